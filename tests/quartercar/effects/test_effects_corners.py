"""A velocity that bends between two samples: what lies in series with the law feels the way that it really went."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.effect_signals import road_like

from lpvid.baselines.signals import Signals
from quartercar.effects import series_march
from quartercar.effects.corners import Corners, corners
from quartercar.effects.series import InSeries
from quartercar.effects.series_march import Elements
from quartercar.rig.damper import Motion
from quartercar.rig.patterns import Triangle

RATE, FINER = 512.0, 32


def triangle(finer: int = 1) -> Signals:
    """Strokes that turn within five samples, on the clock of a record or a finer one."""
    fine = RATE * FINER
    x = Triangle().displacement(round(1.5 * fine), fine, np.random.default_rng(0))
    motion = Motion.along(x, np.ones(x.size), fine)
    step = FINER // finer
    return Signals(step / fine, {"displacement": motion.displacement[::step], "velocity": motion.velocity[::step]},
                   np.zeros(x[::step].size))


def law(s: Signals) -> np.ndarray:
    """(n,) [N]"""
    v = s["velocity"]
    return 2000 * v + 60 * np.tanh(v / 0.01)


def straight(s: Signals) -> Corners:
    """What a velocity is taken to do that has no corners."""
    n = s.n_samples
    return Corners(np.zeros(n), np.full(n, 0.5), np.zeros(n, dtype=bool))


@pytest.mark.parametrize(("elements", "left"), [({"air_stroke": 2e-4, "air_force": 400.0}, 0.05),
                                                ({"compliance": 5e-7}, 0.5)], ids=str)
def test_a_corner_between_samples_is_marched_round_as_on_a_finer_clock(
        elements: dict[str, float], left: float, monkeypatch: pytest.MonkeyPatch) -> None:
    made = InSeries(law, Elements(**elements))
    exact = made(triangle(FINER))[::FINER]
    found = made(triangle())
    monkeypatch.setattr(series_march, "corners", straight)
    cut = made(triangle())
    assert np.sum((cut - exact) ** 2) > 1e-3 * np.sum((law(triangle()) - exact) ** 2)
    assert np.sum((found - exact) ** 2) < left * np.sum((cut - exact) ** 2)


def test_a_displacement_that_lags_or_has_another_gain_bends_no_velocity() -> None:
    """Beyond what the velocity itself has room for, and nowhere on the flanks."""
    s = triangle()
    true, v = corners(s), s["velocity"]
    for x in (np.roll(s["displacement"], 3), 1.2 * s["displacement"], -s["displacement"]):
        found = corners(s.replace(displacement=x))
        bend = np.abs(np.pad(np.diff(v, 2), 1))
        assert np.all(np.abs(found.rise[1:]) <= (bend[1:] + bend[:-1]) / 8 + 1e-15)
        assert np.all(found.rise * true.rise >= 0)
    assert true.sharp.sum() == np.sum(np.abs(true.rise) > 1e-3), "four to a period, less those that hit a sample"
    assert 15 < true.sharp.sum() < 24


def test_noise_of_the_displacement_moves_the_velocity_by_less_than_that_of_its_own_sensor(
        rng: np.random.Generator) -> None:
    s, noise = road_like(1, 4096), 1e-3
    noisy = s.replace(velocity=s["velocity"] + noise * rng.standard_normal(s.n_samples),
                      displacement=s["displacement"] + 1e-4 * rng.standard_normal(s.n_samples))
    assert np.std(corners(noisy).rise - corners(s).rise) < noise


def test_no_displacement_no_corners() -> None:
    s = triangle()
    assert not corners(replace(s, channels={"velocity": s["velocity"]}, cache={}, facts={})).rise.any()
