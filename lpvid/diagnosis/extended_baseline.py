"""ExtendedBaseline: an extended model as the baseline of a further diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lpvid.diagnosis.baseline import Baseline, Coefficient
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.extended import ExtendedModel
from lpvid.diagnosis.signals import Core, Signals
from lpvid.record import Record


@dataclass(frozen=True, eq=False)
class ExtendedBaseline(Baseline):
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
        base = self.composition.baseline
        values = {"name": "+".join((base.name, *self.model.effects)), "output": base.output,
                  "output_unit": base.output_unit, "polarity": base.polarity, "schedule": base.schedule,
                  "static": base.static and all(
                      e.is_static(self.model.vector[p])
                      for e, p in zip(self.composition.effects, self.composition.places, strict=True))}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def composition(self) -> Composition:
        """Of the model."""
        return self.model.composition

    @property
    def clock(self) -> float | None:
        return self.composition.baseline.clock

    @property
    def channels(self) -> tuple[str, ...]:
        return (*self.model.reads, self.output)

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        own = list(self.composition.baseline.coefficients)
        scales = self.composition.scales[len(own):]
        more = [(f"{e.name}.{p.name}", p) for e in self.composition.effects for p in e.parameters]
        return (*own, *(Coefficient(n, p.unit, *p.bounds, float(s)) for (n, p), s in zip(more, scales, strict=True)))

    @property
    def vector(self) -> np.ndarray:
        return np.array(self.model.vector)

    @property
    def start(self) -> int:
        return self.composition.baseline.start

    def with_vector(self, vector: np.ndarray) -> ExtendedBaseline:
        return ExtendedBaseline(replace(self.model, vector=vector))

    def signals(self, record: Record) -> Signals:
        return self.composition.baseline.signals(record)

    def core(self, vector: np.ndarray) -> Core:
        return self.composition.core(vector)

    def fit(self, records: Sequence[Record]) -> ExtendedBaseline:
        return self

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        return self.composition.sensitivities(signals, vector)

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        return []

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
