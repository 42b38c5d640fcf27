"""Tests on one-step residuals: whiteness, and independence from what the model could have used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.codec import Encoded

LAGS = 25
OTHER_LAGS = (5, 100)
"""numbers of lags over which whiteness is tested beside the usual one."""
LEVEL = 0.01
EXACT = 1e-11
"""residual over output below which a model is exact, and its residual nothing but rounding."""
RESOLVED = 1e-2
"""directions of the lagged inputs with less than this share of the largest variance give no reliable information."""


Instrument = tuple[np.ndarray | None, np.ndarray | None]
"""A weight of the residual, or None for 1, and a signal it must not depend on, or None where there is none."""


@dataclass(frozen=True)
class ResidualTest(Encoded):
    """A test on the one-step residuals.

    A small p-value states that the residual still holds something the model could have used.

    Attributes
    ----------
    name : str
        "whiteness", "independence", or what else was tested.
    statistic : float
        Of a χ² law where the hypothesis holds.
    p_value : float
    passed : bool
        Whether the p-value is at least `LEVEL`.
    description : str
        The outcome in words.
    """

    JSON = ("name", "statistic", "p_value", "passed", ("says", "description"))

    name: str
    statistic: float
    p_value: float
    passed: bool
    description: str


def residual_tests(residuals: Sequence[np.ndarray], inputs: Sequence[np.ndarray | None],
                   lags: int = LAGS, other_lags: Sequence[int] = (),
                   further: Mapping[str, Callable[[], Sequence[Instrument]]] | None = None) -> tuple[ResidualTest, ...]:
    """Whiteness of the one-step residual, and its independence from present and past inputs, and along the scheduling.

    Whiteness: Ljung & Box 1978, Q = N(N+2) Σ_τ ρ_ee²(τ)/(N−τ) against χ² with `lags` degrees of freedom. Independence:
    Söderström & Stoica 1989 (11.14), N r_εuᵀ P⁺ r_εu against χ², with P the covariance of the lagged inputs times the
    residual's own autocovariance summed over lags (Bartlett), so that a coloured residual does not fail by itself. Lags
    run from 0 (a missing direct term shows there and nowhere else; under feedback without a delay it shows too).

    Parameters
    ----------
    residuals, inputs : sequences of (n,) arrays, record by record
    lags : int
        Number of lags.
    other_lags : sequence of int
        Further numbers of lags over which whiteness is tested.
    further : mapping of str to callable, optional
        Further signals the residual must not depend on, record by record, computed when their turn comes: a weight of
        the residual (or None) and a signal; other inputs, or an input with a power of a scheduling variable as weight.

    Returns
    -------
    tuple of ResidualTest
        Empty where no record is longer than four times the lags.
    """
    long = [i for i, e in enumerate(residuals) if len(e) > 4 * lags]
    if not long:
        return ()
    centred = [residuals[i] - residuals[i].mean() for i in long]
    tests = [_whiteness(centred, lags)]
    instruments: dict[str, Callable[[], Sequence[Instrument]]] = {
        "independence": lambda: [(None, u) for u in inputs], **(further or {})}
    for name, instrument in instruments.items():
        every = instrument()
        pairs = [(e if w is None else e * w - (e * w).mean(), u - u.mean())
                 for e, (w, u) in zip(centred, (every[i] for i in long), strict=True)
                 if u is not None and np.ptp(u) > 0]
        if pairs:
            tests.append(replace(_independence(pairs, lags), name=name))
    for other in other_lags:
        if all(len(e) > 4 * other for e in centred):
            tests.append(replace(_whiteness(centred, other), name=f"whiteness over {other} lags"))
    return tuple(tests)


def lagged_means(pairs: Sequence[tuple[np.ndarray, np.ndarray]], lags: int) -> np.ndarray:
    """Mean of x(t) u(t−k) over all records, k = 0 … lags.

    Parameters
    ----------
    pairs : sequence of ((n,) array, (n,) array)
        x and u of each record.
    lags : int

    Returns
    -------
    (lags + 1,) array
    """
    n = sum(len(x) for x, _ in pairs)
    return np.array([sum(float(x[k:] @ u[: len(u) - k]) for x, u in pairs if len(x) > k) / n for k in range(lags + 1)])


def probability(p: float) -> str:
    """"p = 3.2e-05"; below the smallest normal number of double precision, where the tail underflows, a bound.

    Parameters
    ----------
    p : float
        p-value.

    Returns
    -------
    str

    Examples
    --------
    >>> probability(3.21e-5), probability(0.0)
    ('p = 3.2e-05', 'p < 2.2e-308')
    """
    least = float(np.finfo(float).tiny)
    return f"p < {least:.1e}" if p < least else f"p = {p:.2g}"


def _whiteness(residuals: Sequence[np.ndarray], lags: int) -> ResidualTest:
    return whiteness(lagged_means([(e, e) for e in residuals], lags), sum(len(e) for e in residuals), lags)


def whiteness(r: np.ndarray, n: int, lags: int) -> ResidualTest:
    """Ljung and Box's test from the autocovariance over lags 0 … `lags` of n residuals.

    Parameters
    ----------
    r : (lags + 1,) array
        Autocovariance of the residual.
    n : int
        Residuals behind it.
    lags : int
        Degrees of freedom.

    Returns
    -------
    ResidualTest
        Passed where the residual is zero.
    """
    from scipy.special import chdtrc

    if not r[0] > 0:
        return ResidualTest("whiteness", 0.0, 1.0, True, "the residual is zero")
    rho = r[1:] / r[0]
    q = float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    p = float(chdtrc(lags, q))
    worst = int(np.argmax(np.abs(rho))) + 1
    description = (f"white at the {100 * LEVEL:.0f} % level" if p >= LEVEL else
            f"not white: correlation {rho[worst - 1]:+.2f} at lag {worst} ({probability(p)}); "
            "plain standard errors would be too small, and an output-error estimate may serve better")
    return ResidualTest("whiteness", q, p, p >= LEVEL, description)


def _independence(pairs: Sequence[tuple[np.ndarray, np.ndarray]], lags: int) -> ResidualTest:
    n = sum(len(e) for e, _ in pairs)
    reach = 4 * lags
    re = lagged_means([(e, e) for e, _ in pairs], reach)
    ru = lagged_means([(u, u) for _, u in pairs], reach + lags)
    return independence(lagged_means(pairs, lags - 1), re, ru, n)


def independence(cross: np.ndarray, re: np.ndarray, ru: np.ndarray, n: int) -> ResidualTest:
    """The test of independence from n samples' covariances.

    Parameters
    ----------
    cross : (lags,) array
        Of the residual with the signal 0 … lags − 1 samples before.
    re, ru : (4 lags + 1,) and (5 lags + 1,) arrays
        Autocovariances of residual and signal.
    n : int

    Returns
    -------
    ResidualTest
        Passed where the residual is zero.
    """
    from scipy.special import chdtrc

    lags, reach = cross.size, re.size - 1
    taper = 1 - np.arange(reach + 1) / (reach + 1)
    both = np.concatenate([(re * taper)[:0:-1], re * taper])
    shift = np.arange(-reach, reach + 1)
    difference = np.abs(np.subtract.outer(np.arange(lags), np.arange(lags)))
    covariance = np.array([np.sum(both * ru[np.abs(shift + d)]) for d in range(lags)])[difference]
    values, vectors = np.linalg.eigh(covariance)
    keep = values > max(RESOLVED * values.max(), 0.0)
    if not keep.any():
        return ResidualTest("independence", 0.0, 1.0, True, "the residual is zero")
    projected = vectors[:, keep].T @ cross
    statistic = float(n * np.sum(projected**2 / values[keep]))
    p = float(chdtrc(int(keep.sum()), statistic))
    description = (f"independent of present and past inputs at the {100 * LEVEL:.0f} % level" if p >= LEVEL else
            f"depends on present or past inputs ({probability(p)}): other input lags, a higher degree or a shaped "
            "input may help")
    return ResidualTest("independence", statistic, p, p >= LEVEL, description)


def residual_of(y: np.ndarray, output: np.ndarray) -> np.ndarray:
    """One-step residual; zero where it is no more than the rounding of an exact model.

    Parameters
    ----------
    y : (n,) array
        Measured output.
    output : (n,) array
        One-step prediction.

    Returns
    -------
    (n,) array
    """
    e = y - output
    return e if np.linalg.norm(e) > EXACT * np.linalg.norm(y) else np.zeros_like(e)
