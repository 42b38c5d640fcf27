"""The linear fractional form: against closed forms, python-control, brute force and simulation."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.model.lft import LFTModel
from lpvid.scheduling import Scheduling

BOX = Scheduling(("speed", "load"), (1.0, -2.0), (5.0, 6.0), (3.0, None), ("m/s", "N"))


def random_model(seed: int, loop: float = 0.2, sample_time: float | None = None) -> LFTModel:
    rng = np.random.default_rng(seed)
    m = rng.normal(size=(2 + 3 + 1, 2 + 3 + 2))
    m[2:5, 2:5] *= loop
    m[:2, :2] -= 2 * np.eye(2)
    return LFTModel(m, 2, BOX, (2, 1), sample_time, ("u1", "u2"), ("y",))


def test_a_rational_gain_is_exact():
    p = np.linspace(1, 5, 9)  # y = u/(1 + p²) solves y = u − p (p y), with p = 3 + 2δ twice
    box = Scheduling(("p",), (1.0,), (5.0,))
    # v = p y = 3 y + 2 p1 with p1 = δ y, and y = u − 3 v − 2 p2 with p2 = δ v
    solve = np.linalg.solve(np.array([[1.0, 3.0], [-3.0, 1.0]]), np.array([[0.0, -2.0, 1.0], [2.0, 0.0, 0.0]]))
    matrix = np.vstack([solve, solve[:1]])  # q = (y, v), output y; columns p1, p2, u
    model = LFTModel(matrix, 0, box, (2,), None)
    np.testing.assert_allclose(model.at(p[:, None])[3].ravel(), 1 / (1 + p**2), rtol=1e-12)
    assert model.well_posed().holds


def test_frozen_values_are_those_of_python_controls_lft():
    model = random_model(3)
    for point in ([1.0, -2.0], [4.1, 3.3]):
        delta = np.diag(model.delta(np.array([point]))[0])
        m = model.matrix[np.ix_([0, 1, 5, 2, 3, 4], [0, 1, 5, 6, 2, 3, 4])]  # Δ's channels last, as lft wants them
        whole = control.ss([], [], [], m).lft(control.ss([], [], [], delta), 3, 3).D
        np.testing.assert_allclose(np.block([list(model.frozen(point)[:2]), list(model.frozen(point)[2:])]), whole)
    ends = model.delta(np.array([[1.0, -2.0], [5.0, 6.0]]))
    np.testing.assert_allclose(ends, [[-1, -1, -1], [1, 1, 1]])


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10**6), loop=st.floats(0.05, 1.2))
def test_well_posedness_agrees_with_a_dense_grid(seed, loop):
    model = random_model(seed, loop)
    found = model.well_posed()
    d = model.delta(BOX.grid(41))
    signs = np.sign(np.linalg.det(np.eye(3) - model.part("q", "p") * d[:, None, :]))
    if found.holds:
        assert np.all(signs == signs[0])
    if np.any(signs != signs[0]):
        assert found.holds is not True
    if found.holds is False:
        assert found.at is not None and bool(BOX.contains(np.array([found.at]))[0])


def test_an_ill_posed_form_says_where():
    model = LFTModel(np.array([[2.0, 1.0], [1.0, 0.0]]), 0, Scheduling(("p",), (0.0,), (2.0,)), (1,), None)  # δ = 1/2
    found = model.well_posed()
    assert found.holds is False and "ill posed" in str(found)
    with pytest.raises(InputError, match=r"no value here: got scheduling \[1.5\]"):
        model.frozen([1.5])


def test_a_discrete_run_is_the_recursion_by_hand():
    model = random_model(5, sample_time=0.1)
    model = model.replace(matrix=model.matrix * 0.3)
    rng = np.random.default_rng(0)
    u, p = rng.normal(size=(30, 2)), rng.uniform(BOX.lower, BOX.upper, (30, 2))
    x, out = np.array([1.0, -1.0]), []
    for uk, pk in zip(u, p, strict=True):
        a, b, c, d = model.frozen(pk)
        out.append(c @ x + d @ uk)
        x = a @ x + b @ uk
    np.testing.assert_allclose(model.simulate(u, p, [1.0, -1.0]), out, rtol=1e-12)


def test_a_continuous_run_with_held_signals_is_the_integrated_one():
    model = random_model(6)
    rng = np.random.default_rng(1)
    u, p = rng.normal(size=(8, 2)), rng.uniform(BOX.lower, BOX.upper, (8, 2))
    x, out = np.zeros(2), []
    for uk, pk in zip(u, p, strict=True):
        a, b, c, d = model.frozen(pk)
        out.append(c @ x + d @ uk)
        x = solve_ivp(lambda _, s, a=a, b=b, uk=uk: a @ s + b @ uk, (0, 0.05), x, rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(model.simulate(u, p, sample_time=0.05), out, atol=1e-9)
    with pytest.raises(InputError, match="sample_time"):
        model.simulate(u, p)


def test_a_record_is_refused_with_what_to_do_instead():
    record = lpv.Record({n: lpv.Channel(np.ones(20)) for n in ("u1", "u2", "y", "speed", "load")}, sample_time=0.1)
    with pytest.raises(InputError, match=r"model\.simulate"):
        lpv.simulate(random_model(5, sample_time=0.1), record)


def test_a_file_brings_the_model_back(tmp_path):
    model = random_model(7, sample_time=0.01)
    again = lpv.load(lpv.save(model, tmp_path / "lft.json"))
    assert isinstance(again, LFTModel) and lpv.model_hash(again) == lpv.model_hash(model)
    assert np.array_equal(again.matrix, model.matrix) and again.scheduling == BOX
    assert repr(again).endswith("2 states, Δ {speed x2, load x1}, 100 Hz")
    np.testing.assert_allclose(again.to_control([2.0, 1.0]).A, model.frozen([2.0, 1.0])[0])


@pytest.mark.parametrize(("change", "message"), [
    ({"repetitions": (2,)}, "one number for each of 2"),
    ({"repetitions": (20, 1)}, "too small"),
    ({"outputs": ("a", "b")}, "signals do not match"),
    ({"sample_time": -1.0}, "positive"),
    ({"matrix": np.full((6, 7), np.nan)}, "finite"),
])
def test_what_does_not_fit_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        random_model(1).replace(**change)
