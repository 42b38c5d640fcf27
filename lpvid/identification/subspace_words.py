"""Past data as words of the scheduling: the regression behind a predictor-based LPV subspace estimate.

The predictor's state is linear in the words z(k−v) ⊗ φ(k−v) ⊗ … ⊗ φ(k−1) of the past z = (u, y, 1), v = 1 … past.
Their number grows as Mᵛ, so two equal estimates stand here: one with the words written out, one with their inner
products alone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

GRID = np.logspace(-12, 1, 40)
"""penalties tried, relative to the largest eigenvalue of the Gram matrix."""
DEAR = 1.4
"""what a degree of freedom costs in cross-validation."""
SPAN = 1024
"""samples handled at once."""


@dataclass(frozen=True, eq=False)
class Trace:
    """One record, scaled: letters φ (n, M), past signals z (n, nz), what acts on y directly (n, nd), y (n, ny).

    Attributes
    ----------
    phi : (n, M) array
        Scaled to unit mean square.
    z : (n, nz) array
        Inputs, outputs and, with offsets, 1.
    now : (n, nd) array
        Inputs where there is a direct term, and 1 where there are offsets.
    y : (n, ny) array
        In units of its spread.
    """

    phi: np.ndarray
    z: np.ndarray
    now: np.ndarray
    y: np.ndarray


class Words(ABC):
    """Ridge regression of y(k) = Σ_m φ_m(k) [C_m x(k) + …] on words, its penalty by generalised cross-validation."""

    penalty: float

    @abstractmethod
    def rows(self, trace: Trace, letter: np.ndarray, future: int) -> np.ndarray:
        """(n − past, future·M·ny) estimates of C_m A(letter)ⁱ x(k), i < future, for k = past … n − 1.

        Parameters
        ----------
        trace : Trace
            Any record, scaled as those of the fit.
        letter : (M,) array
            Basis values at which the state runs on.
        future : int
            Number of predicted outputs; no more than the past.

        Returns
        -------
        (n − past, future·M·ny) array
        """


def number_of_words(letters: int, signals: int, direct: int, past: int) -> int:
    """Columns of the written-out regression.

    Parameters
    ----------
    letters : int
        Functions of the basis M.
    signals : int
        Past signals nz.
    direct : int
        Signals that act on the output directly, nd.
    past : int
        Longest word.

    Returns
    -------
    int
    """
    total = 0
    for _ in range(past):
        total = letters * (signals + total)
    return letters * (total + direct)


@dataclass(frozen=True, eq=False)
class WrittenWords(Words):
    """The regression with every word as a column.

    Attributes
    ----------
    past : int
        Longest word [samples].
    coefficients : (M, n_words, ny) array
        Of the words of the past, by the letter in front.
    n_words : int
        Words without the letter in front.
    penalty : float
        Of the ridge, on the squared coefficients.
    """

    past: int
    coefficients: np.ndarray
    n_words: int
    penalty: float

    @classmethod
    def fit(cls, traces: Sequence[Trace], past: int) -> WrittenWords:
        """Regression on all rows, folded into one triangular factor.

        Parameters
        ----------
        traces : sequence of Trace
            The records.
        past : int
            Longest word [samples].

        Returns
        -------
        WrittenWords
        """
        m, nz = traces[0].phi.shape[1], traces[0].z.shape[1]
        ny, nd = traces[0].y.shape[1], traces[0].now.shape[1]
        width = number_of_words(m, nz, nd, past)
        factor, count = np.zeros((0, width + ny)), 0
        for trace in traces:
            for first in range(past, len(trace.y), max(SPAN, width)):
                k = np.arange(first, min(first + max(SPAN, width), len(trace.y)))
                words = np.hstack([_written(trace, k, past), trace.now[k]])
                stacked = np.vstack([factor, np.hstack([_with_letters(trace.phi[k], words), trace.y[k]])])
                factor = np.asarray(np.linalg.qr(stacked, mode="r"))
                count += k.size
        if len(factor) < width + ny:
            factor = np.vstack([factor, np.zeros((width + ny - len(factor), width + ny))])
        u, s, vt = np.linalg.svd(factor[:width, :width])
        target = u.T @ factor[:width, width:]
        penalty = _cross_validated(s**2, target, float(np.sum(factor[width:, width:] ** 2)), count)
        theta = vt.T @ ((s / (s**2 + penalty))[:, None] * target)
        n_words = width // m - nd
        return cls(past, theta.reshape(m, n_words + nd, ny)[:, :n_words], n_words, penalty)

    def rows(self, trace: Trace, letter: np.ndarray, future: int) -> np.ndarray:
        m, nz = trace.phi.shape[1], trace.z.shape[1]
        lefts = [self.coefficients]
        for _ in range(1, future):  # A(letter) in front: what stands behind that letter, one step further back
            per_letter = lefts[-1].reshape(m, m, -1, self.coefficients.shape[-1])
            lefts.append(np.einsum("l,mlwo->mwo", letter, per_letter)[:, nz:])
        out = np.empty((len(trace.y) - self.past, future, m * self.coefficients.shape[-1]))
        for first in range(self.past, len(trace.y), SPAN):  # the words of a record would be some hundred times as large
            k = np.arange(first, min(first + SPAN, len(trace.y)))
            for i, left in enumerate(lefts):
                words = _written(trace, k, self.past - i)
                out[k - self.past, i] = np.einsum("kw,mwo->kmo", words, left).reshape(k.size, -1)
        return out.reshape(len(out), -1)


def _written(trace: Trace, k: np.ndarray, length: int) -> np.ndarray:
    """(len(k), words) words of up to `length` letters before the samples k: φ(k−1) ⊗ [z(k−1), words before that]."""
    words = np.zeros((k.size, 0))
    for v in range(length, 0, -1):
        words = _with_letters(trace.phi[k - v], np.hstack([trace.z[k - v], words]))
    return words


def _with_letters(phi: np.ndarray, words: np.ndarray) -> np.ndarray:
    return np.einsum("km,kw->kmw", phi, words).reshape(len(phi), -1)


@dataclass(frozen=True, eq=False)
class KernelWords(Words):
    """The regression by inner products of words, on chosen rows (memory and time grow with their number squared).

    Attributes
    ----------
    past : int
        Longest word [samples].
    chosen : tuple of (Trace, (c,) int array)
        Rows of every record that the regression holds.
    dual : (rows, ny) array
        Dual coefficients.
    penalty : float
        Of the ridge, on the squared coefficients.
    """

    past: int
    chosen: tuple[tuple[Trace, np.ndarray], ...]
    dual: np.ndarray
    penalty: float

    @classmethod
    def fit(cls, traces: Sequence[Trace], past: int, limit: int) -> KernelWords:
        """Up to `limit` rows, spread evenly over all traces.

        Parameters
        ----------
        traces : sequence of Trace
            The records.
        past : int
            Longest word [samples].
        limit : int
            Rows at most, but at least one per record.

        Returns
        -------
        KernelWords
        """
        total = sum(len(t.y) - past for t in traces)
        share = min(1.0, limit / total)
        counts = [max(1, int(share * (len(t.y) - past))) for t in traces]
        chosen = tuple((t, np.linspace(past, len(t.y) - 1, c).astype(int)) for t, c in zip(traces, counts, strict=True))
        gram = np.block([[_output_kernel(a, i, b, j, past) for b, j in chosen] for a, i in chosen])
        y = np.vstack([t.y[k] for t, k in chosen])
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        values = np.maximum(values, 0.0)
        target = vectors.T @ y
        penalty = _cross_validated(values, target, 0.0, values.size)
        return cls(past, chosen, vectors @ (target / (values + penalty)[:, None]), penalty)

    def rows(self, trace: Trace, letter: np.ndarray, future: int) -> np.ndarray:
        m, ny = trace.phi.shape[1], trace.y.shape[1]
        out = np.zeros((len(trace.y) - self.past, future, m, ny))
        first = 0
        for source, k in self.chosen:
            dual = self.dual[first: first + k.size]
            first += k.size
            weight = source.phi[k][:, :, None] * dual[:, None, :]
            for i in range(future):
                if i:
                    weight = weight * (source.phi[k - i] @ letter)[:, None, None]
                flat = weight.reshape(k.size, -1)
                for low in range(self.past, len(trace.y), SPAN):
                    here = np.arange(low, min(low + SPAN, len(trace.y)))
                    kernel = _kernel(source, k - i, trace, here, self.past - i)
                    out[here - self.past, i] += (kernel.T @ flat).reshape(here.size, m, ny)
        return out.reshape(len(out), -1)


def _kernel(first: Trace, i: np.ndarray, second: Trace, j: np.ndarray, length: int) -> np.ndarray:
    """Inner products of the words of up to `length` letters before samples i and j: Horner from the far end."""
    total = np.zeros((i.size, j.size))
    for v in range(length, 0, -1):
        total += first.z[i - v] @ second.z[j - v].T
        total *= first.phi[i - v] @ second.phi[j - v].T
    return total


def _output_kernel(first: Trace, i: np.ndarray, second: Trace, j: np.ndarray, past: int) -> np.ndarray:
    inner = _kernel(first, i, second, j, past) + first.now[i] @ second.now[j].T
    return inner * (first.phi[i] @ second.phi[j].T)


def _cross_validated(squares: np.ndarray, target: np.ndarray, rest: float, count: int) -> float:
    """Penalty of least generalised cross-validation (Golub, Heath & Wahba 1979) from singular values squared.

    Each degree of freedom counts 1.4 times (Kim & Gu 2004): with about as many words as rows the plain criterion
    at times takes no penalty at all.
    """
    power, grid = np.sum(target**2, axis=1), GRID * max(squares.max(initial=0.0), 1e-300)
    best = (np.inf, float(grid[-1]))
    for penalty in grid:
        shrunk = penalty / (squares + penalty)
        freedom = count - DEAR * float(np.sum(1 - shrunk))
        if freedom > 0:
            best = min(best, ((float(shrunk**2 @ power) + rest) / freedom**2, float(penalty)))
    return best[1]
