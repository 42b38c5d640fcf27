"""Prediction-error search over the parameters of a state-space model: exact sensitivities, chunked QR, safeguards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.identification.state_space_layout import StateSpaceLayout, stacks
from lpvid.least_squares import Factors, StopRule, descend
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.simulation import _outputs, _signals

INFLUENCED = 5000
"""samples of a record to which its initial state is fitted."""
CHUNK = 512
"""samples whose sensitivities are folded into R at once."""
BEYOND = 1e4
"""a run that exceeds this many times the data's scale counts as diverged."""
RULE = Factors(1e-2, down=8.0, up=6.0, good=0.7, poor=0.2, refusals=14)
"""of damping, for unit Jacobian columns."""
DECIDED, SLOW = 0.01, 0.2
"""decrease of the cost, in noise variances, that ends the search at once (a tenth of a standard error), or at the third
time in a row."""
FROZEN_POINTS = 2000
"""points along the training trajectory at which a trial's frozen poles are looked at."""
NEGLIGIBLE = 1e-9
"""singular values below this share of the largest are directions the data do not see."""


@dataclass(frozen=True, eq=False)
class SearchData:
    """Basis values, filter inputs and outputs of every record.

    Attributes
    ----------
    pieces : tuple of (phi (n, M), u (n, nu), y (n, ny))
    weight : (ny,) array
        Factor on each output's error.
    limit : (ny,) array
        What no sane output exceeds.
    """

    pieces: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]
    weight: np.ndarray
    limit: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "pieces", tuple((phi, _checks.read_only(u), y) for phi, u, y in self.pieces))

    @classmethod
    def of(cls, records: Sequence[Record], model: LPVStateSpace) -> SearchData:
        """The data as the model's stages and basis see them; outputs weighted by their spread.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        model : LPVStateSpace
            For its channels, stages and basis.

        Returns
        -------
        SearchData
        """
        pieces = []
        for record in records:
            u, p = _signals(model, record)
            phi = np.array(model.basis.evaluate(p), order="C")
            pieces.append((phi, np.array(u), np.array(_outputs(model, record))))
        y = np.vstack([piece[2] for piece in pieces])
        reach = np.abs(y).max(axis=0)
        spread = np.where(y.std(axis=0) > 1e-12 * reach, y.std(axis=0), np.maximum(reach, 1.0))
        return cls(tuple(pieces), 1.0 / spread, BEYOND * np.maximum(reach, spread))

    def at(self, model: LPVStateSpace) -> SearchData:
        """The data as this model's stages see them: these here, whose stages do not move.

        Parameters
        ----------
        model : LPVStateSpace
            At the present parameters.

        Returns
        -------
        SearchData
        """
        return self

    def tangents(self, model: LPVStateSpace) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per record the derivatives of φ (n, M, s) and u (n, nu, s) by what moves the stages: nothing does.

        Parameters
        ----------
        model : LPVStateSpace
            At the present parameters.

        Returns
        -------
        list of ((n, M, s) array, (n, nu, s) array)
            s = 0 here.
        """
        return [(np.zeros((*phi.shape, 0)), np.zeros((*u.shape, 0))) for phi, u, _ in self.pieces]

    @property
    def rows(self) -> int:
        """Number of scalar residuals."""
        return sum(piece[2].size for piece in self.pieces)

    @property
    def ones(self) -> np.ndarray | None:
        """(M,) coefficients with which the basis gives the constant 1, or None."""
        phi = np.vstack([piece[0][:: max(1, len(piece[0]) // 2000)] for piece in self.pieces])
        v = np.linalg.lstsq(phi, np.ones(len(phi)), rcond=1e-10)[0]
        return v if np.abs(phi @ v - 1).max() < 1e-8 else None


def triangle(matrix: np.ndarray) -> np.ndarray:
    """R of the QR factorisation.

    Parameters
    ----------
    matrix : (m, n) array

    Returns
    -------
    (min(m, n), n) array
    """
    return np.asarray(np.linalg.qr(matrix, mode="r"))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Weighted sum of squared errors of a model with the best initial states; infinite where a run diverges.

    Attributes
    ----------
    cost : float
        Of weighted errors.
    starts : tuple of (nx,) arrays
        Initial state of every record.
    errors : tuple of (n, ny) arrays
        y − ŷ per record in the units of the outputs, without weights; empty where a run diverges, like `starts`.
    """

    cost: float
    starts: tuple[np.ndarray, ...] = ()
    errors: tuple[np.ndarray, ...] = ()


def evaluate(model: LPVStateSpace, data: SearchData) -> Evaluation:
    """Run the model's predictor over all records; each initial state is the least-squares one.

    Parameters
    ----------
    model : LPVStateSpace
        With an observer gain its one-step predictor runs, without one its free run.
    data : SearchData
        Records, weights and limits.

    Returns
    -------
    Evaluation
    """
    from lpvid._state_space_kernels import predictor_run

    arrays = stacks(model)
    if not all(np.isfinite(a).all() for a in arrays):
        return Evaluation(np.inf)
    cost, starts, errors = 0.0, [], []
    for phi, u, y in data.at(model).pieces:
        n, (ny, nx) = min(len(y), INFLUENCED), model.C.shape[1:]
        output, influence, x0 = np.zeros_like(y), np.zeros((n, ny, nx)), np.zeros(nx)
        if predictor_run(arrays, phi, u, y, x0, n, data.limit, output, influence) >= 0:
            return Evaluation(np.inf)
        left = (y - output) * data.weight
        if nx:
            matrix = (influence * data.weight[:, None]).reshape(-1, nx)
            if not np.isfinite(matrix).all() or np.abs(matrix).max() > 1e12:
                return Evaluation(np.inf)
            x0 = np.linalg.lstsq(matrix, left[:n].ravel(), rcond=1e-8)[0]
            if predictor_run(arrays, phi, u, y, x0, 0, data.limit, output, influence) >= 0:
                return Evaluation(np.inf)
            left = (y - output) * data.weight
        cost += float(np.sum(left**2))
        starts.append(x0)
        errors.append(left / data.weight)
    return Evaluation(cost, tuple(starts), tuple(errors))


def linearise(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData,
              starts: Sequence[np.ndarray]) -> np.ndarray:
    """(k+1, k+1) triangular factor of [∂ŷ/∂θ, ŷ − y] with every record's initial state projected out.

    Parameters
    ----------
    model : LPVStateSpace
        At the present parameters.
    layout : StateSpaceLayout
        Of its k parameters.
    data : SearchData
        Records and weights.
    starts : sequence of (nx,) arrays
        Initial states, from `evaluate`.

    Returns
    -------
    (k + 1, k + 1) array
    """
    from lpvid._kernels import ChunkedQR
    from lpvid._state_space_kernels import sensitivity_rows

    arrays, table = stacks(model), np.array(layout.table)
    nx, ny, width = model.order, model.n_outputs, model.order + layout.size
    total = np.zeros((layout.size + 1, layout.size + 1))
    for (phi, u, y), (d_phi, d_u), x0 in zip(data.at(model).pieces, data.tangents(model), starts, strict=True):
        qr = ChunkedQR(width + 1, CHUNK * ny)
        x, moved = x0.copy(), np.hstack([np.eye(nx), np.zeros((nx, layout.size))])
        for first in range(0, len(y), CHUNK):
            last = min(first + CHUNK, len(y))
            sensitivity_rows(arrays, phi, u, y, table, data.weight, x, moved, first, last, qr.block,
                             d_phi, d_u)
            qr.absorb((last - first) * ny)
        total = triangle(np.vstack([total, qr.r[nx:, nx:]]))
    return total


def gauge(model: LPVStateSpace, layout: StateSpaceLayout, ones: np.ndarray | None) -> np.ndarray:
    """(k, directions) changes of a fully parametrised model that leave its input-output behaviour as it is.

    A change of coordinates x → (I + S)⁻¹x moves A by AS − SA, B by −SB, C by CS (Lee & Poolla 1999; McKelvey,
    Helmersson & Ribarits 2004), every coefficient matrix alike; with free offsets a shift of the state is another.

    Parameters
    ----------
    model : LPVStateSpace
        Fully parametrised.
    layout : StateSpaceLayout
        Of its k parameters.
    ones : (M,) array or None
        Combination of the basis that is 1; None where there is none, and the shift then drops out.

    Returns
    -------
    (k, directions) array
        n² directions for n states, and n more with offsets.
    """
    a, b, c, _, f, _, k = stacks(model)
    free = {int(code) for code in np.unique(layout.table[:, 1])}
    n, columns = model.order, []
    for i, j in np.ndindex(n, n):
        s = np.zeros((n, n))
        s[i, j] = 1.0
        columns.append(layout.direction({"A": a @ s - s @ a, "B": -s @ b, "C": c @ s, "state_offset": -s @ f,
                                         "observer_gain": -s @ k}))
    if ones is not None and {2, 6} <= free:
        for i in range(n):
            s = np.zeros((n, 1))
            s[i] = 1.0
            columns.append(layout.direction({"state_offset": ones[:, None, None] * s - a @ s, "output_offset": -c @ s}))
    return np.column_stack(columns) if columns else np.zeros((layout.size, 0))


@dataclass(frozen=True, eq=False)
class StateSpaceSearchEnd:
    """Where the search ended.

    Attributes
    ----------
    model : LPVStateSpace
    evaluation : Evaluation
    data : SearchData
        With the weights last used.
    iterations : int
    why : str
        Why it stopped.
    """

    model: LPVStateSpace
    evaluation: Evaluation
    data: SearchData
    iterations: int
    why: str


@dataclass(frozen=True, eq=False)
class LocalProblem:
    """The linearised problem in coordinates that the data determine: unit columns, gauge directions projected out.

    Attributes
    ----------
    scale : (k,) array
        Norms of the Jacobian's columns, kept away from zero.
    frame : (k, m) array
        Orthonormal complement of the gauge directions, in scaled parameters.
    left : (r,) array
        Residual in the left singular directions.
    singular : (r,) array
        Singular values of the projected Jacobian, falling.
    right : (r, m) array
        Right singular directions.
    condition : float
        Ratio of the first to the last singular value.
    """

    scale: np.ndarray
    frame: np.ndarray
    left: np.ndarray
    singular: np.ndarray
    right: np.ndarray
    condition: float

    @classmethod
    def of(cls, factor: np.ndarray, directions: np.ndarray) -> LocalProblem:
        """Problem of a triangular factor, by one singular value decomposition.

        Parameters
        ----------
        factor : (k + 1, k + 1) array
            Of [∂ŷ/∂θ, ŷ − y], from `linearise`.
        directions : (k, d) array
            Changes without effect, from `gauge`; no columns for none.

        Returns
        -------
        LocalProblem
        """
        k = factor.shape[0] - 1
        jacobian, residual = factor[:k, :k], factor[:k, k]
        norms = np.linalg.norm(jacobian, axis=0)
        scale = np.maximum(norms, 1e-8 * (norms.max(initial=0.0) or 1.0))
        frame = _complement(directions * scale[:, None])
        u, s, vt = np.linalg.svd((jacobian / scale) @ frame, full_matrices=False)
        ratio = float(s[0] / s[-1]) if s.size and s[-1] > 0 else np.inf
        return cls(scale, frame, u.T @ residual, s, vt, ratio)

    def step(self, damping: float) -> np.ndarray:
        """Change of the parameters that a damped Gauss-Newton step takes.

        Parameters
        ----------
        damping : float
            λ, for unit columns.

        Returns
        -------
        (k,) array
        """
        shrunk = self.singular / (self.singular**2 + damping) * self.left
        return -(self.frame @ (self.right.T @ shrunk)) / self.scale

    def expected(self, damping: float) -> float:
        """Decrease of the cost that the linear model predicts.

        Parameters
        ----------
        damping : float
            λ, for unit columns.

        Returns
        -------
        float
            In the unit of the weighted cost.
        """
        seen = self.singular**2 + damping > 0  # a parameter without any effect gives no decrease
        share = damping / (self.singular[seen] ** 2 + damping)
        return float(np.sum(self.left[seen] ** 2 * (1 - share**2)))

    def covariance(self, noise: float) -> tuple[np.ndarray, int]:
        """Covariance of the parameters, and the number of directions that the data determine.

        Parameters
        ----------
        noise : float
            Variance of the weighted errors.

        Returns
        -------
        (k, k) array, int
        """
        seen = self.singular > NEGLIGIBLE * self.singular.max(initial=0.0)
        root = (self.frame @ self.right[seen].T) / self.singular[seen] / self.scale[:, None]
        return noise * root @ root.T, int(seen.sum())


def _complement(directions: np.ndarray) -> np.ndarray:
    """Orthonormal basis of what is orthogonal to the columns."""
    if not directions.shape[1]:
        return np.eye(directions.shape[0])
    u, s, _ = np.linalg.svd(directions)
    return u[:, int(np.sum(s > 1e-10 * s.max(initial=0.0))):]


def refine(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, *, iterations: int = 60,
           free_coordinates: bool = True, stable: bool = False) -> StateSpaceSearchEnd:
    """Levenberg-Marquardt with every trial evaluated by its own run; a trial that diverges is a step too long.

    Parameters
    ----------
    model : LPVStateSpace
        Start; its predictor must be bounded on the data.
    layout : StateSpaceLayout
        The free parameters.
    data : SearchData
    iterations : int
        Linearisations at most.
    free_coordinates : bool
        True for a full parametrisation, whose steps then leave the state coordinates alone.
    stable : bool
        Refuse also steps that take frozen poles out of the unit circle along the training trajectory, or further out:
        such a model may run well there and diverge on the next record.

    Returns
    -------
    StateSpaceSearchEnd
    """
    with single_thread():
        found = _levenberg(model, layout, data, iterations, free_coordinates, stable)
        if model.n_outputs > 1 and np.isfinite(found.evaluation.cost):
            rms = np.sqrt(np.mean(np.vstack(found.evaluation.errors) ** 2, axis=0))
            reweighted = replace(data, weight=1.0 / np.maximum(rms, 1e-9 / data.weight))
            again = _levenberg(found.model, layout, reweighted, max(iterations // 2, 5), free_coordinates,
                               stable)
            found = replace(again, iterations=found.iterations + again.iterations)
    return found


@dataclass(frozen=True, eq=False)
class _StateSpaceTrial:
    """A model, its parameters and its errors."""

    model: LPVStateSpace
    theta: np.ndarray
    evaluation: Evaluation
    data: SearchData

    @property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return self.evaluation.cost

    @cached_property
    def radius(self) -> float:
        """Largest frozen pole along the training trajectory."""
        return frozen_radius(self.model, self.data)


@dataclass(frozen=True, eq=False)
class _ProjectedStep:
    """The local problem at a trial, and the predicted decrease below which no step is worth a run."""

    theta: np.ndarray
    factor: np.ndarray
    directions: np.ndarray
    least: float

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.factor).all())

    @cached_property
    def local(self) -> LocalProblem:
        return LocalProblem.of(self.factor, self.directions)

    def step(self, damping: float) -> tuple[np.ndarray, float]:
        """Parameters to try, and the predicted decrease of the cost; none where the undamped step has none."""
        worth_it = self.local.expected(0.0) >= self.least
        return self.theta + self.local.step(damping), self.local.expected(damping) if worth_it else 0.0


@dataclass(frozen=True, eq=False)
class _StateSpaceSearch:
    """A state-space model on data as a problem of `lpvid.least_squares.descend`."""

    model: LPVStateSpace
    layout: StateSpaceLayout
    data: SearchData
    free_coordinates: bool
    stable: bool

    @cached_property
    def ones(self) -> np.ndarray | None:
        """`SearchData.ones`, which no step changes."""
        return self.data.ones

    def evaluate(self, point: np.ndarray) -> _StateSpaceTrial | None:
        if not np.isfinite(point).all():
            return None
        model = self.layout.fill(self.model, point)
        found = evaluate(model, self.data)
        return _StateSpaceTrial(model, self.layout.read(model), found, self.data) if np.isfinite(found.cost) else None

    def linearise(self, trial: _StateSpaceTrial, before: _ProjectedStep | None) -> _ProjectedStep:
        factor = linearise(trial.model, self.layout, self.data, trial.evaluation.starts)
        directions = (gauge(trial.model, self.layout, self.ones) if self.free_coordinates
                      else np.zeros((self.layout.size, 0)))
        return _ProjectedStep(trial.theta, factor, directions, DECIDED * trial.cost / self.data.rows)

    def admissible(self, trial: _StateSpaceTrial, now: _StateSpaceTrial) -> bool:
        return not self.stable or trial.radius <= max(1.0, now.radius)


def _levenberg(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, iterations: int,
               free_coordinates: bool, stable: bool) -> StateSpaceSearchEnd:
    stop = StopRule(SLOW / data.rows, calm=3, iterations=iterations, least_decrease=0.0, decided=DECIDED / data.rows,
                    worth=0.0)
    found = descend(_StateSpaceSearch(model, layout, data, free_coordinates, stable), layout.read(model), stop, RULE)
    if found is None:
        return StateSpaceSearchEnd(model, Evaluation(np.inf), data, 0, "its start diverges")
    return StateSpaceSearchEnd(found.trial.model, found.trial.evaluation, data, found.iterations, found.why)


def frozen_radius(model: LPVStateSpace, data: SearchData) -> float:
    """Largest modulus of the frozen poles at points spread along the training trajectory.

    Parameters
    ----------
    model : LPVStateSpace
        At the present parameters.
    data : SearchData
        Gives the trajectory, on about `FROZEN_POINTS` samples.

    Returns
    -------
    float
        0 without states.
    """
    if not model.order:
        return 0.0
    step = max(1, sum(len(piece[0]) for piece in data.pieces) // FROZEN_POINTS)
    phi = np.vstack([piece[0][::step] for piece in data.at(model).pieces])
    return float(np.abs(np.linalg.eigvals(np.tensordot(phi, model.A, axes=1))).max())


def bounded(model: LPVStateSpace, data: SearchData) -> tuple[LPVStateSpace, float]:
    """The model with its state matrix shrunk by the least factor that keeps its runs bounded, and that factor.

    An observer gain whose predictor diverges is dropped first.

    Parameters
    ----------
    model : LPVStateSpace
        Any.
    data : SearchData
        Records on which the run must stay bounded.

    Returns
    -------
    LPVStateSpace
        The model itself where its runs are bounded.
    float
        1 where A is as it was, 0 where it had to vanish.
    """
    excess = 100.0 * data.rows
    if evaluate(model, data).cost < excess:
        return model, 1.0
    if model.observer_gain is not None:
        plain = model.replace(observer_gain=np.zeros_like(model.observer_gain))
        if evaluate(plain, data).cost < excess:
            return plain, 1.0
        model = plain
    for factor in (0.995, 0.98, 0.95, 0.9, 0.8, 0.6, 0.3):
        shrunk = model.replace(A=factor * model.A)
        if evaluate(shrunk, data).cost < excess:
            return shrunk, factor
    return model.replace(A=np.zeros_like(model.A)), 0.0
