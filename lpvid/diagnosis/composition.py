"""Composition: a baseline with effects around it, simulated and differentiated as one model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.effect import STAGES, Effect
from lpvid.diagnosis.signals import Core, Remembered, Signals

STEP = 1e-5
"""share of a parameter's scale by which it is moved to see what it does."""


@dataclass(frozen=True, eq=False)
class Composition:
    """A baseline and effects, in the order of `STAGES`, with one parameter vector: the baseline's, then each effect's.

    Attributes
    ----------
    baseline : Baseline
    effects : tuple of Effect
    """

    baseline: Baseline
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        ordered = tuple(sorted(self.effects, key=lambda e: (STAGES.index(e.stage), e.name)))
        object.__setattr__(self, "effects", ordered)

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Where the parameters of each effect stand in the vector."""
        first, found = self.baseline.vector.size, []
        for effect in self.effects:
            found.append(slice(first, first + len(effect.parameters)))
            first = found[-1].stop
        return tuple(found)

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
        """(P,) bool: parameters that are a choice among things, which no derivative moves."""
        return np.array([False] * self.baseline.vector.size + [bool(p.choices) for e in self.effects
                                                               for p in e.parameters])

    def core(self, vector: np.ndarray, given: Core | None = None) -> Core:
        """The whole simulation at a parameter vector; `given` stands for the baseline's own.

        What the baseline and its series elements give along the same signals with the same parameters is remembered:
        effects beside and around them then cost no further run.
        """
        first = self.baseline.vector.size
        core = self.baseline.core(vector[:first]) if given is None else given
        for k, (effect, place) in enumerate(zip(self.effects, self.places, strict=True)):
            before = self.effects[k - 1].stage if k else "inside"
            if given is None and (before == "series" or (before == "inside" and effect.stage != "inside")):
                core = Remembered(core, (self.baseline, self.effects[:k], vector[: place.start].tobytes()))
            core = effect.compose(core, vector[place], self.baseline)
        return core

    def predict(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        """(n,) simulated output along signals."""
        return self.core(vector)(signals)

    def sensitivities(self, signals: Signals, vector: np.ndarray, free: Sequence[int] | None = None,
                      at: np.ndarray | None = None) -> np.ndarray:
        """(n, len(free)) derivative of `predict` in the free parameters, by differences; inwards from a bound.

        Zero for a choice. Without effects, the baseline's own (exact) derivative; with effects, differences of these
        around it where the baseline's simulation has steps of its own.
        """
        wanted = range(vector.size) if free is None else free
        if not self.effects:
            return self.baseline.sensitivities(signals, vector)[:, list(wanted)]
        here = self.predict(signals, vector) if at is None else at
        _, high = self.bounds
        out = np.zeros((signals.n_samples, len(wanted)))
        chosen = self.chosen
        for column, j in enumerate(wanted):
            if chosen[j]:
                continue
            step = STEP * self.scales[j]
            moved = vector.copy()
            moved[j] += step if vector[j] + step <= high[j] else -step
            if self.baseline.adaptive and j < self.baseline.vector.size:
                there = self.core(vector, self._tangent(signals, vector, moved, j))(signals)
            else:
                there = self.predict(signals, moved)
            out[:, column] = (there - here) / (moved[j] - vector[j])
        return out

    def _tangent(self, signals: Signals, vector: np.ndarray, moved: np.ndarray, j: int) -> Core:
        """The baseline with one parameter moved: along its derivative on these signals, run anew on any others."""
        own = slice(0, self.baseline.vector.size)
        core = Remembered(self.baseline.core(vector[own]), (self.baseline, (), vector[own].tobytes()))
        slopes = Remembered(lambda s: self.baseline.sensitivities(s, vector[own]),
                            (self.baseline, "sensitivities", vector[own].tobytes()))

        def run(s: Signals) -> np.ndarray:
            if s is not signals:
                return self.baseline.core(moved[own])(s)
            return core(s) + (moved[j] - vector[j]) * slopes(s)[:, j]

        return run
