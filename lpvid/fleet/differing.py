"""Which files differ from the fleet: robust scores of the departures, with the false discovery rate controlled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from lpvid import _checks
from lpvid.identification.regression import Factor

CONSISTENT = 1.4826
"""1/Φ⁻¹(3/4): a median absolute deviation times this is the standard deviation of a normal sample."""
EFFICIENCY = 0.37
"""Variance of the standard deviation over that of the scaled median absolute deviation, for normal samples (Huber)."""
PER_PARAMETER = 5
"""Files for each parameter below which no covariance between them is taken."""
SIMULATED = 20_000
"""Files of simulated healthy fleets: their 99 % point has a standard error of 1 to 2 %."""
FEWEST = 8
"""Files without which a spread between them is not known: the median absolute deviation of 8 normal values
has a relative standard error of 40 %."""


@dataclass(frozen=True)
class Differing:
    """Files and how far each lies from the others.

    Attributes
    ----------
    score : mapping of str to float
        Robust standard score of the logarithm of the departure d: (log d − median)/(1.4826 median |log d − median|); by
        `differing_parameters`, the root of the squared robust distance over its median.
    q : mapping of str to float
        Least false discovery rate at which the file is among the named (Benjamini & Hochberg 1995).
    named : tuple of str
        Those with q at most `fdr`, worst first.
    fdr : float
    centre, spread : float
        Median of log d and its robust standard deviation.
    p : mapping of str to float
        Probability of a healthy file at least as far away.
    needed : float or None
        Score from which a single file would be named; None where its distribution is not that of `needed_score`.
    """

    score: Mapping[str, float]
    q: Mapping[str, float]
    named: tuple[str, ...]
    fdr: float
    centre: float
    spread: float
    p: Mapping[str, float] = field(default_factory=dict)
    needed: float | None = None


def needed_score(files: int, fdr: float) -> float:
    """Score from which a single file of a fleet is named by one of two tests.

    The step-up rule names the farthest file from p ≤ fdr/n on, p = 2 p₁ of the two tests together, p₁ the upper tail of
    Student's t with 0.37 n degrees of freedom.

    Parameters
    ----------
    files : int
        n.
    fdr : float

    Returns
    -------
    float

    Examples
    --------
    >>> [round(needed_score(n, 0.05), 1) for n in (8, 20, 100)]
    [7.0, 4.5, 3.8]
    """
    from scipy.stats import t

    return float(t.isf(fdr / files / 2, EFFICIENCY * files))


def shift(own: Factor, theta: np.ndarray) -> np.ndarray:
    """R_xx(θ_i − θ) over the root mean square of the file's own residual: parameters in units of their noise.

    Parameters
    ----------
    own : Factor
    theta : (columns, outputs) array
        Parameters of the fleet's model.

    Returns
    -------
    (columns·outputs,) array
    """
    k = own.columns
    sigma = np.sqrt(np.sum(own.r[k:, k:] ** 2, axis=0) / max(own.rows - k, 1))
    signs = np.sign(np.diag(own.r[:k, :k]))
    return (signs[:, None] * (own.r[:k, k:] - own.r[:k, :k] @ theta) / np.where(sigma > 0, sigma, 1.0)).ravel()


def departure(own: Factor, theta: np.ndarray) -> float:
    """How much worse the fleet's model predicts a file one step ahead than the file's own model of that structure.

    d = (‖Y − Xθ‖² − ‖Y − Xθ_i‖²)/‖Y − Xθ_i‖² = ‖R_xx(θ − θ_i)‖²/‖R_yy‖² with the file's R of [X Y], R_xx θ_i = R_xy:
    the likelihood ratio of "this file's parameters are the fleet's". What the structure describes wrongly in every file
    alike stands in the denominator, not in the numerator.

    Parameters
    ----------
    own : Factor
    theta : (columns, outputs) array
        Parameters of the fleet's model.

    Returns
    -------
    float
    """
    k = own.columns
    apart = own.r[:k, :k] @ theta - own.r[:k, k:]
    rest = float(np.sum(own.r[k:, k:] ** 2))
    return float(np.sum(apart**2)) / rest if rest > 0 else np.inf


def differing(departures: Mapping[str, float], fdr: float = 0.05) -> Differing:
    """Which files depart from the model of all files further than the others do among themselves.

    The logarithm of the departure of healthy specimens is taken as normal about the fleet's median with a robust
    spread. That spread is an estimate as uncertain as a standard deviation of 0.37 n values (the efficiency of the
    median absolute deviation), so that a file's p-value is the upper tail of Student's t with 0.37 n degrees of
    freedom. The step-up rule of Benjamini & Hochberg bounds the expected share of false names.

    Parameters
    ----------
    departures : mapping of str to float
        As `departure` gives them; any positive measure of distance will do.
    fdr : float

    Returns
    -------
    Differing
        None is named among fewer than eight files.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> d = {f"d{k}": float(np.exp(rng.normal(-4, 0.2))) for k in range(40)} | {"bad": 0.2}
    >>> differing(d).named
    ('bad',)
    """
    from scipy.stats import t

    fdr = _checks.positive(fdr, "fdr")
    names = list(departures)
    logs = np.array([np.log(max(float(departures[n]), np.finfo(float).tiny)) for n in names])
    finite = logs[np.isfinite(logs)]
    if finite.size < FEWEST:
        nothing = dict.fromkeys(names, 0.0)
        return Differing(nothing, dict.fromkeys(names, 1.0), (), fdr, float("nan"), float("nan"))
    centre = float(np.median(finite))
    spread = CONSISTENT * float(np.median(np.abs(finite - centre)))
    if spread > 0:
        scores = (logs - centre) / spread
    else:
        scores = np.where(logs > centre, np.inf, 0.0)
    return _named(names, scores, t.sf(scores, EFFICIENCY * finite.size), fdr, centre, spread)


def differing_parameters(shifts: Mapping[str, np.ndarray], fdr: float = 0.05) -> Differing | None:
    """Which files' parameters lie further from the fleet's than the specimens' own spread and noise explain.

    The distance of Mahalanobis with a mean and a covariance from the half of the files that lies closest together
    (minimum covariance determinant by concentration steps; Rousseeuw & Van Driessen 1999). Its distribution for a
    healthy fleet of this size, which depends on the numbers of files and parameters alone, is simulated: c F(k, ν) with
    c and ν from the median and the 99 % point of normal fleets. A shift across the directions in which healthy
    specimens differ counts, however small it is beside them.

    Parameters
    ----------
    shifts : mapping of str to (k,) array
        R_xx(θ_i − θ) of each file, over the residual's root mean square; any coordinates in which noise is about white.
    fdr : float

    Returns
    -------
    Differing or None
        None for fewer than five files for each parameter: a covariance from so few is none (Rousseeuw & Van Zomeren
        1990).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> spread = np.diag([10.0, 1.0])
    >>> files = {f"d{k}": spread @ rng.normal(size=2) for k in range(60)} | {"bad": np.array([0.0, 9.0])}
    >>> differing_parameters(files).named
    ('bad',)
    """
    from scipy.stats import f

    names = list(shifts)
    z = np.array([np.ravel(shifts[n]) for n in names])
    n, k = z.shape
    if n < PER_PARAMETER * k:
        return None
    distance = _distances(z)
    scale, nu = _healthy(n, k)
    p = f.sf(distance / scale, k, nu)
    typical = scale * f.median(k, nu)
    return _named(names, np.sqrt(distance / typical), p, _checks.positive(fdr, "fdr"), 1.0, 1.0)


def residual_level(own: Factor) -> float:
    """Mean square of the residual that a file's own model of the structure leaves, outputs summed.

    Parameters
    ----------
    own : Factor
        Triangular factor of the file's own regression, outputs behind the regressors.

    Returns
    -------
    float
        Per degree of freedom, in the square of the output's unit.
    """
    k = own.columns
    return float(np.sum(own.r[k:, k:] ** 2)) / max(own.rows - k, 1)


def differing_residuals(levels: Mapping[str, float], fdr: float = 0.05) -> Differing:
    """Which files' own models leave more, or less, than the others' own models do.

    A fault outside the model's structure (dry friction, for example) need not move its parameters, but the model cannot
    describe it. The logarithm of the level is taken as normal about the fleet's median, as in `differing`, and both
    tails count: a fault can also hide what the structure fails to describe.

    Parameters
    ----------
    levels : mapping of str to float
        As `residual_level` gives them.
    fdr : float

    Returns
    -------
    Differing

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> levels = {f"d{k}": float(np.exp(rng.normal(3, 0.1))) for k in range(40)} | {"high": 60.0, "low": 8.0}
    >>> differing_residuals(levels).named
    ('high', 'low')
    """
    from scipy.stats import t

    one = differing(levels, fdr)
    if not one.p:
        return one
    names = list(levels)
    scores = np.array([one.score[n] for n in names])
    p = 2 * t.sf(np.abs(scores), EFFICIENCY * len(names))
    return _named(names, scores, p, fdr, one.centre, one.spread)


def either(first: Differing, second: Differing) -> Differing:
    """Files that differ by one of two tests: p = min(1, 2 min(p₁, p₂)) (Bonferroni), with the score of the smaller.

    Parameters
    ----------
    first, second : Differing
        Of the same files; the rate of false discoveries is that of the first.

    Returns
    -------
    Differing
        `first` as it is where one of them judged no file.
    """
    if not first.p or not second.p:
        return first
    names = list(first.p)
    nearer = [first if first.p[n] <= second.p[n] else second for n in names]
    p = np.array([min(1.0, 2 * one.p[n]) for n, one in zip(names, nearer, strict=True)])
    scores = np.array([one.score[n] for n, one in zip(names, nearer, strict=True)])
    return _named(names, scores, p, first.fdr, first.centre, first.spread)


def from_factors(factors: Mapping[str, Factor], theta: np.ndarray, fdr: float) -> Differing:
    """Files that differ from the model of all, in parameters or in the level of the residual.

    Parameters
    ----------
    factors : mapping of str to Factor
        Each file's own least squares.
    theta : (k, n_outputs) array
        Parameters of the model of all.
    fdr : float
        False discovery rate.

    Returns
    -------
    Differing
    """
    levels = differing_residuals({n: residual_level(own) for n, own in factors.items()}, fdr)
    found = differing_parameters({n: shift(own, theta) for n, own in factors.items()}, fdr)
    if found is not None:
        return either(found, levels)
    both = either(differing({n: departure(own, theta) for n, own in factors.items()}, fdr), levels)
    return replace(both, needed=needed_score(len(factors), fdr)) if both.p else both


def _distances(z: np.ndarray) -> np.ndarray:
    """(n,) squared distances from the half that lies closest together."""
    n, k = z.shape
    half = (n + k + 1) // 2
    centred = z - np.median(z, axis=0)
    size = np.median(np.abs(centred), axis=0)
    distance = np.sum((centred / np.where(size > 0, size, 1.0)) ** 2, axis=1)
    chosen = np.sort(np.argsort(distance, kind="stable")[:half])
    for _ in range(100):
        mean, covariance = z[chosen].mean(axis=0), np.atleast_2d(np.cov(z[chosen].T))
        away = z - mean
        distance = np.einsum("ij,ij->i", away, np.linalg.lstsq(covariance, away.T, rcond=None)[0].T)
        following = np.sort(np.argsort(distance, kind="stable")[:half])
        if np.array_equal(following, chosen):
            break
        chosen = following
    return distance


@lru_cache
def _healthy(n: int, k: int) -> tuple[float, float]:
    """c and ν of c F(k, ν), the distances in a normal fleet of n files and k parameters."""
    from scipy.optimize import brentq
    from scipy.stats import f

    rng = np.random.default_rng(0)
    drawn = np.concatenate([_distances(rng.normal(size=(n, k))) for _ in range(-(-SIMULATED // n))])
    middle, far = np.quantile(drawn, [0.5, 0.99])

    def gap(log_nu: float) -> float:
        nu = float(np.exp(log_nu))
        return float(f.ppf(0.99, k, nu) / f.median(k, nu) - far / middle)

    low, high = np.log(1.0), np.log(1e6)
    crossed = gap(low) * gap(high) < 0
    nu = float(np.exp(brentq(gap, low, high) if crossed else high if gap(high) > 0 else low))  # type: ignore[arg-type]
    return float(middle / f.median(k, nu)), nu


def _named(names: list[str], scores: np.ndarray, p: np.ndarray, fdr: float, centre: float, spread: float) -> Differing:
    """The step-up rule."""
    order = np.argsort(p, kind="stable")
    steps = p[order] * len(p) / np.arange(1, len(p) + 1)
    q = np.empty(len(p))
    q[order] = np.minimum(np.minimum.accumulate(steps[::-1])[::-1], 1.0)
    named = tuple(names[k] for k in order if q[k] <= fdr)
    return Differing(dict(zip(names, map(float, scores), strict=True)), dict(zip(names, map(float, q), strict=True)),
                     named, fdr, centre, spread, dict(zip(names, map(float, p), strict=True)))
