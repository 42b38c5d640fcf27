"""Right-coprime LPV model: identified in the coordinates of the controllable canonical form, gap zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.form_layout import bounded_start
from lpvid.identification.result import Identification
from lpvid.identification.state_space_layout import ARRAYS, StateSpaceLayout
from lpvid.identification.state_space_result import StateSpaceStructure, package
from lpvid.identification.state_space_search import SearchData, StateSpaceSearchEnd, refine
from lpvid.identification.structure import Structure
from lpvid.model.input_stage import InputStage
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.varying import unity
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial

RIDGES = (0.0, 1e-6, 1e-3)
"""penalties of the warm start, each tried where the one before cannot be solved or leads nowhere."""


@dataclass(frozen=True)
class RightCoprime(StateSpaceStructure):
    """Right-coprime LPV structure: output error, one output, one latent signal w per input.

    ::

        w(k) + Σ_{i=1}^{na} a_i(p(k−1)) w(k−i) = u(k−1)
        y(k) = Σ_{j=1}^{nb} b_j(p(k)) w(k−j+1) [+ d(p(k)) u(k)] + e(k)

    The controllable canonical form of Díaz Salas 2011 (3.8)-(3.13), A(p_k) companion, B constant, C(p_k), realises
    exactly this (equation sheet 5.6 (a)); the transfer function with the same coefficients is another system as soon as
    p moves. What is estimated here *is* that state-space model. The error is minimised over its free run by
    Levenberg-Marquardt with exact sensitivities. It starts from least squares (for slow p the coefficients agree); at
    first its a_i are kept and the numerators fitted again, a linear problem.

    Parameters
    ----------
    na, nb : int
        Lags of w in its recursion, and in the output.
    input, output : str or sequence of str
        Channel (or role) names; one output. Several inputs share a_i and have a w and b_j each.
    basis : Basis
        Dependence on p(k).
    direct : bool
        Whether u(k) acts on y(k) directly.
    affine : int
        Affine terms: the first is c_0(p) on the output, further ones filter the constant 1 as an input of its own.
    stage, schedule_filter
        As in `ARX`; a name is fitted with the warm start and held.
    iterations : int
        Linearisations at most.

    Examples
    --------
    >>> RightCoprime(na=2, nb=2, input="u", output="y", basis=Polynomial("p", degree=1)).order
    2
    """

    KIND = "right-coprime"

    na: int = 4
    nb: int = 4
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=Polynomial)
    direct: bool = False
    affine: int = 0
    stage: InputStage | str | None = None
    schedule_filter: SchedulingStage | str | None = None
    iterations: int = 60

    def __post_init__(self) -> None:
        _, outputs = self._check_signals()
        if len(outputs) > 1:
            raise InputError("the right-coprime form is for a single output", got=", ".join(outputs),
                             mend="use StateSpaceError for several outputs")
        _checks.count(self.na, "na")
        _checks.count(self.nb, "nb", at_least=1)
        _checks.count(self.affine, "affine")
        _checks.count(self.iterations, "iterations")
        self._warm_structure(0.0, lagged=False)  # its checks of stage and filter

    summary = Structure.summary

    @property
    def order(self) -> int:
        """States per input."""
        return max(self.na, self.nb)

    @property
    def start(self) -> int:
        return self._warm_structure(0.0, lagged=False).start

    def estimate(self, records: Sequence[Record]) -> Identification:
        box = scheduling_box(records, self.basis)
        bound = replace(self, basis=self.basis.bound(box))
        found: list[tuple[StateSpaceSearchEnd, StateSpaceLayout]] = []
        for warm in bound._warm_starts(records):
            template = bound.empty(warm)
            layout = bound.layout(template)
            data = SearchData.of(records, template)
            theta = bound._from_transfer_function(warm, template, layout)
            begun = bounded_start(layout.fill(template, theta), layout, data, self.na)
            found.append((refine(begun.model, layout.outputs, data, iterations=2, free_coordinates=False), layout))
        found.sort(key=lambda pair: pair[0].evaluation.cost)
        ends = [(refine(s.model, layout, s.data, iterations=self.iterations, free_coordinates=False), layout)
                for s, layout in found[:2]]
        best, layout = min(ends, key=lambda pair: pair[0].evaluation.cost)
        return package(bound, best, layout, records,
                       [f"output error from {len(ends)} of {len(found)} starts, {best.iterations} Levenberg-Marquardt "
                        f"steps; stopped because {best.why}"], free_coordinates=False)

    # -- the warm start -----------------------------------------------------------------------------------------
    def _warm_structure(self, ridge: float, *, lagged: bool) -> ARX:
        lags = self.nb + 1 if self.direct else self.nb
        return ARX(na=self.na, nb=lags, nk=0 if self.direct else 1, input=self.input, output=self.output,
                   basis=self.basis, affine=self.affine, lagged=lagged, stage=self.stage,
                   schedule_filter=self.schedule_filter, ridge=ridge)

    def _warm_starts(self, records: Sequence[Record]) -> list[LPVTransferFunction]:
        """Least-squares models, coefficients at p(k) and at p(k−i); with a penalty where the data ask for one."""
        found, refusal = [], None
        stage, lag = self.stage, self.schedule_filter
        for ridge in RIDGES:
            for lagged in (False, True):
                try:
                    warm = replace(self, stage=stage, schedule_filter=lag)._warm_structure(ridge, lagged=lagged)
                    model = warm.estimate(records).model
                except InputError as error:
                    refusal = error
                    continue
                stage, lag = model.input_stage, model.scheduling_stage  # searched once
                found.append(model)
        if not found:
            assert refusal is not None
            raise refusal
        return found

    # -- the canonical form -------------------------------------------------------------------------------------
    def empty(self, warm: LPVTransferFunction) -> LPVStateSpace:
        """The canonical form with zero coefficients: chains of states, driven by the inputs and by 1.

        Parameters
        ----------
        warm : LPVTransferFunction
            Gives rate, box, signals and stages.

        Returns
        -------
        LPVStateSpace
            Over this structure's basis; only the ones of the canonical form stand in it.
        """
        n, nu, m = self.order, warm.n_filter_inputs, self.basis.size
        blocks = nu + (1 if self.affine > 1 else 0)
        orders = [n] * nu + ([max(self.na, self.affine - 1)] if self.affine > 1 else [])
        ones = unity(self.basis)
        size = sum(orders)
        a, b, f = np.zeros((m, size, size)), np.zeros((m, size, nu)), np.zeros((m, size))
        first = 0
        for block in range(blocks):
            last = first + orders[block] - 1
            for row in range(first, last):
                a[:, row, row + 1] = ones
            if block < nu:
                b[:, last, block] = ones
            else:
                f[:, last] = ones
            first = last + 1
        return LPVStateSpace(a, b, np.zeros((m, 1, size)), np.zeros((m, 1, nu)), self.basis, warm.sample_time, warm.box,
                             f, inputs=warm.inputs, outputs=warm.outputs, input_stage=warm.input_stage,
                             scheduling_stage=warm.scheduling_stage)

    def layout(self, template: LPVStateSpace) -> StateSpaceLayout:
        """Parameters a_i (shared by all chains), b_j per input, d, c_j; the rest of the form is fixed.

        Parameters
        ----------
        template : LPVStateSpace
            The form from `empty`, for its filter inputs.

        Returns
        -------
        StateSpaceLayout
            Parameters in the order a_1 …, then per input d and b_1 …, then c_0 …; each over the whole basis.
        """
        m, nu = self.basis.size, template.n_filter_inputs
        code = {name: place for place, name in enumerate(ARRAYS)}
        rows: list[tuple[int, ...]] = []
        labels: list[str] = []
        chains = [self.order] * nu + ([max(self.na, self.affine - 1)] if self.affine > 1 else [])
        ends = np.cumsum(chains) - 1
        several = nu > 1

        def add(label: str, entries: list[tuple[str, int, int, int]]) -> None:
            for f in range(m):
                rows.extend((len(labels), code[name], f, row, column, sign) for name, row, column, sign in entries)
                labels.append(label)

        for i in range(1, self.na + 1):
            add(f"a{i}", [("A", end, end + 1 - i, -1) for end in ends])
        for q in range(nu):
            where = f"{{{template.filter_inputs[q].name}}}" if several else ""
            if self.direct:
                add(f"d{where}", [("D", 0, q, 1)])
            for j in range(1, self.nb + 1):
                add(f"b{j}{where}", [("C", 0, ends[q] + 1 - j, 1)])
        if self.affine:
            add("c0", [("output_offset", 0, 0, 1)])
        for j in range(1, self.affine):
            add(f"c{j}", [("C", 0, ends[-1] + 1 - j, 1)])
        return StateSpaceLayout(np.array(rows), tuple(labels))

    def _from_transfer_function(self, warm: LPVTransferFunction, template: LPVStateSpace,
                                layout: StateSpaceLayout) -> np.ndarray:
        """Parameters of the canonical form whose frozen behaviour is the transfer function's (to the basis' reach)."""
        assert warm.c is not None
        values: dict[str, list[np.ndarray]] = {}
        for i in range(self.na):
            values[f"a{i + 1}"] = [warm.a[i, 0, 0]]
        several = template.n_filter_inputs > 1
        for q in range(template.n_filter_inputs):
            where = f"{{{template.filter_inputs[q].name}}}" if several else ""
            start = warm.b[0, 0, q]
            values[f"d{where}"] = [start]
            for j in range(1, self.nb + 1):
                back = self._product(warm.a[j - 1, 0, 0], start, warm) if self.direct and j <= self.na else 0.0
                values[f"b{j}{where}"] = [warm.b[j, 0, q] - back]
        start = warm.c[0, 0] if self.affine else np.zeros(self.basis.size)
        for j in range(self.affine):
            back = self._product(warm.a[j - 1, 0, 0], start, warm) if 1 <= j <= self.na else 0.0
            values[f"c{j}"] = [warm.c[j, 0] - back]
        stems = layout.labels[:: self.basis.size]
        return np.concatenate([values[stem][0] for stem in stems])

    def _product(self, x: np.ndarray, y: np.ndarray, warm: LPVTransferFunction) -> np.ndarray:
        """Coefficients of the product of two functions, as well as the basis can express it over the box."""
        phi = self.basis.evaluate(warm.box.grid(7))
        return np.linalg.lstsq(phi, (phi @ x) * (phi @ y), rcond=1e-10)[0]

