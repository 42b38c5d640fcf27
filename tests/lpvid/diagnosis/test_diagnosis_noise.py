"""What the diagnosis takes for noise: its colour, its level, the blocks in which it is independent."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.toy_diagnosis import (
    PERIOD,
    Bent,
    coloured,
    drive,
    record,
)
from scipy.signal import lfilter

from lpvid.diagnosis.blocks import FEWEST, Blocks
from lpvid.diagnosis.noise import FLOOR, Whitening, noise_level
from lpvid.diagnosis.signals import Signals
from lpvid.errors import InputError


def plain(n: int, name: str = "record") -> Signals:
    return Signals(PERIOD, {"u": np.zeros(n)}, np.zeros(n), name)


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
        assert found.variance == pytest.approx(0.25, rel=0.1) and "7 s" in found.description

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
