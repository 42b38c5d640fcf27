"""Checks by spectrum: noise level, rate against bandwidth, moving-average filters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View, bandwidth

_SPARE = 4.0
"""sampling rate that a bandwidth deserves, as a multiple of it."""


def noise(views: Sequence[View]) -> Iterator[Finding]:
    """Noise of each moving channel: what neighbouring samples do not share, median over the records."""
    found: dict[str, list[tuple[float, float]]] = {}
    for view in views:
        for name in view.usable:
            measured = _noise(view, name)
            if measured:
                found.setdefault(name, []).append(measured)
    for name, pairs in found.items():
        level = float(np.median([p[0] for p in pairs]))
        ratio = float(np.median([20 * np.log10(p[1] / max(p[0], 1e-12 * p[1])) for p in pairs]))
        unit = next(v.record.unit(name) for v in views if name in v.usable)
        yield Finding("noise-level", "" if len(views) > 1 else views[0].name, name,
                      "warning" if ratio < 20 else "note",
                      f"noise {level:.3g} {unit} rms, {ratio:.0f} dB below the signal",
                      "shield or filter; expect no model better than that" if ratio < 20 else "", level)


def _noise(view: View, name: str) -> tuple[float, float] | None:
    """(noise rms, signal rms) by fourth differences; None where the signal fills the band, which hides its noise."""
    if not view.moves(name) or view.few_levels(name) or name in view.scheduling:
        return None
    found = view.run(name)
    if found is None or view.period is None:
        return None
    x = found[0]
    if not np.ptp(x) > 0 or bandwidth(x, view.period) > 0.1 / view.period:
        return None
    level = float(np.median(np.abs(np.diff(x, 4))) / (0.674490 * np.sqrt(70.0)))
    return (level, float(x.std())) if level > 1e-7 * x.std() else None


def oversampled(views: Sequence[View]) -> Iterator[Finding]:
    """A rate far above what the signals fill makes neighbouring samples repeat each other."""
    widest, channel, rates = 0.0, "", []
    for view in views:
        if view.period is None:
            continue
        rates.append(1 / view.period)
        for name in view.usable:
            filled = _filled(view, name)
            if filled > widest:
                widest, channel = filled, name
    if not rates or not widest:
        return
    ratio = int(min(rates) / (_SPARE * widest))
    if ratio >= 4:
        rate = min(rates) / ratio
        yield Finding("oversampled", "" if len(views) > 1 else views[0].name, channel, "note",
                      f"99 % of the power of every channel lies below {widest:.3g} Hz (the widest: '{channel}'), "
                      f"sampled at {min(rates):.6g} Hz", f"--sample-rate {rate:.6g}", widest)


def _filled(view: View, name: str) -> float:
    """Bandwidth [Hz] of a channel, 0 for temperatures and stepped commands; of its slope for a displacement."""
    found = None if view.record.unit(name) == "K" or view.rests(name) else view.run(name)
    if found is None or view.period is None or not np.ptp(found[0]) > 0:
        return 0.0
    return bandwidth(np.diff(found[0]) if view.record.unit(name) == "m" else found[0], view.period)


def moving_average(view: View) -> Iterator[Finding]:
    """Nulls of the spectrum at every multiple of one frequency: a moving average over that period."""
    for name in view.usable:
        if name in view.scheduling or view.few_levels(name) or not view.moves(name):
            continue
        found = view.run(name)
        if found is None or view.period is None or found[0].size < 2048:
            continue
        comb = comb_length(found[0], view.period)
        if comb:
            length, depth = comb
            yield Finding("moving-average", view.name, name, "note",
                          f"the spectrum dips by {depth:.0f} dB at every multiple of {1 / (length * view.period):.4g} "
                          f"Hz: an average over {length} samples", "filter all channels alike; trust nothing above "
                          f"{0.44 / (length * view.period):.3g} Hz", float(length))


def comb_length(x: np.ndarray, period: float) -> tuple[int, float] | None:
    """(samples averaged, depth of the nulls in dB), or None; nulls against the lobes beside each."""
    from scipy.signal import welch

    size = int(min(2048, x.size // 4))
    frequency, power = welch(np.diff(x), 1 / period, window="blackmanharris", nperseg=size)
    level = 10 * np.log10(np.maximum(power, 1e-30 * power.max()))
    spacing = float(frequency[1])
    tone = float(frequency[int(np.argmax(power))])
    best: tuple[int, float] | None = None
    for length in range(3, 129):
        null = 1 / (length * period)
        reach = 0.12 * null / spacing
        if reach < 1.5 or null < 6 * tone:
            continue
        contrast = _contrast(level, null / spacing, reach)
        if contrast.size >= 3 and np.mean(contrast > 3.0) >= 0.75 and (depth := float(np.median(contrast))) > 6.0 \
                and (best is None or depth > 0.7 * best[1]):
            best = (length, max(depth, best[1] if best else 0.0))
    return best


def _contrast(level: np.ndarray, null: float, reach: float) -> np.ndarray:
    """Level of the lobes on both sides of each null minus the level at the null [dB]."""
    def around(at: float) -> float:
        return float(np.median(level[max(int(np.ceil(at - reach)), 0):int(np.floor(at + reach)) + 1]))

    count = int((level.size - 1 - reach) / null - 0.5)
    return np.array([0.5 * (around((i - 0.5) * null) + around((i + 0.5) * null)) - around(i * null)
                     for i in range(2, count + 1)])
