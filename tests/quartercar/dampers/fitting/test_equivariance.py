"""A fit is the same in whatever size: of a toy, of a buffer, in slow motion; values follow from the units alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from lpvid.record import Record
from quartercar.dampers import DAMPERS, Facts, FitSettings, fit
from quartercar.dampers.drive import Drive
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import TYPICAL, Sizes

UNITS = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}
SIMILAR = {"strong": (1024.0, 1.0, 1.0), "weak": (1 / 1024, 1.0, 1.0), "short": (1.0, 1 / 1024, 1.0),
           "long": (1.0, 32.0, 1.0), "quick": (1.0, 1.0, 1 / 8), "slow": (1.0, 1.0, 8.0)}
"""Factors of force, length and time; powers of two, so that nothing is rounded otherwise."""
STATIC = ("linear", "guo", "guo-7", "kwok", "power-law-friction-gas", "network-series", "network-parallel")
QUICK = FitSettings(starts=6, polished=1, evaluations=40, short_evaluations=6, short_samples=400)


def measured(n: int = 600, period: float = 1 / 256) -> Record:
    """A yield force behind a spring, asymmetric losses, gas and noise, at six currents: no law of the list."""
    rng = np.random.default_rng(1)
    t = np.arange(n) * period
    x, v = np.zeros(n), np.zeros(n)
    for amplitude, frequency, phase in ((0.012, 0.7, 1.0), (0.006, 1.9, 4.0), (0.002, 4.1, 2.0)):
        omega = 2 * np.pi * frequency
        x += amplitude * np.sin(omega * t + phase)
        v += amplitude * omega * np.cos(omega * t + phase)
    current = np.repeat([0.2, 0.8, 0.4, 1.0, 0.0, 0.6], n // 6)
    limit, held, spring = 150 + 500 * current, np.zeros(n), 0.0
    for k in range(1, n):
        spring = float(np.clip(spring + 4e5 * (x[k] - x[k - 1]), -limit[k], limit[k]))
        held[k] = spring
    force = held + np.where(v > 0, 900 * v + 1500 * v**2, 600 * v) + 800 * x - 60 + 5 * rng.normal(size=n)
    return record(x, v, current, force, period)


def record(x: np.ndarray, v: np.ndarray, current: np.ndarray, force: np.ndarray, period: float) -> Record:
    channels = {"displacement": x, "velocity": v, "current": current, "force": force}
    return Record(channels, sample_time=period, units=UNITS, roles={name: name for name in channels})


def resized(of: Record, force: float, length: float, time: float) -> Record:
    assert of.sample_time is not None
    return record(length * of["displacement"], length / time * of["velocity"], of["current"], force * of["force"],
                  time * of.sample_time)


def fitted(name: str, training: Record):
    return fit(DAMPERS.get(name).suited(Facts.of([training])), training, settings=QUICK)  # type: ignore[attr-defined]


@cache
def fitted_as_measured(name: str):
    return fitted(name, measured())


def assert_similar(name: str, how: str, tolerance: float) -> None:
    base, one = measured(), fitted_as_measured(name)
    force, length, time = SIMILAR[how]
    other = fitted(name, resized(base, force, length, time))
    assert one.training.esr is not None
    assert other.training.esr == pytest.approx(one.training.esr, rel=tolerance)
    sizes = replace(TYPICAL, force=TYPICAL.force * force, length=TYPICAL.length * length, time=TYPICAL.time * time)
    run, again = one.damper.simulate(base), other.damper.simulate(resized(base, force, length, time))
    np.testing.assert_allclose(again.output / force, run.output, rtol=0, atol=tolerance * np.ptp(base["force"]))
    for p in one.damper.parameters:
        wanted, got = sizes.factor(p.unit) * one.damper.values[p.name], other.damper.values[p.name]
        if name != "power-law-friction-gas" or not p.name.startswith("exponent"):  # open where its force is zero
            assert got == pytest.approx(wanted, rel=tolerance, abs=1e-6 * sizes.factor(p.unit)), p.name


@pytest.mark.thinned(16, "seconds")
@pytest.mark.parametrize("how", SIMILAR)
@pytest.mark.parametrize("name", STATIC)
def test_a_law_without_memory_in_another_size(name: str, how: str) -> None:
    assert_similar(name, how, 1e-5)


@pytest.mark.thinned(6, "seconds")
@pytest.mark.parametrize("how", ["weak", "short", "quick", "slow"])
@pytest.mark.parametrize("name", ["bouc-wen", "force-map"])
def test_a_law_with_memory_in_another_size(name: str, how: str) -> None:
    assert_similar(name, how, 1e-4)


def test_a_step_of_integration_follows_the_motion_and_not_its_size() -> None:
    r = measured()
    steps = [motion_steps(Drive.of(resized(r, 1.0, length, time), ("velocity", "displacement")))
             for length, time in ((1.0, 1.0), (1 / 1024, 1.0), (32.0, 1.0), (1.0, 8.0))]
    assert steps[0].max() > 2
    for other in steps[1:]:
        np.testing.assert_array_equal(other, steps[0])


def test_a_typical_value_is_carried_over_and_a_bound_of_physics_is_not() -> None:
    sizes = replace(TYPICAL, force=2 * TYPICAL.force, length=4 * TYPICAL.length, sample_time=3 * TYPICAL.sample_time)
    stiff = sizes.sized(Parameter("stiffness", "N/m", "k", 1000.0, 10.0))
    assert (stiff.default, stiff.lower, stiff.upper) == (500.0, 10.0, np.inf)
    slip = sizes.sized(Parameter("slip", "m", "x", 2e-4, 1e-30, log=True, search=(1e-7, 1.0)))
    assert (slip.default, slip.lower, slip.upper) == pytest.approx((8e-4, 4e-7, 4.0))
    rate = sizes.sized(Parameter("rate", "1/s", "eta", 150.0, 1e-30, log=True, search=(1.0, 1e5)))
    assert (rate.default, rate.lower, rate.upper) == pytest.approx((50.0, 1.0, 1e5 / 3))


def test_sizes_of_nothing_are_the_typical_ones() -> None:
    still = Drive(0.01, np.zeros(50), np.zeros(50), np.zeros(50), np.zeros(50))
    assert Sizes.of([still]) == replace(TYPICAL, sample_time=0.01, duration=0.5)
