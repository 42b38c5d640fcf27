"""Which of the structures that cross-validation cannot tell apart is taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.identification.sandwich import residual_memory
from lpvid.identification.selection.free_run import Trial, run_errors, spread
from lpvid.record import Record
from lpvid.simulation import Model, simulate

TOLERATED = 0.02
"""share of the least ESR that one standard error may not exceed when a simpler structure is preferred: 1 % of what the
fit lacks to 100 %, so that simplicity never costs the half point within which a choice should be of the best."""


@dataclass(frozen=True, eq=False)
class Tried:
    """A structure as the choice sees it.

    Attributes
    ----------
    trial : Trial
        Cross-validation.
    n_parameters : int or None
    estimate : callable
        Its model of all records; may raise what an estimate raises.
    """

    trial: Trial
    n_parameters: int | None
    estimate: Callable[[], Model]


def close_to_least(trials: Sequence[Trial]) -> list[int]:
    """Places of the trials whose error is within one standard error of the least, which comes first.

    The standard error is that of the difference from the least, fold by fold, and at most `TOLERATED` of the least:
    blocks of unequal difficulty would otherwise excuse anything.
    """
    least = trials[0]
    return [i for i, t in enumerate(trials)
            if t.mean - least.mean <= min(spread(t.esr - least.esr), TOLERATED * least.mean)]


def simplest_supported(tried: Sequence[Tried], records: Sequence[Record]) -> int:
    """Place of the choice: the simplest within one standard error of the least that all data do not speak against.

    Five folds see a difference only from about their standard error on, and each fits to four fifths of the data. What
    they leave open is asked of all training data::

        N ln(E_simple / E_least) <= 2 (k_least − k_simple),        N = n / Σ_j ρ_j²

    the comparison of two AIC (Akaike 1974, IEEE TAC 19, 716) with E the squared error of the free run and k the number
    of parameters. A residual with autocorrelation ρ_j tells its variance as well as N independent samples do (Bartlett
    1946; Priestley 1981, 5.3), so that a coloured one does not count every sample. A redundant term is left out, and a
    term whose gain is small and sure is kept: by one standard error alone (Breiman et al. 1984, 3.4) the gyroscope's
    third order was taken for its fourth, at a fifth of a point of fit on later data.

    Parameters
    ----------
    tried : sequence of Tried
        Least error in cross-validation first.
    records : sequence of Record

    Returns
    -------
    int
    """
    sizes = [np.inf if t.n_parameters is None else t.n_parameters for t in tried]
    near = close_to_least([t.trial for t in tried])
    simpler = sorted((i for i in near if sizes[i] < sizes[0]), key=lambda i: (sizes[i], tried[i].trial.mean))
    if not simpler:
        return 0
    found = _errors(tried[0], records)
    if found is None:
        return simpler[0]
    least, model = found
    count = independent_samples(model, records)
    for i in simpler:
        other = _errors(tried[i], records)
        if other is not None and count * np.log(other[0] / least) <= 2 * (sizes[0] - sizes[i]):
            return i
    return 0


def _errors(tried: Tried, records: Sequence[Record]) -> tuple[float, Model] | None:
    """Squared error of the free run of all records, and the model; None where there is no run."""
    try:
        model = tried.estimate()
    except (InputError, NumericalError, np.linalg.LinAlgError):
        return None
    diverged, error, _ = run_errors(model, records)
    return None if diverged or not error > 0 else (error, model)


def independent_samples(model: Model, records: Sequence[Record]) -> float:
    """n / Σ_j ρ_j² of the free run's residual, all outputs and records together.

    The sum ends where the autocorrelation is within its own noise (`residual_memory`).
    """
    total = 0.0
    for k, output in enumerate(model.outputs):
        residuals = [r[output.name][model.start:] - simulate(model, r, "estimate").output[model.start:, k]
                     for r in records if r.n_samples > model.start + 2]
        memory = residual_memory(residuals)
        power = sum(float(e @ e) for e in residuals)
        lagged = [sum(float(e[j:] @ e[: e.size - j]) for e in residuals if e.size > j) for j in range(1, memory + 1)]
        total += sum(e.size for e in residuals) / (1 + 2 * float(np.sum(np.square(np.array(lagged) / power))))
    return total
