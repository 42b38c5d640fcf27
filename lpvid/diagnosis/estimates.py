"""Estimates: free-run errors of a fit and parameters with their standard errors, as plain data of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.diagnosis.diagnosis import Errors, Estimated
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect, EffectParameter
from lpvid.record import Record
from lpvid.rounding import TINY


def errors_of(problem: DiagnosisProblem, fit: Refit, left_out: np.ndarray, held_out: Sequence[Record]) -> Errors:
    """Free-run errors of a fit: on training samples, and on further records or, without them, out of fold.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        On the samples of `problem`.
    left_out : (N,) array
        Errors of the same composition out of fold, in the output's unit.
    held_out : sequence of Record
        Prepared; may be empty.

    Returns
    -------
    Errors
        Of an infinite ESR where the output of all further records is constant.
    """
    inside = [s.output[n >= 0] for s, n in zip(problem.signals, problem.blocks.number, strict=True)]
    about = (float(np.sum((y - y.mean()) ** 2)) for y in inside if y.size)  # each record about its own mean
    power = max(sum(about), TINY)
    training = float(fit.errors @ fit.errors) / power
    if not held_out:
        squares = float(left_out @ left_out)
        return Errors(training, squares / power, float(np.sqrt(squares / problem.n_samples)))
    error, total, count = free_run_squares(fit.composition, fit.vector, held_out)
    return Errors(training, error / total if total > 0 else np.inf, float(np.sqrt(error / max(count, 1))))


def free_run_squares(composition: Composition, vector: np.ndarray, records: Sequence[Record]
                     ) -> tuple[float, float, int]:
    """Sums of a free run's squared error and of the output's squared deviation from its mean, over records.

    Parameters
    ----------
    composition : Composition
        Its baseline reads the signals of the records.
    vector : (P,) array
    records : sequence of Record
        Prepared.

    Returns
    -------
    error, power : float
        In the output's unit squared.
    count : int
        Samples, without those that the run takes from the measurement.
    """
    baseline, error, power, count = composition.baseline, 0.0, 0.0, 0
    for record in records:
        s = baseline.signals(record)
        with np.errstate(all="ignore"):  # a run that diverges
            e = (s.output - composition.free_run(s, vector))[baseline.start:]
            y = s.output[baseline.start:]
            error, power, count = error + float(e @ e), power + float(np.sum((y - y.mean()) ** 2)), count + y.size
    return error, power, count


def esr_as_given(baseline: Baseline, records: Sequence[Record]) -> float | None:
    """Pooled free-run ESR of a baseline at its own parameters.

    Parameters
    ----------
    baseline : Baseline
    records : sequence of Record
        Prepared; may be empty.

    Returns
    -------
    float or None
        None without records, where the run diverges, and where the output is constant.
    """
    error, power, _ = free_run_squares(Composition(baseline), baseline.vector, records)
    return error / power if np.isfinite(error) and power > 0 else None


def estimates(effect: Effect, values: np.ndarray, deviation: np.ndarray | None) -> tuple[Estimated, ...]:
    """Parameters of an effect with their standard errors, None where they are not known.

    Parameters
    ----------
    effect : Effect
    values : (k,) array
        Its parameters.
    deviation : (k,) array or None
        Standard errors in the units of the parameters; NaN where one is not known, None where none is.

    Returns
    -------
    tuple of Estimated
    """
    found = []
    for k, p in enumerate(effect.parameters):
        std = None if deviation is None or not np.isfinite(deviation[k]) else float(deviation[k])
        value = float(values[k])
        choice = p.choice(value)
        found.append(Estimated(p.name, value, std, p.unit, choice, None if choice else _bound(p, value, std), p.held))
    return tuple(found)


def _bound(parameter: EffectParameter, value: float, std: float | None) -> str | None:
    """The end of its range at which a number without a standard error stands; None for one that is absent there."""
    if std is not None or value == parameter.neutral:
        return None
    low, high = parameter.bounds
    return "lower" if value == low else "upper" if value == high else None
