"""Task: the records, the baseline and the candidates of a diagnosis, from what a user gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import ROLES
from lpvid.condition.segmentation import refuse_text
from lpvid.condition.tables import as_records
from lpvid.effects.composition import ComposedBaseline
from lpvid.effects.effect import Effect
from lpvid.effects.given import as_baseline, as_effects, by_roles, channels_of, opened, rate_of
from lpvid.effects.preparing import PreparedRecords, prepare
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.training_fingerprint import recalled

Progress = Callable[[str], None]
AUTO = "auto"
"""instead of a baseline's name: the installed law that describes the records best"""


@dataclass(frozen=True, eq=False)
class DiagnosisTask:
    """Prepared records, baseline and catalogue of a diagnosis.

    Attributes
    ----------
    prepared : PreparedRecords
        Records on one clock.
    baseline : Baseline
        Fitted only if its parameters were given.
    fitted : bool
        Whether the parameters were given: the search starts from them, and `esr_as_given` is their error.
    catalogue : tuple of Effect
    raw : tuple of Record
        As read, for the audit.
    baseline_fitted : bool
        Whether the baseline has been fitted to these records already.
    n_training : int or None
        How many of `raw` are training records, which come first; None for all.
    """

    prepared: PreparedRecords
    baseline: Baseline
    fitted: bool
    catalogue: tuple[Effect, ...]
    raw: tuple[Record, ...]
    baseline_fitted: bool = False
    n_training: int | None = None

    @property
    def raw_training(self) -> tuple[Record, ...]:
        """Training records as read."""
        return self.raw[: self.n_training]

    @property
    def training_rows(self) -> tuple[Record, ...]:
        """The same where they have the baseline's output, by whose rows a model recognises them; else none."""
        return self.raw_training if all(r.has(self.baseline.output) for r in self.raw_training) else ()


def prepare_task(records: Record | Sequence[Record], baseline: Any, catalogue: Any = None,
                 held_out: Record | Sequence[Record] | None = None, *, parameters: Any = None,
                 sample_rate: float | None = None, progress: Progress | None = None) -> DiagnosisTask:
    """Resolve names, read the model, prepare the records; arguments as for `diagnose`.

    Parameters
    ----------
    records : Record or sequence of Record
    baseline : str, path, model or Baseline
    catalogue : sequence of Effect, name or names, optional
    held_out : Record or sequence of Record, optional
    parameters : path or object, optional
    sample_rate : float, optional
        [Hz].
    progress : callable, optional

    Returns
    -------
    DiagnosisTask

    Raises
    ------
    InputError
        Parameters for a baseline that is not given by name; no such baseline or catalogue, missing channels, an output
        or a motion that is constant throughout.
    """
    training, kept = _listed(records), _listed(held_out)
    effects, given = as_effects(catalogue), opened(baseline)
    if parameters is not None and not isinstance(given, str):
        raise InputError("parameters belong to a baseline that is given by name", got=type(given).__name__,
                         mend="leave them out, a model file holds its own")
    training, kept = (recalled(part, getattr(given, "metadata", {})) for part in (training, kept))
    given = by_roles(given)
    rate = sample_rate or rate_of(given, [*training, *kept])
    prepared = prepare(training, kept, effects, channels_of(given), rate)
    if given == AUTO:
        from lpvid.diagnosis.automatic import automatic

        if parameters is not None:
            raise InputError("parameters belong to a baseline that is given by name", got=AUTO,
                             mend="name the baseline, or leave them out")
        found, note = automatic(prepared.training, progress or (lambda text: None))
        prepared = replace(prepared, notes=(note, *prepared.notes))
    else:
        try:
            found = as_baseline(given, prepared.training, parameters)
        except InputError:  # text may be why a channel is not there
            refuse_text([*training, *kept], ROLES)
            raise
    _check_moving(found, prepared.training)
    fitted = parameters is not None or not isinstance(given, (str, Baseline))
    causes = found.candidates(effects) if isinstance(found, ComposedBaseline) else tuple(effects)
    return DiagnosisTask(prepared, found, fitted, causes, (*training, *kept), given == AUTO, len(training))


def _check_moving(baseline: Baseline, records: Sequence[Record]) -> None:
    """Raise where the output, or every measured channel of the motion, is constant."""
    values = [r[baseline.output] for r in records if r.has(baseline.output)]
    if values and np.ptp(np.concatenate(values)) == 0:
        unit = next(r.unit(baseline.output) for r in records if r.has(baseline.output))
        raise InputError(f"'{baseline.output}' never changes in the training records, so that there is nothing to "
                         "explain", got=f"{values[0][0]:.6g} {unit} throughout",
                         mend="check the sensor, or leave these files out")
    motions = [r[role] for r in records for role in ("displacement", "velocity") if r.has(role)]
    if motions and not any(np.ptp(x) for x in motions):
        raise InputError("nothing moves in the training records", got="a constant displacement or velocity throughout",
                         mend="check the sensor, or leave these files out")


def _listed(records: Record | Sequence[Record] | None) -> list[Record]:
    return [] if records is None else as_records(records)
