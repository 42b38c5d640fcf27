"""Localise: the regimes of the inputs, of time and of frequency with most of the error, and lines in its spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.codec import Encoded
from lpvid.diagnosis.budgets import LISTED
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.validation.regimes import FreeRunStretch, bands, lines
from lpvid.validation.trust import LEVEL


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
        Of the samples; of the measured power, for a frequency band or a line.
    """

    where: str
    share: float
    time: float


def localise(problem: DiagnosisProblem, errors: Sequence[np.ndarray]) -> tuple[ErrorRegime, ...]:
    """Shares of the squared error by sign and size of each input, by time, after reversals, by frequency, and in lines
    of its spectrum; worst first.

    Listed are regimes in which the odds of the error are at least twice those of the time, as in half of the time with
    two thirds of the error, and which hold a share of it that is significant (`LEVEL`).

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Free-run errors, per record.

    Returns
    -------
    tuple of ErrorRegime
        At most `LISTED` regimes.
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
        regimes += [("after a change of current", inside) for name, inside in _regimes("rate", rate)
                    if name == "large |rate|"]
    place = np.concatenate([np.linspace(0, 1, n.size)[n >= 0] for n in problem.blocks.number])
    regimes += [("first third of the time", place < 1 / 3), ("last third of the time", place > 2 / 3)]
    found = [ErrorRegime(where, float(squared[inside].sum()) / total, float(inside.mean()))
             for where, inside in regimes if 0 < inside.mean() < 1]
    found += [ErrorRegime(b.where, b.error_share, b.share)
              for b in bands(_stretches(problem, errors), problem.signals[0].sample_time)]
    found += spectrum_lines(problem, errors)
    notable = [w for w in found if w.share > 1 - LEVEL and w.share * (1 - w.time) >= 2 * w.time * (1 - w.share)]
    return tuple(sorted(notable, key=lambda w: w.time - w.share)[:LISTED])


def _regimes(name: str, x: np.ndarray) -> list[tuple[str, np.ndarray]]:
    found: list[tuple[str, np.ndarray]] = []
    if x.min() < 0 < x.max():
        found += [(f"{name} < 0", x < 0), (f"{name} > 0", x > 0)]
    size = np.abs(x)
    low, high = np.quantile(size, [1 / 4, 3 / 4])
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


def spectrum_lines(problem: DiagnosisProblem, errors: Sequence[np.ndarray]) -> tuple[ErrorRegime, ...]:
    """Lines in the spectrum of the error that nothing of the motion has, the largest first.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Free-run errors, per record.

    Returns
    -------
    tuple of ErrorRegime
        Those with a significant share of the squared error.
    """
    return tuple(ErrorRegime(x.where, x.error_share, x.share)
                 for x in lines(_stretches(problem, errors), problem.signals[0].sample_time))


def _stretches(problem: DiagnosisProblem, errors: Sequence[np.ndarray]) -> list[FreeRunStretch]:
    """Free runs, with all inputs, from the first block of each stretch of uniform time to its last."""
    parts = []
    for s, e, n in zip(problem.signals, errors, problem.blocks.number, strict=True):
        inputs = np.array([s[c] for c in s.channels if not np.array_equal(s[c], s.output)]).reshape(-1, s.n_samples)
        for first, end in s.pieces:
            inside = first + np.flatnonzero(n[first:end] >= 0)
            if inside.size:
                k = slice(inside[0], inside[-1] + 1)
                parts.append(FreeRunStretch(s.output[k], (s.output - e)[k], None, inputs[:, k].T))
    return parts
