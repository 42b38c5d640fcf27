"""The state-space search against finite differences, invariance, known systems, and the gyroscope."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.state_space_systems import StateSpaceSystem
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.condition import split_tail
from lpvid.errors import InputError
from lpvid.identification.layout import ParameterCloud
from lpvid.identification.state_space_error import StateSpaceError
from lpvid.identification.state_space_layout import StateSpaceLayout
from lpvid.identification.state_space_search import SearchData, bounded, evaluate, gauge, linearise, refine
from lpvid.identification.subspace import Subspace

EVERYTHING = ("A", "B", "C", "D", "state_offset", "output_offset", "observer_gain")


def random_model(rng: np.random.Generator, order: int = 2) -> lpv.LPVStateSpace:
    """Two inputs, two outputs, one variable, every matrix present."""
    def draw(*shape: int) -> np.ndarray:
        return 0.3 * rng.normal(size=(2, *shape))

    return lpv.LPVStateSpace(draw(order, order), draw(order, 2), draw(2, order), draw(2, 2),
                             lpv.Polynomial("p", degree=1), 0.1, None, draw(order), draw(2), draw(order, 2),
                             inputs=(lpv.Signal("u1"), lpv.Signal("u2")), outputs=(lpv.Signal("y1"), lpv.Signal("y2")))


def random_record(rng: np.random.Generator, n: int) -> lpv.Record:
    return lpv.Record({"u1": rng.normal(size=n), "u2": rng.normal(size=n), "p": rng.uniform(-1, 1, n),
                       "y1": rng.normal(size=n), "y2": 5 * rng.normal(size=n)}, sample_time=0.1)


def transformed(model: lpv.LPVStateSpace, t: np.ndarray, shift: np.ndarray) -> lpv.LPVStateSpace:
    """The same behaviour in coordinates T x + shift."""
    back = np.linalg.inv(t)
    a, c = t @ model.A @ back, model.C @ back
    assert model.state_offset is not None and model.output_offset is not None and model.observer_gain is not None
    f, g = (t @ model.state_offset[:, :, None])[:, :, 0] - a @ shift, model.output_offset - c @ shift
    f[0] += shift
    return model.replace(A=a, B=t @ model.B, C=c, state_offset=f, output_offset=g,
                         observer_gain=t @ model.observer_gain)


# -- the linearisation -----------------------------------------------------------------------------------------------
def test_sensitivities_agree_with_finite_differences(rng: np.random.Generator) -> None:
    model, records = random_model(rng), [random_record(rng, 40), random_record(rng, 30)]
    layout, data = StateSpaceLayout.full(model, EVERYTHING), SearchData.of(records, model)
    theta, now = layout.read(model), evaluate(model, data)

    def errors(values: np.ndarray) -> np.ndarray:  # each with its own best initial state, which the QR projects out
        return np.concatenate([-(e * data.weight).ravel() for e in evaluate(layout.fill(model, values), data).errors])

    step = 1e-5
    jacobian = np.column_stack([(errors(theta + step * d) - errors(theta - step * d)) / (2 * step)
                                for d in np.eye(theta.size)])
    factor = linearise(model, layout, data, now.starts)
    # the variable-projection Jacobian differs from the projected one by a term along the projected-out space, so the
    # gradients are equal, and so are the products for directions in which that term vanishes
    np.testing.assert_allclose(factor[:-1, :-1].T @ factor[:-1, -1], jacobian.T @ errors(theta), atol=1e-5)
    assert factor[:, -1] @ factor[:, -1] == pytest.approx(now.cost, rel=1e-9)


def test_jacobian_entry_by_entry_from_a_given_state(rng: np.random.Generator) -> None:
    from lpvid._state_space_kernels import predictor_run, sensitivity_rows
    from lpvid.identification.state_space_layout import stacks

    model, record = random_model(rng), random_record(rng, 25)
    layout, data = StateSpaceLayout.full(model, EVERYTHING), SearchData.of([record], model)
    (phi, u, y), nx = data.pieces[0], model.order
    x0 = rng.normal(size=nx)

    def output(z: np.ndarray) -> np.ndarray:
        out, none = np.zeros_like(y), np.zeros((0, 2, nx))
        matrices = stacks(layout.fill(model, z[nx:]))
        assert predictor_run(matrices, phi, u, y, z[:nx].copy(), 0, data.limit, out, none) == -1
        return (out * data.weight).ravel()

    z, step = np.concatenate([x0, layout.read(model)]), 1e-6
    numeric = np.column_stack([(output(z + step * d) - output(z - step * d)) / (2 * step) for d in np.eye(z.size)])
    block, moved = np.zeros((z.size + 1, y.size)), np.hstack([np.eye(nx), np.zeros((nx, layout.size))])
    sensitivity_rows(stacks(model), phi, u, y, np.array(layout.table), data.weight, x0.copy(), moved, 0, len(y), block,
                     np.zeros((*phi.shape, 0)), np.zeros((*u.shape, 0)))
    np.testing.assert_allclose(block[:-1].T, numeric, atol=1e-7)
    np.testing.assert_allclose(block[-1], output(z) - (y * data.weight).ravel(), atol=1e-12)


def test_coordinates_do_not_matter_and_their_directions_are_known(rng: np.random.Generator) -> None:
    model, records = random_model(rng), [random_record(rng, 60)]
    data = SearchData.of(records, model)
    layout, now = StateSpaceLayout.full(model, EVERYTHING), evaluate(model, data)
    moved = transformed(model, rng.normal(size=(2, 2)), rng.normal(size=2))
    assert evaluate(moved, data).cost == pytest.approx(now.cost, rel=1e-9)
    directions = gauge(model, layout, data.ones)
    assert directions.shape == (layout.size, 4 + 2) and np.linalg.matrix_rank(directions) == 6
    factor = linearise(model, layout, data, now.starts)
    assert np.abs(factor[:-1, :-1] @ directions).max() < 1e-9 * np.abs(factor).max()


@pytest.mark.seconds
def test_search_is_the_same_in_any_coordinates(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    record = system.record(rng, 600, 20.0)
    ends = []
    for turn in (np.eye(2), np.array([[3.0, 1.0], [-0.5, 0.2]])):
        start = lpv.identify(record, StateSpaceError(2, **system.settings, iterations=0)).model
        back = np.linalg.inv(turn)
        start = start.replace(A=turn @ start.A @ back, B=turn @ start.B, C=start.C @ back)
        found = lpv.identify(record, StateSpaceError(2, **system.settings, start_from=start))
        ends.append([found.model.frozen_poles([p]) for p in (-0.5, 0.5)])
    np.testing.assert_allclose(np.sort(ends[0]), np.sort(ends[1]), atol=1e-4)


# -- known systems ---------------------------------------------------------------------------------------------------
@pytest.mark.thinned(2)
@pytest.mark.parametrize("snr", [pytest.param(20.0, marks=pytest.mark.seconds), 30.0])
def test_two_by_two_of_order_three(snr: float) -> None:
    rng = np.random.default_rng(3)
    system = StateSpaceSystem(rng, 3, 2, 2, 3)
    training, fresh = system.record(rng, 3000, snr), system.record(rng, 1500, snr)
    found = lpv.identify(training, StateSpaceError(3, **system.settings), held_out=[fresh])
    assert found.held_out is not None
    fit = found.held_out.overall.free_run.fit_percent
    assert fit is not None and fit > system.best_fit(fresh) - 0.5
    assert np.isfinite(found.covariance).all() and found.model.noise_covariance is not None
    noise = 10 ** (-snr / 20) * training.matrix(["y1 clean", "y2 clean"]).std(axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(found.model.noise_covariance)), noise, rtol=0.06)


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("seed", range(10))
def test_random_stable_systems(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    order, letters = int(rng.integers(2, 5)), int(rng.integers(2, 4))
    system = StateSpaceSystem(rng, order, int(rng.integers(1, 3)), int(rng.integers(1, 3)), letters,
                              radius=rng.uniform(0.6, 0.9))
    snr = rng.uniform(10, 40)
    training, fresh = system.record(rng, 1500, snr), system.record(rng, 800, snr)
    found = lpv.identify(training, StateSpaceError(order, **system.settings), held_out=[fresh])
    assert found.held_out is not None
    fit = found.held_out.overall.free_run.fit_percent
    assert fit is not None and fit > system.best_fit(fresh) - 3
    assert np.isfinite(found.covariance).all() and np.isfinite(found.parameters).all()


@pytest.mark.seconds
def test_initial_state_of_every_record(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    records = [system.record(rng, 300, None, x0=x0) for x0 in 20 * rng.normal(size=(3, 2))]
    found = lpv.identify(records, StateSpaceError(2, **system.settings))
    assert found.fit is not None and found.fit > 99.9
    system.k[:] = 0
    p = np.array([0.3])
    exact = np.linalg.eigvals(system.a[0] + 0.3 * system.a[1])
    np.testing.assert_allclose(np.sort(found.model.frozen_poles(p)), np.sort(exact), atol=1e-4)


@pytest.mark.seconds
def test_innovation_form_predicts_as_well_as_the_system(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    system.k = 0.4 * np.linalg.pinv(system.c[0])  # a stable predictor with a good deal of noise in the state
    training = system.record(rng, 3000, 10.0, innovation=True)
    fresh = system.record(rng, 1500, 10.0, innovation=True)
    found = lpv.identify(training, StateSpaceError(2, **system.settings, noise="innovation"), held_out=[fresh])
    assert found.held_out is not None and found.model.observer_gain is not None
    rmse = found.held_out.overall.one_step.rmse
    innovation = 10 ** (-10 / 20) * fresh["y1 clean"].std()
    assert rmse is not None and rmse < 1.05 * innovation
    free = found.held_out.overall.free_run.rmse
    assert free is not None and free > 1.02 * rmse


@pytest.mark.seconds
def test_covariance_of_frozen_gain_sample() -> None:
    """z-scores of the gain at three levels, over runs: their sum of squares is no accident."""
    rng = np.random.default_rng(8)
    system, scores, runs = StateSpaceSystem(rng, 2, 1, 1, 2), [], 12
    levels = (-0.6, 0.0, 0.6)

    def gain(model: lpv.LPVStateSpace) -> np.ndarray:
        return np.array([(c @ np.linalg.solve(np.eye(2) - a, b))[0, 0]
                         for a, b, c, _ in (model.frozen([p]) for p in levels)])

    true = np.array([((system.c[0] + p * system.c[1]) @ np.linalg.solve(
        np.eye(2) - system.a[0] - p * system.a[1], system.b[0] + p * system.b[1]))[0, 0] for p in levels])
    for _ in range(runs):
        found = lpv.identify(system.record(rng, 600, 20.0),
                             StateSpaceError(2, **system.settings, start_from=Subspace(past=3)))
        theta, step = found.parameters, 1e-5
        slope = np.column_stack([(gain(found.with_parameters(theta + step * d))
                                  - gain(found.with_parameters(theta - step * d))) / (2 * step)
                                 for d in np.eye(theta.size)])
        error = gain(found.model) - true
        scores.append(error @ np.linalg.solve(slope @ found.covariance @ slope.T, error))
    total = sum(scores)  # χ² with 36 degrees: 0.001 and 0.999 quantiles
    assert 14.4 < total < 68.0


# -- robustness ------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_diverging_start_is_drawn_in(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    record = system.record(rng, 800, 30.0)
    start = lpv.identify(record, StateSpaceError(2, **system.settings, iterations=0)).model
    wild = start.replace(A=2.5 * start.A)
    data = SearchData.of([record], wild)
    assert evaluate(wild, data).cost == np.inf
    tame, factor = bounded(wild, data)
    assert factor < 1 and np.isfinite(evaluate(tame, data).cost)
    assert refine(wild, StateSpaceLayout.full(wild, ("A", "B", "C")), data).why == "its start diverges"
    found = lpv.identify(record, StateSpaceError(2, **system.settings, start_from=wild))
    assert found.fit is not None and found.fit > 90


@pytest.mark.seconds
def test_too_high_an_order_and_noise_free_data_stay_finite(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    found = lpv.identify(system.record(rng, 500, None), StateSpaceError(4, **system.settings, iterations=15))
    assert np.isfinite(found.covariance).all() and np.isfinite(found.parameters).all()
    assert found.fit is not None and found.fit > 99


@pytest.mark.seconds
def test_offsets_and_direct_term(rng: np.random.Generator) -> None:
    n = 1500
    u, p = rng.normal(size=n), np.repeat(rng.uniform(-1, 1, n // 5), 5)
    x, y = 0.0, np.zeros(n)
    for k in range(n):
        y[k] = (1 + 0.5 * p[k]) * x + (0.7 - 0.2 * p[k]) * u[k] + 3 + p[k]
        x = (0.5 + 0.3 * p[k]) * x + u[k] + 0.5 * p[k]
    record = lpv.Record({"u": u, "p": p, "y": y + 0.01 * rng.normal(size=n)}, sample_time=1.0)
    basis = lpv.Polynomial("p", degree=1)
    found = lpv.identify(record, StateSpaceError(1, "u", "y", basis, direct=True, affine=True))
    assert found.model.noise_covariance is not None
    assert np.sqrt(found.model.noise_covariance[0, 0]) == pytest.approx(0.01, rel=0.08)
    without = lpv.identify(record, StateSpaceError(1, "u", "y", basis, direct=True))
    assert without.fit is not None and found.fit is not None and without.fit < found.fit - 10
    assert any("free" in note for note in found.notes)


def test_start_from_an_exact_realisation(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    record = system.record(rng, 800, 25.0)
    u, y, _ = system.names
    arx = lpv.identify(record, lpv.ARX(2, 2, 1, u, y, system.settings["basis"], lagged=True))
    shifted = lpv.realize(arx.model, "shifted").model
    held = lpv.identify(record, StateSpaceError(2, **system.settings, start_from=shifted, iterations=0))
    assert held.fit == pytest.approx(lpv.validate(shifted, [record]).overall.free_run.fit_percent, abs=0.2)
    found = lpv.identify(record, StateSpaceError(2, **system.settings, start_from=shifted))
    assert found.fit is not None and held.fit is not None and found.fit > held.fit


def test_result_survives_json_and_draws(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 2, 2)
    found = lpv.identify(system.record(rng, 600, 30.0), StateSpaceError(2, **system.settings,
                                                                       start_from=Subspace(past=3, future=2)))
    json.dumps(found.to_dict())
    again = lpv.LPVStateSpace.from_dict(json.loads(json.dumps(found.model.to_dict())))
    cloud = ParameterCloud.of(again)
    assert cloud is not None
    np.testing.assert_allclose(cloud.layout.read(again), found.parameters)
    poles = [m.frozen_poles([0.0]) for m in cloud.draw(np.random.default_rng(0), 50)]
    assert 0 < np.std(np.sort(np.abs(poles), axis=1), axis=0).max() < 0.05
    assert found.parameter_names[0] == "A11[1]" and len(found.parameter_names) == found.parameters.size


def test_says_what_it_cannot_do() -> None:
    basis = lpv.Polynomial("p", degree=1)
    with pytest.raises(InputError, match="noise must be one of"):
        StateSpaceError(2, "u", "y", basis, noise="white")
    with pytest.raises(InputError, match="order"):
        StateSpaceError(0, "u", "y", basis)
    start = random_model(np.random.default_rng(0))
    with pytest.raises(InputError, match="other inputs or outputs"):
        StateSpaceError(2, "u", "y", basis, start_from=start)
    with pytest.raises(InputError, match="another order"):
        StateSpaceError(3, ("u1", "u2"), ("y1", "y2"), basis, start_from=start)


def test_refuses_data_that_say_too_little(rng: np.random.Generator) -> None:
    n = 30
    basis = lpv.Polynomial("p", degree=1)
    record = lpv.Record({"u": rng.normal(size=n), "p": rng.uniform(-1, 1, n), "y": rng.normal(size=n)}, sample_time=1.0)
    with pytest.raises(InputError, match="cannot determine"):
        lpv.identify(record, StateSpaceError(4, "u", "y", basis))
    with pytest.raises(InputError, match="never moves"):
        lpv.identify(record.with_channel("y", np.full(n, 3.0)), StateSpaceError(1, "u", "y", basis))


def gyroscope_fit(shared_data: Path, order: int, *, from_least_squares: bool) -> float:
    """Free-run fit in percent on the last third, trained on the first two."""
    training, held_out = split_tail(lpv.read(shared_data / "gyroscope" / "estimation.csv")[0])
    channels = ("motor current", "gimbal speed", lpv.Polynomial(("p1", "p2", "p3"), degree=1))
    start = None
    if from_least_squares:
        arx = lpv.ARX(order, order, 1, *channels, affine=order + 1, lagged=True)
        start = lpv.realize(lpv.identify([training], arx).model, "shifted").model
    structure = StateSpaceError(order, *channels, affine=True, start_from=start)
    found = lpv.identify([training], structure, held_out=[held_out])
    assert found.held_out is not None
    fit = found.held_out.overall.free_run.fit_percent
    assert fit is not None
    return fit


@pytest.mark.seconds
def test_gyroscope(shared_data: Path) -> None:
    assert gyroscope_fit(shared_data, 3, from_least_squares=True) >= 94


@pytest.mark.slow
@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_gyroscope_with_every_start(shared_data: Path, order: int) -> None:
    assert gyroscope_fit(shared_data, order, from_least_squares=False) >= 93


@pytest.mark.slow
def test_coloured_errors_get_wider_standard_errors() -> None:
    """Output noise AR(1) 0.9 on a first-order plant with slow input: the sandwich covers the truth's gain."""
    from scipy.signal import lfilter

    truth, scores = 2.0, []
    for seed in range(25):
        rng = np.random.default_rng(100 + seed)
        u = lfilter([1.0], [1, -0.9], rng.normal(size=4000))
        y = lfilter([0, 0.6], [1, -0.7], u) + lfilter([0.5], [1, -0.9], rng.normal(size=4000))
        found = lpv.identify(lpv.Record({"u": u, "y": y}, sample_time=0.01),
                             StateSpaceError(order=1, input="u", output="y"))
        a, b, c, d = found.model.frozen([])
        gain = float((c @ np.linalg.solve(np.eye(1) - a, b) + d)[0, 0])
        assert "sandwich" in found.covariance_kind
        draws = found.draw(rng, 200)
        frozen = [m.frozen([]) for m in draws]
        gains = [float((C @ np.linalg.solve(np.eye(1) - A, B) + D)[0, 0]) for A, B, C, D in frozen]
        scores.append((gain - truth) / np.std(gains))
    assert 0.6 < np.std(scores) < 1.5


def test_short_data_with_a_coloured_error_have_no_white_standard_errors():
    """y = x + v, x(k) = 0.8 x(k−1) + u(k−1), v autoregressive: 800 samples hold no hundred blocks of its memory."""
    rng = np.random.default_rng(3)
    u, v = rng.normal(size=800), lfilter([1.0], [1, -0.95], rng.normal(size=800))
    y = lfilter([0.0, 1.0], [1, -0.8], u) + 0.3 * v
    found = lpv.identify(lpv.Record({"u": u, "y": y}, sample_time=0.01), lpv.StateSpaceError(1, "u", "y"))
    assert "sandwich" in found.covariance_kind
