"""ExtendedBaseline: an extended model as the baseline of a further diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lpvid.baselines.baseline import Coefficient
from lpvid.effects.composition import Composition, CompositionBaseline
from lpvid.effects.extended import ExtendedModel


@dataclass(frozen=True, eq=False)
class ExtendedBaseline(CompositionBaseline):
    """Baseline and effects of an extended model as one, all parameters free; further effects are composed around it.

    It counts as static where the baseline is and no effect has a memory.

    Attributes
    ----------
    model : ExtendedModel
    """

    model: ExtendedModel
    name: str = field(init=False)
    output: str = field(init=False)
    output_unit: str = field(init=False)
    static: bool = field(init=False)
    polarity: int = field(init=False)
    schedule: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        base = self.inner.baseline
        values = {"name": "+".join((base.name, *self.model.effects)), "output": base.output,
                  "output_unit": base.output_unit, "polarity": base.polarity, "schedule": base.schedule,
                  "static": base.static and all(
                      e.is_static(self.model.vector[p])
                      for e, p in zip(self.inner.effects, self.inner.places, strict=True))}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def inner(self) -> Composition:
        return self.model.composition

    @property
    def channels(self) -> tuple[str, ...]:
        return (*self.model.reads, self.output)

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        own = list(self.inner.baseline.coefficients)
        scales = self.inner.scales[len(own):]
        more = [(f"{e.name}.{p.name}", p) for e in self.inner.effects for p in e.parameters]
        return (*own, *(Coefficient(n, p.unit, *p.bounds, float(s)) for (n, p), s in zip(more, scales, strict=True)))

    @property
    def vector(self) -> np.ndarray:
        return np.array(self.model.vector)

    def with_vector(self, vector: np.ndarray) -> ExtendedBaseline:
        return ExtendedBaseline(replace(self.model, vector=vector))

    def to_dict(self) -> dict:
        return {"kind": "extended", "model": self.model.to_dict()}

    @classmethod
    def from_dict(cls, data: Mapping) -> ExtendedBaseline:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping

        Returns
        -------
        ExtendedBaseline
        """
        return cls(ExtendedModel.from_dict(data["model"]))
