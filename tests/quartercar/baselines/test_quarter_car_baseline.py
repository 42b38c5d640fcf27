"""The quarter car as a baseline: its run against scipy, the invariants of any quarter car, a fit that is well posed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lpvid as lpv
from lpvid.baselines.signals import Signals
from lpvid.errors import InputError
from lpvid.record import Channel, Record
from quartercar.baselines.quarter_car import FREE, UNITS, QuarterCarBaseline
from quartercar.parameters import BENCH, MEGANE, SAVARESI, CarParameters
from quartercar.vehicle.strut_friction import SMOOTH, CarCore

PERIOD = 1 / 256
CAR = MEGANE.replace(tyre_damping=120.0)


def signals(n: int, rng: np.random.Generator, force: float = 400.0, seconds: float = 0.0) -> Signals:
    """Band-limited road and actuator force, from rest."""
    t = PERIOD * np.arange(n)
    tones = rng.uniform(0.4, 14.0, 24)
    road = 1e-3 * np.sum(rng.uniform(0.3, 1, 24)[:, None] / np.sqrt(tones)[:, None]
                         * np.sin(2 * np.pi * tones[:, None] * t + rng.uniform(0, 6.3, 24)[:, None]), axis=0)
    actuator = force * np.sign(np.sin(2 * np.pi * 0.7 * t + 1.0)) * (t > 0.1)
    return Signals(PERIOD, {"road": road * np.minimum(t / 0.5, 1.0), "actuator": actuator, "sprung": np.zeros(n),
                            "unsprung": np.zeros(n)}, np.zeros(n))


def by_scipy(car: CarParameters, s: Signals, friction: float) -> np.ndarray:
    """(n, 4) z_s, ż_s, z_us, ż_us, written out from the two equations of motion."""
    t = s.times
    slope = np.append(np.diff(s["road"]) / PERIOD, 0.0)

    def rates(now: float, x: np.ndarray) -> list[float]:
        k = min(int(now / PERIOD * (1 + 1e-12)), t.size - 1)
        road = s["road"][k] + slope[k] * (now - t[k])
        force = np.interp(now, t, s["actuator"])
        rate = x[1] - x[3]
        strut = car.spring_stiffness * (x[0] - x[2]) + car.damping * rate + friction * np.tanh(rate / SMOOTH) - force
        tyre = car.tyre_stiffness * (x[2] - road) + car.tyre_damping * (x[3] - slope[k])
        return [x[1], -strut / car.sprung_mass, x[3], (strut - tyre) / car.unsprung_mass]

    found = solve_ivp(rates, (0, t[-1]), np.zeros(4), "LSODA", t, rtol=1e-9, atol=1e-11, max_step=PERIOD)
    return found.y.T


def test_accelerations_are_no_positions(rng):
    n = 400
    record = Record({r: rng.standard_normal(n) for r in ("road", "unsprung", "sprung")}, sample_time=PERIOD,
                    units={"road": "m/s^2", "unsprung": "m/s^2", "sprung": "m/s^2"})
    with pytest.raises(InputError, match=r"road has a wrong unit: got m/s\^2; m expected.*identify --input TABLE"):
        lpv.diagnose(record, "quarter-car")
    with pytest.raises(InputError, match=r"a baseline reads some of displacement, .*, road, unsprung, sprung"):
        lpv.diagnose(Record({"acc": rng.standard_normal(n)}, sample_time=PERIOD), "quarter-car")


def test_a_command_in_volts_is_no_force_of_the_actuator(rng):
    n = 400
    record = Record({r: rng.standard_normal(n) for r in ("road", "unsprung", "sprung", "actuator")}, sample_time=PERIOD,
                    units={"road": "m", "unsprung": "m", "sprung": "m", "actuator": "V"})
    with pytest.raises(InputError, match=r"actuator has a wrong unit: got V; N expected.*the actuator's force"):
        QuarterCarBaseline(CAR).signals(record)


@pytest.mark.seconds
@pytest.mark.parametrize("friction", [0.0, 60.0])
def test_its_run_is_that_of_the_equations_of_motion(friction, rng):
    s = signals(256, rng)
    found = CarCore(CAR, friction).states(s)
    exact = by_scipy(CAR, s, friction)
    spread = exact.std(axis=0)
    assert np.abs((found - exact) / spread).max() < (2e-5 if friction == 0 else 0.02)
    np.testing.assert_array_equal(CarCore(CAR, friction, "unsprung")(s), found[:, 2])


def test_friction_moves_the_car_far_more_than_its_step_errs(rng):
    s = signals(500, rng)
    plain, rough = (CarCore(CAR, f)(s) for f in (0.0, 60.0))
    assert np.std(rough - plain) > 0.1 * np.std(plain)


@pytest.mark.parametrize("damping", [300.0, 1500.0, 6000.0])
def test_the_invariant_points_do_not_move_with_the_strut(damping):
    """|z_s''/z_r| = k_t/m_s at sqrt(k_t/m_us), |z_d/z_r| = (m_s+m_us)/m_s at sqrt(k_t/(m_s+m_us)): sheet 4.1."""
    car = MEGANE.replace(damping=damping)
    for omega, stroke in ((np.sqrt(car.tyre_stiffness / car.unsprung_mass), False),
                          (np.sqrt(car.tyre_stiffness / (car.sprung_mass + car.unsprung_mass)), True)):
        period = 2 * np.pi / omega / 400
        n = 400 * 400
        t = period * np.arange(n)
        road = 0.01 * np.sin(omega * t)
        x = CarCore(car).states(Signals(period, {"road": road, "sprung": 0 * t, "unsprung": 0 * t}, 0 * t))
        wave = np.exp(-1j * omega * t[-400:])
        body, gap, ground = (abs(wave @ y[-400:]) for y in (x[:, 0], x[:, 0] - x[:, 2], road))
        if stroke:
            assert gap / ground == pytest.approx((car.sprung_mass + car.unsprung_mass) / car.sprung_mass, rel=2e-3)
        else:
            assert body / ground * omega**2 == pytest.approx(car.tyre_stiffness / car.sprung_mass, rel=2e-3)


@pytest.mark.parametrize("friction", [0.0, 60.0])
def test_inner_forces_cancel_in_the_momentum(friction, rng):
    """m_s z_s'' + m_us z_us'' + k_t (z_us - z_r) + c_t (…) = 0 for any force in the strut: sheet 4.1, integrated."""
    s = signals(900, rng)
    x = CarCore(CAR, friction).states(s)
    momentum = CAR.sprung_mass * x[:, 1] + CAR.unsprung_mass * x[:, 3]
    gap = x[:, 2] - s["road"]
    tyre = CAR.tyre_stiffness * np.concatenate([[0], np.cumsum((gap[1:] + gap[:-1]) / 2) * PERIOD])
    left = momentum + tyre + CAR.tyre_damping * gap
    assert np.abs(left).max() < 0.01 * np.abs(tyre).max()


def test_motion_alone_tells_no_scale_so_the_sprung_mass_is_held(rng):
    s = signals(600, rng, force=0.0)
    double = CAR.replace(**{n: 2 * getattr(CAR, n) for n in UNITS})
    np.testing.assert_allclose(CarCore(double)(s), CarCore(CAR)(s), rtol=1e-9, atol=1e-12)
    assert "sprung_mass" not in FREE


def recorded(car: CarParameters, rng: np.random.Generator, force: float, n: int = 6000, noise: float = 1e-5) -> Record:
    s = signals(n, rng, force)
    x = CarCore(car).states(s)
    columns = {"road": s["road"], "sprung": x[:, 0] + noise * rng.standard_normal(n),
               "unsprung": x[:, 2] + noise * rng.standard_normal(n), "actuator": s["actuator"]}
    return Record({k: Channel(v, "N" if k == "actuator" else "m") for k, v in columns.items()}, PERIOD)


def test_a_fit_finds_the_car_from_another_one(rng):
    truth = SAVARESI.replace(damping=2600.0, tyre_damping=300.0, unsprung_mass=62.0)
    record = recorded(truth, rng, 400.0)
    found = QuarterCarBaseline(SAVARESI).fit([record])
    assert found.free == FREE
    for name in FREE:
        assert getattr(found.car, name) == pytest.approx(getattr(truth, name), rel=0.05)
    assert found.car.sprung_mass == SAVARESI.sprung_mass


def test_what_the_records_cannot_determine_is_held(rng):
    record = recorded(SAVARESI.replace(damping=2600.0), rng, 0.0)
    found = QuarterCarBaseline(SAVARESI, free=tuple(UNITS)).fit([record])
    assert "sprung_mass" not in found.free and found.car.sprung_mass == SAVARESI.sprung_mass
    assert found.car.damping == pytest.approx(2600.0, rel=0.05)


@pytest.mark.seconds
def test_nothing_leaves_its_physical_reach(rng):
    base = QuarterCarBaseline(BENCH)
    noise = recorded(BENCH, rng, 1.0)
    wild = Record({**noise.channels, "sprung": Channel(rng.standard_normal(noise.n_samples), "m")}, PERIOD)
    found = base.fit([wild])
    for c, v in zip(found.coefficients, found.vector, strict=True):
        assert c.lower <= v <= c.upper
    assert 0.25 <= found.car.unsprung_mass / BENCH.unsprung_mass <= 4.0


def test_derivatives_are_those_of_the_run(rng):
    s = signals(400, rng)
    base = QuarterCarBaseline(CAR, free=tuple(UNITS))
    found = base.sensitivities(s, base.vector)
    for j, c in enumerate(base.coefficients):
        step = 1e-3 * c.scale * np.eye(6)[j]
        central = (base.core(base.vector + step)(s) - base.core(base.vector - step)(s)) / (2 * step[j])
        np.testing.assert_allclose(found[:, j], central, atol=1e-3 * np.abs(central).max())


def test_a_stored_one_is_the_same_and_missing_channels_are_named(rng):
    base = QuarterCarBaseline(CAR, ("damping",), "unsprung", given=MEGANE)
    again = QuarterCarBaseline.from_dict(base.to_dict())
    assert (again.car, again.free, again.output, again.given) == (CAR, ("damping",), "unsprung", MEGANE)
    record = recorded(CAR, rng, 0.0, 600)
    alone = Record({n: record.channels[n] for n in ("road", "sprung", "unsprung")}, PERIOD)
    with pytest.raises(InputError, match="has no actuator"):
        base.signals(alone)
    assert QuarterCarBaseline(CAR, actuated=False).signals(alone).n_samples == 600


def test_the_other_motion_alone_tells_where_it_starts(rng):
    """An extended model is run along its inputs; the output's own channel is not among them."""
    s = signals(200, rng)
    inputs = {k: v for k, v in s.channels.items() if k != "sprung"}
    np.testing.assert_array_equal(CarCore(CAR)(Signals(PERIOD, inputs, s.output + 0.01))[0], 0.01)


@pytest.mark.seconds
def test_the_bench_car_stays_a_bench_car(shared_data):
    records = [r.slice(0, 5000).with_roles({"actuator": "actuator force"}).flip("actuator force")
               for r in lpv.read(str(shared_data / "quarter_car_rig" / "run*.csv"))]
    found = QuarterCarBaseline().fit(records)
    assert found.car.unsprung_mass < 4 * BENCH.unsprung_mass
    error = power = 0.0
    for s in map(found.signals, records):
        e = found.core(found.vector)(s) - s.output
        error, power = error + e @ e, power + np.sum((s.output - s.output.mean()) ** 2)
    assert error / power < 0.03
