"""LPV-OE: the model whose free run is closest to the measured output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_starts import Start, knee_starts, output_starts
from lpvid.identification.prediction_error import PredictionError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record


@dataclass(frozen=True)
class OutputError(PredictionError):
    """LPV output-error structure, SISO, MISO or MIMO.

    ::

        A(p) x(k) = B(p) u(k) + c(p),    y(k) = x(k) + v(k)

    minimising Σ v(k)² (Ljung 1999 (4.25) with A and B over a basis). Consistent for any noise v that is independent of
    input and scheduling, white or not; the covariance is of sandwich form to match.

    Parameters
    ----------
    na, nb, nk, input, output, basis, affine, lagged, stage, schedule_filter
        As in `ARX`.
    starts, seed, max_iterations, tolerance, bounds, initial, frozen_poles, progress
        As in `PredictionError`.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.identification import identify
    >>> rng = np.random.default_rng(0)
    >>> u, p, x = rng.normal(size=600), rng.uniform(-1, 1, 600), np.zeros(600)
    >>> for k in range(1, 600):
    ...     x[k] = (0.6 + 0.2 * p[k]) * x[k - 1] + u[k - 1]
    >>> record = Record({"u": u, "p": p, "y": x + 0.01 * rng.normal(size=600)}, sample_time=0.01)
    >>> from lpvid.scheduling import Polynomial
    >>> found = identify(record, OutputError(na=1, nb=1, input="u", output="y", basis=Polynomial("p", degree=1)))
    >>> found.model.frozen_poles([1.0]).real.round(2)
    array([0.8])
    """

    kind: ClassVar[str] = "oe"
    _orders: ClassVar[tuple[str, ...]] = ()
    coloured: ClassVar[bool] = True

    def noise_model(self, n_outputs: int, n_functions: int) -> NoiseModel:
        return NoiseModel("output")

    def starting_models(
        self, records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction
    ) -> list[Start]:
        return [*output_starts(problem, first), *knee_starts(records, problem, first)]
