"""Time of output feedback: Wu 1996 from end to end, and the whole against the solver alone (ratios are printed).

    pytest tests/benchmarks/test_synthesis_speed.py --benchmark-enable --benchmark-only -n 0 -s
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from helpers.random_plants import _dynamics
from helpers.synthesis_plants import missile, plant, scherer, wu

import lpvid as lpv
from lpvid.lmi.native import Conic


def _large(order: int, parameters: int = 1) -> lpv.GeneralizedPlant:
    """Two controls, two measurements, `order` states."""
    rng = np.random.default_rng(order)
    s, n = parameters, order
    first = [1.0] + [0.0] * s

    def fixed(rows: int, columns: int, size: float = 1.0) -> np.ndarray:
        return np.array(first)[:, None, None] * size * rng.normal(size=(rows, columns))

    d12, d21 = fixed(4, 2, 0.0), fixed(2, 4, 0.0)
    d12[0, 2:], d21[0, :, 2:] = np.eye(2), np.eye(2)
    c1, b1 = fixed(4, n), fixed(n, 4)
    c1[:, 2:], b1[:, :, 2:] = 0.0, 0.0
    names = tuple("pqr"[:s])
    return plant(_dynamics(rng, n, False, s), b1, fixed(n, 2), c1, np.zeros((s + 1, 4, 4)), d12, fixed(2, n), d21,
                 lpv.Polynomial(names, 1), lpv.Scheduling(names, (-1.0,) * s, (1.0,) * s))


CASES = {"scherer": (scherer, lpv.OutputFeedback()), "missile": (missile, lpv.OutputFeedback()),
         "wu-1996": (lambda: wu(5.0), lpv.OutputFeedback(lpv.Fourier("rho", 1))),
         "n12": (lambda: _large(12), lpv.OutputFeedback()), "n16": (lambda: _large(16), lpv.OutputFeedback()),
         "n12-two-parameters": (lambda: _large(12, 2), lpv.OutputFeedback())}
SECONDS = ("missile", "wu-1996", "n12", "n16", "n12-two-parameters")
"""take seconds each; the others run by default"""


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SECONDS else n for n in CASES])
def test_synthesis(benchmark, monkeypatch, name):
    """Synthesis with verification; the solver's share is the time inside Clarabel, its own setup included."""
    solve, inside = Conic.solve, [0.0]

    def timed(self, *args):
        begun = time.perf_counter()
        answer = solve(self, *args)
        inside[0] += time.perf_counter() - begun
        return answer

    monkeypatch.setattr(Conic, "solve", timed)
    made, design = CASES[name][0](), CASES[name][1]
    totals = []

    def run():
        inside[0], begun = 0.0, time.perf_counter()
        found = lpv.synthesize(made, design)
        totals.append((time.perf_counter() - begun, inside[0]))
        return found

    result = benchmark.pedantic(run, rounds=2, warmup_rounds=1)
    assert result.solved
    whole, solver = min(totals)
    print(f"\n{name}: {whole:.2f} s, of which the solver {solver:.2f} s: ratio {whole / solver:.2f}")
