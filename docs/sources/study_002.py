"""The device behind the page of source 002 (DLR, Modelica 2014), foreign to both of its models, and the fits.

An asymmetric law behind a spring, dry friction of Dahl's form, a gas spring, and a valve whose eight time constants and
delays are all different and none at a default::

    F = F_law(ẏ, u_f) + F_Dahl(ẋ) + k_g x + F_0,     F_law = k (x − y)
    F_law = r [A(u_f) (1 − exp(−|ẏ|/w)) + B(u_f) |ẏ|^1.4] sign ẏ,     r = 2.3 in rebound, A = 40 + 1100 u_f^1.5
    T u̇_f + u_f = u(t − τ),   (T, τ) by sign of ẋ and of u(t − τ) − u_f

All channels, the command among them, pass the same FIR low-pass (the source pre-filters too; its order is lost).

Expected before the first run: (a) J is below the source's 0.09 to 0.12: our device has less that no model can follow;
(b) the extended Bouc-Wen model is better than the Force Map at both duties, as its spring and hysteresis are closer
to ours; (c) the eight T and τ come back within 5 ms, the direction and the edge in the right order; (d) a Runge-Kutta
step of 1 ms is unstable for the Bouc-Wen model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numba
import numpy as np

import lpvid as lpv
from quartercar.dampers import ExtendedBoucWen, ForceMap, identify_stepwise
from quartercar.dampers.bench.semi_active_study import measured, paper_plan
from quartercar.dampers.fitting.stepwise import Stepwise

NODES = (0.1, 0.2, 0.3, 0.4, 0.5)
KNOTS = (-0.16, -0.12, -0.08, -0.04, -0.015, -0.004, 0.0, 0.004, 0.015, 0.04, 0.08, 0.12, 0.16)
"""m/s, of the Force Map"""
TRUE_LAG = {
    ("compression", "rise"): (0.013, 0.009),
    ("compression", "fall"): (0.022, 0.014),
    ("rebound", "rise"): (0.007, 0.006),
    ("rebound", "fall"): (0.017, 0.011),
}
"""s: T and τ"""
NAMES = ("displacement", "velocity", "current", "force")
TAPS, CUTOFF, RATE = 33, 120.0, 1000.0
"""of the FIR pre-filter [1], [Hz], and the sampling of the source [Hz]"""
PLACES, EDGES = ("compression", "rebound"), ("rise", "fall")
FINE = 8
"""steps of the device in a sample"""


@dataclass(frozen=True)
class Foreign:
    """The virtual device; `simulate` takes a record with displacement, velocity and duty ("current")."""

    stiffness: float = 8e5
    rebound: float = 2.3
    knee: float = 0.012
    power: float = 1.4
    friction: float = 28.0
    presliding: float = 6e5
    gas_stiffness: float = 1300.0
    gas_preload: float = -190.0

    def simulate(self, record: lpv.Record) -> SimpleNamespace:
        """(n, 1) force [N], as `measured` of the study asks for it."""
        lag = np.array([TRUE_LAG[place, edge] for place in PLACES for edge in EDGES])
        shape = np.array([self.rebound, self.knee, self.power])
        springs = np.array([self.stiffness, self.presliding, self.friction])
        v = np.ascontiguousarray(record["velocity"])
        force = run_device(v, np.ascontiguousarray(record["current"], dtype=float), shape, springs, lag, 1 / RATE, FINE)
        return SimpleNamespace(output=(force + self.gas_stiffness * record["displacement"] + self.gas_preload)[:, None])


@numba.njit(cache=False)
def law(speed: float, duty: float, shape: np.ndarray) -> float:
    """F_law at an inner speed [N]; `shape` has r, w [m/s] and the power."""
    size = abs(speed)
    force = (40 + 1100 * duty**1.5) * (1 - np.exp(-size / shape[1])) + (300 + 1500 * duty) * size ** shape[2]
    return force * shape[0] if speed > 0 else -force


@numba.njit(cache=False)
def inner_speed(force: float, duty: float, shape: np.ndarray) -> float:
    """Inverse of the law, which rises: bisection on the side of the force's sign."""
    sign = 1.0 if force > 0 else -1.0
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if abs(law(sign * middle, duty, shape)) < abs(force):
            low = middle
        else:
            high = middle
    return sign * low


@numba.njit(cache=False)
def run_device(v, command, shape, springs, lag, sample_time, fine):
    """(n,) force of law, spring and Dahl friction: exponential steps, exact for a law that is linear within a step."""
    n, h = v.size, sample_time / fine
    out = np.empty(n)
    state, force, dahl = command[0], 0.0, 0.0
    for k in range(n):
        for j in range(fine):
            place = 2 if v[k] > 0 else 0
            for edge in range(2):
                back = (k * fine + j - round(lag[place + edge, 1] / h)) // fine
                wanted = command[max(back, 0)]
                if (wanted > state and edge == 0) or (wanted < state and edge == 1):
                    state += (1 - np.exp(-h / lag[place + edge, 0])) * (wanted - state)
                    break
            speed = inner_speed(force, state, shape)
            rise = max((law(speed + 1e-6, state, shape) - law(speed - 1e-6, state, shape)) / 2e-6, 1.0)
            force += (v[k] - speed) * rise * -np.expm1(-springs[0] / rise * h)
            dahl += h * springs[1] * (v[k] - abs(v[k]) * dahl / springs[2])
        out[k] = force + dahl
    return out


def filtered(record: lpv.Record) -> lpv.Record:
    """Every channel through the same linear-phase FIR; the settling stretch is cut off."""
    from scipy.signal import firwin, lfilter

    taps = firwin(TAPS, CUTOFF, fs=RATE)
    channels = {name: lfilter(taps, 1.0, record[name])[TAPS:] for name in NAMES}
    return lpv.Record(
        channels,
        sample_time=1 / RATE,
        units={n: record.unit(n) for n in NAMES},
        name=record.name,
        notes=("synthetic: a semi-active damper foreign to both models",),
    )


def records(device: Foreign, rng: np.random.Generator) -> tuple[list[lpv.Record], dict[str, lpv.Record]]:
    """The source's test plan for training; other amplitudes, speeds and steps held out."""
    training = [filtered(r) for r in paper_plan(device, NODES, rng)]  # type: ignore[arg-type]
    steps = np.where(np.arange(4000) % 370 < 160, 0.45, 0.12)
    held_out = {
        f"u = {u:.0%}": measured(device, f"held-out {u:.0%}", u, "sine", 0.015, 0.11, 2.0, rng)  # type: ignore[arg-type]
        for u in (0.1, 0.5)
    }
    held_out["steps"] = measured(device, "held-out steps", steps, "saw", 0.025, 0.13, 4.0, rng)  # type: ignore[arg-type]
    return training, {name: filtered(r) for name, r in held_out.items()}


def fit_models(training: Sequence[lpv.Record]) -> dict[str, Stepwise]:
    """Both models, step by step as the source: gas, rows, lag."""
    return {
        "extended Bouc-Wen": identify_stepwise(ExtendedBoucWen(nodes=NODES, current_unit="1"), training),
        "Force Map": identify_stepwise(ForceMap(nodes=NODES, knots=KNOTS, current_unit="1"), training),
    }


def lag_values(found: Stepwise) -> Mapping[tuple[str, str], tuple[float, float]]:
    """T and τ as identified [s]."""
    values = found.damper.values
    return {
        (place, edge): (values[f"{edge}_time_{place}"], values[f"{edge}_delay_{place}"]) for place, edge in TRUE_LAG
    }
