"""Lead-in: the motion assumed before the first sample of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import weighed_alike
from lpvid.rounding import HALF_DIGITS


def led_in(s: Signals) -> tuple[Signals, int]:
    """A record after one period of the motion, or rest, that it begins with, and how many samples precede it.

    A record that begins in mid-motion does not state how far a spring is deflected there, nor which way friction acts.
    Both follow from the motion before, which is taken as harmonic through the first displacement x_0 and velocity v_0,
    at the record's mean frequency ω = rms(v)/rms(x − x̄):

        x(−t) = x̄ + (x_0 − x̄) cos ωt − v_0/ω sin ωt,  v(−t) = v_0 cos ωt + (x_0 − x̄) ω sin ωt.

    It is exact for a record of one sine. Where the first quarter of a period is nearer to rest than to that motion, it
    is preceded by rest, and by a quarter of a period from rest to v_0, harmonic about x_0: a jump of the velocity would
    be an infinite force of a mass. The band of a motion is that of the record. Other channels have their first value.
    No measured output is used. Transients of filters end before the record begins, too. The mean and ω are of the whole
    record, so that the run along its first part alone may begin otherwise. A slow state, such as heat, gains one
    period.

    Parameters
    ----------
    s : Signals
        Of a whole record; without displacement it is the integral of the velocity.

    Returns
    -------
    signals : Signals
        As given where there is no velocity, nothing moves, or the period is shorter than two samples.
    count : int
        Samples before the record; 0 then.

    Examples
    --------
    >>> phase = 2 * np.pi * np.arange(300) / 100 + 1  # a sine of 1 Hz at 100 Hz, from mid-stroke
    >>> s = Signals(0.01, {"displacement": np.sin(phase), "velocity": 2 * np.pi * np.cos(phase)}, np.zeros(300))
    >>> led, count = led_in(s)
    >>> count, bool(np.allclose(led["velocity"][:100], s["velocity"][:100]))
    (100, True)
    """
    if not s.has("velocity"):
        return s, 0
    v = s["velocity"]
    x = s["displacement"] if s.has("displacement") else s.sample_time * np.cumsum(v - v.mean())
    swing, speed = float(x.std()), float(np.sqrt(np.mean(v**2)))
    if not swing > HALF_DIGITS * float(np.abs(x).max(initial=0.0)) or not speed > 0:
        return s, 0
    omega, offset = speed / swing, float(x[0] - x.mean())
    count = min(round(2 * np.pi * swing / speed / s.sample_time), s.n_samples) if np.isfinite(omega) else 0
    if count < 2:  # a displacement at rest, or noise of its sensor
        return s, 0
    phase = omega * s.sample_time * np.arange(-count, max(count // 4, 1))
    moved = offset * np.cos(phase) + v[0] / omega * np.sin(phase)
    speeds = v[0] * np.cos(phase) - offset * omega * np.sin(phase)
    after = v[:phase.size - count]
    if np.sum((after - speeds[count:]) ** 2) > np.sum(after**2):
        quarter = np.maximum(phase, -np.pi / 2)
        moved, speeds = offset + v[0] / omega * np.sin(quarter), v[0] * np.cos(quarter) * (phase > -np.pi / 2)
    before = {"displacement": x[0] - offset + moved[:count], "velocity": speeds[:count],
              "acceleration": np.gradient(speeds, s.sample_time)[:count]}

    def led(values: np.ndarray, role: str = "") -> np.ndarray:
        return np.concatenate([before.get(role, np.full(count, values[0])), values])

    found = replace(s, channels={r: led(c, r) for r, c in s.channels.items()}, output=led(s.output), cache={}, facts={},
                    record=None, at=None, coarse=None, peers=(), repeats=None)
    return weighed_alike(found, s), count
