"""Estimates by simulation error: models that are good when they run by themselves, with poles inside the circle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.identification import Identification, identify
from lpvid.identification.arx import ARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.output_error import OutputError
from lpvid.identification.stage_fit import shorten
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import simulate
from lpvid.validation import figures

LARGEST_POLE = 0.999
"""modulus that no frozen pole may exceed along the training data (equation sheet 7.1)."""
MOST_SAMPLES = 60_000
"""samples that a search by simulation error uses at most."""
CURRENTS = 101
"""points of the current's range at which poles are looked at."""


def by_simulation_error(records: Sequence[Record], arx: ARX) -> tuple[Identification, tuple[str, ...]]:
    """Least squares, re-estimated by simulation error; of the two the one that runs the training data better.

    Parameters
    ----------
    records : sequence of Record
    arx : ARX
        Structure; stages given by name are fitted.

    Returns
    -------
    found : Identification
        With frozen poles within `LARGEST_POLE` over the range of the current.
    notes : tuple of str
    """
    least = identify(records, arx)
    sample = shorten(records, MOST_SAMPLES, arx.start + 50)
    structure = OutputError(arx.na, arx.nb, arx.nk, arx.input, arx.output, arx.basis, arx.affine, arx.lagged, arx.stage,
                            arx.schedule_filter)
    notes: list[str] = []
    try:
        found = identify(sample, structure)
        if sum(r.n_samples for r in sample) < sum(r.n_samples for r in records):
            notes.append(f"simulation error over the first {sum(r.n_samples for r in sample)} samples")
    except (InputError, NumericalError) as error:
        found = least
        notes.append(f"the least-squares estimate is kept: {error}")
    drawn = [_drawn_in(f, sample) for f in (least, found)]
    (least, _), (found, shrunk) = drawn
    before, after = (_esr(f.model, sample) for f in (least, found))
    if not after <= before:
        found, shrunk = drawn[0]
        notes.append("the least-squares estimate is kept: "
                     f"simulation error {after:.4g} is no better than its {before:.4g}")
    elif found is not least:
        notes.append(f"re-estimated by simulation error: training free-run ESR {before:.4g} -> {after:.4g}")
    if shrunk < 1:
        notes.append(f"poles drawn in by {shrunk:.4g}, so that none exceeds {LARGEST_POLE} in modulus")
    return found.replace(notes=()), tuple(notes)


def largest_pole(model: LPVTransferFunction) -> float:
    """Largest modulus of the frozen poles over the range of the current.

    Parameters
    ----------
    model : LPVTransferFunction
        Discrete-time.

    Returns
    -------
    float
        Over `CURRENTS` points of the range; 0 for a model without past outputs.
    """
    return max((float(np.abs(model.frozen_poles(p)).max(initial=0.0)) for p in model.box.grid(CURRENTS)), default=0.0)


def _drawn_in(found: Identification, records: Sequence[Record]) -> tuple[Identification, float]:
    """The estimate with poles scaled into the circle where they are not, the inputs fitted again to the free run."""
    size = largest_pole(found.model)
    if size <= LARGEST_POLE:
        return found, 1.0
    share = LARGEST_POLE / size * (1 - 1e-9)
    power = share ** np.arange(1, found.model.na + 1)
    model = found.model.replace(a=found.model.a * power[:, None, None, None])
    return found.replace(model=_inputs_again(model, found.layout, records)), share  # type: ignore[arg-type]


def _inputs_again(model: LPVTransferFunction, layout: ParameterLayout,
                  records: Sequence[Record]) -> LPVTransferFunction:
    """The model with b and c by least squares of its free run, which is linear in them."""
    theta = layout.read(model)
    free = np.flatnonzero(layout.table[:, 0] > 0)

    def runs(vector: np.ndarray) -> np.ndarray:
        trial = layout.fill(model, vector)
        return np.concatenate([simulate(trial, r).output[trial.start:, 0] for r in records])

    still = np.where(layout.table[:, 0] > 0, 0.0, theta)
    base = runs(still)
    columns = np.column_stack([runs(still + unit) - base for unit in np.eye(theta.size)[free]])
    measured = np.concatenate([r["force"][model.start:] for r in records])
    if not (np.isfinite(columns).all() and np.isfinite(base).all()):
        return model
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    still[free] = np.linalg.lstsq(columns / size, measured - base, rcond=1e-12)[0] / size
    return layout.fill(model, still)


def _esr(model: LPVTransferFunction, records: Sequence[Record]) -> float:
    found = figures(model, records, "training").overall.free_run
    return np.inf if found.esr is None else found.esr


__all__ = ["LARGEST_POLE", "by_simulation_error", "largest_pole"]
