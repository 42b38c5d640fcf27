"""What is assumed before the first sample of a record."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.baselines.lead_in import led_in
from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import derivative

PERIOD = 0.002


def signals(**channels: np.ndarray) -> Signals:
    return Signals(PERIOD, channels, np.arange(next(iter(channels.values())).size, dtype=float))


def sine(n: int, phase: float, hertz: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    w = 2 * np.pi * hertz
    at = w * PERIOD * np.arange(n) + phase
    return 0.01 * np.sin(at), 0.01 * w * np.cos(at)


@pytest.mark.parametrize("phase", [0.3, 1.7, 4.0])
def test_of_a_velocity_alone_it_is_the_same_motion(phase: float) -> None:
    x, v = sine(1000, phase)  # four periods of 250 samples
    both, count = led_in(signals(displacement=x, velocity=v))
    alone, other = led_in(signals(velocity=v))
    assert abs(count - 250) <= 1 and abs(other - count) <= 1
    np.testing.assert_allclose(alone["velocity"][:other], both["velocity"][count - other:count], atol=0.02 * v.max())


def test_a_record_that_begins_at_rest_is_preceded_by_rest_where_it_is() -> None:
    x, v = sine(1000, -np.pi / 2)  # from the lowest position, after a second there
    x, v = np.concatenate([np.full(500, x[0]), x]), np.concatenate([np.zeros(500), v])
    led, count = led_in(signals(displacement=x, velocity=v, acceleration=np.gradient(v, PERIOD), current=2 + 0 * v))
    assert count > 100
    np.testing.assert_array_equal(led["displacement"][:count], x[0])
    for role in ("velocity", "acceleration"):
        np.testing.assert_array_equal(led[role][:count], 0.0)
    np.testing.assert_array_equal(led["current"], 2.0)
    np.testing.assert_array_equal(led["displacement"][count:], x)


def test_a_record_that_slows_down_to_rest_is_preceded_by_no_jump_of_its_velocity() -> None:
    """A moving mass had ten times the force of the whole record at the first sample."""
    time = PERIOD * np.arange(2000)
    v = 0.05 * np.exp(-time / 0.05) + 0.1 * np.sin(2 * np.pi * time) * (time > 2)
    given = signals(displacement=PERIOD * np.cumsum(v), velocity=v)
    led, count = led_in(given)
    assert led["velocity"][0] == 0.0 and np.ptp(led["displacement"][:count // 2]) < 1e-12
    assert np.abs(np.diff(led["velocity"][:count + 1])).max() < np.abs(np.diff(v)).max()
    after = derivative(led, "velocity")[count:]
    np.testing.assert_allclose(after[20:], derivative(given, "velocity")[20:], atol=0.01 * np.abs(after).max())
    assert np.abs(after[:20]).max() < 1.5 * np.abs(np.diff(v) / PERIOD).max()


@pytest.mark.parametrize("channels", [{"road": np.sin(np.arange(100.0))}, {"velocity": np.zeros(100)},
                                      {"velocity": np.zeros(100), "displacement": np.ones(100)}], ids=str)
def test_what_does_not_move_is_as_given(channels: dict) -> None:
    given = signals(**channels)
    assert led_in(given) == (given, 0)
