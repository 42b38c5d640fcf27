"""Observers, filters and pole regions over polytopes: the box, dense mixtures of the vertices and runs as oracles."""

from functools import cache

import numpy as np
import pytest
from helpers.responses import largest_gain
from helpers.synthesis_plants import column, plant
from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_lyapunov

import lpvid as lpv

NAMES = ("p", "q")
TRIANGLE = lpv.Hull.of(NAMES, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))


def _still(matrix):
    return np.concatenate([np.asarray(matrix, dtype=float)[None], np.zeros((2, *np.shape(matrix)))])


def mixed(sample_time=None):
    """An oscillator whose damping falls with p and stiffness with q: unstable without control at p = q = 1."""
    a = np.array([[[0, 1.0], [-2, -1.2]], [[0, 0], [0.2, 0.7]], [[0, 0], [0.6, 0.65]]])
    b1, b2 = _still([[0, 0], [1, 0]]), _still(column(0, 1))
    if sample_time is not None:
        a, b1, b2 = a * sample_time, b1 * np.sqrt(sample_time), b2 * sample_time
        a[0] += np.eye(2)
    return plant(a, b1, b2, _still([[1, 0], [0, 0]]), _still(np.zeros((2, 2))), _still(column(0, 0.3)),
                 _still([[1, 0]]), _still([[0, 0.1]]), lpv.Polynomial(NAMES, 1),
                 lpv.Scheduling(NAMES, (0.0, 0.0), (1.0, 1.0)), sample_time)


@cache
def observed(sample_time=None):
    """The observer over the triangle, designed once."""
    return lpv.synthesize(mixed(sample_time), lpv.Observer(hull=TRIANGLE))


def mixtures(count, rng):
    return np.vstack([TRIANGLE.vertices(), rng.dirichlet(0.5 * np.ones(3), count) @ TRIANGLE.vertices()])


def largest(loop, points):
    worst = 0.0
    for p in points:
        a, b, c, d = loop.frozen(p)
        poles = np.linalg.eigvals(a)
        assert (np.abs(poles).max() < 1) if loop.is_discrete else (poles.real.max() < 0)
        at = (np.exp(1j * np.r_[0.0, np.geomspace(1e-4, np.pi, 300)]) if loop.is_discrete
              else 1j * np.r_[0.0, np.geomspace(1e-3, 1e3, 300)])
        worst = max(worst, largest_gain((a, b, c, d), at))
    return worst


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_observer_over_a_hull_is_no_worse_than_over_the_box(sample_time, rng):
    box, found = lpv.synthesize(mixed(sample_time), lpv.Observer()), observed(sample_time)
    assert found.verdict == "solved" and found.between_grid and found.region == "polytope"
    assert found.gamma_verified <= 1.01 * box.gamma_verified
    assert lpv.verify(found.certificate, found.closed_loop).holds
    assert largest(found.closed_loop, mixtures(60, rng)) <= found.gamma_verified
    assert lpv.certify_stability(found.closed_loop).vertices is not None
    assert lpv.l2_gain(found.closed_loop).upper <= 1.001 * found.gamma_verified


@pytest.mark.seconds
def test_estimate_follows_the_plant_while_the_scheduling_jumps(rng):
    """The observer as it is delivered beside the plant: its error decays, and z − ẑ is that of `closed_loop`."""
    case = mixed()
    found = lpv.synthesize(case, lpv.Observer(lpv.HInfinity("w1", "z1"), hull=TRIANGLE))
    x, estimate, error = np.array([1.0, -1.0]), np.zeros(2), np.array([1.0, -1.0])
    for p in mixtures(80, rng):
        m = case.at(p[None]).point(0)
        a, b, _, _ = found.controller.frozen(p)
        whole = np.block([[m.A, np.zeros((2, 2))], [b[:, 1:] @ m.C2, a]])
        x, estimate = np.split(expm(0.5 * whole) @ np.concatenate([x, estimate]), 2)
        error = expm(0.5 * found.closed_loop.frozen(p)[0]) @ error
        np.testing.assert_allclose(x - estimate, error, atol=1e-9)
    assert np.linalg.norm(error) < 1e-3


@pytest.mark.seconds
def test_measurements_that_vary_need_a_constant_gain(rng):
    system = mixed().system
    c = np.array(system.C)
    c[1, 2, 1] = 0.4
    case = lpv.GeneralizedPlant(system.replace(C=c), ["u1"], ["y1"])
    with pytest.raises(lpv.InputError, match=r"steady gains of measurements.*got y1.*Polynomial"):
        lpv.synthesize(case, lpv.Observer(hull=TRIANGLE))
    found = lpv.synthesize(case, lpv.Observer(hull=TRIANGLE, gain=lpv.Polynomial((), 0)))
    assert found.verdict == "solved" and lpv.verify(found.certificate, found.closed_loop).holds
    assert largest(found.closed_loop, mixtures(60, rng)) <= found.gamma_verified
    with pytest.raises(lpv.InputError, match="a gain of degree one"):
        lpv.Observer(hull=TRIANGLE, gain=lpv.Polynomial(NAMES, 2))


@pytest.mark.seconds
def test_filter_of_a_plant_that_is_stable_inside_the_hull_only(rng):
    case = mixed()
    assert lpv.synthesize(case, lpv.Filter()).verdict != "solved"  # the corner p = q = 1 is unstable
    found = lpv.synthesize(case, lpv.Filter(hull=TRIANGLE))
    assert found.verdict == "solved" and found.region == "polytope"
    assert largest(found.closed_loop, mixtures(60, rng)) <= found.gamma_verified


@pytest.mark.seconds
@pytest.mark.parametrize(("sample_time", "region"), [
    (None, lpv.HalfPlane(0.8)), (None, lpv.Cone(0.6)), (None, lpv.Disc(-6.0, 5.5)), (0.1, lpv.Disc(0.0, 0.9))])
def test_poles_stay_in_their_region_at_every_mixture(sample_time, region, rng):
    case = mixed(sample_time)
    gain = lpv.HInfinity()
    for design in (lpv.MultiObjective(gain, region, hull=TRIANGLE), lpv.OutputFeedback(regions=region, hull=TRIANGLE),
                   lpv.Observer(gain, region, hull=TRIANGLE)):
        found = lpv.synthesize(case, design)
        assert found.verdict in ("solved", "backed-off") and found.between_grid, found
        assert any("in the whole polytope" in note for note in found.notes), found.notes
        poles = np.linalg.eigvals(found.closed_loop.at(mixtures(400, rng)[:, [
            NAMES.index(n) for n in found.closed_loop.basis.names]])[0]).ravel()
        assert region.distance(poles).max() < 0
        proof = lpv.certify_region(found.closed_loop, region)
        assert proof.between_grid and "held value of p in [" in proof.certificate.claim
        assert "in a polytope of 3 vertices" in proof.certificate.claim
        assert lpv.verify(proof.certificate, found.closed_loop).holds
        if design.hull is not None and isinstance(design, lpv.MultiObjective):
            free = lpv.synthesize(case, lpv.MultiObjective(gain, hull=TRIANGLE))
            assert found.gamma_verified >= 0.99 * free.infimum


def measured(sample_time=None):
    """The oscillator with all states measured exactly."""
    base = mixed(sample_time).system
    return plant(base.A, base.B[:, :, :2], base.B[:, :, 2:], base.C[:, :2], base.D[:, :2, :2], base.D[:, :2, 2:],
                 _still(np.eye(2)), np.zeros((3, 2, 2)), base.basis, base.box, sample_time)


def test_state_feedback_with_a_region_over_a_hull(rng):
    states = measured()
    region = lpv.HalfPlane(2.0)
    found = lpv.synthesize(states, lpv.StateFeedback(regions=region, hull=TRIANGLE))
    assert found.verdict == "solved" and any("in the whole polytope" in n for n in found.notes)
    poles = np.linalg.eigvals(found.closed_loop.at(mixtures(400, rng))[0]).ravel()
    assert region.distance(poles).max() < 0


@pytest.mark.seconds
def test_decay_over_a_hull_is_between_its_slowest_pole_and_the_vertices(rng):
    found = lpv.synthesize(mixed(), lpv.OutputFeedback(hull=TRIANGLE))
    decay = lpv.decay_rate(found.closed_loop)
    slowest = -np.linalg.eigvals(found.closed_loop.at(mixtures(400, rng))[0]).real.max()
    assert decay.verdict == "certified" and 0.5 * slowest < decay.lower <= slowest * (1 + 1e-6)
    assert lpv.verify(decay.certificate, found.closed_loop).holds


@pytest.mark.seconds
@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_a_half_plane_makes_no_controller_of_millions_of_hertz(scale):
    """At a back-off of 1 % the coupling stayed at its limit, with a pole at 2e7 Hz; units of states change nothing."""
    system = mixed().system
    turned = lpv.LPVStateSpace(system.A * [[1, scale], [1 / scale, 1]], system.B * [[scale], [1]],
                               system.C * [1 / scale, 1], system.D, system.basis, None,
                               lpv.Scheduling(NAMES, (0.0, 0.0), (0.5, 0.5)), inputs=system.inputs,
                               outputs=system.outputs)
    case = lpv.GeneralizedPlant(turned, ["u1"], ["y1"])
    found = lpv.synthesize(case, lpv.OutputFeedback(regions=lpv.HalfPlane(0.8)))
    poles = [np.abs(np.linalg.eigvals(found.controller.frozen(p)[0])).max() for p in case.box.grid(3)]
    assert found.verdict == "solved" and max(poles) < 2 * np.pi * 100


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_h2_norm_of_a_loop_over_a_hull(sample_time, rng):
    """Against Gramians with the scheduling held, the design's own figure, and the covariance along jumps.

    The design bounds the covariance of the states from above; the analysis, the energy of impulse responses.
    """
    found = lpv.synthesize(mixed(sample_time), lpv.MultiObjective(lpv.H2(), feedthrough=False, hull=TRIANGLE))
    loop = found.closed_loop
    norm = lpv.h2_norm(loop)
    solve = solve_continuous_lyapunov if sample_time is None else solve_discrete_lyapunov
    held = []
    for p in mixtures(100, rng):
        a, b, c, d = loop.frozen(p)
        q = solve(a, -b @ b.T if sample_time is None else b @ b.T)
        held.append(np.sqrt(np.trace(c @ q @ c.T) + (0.0 if sample_time is None else np.sum(d**2))))
    assert max(held) <= norm.upper <= 1.05 * found.h2_verified and norm.lower == pytest.approx(max(held), rel=1e-6)
    assert lpv.verify(norm.certificate, loop).holds
    q, squares = np.zeros((loop.order,) * 2), []
    for p in mixtures(400, rng):  # covariance of the states while the scheduling jumps
        a, b, c, d = loop.frozen(p)
        if sample_time is None:
            step = expm(0.3 * a)
            still = solve(a, -b @ b.T)
            q = still + step @ (q - still) @ step.T
            squares.append(np.trace(c @ q @ c.T))
        else:
            squares.append(np.trace(c @ q @ c.T) + np.sum(d**2))
            q = a @ q @ a.T + b @ b.T
    assert np.sqrt(np.mean(squares)) <= norm.upper


@pytest.mark.seconds
@pytest.mark.parametrize(("case", "design"), [(mixed, lpv.Observer), (measured, lpv.StateFeedback)])
def test_in_discrete_time_the_lyapunov_matrix_may_follow_the_scheduling(case, design, rng):
    """Against one P, frozen norms, V along jumps with disturbances, and the inequality at steps between mixtures."""
    still = observed(0.1) if case is mixed else lpv.synthesize(case(0.1), design(hull=TRIANGLE))
    found = lpv.synthesize(case(0.1), design(hull=TRIANGLE, lyapunov=lpv.Polynomial(NAMES, 1)))
    loop, gamma = found.closed_loop, found.gamma_verified
    assert found.verdict == "solved" and found.certificate.kind == "poly-quadratic" and found.region == "polytope"
    assert found.infimum <= still.infimum * (1 + 1e-6) and gamma <= still.gamma_verified * (1 + 1e-3)
    assert lpv.verify(found.certificate, loop).holds and largest(loop, mixtures(60, rng)) <= gamma
    p = mixtures(300, rng)
    held = found.certificate
    at = held.storage.values(p[:, [NAMES.index(n) for n in held.box.names]])
    at = np.linalg.inv(at) if held.inverse else at
    x, supplied, reached = np.zeros(loop.order), 0.0, 0.0
    for k in range(len(p) - 1):
        a, b, c, d = loop.frozen(p[k][[NAMES.index(n) for n in loop.basis.names]])
        now = np.block([[at[k], np.zeros_like(b)], [np.zeros_like(b.T), gamma * np.eye(b.shape[1])]])
        step, out = np.hstack([a, b]), np.hstack([c, d])
        assert np.linalg.eigvalsh(now - step.T @ at[k + 1] @ step - out.T @ out / gamma)[0] > -1e-9 * np.abs(now).max()
        w = rng.standard_normal(b.shape[1])
        supplied, reached = supplied + w @ w, reached + np.sum((c @ x + d @ w) ** 2)
        x = a @ x + b @ w
    assert np.sqrt(reached / supplied) <= gamma
    one, moved = lpv.hull_gain(loop, TRIANGLE), lpv.hull_gain(loop, TRIANGLE, moving=True)
    assert moved.upper <= one.upper * (1 + 1e-6)
    assert lpv.l2_gain(loop).upper <= gamma * (1 + 1e-6)  # the analysis finds what the design did


def test_what_vertices_do_not_decide_is_refused_in_one_line():
    moving = lpv.Polynomial(NAMES, 1)
    with pytest.raises(lpv.InputError, match=r"depends on 'p', whose rate has no bound"):
        lpv.synthesize(mixed(), lpv.Observer(hull=TRIANGLE, lyapunov=moving))
    with pytest.raises(lpv.InputError, match=r"in discrete time has degree one: got degree 2"):
        lpv.synthesize(mixed(0.1), lpv.Observer(hull=TRIANGLE, lyapunov=lpv.Polynomial(NAMES, 2)))
    for more in ({"regions": lpv.Disc(0.0, 0.9)}, {"criteria": lpv.H2()}, {"criteria": ()}):
        with pytest.raises(lpv.InputError, match="bounds gains only"):
            lpv.Observer(hull=TRIANGLE, lyapunov=moving, **more)
    with pytest.raises(lpv.InputError, match=r"moves on a hull needs discrete time"):
        lpv.hull_gain(mixed().system, TRIANGLE, moving=True)


@pytest.mark.seconds
@pytest.mark.parametrize("constant", [lpv.Polynomial((), 0), lpv.Polynomial(NAMES, 0)])
def test_a_constant_lyapunov_matrix_may_be_written_out_beside_a_hull(constant):
    """A basis of degree zero is a constant matrix: nothing to refuse, in any design and with any criteria."""
    for design in (lpv.OutputFeedback, lpv.MultiObjective, lpv.FixedStructure, lpv.StateFeedback, lpv.Observer):
        assert design(hull=TRIANGLE, lyapunov=constant).lyapunov is None
    found = lpv.synthesize(mixed(), lpv.Observer(lpv.H2("w1", "z1"), hull=TRIANGLE, lyapunov=constant))
    assert found.verdict == "solved" and found.region == "polytope"
