"""Speed of certified gains: a sweep over rates compiles once. Times are printed, never asserted.

Run ``pytest tests/benchmarks/test_gain_speed.py -n 0 --benchmark-enable --benchmark-only``.
"""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.analysis.gain import l2_gain, l2_gains
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling

RATES = np.linspace(0.1, 4.0, 11)
QUADRATIC = Polynomial("p", degree=2)


@pytest.fixture(scope="module")
def model() -> LPVStateSpace:
    """Four states, affine in p."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=(2, 4, 4))
    a[0] -= (1.0 + np.abs(np.linalg.eigvals(a[0])).max()) * np.eye(4)
    return LPVStateSpace(a * [[[1.0]], [[0.5]]], rng.normal(size=(2, 4, 1)), rng.normal(size=(2, 1, 4)),
                         np.zeros((2, 1, 1)), Polynomial("p", degree=1), None,
                         Scheduling(("p",), (-1.0,), (1.0,)))


@pytest.mark.seconds
def test_a_sweep_of_eleven_rates(benchmark, model):
    found = benchmark(l2_gains, model, RATES.tolist(), QUADRATIC)
    assert all(g.between_grid for g in found)
    benchmark.extra_info["first_and_later_calls_s"] = [round(g.seconds, 4) for g in found]
    print(f"\nfirst call {found[0].seconds:.3f} s, later calls at most {max(g.seconds for g in found[1:]):.3f} s")


@pytest.mark.seconds
def test_a_single_gain(benchmark, model):
    found = benchmark(l2_gain, model, 1.0, QUADRATIC, trajectories=False)
    assert found.lower <= found.upper
