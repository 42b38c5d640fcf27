"""FleetLaw: a law with the causes that a fleet's healthy files share, from which one file may differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any

import numpy as np

from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.signals import Core, Signals
from lpvid.codec import encode
from lpvid.effects.composition import ComposedBaseline, Composition
from lpvid.effects.effect import Effect, EffectParameter, LpvChange
from lpvid.effects.extended import ExtendedModel
from lpvid.errors import InputError

ALIKE = ("name", "title", "family", "stage", "layer", "equation", "reference", "experiment", "needs", "strengths",
         "memoryless", "smooth", "partners", "added_later", "rugged", "path", "stepwise", "flexible", "placement_of",
         "form_of", "contains", "behind", "turns", "brings")
"""attributes that a `FleetEffect` has from its effect; not `visible` and `common`, which hold for the effect's own
neutral values: samples show a clipped force, but not that it is clipped at another level than the fleet's"""
WITHIN = 3.0
"""standard deviations within which 99.7 % of normal specimens lie"""
CONSISTENT = 1 / NormalDist().inv_cdf(3 / 4)
"""standard deviation of a normal distribution over its median absolute deviation"""
FACTORS = (2.0, 4.0)
"""of a fleet's strength, they and their reciprocals, at which a cause is screened in addition to its own points"""


@dataclass(frozen=True, eq=False)
class FleetLaw(ComposedBaseline):
    """The common law of healthy files with their causes, each parameter free within the spread of the specimens only.

    What all files have in common is part of the law and no cause of a single file. A cause of the fleet is a candidate
    for a file with the fleet's strength as its neutral value (`candidates`), so that it is found where its strength in
    that file lies outside the fleet's range.

    Attributes
    ----------
    shared : ExtendedModel
        Law and causes, at the parameters of all healthy files together.
    lower, upper : (P,) arrays
        Range of healthy specimens.
    at : (P,) array
    """

    shared: ExtendedModel
    lower: np.ndarray
    upper: np.ndarray
    at: np.ndarray
    name: str = field(init=False)
    output: str = field(init=False)
    output_unit: str = field(init=False)
    static: bool = field(init=False)
    adaptive: bool = field(init=False)
    forward: bool = field(init=False)
    polarity: int = field(init=False)
    schedule: tuple[str, ...] = field(init=False)
    apart: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        law = self.inner.baseline
        object.__setattr__(self, "name", "fleet of " + "+".join((law.name, *self.shared.effects)))
        for name in ("output", "output_unit", "static", "adaptive", "forward", "polarity", "schedule", "apart"):
            object.__setattr__(self, name, getattr(law, name))

    @classmethod
    def of(cls, shared: ExtendedModel, specimens: Sequence[np.ndarray]) -> FleetLaw:
        """From the model of all healthy files together and the parameters of each of them.

        A parameter may lie within three standard deviations of the specimens' median, or up to the fleet's value. The
        standard deviation follows from their median absolute deviation, so that a single outlier among the specimens
        does not widen it.

        Parameters
        ----------
        shared : ExtendedModel
        specimens : sequence of (P,) arrays
            Refits of it along healthy files, one each.

        Returns
        -------
        FleetLaw
        """
        values = np.array(specimens)
        middle = np.median(values, axis=0)
        width = WITHIN * CONSISTENT * np.median(np.abs(values - middle), axis=0)
        low, high = shared.composition.bounds
        lower, upper = np.minimum(middle - width, shared.vector), np.maximum(middle + width, shared.vector)
        return cls(shared, np.clip(lower, low, high), np.clip(upper, low, high), np.array(shared.vector))

    @classmethod
    def free(cls, found: ExtendedModel) -> FleetLaw:
        """The extended model of several files together, with physical bounds only.

        Parameters
        ----------
        found : ExtendedModel
            A `FleetLaw` as its baseline is merged into it. A flexible effect is left out: over several specimens it
            fits the differences between them.

        Returns
        -------
        FleetLaw
        """
        composition, vector = found.composition, found.vector
        if composition.flat is not None:
            composition, place = composition.flat
            vector = vector[place]
        kept = Composition(composition.baseline, tuple(e for e in composition.effects if not e.flexible))
        at = composition.by_effect(vector)
        vector = np.concatenate([vector[: kept.own], *(at[e.name] for e in kept.effects)])
        found = replace(found, composition=kept, vector=vector, covariance=np.full((vector.size, vector.size), np.nan))
        return cls(found, *found.composition.bounds, np.array(found.vector))

    @property
    def inner(self) -> Composition:
        return self.shared.composition

    @property
    def channels(self) -> tuple[str, ...]:
        return (*self.shared.reads, self.output)

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Of the shared model: the roles of its channels in training."""
        return self.shared.metadata

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        units = [c.unit for c in self.inner.baseline.coefficients]
        units += [p.unit for e in self.inner.effects for p in e.parameters]
        return tuple(Coefficient(n, u, float(a), float(b), float(s)) for n, u, a, b, s in zip(
            self.inner.names, units, self.lower, self.upper, self.inner.scales, strict=True))

    @property
    def vector(self) -> np.ndarray:
        return np.array(self.at)

    def with_vector(self, vector: np.ndarray) -> FleetLaw:
        return replace(self, at=np.asarray(vector, dtype=float))

    def candidates(self, catalogue: Sequence[Effect]) -> tuple[Effect, ...]:
        own = self.inner.by_effect(self.shared.vector)
        return tuple(FleetEffect(e, own[e.name]) if e.name in own else e for e in catalogue)

    def to_dict(self) -> dict:
        return {"kind": "fleet", "shared": self.shared.to_dict(), "lower": encode(self.lower),
                "upper": encode(self.upper), "at": self.at.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping) -> FleetLaw:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping

        Returns
        -------
        FleetLaw

        Raises
        ------
        InputError
            A file of another version, in which an effect has fewer parameters.
        """
        shared = ExtendedModel.from_dict(data["shared"])
        if len(data["at"]) != shared.vector.size:
            raise InputError(f"the fleet's law has {shared.vector.size} parameters here",
                             got=f"{len(data['at'])} in the file", why="a later version added a parameter",
                             mend="diagnose the fleet again")
        lower, upper = ([none if v is None else v for v in data[n]] for n, none in (("lower", -np.inf),
                                                                                    ("upper", np.inf)))
        return cls(shared, *(np.array(v, dtype=float) for v in (
            lower, upper, data["at"])))


class FleetEffect(Effect):
    """A cause of the whole fleet as a cause of one file: neutral at the fleet's values.

    Parameters
    ----------
    effect : Effect
    values : (k,) array
        Of the fleet.
    """

    def __init__(self, effect: Effect, values: np.ndarray) -> None:
        self.effect, self.values = effect, np.array(values)
        for name in ALIKE:
            setattr(self, name, getattr(effect, name))

    @cached_property
    def _parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(p if p.choices else replace(p, neutral=float(np.clip(v, *p.bounds)))
                     for p, v in zip(self.effect.parameters, self.values, strict=True))

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return self._parameters

    @property
    def component(self) -> str:
        """The component of which it is a form: a set has the fleet's lag in another strength or a further lag."""
        return self.effect.form_of or self.effect.component

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [*self._other_strengths(), *map(self._with_held, self.effect.points(signals))]

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        return [*self._other_strengths(), *map(self._with_held, self.effect.spread_points(signals, scale))]

    def _with_held(self, values: np.ndarray) -> np.ndarray:
        """A point, with the fleet's values of what is not fitted."""
        return np.where([p.held for p in self.parameters], self.values, values)

    def _other_strengths(self) -> list[np.ndarray]:
        """Points with the fleet's shapes and other strengths."""
        low, high = np.array([p.bounds for p in self.parameters]).T
        scale = np.where(np.arange(self.values.size) < self.strengths, 1.0, 0.0)
        factors = sorted((*FACTORS, *(1 / f for f in FACTORS)))
        return [np.clip(self.values * (1 + (f - 1) * scale), low, high) for f in factors]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return self.effect.applies(baseline, signals)

    def determined(self, signals: tuple[Signals, ...]) -> str | None:
        return self.effect.determined(signals)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return self.effect.compose(core, values, baseline)

    def lpv_change(self) -> LpvChange | None:
        return self.effect.lpv_change()

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return self.effect.comes_to(values, signals)

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return self.effect.stands_for(values, signals)

    def is_static(self, values: np.ndarray) -> bool:
        return self.effect.is_static(values)

    def clock_errors(self, values: np.ndarray, signals: Sequence[Signals]) -> np.ndarray:
        return self.effect.clock_errors(values, signals)
