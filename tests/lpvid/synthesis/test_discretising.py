"""Sampling and its inverse: python-control's c2d at frozen points, orders of error, dense integration, round trips."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Fourier, Polynomial, Product, Scheduling, Shifted, Spline
from lpvid.synthesis.discretising import comparison_signals, discretise, to_continuous
from lpvid.synthesis.sampling_rules import Euler, Taylor, Tustin, ZeroOrderHold, remainder

BOX = Scheduling(("p", "q"), (-1.0, 0.0), (1.0, 2.0), (5.0, None), ("A", "K"))


def oscillator(basis=None, offsets=False) -> LPVStateSpace:
    """ẍ = −(40 + 15 f) x − (3 + g) ẋ + (1 + 0.2 f) u: light damping, frequency and damping move."""
    basis = Polynomial(("p", "q"), 1) if basis is None else basis
    rng = np.random.default_rng(1)
    m = basis.size
    move = rng.uniform(-0.4, 0.4, (m, 2))
    one = basis.unity
    a, b = np.zeros((m, 2, 2)), np.zeros((m, 2, 1))
    a[:, 0, 1], a[:, 1, 0], a[:, 1, 1] = one, -40 * (one + move[:, 0]), -3 * (one + move[:, 1])
    b[:, 1, 0] = one + 0.2 * move[:, 0]
    c = np.stack([np.outer(one, [1.0, 0.0]), np.outer(move[:, 1], [0.3, 0.1])], axis=1)
    d = np.stack([np.zeros((m, 1)), 0.1 * one[:, None]], axis=1)
    index = [BOX.names.index(n) for n in basis.names]
    limits = (tuple(getattr(BOX, k)[i] for i in index) for k in ("names", "lower", "upper", "rate", "units"))
    extra = (np.outer(one, [0.0, 2.0]), np.outer(one, [0.1, 0.0])) if offsets else (None, None)
    return LPVStateSpace(a, b, c, d, basis, None, Scheduling(*limits), *extra, inputs=("u",), outputs=("x", "v"))


@pytest.mark.parametrize(("rule", "method"), [(ZeroOrderHold(), "zoh"), (Tustin(), "bilinear"), (Euler(), "euler")])
@pytest.mark.parametrize("basis", [Polynomial("p", 1), Polynomial(("p", "q"), 2), Fourier("p", 1, 4.0),
                                   Product(Fourier("p", 1, 4.0), Polynomial("q", 1))])
def test_frozen_it_is_the_c2d_of_python_control(rule, method, basis):
    system = oscillator(basis)
    sampled = discretise(system, 0.02, rule)
    assert sampled.model.sample_time == 0.02 and sampled.model.box == system.box
    assert sampled.misfit <= 1e-6 and sampled.model.inputs == system.inputs
    for p in np.random.default_rng(0).uniform(system.box.lower, system.box.upper, (4, len(basis.names))):
        expected = control.c2d(system.to_control(p), 0.02, method)
        for z in (1.0, 0.9 + 0.1j, -0.5 + 1j):
            np.testing.assert_allclose(sampled.model.to_control(p)(z), expected(z), rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize(("rule", "local", "overall"), [(Euler(), 2, 1), (Taylor(2), 3, 2), (Taylor(3), 4, 3),
                                                        (Tustin(), 3, None)])
def test_errors_fall_with_the_power_of_the_period_that_is_stated(rule, local, overall):
    coarse, fine = (discretise(oscillator(), t, rule, tolerance=1e-10, highest=6) for t in (0.01, 0.005))
    assert rule.accuracy == local
    assert np.log2(coarse.local_error / fine.local_error) == pytest.approx(local, abs=0.15)
    assert coarse.local_error <= coarse.bound and fine.local_error <= fine.bound
    if overall is not None:
        # the comparison run is scaled with the period, so the figure is read at a fixed one: the gain of a lag
        lag = LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], np.zeros((1, 1, 1)), Polynomial(), None)
        steps = [discretise(lag, t, rule).model.frozen([])[0].item() ** round(1 / t) for t in (0.1, 0.05)]
        assert np.log2(abs(steps[0] - np.exp(-1)) / abs(steps[1] - np.exp(-1))) == pytest.approx(overall, abs=0.15)


def test_the_basis_stays_where_the_rule_needs_no_more():
    system = oscillator(Polynomial("p", 1))
    assert discretise(system, 0.01, Euler()).model.basis.degree == 1
    third = discretise(system, 0.01, Taylor(3))
    assert third.model.basis.degree == 3 and third.misfit == 0.0
    series = np.eye(2) + sum(np.linalg.matrix_power(system.frozen([0.4])[0] * 0.01, k) / f for k, f in
                             ((1, 1), (2, 2), (3, 6)))
    np.testing.assert_allclose(third.model.frozen([0.4])[0], series, rtol=1e-12)


@pytest.mark.seconds
def test_the_stated_error_is_that_of_a_dense_integration():
    """The run behind the figure, done again with an ODE solver."""
    system, period = oscillator(), 0.05
    sampled = discretise(system, period, Taylor(2))
    x, z, exact, got = np.zeros(2), np.zeros(2), [], []
    scheduling, inputs = comparison_signals(system.box, 1)
    assert np.all(BOX.contains(scheduling)) and np.ptp(scheduling, axis=0) == pytest.approx([2.0, 2.0], rel=0.01)
    for p, u in zip(scheduling, inputs, strict=True):
        a, b, c, d = system.frozen(p)
        e, f, g, h = sampled.model.frozen(p)
        exact.append(c @ x + d @ u)
        got.append(g @ z + h @ u)
        x = solve_ivp(lambda _, s, a=a, b=b, u=u: a @ s + b @ u, (0, period), x, rtol=1e-9, atol=1e-12).y[:, -1]
        z = e @ z + f @ u
    figure = np.sqrt(np.mean((np.array(got) - exact) ** 2) / np.mean(np.square(exact)))
    assert sampled.error == pytest.approx(figure, rel=1e-4) and 1e-3 < figure < 0.1
    zoh = discretise(system, period)
    assert zoh.error < 1e-4 and zoh.bound == 0.0 and "zero-order hold at 20 Hz (exact for held u and p)" in str(zoh)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("rule", [ZeroOrderHold(), Tustin(), Euler(), Taylor(6)])
@pytest.mark.parametrize("basis", [Polynomial("p", 2), Fourier("p", 1, 4.0), Polynomial()])
def test_there_and_back_is_the_system_again(rule, basis):
    system = oscillator(basis, offsets=True)
    there = discretise(system, 0.01, rule, tolerance=1e-9, highest=5)
    back = to_continuous(there.model, rule, tolerance=1e-9, highest=5)
    assert back.model.sample_time is None and back.model.box == system.box
    tolerance = 1e-4 if isinstance(rule, Taylor) and rule.order > 1 else 3e-6
    for p in np.linspace(-1, 1, 5)[:, None][:, : len(basis.names)]:
        for old, new in zip(system.frozen(p), back.model.frozen(p), strict=True):
            np.testing.assert_allclose(new, old, atol=tolerance * 60)
        phi = system.basis.evaluate(p[None])[0], back.model.basis.evaluate(p[None])[0]
        np.testing.assert_allclose(phi[1] @ back.model.state_offset, phi[0] @ system.state_offset, atol=tolerance * 60)
        np.testing.assert_allclose(phi[1] @ back.model.output_offset, phi[0] @ system.output_offset, atol=1e-4)
    assert back.error < 1e-3 or isinstance(rule, Taylor | Tustin)


@pytest.mark.seconds
def test_tustin_keeps_stability_where_euler_loses_it():
    system = oscillator(Polynomial("p", 1))  # |λ| about 6.3, damping 0.24
    for p in (-1.0, 1.0):
        assert np.abs(discretise(system, 0.25, Tustin()).model.frozen_poles([p])).max() < 1
        assert np.abs(discretise(system, 0.25, Euler()).model.frozen_poles([p])).max() > 1
    assert discretise(system, 0.25, Euler()).error > 1  # it runs away, and the figure says so


def test_a_gridded_system_is_sampled_over_its_own_pieces():
    system = oscillator(Spline("p", 4, 1, tuple(np.linspace(-1, 1, 5))))
    sampled = discretise(system, 0.01)
    assert sampled.misfit < 1e-4 and sampled.error < 1e-3


def test_a_double_integrator_comes_back_through_its_jordan_block():
    system = LPVStateSpace([[[0.0, 1.0], [0.0, 0.0]]], [[[0.0], [1.0]]], [[[1.0, 0.0]]], np.zeros((1, 1, 1)),
                           Polynomial(), None)
    sampled = discretise(system, 0.1)
    np.testing.assert_allclose(sampled.model.frozen([])[1].ravel(), [0.005, 0.1], rtol=1e-9)
    back = to_continuous(sampled.model).model.frozen([])
    np.testing.assert_allclose(back[0], [[0, 1], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(back[1], [[0], [1]], atol=1e-9)


NEGATIVE = LPVStateSpace([[[-0.5]]], [[[1.0]]], [[[1.0]]], np.zeros((1, 1, 1)), Polynomial(), 0.1)


def test_remainders_bound_the_scalar_series():
    for x in (0.01, 0.3, 1.2):
        for rule in (Euler(), Taylor(3), Tustin()):
            for sign in (1, -1, 1j):
                a = np.array([[[sign * x]]])
                got = rule.sample((a, a, a, a), 1.0)[0].item()
                assert abs(got - np.exp(sign * x)) <= remainder(rule, x) * (1 + 1e-9)
    assert remainder(Tustin(), 2.5) is None


@pytest.mark.parametrize(("call", "message"), [
    (lambda: discretise(oscillator().replace(sample_time=0.1), 0.1), "only a continuous system"),
    (lambda: to_continuous(oscillator()), "only a discrete system"),
    (lambda: discretise(oscillator(), -0.1), "positive"),
    (lambda: discretise(oscillator(Shifted(Polynomial("p", 1), 1)), 0.1), "several times"),
    (lambda: to_continuous(NEGATIVE), r"no continuous counterpart: got poles -0.5.*Tustin"),
    (lambda: to_continuous(NEGATIVE.replace(A=2 * NEGATIVE.A), Tustin()), "pole at −1"),
    (lambda: Taylor(0), "at least 1"),
])
def test_what_cannot_be_converted_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.seconds
def test_entries_that_do_not_move_stay_exactly_so_over_a_table():
    """A fit leaves 1e-16 of variation, with which a loop over this table had products of 43·43·99 functions."""
    made = lpv.from_grid({p: ([[-1 / p, 1.0], [0.0, -2.0]], [[0.0], [1.0]], [[1.0, 0.3]], [[0.7]])
                          for p in np.linspace(1.0, 4.0, 5)}, inputs=["u"], outputs=["y"])
    sampled = lpv.discretise(made, 0.05).model
    assert sampled.basis.size > 20
    for entry, value in ((sampled.C[:, 0, 1], 0.3), (sampled.D[:, 0, 0], 0.7)):
        assert np.array_equal(entry, entry[0] * sampled.basis.unity) and entry[0] == pytest.approx(value, rel=1e-12)
    assert np.ptp(sampled.A[:, 0, 0]) > 0.01


def test_a_generalised_plant_is_refused_with_what_to_sample():
    system = lpv.LPVStateSpace(-np.ones((1, 1, 1)), np.ones((1, 1, 2)), np.ones((1, 2, 1)), np.zeros((1, 2, 2)),
                               lpv.Polynomial((), 0), None, inputs=("w", "u"), outputs=("z", "y"))
    with pytest.raises(lpv.InputError, match="sample the system"):
        lpv.discretise(lpv.GeneralizedPlant(system, ["u"], ["y"]), 0.1)
