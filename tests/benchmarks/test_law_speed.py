"""Time of one step of the laws that look ahead. Times are printed; only a generous ceiling is asserted.

Run ``pytest tests/benchmarks/test_law_speed.py -n 0 --benchmark-enable --benchmark-only -s``.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from quartercar.controllers import Predictive, PreviewQuadratic, PreviewStorage
from quartercar.controllers.contract import SIGNALS, Controller, Law, Setting
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper

pytestmark = pytest.mark.seconds

PREVIEW = 69
"""samples of 2.7 m at 20 m/s and 512 Hz"""
SCALE = {"suspension_deflection": 0.01, "suspension_velocity": 0.3, "body_velocity": 0.15, "wheel_velocity": 0.3,
         "tyre_deflection": 0.004, "attained": 300.0}
CEILING = 2e-3
"""of the mean [s], the period of the loop: a step that takes longer cannot run beside a car of this rate at all"""


def rows(cars: int, seed: int = 0) -> list[dict[str, np.ndarray]]:
    """50 samples of signals of a rough ride, unrelated to each other: harder for a warm start than a ride."""
    rng = np.random.default_rng(seed)
    return [{**{n: rng.normal(0, SCALE.get(n, 1.0), cars) for n in SIGNALS}, "current": rng.uniform(0, 2.5, cars),
             "road_ahead": np.cumsum(rng.normal(0, 1e-3, (cars, PREVIEW)), axis=1)} for _ in range(50)]


def step_of(law: Controller, cars: int) -> tuple[Law, Callable[[], None]]:
    running = law.start(Setting(1 / 512, cars, MEGANE, identified_damper(), preview=PREVIEW))
    seen, place = rows(cars), [0]

    def step() -> None:
        running.step(seen[place[0] % len(seen)])
        place[0] += 1

    return running, step


@pytest.mark.parametrize("cars", [1, 20])
@pytest.mark.parametrize("law", [Predictive(), Predictive(rounds=2), PreviewQuadratic(), PreviewStorage()], ids=repr)
def test_step(law: Controller, cars: int, benchmark) -> None:
    _, step = step_of(law, cars)
    step()
    start = time.process_time()
    for _ in range(200):
        step()
    mean = (time.process_time() - start) / 200 / cars
    rounds = f", {law.rounds} iterations" if isinstance(law, Predictive) else ""
    print(f"\n{law.name}{rounds}, {cars} car{'s' if cars > 1 else ''}: {1e6 * mean:.0f} us of processor time per car "
          "and step")
    assert mean < CEILING
    benchmark(step)
