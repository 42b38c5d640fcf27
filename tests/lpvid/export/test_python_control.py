"""Models to and from python-control: frozen behaviour, time response, grids."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.export.python_control import from_control, frozen_state_space, nonlinear_io_system, to_grid
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked
from lpvid.simulation import simulate


def transfer_function(seed: int, *, na=2, lags=3, affine=0, ny=1, nu=1, lagged=False, degree=1, **more):
    rng = np.random.default_rng(seed)
    m = degree + 1
    return LPVTransferFunction(rng.uniform(-1, 1, (na, ny, ny, m)) * 0.8 / max(na * ny * m, 1),
                               rng.normal(size=(lags, ny, nu, m)), Polynomial("p", degree), 0.01,
                               c=rng.normal(size=(affine, ny, m)), lagged=lagged, **more)


# -- frozen ----------------------------------------------------------------------------------------------------------
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), na=st.integers(0, 4), lags=st.integers(1, 5), ny=st.integers(1, 2),
       nu=st.integers(1, 2), p=st.floats(-1, 1))
def test_frozen_frequency_response_is_that_of_the_coefficients(seed, na, lags, ny, nu, p):
    model = transfer_function(seed, na=na, lags=lags, ny=ny, nu=nu, degree=2)
    system = frozen_state_space(model, [p])
    a, b, _ = model.coefficients([p])
    omega = np.array([0.1, 1.0, 3.0]) / model.sample_time
    got = system(np.exp(1j * omega * model.sample_time), squeeze=False)
    for i, w in enumerate(omega):
        z = np.exp(1j * w * model.sample_time)
        left = np.eye(ny) + sum((x * z ** -(k + 1) for k, x in enumerate(a)), np.zeros((ny, ny)))
        expected = np.linalg.solve(left, sum(x * z**-k for k, x in enumerate(b)))
        np.testing.assert_allclose(got[:, :, i], expected, rtol=1e-10, atol=1e-10)
    assert system.dt == 0.01
    assert system.nstates == model.order * ny


def test_frozen_poles_are_the_models(rng):
    model = transfer_function(1, na=3, lags=4, degree=2)
    for p in (-0.7, 0.0, 0.9):
        np.testing.assert_allclose(np.sort_complex(model.to_control([p]).poles()),
                                   np.sort_complex(model.frozen_poles([p])), atol=1e-10)
        ss = realize(model, "augmented").model
        np.testing.assert_allclose(np.sort_complex(ss.to_control([p]).poles()),
                                   np.sort_complex(ss.frozen_poles([p])), atol=1e-10)


def test_a_continuous_model_stays_continuous():
    model = LPVStateSpace([[[-1.0]], [[-0.5]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], [[[0.0]], [[0.0]]],
                          Polynomial("p", 1), None)
    system = model.to_control([2.0])
    assert system.dt == 0
    assert system.poles() == pytest.approx([-2.0])
    assert system(0) == pytest.approx(0.5)


def test_signal_names_go_along_in_a_form_that_control_takes():
    model = transfer_function(2, nu=2, inputs=("damper.velocity",), outputs=("force",), input_stage=TanhStage())
    system = model.to_control([0.0])
    assert system.input_labels == ["damper_velocity", "tanh(damper_velocity)"]
    assert system.output_labels == ["force"]


# -- varying ---------------------------------------------------------------------------------------------------------
def respond(system, model, record: Record, memory: float | None = None) -> np.ndarray:
    """Time response by python-control, from zero states; `memory` fills the states that hold past scheduling."""
    x0 = [0.0 if memory is None or not name.startswith(("past", "logged")) else memory for name in system.state_labels]
    u = record.matrix(system.input_labels).T
    response = control.input_output_response(system, model.sample_time * np.arange(record.n_samples), u, x0)
    return response.outputs.reshape(len(system.output_labels), -1).T


def a_record(rng, nu=1, n=60, names=None) -> Record:
    inputs = names or [f"u{i + 1}" for i in range(nu)]
    return Record({**{k: rng.normal(size=n) for k in inputs}, "p": rng.uniform(-1, 1, n)}, sample_time=0.01)


@pytest.mark.parametrize("lagged", [False, True])
@pytest.mark.parametrize(("ny", "nu"), [(1, 1), (2, 2)])
def test_time_response_of_a_transfer_function(lagged, ny, nu, rng):
    model = transfer_function(3, na=3, lags=3, ny=ny, nu=nu, lagged=lagged, degree=2)
    record = a_record(rng, nu)
    system = model.to_nonlinear_io_system()
    assert system.input_labels == [f"u{i + 1}" for i in range(nu)] + ["p"]
    np.testing.assert_allclose(respond(system, model, record), simulate(model, record, "zero").output, atol=1e-9)


def test_affine_terms_and_past_scheduling_are_inside(rng):
    model = transfer_function(4, na=2, lags=2, affine=3)
    record = a_record(rng)
    system = nonlinear_io_system(model)
    assert [x for x in system.state_labels if x.startswith("past")] == ["past p 1", "past p 2"]
    got = respond(system, model, record, memory=record["p"][0])
    np.testing.assert_allclose(got, simulate(model, record, "zero").output, atol=1e-9)


def test_the_input_stage_and_a_lagging_scheduling_are_inside(rng):
    for stage in (SchedulingLag(0.02, 0.005), SchedulingLag(0.02, 0.0, delay=0.025)):
        model = transfer_function(5, nu=2, inputs=("velocity",), input_stage=TanhStage(0.5, 0.3), affine=2,
                                  scheduling_stage=stage)
        record = a_record(rng, names=["velocity"])
        got = respond(nonlinear_io_system(model), model, record, memory=record["p"][0])
        np.testing.assert_allclose(got, simulate(model, record, "zero").output, atol=1e-9)


def test_a_channel_that_is_input_and_scheduling_appears_once(rng):
    model = LPVTransferFunction.siso([[-0.5, 0.1]], [[0, 0], [1, 0.2]], Polynomial("velocity", 1), 0.01,
                                     inputs=("velocity",))
    record = Record({"velocity": rng.uniform(-1, 1, 50)}, sample_time=0.01)
    system = nonlinear_io_system(model)
    assert system.input_labels == ["velocity"]
    np.testing.assert_allclose(respond(system, model, record), simulate(model, record, "zero").output, atol=1e-9)


def test_a_continuous_model_varies_in_continuous_time():
    model = LPVStateSpace([[[-1.0]], [[-0.5]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], [[[0.0]], [[0.0]]],
                          Polynomial("p", 1), None)
    t = np.linspace(0, 2, 201)
    response = control.input_output_response(nonlinear_io_system(model), t, np.vstack([0 * t, t]), [1.0],
                                             solve_ivp_kwargs={"rtol": 1e-10, "atol": 1e-12})
    np.testing.assert_allclose(response.outputs.ravel(), np.exp(-t - 0.25 * t**2), atol=1e-8)  # ẋ = −(1 + t/2) x


def test_what_cannot_be_an_input_output_system_is_refused():
    with pytest.raises(InputError, match=r"ahead of time: got 2 sample.*augmented"):
        nonlinear_io_system(realize(transfer_function(6), "shifted").model)
    late = Shifted(Polynomial("p", 1), 1)
    with pytest.raises(InputError, match="continuous model"):
        nonlinear_io_system(LPVStateSpace([[[-1.0]]] * 2, [[[1.0]]] * 2, [[[1.0]]] * 2, [[[0.0]]] * 2, late, None))


# -- back ------------------------------------------------------------------------------------------------------------
def test_a_grid_comes_back_exactly_at_its_points(rng):
    model = realize(transfer_function(7, na=3, lags=4, ny=2, nu=2, degree=3), "observable").model
    at = np.array([0.9, -1.0, 0.1, -0.3])  # in any order
    back = from_control(to_grid(model, at), at)
    assert back.sample_time == 0.01
    assert back.box.lower == (-1.0,)
    for p in at:
        for got, expected in zip(back.frozen([p]), model.frozen([p]), strict=True):
            np.testing.assert_allclose(got, expected, atol=1e-12)
    middle = back.frozen([0.5])[0]
    between = 0.5 * (model.frozen([0.1])[0] + model.frozen([0.9])[0])
    np.testing.assert_allclose(middle, between, atol=1e-12)
    assert [s.name for s in back.inputs] == ["u1", "u2"]


def test_units_come_back_and_may_be_given():
    box = lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",))
    model = LPVStateSpace([[[0.5]], [[0.1]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], [[[0.0]], [[0.0]]],
                          Polynomial("current", 1), 0.01, scheduling=box, inputs=(lpv.Signal("velocity", "m/s"),),
                          outputs=(lpv.Signal("force", "N"),))
    back = from_control(to_grid(model, [0.0, 2.0]), [0.0, 2.0], names="current")
    assert (back.inputs[0].unit, back.outputs[0].unit, back.box.units) == ("m/s", "N", ("A",))
    foreign = control.StateSpace([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.1, inputs=["velocity"], outputs=["force"])
    given = from_control([foreign, foreign], [0.0, 1.0], names="current", units={"force": "N", "current": "A"})
    assert (given.inputs[0].unit, given.outputs[0].unit, given.box.units) == ("", "N", ("A",))
    with pytest.raises(InputError, match="pressure"):
        from_control([foreign, foreign], [0.0, 1.0], names="current", units={"pressure": "Pa"})


def test_a_polynomial_grid_comes_back_everywhere_with_its_own_basis():
    model = realize(transfer_function(8, degree=2), "augmented").model
    at = np.linspace(-1, 1, 5)
    back = from_control(to_grid(model, at), at, Polynomial("p", 2))
    assert back.metadata["from_control"]["largest_misfit"] < 1e-12
    for name in "ABCD":
        np.testing.assert_allclose(
            np.array([back.frozen([p])["ABCD".index(name)] for p in (-0.83, 0.41)]),
            np.array([model.frozen([p])["ABCD".index(name)] for p in (-0.83, 0.41)]), atol=1e-12)


def test_a_basis_too_small_reports_its_misfit():
    grid = [control.StateSpace([[0.1 * p**2]], [[1.0]], [[1.0]], [[0.0]], 0.1) for p in (0, 1, 2)]
    back = from_control(grid, [0, 1, 2], Polynomial("p", 1))
    # residuals of p² against its line: 1/3, −2/3, 1/3
    assert back.metadata["from_control"]["largest_misfit"] == pytest.approx(0.1 * 2 / 3, rel=1e-9)


def test_two_scheduling_variables_on_a_full_grid():
    points = np.array([(p, q) for p in (0.0, 1.0, 3.0) for q in (-1.0, 1.0)])
    grid = [control.StateSpace([[0.1 * p - 0.2 * q + 0.05 * p * q]], [[1.0]], [[1.0]], [[0.0]], 0.1) for p, q in points]
    back = from_control(grid, points, names=("p", "q"))
    assert isinstance(back.basis, Product)
    assert back.frozen([2.0, 0.5])[0][0, 0] == pytest.approx(0.2 - 0.1 + 0.05, rel=1e-12)  # bilinear is reproduced
    fitted = from_control(grid, points, Product(Polynomial("p", 1), Polynomial("q", 1)))
    assert fitted.frozen([2.0, 0.5])[0][0, 0] == pytest.approx(0.15, rel=1e-12)


def test_one_system_is_a_model_that_does_not_move():
    system = control.StateSpace([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.1, inputs=["velocity"], outputs=["force"])
    back = from_control([system], [1.0])
    assert back.box.names == ()
    assert back.inputs[0].name == "velocity"
    np.testing.assert_array_equal(back.to_control([]).A, system.A)


def test_a_box_given_is_kept():
    box = Scheduling(("current",), (0.0,), (2.5,), rate=(100.0,), units=("A",))
    grid = [control.StateSpace([[0.1 * p]], [[1.0]], [[1.0]], [[0.0]], 0.1) for p in (0.0, 2.5)]
    back = from_control(grid, [0.0, 2.5], box=box)
    assert back.box == box
    assert isinstance(back.basis, Spline)


def systems(*numbers, dt=0.1):
    return [control.StateSpace([[n]], [[1.0]], [[1.0]], [[0.0]], dt) for n in numbers]


@pytest.mark.parametrize(("given", "at", "more", "message"), [
    ([], [], {}, "at least one system"),
    ([*systems(0.1), control.StateSpace(np.eye(2) * 0.1, np.ones((2, 1)), np.ones((1, 2)), [[0.0]], 0.1)], [0, 1], {},
     r"differ in states"),
    ([*systems(0.1), *systems(0.2, dt=0.2)], [0, 1], {}, r"differ in their sampling period: got \[0.1, 0.2\]"),
    ([*systems(0.1), *systems(-0.2, dt=0)], [0, 1], {}, "differ in their sampling period"),
    (systems(0.1, 0.2, dt=True), [0, 1], {}, "without a sampling period"),
    (systems(0.1, 0.2), [0, 0], {}, "occurs twice"),
    (systems(0.1, 0.2), [0, 1, 2], {}, "2 systems, 3 points"),
    (systems(0.1, 0.2), [0, np.nan], {}, "must be finite"),
    (systems(0.1, 0.2), [0, 1], {"basis": Polynomial("p", 2)}, "2 scheduling points cannot fix 3 functions"),
    (systems(0.1, 0.2, 0.3), [[0, 0], [0, 1], [1, 0]], {}, "no full grid"),
    (systems(0.1, 0.2), [0, 1], {"names": ("p", "q")}, "names do not match"),
    (systems(0.1, 0.2), [0, 1], {"names": "q", "basis": Polynomial("p", 1)}, "no scheduling variable 'p'"),
])
def test_bad_grids_are_named(given, at, more, message):
    with pytest.raises(InputError, match=message) as caught:
        from_control(given, at, **more)
    assert "\n" not in str(caught.value)


def test_a_basis_that_reads_past_scheduling_freezes_like_any_other():
    basis = Stacked((Polynomial("p", 1), Shifted(Polynomial("p", 1), 1)))
    model = LPVStateSpace([[[0.1]]] * 4, [[[1.0]]] * 4, [[[1.0]]] * 4, [[[0.0]]] * 4, basis, 0.1)
    assert model.to_control([2.0]).A[0, 0] == pytest.approx(0.1 * (1 + 2 + 1 + 2))
