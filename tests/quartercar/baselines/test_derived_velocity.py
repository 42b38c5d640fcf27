"""A velocity that was derived moves with the noise of the displacement's sensor: that must not pass for motion."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, motion, without_noise
from scipy.signal import bilinear, lfilter

import lpvid as lpv
from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import before_filter
from lpvid.condition import differentiate
from lpvid.effects.preparing import prepare
from lpvid.record import Record
from quartercar.dampers import fit
from quartercar.dampers.laws.linear import Linear

NOISE = 2e-5
"""of the displacement's sensor [m]"""
UNITS = {"displacement": "m", "current": "A", "force": "N", "velocity": "m/s"}


def recorded(rng: np.random.Generator, samples: int = 6000) -> tuple[Record, np.ndarray]:
    """A record of a noisy displacement without velocity, and the exact velocity."""
    x, v = motion(PERIOD * np.arange(samples))
    channels = {"displacement": x + NOISE * rng.standard_normal(samples), "force": 500 * v}
    return Record(channels, PERIOD, name="run", units={c: UNITS[c] for c in channels}), v


@pytest.mark.parametrize(("method", "share"), [("savitzky-golay", 0.6), ("central", 1.1), ("backward", 0.6)])
def test_noise_of_a_velocity_that_was_derived_is_told_from_motion(method: str, share: float, rng: np.random.Generator
                                                                  ) -> None:
    """Central differences pass no noise at the top of the band and even noise below, of which the level is then known
    without the source too."""
    record, v = recorded(rng)
    derived = differentiate(record["displacement"], PERIOD, method=method)
    s = Signals(PERIOD, {"displacement": record["displacement"], "velocity": derived}, record["force"])
    alone = Signals(PERIOD, {"velocity": derived}, record["force"])
    exact = differentiate(motion(PERIOD * np.arange(6000))[0], PERIOD, method=method)
    inside = slice(100, -100)
    left, without_source, at_first = (float(np.std((got - exact)[inside])) for got in (
        without_noise(s, "velocity"), without_noise(alone, "velocity"), derived))
    assert left < 0.4 * at_first and left < share * without_source
    assert left < 0.01 * v.std()


def test_a_velocity_of_its_own_sensor_keeps_the_share_of_its_own(rng: np.random.Generator) -> None:
    record, v = recorded(rng)
    measured = v + 0.01 * v.std() * rng.standard_normal(v.size)
    both = Signals(PERIOD, {"displacement": record["displacement"], "velocity": measured}, record["force"])
    alone = Signals(PERIOD, {"velocity": measured}, record["force"])
    np.testing.assert_array_equal(without_noise(both, "velocity"), without_noise(alone, "velocity"))


def test_the_diagnosis_derives_a_velocity_without_that_noise(rng: np.random.Generator) -> None:
    record, v = recorded(rng)
    prepared = prepare([record], [], (), ("displacement", "velocity", "force"))
    got, before = prepared.training[0]["velocity"], differentiate(record["displacement"], PERIOD)
    assert np.std(got - v) < 0.4 * np.std(before - v)
    note, = prepared.notes
    assert note == "velocity derived from displacement without the sensor's noise beyond the band that moves"


def slow_record(rng: np.random.Generator, hum: float, shake: float) -> tuple[Record, np.ndarray]:
    """A slow sine whose displacement carries a hum of 50 Hz [m], and a shake of 80 Hz [m] that the damper follows."""
    period, samples = 1 / 300, 9000
    t = period * np.arange(samples)
    shaking = 2 * np.pi * 80
    x = 0.018 * np.sin(2 * np.pi * 0.21 * t) + shake * np.sin(shaking * t)
    v = 0.018 * 2 * np.pi * 0.21 * np.cos(2 * np.pi * 0.21 * t) + shake * shaking * np.cos(shaking * t)
    read = x + hum * np.sin(2 * np.pi * 50 * t) + 2e-6 * rng.standard_normal(samples)
    channels = {"displacement": read, "force": 2000 * v + 40 * np.tanh(v / 1e-3) + 0.5 * rng.standard_normal(samples)}
    return Record(channels, period, name="slow", units={c: UNITS[c] for c in channels}), v


def test_mains_hum_of_the_displacement_is_no_motion(rng: np.random.Generator) -> None:
    """50 µm at 50 Hz are as fast as 18 mm at .2 Hz."""
    record, v = slow_record(rng, hum=5e-5, shake=0.0)
    prepared = prepare([record], [], (), ("displacement", "velocity", "force"))
    got, before = prepared.training[0]["velocity"], differentiate(record["displacement"], record.sample_time)
    assert np.std(before - v) > 0.15 * np.std(v)
    assert np.std(got - v) < 0.02 * np.std(v)


def test_a_band_of_its_own_in_which_the_force_follows_is_motion(rng: np.random.Generator) -> None:
    record, v = slow_record(rng, hum=5e-5, shake=3e-5)
    got = prepare([record], [], (), ("displacement", "velocity", "force")).training[0]["velocity"]
    assert np.std(got - v) < 0.06 * np.std(v)


def relative_error(displacement: np.ndarray, velocity: np.ndarray, force: np.ndarray, period: float) -> float:
    """Of the velocity that is derived, over the velocity."""
    record = Record({"displacement": displacement, "force": force}, period, name="run", units=UNITS)
    got = prepare([record], [], (), ("displacement", "velocity", "force")).training[0]["velocity"]
    return float(np.std(got - velocity) / np.std(velocity))


@pytest.mark.parametrize(("flips", "viscous"), [(1, 800.0), (5, 800.0), (10, 0.0)])
def test_motion_stays_where_a_switched_current_makes_most_of_the_force(flips: int, viscous: float,
                                                                      rng: np.random.Generator) -> None:
    """Tones of 12 and 20 Hz beside 30 mm at 1 Hz; friction that the current switches hides how they move the force."""
    t = np.arange(20000) * PERIOD
    current = np.repeat(rng.integers(0, 2, 40 * flips), 500 // flips)
    tones = ((0.03, 1.0), (5e-4, 12.0), (3e-4, 20.0))
    x = sum(a * np.sin(2 * np.pi * f * t) for a, f in tones)
    v = sum(a * 2 * np.pi * f * np.cos(2 * np.pi * f * t) for a, f in tones)
    force = viscous * v + (100 + 800 * current) * np.tanh(v / 0.02) + 5 * rng.standard_normal(t.size)
    assert relative_error(x + 1e-5 * rng.standard_normal(t.size), v, force, PERIOD) < 0.02


@pytest.mark.parametrize(("stroke", "frequency", "noise", "in_force", "most"), [
    (1e-4, 1.0, 1e-6, 0.0, 0.1), (0.018, 0.2, 1e-8, 0.0, 0.01), (0.018, 0.2, 1e-6, 2.0, 0.01)])
def test_hum_as_large_as_the_stroke_of_a_quiet_sensor_and_in_both_channels(
        stroke: float, frequency: float, noise: float, in_force: float, most: float, rng: np.random.Generator) -> None:
    t = np.arange(20000) / 512
    w, hum = 2 * np.pi * frequency, np.sin(2 * np.pi * 50 * t)
    v = stroke * w * np.cos(w * t)
    force = 2000 * v + 0.5 * rng.standard_normal(t.size) + in_force * hum
    read = stroke * np.sin(w * t) + 3e-5 * hum + noise * rng.standard_normal(t.size)
    assert relative_error(read, v, force, 1 / 512) < most


def test_what_is_left_out_is_stated(rng: np.random.Generator) -> None:
    note, = prepare([slow_record(rng, 5e-5, 0.0)[0]], [], (), ("displacement", "velocity", "force")).notes
    assert note.endswith("nor interference about 50 Hz, where the force does not follow")


def test_a_current_is_weighed_by_its_own_noise_alone(rng: np.random.Generator) -> None:
    """The force has the sign of the velocity, so that it is not coherent with a smooth current."""
    t = np.arange(20000) * PERIOD
    current = sum(0.2 * np.sin(2 * np.pi * f * t + f) for f in (2.0, 11.0, 23.0, 37.0)) + 1.0
    v = 0.1 * np.sin(2 * np.pi * 1.3 * t)
    lag = 0.02
    late = lfilter(*bilinear([1], [lag, 1], 1 / PERIOD), current)
    force = 800 * current * np.tanh(v / 0.05) + 5 * rng.standard_normal(t.size)
    s = Signals(PERIOD, {"current": late, "velocity": v}, force)
    back = before_filter(s, "current", (lag,))
    assert np.std((back - current)[200:-200]) < 0.05 * np.std(current)


def test_a_fitted_damper_reads_a_validated_record_as_it_was_fitted(rng: np.random.Generator) -> None:
    record, v = slow_record(rng, hum=5e-5, shake=0.0)
    record = record.with_channel("force", 2000 * v + 40 * np.tanh(v / 1e-3), "N")
    found = fit(Linear(), record)
    assert lpv.validate(found.damper, record).records[0].free_run.esr == pytest.approx(found.training.esr, rel=1e-3)


def test_a_damper_fitted_to_a_slow_record_with_hum_has_its_damping(rng: np.random.Generator) -> None:
    record, v = slow_record(rng, hum=5e-5, shake=0.0)
    found = fit(Linear(), record.with_channel("force", 2000 * v, "N"))
    assert found.damper.values["damping"] == pytest.approx(2000, rel=0.01)


def test_a_short_record_is_differentiated_as_elsewhere(rng: np.random.Generator) -> None:
    record, _ = recorded(rng, 300)
    prepared = prepare([record], [], (), ("displacement", "velocity", "force"))
    np.testing.assert_allclose(prepared.training[0]["velocity"], differentiate(record["displacement"], PERIOD))
    assert prepared.notes == ("velocity derived from displacement (savitzky-golay)",)


@pytest.mark.parametrize("samples", [400, 1000, 1900])
def test_from_400_samples_on_the_band_of_the_motion_is_known_well_enough(samples: int, rng: np.random.Generator
                                                                        ) -> None:
    record, v = recorded(rng, samples)
    got = prepare([record], [], (), ("displacement", "velocity", "force")).training[0]["velocity"]
    assert np.std(got - v) < 0.9 * np.std(differentiate(record["displacement"], PERIOD) - v)


def test_of_a_record_that_is_cut_the_short_pieces_are_told(rng: np.random.Generator) -> None:
    record, _ = recorded(rng)
    force = np.array(record["force"])
    force[300:310] = np.nan
    prepared = prepare([record.with_channel("force", force, "N")], [], (), ("displacement", "velocity", "force"))
    assert [r.n_samples for r in prepared.training] == [300, 5690]
    assert prepared.notes[0].endswith("in 1 of 2 pieces; the others are too short for that")


def test_a_measured_velocity_stays(rng: np.random.Generator) -> None:
    record, v = recorded(rng)
    noisy = v + 0.05 * rng.standard_normal(v.size)
    prepared = prepare([record.with_channel("velocity", noisy, "m/s")], [], (), ("displacement", "velocity", "force"))
    np.testing.assert_array_equal(prepared.training[0]["velocity"], noisy)
    assert prepared.notes == ()


@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.slow),
                                   pytest.param(NOISE, marks=pytest.mark.seconds)])
def test_a_late_displacement_brings_no_causes_that_are_not_there(noise: float, rng: np.random.Generator) -> None:
    """Three tones behind a low-pass of 4 ms, which the noise makes hard to tell from a delay; nothing else is wrong."""
    samples, period, lag = 6000, 0.002, 4e-3
    t = period * np.arange(samples)
    x = sum(a * np.sin(2 * np.pi * f * t + p) for p, (a, f) in enumerate(((0.01, 0.7), (0.006, 1.9), (0.003, 4.3))))
    v, current = np.gradient(x, period), np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5], 60), 100)
    force = (300 + 600 * current) * np.tanh(30 * v) + 800 * v
    late = lfilter(*bilinear([1], [lag**2, 1.4 * lag, 1], 1 / period), x - x[0]) + x[0]
    channels = {"displacement": late + noise * rng.standard_normal(samples), "current": current,
                "force": force + 5.0 * rng.standard_normal(samples)}
    found = lpv.diagnose(Record(channels, period, name="run", units={c: UNITS[c] for c in channels}), "guo")
    names = {c.name for c in found.causes} | {name for group in found.rivals for name in group.names}
    assert "one-sided-filter" in names
    assert names <= {"one-sided-filter", "displacement-delay"}
    assert found.after.esr_held_out < 0.001
