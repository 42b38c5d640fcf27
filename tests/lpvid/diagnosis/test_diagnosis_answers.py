"""What the evidence engine answers on a toy: names, rivals, probabilities."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from helpers.toy_diagnosis import CAUSES, NOISES, Added, Bent, Cubic, Dry, DryTwin, drive, problem_of, record

from lpvid.baselines.baseline import Coefficient
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.evidence.calibration import LIMIT, SLOPE, component_support
from lpvid.diagnosis.evidence.discrepancy import Discrepancy
from lpvid.diagnosis.evidence.effective_samples import STRUCTURED_SAMPLES
from lpvid.diagnosis.evidence.engine import diagnose, prepared, root_of
from lpvid.diagnosis.evidence.laplace import EvaluatedSet, EvidenceData
from lpvid.diagnosis.evidence.relations import related
from lpvid.diagnosis.evidence.rivals import NAMED_PROBABILITY
from lpvid.diagnosis.evidence.search import SetSearch
from lpvid.diagnosis.evidence.thinning import for_search, thinned
from lpvid.diagnosis.evidence.visited import posterior
from lpvid.diagnosis.refitting import refit
from lpvid.diagnosis.settings import DiagnosisSettings
from lpvid.effects.composition import Composition
from lpvid.effects.effect import EffectParameter
from lpvid.record import Channel, Record
from quartercar.effects import CATALOGUE


@pytest.mark.thinned(3)
@pytest.mark.parametrize("noise", [pytest.param(n, marks=pytest.mark.seconds) if n == "white" else n for n in NOISES])
def test_nothing_hidden_nothing_named(noise):
    runs = [record(np.random.default_rng(s), noise) for s in range(3)]
    found = [diagnose([r], Bent(), CAUSES) for r in runs]
    assert all(not d.causes and d.verdict == "nothing-to-explain" for d in found)
    assert all(d.weights is not None and d.weights.nothing > 0.5 for d in found)


def test_a_cause_is_named_with_its_probability():
    d = diagnose([record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u))], Bent(), CAUSES)
    cause, = d.causes
    assert cause.name == "dry"
    assert d.verdict == "explained"
    assert cause.probability is not None and cause.probability > NAMED_PROBABILITY
    assert cause.weight is not None and cause.weight > 0.99
    assert np.isclose(cause.parameters[0].value, 0.8, rtol=0.1)
    data = json.loads(json.dumps(d.to_dict()))
    assert data["schema"] == "lpvid/diagnosis/2"
    assert data["sets"][0]["names"] == ["dry"]
    assert {f["name"] for f in data["families"]} == {"toy"}
    assert data["discrepancy"]["share"] < 0.03


@pytest.mark.seconds
def test_twins_share_the_probability():
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u))
    d = diagnose([run], Bent(), (*CAUSES, DryTwin()))
    assert d.verdict == "cannot-tell"
    rivals, = d.rivals
    assert set(rivals.names) == {"dry", "dry-twin"}


class DryForm(DryTwin):
    name, title, form_of = "dry-form", "another form of the same component", "dry"


@pytest.mark.seconds
def test_forms_of_one_component_add_up_and_the_component_is_named():
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u))
    d = diagnose([run], Bent(), (*CAUSES, DryForm()))
    assert [c.name for c in d.causes] == ["dry"] and not d.rivals
    assert d.weights is not None and d.weights.causes["dry"] > NAMED_PROBABILITY and "dry-form" not in d.weights.causes
    assert d.weights.components["dry"].weight > 0.99


class Blurred(DryTwin):
    """The same with shapes that do nothing."""

    name = "blurred"

    @property
    def parameters(self):
        idle = (EffectParameter(n, "", n, 1.0, (0.1, 10.0), (1e-3, 1e3), (0.5, 2.0)) for n in "ab")
        return (super().parameters[0], *idle)


def test_how_many_shapes_a_cause_has_does_not_decide_between_rivals():
    """Shapes that the data do not determine cost nothing, whatever range they were given, wherever a fit left them."""
    problem, composition = problem_of(record(np.random.default_rng(3), hidden=lambda u: 0.6 * np.sign(u)))
    force = float(np.sqrt(np.mean(problem.stack([s.output - s.output.mean() for s in problem.signals]) ** 2)))
    points = {"dry-twin": np.array([[0.1]]), "blurred": np.array([[0.1, 0.5, 2.0], [0.1, 2.0, 0.5]])}
    data = EvidenceData(problem, Discrepancy(np.zeros((problem.n_samples, 1)), np.zeros(1), force), points)
    own = refit(problem, composition, composition.neutral).vector
    plain = EvaluatedSet(data, refit(problem, Composition(composition.baseline, (DryTwin(),)), np.append(own, 0.5)))
    for shapes in ((1.0, 1.0), (1e-3, 1e3)):
        start = np.concatenate([own, [0.5], shapes])
        shaped = EvaluatedSet(data, refit(problem, Composition(composition.baseline, (Blurred(),)), start))
        assert np.isclose(plain.evidence(1.0), shaped.evidence(1.0), atol=1e-3)


def test_stretches_of_a_short_record_hold_enough_blocks():
    """Blocks and start-up are rounded to whole samples; a stretch has room for both its blocks at any rate."""
    for period in (1 / 813.8, 1 / 512, 1 / 600.7):
        n = round(6.6 / period)
        t = period * np.arange(n)
        s = Signals(period, {"velocity": np.sin(30 * t), "displacement": -np.cos(30 * t) / 30}, np.sin(30 * t), "run")
        cut = for_search((s,), True)
        assert Blocks.of(cut, 0).count >= 8


@pytest.mark.seconds
def test_a_small_misfit_of_the_law_is_no_cause():
    """A smooth 1.5 % error of the law is what every law has: neither named nor held against a cause."""
    def misfit(u):
        return 0.08 * np.sin(1.7 * u) * np.cos(u)

    alone = diagnose([record(np.random.default_rng(7), level=0.02, hidden=misfit)], Bent(), (Dry(), *CAUSES[3:]))
    assert "dry" not in [c.name for c in alone.causes]
    run = record(np.random.default_rng(7), level=0.02, hidden=lambda u: misfit(u) + 0.5 * np.sign(u))
    both = diagnose([run], Bent(), (Dry(), *CAUSES[3:]))
    assert "dry" in [c.name for c in both.causes]


@pytest.mark.parametrize(("level", "stated"), [(0.3, True), (0.02, False)])
def test_what_an_explained_error_leaves_for_noise_is_stated(level: float, stated: bool) -> None:
    """A regression that finds nothing in it does not prove that it is noise."""
    run = record(np.random.default_rng(3), level=level, hidden=lambda u: 1.5 * np.sign(u))
    found = diagnose([run], Bent(), [Dry(), Cubic()])
    assert found.verdict == "explained" and ("is taken for noise; a repeat" in found.reason) is stated


def test_support_of_a_component_is_the_weight_of_the_sets_that_hold_it_in_any_form():
    run = record(np.random.default_rng(5), hidden=lambda u: 0.8 * np.sign(u))
    search, _ = prepared([run], Bent(), (Dry(), DryForm(), Cubic()), lambda text: None)
    search.run(root_of(search.problem, Bent()))
    sets = posterior(search)
    dry = component_support(sets)["dry"]
    assert dry.weight == pytest.approx(sum(p for w, p in sets if w.members & {"dry", "dry-form"}))
    assert dry.weight + dry.against == pytest.approx(1.0)
    z = SLOPE * np.log1p(np.log(dry.weight / dry.against))
    assert dry.probability == pytest.approx(LIMIT / (1 + np.exp(-z)))


class Fast(Bent):
    """At the record's rate."""

    def signals(self, record: Record) -> Signals:
        return replace(super().signals(record), sample_time=record.sample_time)


class Clocked(Fast):
    """Runs at one clock alone, as an identified LPV model does."""

    @property
    def clock(self) -> float:
        return 0.001


def test_records_of_a_baseline_with_its_own_clock_are_not_decimated():
    t = 0.001 * np.arange(40_000)
    data = Record({k: Channel(np.sin(5 * t + n), "V") for n, k in enumerate(("u", "c", "y"))}, 0.001)
    assert thinned([data], Fast())[1] > 1 and thinned([data], Clocked())[1] == 1


class Steep(Added):
    name, title = "steep", "sign of the input, not quite as sharp"
    shape = staticmethod(lambda s: np.tanh(30 * s["u"]))


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize(("misfit", "named", "rivals"), [(0.1, ["dry"], []), (0.4, [], [("dry", "steep")])])
def test_related_components_are_separated_where_they_differ_by_more_than_the_error_of_the_law(misfit, named, rivals):
    """The change by either is the same but near zero; the law errs by .07 and by .28 of the output's unit."""
    def hidden(u: np.ndarray) -> np.ndarray:
        return 1.5 * np.sign(u) + misfit * np.sin(9 * u) * np.sign(np.roll(u, 30))

    d = diagnose([record(np.random.default_rng(3), level=0.05, hidden=hidden)], Bent(), (Dry(), Steep()))
    assert [c.name for c in d.causes] == named and [r.names for r in d.rivals] == rivals


def test_next_of_kin_are_other_components_of_a_family_or_lags_of_motion_and_force():
    by_name = {e.name: e for e in CATALOGUE}
    pairs = (("thermal-fade", "viscous-fade", True), ("displacement-delay", "one-sided-filter", True),
             ("force-delay", "fixture-resonance", True), ("coulomb-friction", "inner-friction", False),
             ("coulomb-friction", "coulomb-friction", False), ("series-compliance", "thermal-fade", False))
    assert all(related(by_name[a], by_name[b]) is related(by_name[b], by_name[a]) is wanted for a, b, wanted in pairs)


class Unanswered(Bent):
    """A further number of the law to which nothing answers, and which a fit has sent far away."""

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        return (*super().coefficients, Coefficient("p3", "", -np.inf, np.inf, 1e200))

    @property
    def vector(self) -> np.ndarray:
        return np.array([*self.parameters[:3], 9e244])

    def sensitivities(self, signals, vector: np.ndarray) -> np.ndarray:
        return np.column_stack([super().sensitivities(signals, vector), np.zeros(signals.n_samples)])


@pytest.mark.seconds
def test_a_number_of_the_law_to_which_nothing_answers_decides_nothing():
    data = record(np.random.default_rng(3), hidden=lambda u: 1.5 * np.sign(u))
    settings = DiagnosisSettings(fit_baseline=False)
    plain, far = (diagnose([data], law, [Dry(), Cubic()], settings=settings) for law in (Bent(), Unanswered()))
    assert [c.name for c in far.causes] == [c.name for c in plain.causes] == ["dry"]
    assert far.causes[0].probability == pytest.approx(plain.causes[0].probability, abs=1e-6)


class Bounded(Dry):
    """Dry, of which there can be half a unit at most."""

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("gain", "V", "g", 0.0, (0.0, 0.5), (0.0, 0.5), (0.1,)),)


@pytest.mark.parametrize(("there", "named"), [(0.4, ["dry"]), (1.5, [])])
def test_a_cause_at_its_bound_is_not_named(there, named):
    data = record(np.random.default_rng(3), level=0.1, hidden=lambda u: there * np.sign(u))
    found = diagnose([data], Bent(), [Bounded(), Cubic()])
    assert [c.name for c in found.causes if c.name == "dry"] == named
    if not named:
        assert any(r.name == "dry" and "at its bound, gain 0.5 V" in r.why for r in found.rejected)


class AnyStep(Dry):
    """A form that describes the step of `Dry` among others."""

    name, title, flexible = "any-step", "some step", True

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return ("cubic", "not-in-the-catalogue")


def test_a_form_is_listed_with_the_components_that_it_describes_too():
    """It is by far the most probable; named alone it would be taken for a part of the damper."""
    data = record(np.random.default_rng(3), hidden=lambda u: 1.5 * np.sign(u))
    found = diagnose([data], Bent(), [AnyStep(), Cubic()])
    assert found.weights is not None and found.weights.causes["any-step"] > NAMED_PROBABILITY
    assert not found.causes and [r.names for r in found.rivals] == [("any-step", "cubic")]
    assert found.verdict == "cannot-tell" and "a form that describes cubic too" in found.reason
    assert "the inputs predict a free-run error of" in found.reason
    assert found.after.esr_held_out < found.before.esr_held_out


@pytest.mark.thinned(2)
@pytest.mark.parametrize("hidden", [lambda x: 0.1 * np.sin(9 * x), lambda x: 0.2 * np.sign(x)], ids=["wave", "dry"])
def test_a_repeat_shows_a_small_cause_in_slow_noise(hidden, rng):
    """Causes of 1.5 and 4.5 % of the output in slow noise of 7 %: named from two equal runs, not from two others."""
    u = drive(3000, rng)
    first, again, other = (record(rng, "ar1", 0.3, u=v, hidden=hidden) for v in (u, u, drive(3000, rng)))
    wanted = "wave" if abs(hidden(np.array([1.0]))[0]) < 0.1 else "dry"
    found = diagnose([first, again], Bent(), CAUSES)
    assert [c.name for c in found.causes] == [wanted] and found.verdict == "explained"
    assert found.noise["independent_samples"] > 8 * STRUCTURED_SAMPLES
    assert found.noise["level"] == pytest.approx(0.3, rel=0.25)
    assert found.noise["weighed"] and found.noise["name"] == "coloured-noise"
    single = diagnose([first, other], Bent(), CAUSES)
    assert not single.causes and not single.noise["weighed"]


@pytest.mark.seconds
def test_slow_noise_of_repeats_is_no_cause(rng):
    """Of six pairs of runs with nothing hidden none has a named cause."""
    for _ in range(6):
        u = drive(2000, rng)
        found = diagnose([record(rng, "ar1", 0.3, u=u) for _ in range(2)], Bent(), CAUSES)
        assert found.verdict == "nothing-to-explain" and not found.causes


class Warm(Added):
    """A channel that the baseline does not read."""

    name, title, needs = "warm", "the input in proportion to the temperature", ("t",)
    shape = staticmethod(lambda s: s["t"] * s["u"])


class Wide(Bent):
    """Its records have a temperature, which it does not read."""

    def signals(self, record):
        return Signals(record.sample_time, {k: record[k] for k in ("u", "c", "t")}, record["y"], record.name)


def test_runs_repeat_where_all_that_a_cause_needs_repeats():
    """What a cause in the temperature changes from run to run is no noise."""
    rng = np.random.default_rng(8)
    u = drive(3000, rng)
    warm = [record(rng, "ar1", 0.1, u=u).with_channel("t", np.full(3000, t), "") for t in (-1.0, 1.0)]
    assert not prepared(warm, Wide(), (*CAUSES, Warm()), lambda text: None)[0].repeated
    assert prepared(warm, Wide(), CAUSES, lambda text: None)[0].repeated


@pytest.mark.parametrize(("noise", "hidden", "weighed"),
                         [("ar1", 0.0, True), ("ar1", 1.0, False), ("white", 0.0, False)])
def test_errors_are_weighed_where_slow_noise_is_most_of_the_error(noise, hidden, weighed):
    rng = np.random.default_rng(9)
    u = drive(3000, rng)
    runs = [record(rng, noise, 0.3, u=u, hidden=lambda x: hidden * np.sin(23 * x)) for _ in range(2)]
    search, _ = prepared(runs, Bent(), CAUSES, lambda text: None)
    search.run(root_of(search.problem, Bent()))
    again = search.reweighed()
    assert (again is not None) == weighed and search.noise is not None
    assert search.noise.variance == pytest.approx(0.09, rel=0.3)
    if again is not None:
        assert again.kappa > 4 * search.kappa and set(again.visited) == set(search.visited)
        assert again.reweighed() is None or again.best.members != search.best.members


def test_without_weights_where_the_weighed_search_leaves_more_misfit_than_noise(monkeypatch):
    """A slow misfit has no weight: on a measured record a weighed search had left 2.4 times the error."""
    rng = np.random.default_rng(4)
    u = drive(3000, rng)
    runs = [record(rng, "ar1", 0.3, u=u, hidden=lambda x: 0.1 * np.sin(9 * x)) for _ in range(2)]
    assert diagnose(runs, Bent(), CAUSES).noise["weighed"]
    mostly_noise = SetSearch.is_mostly_noise

    def beside_more_misfit(search, floor):
        if search.problem.whitening is None:
            return mostly_noise(search, floor)
        alone = search.visited[frozenset()]
        worse = SetSearch(replace(alone.data, candidates=()), (), search.channels, search.report_progress,
                          {frozenset(): EvaluatedSet(alone.data, replace(alone.fit, errors=3 * alone.fit.errors))},
                          noise=search.noise)
        assert mostly_noise(search, floor) and not mostly_noise(worse, floor)
        return False

    monkeypatch.setattr(SetSearch, "is_mostly_noise", beside_more_misfit)
    assert not diagnose(runs, Bent(), CAUSES).noise["weighed"]


def test_a_size_in_slow_noise_has_the_interval_of_the_weights():
    """The true size within three standard errors, of .0034; without weights they are .016."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        u = drive(3000, rng)
        runs = [record(rng, "ar1", 0.3, u=u, hidden=lambda x: 0.1 * np.sin(9 * x)) for _ in range(2)]
        size = diagnose(runs, Bent(), CAUSES).causes[0].parameters[0]
        assert size.std is not None and abs(size.value - 0.1) < 3 * size.std < 0.015


def test_the_baseline_alone_is_judged_without_weights():
    """Weights for the misfit of the best set make another law of it: its error is that of its own fit in time."""
    rng = np.random.default_rng(3)
    u = drive(3000, rng)
    runs = [record(rng, "ar1", 0.3, u=u, hidden=lambda x: 0.2 * np.sin(9 * x)) for _ in range(2)]
    fitted = Bent().fit(runs)
    problem = problem_of(*runs)[0]
    error = problem.stack([s.output - fitted.core(fitted.vector)(s) for s in problem.signals])
    found = diagnose(runs, Bent(), CAUSES)
    assert found.noise["weighed"]
    assert found.before.esr_training == pytest.approx(np.mean(error**2) / problem.spread**2, rel=0.01)
    assert found.after.esr_held_out < found.before.esr_held_out
