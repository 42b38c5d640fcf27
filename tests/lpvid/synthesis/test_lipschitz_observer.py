"""An observer for a pendulum-like plant whose nonlinearity is bounded by its slope only."""

import numpy as np
import pytest

import lpvid as lpv


def arm(constant=None):
    """ẋ₁ = x₂, ẋ₂ = −k x₁ − 0.5 x₂ + φ(x₁) + push, y = x₁ + 0.1 noise; stiffness k in [1, 3] as scheduling."""
    a = np.array([[[0, 1.0], [0, -0.5]], [[0, 0], [-1, 0]]])
    b = np.zeros((2, 2, 4))
    b[0, 1] = [1.0, 1.0, 0.0, 1.0]                               # phi, push, noise, torque
    c = np.zeros((2, 3, 2))
    c[0] = [[1.0, 0], [0, 1.0], [1.0, 0]]                        # angle (argument), speed (to estimate), sensor
    d = np.zeros((2, 3, 4))
    d[0, 2, 2] = 0.1
    system = lpv.LPVStateSpace(a, b, c, d, lpv.Polynomial("k", 1), None, lpv.Scheduling(("k",), (1.0,), (3.0,)),
                               inputs=("phi", "push", "noise", "torque"), outputs=("angle", "speed", "sensor"))
    return lpv.GeneralizedPlant(system, ["torque"], ["sensor"])


@pytest.mark.slow
def test_estimate_keeps_its_bound_along_a_run():
    """φ = 2 sin, k sweeping: plant and observer integrated together; ‖speed error‖ ≤ γ ‖(push, noise)‖."""
    found = lpv.LipschitzObserver("phi", "angle", 2.0).solve(arm())
    assert found.solved, found
    bound = found.gain.upper
    assert bound <= 1.2 * found.promised and lpv.verify(found.gain.certificate, found.error).holds
    assert [s.name for s in found.observer.inputs] == ["torque", "phi_estimate", "sensor"]
    plant, step, worst = arm().system, 2e-3, 0.0
    for frequency in (0.4, 1.0, 2.0):
        x, estimate, into, out = np.zeros(2), np.zeros(2), 0.0, 0.0
        for k in range(12000):
            t = k * step
            p = [2.0 + np.sin(7 * t)]
            w = np.array([np.sin(frequency * t), 3 * np.cos(2.3 * t)]) * (t < 16)
            a, b, c, d = plant.frozen(p)
            oa, ob, oc, od = found.observer.frozen(p)
            torque = 0.5 * np.sin(0.3 * t)
            u = np.array([2 * np.sin(x[0]), *w, torque])
            seen = np.array([torque, 2 * np.sin(estimate[0]), (c @ x + d @ u)[2]])
            gap = (c @ x + d @ u)[1] - (oc @ estimate + od @ seen)[1]
            x, estimate = x + step * (a @ x + b @ u), estimate + step * (oa @ estimate + ob @ seen)
            into, out = into + w @ w, out + gap**2
        worst = max(worst, np.sqrt(out / into))
    assert 0.1 * bound < worst <= bound


@pytest.mark.seconds
def test_a_larger_constant_costs():
    gains = [lpv.LipschitzObserver("phi", "angle", c).solve(arm()).gain.upper for c in (0.5, 2.0)]
    assert gains[0] < gains[1]


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="input of the nonlinearity"):
        lpv.LipschitzObserver("nothing", "angle", 1.0).solve(arm())
    with pytest.raises(lpv.InputError, match="a Lipschitz constant"):
        lpv.LipschitzObserver("phi", "angle", -1.0)
