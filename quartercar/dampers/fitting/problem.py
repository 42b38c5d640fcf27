"""Problem: free-run force residuals of a damper law along drives, in the coordinates of a search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.least_squares import Trial, bounded_least_squares
from quartercar.dampers.drive import Drive
from quartercar.dampers.fitting.fitted_law import FittedLaw
from quartercar.dampers.fitting.solver import SearchCoordinates
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import Sizes


@dataclass(frozen=True, eq=False)
class DamperFitProblem:
    """Residuals F̂ − F of the free run, all records one after the other, each without its first `damper.start` samples.

    Attributes
    ----------
    damper : FittedLaw
        Structure; its values are not read.
    drives : tuple of Drive
        With the measured force.
    of : Sizes or None
        Sizes of the data that the search is about, where these drives are part of them; None: those of the drives.
    """

    damper: FittedLaw
    drives: tuple[Drive, ...]
    of: Sizes | None = None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the damper, with the typical values and the ranges that the sizes of the data give."""
        return sized_parameters(self.damper, self.sizes)

    @cached_property
    def sizes(self) -> Sizes:
        """Of the data."""
        return self.of or Sizes.of(self.drives)

    @cached_property
    def measured(self) -> np.ndarray:
        """(m,) measured force."""
        return np.concatenate([_force(d)[self.damper.start:] for d in self.drives])

    @cached_property
    def lengths(self) -> tuple[int, ...]:
        """Residuals of each record."""
        return tuple(d.n_samples - self.damper.start for d in self.drives)

    def model(self, theta: np.ndarray) -> np.ndarray:
        """(m,) free run; not finite where it diverged.

        Parameters
        ----------
        theta : (P,) array
            Parameters in the order of the damper's `names`, SI.

        Returns
        -------
        (m,) array
            Force of all records, one after the other [N].
        """
        with np.errstate(all="ignore"):
            return np.concatenate([self.damper.response(d, theta)[self.damper.start:] for d in self.drives])

    def jacobian(self, theta: np.ndarray) -> np.ndarray:
        """(m, P) sensitivities; those out of range count as none.

        Parameters
        ----------
        theta : (P,) array
            Parameters in the order of the damper's `names`, SI.

        Returns
        -------
        (m, P) array
            [N per unit of the parameter].
        """
        return self.sensitivity(theta, range(theta.size))

    def sensitivity(self, theta: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """The same in the parameters at these places.

        Parameters
        ----------
        theta : (P,) array
        columns : sequence of int

        Returns
        -------
        (m, len(columns)) array
            [N per unit of the parameter].
        """
        start, found, done = self.damper.start, None, 0
        with np.errstate(all="ignore"):
            for drive, length in zip(self.drives, self.lengths, strict=True):
                part = self.damper.sensitivity(drive, theta, columns)[start:]
                if found is None:  # one drive's columns are not copied, those of several are laid out as the first
                    shape = sum(self.lengths), len(columns)
                    found = part if len(self.drives) == 1 else np.empty_like(part, shape=shape)
                if found is not part:
                    found[done: done + length] = part
                done += length
        assert found is not None
        if not np.isfinite(found).all():
            np.nan_to_num(found, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        return found


def sized_parameters(damper: FittedLaw, sizes: Sizes) -> tuple[Parameter, ...]:
    """Parameters of a law with the typical values and the ranges of a search that the data's sizes give.

    Parameters
    ----------
    damper : FittedLaw
    sizes : Sizes

    Returns
    -------
    tuple of Parameter
        The law's own, where they are not `of_typical_size`.
    """
    return tuple(map(sizes.sized, damper.parameters)) if damper.of_typical_size else damper.parameters


def _force(drive: Drive) -> np.ndarray:
    assert drive.force is not None
    return drive.force


class MovingFit:
    """All parameters move together, or some while the others stay.

    Parameters
    ----------
    problem : DamperFitProblem
    free : sequence of str, optional
        Names of those that move; all where left out. The others stay at the damper's own values.
    """

    def __init__(self, problem: DamperFitProblem, free: Sequence[str] | None = None) -> None:
        damper = problem.damper
        self.problem, self.base = problem, damper.vector
        self.free = [list(damper.names).index(n) for n in (damper.names if free is None else free)]
        self.coordinates = SearchCoordinates([problem.parameters[i] for i in self.free])

    def start(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates of a vector of parameters.

        Parameters
        ----------
        theta : (P,) array
            All parameters, SI; those that move are brought inside their bounds.

        Returns
        -------
        (k,) array
            Of the parameters that move; logarithms where one moves by its logarithm.
        """
        return self.coordinates.of(theta[self.free])

    def trial(self, point: np.ndarray) -> Trial | None:
        """Residual at a point of the search; None where the run diverges.

        Parameters
        ----------
        point : (k,) array
            Coordinates of the parameters that move.

        Returns
        -------
        Trial or None
            Residual F̂ − F [N], and all parameters.
        """
        theta = self.base.copy()
        theta[self.free] = self.coordinates.values(point)
        residual = self.problem.model(theta) - self.problem.measured
        return Trial(point, theta, residual) if np.isfinite(residual).all() else None

    def jacobian(self, trial: Trial) -> np.ndarray:
        """(m, k) derivative of the residual in the coordinates.

        Parameters
        ----------
        trial : Trial
            What `trial` returned.

        Returns
        -------
        (m, k) array
            [N per unit of the coordinate].
        """
        found = self.problem.sensitivity(trial.theta, self.free)
        found *= self.coordinates.slope(trial.theta[self.free])
        return found


class ProjectedFit:
    """Only the parameters that enter nonlinearly move; the others follow by bounded linear least squares.

    Golub & Pereyra (1973), SIAM J. Numer. Anal. 10(2), 413-432, with Kaufman's (1975) simplification of the derivative:
    J = P⊥ ∂F/∂β, where P⊥ projects off the columns of those linear parameters that are not at a bound.

    Parameters
    ----------
    problem : DamperFitProblem
        Of a damper with linear parameters.
    """

    def __init__(self, problem: DamperFitProblem) -> None:
        names, parameters = problem.damper.names, problem.parameters
        self.problem = problem
        self.linear = np.array([n in problem.damper.linear for n in names])
        self.by_runs = problem.damper.real_runs
        self.coordinates = SearchCoordinates([p for p, lin in zip(parameters, self.linear, strict=True) if not lin])
        chosen = [p for p, lin in zip(parameters, self.linear, strict=True) if lin]
        self.lower, self.upper = np.array([p.lower for p in chosen]), np.array([p.upper for p in chosen])
        self.anchor = np.array([p.default for p in parameters])
        self.step = np.array([abs(p.default) or problem.sizes.factor(p.unit) for p in chosen])

    def start(self, theta: np.ndarray) -> np.ndarray:
        """Coordinates of a vector of parameters.

        Parameters
        ----------
        theta : (P,) array
            All parameters, SI; the linear ones are not read.

        Returns
        -------
        (k,) array
            Of the nonlinear parameters; logarithms where one moves by its logarithm.
        """
        return self.coordinates.of(theta[~self.linear])

    def trial(self, point: np.ndarray) -> Trial | None:
        """Residual with the best linear parameters; None where the run diverges.

        Parameters
        ----------
        point : (k,) array
            Coordinates of the nonlinear parameters.

        Returns
        -------
        Trial or None
            Residual F̂ − F [N], all parameters, and the columns of the linear ones inside their bounds.
        """
        theta = self.anchor.copy()
        theta[~self.linear] = self.coordinates.values(point)
        base = self.problem.model(theta)
        columns = self._moved_runs(theta, base) if self.by_runs else (
            self.problem.sensitivity(theta, np.flatnonzero(self.linear).tolist()))
        if not (np.isfinite(base).all() and np.isfinite(columns).all()):
            return None
        best = bounded_least_squares(columns, self.problem.measured - base + columns @ theta[self.linear],
                                     self.lower, self.upper)
        residual = base + columns @ (best - theta[self.linear]) - self.problem.measured
        theta[self.linear] = best
        free = (best > self.lower) & (best < self.upper)
        return Trial(point, theta, residual, columns[:, free])

    def _moved_runs(self, theta: np.ndarray, base: np.ndarray) -> np.ndarray:
        """(m, l) columns of the linear parameters, by one run for each: the force is affine in them."""
        columns = np.empty((base.size, self.step.size))
        for k, place in enumerate(np.flatnonzero(self.linear)):
            moved = theta.copy()
            moved[place] += self.step[k]
            with np.errstate(invalid="ignore"):
                columns[:, k] = (self.problem.model(moved) - base) / self.step[k]
        return columns

    def jacobian(self, trial: Trial) -> np.ndarray:
        """(m, k) derivative of the projected residual in the coordinates.

        Parameters
        ----------
        trial : Trial
            What `trial` returned.

        Returns
        -------
        (m, k) array
            [N per unit of the coordinate].
        """
        slope = self.coordinates.slope(trial.theta[~self.linear])
        moved = self.problem.sensitivity(trial.theta, np.flatnonzero(~self.linear).tolist())
        moved *= slope
        if trial.columns is None or not trial.columns.size:
            return moved
        scale = np.linalg.norm(trial.columns, axis=0)
        q = np.linalg.qr(trial.columns / np.where(scale > 0, scale, 1.0))[0]
        moved -= q @ (q.T @ moved)
        return moved
