"""Intervals: the covariance of the parameters of a fitted set, with the resolution of the clock for lags."""

from __future__ import annotations

import numpy as np

from lpvid.diagnosis import refitting
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit


def covariance(problem: DiagnosisProblem, fit: Refit) -> np.ndarray:
    """(P, P) covariance of a refit to all blocks; NaN for parameters at a bound, but for the strength of a lag.

    Two independent parts: the sandwich covariance of the fit (`refitting.covariance`), and the variance of a lag whose
    signals are unknown between their samples (`Effect.clock_errors`). A lag that acts in whole samples has no
    useful derivative: the variance of its strength is the second part alone.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit

    Returns
    -------
    (P, P) array
        In the units of the parameters, squared.
    """
    found = fit.cached("covariance", lambda: refitting.covariance(problem, fit)).copy()
    for effect, place in zip(fit.composition.effects, fit.composition.places, strict=True):
        if effect.stepwise:
            found[place.start, :] = found[:, place.start] = 0.0
        at = np.arange(place.start, place.stop)
        found[at, at] += effect.clock_errors(fit.vector[place], problem.signals) ** 2
    return found
