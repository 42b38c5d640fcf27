"""The fit that no model can exceed, because the output is noisy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid._threads import single_thread
from lpvid.codec import Encoded
from lpvid.condition import segments, with_derived
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.prediction_error import PredictionError
from lpvid.identification.selection.screening import nested
from lpvid.identification.sparsity import SparseARX
from lpvid.identification.structure import Structure
from lpvid.record import Record

ORDERS = (2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 26, 30)
"""orders tried."""
ROWS_PER_PARAMETER = 10
"""equations that every parameter must have."""
MOST_COLUMNS = 400
"""columns of the largest regressor."""


@dataclass(frozen=True, eq=False)
class Ceiling(Encoded):
    """The free-run fit of a perfect model, as far as the noise can be determined.

    Attributes
    ----------
    fit_percent : float
        100 (1 − σ_noise/σ_y).
    noise : float
        Standard deviation of the one-step residual of a high-order ARX [unit of the output].
    output : float
        Standard deviation of the output about each record's mean.
    order : int
        Order by AICc.
    at_limit : bool
        True when a still higher order might predict better: the ceiling is then a low estimate.
    unit, name : str
        Of the output.
    """

    JSON = ("fit_percent", "noise", "output", "unit", "order", "at_limit", "name")

    fit_percent: float
    noise: float
    output: float
    order: int
    at_limit: bool
    unit: str
    name: str

    def on(self, records: Record | Sequence[Record]) -> float:
        """The fit [%] that this noise leaves possible on other records of the same channel.

        Parameters
        ----------
        records : Record or sequence of Record
            With the channel `name`.

        Returns
        -------
        float
        """
        listed = as_records(records)
        return 100 * (1 - self.noise / _spread([r[self.name] for r in listed]))

    def __str__(self) -> str:
        end = ", the highest tried: perhaps higher" if self.at_limit else ""
        return (f"ceiling about {self.fit_percent:.1f} % (noise {self.noise:.3g} {self.unit} of {self.output:.3g} "
                f"{self.unit} in '{self.name}'; ARX of order {self.order}{end})")


def noise_ceiling(records: Record | Sequence[Record], structure: Structure, *,
                  sample_rate: float | None = None) -> Ceiling:
    """Estimate the noise in the output, and with it the highest free-run fit that any model can reach.

    The one-step residual of an ARX of rising order tends to the innovation of the output. For white measurement noise
    that is the noise itself (Ljung 1999, 4.2); noise that can be predicted from its past leaves less, and the ceiling
    is then too high. A structure too poor for the system leaves more, and it is then too low; so does a scheduling that
    moves the poles far and fast, because the best predictor then depends on past p in products that an ARX lacks.

    Parameters
    ----------
    records : Record or sequence of Record
    structure : ARX, SparseARX or prediction-error structure
        Its channels, basis, stage and kind of affine terms; its orders are replaced.
    sample_rate : float, optional
        As for `identify`.

    Returns
    -------
    Ceiling
        For the first output.

    Raises
    ------
    InputError
        A structure that is no ARX and holds none, or records too short for an ARX of the lowest order tried.
    """
    if isinstance(structure, SparseARX | PredictionError):
        structure = structure.arx
    if not isinstance(structure, ARX):
        raise InputError("a noise ceiling comes from an ARX of high order", got=type(structure).__name__,
                         mend="give an ARX with the same channels")
    listed = as_records(records)
    listed = with_derived(listed, structure.channels)
    pieces = segments(listed, structure.channels, sample_rate=sample_rate, minimum=structure.start + 2,
                      remedy="a lower order")
    if isinstance(structure.stage, str) or isinstance(structure.schedule_filter, str):
        fitted = structure.estimate(pieces).structure
        structure = replace(structure, stage=fitted.stage, schedule_filter=fitted.schedule_filter)
    box = scheduling_box(pieces, structure.basis)
    bound = replace(structure, basis=structure.basis.bound(box), ridge=0.0)
    rows = sum(r.n_samples for r in pieces)
    fitting = [s for s in (_of_order(bound, n) for n in ORDERS)
               if s.n_columns <= min(MOST_COLUMNS, rows / ROWS_PER_PARAMETER)
               and all(r.n_samples > s.start + 1 for r in pieces)]
    if not fitting:
        raise InputError("the records are too short to estimate the noise", got=f"{rows} samples",
                         mend="give longer records, or a smaller basis")
    with single_thread():
        costs, variances = _costs(pieces, fitting, box)
    best = int(np.argmin(costs))
    spread = _spread([r[structure.output[0]] for r in pieces])
    noise = float(np.sqrt(variances[best]))
    return Ceiling(100 * (1 - noise / spread), noise, spread, fitting[best].na, best == len(fitting) - 1,
                   pieces[0].unit(structure.output[0]), structure.output[0])


def _spread(pieces: Sequence[np.ndarray]) -> float:
    """Standard deviation about each record's own mean; missing samples left out."""
    return float(np.sqrt(np.nanmean(np.concatenate([y - np.nanmean(y) for y in pieces]) ** 2)))


def _of_order(structure: ARX, order: int) -> ARX:
    terms = structure.affine if structure.affine < 2 else order + 1
    nb = tuple(max(order + 1 - k, 1) for k in structure.delay)
    return replace(structure, na=order, nb=nb, affine=terms)


def _costs(pieces: Sequence[Record], fitting: Sequence[ARX], box) -> tuple[list[float], list[float]]:
    """AICc and residual variance of the first output, order by order, all on the same rows."""
    whole = fitting[-1]
    column = {tuple(row): i for i, row in enumerate(whole.places().tolist())}
    factor = whole.factor(pieces, box)
    costs, variances = [], []
    for structure in fitting:
        columns = [column[tuple(row)] for row in structure.places().tolist()]
        k, n = len(columns), factor.rows
        squares = float(np.sum(nested(factor, columns).r[k:, k] ** 2))
        variances.append(squares / (n - k))
        costs.append(n * np.log(max(squares, 1e-300) / n) + 2 * k * n / (n - k - 1))
    return costs, variances
