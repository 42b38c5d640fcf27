"""Least squares on the free run of a self-scheduled model, with a prior that counts as so many equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.identification.covariance import bartlett_of_parts, normal_inverse, residual_memory
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.structure import Structure
from lpvid.least_squares import Factors, SearchEnd, StopRule, descend
from lpvid.model.quasi import SelfScheduled
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.record import Record

LONGEST_STEP = 1.5
"""no parameter moves by more than this many of its scales in one step."""
SINGULAR = 1e-14
"""reciprocal condition below which a step is by singular values, those below this share of the largest left out."""
NUDGE = 1e-6
"""relative step of the difference quotient by a scheduling filter's parameters."""
FILTER_SHARE = 0.4
"""scale of a fitted filter's parameters by their own, so short that no single step takes a time constant to zero."""

Piece = tuple[np.ndarray, np.ndarray | None]
Columns = tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class FreeRunProblem(ABC):
    """What is minimised: errors record by record at a parameter vector, with their exact Jacobian on request.

    The parameter vector ends in the filter's parameters where these are fitted; their columns are difference quotients.

    Attributes
    ----------
    model : SelfScheduled
        Whose settings are kept; its values serve as a start.
    inputs : tuple of (n, n_inputs) arrays
        Per record.
    outputs : tuple of (n,) arrays
        Measured output of every record.
    scheduling : tuple of (n, n_scheduling) arrays
        As logged, before any filter.
    free_filter : bool
        Whether the parameters of the scheduling filter are fitted along.
    """

    model: Any
    inputs: tuple[np.ndarray, ...]
    outputs: tuple[np.ndarray, ...]
    scheduling: tuple[np.ndarray, ...]
    free_filter: bool

    @abstractmethod
    def along(self, place: int, x: np.ndarray, jacobian: bool) -> Iterator[Piece]:
        """(n,) errors ŷ − y and (n, k) ∂ŷ/∂x of one record; an error that is not finite marks divergence.

        Parameters
        ----------
        place : int
            Number of the record.
        x : (k,) array
            Parameters.
        jacobian : bool
            Whether the derivatives are wanted too; None in their place otherwise.

        Yields
        ------
        (n,) array, (n, k) array or None
            In the unit of the output, from the model's first free sample on; with derivatives in parts of the record,
            one after the other. The caller may change them.
        """

    def pieces(self, x: np.ndarray, jacobian: bool) -> Iterator[Piece]:
        """The same of all records, one after the other.

        Parameters
        ----------
        x : (k,) array
            Parameters.
        jacobian : bool
            Whether the derivatives are wanted too; None in their place otherwise.

        Yields
        ------
        (n,) array, (n, k) array or None
            One per record without derivatives.
        """
        for place in range(len(self.outputs)):
            yield from self.along(place, x, jacobian)

    @abstractmethod
    def model_at(self, x: np.ndarray) -> Any:
        """The model at a parameter vector.

        Parameters
        ----------
        x : (k,) array
            Parameters in the order of the class.

        Returns
        -------
        SelfScheduled
        """

    @abstractmethod
    def run(self, model: Any, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The unbounded free run of a model along one record.

        Parameters
        ----------
        model : SelfScheduled
            Of this problem.
        u, p : (n, inputs) and (n, scheduling) arrays
            Inputs, and scheduling as logged.
        y : (n,) array
            Measured output, from whose first samples the run starts.

        Returns
        -------
        (n,) array
        """

    @staticmethod
    def columns(records: Sequence[Record], model: SelfScheduled) -> tuple[Columns, Columns, Columns]:
        """Inputs, outputs and scheduling of the records, each read once.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        model : SelfScheduled
            Names the channels.

        Returns
        -------
        three tuples of arrays
        """
        return (tuple(np.ascontiguousarray(r.matrix([s.name for s in model.inputs])) for r in records),
                tuple(np.array(r[model.outputs[0].name]) for r in records),
                tuple(r.matrix(list(model.box.names)) for r in records))

    @property
    def filter_scales(self) -> np.ndarray:
        """Search steps of the filter's parameters; empty where it is not fitted."""
        stage = self.model.scheduling_stage
        return np.zeros(0) if stage is None or not self.free_filter else FILTER_SHARE * stage.scales()

    def filtered(self, model: Any, p: np.ndarray) -> np.ndarray:
        """The scheduling behind a model's filter.

        Parameters
        ----------
        model : SelfScheduled
            Of this problem.
        p : (n, scheduling) array
            As logged.

        Returns
        -------
        (n, scheduling) array
        """
        return p if model.scheduling_stage is None else model.scheduling_stage.apply(p, model.sample_time)

    def with_filter(self, model: Any, values: np.ndarray) -> Any:
        """The model with the fitted parameters of its filter.

        Parameters
        ----------
        model : SelfScheduled
            Of this problem.
        values : (s,) array
            Empty where the filter is not fitted.

        Returns
        -------
        SelfScheduled
        """
        if not values.size:
            return model
        return model.replace(scheduling_stage=model.scheduling_stage.with_vector(values))

    def filter_slopes(self, x: np.ndarray, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                      out: np.ndarray) -> list[np.ndarray]:
        """Difference quotients of the free run by the filter's parameters, the last of x.

        Parameters
        ----------
        x : (k,) array
            Parameters.
        u, p, y : arrays
            Of one record, as in `run`.
        out : (n,) array
            The free run at x.

        Returns
        -------
        list of (n,) arrays
        """
        found = []
        for place, scale in enumerate(self.filter_scales, start=x.size - self.filter_scales.size):
            step = NUDGE * max(abs(x[place]), float(scale))
            shifted = x.copy()
            shifted[place] += step
            found.append((self.run(self.model_at(shifted), u, p, y) - out) / step)
        return found


@dataclass(frozen=True, eq=False)
class Prior:
    """Rows W and values t of equations W x = t in the output's unit, each weighted as one sample.

    Attributes
    ----------
    rows : (r, k) array
        W.
    values : (r,) array
        t.
    """

    rows: np.ndarray
    values: np.ndarray

    def error(self, x: np.ndarray) -> np.ndarray:
        """W x − t.

        Parameters
        ----------
        x : (k,) array
            Parameters.

        Returns
        -------
        (r,) array
            In the unit of the output.
        """
        return self.rows @ x - self.values


@dataclass(frozen=True, eq=False)
class _FreeRunTrial:
    """Parameters, and the sum of squares of their free run and of the prior's equations."""

    x: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class _NormalStep:
    """The Gauss-Newton matrix and the gradient at parameters x, which `scales` make comparable."""

    x: np.ndarray
    gram: np.ndarray
    gradient: np.ndarray
    scales: np.ndarray

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.gram).all())

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """A trial no further than `LONGEST_STEP` scales off, and the predicted decrease of the cost."""
        scaled = self.gram * np.outer(self.scales, self.scales)
        diagonal = np.diag(scaled)
        lift = damping * np.maximum(diagonal, 1e-10 * diagonal.max(initial=1e-300))
        move = -_solved(scaled + np.diag(lift), self.scales * self.gradient)
        move *= min(1.0, LONGEST_STEP / max(float(np.abs(move).max(initial=0.0)), 1e-300))
        predicted = -float(move @ (2 * self.scales * self.gradient + scaled @ move))
        return self.x + self.scales * move, predicted


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution of a positive definite system by Cholesky factors; by singular values where its condition is above 1e14.

    Of 113 parameters the singular values take 30 times as long, and half of the time of a search.
    """
    from scipy.linalg import get_lapack_funcs

    factorise, condition, solve = get_lapack_funcs(("potrf", "pocon", "potrs"), (matrix,))
    factor, fault = factorise(matrix, lower=1)
    if not fault and condition(factor, np.abs(matrix).sum(axis=0).max(), uplo="L")[0] > SINGULAR:
        return solve(factor, right, lower=1)[0]
    return np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0]


@dataclass(frozen=True, eq=False)
class _FreeRunSearch:
    """A free run with its prior as a problem of `lpvid.least_squares.descend`."""

    problem: FreeRunProblem
    prior: Prior
    scales: np.ndarray

    def evaluate(self, point: np.ndarray) -> _FreeRunTrial | None:
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(np.sum(self.prior.error(point) ** 2))
            for error, _ in self.problem.pieces(point, False):
                total += float(error @ error)
        return _FreeRunTrial(point, total) if np.isfinite(total) else None

    def linearise(self, trial: _FreeRunTrial, before: _NormalStep | None) -> _NormalStep:
        rows = self.prior.rows
        gram, gradient = rows.T @ rows, rows.T @ self.prior.error(trial.x)
        for error, jacobian in self.problem.pieces(trial.x, True):
            assert jacobian is not None
            gram += jacobian.T @ jacobian
            gradient += jacobian.T @ error
        return _NormalStep(trial.x, gram, gradient, self.scales)

    def admissible(self, trial: _FreeRunTrial, now: _FreeRunTrial) -> bool:
        return True


FreeRunSearchEnd = SearchEnd[_FreeRunTrial, _NormalStep]


def minimise(problem: FreeRunProblem, prior: Prior, start: np.ndarray, scales: np.ndarray, *, max_iterations: int,
             tolerance: float) -> FreeRunSearchEnd | None:
    """Levenberg-Marquardt from `start`; None where the free run diverges there.

    A trial whose run diverges, or whose cost does not fall, is refused, so that the search cannot leave the set of
    models that run. Columns are scaled; no step is longer than `LONGEST_STEP` scales.

    Parameters
    ----------
    problem : FreeRunProblem
        Gives errors and Jacobian.
    prior : Prior
        Its equations count beside those of the data.
    start : (k,) array
        Parameters to begin with.
    scales : (k,) array
        What counts as a unit change of each parameter.
    max_iterations : int
        Accepted steps at most.
    tolerance : float
        The search ends when the cost falls by less than this share of itself.

    Returns
    -------
    FreeRunSearchEnd or None
        Parameters in ``trial.x``, with the cost and why the search ended.
    """
    stop = StopRule(tolerance, iterations=max_iterations, least_decrease=0.0, worth=0.0)
    return descend(_FreeRunSearch(problem, prior, scales), np.array(start, dtype=float), stop, Factors())


def covariance(problem: FreeRunProblem, found: FreeRunSearchEnd) -> tuple[np.ndarray, float]:
    """Sandwich H⁻¹ S H⁻¹ of the estimate, and the mean squared error of the free run.

    S sums the lagged products of the scores J(t) e(t) with Bartlett weights over the residual's memory (Newey & West
    1987): a free run's error is never white. H holds the prior's equations too.

    Parameters
    ----------
    problem : FreeRunProblem
        That of the search.
    found : FreeRunSearchEnd
        End of the search.

    Returns
    -------
    (k, k) array
        Covariance of the searched parameters.
    float
        Mean squared error per sample [square of the output's unit].
    """
    x = found.trial.x
    errors = [error for error, _ in problem.pieces(x, False)]
    scores = (_scores(problem.along(place, x, True)) for place in range(len(errors)))
    middle = bartlett_of_parts(scores, x.size, residual_memory(errors))
    inverse = normal_inverse(found.linearised.gram)
    mean_square = sum(float(e @ e) for e in errors) / max(sum(map(len, errors)), 1)
    return inverse @ middle @ inverse, mean_square


def _scores(pieces: Iterator[Piece]) -> Iterator[np.ndarray]:
    """(n, k) J(t) e(t) of each part of a record, in the memory of its Jacobian."""
    for error, jacobian in pieces:
        assert jacobian is not None
        jacobian *= error[:, None]
        yield jacobian


@dataclass(frozen=True, eq=False)
class VectorLayout:
    """Layout of a self-scheduled model: its parameters in the order of its `vector`.

    Attributes
    ----------
    size : int
        Number of parameters k.
    """

    size: int

    def fill(self, model: SelfScheduled, theta: np.ndarray) -> SelfScheduled:
        """The model with these parameters.

        Parameters
        ----------
        model : SelfScheduled
            Gives everything but the parameters.
        theta : (k,) array
            Parameters in the order of the model's `vector`.

        Returns
        -------
        SelfScheduled
        """
        return model.with_vector(theta)

    def read(self, model: SelfScheduled) -> np.ndarray:
        """(k,) parameters of a model.

        Parameters
        ----------
        model : SelfScheduled
            A model of this layout.

        Returns
        -------
        (k,) array
        """
        return model.vector

    def names(self, model: SelfScheduled) -> tuple[str, ...]:
        """(k,) their names.

        Parameters
        ----------
        model : SelfScheduled
            A model of this layout.

        Returns
        -------
        tuple of str
        """
        return model.parameter_names

    def to_list(self) -> list[int]:
        """Plain data for JSON.

        Returns
        -------
        list of int
            The places 0 … k − 1.
        """
        return list(range(self.size))


def package(
    structure: Structure,
    model: SelfScheduled,
    problem: FreeRunProblem,
    found: FreeRunSearchEnd,
    records: Sequence[Record],
    notes: Sequence[str],
    select: np.ndarray | None = None,
) -> Identification:
    """The Identification of a search's end, with covariance and metadata.

    `select` (model's parameters, searched parameters) gives the searched parameter of each of the model's.

    Parameters
    ----------
    structure : Structure
        That was asked for.
    model : SelfScheduled
        The estimate.
    problem : FreeRunProblem
        That of the search, for the covariance.
    found : FreeRunSearchEnd
        End of the search.
    records : sequence of Record
        Data of the fit.
    notes : sequence of str
        Remarks that go in front of the one on the search.
    select : (model's parameters, searched parameters) array, optional
        Left out where both are the same.

    Returns
    -------
    Identification
        Standard errors stand in the metadata up to `COVARIANCE_LIMIT` parameters.
    """
    size = model.vector.size
    spread, variance = covariance(problem, found)
    if select is not None:
        spread = select @ spread @ select.T
    rows = sum(r.n_samples - model.start for r in records)
    metadata: dict = {"structure": structure.to_dict(),  # type: ignore[attr-defined]
                      "training": {"records": [r.name for r in records], "n_samples": rows}}
    if size <= COVARIANCE_LIMIT:
        metadata["standard_errors"] = np.sqrt(np.maximum(np.diag(spread)[:size], 0.0)).tolist()
    gram = found.linearised.gram
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    conditions = [float(np.linalg.cond(g)) ** 0.5 for g in (gram, gram / np.outer(scale, scale))]
    model = model.replace(noise_variance=variance, metadata=metadata)
    stated = (f"free-run search: {found.iterations} iterations, cost {found.first_cost:.4g} to {found.cost:.4g}; "
            f"{found.why}")
    kind = "sandwich over the free run's coloured error, with the prior's equations"
    return Identification(model, structure, VectorLayout(size), spread[:size, :size], conditions[0],  # type: ignore[arg-type]
                          conditions[1], rows, notes=(*notes, stated), covariance_kind=kind)


def wanted_filter(schedule_filter: SchedulingStage | str | None, sample_time: float,
                  place: int = 0) -> SchedulingStage | None:
    """The filter to start from: of a named one, start number `place`.

    Parameters
    ----------
    schedule_filter : str, SchedulingStage or None
        As the structure has it; an object is the start itself.
    sample_time : float
        Period [s].
    place : int
        Which of the starts; beyond the last it begins again at the first.

    Returns
    -------
    SchedulingStage or None
    """
    if isinstance(schedule_filter, str):
        starts = FITTED[schedule_filter].starts(sample_time)
        return starts[place % len(starts)]
    return schedule_filter
