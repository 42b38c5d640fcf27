"""Refined instrumental variables: exact without noise, unbiased with it, and never worse than where they start."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.monte_carlo import coverage, joint_bias_test

from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.arma import ARMA, fit_arma, largest_root, reflected
from lpvid.identification.arx import ARX
from lpvid.identification.refined_iv import RefinedIV
from lpvid.identification.refined_iv_problem import IVProblem
from lpvid.identification.refined_iv_search import search
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Spline
from lpvid.simulation import predict

# a_1, a_2 and b_1, b_2 over 1, p, p^2: the LPV Box-Jenkins example of Laurain, Gilson, Tóth & Garnier 2010
A = np.array([[1.0, -0.5, -0.1], [0.5, -0.7, -0.1]])
B = np.array([[0.5, -0.4, 0.01], [0.2, -0.3, -0.02]])
RED = ([], [-1.0, 0.2])
OE = RefinedIV(2, 2, 1, "u", "y", Polynomial("p", 2))
BJ = RefinedIV(2, 2, 1, "u", "y", Polynomial("p", 2), "box-jenkins", 0, 2)
LEAST = ARX(2, 2, 1, "u", "y", Polynomial("p", 2))


def arma(rng: np.random.Generator, n: int, c: list[float], d: list[float]) -> np.ndarray:
    """D v = C e by a plain loop, settled."""
    e, v = rng.normal(size=n + 300), np.zeros(n + 300)
    for k in range(3, n + 300):
        v[k] = e[k] + sum(x * e[k - i - 1] for i, x in enumerate(c)) - sum(x * v[k - i - 1] for i, x in enumerate(d))
    return v[300:]


def record(rng: np.random.Generator, n: int = 2000, snr: float | None = 15.0, colour=([], []), name="r") -> Record:
    """The example system with output noise of a signal-to-noise ratio [dB]; None for none."""
    p, u = 0.5 * np.sin(0.35 * np.pi * np.arange(n)) + 0.5, rng.uniform(-1, 1, n)
    powers = np.column_stack([np.ones(n), p, p**2])
    a, b, x = powers @ A.T, powers @ B.T, np.zeros(n)
    for k in range(2, n):
        x[k] = -a[k, 0] * x[k - 1] - a[k, 1] * x[k - 2] + b[k, 0] * u[k - 1] + b[k, 1] * u[k - 2]
    v = np.zeros(n)
    if snr is not None:
        v = arma(rng, n, *colour)
        v *= x.std() / v.std() * 10 ** (-snr / 20)
    return Record({"u": u, "p": p, "y": x + v, "x": x}, sample_time=1.0, name=name)


def truth(basis: Polynomial) -> np.ndarray:
    """The true parameters over a normalised quadratic basis, by expanding (centre + half_width z)^m."""
    c, h = basis.centre[0], basis.half_width[0]
    expand = np.array([[1, c, c**2], [0, h, 2 * c * h], [0, 0, h**2]])
    return np.concatenate([expand @ row for row in (*A, *B)])


# -- exactness and structure --------------------------------------------------------------------------------------
@pytest.mark.parametrize("structure", [OE, BJ])
def test_exact_without_noise(rng, structure) -> None:
    found = identify([record(rng, 500, None, name="a"), record(rng, 300, None, name="b")], structure)
    np.testing.assert_allclose(found.parameters, truth(found.model.basis), atol=1e-9)
    assert found.model.noise.kind == structure.noise
    assert any("converged" in n for n in found.notes)


def test_exact_with_stages_affine_terms_lagged_and_two_inputs(rng) -> None:
    n, stage, lag = 900, TanhStage(v0=0.7), SchedulingLag(tau_rise=0.03, tau_fall=0.01)
    u, w, p = rng.normal(size=n), rng.normal(size=n), rng.uniform(0, 2, n)
    slow = lag.apply(p[:, None], 0.01)[:, 0]
    shaped, y = np.tanh(u / 0.7), np.zeros(n)
    for k in range(2, n):
        y[k] = ((0.9 - 0.2 * slow[k - 1]) * y[k - 1] - 0.2 * y[k - 2] + (0.5 + slow[k - 1]) * u[k - 1]
                + 0.8 * shaped[k - 1] - 0.3 * slow[k - 1] * w[k - 1] + 0.4 - 0.1 * slow[k])
    data = Record({"u": u, "w": w, "p": p, "y": y}, sample_time=0.01)
    found = identify(data, RefinedIV(2, 1, 1, ("u", "w"), "y", Polynomial("p", 1), affine=1, lagged=True, stage=stage,
                                     schedule_filter=lag))
    assert found.training.overall.free_run.esr < 1e-18
    assert found.model.input_stage == stage
    assert found.model.scheduling_stage == lag
    at = found.model.coefficients([1.5])
    np.testing.assert_allclose(at[0].ravel(), [-0.6, 0.2], atol=1e-8)
    np.testing.assert_allclose(at[1][1, 0], [2.0, -0.45, 0.8], atol=1e-8)
    np.testing.assert_allclose(at[2].ravel(), [0.25], atol=1e-8)


def test_a_basis_without_the_constant(rng) -> None:
    """Splines sum to one: straight segments hold any affine dependence."""
    n = 3000
    u, p, x = rng.normal(size=n), rng.uniform(0, 1, n), np.zeros(n)
    for k in range(1, n):
        x[k] = (0.9 - 0.4 * p[k]) * x[k - 1] + u[k - 1]
    data = Record({"u": u, "p": p, "y": x + 0.5 * rng.normal(size=n)}, sample_time=1.0)
    found = identify(data, RefinedIV(1, 1, 1, "u", "y", Spline("p", segments=2, order=1)))
    error = found.parameters[:3] + np.array([0.9, 0.7, 0.5])
    assert np.all(np.abs(error) < 4 * found.standard_errors[:3])
    assert "converged" in found.notes[0]


def test_outputs_that_do_not_couple(rng) -> None:
    one, two = record(rng, 1500, 20.0), record(rng, 1500, 25.0)
    both = one.with_channel("w", two["u"]).with_channel("z", two["y"])
    found = identify(both, RefinedIV(2, 2, 1, ("u", "w"), ("y", "z"), Polynomial("p", 2)))
    assert not np.any(found.model.a[:, 0, 1]) and not np.any(found.model.a[:, 1, 0])
    want = truth(found.model.basis)
    for output in (0, 1):
        mine = found.layout.table[:, 2] == output
        true = np.zeros(mine.sum())
        true[:6], true[6 + 6 * output: 12 + 6 * output] = want[:6], want[6:]
        z = (found.parameters[mine] - true) / found.standard_errors[mine]
        assert np.abs(z).max() < 4
    assert predict(found.model, both).output.shape == (1500, 2)


def test_coupled_outputs_are_refused(rng) -> None:
    n = 3000
    u, w, p = rng.normal(size=n), rng.normal(size=n), rng.uniform(0, 1, n)
    y, z = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (0.7 - 0.5 * p[k]) * z[k - 1] + u[k - 1]
        z[k] = 0.6 * z[k - 1] + (0.5 + 0.5 * p[k]) * w[k - 1]
    data = Record({"u": u, "w": w, "p": p, "y": y + 0.1 * rng.normal(size=n), "z": z + 0.1 * rng.normal(size=n)},
                  sample_time=1.0)
    with pytest.raises(InputError, match="output 'y' depends on the past of 'z'"):
        identify(data, RefinedIV(1, 1, 1, ("u", "w"), ("y", "z"), Polynomial("p", 1)))


@pytest.mark.parametrize(("arguments", "stated"), [
    ({"noise": "white"}, "noise must be one of"), ({"nc": 1}, "no C and D"),
    ({"noise": "box-jenkins"}, "needs nc or nd"), ({"iterations": 0}, "at least 1"), ({"na": -1}, "na must be"),
    ({"tolerance": 0.0}, "tolerance must be positive"),
])
def test_bad_arguments(arguments, stated) -> None:
    with pytest.raises(InputError, match=stated):
        RefinedIV(**{"input": "u", "output": "y", **arguments})


# -- noise ---------------------------------------------------------------------------------------------------------
def test_units_do_not_matter(rng) -> None:
    data = record(rng, 1500, 15.0, RED)
    scaled = data.with_channel("u", 1e3 * data["u"]).with_channel("y", 1e-6 * data["y"])
    scaled = scaled.with_channel("p", 50 * data["p"])
    one, two = identify(data, BJ), identify(scaled, BJ)
    factor = np.where(one.layout.table[:, 0] == 0, 1.0, 1e-9)
    np.testing.assert_allclose(two.parameters, one.parameters * factor, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(two.standard_errors, one.standard_errors * factor, rtol=1e-3)


def test_prediction_uses_the_noise_model(rng) -> None:
    data = record(rng, 4000, 15.0, RED)
    found = identify(data, BJ)
    step = found.training.overall.one_step
    innovation = np.var(data["y"] - data["x"]) / (1.2 / ((1 - 0.2) * (1.2**2 - 1)))  # variance of this AR(2)
    assert step.rmse**2 == pytest.approx(innovation, rel=0.08)
    assert step.rmse < 0.7 * found.training.overall.free_run.rmse
    assert found.model.noise_covariance[0, 0] == pytest.approx(innovation, rel=0.08)
    np.testing.assert_allclose(found.model.noise.d.ravel(), RED[1], atol=0.06)


def test_arma_of_a_known_process(rng) -> None:
    series = [arma(rng, 6000, [0.6], [-0.8]), arma(rng, 4000, [0.6], [-0.8])]
    found = fit_arma(series, 1, 1)
    assert found.c[0] == pytest.approx(0.6, abs=4 * 0.011)  # asymptotic standard errors 0.010 and 0.008
    assert found.d[0] == pytest.approx(-0.8, abs=4 * 0.009)
    assert np.var(found.whiten(series[0])) == pytest.approx(1.0, abs=0.08)
    e = rng.normal(size=50)
    np.testing.assert_allclose(ARMA(np.array([0.6]), np.array([-0.8])).whiten(_coloured(e)), e, atol=1e-12)


def _coloured(e: np.ndarray) -> np.ndarray:
    v = np.zeros_like(e)
    for k in range(len(e)):
        v[k] = e[k] + (0.6 * e[k - 1] + 0.8 * v[k - 1] if k else 0.0)
    return v


def test_reflection_keeps_the_spectrum(rng) -> None:
    tail = np.array([-2.5, 1.7, -0.6])
    assert largest_root(tail) > 1 > largest_root(reflected(tail))
    z = np.exp(1j * np.linspace(0.1, 3, 7))
    ratio = np.abs(np.polyval([1, *tail], z)) / np.abs(np.polyval([1, *reflected(tail)], z))
    np.testing.assert_allclose(ratio, ratio[0])


# -- Monte Carlo ---------------------------------------------------------------------------------------------------
def study(structure: RefinedIV, runs: int, n: int, colour) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors and standard errors of the estimate, and errors of least squares, from `runs` records of one system."""
    errors, deviations, least = [], [], []
    for seed in range(runs):
        data = [record(np.random.default_rng(seed), n, 15.0, colour)]
        found = structure.estimate(data)
        want = truth(found.model.basis)
        errors.append(found.parameters - want)
        deviations.append(found.standard_errors)
        least.append(LEAST.estimate(data).parameters - want)
    return np.array(errors), np.array(deviations), np.array(least)


CASES = [(OE, ([], [])), (BJ, RED), (OE, RED)]
NAMES = ["OE, white output noise", "BJ, AR(2) noise", "OE, AR(2) noise"]


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(("structure", "colour"), CASES, ids=NAMES)
def test_unbiased_sample(structure, colour) -> None:
    errors, deviations, least = study(structure, 16, 2000, colour)
    zero = np.zeros(12)
    assert joint_bias_test(errors[:, :6], zero[:6]) > 1e-3
    assert joint_bias_test(least[:, :6], zero[:6]) < 1e-6
    assert 0.85 < coverage(errors, deviations, zero) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("structure", "colour"), CASES, ids=NAMES)
def test_unbiased(structure, colour, capsys) -> None:
    errors, deviations, least = study(structure, 100, 4000, colour)
    zero = np.zeros(12)
    p_value, share = joint_bias_test(errors, zero), coverage(errors, deviations, zero)
    with capsys.disabled():
        print(f"\n{structure.noise}, noise {colour}: p {p_value:.3f}, 95 % intervals cover {100 * share:.1f} %")
        print("  bias, refined IV:", errors.mean(axis=0).round(4))
        print("  bias, LPV-ARX   :", least.mean(axis=0).round(4))
    assert p_value > 1e-3
    assert 0.90 < share < 0.98
    assert joint_bias_test(least, zero) < 1e-10


# -- robustness ----------------------------------------------------------------------------------------------------
def random_record(rng: np.random.Generator, order: int, snr: float, n: int = 1200) -> Record:
    """A random stable system: poles drawn at both ends of p, coefficients in between; slow p, coloured input."""
    largest, low, high = 2.0, np.zeros(order), np.zeros(order)
    while largest > 0.98:  # stable in between too
        ends = []
        for _ in range(2):
            roots = rng.uniform(0.3, 0.95, order) * np.exp(1j * rng.uniform(0, np.pi, order))
            roots = np.concatenate([roots[: order // 2], roots[: order // 2].conj(), np.abs(roots[order - order % 2:])])
            ends.append(np.real(np.poly(roots))[1:])
        low, high = ends
        largest = max(largest_root((1 - s) * low + s * high) for s in np.linspace(0, 1, 21))
    b = rng.normal(size=(2, order))
    p = 0.5 + 0.5 * np.sin(2 * np.pi * np.arange(n) / rng.uniform(60, 400))
    u, x = arma(rng, n, [], [-0.5]), np.zeros(n)
    for k in range(order, n):
        x[k] = (-((1 - p[k]) * low + p[k] * high) @ x[k - order: k][::-1]
                + ((1 - p[k]) * b[0] + p[k] * b[1]) @ u[k - order: k][::-1])
    v = arma(rng, n, [0.4], [-0.7]) if rng.random() < 0.5 else rng.normal(size=n)
    return Record({"u": u, "p": p, "y": x + v * x.std() / v.std() * 10 ** (-snr / 20)}, sample_time=0.01)


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("seed", range(10))
def test_never_worse_than_its_start(seed) -> None:
    rng = np.random.default_rng(1000 + seed)
    order, snr = 2 + seed % 4, (10, 20, 30, 40)[seed % 4]
    data = random_record(rng, order, snr)
    basis = Polynomial("p", 1)
    start = identify(data, ARX(order, order, 1, "u", "y", basis)).training.overall.free_run
    for more in ({}, {"noise": "box-jenkins", "nc": 1, "nd": 1}):
        found = identify(data, RefinedIV(order, order, 1, "u", "y", basis, **more))
        esr = found.training.overall.free_run.esr
        assert np.isfinite(found.parameters).all() and np.isfinite(found.covariance).all()
        assert esr is not None and np.isfinite(esr)
        assert start.esr is None or esr <= start.esr * (1 + 1e-9)
        assert 100 * (1 - np.sqrt(esr)) > 100 * (1 - np.sqrt(1 / (1 + 10 ** (snr / 10)))) - 3  # of the true model's fit
        assert any("refined IV" in note for note in found.notes)


def test_a_start_that_diverges_is_drawn_in(rng) -> None:
    """From poles twice as large, whose run leaves all bounds, the search arrives where it does otherwise."""
    data = [record(rng, 2000, 20.0)]
    start = LEAST.estimate(data)
    problem = IVProblem(data, start.structure, start.model, start.structure.layout(1))
    usual = search(problem, start.parameters, None, 100, 1e-9)
    out = start.parameters.copy()
    out[:3], out[3:6] = 2 * out[:3], 4 * out[3:6]
    assert problem.run(out) is None
    found = search(problem, out, None, 100, 1e-9)
    assert found is not None and usual is not None
    assert found.origin and not usual.origin
    np.testing.assert_allclose(found.theta, usual.theta, atol=1e-5)


def test_least_squares_far_off_is_no_obstacle() -> None:
    """A slow resonance in slow noise of its own power: least squares explains a sixth of what can be explained."""
    rng = np.random.default_rng(3)
    n = 3000
    u, p, x = rng.normal(size=n), rng.uniform(0, 1, n), np.zeros(n)
    for k in range(2, n):
        x[k] = 1.9 * x[k - 1] - (0.95 - 0.02 * p[k]) * x[k - 2] + 0.1 * u[k - 1]
    v = arma(rng, n, [0.9], [-0.99])
    data = Record({"u": u, "p": p, "y": x + v * x.std() / v.std()}, sample_time=0.01)
    least = identify(data, ARX(2, 1, 1, "u", "y", Polynomial("p", 1))).training.overall.free_run
    found = identify(data, RefinedIV(2, 1, 1, "u", "y", Polynomial("p", 1))).training.overall.free_run
    assert least.esr > 0.8 > 0.52 > found.esr  # the noise alone is 0.5


def test_a_piece_shorter_than_the_lags_counts_as_its_samples() -> None:
    """Folds of a repeating record leave short pieces. Oracle: one of three samples beside a long one changes little."""
    rng = np.random.default_rng(5)
    series = rng.normal(size=3000)
    for k in range(1, series.size):
        series[k] += 0.8 * series[k - 1]
    alone, beside = fit_arma([series], 0, 6), fit_arma([series, series[:3].copy()], 0, 6)
    np.testing.assert_allclose(beside.d, alone.d, atol=0.01)
