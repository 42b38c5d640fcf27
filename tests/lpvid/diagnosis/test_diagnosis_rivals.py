"""Which of two sets the error is nearer to."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.toy_diagnosis import Added, Bent, Cubic, Dry, record

from lpvid.diagnosis.evidence.engine import prepared, root_of
from lpvid.diagnosis.evidence.rivals import LISTED, nearer, settled, swapped
from lpvid.diagnosis.evidence.search import SetSearch


class Steep(Added):
    name, title = "steep", "sign of the input, not quite as sharp"
    shape = staticmethod(lambda s: np.tanh(30 * s["u"]))


def searched(share: float, misfit: float, seed: int = 3) -> SetSearch:
    """A search where the truth is a share of `Dry`, the rest `Steep`, beside a misfit of the law."""
    def hidden(u: np.ndarray) -> np.ndarray:
        between = share * np.sign(u) + (1 - share) * np.tanh(30 * u)
        return 1.5 * between + misfit * np.sin(9 * u) * np.sign(np.roll(u, 30))

    run = record(np.random.default_rng(seed), level=0.05, hidden=hidden)
    search, _ = prepared([run], Bent(), (Dry(), Steep(), Cubic()), lambda text: None)
    search.run(root_of(search.problem, Bent()))
    return search


@pytest.fixture(scope="module")
def dry() -> SetSearch:
    return searched(1.0, 0.4)


def test_what_is_nearer_to_one_is_as_much_farther_from_the_other(dry: SetSearch) -> None:
    one, other = (dry.visited[frozenset({n})] for n in ("dry", "steep"))
    assert nearer(one, other) == pytest.approx(-nearer(other, one), rel=1e-9)
    assert nearer(one, one) == 0.0


def test_a_misfit_elsewhere_does_not_hide_a_small_difference(dry: SetSearch) -> None:
    """By the squared errors alone the two are rivals, the misfit being ten times what they differ by."""
    one, other = (dry.visited[frozenset({n})] for n in ("dry", "steep"))
    worth = 0.5 * dry.kept * dry.problem.n_samples
    assert worth * np.log(other.fit.cost / one.fit.cost) < -np.log(LISTED) < nearer(one, other)


def test_between_the_two_neither_is_nearer() -> None:
    """A law half way between follows neither, however small its standard error is."""
    search = searched(0.5, 0.4)
    one, other = (search.visited[frozenset({n})] for n in ("dry", "steep"))
    assert abs(nearer(one, other)) < -np.log(LISTED)


def test_weights_are_shared_anew_within_swaps_alone(dry: SetSearch) -> None:
    """Sets that differ in one effect of either; their sum and all other weights stay."""
    sets = list(dry.visited.values())
    names = [w.members for w in sets]
    lone = {k: names.index(frozenset({k})) for k in ("dry", "steep")}
    weights = np.zeros(len(sets))
    weights[lone["dry"]], weights[lone["steep"]], weights[names.index(frozenset())] = 0.3, 0.5, 0.2
    found = settled(sets, weights)
    assert swapped(sets[lone["dry"]], sets[lone["steep"]])
    assert not swapped(sets[lone["dry"]], sets[names.index(frozenset())])
    assert found[lone["dry"]] > 0.75 and found[names.index(frozenset())] == 0.2
    assert found.sum() == pytest.approx(1.0)
    weights[lone["dry"]] = 0.5 * LISTED * weights[lone["steep"]]
    assert np.array_equal(settled(sets, weights), weights)  # too light to be a rival
