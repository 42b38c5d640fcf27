"""Checks of velocity against the derivative of displacement: scale, delay, one-sided filters; its size without one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.spectrum import POOR
from lpvid.auditing.view import View
from lpvid.condition import delay
from lpvid.condition.bandwidth import bandwidth
from lpvid.condition.interference import interference, of_motion, power_of
from lpvid.condition.resampling import interpolate
from lpvid.condition.tables import NO_TIME_UNIT

_STENCIL = -np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""central difference of eighth order, for np.convolve: within 1 % up to 0.28 of the sampling rate."""
FAR, APART = 0.3, 0.05
"""shares of the velocity that are not the derivative of the displacement beyond which the two are different motions,
and from which on it is worth a line: the measured records of `tests/lpvid/auditing` have 0.016 at most"""

SOUND = 343.0
"""speed of sound in air at 20 °C [m/s]: no rod in a room moves faster."""


@dataclass(frozen=True)
class Relation:
    """velocity(t) ≈ gain·ẋ(t − delay): gain, delay [samples], residual over rms, busiest frequency [Hz].

    Attributes
    ----------
    gain : float
        1 for velocity and displacement in matching units; negative for opposite signs.
    delay : float
        Positive where the velocity lags [samples].
    residual : float
        rms of what is not explained, as a share of the velocity's.
    busy : float
        Frequency below which half of the velocity's power lies [Hz].
    """

    gain: float
    delay: float
    residual: float
    busy: float

    @property
    def half_sample(self) -> bool:
        """True when the velocity is a one-sided difference of the displacement."""
        return abs(abs(self.delay) - 0.5) < 0.03 and self.residual < 0.05


def hum(view: View) -> Iterator[Finding]:
    """Interference in a displacement without a velocity: small beside the stroke, and fast when it is differentiated.

    Parameters
    ----------
    view : View

    Yields
    ------
    Finding
        ``interference`` where its velocity is more than `APART` of that of the motion, a note, a warning from the noise
        on that is one (`lpvid.auditing.spectrum.POOR`); its value is that share.
    """
    if view.velocity is not None or not (view.displacement and view.force) or view.period is None:
        return
    found = view.run(view.displacement, view.force)
    if found is None:
        return
    from scipy.signal import detrend

    moved, force = found
    _, power, noise = power_of(moved, view.period)
    frequency, interfering = interference(moved, force, view.period)
    if not interfering.any():
        return
    fine = np.fft.rfftfreq(moved.size, view.period)
    fast = np.abs(2 * np.pi * fine * np.fft.rfft(detrend(moved) * np.hanning(moved.size))) ** 2
    of_hum = np.interp(fine, frequency, interfering.astype(float)) >= 0.5
    moves = np.interp(fine, frequency, of_motion(power, noise)) > 0.5
    share = float(np.sqrt(fast[of_hum].sum() / max(fast[moves & ~of_hum].sum(), 1e-300)))
    if share > APART:
        size = float(np.sqrt(power[interfering].sum() * frequency[1]))
        at = f"{fine[np.argmax(np.where(of_hum, fast, 0.0))]:.0f}"
        yield Finding("interference", view.name, view.displacement, "warning" if share > POOR else "note",
                      f"{size:.2g} m rms, most of it about {at} Hz, in which the force does not follow, as hum of the "
                      f"mains: differentiated, {share:.0%} of the motion's velocity",
                      "shield the sensor or record the velocity; fit and diagnose leave it out of the velocity that "
                      "they derive, identify does not", share)


def velocity_against_displacement(view: View) -> Iterator[Finding]:
    """Scale, delay and mismatch between the velocity channel and the slope of the displacement channel.

    Parameters
    ----------
    view : View
        One record; without velocity or displacement nothing is found.

    Yields
    ------
    Finding
        Mismatch, ``velocity-sign``, ``velocity-scale``, a delay or a one-sided filter; value of the first two the
        gain.
    """
    pair = _pair(view)
    if pair is None or view.period is None or view.velocity is None:
        return
    slope, velocity = pair
    found = relation(view)
    at = (view.name, view.velocity)
    if found is None or found.residual > FAR:
        yield _mismatch(view, found)
        return
    if found.residual > APART:
        yield _mismatch(view, found)
    filtered = [] if found.half_sample else list(_one_sided(view, slope, velocity))
    if found.gain < 0:
        yield Finding("velocity-sign", *at, "warning", f"the velocity is {found.gain:.3g} times the derivative of "
                      f"'{view.displacement}'", f"--flip {view.velocity}", found.gain)
    elif abs(found.gain - 1) > 0.05 and not filtered:
        clock = any(note.endswith(NO_TIME_UNIT) for note in view.record.notes)
        yield Finding("velocity-scale", *at, "warning", f"the velocity is {found.gain:.4g} times the derivative of "
                      f"'{view.displacement}'" + (", and the time column states no unit" if clock else ""),
                      "correct the unit or the sensor's gain" + (": of the time, e.g. 'time [ms]', or of a channel"
                                                                 if clock else ""), found.gain)
    yield from _delayed(view, found)
    yield from filtered


def magnitude(views: Sequence[View]) -> Iterator[Finding]:
    """How far and how fast a displacement moves where no velocity channel confirms its unit.

    Millimetres read as metres change nothing else in such a record: any law fits them with other numbers. What they
    mean is put to the reader as a question; beyond the speed of sound it is none.

    Parameters
    ----------
    views : sequence of View

    Returns
    -------
    iterator of Finding
        At most one.
    """
    ranges, speeds = [], []
    for one in views:
        if one.displacement and one.force and not one.velocity and one.stroke is not None \
                and one.record.unit(one.displacement) in ("", "m"):
            x, v, _ = one.stroke
            ranges.append((float(np.ptp(x)), one.name, one.displacement))
            speeds.append(float(np.abs(v).max()))
    if not ranges:
        return
    (stroke, name, channel), speed = max(ranges), max(speeds)
    where = f" ('{name}')" if len(ranges) > 1 else ""
    impossible = speed > SOUND
    yield Finding("displacement-unit" if impossible else "displacement-range", "", channel,
                  "warning" if impossible else "note",
                  f"it moves over {stroke:.3g} m{where}, at up to {speed:.3g} m/s"
                  + (f", faster than sound in air ({SOUND:g} m/s)" if impossible else
                     "; without a velocity channel nothing in the data confirms its unit: is that the rig's stroke?"),
                  "state the unit in the header, e.g. 'displacement [mm]', or --role 'displacement=CHANNEL [mm]'"
                  if impossible else "", stroke)


def relation(view: View) -> Relation | None:
    """How the velocity of a record follows from its displacement; None where one of them is missing or at rest.

    Parameters
    ----------
    view : View
        One record; the answer is kept in its `known`.

    Returns
    -------
    Relation or None
    """
    if "relation" not in view.known:
        pair = _pair(view)
        view.known["relation"] = None if pair is None or view.period is None else _relate(*pair, view.period)
    return view.known["relation"]


def _mismatch(view: View, relation: Relation | None) -> Finding:
    """How much of the velocity is not the derivative of the displacement, and what gain and lag leave least."""
    assert view.period is not None and view.velocity is not None
    left = 1.0 if relation is None else relation.residual
    best = "" if relation is None else (f" at the best gain {relation.gain:.3g} and lag "
                                        f"{1e3 * relation.delay * view.period:+.3g} ms")
    return Finding("velocity-mismatch", view.name, view.velocity, "warning" if left > FAR else "note",
                   f"{100 * left:.3g} % rms of the velocity is not the derivative of '{view.displacement}'{best}",
                   "check which sensors these are; derive the velocity from the displacement", left)


def _pair(view: View) -> tuple[np.ndarray, np.ndarray] | None:
    if not view.displacement or view.velocity in (None, view.displacement) or view.period is None:
        return None
    found = view.run(view.displacement, view.velocity)
    if found is None or not np.ptp(found[0]) > 0 or not np.ptp(found[1]) > 0:
        return None
    reach = _STENCIL.size // 2
    return np.convolve(found[0], _STENCIL, mode="valid") / view.period, found[1][reach:-reach]


def _relate(slope: np.ndarray, velocity: np.ndarray, period: float) -> Relation | None:
    reach = min(max(8, round(0.05 / period)), slope.size // 5)
    if reach < 3:
        return None
    slope, velocity = _quiet(slope, velocity, period)
    late = delay(slope, velocity, period, reach * period) / period
    rows = np.arange(reach + 2, slope.size - reach - 2)
    moved = interpolate(slope[:, None], np.clip(rows - late, 0, slope.size - 1))[:, 0]
    moved -= moved.mean()
    target = velocity[rows] - velocity[rows].mean()
    gain = float(moved @ target / (moved @ moved))
    residual = float(np.std(target - gain * moved) / np.std(target))
    return Relation(gain, late, residual, bandwidth(velocity, period, 0.5))


def _quiet(slope: np.ndarray, velocity: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Both without what lies far above the motion's own band: noise would make the gain look small."""
    from scipy.signal import butter, sosfiltfilt

    cutoff = 2.5 * bandwidth(velocity, period, 0.95)
    if not 0 < cutoff < 0.3 / period:
        return slope, velocity
    sections = butter(4, cutoff, fs=1 / period, output="sos")
    return np.asarray(sosfiltfilt(sections, slope)), np.asarray(sosfiltfilt(sections, velocity))


def _delayed(view: View, relation: Relation) -> Iterator[Finding]:
    assert view.period is not None and view.velocity is not None
    seconds = relation.delay * view.period
    phase = 360 * seconds * relation.busy
    half = relation.half_sample
    if abs(relation.delay) < 0.2 or (abs(phase) < 0.05 and not half):
        return
    kind = "late" if seconds > 0 else "early"
    cause = (f"; half a sample: a {'backward' if seconds > 0 else 'forward'} difference of '{view.displacement}'"
             if half else "")
    name = "one-sided-difference" if half else "velocity-delay"
    severity = "warning" if abs(phase) > 2.0 and not half else "note"
    yield Finding(name, view.name, view.velocity, severity,
                  f"the velocity comes {1e3 * abs(seconds):.3g} ms {kind} against the derivative of "
                  f"'{view.displacement}' ({abs(phase):.2g}° at {relation.busy:.3g} Hz){cause}",
                  f"align it by {1e3 * seconds:+.3g} ms or derive the velocity by central differences", seconds)


def _one_sided(view: View, slope: np.ndarray, velocity: np.ndarray) -> Iterator[Finding]:
    """A gain that falls towards high frequency while the phase lags as a causal low-pass does."""
    assert view.period is not None and view.velocity is not None
    response = _response(slope, velocity, view.period)
    if response is None:
        return
    frequency, h = response
    low = np.median(np.abs(h[: max(h.size // 8, 1)]))
    if not low > 0:
        return
    ratio, phase = np.abs(h) / low, np.unwrap(np.angle(h * np.sign(np.median(np.real(h[: max(h.size // 8, 1)])))))
    # a low-pass of order n, Butterworth: the fall of gain 1/|H|² − 1 = (f/fc)^2n gives fc, the lag must agree
    drop, lag = 1 / np.maximum(ratio, 1e-3) ** 2 - 1, -phase
    upper = frequency > 0.75 * frequency[-1]
    sign = 1.0 if np.median(drop[upper]) > 0 else -1.0
    if sign < 0:  # the displacement is the filtered one: look at the inverse
        drop, lag = ratio**2 - 1, phase
    fell, lagged = float(np.median(drop[upper])), float(np.median(lag[upper]))
    if fell < 0.15 or lagged < 0.15:
        return
    cutoff, order = _cutoff(frequency, drop, lag, upper)
    channel = view.velocity if sign > 0 else str(view.displacement)
    yield Finding("one-sided-filter", view.name, channel, "warning",
                  f"gain down by {10 * np.log10(1 + fell):.2g} dB and phase late by {np.degrees(lagged):.3g}° at "
                  f"{np.median(frequency[upper]):.3g} Hz against the other motion channel: a causal low-pass of order "
                  f"{order} near {cutoff:.3g} Hz on this one alone", "filter all channels alike, or without phase",
                  cutoff)


def _cutoff(frequency: np.ndarray, drop: np.ndarray, lag: np.ndarray, upper: np.ndarray) -> tuple[float, int]:
    """(cut-off [Hz], order 1 or 2) that explains the fall of gain, and of the two the one that explains the lag."""
    found = []
    for order in (1, 2):
        cutoff = float(np.median(frequency[upper] / np.maximum(drop[upper], 1e-9) ** (0.5 / order)))
        r = frequency / cutoff
        expected = np.arctan(r) if order == 1 else np.arctan2(np.sqrt(2) * r, 1 - r**2)
        found.append((float(np.median(np.abs(expected - lag))), cutoff, order))
    return min(found)[1:]


def _response(slope: np.ndarray, velocity: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray] | None:
    """(frequency, velocity over ẋ) where both are coherent."""
    from scipy.signal import coherence, csd, welch

    size = int(min(1024, slope.size // 8))
    if size < 64:
        return None
    frequency, cross = csd(slope, velocity, 1 / period, nperseg=size)
    power = welch(slope, 1 / period, nperseg=size)[1]
    with np.errstate(divide="ignore", invalid="ignore"):  # a bin without any power is not coherent: NaN > 0.9 is False
        alike = coherence(slope, velocity, 1 / period, nperseg=size)[1]
    keep = (alike > 0.9) & (frequency > 0) & (frequency < 0.25 / period) & (power > 1e-5 * power.max())
    if keep.sum() < 16 or frequency[keep].max() < 4 * frequency[keep].min():
        return None
    return frequency[keep], cross[keep] / power[keep]
