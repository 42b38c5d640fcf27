"""Priors of inclusion, strength, shape and misfit, at the scale of the data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.effects.effect import Effect, EffectParameter
from lpvid.rounding import TINY

COMPONENT_PROBABILITY, FORM_PROBABILITY = 0.05, 0.005
"""prior probability of a component, and of a flexible form: of forty entries about two are expected"""
STRENGTH_SCALE = 0.3
"""change of the output by a cause, as a share of the output's rms: half of all causes lie below (half-Cauchy scale)"""
SHAPE_FACTOR = 10.0
"""factor from the middle of its grid that is one standard deviation of a positive shape; and the standard deviation of
a baseline's parameters in their own scales, the same in all sets"""
MISFIT_MEDIAN, MISFIT_LOG_DEVIATION = 0.086, 0.47
"""structured error of the best law, as a share of the output's rms: median, and standard deviation of the logarithm,
of fits by hand to fifteen groups of measured records (tests/benchmarks/real_answers.py)"""


def misfit_prior(relative_error: float) -> float:
    """Log-density of the structured error of a set, less that of the median error.

    −½ (ln(r/`MISFIT_MEDIAN`)/`MISFIT_LOG_DEVIATION`)² above the median, zero below.

    Parameters
    ----------
    relative_error : float
        r: its root mean square over that of the output.

    Returns
    -------
    float
        Zero or less.

    Examples
    --------
    >>> [round(misfit_prior(r), 2) + 0.0 for r in (0.01, 0.086, 0.2, 0.5)]
    [0.0, 0.0, -1.61, -7.01]
    """
    excess = max(float(np.log(max(relative_error, TINY) / MISFIT_MEDIAN)), 0.0)
    return -0.5 * (excess / MISFIT_LOG_DEVIATION) ** 2 + 0.0


def inclusion_prior(effect: Effect) -> float:
    """ln π/(1 − π) with the prior probability π: `FORM_PROBABILITY` of a flexible effect, else `COMPONENT_PROBABILITY`.

    Of an effect that the samples show before any fit (`Effect.visible`) it is one less `COMPONENT_PROBABILITY`: as
    probable as another is improbable. Of one that most real devices have (`Effect.common`) it is ½.

    Parameters
    ----------
    effect : Effect

    Returns
    -------
    float
    """
    share = FORM_PROBABILITY if effect.flexible else 0.5 if effect.common else COMPONENT_PROBABILITY
    found = float(np.log(share / (1 - share)))
    return -found if effect.visible else found


def strength_prior(change: float, slope: float) -> tuple[float, float]:
    """Log-density of a strength, and its curvature, for one that changes the output by `change` of its rms.

    Half-Cauchy in that change r, transformed to the strength a by dr/da = `slope`: a strength has no scale of its own.

    Parameters
    ----------
    change : float
        r: root mean square of the change over that of the output, at least zero.
    slope : float
        dr/da [1/unit of the strength].

    Returns
    -------
    log_density : float
        Of the strength a in its own unit.
    curvature : float
        (slope/`STRENGTH_SCALE`)² [1/unit of the strength²].

    Examples
    --------
    >>> [round(strength_prior(r, 1.0)[0], 2) for r in (0.01, 0.3, 3.0)]
    [0.75, 0.06, -3.86]
    """
    slope = max(slope, TINY)
    value = np.log(2 / (np.pi * STRENGTH_SCALE)) - np.log1p((change / STRENGTH_SCALE) ** 2) + np.log(slope)
    return float(value), (slope / STRENGTH_SCALE) ** 2


def shape_prior(p: EffectParameter, value: float, grid: Sequence[float]) -> tuple[float, float]:
    """Prior of a shape: log-normal about its grid, or normal about neutral.

    Where the grid holds zero too (no deflection of a friction), values below the middle cost nothing: a deflection has
    the same prior in each entry of the catalogue. A share, which has no unit, has no decades.

    The prior volume is not counted, only `determined_count`: how many shapes a filter has, and over how many decades
    they may lie, must not decide between rivals that fit equally well.

    Parameters
    ----------
    p : EffectParameter
    value : float
    grid : sequence of float
        The grid at the scale of the data.

    Returns
    -------
    deviation, curvature : float
        Distance of `value` from the middle of the prior in standard deviations, and curvature there.
    """
    if p.choices or p.held:
        return 0.0, 0.0
    positive, zero_allowed = [g for g in grid if g > 0], 0.0 in grid
    if positive and p.bounds[0] >= 0 and (p.unit if zero_allowed else value > 0):
        width = np.log(SHAPE_FACTOR)
        value = max(value, min(positive)) if zero_allowed else value
        deviation = float((np.log(value) - float(np.mean(np.log(positive)))) / width)
        return max(deviation, 0.0) if zero_allowed else deviation, (1 / (width * value)) ** 2
    width = max(max((abs(g - p.neutral) for g in grid), default=0.0), *(
        abs(b - p.neutral) for b in p.plausible)) if not positive or p.bounds[0] < 0 else max(positive)
    width = width or 1.0
    return (value - p.neutral) / width, 1 / width**2


def deviation_penalty(deviation: np.ndarray, precision: np.ndarray, curvature: np.ndarray) -> float:
    """Loss of log-density by shapes away from the middle of their prior, as far as the data determine them.

    −½ Σ a² h/(h + Λ): of a Gaussian likelihood of curvature h about the estimate times a Gaussian prior of precision Λ,
    a standard deviations away. A shape without effect on the output (h = 0) costs nothing, whatever its fitted value.

    Parameters
    ----------
    deviation : (P,) array
        a.
    precision, curvature : (P,) arrays
        Λ and h.

    Returns
    -------
    float
        Zero or less.

    Examples
    --------
    >>> one = np.ones(1)
    >>> [deviation_penalty(2 * one, one, h * one) for h in (0.0, 1.0, 1e9)]
    [0.0, -1.0, -1.999999998]
    """
    return -0.5 * float(np.sum(deviation**2 * curvature / np.maximum(curvature + precision, TINY))) + 0.0


def determined_count(curvature: np.ndarray, precision: np.ndarray) -> float:
    """Σ h/(h + Λ), the number of parameters that the data determine and their priors do not (MacKay 1992,
    Neural Computation 4, 415).

    A choice among few values has no precision and counts as one.

    Parameters
    ----------
    curvature, precision : (P,) arrays
        h and Λ.

    Returns
    -------
    float

    Examples
    --------
    >>> determined_count(np.array([0.0, 1.0, 1e9]), np.ones(3))
    1.499999999
    """
    shares = curvature / np.maximum(curvature + precision, TINY)
    return float(np.sum(np.where(precision > 0, shares, 1.0)))
