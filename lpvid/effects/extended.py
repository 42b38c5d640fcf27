"""ExtendedModel: a baseline with the causes found in it, as a model for all other commands."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from lpvid import _checks
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.named import named_baseline
from lpvid.condition.band_limited import IN_BAND
from lpvid.effects.catalogues import named_effects
from lpvid.effects.composition import Composition
from lpvid.errors import InputError
from lpvid.model.adaptable import Acting, Adaptable
from lpvid.model.noise_model import NoiseModel
from lpvid.model.quasi import SelfScheduled
from lpvid.model.signals import Signal
from lpvid.record import Channel, Record
from lpvid.rounding import EXPLODED
from lpvid.scheduling import Scheduling
from lpvid.training_fingerprint import SLACK
from lpvid.training_rows import TrainingRows

KINDS = {"extended": ("lpvid.effects.extended_baseline", "ExtendedBaseline"),
         "fleet": ("lpvid.effects.fleet_law", "FleetLaw"), "lpv": ("lpvid.baselines.lpv_baseline", "LpvBaseline")}
"""modules of lpvid's own kinds of baseline, by the kind in their files"""


class FittedComposition(Protocol):
    """What a fit has found: a composition and its parameters."""

    @property
    def composition(self) -> Composition:
        """Baseline and effects."""
        ...

    @property
    def vector(self) -> np.ndarray:
        """(P,) parameters."""
        ...


@dataclass(frozen=True, eq=False)
class ExtendedModel(Adaptable):
    """A composition at its fitted parameters.

    Attributes
    ----------
    composition : Composition
    vector : (P,) array
    covariance : (P, P) array
        NaN where a parameter is at a bound.
    reads : tuple of str
        Roles that it reads, without the output.
    units : mapping of str to str
        Units of those roles.
    ranges : mapping of str to (float, float)
        Of the roles that schedule it, in the training data.
    metadata : mapping
    """

    composition: Composition
    vector: np.ndarray
    covariance: np.ndarray
    reads: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        size = self.composition.neutral.size
        set_ = object.__setattr__
        vector = _checks.shaped(_checks.frozen_array(self.vector, "parameters", ndim=1), (size,), "parameters")
        set_(self, "vector", _checks.finite(vector, "parameters"))
        covariance = _checks.frozen_array(self.covariance, "covariance", ndim=2)
        set_(self, "covariance", _checks.shaped(covariance, (size, size), "covariance"))
        if not self.reads:
            set_(self, "reads", _required(self.composition))

    @classmethod
    def of(cls, fit: FittedComposition, covariance: np.ndarray, baseline: Baseline) -> ExtendedModel:
        """From the result of a fit.

        Parameters
        ----------
        fit : FittedComposition
        covariance : (P, P) array
            Of its parameters; NaN for those at a bound.
        baseline : Baseline
            Around which the effects are composed.

        Returns
        -------
        ExtendedModel
            Without channels, units and ranges of training records (`remembering`).
        """
        return cls(Composition(baseline, fit.composition.effects), fit.vector, covariance)

    def remembering(self, records: Sequence[Record], raw: Sequence[Record] = (),
                    samples: int | None = None) -> ExtendedModel:
        """The same model with channels, units, ranges and prints of rows of its training records.

        A channel beyond those of baseline and effects counts as read where the simulation changes without it.

        Parameters
        ----------
        records : sequence of Record
            Prepared training records.
        raw : sequence of Record
            The same as read, by whose rows it recognises them; the prepared ones without any.
        samples : int, optional
            Of the first record, along which the channels that it reads are determined; all of them by default.

        Returns
        -------
        ExtendedModel
        """
        base = self.composition.baseline
        signals = base.signals(records[0].slice(0, min(records[0].n_samples, samples or records[0].n_samples)))
        reads = tuple(n for n in _required(self.composition) if signals.has(n))
        whole = self.composition.predict(signals, self.vector)
        for role in [r for r in signals.channels if r not in (*reads, base.output)]:
            kept = {n: c for n, c in signals.channels.items() if n != role}
            try:
                trial = self.composition.predict(replace(signals, channels=kept, cache={}, facts={}), self.vector)
            except KeyError:  # the simulation requires it
                reads += (role,)
                continue
            reads += (role,) if not np.array_equal(trial, whole, equal_nan=True) else ()
        ranges = {n: (float(min(r[n].min() for r in records)), float(max(r[n].max() for r in records)))
                  for n in base.schedule if n in reads}
        training = {"records": [r.name for r in records], "n_samples": sum(r.n_samples for r in records),
                    "sample_time": records[0].sample_time,
                    "rows": TrainingRows.of(raw or records, base.output).to_dict()}
        return replace(self, reads=reads, units={n: records[0].unit(n) for n in reads}, ranges=ranges,
                       metadata={**self.metadata, "training": training})

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes in it."""
        return tuple(e.name for e in self.composition.effects)

    @property
    def period(self) -> float | None:
        """Period of its training data [s]."""
        given = self.metadata.get("training", {}).get("sample_time")
        return None if given is None else _checks.positive(given, "sample_time of the training", "s")

    def predict(self, record: Record) -> np.ndarray:
        """(n,) free run along a record, in the output's unit and the record's sense.

        Parameters
        ----------
        record : Record
            Uniform, with the channels of `reads` and of the output, whose first samples begin the run of a law with
            output lags. It may begin in mid-motion (`Composition.free_run`).

        Returns
        -------
        (n,) array
        """
        baseline = self.composition.baseline
        return baseline.polarity * self.composition.free_run(baseline.signals(record), self.vector)

    def to_model(self, sample_time: float) -> ExtendedRun:
        """As a model of lpvid at this period; its predictions are its free run.

        Parameters
        ----------
        sample_time : float
            [s].

        Returns
        -------
        ExtendedRun
        """
        return ExtendedRun(self, sample_time)

    def to_linear_model(self) -> Acting:
        """Refused: causes are put around the baseline's own simulation.

        Returns
        -------
        Acting
            Never.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError("an extended model has no LPV form", why="its causes act around the baseline's simulation",
                         mend="extended_lpv.json beside it, where the causes have an LPV form")

    # -- storing -----------------------------------------------------------------------------------------------------
    def to_dict(self) -> dict:
        """Plain data for JSON: the baseline at its parameters, effects by name with theirs.

        Returns
        -------
        dict
            A NaN of the covariance is None.
        """
        c = self.composition
        size = c.baseline.vector.size
        fitted = c.baseline.with_vector(self.vector[:size])
        effects = [{"name": e.name, "parameters": [{"name": p.name, "value": float(v), "unit": p.unit}
                                                   for p, v in zip(e.parameters, self.vector[place], strict=True)]}
                   for e, place in zip(c.effects, c.places, strict=True)]
        covariance = [[v if np.isfinite(v) else None for v in row] for row in self.covariance.tolist()]
        return {"baseline": {"name": c.baseline.name, "data": fitted.to_dict(), "vector": self.vector[:size].tolist()},
                "effects": effects, "covariance": covariance, "reads": list(self.reads), "units": dict(self.units),
                "ranges": {n: list(v) for n, v in self.ranges.items()}, "metadata": dict(self.metadata)}

    @classmethod
    def from_dict(cls, data: Mapping) -> ExtendedModel:
        """Inverse of `to_dict`; baseline and effects are looked up among those of the installed packages.

        A parameter that was added to an effect after the file was written (`Effect.added_later`) is neutral.

        Parameters
        ----------
        data : mapping
            As from `to_dict`.

        Returns
        -------
        ExtendedModel

        Raises
        ------
        InputError
            A baseline or an effect that no installed package has, parameters that are not those of the effect.
        """
        baseline = stored_baseline(data["baseline"])
        effects = named_effects([str(e["name"]) for e in data["effects"]])
        composition = Composition(baseline, tuple(effects))
        given = {e["name"]: {p["name"]: p["value"] for p in e["parameters"]} for e in data["effects"]}
        if len(given) != len(data["effects"]):
            raise InputError("an extended model has an effect twice", got=", ".join(e.name for e in effects))
        vector = composition.neutral
        size = baseline.vector.size
        if len(data["baseline"]["vector"]) != size:
            raise InputError(f"the baseline {baseline.name} of the extended model has {size} parameters here",
                             got=f"{len(data['baseline']['vector'])} in the file",
                             why="a later version added a parameter", mend="diagnose its records again")
        vector[:size] = data["baseline"]["vector"]
        known = list(range(size))
        for effect, place in zip(composition.effects, composition.places, strict=True):
            names, stored = [p.name for p in effect.parameters], given[effect.name]
            now = {old: p.name for p in effect.parameters for old in p.former}
            stored = {now.get(str(name), str(name)): value for name, value in stored.items()}
            if not set(names) - set(effect.added_later) <= set(stored) <= set(names):
                raise InputError(f"the effect '{effect.name}' has other parameters here than in the file",
                                 got=", ".join(stored), why=f"this version has {', '.join(names)}")
            for k, name in enumerate(names, place.start):
                if name in stored:
                    vector[k] = _checks.real(stored[name], f"{name} of {effect.name}")
                    known.append(k)
        square = np.array([[np.nan if v is None else v for v in row] for row in data["covariance"]], dtype=float)
        covariance = np.full((vector.size, vector.size), np.nan)
        covariance[np.ix_(known, known)] = _checks.shaped(square, (len(known), len(known)), "covariance")
        return cls(composition, vector, covariance, tuple(data["reads"]), dict(data["units"]),
                   {n: (float(v[0]), float(v[1])) for n, v in data["ranges"].items()}, dict(data["metadata"]))

    def __repr__(self) -> str:
        c = self.composition
        lines = [f"ExtendedModel: {c.baseline.name} with {', '.join(self.effects) or 'nothing added'}"]
        for effect, place in zip(c.effects, c.places, strict=True):
            shown = ", ".join(f"{p.name} {p.choice(v) or f'{v:.4g} {p.unit}'}".rstrip() for p, v in
                              zip(effect.parameters, self.vector[place], strict=True))
            lines.append(f"  {effect.name}: {shown}")
        return "\n".join(lines)


def _required(composition: Composition) -> tuple[str, ...]:
    """Roles of the baseline and needs of the effects, without the output."""
    named = (*composition.baseline.channels, *(n for e in composition.effects for n in e.needs))
    return tuple(dict.fromkeys(n for n in named if n != composition.baseline.output))


def stored_baseline(data: Mapping) -> Baseline:
    """The baseline that an extended model's file holds: one of lpvid's own kinds, or an installed one by its name.

    Parameters
    ----------
    data : mapping
        ``name``, and what the baseline's `to_dict` wrote under ``data``.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        A name that no installed package has.
    """
    inner = data["data"]
    if inner.get("kind") not in KINDS:
        return named_baseline(str(data["name"]), (), inner)
    module, name = KINDS[inner["kind"]]
    return getattr(importlib.import_module(module), name).from_dict(inner)


@dataclass(frozen=True, eq=False)
class ExtendedRun(SelfScheduled):
    """A composition along records as measured: its channels in, its output out, in the records' sense.

    It was fitted to its free run and has no noise model of its own: the prediction from any past is the free run.

    Attributes
    ----------
    model : ExtendedModel
    sample_time : float
        [s].
    """

    model: ExtendedModel
    sample_time: float
    scheduling_stage: None = None

    @property
    def scheduled(self) -> tuple[str, ...]:
        """Roles that schedule it."""
        return tuple(n for n in self.model.composition.baseline.schedule if n in self.model.reads)

    @property
    def box(self) -> Scheduling:  # type: ignore[override]
        """Training range of the scheduling variables, wider by `SLACK`; not where one was always zero."""
        ranges = [self.model.ranges.get(n, (-EXPLODED, EXPLODED)) for n in self.scheduled]
        slack = [SLACK * max(b - a, abs(a), abs(b)) for a, b in ranges]
        return Scheduling(self.scheduled, tuple(a - s for (a, _), s in zip(ranges, slack, strict=True)),
                          tuple(b + s for (_, b), s in zip(ranges, slack, strict=True)),
                          units=tuple(self.model.units.get(n, "") for n in self.scheduled))

    @property
    def inputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """The other roles that it reads."""
        return tuple(Signal(n, self.model.units.get(n, "")) for n in self.model.reads if n not in self.scheduled)

    @property
    def outputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Its output."""
        baseline = self.model.composition.baseline
        return (Signal(baseline.output, baseline.output_unit),)

    @property
    def metadata(self) -> Mapping[str, Any]:  # type: ignore[override]
        """That of the model, by which its training data are recognised."""
        turned = {"polarity": "reversed"} if self.model.composition.baseline.polarity < 0 else {}
        return {**self.model.metadata, **IN_BAND, **turned}

    @property
    def start(self) -> int:
        return self.model.composition.baseline.start

    @property
    def memory(self) -> int:
        return self.start

    @property
    def noise(self) -> NoiseModel:
        return NoiseModel("output")

    @property
    def vector(self) -> np.ndarray:
        return self.model.vector

    def with_vector(self, vector: np.ndarray) -> ExtendedRun:
        """The same run with other parameters.

        Parameters
        ----------
        vector : (P,) array
            The baseline's, then each effect's.

        Returns
        -------
        ExtendedRun
        """
        return self.replace(model=replace(self.model, vector=vector))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.model.composition.names

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        columns = {s.name: (u[:, k], s.unit) for k, s in enumerate(self.inputs)}
        columns |= {n: (p[:, k], self.model.units.get(n, "")) for k, n in enumerate(self.scheduled)}
        measured = np.zeros(len(u))
        if past.size:
            measured[:] = past[-1]
            measured[: past.size] = past
        output = self.outputs[0]
        channels = {n: Channel(v, unit) for n, (v, unit) in columns.items()}
        record = Record({**channels, output.name: Channel(measured, output.unit)}, self.sample_time)
        with np.errstate(over="ignore", invalid="ignore"):
            y = np.array(self.model.predict(record))
        y[: past.size] = past
        bounded = np.abs(y) < limit
        return y, None if bounded.all() else int(np.argmin(bounded))

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """The free run, whatever the horizon: without a noise model, later outputs do not change the prediction.

        Parameters
        ----------
        u : (n, inputs) array
            By `inputs`.
        p : (n, scheduled) array
            By `scheduled`.
        y : (n,) array
            Measured outputs, of which the first `start` begin the run.
        horizon : int
            Without effect.

        Returns
        -------
        (n,) array
            In the output's unit; the first `start` are y.
        """
        return self.free_run(u, p, y[: self.start], np.inf)[0]

    def __repr__(self) -> str:
        return f"{self.model!r} at {1 / self.sample_time:.6g} Hz"
