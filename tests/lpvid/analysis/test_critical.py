"""Critical scheduling values against closed forms and against bisection on eigenvalues."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from lpvid.analysis.critical import critical_scheduling
from lpvid.analysis.frozen_stability import frozen_stability
from lpvid.analysis.guardian import bialternate, polynomial_eigenvalues
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Polynomial, Product, Scheduling, Shifted, Spline, Stacked

# equations.md 6.9: D_0 + i D_1 with the common root 0.83
D0 = np.array([-1.63, 0.964, -0.149, -0.083])
D1 = np.array([0.15, -0.1745, 0.06372222, -0.01844444])
BOX = Scheduling(("current",), (0.0,), (2.5,), units=("A",))


def damper(bound: bool) -> LPVTransferFunction:
    basis, a = Polynomial("current", 1), np.column_stack([D0, D1])
    if bound:
        basis, a = basis.bound(BOX), np.column_stack([D0 + 1.25 * D1, 1.25 * D1])
    return LPVTransferFunction.siso(a, [[0, 0], [1, 0]], basis, 1 / 512, scheduling=BOX)


def states(A, basis=None, sample_time=1.0, **kwargs) -> LPVStateSpace:
    a = np.array(A, dtype=float)
    m, n, _ = a.shape
    basis = basis or Polynomial("p", degree=m - 1)
    return LPVStateSpace(a, np.zeros((m, n, 1)), np.zeros((m, 1, n)), np.zeros((m, 1, 1)), basis, sample_time, **kwargs)


def random_model(rng, n, degree, discrete) -> LPVStateSpace:
    a = rng.standard_normal((degree + 1, n, n))
    poles = np.linalg.eigvals(a[0])
    if discrete:
        a[0] *= 0.8 / np.abs(poles).max()
    else:
        a[0] -= np.eye(n) * (poles.real.max() + 0.5)
    a[1:] *= rng.choice([0.1, 0.5, 1.0])
    return states(a, sample_time=0.1 if discrete else None)


def margin(model, s) -> float:
    poles = model.frozen_poles([s])
    return float(np.abs(poles).max() - 1 if model.sample_time is not None else poles.real.max())


def by_bisection(model, low, high, points) -> list[float]:
    grid = np.linspace(low, high, points)
    a = np.einsum("pm,mij->pij", model.basis.evaluate(grid[:, None]), model.A)
    poles = np.linalg.eigvals(a)
    h = np.abs(poles).max(axis=1) - 1 if model.sample_time is not None else poles.real.max(axis=1)
    return [brentq(lambda s: margin(model, s), grid[i], grid[i + 1], xtol=1e-13)
            for i in np.nonzero(h[:-1] * h[1:] < 0)[0]]


@pytest.mark.parametrize("bound", [False, True])
def test_the_damper_of_the_fact_sheet_is_critical_at_nine_amperes(bound):
    result = critical_scheduling(damper(bound))
    closed = {"+1": -(1 + D0.sum()) / D1.sum(), "-1": -(1 + D0 @ [-1, 1, -1, 1]) / (D1 @ [-1, 1, -1, 1])}
    below, above = result.values
    assert above.value == pytest.approx(closed["-1"], rel=1e-10)
    assert above.value == pytest.approx(9.0, abs=1e-3)
    assert (above.direction, above.crossing) == ("to-unstable", "-1")
    assert above.frequency_hz == pytest.approx(256.0)
    assert below.value == pytest.approx(closed["+1"], rel=1e-10)
    assert (below.direction, below.crossing) == ("to-stable", "+1")
    for value in result.values:
        assert value.value == pytest.approx(brentq(lambda s: margin(damper(bound), s), value.value - 0.5,
                                                   value.value + 0.5, xtol=1e-13), abs=1e-9)
        assert value.modulus_residual < 1e-8
    assert result.stable_range == (below.value, above.value)
    assert "9 A" in str(result) and "does not cover a moving" in str(result)
    assert set(json.loads(json.dumps(result.to_dict()))["critical"][0]) >= {"value", "direction", "crossing"}


@pytest.mark.parametrize("discrete", [True, False])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_none_is_missed_and_none_invented_on_random_models(rng, discrete, degree):
    seen = 0
    for _ in range(8):
        model = random_model(rng, int(rng.integers(1, 6)), degree, discrete)
        result = critical_scheduling(model)
        expected = by_bisection(model, -4, 4, 4001)
        found = [c.value for c in result.values if -4 < c.value < 4]
        assert found == pytest.approx(expected, abs=1e-6)
        assert all(c.modulus_residual < 1e-8 for c in result.crossings)
        assert result.exact and not any("bisection" in n for n in result.notes)
        seen += len(found)
    assert seen > 5


def test_what_the_eigenvalue_problem_misses_is_found_by_counting_poles(rng, monkeypatch):
    model = random_model(rng, 4, 2, True)
    solved = critical_scheduling(model)
    monkeypatch.setattr("lpvid.analysis.crossings.candidates", lambda piece: [])
    counted = critical_scheduling(model)
    near = [c.value for c in solved.crossings if abs(c.value) < 5]
    assert near and [c.value for c in counted.crossings if abs(c.value) < 5] == pytest.approx(near, abs=1e-9)
    assert "bisection" in counted.notes[0]


class NotPolynomial(Basis):
    """1 and exp(p)."""

    names, size, labels, degree, lags = ("p",), 2, ("1", "exp(p)"), None, (0, 0)

    def evaluate(self, p):
        return np.column_stack([np.ones(len(p)), np.exp(np.asarray(p)[:, 0])])

    def derivative(self, p, name):
        return np.column_stack([np.zeros(len(p)), np.exp(np.asarray(p)[:, 0])])

    def bound(self, box):
        return self

    def to_dict(self):
        return {"kind": "exponential"}


def test_a_basis_that_is_no_polynomial_is_searched_on_a_grid_and_says_so():
    """z = 0.5 − exp(p)/2 reaches −1 at p = log 3."""
    result = critical_scheduling(states([[[0.5]], [[-0.5]]], NotPolynomial()))
    assert [c.value for c in result.values] == pytest.approx([np.log(3)])
    assert not result.exact and "grid" in result.notes[0]


@pytest.mark.seconds
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_affine_models_of_four_states_agree_with_bisection(seed):
    model = random_model(np.random.default_rng(seed), 4, 1, True)
    for value in critical_scheduling(model).values:
        width = 1e-4 * (1 + abs(value.value))
        before, after = margin(model, value.value - width), margin(model, value.value + width)
        if value.direction != "touching" and before * after < 0:
            assert (before < 0) == (value.direction == "to-unstable")
            assert value.value == pytest.approx(
                brentq(lambda s: margin(model, s), value.value - width, value.value + width, xtol=1e-14), abs=1e-6)


@pytest.mark.seconds
def test_stable_intervals_agree_with_poles_far_out_and_near(rng):
    for k in range(12):
        model = random_model(rng, 4, 1 + k % 3, bool(k % 2))
        result = critical_scheduling(model)
        for s in rng.uniform(-20, 20, 40):
            claimed = any(low < s < high for low, high in result.stable_intervals)
            assert claimed == (margin(model, s) < 0)


def test_eighth_order_of_fourth_degree(rng):
    model = random_model(rng, 8, 4, True)
    result = critical_scheduling(model)
    assert [c.value for c in result.values if abs(c.value) < 2] == pytest.approx(by_bisection(model, -2, 2, 4001),
                                                                                abs=1e-6)


@pytest.mark.seconds
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), factor=st.sampled_from([1e3, 1e-3, 0.0254, -2.0]))
def test_rescaling_the_unit_rescales_the_critical_values(seed, factor):
    model = random_model(np.random.default_rng(seed), 3, 2, True)
    scaled = states(model.A / np.array([1, factor, factor**2])[:, None, None],
                    scheduling=Scheduling(("p",), (-abs(factor),), (abs(factor),)))
    original = critical_scheduling(model)
    assert sorted(c.value for c in critical_scheduling(scaled).values) == pytest.approx(
        sorted(factor * c.value for c in original.values), rel=1e-7)


def test_milliamperes_instead_of_amperes():
    milli = LPVTransferFunction.siso(np.column_stack([D0, D1 / 1e3]), [[0, 0], [1, 0]], Polynomial("current", 1),
                                     1 / 512, scheduling=Scheduling(("current",), (0.0,), (2500.0,), units=("mA",)))
    ampere = [c.value for c in critical_scheduling(damper(False)).values]
    assert [c.value for c in critical_scheduling(milli).values] == pytest.approx([1e3 * v for v in ampere], rel=1e-10)
    moduli = sorted(np.abs(damper(True).frozen_poles([2.5])))
    assert sorted(np.abs(milli.frozen_poles([2500.0]))) == pytest.approx(moduli)


def test_frozen_stability_does_not_cover_the_alternating_pair():
    """equations.md 5.1, scaled by 0.9: frozen-stable at every p, yet p = +1, −1, +1, … multiplies a state by 3.24."""
    upper, lower = np.array([[0, 1.8], [0, 0]]), np.array([[0, 0], [1.8, 0]])
    model = states([(upper + lower) / 2, (upper - lower) / 2])
    result = frozen_stability(model)
    assert result.stable and result.max_modulus == pytest.approx(0.9)
    assert critical_scheduling(model).stable_range == pytest.approx((-np.sqrt(1 + 1 / 0.81), np.sqrt(1 + 1 / 0.81)))
    assert np.abs(model.frozen_poles([1.0])).max() == np.abs(model.frozen_poles([-1.0])).max() == 0
    assert np.abs(np.linalg.eigvals(model.companion([1.0]) @ model.companion([-1.0]))).max() == pytest.approx(3.24)
    for text in (str(result), str(critical_scheduling(model))):
        assert "does not cover a moving scheduling variable" in text


def test_the_alternating_pair_itself_touches_the_circle_halfway():
    model = states([[[0, 1], [1, 0]], [[0, 1], [-1, 0]]])
    result = critical_scheduling(model)
    assert np.array(result.stable_intervals) == pytest.approx(np.array([(-np.sqrt(2), 0), (0, np.sqrt(2))]))
    assert {(c.crossing, c.direction) for c in result.values if c.value == pytest.approx(0)} == {
        ("+1", "touching"), ("-1", "touching")}
    assert not result.stable


def test_poles_that_are_zero_for_every_value_are_never_critical():
    """A(p) = 2 (1, p)ᵀ(−p, 1) is nilpotent for every p, and A(0)A(1) has the eigenvalue −4."""
    model = states(2 * np.array([[[0, 1], [0, 0]], [[-1, 0], [0, 1]], [[0, 0], [-1, 0]]]))
    result = critical_scheduling(model)
    assert result.crossings == () and result.stable_intervals == ((-np.inf, np.inf),)
    assert np.linalg.eigvals(model.companion([0.0]) @ model.companion([1.0])).real.min() == pytest.approx(-4)


@pytest.mark.parametrize(("A", "sample_time", "kind", "crossing"), [
    ([np.diag([1, 0.5]), np.diag([0, 0.1])], 1.0, "+1", 5.0),
    ([[[2, 1, 0], [-1, 0, 0], [0, 0, 0.5]], np.diag([0, 0, 0.1])], 1.0, "+1", 5.0),
    ([[[0, 1, 0], [-100, 0, 0], [0, 0, -3]], np.diag([0, 0, 1.0])], None, "imaginary", 3.0),
    ([[[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 0.2]], np.diag([0, 0, 0.1])], 1.0, "complex", 8.0)])
def test_a_pole_that_stays_on_the_boundary_is_named(A, sample_time, kind, crossing):
    result = critical_scheduling(states(A, sample_time=sample_time))
    assert result.values == () and result.stable_intervals == () and not result.stable
    assert "stays on the stability boundary" in result.notes[0] and f"({kind})" in result.notes[0]
    assert [c.value for c in result.crossings if c.value > 0] == pytest.approx([crossing], abs=1e-6)


def test_an_even_dependence_touches_without_crossing():
    """z = 1 − p²: touches +1 at 0 and leaves through −1 at ±√2."""
    result = critical_scheduling(states([[[1.0]], [[0.0]], [[-1.0]]]))
    assert [(c.crossing, c.direction) for c in result.values] == [("-1", "to-stable"), ("+1", "touching"),
                                                                  ("-1", "to-unstable")]
    assert [c.value for c in result.values] == pytest.approx([-np.sqrt(2), 0, np.sqrt(2)], abs=1e-7)


def test_real_reciprocal_poles_are_no_crossing():
    """z = 0.5 + p and z = 2 multiply to one at p = 0, where neither is on the circle."""
    result = critical_scheduling(states([np.diag([0.5, 2.0]), np.diag([1.0, 0.0])]))
    assert [c.value for c in result.crossings] == pytest.approx([-1.5, 0.5])
    assert result.values == ()


def test_multiple_and_defective_poles_cross_where_the_single_ones_do():
    for a0 in (0.5 * np.eye(3), 0.5 * np.eye(3) + np.eye(3, k=1)):
        result = critical_scheduling(states([a0, 0.1 * np.eye(3)]))
        assert [c.value for c in result.values] == pytest.approx([-15, 5], abs=1e-4)


@pytest.mark.seconds
def test_splines_are_exact_piece_by_piece(rng):
    box = Scheduling(("p",), (0.0,), (3.0,))
    basis = Spline("p", segments=3, order=3).bound(box)
    seen = 0
    for _ in range(10):
        a = rng.standard_normal((6, 3, 3))
        a *= 0.95 / np.median([np.abs(np.linalg.eigvals(x)).max() for x in a])
        model = states(a, basis, scheduling=box)
        result = critical_scheduling(model)
        assert result.exact
        found = [c.value for c in result.values]
        assert found == pytest.approx(by_bisection(model, -1, 4, 8001), abs=1e-6)
        seen += len(found)
        assert all(low == -np.inf or low >= 0 for low, _ in result.stable_intervals)
    assert seen > 5


def test_delays_of_the_scheduling_do_not_matter_when_it_is_frozen(rng):
    a = rng.standard_normal((2, 3, 3)) * 0.4
    once = critical_scheduling(states(a, Polynomial("p", degree=1)))
    moved = critical_scheduling(states(np.concatenate([a / 2, a / 2]), Stacked(
        (Polynomial("p", degree=1), Shifted(Polynomial("p", degree=1), 2)))))
    assert [c.value for c in moved.values] == pytest.approx([c.value for c in once.values], abs=1e-9)


def test_several_variables_axis_by_axis_and_along_a_direction(rng):
    a = rng.standard_normal((4, 3, 3)) * [[[0.35]], [[0.2]], [[0.2]], [[0.1]]]
    basis = Product(Polynomial("p", degree=1), Polynomial("q", degree=1))
    box = Scheduling(("p", "q"), (-1.0, 0.0), (1.0, 2.0), units=("A", "K"))
    model = states(a, basis, scheduling=box)
    axes = critical_scheduling(model, at={"p": 0.5})
    assert {c.variable for c in axes.values} <= {"p", "q"}
    for value in axes.values:
        point = [value.value, 1.0] if value.variable == "p" else [0.5, value.value]
        assert np.abs(model.frozen_poles(point)).max() == pytest.approx(1.0, abs=1e-8)
    slanted = critical_scheduling(model, direction=(1.0, 0.5))
    assert slanted.values
    for value in slanted.values:
        assert np.abs(model.frozen_poles([value.value, 1 + 0.5 * value.value])).max() == pytest.approx(1, abs=1e-8)
    with pytest.raises(InputError, match="more than one line"):
        _ = axes.stable_intervals
    assert axes.along("q").line.unit == "K"


def test_two_outputs_agree_with_the_state_space(rng):
    a = rng.standard_normal((2, 2, 2, 2)) * 0.3
    basis = Polynomial("p", degree=1)
    model = LPVTransferFunction(a, np.zeros((1, 2, 1, 2)), basis, 0.01)
    matrices = [model.companion([0.0]), model.companion([1.0]) - model.companion([0.0])]
    twin = critical_scheduling(states(matrices, sample_time=0.01))
    result = critical_scheduling(model)
    assert [c.value for c in result.values] == pytest.approx([c.value for c in twin.values], rel=1e-9)
    assert result.values


def test_frozen_stability_finds_the_worst_point_between_grid_points():
    """z = 0.99 − (p − 0.123)²: the maximum lies between grid points."""
    model = states([[[0.99 - 0.123**2]], [[0.246]], [[-1.0]]])
    result = frozen_stability(model, points=5)
    assert result.max_modulus == pytest.approx(0.99, abs=1e-6)
    assert result.at["p"] == pytest.approx(0.123, abs=1e-3)
    assert result.to_dict()["stable"] is True


def test_frozen_stability_sees_an_instability_narrower_than_its_grid():
    """z = 1.0001 − 100 (p − 0.05)² exceeds one only on |p − 0.05| < 0.001."""
    model = states([[[1.0001 - 0.25]], [[10.0]], [[-100.0]]], scheduling=Scheduling(("p",), (0.0,), (0.14,)))
    result = frozen_stability(model, points=3)
    assert not result.stable
    assert [c.value for c in critical_scheduling(model).values if c.crossing == "+1"] == pytest.approx([0.049, 0.051])


def test_continuous_frozen_stability_speaks_of_the_real_part():
    result = frozen_stability(states([[[-2.0]], [[1.0]]], sample_time=None))
    assert result.max_modulus is None and result.max_real_part == pytest.approx(-1.0)


def test_models_without_poles_or_without_scheduling():
    still = LPVTransferFunction.siso([[-0.5]], [[1.0]], Polynomial((), degree=0), 1.0)
    assert critical_scheduling(still).values == () and frozen_stability(still).stable
    finite = LPVTransferFunction.siso([], [[1.0, 0.2]], Polynomial("p", degree=1), 1.0)
    assert critical_scheduling(finite).stable_intervals == ((-np.inf, np.inf),)


def test_what_cannot_be_followed_is_refused():
    model = damper(True)
    for arguments in ({"variable": "voltage"}, {"at": (1.0, 2.0)}, {"direction": (0.0,)},
                      {"variable": "current", "direction": (1.0,)}):
        with pytest.raises(InputError):
            critical_scheduling(model, **arguments)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 6))
def test_bialternate_eigenvalues_are_products_and_sums_of_pairs(seed, n):
    a = np.random.default_rng(seed).standard_normal((n, n))
    eigenvalues = np.linalg.eigvals(a)
    i, j = np.triu_indices(n, k=1)
    for matrix, pairs in ((bialternate(a, a), eigenvalues[i] * eigenvalues[j]),
                          (2 * bialternate(a, np.eye(n)), eigenvalues[i] + eigenvalues[j])):
        assert np.poly(matrix) == pytest.approx(np.poly(pairs).real, rel=1e-8, abs=1e-8)


def test_polynomial_eigenvalues_of_a_diagonal_polynomial_are_its_roots():
    """diag((t−1)(t−2), (t+3)·5): three finite roots, the fourth at infinity."""
    coefficients = np.array([np.diag([2.0, 15.0]), np.diag([-3.0, 5.0]), np.diag([1.0, 0.0])])
    assert np.sort(polynomial_eigenvalues(coefficients).real) == pytest.approx([-3, 1, 2])
