"""Time of one composition of every effect on 30 s at 512 Hz: pytest tests/benchmarks -n 0 --benchmark-enable."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from helpers.effect_signals import guo, road_like  # type: ignore[import-not-found]

from lpvid.effects.effect import Effect
from quartercar.effects import CATALOGUE

SAMPLES = 15360


@pytest.mark.parametrize("effect", CATALOGUE, ids=str)
def test_one_composition(effect: Effect, benchmark: BenchmarkFixture) -> None:
    s, baseline = road_like(0, SAMPLES), guo()
    if effect.missing((s,)) or effect.applies(baseline, (s,)) is not None:
        pytest.skip("the effect does not apply to a damper on these signals")
    run = effect.compose(baseline.core(baseline.vector), effect.points((s,))[-1], baseline)
    force = benchmark(run, s)
    assert force.shape == (SAMPLES,) and np.isfinite(force).all()
