"""Criteria of a ride against the standard's table, closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from lpvid.errors import InputError
from quartercar import criteria
from quartercar.dampers import Guo
from quartercar.parameters import MEGANE
from quartercar.vehicle.nonlinear import BumpStops, QuarterCar

TABLE = {-3: 418.8, -2: 458.8, -1: 476.7, 0: 482.5, 1: 484.6, 2: 493.5, 3: 530.8, 4: 633.5, 5: 807.1, 6: 964.8,
         7: 1039.2, 8: 1054.4, 9: 1037.4, 10: 988.4, 11: 898.9, 12: 774.3, 13: 637.3, 14: 510.3, 15: 403.1, 16: 316.0,
         17: 245.1, 18: 185.7, 19: 133.9, 20: 88.7}
"""1000·|W_k| at 10^(k/10) Hz (equation sheet 4.7)"""
PRINTED = {0.5: 418, 0.63: 459, 0.8: 477, 1: 482, 1.25: 484, 1.6: 494, 2: 531, 2.5: 631, 3.15: 804, 4: 967, 5: 1039,
           6.3: 1054, 8: 1036, 10: 988, 12.5: 902, 16: 768, 20: 636, 25: 513, 31.5: 405, 40: 314, 50: 246, 63: 186,
           80: 132, 100: 88.7}
"""1000·|W_k| as ISO 2631-1 prints it"""


def test_weighting_is_the_table():
    gains = 1000 * np.abs(criteria.comfort_weighting(10.0 ** (np.array(list(TABLE)) / 10)))
    np.testing.assert_allclose(gains, list(TABLE.values()), rtol=6e-4)


def test_weighting_is_the_printed_table():
    # within 0.3 % at the nominal frequencies, but for the rounding of frequencies above 12.5 Hz
    f = np.array(list(PRINTED), dtype=float)
    gains = 1000 * np.abs(criteria.comfort_weighting(f))
    np.testing.assert_allclose(gains, list(PRINTED.values()), rtol=3e-3, atol=0.5)


def test_without_the_factor_it_would_be_wrong():
    # (ω_5/ω_6)² sets the step's low end: |W_k| → (2.37/3.35)²·|H_h| there, and about one at 6.3 Hz
    low = abs(criteria.comfort_weighting(np.array([0.1]))[0])
    assert low == pytest.approx((2.37 / 3.35) ** 2 * 0.1**2 / np.sqrt(0.4**4 + 0.1**4), rel=2e-3)


def test_weighted_is_what_the_transfer_function_does(rng):
    rate, n = 2000.0, 6000
    t = np.arange(n) / rate
    a = np.sin(2 * np.pi * 5 * t) * np.hanning(n) + 0.3 * np.sin(2 * np.pi * 17 * t + 1) * np.hanning(n)
    _, wanted, _ = lsim(criteria.comfort_transfer(), a, t)
    np.testing.assert_allclose(criteria.weighted(a, 1 / rate), wanted, atol=2e-4 * np.abs(wanted).max())


def test_a_long_sine_is_weighted_by_its_gain():
    t = np.arange(40_000) / 1000
    a = criteria.weighted(2 * np.sin(2 * np.pi * 10 * t), 1e-3)[20_000:]
    assert criteria.rms(a) == pytest.approx(2 / np.sqrt(2) * 0.9884, rel=2e-4)
    assert criteria.vibration_dose(a, 1e-3) == pytest.approx(2 * 0.9884 * (3 / 8 * 20) ** 0.25, rel=2e-4)
    assert criteria.transient_maximum(a, 1e-3) == pytest.approx(2 / np.sqrt(2) * 0.9884, rel=2e-4)


def test_a_burst_shows_in_the_transient_value():
    a = np.zeros(5000)
    a[2000:2500] = 3.0  # half a second at 3: rms over the best second is 3/√2
    assert criteria.transient_maximum(a, 1e-3) == pytest.approx(3 / np.sqrt(2), rel=1e-12)
    assert criteria.transient_maximum(a[2000:2100], 1e-3) == pytest.approx(3.0, rel=1e-12)


def test_classes_overlap_as_in_the_standard():
    assert criteria.comfort_classes(0.2) == ("not uncomfortable",)
    assert criteria.comfort_classes(0.55) == ("a little uncomfortable", "fairly uncomfortable")
    assert criteria.comfort_classes(3.0) == ("extremely uncomfortable",)


def test_gains_of_a_linear_car_are_its_responses():
    car = QuarterCar(MEGANE)
    found = criteria.frequency_gains(car, [1.4, 4.0, 12.0], amplitude=2e-3)
    for signal, gains in found.gains.items():
        wanted = np.abs(car.passive().frequency_response(found.frequency, signal))
        np.testing.assert_allclose(gains, wanted, rtol=4e-4)


def test_gains_of_a_nonlinear_car_depend_on_the_amplitude():
    # Guo's law is stiff where it is slow: small roads are carried through, and the resonance is damped more
    car = QuarterCar(MEGANE, Guo())
    signal = "body_displacement"
    small, large = (criteria.frequency_gains(car, [3.0], a, signals=(signal,)).gains[signal][0] for a in (1e-4, 3e-2))
    assert small > 1.5 * large


def test_band_gain_in_closed_form():
    f = np.linspace(0.5, 20, 2000)
    assert criteria.band_gain(f, np.full(f.size, 3.0), 4.0, 13.0) == pytest.approx(9.0, rel=1e-12)
    assert criteria.band_gain(f, f, 1.0, 4.0) == pytest.approx(np.sqrt(63 / 3), rel=1e-4)
    with pytest.raises(InputError, match="do not cover"):
        criteria.band_gain(f, f, 4.0, 30.0)


def test_bands_that_are_reached_are_judged():
    gains = {"body_displacement": np.ones(3), "wheel_displacement": np.full(3, 2.0)}
    found = criteria.FrequencyGains(np.array([1.0, 5.0, 21.0]), gains, 1e-3).criteria()
    assert found == pytest.approx({"comfort_low": 2.0, "road_holding": 2 * np.sqrt(19)})


def test_figures_of_a_run():
    t = np.arange(12_000) * 1e-3
    car = QuarterCar(MEGANE, stops=BumpStops(compression=0.05, rebound=0.08))
    run = car.run(3e-3 * np.sin(2 * np.pi * 1.4 * t), 1e-3)
    ride = criteria.judge(run, settle=7.0)  # seven whole periods
    gain = np.abs(car.passive().frequency_response(np.array([1.4]), "suspension_deflection"))[0]
    assert ride.largest_stroke == pytest.approx(3e-3 * gain, rel=1e-3)
    assert ride.space_used == pytest.approx(3e-3 * gain / 0.05, rel=2e-3)
    load = np.abs(car.passive().frequency_response(np.array([1.4]), "tyre_force"))[0] * 3e-3 / np.sqrt(2)
    assert ride.tyre_load == pytest.approx(load, rel=5e-3) and ride.off_road == 0
    assert ride.load_coefficient == pytest.approx(ride.tyre_load / (352.5 * 9.81), rel=1e-12)
    weight = np.abs(criteria.comfort_weighting(np.array([1.4])))[0]
    assert ride.comfort == pytest.approx(weight * ride.acceleration, rel=3e-3)
    assert len(str(ride).splitlines()) == 4 and "m/s^2" in str(ride)


def test_too_slow_a_record_is_refused():
    with pytest.raises(InputError, match="80 Hz"):
        criteria.weighted(np.zeros(100), 0.01)
    with pytest.raises(InputError, match="rise"):
        criteria.frequency_gains(QuarterCar(MEGANE), [2.0, 1.0])
