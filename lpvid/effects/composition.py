"""Composition: a baseline with effects around it, simulated and differentiated as one model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from gc import collect
from typing import Self

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import LONG
from lpvid.baselines.lead_in import led_in
from lpvid.baselines.signals import AlongTangent, Around, Core, Linearised, Remembered, Signals
from lpvid.effects.effect import STAGES, Effect
from lpvid.record import Record
from lpvid.rounding import EPS, STEP

CARRIED = ("inside", "core", "series")
"""stages in series with the damper's own force; a parallel force (`Baseline.apart`) is added behind them"""


class CompositionBaseline(Baseline):
    """A baseline that is itself a law with effects, fitted already."""

    @property
    @abstractmethod
    def inner(self) -> Composition:
        """The law and effects that it is made of."""

    @property
    def clock(self) -> float | None:
        return self.inner.baseline.clock

    @property
    def start(self) -> int:
        return self.inner.baseline.start

    def signals(self, record: Record) -> Signals:
        return self.inner.baseline.signals(record)

    def core(self, vector: np.ndarray) -> Core:
        return self.inner.core(vector)

    def fit(self, records: Sequence[Record]) -> Self:
        return self

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        return self.inner.sensitivities(signals, vector)

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        return []


class ComposedBaseline(CompositionBaseline):
    """One whose effects are composed with further ones in the usual order, as if all were around its law.

    An effect that the baseline already holds replaces the baseline's own values of it.
    """

    @abstractmethod
    def candidates(self, catalogue: Sequence[Effect]) -> tuple[Effect, ...]:
        """A catalogue of causes as those of one record beside this simulation.

        Parameters
        ----------
        catalogue : sequence of Effect

        Returns
        -------
        tuple of Effect
        """


@dataclass(frozen=True, eq=False)
class Composition:
    """A baseline and effects, in the order of `STAGES` and layers, with one parameter vector.

    It holds the baseline's parameters, then each effect's.

    Attributes
    ----------
    baseline : Baseline
    effects : tuple of Effect
    """

    baseline: Baseline
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        ordered = tuple(sorted(self.effects, key=lambda e: (STAGES.index(e.stage), e.layer, e.name)))
        object.__setattr__(self, "effects", ordered)

    @cached_property
    def own(self) -> int:
        """Number of the baseline's parameters."""
        return self.baseline.vector.size

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Places of the parameters of each effect in the vector."""
        first, found = self.own, []
        for effect in self.effects:
            found.append(slice(first, first + len(effect.parameters)))
            first = found[-1].stop
        return tuple(found)

    @cached_property
    def flat(self) -> tuple[Composition, np.ndarray] | None:
        """The law, its own effects and the effects around it as one; the place of each of its parameters in the vector.

        None for a baseline that is a law itself. An effect around it takes the place of its own of that name.
        """
        if not isinstance(self.baseline, ComposedBaseline):
            return None
        inner = self.baseline.inner
        own = [(e, list(range(p.start, p.stop))) for e, p in zip(inner.effects, inner.places, strict=True)]
        around = [(e, list(range(p.start, p.stop))) for e, p in zip(self.effects, self.places, strict=True)]
        at = {e.name: (e, p) for e, p in (*own, *around)}
        whole = Composition(inner.baseline, tuple(e for e, _ in at.values()))
        return whole, np.array([*range(whole.own), *(k for e in whole.effects for k in at[e.name][1])], dtype=int)

    def by_effect(self, vector: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of each effect, by its name.

        Parameters
        ----------
        vector : (P,) array

        Returns
        -------
        dict of str to (k,) array
            Views of the vector.
        """
        return {e.name: vector[place] for e, place in zip(self.effects, self.places, strict=True)}

    @property
    def members(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(e.name for e in self.effects)

    @property
    def neutral(self) -> np.ndarray:
        """(P,) the baseline's parameters, and every effect absent."""
        return np.concatenate([self.baseline.vector, *(e.neutral for e in self.effects)])

    @property
    def names(self) -> tuple[str, ...]:
        """(P,) parameter names; an effect's as ``effect.parameter``."""
        return (*(c.name for c in self.baseline.coefficients),
                *(f"{e.name}.{p.name}" for e in self.effects for p in e.parameters))

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(P,) lower and upper bounds."""
        pairs = [(c.lower, c.upper) for c in self.baseline.coefficients]
        pairs += [p.bounds for e in self.effects for p in e.parameters]
        low, high = np.array(pairs, dtype=float).reshape(-1, 2).T
        return low, high

    @property
    def scales(self) -> np.ndarray:
        """(P,) a change of each parameter that matters."""
        own = [c.scale for c in self.baseline.coefficients]
        own += [max(abs(g - p.neutral) for g in (*p.grid, *p.plausible)) or 1.0
                for e in self.effects for p in e.parameters]
        return np.array(own)

    @property
    def chosen(self) -> np.ndarray:
        """(P,) bool: parameters that are not fitted: a choice, which has no derivative, or a number that is held."""
        own = self.baseline.inner.chosen if isinstance(self.baseline, CompositionBaseline) else [False] * self.own
        return np.array([*own, *(bool(p.choices) or p.held for e in self.effects for p in e.parameters)], dtype=bool)

    def core(self, vector: np.ndarray, given: Core | None = None) -> Core:
        """The whole simulation at a parameter vector; `given` replaces that of the baseline alone.

        The output of the baseline, and of each effect around it, is kept for the same signals and parameters: a change
        of an outer effect then needs no new run of the inner ones.

        Parameters
        ----------
        vector : (P,) array
            The baseline's parameters, then each effect's.
        given : Core, optional
            Of the output of the baseline; what is around it is then simulated anew each time.

        Returns
        -------
        Core
            From signals to the (n,) output, in its unit.
        """
        if self.flat is not None and given is None:
            whole, place = self.flat
            return whole.core(vector[place])
        inner = self._carried(vector) if given is None else vector
        core = self._around(self._base(inner) if given is None else given, inner, 0, self._outside, given is None)
        core = self._beside(core, vector, inner)
        return self._around(core, vector, self._outside, len(self.effects), given is None)

    @cached_property
    def _outside(self) -> int:
        """Number of the effects up to those in series with the law."""
        return sum(e.stage in CARRIED for e in self.effects)

    def _base(self, vector: np.ndarray) -> Remembered:
        own = vector[: self.own]
        return Remembered(self.baseline.core(own), (self.baseline, (), own.tobytes()))

    def _carried(self, vector: np.ndarray) -> np.ndarray:
        """The parameters of what acts through the effects in series: without an inertia (`Baseline.apart`).

        The vector itself where no effect is in series, so that the composition is the baseline to the last bit.
        """
        if not self.baseline.apart or not any(
                e.stage in CARRIED and (vector[p][: e.strengths] != e.neutral[: e.strengths]).any()
                for e, p in zip(self.effects, self.places, strict=True)):
            return vector
        bare = vector.copy()
        bare[[k for k, c in enumerate(self.baseline.coefficients) if c.name in self.baseline.apart]] = 0.0
        return bare

    def _beside(self, core: Core, vector: np.ndarray, inner: np.ndarray) -> Core:
        """A core, and added to it the part of the baseline that does not act through the effects in series."""
        if inner is vector or not (vector != inner).any():
            return core
        whole, bare = self._base(vector), self._base(inner)
        return lambda s: core(s) + (whole(s) - bare(s))

    def _around(self, core: Core, vector: np.ndarray, first: int, last: int, remember: bool) -> Core:
        """A core with some of the effects around it, by number."""
        bare = core
        for k in range(first, last):
            effect, place = self.effects[k], self.places[k]
            if effect.stage == "inside":  # it changes parts of the simulation
                core = core.core if isinstance(core, Remembered) else core
            elif remember and not isinstance(core, Remembered):
                core = Remembered(core, (self.baseline, self.effects[:k], vector[: place.start].tobytes()))
            composed = effect.compose(core, vector[place], self.baseline)
            core = Around(composed, bare) if effect.stage == "core" and composed is not core else composed
        return core

    def predict(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        """(n,) simulated output along signals.

        Parameters
        ----------
        signals : Signals
        vector : (P,) array

        Returns
        -------
        (n,) array
            In the output's unit, not finite where the simulation diverges.
        """
        return self.core(vector)(signals)

    def free_run(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        """(n,) simulated output along a whole record, which may begin in mid-motion (`lpvid.baselines.lead_in`).

        Parameters
        ----------
        signals : Signals
        vector : (P,) array

        Returns
        -------
        (n,) array
            That of `predict` for a law alone, and for one that begins with measured outputs.
        """
        with_effects = self.effects or isinstance(self.baseline, CompositionBaseline)
        led, count = led_in(signals) if with_effects and not self.baseline.start else (signals, 0)
        found = self.predict(led, vector)
        if led is not signals:
            led.cache.clear()  # what is cached refers to its signals, and would stay
        return found[count:].copy()

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")  # of a law that diverges they are not finite
    def sensitivities(self, signals: Signals, vector: np.ndarray, free: Sequence[int] | None = None,
                      at: np.ndarray | None = None) -> np.ndarray:
        """(n, len(free)) derivative of `predict` in the free parameters, by differences; inwards from a bound.

        Zero for a choice. Without effects, the baseline's own (exact) derivative; with effects, differences of these
        around it where the baseline's simulation has steps of its own. What lies inside a series element is moved to
        first order along one run of it, if it is `Linearised`.

        Parameters
        ----------
        signals : Signals
        vector : (P,) array
        free : sequence of int, optional
            Places in the vector, in the order of the columns; all by default.
        at : (n,) array, optional
            `predict` at `vector`, where it is known, so that it is not run again.

        Returns
        -------
        (n, len(free)) array
            In the output's unit over that of the parameter.
        """
        wanted = range(vector.size) if free is None else free
        if self.flat is not None:
            whole, place = self.flat
            at_place = {int(k): c for c, k in enumerate(place)}
            inside = [j for j in wanted if j in at_place]
            out = np.zeros((signals.n_samples, len(wanted)))  # none in its own values of what an effect replaces
            columns = [c for c, j in enumerate(wanted) if j in at_place]
            out[:, columns] = whole.sensitivities(signals, vector[place], [at_place[j] for j in inside], at)
            return out
        if not self.effects:
            return self.baseline.sensitivities(signals, vector)[:, list(wanted)]
        here = self.predict(signals, vector) if at is None else at
        rounding = here.size * EPS * max(float(np.abs(here).max()), float(np.abs(signals.output).max()))
        _, high = self.bounds
        out = np.zeros((signals.n_samples, len(wanted)))
        moves: dict[int, np.ndarray] = {}
        for j in wanted:
            if not self.chosen[j]:
                step = STEP * self.scales[j]
                moves[j] = vector.copy()
                moves[j][j] += step if vector[j] + step <= high[j] else -step
        near = {} if self.baseline.adaptive else self._near(signals, vector, moves)
        along = self.baseline.adaptive or self.baseline.forward
        for column, j in sorted(enumerate(wanted), key=lambda t: t[1] < self.own):  # the effects' while all is at hand
            if j not in moves:
                continue
            moved = moves[j]
            if j in near:
                there = near[j](signals)
            elif along and j < self.own:
                there = self.core(vector, self._tangent(signals, vector, moved, j))(signals)
            else:
                there = self.predict(signals, moved)
            change = there - here
            if signals.n_samples > LONG:  # signals that were made for this run hold what holds them
                collect(1)
            if np.abs(change).max() > rounding:  # else the derivative would be one of rounding errors
                out[:, column] = change / (moved[j] - vector[j])
        return out

    def _near(self, signals: Signals, vector: np.ndarray, moves: Mapping[int, np.ndarray]) -> dict[int, Core]:
        """Simulations with one parameter moved of those inside a series element, to first order along one run of it.

        The effects around the element are composed with it as with any other core.
        """
        def inner(at: np.ndarray, count: int, j: int | None = None) -> Core:
            at = self._carried(at)
            base = self._base(at) if j is None or not self.baseline.forward or j >= self.own else \
                self._tangent(signals, vector, at, j)
            core = self._around(base, at, 0, count, True)
            return core.core if isinstance(core, Remembered) else core

        def whole(core: Core, at: np.ndarray, count: int) -> Core:
            core = self._around(core, vector, count, self._outside, False)
            core = self._beside(core, at, self._carried(at))
            return self._around(core, vector, self._outside, len(self.effects), False)

        for count in range(len(self.effects), 0, -1):
            if self.effects[count - 1].stage != "series":
                continue
            here = inner(vector, count)
            if isinstance(here, Linearised):
                inside = [j for j in moves if j < self.places[count - 1].stop]
                near = here.near([inner(moves[j], count, j) for j in inside])
                return {j: whole(core, moves[j], count) for j, core in zip(inside, near, strict=True)}
        return {}

    def _tangent(self, signals: Signals, vector: np.ndarray, moved: np.ndarray, j: int) -> Core:
        """The baseline with one parameter moved: along its derivative on these signals and on those made of them that
        are kept, run anew on any others. The two differ by the rounding of a difference."""
        own, whole = vector[: self.own], self.baseline.core(moved[: self.own])
        core = self._base(vector)
        slopes = Remembered(lambda s: np.asfortranarray(self.baseline.sensitivities(s, own)),
                            (self.baseline, "sensitivities", own.tobytes()))

        def run(s: Signals) -> np.ndarray:
            if s is not signals and not core.kept(s):
                return whole(s)
            return core(s) + (moved[j] - vector[j]) * slopes(s)[:, j]

        return AlongTangent(run, whole)
