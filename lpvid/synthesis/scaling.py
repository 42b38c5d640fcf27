"""Units in which the matrices of a plant are of order one: time, states, controls and measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.model.state_space import Matrices
from lpvid.synthesis.generalized_plant import PlantMatrices


@dataclass(frozen=True, eq=False)
class Units:
    """Balanced units: t' = `time`·t, x = `states`·x'/√time, u = `controls`·u', y = `measurements`·y'.

    Disturbances and performance signals keep their units, so gains w → z are those of the original. A Lyapunov matrix
    P' of the balanced plant is P = diag(1/states) P' diag(1/states) of the original.

    Parameters
    ----------
    time : float
        [1/s]; rates in the new time are the physical ones over it.
    states, controls, measurements : (n,), (n_u,), (n_y,) arrays

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> slow = PlantMatrices(-1e-4 * one, one, one, one, one, one, one, one, 0 * one)
    >>> float(Units.of(slow).apply(slow).A[0, 0, 0])
    -1.0
    """

    time: float
    states: np.ndarray
    controls: np.ndarray
    measurements: np.ndarray

    @classmethod
    def of(cls, plant: PlantMatrices) -> Units:
        """Units that balance a continuous plant over all its points: every state has rows and columns of equal size.

        Time is measured so that the fastest and the slowest mode are equally far from 1.

        Parameters
        ----------
        plant : PlantMatrices
            Continuous, at N points.

        Returns
        -------
        Units
            Positive; 1 for what has no size.
        """
        time = pace(plant.A)
        root = np.sqrt(time)
        u = 1 / _sizes(np.concatenate([plant.B2 / root, plant.D12], axis=1), 1)
        y = _sizes(np.concatenate([plant.C2 / root, plant.D21], axis=2), 2)
        d = _balance(plant.A / time, np.concatenate([plant.B1, plant.B2 * u], axis=2) / root,
                     np.concatenate([plant.C1, plant.C2 / y[:, None]], axis=1) / root)
        return cls(time, d, u, y)

    def apply(self, plant: PlantMatrices) -> PlantMatrices:
        """The plant in these units.

        Parameters
        ----------
        plant : PlantMatrices
            Continuous, at N points, in the original units.

        Returns
        -------
        PlantMatrices
            D11 is unchanged.
        """
        root, d, u, y = np.sqrt(self.time), self.states, self.controls, self.measurements[:, None]
        return PlantMatrices(plant.A * d / d[:, None] / self.time, plant.B1 / d[:, None] / root,
                             plant.B2 * u / d[:, None] / root, plant.C1 * d / root, plant.D11, plant.D12 * u,
                             plant.C2 * d / y / root, plant.D21 / y, plant.D22 * u / y)

    def controller(self, k: Matrices) -> Matrices:
        """A controller for the balanced plant in the original units of time, controls and measurements.

        Parameters
        ----------
        k : (A, B, C, D), each (N, …)
            Of the balanced plant.

        Returns
        -------
        (A, B, C, D), each (N, …)
            States keep their scale.
        """
        a, b, c, d = k
        root, u = np.sqrt(self.time), self.controls[:, None]
        return self.time * a, root * b / self.measurements, root * u * c, u * d / self.measurements


def pace(a: np.ndarray) -> float:
    """Geometric mean of the fastest and the slowest mode; 1 for a plant without dynamics.

    Parameters
    ----------
    a : (N, n, n) array
        A at N points.

    Returns
    -------
    float
        [1/s].
    """
    speeds = np.abs(np.linalg.eigvals(a)) if a.shape[1] else np.zeros((1, 1))
    fast = float(speeds.max(initial=0.0))
    if not fast > 0:
        return float(np.abs(a).max(initial=0.0)) or 1.0
    slow = float(speeds[speeds > 1e-6 * fast].min())
    return float(np.sqrt(fast * slow))


def _sizes(matrix: np.ndarray, axis: int) -> np.ndarray:
    """Largest norm over the points of every column (summed along axis 1) or row (along axis 2); 1 for empty ones."""
    size = np.sqrt((matrix**2).sum(axis=axis)).max(axis=0)
    return np.where(size > 0, size, 1.0)


def _balance(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Diagonal d that makes rows of [A B] and columns of [A; C] equally large (Osborne 1960), in a few sweeps."""
    a, b, c = (np.abs(x).max(axis=0) for x in (a, b, c))
    n = len(a)
    d, off = np.ones(n), a * (1 - np.eye(n))
    inward, outward = (b**2).sum(axis=1), (c**2).sum(axis=0)
    for _ in range(30):
        before = d.copy()
        for i in range(n):
            row = ((off[i] * d) ** 2).sum() + inward[i]
            column = ((off[:, i] / d) ** 2).sum() + outward[i]
            if row > 0 and column > 0:
                d[i] = (row / column) ** 0.25
        if np.allclose(d, before, rtol=0.05):
            break
    return np.clip(d, 1e-8, 1e8)
