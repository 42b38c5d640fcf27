"""No false promise: random plants, their loops on a fine grid and along random trajectories; the study in small."""

import numpy as np
import pytest
from helpers.promise import frozen_peak, moving_peak
from helpers.random_plants import random_plant

import lpvid as lpv
from lpvid.synthesis.result import VERDICTS


def _examine(seed: int, paths: int) -> str:
    case = random_plant(seed)
    found = lpv.synthesize(case.plant, case.design)
    assert found.verdict in VERDICTS
    if not case.reachable:
        assert found.verdict == "unstabilisable", found
    if found.controller is None:
        assert found.why and found.mend and found.gamma_verified is None
        return found.verdict
    rng = np.random.default_rng(seed)
    frozen, frequency = frozen_peak(case.plant, found.controller, rng)
    promise = min(found.gamma, found.gamma_verified)
    assert found.gamma_verified <= found.gamma <= 1.05 * found.infimum
    assert found.gamma_lower <= found.gamma_verified
    assert frozen <= promise * (1 + 1e-9)
    assert moving_peak(case.plant, found.controller, 4 * frequency, paths, rng) <= promise * (1 + 1e-6)
    return found.verdict


@pytest.mark.parametrize("seed", [2, 3, *(pytest.param(s, marks=pytest.mark.slow) for s in (4, 5, 6, 7))])
def test_a_few(seed):
    _examine(seed, 20)


@pytest.mark.slow
def test_forty():
    """Nearly all that are feasible are solved at once (the whole study: benchmarks/synthesis_study.py)."""
    verdicts = [_examine(seed, 100) for seed in range(200, 240)]
    solved, hard = verdicts.count("solved"), verdicts.count("numerical") + verdicts.count("backed-off")
    assert solved >= 0.95 * (solved + hard)
