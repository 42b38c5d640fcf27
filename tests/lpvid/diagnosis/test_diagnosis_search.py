"""The order in which sets of causes are visited and refitted, on a toy."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.toy_diagnosis import Added, Bent, Cubic, Dry, Wave, record

from lpvid.diagnosis.evidence import candidates
from lpvid.diagnosis.evidence.engine import prepared, root_of
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from lpvid.diagnosis.evidence.visited import posterior
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.effects.composition import Composition
from lpvid.effects.effect import EffectParameter


class Linked(Dry):
    """Dry friction that is searched as a pair with another cause."""

    name = "linked"
    partners = ("cubic",)


def test_single_causes_are_visited_before_the_pairs_that_fit_the_same_error():
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u))
    lines: list[str] = []
    search, _ = prepared([run], Bent(), (Linked(), Cubic()), lines.append)
    search.run(root_of(search.problem, Bent()))
    assert {frozenset(), frozenset({"linked"}), frozenset({"linked", "cubic"})} <= set(search.visited)
    assert search.best.members == {"linked"}
    assert any("best so far: linked" in line and "sets" in line for line in lines)


def test_weights_are_averaged_over_the_samples_that_a_structured_error_counts_as():
    run = record(np.random.default_rng(7), level=0.02, hidden=lambda u: 0.08 * np.sin(1.7 * u) + 0.1 * np.sign(u))
    search, _ = prepared([run], Bent(), (Dry(), Cubic()), lambda text: None)
    search.run(root_of(search.problem, Bent()))
    given = {w.members: p for w, p in posterior(search)}
    by_hand = dict.fromkeys(given, 0.0)
    structured = search.effective.structured
    for worth in (12.5, 12.5 * 2**0.5, 25.0, 25.0 * 2**0.5, 50.0):
        kept = 1 / max(1 - structured + structured * search.problem.n_samples / worth, 1.0)
        odds = {m: np.exp(w.evidence(kept) - search.best.evidence(kept)) for m, w in search.visited.items()}
        for m, o in odds.items():
            by_hand[m] += o / sum(odds.values()) / 5
    assert given == pytest.approx(by_hand, abs=1e-12) and sum(given.values()) == pytest.approx(1.0)


def test_a_smaller_set_that_stopped_in_another_minimum_is_refitted_from_the_larger_one():
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u) + 0.1 * u**3)
    search, _ = prepared([run], Bent(), (Dry(), Cubic()), lambda text: None)
    search.run(root_of(search.problem, Bent()))
    right, both = search.visited[frozenset({"dry"})], search.visited[frozenset({"dry", "cubic"})]
    elsewhere = right.fit.vector.copy()
    elsewhere[-1] = -3.0
    stopped = refit(search.problem, right.fit.composition, elsewhere, iterations=0)
    assert stopped.cost > 2 * right.fit.cost
    search.visited[frozenset({"dry"})] = EvaluatedSet(search.data, stopped)
    search.exchanged.clear()
    search._exchange_members(both)
    assert search.visited[frozenset({"dry"})].fit.cost < 1.001 * right.fit.cost
    kept = search.visited[frozenset({"dry"})]
    search.exchanged.clear()
    search._exchange_members(both)  # no refit has a lower cost now
    assert search.visited[frozenset({"dry"})].fit.cost == pytest.approx(kept.fit.cost, rel=1e-6)


class Springy(Wave):
    name, title, stage = "springy", "what others may sit behind", "series"


class Behind(Dry):
    name, title, placement_of, behind = "behind", "the sign of the input, behind another", "dry", "series"


def test_without_what_it_sits_behind_an_effect_stands_in_its_other_place():
    """The set without the spring holds friction still: it is visited with the number that friction had."""
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u) + 0.3 * np.sin(9 * u) + 0.1 * u**3)
    search, _ = prepared([run], Bent(), effects := (Dry(), Springy(), Behind(), Cubic()), lambda text: None)
    search.visited[frozenset()] = EvaluatedSet(search.data, root_of(search.problem, Bent()))
    fit = refit(search.problem, composition := Composition(Bent(), effects[1:]), composition.neutral)
    search._exchange_members(EvaluatedSet(search.data, fit))
    assert frozenset({"dry", "cubic"}) in search.visited and frozenset({"behind", "cubic"}) not in search.visited
    found = search.visited[frozenset({"dry", "cubic"})].fit
    assert found.composition.by_effect(found.vector)["dry"] == pytest.approx(0.9, abs=0.2)  # the waves in part
    assert Dry().in_place_of(Behind(), np.array([0.7])) == [0.7]


@pytest.mark.parametrize("from_elsewhere", [True, False])
def test_a_set_whose_refit_is_improved_is_enlarged_again(from_elsewhere: bool):
    """Its children were refitted from the worse minimum. One that was at the minimum before is not enlarged again."""
    run = record(np.random.default_rng(5), level=0.05, hidden=lambda u: 0.8 * np.sign(u) + 0.2 * u**3)
    search, _ = prepared([run], Bent(), (Dry(), Cubic()), lambda text: None)
    search.run(root_of(search.problem, Bent()))
    dry, both = frozenset({"dry"}), frozenset({"dry", "cubic"})
    least, child = (search.visited[m].fit for m in (dry, both))
    least = refit(search.problem, least.composition, least.vector)

    def visited(fit: Refit, vector: np.ndarray) -> None:
        found = EvaluatedSet(search.data, refit(search.problem, fit.composition, vector, iterations=0))
        search.visited[found.members] = found

    visited(least, least.vector * (1.05 if from_elsewhere else 1.0))
    visited(child, child.vector * 1.05)
    search.enlarged.add(dry)
    search.exchanged.add(dry)
    search.add(EvaluatedSet(search.data, least))
    assert (dry in search.enlarged) is (dry in search.exchanged) is not from_elsewhere
    search.enlarge([search.visited[dry]])
    assert (search.visited[both].fit.cost < 1.01 * child.cost) is from_elsewhere


class Ringing(Added):
    """Waves of the input, of one number out of many: only the point next to it shows."""

    name, title = "ringing", "sine of a multiple of the input"
    parameters = (EffectParameter("size", "V", "a", 0.0, (-10.0, 10.0), (-10.0, 10.0), (0.5,)),
                  EffectParameter("waves", "", "b", 1.0, (0.0, 60.0), (0.0, 60.0), tuple(np.arange(5.0, 61.0, 5.0))))

    def compose(self, core, values, baseline):
        return lambda s: core(s) + values[0] * np.sin(values[1] * s["u"])


def test_beside_a_set_the_point_of_the_largest_predicted_gain_is_simulated_too():
    """Oracle: of 12 points 1, 5, 8 and 12 are evenly among them; the third has the number of waves that are there."""
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u) + 0.3 * np.sin(15 * u))
    search, _ = prepared([run], Bent(), (Dry(), Ringing()), lambda text: None)
    search.visited[frozenset()] = EvaluatedSet(search.data, root_of(search.problem, Bent()))
    search.baseline_screening = first = candidates.screen_beside_baseline(search)
    dry = next(e for e in search.candidates if e.name == "dry")
    beside = search.evaluated(refit(search.problem, Composition(Bent(), (dry,)), np.r_[Bent().vector, 0.5]))
    found = candidates.screen_beside_sets(search, first, [beside])[0]
    assert {d.values[1] for d in found} == {5.0, 15.0, 25.0, 40.0, 60.0}
    assert max(found, key=lambda d: d.gain).values[1] == 15.0
    assert [e.name for e in candidates.by_predicted_gain(search, first, beside, found)] == ["ringing"]


class Late(Ringing):
    """The same as a lag of the motion."""

    path = "motion"


def test_a_lag_is_simulated_beside_a_set_at_all_of_its_points():
    """Its best point depends on what else delays the force, so that none can be left out beforehand."""
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u) + 0.3 * np.sin(15 * u))
    search, _ = prepared([run], Bent(), (Dry(), Late()), lambda text: None)
    search.visited[frozenset()] = EvaluatedSet(search.data, root_of(search.problem, Bent()))
    search.baseline_screening = first = candidates.screen_beside_baseline(search)
    dry = next(e for e in search.candidates if e.name == "dry")
    beside = search.evaluated(refit(search.problem, Composition(Bent(), (dry,)), np.r_[Bent().vector, 0.5]))
    found = candidates.screen_beside_sets(search, first, [beside])[0]
    assert [d.values[1] for d in found] == list(np.arange(5.0, 61.0, 5.0))
