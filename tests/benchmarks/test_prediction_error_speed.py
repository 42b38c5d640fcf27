"""Speed of output-error estimates against their limit: the banded solves. Ratios are printed, never asserted.

Run ``pytest tests/benchmarks/test_prediction_error_speed.py -n 0 --benchmark-enable --benchmark-only -s``.
"""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from helpers.timing import best_of
from scipy.linalg import lapack
from scipy.signal import lfilter

from lpvid._threads import single_thread
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.output_error import OutputError
from lpvid.identification.pem_problem import Point, PredictionErrorProblem
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.simulation import simulate

pytestmark = pytest.mark.seconds

BASIS = Polynomial("p", degree=2)
SETTINGS = {"na": 4, "nb": 4, "nk": 1, "input": "u", "output": "y", "basis": BASIS}


def system(n: int) -> Record:
    """A stable fourth-order LPV system of 24 parameters with coloured output noise."""
    rng = np.random.default_rng(3)
    p = np.clip(np.cumsum(rng.normal(scale=0.05, size=n)), -1, 1)
    u = rng.normal(size=n)
    a = [[-1.8, 0.10, 0.02], [1.3, -0.1, 0.0], [-0.5, 0.05, 0.01], [0.08, 0, 0]]
    b = [[0, 0, 0], [0.4, 0.1, 0.0], [0.1, -0.3, 0.05], [0.05, 0, 0], [0.02, 0.01, 0]]
    model = LPVTransferFunction.siso(a, b, BASIS, 1 / 512)
    x = simulate(model, Record({"u1": u, "p": p}, sample_time=1 / 512), "zero").output[:, 0]
    noise = lfilter([1], [1, -0.8], rng.normal(size=n))
    return Record({"u": u, "p": p, "y": x + 0.1 * x.std() * noise / noise.std()}, sample_time=1 / 512)


@pytest.fixture(scope="module")
def record() -> Record:
    return system(100_000)


def problem_of(record: Record) -> tuple[PredictionErrorProblem, Point]:
    first = identify(record, ARX(**SETTINGS))
    problem = PredictionErrorProblem(
        [record], first.structure, first.model, first.layout, NoiseModel("output"), (False, False)
    )
    return problem, problem.point(first.model)


def banded(problem: PredictionErrorProblem, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """The system of equation sheet 5.8 with 24 right-hand sides, as LAPACK takes it."""
    model = problem.model_at(point.shared)
    phi = problem.drive(model)[0][1]
    n = phi.shape[1]
    band = np.ones((5, n), order="F")
    for i in range(4):
        band[i + 1, : n - i - 1] = (model.a[i, 0, 0] @ phi)[i + 1:]
    return band, np.asfortranarray(np.random.default_rng(0).normal(size=(n, 24)))


def test_gauss_newton_step_against_its_banded_solves(record, benchmark):
    problem, point = problem_of(record)
    band, right = banded(problem, point)

    def step() -> None:
        residuals = problem.residuals(point)
        assert residuals is not None
        problem.factors(point, residuals)

    with single_thread():
        rounds = 7 if benchmark.enabled else 1
        solves = best_of(lambda: lapack.dtbtrs(band, right, uplo="L", trans="N", diag="U"), rounds)
        ours = best_of(step, rounds)
        benchmark(step)
    print(f"\nGauss-Newton step (run, 24 sensitivities, QR) on 1e5 samples: {1e3 * ours:.1f} ms; "
          f"24 banded solves by dtbtrs: {1e3 * solves:.1f} ms; ratio {ours / solves:.2f} (aim 3)")


def test_output_error_of_24_parameters_on_1e5_samples(record, benchmark):
    found = benchmark.pedantic(lambda: identify(record, OutputError(**SETTINGS)), rounds=1, iterations=1)
    if benchmark.disabled:
        return
    start = time.perf_counter()
    identify(record, OutputError(**SETTINGS))
    print(f"\nLPV-OE, 24 parameters, 1e5 samples: {time.perf_counter() - start:.2f} s (aim 10 s), "
          f"free-run fit {found.fit:.2f} %")


def peak(n: int) -> float:
    problem, point = problem_of(system(n))
    residuals = problem.residuals(point)
    assert residuals is not None
    problem.factors(point, residuals)
    tracemalloc.start()
    problem.factors(point, residuals)
    size = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return size / 2**20


def test_memory_does_not_grow_with_samples_times_parameters():
    """24 columns of 4e4 more samples would be 7.7 MB; a few signals are 1 MB."""
    small, large = peak(10_000), peak(50_000)
    print(f"\nJacobian folded into R: peak {small:.1f} MB at 1e4 samples, {large:.1f} MB at 5e4")
    assert large - small < 4.0
