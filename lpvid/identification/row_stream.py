"""Regressor rows from samples that arrive piece by piece, with the overlap that lags and filters need."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.identification.regression import CHUNK
from lpvid.model.input_stage import InputStage
from lpvid.model.scheduling_stage import memory
from lpvid.record import Record

PUSH = 8 * CHUNK
"""samples of a record that are taken in at once."""


class RowStream:
    """Turns samples into rows [x y] of a regression; what was pushed before serves as the past.

    The rows are those that the whole record at once would give: the last `start` samples are kept, as many more as a
    scheduling filter reaches back, and a row whose basis reads p ahead waits for it.

    Parameters
    ----------
    structure : ARX
        With bound basis, and stages as objects or None.
    sample_time : float
        Period [s].
    """

    def __init__(self, structure: ARX, sample_time: float) -> None:
        if structure.fits_stages:
            raise InputError("a stream cannot fit an input stage or a scheduling filter",
                             why="their search runs over the data many times",
                             mend="fit them on a part of the data first, and give them as objects")
        self.structure, self.sample_time, self.start = structure, sample_time, structure.start
        self.stage = structure.stage if isinstance(structure.stage, InputStage) else None
        self.filter = structure.schedule_filter
        self.columns = structure._places(structure._filter_width())[1]
        self.n_outputs, self.n_inputs = len(structure.output), len(structure.input)
        self.ahead = max(-structure.basis.lags[0], 0)
        self.keep = self.start + (0 if self.filter is None else memory(self.filter, sample_time))
        self.cut()

    @property
    def size(self) -> int:
        """Regressors in a row."""
        return self.columns.size

    def cut(self) -> None:
        """Forget the past: what comes next does not continue it."""
        self._next = self.start
        self._y = np.zeros((0, self.n_outputs))
        self._u = np.zeros((0, self.n_inputs))
        self._p = np.zeros((0, len(self.structure.basis.names)))
        self._w = np.zeros(0)

    def push(self, y: np.ndarray, u: np.ndarray, p: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """Take in samples (n, ·) and give the rows they complete, (size + n_outputs, rows), transposed.

        Weighted samples (n,) scale their rows by the root of their weight.

        Parameters
        ----------
        y : (n, n_outputs) array
        u : (n, n_inputs) array
        p : (n, n_scheduling) array
            As logged, before any filter.
        weight : (n,) array, optional
            Needed where the structure has a weight channel.

        Returns
        -------
        (size + n_outputs, rows) array
            No columns while the past is still filling.
        """
        self._y, self._u, self._p = np.vstack([self._y, y]), np.vstack([self._u, u]), np.vstack([self._p, p])
        if self.structure.weight is not None:
            assert weight is not None
            self._w = np.concatenate([self._w, weight])
        return self._emit(len(self._y) - self.ahead)

    def close(self) -> np.ndarray:
        """The rows that waited for samples which will not come (beyond the end, the last p holds); then a cut.

        Returns
        -------
        (size + n_outputs, rows) array
        """
        rows = self._emit(len(self._y))
        self.cut()
        return rows

    def blocks(self, record: Record) -> Iterator[np.ndarray]:
        """Push a record in parts; yields the rows of each.

        Parameters
        ----------
        record : Record
            Uniform and finite; it goes on from what was pushed before.

        Yields
        ------
        (size + n_outputs, rows) array
        """
        s = self.structure
        names = s.basis.names
        for first in range(0, record.n_samples, PUSH):
            part = slice(first, first + PUSH)
            y = np.column_stack([record[n][part] for n in s.output])
            u = np.column_stack([record[n][part] for n in s.input])
            p = np.column_stack([record[n][part] for n in names]) if names else np.zeros((len(y), 0))
            yield self.push(y, u, p, None if s.weight is None else record[s.weight][part])

    def state(self) -> dict:
        """Plain data: what `restore` needs to go on from here.

        Returns
        -------
        dict
            For JSON: the place of the next row, and the samples kept as past.
        """
        return {"next": self._next, "y": self._y.tolist(), "u": self._u.tolist(), "p": self._p.tolist(),
                "w": self._w.tolist()}

    def restore(self, state: dict) -> None:
        """Go on from a `state`.

        Parameters
        ----------
        state : dict
            From a stream of the same structure.
        """
        self.cut()
        n = len(state["y"])
        self._next = int(state["next"])
        self._y = np.array(state["y"], dtype=float).reshape(n, self.n_outputs)
        self._u = np.array(state["u"], dtype=float).reshape(n, self.n_inputs)
        self._p = np.array(state["p"], dtype=float).reshape(n, self._p.shape[1])
        self._w = np.array(state["w"], dtype=float)

    def _emit(self, last: int) -> np.ndarray:
        from lpvid._kernels import fill_regressor

        first, k, ny = self._next, self.size, self.n_outputs
        rows = max(last - first, 0)
        block = np.empty((k + ny, rows))
        if rows:
            p = self._p if self.filter is None else self.filter.apply(self._p, self.sample_time)  # type: ignore[union-attr]
            low = first - self.start
            phi = self.structure.basis.evaluate(p[low:])[: last - low].T
            u = self._u[low:last]
            if self.stage is not None:
                u = self.stage.apply(u, p[low:last])
            signals = np.vstack([self._y[low:last].T, u.T, np.ones((1, last - low))])
            c = self.columns
            fill_regressor(block, 0, self.start, rows, signals, np.ascontiguousarray(phi), c.source, c.sign, c.lag,
                           c.function, c.phi_lag)
            block[k:] = self._y[first:last].T
            if self._w.size:
                block *= np.sqrt(self._w[first:last])
            self._next = last
        drop = self._next - self.keep
        if drop > 0:
            self._y, self._u, self._p, self._w = self._y[drop:], self._u[drop:], self._p[drop:], self._w[drop:]
            self._next -= drop
        return block
