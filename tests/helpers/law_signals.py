"""Signals that a control law reads, at random, and the force that it asks for."""

from __future__ import annotations

import numpy as np

from quartercar.controllers.contract import SIGNALS, Controller, Setting
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper

SETTING = Setting(0.002, 7, MEGANE, identified_damper())
LOW, HIGH = 300.0, 3000.0


def seen(cars: int = 7, seed: int = 0, ahead: int = 0, **given: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    scale = {"suspension_deflection": 0.02, "tyre_deflection": 0.004, "suspension_velocity": 0.3}
    found = {n: rng.normal(0, scale.get(n, 1.0), cars) for n in SIGNALS}
    return found | {"road_ahead": rng.normal(0, 1e-3, (cars, ahead))} | given


def force(law: Controller, s: dict[str, np.ndarray]) -> np.ndarray:
    return law.start(Setting(0.002, len(next(iter(s.values()))), MEGANE)).step(s)
