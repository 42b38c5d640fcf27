"""Members: the selected set, the effects in it, and which of these are named."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.diagnosis.evidence.calibration import Support
from lpvid.diagnosis.evidence.laplace import WeighedSets
from lpvid.diagnosis.evidence.rivals import NAMED_PROBABILITY, match_form
from lpvid.diagnosis.intervals import covariance
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit
from lpvid.effects.effect import Effect
from lpvid.rounding import TINY
from lpvid.validation.trust import LEVEL, QUANTILE

NAMED_CHANGE = 0.005
"""change of the output, as a share of its rms, below which a cause is no part of a set"""


@dataclass(frozen=True, eq=False)
class SetMember:
    """One effect of the selected set: its name, probability, rivals and contribution.

    Attributes
    ----------
    effect : Effect
    name : str
        Of the effect, or of its component where that is probable enough and the form is not.
    values : (k,) array
    probability, of_family : float
        Calibrated, of the name at any place, and of any effect of its family that is no other member.
    weight : float
        Of the sets that hold it.
    rivals : tuple of (str, float)
        Effects from which these data do not distinguish it, and their probabilities.
    cost : float
        Reduction of the squared error by it, the others refitted.
    gain : float
        Reduction of the squared error out of fold by it, over that without it [%].
    better : float
        Share of the blocks in which the error out of fold is lower with it.
    change : float
        Of the output when it is removed and the others are refitted, as a share of the output's rms.
    evidence : float or None
        Log-evidence with it less that without it; None where the set without it has none (a strength at its bound).
    """

    effect: Effect
    name: str
    values: np.ndarray
    probability: float
    of_family: float
    weight: float
    rivals: tuple[tuple[str, float], ...]
    cost: float
    gain: float
    better: float
    change: float
    evidence: float | None

    @property
    def family_stated(self) -> str:
        """Its family with the probability, where that is enough to be named; otherwise, and for a form, empty."""
        return f"a cause of the family {self.effect.family} ({self.of_family:.2f})" \
            if self.of_family >= NAMED_PROBABILITY and not self.effect.flexible else ""


@dataclass(frozen=True, eq=False)
class SelectedSet:
    """The set to report, with its members and its errors out of fold.

    Attributes
    ----------
    problem : DiagnosisProblem
    root, fit : Refit
        The baseline alone and the set.
    cost_reduction : float
        Of the squared error by the set against the baseline alone, on the samples of the search.
    before, after : (N,) arrays
        Their errors out of fold, in the output's unit.
    members : tuple of SetMember
        Largest change first.
    relative_error : float
        Error out of fold of the set, over the output: root mean squares.
    predictable : float
        Share of its squared error that the inputs predict.
    dropped : tuple of (str, str)
        Effects that did not lower the error out of fold, and the reason given.
    sets : sequence of (EvaluatedSet, float)
        Visited sets and their weights, without those that were not confirmed.
    least_error_set : (tuple of str, float), optional
        Where the selected set is empty: the causes of the visited set of least error, and the error out of fold with
        them, over the output, if that is lower by more than a good law's misfit: the error is no noise then.
    """

    problem: DiagnosisProblem
    root: Refit
    fit: Refit
    cost_reduction: float
    before: np.ndarray
    after: np.ndarray
    members: tuple[SetMember, ...]
    relative_error: float
    predictable: float
    dropped: tuple[tuple[str, str], ...]
    sets: WeighedSets
    least_error_set: tuple[tuple[str, ...], float] | None = None

    @property
    def law_error(self) -> float:
        """The part of the error that the inputs predict, over the output: root mean squares."""
        return float(np.sqrt(self.predictable)) * self.relative_error

    @property
    def gains(self) -> np.ndarray:
        """(blocks,) reduction of the squared error out of fold by the set."""
        return self.problem.block_sums(self.before**2 - self.after**2)

    def reason_not_named(self, m: SetMember) -> str | None:
        """Why a member is not named; None where it is, or has rivals.

        Parameters
        ----------
        m : SetMember

        Returns
        -------
        str or None
        """
        if m.rivals:
            return None
        if m.probability < NAMED_PROBABILITY:
            family = f", but {m.family_stated} is" if m.family_stated else ""
            return f"probability {m.probability:.2f} only, and no alternative is probable enough{family}"
        return self._unresolved(m)

    def _unresolved(self, m: SetMember) -> str | None:
        """The reason where the 95 % interval of a component's only strength includes none of it (Wald 1943).

        As that of a delay of less than half a sample, which may stand for anything as quick. A clock's error is
        even over a sample: 95 % of it lie within .95 √3 standard errors (`Effect.clock_errors`). A strength at its
        bound has no interval.
        """
        e, fit = m.effect, self.fit
        at = fit.composition.places[fit.composition.effects.index(e)].start
        clock = e.clock_errors(m.values, self.problem.signals)[0]
        error = QUANTILE * np.sqrt(abs(covariance(self.problem, fit)[at, at] - clock**2)) + LEVEL * np.sqrt(3) * clock
        if e.strengths > 1 or e.flexible or not abs(fit.vector[at] - e.parameters[0].neutral) < error:
            return None
        return f"{e.parameters[0].neutral:g} is inside the 95 % interval of its {e.parameters[0].name}"


def named_once(members: list[SetMember], sets: WeighedSets) -> list[SetMember]:
    """Members whose names differ: a component's name is that of its own effect, or else of the form that changes most.

    Parameters
    ----------
    members : list of SetMember
        Largest change first.
    sets : sequence of (EvaluatedSet, float)

    Returns
    -------
    list of SetMember
        The other forms under their own names, with the support of these.
    """
    taken, found = {m.effect.name for m in members}, []
    for m in members:
        if m.name != m.effect.name and m.name in taken:
            form = Support.of(sets, match_form(m.effect))
            m = replace(m, name=m.effect.name, probability=form.probability, weight=form.weight)
        found, taken = [*found, m], {*taken, m.name}
    return found


def named_alike(other: SelectedSet, found: SelectedSet) -> SelectedSet:
    """A set with the names of the most probable one: names come from the weights, places from the set to report.

    Parameters
    ----------
    other, found : SelectedSet
        The set to report and the most probable one.

    Returns
    -------
    SelectedSet
    """
    names = {m.effect.component: m.name for m in found.members if not m.effect.flexible}
    members = [m if m.effect.flexible else replace(m, name=names.get(m.effect.component, m.name))
               for m in other.members]
    return replace(other, members=tuple(named_once(members, other.sets)))


def _named(selected: SelectedSet) -> dict[str, float]:
    """Components named without rivals in a set, in whatever place, and the reduction of the logarithm of the error by
    each. A flexible form in a component's place is not that component."""
    error = max(selected.root.cost - selected.cost_reduction, TINY)
    named = [m for m in selected.members if selected.reason_not_named(m) is None and not m.rivals]
    keys = [m.name if m.effect.flexible or m.name != m.effect.name else m.effect.component for m in named]
    return {key: float(np.log1p(max(m.cost, 0.0) / error)) for key, m in zip(keys, named, strict=True)}


def keeps_names(other: SelectedSet, found: SelectedSet) -> bool:
    """Whether each component named in the most probable set is named in another too, with half of its reduction.

    Parameters
    ----------
    other, found : SelectedSet
        The other one and the most probable one.

    Returns
    -------
    bool
    """
    here, wanted = _named(other), _named(found)
    return all(2 * here.get(n, 0.0) >= reduction for n, reduction in wanted.items())
