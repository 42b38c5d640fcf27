"""Static characteristics from triangle runs: known laws come back, what is not steady is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.excitation import sine, triangle
from lpvid.record import Channel, Record
from quartercar.dampers.bench.static_characteristic import StaticCharacteristic, static_points
from quartercar.dampers.bench.steady_windows import WindowSettings, steady_windows


def law(v: np.ndarray) -> np.ndarray:
    return 1e5 * v + 5e7 * v * np.abs(v) + 20.0 * np.sign(v)


def run(speed: float, *, lag: float = 0.0, noise: float = 0.01, amplitude: float = 1e-3, cycles: float = 2.0,
        gas: float = 0.0, wave: str = "triangle", samples: int = 400, rng: np.random.Generator) -> Record:
    """A triangle run with rounded corners: force by `law`, with an exact first-order lag of `lag` stroke times."""
    f = speed / (4 * amplitude)
    rate = samples * f
    n = int(cycles * samples) + 1
    x = triangle(n, rate, amplitude=amplitude, frequency=f, acceleration=40 * speed * f) if wave == "triangle" else \
        sine(n, rate, amplitude=amplitude, frequency=f)
    v = np.gradient(x, 1 / rate)
    wanted = 1e5 * v + 5e7 * v * np.abs(v)
    force = wanted.copy()
    if lag:
        keep = np.exp(-1 / (rate * lag * 0.5 / f))
        for k in range(1, n):
            force[k] = keep * force[k - 1] + (1 - keep) * wanted[k]
    force = force + 20.0 * np.tanh(v / (1e-3 * speed)) + gas * x - 0.5 * gas * amplitude
    force = force + noise * force.std() * rng.standard_normal(n)
    return Record({"displacement": Channel(x + 0.1 * noise * amplitude * rng.standard_normal(n), "m"),
                   "velocity": Channel(v, "m/s"), "force": Channel(force, "N")}, sample_time=1 / rate,
                  name=f"{1e3 * speed:.3g} mm/s")


SPEEDS = np.geomspace(2e-5, 2e-3, 23)


@pytest.mark.parametrize("lag", [0.0, 0.03])
def test_the_law_comes_back_within_its_standard_errors(rng: np.random.Generator, lag: float) -> None:
    c = static_points([run(v, lag=lag, rng=rng) for v in SPEEDS])
    assert c.n_points == 46
    assert (c.direction > 0).sum() == 23
    error = c.force - law(c.velocity)
    assert np.abs(error / c.force).max() < 0.01
    assert 0.6 < np.sqrt(np.mean((error / c.std) ** 2)) < 1.6


@pytest.mark.seconds
def test_standard_errors_hold_over_many_draws(rng: np.random.Generator) -> None:
    scaled = np.concatenate([(c.force - law(c.velocity)) / c.std for c in
                             (static_points([run(1e-3, cycles=4, rng=rng)]) for _ in range(30))])
    assert np.mean(np.abs(scaled) < 1.96) == pytest.approx(0.95, abs=0.07)


@pytest.mark.seconds
def test_repeats_that_differ_widen_the_error(rng: np.random.Generator) -> None:
    def warmer(share: float) -> list[Record]:
        return [r.with_channel("force", r["force"] * (1 + share * rng.standard_normal()), "N")
                for r in (run(v, noise=0.002, rng=rng) for v in np.repeat(SPEEDS, 2))]

    c = static_points(warmer(0.02))
    assert c.repeatability == pytest.approx(0.02, rel=0.4)
    assert np.median(c.std / np.abs(c.force)) > 0.005
    assert not static_points(warmer(0.0)).repeatability > 0.002


def test_a_force_that_lags_moves_the_window_later_or_is_refused(rng: np.random.Generator) -> None:
    prompt, slow = (static_points([run(1e-3, lag=g, noise=0.002, rng=rng)]) for g in (0.0, 0.1))
    assert slow.windows[0].start > prompt.windows[0].start + 0.2
    assert np.abs(slow.force / law(slow.velocity) - 1).max() < 0.006
    with pytest.raises(InputError, match="does not settle"):
        static_points([run(1e-3, lag=0.6, noise=0.002, rng=rng).slice(101, 800)])


def test_a_remainder_is_taken_off_and_doubted(rng: np.random.Generator) -> None:
    """A lag of a fifth of the stroke leaves 2 e^(−4.3) = 3 % at 85 % of it; what is left after correction is small."""
    c = static_points([run(v, lag=0.2, noise=0.002, rng=rng) for v in SPEEDS[::3]], WindowSettings(unsettled=0.1))
    error = c.force / law(c.velocity) - 1
    assert np.abs(error).max() < 0.006
    assert np.abs((c.force - law(c.velocity)) / c.std).max() < 3
    assert np.median(c.std / np.abs(c.force)) > 0.001


def test_a_level_next_to_zero_is_still_a_point(rng: np.random.Generator) -> None:
    """A gas preload may cancel the damping force in one direction; the force's swing is then the scale."""
    r = run(1e-3, gas=4e3, noise=1e-3, amplitude=1e-2, rng=rng)
    c = static_points([r.with_channel("force", r["force"] - 150.0, "N")])
    assert c.n_points == 2
    assert np.allclose(c.force, law(c.velocity) - 170.0, atol=1.0)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_sine_is_refused(rng: np.random.Generator, noise: float) -> None:
    with pytest.raises(InputError, match="the speed is"):
        static_points([run(1e-3, wave="sine", noise=noise, rng=rng)])


def test_spikes_do_not_move_the_line(rng: np.random.Generator) -> None:
    r = run(1e-3, rng=rng)
    force = r["force"].copy()
    force[::37] += 3000.0
    c = static_points([r.with_channel("force", force, "N")])
    assert np.abs(c.force / law(c.velocity) - 1).max() < 0.01


def test_velocity_stands_in_for_displacement(rng: np.random.Generator) -> None:
    r = run(1e-3, noise=0.001, rng=rng)
    without = Record({"velocity": r.channel("velocity"), "force": r.channel("force")}, sample_time=r.sample_time)
    a, b = static_points([r]), static_points([without])
    assert np.allclose(a.velocity, b.velocity, rtol=2e-3)
    assert np.allclose(a.force, b.force, rtol=2e-3)


def test_windows_give_the_stiffness_and_parts_the_preload(rng: np.random.Generator) -> None:
    c = static_points([run(v, gas=10e3, noise=1e-4, amplitude=1e-2, rng=rng) for v in (1e-3, 2e-3)])
    assert np.median([w.drift for w in c.windows]) == pytest.approx(10e3, rel=0.02)
    odd, offset, std = c.parts()
    assert offset == pytest.approx(-50.0, abs=0.5) and std < 0.5
    assert np.allclose(odd.force, law(odd.speed), rtol=2e-3)


def test_reversed_polarity_is_printed_and_turned(rng: np.random.Generator) -> None:
    r = run(1e-3, rng=rng)
    r = r.with_channel("force", -r["force"], "N")
    assert "reversed polarity" in repr(static_points([r]))
    c = static_points([r], polarity=-1)
    assert "reversed polarity" not in repr(c)
    assert np.all(c.force * c.velocity > 0)


def test_every_slope_is_accounted_for(rng: np.random.Generator) -> None:
    windows = steady_windows(run(1e-3, cycles=3, rng=rng))
    assert len(windows) == 5  # and two quarter strokes at the ends
    assert [w.direction for w in windows] == [-1, 1, -1, 1, -1]
    assert all(a.stop < b.start for a, b in pairwise(windows))


def test_what_cannot_be_used_is_refused(rng: np.random.Generator) -> None:
    r = run(1e-3, rng=rng)
    one = np.ones(1)
    bare = Record({"displacement": r.channel("displacement")}, sample_time=r.sample_time)
    with pytest.raises(InputError, match="has no force"):
        static_points([bare])
    with pytest.raises(InputError, match="neither displacement nor velocity"):
        static_points([Record({"force": r.channel("force")}, sample_time=0.01)])
    with pytest.raises(InputError, match="no records"):
        static_points([])
    with pytest.raises(InputError, match="share between 0 and 1"):
        WindowSettings(centre=1.5)
    with pytest.raises(InputError, match="steady samples"):
        static_points([r], WindowSettings(reaction_time=10.0))
    with pytest.raises(InputError, match="compression only"):
        StaticCharacteristic(-one, -one, one).side(1)
    with pytest.raises(InputError, match="zero velocity"):
        StaticCharacteristic(0 * one, one, one)


def test_it_goes_to_plain_data(rng: np.random.Generator) -> None:
    c = static_points([run(1e-3, rng=rng)])
    data = c.to_dict()
    assert data["force_N"] == c.force.tolist() and data["refused"] == []
    assert "Static characteristic: 2 points from 3 of 3 slopes" in repr(c)
