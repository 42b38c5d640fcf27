"""Models whose passivity is known by other means than the code under test."""

from __future__ import annotations

import numpy as np

from lpvid.model.input_stage import TanhStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling

STEP = 1 / 500
BOX = Scheduling(("current",), (0.0,), (2.0,), units=("A",))
BASIS = Polynomial("current", degree=1)
NAMES = {"inputs": (Signal("velocity", "m/s"),), "outputs": (Signal("force", "N"),)}


def maxwell(stiffness: float = 1e5, damping: float = 800.0, parallel: float = 50.0) -> LPVTransferFunction:
    """Spring and damper in series beside a damper, by the trapezoidal rule, which keeps positive realness.

    F' = k(v − F/c) becomes (1 + h) F(k) − (1 − h) F(k−1) = ½ kT (v(k) + v(k−1)), h = kT/2c. Alone it is lossless at
    half the sampling rate; the parallel damper gives it room there.
    """
    h = stiffness * STEP / (2 * damping)
    pole, gain = (1 - h) / (1 + h), 0.5 * stiffness * STEP / (1 + h)
    b = [[gain + parallel], [gain - parallel * pole]]
    return LPVTransferFunction.siso([[-pole]], b, Polynomial(), STEP, **NAMES)


def late(delay: int = 2, damping: float = 500.0, own: float = 0.0) -> LPVTransferFunction:
    """own·v(k) + damping·v(k − delay): gives energy where own + damping·cos(ωT·delay) < 0."""
    rows = [[0.0] for _ in range(delay + 1)]
    rows[0][0] += own
    rows[delay][0] += damping
    return LPVTransferFunction.siso([], rows, Polynomial(), STEP, **NAMES)


def yielding(lag: float = 0.0, slope: float = 0.01) -> LPVTransferFunction:
    """(400 + 200 i) v + 300 i tanh(v/v₀(i)), behind a pole `lag`; static and passive for lag 0."""
    b = np.zeros((1, 1, 2, 2))
    b[0, 0, 0], b[0, 0, 1] = (400.0 * (1 - lag), 200.0 * (1 - lag)), (0.0, 300.0 * (1 - lag))
    a = np.zeros((1, 1, 1, 2)) if lag else np.zeros((0, 1, 1, 2))
    if lag:
        a[0, 0, 0, 0] = -lag
    return LPVTransferFunction(a, b, BASIS, STEP, BOX, input_stage=TanhStage(0.03, slope), **NAMES)


def motion(rng: np.random.Generator, samples: int, speed: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Velocity of mixed bandwidth and a current that jumps within the box."""
    width = int(rng.integers(1, 40))
    v = np.convolve(rng.normal(size=samples), np.ones(width) / np.sqrt(width), "same") * speed
    hold = int(rng.integers(1, 50))
    i = np.repeat(rng.uniform(0, 2, samples // hold + 1), hold)[:samples]
    return v, i


def record(v: np.ndarray, i: np.ndarray, force: np.ndarray | None = None) -> Record:
    """As measured."""
    return Record({"velocity": v, "current": i, "force": np.zeros_like(v) if force is None else force}, STEP,
                  units={"velocity": "m/s", "current": "A", "force": "N"}, name="run")
