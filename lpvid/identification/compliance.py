"""Compliance: a damper law in series with a spring, fitted to its free run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError, NumericalError
from lpvid.identification.arx import require_motion_of, scheduling_box
from lpvid.identification.compliance_problem import ComplianceProblem
from lpvid.identification.free_run_search import FreeRunSearchEnd, Prior, minimise, package, wanted_filter
from lpvid.identification.result import Identification
from lpvid.identification.stage_fit import shorten
from lpvid.identification.structure import Structure
from lpvid.model.compliance import HEAD, ComplianceModel, Element, checked_knots
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.model.signals import Signal
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling, Spline
from lpvid.validation.trust import QUANTILE

SHARES = (0.003, 0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 1.0)
"""default knots on either side of zero, as shares of the largest speed: fine where a damper's law bends."""
LAGS = (0.3, 3.0)
"""starting time constants of the series spring at the law's steep part, in samples."""
KNEES = (0.05, 0.25)
"""starting knees of the law, as shares of the largest speed."""
SHORT_SEARCH = 15
"""iterations from every start before the best one is followed to its end on all data."""
SAMPLES = 12_000
"""samples on which the starts are compared."""
SURE = 0.02
"""what one equation of the prior is worth, as a share of the output's spread."""


@dataclass(frozen=True)
class Compliance(Structure):
    """Damper law in series with a spring, plus linear terms in parallel: first-order LPV, stable for every ρ > 0.

    The equations and the proof of boundedness stand at `lpvid.model.compliance.ComplianceModel` (equation sheet 9.3).
    The law's rises from knot to knot and the stiffness are fitted by their logarithms, so that every trial of a search
    is a rising law and a positive stiffness: no step of it can diverge. Free-run Levenberg-Marquardt with exact
    sensitivities, from several stiffnesses and knees.

    Parameters
    ----------
    input, output : str
        Velocity [m/s] and force [N], in the same sense (a passive damper has mean(F·v) > 0).
    current : str, optional
        Current or voltage on which the law depends, by hat functions on `levels`.
    knots : tuple of float, optional
        Fluid speeds at which the law bends, 0 among them [m/s]; left out, ± a geometric set up to the largest speed.
    levels : int
        Segments of the hat functions in the current.
    lags : int
        Linear terms d_0 v(k) + d_1 v(k−1) + … in parallel (viscous, inertia, timing of the sensors).
    side : str or sequence of str
        Further channels that act linearly in parallel, e.g. displacement for a gas spring.
    states : 1 or 2
        Elements in parallel. (Two in series are one.)
    asymmetric : bool
        Whether rebound and compression have laws of their own.
    schedule_filter : None, name or SchedulingStage
        Filter on the current; a name is fitted along.
    smoothness : float
        Weight of differences of neighbouring log-slopes (along speed, and along current), in equations that are worth
        2 % of the output's spread.
    substeps : int
        Implicit Euler steps per sample.
    max_iterations : int
    tolerance : float

    Examples
    --------
    >>> Compliance(current="current", side="displacement").channels
    ('velocity', 'force', 'displacement', 'current')
    """

    KIND = "compliance"
    JSON = ("input", "output", "current", "knots", "levels", "lags", "side", "states", "asymmetric", "schedule_filter",
            "smoothness", "substeps")

    input: str = "velocity"
    output: str = "force"
    current: str | None = None
    knots: tuple[float, ...] | None = None
    levels: int = 2
    lags: int = 1
    side: str | tuple[str, ...] = ()
    states: int = 1
    asymmetric: bool = True
    schedule_filter: SchedulingStage | str | None = None
    smoothness: float = 0.1
    substeps: int = 4
    max_iterations: int = 80
    tolerance: float = 1e-5

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "side", _checks.names(self.side, "side") if self.side else ())
        for name in ("input", "output"):
            set_(self, name, _checks.names(getattr(self, name), name)[0])
        if len({self.input, self.output, *self.side}) < 2 + len(self.side):
            raise InputError("a compliance needs different channels for velocity, force and side terms",
                             got=", ".join((self.input, self.output, *self.side)))
        if self.knots is not None:
            set_(self, "knots", tuple(checked_knots(self.knots).tolist()))
        if _checks.count(self.states, "states", at_least=1) > 2:
            raise InputError("a compliance has one or two states", got=self.states)
        for name, least in (("levels", 1), ("lags", 0), ("substeps", 1), ("max_iterations", 0)):
            _checks.count(getattr(self, name), name, at_least=least)
        if isinstance(self.schedule_filter, str):
            _checks.one_of(self.schedule_filter, tuple(FITTED), "schedule_filter")
        if self.schedule_filter is not None and self.current is None:
            raise InputError("a scheduling filter needs a current", mend="name the current's channel")
        if not _checks.real(self.smoothness, "smoothness") > 0:
            raise InputError("smoothness must be positive", got=self.smoothness,
                             why="speeds that the data do not reach would have any slope")

    @property
    def channels(self) -> tuple[str, ...]:
        return (self.input, self.output, *self.side, *((self.current,) if self.current else ()))

    @property
    def start(self) -> int:
        return max(self.lags, HEAD if self.states > 1 else 1)

    # -- estimate -----------------------------------------------------------------------------------------------
    def estimate(self, records: Sequence[Record]) -> Identification:
        for name in (self.input, self.output, *self.side):
            require_motion_of(records, name, "output" if name == self.output else "input")
        work = sum(float(r[self.input] @ r[self.output]) for r in records)
        if not work > 0:
            raise InputError("force and velocity have opposite senses", got=f"mean(F·v) {work:.3g} < 0",
                             why="a compliance is passive", mend="turn one channel with record.flip or --flip")
        basis: Basis = Spline(self.current, self.levels, 1) if self.current else Polynomial()
        box = scheduling_box(records, basis)
        with single_thread():
            tried = []
            sample, free = shorten(records, SAMPLES, self.start + 50), isinstance(self.schedule_filter, str)
            for model in self._starts(records, box, basis.bound(box) if box.names else basis):
                problem = ComplianceProblem.of(sample, model, free, self.asymmetric)
                start = problem.with_linear_terms(problem.start())
                found = self._search(problem, start, min(SHORT_SEARCH, self.max_iterations))
                if found is not None:
                    tried.append((problem, found))
            if not tried:
                raise NumericalError("no start of the compliance search gives a finite run; look at the data's scale")
            best_problem, best = min(tried, key=lambda t: t[1].cost)
            problem = ComplianceProblem.of(records, best_problem.model, free, self.asymmetric)
            found = self._search(problem, best.trial.x, self.max_iterations)
            assert found is not None
            whole = package(self, problem.model_at(found.trial.x), problem, found, records,
                            (f"best of {len(tried)} starts",), problem.matrix)
        return whole.replace(notes=(*whole.notes, *rigid_remarks(whole)))

    def _search(self, problem: ComplianceProblem, start: np.ndarray, iterations: int) -> FreeRunSearchEnd | None:
        scales, prior = self._prior(problem)
        return minimise(problem, prior, start, scales, max_iterations=iterations, tolerance=self.tolerance)

    def _starts(self, records: Sequence[Record], box: Scheduling, basis: Basis) -> Iterator[ComplianceModel]:
        period = records[0].sample_time
        assert period is not None
        v, y = (np.concatenate([r[n] for r in records]) for n in (self.input, self.output))
        peak, force = float(np.abs(v).max()), np.quantile(np.abs(y - y.mean()), 0.9)
        knots = np.array(self.knots) if self.knots else peak * np.array([-s for s in SHARES[::-1]] + [0.0, *SHARES])
        sizes = self._sizes(records, basis, float(force))
        for place, knee in enumerate(KNEES):
            stage = wanted_filter(self.schedule_filter, period, place)
            shape = np.tanh(knots / (knee * peak)) + 0.1 * knots / peak
            laws = sizes[:, None] * shape / self.states
            for lag in LAGS:
                steep = float(force) / (knee * peak) / self.states
                stiff = [steep / (lag * period) * factor for factor in (1.0, 20.0)[: self.states]]
                yield ComplianceModel([Element(laws, k) for k in stiff], knots, np.zeros(self.lags),
                                      np.zeros(len(self.side)), 0.0, period,
                                      tuple(Signal(n, records[0].unit(n)) for n in (self.input, *self.side)),
                                      (Signal(self.output, records[0].unit(self.output)),), basis, box, stage,
                                      self.substeps)

    def _sizes(self, records: Sequence[Record], basis: Basis, force: float) -> np.ndarray:
        """(Q,) starting force of the law at every level of the current: a high quantile of |y| near that level."""
        if self.current is None:
            return np.array([force])
        phi = np.vstack([basis.evaluate(r.matrix([self.current])) for r in records])
        y = np.abs(np.concatenate([r[self.output] for r in records]))
        near = [y[w > 0.5] for w in phi.T]
        return np.array([float(np.quantile(x, 0.9)) if x.size > 50 else force for x in near]) + 0.01 * force

    def _prior(self, problem: ComplianceProblem) -> tuple[np.ndarray, Prior]:
        """Scales of the parameters; smooth log-slopes, and a faint pull of the linear terms to zero."""
        model, spread = problem.model, problem.spread
        weight = np.sqrt(self.smoothness) * SURE * spread
        q, width, size = model.current.size, problem.widths.size, problem.start().size
        rows, values, place = [], [], 0
        logs = np.log(problem.widths)
        for _ in model.elements:
            index = place + np.arange(q * width).reshape(q, width)
            pairs = [(a, b, logs[j + 1] - logs[j]) for i in range(q) for j, (a, b) in
                     enumerate(zip(index[i, :-1], index[i, 1:], strict=True))]
            pairs += [(a, b, 0.0) for i in range(q - 1) for a, b in zip(index[i], index[i + 1], strict=True)]
            for a, b, difference in pairs:
                row = np.zeros(size)
                row[a], row[b] = -weight, weight
                rows.append(row)
                values.append(weight * difference)
            place += q * width + 1
        reach = [float(np.sqrt(np.mean(np.concatenate([u[:, 0] for u in problem.inputs]) ** 2)))] * model.direct.size
        reach += [float(np.sqrt(np.mean(np.concatenate([u[:, 1 + j] for u in problem.inputs]) ** 2)))
                  for j in range(model.side.size)]
        for j, r in enumerate([*reach, 1.0]):
            row = np.zeros(size)
            row[place + j] = SURE * r
            rows.append(row)
            values.append(0.0)
        linear = [0.1 * spread / r for r in [*reach, 1.0]]
        scales = np.concatenate([np.ones(place), linear, problem.filter_scales])
        return scales, Prior(np.array(rows), np.array(values))


def rigid_remarks(found: Identification) -> tuple[str, ...]:
    """Springs whose compliance the data do not distinguish from none.

    The compliance 1/k has the relative standard error of ln k; within `QUANTILE` of its own standard errors it may be
    zero, which is an element without a spring.

    Parameters
    ----------
    found : Identification
        Of a `Compliance`.

    Returns
    -------
    tuple of str
        One remark for each such spring.
    """
    named = zip(found.parameter_names, found.parameters.tolist(), found.standard_errors.tolist(), strict=True)
    return tuple(f"not identifiable: the stiffness {name.removeprefix('ln ')}, {np.exp(value):.3g} N/m: at the 95 % "
                 "level these data do not distinguish its compliance from none, and a rigid element would do"
                 for name, value, error in named if name.startswith("ln k_h") and not 0 < QUANTILE * error < 1)
