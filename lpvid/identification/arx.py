"""LPV-ARX: the equation-error structure, one linear least squares (Bamieh & Giarré 2002)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.condition.constancy import constant
from lpvid.errors import InputError, TooFewSamples
from lpvid.identification.covariance import sandwich_covariance
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.regression import SINGULAR, Columns, Factor, RegressionData, RegressionEstimate, factorize
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.ridge import Ridge
from lpvid.identification.structure import Structure
from lpvid.model.input_stage import STAGES, InputStage
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling
from lpvid.scheduling.basis import checked_basis


@dataclass(frozen=True)
class ARX(Structure):
    """LPV-ARX structure, SISO, MISO or MIMO.

    ::

        y(k) = −Σ_{i=1}^{na} a_i(p) y(k−i) + Σ_{j=nk}^{nk+nb−1} b_j(p) u(k−j) + Σ_{j<affine} c_j(p(k−j)) + e(k)

    Díaz Salas 2011 (3.5)-(3.7) for one input and one variable; Bamieh & Giarré 2002 for the regression. The estimate
    is consistent only for white equation error e.

    Parameters
    ----------
    na : int
        Output lags (every output's past enters every output's equation).
    nb, nk : int or one per input
        Number of input lags, and the first of them; nk = 0 gives a direct term.
    input, output : str or sequence of str
        Channel (or role) names; a comma-separated list serves too.
    basis : Basis
        Dependence on the scheduling variables; normalised to the data's box. Left out: time-invariant.
    affine : int
        Number of affine terms c_0 … c_{affine−1}, each a function of p alone at lag j.
    lagged : bool
        Coefficients of lag i taken at p(k−i): exact in observer form.
    stage : None, "tanh", "three-zone" or InputStage
        Static input stage; a name is fitted to the data, an InputStage is taken as it is.
    schedule_filter : None, "lag", "rise-fall", "lag-delay", "rise-fall-delay" or SchedulingStage
        Filter between the logged scheduling and the coefficients; a name is fitted to the data.
    ridge : float or Ridge
        Penalty on the parameters in unit-column scaling; 0 for plain least squares. A `Ridge` penalises how strongly
        the coefficients depend on the scheduling, and finds its strength from the data.
    weight : str, optional
        Channel of non-negative weights per sample.

    Examples
    --------
    >>> ARX(na=2, nb=2, input="velocity", output="force", basis=Polynomial("current", degree=1)).n_columns
    8
    """

    KIND = "arx"

    na: int = 4
    nb: int | tuple[int, ...] = 4
    nk: int | tuple[int, ...] = 1
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=Polynomial)
    affine: int = 0
    lagged: bool = False
    stage: InputStage | str | None = None
    schedule_filter: SchedulingStage | str | None = None
    ridge: float | Ridge = 0.0
    weight: str | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "input", _checks.names(self.input, "input"))
        set_(self, "output", _checks.names(self.output, "output"))
        shared = set(self.input) & set(self.output)
        if shared:
            raise InputError("a channel cannot be input and output at once", got=", ".join(sorted(shared)),
                             mend="leave it out of the one or the other; past outputs enter by na")
        checked_basis(self.basis)
        own = set(self.output) & set(self.basis.names)
        if own:
            raise InputError("the coefficients depend on the output itself", got=", ".join(sorted(own)),
                             why="in free run that output is simulated, not measured",
                             mend="schedule on another channel, or use QuasiLPV (--structure quasi)")
        _checks.count(self.na, "na")
        _checks.count(self.affine, "affine")
        set_(self, "nb", _checks.counts(self.nb, len(self.input), "nb", at_least=1))
        set_(self, "nk", _checks.counts(self.nk, len(self.input), "nk"))
        if isinstance(self.stage, str):
            _checks.one_of(self.stage, tuple(STAGES), "stage")
        if isinstance(self.schedule_filter, str):
            _checks.one_of(self.schedule_filter, tuple(FITTED), "schedule_filter")
        if self.schedule_filter is not None and not self.basis.names:
            raise InputError("a scheduling filter needs a scheduling variable", mend="give a basis that names one")
        if isinstance(self.stage, InputStage):
            _stage_fits(self.stage, len(self.input), len(self.basis.names))
        if not isinstance(self.ridge, Ridge) and not _checks.real(self.ridge, "ridge") >= 0:
            raise InputError("ridge must not be negative", got=self.ridge)

    # -- sizes --------------------------------------------------------------------------------------------------
    @property
    def summary(self) -> str:
        nb, nk = (",".join(map(str, n)) for n in (self.width, self.delay))
        parts = [f"ARX na={self.na} nb={nb} nk={nk}", self.basis.summary]
        if self.affine:
            parts.append(f"affine {self.affine}")
        if self.lagged:
            parts.append("at p(k-i)")
        stage, lag = self.stage, self.schedule_filter
        if stage is not None:
            parts.append(stage.to_dict()["kind"] if isinstance(stage, InputStage) else stage)
        if lag is not None:
            parts.append(f"filter {lag.to_dict()['kind'] if isinstance(lag, SchedulingStage) else lag}")
        if self.ridge:
            parts.append("ridge")
        return " ".join(parts)

    @property
    def channels(self) -> tuple[str, ...]:
        named = (*self.input, *self.output, *self.basis.names, *((self.weight,) if self.weight else ()))
        return tuple(dict.fromkeys(named))

    @property
    def start(self) -> int:
        back = [self.na, self.affine - 1, *(b + k - 1 for b, k in zip(self.width, self.delay, strict=True))]
        return max(0, *back) + max(self.basis.lags[1], 0)

    @property
    def n_columns(self) -> int:
        """Columns of the regressor (parameters per output), with the stage's own inputs counted."""
        return self._places(self._filter_width())[0].shape[0]

    @property
    def delay(self) -> tuple[int, ...]:
        """First input lag of every input."""
        return self.nk  # type: ignore[return-value]

    @property
    def width(self) -> tuple[int, ...]:
        """Number of input lags of every input."""
        return self.nb  # type: ignore[return-value]

    @property
    def fits_stages(self) -> bool:
        """Whether an input stage or a scheduling filter is to be fitted: named, not given."""
        return isinstance(self.stage, str) or isinstance(self.schedule_filter, str)

    def _shape(self) -> InputStage | None:
        return STAGES[self.stage]() if isinstance(self.stage, str) else self.stage

    def _filter_width(self) -> int:
        stage = self._shape()
        inputs = tuple(Signal(n) for n in self.input)
        return len(inputs) if stage is None else len(stage.signals(inputs))

    def _places(self, width: int) -> tuple[np.ndarray, Columns]:
        """Layout rows (without output) and regressor columns for `width` filter inputs."""
        ny, m = len(self.output), self.basis.size
        one = [label == "1" for label in self.basis.labels]
        stage = self._shape()
        shaped = 0 if stage is None else stage.channel  # inputs that a stage adds have the lags of the one it shapes
        nb = self.width + (self.width[shaped],) * (width - len(self.input))
        nk = self.delay + (self.delay[shaped],) * (width - len(self.input))
        rows: list[tuple[int, int, int, int]] = []
        columns: list[tuple[int, float, int, int, int]] = []

        def add(part: int, index: int, signal: int, source: int, sign: float, lag: int, functions: list[int]) -> None:
            phi_lag = lag if (self.lagged or part == 2) else 0
            for f in functions:
                rows.append((part, index, signal, f))
                columns.append((source, sign, lag, -1 if one[f] else f, phi_lag))

        everything = list(range(m))
        for i in range(1, self.na + 1):
            for q in range(ny):
                add(0, i - 1, q, q, -1.0, i, everything)
        for q in range(width):
            for j in range(nk[q], nk[q] + nb[q]):
                add(1, j, q, ny + q, 1.0, j, everything)
        for j in range(self.affine):
            add(2, j, 0, ny + width, 1.0, j,
                everything if j == 0 or self.basis.redundant is None else
                [f for f in everything if f != self.basis.redundant])
        source, sign, lag, function, phi_lag = (np.array(x) for x in zip(*columns, strict=True))
        return np.array(rows), Columns(source, sign.astype(float), lag, function, phi_lag)

    def layout(self, width: int) -> ParameterLayout:
        """Parameter layout, output by output.

        Parameters
        ----------
        width : int
            Filter inputs: the inputs, or the signals that the input stage makes of them.

        Returns
        -------
        ParameterLayout
        """
        rows, _ = self._places(width)
        part, index, signal, function = rows.T
        tables = [np.column_stack([part, index, np.full(len(rows), o), signal, function])
                  for o in range(len(self.output))]
        return ParameterLayout(np.vstack(tables))

    # -- estimate -----------------------------------------------------------------------------------------------
    def estimate(self, records: Sequence[Record]) -> Identification:
        for name in (*self.input, *self.output):
            require_motion_of(records, name, "input" if name in self.input else "output")
        if self.weight is not None and not all(r[self.weight].min() >= 0 for r in records):
            raise InputError(f"weights in channel '{self.weight}' must not be negative",
                             got=min(float(r[self.weight].min()) for r in records))
        box = scheduling_box(records, self.basis, check_basis=not self.ridge)
        bound = replace(self, basis=self.basis.bound(box))
        if self.fits_stages:
            from lpvid.identification.stage_fit import fit_stages

            return fit_stages(records, bound, box)
        return bound.regress(records, box)

    def regress(self, records: Sequence[Record], box: Scheduling) -> Identification:
        """One least squares with the basis bound and the stage fixed.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        box : Scheduling
            Of the scheduling variables, to which the basis is bound.

        Returns
        -------
        Identification

        Raises
        ------
        InputError
            No more equations than parameters per output, or regressors that the data cannot separate.
        """
        equations = sum(r.n_samples - self.start for r in records)
        per_output = self.places().shape[0]
        if equations <= per_output:
            raise TooFewSamples(f"{equations} equations cannot determine {per_output} parameters per output",
                                mend="give longer records, or lower the orders or the degree")
        return self.solved(records, box, self.factor(records, box))

    def places(self) -> np.ndarray:
        """(columns, 4) part, lag index, signal and basis function of every regressor column, as in a `ParameterLayout`.

        Returns
        -------
        (columns, 4) int array
        """
        return self._places(self._filter_width())[0]

    def factor(self, records: Sequence[Record], box: Scheduling, start: int | None = None) -> Factor:
        """R of [X Y] with the basis bound and the stage fixed; rows from `start` on (by default the structure's).

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        box : Scheduling
            Of the scheduling variables.
        start : int, optional
            First sample of every record that gives an equation; left out, the first whose lags are all inside.

        Returns
        -------
        Factor
        """
        return factorize(records, self._data(box, start))

    def coloured_covariance(self, records: Sequence[Record], found: Identification, memory: int) -> np.ndarray | None:
        if self.ridge or found.scaled_condition > 1 / SINGULAR:
            return None
        data = self._data(found.model.box, None)
        theta = found.parameters.reshape(len(self.output), -1).T
        return sandwich_covariance(records, data, factorize(records, data), theta, memory)

    def _data(self, box: Scheduling, start: int | None) -> RegressionData:
        stage = self.stage if isinstance(self.stage, InputStage) else None
        _, columns = self._places(self._filter_width())
        return RegressionData(self.input, self.output, box.names, self.basis, columns,  # type: ignore[arg-type]
                              self.start if start is None else start, stage, self._filter(), self.weight)

    def solved(self, records: Sequence[Record], box: Scheduling, factor: Factor) -> Identification:
        """The estimate that a factor of these records holds.

        Parameters
        ----------
        records : sequence of Record
            Those of the factor: they give names, units and the rate, and the residual for the covariance.
        box : Scheduling
            Of the scheduling variables, to which the basis is bound.
        factor : Factor
            R of [X Y].

        Returns
        -------
        Identification
            With a remark on the strength where the ridge found its own.
        """
        width = self._filter_width()
        layout, model = self.layout(width), self._empty_model(records[0], box, width)
        names = [n.split(":")[-1] for n in layout.names(model)[: factor.columns]]
        with single_thread():
            if not isinstance(self.ridge, Ridge):
                solved = self.solution(records, box, factor, names)
                return self._package(records, model, layout, factor, solved)
            solution, strength = self.ridge.solve(factor, self.places(), self.basis)
        found = self._package(records, model, layout, factor, solution)
        return found.replace(notes=(*found.notes, f"{self.ridge.describe()}: strength {strength:.3g}"))

    def solution(
        self, records: Sequence[Record], box: Scheduling, factor: Factor, names: Sequence[str]
    ) -> RegressionEstimate:
        """The least squares of a factor; a structure with another criterion on the same regressors replaces it.

        Parameters
        ----------
        records : sequence of Record
            What the factor was made of; rows from `start` on.
        box : Scheduling
            Of the scheduling variables; the basis is bound to it.
        factor : Factor
            R of [X Y].
        names : sequence of str
            One for each column of X.

        Returns
        -------
        RegressionEstimate
        """
        assert not isinstance(self.ridge, Ridge)  # which finds its strength in `solved`
        return factor.solve(self.ridge, list(names), self._spare(records))

    def _spare(self, records: Sequence[Record]) -> np.ndarray | None:
        """Columns of inputs that move together: `separation` states what they leave open. None where it does not."""
        from lpvid.identification.separation import coherence_of

        if len(self.input) < 2 or self.stage is not None or coherence_of(records, self.input) is None:
            return None
        return self.places()[:, 0] == 1

    def _empty_model(self, record: Record, box: Scheduling, width: int) -> LPVTransferFunction:
        ny, m = len(self.output), self.basis.size
        lags = max(b + k for b, k in zip(self.width, self.delay, strict=True))
        assert record.sample_time is not None
        return LPVTransferFunction(
            np.zeros((self.na, ny, ny, m)), np.zeros((lags, ny, width, m)), self.basis, record.sample_time, box,
            np.zeros((self.affine, ny, m)), self.lagged, tuple(Signal(n, record.unit(n)) for n in self.input),
            tuple(Signal(n, record.unit(n)) for n in self.output),
            self.stage if isinstance(self.stage, InputStage) else None, self._filter())

    def _filter(self) -> SchedulingStage | None:
        return self.schedule_filter if isinstance(self.schedule_filter, SchedulingStage) else None

    def _package(self, records: Sequence[Record], model: LPVTransferFunction, layout: ParameterLayout, factor: Factor,
                 solution: RegressionEstimate) -> Identification:
        theta = solution.theta.T.ravel()
        metadata: dict = {"structure": self.to_dict(),
                          "training": {"records": [r.name for r in records], "n_samples": factor.rows}}
        if layout.size <= COVARIANCE_LIMIT:
            metadata["parameters"] = {"layout": layout.to_list(), "covariance": solution.covariance.tolist()}
        model = layout.fill(model, theta).replace(noise_covariance=solution.noise, metadata=metadata)
        return Identification(model, self, layout, solution.covariance, solution.condition, solution.scaled_condition,
                              factor.rows)

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {**super().to_dict(), "nb": list(self.width), "nk": list(self.delay)}


class ThroughARX(Structure):
    """A structure with the equations of an ARX: it reads the same channels and starts at the same sample.

    Attributes
    ----------
    arx : ARX
        A field or a property.
    """

    arx: ARX

    @property
    def summary(self) -> str:
        return type(self).__name__ + self.arx.summary.removeprefix("ARX")

    @property
    def channels(self) -> tuple[str, ...]:
        return self.arx.channels

    @property
    def start(self) -> int:
        return self.arx.start

    @property
    def n_columns(self) -> int:
        """Columns of the regressor (parameters per output), with the stage's own inputs counted."""
        return self.arx.n_columns


def _stage_fits(stage: InputStage, inputs: int, variables: int) -> None:
    if not 0 <= stage.channel < inputs:
        raise InputError("the input stage shapes an input that is not there",
                         got=f"channel {stage.channel} of {inputs}", mend="count inputs from 0")
    if variables and not 0 <= stage.variable < variables:
        raise InputError("the input stage depends on a scheduling variable that is not there",
                         got=f"variable {stage.variable} of {variables}", mend="count variables from 0")


def require_motion_of(records: Sequence[Record], name: str, what: str) -> None:
    """Refuse a channel that has one value in all records.

    Parameters
    ----------
    records : sequence of Record
        Finite.
    name : str
    what : {"input", "output"}
        What it is, for the message.

    Raises
    ------
    InputError
        With the value, why it matters, and the mend.
    """
    low, high = min(float(r[name].min()) for r in records), max(float(r[name].max()) for r in records)
    if not high > low:
        raise InputError(f"{what} '{name}' never moves", got=f"the constant {low:.6g}",
                         why="there is nothing to model" if what == "output" else "its effect cannot be identified",
                         mend="check the sensor and the file" if what == "output" else
                         "leave it out (a constant is part of the model anyhow), or check the sensor")


def scheduling_box(records: Sequence[Record], basis: Basis, *, check_basis: bool = True) -> Scheduling:
    """The box around the data's scheduling, refused where these data cannot carry the basis.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    basis : Basis
        Its variables are those of the box; a basis without any gives an empty box.
    check_basis : bool
        Whether the number of distinct levels must suffice for the basis.

    Returns
    -------
    Scheduling
        Lowest and highest value of each variable over all records, with its unit.

    Raises
    ------
    InputError
        A variable that is constant over the whole data set, or fewer distinct levels than the basis needs.
    """
    names = basis.names
    if not names:
        return Scheduling((), (), ())
    ranges = [(r.matrix(names).min(axis=0), r.matrix(names).max(axis=0)) for r in records]
    low, high = np.min([a for a, _ in ranges], axis=0), np.max([b for _, b in ranges], axis=0)
    for name, lo, hi in zip(names, low, high, strict=True):
        if basis.degree != 0 and constant(float(lo), float(hi), records[0].unit(name)):
            raise is_constant(name, float(lo), float(hi), records[0].unit(name))
    units = tuple(records[0].unit(n) for n in names)
    box = Scheduling(names, tuple(low.tolist()), tuple(high.tolist()), units=units)
    if check_basis:
        _enough_levels(records, basis.bound(box))
    return box


def is_constant(name: str, low: float, high: float, unit: str) -> InputError:
    """What is wrong with a scheduling variable that does not move.

    Parameters
    ----------
    name : str
    low, high : float
        Least and largest value over the whole data set, in SI.
    unit : str

    Returns
    -------
    InputError
    """
    size = max(abs(low), abs(high))
    moves = f"{low:.6g} {unit}".rstrip() if high == low else (
        f"{0.5 * (low + high):.6g} ± {0.5 * (high - low):.2g} {unit}".rstrip()
        + f", {100 * (high - low) / size:.2g} % of its size")
    return InputError(f"scheduling variable '{name}' is constant over the whole data set", got=moves,
                      why="a dependence on it cannot be identified",
                      mend="use degree 0, leave the scheduling out (no --schedule), or add records at other levels")


def _enough_levels(records: Sequence[Record], bound: Basis) -> None:
    gram = np.zeros((bound.size, bound.size))
    for record in records:
        step = max(1, record.n_samples // 20_000)
        phi = bound.evaluate(record.matrix(bound.names)[::step])
        gram += phi.T @ phi
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    if values[0] > 1e-12 * values[-1]:
        return
    levels = {n: _levels(np.concatenate([r[n] for r in records])) for n in bound.names}
    described = ", ".join(f"'{n}' takes {k} level{'s' if k > 1 else ''}" for n, k in levels.items())
    mixed = [bound.labels[i] for i in np.argsort(-np.abs(vectors[:, 0])) if abs(vectors[i, 0]) > 0.05][:6]
    raise InputError(f"a basis of {bound.size} functions cannot be identified from these data", got=described,
                     why=f"there the functions {', '.join(mixed)} are linearly dependent",
                     mend="lower the degree or the number of segments, add ridge, or add records at other levels")


def _levels(values: np.ndarray) -> int:
    reach = float(np.ptp(values)) or 1.0
    return len(np.unique(np.round((values - values.min()) / reach, 9)))
