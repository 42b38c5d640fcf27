"""LpvBaseline: a saved model of lpvid (transfer function, state space, quasi-LPV) as what a diagnosis starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.diagnosis.baseline import Baseline, Coefficient
from lpvid.diagnosis.preparing import ROLES
from lpvid.diagnosis.signals import Core, Signals
from lpvid.errors import InputError
from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.simulation import simulate

Model = LPVTransferFunction | LPVStateSpace | SelfScheduled
ARRAYS: Mapping[type, tuple[str, ...]] = {LPVTransferFunction: ("a", "b", "c"),
                                          LPVStateSpace: ("A", "B", "C", "D", "state_offset", "output_offset")}
"""where the free numbers of a model stand; those that are exactly zero are structure"""
STEP = 1e-6
"""share of a number's scale by which it is moved to see what it does"""
SMALL = 1e-3
"""scale of a number, as a share of the largest in its array, where the number itself is smaller"""


@dataclass(frozen=True, eq=False)
class LpvBaseline(Baseline):
    """An LPV model, free in its coefficients; its input stage and scheduling filter stay as they were fitted.

    Attributes
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        Discrete-time, one output.
    name : str
    """

    model: Model
    name: str = "lpv-model"
    output: str = field(init=False)
    output_unit: str = field(init=False)
    static: bool = field(init=False)
    polarity: int = field(default=1, init=False)
    schedule: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        if len(self.model.outputs) != 1 or self.model.sample_time is None:
            raise InputError("a baseline is a discrete-time model of one output",
                             got=f"{len(self.model.outputs)} outputs" if self.model.sample_time else "continuous time")
        output = self.model.outputs[0]
        values = {"output": output.name, "output_unit": output.unit, "static": False,
                  "schedule": tuple(self.model.box.names)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> tuple[str, ...]:
        return (*(s.name for s in self.model.inputs), *self.model.box.names, self.output)

    @cached_property
    def places(self) -> tuple[tuple[str, np.ndarray], ...]:
        """Arrays of the model and which of their entries are free; none for a model that knows its own vector."""
        return tuple((n, np.flatnonzero(getattr(self.model, n))) for n in ARRAYS.get(type(self.model), ()))

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        if isinstance(self.model, SelfScheduled):
            largest = max(float(np.abs(self.vector).max(initial=0.0)), 1e-300)
            return tuple(Coefficient(n, "", -np.inf, np.inf, max(abs(float(v)), SMALL * largest))
                         for n, v in zip(self.model.parameter_names, self.vector, strict=True))
        found = []
        for name, free in self.places:
            values = np.asarray(getattr(self.model, name)).ravel()[free]
            largest = float(np.abs(values).max(initial=0.0))
            found += [Coefficient(f"{name}[{k}]", "", -np.inf, np.inf, max(abs(float(v)), SMALL * largest))
                      for k, v in zip(free, values, strict=True)]
        return tuple(found)

    @property
    def vector(self) -> np.ndarray:
        if isinstance(self.model, SelfScheduled):
            return np.array(self.model.vector)
        return np.concatenate([np.asarray(getattr(self.model, n)).ravel()[free] for n, free in self.places])

    @property
    def start(self) -> int:
        return self.model.start

    def with_vector(self, vector: np.ndarray) -> LpvBaseline:
        return LpvBaseline(self._model(vector), self.name)

    def _model(self, vector: np.ndarray) -> Model:
        if isinstance(self.model, SelfScheduled):
            return self.model.with_vector(np.asarray(vector, dtype=float))
        changes, first = {}, 0
        for name, free in self.places:
            values = np.array(getattr(self.model, name), dtype=float)
            values.ravel()[free] = vector[first: first + free.size]
            changes[name], first = values, first + free.size
        return self.model.replace(**changes)

    def signals(self, record: Record) -> Signals:
        period = self.model.sample_time or 0.0
        if record.sample_time is None or abs(record.sample_time - period) > RATE_TOLERANCE * period:
            raise InputError(f"record '{record.name}' has another rate than the model",
                             mend=f"--sample-rate {1 / period:.6g}")
        names = dict.fromkeys((*self.channels, *(r for r in ROLES if record.has(r))))
        channels = {n: record[n] for n in names if n != self.output}
        return Signals(record.sample_time, channels, record[self.output], record.name)

    def core(self, vector: np.ndarray) -> Core:
        model = self._model(vector)
        units = {s.name: s.unit for s in (*model.inputs, *model.outputs)}
        units |= dict(zip(model.box.names, model.box.units, strict=True))
        wanted = [n for n in self.channels if n != self.output]

        def run(s: Signals) -> np.ndarray:
            channels = {n: Channel(s[n], units.get(n, "")) for n in wanted}
            record = Record({**channels, self.output: Channel(s.output, self.output_unit)}, model.sample_time)
            return simulate(model, record).output[:, 0]

        return run

    def fit(self, records: Sequence[Record]) -> LpvBaseline:
        return self

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        here = self.core(vector)(signals)
        out = np.empty((signals.n_samples, vector.size))
        for j, coefficient in enumerate(self.coefficients):
            moved = np.array(vector)
            moved[j] += STEP * coefficient.scale
            out[:, j] = (self.core(moved)(signals) - here) / (moved[j] - vector[j])
        return np.nan_to_num(out, nan=0.0, posinf=0.0, neginf=0.0)

    def to_dict(self) -> dict:
        return {"kind": "lpv", "name": self.name, "model": self.model.to_dict()}  # type: ignore[union-attr]

    @classmethod
    def from_dict(cls, data: Mapping) -> LpvBaseline:
        """Inverse of `to_dict`."""
        inner: Any = data["model"]
        kinds = {"lpv-transfer-function": LPVTransferFunction, "lpv-state-space": LPVStateSpace,
                 "quasi-lpv": QuasiLPVModel}
        if inner.get("kind") not in kinds:
            raise InputError("the model inside a baseline is of no known kind", got=inner.get("kind"))
        return cls(kinds[inner["kind"]].from_dict(inner), str(data["name"]))
