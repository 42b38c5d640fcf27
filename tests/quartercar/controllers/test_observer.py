"""Sensors and the observer: their statistics, the Riccati equation by simulation, unknown signals refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from lpvid.errors import InputError
from quartercar import roads
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.observer import STATES, KalmanObserver, ObserverSettings
from quartercar.controllers.loop.sensing import BODY, SETS, STROKE, TRUE, MeasurementSet, Sensing, Sensor
from quartercar.dampers import Linear
from quartercar.parameters import MEGANE
from quartercar.vehicle.nonlinear import QuarterCar

STEP = 0.002
SETTING = Setting(STEP, 1, MEGANE)


def readings(sensor: Sensor, signal: np.ndarray, seed: int = 0) -> np.ndarray:
    sensing = Sensing(MeasurementSet("one", (sensor,)), STEP, [np.random.default_rng(seed)], signal.size)
    return np.array([sensing({sensor.signal: signal[k:k + 1]})[sensor.signal][0] for k in range(signal.size)])


@pytest.mark.seconds
def test_noise_has_its_standard_deviation_and_its_seed():
    read = readings(Sensor("body_acceleration", noise=0.05), np.zeros(20000))
    assert read.std() == pytest.approx(0.05, rel=0.03) and abs(read.mean()) < 0.002
    np.testing.assert_array_equal(read, readings(Sensor("body_acceleration", noise=0.05), np.zeros(20000)))
    assert not np.array_equal(read, readings(Sensor("body_acceleration", noise=0.05), np.zeros(20000), 1))


def test_numbers_are_whole_steps():
    read = readings(Sensor("suspension_deflection", resolution=5e-5), np.linspace(-0.01, 0.01, 500))
    np.testing.assert_allclose(read / 5e-5, np.round(read / 5e-5), atol=1e-9)
    np.testing.assert_allclose(read, np.linspace(-0.01, 0.01, 500), atol=2.5e-5 * (1 + 1e-9))


def test_bandwidth_is_a_first_order_lag():
    step = readings(Sensor("body_acceleration", bandwidth=20.0), np.r_[0.0, np.ones(200)])
    turn = 2 * np.pi * 20.0
    _, out, _ = lsim(([turn], [1.0, turn]), np.r_[0.0, np.ones(200)], STEP * np.arange(201))
    np.testing.assert_allclose(step, out, atol=1e-12)


def test_sets_say_what_they_measure():
    assert SETS["stroke-body"].signals == ("suspension_deflection", "body_acceleration")
    assert SETS["ideal"].ideal and not SETS["stroke-body"].ideal and set(SETS["ideal"].signals) == set(TRUE)
    assert all(s.noise == 0 for s in SETS["stroke-body"].quiet().sensors)
    with pytest.raises(InputError, match="one sensor per signal"):
        MeasurementSet("two", (STROKE, STROKE))
    with pytest.raises(InputError, match="is measured"):
        Sensor("speed")
    with pytest.raises(InputError, match="noise"):
        Sensor("body_acceleration", noise=-1.0)


# -- observer ----------------------------------------------------------------------------------------------------------
def ridden(damping: float, n: int = 8000, seed: int = 2):
    road = roads.iso8608(n, 1 / STEP, "C", speed=20.0, rng=np.random.default_rng(seed))
    return QuarterCar(MEGANE, Linear(values={"damping": damping}), lift_off=False).run(road - road[0], STEP)


def estimates(run, sensors: MeasurementSet, force_gain: float = 1.0, seed: int = 0,
              settings: ObserverSettings | None = None) -> dict[str, np.ndarray]:
    observer = KalmanObserver(SETTING, sensors, settings)
    sensing = Sensing(sensors, STEP, [np.random.default_rng(seed)], run.n_samples)
    force = force_gain * run["damper_force"]
    out = []
    for k in range(run.n_samples):
        read = sensing({n: run[n][k:k + 1] for n in sensors.signals})
        mean = 0.5 * (force[max(k - 1, 0)] + force[k])
        out.append(observer(read, np.array([mean]), force[k:k + 1]))
    return {n: np.array([o[n][0] for o in out]) for n in out[0]}


def wrong_by(found: dict[str, np.ndarray], run, name: str) -> float:
    """Rms error as a share of the signal's rms, the first second left out."""
    return float(np.std((found[name] - run[name])[500:]) / np.std(run[name][500:]))


def test_its_error_dies_out_and_its_covariance_is_a_fixed_point():
    observer = KalmanObserver(SETTING, SETS["stroke-body"])
    assert np.abs(observer.poles).max() < 1
    assert np.linalg.eigvalsh(observer.covariance).min() > -1e-12


@pytest.mark.thinned(4, "seconds")
@pytest.mark.parametrize(("sensors", "limits"), [
    ("stroke-body", {"suspension_deflection": 0.02, "suspension_velocity": 0.22, "body_velocity": 0.03,
                     "wheel_velocity": 0.23, "tyre_deflection": 0.7}),
    ("stroke-body-wheel", {"suspension_deflection": 0.01, "suspension_velocity": 0.03, "body_velocity": 0.04,
                           "wheel_velocity": 0.03, "tyre_deflection": 0.12})])
@pytest.mark.parametrize("known", [1.0, 0.7])
def test_velocities_from_realistic_sensors(sensors: str, limits: dict[str, float], known: float):
    run = ridden(1500.0, 5000)
    found = estimates(run, SETS[sensors], known)  # also with a damper model that lacks a third of the force
    for name, limit in limits.items():
        assert wrong_by(found, run, name) < limit, name


@pytest.mark.seconds
def test_its_covariance_is_what_it_makes():
    # white noise without lag and a force that is known: the filter's own error covariance must come out
    sensors = MeasurementSet("plain", (Sensor("suspension_deflection", noise=STROKE.noise),
                                       Sensor("body_acceleration", noise=BODY.noise)))
    settings = ObserverSettings(force_error=1.0)
    observer = KalmanObserver(SETTING, sensors, settings)
    errors = []
    for seed in range(3):
        run = ridden(1500.0, 10000, seed + 10)
        found = estimates(run, sensors, seed=seed, settings=settings)
        errors.append(np.array([(found[n] - run[n])[1000:] for n in STATES]))
    sample = np.concatenate(errors, axis=1)
    spread, expected = np.sqrt(np.mean(sample**2, axis=1)), np.sqrt(np.diag(observer.covariance)[:4])
    np.testing.assert_allclose(spread[[0, 2, 3]], expected[[0, 2, 3]], rtol=0.05)
    assert spread[1] < expected[1]  # the body's velocity drifts over minutes; these runs begin without error


def test_without_noise_and_error_it_is_the_car():
    sensors = MeasurementSet("exact", (Sensor("suspension_deflection"), Sensor("body_acceleration")))
    run = ridden(1500.0, 4000)
    found = estimates(run, sensors, settings=ObserverSettings(force_error=1e-2))
    assert wrong_by(found, run, "suspension_velocity") < 0.03
    assert wrong_by(found, run, "body_velocity") < 0.03


@pytest.mark.parametrize("sensors", [(BODY,), (STROKE,)])
def test_too_little_to_observe(sensors):
    with pytest.raises(InputError, match="deflection and an acceleration"):
        KalmanObserver(SETTING, MeasurementSet("few", sensors))


def test_settings_are_checked():
    with pytest.raises(InputError, match="speed"):
        ObserverSettings(speed=0.0)
    with pytest.raises(InputError, match="class"):
        ObserverSettings(road_class="Z")
