"""The order of a subspace estimate by its free run on blocks of the data that it was not fitted to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from lpvid.condition import folds
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.simulation import simulate

FOLDS = 4
"""blocks of the data on which orders are compared."""
GAP = 2
"""gap between training and held-out samples, in times the past that a state is read from."""


class OrderedStructure(Protocol):
    """A structure that estimates models of several orders at once; `Subspace` is one."""

    @property
    def start(self) -> int:
        """Samples at the head of every record that only serve as a past."""
        ...

    @property
    def output(self) -> str | tuple[str, ...]:
        """Names of the outputs."""
        ...

    def by_order(self, records: Sequence[Record], orders: Sequence[int]) -> Iterator[tuple[int, LPVStateSpace | None]]:
        """Order and estimate for several orders.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        orders : sequence of int

        Returns
        -------
        iterator of (int, LPVStateSpace or None)
            None where there is none.
        """
        ...


def free_run_errors(structure: OrderedStructure, records: Sequence[Record], orders: Sequence[int]) -> dict[int, float]:
    """Free-run ESR out of fold by order.

    One regression per fold serves all orders, which take more or fewer of the same singular directions. The state at
    the beginning of a held-out block is estimated on it; each output counts in units of its own spread.

    Parameters
    ----------
    structure : OrderedStructure
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


def _fold(structure: OrderedStructure, training: Sequence[Record], held: Sequence[Record], unit: np.ndarray,
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
