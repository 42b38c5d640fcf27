"""Kwok's law: its formula, the smoothed sign, current dependence, starts."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.simulation import simulate
from quartercar.dampers import Drive, Facts
from quartercar.dampers.laws.kwok import Kwok

VALUES = {"viscous_damping": 1200.0, "stiffness": 5000.0, "hysteresis_force": 300.0, "hysteresis_shift": 0.6,
          "offset": 50.0, "sharpness": 100.0}


def test_force_is_the_printed_one_away_from_mid_stroke() -> None:
    x, v = np.array([-0.01, -0.004, 0.004, 0.01]), np.array([-0.02, 0.005, -0.004, 0.03])
    printed = 1200 * v + 5000 * x + 300 * np.tanh(100 * v + 0.6 * np.sign(x)) + 50
    np.testing.assert_allclose(Kwok(values=VALUES).force(x, v), printed, rtol=1e-6, atol=1e-4)


def test_smoothed_sign_does_not_jump_at_mid_stroke() -> None:
    x = np.linspace(-2e-3, 2e-3, 4001)
    for stroke, largest in ((5e-4, 1.0), (5e-5, 10.0)):
        forces = Kwok(values=VALUES, turning_stroke=stroke).force(x, 0.0)
        assert np.abs(np.diff(forces)).max() < largest
        assert forces[-1] - forces[0] == pytest.approx(2 * (300 * np.tanh(0.6) + 5000 * 2e-3), rel=1e-3)


def test_coefficients_are_affine_in_the_current() -> None:
    law = Kwok(degree=1, span=(0.5, 2.0))
    x, v = np.full(3, 0.01), np.array([-0.1, 0.0, 0.1])
    low, high = law.values, law.values
    for i in (0.5, 1.1, 2.0):
        share = (i - 0.5) / 1.5
        c, k, a, d, f = ((1 - share) * low[f"{n}_at_low"] + share * high[f"{n}_at_high"] for n in
                         ("viscous_damping", "stiffness", "hysteresis_force", "hysteresis_shift", "offset"))
        expected = c * v + k * x + a * np.tanh(law.values["sharpness"] * v + d) + f
        np.testing.assert_allclose(law.force(x, v, i), expected, rtol=1e-9)


@pytest.mark.parametrize("law", [Kwok(), Kwok(degree=1, span=(0.0, 2.0))])
def test_gradient_is_that_of_the_law(law: Kwok, rng: np.random.Generator) -> None:
    x, v, i = rng.normal(scale=0.01, size=80), rng.normal(scale=0.05, size=80), rng.uniform(0, 2, 80)
    exact = law.law_gradient(x, v, i, law.vector)
    for j in range(law.vector.size):
        step = np.zeros(law.vector.size)
        step[j] = 1e-5 * max(abs(law.vector[j]), 1.0)
        moved = (law.law(x, v, i, law.vector + step) - law.law(x, v, i, law.vector - step)) / (2 * step[j])
        np.testing.assert_allclose(exact[:, j], moved, rtol=1e-4, atol=2e-6 * np.abs(exact[:, j]).max())


def test_loop_encloses_the_same_velocity_offset_at_every_amplitude() -> None:
    # equations.md 9.2: δ does not know the amplitude; the hysteresis is zero at v = -δ/β on the side x > 0
    law = Kwok(values={**VALUES, "stiffness": 0.0, "offset": 0.0, "viscous_damping": 0.0})
    for amplitude in (0.005, 0.02):
        loop = law.cycle(amplitude, 2.0)
        far = (loop.displacement > 0.5 * amplitude) & (loop.velocity < 0)
        zero = np.interp(0.0, loop.force[far][::-1], loop.velocity[far][::-1])
        assert zero == pytest.approx(-0.6 / 100, rel=1e-3)


def test_starts_come_near_the_truth(rng: np.random.Generator) -> None:
    t = np.arange(3000) / 300
    x = 0.01 * np.sin(9 * t) + 0.004 * np.sin(41 * t)
    law = Kwok(degree=1, span=(0.0, 2.0))
    drive = Drive(1 / 300, np.gradient(x, 1 / 300), x, 1 + 0.8 * np.sin(3 * t))
    force = law.response(drive, law.vector)
    seen = Drive(drive.sample_time, drive.velocity, x, drive.current, force + rng.normal(scale=5, size=t.size))
    assert np.std(law.response(drive, law.starts([seen], 4, rng)[0]) - force) < 0.15 * force.std()


def test_it_needs_the_displacement_and_follows_the_current() -> None:
    def facts(displacement: bool, varies: bool) -> Facts:
        return Facts(displacement, varies, varies, "A", (0.0, 1.0) if varies else None, (), 0.0, 0.02, 0.5, 500.0,
                     1 / 500, 1000, 1)

    with pytest.raises(InputError, match="displacement"):
        Kwok.suited(facts(False, True))
    assert Kwok.suited(facts(True, True)).degree == 1
    assert Kwok.suited(facts(True, False)).reads == ("velocity", "displacement")
    assert Kwok.suited(facts(True, False)).turning_stroke == pytest.approx(4e-4)


@pytest.mark.parametrize("law", [
    Kwok(values=VALUES), Kwok(degree=1, current_range=(0.0, 2.0), centre=0.002, values={"offset_at_high": -90.0}),
    Kwok(values=VALUES, polarity=-1)])
def test_it_is_quasi_lpv_in_two_secants(law: Kwok) -> None:
    t = np.arange(400) / 200
    record = Record({"displacement": 0.01 * np.sin(9 * t) + 0.004 * np.sin(31 * t), "current": 1.0 + np.sin(2 * t),
                     "velocity": 0.09 * np.cos(9 * t) + 0.124 * np.cos(31 * t)}, sample_time=1 / 200,
                    units={"displacement": "m", "velocity": "m/s", "current": "A"})
    scheduled = law.with_secants(record).with_channel("force", np.zeros(t.size), "N")
    for name in ("saturation", "turning"):
        assert 0 < scheduled[name].min() < scheduled[name].max() <= 1
    run = simulate(law.to_lpv(1 / 200), scheduled)
    np.testing.assert_allclose(run.output[:, 0], law.simulate(record).output[:, 0], rtol=1e-9, atol=1e-8)


def test_bad_settings() -> None:
    with pytest.raises(InputError, match="turning_stroke"):
        Kwok(turning_stroke=0.0)
    with pytest.raises(InputError, match="hysteresis_force"):
        Kwok(values={"hysteresis_force": -1.0})
