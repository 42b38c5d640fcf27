"""Designs over a hull with a Lyapunov matrix that moves: dense mixtures and admissible trajectories as oracles."""

import dataclasses
import json
from functools import cache

import numpy as np
import pytest
from helpers.responses import held_steps
from helpers.synthesis_plants import column, plant

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.model.designed import designed
from lpvid.model.hull import KEY
from lpvid.synthesis.moving_feedback import lowest

NAMES = ("c", "s")
TRIANGLE = np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]])
HULL = lpv.Hull.of(NAMES, TRIANGLE)
MOVING = lpv.Polynomial(NAMES, 1)


def _still(matrix):
    return np.concatenate([np.asarray(matrix, dtype=float)[None], np.zeros((2, *np.shape(matrix)))])


def turning(rate, sample_time=None):
    """A resonance whose stiffness, damping, disturbance and stroke follow two variables."""
    a = np.array([[[0, 1.0], [-1, -0.4]], [[0, 0], [0.8, 0.3]], [[0, 0], [0.3, 0.8]]])
    b1, b2, c1 = _still([[0, 0], [1, 0]]), _still(column(0, 1)), _still([[1, 0], [0, 0]])
    b1[1:] = [[0, 0], [0.5, 0]], [[0.3, 0], [0, 0]]
    c1[1:] = [[0.4, 0.2], [0, 0]], [[0, 0.5], [0, 0]]
    if sample_time is not None:
        a, b1, b2 = a * sample_time, b1 * np.sqrt(sample_time), b2 * sample_time
        a[0] += np.eye(2)
    box = lpv.Scheduling(NAMES, (-1, -1), (1, 1), (rate, rate))
    return plant(a, b1, b2, c1, _still(np.zeros((2, 2))), _still(column(0, 0.3)), _still([[1, 0]]), _still([[0, 0.1]]),
                 lpv.Polynomial(NAMES, 1), box, sample_time)


def measured(rate, sample_time=None):
    """The same with both states measured without noise."""
    whole = turning(rate, sample_time).system
    c, d = np.zeros((3, 4, 2)), np.zeros((3, 4, 3))
    c[:, :2], d[:, :2], c[0, 2:] = whole.C[:, :2], whole.D[:, :2], np.eye(2)
    system = lpv.LPVStateSpace(whole.A, whole.B, c, d, whole.basis, sample_time, whole.box, inputs=whole.inputs,
                               outputs=("z1", "z2", "x1", "x2"))
    return lpv.GeneralizedPlant(system, ["u1"], ["x1", "x2"])


def synthesized(design, sample_time=None, lyapunov=MOVING, **more):
    """Over the triangle at rates of 0.5 1/s, designed once: tests look at the same few loops."""
    return _synthesized(design, sample_time, lyapunov, tuple(more.items()))


@cache
def _synthesized(design, sample_time, lyapunov, more):
    given = (measured if design is lpv.StateFeedback else turning)(0.5, sample_time)
    points = {} if lyapunov is None else {"points": 4}
    return lpv.synthesize(given, design(hull=HULL, lyapunov=lyapunov, **points, **dict(more)))


def mixtures(rng, count):
    """Random means of the vertices, edges and corners among them."""
    shares = rng.dirichlet(np.full(3, 0.6), count)
    return np.vstack([TRIANGLE, shares @ TRIANGLE])


def storage(certificate, points):
    """P over the loop's own states, and how its slopes along each variable act, by the certificate's numbers alone."""
    cols = [certificate.box.names.index(n) for n in certificate.basis.names]
    value = np.tensordot(certificate.basis.evaluate(points[:, cols]), certificate.matrices, axes=1)
    back = np.eye(value.shape[1]) if certificate.states is None else np.linalg.inv(certificate.states)
    if certificate.inverse:
        value = np.linalg.inv(value)
    return back.T @ value @ back


def worst_of_mixtures(found, rng, count=150):
    """The largest eigenvalue of the bounded-real inequality, by differences of P along the motion; below zero: holds.

    In discrete time the steps are those of the rate bounds, to corners and within.
    """
    loop, held = found.closed_loop, found.certificate
    gamma, points, worst = held.gamma, mixtures(rng, count), -np.inf
    order = [held.box.names.index(n) for n in loop.basis.names]
    rates = np.array([r if r is not None else np.nan for r in held.box.rate])
    for p, here in zip(points, storage(held, points), strict=True):
        a, b, c, d = loop.frozen(p[order])
        for _ in range(4):
            sign = rng.choice([-1.0, 1.0], 2) if rng.random() < 0.6 else rng.uniform(-1, 1, 2)
            if loop.is_discrete:
                ahead = p + sign * rates * loop.sample_time if np.isfinite(rates).all() else mixtures(rng, 1)[-1]
                then = storage(held, ahead[None])[0]
                inner = np.block([[a.T @ then @ a - here, a.T @ then @ b],
                                  [b.T @ then @ a, b.T @ then @ b - gamma * np.eye(b.shape[1])]])
            else:
                step = 1e-5 * sign * rates
                slope = (storage(held, (p + step)[None])[0] - storage(held, (p - step)[None])[0]) / 2e-5
                inner = np.block([[a.T @ here + here @ a + slope, here @ b], [b.T @ here, -gamma * np.eye(b.shape[1])]])
            out = np.hstack([c, d])
            whole = inner + out.T @ out / gamma
            size = np.sqrt(np.abs(np.diag(whole)))
            worst = max(worst, float(np.linalg.eigvalsh(whole / np.outer(size, size))[-1]))
    return worst


def reached(found, rate, rng, steps=600, held=0.02):
    """‖z‖/‖w‖ along a trajectory that turns within the triangle no faster than the rate; w what the state asks for."""
    loop = found.closed_loop
    held = loop.sample_time or held
    n, m = loop.order, len(loop.inputs)
    p, heading, path = TRIANGLE.mean(axis=0), rng.choice([-1.0, 1.0], 2), []
    for _ in range(steps):
        path.append(p)
        trial = p + heading * rate * held
        if not HULL.contains(trial[None])[0] or rng.random() < 0.01:
            heading = rng.choice([-1.0, 1.0], 2)
            trial = p + heading * rate * held
        p = trial if HULL.contains(trial[None])[0] else p
    a, b, c, d = loop.at(np.array(path))
    if loop.is_discrete:
        out = np.concatenate([c, d], axis=2)
        moves = np.concatenate([a, b], axis=2), out.swapaxes(1, 2) @ out
    else:
        moves = held_steps((a, b, c, d), held)
    x, w, energy, output = np.zeros(n), rng.standard_normal(m), 0.0, 0.0
    for step, square, of_w in zip(*moves, b, strict=True):
        y = np.concatenate([x, w])
        output += float(y @ square @ y)
        energy += (1.0 if loop.is_discrete else held) * float(w @ w)
        x = (step @ y)[:n]
        w = of_w.T @ x / max(np.linalg.norm(x), 1e-9) + 0.3 * rng.standard_normal(m)
    return np.sqrt(output / energy)


def kept(found, rate, rng):
    """Verified anew, at dense mixtures, along trajectories, and after a round trip through JSON."""
    assert found.solved and found.region == "polytope" and found.between_grid
    assert "polytope of 3 vertices" in found.certificate.claim and "whole polytope" in repr(found)
    again = lpv.Synthesis.from_dict(json.loads(json.dumps(found.to_dict())))
    assert lpv.verify(again.certificate, again.closed_loop).holds
    assert worst_of_mixtures(again, rng) < 0
    assert max(reached(found, rate, rng) for _ in range(3)) <= found.gamma_verified
    lower = dataclasses.replace(found.certificate, gamma=0.8 * found.certificate.gamma)
    assert not lpv.verify(lower, found.closed_loop).holds


@pytest.mark.seconds
@pytest.mark.parametrize("varying", ["controls", pytest.param("measurements", marks=pytest.mark.seconds)])
@pytest.mark.parametrize("sample_time", [None, 0.05])
def test_output_feedback_whose_matrix_moves(sample_time, varying, rng):
    still = synthesized(lpv.OutputFeedback, sample_time, None)
    found = synthesized(lpv.OutputFeedback, sample_time, varying=varying)
    assert found.gamma_verified < 0.95 * still.gamma_verified and "for scheduling that jumps" in found.notes[0]
    assert found.certificate.kind == "parameter-dependent" and "|d c/dt| <= 0.5" in found.certificate.claim
    kept(found, 0.5, rng)


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.05])
@pytest.mark.parametrize("design", [lpv.StateFeedback, lpv.Observer])
def test_a_gain_whose_matrix_moves(design, sample_time, rng):
    still, found = (synthesized(design, sample_time, p) for p in (None, MOVING))
    assert found.gamma_verified <= still.gamma_verified * (1 + 1e-3)
    kept(found, 0.5, rng)


@pytest.mark.seconds
@pytest.mark.parametrize("design", [lpv.StateFeedback, lpv.Observer])
def test_a_bound_that_is_asked_for_leaves_room_for_the_fit(design):
    """A tenth above the least bound: the program that takes all of it has no room for a gain that is fitted."""
    plant = (measured if design is lpv.StateFeedback else turning)(0.5)
    least = synthesized(design).infimum
    found = lpv.synthesize(plant, design(lpv.HInfinity(bound=1.1 * least), hull=HULL, lyapunov=MOVING, points=4))
    assert found.verdict == "solved" and found.gamma_verified <= 1.1 * least
    assert lpv.verify(found.certificate, found.closed_loop).holds


@pytest.mark.seconds
def test_output_feedback_that_is_solved_keeps_the_bound_that_was_asked_for():
    """A tenth above the least bound: the formula of that bound is proven above it, one of half as much room below."""
    design = lpv.OutputFeedback(hull=HULL, lyapunov=MOVING, varying="controls", points=4)
    least = synthesized(lpv.OutputFeedback, varying="controls").infimum
    found = lpv.synthesize(turning(0.5), dataclasses.replace(design, bound=1.1 * least))
    assert found.verdict == "solved" and found.gamma_verified <= 1.1 * least
    assert lpv.verify(found.certificate, found.closed_loop).holds


def test_of_two_sides_both_must_be_infeasible():
    """What X cannot keep Y may keep: without a controller of Y that none exists is not shown."""
    refused, lost = lpv.Synthesis("infeasible", why="least bound 2"), lpv.Synthesis("numerical", why="not written down")
    for order in ((refused, lost), (lost, refused)):
        assert lowest(order, refused).verdict == "numerical"
    assert lowest((refused, refused), refused).verdict == "infeasible"


@pytest.mark.slow
def test_faster_motion_costs_more_and_jumps_cost_what_constants_do():
    gains = [lpv.synthesize(measured(rate), lpv.StateFeedback(hull=HULL, lyapunov=MOVING)).gamma_verified
             for rate in (0.05, 1.0, 30.0)]
    still = lpv.synthesize(measured(None), lpv.StateFeedback(hull=HULL)).gamma_verified
    assert gains[0] < gains[1] < gains[2] * (1 + 1e-3) and gains[2] <= 1.02 * still


@pytest.mark.seconds
def test_steps_from_vertex_to_vertex_without_rate_bounds(rng):
    """Discrete time: P(p) affine for jumps, no worse than one P."""
    still, found = (lpv.synthesize(turning(None, 0.05), lpv.OutputFeedback(hull=HULL, lyapunov=p)) for p in
                    (None, MOVING))
    assert found.gamma_verified <= still.gamma_verified * (1 + 1e-3)
    assert lpv.verify(found.certificate, found.closed_loop).holds
    if found.certificate.kind == "poly-quadratic":
        assert worst_of_mixtures(found, rng) < 0


@pytest.mark.parametrize("sample_time", [None, pytest.param(0.05, marks=pytest.mark.seconds)])
def test_an_interval_is_the_box(sample_time):
    """One variable: the hull of its ends has the least bound of the box, by other programs and another proof."""
    a = np.array([[[0, 1.0], [-1, -0.4]], [[0, 0], [0.8, 0.3]]])
    b, c, d = np.zeros((2, 2, 3)), np.zeros((2, 3, 2)), np.zeros((2, 3, 3))
    b[0], c[0] = [[0, 0, 0], [1, 0, 1]], [[1, 0], [0, 0], [1, 0]]
    d[0, 1, 2], d[0, 2, 1] = 0.3, 0.1
    if sample_time is not None:
        a, b = a * sample_time, b * sample_time
        a[0] += np.eye(2)
    box = lpv.Scheduling(("c",), (-1.0,), (1.0,), (0.2,))
    system = lpv.LPVStateSpace(a, b, c, d, lpv.Polynomial("c", 1), sample_time, box)
    given = lpv.GeneralizedPlant(system, ["u3"], ["y3"])
    ends = lpv.Hull.of(("c",), np.array([[-1.0], [1.0]]))
    on_hull, on_box = (lpv.synthesize(given, lpv.OutputFeedback(hull=hull, lyapunov=lpv.Polynomial("c", 1),
                                                               varying="controls")) for hull in (ends, None))
    assert on_hull.infimum == pytest.approx(on_box.infimum, rel=0.02)
    assert on_hull.gamma_verified <= 1.05 * on_box.gamma_verified
    assert lpv.verify(on_hull.certificate, on_hull.closed_loop).holds


@pytest.mark.seconds
def test_three_variables(rng):
    """A tetrahedron: gains of the analysis at rates against dense mixtures, and against one P for jumps."""
    names, corners = ("p", "q", "r"), np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    a = np.array([[[0, 1.0], [-1, -1.2]], [[0, 0], [0, 0.8]], [[0, 0], [-0.3, 0.35]], [[0, 0], [0.5, 0.1]]])
    b, c = np.zeros((4, 2, 1)), np.zeros((4, 1, 2))
    b[0], c[0] = [[0.0], [1.0]], [[1.0, 0.0]]
    box = lpv.Scheduling(names, (0,) * 3, (1,) * 3, (0.05,) * 3)
    system = lpv.LPVStateSpace(a, b, c, np.zeros((4, 1, 1)), lpv.Polynomial(names, 1), None, box)
    hull = lpv.Hull.of(names, corners)
    loop = designed(system.replace(metadata={KEY: hull.to_dict()}), "closed loop")
    slow, jumps = lpv.l2_gain(loop), lpv.hull_gain(system, hull)
    frozen = max(h_infinity_norm(system.frozen(p))[0] for p in rng.dirichlet(np.ones(4), 300) @ corners)
    assert frozen <= slow.upper < jumps.upper and len(slow.certificate.vertices) == 4
    assert lpv.verify(slow.certificate, loop).holds


@pytest.mark.seconds
def test_a_certificate_without_a_polytope_does_not_hold():
    found = synthesized(lpv.OutputFeedback, 0.05, varying="controls")
    held = found.certificate
    for vertices, why in ((np.zeros((0, 2)), "no vertices"), (TRIANGLE[:2], "no inside"),
                          (TRIANGLE[:, :1], "variables"), (np.full((3, 2), np.nan), "not finite"),
                          (2 * TRIANGLE, "leaves its box")):
        outcome = lpv.verify(dataclasses.replace(held, vertices=vertices), found.closed_loop)
        assert not outcome.holds and why in outcome.why
    smaller = dataclasses.replace(held, vertices=0.5 * TRIANGLE)
    outcome = lpv.verify(smaller, found.closed_loop)  # true, of a smaller set than that of the design
    assert outcome.holds and "3 of the 3 vertices of the design's hull lie outside of it" in outcome.why
    assert "c in [-0.5, 0.5]" in smaller.claim and "c in [-1, 1]" in held.claim
    assert "design's hull" not in lpv.verify(held, found.closed_loop).why
    faster = dataclasses.replace(held.box, rate=(20.0, 20.0))
    assert not lpv.verify(dataclasses.replace(held, box=faster), found.closed_loop).holds


@pytest.mark.seconds
def test_control_gain_that_moves():
    """A plant whose control gain moves has no affine loop, and with a matrix that moves it needs none."""
    system = turning(0.5).system
    b = np.array(system.B)
    b[1, 1, 2] = 0.2
    uneven = lpv.GeneralizedPlant(system.replace(B=b), ["u1"], ["y1"])
    found = lpv.synthesize(uneven, lpv.OutputFeedback(hull=HULL, lyapunov=MOVING, varying="measurements", points=4))
    assert found.solved and found.region == "polytope"
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert "steady gains" in found.notes[0]


def test_bad_input_in_one_line():
    for design in (lpv.OutputFeedback, lpv.StateFeedback, lpv.Observer):
        with pytest.raises(lpv.InputError, match=r"on a hull is a polynomial: got Fourier"):
            design(hull=HULL, lyapunov=lpv.Fourier("c", 1, 2.0))
    for design in (lpv.MultiObjective, lpv.FixedStructure):
        with pytest.raises(lpv.InputError, match="constant Lyapunov matrices here"):
            design(hull=HULL, lyapunov=MOVING)
    with pytest.raises(lpv.InputError, match="in discrete time has degree one: got degree 2"):
        lpv.synthesize(turning(0.5, 0.05), lpv.OutputFeedback(hull=HULL, lyapunov=lpv.Polynomial(NAMES, 2)))
    with pytest.raises(lpv.InputError, match="whose rate has no bound"):
        lpv.synthesize(turning(None), lpv.OutputFeedback(hull=HULL, lyapunov=MOVING))
