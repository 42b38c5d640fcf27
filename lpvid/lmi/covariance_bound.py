"""A matrix above the covariance of an LPV system's states, and what it bounds of the outputs: rms and peak."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.lmi.certificate import diagonal
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import LyapunovInequality, Pieces
from lpvid.lmi.storage import Storage


@dataclass(frozen=True, eq=False)
class CovarianceBound(LyapunovInequality):
    """Q̇ − AQ − QAᵀ − BBᵀ ≻ 0, in discrete time Q⁺ − AQAᵀ − BBᵀ ≻ 0, and ν² > tr(CQCᵀ + DDᵀ) or ν²I ≻ CQCᵀ + DDᵀ.

    Q(p) is then above the covariance of the states from rest under white noise of unit intensity, so that E|z|² ≤ ν² at
    every instant; and xᵀQ⁻¹x is at most the energy of any w so far, so that |z|² ≤ ν²‖w‖² where the second holds
    (Boyd, El Ghaoui, Feron & Balakrishnan 1994, sections 6.2.1 and 10.1). In continuous time D must be zero.

    Parameters
    ----------
    system : Driven
    storage : Storage
        Q(p).
    level : float
        ν.
    peak : bool
        The second of the two conditions on ν.
    """

    system: Driven
    storage: Storage
    level: float
    peak: bool
    power: int = 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        noise, at = q.B @ q.B.swapaxes(2, 3), q.A.swapaxes(2, 3)
        if self.system.sample_time is not None:
            state = q.later + s * (q.A @ q.P @ at + noise)
        else:
            product = q.A @ q.P
            state = q.later + s * (product + product.swapaxes(2, 3) + noise)
        seen = q.C @ q.P @ q.C.swapaxes(2, 3) + q.D @ q.D.swapaxes(2, 3)
        if not self.peak:
            seen = np.trace(seen, axis1=2, axis2=3)[..., None, None]
        return diagonal(state, self.level**2 * np.eye(seen.shape[-1]) + s * seen)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        n, m = len(root), self.system.coefficients.shape[1] - len(root) if self.peak else 1
        if self.system.sample_time is None and n:
            a = self.system.matrices(self.storage.box.centre[None, :])[0][0]
            size = float(np.linalg.norm(root @ a @ np.linalg.inv(root), 2))
            root = root / np.sqrt(size if 0 < size < np.inf else 1.0)
        return diagonal(root, np.eye(m) / max(self.level, 1e-300))
