"""Responses of frozen systems: gains over a grid of frequencies, and motion while all that moves is held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm


def largest_gain(system: Sequence[np.ndarray], points: np.ndarray) -> float:
    """Largest singular value of C(sI − A)⁻¹B + D among the points s of a grid."""
    a, b, c, d = system
    return float(np.linalg.norm(c @ np.linalg.solve(points[:, None, None] * np.eye(len(a)) - a, b) + d, 2,
                                axis=(1, 2)).max())


def held_steps(systems: Sequence[np.ndarray], time: float) -> tuple[np.ndarray, np.ndarray]:
    """Of each continuous system, with (x, w) = y at the begin: Φ with y = Φy at the end, and Q with ∫|z|² dt = yᵀQy.

    w is held for the time (Van Loan, IEEE TAC 23 (1978) 395-404). Systems are (A, B, C, D), each (count, ·, ·).
    """
    a, b, c, d = systems
    n, size = a.shape[1], a.shape[1] + b.shape[2]
    whole, out = np.zeros((len(a), size, size)), np.concatenate([c, d], axis=2)
    whole[:, :n] = np.concatenate([a, b], axis=2)
    pair = np.zeros((len(a), 2 * size, 2 * size))
    pair[:, :size, :size], pair[:, size:, size:] = -whole.swapaxes(1, 2), whole
    pair[:, :size, size:] = out.swapaxes(1, 2) @ out
    pair = expm(pair * time)
    step = pair[:, size:, size:]
    return step, step.swapaxes(1, 2) @ pair[:, :size, size:]
