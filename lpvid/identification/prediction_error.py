"""Prediction-error estimates: what LPV-OE, LPV-BJ and LPV-ARMAX have in common."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.caveat import Caveat
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, ThroughARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.levenberg_marquardt import LeastSquaresEnd, frozen_moduli, reduce
from lpvid.identification.pem_covariance import covariance
from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_search import EDGE, SHORT, Campaign, PredictionErrorOutcome, better, mean_square, ranked
from lpvid.identification.pem_starts import Start, equation_start, perturbed, stabilised
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.stage_fit import SAMPLES, fitted_stages, shorten, unresolved
from lpvid.model.input_stage import InputStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial

CHECKED_POINTS = 5000


@dataclass(frozen=True)
class PredictionError(ThroughARX):
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
    frozen_poles : {"any", "inside"}
        Whether frozen poles may leave the unit circle along the training trajectory where that fits markedly better, or
        stay inside.
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
    frozen_poles: str = "any"
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
        _checks.one_of(self.frozen_poles, ("any", "inside"), "frozen_poles")
        _checks.instance(self.bounds, (Mapping, Sequence), "bounds are intervals by parameter name",
                         'bounds={"v0": (0.01, 0.2)}')
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
        """A noise model of the kind and orders to be estimated.

        Parameters
        ----------
        n_outputs : int
        n_functions : int
            Functions of the basis, for coefficients that depend on the scheduling.

        Returns
        -------
        NoiseModel
            With zero coefficients.
        """

    @abstractmethod
    def starting_models(
        self, records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction
    ) -> list[Start]:
        """Models to start from, given the least-squares model.

        Parameters
        ----------
        records : sequence of Record
            Those of the problem.
        problem : PredictionErrorProblem
            On the sample of the data on which starts are compared.
        first : LPVTransferFunction
            The least-squares model.

        Returns
        -------
        list of (label, model)
        """

    # -- shared --------------------------------------------------------------------------------------------------
    @property
    def arx(self) -> ARX:
        """The equation-error structure of the same orders."""
        return ARX(self.na, self.nb, self.nk, self.input, self.output, self.basis, self.affine, self.lagged, self.stage,
                   self.schedule_filter)

    def estimate(self, records: Sequence[Record]) -> Identification:
        return self.estimate_from(records, self.arx)

    def estimate_from(self, records: Sequence[Record], start: ARX) -> Identification:
        """The estimate, begun at a least-squares structure other than `arx`.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        start : ARX
            Of the same orders. Its stages may be objects where those of this structure are names: the search then
            begins at them, which spares their fit by least squares, and moves them.

        Returns
        -------
        Identification
        """
        first = start.estimate(records)
        with single_thread():
            return self._estimate(list(records), first)

    def _estimate(self, records: list[Record], first: Identification) -> Identification:
        sample = shorten(records, SAMPLES, self.start + 50)
        coarse, problem = self._problem(sample, first), self._problem(records, first)
        rng = np.random.default_rng(self.seed)
        models = self.starting_models(sample, coarse, first.model)
        models += perturbed(models[0][1], problem.layout, first.covariance, rng, max(self.starts - 1, 1))
        inside, outside = ranked(coarse, models)
        campaign = self._campaign(coarse, problem)
        found = campaign.follow(inside[: self.starts], 1.0)
        if found is None:
            drawn = stabilised(problem, first.model)
            found = campaign.finish([(np.inf, "least squares, poles drawn in", drawn)], 1.0)
        if self.frozen_poles == "any" and (found is None or problem.noise.kind != "armax"):
            found = better(found, campaign.unguarded(
                found, outside, lambda: equation_start(sample, coarse, first.model, SHORT)))
        if found is None:
            raise InputError("no starting point has a bounded free run on these data", got=f"{len(models)} starts",
                             mend="lower the orders or the degree, or check the units of the channels")
        problem.weights = found.weights
        if problem.noise.kind == "output" and problem.estimate_past:
            problem, found = self._no_worse(records, first, problem, found)
        described = f"{len(models)} starts ranked, {len(inside) + len(outside)} different and bounded"
        return self._package(records, first, problem, found.search,
                             [*self._first_notes(first), *self._notes(records, problem, first, found, described)])

    def _no_worse(
        self,
        records: Sequence[Record],
        first: Identification,
        problem: PredictionErrorProblem,
        found: PredictionErrorOutcome,
    ) -> tuple[PredictionErrorProblem, PredictionErrorOutcome]:
        """The outcome, or one from measured starts where the free run from those would be worse than least squares'."""
        measured = self._problem(records, first, estimate_past=False)
        measured.weights = found.weights
        least = measured.residuals(measured.point(first.model))
        ours = measured.residuals(measured.point(problem.model_at(found.search.trial.point.shared)))
        if least is None or (ours is not None and ours.cost <= least.cost):
            return problem, found
        begin = (least.cost, "least squares, from measured samples", first.model)
        again = self._campaign(measured, measured).finish([begin], 1.0)
        return (problem, found) if again is None else (measured, again)

    def _campaign(self, coarse: PredictionErrorProblem, problem: PredictionErrorProblem) -> Campaign:
        return Campaign(coarse, problem, self._bounds(problem), self.starts, self.max_iterations, self.tolerance,
                        self.progress, self.frozen_poles == "inside")

    def _problem(
        self, records: Sequence[Record], first: Identification, estimate_past: bool = True
    ) -> PredictionErrorProblem:
        model = first.model
        noise = self.noise_model(model.n_outputs, model.basis.size)
        free = (isinstance(self.stage, str), isinstance(self.schedule_filter, str))
        assert isinstance(first.layout, ParameterLayout)
        problem = PredictionErrorProblem(records, first.structure, model, first.layout, noise, free,
                          estimate_past and self.initial == "estimate")
        if problem.n_outputs > 1:
            spread = [np.var(np.concatenate([r[name] for r in records])) for name in self.output]
            problem.weights = 1.0 / np.sqrt(np.maximum(spread, 1e-300))
        return problem

    def _bounds(self, problem: PredictionErrorProblem) -> tuple[np.ndarray, np.ndarray]:
        names = self._names(problem)
        k = sum(problem.sizes)
        lower, upper = np.full(k, -np.inf), np.full(k, np.inf)
        for name, low, high in self.bounds:
            _checks.known_name(name, names, "parameter to bound")
            lower[names.index(name)], upper[names.index(name)] = low, high
        return lower, upper

    @staticmethod
    def _names(problem: PredictionErrorProblem) -> tuple[str, ...]:
        outputs = tuple(s.name for s in problem.model.outputs)
        return (*problem.layout.names(problem.model), *problem.noise.names(problem.model.basis.labels, outputs))

    # -- result --------------------------------------------------------------------------------------------------
    def _first_notes(self, first: Identification) -> list[str]:
        """Notes of the least-squares start, but for those on stages that have moved since."""
        free = isinstance(self.stage, str) or isinstance(self.schedule_filter, str)
        return [n for n in first.notes if not (free and n.startswith("fitted to the free run"))]

    def _notes(
        self, records: Sequence[Record], problem: PredictionErrorProblem, first: Identification,
        found: PredictionErrorOutcome, described: str
    ) -> list[str]:
        search = found.search
        least = problem.residuals(problem.point(first.model))
        begun = "diverges" if least is None else f"{mean_square(least.errors):.6g}"
        notes = [
            f"prediction error: {search.iterations} iterations from {found.label} ({described}, {self.starts} at most "
            f"followed); mean square {begun} (least squares) -> {found.size:.6g}; stopped: {search.why}"
        ]
        model = problem.model_at(search.trial.point.shared)
        if stated := fitted_stages(model, self.arx):
            notes.append(f"fitted along with the model: {' and '.join(stated)}")
        notes += unresolved(model, self.arx, records)
        if problem.n_past:
            what = "past innovations" if problem.noise.kind == "armax" else "past outputs"
            values = ", ".join(f"{v:.4g}" for v in search.trial.point.past[0].ravel()[:4])
            count = len(search.trial.point.past)
            notes.append(f"initial conditions estimated: {problem.n_past} {what} for each of {count} record(s), "
                         f"not counted as parameters (first record: {values})")
        moduli = frozen_moduli(problem, problem.model_at(search.trial.point.shared), CHECKED_POINTS)
        share = float(np.mean(moduli >= 1))
        if moduli.max(initial=0.0) < 1 and moduli.max(initial=0.0) > EDGE:
            notes.append(f"the search ended at the edge of frozen stability (largest frozen pole {moduli.max():.6f}): "
                         "a lower order or degree may do")
        if share:
            notes.append(f"{100 * share:.2g} % of the training trajectory has a frozen pole outside the unit circle "
                         f"(largest {moduli.max():.4f}): the free run may diverge elsewhere")
        return notes

    def _package(
        self,
        records: Sequence[Record],
        first: Identification,
        problem: PredictionErrorProblem,
        search: LeastSquaresEnd,
        notes: Sequence[str],
    ) -> Identification:
        shared, _ = reduce(problem, search.linearised.factors)
        jacobian = shared[:, :-1]
        scale = np.linalg.norm(jacobian, axis=0)
        alive = scale > 0
        dead = [name for name, moves in zip((*self._names(problem), *problem.stage_names), alive, strict=True)
                if not moves]
        notes = [*([Caveat(f"not identifiable: {', '.join(dead)}, on which the error does not depend on these data; "
                           "the condition number is that of the others")] if dead else ()), *notes]
        whole, kind = covariance(problem, search, coloured=self.coloured)
        k, q, _ = problem.sizes
        rows = np.vstack([e[problem.head:] for e in search.trial.residuals.errors])
        degrees = max(len(rows) - (sum(problem.sizes) + problem.n_past * len(records)) / problem.n_outputs, 1)
        model = problem.model_at(search.trial.point.shared)
        structure = replace(self, basis=model.basis, stage=model.input_stage, schedule_filter=model.scheduling_stage)
        metadata: dict = {"structure": structure.to_dict(), "covariance_kind": kind,
                          "training": {"records": [r.name for r in records], "n_samples": len(rows)}}
        if first.layout.size <= COVARIANCE_LIMIT:
            metadata["parameters"] = {"layout": problem.layout.to_list(), "covariance": whole[:k, :k].tolist()}
        if q:
            metadata["noise_parameters"] = {"names": list(self._names(problem)[k:]),
                                            "covariance": whole[k: k + q, k: k + q].tolist()}
        model = model.replace(noise_covariance=rows.T @ rows / degrees, metadata=metadata)
        return Identification(model, structure, first.layout, whole[:k, :k], float(np.linalg.cond(jacobian[:, alive])),
                              float(np.linalg.cond(jacobian[:, alive] / scale[alive])), len(rows),
                              notes=tuple(notes), covariance_kind=kind)

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        data = self.arx.to_dict()
        del data["ridge"], data["weight"]
        orders = {name: getattr(self, name) for name in self._orders}
        return {**data, "kind": self.kind, **orders, "starts": self.starts, "seed": self.seed,
                "max_iterations": self.max_iterations, "tolerance": self.tolerance,
                "bounds": {name: [low, high] for name, low, high in self.bounds}, "initial": self.initial,
                "frozen_poles": self.frozen_poles}


def _interval(name: object, pair: Sequence[float]) -> tuple[float, float]:
    values = [float(v) for v in pair]
    if len(values) != 2 or not values[0] < values[1]:
        raise InputError(f"the bounds of '{name}' must be a lower and a higher number", got=pair)
    return values[0], values[1]
