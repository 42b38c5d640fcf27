"""Speed against the limit: a bare chunked QR, a hand-written loop, lstsq. Ratios are printed, never asserted.

Run ``pytest tests/benchmarks -n 0 --benchmark-enable --benchmark-only -s``.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from helpers.timing import best_of
from numba import njit
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

from lpvid.identification.arx import ARX
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.simulation import simulate


@pytest.fixture(scope="module")
def record(request: pytest.FixtureRequest) -> Record:
    """A million samples of a stable fourth-order LPV system, 24 parameters; a tenth where nothing is timed."""
    n = 1_000_000 if request.config.getoption("benchmark_enable") else 100_000
    rng = np.random.default_rng(3)
    p = np.clip(np.cumsum(rng.normal(scale=0.05, size=n)), -1, 1)
    u = rng.normal(size=n)
    basis = Polynomial("p", degree=2)
    a = [[-1.8, 0.10, 0.02], [1.3, -0.1, 0.0], [-0.5, 0.05, 0.01], [0.08, 0, 0]]
    b = [[0, 0, 0], [0.4, 0.1, 0.0], [0.1, -0.3, 0.05], [0.05, 0, 0], [0.02, 0.01, 0]]
    model = LPVTransferFunction.siso(a, b, basis, 1 / 512)
    clean = Record({"u1": u, "p": p}, sample_time=1 / 512)
    y = simulate(model, clean, "zero").output[:, 0] + 0.01 * rng.normal(size=n)
    return Record({"u": u, "p": p, "y": y}, sample_time=1 / 512)


def build(record: Record) -> np.ndarray:
    """[X y] with 24 columns of X, column order."""
    u, p, y = record["u"], record["p"], record["y"]
    z = (p - 0.5 * (p.max() + p.min())) / (0.5 * np.ptp(p))
    n = u.size
    out = np.empty((n - 4, 25), order="F")
    for i in range(4):
        for m in range(3):
            out[:, 3 * i + m] = -y[3 - i: n - 1 - i] * z[4:] ** m
            out[:, 12 + 3 * i + m] = u[3 - i: n - 1 - i] * z[4:] ** m
    out[:, 24] = y[4:]
    return out


def bare_qr(xy: np.ndarray) -> np.ndarray:
    """Chunked QR by dgeqrf on a prebuilt regressor: R of [R; chunk], one chunk after the other."""
    work = np.zeros((25, 25 + 1024))
    above, space = np.triu(np.ones((25, 25), dtype=bool), 1), int(lapack.dgeqrf_lwork(1049, 25)[0])
    with threadpool_limits(1, user_api="blas"):
        for i in range(0, len(xy), 1024):
            rows = min(1024, len(xy) - i)
            work[:, 25: 25 + rows], work[:, 25 + rows:] = xy[i: i + rows].T, 0.0
            lapack.dgeqrf(work.T, lwork=space, overwrite_a=1)
            work[:, :25][above] = 0.0
    return np.triu(work[:, :25].T)


@njit(cache=True)
def hand_loop(a, b, u, p, centre, half, y):
    """The 24-coefficient recursion written out by hand."""
    for k in range(4, y.size):
        z = (p[k] - centre) / half
        z2 = z * z
        total = 0.0
        for i in range(4):
            total += (b[i, 0] + b[i, 1] * z + b[i, 2] * z2) * u[k - 1 - i]
            total -= (a[i, 0] + a[i, 1] * z + a[i, 2] * z2) * y[k - 1 - i]
        y[k] = total


STRUCTURE = ARX(na=4, nb=4, input="u", output="y", basis=Polynomial("p", degree=2))


@pytest.mark.seconds
def test_identification_against_the_limit(benchmark, record: Record) -> None:
    with threadpool_limits(1, user_api="blas"):
        ours = best_of(lambda: STRUCTURE.estimate([record]))
        building = best_of(lambda: build(record))
        xy = build(record)
        qr = best_of(lambda: bare_qr(xy))
        dense = best_of(lambda: np.linalg.lstsq(xy[:, :24], xy[:, 24], rcond=None), 1)
    found = STRUCTURE.estimate([record])
    theta, *_ = np.linalg.lstsq(xy[:, :24], xy[:, 24], rcond=None)
    worst = float(np.max(np.abs(found.parameters - theta)) / np.max(np.abs(theta)))
    bound = max(1e-9, 50 * np.finfo(float).eps * found.condition)
    tracemalloc.start()
    STRUCTURE.estimate([record])
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    print(f"\nidentify {record.n_samples} samples, 24 parameters, building included: {ours:.3f} s"
          f"\n  build {building:.3f} s + bare chunked QR {qr:.3f} s: ratio {ours / (building + qr):.2f} (limit 1.5)"
          f"\n  build + lstsq {building + dense:.3f} s: {(building + dense) / ours:.1f} times faster (at least 3)"
          f"\n  peak extra memory {peak:.1f} MB (limit 100)"
          f"\n  parameters against lstsq: {worst:.1e} relative (limit {bound:.1e})")
    assert worst < bound
    assert peak < 100
    benchmark(lambda: STRUCTURE.estimate([record]))


def test_free_run_against_a_hand_loop(benchmark, record: Record) -> None:
    model = STRUCTURE.estimate([record]).model
    a, b = np.ascontiguousarray(model.a[:, 0, 0]), np.ascontiguousarray(model.b[1:, 0, 0])
    centre, half = float(model.box.centre[0]), float(model.box.half_width[0])
    y = record["y"].copy()

    def by_hand() -> None:
        hand_loop(a, b, record["u"], record["p"], centre, half, y)

    ours, loop = best_of(lambda: simulate(model, record), 5), best_of(by_hand, 5)
    print(f"\nfree run of {record.n_samples} samples: {ours:.4f} s, hand-compiled loop {loop:.4f} s: "
          f"ratio {ours / loop:.2f} (limit 2)")
    np.testing.assert_allclose(simulate(model, record).output[:, 0], y, rtol=1e-9, atol=1e-9)
    benchmark(lambda: simulate(model, record))
