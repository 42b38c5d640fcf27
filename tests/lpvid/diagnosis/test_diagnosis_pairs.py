"""Physically linked pairs of causes: taken in where they explain something, not for leading a fit out of a valley."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.toy_diagnosis import Added, problem_of, record

from lpvid.diagnosis.refitting import refit
from lpvid.diagnosis.screening import Direction, Evidence, directions, moves, screen
from lpvid.diagnosis.selection import ForwardSelection

STUCK = np.array([2.6, 2.2, 9.0])
"""parameters of the toy from which its steep tanh is out of a step's sight"""


class Soft(Added):
    name, title = "soft", "half of a linked pair"
    partners = ("steep",)
    shape = staticmethod(lambda s: np.tanh(1.2 * s["u"]))


class Steep(Added):
    name, title = "steep", "the other half"
    partners = ("soft",)
    shape = staticmethod(lambda s: np.tanh(2 * s["u"]))


class Sine(Added):
    name, title = "sine", "half of a linked pair"
    partners = ("cosine",)
    shape = staticmethod(lambda s: np.sin(9 * s["u"]))


class Cosine(Added):
    name, title = "cosine", "the other half"
    partners = ("sine",)
    shape = staticmethod(lambda s: np.cos(7 * s["u"]))


def stuck_search(rng: np.random.Generator, pair: tuple[Added, Added],
                 hidden: Callable[[np.ndarray], np.ndarray] | None = None
                 ) -> tuple[ForwardSelection, list[Evidence], list[Direction], float]:
    """A search whose baseline stopped on its way, what screens there, and the cost at which it should have stopped."""
    problem, composition = problem_of(record(rng, hidden=hidden))
    search = ForwardSelection(problem, refit(problem, composition, STUCK, iterations=0), pair, rng, lambda text: None)
    found = directions(problem, search.fit, moves(problem, search.fit, pair))
    return search, screen(problem, search.fit, found, rng), found, refit(problem, composition, composition.neutral).cost


def test_a_way_out_of_a_valley_is_nothing_that_a_pair_explains(rng: np.random.Generator) -> None:
    search, evidence, found, least = stuck_search(rng, (Soft(), Steep()))
    assert all(e.p_value < 0.01 for e in evidence) and search.fit.cost > 4 * least
    assert search.best_pair(evidence, found) is None
    assert search.fit.cost == pytest.approx(least, rel=1e-3), "the baseline keeps what it was led to"


def test_what_a_pair_led_to_is_screened_anew(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    search, evidence, found, _ = stuck_search(rng, (Soft(), Steep()))
    monkeypatch.setattr(search, "best_addition", lambda evidence, found: None)
    evidence, _ = search.grow(evidence, found)
    assert not search.fit.composition.effects
    assert min(e.p_value for e in evidence) > 0.01


def test_a_pair_that_explains_something_is_taken(rng: np.random.Generator) -> None:
    search, evidence, found, least = stuck_search(rng, (Sine(), Cosine()),
                                                  lambda u: 0.6 * np.sin(9 * u) + 0.6 * np.cos(7 * u))
    best = search.best_pair(evidence, found)
    assert best is not None and {e.name for e in best[0]} == {"sine", "cosine"}
    assert best[1].cost < 0.5 * least
