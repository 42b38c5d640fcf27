"""ExtendedModel: a baseline with the causes that were found, as a model that every other command can use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.composition import Composition
from lpvid.record import Record

if TYPE_CHECKING:
    from lpvid.diagnosis.refitting import Refit


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """A composition at its fitted parameters.

    Attributes
    ----------
    composition : Composition
    vector : (P,) array
    covariance : (P, P) array
        NaN where a parameter lies on a bound.
    metadata : mapping
    """

    composition: Composition
    vector: np.ndarray
    covariance: np.ndarray
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, fit: Refit, covariance: np.ndarray, baseline: Baseline) -> ExtendedModel:
        """From where a refit ended."""
        return cls(Composition(baseline, fit.composition.effects), fit.vector, covariance)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes in it."""
        return tuple(e.name for e in self.composition.effects)

    def predict(self, record: Record) -> np.ndarray:
        """(n,) free run along a record, in the output's unit."""
        return self.composition.predict(self.composition.baseline.signals(record), self.vector)

    def __repr__(self) -> str:
        return f"ExtendedModel: {self.composition.baseline.name} with {', '.join(self.effects) or 'nothing added'}"
