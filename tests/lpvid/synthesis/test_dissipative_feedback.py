"""Dissipative state feedback: its bound for every share of the control, against independent answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.synthesis.dissipative_feedback import SHARE, DissipativeFeedback
from lpvid.synthesis.generalized_plant import GeneralizedPlant

C1 = np.array([[3.0, 0.4], [0.0, 1.0], [0.0, 0.0]])


def plant(stiffness: float = 4.0, damping: float = 0.6, effort: float = 0.5, moves: float = 0.5,
          **changes) -> GeneralizedPlant:
    """A mass on a spring and a damper that moves with p, pushed by w and u; z: position, velocity, effort."""
    a = np.array([[[0.0, 1.0], [-stiffness, -damping]], [[0.0, 0.0], [0.0, -moves]]])
    b = np.zeros((2, 2, 2))
    b[0] = [[0.0, 0.0], [1.0, 1.0]]
    c = np.zeros((2, 5, 2))
    c[0, :3], c[0, 3:] = C1, np.eye(2)
    d = np.zeros((2, 5, 2))
    d[0, 2, 1] = effort
    parts = {"A": a, "B": b, "C": c, "D": d} | changes
    system = LPVStateSpace(parts["A"], parts["B"], parts["C"], parts["D"], Polynomial("p", 1), None,
                           Scheduling(("p",), (0.0,), (1.0,)), inputs=(Signal("w"), Signal("u")),
                           outputs=tuple(map(Signal, ("position", "velocity", "effort", "x_0", "x_1"))))
    return GeneralizedPlant(system, ["u"], ["x_0", "x_1"])


@pytest.mark.seconds
def test_bound_holds_on_random_courses_of_share_and_scheduling() -> None:
    given = plant()
    found = lpv.synthesize(given, DissipativeFeedback())
    assert found.solved and found.between_grid and found.closed_loop.box.names == ("p", SHARE)
    rng, step = np.random.default_rng(3), 0.02
    k = found.controller.D[0]
    worst = 0.0
    for trial in range(20):
        x, energy, drive = np.zeros(2), 0.0, 0.0
        for n in range(1500):
            if n % (1 + 5 * trial) == 0:
                p, s = rng.random(), rng.choice([0.0, rng.random(), 1.0])
                at = given.at(np.array([[p]])).point(0)
                flow = np.block([[at.A + s * at.B2 @ k, at.B1], [np.zeros((1, 3))]])
                e = expm(flow * step)
            w = np.sin(2.0 * n * step) if trial % 2 else rng.normal()
            z = np.concatenate([C1[:2] @ x, [s * 0.5 * (k @ x)[0]]])
            energy, drive, x = energy + z @ z, drive + w * w, e[:2, :2] @ x + e[:2, 2] * w
        worst = max(worst, np.sqrt(energy / drive))
    assert 0.1 * found.gamma_verified < worst < found.gamma_verified


@pytest.mark.seconds
def test_certified_gain_is_above_every_frozen_one_and_checked_by_others() -> None:
    found = lpv.synthesize(plant(), DissipativeFeedback())
    worst = 0.0
    for p in found.closed_loop.box.grid(15):
        a, b, c, d = found.closed_loop.frozen(p)
        for omega in np.geomspace(0.1, 30.0, 200):
            g = c @ np.linalg.solve(1j * omega * np.eye(2) - a, b + 0j) + d
            worst = max(worst, float(np.linalg.norm(g, 2)))
    assert worst <= found.gamma_lower * (1 + 1e-6) <= found.gamma_verified
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert found.gamma_verified <= found.gamma and found.infimum <= found.gamma_verified * 1.002


def test_far_above_the_least_bound_the_gain_is_that_of_the_lyapunov_equation() -> None:
    # γ → ∞, no scheduling: P solves AᵀP + PA + C1ᵀC1 = 0 (scipy), K = −R⁻¹B2ᵀP
    given = plant(moves=0.0)
    found = lpv.synthesize(given, DissipativeFeedback(back_off=100.0))
    at = given.at(np.array([[0.0]])).point(0)
    p = solve_continuous_lyapunov(at.A.T, -C1.T @ C1)
    np.testing.assert_allclose(found.controller.D[0], -at.B2.T @ p / 0.25, rtol=2e-2)


def test_any_share_lowers_the_mean_square() -> None:
    given = plant(moves=0.0)
    found = lpv.synthesize(given, DissipativeFeedback(back_off=10.0))
    costs = []
    for s in (0.0, 0.2, 0.5, 1.0):
        a, b, c, _ = found.closed_loop.frozen([0.3, s])
        costs.append(float((b.T @ solve_continuous_lyapunov(a.T, -c.T @ c) @ b)[0, 0]))
    assert max(costs[1:]) < costs[0]


@pytest.mark.slow
def test_without_the_control_nothing_is_worse_than_the_plant_alone() -> None:
    found = lpv.synthesize(plant(), DissipativeFeedback())
    a, _, _, _ = found.closed_loop.frozen([0.4, 0.0])
    np.testing.assert_allclose(a, [[0.0, 1.0], [-4.0, -0.8]])
    alone = lpv.l2_gain(LPVStateSpace(found.closed_loop.A[::2], found.closed_loop.B[::2], found.closed_loop.C[::2],
                                      found.closed_loop.D[::2], Polynomial("p", 1), None,
                                      Scheduling(("p",), (0.0,), (1.0,)), inputs=(Signal("w"),)))
    assert found.gamma_verified >= alone.lower


@pytest.mark.seconds
def test_other_units_change_nothing() -> None:
    one = lpv.synthesize(plant(), DissipativeFeedback())
    scale = np.array([1e3, 1e-2])
    given = plant()
    s = given.system
    turned = LPVStateSpace(s.A * scale[:, None] / scale, s.B * scale[:, None], s.C / scale, s.D, s.basis, None, s.box,
                           inputs=s.inputs, outputs=s.outputs)
    other = lpv.synthesize(GeneralizedPlant(turned, ["u"], ["x_0", "x_1"]), DissipativeFeedback())
    np.testing.assert_allclose(other.gamma_verified, one.gamma_verified, rtol=1e-2)
    np.testing.assert_allclose(other.controller.D[0], one.controller.D[0], rtol=5e-2)


def test_a_plant_that_grows_by_itself_gets_a_verdict() -> None:
    found = lpv.synthesize(plant(damping=-0.1, moves=0.0), DissipativeFeedback())
    assert found.verdict == "unstabilisable" and "grows by 0.05" in found.why and not found.solved


def test_what_it_refuses() -> None:
    d = np.zeros((2, 5, 2))
    with pytest.raises(InputError, match="nothing limits the controls"):
        lpv.synthesize(plant(D=d), DissipativeFeedback())
    d[0, 0, 1] = 1.0
    with pytest.raises(InputError, match="a performance signal of its own"):
        lpv.synthesize(plant(D=d), DissipativeFeedback())
    b = np.zeros((2, 2, 2))
    b[0], b[1, 1, 1] = [[0.0, 0.0], [1.0, 1.0]], 0.3
    with pytest.raises(InputError, match="does not vary with the scheduling"):
        lpv.synthesize(plant(B=b), DissipativeFeedback())
    with pytest.raises(InputError, match="back_off must be at least 1"):
        DissipativeFeedback(back_off=0.9)
    sampled = plant().system.replace(sample_time=0.1)
    with pytest.raises(InputError, match="continuous time"):
        lpv.synthesize(GeneralizedPlant(sampled, ["u"], ["x_0", "x_1"]), DissipativeFeedback())
