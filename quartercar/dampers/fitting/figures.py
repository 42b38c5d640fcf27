"""Figures of a fit on a set of records: free-run errors, energy, currents beyond the fit."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.record import Record
from lpvid.validation.figures import Figures, Pool
from quartercar.dampers.contract import Damper, ExtrapolationWarning


@dataclass(frozen=True)
class Score:
    """How well a free run follows a set of records.

    Attributes
    ----------
    figures : Figures
        Pooled, free-run.
    records : tuple of (str, Figures)
        Record by record.
    energy_error : float or None
        |∫F̂v dt / ∫Fv dt − 1|; None after divergence or where no energy is exchanged.
    extrapolation_share : float
        Share of the samples whose current lies outside the fitted range.
    """

    figures: Figures
    records: tuple[tuple[str, Figures], ...]
    energy_error: float | None
    extrapolation_share: float

    @property
    def root_sse(self) -> float | None:
        """√Σ(F̂ − F)² [N], which means nothing without `figures.n_samples`."""
        return None if self.figures.rmse is None else self.figures.rmse * float(np.sqrt(self.figures.n_samples))

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"free_run": self.figures.to_dict(), "root_sse": self.root_sse, "energy_error": self.energy_error,
                "extrapolation_share": self.extrapolation_share,
                "records": [{"name": n, "free_run": f.to_dict()} for n, f in self.records]}


def score(damper: Damper, records: Sequence[Record]) -> Score:
    """Free-run figures of a damper on prepared records, in the polarity of the records."""
    pool, rows, model, truth, outside, total = Pool(), [], 0.0, 0.0, 0.0, 0
    for record in records:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExtrapolationWarning)
            run = damper.simulate(record)
        measured = record["force"]
        rows.append((record.name, pool.add(measured[:, None], run)))
        power = record["velocity"][run.start:] * record.sample_time if record.has("velocity") else np.zeros(1)
        model += float(np.sum(run.output[run.start:, 0] * power))
        truth += float(np.sum(measured[run.start:] * power))
        outside += run.extrapolation_share * record.n_samples
        total += record.n_samples
    error = abs(model / truth - 1) if truth and np.isfinite(model) else None
    return Score(pool.total("free-run"), tuple(rows), error, outside / max(total, 1))
