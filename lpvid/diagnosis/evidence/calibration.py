"""Calibration: from the weight of a cause among the visited sets to the probability that it is present."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.evidence.laplace import EvaluatedSet, WeighedSets
from lpvid.effects.effect import Effect
from lpvid.rounding import TINY

SLOPE, LIMIT = 1.64, 0.954
"""b and c of the map p = c/(1 + exp(∓ b ln(1 + |l|))) from the logarithm l of the odds by weight, ∓ against its sign:
logistic regression (Platt 1999) with a limit, on cases of both rigs and measured records, each source counted alike.
One cause in twenty is absent whatever its weight: what is there is not among the sets, or a law errs as the cause does.
`tests/benchmarks/diagnosis_calibration.py tests/benchmarks/claims --table` computes both anew; docs/diagnosis_boards.md
has their validation"""
Matcher = Callable[[EvaluatedSet], Effect | None]
"""From a set to its effect that matches; None where none does."""


@dataclass(frozen=True)
class Support:
    """Support of the visited sets for a component, a form or a family.

    Attributes
    ----------
    weight, against : float
        Of the sets with a match and of those without.
    """

    weight: float
    against: float

    @classmethod
    def of(cls, sets: WeighedSets, match: Matcher) -> Support:
        """From all visited sets.

        Parameters
        ----------
        sets : sequence of (EvaluatedSet, float)
            With their weights, which add up to one.
        match : Matcher

        Returns
        -------
        Support
        """
        held = [match(w) is not None for w, _ in sets]
        weight, against = (float(sum(p for (_, p), holds in zip(sets, held, strict=True) if holds is wanted))
                           for wanted in (True, False))
        return cls(weight, against)

    @property
    def compressed(self) -> float:
        """± ln(1 + |l|) of the logarithm l of the odds, ± its sign: of weights near one more are wrong than these
        state."""
        odds = float(np.log(max(self.weight, TINY)) - np.log(max(self.against, TINY)))
        return float(np.sign(odds) * np.log1p(abs(odds)))

    @property
    def probability(self) -> float:
        """Calibrated probability that it is present, `LIMIT`/(1 + exp(−`SLOPE` · `compressed`)).

        Examples
        --------
        >>> Support(0.5, 0.5).probability == LIMIT / 2
        True
        >>> 0.85 < Support(0.95, 0.05).probability < 0.94 < Support(1 - 1e-9, 1e-9).probability < LIMIT
        True
        """
        return float(LIMIT / (1 + np.exp(-SLOPE * self.compressed))) if self.weight > 0 else 0.0


def match_component(component: str) -> Matcher:
    """Matches a component, in any form.

    Parameters
    ----------
    component : str
        Its name.

    Returns
    -------
    Matcher
    """
    return lambda w: next((e for e, k in zip(w.effects, w.components, strict=True) if k == component), None)


def match_family(name: str, without: Collection[str] = ()) -> Matcher:
    """Matches any effect of a family.

    Parameters
    ----------
    name : str
        Of the family.
    without : collection of str
        Components that are left out.

    Returns
    -------
    Matcher
    """
    return lambda w: next((e for e, k in zip(w.effects, w.components, strict=True)
                           if e.family == name and k not in without), None)


def component_support(sets: WeighedSets) -> dict[str, Support]:
    """Support for every component that some set holds, in any form; the most probable first.

    Parameters
    ----------
    sets : sequence of (EvaluatedSet, float)
        All visited, with weights that add up to one.

    Returns
    -------
    dict of str to Support
    """
    found = {k: Support.of(sets, match_component(k)) for k in {k for w, _ in sets for k in w.components}}
    return dict(sorted(found.items(), key=lambda t: (-t[1].probability, t[0])))
