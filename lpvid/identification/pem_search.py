"""A prediction-error search: starts ranked on a sample, the best followed on all data, frozen poles watched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.identification.levenberg_marquardt import LeastSquaresEnd, frozen_inside, minimise
from lpvid.identification.pem_problem import Point, PredictionErrorProblem
from lpvid.identification.pem_starts import Start, stabilised
from lpvid.model.transfer_function import LPVTransferFunction

SHORT = 12
"""iterations that each of the best starts gets before the best goes on."""
REWEIGHTED = 3
"""rounds in which several outputs are weighed by their own prediction errors."""
EDGE = 0.999
"""frozen pole modulus from which a search counts as held up by the unit circle."""
WORTH_LEAVING = 0.9
"""cost, relative to the best model with all frozen poles inside the unit circle, that justifies one without."""
Ranked = tuple[float, str, LPVTransferFunction]


@dataclass(frozen=True, eq=False)
class PredictionErrorOutcome:
    """A finished search, where it began, and the weights of the outputs in its cost.

    Attributes
    ----------
    search : LeastSquaresEnd
        Its trial holds the parameters.
    label : str
        Name of the start.
    weights : (n_outputs,) array
        Factor on each output's error.
    """

    search: LeastSquaresEnd
    label: str
    weights: np.ndarray

    @property
    def size(self) -> float:
        """Geometric mean over the outputs of the mean squared prediction error."""
        return mean_square(self.search.trial.residuals.errors)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Settings of a search.

    Attributes
    ----------
    coarse, problem : PredictionErrorProblem
        On a sample of the data, and on all.
    bounds : pair of arrays
    starts : int
        How many starts are followed.
    max_iterations : int
    tolerance : float
    progress : callable or None
    inside : bool
        Whether frozen poles stay inside: a start with others is drawn in.
    """

    coarse: PredictionErrorProblem
    problem: PredictionErrorProblem
    bounds: tuple[np.ndarray, np.ndarray]
    starts: int
    max_iterations: int
    tolerance: float
    progress: Callable[[int, float], None] | None
    inside: bool = False

    def follow(self, ranked: Sequence[Ranked], frozen_limit: float) -> PredictionErrorOutcome | None:
        """A short search on the sample from each of these starts, and the full search from the best of them.

        Parameters
        ----------
        ranked : sequence of (cost, label, model)
            Starts by rising cost, as from `ranked`.
        frozen_limit : float
            Largest modulus of frozen poles that a trial may have; infinite for no limit.

        Returns
        -------
        PredictionErrorOutcome or None
            None where no start runs on all data.
        """
        return self.finish(self._tried(ranked, frozen_limit), frozen_limit)

    def _tried(self, ranked: Sequence[Ranked], frozen_limit: float) -> list[Ranked]:
        tried = []
        for _, label, model in ranked:
            found = minimise(self.coarse, self.coarse.point(model), max_iterations=min(SHORT, self.max_iterations),
                             tolerance=self.tolerance, bounds=self.bounds, frozen_limit=frozen_limit)
            if found is not None:
                tried.append((found.cost, label, self.coarse.model_at(found.trial.point.shared)))
        return sorted(tried, key=lambda row: row[0])

    def finish(self, tried: Sequence[Ranked], frozen_limit: float) -> PredictionErrorOutcome | None:
        """The full search from the first start that runs on all data.

        Parameters
        ----------
        tried : sequence of (cost, label, model)
            Best first.
        frozen_limit : float
            Largest modulus of frozen poles that a trial may have; infinite for no limit.

        Returns
        -------
        PredictionErrorOutcome or None
            None where no start runs on all data. Outputs are reweighted by their errors where they are several.
        """
        problem = self.problem
        problem.weights = self.coarse.weights
        for _, label, model in tried:
            begin = stabilised(problem, model) if self.inside else model
            search = self._full(problem.point(begin), frozen_limit)
            if search is None:
                continue
            for _ in range(REWEIGHTED if problem.n_outputs > 1 else 0):
                errors = np.vstack([e[problem.head:] for e in search.trial.residuals.errors])
                problem.weights = 1.0 / np.maximum(np.sqrt(np.mean(errors**2, axis=0)), 1e-300)
                search = self._full(search.trial.point, frozen_limit) or search
            return PredictionErrorOutcome(search, label, problem.weights)
        return None

    def _full(self, point: Point, frozen_limit: float) -> LeastSquaresEnd | None:
        return minimise(self.problem, point, max_iterations=self.max_iterations, tolerance=self.tolerance,
                        bounds=self.bounds, frozen_limit=frozen_limit, progress=self.progress)

    def unguarded(self, guarded: PredictionErrorOutcome | None, outside: Sequence[Ranked],
                  more: Callable[[], Sequence[Start]]) -> PredictionErrorOutcome | None:
        """The search without the circle for frozen poles, where that circle holds the guarded one up.

        A stable varying system may have frozen poles outside the circle for a while. ``more`` gives further starts for
        such systems.

        Parameters
        ----------
        guarded : PredictionErrorOutcome or None
            End of the search with frozen poles inside.
        outside : sequence of (cost, label, model)
            Ranked starts with frozen poles outside.
        more : callable
            Gives (label, model) pairs; called only where the search without the circle is run.

        Returns
        -------
        PredictionErrorOutcome or None
            None where the circle holds nothing up, or no start runs.
        """
        if guarded is not None:
            each = guarded.search.cost / self.problem.counted
            held = not frozen_inside(self.problem, guarded.search.trial.point, EDGE)
            if not held and not (outside and outside[0][0] / self.coarse.counted < each):
                return None
        models = list(outside[: self.starts])
        if guarded is not None:
            inside, rest = ranked(self.coarse, [("the guarded search",
                                                 self.problem.model_at(guarded.search.trial.point.shared))])
            models += [*inside, *rest]
        inside, rest = ranked(self.coarse, more())
        return self.follow([*models, *inside, *rest], np.inf)


def better(
    guarded: PredictionErrorOutcome | None, free: PredictionErrorOutcome | None
) -> PredictionErrorOutcome | None:
    """The guarded outcome unless the other is markedly better.

    Parameters
    ----------
    guarded : PredictionErrorOutcome or None
        With frozen poles inside the unit circle.
    free : PredictionErrorOutcome or None
        Without that limit.

    Returns
    -------
    PredictionErrorOutcome or None
        The one that there is, if only one; the free one below `WORTH_LEAVING` times the guarded one's error.
    """
    if guarded is None or free is None:
        return guarded or free
    return free if free.size < WORTH_LEAVING * guarded.size else guarded


def ranked(problem: PredictionErrorProblem, models: Sequence[Start]) -> tuple[list[Ranked], list[Ranked]]:
    """Starts that do not diverge, by rising cost: with all frozen poles inside the unit circle, and others.

    Parameters
    ----------
    problem : PredictionErrorProblem
        On which the costs are computed.
    models : sequence of (label, model)
        Starts.

    Returns
    -------
    (list, list) of (cost, label, model)
        Of starts whose costs agree within a thousandth the first is kept.
    """
    stable, rest = [], []
    for label, model in models:
        point = problem.point(model)
        residuals = problem.residuals(point)
        if residuals is not None:
            inside = frozen_inside(problem, point, 1.0)
            (stable if inside else rest).append((residuals.cost, label, model))
    return _different(sorted(stable, key=lambda row: row[0])), _different(sorted(rest, key=lambda row: row[0]))


def _different(rows: list[Ranked]) -> list[Ranked]:
    """Rows without those whose cost repeats an earlier one's within a thousandth."""
    kept: list[Ranked] = []
    for row in rows:
        if not kept or row[0] > kept[-1][0] * (1 + 1e-3):
            kept.append(row)
    return kept


def mean_square(errors: Sequence[np.ndarray]) -> float:
    """Geometric mean over the outputs of Σe² per sample.

    Parameters
    ----------
    errors : sequence of (n, n_outputs) arrays
        One per record.

    Returns
    -------
    float
        [geometric mean of the outputs' squared units].
    """
    total = np.sum([np.sum(e**2, axis=0) for e in errors], axis=0) / sum(len(e) for e in errors)
    return float(np.exp(np.mean(np.log(np.maximum(total, 1e-300)))))
