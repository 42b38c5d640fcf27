"""Localise: the regimes of the inputs, of time and of frequency with most of the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lpvid.codec import Encoded
from lpvid.diagnosis.budgets import LISTED
from lpvid.diagnosis.problem import DiagnosisProblem

BANDS = (0.0, 1.0, 5.0, 15.0, 50.0, np.inf)
"""edges of the frequency bands [Hz]"""
NOTABLE = 1.5
"""least ratio of a regime's share of the squared error to its share of the time at which it is listed"""


@dataclass(frozen=True)
class ErrorRegime(Encoded):
    """A regime whose share of the error exceeds its share of the time.

    Attributes
    ----------
    where : str
        E.g. ``"velocity < 0"``.
    share : float
        Of the squared error.
    time : float
        Of the samples.
    """

    where: str
    share: float
    time: float


def localise(problem: DiagnosisProblem, errors: Sequence[np.ndarray]) -> tuple[ErrorRegime, ...]:
    """Shares of the squared error by sign and size of each input, by time, after reversals, by frequency; worst first.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Free-run errors, per record.

    Returns
    -------
    tuple of ErrorRegime
        At most `LISTED` regimes; the share of the frequency bands is that of the error's power.
    """
    squared = problem.stack([e**2 for e in errors])
    total = float(squared.sum())
    if not total > 0:
        return ()
    regimes: list[tuple[str, np.ndarray]] = []
    for name in dict.fromkeys(k for s in problem.signals for k in s.channels):
        if all(s.has(name) for s in problem.signals):
            regimes += _regimes(name, problem.stack([s[name] for s in problem.signals]))
    if all(s.has("velocity") for s in problem.signals):
        regimes.append(("after a reversal", problem.stack([_after_reversal(s["velocity"]).astype(float)
                                                            for s in problem.signals]) > 0.5))
    if all(s.has("current") for s in problem.signals):
        rate = problem.stack([np.gradient(s["current"], s.sample_time) for s in problem.signals])
        if np.ptp(rate) > 0:
            regimes.append(("after a change of current", np.abs(rate) > 0.1 * np.abs(rate).max()))
    place = np.concatenate([np.linspace(0, 1, n.size)[n >= 0] for n in problem.blocks.number])
    regimes += [("first third of the time", place < 1 / 3), ("last third of the time", place > 2 / 3)]
    found = [ErrorRegime(where, float(squared[inside].sum()) / total, float(inside.mean()))
             for where, inside in regimes if 0 < inside.mean() < 1]
    found += _bands(problem, errors)
    notable = [w for w in found if w.share > max(NOTABLE * w.time, 0.05) or (w.share > 0.65 and w.time < 0.55)]
    return tuple(sorted(notable, key=lambda w: w.time - w.share)[:LISTED])


def _regimes(name: str, x: np.ndarray) -> list[tuple[str, np.ndarray]]:
    found: list[tuple[str, np.ndarray]] = []
    if x.min() < 0 < x.max():
        found += [(f"{name} < 0", x < 0), (f"{name} > 0", x > 0)]
    size = np.abs(x)
    low, high = np.quantile(size, [0.25, 0.75])
    if high > low:
        found += [(f"small |{name}|", size <= low), (f"large |{name}|", size >= high)]
    return found


def _after_reversal(velocity: np.ndarray) -> np.ndarray:
    """Samples within the eighth of a half stroke that follows a change of sign; none where the sign never changes.

    Examples
    --------
    >>> _after_reversal(np.repeat([1.0, -1.0], 8)).nonzero()[0].tolist(), bool(_after_reversal(np.ones(8)).any())
    ([8], False)
    """
    sign = np.sign(velocity)
    turns = np.flatnonzero(np.diff(sign) != 0) + 1
    out = np.zeros(velocity.size, dtype=bool)
    ends = np.append(turns, velocity.size)[1:]
    for a, b in zip(turns, ends, strict=True):
        out[a: a + max(1, (b - a) // 8)] = True
    return out


def _bands(problem: DiagnosisProblem, errors: Sequence[np.ndarray]) -> list[ErrorRegime]:
    """Shares of the error's power; a frequency between 0 and half the rate counts twice, for its negative too."""
    period = problem.signals[0].sample_time
    power = np.zeros(len(BANDS) - 1)
    for e, n in zip(errors, problem.blocks.number, strict=True):
        x = np.where(n >= 0, e, 0.0)
        spectrum, f = np.abs(np.fft.rfft(x)) ** 2 / x.size, np.fft.rfftfreq(x.size, period)
        spectrum[1:(x.size + 1) // 2] *= 2
        power += [float(spectrum[(f >= a) & (f < b)].sum()) for a, b in pairwise(BANDS)]
    top = 0.5 / period
    total = float(power.sum())
    if not total > 0:
        return []
    return [ErrorRegime(f"{a:g} to {b:g} Hz" if b < top else f"above {a:g} Hz", float(p) / total,
                        (min(b, top) - a) / top) for (a, b), p in zip(pairwise(BANDS), power, strict=True) if a < top]
