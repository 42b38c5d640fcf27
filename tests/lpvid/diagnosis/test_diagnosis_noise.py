"""What the diagnosis takes for noise: its level, the blocks in which it is independent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from helpers.toy_diagnosis import (
    PERIOD,
    TRUE,
    Bent,
    drive,
    record,
)

from lpvid.baselines.signals import Signals
from lpvid.baselines.stretches import cut_together
from lpvid.diagnosis.blocks import FEWEST, Blocks
from lpvid.diagnosis.noise import NoiseLevel, noise_level
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.remainder import predictable_share
from lpvid.effects.composition import Composition
from lpvid.errors import InputError
from lpvid.rounding import EXPLODED


def moved(n: int, seed: int, name: str = "record") -> Signals:
    return Signals(PERIOD, {"u": np.random.default_rng(seed).standard_normal(n)}, np.zeros(n), name)


def plain(n: int, name: str = "record") -> Signals:
    return Signals(PERIOD, {"u": np.zeros(n)}, np.zeros(n), name)


def level_of(runs: Sequence[Signals], channels: Sequence[str] = ("u",)) -> tuple[NoiseLevel, int]:
    """Of the errors that the true law has, and the samples in blocks."""
    problem = DiagnosisProblem(tuple(runs), Blocks.of(runs))
    errors = problem.errors(Composition(Bent()), np.array(TRUE))
    return noise_level(problem, channels, errors), problem.n_samples


class TestNoiseLevel:
    def test_from_records_that_repeat(self, rng: np.random.Generator) -> None:
        u = drive(4000, rng)
        for kind in ("white", "proportional"):
            runs = [Bent().signals(record(rng, kind, 0.7, u=u)) for _ in range(3)]
            found, inside = level_of(runs)
            assert found.variance == pytest.approx(0.49, rel=0.1) and found.samples == inside
            assert found.repeating[0] < 0.15

    def test_from_periods_within_a_record(self, rng: np.random.Generator) -> None:
        """As far apart as they are: half of the record later."""
        for periods, lag in ((2, "7 s"), (5, "14 s"), (6, "21 s")):
            u = np.tile(drive(700, rng), periods)
            found, _ = level_of([Bent().signals(record(rng, "white", 0.5, u=u))], ["u", "c"])
            assert found.variance == pytest.approx(0.25, rel=0.15) and f"after {lag}" in found.description

    def test_a_period_is_found_however_short_and_a_slow_start_is_none(self, rng: np.random.Generator) -> None:
        """8 Hz repeat after an eighth of a second; a hundredth of a turn is alike and no repeat."""
        t = np.arange(4000) / 400
        for motion, lag in ((np.sin(16 * np.pi * t), 50), (np.sin(0.1 * np.pi * t), 0)):
            s = Signals(1 / 400, {"u": motion}, motion, "record")
            problem = DiagnosisProblem((s,), Blocks.of([s]))
            found = noise_level(problem, ["u"], [0.3 * rng.standard_normal(t.size)])
            assert 0.35 * t.size < found.samples < 0.55 * t.size if lag else found.samples == 0
            assert found.variance is None if not lag else found.variance == pytest.approx(0.09, rel=0.1)

    @pytest.mark.parametrize("kind", ["white", "ar1"])
    def test_what_the_model_lacks_repeats_and_is_no_noise(self, kind: str, rng: np.random.Generator) -> None:
        u = drive(8000, rng)
        runs = [Bent().signals(record(rng, kind, 0.4, u=u, hidden=lambda x: 0.5 * np.sign(x))) for _ in range(2)]
        found, _ = level_of(runs)
        assert found.variance == pytest.approx(0.16, rel=0.3)
        assert 0.35 < found.repeating[0] < 0.5 < found.repeating[1]

    def test_errors_that_oppose_each_other_leave_open_how_much_repeats(self, rng: np.random.Generator) -> None:
        """Two runs with other offsets, of which a fitted law has the mean: the noise is no more than the error."""
        u, load = drive(4000, rng), 0.7 * drive(4000, rng)
        runs = tuple(Bent().signals(record(rng, level=0.1, u=u)) for _ in range(2))
        problem = DiagnosisProblem(runs, Blocks.of(runs))
        errors = [load + offset + 0.1 * rng.standard_normal(4000) for offset in (1.0, -1.0)]
        found = noise_level(problem, ["u"], errors)
        total = float(np.mean(problem.stack(errors) ** 2))
        assert found.variance is not None and 0.9 * total < found.variance <= total
        assert found.repeating[0] == 0 and 0.6 < found.repeating[1] < 0.9

    def test_few_repeats_decide_little(self, rng: np.random.Generator) -> None:
        """Four seconds of a long record are repeated: of white noise no part repeats for sure, and half of it may."""
        long = drive(30000, rng)
        found = [level_of([Bent().signals(record(rng, level=1.0, u=u)) for u in (long, long[:400])])[0].repeating
                 for _ in range(40)]
        assert sum(low > 0 for low, _ in found) <= 4 and np.median([high for _, high in found]) > 0.3

    def test_a_simulation_that_explodes_has_finite_figures(self, rng: np.random.Generator) -> None:
        runs = tuple(Bent().signals(record(rng, u=u)) for u in [drive(4000, rng)] * 2)
        errors = [rng.standard_normal(4000) for _ in range(2)]
        errors[1][2000:2100] = EXPLODED
        found = noise_level(DiagnosisProblem(runs, Blocks.of(runs)), ["u"], errors)
        assert found.variance is not None and np.isfinite(found.repeating).all()

    def test_a_part_that_differs_between_repeats_does_not_repeat(self, rng: np.random.Generator) -> None:
        """Such as that of another temperature."""
        u = drive(4000, rng)
        drifts = (np.zeros(4000), np.linspace(0.0, 2.0, 4000))
        runs = [Bent().signals(record(rng, level=0.4, u=u, hidden=lambda x, d=d: d)) for d in drifts]
        found, _ = level_of(runs)
        assert found.variance == pytest.approx(0.16 + 2 / 3, rel=0.1) and found.repeating[0] < 0.15

    def test_inputs_that_differ_a_little_change_what_the_model_states(self, rng: np.random.Generator) -> None:
        """A hundredth of the input changes the output by more than its noise, and the error by no more than that."""
        u = drive(4000, rng)
        runs = [Bent().signals(record(rng, level=0.02, u=k * u)) for k in (1.0, 1.015)]
        found, _ = level_of(runs)
        assert found.variance == pytest.approx(0.0004, rel=0.1)
        assert np.mean((runs[0].output - runs[1].output) ** 2) / 2 > 2 * 0.0004

    def test_slow_noise_does_not_repeat(self, rng: np.random.Generator) -> None:
        """At the 2.5 % of one end of the interval: of 80 pairs of runs at most six (99 %)."""
        u = drive(3000, rng)
        levels = [level_of([Bent().signals(record(rng, "ar1", 0.3, u=u)) for _ in range(2)])[0] for _ in range(80)]
        assert sum(found.repeating[0] > 0 for found in levels) <= 6

    def test_the_interval_holds_what_repeats(self, rng: np.random.Generator) -> None:
        """95 % of 80 (99 %: 70 at least), beside noise as slow as it."""
        u, load = drive(3000, rng), 0.3 * drive(3000, rng)
        runs = [[Bent().signals(record(rng, "ar1", 0.3, u=u, hidden=lambda _: load)) for _ in range(2)]
                for _ in range(80)]
        true = float(np.sqrt(np.mean(load**2)))
        found = [level_of(pair)[0].repeating for pair in runs]
        assert sum(low <= true <= high for low, high in found) >= 70

    def test_slow_noise_beside_a_fast_motion_does_not_repeat(self, rng: np.random.Generator) -> None:
        """An eighth of a second later it is the same; half of the record later it is not."""
        few = 0
        for _ in range(40):
            u = np.sin(16 * np.pi * np.arange(3000) * PERIOD)
            found, _ = level_of([Bent().signals(record(rng, "ar1", 0.3, u=u))])
            few += found.repeating[0] > 0
        assert few <= 4

    def test_none_where_nothing_repeats(self, rng: np.random.Generator) -> None:
        found, _ = level_of([Bent().signals(record(rng)) for _ in range(2)])
        assert found.variance is None and found.repeating == (0, 0)


class TestBlocks:
    @pytest.mark.parametrize("sizes", [(3000,), (900, 2500, 400), (15000, 15000)])
    def test_cover_and_alternate(self, sizes: tuple[int, ...]) -> None:
        blocks = Blocks.of([plain(n) for n in sizes])
        assert blocks.count >= FEWEST and 0.4 <= blocks.length <= 2.0
        np.testing.assert_array_equal(np.unique(np.concatenate(blocks.number)), np.arange(-1, blocks.count))
        if len(sizes) == 1:
            np.testing.assert_array_equal(blocks.fold, blocks.turn)
        for k, number in enumerate(blocks.number):
            own = blocks.turn[np.unique(number)[1:]]
            np.testing.assert_array_equal(own, (np.arange(own.size) + k) % 2)
        inside = np.concatenate(blocks.number)
        assert np.ptp(np.bincount(inside[inside >= 0])) == 0
        for number in blocks.number:
            inside = number[number >= 0]
            assert np.all(np.diff(inside) >= 0) and inside.size > 0.75 * number.size - 200
            edges = np.flatnonzero(np.diff(number) > 0)
            assert np.all(number[edges] == -1), "neighbours have a gap between them"

    @pytest.mark.parametrize(("sizes", "folds"), [((900, 2500, 400, 1500), (0, 1, 0, 0)), ((3000, 900), None)])
    def test_several_records_are_of_one_fold_each_unless_one_is_most_of_the_data(self, sizes, folds) -> None:
        whole = [moved(n, n) for n in sizes]
        stretches = cut_together([(s, a, a + 350) for s in whole for a in (0, s.n_samples - 350)],
                                 [(0.0, 1.0)] * 2 * len(sizes), 60)
        blocks = Blocks.of(whole)
        if folds is None:
            assert blocks.halves == "alternating blocks" and set(blocks.fold[:5]) == {0, 1}
            return
        assert blocks.halves == "alternating records"
        for number, fold in zip(blocks.number, folds, strict=True):
            assert set(blocks.fold[np.unique(number[number >= 0])]) == {fold}
        joined = Blocks.of([stretches])
        assert joined.halves == "alternating records"
        for k in range(len(sizes)):  # two stretches of every record
            of_record = joined.number[0][700 * k: 700 * (k + 1)]
            assert np.ptp(joined.fold[np.unique(of_record[of_record >= 0])]) == 0

    def test_pieces_of_a_record_and_runs_of_a_test_are_no_folds(self) -> None:
        """One would predict the other, however wrong a model is elsewhere."""
        pieces = Blocks.of([moved(2000, 0, "run#1"), moved(2000, 1, "run#2")])
        runs = Blocks.of([moved(2000, 0), moved(2000, 0)])
        assert pieces.halves == runs.halves == "alternating blocks"
        np.testing.assert_array_equal(pieces.turn, np.arange(pieces.count) % 2)
        np.testing.assert_array_equal(*np.split(runs.turn, 2))

    @pytest.mark.parametrize("seeds", [[0] * 10, [k // 2 for k in range(10)]], ids=["one test", "five tests twice"])
    def test_many_runs_of_one_block_are_in_either_fold(self, seeds: list[int]) -> None:
        blocks = Blocks.of([moved(70, seed) for seed in seeds])
        assert blocks.count == 10
        for half in (blocks.fold, blocks.turn):
            assert 3 <= half.sum() <= 7

    def test_what_memorises_is_tested_in_time(self, rng: np.random.Generator) -> None:
        """An error that is no function of the input, the same in two runs of fifteen blocks: one shows the other."""
        u, load = drive(2990, rng), drive(2990, rng)
        runs = [Bent().signals(record(rng, u=u)) for _ in range(2)]
        problem = DiagnosisProblem(tuple(runs), Blocks.of(runs))
        assert problem.blocks.count == 30 and predictable_share(problem, [load, load], ["u"])[0] < 0.3

    def test_sums(self) -> None:
        """Of ones, the samples of each block; of columns, column by column."""
        signals = (plain(1200), plain(1300))
        problem = DiagnosisProblem(signals, Blocks.of(signals))
        stacked = problem.stack([np.column_stack([np.ones(s.n_samples), s.times]) for s in signals])
        sizes = np.bincount(problem.block)
        np.testing.assert_array_equal(problem.block_sums(stacked[:, 0]), sizes)
        times = [problem.stack([s.times for s in signals])[problem.block == b].sum() for b in range(sizes.size)]
        np.testing.assert_allclose(problem.block_sums(stacked)[:, 1], times, rtol=1e-12)

    def test_too_little_data(self) -> None:
        with pytest.raises(InputError, match="too little data"):
            Blocks.of([plain(300)])

    @pytest.mark.parametrize(("hertz", "enough"), [(40.0, True), (1.5, False)])
    def test_a_short_record_counts_by_the_periods_of_its_motion(self, hertz: float, enough: bool) -> None:
        """Two seconds of 40 Hz are eighty periods, of 1.5 Hz three: the same time says much or little."""
        period, n = 1e-3, 2000
        signals = Signals(period, {"velocity": np.cos(2 * np.pi * hertz * period * np.arange(n))}, np.ones(n), "short")
        if not enough:
            with pytest.raises(InputError, match=r"at least 8 blocks of 0\.32"):
                Blocks.of([signals])
            return
        blocks = Blocks.of([signals])
        assert blocks.count >= FEWEST and 1 / hertz <= blocks.length < 0.4

    def test_folds_of_blocks_shorter_than_a_period_have_strokes_of_either_direction(self) -> None:
        """Five periods make eight blocks; by turns each fold would see little but compression or rebound."""
        period, n, hertz = 1e-3, 2000, 2.5
        v = np.cos(2 * np.pi * hertz * period * np.arange(n))
        blocks = Blocks.of([Signals(period, {"velocity": v}, np.ones(n), "short")])
        assert blocks.count == FEWEST and 0.5 / hertz <= blocks.length < 1 / hertz
        for fold in (0, 1):
            share = np.mean(v[np.isin(blocks.number[0], np.flatnonzero(blocks.fold == fold))] > 0)
            assert 0.3 < share < 0.7
