"""Which set is reported, what of it is named, and the verdict, on a toy."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_diagnosis import Bent, Cubic, Dry, Wave, record

from lpvid.baselines.baseline import Coefficient
from lpvid.diagnosis.budgets import MOST_MEMBERS
from lpvid.diagnosis.diagnosis import Estimated
from lpvid.diagnosis.evidence import engine, members, outcome, selection, weighed_sets
from lpvid.diagnosis.evidence.calibration import match_family
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.evidence.members import SelectedSet, SetMember
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.settings import DiagnosisSettings
from lpvid.record import Channel, Record
from lpvid.report.diagnosis import _cause_row


@pytest.mark.parametrize(("of_family", "flexible", "stated"), [
    (0.8, False, True), (0.7, False, False), (0.8, True, False)])
def test_a_cause_that_is_not_probable_enough_states_its_family_where_that_is(of_family, flexible, stated):
    effect = SimpleNamespace(name="air", family="elastic", flexible=flexible)
    air = SetMember(effect, "air", np.zeros(1), 0.4, of_family, 0.4, (), 1.0, 10.0, 1.0, 0.05, 5.0)
    selected = SelectedSet(*[None] * 3, 1.0, *[np.zeros(1)] * 2, (air,), 0.05, 0.0, (), [])  # type: ignore[arg-type]
    reason = selected.reason_not_named(air)
    assert reason is not None and reason.startswith("probability 0.40 only")
    assert ("but a cause of the family elastic (0.80) is" in reason) is stated


@pytest.mark.parametrize(("on_all", "named", "verdict"), [
    (0.04, True, "explained"), (0.2, True, "partly-explained"), (0.04, False, "nothing-to-explain"),
    (0.2, False, "unexplained")])
def test_an_error_where_no_sample_of_the_search_lies_is_not_explained(on_all, named, verdict):
    """An end stop that none of the stretches of a search reaches: 3.5 % there, 20 % on all samples."""
    found = SimpleNamespace(name="dry", probability=0.9)
    case = SimpleNamespace(
        search=SimpleNamespace(relative_rms=lambda e: on_all, data=SimpleNamespace(discrepancy=SimpleNamespace(
            output_rms=1.0))), selected=SimpleNamespace(law_error=0.01, after=None, relative_error=0.035,
                                                        least_error_set=None))
    level = SimpleNamespace(repeating=(0.0, 0.0), variance=None)
    answer, reason = outcome.EvidenceOutcome._verdict(case, [found] if named else [], [], [], level, [])
    assert answer == verdict
    assert ("20.0% on all samples and 3.5% on those of the search" in reason) is (on_all > 0.1)


def test_another_member_is_no_evidence_for_a_family():
    spring, stop, air = (SimpleNamespace(name=n, family="elastic") for n in ("spring", "stop", "air"))
    both, either, none = (SimpleNamespace(effects=e, components=[x.name for x in e])
                          for e in ([spring, stop], [air], [spring]))
    of_stop = match_family("elastic", {"spring"})
    assert [of_stop(w) for w in (both, either, none)] == [stop, air, None]


@pytest.mark.parametrize(("value", "error", "clock", "strengths", "flexible", "named"), [
    (0.4, 0.2, 0.0, 1, False, True),  # two standard errors from none
    (0.38, 0.2, 0.0, 1, False, False),
    (0.51, 0.0, 1 / np.sqrt(12), 1, False, True),  # half a sample, which is all that the clock leaves open
    (0.47, 0.0, 1 / np.sqrt(12), 1, False, False),
    (0.38, 0.2, 0.0, 2, False, True),  # the other strength may be there
    (0.38, 0.2, 0.0, 1, True, True),  # a form has no size of its own
    (0.4, np.nan, 0.0, 1, False, True),  # at its bound: not known
    (0.4, 0.0, 0.0, 1, False, True),  # a choice
])
def test_a_strength_whose_interval_includes_none_of_it_is_not_named(value, error, clock, strengths, flexible, named,
                                                                    monkeypatch):
    monkeypatch.setattr(members, "covariance", lambda problem, fit: np.diag([1.0, error**2 + clock**2, 1e-6]))
    effect = SimpleNamespace(name="delay", strengths=strengths, flexible=flexible,
                             clock_errors=lambda values, signals: np.array([clock, 0.0]),
                             parameters=[SimpleNamespace(name="delay", neutral=0.0)])
    fit = SimpleNamespace(vector=np.array([5.0, value, 1.0]),
                          composition=SimpleNamespace(effects=(effect,), places=[slice(1, 3)]))
    delay = SetMember(effect, "delay", np.array([value, 1.0]), 0.9, 0.9, 0.9, (), 1.0, 10.0, 1.0, 0.05, 5.0)
    problem = SimpleNamespace(signals=())
    selected = SelectedSet(problem, None, fit, 1.0, *[np.zeros(1)] * 2, (delay,), 0.05, 0.0, (), [])  # type: ignore[arg-type]
    reason = selected.reason_not_named(delay)
    assert (reason is None) is named and (named or reason == "0 is inside the 95 % interval of its delay")
    assert selected.reason_not_named(replace(delay, rivals=(("lag", 0.2),))) is None


def test_a_form_that_simulates_a_named_component_is_no_stand_in():
    hidden = record(np.random.default_rng(3), hidden=lambda u: 0.6 * np.sign(u))
    found = diagnose([hidden], Bent(), [Dry()], settings=DiagnosisSettings(fit_baseline=False))
    assert [c.name for c in found.causes] == ["dry"] and found.stand_ins == ()
    whole = replace(found, causes=(replace(found.causes[0], name="friction", form="dry"),))
    assert whole.stand_ins == () and whole.to_dict()["causes"][0]["form"] == "dry"
    assert replace(found, causes=()).stand_ins == ("dry",) and "form" not in found.to_dict()["causes"][0]


def test_of_two_members_with_the_same_effect_one_is_dropped(monkeypatch):
    """Either is needless beside the other, as a preload beside an offset; both were dropped, and nothing explained."""
    whole, costs = frozenset("abc"), {frozenset("bc"): 2.0, frozenset("ac"): 1.0}

    def ablated(search, fits, w):
        fits.update({m: m for m in costs})
        return [], {"a", "b"} if w.members == whole else set()

    for name, function in {
        "confirmed_sets": lambda search, rejected, smaller: smaller, "_ablated": ablated,
        "reported_set": lambda smaller: SimpleNamespace(members=smaller.get(whole, whole)),
        "_out_of_fold_cost": lambda problem, members: costs[members], "_better_predicting": lambda *rest: [],
        "_assessed": lambda search, fits, sets, w, ablations, dropped: (w.members, set(dropped)),
    }.items():
        monkeypatch.setattr(selection, name, function)
    search = SimpleNamespace(root=SimpleNamespace(fit=None), problem=None)
    assert selection.select_set(search, lambda text: None) == (frozenset("ac"), {"b"})  # type: ignore[arg-type]


class Held(Bent):
    """Its numbers cannot follow the data."""

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        return tuple(Coefficient(n, "", v, v + 1e-6, 1e-6) for n, v in zip("abc", self.vector, strict=True))


def test_a_baseline_that_is_worse_than_the_mean_is_stated():
    data = record(np.random.default_rng(5))
    turned = Record({k: Channel(-data[k] if k == "y" else data[k], data.unit(k)) for k in data.channels}, 0.01)
    found = diagnose([turned], Held(), [Cubic()], settings=DiagnosisSettings(fit_baseline=False))
    assert found.causes or (found.verdict == "unexplained" and "than their mean" in found.reason)
    assert found.before.esr_held_out > 1


@pytest.fixture(scope="module")
def contradicted() -> tuple[Record, Record]:
    """In training a wave stands beside the step, and is named; in the other record one of the other sign."""
    rng = np.random.default_rng(3)
    training, other = (record(rng, level=0.1, hidden=lambda u, w=w: 0.8 * np.sign(u) + w * np.sin(9 * u))
                       for w in (0.5, -2.0))
    assert {c.name for c in diagnose([training], Bent(), [Dry(), Wave()]).causes} == {"dry", "wave"}
    return training, other


@pytest.mark.seconds
@pytest.mark.parametrize(("weights", "kept"), [
    ((0.48, 0.47, 0.05), ["dry"]), ((0.9, 0.09, 0.01), ["dry"]), ((0.97, 0.02, 0.01), [])])
def test_a_set_that_further_data_do_not_confirm_is_replaced_by_the_next(contradicted, monkeypatch, weights, kept):
    """With the wave the error of the other record grows. Where that set has nearly all weight the baseline stays."""
    training, other = contradicted

    def fixed(search):
        known = [search.visited[frozenset(n)] for n in (("dry", "wave"), ("dry",), ())]
        return sorted(zip(known, weights, strict=True), key=lambda t: -t[1])

    monkeypatch.setattr(weighed_sets, "posterior", fixed)
    monkeypatch.setattr(engine, "posterior", fixed)
    monkeypatch.setattr(selection, "reported_set", lambda sets: next(w for w, _ in sets if "dry" in w.members))
    found = diagnose([training], Bent(), [Dry(), Wave()], held_out=[other])
    assert [*(c.name for c in found.causes), *found.stand_ins] == kept
    assert any(r.name == "wave" and "no lower" in r.why for r in found.rejected)
    assert (found.after.esr_held_out < found.before.esr_held_out) is bool(kept)


@pytest.mark.seconds
def test_no_more_sets_are_tried_on_held_out_records_than_a_set_has_members(contradicted, monkeypatch):
    """Each further trial could pass by chance; where none passes, nothing is named."""
    training, other = contradicted
    tried, measured = [], engine._measured

    def counted(*given):
        tried.append(measured(*given))
        return tried[-1]

    monkeypatch.setattr(engine, "_measured", counted)
    monkeypatch.setattr(engine, "posterior", lambda search: [(w, 0.0) for w in search.visited.values()])
    monkeypatch.setattr(outcome.EvidenceOutcome, "predicts", property(lambda self: False))
    found = diagnose([training], Bent(), [Dry(), Wave(), Cubic()], held_out=[other])
    assert len(tried) == MOST_MEMBERS and not found.causes


@pytest.mark.parametrize(("hidden", "weight", "wanted"), [
    (0.5, 0.25, {"dry", "wave"}),  # nearly as probable, and it predicts better
    (0.5, 0.04, {"dry"}),  # beyond all but a twentieth of the weight
    (0.0, 0.25, {"dry"}),  # no better
])
def test_the_set_to_report_is_a_probable_one_that_predicts_best(monkeypatch, hidden, weight, wanted):
    """The most probable set is friction, whose name stays where another set has less error out of fold."""
    data = record(np.random.default_rng(3), level=0.1, hidden=lambda u: 0.8 * np.sign(u) + hidden * np.sin(9 * u))

    weights = {frozenset({"dry"}): 1.0 - weight - 1e-9, frozenset({"dry", "wave"}): weight, frozenset(): 1e-9}

    def weighed(search):
        search.visited.pop(frozenset({"wave"}), None)  # no search need have visited every part of the set
        return [(search.visited[m], p) for m, p in weights.items() if m in search.visited]

    monkeypatch.setattr(weighed_sets, "posterior", weighed)
    monkeypatch.setattr(engine, "posterior", weighed)
    found = diagnose([data], Bent(), [Dry(), Wave()])
    assert found.extended is not None and set(found.extended.effects) == wanted
    assert [c.name for c in found.causes] == ["dry"] and set(found.stand_ins) == wanted - {"dry"}
    assert found.causes[0].delta_bic < -10
    assert found.weights is not None
    reported = [set(w.names) for w in found.weights.sets if w.held_out_esr is not None]
    assert reported == [wanted]  # the error stands beside the set that has it


@pytest.mark.parametrize(("here", "kept"), [
    ({"friction": 1.6, "valve": 0.2}, True),
    ({"friction": 0.4}, False),  # a valve that is less probable does the rest: its number would be no friction's
    ({"valve": 3.0}, False),
])
def test_what_the_most_probable_set_names_achieves_half_of_its_reduction_in_the_set_to_report(here, kept, monkeypatch):
    monkeypatch.setattr(members, "_named", lambda found: found)
    assert members.keeps_names(here, {"friction": 3.0}) is kept


@dataclass(frozen=True)
class Part:
    """What names need of a member."""

    effect: SimpleNamespace
    name: str
    probability: float = 0.9
    weight: float = 0.9


def part(name: str, component: str, flexible: bool = False, given: str = "") -> Part:
    return Part(SimpleNamespace(name=name, component=component, flexible=flexible), given or name)


def test_names_come_from_the_weights_and_places_from_the_set_to_report():
    @dataclass(frozen=True)
    class Chosen:
        members: tuple
        sets: tuple = ()

    found = Chosen((part("friction", "friction"),))
    other = Chosen((part("inner-friction", "friction"), part("hysteresis", "friction", True), part("spring", "spring")))
    assert [m.name for m in members.named_alike(other, found).members] == ["friction", "hysteresis", "spring"]


@pytest.mark.parametrize("order", [1, -1])
def test_air_beside_a_spring_is_not_named_as_that_spring(order):
    """Air is named as a spring in series where its form is not sure; beside one, both had the same name."""
    both = [part("air", "air", given="spring"), part("spring", "spring")][::order]
    air = SimpleNamespace(effects=(both[0 if order > 0 else 1].effect,))
    found = members.named_once(both, [(air, 0.4), (SimpleNamespace(effects=()), 0.6)])
    assert {m.effect.name: m.name for m in found} == {"air": "air", "spring": "spring"}
    assert {m.effect.name: m.weight for m in found} == {"air": 0.4, "spring": 0.9}


def test_of_two_forms_of_a_component_that_is_not_there_itself_the_larger_has_its_name():
    both = [part("air", "air", given="spring"), part("bush", "bush", given="spring")]
    assert [m.name for m in members.named_once(both, [(SimpleNamespace(effects=()), 1.0)])] == ["spring", "bush"]


@pytest.mark.parametrize(("effect", "component", "name", "key"), [
    ("inner-friction", "friction", "inner-friction", "friction"),  # the same component in another place
    ("power", "power", "friction", "friction"),  # it reduces to that component at its numbers
    ("hysteresis", "friction", "hysteresis", "hysteresis"),  # flexible: it can describe more than the component
])
def test_a_component_keeps_its_name_in_every_place(effect, component, name, key):
    part = SimpleNamespace(name=effect, component=component, flexible=effect == "hysteresis")
    member = SimpleNamespace(effect=part, name=name, cost=3.0, rivals=())
    selected = SimpleNamespace(root=SimpleNamespace(cost=4.0), cost_reduction=3.0, members=(member,),
                               reason_not_named=lambda m: None)
    assert members._named(selected) == {key: pytest.approx(np.log(4))}


@pytest.mark.parametrize("hidden", [0.8, 0.0])
def test_an_error_that_a_set_lowers_is_no_noise_where_nothing_is_probable(hidden, monkeypatch):
    """Where all weight is on the baseline alone, what a set takes away out of fold was no noise."""
    monkeypatch.setattr(selection, "confirmed_sets", lambda search, *_: [(search.visited[frozenset()], 1.0)])
    run = record(np.random.default_rng(5), level=0.02 if hidden else 0.5, hidden=lambda u: hidden * np.sign(u))
    found = diagnose([run], Bent(), [Dry(), Cubic()])
    assert not found.causes and found.verdict == ("unexplained" if hidden else "nothing-to-explain")
    assert ("the error is no noise: with" in found.reason and "dry" in found.reason) is bool(hidden)


def test_a_cause_without_which_no_evidence_is_defined_has_no_bic(monkeypatch):
    data = record(np.random.default_rng(3), level=0.1, hidden=lambda u: 0.8 * np.sign(u))
    member, score = selection._member, SetSearch.score

    def assessed(*given):  # as where a strength of the set without it is at its bound
        with monkeypatch.context() as patch:
            patch.setattr(SetSearch, "score", lambda search, w: score(search, w) if w.members else -np.inf)
            return member(*given)

    monkeypatch.setattr(selection, "_member", assessed)
    found = diagnose([data], Bent(), [Dry()])
    assert [c.name for c in found.causes] == ["dry"] and found.causes[0].delta_bic is None
    assert json.loads(json.dumps(found.to_dict()))["causes"][0]["delta_bic"] is None
    assert _cause_row(found.causes[0])[0][5] == "–"
    held = Estimated("take_up", 2.5, None, "N", held=True)
    assert _cause_row(replace(found.causes[0], parameters=(held,)))[0][2:4] == ("2.5 N", "held")
    assert str(held) == "take_up 2.5 N (held)"


@pytest.mark.parametrize(("acceptable", "verdict"), [(1e-9, "unexplained"), (10.0, "nothing-to-explain")])
def test_what_changes_too_little_is_no_part_of_a_set(monkeypatch, acceptable, verdict):
    """Beside a good law nothing is left to explain; else the error is unexplained, with that cause it falls."""
    data = record(np.random.default_rng(3), level=0.1, hidden=lambda u: 0.8 * np.sign(u))
    monkeypatch.setattr(selection, "NAMED_CHANGE", 0.99)
    for module in (outcome, selection):
        monkeypatch.setattr(module, "ACCEPTABLE_MISFIT", acceptable)
    found = diagnose([data], Bent(), [Dry()])
    assert found.verdict == verdict and not found.causes and found.after == found.before
    assert [r.name for r in found.rejected] == ["dry"] and "changes by less than" in found.rejected[0].why
