"""Free runs as tables beside a report: measured, simulated, residual, inputs and scheduling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lpvid.cli.running import Results
    from lpvid.model.adaptable import Adaptable
    from lpvid.record import Record
    from lpvid.simulation import Model
    from lpvid.validation.free_runs import FreeRuns


def queue_runs(results: Results, found: FreeRuns, kind: str = "csv") -> None:
    """simulation.KIND for one record, simulation-NAME.KIND for each of several.

    Parameters
    ----------
    results : Results
    found : FreeRuns
    kind : str
        "csv", "parquet" or "mat".
    """
    from lpvid.export.tables import write_table

    for label, run in zip(found.labels, found.runs, strict=True):
        stem = "simulation" if len(found.runs) == 1 else f"simulation-{label}"
        results.add(f"{stem}.{kind}", lambda path, columns=run.columns: write_table(columns, path))


def queue_run(results: Results, model: Model | Adaptable, records: Sequence[Record],
              sample_rate: float | None = None) -> None:
    """The same for a model along records.

    Parameters
    ----------
    results : Results
    model : model or Adaptable
    records : sequence of Record
        As read: cut at gaps, resampled to the model's rate.
    sample_rate : float, optional
        Of a model without a rate of its own [Hz].
    """
    from lpvid.validation.free_runs import free_runs

    queue_runs(results, free_runs(model, records, sample_rate))
