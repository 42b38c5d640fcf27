"""Local fit: the value of a noisy curve at one abscissa, over the widest window in which a parabola describes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.identification.covariance import clusters, inverse_gram

LEAST = 6
"""samples of each group that a window needs: twice the unknowns of a parabola"""
SHRINK = 0.7
"""factor from one trial window to the next: the standard error grows by a fifth at each"""
CURVED = 2.0
"""standard errors above which a cubic term states that a window is too wide"""
APART = 3.0
"""standard errors above which a difference from a smaller window states so: about ten of these are looked at"""
ENOUGH = 24
"""samples from which a smaller window's standard error is good to 15 %, so that it can reject a larger one"""


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

    h is the largest of a falling series for which a cubic term is within two standard errors of zero and the value
    agrees with those of all smaller windows within three of their standard errors (Lepskii 1991, Theory Probab.
    Appl. 35).
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
    fits = []
    least = min(LEAST * np.unique(group).size, u.size)  # cycles that are sampled at the same phases are one point
    h = max(widest, float(np.sort(np.abs(u))[least - 1]))
    inside = np.abs(u) <= h
    while inside.sum() >= least:
        fits.append((_fit(u[inside], y[inside], group[inside], h), _cubic(u[inside] / h, y[inside], group[inside])))
        h *= SHRINK
        inside = np.abs(u) <= h
    for k, (found, cubic) in enumerate(fits):
        agrees = all(abs(found.value - other.value) <= APART * other.std for other, _ in fits[k + 1:]
                     if other.count >= ENOUGH)
        if agrees and not cubic:
            return found
    return fits[-1][0]


def _fit(u: np.ndarray, y: np.ndarray, group: np.ndarray, h: float) -> LocalFit:
    s = u / h
    design = np.vander(s, 3 if s.size > LEAST else 2, increasing=True)
    beta, cov, _ = _least_squares(design, y, group)
    beyond = max(float(s.min()), -float(s.max()), 0.0)
    return LocalFit(float(beta[0]), float(np.sqrt(cov[0, 0])), float(beta[1] / h), int(s.size), beyond)


def _cubic(s: np.ndarray, y: np.ndarray, group: np.ndarray) -> bool:
    beta, cov, dof = _least_squares(np.vander(s, 4, increasing=True), y, group)
    return dof > 0 and abs(float(beta[3])) > CURVED * float(np.sqrt(cov[3, 3]))


def _least_squares(design: np.ndarray, y: np.ndarray, group: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    beta = np.linalg.lstsq(design, y, rcond=None)[0]
    rest = y - design @ beta
    dof = y.size - design.shape[1]
    inverse = inverse_gram(design)
    ordinary = inverse * float(rest @ rest) / max(dof, 1)
    count = np.unique(group).size
    if count < 3:
        return beta, ordinary, dof
    robust = inverse @ clusters(design * rest[:, None], group) @ inverse * count / (count - 1)
    wider = np.diag(robust) > np.diag(ordinary)  # few groups scatter: the larger of the two
    return beta, np.where(np.outer(wider, wider), robust, ordinary), dof
