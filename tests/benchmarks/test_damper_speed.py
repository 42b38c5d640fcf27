"""Speed of damper models with states against their bare compiled kernels. Times are printed, never asserted.

Run ``pytest tests/benchmarks/test_damper_speed.py -n 0 --benchmark-enable --benchmark-only -s``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.timing import best_of

from quartercar.dampers import Drive
from quartercar.dampers.families import DynamicDamper
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.dampers.laws.wang_kamath import WangKamath

pytestmark = pytest.mark.seconds

SAMPLES = 30 * 512


@pytest.fixture(scope="module")
def drive() -> Drive:
    """30 s at 512 Hz, 0.5 to 12 Hz, about 6 mm and 0.15 m/s."""
    t = np.arange(SAMPLES) / 512
    f, phase = np.linspace(0.5, 12, 20), np.random.default_rng(0).uniform(0, 2 * np.pi, 20)
    angle = 2 * np.pi * np.outer(t, f) + phase
    return Drive(1 / 512, np.cos(angle) @ (0.003 * 2 * np.pi * np.sqrt(f)), np.sin(angle) @ (0.003 / np.sqrt(f)),
                 1.0 + np.sin(t))


def report(model: DynamicDamper, bare: Callable[[], object], drive: Drive, aim: str, timed: bool) -> None:
    rounds = 15 if timed else 1
    ours, kernel = best_of(lambda: model.response(drive, model.vector), rounds), best_of(bare, rounds)
    sensitivities = best_of(lambda: model.jacobian(drive, model.vector), min(rounds, 3))
    print(f"\n{model.title}, {len(model.names)} parameters, 30 s at 512 Hz: {1e3 * ours:.1f} ms{aim}, bare kernel "
          f"{1e3 * kernel:.1f} ms, ratio {ours / kernel:.3f}; all sensitivities {1e3 * sensitivities:.0f} ms")


def test_bouc_wen_of_ten_parameters(drive, benchmark) -> None:
    from quartercar.dampers.laws._bouc_wen_kernels import spencer_run

    model = BoucWen(scheduled=False, free_exponent=True, values={"yield_force": 900.0})
    theta, _ = model.coefficients(model.vector)
    still, state = np.zeros(SAMPLES), np.array([drive.displacement[0], 0.0, 0.0])
    steps = motion_steps(drive)
    report(model, lambda: spencer_run(drive.displacement, drive.velocity, still, 1 / 512, steps, theta, state), drive,
           " (aim 20 ms)", benchmark.enabled)
    assert np.isfinite(benchmark(lambda: model.response(drive, model.vector))).all()


def test_wang_kamath_of_ten_parameters(drive, benchmark) -> None:
    from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_run

    model = WangKamath(degree=1, current_scale=2.0)
    theta = np.ascontiguousarray(model.coefficients(drive.current, model.vector))
    steps = motion_steps(drive)
    report(model, lambda: wang_kamath_run(drive.velocity, 1 / 512, steps, theta, 0.0, 0.0), drive, "",
           benchmark.enabled)
    assert np.isfinite(benchmark(lambda: model.response(drive, model.vector))).all()
