"""Noise of the inputs: whether a cause explains what was moved, or what the sensors of the motion added to it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit
from lpvid.diagnosis.signals import Signals, jumps
from lpvid.diagnosis.spectra import is_meant, weighed_alike, without_noise


def gain_without_input_noise(problem: DiagnosisProblem, fit: Refit, rest: Refit) -> float:
    """Share of a cause's whitened gain that is left when both simulations are driven by inputs without their noise.

    A baseline that is driven by a recorded velocity v + n simulates f(v) + f'(v) n. Whatever smooths the velocity, a
    lag or a filter, takes f'(v) n away and gains by it, whether or not anything lags. With e the whitened error of the
    set without the cause and d the change that the cause makes there, the gain is 2 dᵀe − dᵀd; d is simulated once more
    from inputs whose every frequency is weighed with the share of it that is motion.

    Parameters
    ----------
    problem : Problem
    fit, rest : Refit
        The set with the cause and without it.

    Returns
    -------
    float
        About 1 for a cause that acts on the motion, 0 or less for one that acts on the noise in its record.
    """
    if not rest.cost > fit.cost:
        return 1.0
    change = problem.stack([fit.composition.predict(s, fit.vector) - rest.composition.predict(s, rest.vector)
                            for s in without_input_noise(problem).signals])
    return float(2 * change @ rest.errors - change @ change) / (rest.cost - fit.cost)


def without_input_noise(problem: DiagnosisProblem) -> DiagnosisProblem:
    """The same, driven by inputs of which each frequency is weighed with the share of it that is motion."""
    return replace(problem, signals=tuple(s.cached("without noise", partial(_without, s)) for s in problem.signals))


def _without(s: Signals) -> Signals:
    """Signals without their sensors' noise, of which a filter is undone where it would be undone with it."""
    quiet = {c: x for c in s.channels if (x := _quiet(s, c)) is not s[c]}
    return weighed_alike(s.replace(**quiet), s)


def _quiet(s: Signals, channel: str) -> np.ndarray:
    """(n,) a channel without its sensor's noise, where that is a small part of one that does not jump.

    No spectrum keeps the edges of a jump apart from noise.
    """
    values = s[channel]
    if jumps(values):
        return values
    quiet = without_noise(s, channel)
    return values if is_meant(values - quiet, values) else quiet
