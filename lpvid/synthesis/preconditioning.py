"""States in which the matrices of a design are of one size: those that the Riccati equations of its middle suggest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.synthesis.bilinear import plant_to_continuous, sign_for
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.riccati import start
from lpvid.synthesis.scaling import Units


@dataclass(frozen=True, eq=False)
class Preconditioned:
    """A plant over states x' = `turn`⁻¹x in which X = Y = diag(`sizes`) suits the middle of its box.

    Not `balanced`, it is the plant as it was.

    Parameters
    ----------
    plant : GeneralizedPlant
        Over x'.
    turn : (n, n) array
        T of x = T x'.
    sizes : (n,) array
        Diagonal of X and Y; ones where not balanced.
    balanced : bool
        Whether the states were changed.
    """

    plant: GeneralizedPlant
    turn: np.ndarray
    sizes: np.ndarray
    balanced: bool = True


def preconditioned(plant: GeneralizedPlant, points: np.ndarray) -> Preconditioned:
    """The same signals over states x' = T⁻¹x in which X and Y of the middle point are one diagonal matrix.

    T⁻¹XT⁻ᵀ = TᵀYT (as in balanced truncation), for a pair that keeps twice the least gain there. A controller for one
    plant is a controller for the other. Where the equations have no solution, the plant as it is.

    plant : GeneralizedPlant
        Continuous or discrete.

    Parameters
    ----------
    points : (N, n_scheduling) array
        Over which units are balanced; the one in the middle counts.

    Returns
    -------
    Preconditioned
        The plant over the new states, with the way back.
    """
    at = plant.at(points)
    if plant.sample_time is not None:
        at = plant_to_continuous(at, sign_for(at.A))
    units = Units.of(at)
    balanced = units.apply(at)
    found = start(replace(balanced, D22=np.zeros_like(balanced.D22)))
    if found is None or not plant.order:
        return unconditioned(plant)
    turn, sizes = balancing(found.x, found.y)
    return turned(plant, units.states[:, None] * turn, sizes)


def turned(plant: GeneralizedPlant, turn: np.ndarray, sizes: np.ndarray) -> Preconditioned:
    """The same signals over states x' = `turn`⁻¹x.

    Parameters
    ----------
    plant : GeneralizedPlant
        Kept as it is.
    turn : (n, n) array
        Regular.
    sizes : (n,) array
        Sizes of the new states, kept with the result.

    Returns
    -------
    Preconditioned
        The plant over the new states, with the way back.
    """
    back, system = np.linalg.inv(turn), plant.system
    moved = system.replace(A=back @ system.A @ turn, B=back @ system.B, C=system.C @ turn)
    return Preconditioned(GeneralizedPlant(moved, plant.controls, plant.measurements), turn, sizes)


def unconditioned(plant: GeneralizedPlant) -> Preconditioned:
    """The plant as it is.

    Parameters
    ----------
    plant : GeneralizedPlant
        Kept as it is.

    Returns
    -------
    Preconditioned
        With `turn` the identity, not balanced.
    """
    return Preconditioned(plant, np.eye(plant.order), np.ones(plant.order), False)


def balancing(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T with T⁻¹ X T⁻ᵀ = Tᵀ Y T = Σ, and the diagonal of Σ.

    Parameters
    ----------
    x, y : (n, n) array
        Symmetric and positive definite.

    Returns
    -------
    (n, n) array
        Change of states T.
    (n,) array
        Diagonal of Σ, falling.

    Examples
    --------
    >>> x, y = np.array([[4.0, 1.0], [1.0, 2.0]]), np.array([[3.0, -1.0], [-1.0, 5.0]])
    >>> t, sizes = balancing(x, y)
    >>> np.allclose(np.linalg.inv(t) @ x @ np.linalg.inv(t).T, np.diag(sizes)), np.allclose(t.T @ y @ t, np.diag(sizes))
    (True, True)
    """
    if not len(x):
        return np.zeros((0, 0)), np.zeros(0)
    first, second = np.linalg.cholesky(x), np.linalg.cholesky(y)
    _, sizes, vt = np.linalg.svd(second.T @ first)
    return first @ vt.T / np.sqrt(sizes), sizes
