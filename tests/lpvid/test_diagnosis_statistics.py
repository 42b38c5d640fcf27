"""Statistics of the diagnosis on a toy that is no damper: every one against what it ought to be under a known truth."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import lsq_linear
from scipy.signal import lfilter
from toy_diagnosis import (
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
    coloured,
    drive,
    problem_of,
    record,
)

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.blocks import FEWEST, Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.deciding import (
    BLOCKS_BETTER,
    MAJORITY,
    Folds,
    _enough,
    explained_share,
    judge,
    out_of_fold,
    stands_apart,
    surer_share,
)
from lpvid.diagnosis.effect import Effect, EffectParameter
from lpvid.diagnosis.engine import diagnose
from lpvid.diagnosis.localise import localise
from lpvid.diagnosis.noise import FLOOR, Whitening, noise_level
from lpvid.diagnosis.problem import Problem, projector, without
from lpvid.diagnosis.refitting import Refit, _step, covariance, refit
from lpvid.diagnosis.remainder import predictable_share
from lpvid.diagnosis.rivals import DISTINCT, SEPARATED, _unwhitened, in_both, separation
from lpvid.diagnosis.screening import DETECT, Evidence, directions, moves, saturated, screen
from lpvid.diagnosis.selection import BIC_GAIN, Search
from lpvid.diagnosis.signals import Core, Signals
from lpvid.diagnosis.steadiness import is_there
from lpvid.errors import InputError
from lpvid.record import Channel, Record


def plain(n: int, name: str = "record") -> Signals:
    return Signals(PERIOD, {"u": np.zeros(n)}, np.zeros(n), name)


def whitened(*records: Record) -> tuple[Problem, Refit]:
    """Problem and baseline fit with the noise's colour found as the engine finds it."""
    problem, composition = problem_of(*records)
    first = refit(problem, composition, composition.neutral)
    left = saturated(problem, first, moves(problem, first, CAUSES))
    problem = problem.with_whitening(Whitening.of(left, problem.blocks.mask()))
    return problem, refit(problem, composition, first.vector)


class TestWhitening:
    @pytest.mark.parametrize("poles", [(0.95,), (0.6,), (0.9 * np.exp(0.5j), 0.9 * np.exp(-0.5j)), (0.97, 0.5)])
    def test_recovers_an_autoregression(self, poles: tuple, rng: np.random.Generator) -> None:
        a = np.real(np.poly(poles))
        e = np.asarray(lfilter([1.0], a, 2.5 * rng.standard_normal(40500)))[500:]
        found = Whitening.of([e], [np.ones(e.size, bool)])
        turns = np.exp(-1j * np.linspace(0.05, np.pi, 60))
        power = found.level**2 / np.abs(np.polyval(found.coefficients[::-1], turns)) ** 2
        exact = 2.5**2 / np.abs(np.polyval(a[::-1], turns)) ** 2
        np.testing.assert_allclose(power, exact + FLOOR * np.var(e), rtol=0.25)
        assert found.level == pytest.approx(2.5, rel=0.12)
        assert found.is_coloured

    def test_leaves_white_noise_alone(self, rng: np.random.Generator) -> None:
        orders = [Whitening.of([rng.standard_normal(3000)], [np.ones(3000, bool)]).order for _ in range(40)]
        assert sum(o > 0 for o in orders) <= 3

    def test_what_it_makes_is_white(self, rng: np.random.Generator) -> None:
        e = coloured(20000, rng, np.zeros(0))
        w = Whitening.of([e], [np.ones(e.size, bool)]).apply(e)[50:]
        lags = [float(w[k:] @ w[:-k]) / float(w @ w) for k in range(1, 21)]
        assert np.abs(lags).max() < 4.5 / np.sqrt(w.size)

    def test_gaps_do_not_colour_it(self, rng: np.random.Generator) -> None:
        """Samples outside the masks count for nothing, however large."""
        e = coloured(20000, rng, np.zeros(0))
        mask = (np.arange(e.size) // 200) % 3 > 0
        found = Whitening.of([np.where(mask, e, 1e6)], [mask])
        assert found.coefficients[1] == pytest.approx(-0.95, abs=0.03)


class TestNoiseLevel:
    def test_from_records_that_repeat(self, rng: np.random.Generator) -> None:
        u = drive(4000, rng)
        for kind in ("white", "proportional"):
            runs = [Bent().signals(record(rng, kind, 0.7, u=u)) for _ in range(3)]
            found = noise_level(runs, ["u"], [np.ones(4000, bool)] * 3)
            assert found.variance == pytest.approx(0.49, rel=0.1) and found.samples == 12000

    def test_from_periods_within_a_record(self, rng: np.random.Generator) -> None:
        u = np.tile(drive(700, rng), 6)
        s = Bent().signals(record(rng, "white", 0.5, u=u))
        found = noise_level([s], ["u", "c"], [np.ones(4200, bool)])
        assert found.variance == pytest.approx(0.25, rel=0.1) and "7 s" in found.says

    def test_whatever_the_model_misses(self, rng: np.random.Generator) -> None:
        """A hidden cause repeats with the input and is no noise."""
        u = drive(4000, rng)
        runs = [Bent().signals(record(rng, level=0.4, u=u, hidden=lambda x: 5 * np.sign(x))) for _ in range(2)]
        assert noise_level(runs, ["u"], [np.ones(4000, bool)] * 2).variance == pytest.approx(0.16, rel=0.15)

    @pytest.mark.parametrize("pole", [0.0, 0.95])
    def test_how_sure_it_is(self, pole: float) -> None:
        u, found = drive(3000, np.random.default_rng(0)), []
        for seed in range(60):
            rng = np.random.default_rng(seed)
            pair = [Signals(PERIOD, {"u": u}, np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(3300)))[300:])
                    for _ in range(2)]
            found.append(noise_level(pair, ["u"], [np.ones(3000, bool)] * 2))
        whitening = Whitening(np.array([1.0, -pole]), 1.0)
        assert whitening.memory == pytest.approx((1 + pole**2) / (1 - pole**2), rel=1e-3)
        errors = [level.error(whitening) for level in found]
        assert np.std([level.variance for level in found]) == pytest.approx(np.mean(errors), rel=0.3)

    def test_none_where_nothing_repeats(self, rng: np.random.Generator) -> None:
        runs = [Bent().signals(record(rng)) for _ in range(2)]
        assert noise_level(runs, ["u"], [np.ones(3000, bool)] * 2).variance is None


class TestBlocks:
    @pytest.mark.parametrize("sizes", [(3000,), (900, 2500, 400), (15000, 15000)])
    def test_cover_and_alternate(self, sizes: tuple[int, ...]) -> None:
        blocks = Blocks.of([plain(n) for n in sizes])
        assert blocks.count >= FEWEST and 0.4 <= blocks.length <= 2.0
        np.testing.assert_array_equal(np.unique(np.concatenate(blocks.number)), np.arange(-1, blocks.count))
        np.testing.assert_array_equal(blocks.fold, np.arange(blocks.count) % 2)
        assert np.ptp(blocks.sizes()) == 0
        for number in blocks.number:
            inside = number[number >= 0]
            assert np.all(np.diff(inside) >= 0) and inside.size > 0.75 * number.size - 200
            edges = np.flatnonzero(np.diff(number) > 0)
            assert np.all(number[edges] == -1), "neighbours have a gap between them"
        masks = [blocks.mask(f) for f in (None, 0, 1)]
        for whole, even, odd in zip(*masks, strict=True):
            np.testing.assert_array_equal(whole, even | odd)
            assert not np.any(even & odd)

    def test_sums(self) -> None:
        blocks = Blocks.of([plain(1200), plain(1300)])
        ones = [np.ones(1200), np.ones(1300)]
        np.testing.assert_array_equal(blocks.sums(ones), blocks.sizes())

    def test_too_little_data(self) -> None:
        with pytest.raises(InputError, match="too little data"):
            Blocks.of([plain(300)])


class TestScreening:
    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_p_values_are_uniform_where_nothing_is_hidden(self, noise: str) -> None:
        rng = np.random.default_rng(20)
        smallest = []
        for _ in range(200):
            problem, composition = problem_of(record(rng, noise, n=2000))
            first = refit(problem, composition, composition.neutral)
            _, evidence, _ = Search.begin(problem, first, CAUSES, rng, lambda text: None)
            smallest.append(min(e.p_value for e in evidence))
        assert stats.kstest(smallest, "uniform").pvalue > 0.001
        assert np.mean(np.array(smallest) < 0.05) < 0.10

    @pytest.mark.parametrize("noise", ["white", "ar1"])
    def test_smallest_detectable_strength_is_detected(self, noise: str) -> None:
        """At it, √LR is on average √(10 + ln n)."""
        rng = np.random.default_rng(21)
        for cause in (Cubic(), Dry()):
            said, reached, wanted, u = [], [], 0.0, drive(3000, rng)
            quiet = [_named(cause.name, *whitened(record(rng, noise, u=u)), rng) for _ in range(15)]
            strength = float(np.median([e.smallest_detectable or np.inf for e in quiet]))
            for _ in range(40):
                shape = type(cause).shape
                runs = record(rng, noise, u=u, hidden=lambda u, s=strength, f=shape: s * f(
                    Signals(PERIOD, {"u": u}, np.zeros(u.size))))
                problem, fit = whitened(runs)
                mine = _named(cause.name, problem, fit, rng)
                reached.append(np.sqrt(mine.likelihood_ratio))
                said.append(mine.smallest_detectable or np.inf)
                wanted = np.sqrt(DETECT + np.log(problem.n_samples))
            assert np.mean(reached) == pytest.approx(wanted, rel=0.2)
            assert np.median(said) == pytest.approx(strength, rel=0.2)

    def test_wrong_parameters_alone_are_no_cause(self, rng: np.random.Generator) -> None:
        """Dry friction seems to explain most of what a wrong p₂ leaves; beyond the sensitivities, nothing."""
        problem, composition = problem_of(record(rng, level=0.0))
        wrong = refit(problem, composition, TRUE * [1.0, 1.0, 1.15], iterations=0)
        np.testing.assert_allclose(wrong.vector, TRUE * [1.0, 1.0, 1.15])
        moved = moves(problem, wrong, (Dry(),))
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


def _named(name: str, problem: Problem, fit: Refit, rng: np.random.Generator) -> Evidence:
    found = screen(problem, fit, directions(problem, fit, moves(problem, fit, CAUSES)), rng)
    return next(e for e in found if e.effect.name == name)


class TestRefit:
    def test_recovers_baseline_and_cause_without_noise(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.0, hidden=lambda u: 0.7 * np.sign(u)))
        composition = Composition(Bent(), (Dry(),))
        fit = refit(problem, composition, np.array([1.5, 2.0, 1.0, 0.1]))
        np.testing.assert_allclose(fit.vector, [*TRUE, 0.7], rtol=1e-4)

    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_intervals_cover(self, noise: str) -> None:
        rng, inside = np.random.default_rng(22), []
        truth = np.array([*TRUE, 0.7])
        composition = Composition(Bent(), (Dry(),))
        for _ in range(100):
            problem, _ = whitened(record(rng, noise, hidden=lambda u: 0.7 * np.sign(u)))
            fit = refit(problem, composition, truth)
            deviation = np.sqrt(np.diag(covariance(problem, fit)))
            inside.append(np.abs(fit.vector - truth) < 1.96 * deviation)
        covered = np.mean(inside)
        assert 0.90 <= covered <= 0.98, covered

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
            step, promised = _step(jacobian, errors, here, 0.0, low, high)
            best = lsq_linear(jacobian, errors, bounds=(low - here, high - here), method="bvls").x
            assert ((here + step >= low) & (here + step <= high)).all()
            left = [float(np.sum((errors - jacobian @ s) ** 2)) for s in (step, best)]
            assert left[0] == pytest.approx(left[1], rel=1e-6)
            assert promised == pytest.approx(float(errors @ errors) - left[0], rel=1e-6, abs=1e-9)

    def test_a_fold_sees_only_its_blocks(self, rng: np.random.Generator) -> None:
        problem, composition = problem_of(record(rng))
        half = refit(problem, composition, TRUE, fold=0)
        test = problem.in_fold(1)
        assert half.n_samples == int((~test).sum())
        assert half.cost == pytest.approx(float(half.errors[~test] @ half.errors[~test]), rel=1e-12)


class TestBothMetrics:
    @pytest.mark.parametrize(("apart", "share", "certain", "says"), [
        (50.0, 0.0, 0.0, 50.0), (-50.0, 0.0, 0.0, -50.0),  # the error in the output's unit is silent
        (50.0, 0.4, 4.0, -20.0), (-50.0, -0.4, -4.0, 20.0),  # it surely says otherwise
        (50.0, -0.4, -4.0, 50.0), (-50.0, 0.4, 4.0, -50.0),  # it agrees
        (50.0, 0.05, 2.0, 0.0), (-50.0, -0.05, -2.0, 0.0),  # it seems to say otherwise: nobody can tell
        (5.0, 0.05, 2.0, 0.0), (50.0, 0.4, 0.5, 50.0)])
    def test_who_decides(self, apart: float, share: float, certain: float, says: float) -> None:
        assert in_both(apart, share, certain) == says

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
        """A cause of a twentieth of the noise's power, of which an extended model leaves nothing."""
        plain, surer = [], []
        for seed in range(12):
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
            before, after = out_of_fold(problem, bare), out_of_fold(problem, fit)
            plain.append(explained_share(problem, before, after, level.variance, 0.0)[0])
            surer.append(surer_share(problem, before, after, level, white, 0.0)[0])
        assert np.std(plain) > 3 * np.std(surer) and np.mean(surer) == pytest.approx(1.0, abs=0.15)

    def test_a_worse_model_explains_nothing(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        small, large = (Folds(np.zeros(problem.n_samples), np.full(problem.n_samples, e)) for e in (1.0, 1.1))
        for floor in (None, 0.5, 2.0):
            assert explained_share(problem, small, large, floor, 0.0)[0] == 0.0
            assert explained_share(problem, large, small, floor, 0.0)[0] > 0.0


class TestRemainder:
    @pytest.mark.parametrize("noise", ["white", "ar1", "proportional"])
    def test_noise_is_not_predictable(self, noise: str, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, noise, n=15000))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        share, spread = predictable_share(problem, errors, ["u"])
        assert share < 0.02 and abs(share) < 0.15 and share - 2 * spread < 0.02

    @pytest.mark.parametrize("hidden", [lambda u: np.sign(u), lambda u: np.abs(u) * u,
                                        lambda u: np.concatenate([np.zeros(6), u[:-6]]) ** 2])
    def test_what_follows_the_input_is(self, hidden: object, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.1, n=15000, hidden=hidden))  # type: ignore[arg-type]
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        share, spread = predictable_share(problem, errors, ["u"])
        assert share - 2 * spread > 0.5


class TestLocalise:
    def test_names_the_regime_that_is_wrong(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng, level=0.05, hidden=lambda u: np.where(u < 0, u**2, 0.0)))
        errors = [s.output - Bent().core(TRUE)(s) for s in problem.signals]
        places = [w.where for w in localise(problem, errors)]
        assert "u < 0" in places and "u > 0" not in places and "large |u|" in places

    def test_bands_add_up(self, rng: np.random.Generator) -> None:
        problem, _ = problem_of(record(rng))
        tone = [np.sin(2 * np.pi * 3.0 * s.times) for s in problem.signals]
        found = {w.where: w.share for w in localise(problem, tone)}
        assert found["1 to 5 Hz"] > 0.8


class TestDiagnosis:
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
        """The true law, simulated from noisy records of one motion: the output's own repeats agree far better."""
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
        assert found.noise_floor == pytest.approx(0.01, rel=0.1) and found.before.rmse > 0.02
        assert found.verdict == "nothing-to-explain"

    def test_names_the_cause_and_its_strength(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, "ar1", hidden=lambda u: 1.2 * np.sign(u))], Bent(), CAUSES)
        assert found.verdict == "explained" and [c.name for c in found.causes] == ["dry"]
        gain = found.causes[0].parameters[0]
        assert gain.std is not None and abs(gain.value - 1.2) < 4 * gain.std < 0.4

    def test_causes_come_in_the_order_of_what_they_change(self, rng: np.random.Generator) -> None:
        """Noise that wanders lets a search find a faint jump before a great slow change."""
        def hidden(u: np.ndarray) -> np.ndarray:
            return 0.8 * np.sign(u) + 0.7 * np.concatenate([np.zeros(50), u[:-50]])

        found = diagnose([record(rng, "ar1", n=6000, hidden=hidden)], Bent(), CAUSES)
        late, dry = found.causes
        assert (late.name, dry.name) == ("late", "dry") and late.contribution > 1.1 * dry.contribution
        assert late.delta_bic > 2 * dry.delta_bic, "by the likelihood it is the other way round"

    def test_nothing_hidden(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, "ar1")], Bent(), CAUSES)
        assert found.verdict == "nothing-to-explain" and found.noise["name"] == "coloured-noise"

    def test_identical_causes_are_rivals(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, hidden=lambda u: np.sign(u))], Bent(), (*CAUSES, DryTwin()))
        assert found.verdict == "cannot-tell" and not found.causes
        assert set(found.rivals[0].names) == {"dry", "dry-twin"} and found.rivals[0].similarity > 0.999

    def test_a_cause_without_a_trace_cannot_be_told(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng)], Bent(), (*CAUSES, LaggedConstant()))
        told = {c.name: c for c in found.cannot_tell}
        assert "lagged-c" in told and told["lagged-c"].smallest_detectable is None

    def test_a_cause_outside_the_catalogue_is_refused(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, n=6000, hidden=lambda u: 1.5 * np.sign(np.sin(7 * u)) * np.abs(u))], Bent(),
                         (Dry(), Cubic()))
        assert found.verdict == "unexplained" and not found.causes

    def test_what_explains_a_part_only_stands_in_and_is_not_named(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, n=6000, hidden=lambda u: 1.5 * np.sign(u) + 0.9 * np.cos(9 * u))], Bent(),
                         (Dry(), Cubic()))
        assert found.verdict == "unexplained" and not found.causes and not found.rivals
        assert found.stand_ins == ("dry",) and found.gain_percent > 20.0
        assert found.to_dict()["extended"]["stand_ins"] == ["dry"]
        assert "dry stands in for a cause that is not known" in repr(found)

    def test_diagnosis_json(self, rng: np.random.Generator) -> None:
        found = diagnose([record(rng, hidden=lambda u: 1.2 * np.sign(u))], Bent(), (*CAUSES, LaggedConstant()))
        back = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert back["schema"] == "lpvid/diagnosis/1" and back["verdict"] == found.verdict
        assert {"baseline", "wrong", "causes", "rivals", "cannot_tell", "rejected", "extended"} <= set(back)
        assert {"name", "esr", "rmse", "noise_floor"} <= set(back["baseline"])
        assert {"training", "held_out"} == set(back["baseline"]["esr"])
        assert {"esr", "rmse", "gain_percent", "model"} <= set(back["extended"])
        assert {"name", "description", "parameters", "p_value", "delta_bic", "share_alone", "share_given_others",
                "held_out_gain"} <= set(back["causes"][0])
        assert {"name", "value", "std", "unit"} <= set(back["causes"][0]["parameters"][0])
        assert {"name", "reason", "smallest_detectable", "experiment"} <= set(back["cannot_tell"][0])
        assert all({"where", "share"} <= set(w) for w in back["wrong"])

    def test_is_deterministic(self) -> None:
        runs = [record(np.random.default_rng(5), "ar1", hidden=lambda u: 0.8 * np.sign(u)) for _ in range(2)]
        first, second = (diagnose([r], Bent(), CAUSES).to_dict() for r in runs)
        for found in (first, second):
            del found["seconds"]
        assert first == second


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

    def asked(self, rng: np.random.Generator, size: float, quiet_share: float) -> bool:
        """Whether a change of this size stands apart, of which the data hold so much where the strong one is quiet."""
        problem, _ = problem_of(record(rng))
        n = problem.n_samples
        bursts = np.sin(np.arange(n) / 40) > 0.3
        noise, change = rng.standard_normal(n), size * np.sin(np.arange(n) / 7)
        errors = noise - (1 - quiet_share) * change * ~bursts  # the fit believes in it everywhere
        fit = SimpleNamespace(errors=errors, variance=1.0)
        strong = SimpleNamespace(without=SimpleNamespace(errors=errors + 20.0 * bursts * np.sin(np.arange(n) / 5)))
        faint = SimpleNamespace(without=SimpleNamespace(errors=errors + change))
        return stands_apart(SimpleNamespace(problem=problem, fit=fit), faint, strong)  # type: ignore[arg-type]

    def test_one_of_its_own_stands_apart(self, rng: np.random.Generator) -> None:
        assert self.asked(rng, 0.6, 1.0)

    def test_the_small_print_of_the_strong_one_does_not(self, rng: np.random.Generator) -> None:
        assert not self.asked(rng, 0.6, 0.0) and not self.asked(rng, 0.6, 0.4)

    def test_one_that_noise_drowns_does_not(self, rng: np.random.Generator) -> None:
        assert not self.asked(rng, 0.02, 1.0)


class TestBlocksInWhichACauseMustHelp:
    def test_one_that_dwarfs_the_noise_in_most(self) -> None:
        assert _enough(np.full(30, 400.0)) == BLOCKS_BETTER

    def test_a_faint_one_in_as_many_as_it_would_by_chance(self, rng: np.random.Generator) -> None:
        """Held-out gains of a true change of energy E: 2 (d·e) + E, drawn; 5 % of them help in fewer blocks."""
        energy, draws = np.full(40, 1.5), 4000
        gains = 2 * np.sqrt(energy) * rng.standard_normal((draws, energy.size)) + energy
        enough = _enough(energy)
        assert MAJORITY < enough < BLOCKS_BETTER
        assert np.mean((gains > 0).mean(axis=1) < enough) < 0.08

    def test_never_fewer_than_a_clear_majority(self) -> None:
        assert _enough(np.full(12, 1e-6)) == MAJORITY


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

    def search(self, scatter: float, rng: np.random.Generator, *beside: Effect) -> tuple[Search, list, list]:
        """A wave of .2 V, or of a gain with such a mean and so many times that spread, by stretches of 100 samples."""
        u = drive(6000, rng)
        gains = rng.standard_normal(60)
        gains = 0.2 * np.repeat((gains - gains.mean()) * scatter + 1.0, 100)
        problem, _ = problem_of(record(rng, hidden=lambda u: gains * np.sin(9 * u), u=u))
        composition = Composition(Bent(), beside)
        first = refit(problem, composition, composition.neutral)
        found = directions(problem, first, moves(problem, first, (Wave(),)))
        return Search(problem, first, (Wave(),), rng, lambda text: None), screen(problem, first, found, rng), found

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
        told = judge(search, search.fit.composition.effects[-1], out_of_fold(search.problem, search.fit), ())
        assert told.effect.name == "wave" and not told.minor
        assert "its strength is not surely different from none" in told.objections
