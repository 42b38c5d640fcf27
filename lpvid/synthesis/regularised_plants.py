"""Plants whose free controls get effort and whose exact measurements get noise: a program then bounds their gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.synthesis.generalized_plant import PlantMatrices


def singular(plant: PlantMatrices) -> bool:
    """Some control is limited by nothing at high frequency, or some measurement is exact.

    Parameters
    ----------
    plant : PlantMatrices
        At N points.

    Returns
    -------
    bool
        D12 or D21 passes almost nothing in some direction at some point.
    """
    return any(len(w) for w in _unlimited(plant))


def regular(plant: PlantMatrices, size: float) -> PlantMatrices:
    """The plant with noise of a given size in measurements that are exact, and effort of controls that are free.

    What bounds its gain bounds that of the plant itself.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in balanced units.
    size : float
        Of noise and effort.

    Returns
    -------
    PlantMatrices
        With further disturbances and performance signals where there are such directions.
    """
    return _restrained(plant, size, *_unlimited(plant))


def restrained(plant: PlantMatrices, size: float) -> PlantMatrices:
    """The plant with noise of a given size in every measurement and effort of every control: gains stay moderate.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in balanced units.
    size : float
        Of noise and effort.

    Returns
    -------
    PlantMatrices
        With n_y more disturbances and n_u more performance signals.
    """
    return _restrained(plant, size, np.eye(plant.B2.shape[2]), np.eye(plant.C2.shape[1]))


def stirred(plant: PlantMatrices, size: float, *, by_controls: bool) -> PlantMatrices:
    """The plant with a disturbance more that enters where the controls do, or a performance signal of what is measured.

    Where disturbances reach only a part of what the controls move, and the measurements show them exactly, the filter's
    Riccati equation has the solution zero: Y = γY∞⁻¹ is not bounded, and no solver ends. What bounds the gain of this
    plant bounds that of the plant itself.

    Parameters
    ----------
    plant : PlantMatrices
    size : float
        Of the disturbance, or the signal, as a share of the plant's own.
    by_controls : bool

    Returns
    -------
    PlantMatrices
    """
    own, like = (plant.B1, plant.B2) if by_controls else (plant.C1, plant.C2)
    largest = float(np.abs(like).max(initial=0.0))
    more = size * float(np.abs(own).max(initial=0.0)) / max(largest, 1e-300) * like
    axis = 2 if by_controls else 1
    through, beside = plant.D11, plant.D21 if by_controls else plant.D12
    zeros = [np.zeros_like(m.take(range(1), axis=axis)).repeat(more.shape[axis], axis=axis) for m in (through, beside)]
    through, beside = (np.concatenate([m, z], axis=axis) for m, z in zip((through, beside), zeros, strict=True))
    wide = np.concatenate([own, more], axis=axis)
    if by_controls:
        return replace(plant, B1=wide, D11=through, D21=beside)
    return replace(plant, C1=wide, D11=through, D12=beside)


def _restrained(plant: PlantMatrices, size: float, effort: np.ndarray, noise: np.ndarray) -> PlantMatrices:
    """Effort of, and noise in, the directions that are given as rows."""
    def wide(m: np.ndarray, more: np.ndarray, axis: int) -> np.ndarray:
        shape = [*m.shape]
        shape[axis] = more.shape[axis - 1]
        return np.concatenate([m, np.broadcast_to(more, shape)], axis=axis)

    through = wide(wide(plant.D11, np.zeros((1, len(noise))), 2), np.zeros((len(effort), 1)), 1)
    return replace(plant, B1=wide(plant.B1, np.zeros((1, len(noise))), 2),
                   C1=wide(plant.C1, np.zeros((len(effort), 1)), 1), D11=through,
                   D12=wide(plant.D12, size * effort, 1), D21=wide(plant.D21, size * noise.T, 2))


def _unlimited(plant: PlantMatrices) -> tuple[np.ndarray, np.ndarray]:
    """Directions, as rows, of which D12 (controls) or D21 (measurements) passes almost nothing at some point."""
    return unlimited(plant.D12), unlimited(plant.D21.swapaxes(1, 2))


def unlimited(through: np.ndarray) -> np.ndarray:
    """(·, n) directions, as rows, of which some of the matrices (N, m, n) passes almost nothing.

    Parameters
    ----------
    through : (N, m, n) array
        One matrix for each point.

    Returns
    -------
    (k, n) array
        Orthonormal rows.
    """
    least = min((m.T @ m for m in through), key=lambda g: float(np.linalg.eigvalsh(g).min(initial=np.inf)))
    values, vectors = np.linalg.eigh(least)
    return vectors.T[values < 1e-12]
