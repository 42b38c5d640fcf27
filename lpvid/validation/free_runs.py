"""free_runs: a model along records, sample by sample, with the figures of the free run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.model.adaptable import Adaptable
from lpvid.model.hull import outside_share
from lpvid.record import Record
from lpvid.simulation import Model, Simulation, simulate
from lpvid.training_fingerprint import recalled
from lpvid.training_rows import compared_rows
from lpvid.validation.figures import Figures, Pool
from lpvid.validation.opposite import opposite_remark
from lpvid.validation.report import acting_model, along
from lpvid.validation.trust import held_out_doubt, independent_samples


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A model along one record.

    Attributes
    ----------
    record : Record
        Uniform, at the model's rate.
    run : Simulation
    figures : Figures or None
        Of the free run; None where the output was not measured.
    extrapolation_share : float
        Share of the samples whose scheduling lies outside the training range.
    columns : mapping of str to ((n,) array, str)
        ``time``, then for every output ``measured``, ``simulated``, ``residual`` (with its name where there are
        several), then inputs and scheduling; values and unit.
    """

    record: Record
    run: Simulation
    figures: Figures | None
    extrapolation_share: float
    columns: Mapping[str, tuple[np.ndarray, str]]


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """A model along records.

    Attributes
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
    runs : tuple of FreeRun
    label : str
        "held-out", "training", "partly training", "held-out or training" where that is not known, or "not measured".
    overall : Figures or None
        Pooled over the records; None where the output was not measured.
    notes : tuple of str
    """

    model: Model
    runs: tuple[FreeRun, ...]
    label: str
    overall: Figures | None
    notes: tuple[str, ...] = ()

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """A name for a file of each run."""
        stems = [re.sub(r"[^\w.-]+", "_", r.record.name) or "record" for r in self.runs]
        return tuple(s if stems.count(s) == 1 else f"{s}-{k + 1}" for k, s in enumerate(stems))

    @property
    def doubt(self) -> str | None:
        """Why the fit cannot be trusted (`held_out_doubt`), or None."""
        if self.overall is None or self.overall.esr is None:
            return None
        first = self.model.outputs[0].name
        errors = [r.record[first][r.run.start:] - r.run.output[r.run.start:, 0] for r in self.runs]
        return held_out_doubt(self.overall, independent_samples(errors))

    def to_dict(self) -> dict:
        """simulation.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "lpvid/simulation/1", "kind": "free-run", "data": self.label,
                "overall": None if self.overall is None else self.overall.to_dict(), "doubt": self.doubt,
                "records": [{"name": r.record.name, "n_samples": r.record.n_samples, "start": r.run.start,
                             "initial": r.run.initial, "diverged_at": r.run.diverged_at,
                             "free_run": None if r.figures is None else r.figures.to_dict(),
                             "extrapolation_share": r.extrapolation_share} for r in self.runs],
                "sample_time": self.model.sample_time, "outputs": [str(s) for s in self.model.outputs],
                "notes": list(self.notes)}

    def __repr__(self) -> str:
        doubt = "" if self.doubt is None else f" ({self.doubt})"
        total = ("the output was not measured: no figures" if self.overall is None else
                 f"{self.label}{doubt}: {self.overall}")
        count = f"{len(self.runs)} record{'s' if len(self.runs) != 1 else ''}"
        lines = [f"Simulation of {count}, free run from {self.runs[0].run.initial}; {total}"]
        for r in self.runs[:8]:
            end = "" if r.run.diverged_at is None else f", DIVERGED at sample {r.run.diverged_at}"
            stated = end if r.figures is None or end else f": {r.figures}"
            lines.append(f"  {r.record.name}, {r.record.n_samples} samples{stated}")
        share = max(r.extrapolation_share for r in self.runs)
        if share >= 5e-4:
            lines.append(f"  up to {100 * share:.1f} % of a record's samples outside the training range of the "
                         "scheduling: the model extrapolates there")
        return "\n".join(lines + [f"  note: {n}" for n in self.notes])


def free_runs(model: Model | Adaptable, records: Record | Sequence[Record],
              sample_rate: float | None = None) -> FreeRuns:
    """Run a model freely along measured records, from their first measured samples, or from zero without any.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, SelfScheduled or Adaptable
    records : Record or sequence of Record
        As read: cut at gaps, resampled to the model's rate.
    sample_rate : float, optional
        Only the model's own rate [Hz] is accepted.

    Returns
    -------
    FreeRuns

    Raises
    ------
    InputError
        Missing channels, another unit than the model's, no stretch long enough, outputs that only some records have.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.5, 0.0]], [[0, 0], [1.0, 0.5]], Polynomial("p", degree=1), 0.1)
    >>> found = free_runs(model, Record({"u1": [1.0, 1, 1], "p": [0.0, 1, 1]}, sample_time=0.1))
    >>> list(found.runs[0].columns), found.runs[0].columns["simulated"][0].tolist()
    (['time', 'simulated', 'u1', 'p'], [0.0, 1.5, 2.25])
    """
    listed = as_records(records)
    if not listed:
        raise InputError("no records given")
    model = acting_model(model, listed, sample_rate)
    having = [all(r.has(s.name) for s in model.outputs) for r in recalled(listed, model.metadata)]
    if any(having) and not all(having):
        raise InputError("only some records have the model's output", got=listed[having.index(False)].name,
                         mend="simulate them apart")
    acting, pieces, notes = along(model, listed, sample_rate, measured=all(having))
    measured = all(having)
    pool, runs = Pool(), []
    for piece in pieces:
        run = simulate(acting, piece, "measured" if measured else "zero")
        figures = pool.add(piece.matrix([s.name for s in acting.outputs]), run) if measured else None
        share = outside_share(acting, piece.matrix(list(acting.box.names)))
        runs.append(FreeRun(piece, run, figures, share, _columns(acting, piece, run, measured)))
    label = "not measured"
    if measured:
        label, stated = compared_rows(acting.metadata, recalled(listed, acting.metadata), pieces,
                                      acting.outputs[0].name).labelled()
        notes += stated
    overall = pool.total("free-run") if measured else None
    turned = None if overall is None else opposite_remark(acting, pieces, overall)
    return FreeRuns(acting, tuple(runs), label, overall, notes if turned is None else (*notes, turned))


def _columns(model: Model, record: Record, run: Simulation, measured: bool) -> dict[str, tuple[np.ndarray, str]]:
    columns = {"time": (record.times, "s")}
    several = len(model.outputs) > 1
    for k, signal in enumerate(model.outputs):
        tail = f"_{signal.name}" if several else ""
        unit = signal.unit or record.unit(signal.name) if measured else signal.unit
        if measured:
            columns[f"measured{tail}"] = record[signal.name], unit
        columns[f"simulated{tail}"] = np.array(run.output[:, k]), unit
        if measured:
            columns[f"residual{tail}"] = record[signal.name] - run.output[:, k], unit
    for name in dict.fromkeys((*(s.name for s in model.inputs), *model.box.names)):
        columns[name] = record[name], record.unit(name)
    return columns
