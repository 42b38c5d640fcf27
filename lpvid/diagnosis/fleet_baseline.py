"""FleetBaseline: the law of a fleet with what its healthy files share, from which one file may differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from lpvid.diagnosis.baseline import Baseline, Coefficient
from lpvid.diagnosis.common_error import CommonError
from lpvid.diagnosis.lpv_baseline import LpvBaseline
from lpvid.diagnosis.signals import Core, Signals
from lpvid.record import Record

WITHIN = 3.0
"""standard deviations between the healthy specimens by which a file's own law may lie off their mean: 99.7 % of
normal specimens; beyond it there is a cause"""


@dataclass(frozen=True, eq=False)
class FleetBaseline(Baseline):
    """f(u) + e₀(u) + Σ z_k e_k(u): what healthy files share, free only within the spread of their specimens.

    f is the free run of the fleet's law, e₀ its error in all healthy files alike, e_k directions in which the specimens
    differ. A diagnosis against it names what one file has beyond the others: what the law lacks in every file is in e₀.

    Attributes
    ----------
    law : LpvBaseline
    error : CommonError
    at : (K,) array
        z, in standard deviations between the specimens.
    """

    law: LpvBaseline
    error: CommonError
    at: np.ndarray
    name: str = field(init=False, default="fleet")
    output: str = field(init=False)
    output_unit: str = field(init=False)
    static: bool = field(init=False, default=False)
    polarity: int = field(init=False)
    schedule: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        for name in ("output", "output_unit", "polarity", "schedule"):
            object.__setattr__(self, name, getattr(self.law, name))

    @classmethod
    def of(cls, law: LpvBaseline, error: CommonError) -> FleetBaseline:
        """At the mean of the fleet."""
        return cls(law, error, np.zeros(len(error.modes)))

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Of the law: the roles that its channels had in training."""
        return self.law.model.metadata

    @property
    def clock(self) -> float:
        return self.law.clock

    @property
    def channels(self) -> tuple[str, ...]:
        return self.law.channels

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(f"specimen[{k}]", "", -WITHIN, WITHIN, 1.0) for k in range(self.at.size))

    @property
    def vector(self) -> np.ndarray:
        return np.array(self.at)

    @property
    def start(self) -> int:
        return self.law.start

    def with_vector(self, vector: np.ndarray) -> FleetBaseline:
        return replace(self, at=np.asarray(vector, dtype=float))

    def signals(self, record: Record) -> Signals:
        return self.law.signals(record)

    def core(self, vector: np.ndarray) -> Core:
        weights = np.concatenate([[1.0, 1.0], np.asarray(vector, dtype=float)])
        return lambda s: weights @ self._parts(s)

    def fit(self, records: Sequence[Record]) -> FleetBaseline:
        """The specimen's place within the fleet, by least squares."""
        if not self.at.size:
            return self
        from scipy.optimize import lsq_linear

        rows, errors = [], []
        for s in map(self.signals, records):
            parts = self._parts(s)[:, self.start:]
            rows.append(parts[2:].T)
            errors.append(s.output[self.start:] - parts[0] - parts[1])
        found = lsq_linear(np.vstack(rows), np.concatenate(errors), (-WITHIN, WITHIN))
        return self.with_vector(found.x)

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        return self._parts(signals)[2:].T

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        return []

    def _parts(self, s: Signals) -> np.ndarray:
        """(2 + K, n) free run of the law, common error, a standard deviation of every mode."""
        def made() -> np.ndarray:
            run = self.law.core(self.law.vector)(s)
            with np.errstate(all="ignore"):
                return np.vstack([run, self.error.along(s, run)])

        return s.cached(("fleet", self.error), made)

    def to_dict(self) -> dict:
        return {"kind": "fleet", "law": self.law.to_dict(), "error": self.error.to_dict(), "at": self.at.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping) -> FleetBaseline:
        """Inverse of `to_dict`."""
        return cls(LpvBaseline.from_dict(data["law"]), CommonError.from_dict(data["error"]),
                   np.array(data["at"], dtype=float))
