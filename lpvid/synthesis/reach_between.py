"""Where between the points of a grid a plant's only control, or only measurement, loses a mode that does not decay.

The reach of one control on a real mode, vᵀb with the left eigenvector v, is one number that moves with the scheduling.
It may change its sign, and where it is zero no controller stabilises the plant; a grid meets such a place by chance.
Two controls lose a mode at once only by coincidence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance

from lpvid.synthesis.generalized_plant import PlantMatrices

INSIDE = 8
"""parts into which a line between neighbours of the grid is cut for a first look"""
HALVINGS = 60
"""steps of the golden section: the place to 0.618⁶⁰ = 3e-13 of a part"""


def least_reach(at: Callable[[np.ndarray], PlantMatrices], points: np.ndarray, discrete: bool, decay: float = 0.0
                ) -> np.ndarray:
    """Places on the lines between neighbours of a grid at which a mode is reached, or shown, least.

    Parameters
    ----------
    at : callable
        Points (N, n_scheduling) → matrices of the plant.
    points : (N, n_scheduling) array
        A full grid.
    discrete : bool
    decay : float
        Modes count that decay no faster [1/s, or per sample].

    Returns
    -------
    (K, n_scheduling) array
        Local minima that may be zeros; none where no such mode depends on one signal.
    """
    start, end = _lines(points)
    found: list[np.ndarray] = []
    if not len(start):
        return points[:0]
    shares = np.linspace(0.0, 1.0, INSIDE + 1)
    places = start[:, None] + shares[:, None] * (end - start)[:, None]
    plant = at(places.reshape(-1, points.shape[1]))
    for turned in (False, True):
        a, b = _side(plant, turned)
        if b.shape[2] != 1:
            continue
        reach = _reach(a, b, discrete, decay).reshape(places.shape[:2])
        for k in np.flatnonzero(np.isfinite(reach).any(axis=1)):
            j = int(np.argmin(reach[k]))
            low, high = max(j - 1, 0), min(j + 1, INSIDE)
            # the sample next to a line's zero is at most half as high as its outer neighbour is above it
            if not reach[k, j] <= max(reach[k, low], reach[k, high]) - reach[k, j]:
                continue
            line = _Line(at, start[k], end[k], turned, discrete, decay)
            found.append(line.place(_golden(line.reach, float(shares[low]), float(shares[high]))))
    return np.array(found).reshape(-1, points.shape[1])


@dataclass(frozen=True, eq=False)
class _Line:
    """The reach along the line between two points."""

    at: Callable[[np.ndarray], PlantMatrices]
    start: np.ndarray
    end: np.ndarray
    turned: bool
    discrete: bool
    decay: float

    def place(self, share: float) -> np.ndarray:
        return self.start + share * (self.end - self.start)

    def reach(self, share: float) -> float:
        return float(_reach(*_side(self.at(self.place(share)[None]), self.turned), self.discrete, self.decay)[0])


def _lines(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the lines that join neighbours along each variable."""
    start, end = [points[:0]], [points[:0]]
    for j in range(points.shape[1]):
        others = np.delete(points, j, axis=1)
        order = np.lexsort((points[:, j], *others.T))
        ahead, behind = points[order[1:]], points[order[:-1]]
        same = np.all(np.delete(ahead == behind, j, axis=1), axis=1) & (ahead[:, j] > behind[:, j])
        start.append(behind[same])
        end.append(ahead[same])
    return np.concatenate(start), np.concatenate(end)


def _side(plant: PlantMatrices, turned: bool) -> tuple[np.ndarray, np.ndarray]:
    """A and B2, or those of the dual plant; states of comparable size."""
    a, b = (plant.A.swapaxes(1, 2), plant.C2.swapaxes(1, 2)) if turned else (plant.A, plant.B2)
    if not a.shape[1]:
        return a, b
    _, (scale, _) = matrix_balance(np.abs(a).mean(axis=0), permute=False, separate=True)
    return a * scale / scale[:, None], b / scale[:, None]


def _reach(a: np.ndarray, b: np.ndarray, discrete: bool, decay: float) -> np.ndarray:
    """(N,) least |vᵀb|/(|v||b|) over the real modes that decay no faster; infinite without one."""
    if not a.shape[1]:
        return np.full(len(a), np.inf)
    poles, left = np.linalg.eig(a.swapaxes(1, 2))
    size = np.maximum(np.linalg.norm(b, axis=(1, 2)), 1e-300)
    reach = np.abs(np.einsum("kij,ki->kj", left, b[:, :, 0])) / size[:, None]
    stays = (np.abs(poles) >= 1 - decay if discrete else np.real(poles) >= -decay) & (np.imag(poles) == 0)
    return np.where(stays, reach, np.inf).min(axis=1)


def _golden(of: Callable[[float], float], low: float, high: float) -> float:
    """The minimum of a function with one, by the golden section."""
    ratio = (np.sqrt(5.0) - 1) / 2
    left, right = high - ratio * (high - low), low + ratio * (high - low)
    at_left, at_right = of(left), of(right)
    for _ in range(HALVINGS):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - ratio * (high - low)
            at_left = of(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + ratio * (high - low)
            at_right = of(right)
    return left if at_left < at_right else right
