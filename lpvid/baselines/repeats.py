"""Repeats: where the inputs of records, or of the halves of a periodic one, are the same."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.constancy import DISTINCT
from lpvid.rounding import EPS, HALF_DIGITS, TINY


class Repeat(NamedTuple):
    """Two stretches of the same inputs.

    Attributes
    ----------
    first, second : int
        Numbers of their records.
    lag : int
        Samples by which the second begins later; 0 for two records.
    """

    first: int
    second: int
    lag: int

    def pair(self, values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Values along either stretch.

        Parameters
        ----------
        values : sequence of (n,) arrays
            Per record.

        Returns
        -------
        (m,), (m,) arrays
        """
        n = min(values[self.first].size, values[self.second].size - self.lag)
        return values[self.first][:n], values[self.second][self.lag: self.lag + n]

    def stated(self, signals: Sequence[Signals]) -> str:
        """In words, with the names of the records.

        Parameters
        ----------
        signals : sequence of Signals

        Returns
        -------
        str
        """
        a, b = signals[self.first], signals[self.second]
        return f"{a.name} repeats after {self.lag * a.sample_time:.3g} s" if self.lag else f"{a.name} repeats {b.name}"


def repeats(signals: Sequence[Signals], channels: Sequence[str]) -> list[Repeat]:
    """Records against records, and the halves of a periodic one.

    Inputs agree where every channel differs by less than `DISTINCT` of its spread.

    Parameters
    ----------
    signals : sequence of Signals
        One for each record, one rate.
    channels : sequence of str
        The inputs that must repeat.

    Returns
    -------
    list of Repeat
        Empty where nothing repeats.
    """
    return _repeated_records(signals, channels) + [
        Repeat(k, k, lag) for k, s in enumerate(signals) if (lag := _period(s, channels))]


def record_origins(records: Sequence[Signals]) -> tuple[list[int], list[int]]:
    """Which records are pieces of one (``run#1``, ``run#2``), and which are of one test.

    Of one test are those of the same inputs, but for acceleration and temperature, along half of the longer one at
    least.

    Parameters
    ----------
    records : sequence of Signals
        Whole, one rate.

    Returns
    -------
    parents, tests : list of int
        For each, the number of the first that is a piece of the same record; and of its test, counted from 0.

    Examples
    --------
    >>> def run(seed, name):
    ...     return Signals(0.01, {"velocity": np.random.default_rng(seed).standard_normal(400)}, np.ones(400), name)
    >>> record_origins([run(0, "a"), run(0, "b"), run(1, "c#1"), run(2, "c#2")])
    ([0, 1, 2, 2], [0, 0, 1, 1])
    """
    inputs = [c for c in records[0].channels if c not in ("acceleration", "temperature") and all(
        s.has(c) and not np.array_equal(np.abs(s[c]), np.abs(s.output)) for s in records)]
    pieces = [s.name.rpartition("#") for s in records]
    keys = [head if head and number.isdigit() else k for k, (head, _, number) in enumerate(pieces)]
    parents = [keys.index(key) for key in keys]
    tests = list(parents)
    for r in _repeated_records(records, inputs) if inputs else ():
        sizes = records[r.first].n_samples, records[r.second].n_samples
        if 2 * min(sizes) >= max(sizes):
            tests = [tests[r.first] if k == tests[r.second] else k for k in tests]
    return parents, [list(dict.fromkeys(tests)).index(k) for k in tests]


def record_halves(sizes: Sequence[int], tests: Sequence[int]) -> list[int]:
    """Half of each record, 0 or 1, so that what was fitted to one is tested on other tests.

    Runs of one test are in one half: one of them would predict the other however wrong a model is elsewhere. Each test
    is in the half that has fewer samples so far.

    Parameters
    ----------
    sizes : sequence of int
        Samples of each record.
    tests : sequence of int
        As of `record_origins`.

    Returns
    -------
    list of int
        Empty where one half would have less than half as many samples as the other, as for a single test.

    Examples
    --------
    >>> record_halves([400, 400, 300, 200], [0, 0, 1, 2]), record_halves([900, 100], [0, 1])
    ([0, 0, 1, 1], [])
    """
    half, held = {}, [0, 0]
    for test in dict.fromkeys(tests):
        half[test] = int(held[1] < held[0])
        held[half[test]] += sum(n for n, other in zip(sizes, tests, strict=True) if other == test)
    return [half[test] for test in tests] if 2 * min(held) >= max(held) else []


def _repeated_records(signals: Sequence[Signals], channels: Sequence[str]) -> list[Repeat]:
    """Pairs of records with the same inputs."""
    return [Repeat(j, k, 0) for (j, a), (k, b) in combinations(enumerate(signals), 2)
            if _alike(a, b, channels, min(a.n_samples, b.n_samples))]


def _alike(a: Signals, b: Signals, channels: Sequence[str], n: int) -> bool:
    """Whether the first n samples of two records have the same inputs."""
    for name in channels:
        x, y = a[name][:n], b[name][:n]
        spread = max(float(np.std(x)), float(np.std(y)), EPS * float(np.abs(x).max(initial=0.0)))
        if spread > 0 and not float(np.sqrt(np.mean((x - y) ** 2))) <= DISTINCT * spread:
            return False
    return True


def _period(s: Signals, channels: Sequence[str]) -> int:
    """Longest lag in samples, up to half of the record, at which all inputs repeat; 0 where none does.

    The longest: slow noise is the same a short period later.
    """
    n = s.n_samples
    moving = [s[c] - s[c].mean() for c in channels if np.std(s[c]) > HALF_DIGITS * max(float(np.abs(s[c]).max()), TINY)]
    if not moving:
        return 0
    size = 1 << (2 * n - 1).bit_length()
    lags = np.arange(n // 2 + 1)
    worst = np.zeros(lags.size)
    for x in moving:
        power = np.cumsum(np.concatenate([[0.0], x**2]))
        cross = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[lags]
        worst = np.maximum(worst, (power[n - lags] + power[n] - power[lags] - 2 * cross) / (n - lags) / np.var(x))
    departed = np.maximum.accumulate(worst) > 1  # correlation below ½ before, as in `condition.repetition_period`
    good = np.flatnonzero(departed & (worst < DISTINCT**2))
    last = good[2 * good > 2 * good[-1] - good[0]] if good.size else np.zeros(1, int)  # its neighbours are alike too
    return int(last[np.argmin(worst[last])])
