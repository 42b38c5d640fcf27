"""The prediction-error engine: Jacobian, search, bounds, starts, covariance, against independent oracles."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.monte_carlo import coverage, joint_bias_test, known_bias_test
from scipy.linalg import lapack, solve_banded

from lpvid import _noise, _sensitivity
from lpvid._checks import read_only
from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.armax import ARMAX
from lpvid.identification.arx import ARX
from lpvid.identification.box_jenkins import BoxJenkins
from lpvid.identification.levenberg_marquardt import frozen_inside, frozen_radius, minimise, reduce
from lpvid.identification.output_error import OutputError
from lpvid.identification.pem_problem import Point, PredictionErrorProblem
from lpvid.identification.pem_starts import arma, autoregression, stable_polynomial
from lpvid.model.input_stage import TanhStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.record import Record
from lpvid.scheduling import Polynomial

BASIS = Polynomial("p", degree=1)


def noise_records(rng: np.random.Generator, outputs: int, lengths: tuple[int, ...] = (1100, 400)) -> list[Record]:
    return [Record({"u": rng.normal(size=n), "p": rng.uniform(-1, 1, n),
                    **{f"y{i}": rng.normal(size=n) for i in range(outputs)}}, sample_time=0.01) for n in lengths]


def problem_of(rng: np.random.Generator, kind: str, outputs: int = 1, lagged: bool = False, functions: int = 1,
               stages: bool = False, **orders: int) -> tuple[PredictionErrorProblem, Point]:
    """A problem at a random stable point far from its minimum, where nothing cancels."""
    records = noise_records(rng, outputs)
    names = tuple(f"y{i}" for i in range(outputs))
    structure = ARX(orders.get("na", 2), 2, 1, "u", names, BASIS, affine=2, lagged=lagged,
                    stage=TanhStage(0.8, 0.1) if stages else None,
                    schedule_filter=SchedulingLag(0.02, 0.05) if stages else None)
    first = structure.estimate(records)
    theta = first.parameters + 0.2 * rng.normal(size=first.parameters.size)
    theta[first.layout.table[:, 0] == 0] *= 0.4
    nc, nd = {"output": (0, 0), "box-jenkins": (2, 3), "armax": (3, 0)}[kind]
    noise = NoiseModel(kind, 0.2 * rng.normal(size=(nc, outputs, functions)) if nc else None,
                       0.2 * rng.normal(size=(nd, outputs)) if nd else None)
    model = first.layout.fill(first.model, theta).replace(noise=noise)
    problem = PredictionErrorProblem(records, first.structure, model, first.layout, noise, (stages, stages))
    problem.weights = 1.0 + np.arange(outputs)
    point = problem.point(model)
    return problem, Point(point.shared, tuple(q + 0.3 * rng.normal(size=q.shape) for q in point.past))


def weighted(problem: PredictionErrorProblem, point: Point) -> np.ndarray:
    residuals = problem.residuals(point)
    assert residuals is not None
    return np.concatenate([(e[problem.head:] * problem.weights).ravel() for e in residuals.errors])


def finite_differences(problem: PredictionErrorProblem, point: Point, step: float = 1e-6) -> np.ndarray:
    """−∂e/∂(all pasts, shared), by central differences of the residuals."""
    columns = []
    for i, past in enumerate(point.past):
        for j in range(past.size):
            ends = []
            for sign in (1, -1):
                moved = [q.copy() for q in point.past]
                moved[i].ravel()[j] += sign * step
                ends.append(weighted(problem, Point(point.shared, tuple(moved))))
            columns.append((ends[1] - ends[0]) / (2 * step))
    for j in range(point.shared.size):
        ends = []
        for sign in (1, -1):
            shared = point.shared.copy()
            shared[j] += sign * step
            ends.append(weighted(problem, replace(point, shared=shared)))
        columns.append((ends[1] - ends[0]) / (2 * step))
    return np.array(columns).T


CASES = {
    "oe": {"kind": "output"},
    "oe lagged": {"kind": "output", "lagged": True},
    "oe five lags": {"kind": "output", "na": 5},
    "oe two outputs": {"kind": "output", "outputs": 2},
    "oe finite response": {"kind": "output", "na": 0},
    "bj": {"kind": "box-jenkins"},
    "bj two outputs lagged": {"kind": "box-jenkins", "outputs": 2, "lagged": True},
    "armax": {"kind": "armax"},
    "armax varying": {"kind": "armax", "functions": 2},
    "armax varying two outputs lagged": {"kind": "armax", "functions": 2, "outputs": 2, "lagged": True},
}


@pytest.mark.parametrize("case", CASES)
def test_the_folded_jacobian_is_that_of_finite_differences(case, rng):
    problem, point = problem_of(rng, **CASES[case])
    residuals = problem.residuals(point)
    jacobian = finite_differences(problem, point)
    error = weighted(problem, point)
    factors = problem.factors(point, residuals)
    ni, n = problem.n_past, sum(problem.sizes)
    gram = np.zeros((2 * ni + n, 2 * ni + n))
    right = np.zeros(2 * ni + n)
    for i, r in enumerate(factors):
        place = np.r_[i * ni: (i + 1) * ni, 2 * ni: 2 * ni + n]
        gram[np.ix_(place, place)] += r[:, :-1].T @ r[:, :-1]
        right[place] += r[:, :-1].T @ r[:, -1]
    scale = np.linalg.norm(jacobian, axis=0)
    np.testing.assert_allclose(gram / np.outer(scale, scale), jacobian.T @ jacobian / np.outer(scale, scale), atol=1e-6)
    np.testing.assert_allclose(right / scale, jacobian.T @ error / scale, atol=1e-6 * np.linalg.norm(error))


def test_the_stages_have_sensitivities(rng):
    problem, point = problem_of(rng, "output", stages=True)
    assert problem.sizes[2] == 4
    jacobian = finite_differences(problem, point, 1e-5)
    gram = sum(r[:, problem.n_past: -1].T @ r[:, problem.n_past: -1] for r in
               problem.factors(point, problem.residuals(point)))
    shared = jacobian[:, -sum(problem.sizes):]
    scale = np.linalg.norm(shared, axis=0)
    np.testing.assert_allclose(gram / np.outer(scale, scale), shared.T @ shared / np.outer(scale, scale), atol=1e-4)


@pytest.mark.parametrize("lags", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("columns", [3, 8, 13])
def test_recursion_is_the_banded_solve(lags, columns, rng):
    rows, history = 300, max(lags, 4)
    weights = rng.uniform(-0.2, 0.2, (lags, rows))
    right = rng.normal(size=(columns, rows))
    z = np.concatenate([np.zeros((columns, history)), right], axis=1)
    _sensitivity.recur(weights, z, history, rows)
    band = np.zeros((lags + 1, rows))
    band[0] = 1.0
    for i in range(lags):
        band[i + 1, : rows - i - 1] = weights[i, i + 1:]
    by_scipy = solve_banded((lags, 0), band, right.T)
    by_lapack, info = lapack.dtbtrs(band, right.T, uplo="L", trans="N", diag="U")
    assert info == 0
    np.testing.assert_allclose(z[:, history:].T, by_scipy, atol=1e-12)
    np.testing.assert_allclose(z[:, history:].T, by_lapack, atol=1e-12)


def test_a_chunk_border_changes_nothing(rng):
    weights = rng.uniform(-0.2, 0.2, (4, 200))
    right = rng.normal(size=(7, 200))
    whole = np.concatenate([np.zeros((7, 4)), right], axis=1)
    parts = whole.copy()
    _sensitivity.recur(weights, whole, 4, 200)
    for first in (0, 77):
        last = (77, 200)[first > 0]
        part = parts[:, first: last + 4].copy()
        _sensitivity.recur(np.ascontiguousarray(weights[:, first:last]), part, 4, last - first)
        parts[:, first: last + 4] = part
    np.testing.assert_array_equal(whole, parts)


def test_eliminating_the_pasts_is_the_joint_least_squares(rng):
    problem, point = problem_of(rng, "output")
    factors = problem.factors(point, problem.residuals(point))
    shared, _ = reduce(problem, factors)
    step = np.linalg.solve(shared[:-1, :-1], shared[:-1, -1]) if shared.shape[0] == shared.shape[1] else (
        np.linalg.lstsq(shared[:, :-1], shared[:, -1], rcond=None)[0])
    jacobian = finite_differences(problem, point)
    joint = np.linalg.lstsq(jacobian, weighted(problem, point), rcond=None)[0]
    np.testing.assert_allclose(step, joint[-step.size:], rtol=1e-4, atol=1e-6)


def test_a_start_that_diverges_is_no_start(rng):
    problem, point = problem_of(rng, "output")
    shared = point.shared.copy()
    shared[problem.layout.table[:, 0] == 0] = 2.0
    free = (np.full(shared.size, -np.inf), np.full(shared.size, np.inf))
    assert minimise(problem, replace(point, shared=shared), max_iterations=3, tolerance=1e-8, bounds=free) is None


@pytest.mark.parametrize("kind", ["output", "armax", "box-jenkins"])
def test_step_down_agrees_with_eigenvalues(kind, rng):
    problem, point = problem_of(rng, kind, na=5)
    radius = frozen_radius(problem, point)
    assert frozen_inside(problem, point, radius * (1 + 1e-6))
    assert not frozen_inside(problem, point, radius * (1 - 1e-6))


def simple(rng: np.random.Generator, n: int = 800, noise: float = 0.05, slope: float = 0.2) -> Record:
    u, p, x = rng.normal(size=n), rng.uniform(-1, 1, n), np.zeros(n)
    p[:2] = -1, 1
    for k in range(1, n):
        x[k] = (0.7 + slope * p[k]) * x[k - 1] + (1 - 0.3 * p[k]) * u[k - 1]
    return Record({"u": u, "p": p, "y": x + noise * rng.normal(size=n)}, sample_time=0.01)


SETTINGS = {"na": 1, "nb": 1, "input": "u", "output": "y", "basis": BASIS}


@pytest.mark.seconds
def test_bounds_hold_and_the_rest_still_fits(rng):
    record = simple(rng)
    free = identify(record, OutputError(**SETTINGS))
    held = identify(record, OutputError(**SETTINGS, bounds={"a1[1]": (-0.6, 0.0)}))
    assert free.parameters[0] == pytest.approx(-0.7, abs=0.02)
    assert held.parameters[0] == pytest.approx(-0.6, abs=1e-12)
    assert held.training.overall.free_run.esr > free.training.overall.free_run.esr


def test_unknown_bounds_and_bad_settings_are_refused(rng):
    with pytest.raises(InputError, match="no parameter to bound 'a9'"):
        identify(simple(rng), OutputError(**SETTINGS, bounds={"a9": (0, 1)}))
    for bad in ({"starts": 0}, {"tolerance": 0}, {"initial": "guess"}, {"bounds": {"a1[1]": (1, 0)}}, {"seed": -1}):
        with pytest.raises(InputError):
            OutputError(**SETTINGS, **bad)
    with pytest.raises(InputError, match="nc"):
        ARMAX(**SETTINGS, nc=-1)


@pytest.mark.seconds
def test_the_same_seed_gives_the_same_estimate_and_progress_falls(rng):
    record, costs = simple(rng), []
    one = identify(record, OutputError(**SETTINGS, starts=2, seed=5, progress=lambda i, cost: costs.append((i, cost))))
    two = identify(record, OutputError(**SETTINGS, starts=2, seed=5))
    np.testing.assert_array_equal(one.parameters, two.parameters)
    assert [i for i, _ in costs] == list(range(1, len(costs) + 1))
    assert np.all(np.diff([c for _, c in costs]) < 0)


def test_an_interrupt_reaches_the_caller(rng):
    def stop(iteration: int, cost: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(simple(rng), OutputError(**SETTINGS, progress=stop))


def test_an_unstable_least_squares_start_is_drawn_in(rng):
    """Heavy noise on a slow resonance: the equation-error model fails, the output-error model does not."""
    n = 1500
    u, p, x = rng.normal(size=n), np.sin(np.arange(n) / 40), np.zeros(n)
    for k in range(2, n):
        x[k] = (1.96 + 0.01 * p[k]) * x[k - 1] - 0.985 * x[k - 2] + 0.1 * u[k - 1]
    record = Record({"u": u, "p": p, "y": x + 0.1 * x.std() * rng.normal(size=n)}, sample_time=0.01)
    settings = {**SETTINGS, "na": 2, "nb": 1}
    found = identify(record, OutputError(**settings))
    assert found.training.overall.free_run.fit_percent > 85  # the ceiling is 90
    first = identify(record, ARX(**settings))
    assert first.training.overall.free_run.fit_percent is None or first.training.overall.free_run.fit_percent < 60


def test_records_of_different_lengths_and_starts_count_together(rng):
    parts = [simple(rng, n, 0.02) for n in (300, 90, 700)]
    found = identify(parts, OutputError(**SETTINGS))
    np.testing.assert_allclose(found.parameters, [-0.7, -0.2, 1.0, -0.3], atol=0.02)
    assert any("3 record(s)" in n for n in found.notes)
    assert found.n_parameters == 4


def test_initial_conditions_are_found(rng):
    record = simple(rng, 300, 0.0).slice(20, 300)
    found = identify(record, OutputError(**SETTINGS))
    note = next(n for n in found.notes if "initial conditions" in n)
    value = float(note.rsplit("first record: ", 1)[1].rstrip(")"))
    assert value == pytest.approx(record["y"][0], abs=1e-3 * np.abs(record["y"]).max())
    np.testing.assert_allclose([found.model.frozen_poles([p])[0] for p in (-0.5, 0.5)], [0.6, 0.8], atol=1e-6)


def test_measured_start_leaves_the_past_alone(rng):
    found = identify(simple(rng), OutputError(**SETTINGS, initial="measured"))
    assert not any("initial conditions" in n for n in found.notes)
    np.testing.assert_allclose(found.parameters, [-0.7, -0.2, 1.0, -0.3], atol=0.03)


@pytest.mark.parametrize("structure", [OutputError(**SETTINGS, bounds={"a1[1]": (-1, 0)}),
                                       BoxJenkins(**SETTINGS, nc=1, nd=1), ARMAX(**SETTINGS, nc=1, varying_noise=True)])
def test_results_are_plain_data(structure, rng):
    found = identify(simple(rng), structure)
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["structure"]["kind"] == structure.kind
    assert data["covariance_kind"] == found.covariance_kind
    assert data["n_parameters"] == 4 + found.model.noise.vector.size
    assert type(found.model).from_dict(json.loads(json.dumps(found.model.to_dict()))).noise == found.model.noise


def test_scaling_the_output_scales_the_estimate(rng):
    record = simple(rng)
    scaled = Record({"u": record["u"], "p": record["p"], "y": 1e6 * record["y"]}, sample_time=0.01)
    one, two = (identify(r, OutputError(**SETTINGS)) for r in (record, scaled))
    np.testing.assert_allclose(two.parameters, one.parameters * [1, 1, 1e6, 1e6], rtol=1e-4)
    np.testing.assert_allclose(two.standard_errors, one.standard_errors * [1, 1, 1e6, 1e6], rtol=1e-3)


def test_innovations_and_colour_undo_each_other(rng):
    from scipy.signal import lfilter

    e = rng.normal(size=(400, 1))
    v = lfilter([1, 0.5, 0.2], [1, -0.8], e[:, 0])[:, None]
    back = np.zeros_like(e)
    c, d = read_only(np.array([0.5, 0.2]).reshape(2, 1, 1)), read_only(np.array([[-0.8]]))
    code = _noise.innovations(v, c, d, np.ones((1, 400)), False, 0, 1e9, back)
    assert code == -1
    np.testing.assert_allclose(back, e, atol=1e-10)


def test_noise_starts_know_their_own_process(rng):
    from scipy.signal import lfilter

    v = lfilter([1, 0.5], [1, -0.85], rng.normal(size=20_000))
    c, d = arma([v[:12_000], v[12_000:]], 1, 1)
    np.testing.assert_allclose([c[0], d[0]], [0.5, -0.85], atol=0.03)
    polynomial, variance = autoregression([v], 30)
    assert variance == pytest.approx(1.0, abs=0.03)
    assert np.abs(np.roots(polynomial)).max() < 1
    np.testing.assert_allclose(stable_polynomial(np.array([2.0, 0.5])), [1, -1, 0.25])


def test_monte_carlo_statistics_tell_bias_from_scatter(rng):
    truth, covariance = np.array([1.0, -2.0, 0.5]), np.diag([0.1, 0.2, 0.3]) ** 2
    draws = truth + rng.normal(size=(200, 3)) * [0.1, 0.2, 0.3]
    assert joint_bias_test(draws, truth) > 0.001
    assert known_bias_test(draws, truth, covariance) > 0.001
    assert joint_bias_test(draws, truth + np.array([0.05, 0, 0])) < 1e-4
    assert known_bias_test(draws, truth + np.array([0.05, 0, 0]), covariance) < 1e-4
    assert coverage(draws, np.tile([0.1, 0.2, 0.3], (200, 1)), truth) == pytest.approx(0.95, abs=0.03)
