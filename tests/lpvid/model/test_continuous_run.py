"""Continuous models along records: closed forms, an independent integrator, and a time-varying solution."""

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lpvid as lpv


def _oscillator():
    """ẍ + 0.4 ẋ + (2 + p) x = w over p in [−1, 1]."""
    a = np.array([[[0, 1], [-2, -0.4]], [[0, 0], [-1, 0]]], dtype=float)
    b, c = np.array([[[0], [1.0]], [[0], [0]]]), np.array([[[1.0, 0]], [[0, 0]]])
    return lpv.LPVStateSpace(a, b, c, np.zeros((2, 1, 1)), lpv.Polynomial("p", 1), None,
                             lpv.Scheduling(("p",), (-1.0,), (1.0,)), inputs=(lpv.Signal("w"),),
                             outputs=(lpv.Signal("x"),))


@pytest.mark.seconds
def test_a_run_is_that_of_a_general_integrator():
    t = np.arange(0, 10, 0.05)
    w, p = np.sin(3 * t) + 0.3 * np.cos(0.7 * t), np.sin(1.3 * t)
    found = lpv.simulate(_oscillator(), lpv.Record({"w": w, "p": p}, sample_time=0.05))
    model = _oscillator()

    def slope(now, x):
        a, b, _, _ = model.frozen([np.interp(now, t, p)])
        return a @ x + b[:, 0] * np.interp(now, t, w)

    truth = solve_ivp(slope, (0, t[-1]), [0, 0], "DOP853", t, rtol=1e-7, atol=1e-10, max_step=0.05).y[0]
    assert found.initial == "rest" and found.start == 0
    np.testing.assert_allclose(found.output[:, 0], truth, atol=3e-4 * np.abs(truth).max())


def test_a_step_is_that_of_python_control():
    t = np.linspace(0, 8, 161)
    plant = _oscillator()
    wanted = control.step_response(plant.to_control(at=[0.5]), t).outputs
    found = lpv.step_response(plant, t, np.full(len(t), 0.5))
    np.testing.assert_allclose(found[:, 0], wanted, atol=1e-4)
    with pytest.raises(lpv.InputError, match="no input"):
        lpv.step_response(plant, t, of="force")
    with pytest.raises(lpv.InputError, match="equally spaced"):
        lpv.step_response(plant, np.array([0.0, 1.0, 3.0]))


def test_a_growing_gain_in_closed_form():
    """ẋ = −p x with p = t from x(0) = 1: x = exp(−t²/2)."""
    model = lpv.LPVStateSpace([[[0.0]], [[-1.0]]], np.zeros((2, 1, 1)), [[[1.0]], [[0.0]]], np.zeros((2, 1, 1)),
                              lpv.Polynomial("p", 1), None, lpv.Scheduling(("p",), (0.0,), (3.0,)))
    t = np.linspace(0, 3, 31)
    found = lpv.simulate(model, lpv.Record({"u1": 0 * t, "p": t}, sample_time=0.1), np.array([1.0]))
    np.testing.assert_allclose(found.output[:, 0], np.exp(-t**2 / 2), atol=1e-4)
