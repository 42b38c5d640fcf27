"""Free-run errors of a quasi-LPV model and their exact sensitivities; the least squares of one step as a start."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.identification.free_run_search import FreeRunProblem, Piece, Prior
from lpvid.model.quasi import QuasiLPVModel
from lpvid.record import Record

DIVERGED = 1e6
"""a training run that exceeds this many times the largest output is ended."""
PART = 16_384
"""samples whose sensitivities or regressors are in memory at a time: 15 MB of 113 parameters"""


@dataclass(frozen=True, eq=False)
class QuasiProblem(FreeRunProblem):
    """Free-run errors of a quasi-LPV model over records, and their exact Jacobian.

    The parameter vector is the model's, then the filter's where that is fitted.

    Attributes
    ----------
    model : QuasiLPVModel
        Whose settings are kept; its values serve as a start.
    inputs : tuple of (n, n_inputs) arrays
        Per record.
    outputs : tuple of (n,) arrays
        Measured output of every record.
    scheduling : tuple of (n, n_scheduling) arrays
        As logged, before any filter.
    free_filter : bool
        Whether the parameters of the scheduling filter are fitted along.
    """

    model: QuasiLPVModel

    @classmethod
    def of(cls, records: Sequence[Record], model: QuasiLPVModel, free_filter: bool) -> QuasiProblem:
        """Read the records once.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        model : QuasiLPVModel
            Where the search starts.
        free_filter : bool
            Whether the model's scheduling filter is fitted along.

        Returns
        -------
        QuasiProblem
        """
        return cls(model, *cls.columns(records, model), free_filter)

    def model_at(self, x: np.ndarray) -> QuasiLPVModel:
        """The model at a parameter vector.

        Parameters
        ----------
        x : (k,) array
            Parameters in the order of the class.

        Returns
        -------
        QuasiLPVModel
        """
        cut = x.size - self.filter_scales.size
        return self.with_filter(self.model.with_vector(x[:cut]), x[cut:])

    def measured_rows(self) -> Iterator[np.ndarray]:
        """Regressors with measured outputs in the output columns.

        Yields
        ------
        (n, columns) array
            Per record; −y(k−i) in column i − 1, i = 1 … na.
        """
        for u, y, p in zip(self.inputs, self.outputs, self.scheduling, strict=True):
            _, rows, _ = self.model.arrays(u, p)
            for i in range(self.model.na):
                rows[i + 1:, i] = -y[: -i - 1]
            yield rows

    def one_step(self, prior: Prior) -> np.ndarray:
        """Least squares of one step on measured outputs, at the model's trial weights and filter.

        Parameters
        ----------
        prior : Prior
            Its equations count beside those of the data; those of weights and filter are left out.

        Returns
        -------
        (k,) array
            θ as found; trial weights and filter as in the model.
        """
        model = self.model
        gram, right = prior.rows.T @ prior.rows, prior.rows.T @ prior.values
        gram, right = gram[: model.theta.size, : model.theta.size], right[: model.theta.size]
        for x, y in self._equations():
            gram, right = gram + x.T @ x, right + x.T @ y
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        theta = np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
        stage = model.scheduling_stage
        lag = stage.vector if self.free_filter and stage is not None else np.zeros(0)
        return np.concatenate([theta, model.kappa, lag])

    def one_step_error(self) -> float:
        """Standard deviation of the least squares of one step without a prior.

        Returns
        -------
        float
            In the unit of the output.
        """
        size = self.model.theta.size
        free = Prior(np.zeros((0, size)), np.zeros(0))
        theta = self.one_step(free)[:size]
        squares = [float(np.sum((y - x @ theta) ** 2)) for x, y in self._equations()]
        left = sum(len(y) - self.model.start for y in self.outputs) - size
        return float(np.sqrt(sum(squares) / max(left, 1)))

    def _equations(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """(n, θ) regressors on measured outputs and (n,) outputs that they shall give, `PART` samples at a time."""
        model = self.model
        weights = np.ones(1) if model.on == "input" else model.kappa
        for u, y, p, rows in zip(self.inputs, self.outputs, self.scheduling, self.measured_rows(), strict=True):
            phi, _, drive = model.arrays(u, self.filtered(model, p))
            rho = drive @ weights
            if model.on != "input":
                rho[1:] += y[:-1]
            low, high = model.range
            for first in range(model.start, len(y), PART):
                part = slice(first, first + PART)
                own = model.own.evaluate(np.clip(rho[part], low, high)[:, None])
                x = np.einsum("nm,ne,nr->nmer", own, phi[part], rows[part])
                yield x.reshape(len(x), -1), y[part]

    def along(self, place: int, x: np.ndarray, jacobian: bool) -> Iterator[Piece]:
        """Errors of the free run along one record and their Jacobian, `PART` samples at a time.

        Parameters
        ----------
        place : int
            Number of the record.
        x : (k,) array
            Parameters in the order of the class.
        jacobian : bool
            Whether the derivatives are wanted too.

        Yields
        ------
        (n,) array, (n, k) array or None
            Errors ŷ − y from the model's first free sample on, and ∂ŷ/∂x; None where it was not wanted. Without it
            a run that diverges gives one infinite error; with it the samples behind have errors and slopes of zero.
        """
        from lpvid._quasi_kernels import free_run_quasi

        u, y, p = self.inputs[place], self.outputs[place], self.scheduling[place]
        model = self.model_at(x)
        limit = DIVERGED * float(np.abs(y).max())
        if jacobian:
            yield from self._linearised(model, x, (u, y, p), limit)
            return
        out, arrays = np.array(y), model.arrays(u, self.filtered(model, p))
        code = free_run_quasi(*model.kernel_settings, *arrays, out, model.start, limit)
        yield (out - y)[model.start:] if code < 0 else np.array([np.inf]), None

    def _linearised(self, model: QuasiLPVModel, x: np.ndarray, record: tuple[np.ndarray, ...], limit: float
                    ) -> Iterator[Piece]:
        """Errors and Jacobian of one record; each part goes on from the last slopes of the one before."""
        from lpvid._quasi_kernels import sensitivity_quasi

        u, y, p = record
        start, size = model.start, model.vector.size
        columns = size if model.on != "input" else size + 1  # the kernel also gives the fixed weight's column
        arrays = model.arrays(u, self.filtered(model, p))
        moved = self.filter_slopes(x, u, p, y, self.run(model, u, p, y)) if self.filter_scales.size else []
        out, before, code = np.array(y), np.zeros((start, columns)), -1
        for first in range(start, len(y), PART):
            part, back = slice(first, first + PART), slice(first - start, first + PART)
            slopes = np.zeros((len(y[back]), columns))
            slopes[:start] = before
            if code < 0:
                code = sensitivity_quasi(*model.kernel_settings, *(a[back] for a in arrays), out[back], start, limit,
                                         slopes)
            before = slopes[len(slopes) - start:].copy()
            own = slopes[start:, :size]
            yield (out - y)[part], np.column_stack([own, *(m[part] for m in moved)]) if moved else own

    def run(self, model: QuasiLPVModel, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
        from lpvid._quasi_kernels import free_run_quasi

        out = np.array(y)
        free_run_quasi(*model.kernel_settings, *model.arrays(u, self.filtered(model, p)), out, model.start, np.inf)
        return out
