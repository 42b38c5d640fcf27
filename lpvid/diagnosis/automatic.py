"""Automatic: the choice of a baseline, where none is named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid._threads import single_thread
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.named import factories
from lpvid.diagnosis.budgets import LISTED
from lpvid.diagnosis.evidence.effective_samples import effective_samples
from lpvid.diagnosis.folds import out_of_fold
from lpvid.diagnosis.problem import problem_of
from lpvid.diagnosis.refitting import refit
from lpvid.effects.composition import Composition
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.rounding import TINY
from lpvid.validation.figures import gain_percent


@dataclass(frozen=True, eq=False)
class Law:
    """A fitted law and its mean squared error out of fold, in the output's unit squared.

    Attributes
    ----------
    baseline : Baseline
        Fitted.
    error : float
        Over all samples in blocks.
    """

    baseline: Baseline
    error: float


def automatic(records: Sequence[Record], report_progress: Callable[[str], None] = lambda text: None
              ) -> tuple[Baseline, str]:
    """The installed law without memory that describes records best for its number of parameters, and a note on it.

    The least κN ln(error out of fold) + P ln κN is chosen, with P parameters and κN independent samples in the error of
    the best law: of two laws with the same error it is the one with fewer parameters. Laws with memory are left out,
    because their memory is among the causes, by name.

    Parameters
    ----------
    records : sequence of Record
        Prepared: uniform, of one rate.
    report_progress : callable, optional
        Receives a line of text for each law that is fitted.

    Returns
    -------
    baseline : Baseline
        Fitted to the records.
    note : str
        The law chosen, how many suit these records, and the free-run ESR out of fold of the first `LISTED` of them.

    Raises
    ------
    InputError
        No law suits these records.
    """
    found, why = [], []
    with single_thread():
        for name, factory in factories().items():
            try:
                baseline = factory(records, None)
                if not baseline.static or baseline.adaptive:
                    continue
                report_progress(f"trying {name}")
                found.append(_law(baseline.fit(records), records))
            except InputError as error:
                why.append(f"{name}: {error.what}")
    if not found:
        raise InputError("no installed law suits these records", why="; ".join(why[:3]) or "none is installed",
                         mend="name a baseline")
    problem, best = problem_of(records, found[0].baseline), min(found, key=lambda law: law.error)
    composition = Composition(best.baseline)
    kappa = effective_samples(problem, problem.errors(composition, best.baseline.vector)).kappa
    count = kappa * problem.n_samples

    ranked = sorted(found, key=lambda law: count * np.log(max(law.error, TINY)) + law.baseline.vector.size * np.log(
        max(count, 2.0)))
    described = ", ".join(f"{x.baseline.name} {x.error / max(problem.spread**2, TINY):.3g}" for x in ranked[:LISTED])
    chosen = ranked[0].baseline
    return chosen, (f"the law diagnosed is {chosen.name}, of {len(found)} that suit these records: free-run ESR out of "
                    f"fold {described}{_fewer(ranked[0], best, count)}")


def _fewer(chosen: Law, best: Law, count: float) -> str:
    """Why the law of least error is not the one chosen; empty where it is."""
    if chosen is best:
        return ""
    more = best.baseline.vector.size - chosen.baseline.vector.size
    return (f". {best.baseline.name} has {gain_percent(chosen.error, best.error):.2g} % less error with {more} "
            f"parameter{'s' * (more != 1)} more: too little, with about {count:.0f} independent samples in the error")


def _law(baseline: Baseline, records: Sequence[Record]) -> Law:
    problem = problem_of(records, baseline)
    fit = refit(problem, Composition(baseline), baseline.vector, iterations=0)  # its errors as fitted, no second fit
    return Law(baseline, float(np.mean(out_of_fold(problem, fit) ** 2)))
