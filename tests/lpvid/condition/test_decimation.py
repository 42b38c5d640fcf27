"""The rate to which fast records are decimated: about 500 Hz, and no less than their bandwidth calls for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lpvid.condition.bandwidth import widest_band
from lpvid.condition.preparing import decimation
from lpvid.files import read
from lpvid.record import Record

RATE, N = 3000.0, 12_000


def tones(highest: float, noise: float = 0.0, command: bool = False) -> Record:
    """A force of twenty tones of one size up to a frequency [Hz], with noise, and a current that jumps."""
    rng, t = np.random.default_rng(0), np.arange(N) / RATE
    force = sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(np.linspace(1.0, highest, 20), rng.uniform(0, 6, 20),
                                                              strict=True)) + noise * rng.normal(size=N)
    channels = {"force": np.asarray(force)}
    if command:
        channels["current"] = np.repeat(rng.integers(0, 2, N // 100), 100).astype(float)
    return Record(channels, sample_time=1 / RATE, units={"force": "N", "current": "A"} if command else {"force": "N"})


@pytest.mark.parametrize(("highest", "factor"), [(20.0, 6), (100.0, 6), (150.0, 5), (200.0, 3), (350.0, 2), (900.0, 1)])
def test_by_the_highest_tone(highest: float, factor: int) -> None:
    """Four times the band, by a whole number; where that leaves nothing to decimate, the records' own rate."""
    rate, notes = decimation([tones(highest)])
    assert rate == (None if factor == 1 else pytest.approx(RATE / factor))
    assert not notes or ("99 % of what moves" in notes[0]) == (factor < 6)


def test_neither_noise_nor_a_command_that_jumps_counts() -> None:
    assert decimation([tones(40.0, noise=2.0, command=True)])[0] == pytest.approx(500.0)
    assert widest_band([tones(40.0, noise=2.0, command=True)]) == pytest.approx(40.0, abs=4.0)


@pytest.mark.parametrize(("group", "rate"), [("silverbox", 2441.41 / 3), ("bouc_wen", 750.0),
                                             ("mr_damper_random", 3004.8 / 6)])
def test_of_measured_records(shared_data: Path, group: str, rate: float) -> None:
    """Two benchmarks whose bands end at 260 and 155 Hz keep them; a damper recorded at 3 kHz has nothing above 125."""
    assert decimation(read(shared_data / group))[0] == pytest.approx(rate, rel=1e-4)
