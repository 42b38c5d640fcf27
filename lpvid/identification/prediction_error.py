"""Prediction-error estimates: what LPV-OE, LPV-BJ and LPV-ARMAX have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.identification.layout import Layout
from lpvid.identification.levenberg_marquardt import Search, frozen_moduli, frozen_radius, minimise, reduce
from lpvid.identification.pem_covariance import covariance
from lpvid.identification.pem_problem import Problem
from lpvid.identification.pem_starts import Start, equation_start, perturbed, stabilised
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.stage_fit import SAMPLES, shorten
from lpvid.identification.structure import Structure
from lpvid.model.input_stage import InputStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial

SHORT = 12
"""iterations that each of the best starts gets before the best goes on."""
REWEIGHTED = 3
"""rounds in which several outputs are weighed by their own prediction errors."""
CHECKED_POINTS = 5000
EDGE = 0.999
WORTH_LEAVING = 0.9
"""cost, relative to the best model with all frozen poles inside the unit circle, that justifies one without."""
Ranked = tuple[float, str, LPVTransferFunction]


@dataclass(frozen=True)
class PredictionError(Structure):
    """Settings shared by the prediction-error structures; the first ten are those of `ARX`, which gives the start.

    The estimate minimises Σ_k e(k)² (each output weighed by its own error) by Levenberg-Marquardt with exact gradients.
    What ran before a record is estimated along with the parameters.

    Parameters
    ----------
    na, nb, nk, input, output, basis, affine, lagged, stage, schedule_filter
        As in `ARX`. A stage given by name starts where `ARX` fits it and joins the search; one given as an object
        stays as it is.
    starts : int
        How many of the starting points are followed; all are ranked by their cost first.
    seed : int
        Of the random starts.
    max_iterations : int
    tolerance : float
        Stop when the cost falls by less than this share of itself, twice in a row.
    bounds : mapping of str to (float, float)
        Lowest and highest value of parameters by their name in the result, e.g. ``{"a1[1]": (-2, 0)}``.
    initial : {"estimate", "measured"}
        Whether what ran before a record is estimated, or read off its first samples.
    progress : callable, optional
        ``progress(iteration, cost)`` after every step.
    """

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
    starts: int = 3
    seed: int = 0
    max_iterations: int = 100
    tolerance: float = 1e-8
    bounds: Any = ()
    initial: str = "estimate"
    progress: Callable[[int, float], None] | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        arx = self.arx
        for name in ("nb", "nk", "input", "output"):
            set_(self, name, getattr(arx, name))
        _checks.count(self.starts, "starts", at_least=1)
        _checks.count(self.seed, "seed")
        _checks.count(self.max_iterations, "max_iterations", at_least=1)
        _checks.positive(self.tolerance, "tolerance")
        _checks.one_of(self.initial, ("estimate", "measured"), "initial")
        rows = self.bounds.items() if isinstance(self.bounds, Mapping) else [(r[0], r[1:]) for r in self.bounds]
        set_(self, "bounds", tuple((str(name), *_interval(name, pair)) for name, pair in rows))
        for name in self._orders:
            if not isinstance(getattr(self, name), bool):
                _checks.count(getattr(self, name), name)

    # -- what a structure adds -----------------------------------------------------------------------------------
    @property
    @abstractmethod
    def kind(self) -> str:
        """Its name in files."""

    @property
    @abstractmethod
    def _orders(self) -> tuple[str, ...]:
        """Fields that hold orders of the noise model."""

    @property
    @abstractmethod
    def coloured(self) -> bool:
        """Whether the residual may be coloured, so that the covariance must be of sandwich form."""

    @abstractmethod
    def noise_model(self, n_outputs: int, n_functions: int) -> NoiseModel:
        """A noise model of the kind and orders to be estimated."""

    @abstractmethod
    def starting_models(self, records: Sequence[Record], problem: Problem, first: LPVTransferFunction) -> list[Start]:
        """Models to start from, given the least-squares model."""

    # -- shared --------------------------------------------------------------------------------------------------
    @property
    def arx(self) -> ARX:
        """The equation-error structure of the same orders."""
        return ARX(self.na, self.nb, self.nk, self.input, self.output, self.basis, self.affine, self.lagged, self.stage,
                   self.schedule_filter)

    @property
    def channels(self) -> tuple[str, ...]:
        return self.arx.channels

    @property
    def start(self) -> int:
        return self.arx.start

    @property
    def n_columns(self) -> int:
        """Parameters per output, those of the noise model left out."""
        return self.arx.n_columns

    def estimate(self, records: Sequence[Record]) -> Identification:
        first = self.arx.estimate(records)
        with single_thread():
            return self._estimate(list(records), first)

    def _estimate(self, records: list[Record], first: Identification) -> Identification:
        sample = shorten(records, SAMPLES, self.start + 50)
        coarse, problem = self._problem(sample, first), self._problem(records, first)
        bounds = self._bounds(problem)
        rng = np.random.default_rng(self.seed)
        models = self.starting_models(sample, coarse, first.model)
        models += perturbed(models[0][1], first.layout, first.covariance, rng, max(self.starts - 1, 1))
        inside, outside = self._ranked(coarse, models)
        tried = self._tried(coarse, inside, bounds, 1.0)
        tried += [(np.inf, "least squares, poles drawn in", stabilised(problem, first.model))]
        search, label = self._follow(problem, tried, bounds, 1.0)
        free = self._unguarded(sample, coarse, problem, first.model, outside, search, bounds)
        if free is not None and (search is None or free[0].cost < WORTH_LEAVING * search.cost):
            search, label = free
        if search is None:
            raise InputError("no starting point has a bounded free run on these data", got=f"{len(models)} starts",
                             mend="lower the orders or the degree, or check the units of the channels")
        notes = [*first.notes, *self._notes(problem, search, label, len(models), len(inside) + len(outside))]
        return self._package(records, first, problem, search, notes)

    def _unguarded(self, sample: Sequence[Record], coarse: Problem, problem: Problem, first: LPVTransferFunction,
                   outside: Sequence[Ranked], search: Search | None, bounds: tuple[np.ndarray, np.ndarray]
                   ) -> tuple[Search, str] | None:
        """The same search without the circle for frozen poles, where that circle holds the guarded one up.

        A stable varying system may have frozen poles outside the circle for a while; a model with such poles is taken
        only where it fits markedly better.
        """
        held = search is None or frozen_radius(problem, search.point) > EDGE
        if not held and not (outside and search is not None and outside[0][0] < search.cost):
            return None
        models = list(outside[: self.starts])
        if search is not None:
            model = problem.model_at(search.point.shared)
            residuals = coarse.residuals(coarse.point(model))
            models += [] if residuals is None else [(residuals.cost, "the guarded search", model)]
        if self.coloured or self.kind == "bj":
            found = self._ranked(coarse, equation_start(sample, coarse, first, SHORT))
            models += [*found[0], *found[1]]
        found, label = self._follow(problem, self._tried(coarse, models, bounds, np.inf), bounds, np.inf)
        return None if found is None else (found, label)

    def _tried(self, coarse: Problem, ranked: Sequence[Ranked], bounds: tuple[np.ndarray, np.ndarray],
               frozen_limit: float) -> list[Ranked]:
        """A short search from each of the best starts, best result first."""
        tried = []
        count = self.starts if frozen_limit == 1 else len(ranked)
        for _, label, model in ranked[:count]:
            found = minimise(coarse, coarse.point(model), max_iterations=min(SHORT, self.max_iterations),
                             tolerance=self.tolerance, bounds=bounds, frozen_limit=frozen_limit)
            if found is not None:
                tried.append((found.cost, label, coarse.model_at(found.point.shared)))
        return sorted(tried, key=lambda row: row[0])

    def _problem(self, records: Sequence[Record], first: Identification) -> Problem:
        model = first.model
        noise = self.noise_model(model.n_outputs, model.basis.size)
        free = (isinstance(self.stage, str), isinstance(self.schedule_filter, str))
        assert isinstance(first.layout, Layout)
        problem = Problem(records, first.structure, model, first.layout, noise, free, self.initial == "estimate")
        if problem.n_outputs > 1:
            spread = [np.var(np.concatenate([r[name] for r in records])) for name in self.output]
            problem.weights = 1.0 / np.sqrt(np.maximum(spread, 1e-300))
        return problem

    def _bounds(self, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
        names = self._names(problem)
        k = sum(problem.sizes)
        lower, upper = np.full(k, -np.inf), np.full(k, np.inf)
        for name, low, high in self.bounds:
            _checks.known_name(name, names, "parameter to bound")
            lower[names.index(name)], upper[names.index(name)] = low, high
        return lower, upper

    @staticmethod
    def _names(problem: Problem) -> tuple[str, ...]:
        outputs = tuple(s.name for s in problem.model.outputs)
        return (*problem.layout.names(problem.model), *problem.noise.names(problem.model.basis.labels, outputs))

    @staticmethod
    def _ranked(problem: Problem, models: Sequence[Start]) -> tuple[list[Ranked], list[Ranked]]:
        """Starts that do not diverge, by rising cost: with all frozen poles inside the unit circle, and others."""
        stable, rest = [], []
        for label, model in models:
            point = problem.point(model)
            residuals = problem.residuals(point)
            if residuals is not None:
                inside = frozen_radius(problem, point) < 1
                (stable if inside else rest).append((residuals.cost, label, model))
        return _different(sorted(stable, key=lambda row: row[0])), _different(sorted(rest, key=lambda row: row[0]))

    def _follow(self, problem: Problem, tried: Sequence[Ranked], bounds: tuple[np.ndarray, np.ndarray],
                frozen_limit: float) -> tuple[Search | None, str]:
        """The full search from the first start that runs on all data."""
        for _, label, model in tried:
            search = minimise(problem, problem.point(model), max_iterations=self.max_iterations,
                              tolerance=self.tolerance, bounds=bounds, frozen_limit=frozen_limit,
                              progress=self.progress)
            if search is None:
                continue
            for _ in range(REWEIGHTED if problem.n_outputs > 1 else 0):
                errors = np.vstack([e[problem.head:] for e in search.residuals.errors])
                problem.weights = 1.0 / np.maximum(np.sqrt(np.mean(errors**2, axis=0)), 1e-300)
                again = minimise(problem, search.point, max_iterations=self.max_iterations, tolerance=self.tolerance,
                                 bounds=bounds, frozen_limit=frozen_limit, progress=self.progress)
                search = search if again is None else again
            return search, label
        return None, ""

    # -- result --------------------------------------------------------------------------------------------------
    def _notes(self, problem: Problem, search: Search, label: str, starts: int, running: int) -> list[str]:
        per = problem.counted
        notes = [f"prediction error: {search.iterations} iterations from {label} ({starts} starts ranked, {running} "
                 f"different and bounded, {min(self.starts, running)} followed); mean square "
                 f"{search.first_cost / per:.6g} -> {search.cost / per:.6g}; stopped: {search.why}"]
        if problem.n_past:
            what = "past innovations" if problem.noise.kind == "armax" else "past outputs"
            values = ", ".join(f"{v:.4g}" for v in search.point.past[0].ravel()[:4])
            notes.append(f"initial conditions estimated: {problem.n_past} {what} for each of "
                         f"{len(search.point.past)} record(s), not counted as parameters (first record: {values})")
        moduli = frozen_moduli(problem, problem.model_at(search.point.shared), CHECKED_POINTS)
        share = float(np.mean(moduli >= 1))
        if moduli.max(initial=0.0) < 1 and moduli.max(initial=0.0) > EDGE:
            notes.append(f"the search ended at the edge of frozen stability (largest frozen pole {moduli.max():.6f}): "
                         "a lower order or degree may do")
        if share:
            notes.append(f"{100 * share:.2g} % of the training trajectory has a frozen pole outside the unit circle "
                         f"(largest {moduli.max():.4f}): the free run may diverge elsewhere")
        return notes

    def _package(self, records: Sequence[Record], first: Identification, problem: Problem, search: Search,
                 notes: Sequence[str]) -> Identification:
        shared, _ = reduce(problem, search.factors)
        jacobian = shared[:, :-1]
        scale = np.linalg.norm(jacobian, axis=0)
        alive = scale > 0
        whole, kind = covariance(problem, search, coloured=self.coloured)
        k, q, _ = problem.sizes
        rows = np.vstack([e[problem.head:] for e in search.residuals.errors])
        degrees = max(len(rows) - (sum(problem.sizes) + problem.n_past * len(records)) / problem.n_outputs, 1)
        model = problem.model_at(search.point.shared)
        structure = replace(self, basis=model.basis, stage=model.input_stage, schedule_filter=model.scheduling_stage)
        metadata: dict = {"structure": structure.to_dict(), "covariance_kind": kind,
                          "training": {"records": [r.name for r in records], "n_samples": len(rows)}}
        if first.layout.size <= COVARIANCE_LIMIT:
            metadata["parameters"] = {"layout": problem.layout.to_list(), "covariance": whole[:k, :k].tolist()}
        if q:
            metadata["noise_parameters"] = {"names": list(self._names(problem)[k:]),
                                            "covariance": whole[k: k + q, k: k + q].tolist()}
        model = model.replace(noise_covariance=rows.T @ rows / degrees, metadata=metadata)
        return Identification(model, structure, first.layout, whole[:k, :k], float(np.linalg.cond(jacobian)),
                              float(np.linalg.cond(jacobian[:, alive] / scale[alive])), len(rows),
                              notes=tuple(notes), covariance_kind=kind)

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        data = self.arx.to_dict()
        del data["ridge"], data["weight"]
        orders = {name: getattr(self, name) for name in self._orders}
        return {**data, "kind": self.kind, **orders, "starts": self.starts, "seed": self.seed,
                "max_iterations": self.max_iterations, "tolerance": self.tolerance,
                "bounds": {name: [low, high] for name, low, high in self.bounds}, "initial": self.initial}


def _interval(name: object, pair: Sequence[float]) -> tuple[float, float]:
    values = [float(v) for v in pair]
    if len(values) != 2 or not values[0] < values[1]:
        raise InputError(f"the bounds of '{name}' must be a lower and a higher number", got=pair)
    return values[0], values[1]


def _different(rows: list[Ranked]) -> list[Ranked]:
    """Rows without those whose cost repeats an earlier one's within a thousandth."""
    kept: list[Ranked] = []
    for row in rows:
        if not kept or row[0] > kept[-1][0] * (1 + 1e-3):
            kept.append(row)
    return kept
