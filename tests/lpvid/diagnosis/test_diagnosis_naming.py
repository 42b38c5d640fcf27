"""The name under which a member of a set is reported, and the rivals that are listed with it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lpvid.diagnosis.evidence import rivals, weighed_sets
from lpvid.diagnosis.evidence.calibration import match_component
from lpvid.diagnosis.evidence.outcome import alternatives
from lpvid.diagnosis.evidence.rivals import NAMED_PROBABILITY, reported_name
from lpvid.effects.effect import Effect
from quartercar.effects import CATALOGUE
from quartercar.effects.electrical import CoilLag, RiseFallLag


def test_a_component_is_named_where_only_its_form_is_unsure():
    """Sets that hold unequal edges of a lag fit little better than those with a plain one, and both far better than
    none: the lag is named, and unequal edges only where they alone fit."""
    lag, edges = CoilLag(), RiseFallLag()

    def weighed(effects: tuple[Effect, ...], cost: float) -> SimpleNamespace:
        return SimpleNamespace(effects=effects, components=("coil-lag",) * len(effects), fit=SimpleNamespace(cost=cost))

    def named(weights: tuple[float, float, float], costs: tuple[float, float, float]) -> tuple[str, float]:
        sets = [(weighed(e, c), w) for e, c, w in zip(((edges,), (lag,), ()), costs, weights, strict=True)]
        name, finding, support = reported_name(edges, "coil-lag", sets)
        assert (finding(weighed((lag,), 1.0)) is None) is (name == "rise-fall-lag")
        return name, support.probability

    name, p = named((0.6, 0.3999, 0.0001), (1.0, 1.02, 9.0))
    assert name == "coil-lag" and p >= NAMED_PROBABILITY
    name, p = named((0.9998, 0.0001, 0.0001), (1.0, 6.0, 9.0))
    assert name == "rise-fall-lag" and p >= NAMED_PROBABILITY
    name, p = named((0.4, 0.1, 0.5), (1.0, 1.02, 1.05))
    assert name == "rise-fall-lag" and p < NAMED_PROBABILITY


def visited(**changes: float) -> SimpleNamespace:
    """A set of effects by name and by what each changes; a name before "__" is the component."""
    effects = [SimpleNamespace(name=n, component=n, contains=("spring",) if n == "loop" else (),
                               family="electrical" if "lag" in n else n) for n in changes]
    components = ["friction" if n == "loop" else n.partition("__")[0] for n in changes]
    return SimpleNamespace(effects=effects, components=components, changes=list(changes.values()),
                           members=frozenset(changes))


@pytest.mark.parametrize(("other", "of_spring", "of_friction"), [
    (visited(power=0.7, mount=0.09), ["power"], ["power"]),  # what changes most
    (visited(friction__breakaway=0.6, mount=0.09), ["mount"], []),  # friction is there, in another form
    (visited(loop=0.6), ["loop"], []),  # contains friction
])
def test_alternatives_of_a_member_contain_it_or_change_most(other, of_spring, of_friction):
    best = visited(friction=0.6, spring=0.1)
    sets = [(best, 0.6), (other, 0.4)]
    for effect, wanted in zip(best.effects, (of_friction, of_spring), strict=True):
        found = rivals._alternatives(sets, best, effect, match_component(effect.name))
        assert [n for n, _ in found] == wanted


@pytest.mark.parametrize(("weights", "wanted"), [
    ((0.69, 0.05, 0.05, 0.21), ["late-lag", "slow-lag"]),  # none of them is worth a line by itself
    ((0.73, 0.05, 0.001, 0.219), ["late-lag"]),  # one has next to nothing of what is left
    ((0.55, 0.04, 0.04, 0.37), []),  # nor is the family sure
])
def test_a_family_that_is_sure_is_listed_by_its_members(weights, wanted):
    parts = ({"coil-lag": 0.3}, {"late-lag": 0.3}, {"slow-lag": 0.3}, {})
    sets = [(visited(**held), p) for held, p in zip(parts, weights, strict=True)]
    best = sets[0][0]
    found = rivals._alternatives(sets, best, best.effects[0], match_component("coil-lag"))
    assert sorted(n for n, _ in found) == wanted


def test_what_a_form_describes_is_listed_beside_its_alternatives(monkeypatch):
    """A dead zone of the force or air: play is the same as the first."""
    monkeypatch.setattr(rivals, "name_in", lambda *a: ("dead-zone", None, SimpleNamespace(probability=0.5)))
    monkeypatch.setattr(rivals, "_described_components", lambda *a: (("play", 0.1),))
    for others, wanted in (((("air", 0.3),), ["air", "play"]), ((), [])):
        monkeypatch.setattr(rivals, "_alternatives", lambda *a, others=others: others)
        found = rivals.rivals_beside(None, [], None, part("dead-zone"), np.zeros(0))
        assert [n for n, _ in found] == wanted


def test_an_effect_whose_numbers_leave_a_simpler_one_is_named_that():
    """Air without pressure is play; in less likely sets its pressure is a little more than none."""
    air = SimpleNamespace(name="air", component="air", form_of="spring")
    sets = [(SimpleNamespace(effects=[air], components=[kind]), p) for kind, p in (("play", 0.9), ("spring", 0.1))]
    name, _, support = rivals.reported_name(air, "play", sets)
    assert name == "play" and support.weight == pytest.approx(1.0)


@pytest.mark.parametrize(("cost", "value", "name"), [
    (1.1, 0.2, "loss"),  # the simpler effect leaves as much
    (2.0, 0.2, "orifice"),  # it does not
    (2.0, 0.0, "loss"),  # at its bound it is the simpler effect
    (None, 0.2, "loss"),  # nothing is known of that
])
def test_an_effect_keeps_its_name_where_the_simpler_one_leaves_notably_more(cost, value, name):
    """An orifice that opens at low speed is a quadratic loss, if the law gives up some of its viscous share."""
    orifice = SimpleNamespace(name="orifice", component="orifice", form_of="", flexible=False)

    def held(cost: float) -> SimpleNamespace:
        fit = SimpleNamespace(cost=cost, vector=np.array([3.0, value]), composition=SimpleNamespace(
            places=[slice(0, 2)], bounds=(np.zeros(2), np.array([9.0, 9.0]))))
        return SimpleNamespace(effects=(orifice,), components=("loss",), fit=fit, members=frozenset({"orifice"}))

    w = held(1.0)
    search = SimpleNamespace(kappa=0.1, problem=SimpleNamespace(n_samples=300),
                             visited={} if cost is None else {frozenset({"loss"}): held(cost)})
    found, _, support = rivals.name_in(search, [(w, 1.0)], w, orifice)
    assert found == name and support.weight == pytest.approx(1.0)


def of_cost(cost: float, *effects: SimpleNamespace, bounds: bool = False) -> SimpleNamespace:
    """A visited set of given cost."""
    fit = SimpleNamespace(cost=cost, vector=np.zeros(0), composition=SimpleNamespace(places=[slice(0)] * len(effects)))
    data = SimpleNamespace(problem=SimpleNamespace(signals=()))
    return SimpleNamespace(effects=effects, components=tuple(e.name for e in effects), fit=fit, data=data,
                           members=frozenset(e.name for e in effects), at_bounds={"a": "1"} if bounds else {})


def part(name: str, family: str = "else", **more: object) -> SimpleNamespace:
    """The attributes of an effect that rivals read."""
    return SimpleNamespace(**{"name": name, "component": name, "family": family, "path": "", "flexible": False,
                              "contains": (), "stands_for": lambda values, signals: (), **more})


PLAY, SPRING, RELATED = part("play"), part("spring"), part("related", "loose")


@pytest.mark.parametrize(("other", "wanted"), [
    (of_cost(1.2, RELATED), ["related"]),
    (of_cost(1.3, RELATED), []),  # by 25 samples: 1.3^-12.5 is less than one in twenty
    (of_cost(1.2, PLAY), []),  # of another family
    (of_cost(0.99, RELATED, SPRING), []),  # two are no other name for one
    (of_cost(1.2, RELATED, bounds=True), []),
    (of_cost(0.9, part("form", flexible=True)), []),
    (of_cost(1.2, part("form", "loose", flexible=True)), ["form"]),
    (of_cost(0.9, part("form", "loose", flexible=True, stands_for=lambda v, s: ("dead-zone",))), []),  # it contains it
    (of_cost(0.9, part("other", "loose", stands_for=lambda v, s: ("dead-zone",))), ["other"]),  # a component
    (of_cost(0.9, part("other", "loose", contains=("dead-zone",))), []),
])
def test_effects_that_can_replace_one_at_nearly_the_same_error_are_listed(other, wanted):
    assert _rivals_beside(of_cost(1.0, part("dead-zone", "loose")), other) == wanted


def _rivals_beside(best: SimpleNamespace, *others: SimpleNamespace) -> list[str]:
    """Names listed with the only member of the best set."""
    search = SimpleNamespace(kappa=0.01, problem=SimpleNamespace(n_samples=2500))
    found = rivals._equally_likely(search, [(best, 0.9), *((w, 0.1) for w in others)], best, best.effects[0])
    return [n for n, _ in found]


FILTER, OTHER = part("chain", "lags", path="all"), part("other", "lags")


@pytest.mark.parametrize(("others", "wanted"), [
    ((of_cost(1.05, FILTER),), ["chain"]),  # alone in the place of a lag
    ((of_cost(1.5), of_cost(1.2, OTHER)), ["other"]),
    ((of_cost(1.05, part("lag", "lags")),), []),  # itself, with numbers that leave another component
])
def test_a_rival_is_another_component_in_the_place_of_one(others, wanted, monkeypatch):
    monkeypatch.setattr(rivals, "_cost_without_sensor_noise", lambda *sets: rivals._cost)  # clean sensors
    best = of_cost(1.0, part("lag", "lags"))
    for w in others:
        if "lag" in w.members:
            w.components = ("play",)
    assert _rivals_beside(best, *others) == wanted


def test_what_adds_nothing_out_of_fold_leaves_its_weight_to_the_set_without_it(monkeypatch):
    """Two sets with "dry" hold most weight. That a wave adds nothing to one of them says nothing against "dry"."""
    dry, spring, wave = part("dry"), SPRING, part("wave")
    sets = [of_cost(1.0, dry, wave), of_cost(1.2, spring), of_cost(1.1, dry), of_cost(2.0)]
    monkeypatch.setattr(weighed_sets, "posterior", lambda search: list(zip(sets, (0.4, 0.35, 0.2, 0.05), strict=True)))
    search = SimpleNamespace(visited={w.members: w for w in sets}, root=sets[3])
    smaller = {frozenset({"dry", "wave"}): frozenset({"dry"})}
    found = [(set(w.members), p) for w, p in weighed_sets.confirmed_sets(search, (), smaller)]
    assert found[0] == ({"dry"}, pytest.approx(0.6)) and found[1] == ({"spring"}, pytest.approx(0.35))
    smaller = {frozenset({"dry", "wave"}): frozenset({"wave"})}  # never visited, nor is any cause within it
    assert weighed_sets.confirmed_sets(search, (), smaller)[0] == (sets[1], pytest.approx(0.35 / 0.6))


def test_weight_goes_to_the_most_probable_set_within_what_is_left_wherever_its_components_sit(monkeypatch):
    """A wave and a kink alone explain nothing; friction behind the spring that was dropped is friction without it."""
    behind, dry, wave, kink = part("behind", component="dry"), part("dry"), part("wave"), part("kink")
    sets = [of_cost(1.0, behind, SPRING, wave, kink), of_cost(1.1, behind, SPRING), of_cost(1.2, dry), of_cost(2.0),
            of_cost(1.9, wave, kink)]
    monkeypatch.setattr(weighed_sets, "posterior",
                        lambda search: list(zip(sets, (0.5, 0.3, 0.15, 0.05, 0.0), strict=True)))
    search = SimpleNamespace(visited={w.members: w for w in sets}, root=sets[3])
    smaller = {sets[0].members: frozenset({"behind", "wave", "kink"})}
    assert weighed_sets.confirmed_sets(search, (), smaller)[:2] == [(sets[2], pytest.approx(0.65)), (sets[1], 0.3)]
    loop = of_cost(1.05, part("loop", component="dry", flexible=True))  # holds a spring too
    monkeypatch.setattr(weighed_sets, "posterior", lambda search: [
        (sets[1], 0.5), (loop, 0.3), (sets[2], 0.2), (sets[3], 0.0)])
    search = SimpleNamespace(visited={w.members: w for w in (sets[1], loop, *sets[2:])}, root=sets[3])
    found = weighed_sets.confirmed_sets(search, (), {sets[1].members: frozenset({"behind"})})
    assert found[0] == (sets[2], pytest.approx(0.7))


def test_that_a_set_fails_out_of_fold_is_no_evidence_for_the_baseline_alone(monkeypatch):
    """Play with a spring seems as probable as friction and fails: friction against nothing is left."""
    dry, spring, play = part("dry"), SPRING, part("play")
    sets = [of_cost(1.0, play, spring), of_cost(1.1, dry), of_cost(2.0)]
    monkeypatch.setattr(weighed_sets, "posterior", lambda search: list(zip(sets, (0.5, 0.45, 0.05), strict=True)))
    search = SimpleNamespace(visited={w.members: w for w in sets}, root=sets[2])
    found = weighed_sets.confirmed_sets(search, (), {frozenset({"play", "spring"}): frozenset()})
    assert found == [(sets[1], pytest.approx(0.9)), (sets[2], pytest.approx(0.1))]
    failed = {w.members: frozenset() for w in sets[:2]}
    assert weighed_sets.confirmed_sets(search, (), failed) == [(sets[2], 1.0)]


def test_rejected_sets_leave_their_weight_to_smaller_ones_and_at_last_the_baseline(monkeypatch):
    dry, wave = part("dry"), part("wave")
    sets = [of_cost(1.0, dry, wave), of_cost(1.1, dry), of_cost(2.0)]
    monkeypatch.setattr(weighed_sets, "posterior", lambda search: list(zip(sets, (0.9, 0.06, 0.04), strict=True)))
    search = SimpleNamespace(visited={w.members: w for w in sets}, root=sets[2])
    assert weighed_sets.confirmed_sets(search, {sets[0].members}, {})[0] == (sets[1], pytest.approx(0.96))
    rejected = {w.members for w in sets}
    assert weighed_sets.confirmed_sets(search, rejected, {}) == [(sets[2], 1.0)]


def test_sets_that_held_out_data_rejected_take_no_name():
    best, other = of_cost(1.0, part("dead-zone", "loose")), of_cost(1.05, RELATED)
    search = SimpleNamespace(kappa=0.01, problem=SimpleNamespace(n_samples=2500),
                             visited={w.members: w for w in (best, other)})
    assert not rivals._equally_likely(search, [(best, 1.0)], best, best.effects[0])


def test_rivals_that_share_an_experiment_state_it_once() -> None:
    known = {e.name: e.experiment for e in CATALOGUE}
    for names in (("gas-preload", "force-offset"), ("force-offset", "gas-preload")):
        stated = alternatives([known[n] for n in names])
        assert stated.count("creep at several positions and temperatures") == 1
        assert "gas depends on both" in stated and "unloaded before and after" in stated
    assert alternatives(["one", "two", "one"]) == "one; or two"
