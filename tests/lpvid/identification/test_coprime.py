"""The right-coprime structure against plain recursions, known systems and the transfer-function route."""

from __future__ import annotations

import json

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.identification.coprime import RightCoprime
from lpvid.identification.layout import ParameterCloud
from lpvid.identification.state_space_layout import StateSpaceLayout

BASIS = lpv.Polynomial("p", degree=1)


def system(seed: int, n: int, noise: float, period: int = 1) -> lpv.Record:
    """A right-coprime system by its equations; p steps every `period` samples."""
    rng = np.random.default_rng(seed)
    u, p = rng.normal(size=n), np.repeat(rng.uniform(-1, 1, n // period + 1), period)[:n]
    w, y = np.zeros(n), np.zeros(n)
    for k in range(2, n):
        w[k] = u[k - 1] - (-1.0 + 0.4 * p[k - 1]) * w[k - 1] - (0.5 - 0.3 * p[k - 1]) * w[k - 2]
        y[k] = (1 + 0.5 * p[k]) * w[k] + (0.3 - 0.4 * p[k]) * w[k - 1]
    measured = y + noise * y.std() * rng.normal(size=n)
    return lpv.Record({"u": u, "p": p, "y": measured, "clean": y}, sample_time=0.01)


TRUE = {"a1[1]": -1.0, "a1[p]": 0.4, "a2[1]": 0.5, "a2[p]": -0.3, "b1[1]": 1.0, "b1[p]": 0.5, "b2[1]": 0.3,
        "b2[p]": -0.4}


@pytest.fixture(scope="module")
def found() -> lpv.Identification:
    return lpv.identify(system(0, 3000, 0.05), RightCoprime(2, 2, "u", "y", BASIS), held_out=[system(1, 2000, 0.0)])


def test_recovers_a_known_system(found: lpv.Identification) -> None:
    box = found.model.box  # coefficients over z = (p − centre)/half width, against those over p
    centre, half = box.centre[0], box.half_width[0]
    estimated = dict(zip(found.parameter_names, found.parameters, strict=True))
    for stem in ("a1", "a2", "b1", "b2"):
        slope = estimated[f"{stem}[p]"] / half
        assert slope == pytest.approx(TRUE[f"{stem}[p]"], abs=0.02)
        assert estimated[f"{stem}[1]"] - slope * centre == pytest.approx(TRUE[f"{stem}[1]"], abs=0.02)


def test_standard_errors_hold_the_truth(found: lpv.Identification) -> None:
    box = found.model.box
    centre, half = box.centre[0], box.half_width[0]
    true = np.array([v for s in ("a1", "a2", "b1", "b2")
                     for v in (TRUE[f"{s}[1]"] + centre * TRUE[f"{s}[p]"], half * TRUE[f"{s}[p]"])])
    error = found.parameters - true
    assert error @ np.linalg.solve(found.covariance, error) < 26.1  # 0.999 quantile of χ² with 8 degrees


def test_beats_the_transfer_function_route_under_fast_scheduling(found: lpv.Identification) -> None:
    training, held_out = system(0, 3000, 0.05), system(1, 2000, 0.0)
    assert found.held_out is not None
    direct = found.held_out.overall.free_run.fit_percent
    arx = lpv.identify(training, lpv.ARX(2, 2, 1, "u", "y", BASIS))
    routed = lpv.validate(lpv.realize(arx.model, "controllable").model, [held_out]).overall.free_run.fit_percent
    assert direct is not None and routed is not None
    assert direct > 99 and routed < 80


def test_slow_scheduling_makes_both_agree() -> None:
    slow = system(2, 4000, 0.0, period=1000)
    direct = lpv.identify(slow, RightCoprime(2, 2, "u", "y", BASIS))
    arx = lpv.identify(slow, lpv.ARX(2, 2, 1, "u", "y", BASIS))
    np.testing.assert_allclose(direct.model.frozen_poles([0.3]), arx.model.frozen_poles([0.3]), atol=0.02)


def test_the_model_is_the_canonical_form(found: lpv.Identification) -> None:
    model = found.model
    np.testing.assert_array_equal(model.B, [[[0], [1]], [[0], [0]]])
    np.testing.assert_array_equal(model.A[:, 0], [[0, 1], [0, 0]])
    assert not model.D.any() and model.order == 2


@pytest.mark.parametrize("direct", [False, True])
def test_parameters_mean_their_equation(direct: bool) -> None:
    """Two inputs, affine terms and direct terms: the state space against the recursion written out."""
    rng = np.random.default_rng(3)
    n, t = 60, np.arange(60)
    p = np.sin(0.7 * t)
    record = lpv.Record({"u": rng.normal(size=n), "v": rng.normal(size=n), "p": p, "y": np.zeros(n)}, sample_time=1.0)
    structure = RightCoprime(2, 3, ("u", "v"), "y", BASIS, direct=direct, affine=3)
    warm = lpv.LPVTransferFunction(np.zeros((2, 1, 1, 2)), np.zeros((4, 1, 2, 2)), BASIS, 1.0,
                                   inputs=(lpv.Signal("u"), lpv.Signal("v")), outputs=(lpv.Signal("y"),))
    template = structure.empty(warm)
    layout = structure.layout(template)
    theta = 0.2 * rng.normal(size=layout.size)
    value = dict(zip(layout.names(template), theta, strict=True))

    def at(stem: str, k: int) -> float:
        return value[f"{stem}[1]"] + value[f"{stem}[p]"] * p[k]

    w = np.zeros((n + 4, 3))  # latent signals behind four zeros: of u, of v, and of the constant 1
    y = np.zeros(n)
    for k in range(n):
        if k:
            drive = np.array([record["u"][k - 1], record["v"][k - 1], 1.0])
            w[k + 4] = drive - at("a1", k - 1) * w[k + 3] - at("a2", k - 1) * w[k + 2]
        y[k] = sum(at(f"b{j}{{{name}}}", k) * w[k + 5 - j, q] for q, name in enumerate("uv") for j in (1, 2, 3))
        y[k] += at("c0", k) + sum(at(f"c{j}", k) * w[k + 5 - j, 2] for j in (1, 2))
        if direct:
            y[k] += sum(at(f"d{{{name}}}", k) * record[name][k] for name in "uv")
    run = lpv.simulate(layout.fill(template, theta), record, "zero")
    np.testing.assert_allclose(run.output[:, 0], y, atol=1e-12)
    np.testing.assert_allclose(layout.read(layout.fill(template, theta)), theta)


def test_warm_start_is_exact_for_frozen_scheduling() -> None:
    """With b_0 and c_0 the canonical form's numerator is b_i − a_i b_0; over a constant basis nothing is lost."""
    rng = np.random.default_rng(4)
    n = 500
    u, y = rng.normal(size=n), np.zeros(n)
    for k in range(2, n):
        y[k] = 1.1 * y[k - 1] - 0.4 * y[k - 2] + 0.5 * u[k] + 0.3 * u[k - 1] - 0.2 * u[k - 2] + 0.7
    record = lpv.Record({"u": u, "y": y}, sample_time=1.0)
    structure = RightCoprime(2, 2, "u", "y", lpv.Polynomial(), direct=True, affine=2, iterations=0)
    estimate = lpv.identify(record, structure)
    assert estimate.fit is not None and estimate.fit > 99.9


@pytest.mark.seconds
def test_fitted_stage_and_filter_ride_along() -> None:
    rng = np.random.default_rng(5)
    n = 1500
    u, p = rng.normal(size=n), rng.uniform(0, 1, n)
    x, y = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        x[k] = (0.5 + 0.2 * p[k - 1]) * x[k - 1] + np.tanh(u[k - 1] / 0.5)
        y[k] = (1 + p[k]) * x[k]
    record = lpv.Record({"u": u, "p": p, "y": y + 0.01 * rng.normal(size=n)}, sample_time=1.0)
    found = lpv.identify(record, RightCoprime(1, 1, "u", "y", BASIS, stage="tanh"))
    assert found.model.input_stage is not None
    assert found.fit is not None and found.fit > 95


@pytest.mark.seconds
def test_result_survives_json_and_draws(found: lpv.Identification) -> None:
    json.dumps(found.to_dict())
    again = lpv.LPVStateSpace.from_dict(json.loads(json.dumps(found.model.to_dict())))
    np.testing.assert_array_equal(again.A, found.model.A)
    cloud = ParameterCloud.of(again)
    assert cloud is not None and isinstance(cloud.layout, StateSpaceLayout)
    drawn = cloud.draw(np.random.default_rng(0), 400)
    spread = np.std([cloud.layout.read(m) for m in drawn], axis=0)
    np.testing.assert_allclose(spread, found.standard_errors, rtol=0.2)
    assert all(np.array_equal(m.B, found.model.B) for m in drawn)


def test_shifted_form_is_identified_exactly_by_least_squares() -> None:
    """Coefficients of lag i at p(k − i): one regression, and its observable realisation has no gap."""
    rng = np.random.default_rng(6)
    n = 1500
    u, p, y = rng.normal(size=n), rng.uniform(-1, 1, n), np.zeros(n)
    for k in range(2, n):
        y[k] = ((1.0 - 0.4 * p[k - 1]) * y[k - 1] - (0.5 - 0.3 * p[k - 2]) * y[k - 2]
                + (1 + 0.5 * p[k - 1]) * u[k - 1] + (0.3 - 0.4 * p[k - 2]) * u[k - 2])
    record = lpv.Record({"u": u, "p": p, "y": y}, sample_time=0.01)
    arx = lpv.identify(record, lpv.ARX(2, 2, 1, "u", "y", BASIS, lagged=True))
    realised = lpv.realize(arx.model, "observable")
    assert realised.exact and realised.causal and realised.model.basis.lags == (0, 0)
    assert realised.gap([record]).esr[0] < 1e-20
    assert arx.fit is not None and arx.fit > 99.99


def test_says_what_it_cannot_do() -> None:
    with pytest.raises(InputError, match="single output"):
        RightCoprime(2, 2, "u", ("y", "z"), BASIS)
    with pytest.raises(InputError, match="p\\(k\\) alone"):
        RightCoprime(2, 2, "u", "y", lpv.Shifted(BASIS, 1))
    with pytest.raises(InputError, match="input and output at once"):
        RightCoprime(2, 2, "y", "y", BASIS)


def growing(level: float, n: int, seed: int) -> lpv.Record:
    """y(k) = (0.7 + 0.303 p) y(k−1) + u(k−1): at p = 1 it grows, e-fold in 333 samples."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        y[k] = (0.7 + 0.303 * level) * y[k - 1] + u[k - 1]
    return lpv.Record({"u": u, "p": np.full(n, level), "y": y}, sample_time=0.01)


def test_growth_at_a_scheduling_that_rests_is_not_put_down_to_its_motion():
    found = lpv.identify([growing(0.0, 400, 1), growing(1.0, 400, 2)], RightCoprime(1, 1, "u", "y", BASIS))
    assert np.abs(found.model.frozen_poles([1.0])).max() == pytest.approx(1.003, abs=1e-3)
    (stated,) = [n for n in found.notes if "frozen pole outside" in n]
    assert "the scheduling is constant there, and a longer run diverges" in stated and "50 %" in stated
