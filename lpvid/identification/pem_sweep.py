"""One record's Jacobian, chunk by chunk, through the banded recursions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from lpvid.identification.layout import ParameterLayout
from lpvid.identification.regression import Columns
from lpvid.model.transfer_function import LPVTransferFunction

CHUNK = 1024
"""samples whose sensitivities are in memory at once."""
FADED = 1e-60
"""sensitivity below which what is carried into the next chunk counts as zero."""


class Swept(Protocol):
    """What a sweep reads of a prediction-error problem.

    Attributes
    ----------
    layout : ParameterLayout
    columns : Columns
    weights : (ny,) array
        Of the outputs.
    start, depth : int
        First sample with a whole past, and how much of the past is unknown.
    estimate_past : bool
    """

    layout: ParameterLayout
    columns: Columns
    weights: np.ndarray
    start: int
    depth: int
    estimate_past: bool


def sweep_record(
    problem: Swept,
    model: LPVTransferFunction,
    signals: tuple[np.ndarray, np.ndarray, np.ndarray],
    state: tuple[np.ndarray, np.ndarray],
    slopes: Sequence[np.ndarray],
    absorb: Callable,
) -> None:
    """Advance the sensitivities of one record and hand every chunk of weighted rows to `absorb`.

    Parameters
    ----------
    problem : Swept
    model : LPVTransferFunction
    signals : y (n, ny), u (width, n), phi (M, n)
    state : e (n, ny), and x (n, ny) or the equation error
    slopes : (n, ny) arrays
        Columns of the free stage parameters.
    absorb : callable
        ``absorb(write, rows)``, see `PredictionErrorProblem.sweep`.
    """
    sweep = _Sweep(problem, model, signals, state, slopes)
    if problem.depth:
        sweep.head()
        if problem.estimate_past:
            absorb(sweep.writer(problem.start - problem.depth, problem.depth), problem.depth)
        sweep.carry(problem.depth)
    for first in range(problem.start, len(signals[0]), CHUNK):
        rows = min(CHUNK, len(signals[0]) - first)
        sweep.advance(first, rows)
        absorb(sweep.writer(first, rows), rows)
        sweep.carry(rows)


class _Sweep:
    """Sensitivities of one chunk behind those of the last few samples."""

    def __init__(self, problem: Swept, model: LPVTransferFunction, signals: tuple, state: tuple,
                 slopes: Sequence[np.ndarray]) -> None:
        self.problem, self.model, self.noise = problem, model, model.noise
        self.y, self.u, self.phi = signals
        self.e, self.plant = state
        self.slopes = slopes
        ny, nc, nd = model.n_outputs, self.noise.nc, self.noise.nd
        assert self.noise.c is not None
        self.functions = self.noise.c.shape[2]
        self.history = max(model.na, nc, nd, problem.depth, 4)
        past = problem.depth * ny
        width = problem.layout.size + past + (ny * nc * self.functions if self.noise.kind == "armax" else 0)
        self.first_past = width - past
        self.sens = np.zeros((ny, width, self.history + CHUNK))
        self.coloured = self.sens
        if self.noise.kind == "box-jenkins":
            self.coloured = np.zeros((ny, width + ny * (nc + nd), self.history + CHUNK))
        self.order = self._order(width)
        source = self.y if self.noise.kind == "armax" else self.plant
        self.signals = np.vstack([source.T, self.u, np.ones(len(self.y))])
        self.output_error = self.y - self.plant

    def _order(self, width: int) -> np.ndarray:
        """Columns of the sensitivities in the order past, layout, noise."""
        ny, nc, nd, k = self.model.n_outputs, self.noise.nc, self.noise.nd, self.problem.layout.size
        past = np.arange(self.first_past, width) if self.problem.estimate_past else np.zeros(0, dtype=int)
        noise = np.zeros(0, dtype=int)
        if self.noise.kind == "armax":
            noise = k + np.arange(ny * nc * self.functions)
        elif self.noise.kind == "box-jenkins":
            place = width + np.arange(ny * (nc + nd)).reshape(ny, nc + nd)
            noise = np.concatenate([place[:, :nc].ravel(), place[:, nc:].ravel()])
        return np.concatenate([past, np.arange(k), noise])

    def head(self) -> None:
        """The unknown past itself: x(k) is its own parameter; so is e(k), against which ŷ falls."""
        ny, depth, first = self.model.n_outputs, self.problem.depth, self.first_past
        sign = -1.0 if self.noise.kind == "armax" else 1.0
        if self.problem.estimate_past:
            for r in range(depth):
                for o in range(ny):
                    self.sens[o, first + r * ny + o, self.history + r] = sign
        if self.noise.kind == "box-jenkins":
            self._colour(self.problem.start - depth, depth)

    def advance(self, first: int, rows: int) -> None:
        """Sensitivities of samples `first` … `first`+rows−1 behind those carried over."""
        from lpvid import _kernels, _sensitivity

        c, ny, history = self.problem.columns, self.model.n_outputs, self.history
        for o in range(ny):
            z, own = self.sens[o], slice(o * c.size, (o + 1) * c.size)
            for other in (slice(0, own.start), slice(own.stop, None)):
                z[other, history: history + rows] = 0.0
            _kernels.fill_regressor(z[own], history, first, rows, self.signals, self.phi,
                                    c.source, c.sign, c.lag, c.function, c.phi_lag)
        if self.noise.kind == "armax":
            self._noise_columns(first, rows)
            weights = self._noise_weights(first, rows)
            for o in range(ny):
                _sensitivity.recur(weights[o], self.sens[o], history, rows)
        elif self.model.na and ny == 1:
            _sensitivity.recur(self._weights(first, rows).reshape(self.model.na, rows), self.sens[0], history, rows)
        elif self.model.na:
            _sensitivity.recur_coupled(self._weights(first, rows), self.sens, history, rows)
        if self.noise.kind == "box-jenkins":
            self._colour(first, rows)

    def _colour(self, first: int, rows: int) -> None:
        """D/C times the plant's sensitivities, and those of C and D themselves behind them."""
        from lpvid import _sensitivity

        noise, width, history = self.noise, self.sens.shape[1], self.history
        assert noise.c is not None and noise.d is not None
        more, begin = noise.nc + noise.nd, self.problem.start - self.problem.depth
        for o in range(self.model.n_outputs):
            z = self.coloured[o]
            z[width:, history: history + rows] = 0.0
            _sensitivity.moving_average(noise.d[:, o].copy(), self.sens[o], z, history, rows)
            for i in range(noise.nc):
                z[width + o * more + i, history: history + rows] = _delayed(self.e[:, o], first, rows, i + 1, begin)
            for i in range(noise.nd):
                past = _delayed(self.output_error[:, o], first, rows, i + 1, begin)
                z[width + o * more + noise.nc + i, history: history + rows] = -past
            if noise.nc:
                _sensitivity.recur(np.repeat(noise.c[:, o], rows, axis=1), z, history, rows)

    def _weights(self, first: int, rows: int) -> np.ndarray:
        """(na, ny, ny, rows) coefficients a_i(p) of these samples."""
        a, lagged = self.model.a, self.model.lagged
        if not lagged:
            return (a.reshape(-1, a.shape[3]) @ self.phi[:, first: first + rows]).reshape(*a.shape[:3], rows)
        out = np.empty((*a.shape[:3], rows))
        for i in range(len(a)):
            low = first - (i + 1 if lagged else 0)
            out[i] = a[i] @ self.phi[:, low: low + rows]
        return out

    def _noise_functions(self, first: int, rows: int, lag: int) -> np.ndarray:
        """(functions, rows) basis of c_lag at these samples."""
        if self.functions == 1:
            return np.ones((1, rows))
        low = first - (lag if self.model.lagged else 0)
        if low >= 0:
            return self.phi[:, low: low + rows]
        return self.phi[:, np.maximum(np.arange(low, low + rows), 0)]  # what comes before multiplies zeros

    def _noise_weights(self, first: int, rows: int) -> np.ndarray:
        """(ny, nc, rows) coefficients c_i(p) of these samples."""
        assert self.noise.c is not None
        out = np.zeros((self.model.n_outputs, max(self.noise.nc, 1), rows))
        for i in range(self.noise.nc):
            out[:, i] = self.noise.c[i] @ self._noise_functions(first, rows, i + 1)
        return out

    def _noise_columns(self, first: int, rows: int) -> None:
        """Right-hand sides φ_f(p) e(k−i) of the coefficients of C."""
        width, place = self.noise.nc * self.functions, self.problem.layout.size
        for o in range(self.model.n_outputs):
            for i in range(self.noise.nc):
                past = _delayed(self.e[:, o], first, rows, i + 1, 0)
                target = self.sens[o, place + o * width + i * self.functions:][: self.functions]
                target[:, self.history: self.history + rows] = past * self._noise_functions(first, rows, i + 1)

    def carry(self, rows: int) -> None:
        """Move the last samples in front of the next chunk."""
        for array in {id(a): a for a in (self.sens, self.coloured)}.values():
            last = array[:, :, rows: rows + self.history].copy()
            last[np.abs(last) < FADED] = 0.0  # a past that has faded would linger as slow subnormal numbers
            array[:, :, : self.history] = last

    def writer(self, first: int, rows: int) -> Callable[[np.ndarray, int], None]:
        """A function that writes one output's weighted rows of this chunk into a transposed workspace."""
        from lpvid import _sensitivity

        def write(block: np.ndarray, output: int) -> None:
            scale = float(self.problem.weights[output])
            _sensitivity.copy_columns(block, self.coloured[output], self.history, rows, self.order, scale)
            for j, slope in enumerate(self.slopes):
                block[self.order.size + j, :rows] = scale * slope[first: first + rows, output]
            block[self.order.size + len(self.slopes), :rows] = scale * self.e[first: first + rows, output]

        return write


def _delayed(signal: np.ndarray, first: int, rows: int, lag: int, begin: int) -> np.ndarray:
    """Samples first−lag … of a signal (n,) that counts as zero before `begin`."""
    low = first - lag
    skip = max(begin - low, 0)
    if not skip:
        return signal[low: low + rows]
    out = np.zeros(rows)
    if skip < rows:
        out[skip:] = signal[low + skip: low + rows]
    return out
