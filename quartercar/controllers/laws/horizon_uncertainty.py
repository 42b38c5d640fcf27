"""What is not known of state and road over a horizon, and what the damper's current makes it cost.

The cost of a horizon is quadratic in the car's motion. With the motion the expected one and a deviation δ from it that
is unknown, its mean is the cost of the expected motion and that of δ. The first is what
`quartercar.controllers.laws.horizon` predicts. The second depends on the current too, by the damping that δ meets::

    δ(k+1) = A(c) δ(k) + b w(k)      δ = (z_d, ż_s, z_t, ż_us, states of W_k), w the road's velocity, white
    D(k)   = E[δ(k) δ(k)ᵀ]           D(0) of the observer; c the dashpot of the lowest current, met by v_d of D(k)
    E(k, i) = tr[(C(c)ᵀ W C(c) + A(c)ᵀ P A(c)) D(k)]    c the dashpot of current i, P what follows then

E(k, i) is exact for a change of the current at one sample, and added over the samples to first order. Without it the
sequence relies on a course of the deflection's velocity that the next samples do not confirm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from quartercar.parameters import CarParameters
from quartercar.vehicle.integrator import LinearPart

DEVIATIONS = np.geomspace(5e-3, 2.0, 25)
"""standard deviations of the deflection's velocity at which dampings are tabulated [m/s]: from what a sensor leaves to
what bump stops end; linear in the logarithm between them"""
NODES = 40
"""of the quadrature over the normal distribution: a law with a knee at a twentieth of the deviation within 3 %"""
BETWEEN = 48
"""dampings at which a dashpot's cost is computed, linear in between"""
VELOCITY = np.array([0.0, 1.0, 0.0, -1.0])
"""v_d of z_d, ż_s, z_t, ż_us"""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Of the state now, and of the road to come.

    Attributes
    ----------
    estimate : (4, 4) array
        Covariance of the error of z_d, ż_s, z_t, ż_us.
    road : (N,) array
        Two-sided spectrum of what is not known of the road's velocity over each coming sample [m²/s].
    """

    estimate: np.ndarray
    road: np.ndarray


def dashpot(p: CarParameters, damping: float, sample_time: float, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and C of a car with a dashpot on a level road, behind the weighting filter.

    Parameters
    ----------
    p : CarParameters
        Its damping is left out.
    damping : float
        [N·s/m].
    sample_time : float
        [s].
    shape : (nf + 1, nf + 1) array
        Filter (A, B; C, D) of the acceleration.

    Returns
    -------
    step : (4 + nf, 4 + nf) array
        State z_d, ż_s, z_t, ż_us and that of the filter, a sample on.
    out : (3, 4 + nf) array
        Weighted acceleration, tyre force and deflection a sample on.
    """
    nf = len(shape) - 1
    part = LinearPart(p.sprung_mass, p.unsprung_mass, 0.0, p.spring_stiffness, damping, p.tyre_stiffness,
                      p.tyre_damping)
    to = np.array([[1.0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # on a level of zero
    a = to @ expm(part.matrices()[0] * sample_time) @ np.linalg.inv(to)
    k, c, m = p.spring_stiffness, damping, p.sprung_mass
    rows = np.array([[-k / m, -c / m, 0, c / m], [0, 0, p.tyre_stiffness, p.tyre_damping], [1.0, 0, 0, 0]]) @ a
    step, out = np.zeros((4 + nf, 4 + nf)), np.zeros((3, 4 + nf))
    step[:4, :4], step[4:, 4:], step[4:, :4] = a, shape[:nf, :nf], np.outer(shape[:nf, nf], rows[0])
    out[0, :4], out[0, 4:] = shape[nf, nf] * rows[0], shape[nf, :nf]
    out[1:, :4] = rows[1:]
    return step, out


def sum_of_powers(step: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Σ_{k≥0} (Aᵀ)ᵏ Q Aᵏ by doubling (Smith 1968, SIAM J. Appl. Math. 16, 198-201); 2⁴⁰ terms.

    Parameters
    ----------
    step : (n, n) array
        A, stable.
    cost : (n, n) array
        Q, symmetric.

    Returns
    -------
    (n, n) array
        Symmetric.
    """
    total, power = cost, step
    for _ in range(40):
        total, power = total + power.T @ total @ power, power @ power
    return 0.5 * (total + total.T)


def linearised(force: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Damping that a normal velocity meets, E[F v]/E[v²] at each of `DEVIATIONS` (statistical linearisation).

    Parameters
    ----------
    force : callable
        (·,) forces [N] at (·,) velocities [m/s].

    Returns
    -------
    (S,) array
        [N·s/m].

    Examples
    --------
    >>> bool(np.allclose(linearised(lambda v: 900.0 * v + 50.0), 900.0))
    True
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    found = force(np.outer(DEVIATIONS, nodes).ravel()).reshape(DEVIATIONS.size, NODES)
    return found @ (weights * nodes) / (weights.sum() * DEVIATIONS)


def deviations(unknown: Uncertainty, dampings: np.ndarray, car: Callable[[float], tuple[np.ndarray, np.ndarray]],
               sample_time: float) -> tuple[np.ndarray, np.ndarray]:
    """D(k) at the samples 0 … N − 1, and the damping that it meets there at each current.

    Parameters
    ----------
    unknown : Uncertainty
    dampings : (S, G) array
        By deviation and current, the lowest first [N·s/m].
    car : callable
        `dashpot` of a damping.
    sample_time : float
        [s].

    Returns
    -------
    spread : (N, n, n) array
        Covariances.
    damping : (N, G) array
        [N·s/m].
    """
    now = np.zeros_like(car(float(dampings[0, 0]))[0])
    now[:4, :4] = unknown.estimate
    spread, met = [], []
    for level in unknown.road:
        size = np.sqrt(max(VELOCITY @ now[:4, :4] @ VELOCITY, 0.0))
        place = np.interp(np.log(max(size, DEVIATIONS[0])), np.log(DEVIATIONS), np.arange(DEVIATIONS.size))
        first = min(int(place), DEVIATIONS.size - 2)
        row = dampings[first] + (place - first) * (dampings[first + 1] - dampings[first])
        spread.append(now)
        met.append(row)
        step = car(float(row[0]))[0]
        now = step @ now @ step.T
        now[2, 2] += level * sample_time  # the road rises, and z_t falls by it
    return np.array(spread), np.array(met)


def expected_cost(car: Callable[[float], tuple[np.ndarray, np.ndarray]], damping: np.ndarray, weights: np.ndarray,
                  end: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """E(k, i) of the module.

    Parameters
    ----------
    car : callable
        `dashpot` of a damping.
    damping : (N, G) array
        That D(k) meets at current i [N·s/m].
    weights : (3,) array
        W, of weighted acceleration, tyre force and deflection.
    end : (n, n) array
        P.
    spread : (N, n, n) array
        D(k).

    Returns
    -------
    (N, G) array
        In the unit of the cost.
    """
    known = np.geomspace(damping.min(), damping.max() * (1 + 1e-9), BETWEEN)
    pairs = [car(float(c)) for c in known]
    g = np.array([out.T @ (weights[:, None] * out) + step.T @ end @ step for step, out in pairs])
    each = np.einsum("gij,kij->kg", g, spread)
    return np.array([np.interp(d, known, e) for d, e in zip(damping, each, strict=True)])
