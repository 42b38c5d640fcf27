"""What a free run costs that begins at measured samples, on the average over where it begins."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid.record import Record
from lpvid.simulation import Model, simulate


def fit_from_measured_samples(model: Model, records: Sequence[Record], starts: int) -> float:
    """Free-run fit [%] on these records, each begun once at measured samples, on the average over `starts` places.

    Reported figures begin at measured samples, whose noise a slow mode carries on. How much that costs depends on the
    few samples of one beginning, so that a record is begun at several places::

        E = Σ_records (E_est + mean_k (E_measured,k − E_est,k))

    with E_est the squared error of the whole record from an estimated past, and of stretch k from either.

    Parameters
    ----------
    model : Model
    records : sequence of Record
        Uniform and finite.
    starts : int
        Places in every record; stretches too short to run on are left out.

    Returns
    -------
    float
        −inf where a run diverges.
    """
    names = [s.name for s in model.outputs]
    error, power = np.zeros(len(names)), np.zeros(len(names))
    for record in records:
        if record.n_samples <= model.start + 2:
            continue
        y = record.matrix(names)[model.start:]
        own = _squared(model, record, "estimate")
        edges = np.linspace(0, record.n_samples, starts + 1).astype(int)
        pieces = [replace(record.slice(a, b), time=None) for a, b in itertools.pairwise(edges)
                  if b - a > 2 * model.start + 10]
        costs = [_squared(model, p, "measured") - _squared(model, p, "estimate") for p in pieces]
        error += own + (np.mean(costs, axis=0) if costs else 0.0)
        power += np.sum((y - y.mean(axis=0)) ** 2, axis=0)
    esr = float(np.mean(error / np.maximum(power, 1e-300)))
    return 100 * (1 - float(np.sqrt(max(esr, 0.0)))) if np.isfinite(esr) else -np.inf


def _squared(model: Model, record: Record, initial: str) -> np.ndarray:
    """(n_outputs,) squared error of a free run; inf where it diverges."""
    run = simulate(model, record, initial)
    if run.diverged_at is not None:
        return np.full(len(model.outputs), np.inf)
    y = record.matrix([s.name for s in model.outputs])
    return np.sum((y - run.output)[model.start:] ** 2, axis=0)
