"""LPV-ARMAX: k-step prediction by hand, consistent under moving-average equation noise."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.monte_carlo import coverage, joint_bias_test
from scipy.signal import lfilter

from lpvid.identification import identify
from lpvid.identification.armax import ARMAX
from lpvid.identification.arx import ARX
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.simulation import predict, simulate

TRUTH = np.array([-1.0, 0.3, 0.4, -0.2, 0.6, 0.3, 0.3, -0.2])
BASIS = Polynomial("p", degree=1)
SETTINGS = {"na": 2, "nb": 2, "nk": 1, "input": "u", "output": "y", "basis": BASIS}


def system(rng: np.random.Generator, n: int = 2000, slope: float = 0.0) -> Record:
    """The system of `TRUTH` with equation noise e(k) + (0.7 + slope p) e(k−1), by plain loops."""
    u, e = rng.normal(size=n), 0.1 * rng.normal(size=n)
    p = np.clip(lfilter([0.3], [1, -0.9], rng.normal(size=n)), -1, 1)
    p[:2] = -1, 1
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = ((1.0 - 0.3 * p[k]) * y[k - 1] - (0.4 - 0.2 * p[k]) * y[k - 2] + (0.6 + 0.3 * p[k]) * u[k - 1]
                + (0.3 - 0.2 * p[k]) * u[k - 2] + e[k] + (0.7 + slope * p[k]) * e[k - 1])
    return Record({"u": u, "p": p, "y": y}, sample_time=1.0)


def random_record(rng: np.random.Generator, n: int) -> Record:
    return Record({"u1": rng.normal(size=n), "p": rng.uniform(-1, 1, n), "y1": rng.normal(size=n)}, sample_time=1.0)


def study(structure, runs: int, **changes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    found = [identify(system(np.random.default_rng(r), **changes), structure) for r in range(runs)]
    return (np.array([f.parameters for f in found]), np.array([f.standard_errors for f in found]),
            np.array([f.model.noise.vector for f in found]))


@pytest.mark.seconds
def test_consistent_where_least_squares_is_not_sample():
    estimates, errors, noise = study(ARMAX(**SETTINGS, nc=1, starts=1), 12)
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert coverage(estimates, errors, TRUTH) > 0.85
    assert noise.mean() == pytest.approx(0.7, abs=0.02)
    biased, biased_errors, _ = study(ARX(**SETTINGS), 12)
    assert coverage(biased, biased_errors, TRUTH) < 0.7


@pytest.mark.slow
def test_consistent_where_least_squares_is_not():
    estimates, errors, _ = study(ARMAX(**SETTINGS, nc=1, starts=1), 100)
    biased, biased_errors, _ = study(ARX(**SETTINGS), 100)
    print(f"ARMAX: p = {joint_bias_test(estimates, TRUTH):.3f}, coverage {coverage(estimates, errors, TRUTH):.3f}; "
          f"least squares: p = {joint_bias_test(biased, TRUTH):.1e}, "
          f"coverage {coverage(biased, biased_errors, TRUTH):.3f}")
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert 0.90 <= coverage(estimates, errors, TRUTH) <= 0.98
    assert joint_bias_test(biased, TRUTH) < 1e-6


@pytest.mark.seconds
def test_noise_that_moves_with_the_scheduling_is_found():
    _, _, noise = study(ARMAX(**SETTINGS, nc=1, varying_noise=True, starts=1), 4, n=6000, slope=-0.25)
    np.testing.assert_allclose(noise.mean(axis=0), [0.7, -0.25], atol=0.03)


def by_hand(model: LPVTransferFunction, record: Record, horizon: int) -> np.ndarray:
    """Future innovations are zero; coefficients at p(k), or at p(k−i) in a lagged model."""
    y, u, p, start = record["y1"], record["u1"], record["p"], model.start
    a, b, c = model.a[:, 0, 0], model.b[:, 0, 0], model.noise.c[:, 0]
    lagged, n = model.lagged, len(record["y1"])

    def at(row: np.ndarray, k: int) -> float:
        return row[0] + (row[1] * p[k] if row.size > 1 else 0.0)

    def step(k: int, past: np.ndarray, e: np.ndarray) -> float:
        total = sum(at(b[j], k - j if lagged else k) * u[k - j] for j in range(len(b)))
        total -= sum(at(a[i], k - i - 1 if lagged else k) * past[k - i - 1] for i in range(len(a)))
        return total + sum(at(c[i], k - i - 1 if lagged else k) * e[k - i - 1] for i in range(len(c)) if k > i)

    e, out = np.zeros(n), y.copy()
    for k in range(start, n):
        e[k] = y[k] - step(k, y, e)
    for k in range(start, n):
        base = max(k - horizon + 1, start)
        past, known = y.copy(), np.where(np.arange(n) < base, e, 0.0)
        for t in range(base, k + 1):
            past[t] = step(t, past, known)
        out[k] = past[k]
    return out


@pytest.mark.parametrize("lagged", [False, True])
@pytest.mark.parametrize("horizon", [1, 3, 1000])
def test_prediction_by_hand(horizon, lagged, rng):
    noise = NoiseModel("armax", [[[0.4, 0.2]], [[0.1, -0.1]], [[0.05, 0.0]]])
    model = LPVTransferFunction.siso([[-0.8, 0.1], [0.2, 0.0]], [[0.3, 0], [1.0, 0.5]], BASIS, 1.0, lagged=lagged,
                                     noise=noise)
    record = random_record(rng, 60)
    ahead = predict(model, record, horizon).output[:, 0]
    np.testing.assert_allclose(ahead, by_hand(model, record, horizon), atol=1e-12)


def test_far_ahead_the_prediction_is_the_free_run_but_for_the_first_innovations(rng):
    """After nc samples no innovation is left, and what remains is the free run."""
    plain = LPVTransferFunction.siso([[-0.5, 0.1]], [[0, 0], [1.0, 0.5]], BASIS, 1.0)
    model = plain.replace(noise=NoiseModel("armax", [[[0.6]]]))
    record = random_record(rng, 80)
    np.testing.assert_allclose(predict(model, record, 1000).output, simulate(plain, record).output, atol=1e-12)


def test_without_noise_orders_it_is_least_squares(rng):
    record = system(rng, 600)
    one, two = (identify(record, s) for s in (ARMAX(**SETTINGS, nc=0), ARX(**SETTINGS)))  # coloured: both sandwiches
    np.testing.assert_allclose(one.parameters, two.parameters, atol=1e-8)
    np.testing.assert_allclose(one.standard_errors, two.standard_errors, rtol=1e-4)
