"""LPV-ARMAX: equation error that is a moving average of white innovations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_starts import Start, armax_starts
from lpvid.identification.prediction_error import PredictionError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record


@dataclass(frozen=True)
class ARMAX(PredictionError):
    """LPV-ARMAX structure, SISO, MISO or MIMO.

    ::

        A(p) y(k) = B(p) u(k) + c(p) + C e(k),    C = 1 + Σ_{i=1}^{nc} c_i q⁻ⁱ

    minimising Σ e(k)² (Ljung 1999 (4.14) with A and B over a basis). The past innovations of every record are estimated
    along.

    Parameters
    ----------
    na, nb, nk, input, output, basis, affine, lagged, stage, schedule_filter
        As in `ARX`.
    nc : int
        Order of C, one for each output.
    varying_noise : bool
        Coefficients c_i(p) over the basis rather than constant ones.
    starts, seed, max_iterations, tolerance, bounds, initial, frozen_poles, progress
        As in `PredictionError`.

    Examples
    --------
    >>> ARMAX(na=2, nb=2, nc=1, input="u", output="y").noise_model(1, 1)
    NoiseModel armax: nc=1
    """

    nc: int = 2
    varying_noise: bool = False
    kind: ClassVar[str] = "armax"
    _orders: ClassVar[tuple[str, ...]] = ("nc", "varying_noise")
    coloured: ClassVar[bool] = False

    def noise_model(self, n_outputs: int, n_functions: int) -> NoiseModel:
        return NoiseModel("armax", np.zeros((self.nc, n_outputs, n_functions if self.varying_noise else 1)))

    def starting_models(
        self, records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction
    ) -> list[Start]:
        return armax_starts(problem, first)
