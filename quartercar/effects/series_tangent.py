"""Small changes of a simulation with elements in series, to first order along its own run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from lpvid.baselines.budgets import LONG, REPLACED
from lpvid.baselines.signals import Core, Linearised, Remembered, Signals
from lpvid.toolkit import found_once
from quartercar.effects.series_law import SAME, SEEN, Law, force_at_rest, with_memory
from quartercar.effects.series_march import SeriesMarch, empty_trace

Changes = Callable[[Any, Signals, Sequence[Core]], tuple[np.ndarray, dict[int, np.ndarray]]]


def near(own: SeriesMarch | Linearised, others: Sequence[Core], changes: Changes) -> list[Core]:
    """Each of the others as the own simulation plus its first-order change.

    One that is not in series, or whose core at a stage of the march depends on other stages, is returned unchanged.

    Parameters
    ----------
    own : SeriesMarch
    others : sequence of Core
    changes : callable
        From the own simulation, signals and the others to the (n,) output and the changes of those that have one.

    Returns
    -------
    list of Core
        One for each of the others.
    """
    runs = _SeriesRuns(own, tuple(others), changes)
    return [runs.core(j) if isinstance(other, type(own)) else other for j, other in enumerate(others)]


@dataclass(frozen=True, eq=False)
class _SeriesRuns:
    """A simulation in series and others that differ little from it, along the signals of the last evaluation.

    With δ_law the change of the core at the same speed and position, δD that of the deflection under the same force::

        δF = ∂F/∂w δw − ∂F/∂x δd + δ_law,   δd = D'(F) δF + δD,   δḋ = −δw
    """

    own: Any
    others: tuple[Core, ...]
    changes: Changes
    kept: list[tuple[Signals, np.ndarray, dict[int, np.ndarray]]] = field(default_factory=list)

    def core(self, j: int) -> Core:
        """One of the others."""
        def run(s: Signals) -> np.ndarray:
            out, changes = self.along(s)
            return out + changes[j] if j in changes else self.others[j](s)

        return run

    def along(self, s: Signals) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """(n,) the own simulation, and the changes of those that have one, by index."""
        for signals, out, changes in self.kept:
            if _alike(signals, s):
                return out, changes
        out, changes = self.changes(self.own, s, self.others) if s.coarse is None else self._refined(s, s.coarse)
        self.kept.append((s, out, changes))
        del self.kept[:-REPLACED]  # an effect around the series may run it along several signals
        return out, changes

    def _refined(self, s: Signals, coarse: Signals) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """The same between the samples: the cores there, plus the change by the elements, interpolated."""
        rigid = self.own.core(s)
        if not np.isfinite(rigid).all():
            return rigid, {}
        (out, changes), at = self.along(coarse), self.own.core(coarse)

        def change(j: int) -> np.ndarray:
            core = self.others[j].core  # type: ignore[attr-defined]
            return core(s) - rigid + s.refined(changes[j] - (core(coarse) - at))

        return rigid + s.refined(out - at), {j: change(j) for j in changes}


def changed(own: SeriesMarch, s: Signals, others: Sequence[Core]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """(n,) a simulation in series, and the first-order changes from it to the others.

    The stages, several per sample, are processed in parts to limit memory: the outputs of the cores along all stages of
    ten minutes are half a gigabyte.

    Parameters
    ----------
    own : SeriesMarch
    s : Signals
    others : sequence of Core

    Returns
    -------
    out : (n,) array
        [N].
    changes : dict of int to (n,) array
        [N], by index of the others; without those that have none, and empty where the core is not finite.
    """
    from quartercar.effects import _series_kernels as kernels

    rigid = own.core(s)
    if not np.isfinite(rigid).all():
        return rigid, {}
    law = own.law(s, rigid)
    parts, ends = own.steps(s, law)
    sizes = 2 * parts + ends
    sizes[0] = 1
    behind = np.cumsum(sizes)
    count = int(behind[-1])
    trace, last, place = empty_trace(count), np.empty(count, dtype=np.int64), np.empty(count)
    out = own.march(s, rigid, law, trace)
    kernels.stages(parts, ends, last, place)
    stages = MarchStages(own.core, s, law, trace, last, place)
    element, found = own.elements.numbers(law.rest), []
    for j, other in enumerate(others):
        moved = stages.moved(other.core) if isinstance(other, type(own)) and other.static == own.static else None
        if moved is not None:
            beside = 0.0 if law.memory else force_at_rest(other.core, s) - law.rest
            found.append((j, moved, other.elements.numbers(law.rest), beside))
    falls = np.array([0.0 if numbers == element else numbers[4] - element[4] for _, _, numbers, _ in found])
    state, changes = np.zeros((2, len(found))), np.empty((len(found), s.n_samples))
    first = 0
    while first < s.n_samples:
        begin = int(behind[first - 1]) if first else 0
        until = max(int(np.searchsorted(behind, begin + LONG, side="right")), first + 1)
        which = slice(begin, int(behind[until - 1]))
        part = cache(partial(stages.part, which))
        direct, softer = np.zeros((2, len(found), which.stop - begin))
        for k, (_, moved, numbers, beside) in enumerate(found):
            direct[k] = moved(which, part) - beside
            if numbers != element:
                kernels.softer(trace[which], element, numbers, softer[k])
        here = np.empty((len(found), until - first))
        kernels.tangent(trace[which], direct, softer, falls, element, s.sample_time, parts[first:until],
                        ends[first:until], first == 0, state, here)
        changes[:, first:until] = here
        first = until
    for k, (*_, beside) in enumerate(found):
        changes[k] += beside
    return out, {j: change for (j, *_), change in zip(found, changes, strict=True)}


Moved = Callable[[slice, Callable[[], Signals]], np.ndarray | float]
"""Change of a law along some of the stages, whose signals are computed at first use."""


@dataclass(frozen=True, eq=False)
class MarchStages:
    """The stages of a march, with the inputs of the law.

    Attributes
    ----------
    core : Core
    s : Signals
    law : Law
    trace : (stages, 5) array
        Of the march.
    last : (stages,) array of int
        Last sample of the interval.
    place : (stages,) array
        Place in the interval; above 1 at the step into the sample.
    """

    core: Core
    s: Signals
    law: Law
    trace: np.ndarray
    last: np.ndarray
    place: np.ndarray

    def moved(self, core: Core) -> Moved | None:
        """Change of the law for another core at the same speeds and positions.

        Parameters
        ----------
        core : Core

        Returns
        -------
        callable or None
            Of some of the stages and a function for their signals: (stages,) change [N]. None where the core depends on
            other stages.
        """
        if core is self.core or (isinstance(core, Remembered) and isinstance(self.core, Remembered)
                                 and core.key == self.core.key):
            return lambda which, part: 0.0
        if self.law.memory:
            rows = with_memory(core, self.s, core(self.s)).rows - self.law.rows
            return (lambda which, part: self._along(rows, which)) if np.isfinite(rows).all() else None
        few, among = self._probes
        alone, beside = core(few), core(among)
        if not np.allclose(alone, beside[: alone.size], rtol=SAME, atol=SAME * np.ptp(beside)):
            return None
        return lambda which, part: core(part()) - part().cached("the march's own law", lambda: self.core(part()))

    def part(self, which: slice) -> Signals:
        """A sample for each of some stages: speed and position behind the elements, other channels interpolated.

        Parameters
        ----------
        which : slice
            Of the stages.

        Returns
        -------
        Signals
        """
        s, law = self.s, self.law
        channels = {role: self._between(c, c, which) for role, c in s.channels.items() if role != "velocity"}
        if law.jumps.any():
            i = s["current"]
            channels["current"] = self._between(i, np.where(law.jumps, np.concatenate([i[:1], i[:-1]]), i), which)
        if "displacement" in channels:
            channels["displacement"] = channels["displacement"] - self.trace[which, 1]
        channels["velocity"] = self.trace[which, 0].copy()
        return self._signals(channels, self._between(s.places, s.places, which))

    def _along(self, rows: np.ndarray, which: slice) -> np.ndarray:
        """A law linear in the speed at some stages, from its rows, (n, 2), at the samples."""
        at = self._between(rows, rows, which)
        return at[:, 0] + at[:, 1] * self.trace[which, 0]

    @found_once
    def _probes(self) -> tuple[Signals, Signals]:
        """Some of the first stages alone, and the same followed by those at twice the speed."""
        first = self.part(slice(0, min(LONG, self.last.size)))
        probed = np.linspace(0, first.n_samples - 1, min(SEEN, first.n_samples)).astype(int)
        few = self._signals({role: c[probed] for role, c in first.channels.items()}, first.places[probed])
        among = {role: np.tile(c, 2) for role, c in few.channels.items()}
        among["velocity"][probed.size:] *= 2.0
        return few, self._signals(among, np.tile(few.places, 2))

    def _signals(self, channels: Mapping[str, np.ndarray], at: np.ndarray) -> Signals:
        s = self.s
        return Signals(s.sample_time, channels, np.zeros(at.size), s.name, s.span, record=s.record or s, at=at)

    def _between(self, values: np.ndarray, before: np.ndarray, which: slice) -> np.ndarray:
        """Values at some of the stages, linear from each sample to the value `before` the next one."""
        last, share = self.last[which], self.place[which]
        start, into = values[np.maximum(last - 1, 0)], share > 1
        if values.ndim == 2:
            share, into = share[:, None], into[:, None]
        return np.where(into, values[last], start + share * (before[last] - start))


def _alike(a: Signals, b: Signals) -> bool:
    """Whether two signals hold the same numbers."""
    return a is b or (a.sample_time == b.sample_time and a.span == b.span and a.channels.keys() == b.channels.keys()
                      and (a.at is b.at or (a.at is not None and b.at is not None and np.array_equal(a.at, b.at)))
                      and all(a[r] is b[r] or np.array_equal(a[r], b[r]) for r in a.channels)
                      and (a.output is b.output or np.array_equal(a.output, b.output)))
