"""Bandwidth of a channel, and the sampling rate that the channels of records call for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.record import Record

PASSED = 0.8
"""share of half the sample rate that an anti-alias filter leaves"""
SPARE = 4.0
"""sampling rate that a bandwidth calls for, as a multiple of it: an anti-alias filter leaves 1.6 times the band"""
LONGEST = 200_000
"""samples that are looked at, at most"""
COMMANDS = ("A", "V", "K")
"""units of channels that do not count: commands, whose jumps fill any band, and temperatures"""
SHORTEST = 64
"""samples below which a record gives no information on its band"""


def band(values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """(frequency [Hz], power spectral density) by Welch's method, mean removed.

    Parameters
    ----------
    values : (n,) array
        Finite.
    period : float
        Sampling period [s].

    Returns
    -------
    (f,) array
        [Hz].
    (f,) array
        [squared unit of the values per Hz].
    """
    from scipy.signal import welch

    size = min(4096, max(values.size // 4, 32))
    frequency, power = welch(values - values.mean(), 1 / period, nperseg=size)
    return frequency, power


def bandwidth(values: np.ndarray, period: float, share: float = 0.99, slope: bool = False,
              quiet: bool = False) -> float:
    """Frequency [Hz] below which `share` of the power lies.

    With `slope`, of the derivative's power; with that or `quiet`, less twice the noise floor seen in the top fifth of
    the band, which differentiating would blow up and which fills the band at any rate.

    Parameters
    ----------
    values : (n,) array
        Finite.
    period : float
        Sampling period [s].
    share : float
        Between 0 and 1.
    slope : bool
        Whether the derivative's power counts.
    quiet : bool
        Whether the noise floor is taken off.

    Returns
    -------
    float
        Half the sampling rate where no power is left.
    """
    frequency, power = band(values, period)
    if slope or quiet:
        floor = float(np.median(power[-max(power.size // 5, 1):]))
        power = np.maximum(power - 2 * floor, 0.0) * (frequency**2 if slope else 1.0)
    total = np.cumsum(power)
    if not total[-1] > 0:
        return float(frequency[-1])
    return float(frequency[min(int(np.searchsorted(total, share * total[-1])), frequency.size - 1)])


def widest_band(records: Sequence[Record]) -> float:
    """Bandwidth [Hz] of what moves in records, the widest: a displacement by its slope unless a velocity is there.

    Channels in units of `COMMANDS` do not count; 0 where nothing does.

    Parameters
    ----------
    records : sequence of Record

    Returns
    -------
    float
    """
    return max((_filled(record, name) for record in records for name in record.channels), default=0.0)


def _filled(record: Record, name: str) -> float:
    channel, period = record.channel(name), record.time_base.period
    by_slope = channel.unit == "m"
    if channel.fault or not channel.unit_known or channel.unit in COMMANDS or not period > 0 or (
            by_slope and record.has("velocity")):
        return 0.0
    values = channel.values[:LONGEST]
    values = values[np.isfinite(values)]
    if values.size < SHORTEST or not np.ptp(values) > 0:
        return 0.0
    return bandwidth(values, period, slope=by_slope, quiet=True)
