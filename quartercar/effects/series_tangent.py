"""Small changes of a simulation with elements in series, to first order along its own run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from lpvid.diagnosis.signals import Core, Remembered, Signals
from lpvid.toolkit import found_once
from quartercar.effects.series_law import SAME, Law, force_at_rest, with_memory

if TYPE_CHECKING:
    from quartercar.effects.series import InSeries

RUNS = 4
"""signals of which the changes are kept: an effect around the series may read it along several"""
PROBED, FASTER = 32, 3.0
"""stages at which a core is asked whether it depends on other stages, and how much faster those others are"""
AT_ONCE = 16384
"""stages that a core is asked at once, so that its intermediate results stay in the processor's cache"""


def near(own: InSeries, others: Sequence[Core]) -> list[Core]:
    """Each of the others as the own simulation and its first-order change.

    One that is not in series, or whose core along a stage of the march depends on other stages, stays as it is.
    """
    runs = SeriesRuns(own, tuple(others))
    return [runs.core(j) if isinstance(other, type(own)) else other for j, other in enumerate(others)]


@dataclass(frozen=True, eq=False)
class SeriesRuns:
    """A simulation in series and others that differ little from it, along the signals that were last asked for.

    With δ_law the change of the core at the same speed and position, δD that of the deflection under the same force::

        δF = ∂F/∂w δw − ∂F/∂x δd + δ_law,   δd = D'(F) δF + δD,   δḋ = −δw
    """

    own: InSeries
    others: tuple[Core, ...]
    kept: list[tuple[Signals, np.ndarray, dict[int, np.ndarray]]] = field(default_factory=list)

    def core(self, j: int) -> Core:
        """One of the others."""
        def run(s: Signals) -> np.ndarray:
            out, changes = self.along(s)
            return out + changes[j] if j in changes else self.others[j](s)

        return run

    def along(self, s: Signals) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """(n,) the own simulation, and the changes that are known, by number."""
        for signals, out, changes in self.kept:
            if _alike(signals, s):
                return out, changes
        out, changes = changed(self.own, s, self.others) if s.coarse is None else self._refined(s, s.coarse)
        self.kept.append((s, out, changes))
        del self.kept[:-RUNS]
        return out, changes


    def _refined(self, s: Signals, coarse: Signals) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """The same between the samples: the cores there, and what the elements change along the samples."""
        rigid = self.own.core(s)
        if not np.isfinite(rigid).all():
            return rigid, {}
        (out, changes), at = self.along(coarse), self.own.core(coarse)

        def change(j: int) -> np.ndarray:
            core = self.others[j].core  # type: ignore[attr-defined]
            return core(s) - rigid + s.refined(changes[j] - (core(coarse) - at))

        return rigid + s.refined(out - at), {j: change(j) for j in changes}


def changed(own: InSeries, s: Signals, others: Sequence[Core]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """(n,) a simulation in series, and the first-order changes that lead to others, where they are known."""
    from quartercar.effects import _series_kernels as kernels

    rigid = own.core(s)
    if not np.isfinite(rigid).all():
        return rigid, {}
    law = own.law(s, rigid)
    parts, ends = own.steps(s, law)
    count = 1 + int((2 * parts + ends)[1:].sum())
    trace, last, place = np.empty((count, 5)), np.empty(count, dtype=np.int64), np.empty(count)
    out = own.march(s, rigid, law, trace)
    kernels.stages(parts, ends, last, place)
    stages = MarchStages(own.core, s, law, trace, last, place)
    element, found = own.elements.numbers(law.rest), []
    for j, other in enumerate(others):
        change = stages.change(other.core) if isinstance(other, type(own)) and other.static == own.static else None
        if change is not None:
            beside = 0.0 if law.memory else force_at_rest(other.core, s) - law.rest
            found.append((j, change - beside, other.elements.numbers(law.rest), beside))
    direct, softer = np.zeros((len(found), count)), np.zeros((len(found), count))
    falls = np.zeros(len(found))
    for k, (_, change, numbers, _) in enumerate(found):
        direct[k] = change
        if numbers != element:
            falls[k] = numbers[4] - element[4]
            kernels.softer(trace, element, numbers, softer[k])
    moved = np.empty((len(found), s.n_samples))
    kernels.tangent(trace, direct, softer, falls, element, s.sample_time, parts, ends, moved)
    return out, {j: m + beside for (j, *_, beside), m in zip(found, moved, strict=True)}


@dataclass(frozen=True, eq=False)
class MarchStages:
    """The stages of a march: what the law saw there.

    Attributes
    ----------
    core : Core
    s : Signals
    law : Law
    trace : (stages, 5) array
        Of the march.
    last : (stages,) array of int
        The sample up to which the step goes.
    place : (stages,) array
        Share of the way to it; beyond 1 at the step into the sample.
    """

    core: Core
    s: Signals
    law: Law
    trace: np.ndarray
    last: np.ndarray
    place: np.ndarray

    def change(self, core: Core) -> np.ndarray | None:
        """(stages,) change of the law for another core at the same speeds and positions; None where it has none."""
        if core is self.core or (isinstance(core, Remembered) and isinstance(self.core, Remembered)
                                 and core.key == self.core.key):
            return np.zeros(self.last.size)
        if self.law.memory:
            rows = with_memory(core, self.s, core(self.s)).rows - self.law.rows
            at = self._between(rows, rows)
            return at[:, 0] + at[:, 1] * self.trace[:, 0] if np.isfinite(rows).all() else None
        few, among = self._probes
        alone, beside = core(few), core(among)
        if not np.allclose(alone, beside[: alone.size], rtol=SAME, atol=SAME * np.ptp(beside)):
            return None
        return self._asked(core) - self._here

    @found_once
    def signals(self) -> tuple[Signals, ...]:
        """A sample for each stage: the speed and position of the core's side, other channels straight in between."""
        s, law = self.s, self.law
        channels = {role: self._between(c, c) for role, c in s.channels.items() if role != "velocity"}
        if law.jumps.any():
            i = s["current"]
            channels["current"] = self._between(i, np.where(law.jumps, np.concatenate([i[:1], i[:-1]]), i))
        if "displacement" in channels:
            channels["displacement"] = channels["displacement"] - self.trace[:, 1]
        channels["velocity"] = self.trace[:, 0].copy()
        at, size = self._between(s.places, s.places), self.last.size
        return tuple(self._part(channels, at, slice(k, k + AT_ONCE)) for k in range(0, size, AT_ONCE))

    def _asked(self, core: Core) -> np.ndarray:
        return np.concatenate([core(part) for part in self.signals])

    @found_once
    def _here(self) -> np.ndarray:
        return self._asked(self.core)

    @found_once
    def _probes(self) -> tuple[Signals, Signals]:
        """Some of the stages alone, and before the same ones at other speeds."""
        first = self.signals[0]
        probed = np.linspace(0, first.n_samples - 1, min(PROBED, first.n_samples)).astype(int)
        few = self._part(first.channels, first.places, probed)
        among = {role: np.tile(c, 2) for role, c in few.channels.items()}
        among["velocity"][probed.size:] *= FASTER
        return few, self._part(among, np.tile(few.places, 2), slice(None))

    def _part(self, channels: Mapping[str, np.ndarray], at: np.ndarray, which: slice | np.ndarray) -> Signals:
        found = {role: c[which] for role, c in channels.items()}
        s = self.s
        return Signals(s.sample_time, found, np.zeros(found["velocity"].size), s.name, s.span, record=s.record or s,
                       at=at[which])

    def _between(self, values: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Values at samples, straight from each to `before` the next, at the stages."""
        start = values[np.maximum(self.last - 1, 0)]
        share, into = self.place, self.place > 1
        if values.ndim == 2:
            share, into = share[:, None], into[:, None]
        return np.where(into, values[self.last], start + share * (before[self.last] - start))


def _alike(a: Signals, b: Signals) -> bool:
    """Whether two signals hold the same numbers."""
    return a is b or (a.sample_time == b.sample_time and a.span == b.span and a.channels.keys() == b.channels.keys()
                      and (a.at is b.at or (a.at is not None and b.at is not None and np.array_equal(a.at, b.at)))
                      and all(a[r] is b[r] or np.array_equal(a[r], b[r]) for r in a.channels)
                      and (a.output is b.output or np.array_equal(a.output, b.output)))
