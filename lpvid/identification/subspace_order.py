"""The order of a subspace estimate by its free run on blocks of the data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.condition import folds
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.simulation import simulate

if TYPE_CHECKING:
    from lpvid.identification.subspace import Subspace

FOLDS = 4
"""blocks of the data on which orders are compared."""
GAP = 2
"""gap between training and held-out samples, in times the past that a state is read from."""


def free_run_errors(structure: Subspace, records: Sequence[Record], orders: Sequence[int]) -> dict[int, float]:
    """Free-run ESR out of fold by order.

    One regression per fold serves all orders, which take more or fewer of the same singular directions. The state at
    the beginning of a held-out block is estimated on it; each output counts in units of its own spread.

    Parameters
    ----------
    structure : Subspace
        With its basis bound.
    records : sequence of Record
        Uniform and finite.
    orders : sequence of int

    Returns
    -------
    dict of int to float
        Orders whose run diverges on a block are left out; empty where the records are too short for blocks.
    """
    start = structure.start
    try:
        parts = folds(records, FOLDS, GAP * start * (records[0].sample_time or 1.0))
    except InputError:
        return {}
    centred = np.vstack([y - y.mean(axis=0) for y in (r.matrix(structure.output) for r in records)])
    unit = np.maximum(centred.std(axis=0), 1e-300)
    errors, power = dict.fromkeys(orders, 0.0), 0.0
    try:
        for training, held in parts:
            used, kept = _usable(training, start), _usable(held, start)
            if not used or not kept:
                return {}
            power += _fold(structure, used, kept, unit, errors)
    except InputError:
        return {}
    return {n: e / power for n, e in errors.items()} if power > 0 else {}


def _fold(structure: Subspace, training: Sequence[Record], held: Sequence[Record], unit: np.ndarray,
          errors: dict[int, float]) -> float:
    """Add one fold's squared errors to each order's, drop orders that diverge, and return the fold's power."""
    measured = [r.matrix(structure.output) / unit for r in held]
    for order, model in structure.by_order(training, tuple(errors)):
        runs = [] if model is None else [simulate(model, r, "estimate") for r in held]
        if not runs or any(run.diverged_at is not None for run in runs):
            del errors[order]
            continue
        errors[order] += sum(float(np.sum((y - run.output / unit) ** 2))
                             for y, run in zip(measured, runs, strict=True))
    return sum(float(np.sum((y - y.mean(axis=0)) ** 2)) for y in measured)


def _usable(records: Sequence[Record], start: int) -> list[Record]:
    return [r for r in records if r.n_samples > 3 * start]
