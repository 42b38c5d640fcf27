"""The state in which a record begins: exact for exact models, closed form for one state, better where models err."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.initial_state import estimate_state

TS = 0.01


def model_of(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> lpv.LPVStateSpace:
    return lpv.LPVStateSpace(a[None], b[None], c[None], np.zeros((1, c.shape[0], b.shape[1])), lpv.Polynomial(), TS)


def slow(rng: np.random.Generator, n: int = 3) -> lpv.LPVStateSpace:
    """Slow real poles, close to one another."""
    poles = 1 - rng.uniform(0.005, 0.05, n)
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    return model_of(turn @ np.diag(poles) @ turn.T, rng.normal(size=(n, 1)), rng.normal(size=(1, n)))


def run(model: lpv.LPVStateSpace, u: np.ndarray, x0: np.ndarray) -> np.ndarray:
    record = lpv.Record({"u1": u, "y1": np.zeros(len(u))}, sample_time=TS)
    return lpv.simulate(model, record, x0).output[:, 0]


def least_squares(model: lpv.LPVStateSpace, u: np.ndarray, y: np.ndarray, rows: int) -> np.ndarray:
    influence = np.vstack([model.C[0] @ np.linalg.matrix_power(model.A[0], k) for k in range(rows)])
    forced = run(model, u, np.zeros(model.order))[:rows]
    return np.linalg.lstsq(influence, y[:rows] - forced, rcond=1e-10)[0]


def test_one_state_is_the_closed_form() -> None:
    """One state, two samples: x = Σ aᵏ r/σ² / (Σ a²ᵏ/σ² + 1/P) with P and σ² written out with numpy."""
    rng = np.random.default_rng(0)
    a, n, rows = 0.98, 300, 2
    model = model_of(np.array([[a]]), np.array([[1.0]]), np.array([[1.0]]))
    u = rng.normal(size=n)
    y = run(model, u, np.array([3.0])) + 0.5 * rng.normal(size=n)
    found = estimate_state(model, np.ones((n, 1)), u[:, None], y[:, None], rows, 1e9)
    far = 200
    unit = y[:far].std()
    states = run(model, u, np.zeros(1))[:far]
    left, power = (y[:far] - states) / unit, a ** np.arange(far) / unit
    best = power @ left / (power @ power)
    sigma2 = np.sum((left - power * best) ** 2) / (far - 1)
    prior = np.mean(states**2) + np.mean(left**2) / np.mean(power**2)
    expected = (power[:rows] @ left[:rows] / sigma2) / (power[:rows] @ power[:rows] / sigma2 + 1 / prior)
    assert found[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.seconds
def test_a_model_in_error_starts_better_than_by_least_squares() -> None:
    """Forty records with coloured noise on the output, runs from 2 n samples as `simulate` takes them."""
    rng = np.random.default_rng(1)
    weighed, plain, best = [], [], []
    for _ in range(40):
        model = slow(rng)
        u, x0, n = rng.normal(size=600), rng.normal(size=3), 600
        y = run(model, u, x0)
        y = y + 0.03 * y.std() * np.convolve(rng.normal(size=n), [1, 0.6], "same")
        record = lpv.Record({"u1": u, "y1": y}, sample_time=TS)
        truth = run(model, u, x0)
        ours = lpv.simulate(model, record).output[:, 0]
        other = run(model, u, least_squares(model, u, y, model.start))
        for out, errors in ((ours, weighed), (other, plain), (run(model, u, least_squares(model, u, y, 600)), best)):
            errors.append(np.mean((out - truth) ** 2) / np.var(truth))
    assert np.median(weighed) < 0.5 * np.median(plain)
    assert np.median(weighed) > np.median(best)  # samples that it does not use would tell more


def test_an_exact_model_starts_exactly() -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        model = slow(rng)
        u, x0 = rng.normal(size=400), 5 * rng.normal(size=3)
        y = run(model, u, x0)
        out = lpv.simulate(model, lpv.Record({"u1": u, "y1": y}, sample_time=TS)).output[:, 0]
        np.testing.assert_allclose(out, y, atol=1e-6 * np.abs(y).max())


def test_without_any_input_the_free_response_counts() -> None:
    """The input reaches no state, so that the second term of P is all there is."""
    rng = np.random.default_rng(3)
    model = slow(rng)
    u, x0 = np.zeros(400), rng.normal(size=3)
    y = run(model, u, x0)
    out = lpv.simulate(model, lpv.Record({"u1": u, "y1": y}, sample_time=TS)).output[:, 0]
    np.testing.assert_allclose(out, y, atol=1e-6 * np.abs(y).max())


def test_a_longer_fit_is_plain_least_squares() -> None:
    rng = np.random.default_rng(4)
    model = slow(rng)
    u = rng.normal(size=400)
    y = run(model, u, rng.normal(size=3)) + rng.normal(size=400)
    found = estimate_state(model, np.ones((400, 1)), u[:, None], y[:, None], 200, 1e9)
    np.testing.assert_allclose(found, least_squares(model, u, y, 200), rtol=1e-8)
