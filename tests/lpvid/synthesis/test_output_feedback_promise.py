"""No false promise: random plants, their loops on a fine grid and along random trajectories; the study in small."""

import numpy as np
import pytest
from helpers.promise import frozen_peak, moving_peak
from helpers.random_plants import random_plant

import lpvid as lpv
from lpvid.synthesis.moderated import SLACK
from lpvid.synthesis.output_feedback_search import SOLVED
from lpvid.synthesis.result import VERDICTS

NEAR = 1.05
"""times the least bound: what the first back-offs of 1 and 3 % lead to"""


def _examine(seed: int, paths: int) -> tuple[str, float]:
    """The verdict, held against its definition, and the promised gain over the least bound (infinite without one)."""
    case = random_plant(seed)
    found = lpv.synthesize(case.plant, case.design)
    assert found.verdict in VERDICTS
    if not case.reachable:
        assert found.verdict == "unstabilisable", found
    if found.controller is None:
        assert found.why and found.mend and found.gamma_verified is None
        return found.verdict, np.inf
    rng = np.random.default_rng(seed)
    frozen, frequency = frozen_peak(case.plant, found.controller, rng)
    promise = min(found.gamma, found.gamma_verified)
    assert found.gamma_lower <= found.gamma_verified <= found.gamma <= (1 + SLACK) ** 2 * found.gamma_verified
    assert (found.verdict == "solved") == (found.gamma_verified <= (1 + SOLVED) * found.infimum)
    assert frozen <= promise * (1 + 1e-9)
    assert moving_peak(case.plant, found.controller, 4 * frequency, paths, rng) <= promise * (1 + 1e-6)
    return found.verdict, found.gamma / found.infimum


@pytest.mark.parametrize("seed", [2, *(pytest.param(s, marks=pytest.mark.slow) for s in (3, 4, 5, 6, 7))])
def test_a_few(seed):
    verdict, above = _examine(seed, 20)
    assert verdict in ("unstabilisable", "infeasible") or above <= NEAR


@pytest.mark.slow
def test_forty():
    """Nearly all that are feasible are solved at once (the whole study: benchmarks/synthesis_study.py).

    Nearly all, not all, come within 5 % of the least bound. Where nothing penalises the controls that bound asks for
    gains without limit, and back-offs of 1 and 3 % may leave no controller that rounding spares: seed 211 ends 10 %
    above, which is "solved" by its definition (12 %).
    """
    found = [_examine(seed, 100) for seed in range(200, 240)]
    verdicts = [verdict for verdict, _ in found]
    solved, hard = verdicts.count("solved"), verdicts.count("numerical") + verdicts.count("backed-off")
    assert solved >= 0.95 * (solved + hard)
    assert sum(above <= NEAR for verdict, above in found if verdict == "solved") >= 0.95 * solved
