"""Who differs from the fleet: robust scores of the free-run errors, with the false discovery rate controlled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks

CONSISTENT = 1.4826
"""1/Φ⁻¹(3/4): a median absolute deviation times this is the standard deviation of a normal sample."""
EFFICIENCY = 0.37
"""Variance of the standard deviation over that of the scaled median absolute deviation, for normal samples (Huber)."""
FEWEST = 8
"""Files without which a spread between them is no more than a guess: the median absolute deviation of 8 normal values
has a relative standard error of 40 %."""


@dataclass(frozen=True)
class Differing:
    """Files and how far each lies from the others.

    Attributes
    ----------
    score : mapping of str to float
        Robust standard score of log ESR: (log ESR − median)/(1.4826 median |log ESR − median|).
    q : mapping of str to float
        Least false discovery rate at which the file is among the named (Benjamini & Hochberg 1995).
    named : tuple of str
        Those with q at most `fdr`, worst first.
    fdr : float
    centre, spread : float
        Median of log ESR and its robust standard deviation.
    """

    score: Mapping[str, float]
    q: Mapping[str, float]
    named: tuple[str, ...]
    fdr: float
    centre: float
    spread: float


def differing(esr: Mapping[str, float], fdr: float = 0.05) -> Differing:
    """Which files a model of all files describes worse than the others differ among themselves.

    The logarithm of the free-run error of healthy specimens is taken as normal about the fleet's median with a robust
    spread. That spread is an estimate as uncertain as a standard deviation of 0.37 n values (the efficiency of the
    median absolute deviation), so that a file's p-value is the upper tail of Student's t with 0.37 n degrees of
    freedom. The step-up rule of Benjamini & Hochberg bounds the expected share of false names.

    Parameters
    ----------
    esr : mapping of str to float
        Free-run ESR of one model along each file; infinite where it diverges.
    fdr : float

    Returns
    -------
    Differing
        Nobody is named among fewer than eight files.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> esr = {f"d{k}": float(np.exp(rng.normal(-4, 0.2))) for k in range(40)} | {"bad": 0.2}
    >>> differing(esr).named
    ('bad',)
    """
    from scipy.stats import t

    fdr = _checks.positive(fdr, "fdr")
    names = list(esr)
    logs = np.array([np.log(max(float(esr[n]), np.finfo(float).tiny)) for n in names])
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
    p = t.sf(scores, EFFICIENCY * finite.size)
    order = np.argsort(p)
    steps = p[order] * len(p) / np.arange(1, len(p) + 1)
    q = np.empty(len(p))
    q[order] = np.minimum(np.minimum.accumulate(steps[::-1])[::-1], 1.0)
    named = tuple(names[k] for k in order if q[k] <= fdr)
    return Differing(dict(zip(names, map(float, scores), strict=True)), dict(zip(names, map(float, q), strict=True)),
                     named, fdr, centre, spread)
