"""Inverse damper models: the current of a force, in range and beyond it, and through the coil."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.damper_cases import truth

from lpvid.errors import InputError
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.forces import SPEEDS, along
from quartercar.controllers.loop.inverse import Inverse, InverseSettings, nearest
from quartercar.dampers import Guo, Linear, PowerLawFrictionGas
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import Coil

CURRENTS = (0.0, 2.0)
LIMITS = Coil(highest=2.0)


def inverse(damper, cars: int = 1, coil: Coil = LIMITS, period: float = 0.002, **settings) -> Inverse:
    return Inverse(Setting(period, cars, MEGANE, damper, CURRENTS), coil, InverseSettings(**settings))


def affine() -> Guo:
    return Guo(degree=1, span=CURRENTS, current_range=CURRENTS, values={
        "yield_force_at_low": 100.0, "yield_force_at_high": 1500.0, "sharpness": 20.0, "critical_ratio": 2.0,
        "post_yield_damping_at_low": 300.0, "post_yield_damping_at_high": 900.0})


def test_a_demand_that_can_be_had_is_had(rng):
    law, cars = affine(), 200
    z, v = rng.normal(0, 0.02, cars), rng.choice([-1, 1], cars) * rng.uniform(0.02, 1.0, cars)
    wanted = rng.uniform(*CURRENTS, cars)
    asked = law.law(z, v, wanted, law.vector)
    running = inverse(law, cars)
    running.look(z, v)
    got = running.choose(asked)
    alike = np.abs(running.highest - running.lowest) < 5.0
    assert alike.mean() < 0.1
    np.testing.assert_allclose(got[~alike], wanted[~alike], atol=1e-9)  # affine in the current: exact
    np.testing.assert_allclose(law.law(z, v, got, law.vector)[~alike], asked[~alike], atol=1e-6)
    np.testing.assert_allclose(running.attained[~alike], asked[~alike], atol=1e-6)
    assert not running.limited[~alike].any()


@pytest.mark.parametrize("name", ["guo-15", "bouc-wen", "force-map", "lpv-arx"])
def test_settled_force_of_every_kind_is_recovered(name: str):
    damper = truth(name)
    low, high = damper.current_range or (0.0, 1.0)
    currents = (max(low, 0.0), high)
    period = damper.clock or 0.002
    # SPEEDS are where a characteristic is tabulated: there the current is the only unknown
    v = SPEEDS[[20, 40, 80, 100]]
    want = currents[0] + np.array([0.2, 0.4, 0.6, 0.8]) * (currents[1] - currents[0])
    rest = float(damper.conservative_force(np.zeros(1))[0])

    def settled(current: np.ndarray) -> np.ndarray:
        pairs = zip(v.tolist(), current.tolist(), strict=True)
        return np.array([float(damper.static_force(np.array([a]), b)[0]) for a, b in pairs]) - rest

    asked = settled(want)
    setting = Setting(period, 4, MEGANE, damper, currents)
    running = Inverse(setting, Coil(highest=currents[1]), InverseSettings(points=41))
    running.look(np.zeros(4), v)
    force = settled(running.choose(asked))
    span = running.highest - running.lowest
    assert np.all(span > 5.0)
    np.testing.assert_allclose(force, asked, atol=0.01 * span.max())


def test_beyond_the_limits_it_clips_and_says_so():
    law = affine()
    running = inverse(law, 4)
    v = np.array([0.5, 0.5, -0.5, 0.5])
    running.look(np.zeros(4), v)
    np.testing.assert_allclose(running.choose(np.array([1e5, -1e5, -1e5, 100.0])), [2.0, 0.0, 2.0, 0.0])
    assert running.limited.tolist() == [True, True, True, True]
    edges = law.law(np.zeros(4), v, np.array([2.0, 0.0, 2.0, 0.0]), law.vector)
    np.testing.assert_allclose(running.attained, edges)
    running.take(np.array([-1.0, 1.0, 3.0, 2.0]))
    np.testing.assert_allclose(running.current, [0.0, 1.0, 2.0, 2.0])
    assert running.limited.tolist() == [True, False, True, False]


def test_a_damper_that_turns_back_takes_the_nearer_current():
    grid = np.linspace(0.0, 2.0, 21)
    rows = np.array([1000 * np.sin(np.pi * grid / 2)] * 2)  # rises to 1 A, then falls
    got = nearest(rows, grid, np.array([500.0, 500.0]), np.array([0.2, 1.9]))
    np.testing.assert_allclose(got, [1 / 3, 5 / 3], atol=2e-3)
    np.testing.assert_allclose(nearest(rows, grid, np.array([2e3, -50.0]), np.array([1.9, 0.1])), [1.0, 0.0], atol=1e-9)


def test_where_no_current_matters_it_stays():
    rows = np.full((1, 5), 100.0) + np.arange(5)
    assert nearest(rows, np.linspace(0, 2, 5), np.array([300.0]), np.array([0.7]))[0] == 0.7
    running = inverse(affine())
    running.look(np.zeros(1), np.array([0.5]))
    first = running.choose(np.array([800.0]))
    running.look(np.zeros(1), np.array([0.004]))  # inside the deadband
    assert running.choose(np.array([0.0]))[0] == first[0] > 0


def test_a_damper_that_knows_no_current():
    running = inverse(Linear(values={"damping": 1500.0, "stiffness": 0.0, "mass": 0.0, "offset": 0.0}))
    running.look(np.zeros(1), np.array([0.5]))
    assert running.lowest[0] == running.highest[0] == pytest.approx(750.0)
    running.choose(np.array([2000.0]))
    assert running.limited[0]
    bare = inverse(None)
    bare.look(np.zeros(1), np.array([0.5]))
    assert bare.force[0] == MEGANE.damping * 0.5


def test_gas_belongs_to_the_static_equilibrium():
    gas = PowerLawFrictionGas()
    running = inverse(gas)
    running.look(np.zeros(1), np.array([0.2]))
    free = float(gas.static_force(np.array([0.2]))[0] - gas.conservative_force(np.zeros(1))[0])
    assert running.lowest[0] == pytest.approx(free, rel=2e-3)


# -- through the coil --------------------------------------------------------------------------------------------------
def test_with_compensation_the_coil_has_the_current_one_sample_later():
    coil, law = Coil(0.005, 0.010, 0.0, 2.0), affine()
    running = inverse(law, coil=coil, lag_compensated=True)
    z, v = np.zeros(1), np.array([0.5])
    true = 0.0
    for wanted in (0.3, 0.5, 0.42, 0.45):
        running.look(z, v)
        command = running.choose(law.law(z, v, np.array([wanted]), law.vector))
        true = float(coil.follow(true, float(command[0]), np.array([0.002]))[0])
        assert true == pytest.approx(wanted, abs=1e-9)
        assert running.current[0] == pytest.approx(true, abs=1e-12)


def test_compensation_ends_at_the_limits():
    coil = Coil(0.005, 0.010, 0.0, 2.0)
    running = inverse(affine(), coil=coil, lag_compensated=True)
    running.look(np.zeros(1), np.array([0.5]))
    assert running.choose(np.array([1e5]))[0] == 2.0
    assert running.current[0] == pytest.approx(2 * (1 - np.exp(-0.4)))


def test_without_compensation_the_command_is_the_current_that_is_wanted():
    law = affine()
    running = inverse(law, coil=Coil(0.005, 0.010, 0.0, 2.0))
    running.look(np.zeros(1), np.array([0.5]))
    assert running.choose(law.law(np.zeros(1), np.array([0.5]), np.array([1.1]), law.vector))[0] == pytest.approx(1.1)


# -- the identified damper ---------------------------------------------------------------------------------------------
def test_identified_damper_one_step_ahead():
    damper = identified_damper()
    assert damper.clock is not None
    n = 400
    t = damper.clock * np.arange(n)
    z, v = 0.02 * np.sin(12 * t), 0.24 * np.cos(12 * t)
    setting = Setting(damper.clock, 1, MEGANE, damper, (0.0, 2.5))
    running = Inverse(setting, Coil(highest=2.5), InverseSettings(points=26, steps=1, lag_compensated=True))
    asked, had, low, high = np.zeros((4, n))
    for k in range(n):
        running.look(z[k:k + 1], v[k:k + 1])
        had[k] = running.force[0]
        asked[k], low[k], high[k] = 2500 * v[k], running.lowest[0], running.highest[0]
        running.choose(asked[k:k + 1])
    ahead, wanted = had[1:], np.clip(asked, low, high)[:-1]
    inside = (asked > low)[:-1] & (asked < high)[:-1] & (np.abs(v[:-1]) > 0.02)
    assert inside.mean() > 0.3
    assert np.sqrt(np.mean((ahead - wanted)[inside] ** 2)) < 0.1 * np.std(asked)


def test_forces_follow_the_damper_itself():
    damper = identified_damper()
    assert damper.clock is not None
    from quartercar.dampers import Drive

    n = 300
    t = damper.clock * np.arange(n)
    z, v = 0.02 * np.sin(12 * t), 0.24 * np.cos(12 * t) * (1 - np.exp(-t / 0.02))
    current = np.where(t < 0.2, 0.0, 1.5)
    setting = Setting(damper.clock, 1, MEGANE, damper, (0.0, 2.5))
    running = Inverse(setting, Coil(highest=2.5))
    found = np.zeros(n)
    for k in range(n):
        running.look(z[k:k + 1], v[k:k + 1])
        found[k] = running.force[0]
        running.take(current[min(k + 1, n - 1)][None])
    exact = damper.response(Drive(damper.clock, v, z, current), damper.vector)
    rest = float(damper.conservative_force(np.zeros(1))[0])
    np.testing.assert_allclose(found[1:], exact[1:] - rest, atol=1e-6 * np.abs(exact).max())


# -- input -------------------------------------------------------------------------------------------------------------
def test_limits_are_needed():
    with pytest.raises(InputError, match="limits of the current"):
        Inverse(Setting(0.002, 1, MEGANE, affine(), (0.0, np.inf)), Coil())
    with pytest.raises(InputError, match="points"):
        InverseSettings(points=1)
    with pytest.raises(InputError, match="deadband"):
        InverseSettings(deadband=-1.0)


def test_rows_are_read_between_the_grid_and_not_beyond():
    rows = np.array([[0.0, 1.0, 4.0]])
    grid = np.array([0.0, 1.0, 2.0])
    assert [along(rows, grid, np.array([x]))[0] for x in (-1.0, 0.5, 1.5, 9.0)] == [0.0, 0.5, 2.5, 4.0]
