"""Full-order designs over scheduling sets that are no boxes: the box, fine grids and random trajectories as oracles."""

import json
from functools import cache

import numpy as np
import pytest
from helpers.responses import held_steps, largest_gain
from helpers.synthesis_plants import column, plant, wu
from scipy.linalg import solve_continuous_lyapunov

import lpvid as lpv
from lpvid.model.hull import outside_share
from lpvid.synthesis.design_log import limits

NAMES = ("c", "s")
DISC = lpv.Hull.disc(NAMES, sides=16)
SQUARE = lpv.Hull.disc(NAMES, sides=4)


def _still(matrix):
    return np.concatenate([np.asarray(matrix, dtype=float)[None], np.zeros((2, *np.shape(matrix)))])


def turning(sample_time=None, moving=False, unit=1.0):
    """A resonance whose stiffness and damping follow cos θ and sin θ; `moving` lets B1 and C1 follow them too."""
    a = np.array([[[0, 1.0], [-1, -0.4]], [[0, 0], [0.8, 0.3]], [[0, 0], [0.3, 0.8]]])
    b1, b2, c1 = _still([[0, 0], [1, 0]]), _still(column(0, 1)), _still([[1, 0], [0, 0]])
    if moving:
        b1[1:] = [[0, 0], [0.5, 0]], [[0.3, 0], [0, 0]]
        c1[1:] = [[0.4, 0.2], [0, 0]], [[0, 0.5], [0, 0]]
    if sample_time is not None:
        a, b1, b2 = a * sample_time, b1 * np.sqrt(sample_time), b2 * sample_time
        a[0] += np.eye(2)
    for m in (a, b1, c1):
        m[1:] /= unit
    box = lpv.Scheduling(NAMES, (-unit, -unit), (unit, unit))
    return plant(a, b1, b2, c1, _still(np.zeros((2, 2))), _still(column(0, 0.3)), _still([[1, 0]]), _still([[0, 0.1]]),
                 lpv.Polynomial(NAMES, 1), box, sample_time)


def synthesized(hull=DISC, sample_time=None, moving=False):
    """Output feedback, designed once: most tests look at the same few loops."""
    return _synthesized(hull, sample_time, moving)


@cache
def _synthesized(hull, sample_time, moving):
    return lpv.synthesize(turning(sample_time, moving), lpv.OutputFeedback(hull=hull))


def _polar(turns=24, rings=4):
    angle = np.linspace(0, 2 * np.pi, turns, endpoint=False)
    return np.vstack([r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in np.linspace(0, 1, rings)])


def _largest_frozen(loop, points):
    """By singular values on a fine grid of frequencies."""
    found = 0.0
    for p in points:
        a, b, c, d = loop.frozen(p)
        if loop.is_discrete:
            assert np.abs(np.linalg.eigvals(a)).max() < 1
            grid = np.exp(1j * np.concatenate([[0.0], np.geomspace(1e-4, np.pi, 400)]))
        else:
            assert np.linalg.eigvals(a).real.max() < 0
            grid = 1j * np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 400)])
        found = max(found, largest_gain((a, b, c, d), grid))
    return found


def _driven(loop, rng, steps=800, held=0.02):
    """‖z‖/‖w‖ on a trajectory that jumps within the disc, w the input that the state asks for most, or at random.

    Exact over each interval: the state and ∫|z|² of constant w and p by matrix exponentials.
    """
    angle, radius = np.cumsum(rng.normal(0, rng.uniform(0.02, 1.0), steps)), np.sqrt(rng.uniform(0.3, 1, steps))
    n, m = loop.order, len(loop.inputs)
    systems = loop.at((radius * [np.cos(angle), np.sin(angle)]).T)
    x, energy, reached = np.zeros(n), 0.0, 0.0
    w = rng.standard_normal(m)
    for step, square, b in zip(*held_steps(systems, held), systems[1], strict=True):
        y = np.concatenate([x, w])
        reached += float(y @ square @ y)
        energy += held * float(w @ w)
        x = (step @ y)[:n]
        w = b.T @ x / max(np.linalg.norm(x), 1e-9) + 0.3 * rng.standard_normal(m)
    return np.sqrt(reached / energy)


@pytest.mark.seconds
def test_square_is_the_box():
    """Four sides around the circle are the box itself: the least bounds are the same."""
    hull, box = (synthesized(h) for h in (SQUARE, None))
    assert hull.solved and box.solved and hull.infimum == pytest.approx(box.infimum, rel=1e-3)
    hull, box = (lpv.synthesize(turning(), lpv.MultiObjective(lpv.H2(), feedthrough=False, hull=h))
                 for h in (SQUARE, None))
    assert hull.solved and box.solved and hull.h2_verified == pytest.approx(box.h2_verified, rel=2e-3)


@pytest.mark.seconds
@pytest.mark.parametrize("moving", [False, True])
def test_disc_admits_less_than_the_box_and_keeps_it(moving, rng):
    box, found = (synthesized(h, moving=moving) for h in (None, DISC))
    assert found.verdict == "solved" and found.between_grid and found.region == "polytope"
    assert found.gamma_verified < 0.91 * box.gamma_verified
    assert found.gamma_verified <= 1.02 * found.infimum
    assert "polytope of 16 vertices" in found.certificate.claim and "whole polytope" in repr(found)
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert found.controller.basis.degree == 1 and found.controller.order == 2
    worst = _largest_frozen(found.closed_loop, _polar())
    assert 0.9 * found.gamma_lower <= worst <= found.gamma_verified
    assert max(_driven(found.closed_loop, rng) for _ in range(4)) <= found.gamma_verified
    poles = [np.abs(np.linalg.eigvals(found.controller.frozen(p)[0])).max() for p in DISC.vertices()]
    assert max(poles) < 2 * np.pi * 1e3  # one at 2e8 Hz without a coupling apart from its limit


def test_storage_function_bounds_the_gain_inside():
    """The bounded-real inequality of the certificate's P at points between the vertices, by its Schur complement."""
    found = synthesized()
    p, gamma = found.certificate.matrix, found.certificate.gamma
    for point in _polar(36, 6):
        a, b, c, d = found.closed_loop.frozen(point)
        inner = np.block([[a.T @ p + p @ a, p @ b], [b.T @ p, -gamma * np.eye(b.shape[1])]])
        out = np.hstack([c, d])
        assert np.linalg.eigvalsh(inner + out.T @ out / gamma).max() < 0


@pytest.mark.seconds
def test_more_sides_come_closer():
    gains = [synthesized(h).infimum for h in (SQUARE, lpv.Hull.disc(NAMES, sides=8), DISC)]
    assert gains[0] > gains[1] > gains[2]
    angle = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    inner = lpv.Hull.of(NAMES, np.column_stack([np.cos(angle), np.sin(angle)]))  # inside the circle
    assert lpv.synthesize(turning(), lpv.OutputFeedback(hull=inner)).infimum <= gains[2] * (1 + 1e-3)


@pytest.mark.seconds
def test_unit_and_order_of_the_variables_change_nothing():
    percent = lpv.Hull.disc(("s", "c"), radius=100.0, sides=16)
    one = synthesized()
    other = lpv.synthesize(turning(unit=100.0), lpv.OutputFeedback(hull=percent))
    assert other.infimum == pytest.approx(one.infimum, rel=1e-3)
    assert lpv.verify(other.certificate, other.closed_loop).holds


@pytest.mark.seconds
def test_discrete_time():
    box, found = (synthesized(h, 0.05) for h in (None, DISC))
    assert found.verdict == "solved" and found.gamma_verified < 0.96 * box.gamma_verified
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert _largest_frozen(found.closed_loop, _polar(12, 3)) <= found.gamma_verified


@pytest.mark.seconds
def test_h2_beside_a_gain():
    """The mixed problem: the bound is kept, and the rms is above that of every held loop (Lyapunov equation)."""
    criteria = [lpv.HInfinity(bound=0.75), lpv.H2("w1", ("z1", "z2"))]
    box, found = (lpv.synthesize(turning(), lpv.MultiObjective(criteria, feedthrough=False, hull=h))
                  for h in (None, DISC))
    assert found.verdict == "solved" and found.gamma_verified <= 0.75
    assert found.h2_verified < 0.8 * box.h2_verified
    assert all("whole polytope" in note for note in found.notes[:2])
    held = []
    for p in _polar():
        a, b, c, _ = found.closed_loop.frozen(p)
        held.append(np.sqrt(np.trace(c @ solve_continuous_lyapunov(a, -b[:, :1] @ b[:, :1].T) @ c.T)))
    assert 0.4 * found.h2_verified < max(held) <= found.h2_verified


def measured(sample_time=None):
    """The turning resonance with both states measured without noise."""
    whole = turning(sample_time, moving=True).system
    c, d = np.zeros((3, 4, 2)), np.zeros((3, 4, 3))
    c[:, :2], d[:, :2], c[0, 2:] = whole.C[:, :2], whole.D[:, :2], np.eye(2)
    system = lpv.LPVStateSpace(whole.A, whole.B, c, d, whole.basis, sample_time, whole.box, inputs=whole.inputs,
                               outputs=("z1", "z2", "x1", "x2"))
    return lpv.GeneralizedPlant(system, ["u1"], ["x1", "x2"])


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.05])
@pytest.mark.parametrize("criterion", [lpv.HInfinity(), lpv.H2()])
def test_state_feedback(sample_time, criterion):
    """Four sides give the box's figure, sixteen less; with the controller a constant gain at every frozen point."""
    def figure(hull):
        found = lpv.synthesize(measured(sample_time), lpv.StateFeedback(criterion, hull=hull))
        assert found.verdict == "solved" and found.between_grid
        assert lpv.verify(found.certificate, found.closed_loop).holds
        return found, found.gamma_verified if found.h2_verified is None else found.h2_verified

    (_, box), (_, square), (loop, disc) = [figure(h) for h in (None, SQUARE, DISC)]
    assert square == pytest.approx(box, rel=2e-3) and disc < 0.87 * box
    assert loop.controller.order == 0 and loop.controller.basis.degree == 1
    assert _largest_frozen(loop.closed_loop, _polar(12, 3)) <= loop.gamma_verified


@pytest.mark.seconds
def test_h2_alone_has_a_gain_with_a_certificate():
    found = lpv.synthesize(turning(), lpv.MultiObjective(lpv.H2(), feedthrough=False, hull=DISC))
    assert found.solved and found.region == "polytope"
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert _largest_frozen(found.closed_loop, _polar(16, 3)) <= found.gamma_verified


@pytest.mark.seconds
def test_coupling_stays_off_its_limit():
    """A peak beside a gain over the box: at the limit of the coupling the controller had a pole at 3e8 Hz."""
    found = lpv.synthesize(turning(), lpv.MultiObjective([lpv.GeneralizedH2("w1", "z1"), lpv.HInfinity()]))
    poles = [np.abs(found.controller.frozen_poles(p)).max() for p in turning().box.grid(2)]
    assert found.solved and max(poles) < 2 * np.pi * 1e4


def test_result_names_its_set(tmp_path):
    """The controller knows the hull (extrapolation is counted against it), the design log looks at its vertices."""
    found = synthesized()
    again = lpv.Synthesis.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.region == "polytope" and lpv.verify(again.certificate, again.closed_loop).holds
    assert outside_share(again.controller, np.array([[1.0, 1.0], [0.5, 0.5]])) == 0.5
    assert all(DISC.contains(np.array([[v for _, v, _ in limit.at]]))[0] for limit in limits(again.closed_loop))


@pytest.mark.seconds
def test_a_bound_that_is_too_low():
    found = lpv.synthesize(turning(), lpv.OutputFeedback(hull=DISC, bound=0.5))
    assert found.verdict == "infeasible" and "smaller hull" in found.mend and "lyapunov=" in found.mend


@pytest.mark.slow
def test_lifted_angle_without_rate_bound_is_infeasible():
    """Wu et al. 1996: a constant Lyapunov function is infeasible, also on the circle of cos ρ and sin ρ."""
    turned = wu(None)
    lifted = lpv.lift(turned.system).system
    found = lpv.synthesize(lpv.GeneralizedPlant(lifted, turned.controls, turned.measurements),
                           lpv.OutputFeedback(hull=lpv.Hull.disc(lifted.box.names)))
    assert found.verdict == "infeasible"


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="names other variables than the plant: got c, q; the plant has c, s"):
        lpv.synthesize(turning(), lpv.OutputFeedback(hull=lpv.Hull.disc(("c", "q"))))
    for design in (lpv.OutputFeedback, lpv.MultiObjective, lpv.FixedStructure, lpv.StateFeedback, lpv.Observer,
                   lambda hull: lpv.Filter(hull=hull).solve(turning())):
        with pytest.raises(lpv.InputError, match=r"got str.*lpv\.Hull\.of"):
            design(hull="disc")
    with pytest.raises(lpv.InputError, match="a gain of degree one"):
        lpv.StateFeedback(hull=DISC, gain=lpv.Polynomial(NAMES, 2))
    bent = wu(None)
    with pytest.raises(lpv.InputError, match=r"affine in its scheduling variables.*lpv\.lift"):
        lpv.synthesize(bent, lpv.OutputFeedback(hull=lpv.Hull.of(("rho",), np.array([[-1.0], [1.0]]))))
    system = turning().system
    unsteady = np.array(system.B)
    unsteady[1, 1, 2] = 0.2
    uneven = lpv.GeneralizedPlant(system.replace(B=unsteady), ["u1"], ["y1"])
    with pytest.raises(lpv.InputError, match=r"steady gains of controls and measurements.*got u1.*add_actuator"):
        lpv.synthesize(uneven, lpv.OutputFeedback(hull=DISC))
