"""Calibration: from the weights of the sets that hold a cause to the probability that it is there."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lpvid.diagnosis.evidence.weighing import Weighed

OFFSET, OF_WEIGHT, OF_ERROR = -0.96, 1.37, 1.24
"""Coefficients of the map, by logistic regression on blind cases."""
MOST = 2.0
"""logarithm of an error's reduction beyond which more proves no more: to a seventh of its square"""
LEAST = 1e-12
"""weights are read to within this of 0 and 1"""


def support(sets: Sequence[tuple[Weighed, float]], holds: Callable[[Weighed], bool]) -> tuple[float, float]:
    """What speaks for something that some sets hold: their weight w, and ln(E₋/E₊).

    E₊ is the squared error of the foremost of them, E₋ that of the best of the others: what nothing else in the
    catalogue takes away.

    Parameters
    ----------
    sets : sequence of (Weighed, float)
        All visited, with weights that add up to one.
    holds : callable
        Whether a set holds it.
    """
    inside = [(w.fit.cost, p) for w, p in sets if holds(w)]
    outside = [w.fit.cost for w, _ in sets if not holds(w)]
    if not inside:
        return 0.0, 0.0
    foremost = max(inside, key=lambda t: t[1])[0]
    reduction = float(np.log(max(min(outside), 1e-300) / max(foremost, 1e-300))) if outside else MOST
    return float(sum(p for _, p in inside)), reduction


def probability_that(sets: Sequence[tuple[Weighed, float]], holds: Callable[[Weighed], bool]) -> float:
    """Probability that the records hold something that some sets hold."""
    return calibrated(*support(sets, holds))


def calibrated(weight: float, reduction: float) -> float:
    """ln p/(1 − p) = a + b asinh(ln(w/(1 − w))/2) + c ln(E₋/E₊), the last logarithm between 0 and `MOST`.

    Parameters
    ----------
    weight : float
        Of the sets that hold something, 0 to 1.
    reduction : float
        Natural logarithm of the ratio of the squared errors without it and with it.

    Examples
    --------
    >>> calibrated(0.5, 0.0) < 0.5 < calibrated(0.99, 1.0) < calibrated(0.9999, 3.0) < 1
    True
    """
    w = min(max(weight, LEAST), 1 - LEAST)
    z = OFFSET + OF_WEIGHT * np.arcsinh(np.log(w / (1 - w)) / 2) + OF_ERROR * np.clip(reduction, 0.0, MOST)
    return float(1 / (1 + np.exp(-z)))


def components(sets: Sequence[tuple[Weighed, float]]) -> dict[str, tuple[float, float, float]]:
    """Probability, weight and reduction of every component that some set holds, in whatever form; most probable first.
    """
    held = {k: support(sets, lambda w, k=k: k in w.kinds) for k in {k for w, _ in sets for k in w.kinds}}
    found = {k: (calibrated(*s), *s) for k, s in held.items()}
    return dict(sorted(found.items(), key=lambda t: (-t[1][0], t[0])))
