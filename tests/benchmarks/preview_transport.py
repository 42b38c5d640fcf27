"""State feedback by matrix inequalities over a register of the road in distance, the speed as scheduling variable.

``python tests/benchmarks/preview_transport.py [--states 8] [--criterion hinf] [--speeds 19,21]``. The register holds
the road between the axles as Legendre coefficients q of a pure transport (Voelker, Eliasmith 2018, Neural Computation
30, 569-609: dq/dt = (v/L)(A_L q + b_L w), the axle meets c_L q), discretised exactly at the loop's rate at nine speeds
and fitted by a cubic of the speed. One Lyapunov matrix holds for every course of the speed; with `--rate` it is affine
in the speed. Printed beside the bound: the least gain with a constant speed (central gains of the game Riccati equation
of the car with its register of delays), without preview, and of the car left at its nominal damping, each with its
frequency; for H2 the norms of the Riccati solution.

Nominal damping and weights follow from the car on a road whose rate is white, E|a|² and E(F_t/m_s)² with the damper at
c v_d alone:

- c_nom minimises the product of the two: in the ride's objective comfort and tyre load count by their relative changes.
- ρ_t = E|a|² / E(F_t/m_s)² at c_nom: half the cost each, as in the objective.
- r = E|a|² / E(c_nom v_d/m_s)²: a demand as large as the nominal force costs as much as the acceleration.
- ρ_z = 0: the objective has no stroke, and acceleration and tyre force show every state.
- τ is the default of the laws, the slowest frozen pole of the embedded damper.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_are
from scipy.optimize import minimize_scalar

import lpvid as lpv
from lpvid.model.signals import Signal
from quartercar.controllers.laws.preview_model import LAG, PreviewModel
from quartercar.parameters import MEGANE
from quartercar.vehicle.linear import LinearCar

PERIOD, WHEELBASE = 1 / 512, 2.7
UNITS = np.array([3e-3, 0.1, 7e-4, 0.15, 100.0])
"""size of the car's states, for the Riccati equation"""


def variances(damping: float) -> tuple[float, float, float]:
    """Of the body's acceleration, the tyre's force over m_s and the damper's over m_s for a white road rate of unit
    intensity, each [m²/s⁴]."""
    parameters = MEGANE.replace(damping=damping)
    linear = LinearCar(parameters).relative()
    spread = solve_continuous_lyapunov(linear.A, -np.outer(linear.B[:, 0], linear.B[:, 0]))
    rows = {name: linear.C[linear.outputs.index(name)] for name in ("body_acceleration", "tyre_force",
                                                                    "suspension_velocity")}
    mass = parameters.sprung_mass
    scaled = rows["body_acceleration"], rows["tyre_force"] / mass, damping * rows["suspension_velocity"] / mass
    a, tyre, force = (float(row @ spread @ row) for row in scaled)
    return a, tyre, force


def nominal() -> float:
    """c_nom [N·s/m]: the least product of the first two variances."""
    found = minimize_scalar(lambda c: np.log(variances(c)[0] * variances(c)[1]), bounds=(300.0, 5000.0),
                            method="bounded")
    return float(found.x)


DAMPING = nominal()
EFFORT = variances(DAMPING)[0] / variances(DAMPING)[2]
TYRE = variances(DAMPING)[0] / variances(DAMPING)[1]


def car() -> tuple[np.ndarray, ...]:
    """A, B, E, C, D of the car about its nominal damping; the body's acceleration without W_k."""
    parameters = MEGANE.replace(damping=DAMPING)
    m = PreviewModel.of(parameters, TYRE, 0.0, LAG.default, PERIOD)
    linear = LinearCar(parameters).relative()
    row = linear.outputs.index("body_acceleration")
    c = np.vstack([np.append(linear.C[row], linear.D[row, 1]), m.shown[1:, :5], np.zeros(5)])
    return m.step[:5, :5], m.control[:5], m.road[:5], c, np.array([0, 0, 0, np.sqrt(EFFORT) / MEGANE.sprung_mass])


def transport(states: int, delay: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Discrete A, b and c of the register for a delay [s], in orthonormal coordinates."""
    i = np.arange(states)
    sign = np.where(i[:, None] < i, -1.0, (-1.0) ** (i[:, None] - i + 1))
    root = np.sqrt(2 * i + 1.0)
    flow = np.block([[sign * np.outer(root, root), ((-1.0) ** i * root)[:, None]], [np.zeros((1, states + 1))]])
    held = expm(flow * PERIOD / delay)
    return held[:-1, :-1], held[:-1, -1], root


def plant(states: int, speeds: tuple[float, float], rate: float | None) -> lpv.GeneralizedPlant:
    """Car and register over the speed, all states measured."""
    a, b, e, c, d = car()
    n, size = len(a), len(a) + states
    box = lpv.Scheduling(("speed",), speeds[:1], speeds[1:], rate=(rate,), units=("m/s",))
    basis, grid = lpv.Polynomial(("speed",), 3), np.linspace(*speeds, 9)
    weights = np.linalg.pinv(basis.bound(box).evaluate(grid[:, None]))
    held = [transport(states, WHEELBASE / v) for v in grid]
    fitted = [np.tensordot(weights, np.array(m), axes=1) for m in list(zip(*held, strict=True))[:2]]
    step, into = np.zeros((4, size, size)), np.zeros((4, size, 2))
    step[:, n:, n:], into[:, n:, 0] = fitted
    step[0, :n, :n], step[0, :n, n:], into[0, :n, 1] = a, np.outer(e, held[0][2]), b
    out, through = np.zeros((4, 4 + size, size)), np.zeros((4, 4 + size, 2))
    out[0, :4, :n], out[0, 4:], through[0, :4, 1] = c, np.eye(size), d
    names = [f"x{k}" for k in range(size)]
    outputs = tuple(map(Signal, ("comfort", "tyre", "stroke", "effort", *names)))
    system = lpv.LPVStateSpace(step, into, out, through, basis, PERIOD, box,
                               inputs=(Signal("road_rate"), Signal("force")), outputs=outputs)
    return lpv.GeneralizedPlant(system, ("force",), tuple(names))


def peak(step: np.ndarray, into: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    """Largest gain over frequency, and where [Hz]."""
    grid = np.geomspace(0.2, 0.5 / PERIOD, 3000)
    gains = [np.linalg.norm(rows @ np.linalg.solve(np.exp(2j * np.pi * f * PERIOD) * np.eye(len(step)) - step, into))
             for f in grid]
    return float(max(gains)), float(grid[int(np.argmax(gains))])


def at_level(samples: int, gamma: float) -> tuple[float, float]:
    """Largest gain of the loop with the central gains for γ and a register of delays, and where [Hz]; inf for none.

    The existence of a solution near the least γ is a matter of rounding; the loop's own gain is none.
    """
    a, b, e, c, d = car()
    n, unit = len(a), np.append(UNITS, np.ones(samples))
    step, rows = np.zeros((n + samples, n + samples)), np.hstack([c, np.zeros((4, samples))]) * unit
    step[:n, :n] = a
    into = np.zeros((n + samples, 2))
    into[:n, 0] = b
    if samples:
        step[:n, n], step[n:-1, n + 1:], into[-1, 1] = e, np.eye(samples - 1), 1.0
    else:
        into[:n, 1] = e
    step, into = step * unit / unit[:, None], into / unit[:, None]
    try:
        p = solve_discrete_are(step, into, rows.T @ rows, np.diag(np.array([d @ d, -gamma**2])))
    except (np.linalg.LinAlgError, ValueError):
        return np.inf, 0.0
    road = p @ into[:, 1]
    if into[:, 1] @ road >= gamma**2:
        return np.inf, 0.0
    p = p + np.outer(road, road) / (gamma**2 - into[:, 1] @ road)
    gain = into[:, 0] @ p @ step / (d @ d + into[:, 0] @ p @ into[:, 0])
    loop = step - np.outer(into[:, 0], gain)
    return peak(loop, into[:, 1], rows - np.outer(d, gain)) if np.abs(np.linalg.eigvals(loop)).max() < 1 else (
        np.inf, 0.0)


def least(samples: int) -> tuple[float, float]:
    """The least gain that the central gains of any γ reach, and at which frequency [Hz]."""
    return min(at_level(samples, g) for g in np.geomspace(9.0, 16.0, 40))


def norms() -> tuple[float, float, float]:
    """H2 norms: without preview, with 69 samples at 20 m/s, and of the car left at its nominal damping."""
    a, b, e, c, d = car()
    p = solve_discrete_are(a, b[:, None], c.T @ c, np.array([[d @ d]]))
    weight = d @ d + b @ p @ b
    loop, row, won = a - np.outer(b, b @ p @ a / weight), p @ e, 0.0
    for _ in range(69):
        won, row = won + (b @ row) ** 2 / weight, loop.T @ row
    x, total = e, 0.0
    for _ in range(8192):
        total, x = total + np.sum((c @ x) ** 2), a @ x
    return float(np.sqrt(e @ p @ e)), float(np.sqrt(e @ p @ e - won)), float(np.sqrt(total))


def main() -> None:
    """One design and its yardsticks."""
    print(f"c_nom {DAMPING:.0f} N*s/m, tyre weight {TYRE:.3f}, effort weight {EFFORT:.2f}, lag {LAG.default:g} s")
    parser = argparse.ArgumentParser(description="LPV state feedback over a transport register.")
    parser.add_argument("--states", type=int, default=8)
    parser.add_argument("--criterion", choices=("hinf", "h2"), default="hinf")
    parser.add_argument("--speeds", default="19,21")
    parser.add_argument("--rate", type=float, default=None)
    given = parser.parse_args()
    low, high = (float(v) for v in given.speeds.split(","))
    started = time.process_time()
    moving = None if given.rate is None else lpv.Polynomial(("speed",), 1)
    criterion = lpv.HInfinity() if given.criterion == "hinf" else lpv.H2()
    found = lpv.synthesize(plant(given.states, (low, high), given.rate), lpv.StateFeedback(
        (criterion,), lyapunov=moving, gain=lpv.Polynomial(("speed",), 2), points=3))
    bound = found.gamma_verified if given.criterion == "hinf" else found.h2_verified
    print(f"{given.criterion}, {given.states} states of the register, {low:g} to {high:g} m/s: {found.verdict}, bound "
          f"{bound}, {time.process_time() - started:.0f} s", flush=True)
    if given.criterion == "h2":
        print("H2 norms without preview {:.3f}, with 69 samples {:.3f}, left alone {:.3f}".format(*norms()))
        return
    a, _, e, c, _ = car()
    for label, (gain, where) in (("without preview", least(0)), ("69 samples, constant speed", least(69)),
                                 ("left alone", peak(a, e, c))):
        print(f"{label}: {gain:.2f} at {where:.1f} Hz")


if __name__ == "__main__":
    main()
