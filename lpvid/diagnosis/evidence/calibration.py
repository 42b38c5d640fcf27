"""Calibration: from what a search knows of a cause to the probability that it is there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.evidence.search import LAGGING
from lpvid.diagnosis.evidence.weighing import Weighed

COEFFICIENTS = (-1.11, 1.41, 0.41, -1.22)
"""a, b, c, d of the map, by logistic regression (Platt 1999) on blind cases of both rigs, those with even numbers;
docs/diagnosis.md shows those with odd ones. `tests/benchmarks/diagnosis_calibration.py OUT --table` computes them"""
FARTHEST = 3.0
"""logarithm of a change over what is left beyond which more proves no more: a factor of twenty either way"""
CLIP = 1e-12
"""weights are read to within this of 0 and 1"""
Finding = Callable[[Weighed], Effect | None]
"""The effect of a set by which it holds something; None where it does not."""


@dataclass(frozen=True)
class Support:
    """What speaks for something that some sets hold.

    Attributes
    ----------
    weight : float
        Of these sets among all.
    relative : float
        What it changes in the output, over the error that is left: root mean squares, of the foremost of these sets.
    lagging : bool
        Whether it is a lag, a delay or a filter on the way of motion or force: these imitate every dynamic cause.
    """

    weight: float
    relative: float
    lagging: bool

    @classmethod
    def of(cls, sets: Sequence[tuple[Weighed, float]], finding: Finding) -> Support:
        """From all visited sets with their weights, which add up to one."""
        inside = [(p, w, e) for w, p in sets if (e := finding(w)) is not None]
        if not inside:
            return cls(0.0, 0.0, False)
        _, foremost, effect = max(inside, key=lambda t: t[0])
        left = np.sqrt(foremost.fit.cost / foremost.data.problem.n_samples) / foremost.data.discrepancy.force
        change = foremost.changes[foremost.effects.index(effect)]
        return cls(float(sum(t[0] for t in inside)), change / max(float(left), 1e-12), effect.path in LAGGING)

    @property
    def features(self) -> tuple[float, float, float, float]:
        """1, asinh(ln(w/(1 − w))/2), ln of the relative change within ±`FARTHEST`, and 1 for what is lagging."""
        w = min(max(self.weight, CLIP), 1 - CLIP)
        size = np.log(max(self.relative, CLIP))
        return (1.0, float(np.arcsinh(np.log(w / (1 - w)) / 2)), float(np.clip(size, -FARTHEST, FARTHEST)),
                float(self.lagging))

    @property
    def probability(self) -> float:
        """That it is there: ln p/(1 − p) = a + b asinh(ln(w/(1 − w))/2) + c ln(change/left) + d [lagging].

        Examples
        --------
        >>> faint, strong = Support(0.5, 1.0, False), Support(0.99, 5.0, False)
        >>> 0 < faint.probability < 0.5 < strong.probability < Support(0.9999, 10.0, False).probability < 1
        True
        >>> Support(0.99, 5.0, True).probability < strong.probability
        True
        """
        if not self.weight > 0:
            return 0.0
        return float(1 / (1 + np.exp(-np.dot(COEFFICIENTS, self.features))))


def component(kind: str) -> Finding:
    """Finds a component, in whatever form."""
    return lambda w: next((e for e, k in zip(w.effects, w.kinds, strict=True) if k == kind), None)


def family(name: str) -> Finding:
    """Finds any effect of a family."""
    return lambda w: next((e for e in w.effects if e.family == name), None)


def components(sets: Sequence[tuple[Weighed, float]]) -> dict[str, Support]:
    """What speaks for every component that some set holds, in whatever form; the most probable first."""
    found = {k: Support.of(sets, component(k)) for k in {k for w, _ in sets for k in w.kinds}}
    return dict(sorted(found.items(), key=lambda t: (-t[1].probability, t[0])))
