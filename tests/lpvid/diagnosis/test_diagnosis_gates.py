"""Gates of the diagnosis on a toy that is no damper: each against what it ought to say under a known truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_diagnosis import Added, Bent, Dry, Wave, Zero, drive, problem_of, record, whitened

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import (
    BLOCKS_BETTER,
    MAJORITY,
    Folds,
    JudgedEffect,
    _enough,
    dispersion,
    explained_share,
    judge,
    out_of_fold,
    shadowed,
    stands_apart,
    surer_share,
    weighty,
)
from lpvid.diagnosis.effect import Effect, EffectParameter
from lpvid.diagnosis.engine import AS_WELL, _Case, diagnose
from lpvid.diagnosis.noise import NoiseLevel, Whitening, noise_level
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.rivals import DISTINCT, SEPARATED, _unwhitened, in_both, separation
from lpvid.diagnosis.screening import directions, moves, screen
from lpvid.diagnosis.selection import BIC_GAIN, ForwardSelection
from lpvid.diagnosis.signals import Core, Signals
from lpvid.diagnosis.steadiness import is_there
from lpvid.record import Record


class Form(Wave):
    name, catch_all = "form", True


def drowned(seed: int) -> tuple[DiagnosisProblem, Folds, Folds, NoiseLevel, NoiseLevel]:
    """A cause of a twentieth of slow noise's power: baseline and set out of fold, noise of the output and whitened."""
    rng = np.random.default_rng(seed)
    u = drive(6000, rng)
    pair = [record(rng, "ar1", level=1.0, u=u, hidden=lambda u: 0.3 * np.sin(9 * u)) for _ in range(2)]
    problem, composition = problem_of(*pair)
    problem = problem.with_whitening(Whitening(np.array([1.0, -0.95]), 1.0))
    bare = refit(problem, composition, composition.neutral)
    both = Composition(Bent(), (Wave(),))
    fit = refit(problem, both, both.neutral)
    errors = [problem.whitening.apply(e) for e in problem.errors(both, fit.vector)]
    left = [replace(s, output=e) for s, e in zip(problem.signals, errors, strict=True)]
    level, white = (noise_level(s, ["u"], problem.blocks.mask()) for s in (problem.signals, left))
    return problem, out_of_fold(problem, bare), out_of_fold(problem, fit), level, white


class TestBothMetrics:
    @pytest.mark.parametrize(("apart", "share", "certain", "description"), [
        (50.0, 0.0, 0.0, 50.0), (-50.0, 0.0, 0.0, -50.0),  # the error in the output's unit is silent
        (50.0, 0.4, 4.0, -20.0), (-50.0, -0.4, -4.0, 20.0),  # it surely says otherwise
        (50.0, -0.4, -4.0, 50.0), (-50.0, 0.4, 4.0, -50.0),  # it agrees
        (50.0, 0.05, 2.0, 0.0), (-50.0, -0.05, -2.0, 0.0),  # it seems to say otherwise: nobody can tell
        (5.0, 0.05, 2.0, 0.0), (50.0, 0.4, 0.5, 50.0)])
    def test_who_decides(self, apart: float, share: float, certain: float, description: float) -> None:
        assert in_both(apart, share, certain) == description

    def test_a_fit_in_the_unit_of_the_output_is_best_there(self, rng: np.random.Generator) -> None:
        """Under a whitening, what a law cannot do pulls its parameters elsewhere."""
        whitened_problem, fit = whitened(record(rng, "ar1", hidden=lambda u: 1.5 * np.sin(9 * u)))

        def plainly(vector: np.ndarray) -> float:
            errors = whitened_problem.stack(whitened_problem.errors(fit.composition, vector), whiten=False)
            return float(errors @ errors)

        other = _unwhitened(whitened_problem, fit)
        assert plainly(other.vector) < 0.999 * plainly(fit.vector)
        stacked = whitened_problem.stack(whitened_problem.errors(fit.composition, other.vector))
        assert stacked @ stacked > 1.001 * fit.cost

    def test_a_share_that_slow_noise_drowns_is_told_by_the_whitened_errors(self) -> None:
        plain, surer = [], []
        for seed in range(12):
            problem, before, after, level, white = drowned(seed)
            plain.append(explained_share(problem, before, after, level.variance, 0.0)[0])
            surer.append(surer_share(problem, before, after, level, white, 0.0)[0])
        assert np.std(plain) > 3 * np.std(surer) and np.mean(surer) == pytest.approx(1.0, abs=0.15)

    @pytest.mark.parametrize(("level_of_both", "worse", "described"), [(1.0, 1.005, True), (1.0, 1.02, True),
                                                                  (5.0, 3.0, False)])
    def test_a_share_below_none_that_is_unsure_says_nothing(self, level_of_both: float, worse: float,
                                                            described: bool) -> None:
        """A baseline fitted to slow noise may leave less of that than an extended model which is fitted to the rest."""
        for seed in range(4):
            problem, before, after, level, white = drowned(seed)
            before = Folds(before.errors, level_of_both * before.plain)  # 5: far above the noise, and no doubt of it
            after = Folds(after.errors, worse * before.plain)
            assert explained_share(problem, before, after, level.variance, 0.0)[0] == 0.0
            share, error = surer_share(problem, before, after, level, white, 0.0)
            assert abs(share - 1.0) < error < 0.3 if described else share == 0.0

    def test_a_worse_model_explains_nothing(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        small, large = (Folds(np.zeros(problem.n_samples), np.full(problem.n_samples, e)) for e in (1.0, 1.1))
        for floor in (None, 0.5, 2.0):
            assert explained_share(problem, small, large, floor, 0.0)[0] == 0.0
            assert explained_share(problem, large, small, floor, 0.0)[0] > 0.0


class TestSmallPrint:
    def margin(self, won: float) -> float:
        rest, now = (SimpleNamespace(cost=c, variance=2.0) for c in (2.0 * won + 500.0, 500.0))
        return separation(rest, now)  # type: ignore[arg-type]

    def test_what_lies_between_rivals_grows_with_what_is_won(self) -> None:
        assert self.margin(1e3) == SEPARATED
        assert SEPARATED < self.margin(2e4) < DISTINCT
        assert self.margin(1e7) == DISTINCT


class TestFaintCauses:
    """A strong cause that acts in bursts, and a faint change beside it."""

    def asked(self, rng: np.random.Generator, size: float, quiet_share: float, louder: float = 1.0) -> bool:
        """Whether a change of this size stands apart, of which the data hold so much where the strong one is quiet."""
        problem, _ = problem_of(record(rng))
        n = problem.n_samples
        bursts = np.sin(np.arange(n) / 40) > 0.3
        noise, change = rng.standard_normal(n), size * np.sin(np.arange(n) / 7) * np.where(bursts, louder, 1.0)
        errors = noise - (1 - quiet_share) * change * ~bursts  # the fit believes in it everywhere
        fit = SimpleNamespace(errors=errors, variance=1.0)
        strong = SimpleNamespace(without=SimpleNamespace(errors=errors + 20.0 * bursts * np.sin(np.arange(n) / 5)))
        faint = SimpleNamespace(without=SimpleNamespace(errors=errors + change))
        return stands_apart(SimpleNamespace(problem=problem, fit=fit), faint, strong)  # type: ignore[arg-type]

    def test_one_of_its_own_stands_apart(self, rng: np.random.Generator) -> None:
        assert self.asked(rng, 0.6, 1.0)

    def test_the_small_print_of_the_strong_one_does_not(self, rng: np.random.Generator) -> None:
        assert not self.asked(rng, 0.6, 0.0) and not self.asked(rng, 0.6, 0.4)

    def test_one_that_acts_where_the_strong_one_does_is_not_apart(self, rng: np.random.Generator) -> None:
        assert self.asked(rng, 0.6, 1.0, louder=1.5) and not self.asked(rng, 0.6, 1.0, louder=4.0)

    def test_one_that_noise_drowns_does_not(self, rng: np.random.Generator) -> None:
        assert not self.asked(rng, 0.02, 1.0)


def test_what_stays_without_a_name_changes_less_than_what_is_named() -> None:
    def judged(contribution: float, minor: bool) -> JudgedEffect:
        stated = ("faint",) if minor else ()
        return JudgedEffect(Dry(), np.ones(1), 0.0, -100.0, 50.0, 0.0, 1.0, 0.1, contribution, (), None, stated, minor,
                      None)  # type: ignore[arg-type]

    found = weighty([judged(3.0, False), judged(1.0, True), judged(5.0, True), judged(2.0, False)])
    assert [j.minor for j in found] == [False, True, False, False]
    assert [j.minor for j in weighty([judged(3.0, True)])] == [True]


@pytest.mark.parametrize(("faint", "strong", "named"), [
    (Dry(), Wave(), True), (Dry(), Form(), False), (Form(), Wave(), False)])
def test_beside_a_form_a_faint_cause_needs_more(faint: Effect, strong: Effect, named: bool,
                                                rng: np.random.Generator) -> None:
    """3 % of what the strongest wins, nowhere apart from it."""
    problem, fit = whitened(record(rng))
    shape = 20.0 * np.sin(np.arange(problem.n_samples) / 5)
    search = SimpleNamespace(problem=problem, fit=fit)

    def judged(effect: Effect, delta: float, share: float) -> JudgedEffect:
        without = SimpleNamespace(errors=fit.errors + share * shape)
        return JudgedEffect(effect, np.ones(1), 0.0, delta, -delta, 0.0, 1.0, 0.1, 1.0, (), None, (), False,
                      without)  # type: ignore[arg-type]

    found = shadowed(search, [judged(strong, -5000.0, 1.0), judged(faint, -150.0, 0.0)], 0.0)  # type: ignore[arg-type]
    assert [not j.objections for j in found] == [True, named]


class Twice(Added):
    name, title = "twice", "in two blocks, both of one fold, and next to nothing elsewhere"

    @staticmethod
    def shape(s: Signals) -> np.ndarray:
        k = np.arange(s.n_samples)
        return np.where((np.abs(k - 1262) < 25) | (np.abs(k - 1462) < 25), 1.0, 1e-3 * np.sin(9 * s["u"]))


class TestBlocksInWhichACauseMustHelp:
    def test_those_that_were_fitted_to_themselves_do_not_count(self, rng: np.random.Generator) -> None:
        """No other block tells of it, so that nothing was held out."""
        problem, _ = problem_of(run := record(rng))
        signals = replace(problem.signals[0], output=run["y"] + 3 * Twice.shape(problem.signals[0]))
        problem = replace(problem, signals=(signals,))
        numbers = problem.blocks.number[0][[1262, 1462]]
        assert numbers[0] != numbers[1] and np.ptp(problem.blocks.fold[numbers]) == 0
        composition = Composition(Bent(), (Twice(),))
        search = ForwardSelection(problem, refit(problem, composition, composition.neutral), (), rng, lambda text: None)
        described = judge(search, composition.effects[0], out_of_fold(problem, search.fit), ())
        assert described.delta_bic < -BIC_GAIN and described.blocks_better == 0.0
        assert any("held-out blocks" in stated for stated in described.objections)

    def test_one_that_dwarfs_the_noise_in_most(self) -> None:
        assert _enough(np.full(30, 400.0)) == BLOCKS_BETTER

    def test_a_faint_one_in_as_many_as_it_would_by_chance(self, rng: np.random.Generator) -> None:
        """Held-out gains of a true change of energy E: 2 (d·e) + E, drawn; 5 % of them help in fewer blocks."""
        energy, draws = np.full(40, 1.5), 4000
        gains = 2 * np.sqrt(energy) * rng.standard_normal((draws, energy.size)) + energy
        enough = _enough(energy)
        assert MAJORITY < enough < BLOCKS_BETTER
        assert np.mean((gains > 0).mean(axis=1) < enough) < 0.08

    @pytest.mark.parametrize("colour", ["white", "slow", "uneven"])
    def test_dispersion_is_that_of_the_noise_along_the_change(self, rng: np.random.Generator, colour: str) -> None:
        """Against block sums of d·e drawn anew many times."""
        problem, _ = problem_of(record(rng))
        n = problem.n_samples
        change = np.sin(np.arange(n) / 300.0) ** 2

        def noise() -> np.ndarray:
            white = rng.standard_normal(n)
            if colour == "slow":
                return np.convolve(white, np.full(10, 10**-0.5), "same")
            return white * (change / np.sqrt(np.mean(change**2)) if colour == "uneven" else 1.0)

        draws = [noise() for _ in range(60)]
        scatter = np.mean([problem.block_sums(change * e) ** 2 for e in draws])
        expected = scatter / np.mean(problem.block_sums(change**2)) / np.mean(np.square(draws))
        assert np.mean([dispersion(problem, change, e) for e in draws[:10]]) == pytest.approx(expected, rel=0.25)

    def test_no_change_disperses_nothing(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        assert dispersion(problem, np.zeros(problem.n_samples), rng.standard_normal(problem.n_samples)) == 1.0

    def test_never_fewer_than_a_clear_majority(self) -> None:
        assert _enough(np.full(12, 1e-6)) == MAJORITY


def test_a_search_that_goes_in_circles_ends(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each addition makes the one before superfluous, and is so itself beside that one."""
    problem, composition = problem_of(record(rng, hidden=lambda u: 0.5 * np.sin(9 * u)))
    first = refit(problem, composition, composition.neutral)
    search, evidence, found = ForwardSelection.begin(problem, first, (Wave(), Dry()), rng, lambda text: None)
    taken: list[str] = []

    def without_the_first(self: ForwardSelection) -> None:
        self.fit = self.without(*(e for e in self.fit.composition.effects if e.name != taken[-1]))

    def the_other(self: ForwardSelection, evidence: object, found: list) -> tuple[tuple[Effect, ...], Refit]:
        other = self.outside()[0]
        taken.append(other.name)
        return (other,), self.taste((other,), found)

    monkeypatch.setattr(ForwardSelection, "prune", without_the_first)
    monkeypatch.setattr(ForwardSelection, "best_addition", the_other)
    monkeypatch.setattr(ForwardSelection, "negligible", lambda self, added, fit: False)
    monkeypatch.setattr("lpvid.diagnosis.selection.SIGNIFICANT", 2.0)
    search.grow(evidence, found)
    assert taken == ["wave", "dry", "wave"]


class Abrupt(Dry):
    name, title, abrupt = "abrupt", "sign of the input, at instants that nobody knows", True


class Waves(Added):
    """Five strengths."""

    name, title, strengths = "waves", "five waves of the input", 5

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(f"gain_{k}", "V", "g", 0.0, (-10.0, 10.0), (-100.0, 100.0), (-0.1, 0.1))
                     for k in range(5))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return lambda s: core(s) + np.sin(np.outer(s["u"], np.arange(4, 9))) @ values


class TestStrengthOfNothing:
    """One that changes from block to block wins a likelihood of independent samples, wherever its mean comes to lie."""

    def search(self, scatter: float, rng: np.random.Generator, *beside: Effect) -> tuple[ForwardSelection, list, list]:
        """A wave of .2 V, or of a gain with such a mean and so many times that spread, by stretches of 100 samples."""
        u = drive(6000, rng)
        gains = rng.standard_normal(60)
        gains = 0.2 * np.repeat((gains - gains.mean()) * scatter + 1.0, 100)
        problem, _ = problem_of(record(rng, hidden=lambda u: gains * np.sin(9 * u), u=u))
        composition = Composition(Bent(), beside)
        first = refit(problem, composition, composition.neutral)
        found = directions(problem, first, moves(problem, first, (Wave(),)))
        return (
            ForwardSelection(problem, first, (Wave(),), rng, lambda text: None),
            screen(problem, first, found, rng),
            found,
        )

    @pytest.mark.parametrize(("scatter", "there"), [(0.0, True), (1.0, True), (6.0, False)])
    def test_is_told_by_its_blocks(self, scatter: float, there: bool, rng: np.random.Generator) -> None:
        search, _, found = self.search(scatter, rng)
        fit = search.taste((Wave(),), found)
        assert fit.bic() < search.fit.bic() - BIC_GAIN, "the likelihood is for it either way"
        assert is_there(search.problem, fit, fit.composition.effects[0]) == there

    @pytest.mark.parametrize(("beside", "scatter", "added"), [
        ((Abrupt(),), 0.0, True), ((Abrupt(),), 6.0, False), ((Dry(),), 6.0, True)])
    def test_is_not_added_where_another_jumps(self, beside: tuple[Effect, ...], scatter: float, added: bool,
                                              rng: np.random.Generator) -> None:
        search, evidence, found = self.search(scatter, rng, *beside)
        assert (search.best_addition(evidence, found) is not None) == added

    def test_several_strengths_are_rarely_there_where_nothing_is(self) -> None:
        there = []
        for seed in range(100):
            problem, _ = problem_of(record(np.random.default_rng(seed), n=2000))
            composition = Composition(Bent(), (Waves(),))
            fit = refit(problem, composition, composition.neutral)
            there.append(is_there(problem, fit, composition.effects[0]))
        assert sum(there) <= 12

    def test_is_an_objection_there(self, rng: np.random.Generator) -> None:
        search, _, found = self.search(6.0, rng, Abrupt())
        search.fit = search.taste((Wave(),), found)
        described = judge(search, search.fit.composition.effects[-1], out_of_fold(search.problem, search.fit), ())
        assert described.effect.name == "wave" and not described.minor
        assert "its strength is not surely different from none" in described.objections


class TestGivingWay:
    """One of the set gives way to another that does clearly better in its place."""

    @pytest.mark.parametrize("been", [set(), {frozenset({"dry"})}])
    def test_not_to_one_that_leads_to_a_set_that_has_been(self, been: set[frozenset[str]]) -> None:
        """Two that are better than each other, each by its own fit, would take turns as long as they may."""
        better = SimpleNamespace(effect=Dry(), fit=SimpleNamespace(composition=Composition(Bent(), (Dry(),))))
        one = SimpleNamespace(effect=Wave(), rivals=(), better=better, objections=(), minor=False, p_value=0.01)
        search = SimpleNamespace(fit="as it is", p_values={})
        case = SimpleNamespace(search=search, report_progress=lambda text: None)
        assert _Case._give_way(case, [one], [], been) == (not been)  # type: ignore[arg-type]
        assert search.fit == ("as it is" if been else better.fit)

    @pytest.mark.parametrize("apart", [-3.0, 4.0, 6.0])
    def test_a_special_case_that_trails_too_much_stays_a_rival(self, apart: float) -> None:
        fit = SimpleNamespace(composition=Composition(Bent(), (Dry(),)))
        special = SimpleNamespace(effect=Dry(), fit=fit, apart=apart)
        general = SimpleNamespace(name="general", contains=("dry",))
        one = SimpleNamespace(effect=general, rivals=(special,), better=None, objections=(), minor=False, p_value=0.01)
        case = SimpleNamespace(search=SimpleNamespace(fit=None, p_values={}), report_progress=lambda text: None)
        assert _Case._give_way(case, [one], [], set()) == (apart < AS_WELL)  # type: ignore[arg-type]


class TestWhatRepeatsShare:
    @staticmethod
    def shared(*records: Record) -> float:
        problem, fit = whitened(*records)
        case = SimpleNamespace(problem=problem, search=SimpleNamespace(problem=problem), baseline=Bent())
        case._unshared = lambda fit: _Case._unshared(case, fit)  # type: ignore[arg-type]
        return float(np.sqrt(_Case._repeated(case, fit)))  # type: ignore[arg-type]

    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_is_structure_whatever_the_noise(self, noise: str, rng: np.random.Generator) -> None:
        """The noise hides half of it from a regression; what two runs share of it they share."""
        u = drive(6000, rng)
        pair = [record(rng, noise, level=0.4, hidden=lambda u: 0.8 * np.sin(9 * u), u=u) for _ in range(2)]
        left = 0.8 * np.sqrt(np.mean(np.sin(9 * u) ** 2))
        assert 0.7 * left < self.shared(*pair) < 1.02 * left

    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_noise_they_do_not_share(self, noise: str, rng: np.random.Generator) -> None:
        found = []
        for _ in range(10):
            u = drive(3000, rng)
            found.append(self.shared(*(record(rng, noise, level=0.4, u=u) for _ in range(2))))
        assert np.mean(np.array(found) > 0) <= 0.2 and max(found) < 0.15

    def test_without_repeats_nothing_is_known(self, rng: np.random.Generator) -> None:
        assert self.shared(record(rng, hidden=lambda u: np.sin(9 * u)), record(rng)) == 0.0

    @pytest.mark.parametrize(("strange", "named"), [(0.0, ["dry", "zero"]), (0.2, ["zero"])])
    def test_a_cause_that_changes_less_is_small(self, strange: float, named: list[str],
                                                rng: np.random.Generator) -> None:
        """Beside a wave that no candidate describes the sign of the input may be a part of what is left."""
        def hidden(u: np.ndarray) -> np.ndarray:
            return 2.0 + 0.1 * np.sign(u) + strange * np.sin(40 * u)

        u = drive(3000, rng)
        found = diagnose([record(rng, hidden=hidden, u=u, level=0.05) for _ in range(2)], Bent(), [Dry(), Zero()])
        assert sorted(c.name for c in found.causes) == named
        assert [r.why for r in found.rejected] == (["it changes less than what is left unexplained"] if strange else [])


class TestPlausibleRange:
    @pytest.mark.parametrize(("plausible", "reach"), [
        ((0.0, 2.0), (0.0, 3.0)), ((1.0, 2.0), (1.0 / 1.5, 3.0)), ((-0.5, 0.5), (-0.75, 0.75)),
        ((-0.5, 1.0), (-0.75, 1.5)), ((-2.0, -1.0), (-3.0, -1.0 / 1.5)), ((0.0, 90.0), (0.0, 100.0))])
    def test_it_has_room_by_a_factor(self, plausible: tuple[float, float], reach: tuple[float, float]) -> None:
        """A damping less by 50 % may well be less by 75 %, and not by more than there is of it."""
        found = EffectParameter("size", "N", "s", 0.0, plausible, (-100.0, 100.0), (1.0,)).reach
        assert found == pytest.approx(reach)

    def test_what_stopped_at_a_bound_would_have_gone_on(self) -> None:
        """But not at one that is nearer than the room ends: a form's coefficient may take all that it is given."""
        def share(bound: float) -> EffectParameter:
            return EffectParameter("share", "", "s", 0.0, (0.0, 1.0), (0.0, bound), (0.5,))

        assert share(1.5).stopped(1.5) and not share(1.4).stopped(1.4)
        assert not any(share(1.5).stopped(v) for v in (0.0, 1.0, 1.49))

        class Passing(Dry):
            parameters = (share(1.5),)

        assert Passing().implausible(np.array([1.5])) and not Passing().implausible(np.array([1.49]))
