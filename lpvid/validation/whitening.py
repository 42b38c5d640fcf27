"""Whitening: weights of the errors where repeats give the spectrum of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid._stationary import toeplitz_basis, variance_components
from lpvid.baselines.repeats import Repeat
from lpvid.rounding import EXPLODED, TINY
from lpvid.validation.trust import QUANTILE, autocovariance


@dataclass(frozen=True, eq=False)
class Whitening:
    """Noise and misfit along the eigenvectors of the noise of a block, and the weights that these give.

    An error e = m + n in a block has along eigenvector i of the covariance of n the variance λ_i of the noise and m_i
    of the misfit. The misfit counts as α samples of N: its variance is m_i N/α as far as the evidence is concerned, and
    the precision of the coordinate is p_i = 1/(λ_i + m_i N/α). For white noise and a misfit like it that is the κ/σ² of
    all other errors. The weights are p_i over their mean.

    Noise that is slower than a block is alike in its neighbours, and of an offset many such blocks say little more than
    one. So λ_i in p_i is the variance of the sum over all blocks, by their number: the covariances between blocks are
    added. In the most probable misfit it is that within a block.

    Attributes
    ----------
    variance : float
        Of the noise, in the output's unit squared.
    within, noise, misfit : (n,) arrays
        λ within a block and over all blocks, and m, in the same unit.
    shapes : (3, n) array
        Misfits of mean one: like the output's power, like its amplitude, and white.
    basis : (n, n) array
        Eigenvectors in columns.
    root_weight : (n,) array
        Square roots of the weights.
    least : float
        Least mean square of a misfit, in the same unit: no law is known to be exact, however small its error is.
    """

    variance: float
    within: np.ndarray
    noise: np.ndarray
    misfit: np.ndarray
    shapes: np.ndarray
    basis: np.ndarray
    root_weight: np.ndarray
    least: float = 0.0

    def weighed(self, stacked: np.ndarray) -> np.ndarray:
        """Values whose squares count by the weights; their blocks keep their places.

        Parameters
        ----------
        stacked : (N,) or (N, k) array
            Block by block.

        Returns
        -------
        (N,) or (N, k) array
        """
        return self._scaled(stacked, self.root_weight)

    def unweighed(self, stacked: np.ndarray) -> np.ndarray:
        """Values as they are in time, from those that were weighed.

        Parameters
        ----------
        stacked : (N,) or (N, k) array

        Returns
        -------
        (N,) or (N, k) array
        """
        return self._scaled(stacked, 1 / self.root_weight)

    def beside(self, error: np.ndarray, alpha: float | None = None) -> Whitening:
        """The same noise beside the misfit of a model, at its most probable variances.

        A misfit below `least` is raised to it, by equal parts of all `shapes`.

        Parameters
        ----------
        error : (N,) array
            Of the model as it is in time, in the output's unit.
        alpha : float, optional
            α, samples that a misfit counts as: of new weights; without it the weights stay.

        Returns
        -------
        Whitening
        """
        misfit = variance_components(_squares(error, self.basis), self.within, self.shapes) @ self.shapes
        misfit = misfit + max(self.least - float(misfit.mean()), 0.0) * self.shapes.mean(axis=0)
        if alpha is None:
            return replace(self, misfit=misfit)
        precision = 1 / (self.noise + misfit * error.size / alpha)
        return replace(self, misfit=misfit, root_weight=np.sqrt(precision / precision.mean()))

    def independent_share(self, samples: int, alpha: float) -> float:
        """κ: Σ g (λ + m)/Σ g (λ + m N/α), at most one, with the weights g, which are those for one α.

        The first λ is that within a block, as the error has it.

        Parameters
        ----------
        samples : int
            N.
        alpha : float
            α.

        Returns
        -------
        float
        """
        weight = self.root_weight**2
        inside = float(weight @ (self.within + self.misfit))
        return min(inside / float(weight @ (self.noise + self.misfit * samples / alpha)), 1.0)

    def _scaled(self, stacked: np.ndarray, scale: np.ndarray) -> np.ndarray:
        blocks = stacked.reshape(-1, self.noise.size, stacked[0].size)
        return np.matmul(self.basis, scale[:, None] * np.matmul(self.basis.T, blocks)).reshape(stacked.shape)


def _squares(stacked: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """(n,) mean square along every eigenvector of values as they are in time, over all blocks."""
    return np.mean((stacked.reshape(-1, len(basis)) @ basis) ** 2, axis=0)


def whitening_of(pairs: Sequence[Repeat], errors: Sequence[np.ndarray], output: np.ndarray, size: int, start: int,
                 least: float = 0.0) -> Whitening | None:
    """The noise of blocks of some samples, from the error that does not repeat where the inputs do.

    The autocovariance is the biased one, with a positive spectrum: at a lag of k of n samples its mean is (1 − k/n) of
    the true one. Of two halves of one record slow noise is partly the same, and counts as less.

    The misfit is partly like the output, partly less peaked than it and partly white: a law errs in proportion to its
    force, the fit removes most of that where the force has most, and where the motion reverses an error has any
    frequency.

    Parameters
    ----------
    pairs : sequence of Repeat
        Of the records.
    errors : sequence of (n,) arrays
        Of a model, per record, in the output's unit: what repeats of them is left out.
    output : (N,) array
        Of the blocks, one after the other, about its mean.
    size : int
        n, samples of a block.
    start : int
        Samples at the head of a pair that are left out: a simulation starts there.
    least : float
        As of `Whitening`.

    Returns
    -------
    Whitening or None
        Without misfit and with equal weights; None where fewer samples repeat than two blocks have.
    """
    differences = [(first - second)[start:] / np.sqrt(2) for first, second in (p.pair(errors) for p in pairs)]
    count = sum(d.size for d in differences)
    if count < 2 * size:
        return None
    covariance = np.sum([autocovariance(d, max(e.size for e in differences)) for d in differences], axis=0) / count
    if not 0 < covariance[0] < EXPLODED:
        return None
    within, basis = toeplitz_basis(covariance[:size])
    noise = _summed_over_blocks(covariance, basis, within, count // size)
    like_output = _squares(output, basis)
    shapes = np.array([like_output**power for power in (1.0, 0.5, 0.0)])
    shapes /= np.maximum(shapes.mean(axis=1, keepdims=True), TINY)
    return Whitening(float(covariance[0]), within, noise, np.zeros(size), shapes, basis, np.ones(size), least)


def _summed_over_blocks(covariance: np.ndarray, basis: np.ndarray, within: np.ndarray, count: int) -> np.ndarray:
    """(n,) variance of the sum over blocks along every eigenvector, by their number.

    `within` is that of a block alone. The covariance with each further block counts as long as it is positive beyond
    its 95 % interval with `count` blocks (Geyer 1992, initial positive sequence).
    """
    from scipy.linalg import toeplitz

    total, counted, size = within.copy(), np.full(within.size, True), within.size
    for first in range(size, covariance.size - size, size):
        later = toeplitz(covariance[first: first + size], covariance[first:first - size:-1])
        between = np.einsum("ti,ti->i", basis, later @ basis)
        counted &= between > QUANTILE / np.sqrt(count) * within
        if not counted.any():
            break
        total += 2 * np.where(counted, between, 0.0)
    return total
