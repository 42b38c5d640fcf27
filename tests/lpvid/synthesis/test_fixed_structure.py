"""Controllers of fixed structure: published optima, gradients by differences, and promises that hold."""

import json

import numpy as np
import pytest
from helpers.published_plants import helicopter, near_integrators
from helpers.synthesis_plants import scherer, spring

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.synthesis.bilinear_descent import BilinearDescent
from lpvid.synthesis.controller_structures import LowOrder, ObserverBased, StaticGain
from lpvid.synthesis.design_file import design_of
from lpvid.synthesis.frozen_descent import FrozenLoops, bfgs
from lpvid.synthesis.interconnection import close_loop


def largest_frozen(loop, count=60):
    """Oracle: H-infinity norms on a fine grid."""
    return max(h_infinity_norm(loop.frozen(p), loop.is_discrete)[0] for p in loop.box.grid(count))


@pytest.mark.seconds
def test_static_gain_reaches_the_published_optimum():
    found = lpv.synthesize(helicopter(), lpv.FixedStructure(starts=2))
    assert found.verdict == "solved"
    assert found.gamma_verified == pytest.approx(0.1538, rel=2e-3)
    assert found.gamma_lower <= found.gamma_verified <= 1.12 * found.gamma
    assert lpv.verify(found.certificate, found.closed_loop).holds


@pytest.mark.slow
def test_one_state_comes_close_to_the_full_order_optimum():
    found = lpv.synthesize(scherer(), lpv.FixedStructure(LowOrder(1), starts=1))
    assert found.controller.order == 1
    assert 9.508 <= found.gamma_verified <= 1.005 * 9.50808  # Scherer, Gahinet & Chilali 1997: no controller is better


@pytest.mark.seconds
def test_two_states_beside_near_integrators():
    """Poles of 2e-7 and 12 rad/s in one controller: its slowest two states are a start, and the loop is proven.

    The least bound of all controllers is 5.292 (with noise of 0.1 at the control: the Riccati equations' least gain).
    """
    found = lpv.synthesize(near_integrators(1e-1), lpv.FixedStructure(LowOrder(2), starts=1))
    assert found.solved and found.between_grid and found.controller.order == 2
    norm = h_infinity_norm(found.closed_loop.frozen([]))[0]
    assert 5.292 * 0.999 <= norm * (1 - 1e-6) <= found.gamma_verified <= 1.02 * 5.292


@pytest.mark.parametrize("structure", [StaticGain(), lpv.PID(filter=0.1), LowOrder(2), ObserverBased()])
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_attached_plant_with_gain_is_the_controller_in_its_loop(structure, sample_time):
    given = spring(sample_time=sample_time)
    attached = structure.attach(given)
    basis, generator = lpv.Polynomial("k", 1), np.random.default_rng(3)
    gains = generator.standard_normal((2, *attached.free.shape)) * attached.free
    loop = close_loop(given, attached.controller(basis, gains))
    for k in (1.0, 2.7):
        point = np.array([[k]])
        at = attached.plant.at(point[:, : len(attached.plant.box.names)]).point(0)
        g = np.tensordot(basis.evaluate(point)[0], gains, axes=1)
        ours = at.A + at.B2 @ g @ at.C2, at.B1 + at.B2 @ g @ at.D21, at.C1 + at.D12 @ g @ at.C2
        theirs = loop.frozen([k])
        s = 0.3j if sample_time is None else np.exp(0.3j)
        mine = ours[2] @ np.linalg.solve(s * np.eye(len(ours[0])) - ours[0], ours[1]) + at.D11 + at.D12 @ g @ at.D21
        other = theirs[2] @ np.linalg.solve(s * np.eye(len(theirs[0])) - theirs[0], theirs[1]) + theirs[3]
        np.testing.assert_allclose(mine, other, atol=1e-9 * max(1, np.abs(mine).max()))


def test_pid_is_the_textbook_law():
    """K_p + K_i/s + K_d s/(τs + 1), and with sums and backward differences in discrete time."""
    kp, ki, kd, tau = 2.0, 0.7, 0.3, 0.05
    for period in (None, 0.02):
        attached = lpv.PID(filter=tau).attach(spring(sample_time=period))
        law = attached.controller(lpv.Polynomial((), 0), np.array([[[kp, ki, kd]]]))
        a, b, c, d = law.frozen(())
        for omega in (0.2, 3.0):
            z = 1j * omega if period is None else np.exp(1j * omega * period)
            s = z if period is None else (z - 1) / period
            i, back = (1 / s, s) if period is None else (1 / s, (z - 1) / (period * z))
            wanted = kp + ki * i + kd * back / (tau * back + 1)
            got = (c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + d)[0, 0]
            assert got == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("discrete", [False, True])
def test_gradients_by_differences(discrete):
    at = LowOrder(1).attach(spring(sample_time=0.02 if discrete else None)).plant
    points = np.array([[1.0], [2.5], [4.0]])
    loops = FrozenLoops(at.at(points), lpv.Polynomial("k", 1).evaluate(points), np.ones((2, 2), dtype=bool), discrete)
    theta = np.zeros(8)
    theta[loops.parameters(np.arange(8).reshape(2, 2, 2)) == 0] = -0.1
    theta = theta + 0.05 * np.random.default_rng(1).standard_normal(8)
    theta[2] = 0.3 if discrete else -2.0  # A_K of the first function
    for objective in (loops.abscissa, loops.norm):
        value, slope = objective(theta)
        assert np.isfinite(value)
        step = 1e-6
        numeric = [(objective(theta + step * e)[0] - objective(theta - step * e)[0]) / (2 * step) for e in np.eye(8)]
        np.testing.assert_allclose(slope, numeric, rtol=1e-3, atol=1e-4 * np.abs(slope).max())


def test_descent_ends_at_a_kink():
    g = np.array([0.4, -0.2])
    _, value = bfgs(lambda x: (float(np.abs(x - g).sum()), np.sign(x - g)), np.array([5.0, 3.0]), 200)
    assert value < 1e-3


@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_certified_steps_never_raise_the_bound(sample_time):
    """The convex step keeps what is proven: each answer satisfies the bilinear inequality, checked by frozen norms."""
    given = spring(sample_time=sample_time)
    at = given.at(np.array([[2.0]]))
    one = np.ones((1, 1))
    discrete = sample_time is not None
    descent = BilinearDescent(at, one, one, (one if discrete else 0 * one,), np.ones((1, 1), dtype=bool), discrete)
    start = descent.proven(np.array([[[0.3]]]))
    bound = start.gamma
    for _ in range(3):
        following = descent.descended(start, most=1)
        m, g = at.point(0), following.gains[0]
        loop = m.A + m.B2 @ g @ m.C2, m.B1 + m.B2 @ g @ m.D21, m.C1 + m.D12 @ g @ m.C2, m.D11 + m.D12 @ g @ m.D21
        assert following.gamma <= bound
        assert h_infinity_norm(loop, discrete)[0] <= following.gamma * (1 + 1e-6)
        start, bound = following, following.gamma
    assert bound < 0.999 * descent.proven(np.array([[[0.3]]])).gamma


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "lyapunov", "sample_time"), [
    (None, None, None), pytest.param(0.5, 1, None, marks=pytest.mark.slow),
    pytest.param(0.5, None, 0.1, marks=pytest.mark.slow)])
def test_moving_scheduling_is_certified(rate, lyapunov, sample_time):
    given = spring(rate, sample_time)
    basis = None if lyapunov is None else lpv.Polynomial("k", lyapunov)
    found = lpv.synthesize(given, lpv.FixedStructure(LowOrder(1), lyapunov=basis, starts=1, points=3))
    assert found.solved, found.why
    assert largest_frozen(found.closed_loop) <= found.gamma_verified * (1 + 1e-9)
    assert lpv.verify(found.certificate, found.closed_loop).holds
    full = lpv.synthesize(given, lpv.OutputFeedback(lyapunov=basis))
    assert found.gamma_verified < 3 * full.gamma_verified


def test_table_of_gains(tmp_path):
    basis, generator = lpv.Spline("k", 2, 1, (1.0, 2.0, 4.0)), np.random.default_rng(0)
    controller = LowOrder(1).attach(spring()).controller(basis, generator.standard_normal((3, 2, 2)))
    surface = lpv.gain_surface(lpv.LPVStateSpace.from_dict(json.loads(json.dumps(controller.to_dict()))))
    assert surface.labels[-1] == "controller state 1 <- y1"
    _, values = surface.table([[1.0, 1.5, 2.0, 4.0]])
    np.testing.assert_allclose(values[1], 0.5 * (values[0] + values[2]))      # linear between breakpoints
    a, b, c, d = controller.frozen([2.0])
    np.testing.assert_allclose(np.sort(values[2]), np.sort([a[0, 0], b[0, 0], c[0, 0], d[0, 0]]), rtol=1e-9)
    lines = surface.to_csv(tmp_path / "gains.csv", 3).read_text().splitlines()
    assert lines[0].startswith("k,u1 <- controller state 1") and len(lines) == 4
    with pytest.raises(lpv.InputError, match="within the box"):
        surface.table([[0.0, 9.0]])


def test_paths_keep_gains_at_zero():
    given = helicopter()
    attached = StaticGain({"u1": []}).attach(given)
    assert attached.free.tolist() == [[False], [True]]


def test_integral_behind_a_zero_at_rest_is_refused():
    """Scherer's plant measures a derivative: what an integral of it collects cannot be brought to rest."""
    found = lpv.synthesize(scherer(), lpv.FixedStructure(lpv.PID()))
    assert found.verdict in ("unstabilisable", "undetectable")
    assert "integral" in found.mend


@pytest.mark.seconds
@pytest.mark.parametrize("design", [
    pytest.param(lambda gain: lpv.FixedStructure(lpv.PID(filter=0.1, integral=False), gain=gain, starts=1, points=2),
                 marks=pytest.mark.seconds),
    lambda gain: lpv.StateFeedback(gain=gain, points=2)])
def test_breakpoints_of_a_table_are_points_of_the_design(design):
    """Two points look at the ends alone; a table with a breakpoint between them is no worse than one line."""
    noisy = isinstance(design(None), lpv.FixedStructure)
    names = ("stroke", "effort", "sensor") if noisy else ("stroke", "effort", "position", "speed")
    a, b = [[[0, 1], [0, -0.2]], [[0, 0], [-1, 0]]], [[[0, 0, 0], [1, 0, 1]], np.zeros((2, 3))]
    rows = [[1, 0], [0, 0], [1, 0], [0, 1]][:len(names)]
    d = np.zeros((2, len(names), 3))
    d[0, 1, 2], d[0, 2, 1] = 0.3, 0.1 * noisy
    box = lpv.Scheduling(("k",), (1.0,), (4.0,))
    system = lpv.LPVStateSpace(a, b, [rows, np.zeros((len(names), 2))], d, lpv.Polynomial("k", 1), None, box,
                               inputs=("push", "noise", "force"), outputs=names)
    plant = lpv.GeneralizedPlant(system, ["force"], list(names[2:]))
    line, table = (lpv.synthesize(plant, design(g)) for g in (lpv.Polynomial("k", 1), lpv.Spline("k", 2, 1)))
    assert table.solved and table.gamma_verified <= 1.03 * line.gamma_verified


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="a fixed structure is needed"):
        lpv.FixedStructure("pid")
    with pytest.raises(lpv.InputError, match="needs a term"):
        lpv.PID(integral=False, proportional=False)
    with pytest.raises(lpv.InputError, match="measurement"):
        lpv.synthesize(helicopter(), lpv.FixedStructure(StaticGain({"u1": ["nothing"]})))
    with pytest.raises(lpv.InputError, match="reach the measurements directly"):
        lpv.synthesize(scherer(d22=1.0), lpv.FixedStructure())


def test_design_file():
    given = helicopter()
    design = design_of({"design": "fixed-structure", "structure": "low-order", "order": 2, "gain_degree": 0}, given)
    assert design.structure == LowOrder(2) and design.gain.degree == 0
    assert design_of({"design": "fixed-structure", "structure": "pid", "filter": 0.01}, given).structure.filter == 0.01
    with pytest.raises(lpv.InputError, match="lacks its order"):
        design_of({"design": "fixed-structure", "structure": "low-order"}, given)
    with pytest.raises(lpv.InputError, match="has no 'order'"):
        design_of({"design": "fixed-structure", "structure": "static-gain", "order": 2}, given)
