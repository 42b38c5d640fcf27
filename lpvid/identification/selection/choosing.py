"""Which of the structures that cross-validation cannot distinguish is taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.identification.covariance import residual_memory
from lpvid.identification.selection.free_run import RANGE_POINTS, Trial, spread, unstable_share_of_range
from lpvid.record import Record
from lpvid.simulation import Model, simulate

TOLERATED = 0.02
"""share of the least ESR that one standard error may not exceed when a simpler structure is preferred: 1 % of what the
fit lacks to 100 %, so that simplicity never costs the half point within which a choice should be of the best."""


@dataclass(frozen=True, eq=False)
class Tried:
    """A structure with what the choice compares.

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

    Parameters
    ----------
    trials : sequence of Trial
        Least error first.

    Returns
    -------
    list of int
    """
    least = trials[0]
    return [i for i, t in enumerate(trials)
            if t.mean - least.mean <= min(spread(t.esr - least.esr), TOLERATED * least.mean)]


def least_unstable(shares: Sequence[float | None]) -> list[int]:
    """Places of the shares that the points of the range cannot distinguish from the least.

    A share s counted on n points has the binomial standard error √(s(1 − s)/n), and one point of n is the least
    difference there is: a share up to the larger of the two above the least is as good as the least.

    Parameters
    ----------
    shares : sequence of float or None
        Parts of the range with unstable poles, from about n = `RANGE_POINTS` points each. One that is not known (None)
        is not compared: its place stays, and the least is that of the others.

    Returns
    -------
    list of int
    """
    least = min((s for s in shares if s is not None), default=0.0)
    error = max(np.sqrt(least * (1 - least) / RANGE_POINTS), 1 / RANGE_POINTS)
    return [i for i, s in enumerate(shares) if s is None or s <= least + error]


def simplest_supported(tried: Sequence[Tried], records: Sequence[Record]) -> int:
    """Place of the choice: the simplest within one standard error of the least that AIC on all data admits.

    Of those within one standard error, the ones that compete are those whose frozen poles are unstable in the smallest
    part of the range as far as its points resolve it (`unstable_share_of_range`, `least_unstable`). Along the training
    trajectory all of them are stable, but it is a line in that range: later data combine its values otherwise, and what
    a model does there no error on the training data measures. Where that part is not known (quasi-LPV), a structure
    competes and throws no other out.

    Five folds see a difference only from about their standard error on, and each fits to four fifths of the data. What
    they leave open is decided on all training data::

        N ln(E_simple / E_least) <= 2 (k_least − k_simple),        N = n / Σ_j ρ_j²

    the comparison of two AIC (Akaike 1974, IEEE TAC 19, 716) with E the squared error of the free run and k the number
    of parameters. A residual with autocorrelation ρ_j determines its variance as well as N independent samples do
    (Bartlett 1946; Priestley 1981, 5.3), so that a coloured one does not count every sample. A redundant term is
    left out, and a term whose gain is small and sure is kept: by one standard error alone (Breiman et al. 1984,
    3.4) the gyroscope's third order was taken for its fourth, at a fifth of a point of fit on later data.

    The bound of `TOLERATED` keeps simplicity from costing fit. It is not needed for a structure that has fewer
    parameters and the lower error on all training data too (`_dominant`).

    Parameters
    ----------
    tried : sequence of Tried
        Least error in cross-validation first.
    records : sequence of Record

    Returns
    -------
    int
    """
    return _dominant(tried, _simplest_near(tried, records), records)


def _dominant(tried: Sequence[Tried], choice: int, records: Sequence[Record]) -> int:
    """Place of what has fewer parameters than the choice and fits all training data better, or of the choice.

    Its error may be above the least by one standard error of their difference, fold by fold. More parameters always
    lower the error on the data they are fitted to, within one family; where fewer do, they are of the better family,
    and what the folds hold against it is below their own noise. On a third of a measured damper's record (666 samples)
    an ARX of 91 parameters had the least error of the folds; quasi-LPV of 58 had 1.14 times it, and 0.65 times on all
    training data: 91.4 % against 80.3 % on later data. Of several the one of the least AIC is taken.
    """
    size, least = tried[choice].n_parameters, tried[0].trial
    if size is None:
        return choice
    fewer = [i for i, t in enumerate(tried) if t.n_parameters is not None and t.n_parameters < size
             and t.trial.mean - least.mean <= spread(t.trial.esr - least.esr)]
    best = _model(tried[choice]) if fewer else None
    if best is None:
        return choice
    models = [(choice, best), *((i, m) for i in fewer if (m := _model(tried[i])) is not None)]
    models = [models[k] for k in least_unstable([unstable_share_of_range(m) for _, m in models])]
    count = independent_samples(best, records)
    criteria = {choice: 0.0}
    for i, model in models:
        gain = _log_ratio(model, best, records)
        if gain < 0:
            criteria[i] = count * gain + 2 * ((tried[i].n_parameters or 0) - size)
    return min(criteria, key=criteria.__getitem__)


def _simplest_near(tried: Sequence[Tried], records: Sequence[Record]) -> int:
    """Place of the simplest of the structures that the folds cannot distinguish, of those that all data support."""
    near = close_to_least([t.trial for t in tried])
    if len(near) < 2:
        return 0
    models = {i: _model(tried[i]) for i in near}
    estimated = [(i, m) for i in near if (m := models[i]) is not None]
    if estimated:
        near = [estimated[k][0] for k in least_unstable([unstable_share_of_range(m) for _, m in estimated])]
    sizes = {i: np.inf if (k := tried[i].n_parameters) is None else k for i in near}
    least = near[0]
    simpler = sorted((i for i in near if sizes[i] < sizes[least]), key=lambda i: (sizes[i], tried[i].trial.mean))
    best = models[least]
    if not simpler or best is None:
        return simpler[0] if simpler else least
    count = independent_samples(best, records)
    for i in simpler:
        other = models[i]
        if other is not None and count * _log_ratio(other, best, records) <= 2 * (sizes[least] - sizes[i]):
            return i
    return least


def _model(tried: Tried) -> Model | None:
    try:
        return tried.estimate()
    except (InputError, NumericalError, np.linalg.LinAlgError):
        return None


def _log_ratio(simple: Model, best: Model, records: Sequence[Record]) -> float:
    """ln(E_simple/E_best) over the samples that both run along, the mean over outputs; inf where a run diverges."""
    start = max(simple.start, best.start)
    ratios = []
    for k in range(best.n_outputs):
        e, e_best = (sum(float(r @ r) for r in _residuals(m, records, k, start)) for m in (simple, best))
        ratios.append(np.log(e / e_best) if np.isfinite(e) and e_best > 0 else np.inf)
    return float(np.mean(ratios))


def _residuals(model: Model, records: Sequence[Record], output: int, start: int) -> list[np.ndarray]:
    """Of one output's free run, from a sample on."""
    name = model.outputs[output].name
    return [r[name][start:] - simulate(model, r, "estimate").output[start:, output]
            for r in records if r.n_samples > start + 2]


def independent_samples(model: Model, records: Sequence[Record]) -> float:
    """n / Σ_j ρ_j² of the free run's residual, all outputs and records together.

    The sum ends where the autocorrelation is within its own noise (`residual_memory`).

    Parameters
    ----------
    model : Model
    records : sequence of Record

    Returns
    -------
    float
    """
    total = 0.0
    for k in range(model.n_outputs):
        residuals = _residuals(model, records, k, model.start)
        memory = residual_memory(residuals)
        power = sum(float(e @ e) for e in residuals)
        lagged = [sum(float(e[j:] @ e[: e.size - j]) for e in residuals if e.size > j) for j in range(1, memory + 1)]
        total += sum(e.size for e in residuals) / (1 + 2 * float(np.sum(np.square(np.array(lagged) / power))))
    return total
