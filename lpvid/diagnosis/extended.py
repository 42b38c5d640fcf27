"""ExtendedModel: a baseline with the causes that were found, as a model that every other command can use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid import _checks
from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.composition import Composition
from lpvid.errors import InputError
from lpvid.model.adaptable import Acting, Adaptable
from lpvid.record import Record
from lpvid.training_fingerprint import heads

if TYPE_CHECKING:
    from lpvid.diagnosis.extended_run import ExtendedRun
    from lpvid.diagnosis.refitting import Refit

TRACED = 2000
"""samples of a record on which is seen which further channels a composition reads"""


@dataclass(frozen=True, eq=False)
class ExtendedModel(Adaptable):
    """A composition at its fitted parameters.

    Attributes
    ----------
    composition : Composition
    vector : (P,) array
    covariance : (P, P) array
        NaN where a parameter lies on a bound.
    reads : tuple of str
        Roles that it needs of a record, the output apart.
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
    def of(cls, fit: Refit, covariance: np.ndarray, baseline: Baseline) -> ExtendedModel:
        """From where a refit ended.

        Parameters
        ----------
        fit : Refit
        covariance : (P, P) array
            Of its parameters; NaN for those at a bound.
        baseline : Baseline
            That the fit's effects are around.

        Returns
        -------
        ExtendedModel
            Without channels, units and ranges of training records (`remembering`).
        """
        return cls(Composition(baseline, fit.composition.effects), fit.vector, covariance)

    def remembering(self, records: Sequence[Record]) -> ExtendedModel:
        """The same model with what is needed of its training records: channels, units, ranges, first samples.

        A channel beyond those of baseline and effects counts as read where the run changes without it.

        Parameters
        ----------
        records : sequence of Record
            Prepared training records.

        Returns
        -------
        ExtendedModel
        """
        base = self.composition.baseline
        first = records[0].slice(0, min(records[0].n_samples, TRACED))
        signals = base.signals(first)
        reads = tuple(n for n in _required(self.composition) if signals.has(n))
        whole = self.composition.predict(signals, self.vector)
        for role in [r for r in signals.channels if r not in (*reads, base.output)]:
            kept = {n: c for n, c in signals.channels.items() if n != role}
            try:
                trial = self.composition.predict(replace(signals, channels=kept, cache={}, facts={}), self.vector)
            except KeyError:  # it cannot do without
                reads += (role,)
                continue
            reads += (role,) if not np.array_equal(trial, whole, equal_nan=True) else ()
        ranges = {n: (float(min(r[n].min() for r in records)), float(max(r[n].max() for r in records)))
                  for n in base.schedule if n in reads}
        training = {"records": [r.name for r in records], "n_samples": sum(r.n_samples for r in records),
                    "sample_time": records[0].sample_time, "heads": heads(records, base.output)}
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
            memory.

        Returns
        -------
        (n,) array
        """
        baseline = self.composition.baseline
        return baseline.polarity * self.composition.predict(baseline.signals(record), self.vector)

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
        from lpvid.diagnosis.extended_run import ExtendedRun

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

        A parameter that an effect had not yet when the file was written (`Effect.added_later`) is neutral.

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
        from lpvid.diagnosis.registry import named_effects

        baseline = stored_baseline(data["baseline"])
        effects = named_effects([str(e["name"]) for e in data["effects"]])
        composition = Composition(baseline, tuple(effects))
        given = {e["name"]: {p["name"]: p["value"] for p in e["parameters"]} for e in data["effects"]}
        if len(given) != len(data["effects"]):
            raise InputError("an effect stands twice in an extended model", got=", ".join(e.name for e in effects))
        vector = composition.neutral
        size = baseline.vector.size
        vector[:size] = data["baseline"]["vector"]
        known = list(range(size))
        for effect, place in zip(composition.effects, composition.places, strict=True):
            names, stored = [p.name for p in effect.parameters], given[effect.name]
            if not set(names) - set(effect.added_later) <= set(stored) <= set(names):
                raise InputError(f"the effect '{effect.name}' has other parameters here than in the file",
                                 got=", ".join(stored), why=f"this version knows {', '.join(names)}")
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


def stored_baseline(data: Mapping) -> Baseline:
    """The baseline that an extended model's file holds, by its name: lpvid's own kinds, then installed ones.

    Parameters
    ----------
    data : mapping
        ``name``, and ``data`` as from the baseline's own `to_dict`.

    Returns
    -------
    Baseline
        At the parameters that were stored.
    """
    from lpvid.diagnosis import extended_baseline, registry

    inner = data["data"]
    if inner.get("kind") == "extended":
        return extended_baseline.ExtendedBaseline(ExtendedModel.from_dict(inner["model"]))
    if inner.get("kind") == "lpv":
        from lpvid.diagnosis.lpv_baseline import LpvBaseline

        return LpvBaseline.from_dict(inner)
    if inner.get("kind") == "fleet":
        from lpvid.diagnosis.fleet_law import FleetLaw

        return FleetLaw.from_dict(inner)
    return registry.named_baseline(str(data["name"]), (), inner)


def _required(composition: Composition) -> tuple[str, ...]:
    """Roles of the baseline and needs of the effects, the output apart."""
    named = (*composition.baseline.channels, *(n for e in composition.effects for n in e.needs))
    return tuple(dict.fromkeys(n for n in named if n != composition.baseline.output))
