"""Refined instrumental variables for LPV output-error and Box-Jenkins models (Laurain, Gilson, Tóth & Garnier 2010)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, ThroughARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.refined_iv_problem import IVProblem
from lpvid.identification.refined_iv_search import RefinedIvEnd, conditions, covariance, search
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.model.input_stage import InputStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial
from lpvid.simulation import simulate

COUPLED = (1e-6, 0.02)
"""p-value below which, and share of the innovations' power above which, another output's past counts as coupling."""


@dataclass(frozen=True)
class RefinedIV(ThroughARX):
    """LPV output-error or Box-Jenkins structure, estimated by refined instrumental variables.

    ::

        A(p, q) x = B(p, q) u + Σ_{j<affine} c_j(p(k−j)),    y = x + v,    D(q) v = C(q) e

    An auxiliary model is simulated from the last estimate; its noise-free output makes the instruments, an ARMA model
    of y − x̂ and the time-invariant part F of A the prefilter D/(C F) (Laurain et al. 2010; equation sheet 5.9). The
    estimate is consistent for output noise of any colour; with ``noise="box-jenkins"`` the colour is used too. It
    serves as it is, and as a start of prediction-error estimates. Several outputs are estimated one by one, each from
    its own past: where the data show that they couple, the estimate is refused.

    Parameters
    ----------
    na, nb, nk, input, output, basis, affine, lagged
        As for `ARX`.
    noise : {"output", "box-jenkins"}
        White output noise, or C/D with constant coefficients.
    nc, nd : int
        Orders of C and D (box-jenkins).
    stage : None, str or InputStage
        Static input stage; a name is fitted with the least-squares start and then held.
    schedule_filter : None, str or SchedulingStage
        Filter of the scheduling; a name is fitted with the least-squares start and then held.
    iterations : int
        Most iterations.
    tolerance : float
        Relative change of the parameters at which the iteration stops.

    Examples
    --------
    >>> RefinedIV(na=2, nb=2, input="u", output="y", noise="box-jenkins", nc=1, nd=1).channels
    ('u', 'y')
    """

    na: int = 4
    nb: int | tuple[int, ...] = 4
    nk: int | tuple[int, ...] = 1
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=Polynomial)
    noise: str = "output"
    nc: int = 0
    nd: int = 0
    affine: int = 0
    lagged: bool = False
    stage: InputStage | str | None = None
    schedule_filter: SchedulingStage | str | None = None
    iterations: int = 100
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        arx = self.arx  # checks what it shares with this structure
        for name in ("input", "output", "nb", "nk"):
            object.__setattr__(self, name, getattr(arx, name))
        _checks.one_of(self.noise, ("output", "box-jenkins"), "noise")
        _checks.count(self.nc, "nc")
        _checks.count(self.nd, "nd")
        _checks.count(self.iterations, "iterations", at_least=1)
        _checks.positive(self.tolerance, "tolerance")
        if self.noise == "output" and self.nc + self.nd:
            raise InputError("white output noise has no C and D", got=f"nc={self.nc}, nd={self.nd}",
                             mend='set noise="box-jenkins", or nc=nd=0')
        if self.noise == "box-jenkins" and not self.nc + self.nd:
            raise InputError("a Box-Jenkins model needs nc or nd above 0", mend='set noise="output" for white noise')

    @property
    def arx(self) -> ARX:
        """The equation-error structure of the same orders, whose least squares is the start."""
        return ARX(self.na, self.nb, self.nk, self.input, self.output, self.basis, self.affine, self.lagged, self.stage,
                   self.schedule_filter)

    # -- estimate ------------------------------------------------------------------------------------------------
    def estimate(self, records: Sequence[Record]) -> Identification:
        whole = self.arx.estimate(records)  # all checks, the fitted stages, and the box
        fitted: ARX = whole.structure
        bound = replace(self, basis=fitted.basis, stage=fitted.stage, schedule_filter=fitted.schedule_filter)
        with single_thread():
            singles = [self._single(records, fitted, name, whole) for name in fitted.output]
            if len(singles) > 1:
                _refuse_coupling(singles, fitted.output)
        if all(s.fallen_back for s in singles) and len(singles) == 1:
            return whole.replace(notes=(*whole.notes, *singles[0].notes))
        return _assembled(bound, whole, singles)

    def _single(self, records: Sequence[Record], fitted: ARX, output: str, whole: Identification) -> _Single:
        own = replace(fitted, output=(output,))
        least = whole if len(fitted.output) == 1 else own.regress(records, whole.model.box)
        problem = IVProblem(records, own, least.model, own.layout(least.model.n_filter_inputs))
        orders = (self.nc, self.nd) if self.noise == "box-jenkins" else None
        found = search(problem, least.parameters, orders, self.iterations, self.tolerance)
        before = _free_run_error(least.model, records, output)
        to = f" of '{output}'" if len(fitted.output) > 1 else ""
        if found is None:
            return _Single(problem, least, None, (f"refined IV{to}: the least-squares start diverges in free run, even "
                                                  "with its poles drawn in; this is the least-squares estimate",))
        after = _free_run_error(found.run.model, records, output)
        if not after <= before * (1 + 1e-9) + 1e-20 * sum(float(y @ y) for y in problem.y):
            return _Single(problem, least, None, (f"refined IV{to} found nothing better in free run than its start: "
                                                  "this is the least-squares estimate, with equation noise",))
        return _Single(problem, least, found, (_described(found, to),))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        shared = {k: v for k, v in self.arx.to_dict().items() if k not in ("kind", "ridge", "weight")}
        return {"kind": "refined-iv", **shared, "noise": self.noise, "nc": self.nc, "nd": self.nd,
                "iterations": self.iterations, "tolerance": self.tolerance}


@dataclass(frozen=True, eq=False)
class _Single:
    """One output's estimate, or its least squares where refined IV failed."""

    problem: IVProblem
    least: Identification
    found: RefinedIvEnd | None
    notes: tuple[str, ...]

    @property
    def fallen_back(self) -> bool:
        return self.found is None


def _described(found: RefinedIvEnd, to: str) -> str:
    verdict = "converged" if found.converged else "did not converge"
    text = f"refined IV{to} {verdict} in {found.iterations} iterations, last relative change {found.change:.1e}"
    if found.damped:
        text += f"; {found.damped} of them with a step shortened or taken by Newton's rule"
    if found.origin:
        text += f"; {found.origin}"
    if found.converged:
        return text
    still = found.change < 1e-5
    return text + ("; it rests at the least cost, not at a root of its equations" if still else
                   "; the best point met is kept")


def _free_run_error(model: LPVTransferFunction, records: Sequence[Record], output: str) -> float:
    total = 0.0
    for record in records:
        run = simulate(model, record)
        if run.diverged_at is not None:
            return np.inf
        total += float(np.sum((record[output][run.start:] - run.output[run.start:, 0]) ** 2))
    return total


def _refuse_coupling(singles: Sequence[_Single], outputs: Sequence[str]) -> None:
    """Refuse where the innovations of one output are explained by the noise-free past of the others (an F test)."""
    from scipy.stats import f

    for i, single in enumerate(singles):
        others = [(s.found, name) for s, name in zip(singles, outputs, strict=True) if s is not single and s.found]
        if single.found is None or not others:
            continue
        signals = [found.run.noise_free for found, _ in others]
        factor = single.problem.factor(single.found.run, single.found.noise, "others", signals)
        k = single.problem.size
        more = factor.shape[0] - 1 - k
        explained, left = float(np.sum(factor[k:-1, -1] ** 2)), float(factor[-1, -1] ** 2)
        freedom = max(single.problem.rows - k - more, 1)
        whole = explained + left
        if whole <= 1e-20 * sum(float(y @ y) for y in single.problem.y):
            continue
        p_value = float(f.sf(explained / more / max(left / freedom, 1e-300), more, freedom))
        if p_value < COUPLED[0] and explained > COUPLED[1] * whole:
            named = ", ".join(f"'{name}'" for _, name in others)
            share = f"{100 * explained / whole:.0f} %"
            raise InputError(f"output '{outputs[i]}' depends on the past of {named}",
                             got=f"{share} of its innovations explained by it (p = {p_value:.0e})",
                             why="refined IV estimates every output from its own past",
                             mend="raise na and nb, or use ARX or OutputError, which couple outputs")


def _assembled(structure: RefinedIV, whole: Identification, singles: Sequence[_Single]) -> Identification:
    """One model and one covariance from the outputs' own."""
    from scipy.linalg import block_diag

    ny, m = len(structure.output), structure.basis.size  # type: ignore[arg-type]
    nc, nd = structure.nc, structure.nd
    tables, theta, blocks, variances = [], [], [], []
    notes: list[str] = []
    c, d = np.zeros((nc, ny, 1)), np.zeros((nd, ny))
    for o, single in enumerate(singles):
        table = single.problem.layout.table.copy()
        table[:, 2] = o
        table[table[:, 0] == 0, 3] = o
        tables.append(table)
        if single.found is None:
            theta.append(single.least.parameters)
            blocks.append(single.least.covariance)
            variances.append(float(single.least.model.noise_covariance[0, 0]))  # type: ignore[index]
        else:
            block, variance, colour = covariance(single.problem, single.found)
            if colour.d.size:
                of_output = f" of '{structure.output[o]}'" if ny > 1 else ""
                mend = 'noise="box-jenkins"' if structure.noise == "output" else "a noise model of higher order"
                notes.append(f"the {_error_of(structure)}{of_output} is coloured: standard errors allow for an "
                             f"autoregression of order {colour.d.size}; {mend} would use the colour")
            theta.append(single.found.theta)
            blocks.append(block)
            variances.append(variance)
            c[:, o, 0], d[:, o] = _orders(single.found.noise.c, nc), _orders(single.found.noise.d, nd)
    layout, matrix = ParameterLayout(np.vstack(tables)), np.asarray(block_diag(*blocks))
    metadata: dict = {"structure": structure.to_dict(), "training": whole.model.metadata["training"],
                      "refined_iv": [None if s.found is None else
                                     {"iterations": s.found.iterations, "relative_change": s.found.change,
                                      "converged": s.found.converged, "damped": s.found.damped} for s in singles]}
    if layout.size <= COVARIANCE_LIMIT:
        metadata["parameters"] = {"layout": layout.to_list(), "covariance": matrix.tolist()}
    empty = whole.model.replace(a=np.zeros((structure.na, ny, ny, m)), noise=NoiseModel(structure.noise, c, d),
                                noise_covariance=_noise_covariance(singles, variances), metadata=metadata)
    worst = [(s.least.condition, s.least.scaled_condition) if s.found is None else
             conditions(s.found.factor, s.problem.size) for s in singles]
    kind = f"refined IV, coloured {_error_of(structure)}" if notes else "refined IV, white innovations"
    return Identification(layout.fill(empty, np.concatenate(theta)), structure, layout, matrix,
                          max(w[0] for w in worst), max(w[1] for w in worst), whole.n_samples,
                          notes=(*whole.notes, *(n for s in singles for n in s.notes), *notes),
                          covariance_kind=kind)


def _error_of(structure: RefinedIV) -> str:
    """What remains of the output by the noise model of the structure."""
    return "output error" if structure.noise == "output" else "innovation"


def _orders(tail: np.ndarray, order: int) -> np.ndarray:
    return np.concatenate([tail, np.zeros(order - tail.size)])


def _noise_covariance(singles: Sequence[_Single], variances: Sequence[float]) -> np.ndarray:
    """Innovation covariance; between outputs from their innovations, on the diagonal with the degrees of freedom."""
    out = np.diag(np.array(variances))
    if any(s.found is None for s in singles):
        return out
    series = [np.concatenate(list(s.found.innovations)) for s in singles]  # type: ignore[union-attr]
    power = [max(float(e @ e), 1e-300) for e in series]
    for i in range(len(series)):
        for j in range(i):
            out[i, j] = out[j, i] = (float(series[i] @ series[j]) / np.sqrt(power[i] * power[j])
                                     * np.sqrt(variances[i] * variances[j]))
    return out
