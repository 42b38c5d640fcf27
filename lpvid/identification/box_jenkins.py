"""LPV-BJ: an LPV plant and a coloured output noise of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.identification.levenberg_marquardt import minimise
from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_search import SHORT, ranked
from lpvid.identification.pem_starts import Start, box_jenkins_starts, output_starts
from lpvid.identification.prediction_error import PredictionError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record


@dataclass(frozen=True)
class BoxJenkins(PredictionError):
    """LPV Box-Jenkins structure, SISO, MISO or MIMO.

    ::

        A(p) x(k) = B(p) u(k) + c(p),    y(k) = x(k) + v(k),    D v(k) = C e(k)

    minimising Σ e(k)² (Ljung 1999 (4.31) with A and B over a basis; C and D constant). Plant and noise share nothing,
    so that in open loop the plant is consistent even where C and D are too small (in closed loop only where they are
    not); efficient where they are not.

    Parameters
    ----------
    na, nb, nk, input, output, basis, affine, lagged, stage, schedule_filter
        As in `ARX`.
    nc, nd : int
        Orders of C and D, one pair for each output.
    starts, seed, max_iterations, tolerance, bounds, initial, frozen_poles, progress
        As in `PredictionError`.

    Examples
    --------
    >>> BoxJenkins(na=2, nb=2, nc=1, nd=2, input="u", output="y").noise_model(1, 1)
    NoiseModel box-jenkins: nc=1, nd=2
    """

    nc: int = 2
    nd: int = 2
    kind: ClassVar[str] = "bj"
    _orders: ClassVar[tuple[str, ...]] = ("nc", "nd")
    coloured: ClassVar[bool] = False

    def noise_model(self, n_outputs: int, n_functions: int) -> NoiseModel:
        return NoiseModel("box-jenkins", np.zeros((self.nc, n_outputs, 1)), np.zeros((self.nd, n_outputs)))

    def starting_models(
        self, records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction
    ) -> list[Start]:
        """The output-error model, with white noise and with an ARMA model of its error."""
        plain = PredictionErrorProblem(records, problem.structure, problem.model, problem.layout, NoiseModel("output"),
                        problem.free_stages, problem.estimate_past)
        plain.weights = problem.weights
        inside, outside = ranked(plain, output_starts(plain, first))
        models = [model for _, _, model in (*inside[: self.starts], *outside[:1])]
        k = sum(plain.sizes)
        found = []
        for model in models:
            search = minimise(plain, plain.point(model), max_iterations=SHORT, tolerance=self.tolerance,
                              bounds=(np.full(k, -np.inf), np.full(k, np.inf)))
            if search is not None:
                found.append((search.cost, plain.model_at(search.trial.point.shared)))
        best = [min(found, key=lambda row: row[0])[1]] if found else []

        def errors(model: LPVTransferFunction) -> tuple[np.ndarray, ...] | None:
            residuals = plain.residuals(plain.point(model))
            return None if residuals is None else residuals.errors

        return [start for model in (*best, *models[:1]) for start in box_jenkins_starts(problem, model, errors)]
