"""Statistics of the diagnosis on a toy that is no damper: every one against what it ought to be under a known truth."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_diagnosis import (
    CAUSES,
    PERIOD,
    TRUE,
    Added,
    Bent,
    Cubic,
    Dry,
    DryTwin,
    Explosive,
    LaggedConstant,
    Wave,
    Zero,
    drive,
    fitted,
    problem_of,
    record,
    seen,
)
from scipy import stats
from scipy.linalg import sqrtm
from scipy.optimize import lsq_linear
from scipy.signal import lfilter

from lpvid._bounded_steps import damped_step
from lpvid._projection import projector, without
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.localise import _after_reversal, _stretches, localise, spectrum_lines
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, covariance, refit
from lpvid.diagnosis.remainder import KNOTS, knots_of, predictable_share
from lpvid.diagnosis.screening import DETECTABLE_RATIO, ScreeningResult, candidate_change, directions, screen
from lpvid.effects.composition import Composition
from lpvid.record import Channel, Record
from lpvid.validation.regimes import bands


def noises(default: str, *slow: str) -> pytest.MarkDecorator:
    """One kind of noise by default, the others among the slow studies: each is hundreds of diagnoses."""
    return pytest.mark.parametrize("noise", [default, *(pytest.param(n, marks=pytest.mark.slow) for n in slow)])


class TestScreening:
    @pytest.mark.seconds
    @noises("ar1", "white", "proportional")
    def test_p_values_are_uniform_where_nothing_is_hidden(self, noise: str) -> None:
        rng = np.random.default_rng(20)
        smallest = []
        for _ in range(200):
            problem, fit = fitted(record(rng, noise, n=2000))
            smallest.append(min(e.p_value for e in screen(problem, fit, seen(problem, fit), rng)))
        assert stats.kstest(smallest, "uniform").pvalue > 0.001
        assert np.mean(np.array(smallest) < 0.05) < 0.10

    @pytest.mark.seconds
    def test_smallest_detectable_strength_is_detected(self) -> None:
        """At it, in white noise, √LR is on average √(10 + ln n)."""
        rng = np.random.default_rng(22)
        for cause in (Cubic(), Dry()):
            stated, reached, wanted, u = [], [], 0.0, drive(3000, rng)
            quiet = [_named(cause.name, *fitted(record(rng, u=u)), rng) for _ in range(15)]
            strength = float(np.median([e.smallest_detectable or np.inf for e in quiet]))
            for _ in range(40):
                shape = type(cause).shape
                runs = record(rng, u=u, hidden=lambda u, s=strength, f=shape: s * f(
                    Signals(PERIOD, {"u": u}, np.zeros(u.size))))
                problem, fit = fitted(runs)
                mine = _named(cause.name, problem, fit, rng)
                reached.append(np.sqrt(mine.likelihood_ratio))
                stated.append(mine.smallest_detectable or np.inf)
                wanted = np.sqrt(DETECTABLE_RATIO + np.log(problem.n_samples))
            assert np.mean(reached) == pytest.approx(wanted, rel=0.2)
            assert np.median(stated) == pytest.approx(strength, rel=0.2)

    def test_wrong_parameters_alone_are_no_cause(self, rng: np.random.Generator) -> None:
        """Dry friction seems to explain most of what a wrong p₂ leaves; beyond the sensitivities, nothing."""
        problem, composition = problem_of(record(rng, level=0.0))
        wrong = refit(problem, composition, TRUE * [1.0, 1.0, 1.15], iterations=0)
        np.testing.assert_allclose(wrong.vector, TRUE * [1.0, 1.0, 1.15])
        dry = Dry()
        moved = [m for v in dry.points(problem.signals) if (m := candidate_change(problem, wrong, dry, v)) is not None]
        raw = problem.stack(moved[0].change)
        power = float(wrong.errors @ wrong.errors)
        assert (raw @ wrong.errors) ** 2 / (raw @ raw) > 0.1 * power
        explained = max(d.gain for d in directions(problem, wrong, moved))
        assert explained < 0.01 * power

    def test_projection_is_onto_the_complement(self, rng: np.random.Generator) -> None:
        j = rng.standard_normal((400, 5)) @ np.diag([1e-8, 1.0, 1e6, 1.0, 0.0])
        basis = projector(j)
        assert basis.shape == (400, 4)
        np.testing.assert_allclose(basis.T @ basis, np.eye(4), atol=1e-10)
        rest = without(basis, rng.standard_normal(400))
        assert np.abs(j[:, :4].T @ rest / np.linalg.norm(j[:, :4], axis=0)).max() < 1e-10


def _named(name: str, problem: DiagnosisProblem, fit: Refit, rng: np.random.Generator) -> ScreeningResult:
    found = screen(problem, fit, seen(problem, fit), rng)
    return next(e for e in found if e.effect.name == name)


def once(u: np.ndarray) -> np.ndarray:
    return np.where(np.abs(np.arange(u.size) - 1262) < 30, 1.0, 1e-3 * np.sin(9 * u))


class Once(Added):
    name, title = "once", "in one block, and next to nothing elsewhere"
    shape = staticmethod(lambda s: once(s["u"]))


class TestRefit:
    def test_recovers_baseline_and_cause_without_noise(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.0, hidden=lambda u: 0.7 * np.sign(u)))
        composition = Composition(Bent(), (Dry(),))
        fit = refit(problem, composition, np.array([1.5, 2.0, 1.0, 0.1]))
        np.testing.assert_allclose(fit.vector, [*TRUE, 0.7], rtol=1e-4)

    @pytest.mark.seconds
    @noises("proportional", "white", "ar1")
    def test_intervals_cover(self, noise: str) -> None:
        rng, inside = np.random.default_rng(22), []
        truth = np.array([*TRUE, 0.7])
        composition = Composition(Bent(), (Dry(),))
        for _ in range(100):
            problem, _ = fitted(record(rng, noise, hidden=lambda u: 0.7 * np.sign(u)))
            fit = refit(problem, composition, truth)
            deviation = np.sqrt(np.diag(covariance(problem, fit)))
            inside.append(np.abs(fit.vector - truth) < 1.96 * deviation)
        covered = np.mean(inside)
        assert 0.90 <= covered <= 0.98, covered

    def test_the_covariance_corrects_for_what_a_fit_draws_from_its_own_errors(self, rng: np.random.Generator) -> None:
        """The same with matrices of samples, and its mean over white noise: σ²(JᵀJ)⁻¹."""
        block, size = np.repeat(np.arange(6), 8), 3
        jacobian = rng.standard_normal((48, size)) * np.array([1.0, 1e3, 1e-3])
        jacobian[block != 2, 2] *= 0.1  # one block determines most of it
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        leverage = jacobian @ inverse @ jacobian.T
        found, oracle = [], []
        for _ in range(400):
            noise = rng.standard_normal(48)
            errors = noise - leverage @ noise
            fit = SimpleNamespace(vector=np.zeros(size), at_bounds=lambda: np.zeros(size, dtype=bool), errors=errors,
                                  jacobian=jacobian, variance=0.0)
            scores = np.array([jacobian[b].T @ np.linalg.inv(sqrtm(np.eye(8) - leverage[np.ix_(b, b)])) @ errors[b]
                               for b in (block == k for k in range(6))])
            found.append(covariance(SimpleNamespace(block=block), fit))  # type: ignore[arg-type]
            oracle.append(inverse @ scores.T @ scores @ inverse)
        np.testing.assert_allclose(found, oracle, rtol=1e-6, atol=1e-12 * np.abs(oracle).max())
        np.testing.assert_allclose(np.diag(np.mean(found, axis=0)), np.diag(inverse), rtol=0.15)

    def test_a_number_that_one_block_determines_has_its_interval(self, rng: np.random.Generator) -> None:
        problem, composition = problem_of(record(rng, hidden=lambda u: 3 * once(u)))
        fit = refit(problem, Composition(composition.baseline, (Once(),)), np.array([*TRUE, 3.0]))
        usual = np.sqrt(fit.variance * np.diag(np.linalg.inv(fit.jacobian.T @ fit.jacobian)))
        assert 1.0 <= np.sqrt(covariance(problem, fit)[-1, -1]) / usual[-1] < 3.0

    def test_stays_inside_its_bounds(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, hidden=lambda u: 300 * np.sign(u)))
        fit = refit(problem, Composition(Bent(), (Dry(),)), np.array([*TRUE, 0.1]))
        assert fit.vector[3] == pytest.approx(100.0) and fit.at_bounds()[3]
        assert np.isnan(covariance(problem, fit)[3, 3])

    def test_a_step_that_bounds_stop_is_the_best_inside_them(self, rng: np.random.Generator) -> None:
        for _ in range(60):
            size = int(rng.integers(2, 8))
            jacobian = rng.standard_normal((60, size)) @ rng.standard_normal((size, size))
            errors, low, high = 5 * rng.standard_normal(60), -rng.uniform(0, 1, size), rng.uniform(0, 1, size)
            here = rng.uniform(0.98 * low, 0.98 * high)
            step, promised = damped_step(jacobian, errors, np.ones(errors.size), here, 0.0, low, high)
            best = lsq_linear(jacobian, errors, bounds=(low - here, high - here), method="bvls").x
            assert ((here + step >= low) & (here + step <= high)).all()
            left = [float(np.sum((errors - jacobian @ s) ** 2)) for s in (step, best)]
            assert left[0] == pytest.approx(left[1], rel=1e-6)
            assert promised == pytest.approx(float(errors @ errors) - left[0], rel=1e-6, abs=1e-9)

    def test_a_fold_sees_little_but_its_blocks(self) -> None:
        """It is where the slope of its blocks' squared errors and a hundredth of the others' vanishes."""
        problem, composition = problem_of(record(np.random.default_rng(1)))
        half, whole = refit(problem, composition, TRUE, fold=0), refit(problem, composition, TRUE)
        test = problem.in_fold(1)
        assert half.n_samples == int((~test).sum())
        weights = np.where(test, 0.01, 1.0)
        assert half.cost == pytest.approx(float(weights @ half.errors**2), rel=1e-12)

        def slope(fit: Refit) -> float:
            score = fit.jacobian.T @ (weights * fit.errors)
            return float(np.abs(score / np.sqrt(np.einsum("nk,n,nk->k", fit.jacobian, weights, fit.jacobian)
                                                * fit.variance)).max())

        assert slope(half) < 0.1 < 0.5 < slope(whole)

    def test_the_other_holds_what_a_fold_says_nothing_of(self, rng: np.random.Generator) -> None:
        """A cause that acts in one block and hardly elsewhere: without that block noise would drive it anywhere."""
        problem, composition = problem_of(record(rng, hidden=lambda u: 3 * once(u)))
        composition = Composition(composition.baseline, (Once(),))
        fit = refit(problem, composition, composition.neutral)
        for fold in (0, 1):
            assert refit(problem, composition, fit.vector, fold=fold).vector[-1] == pytest.approx(3.0, abs=0.3)


class TestRemainder:
    @pytest.mark.thinned(3, "slow", "seconds")
    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_noise_is_not_predictable(self, noise: str, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, noise, n=15000))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        share, spread = predictable_share(problem, errors, ["u"])
        assert share < 0.02 and abs(share) < 0.15 and share - 2 * spread < 0.02

    @pytest.mark.seconds
    @pytest.mark.parametrize("hidden", [lambda u: np.sign(u), lambda u: np.abs(u) * u,
                                        lambda u: np.concatenate([np.zeros(6), u[:-6]]) ** 2])
    def test_what_follows_the_input_is(self, hidden: object, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.1, n=15000, hidden=hidden))  # type: ignore[arg-type]
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        share, spread = predictable_share(problem, errors, ["u"])
        assert share - 2 * spread > 0.5

    def test_inputs_at_rest_predict_nothing(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        share, spread = predictable_share(problem, errors, ["c"])
        assert share < 2 * spread + 0.02 and np.isfinite(spread)


def test_knots_do_not_fall_on_each_other() -> None:
    even, crowded = np.linspace(-1, 1, 999), np.concatenate([np.linspace(0, 1e-3, 900), np.linspace(0, 1, 100)])
    gaps = np.diff(knots_of(even))
    assert gaps.max() < 1.01 * 2 / (KNOTS - 1) and gaps.min() > 0.99 * 2 / (KNOTS - 1)
    assert np.diff(knots_of(crowded)).max() < 2.2 / KNOTS and np.sum(knots_of(crowded) < 1e-3) > 0.4 * KNOTS
    assert knots_of(np.ones(5)).size == 1


class TestLocalise:
    def test_names_the_regime_that_is_wrong(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.05, hidden=lambda u: np.where(u < 0, u**2, 0.0)))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        places = [w.where for w in localise(problem, errors)]
        assert "u < 0" in places and "u > 0" not in places and "large |u|" in places

    def test_bands_add_up(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        tone = [np.sin(2 * np.pi * 7.0 * s.times) for s in problem.signals]
        found = {w.where: w.share for w in localise(problem, tone)}
        (band, share), = ((where, share) for where, share in found.items() if " to " in where)
        low, high = (float(x) for x in band.removesuffix(" Hz").split(" to "))
        assert low < 7.0 < high and share > 0.8

    def test_a_tone_is_a_line_that_no_input_has(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, hidden=lambda u: np.sin(2 * np.pi * 7.0 * 0.01 * np.arange(u.size))))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        found, = spectrum_lines(problem, errors)
        assert found in localise(problem, errors)
        assert found.where == "a line at 7 Hz that no input has" and found.share > 0.8
        without = [e - np.sin(2 * np.pi * 7.0 * s.times) for e, s in zip(errors, problem.signals, strict=True)]
        assert spectrum_lines(problem, without) == ()

    def test_an_offset_counts_with_its_whole_power(self, rng: np.random.Generator) -> None:
        """Mean 1 and a tone of amplitude √2 hold half of the square each; stretches left out blur it."""
        problem, _ = problem_of(record(rng))
        errors = [1 + np.sqrt(2) * np.sin(0.2 * np.pi * np.arange(s.output.size)) for s in problem.signals]
        found = {r.where: r.error_share for r in bands(_stretches(problem, errors), problem.signals[0].sample_time)}
        assert next(share for where, share in found.items() if where.startswith("0 to")) == pytest.approx(0.5, abs=0.06)

    def test_a_velocity_that_never_changes_sign(self) -> None:
        assert not _after_reversal(np.ones(40)).any()
        assert not _after_reversal(np.zeros(40)).any()
        turned = _after_reversal(np.repeat([1.0, -1.0, 1.0], 16))
        assert np.flatnonzero(turned).tolist() == [16, 17, 32, 33]


class TestDiagnosis:
    @pytest.mark.seconds
    def test_a_candidate_that_runs_away_does_no_harm(self, rng: np.random.Generator) -> None:
        """Where it explodes its derivative has no finite square: it loses by its cost, without a warning."""
        run = record(rng, hidden=lambda u: 1.2 * np.sign(u))
        problem, composition = problem_of(run)
        beyond = np.append(TRUE, 1.4)
        fit = refit(problem, Composition(composition.baseline, (Explosive(),)), beyond)
        assert np.isfinite(fit.jacobian.T @ fit.jacobian).all() and np.isfinite(fit.vector).all()
        found = diagnose([run], Bent(), (*CAUSES, Explosive()))
        assert found.verdict == "explained" and [c.name for c in found.causes] == ["dry"]

    def test_noise_of_a_recorded_input_is_not_unexplained(self, rng: np.random.Generator) -> None:
        """The true law, simulated from noisy records of one motion: all of its error is other in the other record."""
        u = drive(3000, rng)
        y = TRUE[0] * u + TRUE[1] * np.tanh(TRUE[2] * u)
        runs = []
        for name in ("a", "b"):
            clean = record(rng, level=1e-9, u=u)
            channels = {k: Channel(clean[k], clean.unit(k)) for k in ("u", "c")}
            channels["u"] = Channel(u + 0.01 * rng.standard_normal(u.size), clean.unit("u"))
            channels["y"] = Channel(y + 0.01 * rng.standard_normal(u.size), "V")
            runs.append(Record(channels, PERIOD, name=name))
        found = diagnose(runs, Bent(), (Dry(), Cubic()))
        assert found.noise_floor == pytest.approx(found.before.rmse, rel=0.05) and found.before.rmse > 0.02
        assert found.verdict == "nothing-to-explain"

    @pytest.mark.seconds
    def test_error_that_repeats_is_not_nothing(self, rng: np.random.Generator) -> None:
        """A load that is the same in both runs, and no function of the input: one run cannot show it beside noise."""
        u, load = drive(3000, rng), 0.35 * drive(3000, rng)
        runs = [record(rng, "ar1", 0.4, u=u, hidden=lambda _: load) for _ in range(2)]
        one, two = (diagnose(runs[:n], Bent(), (Wave(), Zero())) for n in (1, 2))
        assert one.verdict == "nothing-to-explain" and "a repeat of the run decides that" in one.reason
        assert one.noise["repeating"] == [0, 0]
        assert two.verdict == "unexplained" and "repeats where they do" in two.reason
        low, high = two.noise["repeating"]
        assert 0.2 < low < 0.35 < high < 0.55 and two.noise_floor == pytest.approx(0.4, rel=0.1)

    def test_names_the_cause_and_its_strength(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, "ar1", hidden=lambda u: 1.2 * np.sign(u))], Bent(), CAUSES)
        assert found.verdict in {"explained", "partly-explained"} and [c.name for c in found.causes] == ["dry"]
        gain = found.causes[0].parameters[0]
        assert gain.std is not None and abs(gain.value - 1.2) < 4 * gain.std < 0.4

    @pytest.mark.seconds
    def test_causes_come_in_the_order_of_what_they_change(self, rng: np.random.Generator) -> None:
        def hidden(u: np.ndarray) -> np.ndarray:
            return 0.8 * np.sign(u) + 0.7 * np.concatenate([np.zeros(50), u[:-50]])

        found = diagnose([record(rng, hidden=hidden)], Bent(), CAUSES)
        first, second = found.causes
        assert {first.name, second.name} == {"late", "dry"} and first.contribution > second.contribution

    @pytest.mark.seconds
    def test_nothing_hidden(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, "ar1")], Bent(), CAUSES)
        assert found.verdict == "nothing-to-explain" and found.noise["name"] == "coloured-noise"

    @pytest.mark.seconds
    def test_identical_causes_are_rivals(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, hidden=lambda u: np.sign(u))], Bent(), (*CAUSES, DryTwin()))
        assert found.verdict == "cannot-tell" and not found.causes
        assert set(found.rivals[0].names) == {"dry", "dry-twin"}

    @pytest.mark.seconds
    def test_a_cause_without_a_trace_cannot_be_told(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng)], Bent(), (*CAUSES, LaggedConstant()))
        described = {c.name: c for c in found.cannot_tell}
        assert "lagged-c" in described and described["lagged-c"].smallest_detectable is None

    def test_a_cause_outside_the_catalogue_is_refused(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, n=6000, hidden=lambda u: 1.5 * np.sign(np.sin(7 * u)) * np.abs(u))], Bent(),
                         (Dry(), Cubic()))
        assert found.verdict == "unexplained" and not found.causes

    @pytest.mark.seconds
    def test_beside_as_large_a_cause_outside_the_catalogue_none_is_named(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, n=6000, hidden=lambda u: 1.5 * np.sign(u) + 0.9 * np.cos(9 * u))], Bent(),
                         (Dry(), Cubic()))
        assert found.verdict == "unexplained" and not found.causes and not found.rivals

    @pytest.mark.seconds
    def test_the_error_of_the_baseline_is_that_of_its_least_squares_fit(self, rng: np.random.Generator) -> None:
        u = drive(6000, rng)
        slow = np.asarray(lfilter([0.01], [1.0, -0.99], u))
        given = record(rng, u=u, level=0.02, hidden=lambda u: 8 * slow / np.std(slow))
        found = diagnose([given], Bent(), (Wave(), Zero()))
        assert not found.causes and not found.stand_ins
        signals = Bent().signals(given)
        inside = Blocks.of([signals]).number[0] >= 0
        fitted = Bent().fit([Record({k: Channel(given[k][inside], "") for k in ("u", "c", "y")}, sample_time=PERIOD)])
        left = (signals.output - fitted.core(fitted.vector)(signals))[inside]
        least = float(np.mean(left**2) / np.var(signals.output[inside]))
        assert found.before.esr_training == pytest.approx(least, rel=1e-3)
        assert least < found.before.esr_held_out < 1.3 * least
        assert found.after == found.before and found.extended is not None
        kept = signals.output - found.extended.composition.predict(signals, found.extended.vector)
        assert float(np.mean(kept[inside] ** 2)) == pytest.approx(float(np.mean(left**2)), rel=1e-3)

    def test_records_about_different_means_are_each_taken_about_its_own(self, rng: np.random.Generator) -> None:
        given = [record(rng, u=drive(3000, rng) + mean) for mean in (0.0, 6.0)]
        found = diagnose(given, Bent(), (Wave(), Zero()))
        signals = [Bent().signals(r) for r in given]
        inside = [n >= 0 for n in Blocks.of(signals).number]
        fitted = Bent().fit(given)
        left = sum(float(np.sum((s.output - fitted.core(fitted.vector)(s))[m] ** 2))
                   for s, m in zip(signals, inside, strict=True))
        spread = sum(float(np.sum(m) * np.var(s.output[m])) for s, m in zip(signals, inside, strict=True))
        assert found.before.esr_training == pytest.approx(left / spread, rel=0.01)

    def test_diagnosis_json(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, hidden=lambda u: 1.2 * np.sign(u))], Bent(), (*CAUSES, LaggedConstant()))
        back = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert back["schema"] == "lpvid/diagnosis/2" and back["verdict"] == found.verdict
        assert {"baseline", "wrong", "causes", "rivals", "cannot_tell", "rejected", "extended"} <= set(back)
        assert {"name", "esr", "rmse", "noise_floor"} <= set(back["baseline"])
        assert {"training", "held_out"} == set(back["baseline"]["esr"])
        assert {"esr", "rmse", "gain_percent", "model"} <= set(back["extended"])
        assert {"name", "description", "parameters", "p_value", "delta_bic", "share_alone", "share_given_others",
                "held_out_gain"} <= set(back["causes"][0])
        assert {"name", "value", "std", "unit"} <= set(back["causes"][0]["parameters"][0])
        assert {"name", "reason", "smallest_detectable", "experiment"} <= set(back["cannot_tell"][0])
        assert all({"where", "share"} <= set(w) for w in back["wrong"])

    @pytest.mark.seconds
    def test_is_deterministic(self) -> None:
        runs = [record(np.random.default_rng(5), "ar1", hidden=lambda u: 0.8 * np.sign(u)) for _ in range(2)]
        first, second = (diagnose([r], Bent(), CAUSES).to_dict() for r in runs)
        for found in (first, second):
            del found["seconds"]
        assert first == second
