"""Calibration: from the weight of a cause among the visited sets to the probability that it is present."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.effects.effect import Effect
from lpvid.rounding import TINY

COEFFICIENTS = (-1.64, 1.01, 1.67)
"""a, b and c of the map, by logistic regression (Platt 1999) on cases of both rigs and measured records, each source
counted alike. `tests/benchmarks/diagnosis_calibration.py OUT --table` computes them anew; docs/diagnosis_boards.md has
their validation"""
Matcher = Callable[[EvaluatedSet], Effect | None]
"""From a set to its effect that matches; None where none does."""


@dataclass(frozen=True)
class Support:
    """Support of the visited sets for a component, a form or a family.

    Attributes
    ----------
    weight, against : float
        Of the sets with a match and of those without.
    structured : float
        Share of the error of the best set beyond the noise floor. Where all is noise every sample counts, so that an
        error of the law below the noise level has the weight of a cause.
    """

    weight: float
    against: float
    structured: float

    @classmethod
    def of(cls, sets: Sequence[tuple[EvaluatedSet, float]], match: Matcher, structured: float) -> Support:
        """From all visited sets.

        Parameters
        ----------
        sets : sequence of (EvaluatedSet, float)
            With their weights, which add up to one.
        match : Matcher
        structured : float
            Share of the error of the best set beyond the noise floor.

        Returns
        -------
        Support
        """
        held = [match(w) is not None for w, _ in sets]
        weight, against = (float(sum(p for (_, p), holds in zip(sets, held, strict=True) if holds is wanted))
                           for wanted in (True, False))
        return cls(weight, against, structured)

    @property
    def features(self) -> tuple[float, ...]:
        """1, ±ln(1 + |l|) of the logarithm l of the odds, and the structured share."""
        odds = float(np.log(max(self.weight, TINY)) - np.log(max(self.against, TINY)))
        return 1.0, float(np.sign(odds) * np.log1p(abs(odds))), self.structured

    @property
    def probability(self) -> float:
        """Calibrated probability that it is present, by its `features` f and the `COEFFICIENTS` β: ln p/(1 − p) = β·f.

        Examples
        --------
        >>> faint, strong = Support(0.5, 0.5, 0.9), Support(0.99, 0.01, 0.9)
        >>> 0 < faint.probability < 0.5 < strong.probability < Support(0.9999, 1e-4, 0.9).probability < 1
        True
        >>> Support(0.99, 0.01, 0.1).probability < strong.probability
        True
        """
        if not self.weight > 0:
            return 0.0
        return float(1 / (1 + np.exp(-np.dot(COEFFICIENTS, self.features))))


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


def match_family(name: str) -> Matcher:
    """Matches any effect of a family.

    Parameters
    ----------
    name : str
        Of the family.

    Returns
    -------
    Matcher
    """
    return lambda w: next((e for e in w.effects if e.family == name), None)


def component_support(sets: Sequence[tuple[EvaluatedSet, float]], structured: float) -> dict[str, Support]:
    """Support for every component that some set holds, in any form; the most probable first.

    Parameters
    ----------
    sets : sequence of (EvaluatedSet, float)
        All visited, with weights that add up to one.
    structured : float
        Share of the error of the best set beyond the noise floor.

    Returns
    -------
    dict of str to Support
    """
    found = {k: Support.of(sets, match_component(k), structured) for k in {k for w, _ in sets for k in w.components}}
    return dict(sorted(found.items(), key=lambda t: (-t[1].probability, t[0])))
