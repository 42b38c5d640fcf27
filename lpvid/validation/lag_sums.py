"""Covariances over lags of signals that arrive in pieces."""

from __future__ import annotations

import numpy as np

BLOCK = 16_384
"""Samples multiplied at once: two of them fit into a core's cache."""


class LagSums:
    """Σ_j (x(j+k) − x̄)(y(j) − ȳ) for k = 0 … lags, record by record, each about its own means.

    With S_k = Σ_j x(j+k) y(j) over a record of n samples, the centred sum is S_k − x̄ Σ_{j<n−k} y(j) − ȳ Σ_{j≥k} x(j)
    + (n − k) x̄ ȳ: the first and last `lags` samples are kept. Both signals are taken from their first piece's means,
    which keeps the differences free of cancellation.

    Parameters
    ----------
    lags : int
    shortest : int
        Records of no more samples count for nothing.

    Examples
    --------
    >>> sums = LagSums(1, 0)
    >>> for part in ([1.0, 2.0], [4.0, 1.0]):
    ...     sums.add(np.array(part), np.array(part))
    >>> sums.close(), sums.total
    (True, array([ 6., -2.]))
    """

    def __init__(self, lags: int, shortest: int) -> None:
        self.lags, self.shortest = lags, shortest
        self.total, self.n = np.zeros(lags + 1), 0
        self._clear()

    def _clear(self) -> None:
        self.count, self.sums = 0, np.zeros(self.lags + 1)
        self.pivot = (0.0, 0.0)
        self.x_sum = self.y_sum = 0.0
        self.head, self.tail_y = np.zeros(0), np.zeros(0)

    def add(self, x: np.ndarray, y: np.ndarray) -> None:
        """The next samples of a record."""
        if not x.size:
            return
        if not self.count:
            self.pivot = (float(x.mean()), float(y.mean()))
        for first in range(0, x.size, BLOCK):
            part = slice(first, first + BLOCK)
            self._block(x[part] - self.pivot[0], y[part] - self.pivot[1])

    def _block(self, x: np.ndarray, y: np.ndarray) -> None:
        past = np.concatenate([self.tail_y, y])
        before = self.tail_y.size
        for k in range(self.lags + 1):
            reach = min(k, before)  # x(j) meets y(j − k), the first `k − reach` of which stand before the record
            skip = k - reach
            self.sums[k] += x[skip:] @ past[before - reach: past.size - k] if x.size > skip else 0.0
        if self.head.size < self.lags:
            self.head = np.concatenate([self.head, x[: self.lags - self.head.size]])
        self.tail_y = past[max(past.size - self.lags, 0):] if self.lags else past[:0]
        self.x_sum, self.y_sum = self.x_sum + float(x.sum()), self.y_sum + float(y.sum())
        self.count += x.size

    def close(self) -> bool:
        """The end of a record; whether it was long enough to count."""
        n = self.count
        long = n > self.shortest
        if long:
            k = np.arange(self.lags + 1)
            first = np.concatenate([[0.0], np.cumsum(self.head)])[np.minimum(k, self.head.size)]
            last = np.concatenate([[0.0], np.cumsum(self.tail_y[::-1])])[np.minimum(k, self.tail_y.size)]
            mx, my = self.x_sum / n, self.y_sum / n
            centred = self.sums - mx * (self.y_sum - last) - my * (self.x_sum - first) + (n - k) * mx * my
            self.total += np.where(k < n, centred, 0.0)
            self.n += n
        self._clear()
        return long
