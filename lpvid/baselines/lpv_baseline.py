"""LpvBaseline: a saved model of lpvid (transfer function, state space, quasi-LPV) as the baseline of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.budgets import MOST_FREE
from lpvid.baselines.signals import ROLES, Core, Signals
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from lpvid.model.compliance import ComplianceModel
from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.rounding import STEP, TINY
from lpvid.simulation import simulate

Model = LPVTransferFunction | LPVStateSpace | SelfScheduled
ARRAYS: Mapping[type, tuple[str, ...]] = {LPVTransferFunction: ("a", "b", "c"),
                                          LPVStateSpace: ("A", "B", "C", "D", "state_offset", "output_offset")}
"""arrays of a model's free coefficients; those that are exactly zero are fixed"""
LINEAR: Mapping[type, tuple[str, ...]] = {LPVTransferFunction: ("b", "c"), LPVStateSpace: ("C", "D", "output_offset")}
"""those of them in which the free run is linear"""
SENSES = ("records", "device")
KINDS = {"lpv-transfer-function": LPVTransferFunction, "lpv-state-space": LPVStateSpace, "quasi-lpv": QuasiLPVModel,
         "compliance": ComplianceModel}
SMALL = 1e-3
"""least scale of a coefficient, as a share of the largest one in its array"""


@dataclass(frozen=True, eq=False)
class LpvBaseline(Baseline):
    """An LPV model, free in its coefficients and in the parameters of its input stage and its scheduling filter.

    Signals and simulation have the sign of the device: an output that is recorded with the other sign is reversed on
    reading.

    Attributes
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        Discrete-time, one output.
    name : str
    sense : {"records", "device"}
        Whether the model simulates the output as recorded or that of the device, with its own sign and zero.
    polarity : {1, -1}, optional
        -1 where the records' output has the other sign than the device's; read off the model's metadata if left out.
    zero : mapping of str to float
        Value of a channel that is zero in the model.
    """

    model: Model
    name: str = "lpv-model"
    sense: str = "records"
    polarity: int = 0
    zero: Mapping[str, float] = field(default_factory=dict)
    output: str = field(init=False)
    output_unit: str = field(init=False)
    static: bool = field(init=False)
    schedule: tuple[str, ...] = field(init=False)
    forward: bool = field(init=False)

    def __post_init__(self) -> None:
        if len(self.model.outputs) != 1 or self.model.sample_time is None:
            raise InputError("a baseline is a discrete-time model of one output",
                             got=f"{len(self.model.outputs)} outputs" if self.model.sample_time else "continuous time")
        _checks.one_of(self.sense, SENSES, "sense")
        output = self.model.outputs[0]
        known = -1 if self.model.metadata.get("polarity") == "reversed" else 1
        values = {"output": output.name, "output_unit": output.unit, "static": False,
                  "schedule": tuple(self.model.box.names), "polarity": self.polarity or known,
                  "forward": isinstance(self.model, LPVTransferFunction) and self.model.basis.lags == (0, 0)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def turn(self) -> int:
        """-1 where the model's output has the other sign than the device's."""
        return self.polarity if self.sense == "records" else 1

    @property
    def channels(self) -> tuple[str, ...]:
        return (*(s.name for s in self.model.inputs), *self.model.box.names, self.output)

    @cached_property
    def places(self) -> tuple[tuple[str, np.ndarray], ...]:
        """Arrays of the model and their free entries; none for a model with a vector of its own."""
        kind = type(self.model)
        listed = [(n, np.flatnonzero(getattr(self.model, n))) for n in ARRAYS.get(kind, ())]
        if sum(free.size for _, free in listed) > MOST_FREE:
            listed = [(n, free) for n, free in listed if n in LINEAR[kind]]
        return tuple(listed)

    @cached_property
    def shape(self) -> np.ndarray:
        """Indices of the input stage's free parameters."""
        stage = self.model.input_stage
        if stage is None:
            return np.zeros(0, dtype=int)
        reach = float(self.model.box.half_width[0]) if self.model.box.names else 0.0
        return np.flatnonzero(stage.scales(reach) > 0)

    @cached_property
    def coefficients(self) -> tuple[Coefficient, ...]:
        found: list[Coefficient] = []
        if isinstance(self.model, SelfScheduled):
            found += _scaled(self.model.parameter_names, self._own)
        for name, free in self.places:
            found += _scaled([f"{name}[{k}]" for k in free], np.asarray(getattr(self.model, name)).ravel()[free])
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        if stage is not None:
            reach = float(self.model.box.half_width[0]) if self.model.box.names else 0.0
            scales = stage.scales(reach)
            found += [Coefficient(f"shape[{k}]", "", -np.inf, np.inf, float(scales[k])) for k in self.shape]
        if lag is not None:
            found += [Coefficient(f"schedule_filter[{k}]", "s", 0.0, np.inf, max(float(v), self.clock))
                      for k, v in enumerate(lag.vector)]
        return tuple(found)

    @property
    def clock(self) -> float:
        return self.model.sample_time or 1.0

    @property
    def _own(self) -> np.ndarray:
        """Parameters of a model with a vector of its own, unless there are more than `MOST_FREE`."""
        known = isinstance(self.model, SelfScheduled) and self.model.vector.size <= MOST_FREE
        return np.array(self.model.vector) if known else np.zeros(0)  # type: ignore[union-attr]

    @property
    def vector(self) -> np.ndarray:
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        entries = [np.asarray(getattr(self.model, n)).ravel()[free] for n, free in self.places]
        return np.concatenate([self._own, *entries,
                               np.zeros(0) if stage is None else stage.vector[self.shape],
                               np.zeros(0) if lag is None else lag.vector])

    @property
    def start(self) -> int:
        return self.model.start

    def with_vector(self, vector: np.ndarray) -> LpvBaseline:
        return replace(self, model=self._model(vector))

    def _model(self, vector: np.ndarray) -> Model:
        vector, changes, first = np.asarray(vector, dtype=float), {}, self._own.size
        model: Any = self.model
        if first:
            model = model.with_vector(vector[:first])
        for name, free in self.places:
            values = np.array(getattr(model, name), dtype=float)
            values.ravel()[free] = vector[first: first + free.size]
            changes[name], first = values, first + free.size
        if model.input_stage is not None and self.shape.size:
            shape = model.input_stage.vector.copy()
            shape[self.shape] = vector[first: first + self.shape.size]
            changes["input_stage"], first = model.input_stage.with_vector(shape), first + self.shape.size
        if model.scheduling_stage is not None:
            changes["scheduling_stage"] = model.scheduling_stage.with_vector(vector[first:])
        return model.replace(**changes) if changes else model

    def signals(self, record: Record) -> Signals:
        period = self.model.sample_time or 0.0
        if record.sample_time is None or abs(record.sample_time - period) > RATE_TOLERANCE * period:
            raise InputError(f"record '{record.name}' has another rate than the model",
                             mend=f"--sample-rate {1 / period:.6g}")
        names = dict.fromkeys((*self.channels, *(r for r in ROLES if record.has(r))))
        channels = {n: record[n] - self.zero.get(n, 0.0) for n in names if n != self.output}
        return Signals(record.sample_time, channels, self.polarity * record[self.output], record.name)

    def core(self, vector: np.ndarray) -> Core:
        try:
            with np.errstate(all="ignore"):
                model = self._model(vector)
        except InputError:  # parameters that are not finite
            return lambda s: np.full(s.n_samples, np.nan)
        units = {s.name: s.unit for s in (*model.inputs, *model.outputs)}
        units |= dict(zip(model.box.names, model.box.units, strict=True))
        offsets = {n: self.zero.get(n, 0.0) if self.sense == "records" else 0.0 for n in self.channels
                   if n != self.output}

        def run(s: Signals) -> np.ndarray:
            channels = {n: Channel(s[n] + offset, units.get(n, "")) for n, offset in offsets.items()}
            past = Channel(self.turn * s.output, self.output_unit)
            record = Record({**channels, self.output: past}, model.sample_time)
            return self.turn * simulate(model, record).output[:, 0]

        return run

    def fit(self, records: Sequence[Record]) -> LpvBaseline:
        return self

    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        here = self.core(vector)(signals)
        out, exact = np.empty((signals.n_samples, vector.size)), self._by_recursion(signals, vector, here)
        known = 0 if exact is None else exact.shape[1]
        if exact is not None:
            out[:, :known] = exact
        for j, coefficient in list(enumerate(self.coefficients))[known:]:
            moved = np.array(vector)
            moved[j] += STEP * coefficient.scale
            out[:, j] = (self.core(moved)(signals) - here) / (moved[j] - vector[j])
        return np.nan_to_num(out, nan=0.0, posinf=0.0, neginf=0.0)

    def _by_recursion(self, signals: Signals, vector: np.ndarray, here: np.ndarray) -> np.ndarray | None:
        """(n, k) derivative in the coefficients of a transfer function, the first k parameters; None for others."""
        from lpvid.baselines.lpv_tangent import free_run_sensitivities

        if not self.forward or not np.isfinite(here).all() or not np.isfinite(vector).all():
            return None
        found = {n: signals[n] + (self.zero.get(n, 0.0) if self.sense == "records" else 0.0) for n in self.channels
                 if n != self.output}
        slopes = free_run_sensitivities(self._model(vector), signals.replace(**found),  # type: ignore[arg-type]
                                        self.turn * here, self.places)
        return None if slopes is None else self.turn * slopes

    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        return []

    def to_dict(self) -> dict:
        return {"kind": "lpv", "name": self.name, "model": self.model.to_dict(), "sense": self.sense,  # type: ignore[union-attr]
                "polarity": self.polarity, "zero": dict(self.zero)}

    @classmethod
    def from_dict(cls, data: Mapping) -> LpvBaseline:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            As from `to_dict`; ``sense``, ``polarity`` and ``zero`` may be missing.

        Returns
        -------
        LpvBaseline

        Raises
        ------
        InputError
            A model of a kind that is none of `KINDS`.
        """
        inner: Any = data["model"]
        if inner.get("kind") not in KINDS:
            raise InputError("the model inside a baseline is of no known kind", got=inner.get("kind"))
        return cls(KINDS[inner["kind"]].from_dict(inner), str(data["name"]), str(data.get("sense", "records")),
                   int(data.get("polarity", 0)), dict(data.get("zero", {})))


def _scaled(names: Sequence[str], values: np.ndarray) -> list[Coefficient]:
    """Coefficients without bounds; the scale of each is its size, `SMALL` of the largest at least."""
    largest = max(float(np.abs(values).max(initial=0.0)), TINY)
    return [Coefficient(n, "", -np.inf, np.inf, max(abs(float(v)), SMALL * largest))
            for n, v in zip(names, values, strict=bool(values.size))]
