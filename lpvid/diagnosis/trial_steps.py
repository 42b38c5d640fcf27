"""Trial steps of parameters without a useful derivative: lags of whole samples, lost motion, kinks."""

from __future__ import annotations

import numpy as np

from lpvid._tall import column_norms, least_squares_overwriting
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.effects.composition import Composition
from lpvid.rounding import HALF_DIGITS, STEP, VANISHING

SAMPLE_STEPS = (5.0, 1.0)
"""steps of a lag [samples], and of a rugged parameter in units of `SHARE`"""
SHARE = 0.02
"""of its value, the unit of the steps of a rugged parameter"""


def trial_parameters(composition: Composition) -> list[tuple[int, bool]]:
    """Places of the parameters that act in whole samples or are rugged, and whether they are rugged.

    Parameters
    ----------
    composition : Composition

    Returns
    -------
    list of (int, bool)
        Place in the parameter vector; True for one that is rugged.
    """
    found = []
    for e, place in zip(composition.effects, composition.places, strict=True):
        if e.rugged:
            found.append((place.start + [p.name for p in e.parameters].index(e.rugged), True))
        elif e.stepwise:
            found.append((place.start, False))
    return found


def step_by_trial(problem: DiagnosisProblem, composition: Composition, vector: np.ndarray, cost: float,
                  jacobian: np.ndarray) -> tuple[np.ndarray, float]:
    """Change each such parameter while that lowers the cost, with one Gauss-Newton step of the other parameters.

    With a current that is held between samples the error jumps where a delay passes a whole sample: the derivative
    between two jumps gives no information on the error beyond them. Lost motion and kinks make the error rugged.

    Parameters
    ----------
    problem : DiagnosisProblem
    composition : Composition
    vector : (P,) array
    cost : float
        Squared error at `vector`.
    jacobian : (N, P) array
        At a point nearby.

    Returns
    -------
    (P,) array, float
        Where it ended, and the cost there.
    """
    low, high = composition.bounds
    clock = problem.signals[0].sample_time
    for j, rugged in trial_parameters(composition):
        others = np.delete(np.arange(vector.size), j)
        norms = np.array([column_norms(jacobian[:, [k]])[0] for k in others])
        norms = np.where(norms > VANISHING, norms, 1.0)  # a parameter without effect is not changed
        unit = SHARE * vector[j] if rugged else clock
        for change in [sign * size * unit for size in SAMPLE_STEPS for sign in (1.0, -1.0)]:
            while True:  # until the cost falls no more, or the bound is reached
                trial = vector.copy()
                trial[j] = np.clip(trial[j] + change, low[j], high[j])
                if trial[j] == vector[j]:
                    break
                errors = problem.stacked_errors(composition, trial)
                scaled = np.empty((errors.size, others.size), order="F")
                for column, k in enumerate(others):
                    np.divide(jacobian[:, k], norms[column], out=scaled[:, column])
                step = least_squares_overwriting(scaled, errors, HALF_DIGITS) / norms
                del scaled  # before the next runs
                corrected = trial.copy()
                corrected[others] = np.clip(trial[others] + step, low[others], high[others])
                tried = [(float(errors @ errors), trial)]
                errors = problem.stacked_errors(composition, corrected)
                tried.append((float(errors @ errors), corrected))
                least, where = min(tried, key=lambda t: t[0])
                if not least < cost * (1 - STEP):
                    break
                vector, cost = where, least
    return vector, cost
