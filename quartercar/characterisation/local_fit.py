"""Local fit: the value of a noisy curve at one abscissa, over the widest window in which a parabola describes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST = 6
"""samples that a window needs: twice the unknowns of a parabola"""
SHRINK = 0.7
"""factor from one trial window to the next: the standard error grows by a fifth at each"""
CURVED = 2.0
"""standard errors above which a cubic term counts, so that the window is too wide"""


@dataclass(frozen=True)
class LocalFit:
    """The value at the wanted place.

    Attributes
    ----------
    value, std : float
        With its standard error, from the spread between groups where there are three or more.
    slope : float
        Derivative there.
    count : int
        Samples used.
    outside : float
        How far the place lies beyond the samples used, as a share of the window; 0 where it is between them.
    """

    value: float
    std: float
    slope: float
    count: int
    outside: float


def local_fit(u: np.ndarray, y: np.ndarray, group: np.ndarray, widest: float) -> LocalFit | None:
    """Local parabola y ≈ β_0 + β_1 u + β_2 u², |u| ≤ h; the value is β_0.

    h starts at `widest` and shrinks until a cubic term is within two standard errors of zero or few samples are left.
    The variance is robust against errors that samples of one group (a cycle) share::

        V = (XᵀX)⁻¹ (Σ_g X_gᵀ e_g e_gᵀ X_g) (XᵀX)⁻¹ G/(G−1)

    (Liang and Zeger 1986, Biometrika 73, with independent working correlation); with fewer than three groups it is the
    ordinary one.

    Parameters
    ----------
    u, y : (n,) arrays
        Abscissa less the wanted place, and ordinate.
    group : (n,) array of int
    widest : float

    Returns
    -------
    LocalFit or None
        None with fewer than six samples.

    Examples
    --------
    >>> u = np.linspace(-1, 1, 201)
    >>> found = local_fit(u, np.tanh(2 * u + 0.5), np.arange(201) % 4, 1.0)
    >>> bool(abs(found.value - np.tanh(0.5)) < 2e-3)
    True
    """
    if u.size < LEAST:
        return None
    h = widest
    inside = np.abs(u) <= h
    if inside.sum() < LEAST:
        h = float(np.sort(np.abs(u))[LEAST - 1])
        inside = np.abs(u) <= h
    while True:
        smaller = np.abs(u) <= SHRINK * h
        if smaller.sum() < LEAST or not _cubic(u[inside] / h, y[inside], group[inside]):
            break
        h, inside = SHRINK * h, smaller
    s = u[inside] / h
    design = np.vander(s, 3 if inside.sum() > LEAST else 2, increasing=True)
    beta, cov, _ = _least_squares(design, y[inside], group[inside])
    beyond = max(float(s.min()), -float(s.max()), 0.0)
    return LocalFit(float(beta[0]), float(np.sqrt(cov[0, 0])), float(beta[1] / h), int(inside.sum()), beyond)


def _cubic(s: np.ndarray, y: np.ndarray, group: np.ndarray) -> bool:
    beta, cov, dof = _least_squares(np.vander(s, 4, increasing=True), y, group)
    return dof > 0 and abs(float(beta[3])) > CURVED * float(np.sqrt(cov[3, 3]))


def _least_squares(design: np.ndarray, y: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    beta = np.linalg.lstsq(design, y, rcond=None)[0]
    rest = y - design @ beta
    dof = y.size - design.shape[1]
    inverse = np.linalg.pinv(design.T @ design)
    ordinary = inverse * float(rest @ rest) / max(dof, 1)
    names = np.unique(group)
    if names.size < 3:
        return beta, ordinary, dof
    scores = np.array([design[group == g].T @ rest[group == g] for g in names])
    robust = inverse @ scores.T @ scores @ inverse * names.size / (names.size - 1)
    wider = np.diag(robust) > np.diag(ordinary)  # few groups scatter: the larger of the two
    return beta, np.where(np.outer(wider, wider), robust, ordinary), dof
