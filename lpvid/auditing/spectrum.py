"""Checks by spectrum: noise level, rate against bandwidth, moving-average filters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.condition.bandwidth import SPARE, band, bandwidth
from lpvid.condition.preparing import WANTED

POOR = 0.1
"""rms of noise over that of a signal, from which on it is a warning (20 dB)"""
CHANCE = 0.01
"""probability that unrelated signals pass for coherent anywhere in their spectrum"""
_BROADBAND = 6.0
"""signal over floor [dB] below which a flat floor cannot be separated from a broadband signal."""


def noise(views: Sequence[View]) -> Iterator[Finding]:
    """Noise of each moving channel: the floor of its spectrum spread over the whole band, median over the records.

    Parameters
    ----------
    views : sequence of View
        The data set.

    Yields
    ------
    Finding
        ``noise-level`` by channel, a warning from a tenth of the signal's rms on, else a note; its value is the noise's
        rms in the unit of the channel. "At most" where the floor slopes, or would be a warning and could be the force's
        overtones (`folded`).
    """
    found: dict[str, list[tuple[float, float, bool]]] = {}
    for view in views:
        for name in view.usable:
            measured = _noise(view, name)
            if measured:
                level, rms, flat = measured
                sure = level < POOR * rms or level > rms * folded(view, name)  # what calls for a warning must be noise
                found.setdefault(name, []).append((level, rms, flat and sure))
    for name, rows in found.items():
        level = float(np.median([row[0] for row in rows]))
        ratio = float(np.median([20 * np.log10(row[1] / row[0]) for row in rows]))
        unit = next(v.record.unit(name) for v in views if name in v.usable)
        about = "noise" if np.mean([row[2] for row in rows]) > 0.5 else "noise at most"
        if ratio < _BROADBAND:
            continue  # a signal that fills the band: its floor may be the signal itself
        poor = ratio < -20 * np.log10(POOR) and about == "noise"
        mend = "shield or filter; expect no model better than that" if poor else ""
        if ratio < -20 * np.log10(POOR) and not poor:
            mend = "record faster to decide: it may as well be noise, or the folded overtones of a force that turns " \
                   "over with the motion"
        yield Finding("noise-level", "" if len(views) > 1 else views[0].name, name, "warning" if poor else "note",
                      f"{about} {level:.3g} {unit} rms, {ratio:.0f} dB below the signal",
                      mend, level)


def folded(view: View, name: str) -> float:
    """How much of a force above half the sampling rate its own overtones can be: rms over that of the force.

    The hardest law turns the force over with the motion: a square wave, whose overtone 2j + 1 has 8/(π²(2j + 1)²) of
    its power. Above N times the frequency f of the motion stands 8/π² Σ 1/(2j + 1)² ≈ 4/(π² N) of it, and N = 1/(2 T f)
    is half the sampling rate: folded back, it looks like a floor of noise.

    Parameters
    ----------
    view : View
    name : str
        Channel; 0 for all but the force.

    Returns
    -------
    float
    """
    if name != view.force or view.stroke is None or view.period is None:
        return 0.0
    moves = bandwidth(view.stroke[1], view.period)
    return float(np.sqrt(8 / np.pi**2 * view.period * moves))


def _noise(view: View, name: str) -> tuple[float, float, bool] | None:
    """(noise rms, signal rms, whether the floor is flat); None where the signal fills the band, which hides it."""
    if not view.moves(name) or view.few_levels(name) or name in view.scheduling:
        return None
    found = view.run(name)
    if found is None or view.period is None or not np.ptp(found[0]) > 0:
        return None
    frequency, power = band(found[0], view.period)
    n = frequency.size
    inner, outer = (float(np.median(power[int(a * n):int(b * n)])) for a, b in ((0.7, 0.84), (0.84, 0.98)))
    floor, rms = min(inner, outer), float(found[0].std())
    if not floor > 1e-14 * rms**2 * view.period or power.max() < 100 * max(inner, outer):
        return None
    return float(np.sqrt(floor * 0.5 / view.period)), rms, max(inner, outer) < 2 * floor


def oversampled(views: Sequence[View]) -> Iterator[Finding]:
    """A rate far above what the signals fill makes neighbouring samples repeat each other.

    Parameters
    ----------
    views : sequence of View
        Records without a steady clock are left out.

    Yields
    ------
    Finding
        ``oversampled`` from a factor of 4 on, a note; its value is the widest band [Hz], of what is in the channels
        or of what the force answers of the motion. Where a current or another scheduling variable steps, the rate it
        names is not below `WANTED`: the force's lag behind a step, of a few ms, has little power in any channel.
    """
    widest, channel, answered, rates = 0.0, "", False, list[float]()
    for view in views:
        if view.period is None:
            continue
        rates.append(1 / view.period)
        for name in view.usable:
            filled = _filled(view, name)
            if filled > widest:
                widest, channel, answered = filled, name, False
        if (reach := follows(view)) > widest:
            widest, channel, answered = reach, view.force or "", True
    if not rates or not widest:
        return
    ratio = int(min(rates) / (SPARE * widest))
    steps = any(view.moves(name) and view.rests(name) for view in views for name in view.scheduling
                if name in view.usable and view.record.unit(name) != "K")
    if steps:
        ratio = min(ratio, int(min(rates) / WANTED))
    if ratio >= 4:
        rate = min(rates) / ratio
        lies = f"99 % of the power of every channel lies below {widest:.3g} Hz (the widest: '{channel}')"
        if answered:
            lies = f"'{channel}' follows the motion up to {widest:.3g} Hz"
        if steps:
            lies += ", its lag behind the steps of the current not counted"
        yield Finding("oversampled", "" if len(views) > 1 else views[0].name, channel, "note",
                      f"{lies}, sampled at {min(rates):.6g} Hz", f"--sample-rate {rate:.6g}", widest)


def follows(view: View) -> float:
    """Frequency [Hz] up to which the force follows the motion, at least; 0 where it follows nowhere.

    A slow motion may have 99 % of its power, and of the force's, in a small part of the band in which it excites the
    force. There the two are coherent: over K independent segments the coherence of unrelated signals exceeds
    1 − a^(1/(K − 1)) with probability a (Carter 1987), and of the whole spectrum with `CHANCE`. Of segments with a
    Hann window that overlap by half, 0.53 of their number are independent; fewer than three give no estimate. The
    frequencies count from the lowest one that follows to the first that does not: hum in both sensors stands apart
    from them.

    What the window leaks of a strong line is coherent too, up to any frequency where there is little noise. So the band
    ends with the last of these frequencies at which the motion has power of its own: above what all others leak there
    and above the floor at the top of the spectrum. A line is seen up to one bin beyond the bin nearest to it, hence
    1.5 bins are taken off.

    Parameters
    ----------
    view : View
        One record.

    Returns
    -------
    float
    """
    if view.stroke is None or view.period is None:
        return 0.0
    from scipy.signal import coherence, welch

    _, velocity, force = view.stroke
    size = min(1024, max(velocity.size // 16, 16))
    independent = 0.53 * (2 * velocity.size / size - 1)
    if independent < 3:
        return 0.0
    frequency, shared = coherence(velocity, force, 1 / view.period, nperseg=size)
    power = welch(velocity, 1 / view.period, nperseg=size)[1]
    above = shared[1:] > 1 - (CHANCE / shared[1:].size) ** (1 / (independent - 1))
    if not above.any():
        return 0.0
    first = int(np.argmax(above))
    last = above.size if above[first:].all() else first + int(np.argmin(above[first:]))
    own = power > np.maximum(_leaked(power, size), _floor(power, independent))
    seen = np.flatnonzero(own[1 + first:1 + last])
    return max(first + int(seen[-1]) - 0.5, 0.0) * float(frequency[1]) if seen.size else 0.0


def _leaked(power: np.ndarray, size: int) -> np.ndarray:
    """(f,) the most that a Hann window of `size` samples leaks into each bin from all others but its two neighbours.

    A line at most half a bin beside bin j, which has the amplitude a there, has a |W(d + δ)| / |W(δ)| in the bin d
    further on, W the window's transform and |δ| ≤ 1/2. The amplitudes of all bins are added, on the circle of the
    frequencies of a sampled signal, negative ones among them.
    """
    from scipy.signal import get_window

    fine = 16
    shape = np.abs(np.fft.fft(get_window("hann", size), fine * size))
    offset = np.arange(-fine // 2, fine // 2 + 1)
    spread = (shape[(fine * np.arange(size)[:, None] + offset) % shape.size] / shape[np.abs(offset)]).max(axis=1)
    spread[[0, 1, -1]] = 0.0
    both = np.minimum(np.arange(size), size - np.arange(size))
    amplitude = np.fft.ifft(np.fft.fft(np.sqrt(power[both])) * np.fft.fft(spread)).real
    return amplitude[:power.size] ** 2


def _floor(power: np.ndarray, independent: float) -> float:
    """Power that no bin of white noise exceeds, but with `CHANCE`: its level is the median of the top fifth.

    The mean over K segments of the power of noise has a chi-square distribution of 2K degrees of freedom.
    """
    from scipy.stats import chi2

    level = float(np.median(power[-max(power.size // 5, 1):]))
    return level * float(chi2.isf(CHANCE / power.size, 2 * independent)) / (2 * independent)


def _filled(view: View, name: str) -> float:
    """Bandwidth [Hz] of a channel, 0 for temperatures and stepped commands; a displacement counts by its slope,
    unless the velocity was measured."""
    known = view.velocity is not None and name == view.displacement
    found = None if known or view.record.unit(name) == "K" or view.rests(name) else view.run(name)
    if found is None or view.period is None or not np.ptp(found[0]) > 0:
        return 0.0
    return bandwidth(found[0], view.period, slope=view.record.unit(name) == "m")


def moving_average(view: View) -> Iterator[Finding]:
    """Nulls of the spectrum at every multiple of one frequency: a moving average over that period.

    Parameters
    ----------
    view : View
        One record; runs below 2048 samples are left out.

    Yields
    ------
    Finding
        ``moving-average`` by channel, a note; its value is the number of samples averaged. None where the nulls lie on
        the even overtones of the motion: a force that is alike in both directions lacks these.
    """
    motion = _line(view)
    for name in view.usable:
        if name in view.scheduling or view.few_levels(name) or not view.moves(name):
            continue
        found = view.run(name)
        if found is None or view.period is None or found[0].size < 2048:
            continue
        comb = _comb_length(found[0], view.period, motion)
        if comb:
            length, depth = comb
            yield Finding("moving-average", view.name, name, "note",
                          f"the spectrum dips by {depth:.0f} dB at every multiple of {1 / (length * view.period):.4g} "
                          f"Hz: an average over {length} samples", "filter all channels alike; trust nothing above "
                          f"{0.44 / (length * view.period):.3g} Hz", float(length))


def _line(view: View) -> float | None:
    """Frequency [Hz] of a motion that is one sine, of which a line holds half of the power; else None."""
    if view.stroke is None or view.period is None or view.stroke[1].size < 2048:
        return None
    frequency, _, line = _lines(view.stroke[1], view.period)
    return line * float(frequency[1]) if line is not None else None


def _lines(x: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, float | None]:
    """(frequency [Hz], power spectrum, bin of the line that holds half of the power, to a part of a bin, or None)."""
    from scipy.signal import welch

    frequency, power = welch(x, 1 / period, window="blackmanharris", nperseg=int(min(2048, x.size // 4)))
    top = int(np.argmax(power))
    around = slice(max(top - 4, 0), top + 5)
    share = power[around]
    tonal = share.sum() > 0.5 * power.sum()
    return frequency, power, float(share @ np.arange(power.size)[around] / share.sum()) if tonal else None


def _comb_length(x: np.ndarray, period: float, motion: float | None) -> tuple[int, float] | None:
    """(samples averaged, depth of the nulls in dB), or None; nulls against the lobes beside each."""
    frequency, power, line = _lines(np.diff(x), period)
    level = 10 * np.log10(np.maximum(power, 1e-30 * power.max()))
    spacing = float(frequency[1])
    # overtones of a sine must not pass for lobes: look well above it only
    lowest = 0.0 if line is None else 6 * spacing * line
    best: tuple[int, float] | None = None
    for length in range(3, 257):
        null = 1 / (length * period)
        reach = 0.12 * null / spacing
        if reach < 1.0 or null < lowest or (motion and abs(null - 2 * motion * round(null / (2 * motion))) < spacing):
            continue
        contrast = _contrast(level, null / spacing, reach)
        if contrast.size >= 3 and np.mean(contrast > 3.0) >= 0.75 and (depth := float(np.median(contrast))) > 6.0 \
                and (best is None or depth > 0.7 * best[1]):
            best = (length, max(depth, best[1] if best else 0.0))
    return best


def _contrast(level: np.ndarray, null: float, reach: float) -> np.ndarray:
    """Level of the lobes on both sides of each null minus the level at the null [dB]."""
    sums = np.cumsum(np.insert(level, 0, 0.0))

    def around(at: np.ndarray) -> np.ndarray:
        first = np.maximum(np.ceil(at - reach), 0).astype(int)
        last = np.floor(at + reach).astype(int) + 1
        return (sums[last] - sums[first]) / (last - first)

    count = int((level.size - 1 - reach) / null - 0.5)
    at = null * np.arange(2, count + 1)
    return 0.5 * (around(at - 0.5 * null) + around(at + 0.5 * null)) - around(at)
