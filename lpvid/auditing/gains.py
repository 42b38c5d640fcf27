"""Checks of gains that differ between the files of a data set."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.motion import relation
from lpvid.auditing.view import View

APART = 0.02
"""difference of the gain between two motion channels that counts; on clean records it is known to a thousandth"""
ALIKE = 0.02
"""by how much two motions may differ, in size and frequency, and be the same"""
CHANGED = 0.1
"""ratio of two forces under one motion, less one, that counts: warm and cold oil differ by less in one session"""
SHAPE = 0.1
"""share of a force that may not be a multiple of the other; beyond it the two differ by more than a gain"""
HARMONICS = 7
"""harmonics of a sine's force that are compared"""
MOST = 40
"""records that are compared with each other"""
PREFIX = np.sqrt(1000.0)
"""ratio of two forces that is nearer to a thousand, as between N and kN, than to one"""


def motion_gain_varies(views: Sequence[View]) -> Iterator[Finding]:
    """Velocity over the derivative of displacement, from file to file.

    Parameters
    ----------
    views : sequence of View
        Records whose velocity follows from their displacement count.

    Yields
    ------
    Finding
        ``motion-gain-varies``, a warning; its value is the largest difference of the gains.
    """
    found = [(view.name, r.gain, view.velocity) for view in views
             if (r := relation(view)) is not None and r.residual < 0.05]
    if len(found) < 2:
        return
    low, high = min(found, key=lambda f: f[1]), max(found, key=lambda f: f[1])
    if abs(high[1] - low[1]) > APART * abs(float(np.median([f[1] for f in found]))):
        yield Finding("motion-gain-varies", "", str(low[2]), "warning",
                      f"the velocity is {low[1]:.4g} ('{low[0]}') to {high[1]:.4g} ('{high[0]}') times the derivative "
                      "of the displacement: a sensor's gain or unit differs between files",
                      "correct the gain or the unit of one of them", high[1] - low[1])


def force_gain_varies(views: Sequence[View]) -> Iterator[Finding]:
    """The force of two records of one motion and one command that differs by a factor and by nothing else.

    Parameters
    ----------
    views : sequence of View
        The first `MOST` with force and motion count.

    Yields
    ------
    Finding
        ``force-gain-varies``, a warning; its value is the factor between the pair that differs most.
    """
    of_record = [(view, m) for view in views if (m := _motion(view)) is not None][:MOST]
    found = []
    for (one, a), (other, b) in combinations(of_record, 2):
        if _commanded_alike(one, other, views) and (pair := _same(a, b)) is not None:
            gain, rest = _multiple(*pair)
            if rest < SHAPE and abs(np.log(max(abs(gain), 1e-9))) > np.log1p(CHANGED):
                found.append((abs(float(np.log(abs(gain)))), gain, one.name, other.name, rest, one.force))
    if found:
        _, gain, one, other, rest, channel = max(found)
        yield Finding("force-gain-varies", "", str(channel), "warning",
                      f"under one motion the force in '{other}' is {gain:.4g} times that in '{one}', up to "
                      f"{100 * rest:.2g} % of it" + (f"; {len(found) - 1} more pair(s)" if len(found) > 1 else "")
                      + ": a gain, or another state of the specimen",
                      "check the range of the amplifier in both; correct one or do not use them together", gain)


def force_scale_varies(views: Sequence[View]) -> Iterator[Finding]:
    """A force that is a thousand times that of another record: newtons and kilonewtons under one label.

    With the ratio u of two speeds a dry force stays, a viscous one grows as u and a turbulent loss as u². What no power
    of these explains counts from `PREFIX` on.

    Parameters
    ----------
    views : sequence of View
        Records with force and motion count.

    Yields
    ------
    Finding
        ``force-scale-varies``, a warning; its value is the ratio of the two forces.
    """
    found = [(float(np.std(run[1])), float(np.std(run[0] if view.velocity else np.diff(run[0]) / view.period)), view)
             for view in views if view.period and view.force and (name := view.velocity or view.displacement)
             and (run := view.run(name, view.force, longest=20_000)) is not None]
    if not found or not min(force for force, _, _ in found) > 0:
        return
    (small, slow, one), (large, fast, other) = min(found, key=lambda f: f[0]), max(found, key=lambda f: f[0])
    if large > PREFIX * small * max(fast / max(slow, 1e-300), 1.0) ** 2:
        yield Finding("force-scale-varies", "", str(other.force), "warning",
                      f"the force varies by {large:.4g} N rms in '{other.name}' and by {small:.4g} N in '{one.name}', "
                      f"{large / small:.4g} times as much at {fast / max(slow, 1e-300):.3g} times the speed: kN "
                      "labelled N, or mV labelled V", "correct the unit of one of them", large / small)


class _Motion:
    """What a record is compared by: its motion and force, and both as harmonics where it is one sine."""

    def __init__(self, displacement: np.ndarray, force: np.ndarray, period: float) -> None:
        self.displacement, self.force = displacement - displacement.mean(), force - force.mean()
        self.frequency, self.lines = _harmonics(self.displacement, self.force, period)


def _motion(view: View) -> _Motion | None:
    name = view.displacement or view.velocity
    if name is None or view.force is None or view.period is None:
        return None
    found = view.run(name, view.force, longest=20_000)
    if found is None or not (np.ptp(found[0]) > 0 and np.ptp(found[1]) > 0):
        return None
    return _Motion(found[0], found[1], view.period)


def _harmonics(x: np.ndarray, force: np.ndarray, period: float) -> tuple[float, np.ndarray | None]:
    """Frequency [Hz] of a sine, and the amplitudes of its motion and force's harmonics from its phase on.

    None for the latter where the motion is no sine of at least four cycles.
    """
    n = x.size
    spectrum = np.abs(np.fft.rfft(x * np.hanning(n)))
    k = int(np.argmax(spectrum[1:-1])) + 1
    if k < 4:
        return 0.0, None
    low, middle, high = np.log(np.maximum(spectrum[k - 1: k + 2], 1e-300))
    frequency = (k + 0.5 * (low - high) / (low - 2 * middle + high)) / (n * period)
    middle_out = np.arange(n) - (n - 1) / 2
    for _ in range(2):  # what a small error of the frequency does, to first order: a line that turns in the course
        line = np.exp(2j * np.pi * frequency * period * middle_out)
        columns = np.column_stack([line.real, line.imag, middle_out * line.real, middle_out * line.imag])
        a, b, c, d = np.linalg.lstsq(columns, x, rcond=None)[0]
        frequency += float((b * c - a * d) / (a * a + b * b)) / (2 * np.pi * period)
    angle = 2 * np.pi * frequency * period * np.arange(n)

    def along(values: np.ndarray, count: int) -> np.ndarray:
        columns = np.column_stack([f(m * angle) for m in range(1, count + 1) for f in (np.cos, np.sin)])
        found = np.linalg.lstsq(columns, values, rcond=None)[0]
        return found[::2] - 1j * found[1::2]

    line = along(x, 1)[0]
    if np.std(x - np.real(line * np.exp(1j * angle))) > ALIKE * np.std(x):
        return frequency, None
    turned = along(force, HARMONICS) * np.exp(-1j * np.angle(line) * np.arange(1, HARMONICS + 1))
    return frequency, np.append(turned, abs(line))


def _same(a: _Motion, b: _Motion) -> tuple[np.ndarray, np.ndarray] | None:
    """The two forces where the motions are the same, as samples or as harmonics; None where they are not."""
    if a.displacement.size == b.displacement.size:
        x, y = a.displacement, b.displacement
        if np.std(x - y) < ALIKE * np.std(x):
            return a.force, b.force
    if a.lines is None or b.lines is None or abs(a.frequency - b.frequency) > ALIKE * a.frequency \
            or abs(a.lines[-1] - b.lines[-1]) > ALIKE * abs(a.lines[-1]):
        return None
    return a.lines[:-1], b.lines[:-1]


def _multiple(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """(g, share left) of b ≈ g a."""
    gain = float(np.real(np.vdot(a, b)) / np.real(np.vdot(a, a)))
    return gain, float(np.linalg.norm(b - gain * a) / max(np.linalg.norm(b), 1e-300))


def _commanded_alike(one: View, other: View, views: Sequence[View]) -> bool:
    """Whether every scheduling variable has the same mean and spread in both, of its range in the data set."""
    for name in set(one.scheduling) | set(other.scheduling):
        if name not in one.record.channels or name not in other.record.channels:
            return False
        a, b = one.finite(name), other.finite(name)
        every = [v.finite(name) for v in views if name in v.record.channels]
        span = max((float(e.max()) for e in every if e.size), default=0.0) - \
            min((float(e.min()) for e in every if e.size), default=0.0)
        if not a.size or not b.size:
            return False
        if span > 0 and max(abs(a.mean() - b.mean()), abs(a.std() - b.std())) > ALIKE * span:
            return False
    return True
