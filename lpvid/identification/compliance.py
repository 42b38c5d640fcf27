"""Compliance: a damper law in series with a spring, fitted to its free run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError, NumericalError
from lpvid.identification.arx import _moves, scheduling_box
from lpvid.identification.free_run_search import NUDGE, Found, Piece, Prior, minimise, package, wanted_filter
from lpvid.identification.result import Identification
from lpvid.identification.structure import Structure
from lpvid.model.compliance import HEAD, ComplianceModel, Element, checked_knots
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.model.signals import Signal
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling, Spline

SHARES = (0.003, 0.01, 0.025, 0.05, 0.1, 0.2, 0.4, 1.0)
"""default knots on either side of zero, as shares of the largest speed: fine where a damper's law bends."""
LAGS = (0.3, 3.0)
"""starting time constants of the series spring at the law's steep part, in samples."""
KNEES = (0.05, 0.25)
"""starting knees of the law, as shares of the largest speed."""
TASTE = 15
"""iterations from every start before the best one is followed to its end."""
SURE = 0.02
"""what one equation of the prior is worth, as a share of the output's spread."""
SMALLEST = 1e-8
"""smallest rise of the law from knot to knot, as a share of the output's spread."""


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
            _moves(records, name, "output" if name == self.output else "input")
        work = sum(float(r[self.input] @ r[self.output]) for r in records)
        if not work > 0:
            raise InputError("force and velocity have opposite senses", got=f"mean(F·v) {work:.3g} < 0",
                             why="a compliance is passive", mend="turn one channel with record.flip or --flip")
        basis: Basis = Spline(self.current, self.levels, 1) if self.current else Polynomial()
        box = scheduling_box(records, basis)
        with single_thread():
            tried = []
            for model in self._starts(records, box, basis.bound(box) if box.names else basis):
                problem = ComplianceProblem.of(records, model, isinstance(self.schedule_filter, str), self.asymmetric)
                start = problem.with_linear_terms(problem.start())
                found = self._search(problem, start, min(TASTE, self.max_iterations))
                if found is not None:
                    tried.append((problem, found))
            if not tried:
                raise NumericalError("no start of the compliance search gives a finite run; look at the data's scale")
            problem, tasted = min(tried, key=lambda t: t[1].cost)
            found = self._search(problem, tasted.x, self.max_iterations)
            assert found is not None
            model = problem.model_at(found.x)
            return package(self, model, problem.free(), problem.expanded(found), records,
                           (f"best of {len(tried)} starts",))

    def _search(self, problem: ComplianceProblem, start: np.ndarray, iterations: int) -> Found | None:
        scales, prior = self._prior(problem)
        return minimise(problem, prior, start, scales, max_iterations=iterations, tolerance=self.tolerance)

    def _starts(self, records: Sequence[Record], box: Scheduling, basis: Basis) -> Iterator[ComplianceModel]:
        period = records[0].sample_time
        assert period is not None
        v, y = (np.concatenate([r[n] for r in records]) for n in (self.input, self.output))
        peak, force = float(np.abs(v).max()), np.quantile(np.abs(y - y.mean()), 0.9)
        knots = np.array(self.knots) if self.knots else peak * np.array([-s for s in SHARES[::-1]] + [0.0, *SHARES])
        sizes = self._sizes(records, basis, float(force))
        stage = wanted_filter(self.schedule_filter, period)
        for knee in KNEES:
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

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        lag = self.schedule_filter
        return {"kind": "compliance", "input": self.input, "output": self.output, "current": self.current,
                "knots": None if self.knots is None else list(self.knots), "levels": self.levels, "lags": self.lags,
                "side": list(self.side), "states": self.states, "asymmetric": self.asymmetric,
                "schedule_filter": lag.to_dict() if isinstance(lag, SchedulingStage) else lag,
                "smoothness": self.smoothness, "substeps": self.substeps}


@dataclass(frozen=True, eq=False)
class ComplianceProblem:
    """Free-run errors of a compliance over records, and their exact Jacobian.

    The parameter vector: for every element the log-rises (tied in pairs about zero in a symmetric law) and ln k_h, then
    the linear terms, then the filter's where that is fitted (its columns are difference quotients).
    """

    model: ComplianceModel
    inputs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]
    scheduling: tuple[np.ndarray, ...]
    free_filter: bool
    tie: np.ndarray
    """(M − 1,) place of each rise's parameter among those of its current level."""

    @classmethod
    def of(cls, records: Sequence[Record], model: ComplianceModel, free_filter: bool,
           asymmetric: bool) -> ComplianceProblem:
        """Read the records once."""
        rises = model.knots.size - 1
        tie = np.arange(rises)
        if not asymmetric:
            if not np.allclose(model.knots, -model.knots[::-1]):
                raise InputError("a symmetric law needs symmetric knots", got=model.knots.tolist())
            tie = np.abs(np.arange(rises) - (rises - 1) / 2).astype(int)
        return cls(model, tuple(np.ascontiguousarray(r.matrix([s.name for s in model.inputs])) for r in records),
                   tuple(np.array(r[model.outputs[0].name]) for r in records),
                   tuple(r.matrix(list(model.box.names)) for r in records), free_filter, tie)

    def free(self) -> ComplianceProblem:
        """The same problem without ties."""
        return ComplianceProblem(self.model, self.inputs, self.outputs, self.scheduling, self.free_filter,
                                 np.arange(self.tie.size))

    # -- parameters -----------------------------------------------------------------------------------------------
    @property
    def spread(self) -> float:
        """Standard deviation of the output."""
        return float(np.std(np.concatenate(self.outputs)))

    @property
    def widths(self) -> np.ndarray:
        """Knot spacing that belongs to every rise parameter."""
        out = np.zeros(self.tie.max() + 1)
        out[self.tie] = np.diff(self.model.knots)
        return out

    @property
    def filter_scales(self) -> np.ndarray:
        """Search steps of the filter's parameters."""
        stage = self.model.scheduling_stage
        return stage.scales() if self.free_filter and stage is not None else np.zeros(0)

    @property
    def matrix(self) -> np.ndarray:
        """(model parameters, own parameters) selection of each model parameter."""
        q, k = self.model.current.size, self.tie.max() + 1
        one = np.zeros((self.tie.size, k))
        one[np.arange(self.tie.size), self.tie] = 1.0
        element = np.zeros((q * self.tie.size + 1, q * k + 1))
        element[:-1, :-1] = np.kron(np.eye(q), one)
        element[-1, -1] = 1.0
        rest = np.eye(self.model.direct.size + self.model.side.size + 1 + self.filter_scales.size)
        blocks = [element] * len(self.model.elements) + [rest]
        out = np.zeros((sum(b.shape[0] for b in blocks), sum(b.shape[1] for b in blocks)))
        row = column = 0
        for b in blocks:
            out[row: row + b.shape[0], column: column + b.shape[1]] = b
            row, column = row + b.shape[0], column + b.shape[1]
        return out

    def start(self) -> np.ndarray:
        """Own parameters of the model."""
        stage = self.model.scheduling_stage
        whole = np.concatenate([self.model.vector, stage.vector if self.filter_scales.size and stage else np.zeros(0)])
        select = self.matrix
        return select.T @ whole / select.sum(axis=0)

    def expanded(self, found: Found) -> Found:
        """The find in untied parameters, for the covariance."""
        select = self.matrix
        gram = select @ found.gram @ select.T
        return Found(select @ found.x, found.cost, found.first_cost, gram, found.iterations, found.why)

    def model_at(self, x: np.ndarray) -> ComplianceModel:
        """The model at a parameter vector; rises are kept above rounding and below overflow."""
        whole = self.matrix @ x
        cut = whole.size - self.filter_scales.size
        vector = whole[:cut].copy()
        logs = len(self.model.elements) * (self.model.current.size * self.tie.size + 1)
        floor = np.log(SMALLEST * self.spread)
        per = self.model.current.size * self.tie.size + 1
        for place in range(logs):
            if place % per != per - 1:
                vector[place] = np.clip(vector[place], floor, floor + 60)
            else:
                vector[place] = np.clip(vector[place], -60, 60)
        model = self.model.with_vector(vector)
        if self.filter_scales.size:
            assert model.scheduling_stage is not None
            model = model.replace(scheduling_stage=model.scheduling_stage.with_vector(whole[cut:]))
        return model

    def _scheduling(self, model: ComplianceModel, p: np.ndarray) -> np.ndarray:
        return p if model.scheduling_stage is None else model.scheduling_stage.apply(p, model.sample_time)

    # -- errors ---------------------------------------------------------------------------------------------------
    def pieces(self, x: np.ndarray, jacobian: bool) -> Iterator[Piece]:
        """Errors of the free run and their Jacobian, record by record."""
        model = self.model_at(x)
        select = self.matrix if jacobian else np.zeros((0, 0))
        for u, y, p in zip(self.inputs, self.outputs, self.scheduling, strict=True):
            behind = self._scheduling(model, p)
            if not jacobian:
                run, _ = model.free_run(u, behind, y[: model.start], np.inf)
                yield (run - y)[model.start:], None
                continue
            run, slopes = sensitivity(model, u, behind, y)
            moved = [self._filter_slope(x, j, u, y, p, run) for j in range(self.filter_scales.size)]
            yield (run - y)[model.start:], np.column_stack([slopes, *moved])[model.start:] @ select

    def _filter_slope(self, x: np.ndarray, j: int, u: np.ndarray, y: np.ndarray, p: np.ndarray,
                      run: np.ndarray) -> np.ndarray:
        place = x.size - self.filter_scales.size + j
        step = NUDGE * max(abs(x[place]), float(self.filter_scales[j]))
        shifted = x.copy()
        shifted[place] += step
        model = self.model_at(shifted)
        near, _ = model.free_run(u, self._scheduling(model, p), y[: model.start], np.inf)
        return (near - run) / step

    def with_linear_terms(self, x: np.ndarray) -> np.ndarray:
        """The vector with its linear terms replaced by the best ones for the elements' forces (variable projection)."""
        model = self.model_at(x)
        count = model.direct.size + model.side.size + 1
        first = x.size - self.filter_scales.size - count
        gram, right = np.zeros((count, count)), np.zeros(count)
        for error, slopes in self.pieces(x, True):
            assert slopes is not None
            part = slopes[:, first: first + count]
            gram, right = gram + part.T @ part, right - part.T @ error
        out = x.copy()
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        move = np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-8)[0] / scale
        out[first: first + count] += move
        return out


def sensitivity(model: ComplianceModel, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Free run from the measured start, (n,), and its exact Jacobian by the model's vector, (n, k)."""
    from lpvid._quasi_kernels import sensitivity_compliance

    v, phi, beside = model.arrays(u, p)
    parallel, begin, n = model.parallel(u), model.start - 1, len(v)
    q, m = model.current.size, model.knots.size
    forces, slopes = [], []
    for e in range(len(model.elements) - 1, -1, -1):
        element = model.elements[e]
        force, change = np.zeros(n), np.zeros((n, q * m + 2))
        at = 0 if e else begin
        if e:  # settles from its static law
            force[0] = _hat(v[0], model.knots) @ (phi[0] @ element.law)
            change[0, : q * m] = np.outer(phi[0], _hat(v[0], model.knots)).ravel()
        else:
            force[begin] = y[begin] - beside[begin] - (forces[0][begin] if forces else 0.0)
            change[begin, -1] = 1.0
        sensitivity_compliance(element.law, model.knots, model.gain(element), phi, v, at, model.substeps, force, change)
        forces.append(force)
        slopes.append(change)
    run = sum(forces) + beside
    run[: model.start] = y[: model.start]
    own, start_column = slopes[-1][:, :-1], slopes[-1][:, -1:]
    columns = [own @ _chain(model, 0)]
    if len(model.elements) > 1:
        second = slopes[0][:, :-1]
        columns.append((second - start_column * second[begin]) @ _chain(model, 1))
    columns.append(parallel - start_column * parallel[begin])
    out = np.hstack(columns)
    out[: model.start] = 0.0
    return run, out


def _chain(model: ComplianceModel, e: int) -> np.ndarray:
    """(q·m + 1, q·(m − 1) + 1) change of the law's nodes, and of ln k_h, with the log-rises and ln k_h."""
    law, zero, m = model.elements[e].law, model.zero, model.knots.size
    step = np.zeros((m, m - 1))
    for j in range(m - 1):
        if j >= zero:
            step[j + 1:, j] = 1.0
        else:
            step[: j + 1, j] = -1.0
    out = np.zeros((law.size + 1, law.shape[0] * (m - 1) + 1))
    for i, rises in enumerate(np.diff(law, axis=1)):
        out[i * m: (i + 1) * m, i * (m - 1): (i + 1) * (m - 1)] = step * rises
    out[-1, -1] = 1.0
    return out


def _hat(w: float, knots: np.ndarray) -> np.ndarray:
    """Weights of the knots at one speed, linear beyond the ends."""
    s = int(np.clip(np.searchsorted(knots, w, side="right") - 1, 0, knots.size - 2))
    out, part = np.zeros(knots.size), (w - knots[s]) / (knots[s + 1] - knots[s])
    out[s], out[s + 1] = 1 - part, part
    return out
