"""Several models of any kind on the same records, best free run first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid._shown import Shown
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.model.adaptable import Adaptable
from lpvid.record import Record
from lpvid.simulation import Model
from lpvid.validation.report import Validation, acting_model, validate


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One model on the data.

    Attributes
    ----------
    name : str
    model : Model
        As it ran: what an `Adaptable` gives for its rate.
    found : Validation
    """

    name: str
    model: Model
    found: Validation

    @property
    def esr(self) -> float:
        """Pooled free-run ESR; infinite where the run diverges or the output does not move."""
        esr = self.found.overall.free_run.esr
        return np.inf if esr is None else esr


@dataclass(frozen=True, eq=False)
class ModelComparison(Shown):
    """Models of one output on the same records, by their pooled free-run ESR; prints itself.

    Attributes
    ----------
    models : tuple of ComparedModel
        Best first.
    refused : mapping of str to str
        Models that cannot run on these records, and why.
    """

    models: tuple[ComparedModel, ...]
    refused: Mapping[str, str]

    @property
    def verdict(self) -> str:
        """One sentence."""
        best = self.models[0]
        label = best.found.label
        if not np.isfinite(best.esr):
            return f"No model has a free run on these {label} records."
        after = self.models[1] if len(self.models) > 1 else None
        rest = "" if after is None else f"; next is {after.name}: {after.found.overall.free_run}"
        return f"Least free-run error on {label} data: {best.name}: {best.found.overall.free_run}{rest}."

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes of the validations, those of some models with their names: a swapped sign, resampling."""
        found: dict[str, list[str]] = {}
        for m in self.models:
            for note in m.found.notes:
                found.setdefault(note, []).append(m.name)
        return tuple(note if len(names) == len(self.models) else f"{', '.join(names)}: {note}"
                     for note, names in found.items())

    def to_dict(self) -> dict[str, Any]:
        """compare.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "lpvid/compare/1", "verdict": self.verdict,
                "models": [{"name": m.name, "kind": type(m.model).__name__, **m.found.to_dict()} for m in self.models],
                "refused": dict(self.refused)}

    def __repr__(self) -> str:
        lines = [self.verdict]
        lines += [f"  {m.name} ({m.found.label}): {m.found.overall.free_run}; {m.found.overall.one_step}"
                  for m in self.models]
        lines += [f"  {name} cannot run here: {why}" for name, why in self.refused.items()]
        return "\n".join([*lines, *(f"  note: {n}" for n in self.remarks)])


def compare_models(models: Mapping[str, Model | Adaptable], records: Record | Sequence[Record], *,
                   sample_rate: float | None = None, label: str | None = None,
                   fitted: Callable[[Model, list[Record]], list[Record]] | None = None) -> ModelComparison:
    """Validate several models on the same records and rank them by their pooled free run.

    Parameters
    ----------
    models : mapping of str to model
        Of any kind that `validate` takes; all of one output.
    records : Record or sequence of Record
        Resampled to each model's own rate.
    sample_rate : float, optional
        For models without a rate of their own [Hz].
    label : str, optional
        "held-out" or "training"; records that a model was fitted to are labelled as what they are. As for `validate`.
    fitted : callable, optional
        Records with the roles that one model reads.

    Returns
    -------
    ModelComparison

    Raises
    ------
    InputError
        No models, models of different outputs, or none that can run on these records.

    Examples
    --------
    >>> import lpvid as lpv
    >>> exact = lpv.LPVTransferFunction.siso([], [[2.0]], lpv.Polynomial(), 0.1, inputs="u", outputs="y")
    >>> half = lpv.LPVTransferFunction.siso([], [[1.0]], lpv.Polynomial(), 0.1, inputs="u", outputs="y")
    >>> record = lpv.Record({"u": [0.0, 1.0, -1.0, 2.0], "y": [0.0, 2.0, -2.0, 4.0]}, 0.1)
    >>> [m.name for m in compare_models({"half": half, "exact": exact}, record).models]
    ['exact', 'half']
    """
    listed = as_records(records)
    _checks.instance(models, Mapping, "models are compared by name",
                     'compare_models({"first": one, "second": two}, records)')
    if not models:
        raise InputError("no models to compare")
    rows, refused = [], {}
    for name, given in models.items():
        try:
            model = acting_model(given, listed, sample_rate)
            own = listed if fitted is None else fitted(model, listed)
            rows.append(ComparedModel(name, model, validate(model, own, sample_rate=sample_rate, label=label)))
        except InputError as error:
            refused[name] = str(error)
    if not rows:
        name, why = next(iter(refused.items()))
        what = f"none of the {len(models)} models can" if len(models) > 1 else "the model cannot"
        raise InputError(f"{what} run on these records", got=f"{name}: {why}")
    outputs = {m.model.outputs[0].name for m in rows}
    if len(outputs) > 1:
        raise InputError("models of different outputs cannot be compared", got=", ".join(sorted(outputs)),
                         mend="compare the models of one output at a time")
    return ModelComparison(tuple(sorted(rows, key=lambda m: m.esr)), refused)
