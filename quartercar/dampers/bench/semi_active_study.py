"""Source 002's study on a virtual device: its test plan, and the explicit step that its paper found unstable."""

from __future__ import annotations

from typing import Any

import numpy as np

from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.laws.extended_bouc_wen import DIRECTIONS, ExtendedBoucWen
from quartercar.dampers.laws.semi_active import SemiActiveDamper

RK4_END = 2.785
"""end of the stability of the classical Runge-Kutta method on the negative real axis, in steps times rate"""
NODES = tuple(float(u) for u in np.linspace(0.1, 0.5, 9))
REBOUND = 2.2
"""rebound over compression forces"""


def virtual_device() -> ExtendedBoucWen:
    """A damper whose forces grow with the square of the duty, on a table finer than that of the models.

    Its hysteresis is too sharp for a Runge-Kutta step of 1 ms; the paper's values are lost, these are chosen.

    Returns
    -------
    ExtendedBoucWen
        Over the nine duties of `NODES`, with gas spring and preload.

    Examples
    --------
    >>> virtual_device().fastest_rate(0.126, current=0.5) * 1e-3 > RK4_END
    True
    """
    values = {"gas_stiffness": 1500.0, "gas_preload": -220.0}
    for d, k in zip(DIRECTIONS, (1.0, REBOUND), strict=True):
        for j, u in enumerate(NODES, 1):
            values |= {f"damping_{d}_{j}": 500 * k * (1 + 8 * u**2), f"yield_force_{d}_{j}": k * (60 + 900 * u**2),
                       f"roll_off_damping_{d}_{j}": 2e4 * (1 + u), f"sharpness_{d}_{j}": 5e3 + 5e4 * u}
    return ExtendedBoucWen(nodes=NODES, current_unit="1", values=values)


def measured(device: SemiActiveDamper, name: str, current: float | np.ndarray, wave: str, amplitude: float,
             speed: float, seconds: float, rng: np.random.Generator | int, noise: float = 10.0) -> Record:
    """A device on the virtual rig, sampled at 1 kHz as in the paper.

    Parameters
    ----------
    device : SemiActiveDamper
    name : str
    current : float or (n,) array
        Duty.
    wave : {"sine", "saw"}
        Saw-tooth strokes have constant velocity.
    amplitude, speed : float
        Half stroke [m], largest speed [m/s].
    seconds : float
    rng : numpy.random.Generator or int
    noise : float
        Standard deviation on the force [N].

    Returns
    -------
    Record
        Displacement [m], velocity [m/s], duty [1] and noisy force [N].
    """
    checks.one_of(wave, ("sine", "saw"), "wave")
    sine = wave == "sine"
    angle = np.arange(round(1000 * seconds)) * 1e-3 * speed / amplitude * (1.0 if sine else np.pi / 2)
    x = np.sin(angle) if sine else 2 / np.pi * np.arcsin(np.sin(angle))
    v = np.cos(angle) if sine else np.sign(np.cos(angle))
    channels: dict[str, Any] = {"displacement": amplitude * x, "velocity": speed * v,
                                "current": np.broadcast_to(np.asarray(current, dtype=float), x.size)}
    bare = Record(channels, sample_time=1e-3, units={"displacement": "m", "velocity": "m/s", "current": "1"}, name=name)
    drawn = checks.generator(rng).normal(0.0, noise, x.size)
    return bare.with_channel("force", device.simulate(bare).output[:, 0] + drawn, "N")


def paper_plan(device: SemiActiveDamper, nodes: tuple[float, ...], rng: np.random.Generator | int) -> list[Record]:
    """The paper's: a slow run at the least duty, 25 mm and 0.8 Hz at each, steps of 15 to 50 % inside strokes.

    Parameters
    ----------
    device : SemiActiveDamper
        What is measured.
    nodes : tuple of float
        Duties of the runs at constant current, rising.
    rng : numpy.random.Generator or int
        Draws the noise of the force.

    Returns
    -------
    list of Record
        ``slow``, one for each node, and ``steps``, at 1 kHz.
    """
    rng = checks.generator(rng)
    steps = np.where(np.arange(8000) % 290 < 140, 0.5, 0.15)
    return [measured(device, "slow", nodes[0], "saw", 0.025, 0.005, 20.0, rng),
            *(measured(device, f"u = {u:.0%}", u, "sine", 0.025, 0.04 * np.pi, 3.75, rng) for u in nodes),
            measured(device, "steps", steps, "saw", 0.025, 0.15, 8.0, rng)]


def fixed_steps(damper: ExtendedBoucWen, record: Record, refinement: int = 20) -> tuple[Record, float, float]:
    """The same motion with the stepper and with Runge-Kutta, against a run with steps so many times finer.

    Parameters
    ----------
    damper : ExtendedBoucWen
        What is stepped.
    record : Record
        Uniform, with displacement, velocity and current.
    refinement : int
        Steps of the reference within one sample.

    Returns
    -------
    tuple
        Record with channels ``reference``, ``stepped`` and ``runge-kutta`` [N], the last NaN from where it diverges;
        ESR of the stepper and of Runge-Kutta against the reference, infinite where it diverges. Commands are constant.
    """
    drive, h = damper.drive(record).slice(0, record.n_samples), record.sample_time
    assert h is not None
    fine = np.arange(refinement * (drive.n_samples - 1) + 1) / refinement
    x, v, u = (np.interp(fine, np.arange(drive.n_samples), s)
               for s in (drive.displacement, drive.velocity, drive.current))
    exact = damper.response(Drive(h / refinement, v, x, u), damper.vector)[::refinement]
    stepper = damper.real_time(h)
    ours = np.array([stepper(float(a), float(b), float(c))
                     for a, b, c in zip(drive.displacement, drive.velocity, drive.current, strict=True)])
    explicit = runge_kutta(damper, record)
    lost = ~(np.abs(explicit) < 100 * np.abs(exact).max())
    explicit[lost] = np.nan
    out = record.with_channel("reference", exact, "N").with_channel("stepped", ours, "N")
    esr = [float(np.sum((f - exact) ** 2) / np.sum((exact - exact.mean()) ** 2)) for f in (ours, explicit)]
    return out.with_channel("runge-kutta", explicit, "N"), esr[0], np.inf if lost.any() else esr[1]


def runge_kutta(damper: ExtendedBoucWen, record: Record) -> np.ndarray:
    """(n,) force by the classical Runge-Kutta method at the record's step, its command taken as settled [N].

    What the paper ran in real time. Not finite, or absurd, from where it diverges.

    Parameters
    ----------
    damper : ExtendedBoucWen
        What is integrated.
    record : Record
        Uniform, with displacement [m], velocity [m/s] and current.

    Returns
    -------
    (n,) array
        With the gas spring; NaN after the step at which the state is no longer finite [N].
    """
    def rates(s: np.ndarray, x: float, v: float, u: float) -> np.ndarray:
        c0, k0, c1, alpha, beta, gamma, delta = damper.mixture(v, u, damper.vector)
        rate = (alpha * s[1] + c0 * v + k0 * (x - s[0])) / (c0 + c1)
        slip, n = v - rate, damper.exponent
        size = abs(s[1]) ** n
        return np.array([rate, delta * slip - (gamma * abs(slip) * np.sign(s[1]) + beta * slip) * size, c1 * rate])

    x, v, u, h = record["displacement"], record["velocity"], record["current"], record.sample_time
    assert h is not None
    s, force = damper.rest(x[0], v[0], u[0], None, damper.vector)[1:], np.full(x.size, np.nan)
    with np.errstate(all="ignore"):
        for k in range(x.size):
            start = rates(s, x[k], v[k], u[k])
            force[k] = start[2] + damper.conservative_force(x[k])
            if k + 1 == x.size or not np.isfinite(s).all():
                break
            half = 0.5 * (x[k] + x[k + 1]), 0.5 * (v[k] + v[k + 1]), u[k]
            k2 = rates(s + h / 2 * start[:2], *half)
            k3 = rates(s + h / 2 * k2[:2], *half)
            k4 = rates(s + h * k3[:2], x[k + 1], v[k + 1], u[k + 1])
            s = s + h / 6 * (start + 2 * k2 + 2 * k3 + k4)[:2]
    return force
