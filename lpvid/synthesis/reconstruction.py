"""From the Lyapunov matrices X(p), Y(p) to the controller, in closed form at every point.

Gahinet, Automatica 32 (1996) 1007-1014, extended to matrices that vary. Where controls are free or measurements exact
his equations are singular; fictitious effort and noise make them regular, and the largest that keep the bound give
the controller of least gains: ε² in every direction, and δ² ≥ ε² in those where there is none, which costs far less.
Symbols as in the equations sheet, 5.4 (there R = X, S = Y).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.projected_half import null_space
from lpvid.synthesis.regularised_plants import unlimited
from lpvid.synthesis.scaling import Matrices

SIZES = tuple(10.0 ** np.arange(1.0, -8.01, -0.5))
"""of fictitious noise and effort that are tried, in balanced units"""


@dataclass(frozen=True, eq=False)
class LyapunovPair:
    """X, Y and their derivatives at N points and T corners of the rates.

    Parameters
    ----------
    x, y : (N, n, n) arrays
    x_slope, y_slope : (N, T, n, n) arrays
    by_measurements : bool
        I − YX = N Mᵀ with M = −X, N = Y − X⁻¹: the controller does not depend on ṗ if X is constant. Otherwise
        N = −Y, M = X − Y⁻¹, for a constant Y.
    """

    x: np.ndarray
    y: np.ndarray
    x_slope: np.ndarray
    y_slope: np.ndarray
    by_measurements: bool = True

    def blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, n, n) P of the closed loop in two parts: of x and x + x_K, or of x − x_K and x_K.

        Returns
        -------
        ((N, n, n) array, (N, n, n) array)
            Both positive definite where [X, I; I, Y] ≻ 0.
        """
        if self.by_measurements:
            return np.linalg.inv(self.x), self.y - np.linalg.inv(self.x)
        return self.y, np.linalg.inv(self.x - np.linalg.inv(self.y))

    def block_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """(N, T, n, n) derivatives of `blocks`.

        Returns
        -------
        ((N, T, n, n) array, (N, T, n, n) array)
            Per unit of time of the plant.
        """
        first, second = (m[:, None] for m in self.blocks())
        if self.by_measurements:
            falling = -first @ self.x_slope @ first
            return falling, self.y_slope - falling
        return self.y_slope, -second @ self.x_slope @ second

    def drift(self, x_rate: np.ndarray) -> np.ndarray:
        """N⁻¹ (Y Ẋ + N Ṁᵀ) M⁻ᵀ, the part of A_K that is proportional to ṗ, for Ẋ = `x_rate` (N, n, n).

        Parameters
        ----------
        x_rate : (N, n, n) array
            Derivative of X.

        Returns
        -------
        (N, n, n) array
            Zero where the controller is that of a constant Y.
        """
        if not self.by_measurements:
            return np.zeros_like(self.x)
        p, n = self.blocks()
        return -np.linalg.solve(n, p @ x_rate @ p)


def feedthrough(plant: PlantMatrices, gamma: float) -> np.ndarray:
    """(N, n_u, n_y) the smallest D_K with ‖D11 + D12 D_K D21‖ < γ (Parrott's theorem); zero where none is needed.

    Parameters
    ----------
    plant : PlantMatrices
        At N points.
    gamma : float
        Bound of the gain.

    Returns
    -------
    (N, n_u, n_y) array
        Zero at points where the norm of D11 is below 0.9 γ.
    """
    d = np.zeros((len(plant.A), plant.D12.shape[2], plant.D21.shape[1]))
    for k in range(len(d)):
        if np.linalg.norm(plant.D11[k], 2) < 0.9 * gamma or not d[k].size:
            continue
        u, v = _oriented(plant.D12[k]), _oriented(plant.D21[k].T)
        e = u[0].T @ plant.D11[k] @ v[0]
        r, s = u[1], v[1]
        free, seen = len(e) - r, e.shape[1] - s
        e11, e12, e21, e22 = e[:free, :seen], e[:free, seen:], e[free:, :seen], e[free:, seen:]
        limit = gamma * gamma * np.eye(seen) - e11.T @ e11
        inner = -e22 - e21 @ np.linalg.solve(limit, e11.T @ e12) if free and seen else -e22
        d[k] = np.linalg.pinv(plant.D12[k], 1e-9) @ (u[0][:, free:] @ inner @ v[0][:, seen:].T) @ np.linalg.pinv(
            plant.D21[k], 1e-9)
    return d


def observer_gain(plant: PlantMatrices, y: np.ndarray, gamma: float, noise: np.ndarray) -> np.ndarray:
    """(N, n, n_y) B̂, the gain of the measurements that is best at γ; D_K is already closed in `plant`.

    `noise` (n_y, n_y) is the covariance that is added to D21 D21ᵀ.

    Parameters
    ----------
    plant : PlantMatrices
        At N points.
    y : (N, n, n) array
        Lyapunov matrix Y of the measurements' side, positive definite.
    gamma : float
        Bound of the gain.
    noise : (n_y, n_y) array
        Fictitious covariance.

    Returns
    -------
    (N, n, n_y) array
        Gain B̂ of the measurements, B_K = N⁻¹ B̂.
    """
    right = -np.concatenate([plant.C2, plant.B1.swapaxes(1, 2) @ y, plant.C1], axis=1)
    return _best(plant.D21, plant.D11, gamma, noise, right).swapaxes(1, 2)


def _state_gain(plant: PlantMatrices, p: np.ndarray, gamma: float, effort: np.ndarray) -> np.ndarray:
    """(N, n_u, n) F = Ĉ X⁻¹ for P = X⁻¹, the best gain of the controls if the state were known."""
    t = plant.B1.swapaxes(1, 2) @ p
    right = -np.concatenate([plant.B2.swapaxes(1, 2) @ p, plant.C1, t], axis=1)
    return _best(plant.D12.swapaxes(1, 2), plant.D11.swapaxes(1, 2), gamma, effort, right)


def closed_through(plant: PlantMatrices, d: np.ndarray) -> PlantMatrices:
    """The plant with u = D_K y + u'.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, D22 = 0.
    d : (N, n_u, n_y) array
        Feedthrough D_K of the controller.

    Returns
    -------
    PlantMatrices
        Its controls are u'.
    """
    return PlantMatrices(plant.A + plant.B2 @ d @ plant.C2, plant.B1 + plant.B2 @ d @ plant.D21, plant.B2,
                         plant.C1 + plant.D12 @ d @ plant.C2, plant.D11 + plant.D12 @ d @ plant.D21, plant.D12,
                         plant.C2, plant.D21, plant.D22)


def dual(plant: PlantMatrices) -> PlantMatrices:
    """Controls and measurements exchanged: every matrix transposed.

    Parameters
    ----------
    plant : PlantMatrices
        At N points.

    Returns
    -------
    PlantMatrices
        Its disturbances are the plant's performance signals, and the other way round.
    """
    p = plant
    return PlantMatrices(*(m.swapaxes(1, 2) for m in (p.A, p.C1, p.C2, p.B1, p.D11, p.D21, p.B2, p.D12, p.D22)))


def _half_norm(plant: PlantMatrices, y: np.ndarray, slope: np.ndarray, gain: np.ndarray, gamma: float) -> float:
    """Largest eigenvalue of the observer's own inequality, relative to Y; negative where it holds."""
    root = np.linalg.inv(np.linalg.cholesky(y))
    a, b = plant.A + np.linalg.solve(y, gain @ plant.C2), plant.B1 + np.linalg.solve(y, gain @ plant.D21)
    back = np.linalg.inv(root).swapaxes(1, 2)
    a, b, c = back @ a @ root.swapaxes(1, 2), back @ b, plant.C1 @ root.swapaxes(1, 2)
    drift = root[:, None] @ slope @ root.swapaxes(1, 2)[:, None]
    both = np.concatenate([b, c.swapaxes(1, 2)], axis=2)
    q = _supply(plant.D11, gamma)
    np.linalg.cholesky(q)  # no bound where the direct path alone exceeds it
    matrix = (a + a.swapaxes(1, 2) + both @ np.linalg.solve(q, both.swapaxes(1, 2)))[:, None] + drift
    return float(np.linalg.eigvalsh(0.5 * (matrix + matrix.swapaxes(2, 3)))[..., -1].max())


def with_largest_noise(plant: PlantMatrices, y: np.ndarray, slope: np.ndarray, gamma: float
             ) -> tuple[np.ndarray, np.ndarray] | None:
    """B̂ with the largest fictitious noise that keeps the observer's inequality, and its covariance; None if none does.

    First the same in every direction, then more of it in those that D21 does not reach.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, D_K already closed.
    y : (N, n, n) array
        Lyapunov matrix Y of the measurements' side, positive definite.
    slope : (N, T, n, n) array
        Derivatives of Y at the corners of the rates.
    gamma : float
        Bound of the gain.

    Returns
    -------
    (N, n, n_y) array
        Gain B̂ of the measurements, B_K = N⁻¹ B̂.
    (n_y, n_y) array
        Covariance of the noise; zero where there is room for none.
    """
    eye = np.eye(plant.D21.shape[1])
    found = next(_fitting(plant, y, slope, gamma, ((size**2 * eye) for size in (*SIZES, 0.0))), None)
    unreached = unlimited(plant.D21.swapaxes(1, 2))
    if found is None or not len(unreached):
        return found
    least, more = found[1], unreached.T @ unreached
    noisier = (least + (size**2 - least[0, 0]) * more for size in SIZES if size**2 > least[0, 0])
    return next(_fitting(plant, y, slope, gamma, noisier), found)


def _fitting(plant: PlantMatrices, y: np.ndarray, slope: np.ndarray, gamma: float, sizes: Iterable[np.ndarray]
             ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Those of some covariances with which the observer's inequality holds, with its gain."""
    for noise in sizes:
        try:
            gain = observer_gain(plant, y, gamma, noise)
            if np.all(np.isfinite(gain)) and _half_norm(plant, y, slope, gain, gamma) < 0:
                yield gain, noise
        except np.linalg.LinAlgError:
            continue


def controller_at(plant: PlantMatrices, v: LyapunovPair, gamma: float, efforts: tuple[np.ndarray, np.ndarray],
                  d: np.ndarray) -> Matrices:
    """The controller (N, …) at ṗ = 0, in the coordinates of `LyapunovPair.blocks`.

    With P = X⁻¹, N = Y − P, F the state feedback and W ≻ 0 the slack of its inequality,

        A_K = A + B2 F + B_K C2 + (B1 + B_K D21) w̄ − N⁻¹ (W − FᵀEF / γ),    B_K = N⁻¹ B̂,    C_K = −F,

    where w̄ is the worst disturbance of the state feedback and E the fictitious effort: the same controller as equations
    sheet 5.4 without its differences of large numbers. Where only X moves, the dual plant's controller, transposed.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, D22 = 0.
    v : LyapunovPair
        X and Y there.
    gamma : float
        Bound of the gain.
    efforts : ((n_u, n_u) array, (n_y, n_y) array)
        Fictitious effort and noise.
    d : (N, n_u, n_y) array
        Feedthrough D_K of the controller.

    Returns
    -------
    (A, B, C, D), each (N, …)
        For u = C x_K + D y.
    """
    if not v.by_measurements:
        turned = LyapunovPair(v.y, v.x, v.y_slope, v.x_slope)
        a, b, c, _ = controller_at(dual(plant), turned, gamma, (efforts[1], efforts[0]), d.swapaxes(1, 2))
        return a.swapaxes(1, 2), c.swapaxes(1, 2), b.swapaxes(1, 2), d
    at = closed_through(plant, d)
    p, n = v.blocks()
    f = _state_gain(at, p, gamma, efforts[0])
    b = np.linalg.solve(n, observer_gain(at, v.y, gamma, efforts[1]))
    into = np.concatenate([at.B1.swapaxes(1, 2) @ p, at.C1 + at.D12 @ f], axis=1)
    worst = np.linalg.solve(_supply(at.D11, gamma), into)
    flow = p @ (at.A + at.B2 @ f)
    slack = -(flow + flow.swapaxes(1, 2) + into.swapaxes(1, 2) @ worst)
    a = (at.A + at.B2 @ f + b @ at.C2 + (at.B1 + b @ at.D21) @ worst[:, : at.B1.shape[2]]
         - np.linalg.solve(n, slack - f.swapaxes(1, 2) @ efforts[0] @ f / gamma))
    return a, b, -f, d


def _best(d21: np.ndarray, d: np.ndarray, gamma: float, noise: np.ndarray, right: np.ndarray) -> np.ndarray:
    """First rows of the solution of [E/γ D21 0; D21ᵀ −γ Dᵀ; 0 D −γ] x = right, E = `noise`."""
    count, ny = d21.shape[:2]
    zero = np.zeros((count, ny, d.shape[1]))
    beside = np.concatenate([d21, zero], axis=2)
    left = np.block([[np.broadcast_to(noise / gamma, (count, ny, ny)), beside],
                     [beside.swapaxes(1, 2), -_supply(d, gamma)]])
    return np.linalg.solve(left, right)[:, : d21.shape[1]]


def _supply(d: np.ndarray, gamma: float) -> np.ndarray:
    """[γI −Dᵀ; −D γI], the negative of the sheet's Q."""
    nz, nw = d.shape[1:]
    eye_w, eye_z = (np.broadcast_to(gamma * np.eye(m), (len(d), m, m)) for m in (nw, nz))
    return np.block([[eye_w, -d.swapaxes(1, 2)], [-d, eye_z]])


def _oriented(matrix: np.ndarray) -> tuple[np.ndarray, int]:
    """Orthonormal basis of the rows' space, the directions that `matrix` reaches last, and how many those are."""
    outside = null_space(matrix.T)
    inside = null_space(outside.T) if outside.shape[1] else np.eye(len(matrix))
    return np.hstack([outside, inside]), inside.shape[1]
