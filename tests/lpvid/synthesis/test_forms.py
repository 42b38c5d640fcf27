"""Forms of one system: exact where promised, with an error that a denser grid confirms elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Fourier, Polynomial, Product, Scheduling, Shifted, Spline
from lpvid.synthesis._horner import fractional
from lpvid.synthesis.forms import from_lft, to_affine, to_gridded, to_lft, to_polynomial, to_polytopic
from lpvid.synthesis.lifting import lift

BOX = Scheduling(("p", "q"), (-1.0, 2.0), (2.0, 5.0), (3.0, None), ("A", "K"))


def system(basis, seed=0, order=3, offsets=False, rank=None) -> LPVStateSpace:
    rng = np.random.default_rng(seed)
    m = basis.size
    s = rng.normal(size=(m, order + 2, order + 1))
    if rank is not None:
        s[1:] = rng.normal(size=(m - 1, order + 2, rank)) @ rng.normal(size=(m - 1, rank, order + 1))
    f = (rng.normal(size=(m, order)), rng.normal(size=(m, 2))) if offsets else (None, None)
    index = [BOX.names.index(n) for n in basis.names]
    limits = (tuple(getattr(BOX, k)[i] for i in index) for k in ("lower", "upper", "rate", "units"))
    return LPVStateSpace(s[:, :order, :order], s[:, :order, order:], s[:, order:, :order], s[:, order:, order:], basis,
                         0.1, Scheduling(basis.names, *limits), *f, inputs=("u",), outputs=("y1", "y2"))


def gap(one, other, count=400) -> float:
    """Largest distance of the system matrices at random points, relative to the largest matrix."""
    points = np.random.default_rng(9).uniform(one.box.lower, one.box.upper, (count, len(one.box.names)))
    s, t = (np.array([np.block([[a, b], [c, d]]) for a, b, c, d in map(x.frozen, points)]) for x in (one, other))
    return float(np.linalg.norm(t - s, ord=2, axis=(1, 2)).max() / np.linalg.norm(s, ord=2, axis=(1, 2)).max())


POLYNOMIALS = [Polynomial("p", 1), Polynomial("p", 3), Polynomial(("p", "q"), 2, (0.3, 0.1), (2.0, 0.5)),
               Product(Polynomial("q", 1), Polynomial("p", 2)), Polynomial()]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("basis", POLYNOMIALS)
def test_a_polynomial_becomes_a_linear_fractional_form_and_comes_back(basis):
    old = system(basis)
    form = to_lft(old)
    assert form.exact and form.error == 0.0 and isinstance(form.model, LFTModel)
    assert gap(old, form.model) < 1e-13 and form.model.well_posed().holds
    assert form.model.box == old.box and form.model.inputs == old.inputs and form.model.sample_time == 0.1
    back = from_lft(form.model)
    assert back.exact and gap(old, back.model) < 1e-12


def test_repetitions_are_ranks():
    assert to_lft(system(Polynomial("p", 1), rank=2)).model.repetitions == (2,)
    affine = to_lft(system(Polynomial(("p", "q"), 1), rank=1))
    assert affine.model.repetitions == (1, 1)
    # one function u vᵀ (p + 0.5 p²): two copies of p, the minimal number for degree 2
    u, v = np.random.default_rng(1).normal(size=(2, 4))
    terms = np.array([np.zeros((4, 4)), np.outer(u, v), 0.5 * np.outer(u, v)])
    k, repetitions = fractional(terms, np.arange(3)[:, None])
    assert repetitions == (2,) and k.shape == (6, 6)
    # rows in common: Hankel matrix [S1 S2; S2 0] of rank 2 is the minimum
    a, b, e = *np.random.default_rng(2).normal(size=(2, 4)), np.eye(4)[0]
    assert fractional(np.array([np.zeros((4, 4)), np.outer(a, e), np.outer(b, e)]), np.arange(3)[:, None])[1] == (2,)


@pytest.mark.seconds
def test_a_rational_form_is_gridded_and_fitted_with_a_stated_error():
    model = LFTModel(np.array([[-0.5, 0.25, 1.0], [1.0, -0.5, 0.0], [1.0, 0.0, 0.0]]), 1,
                     Scheduling(("p",), (0.0,), (2.0,)), (1,), 0.1)  # A = −1/(1 + p)
    with pytest.raises(InputError, match="rational, not polynomial"):
        from_lft(model)
    for convert, sizes in ((to_gridded, (3, 5, 9, 17)), (to_polynomial, (1, 2, 3, 4))):
        forms = [convert(model, size) for size in sizes]
        for form in forms:
            assert not form.exact and form.error == pytest.approx(gap(model, form.model), rel=0.1)
        assert forms[-1].error < forms[0].error / 15
    h, size = 2 / 16, np.linalg.norm([[-1, 1], [1, 0]], 2)
    bound = h**2 / 8 * 2 / size  # |d²/dp² 1/(1 + p)| ≤ 2
    assert 0.5 * bound < to_gridded(model, 17).error < bound


@pytest.mark.seconds
def test_polytopic_and_affine_are_one_system():
    basis = Polynomial(("p", "q"), 2, (0.1, 3.0), (1.0, 2.0))
    old = system(basis, offsets=True)
    square = basis.exponents.max(axis=1) > 1
    arrays = {n: np.where(square.reshape(-1, *[1] * (getattr(old, n).ndim - 1)), 0.0, getattr(old, n))
              for n in ("A", "B", "C", "D", "state_offset", "output_offset")}
    old = old.replace(**arrays)  # 1, p, q, pq
    corners = to_polytopic(old)
    assert corners.exact and gap(old, corners.model) < 1e-14
    vertices = [(p, q) for p in (-1.0, 2.0) for q in (2.0, 5.0)]
    for matrix, vertex in zip(corners.model.A, vertices, strict=True):
        np.testing.assert_allclose(matrix, old.frozen(vertex)[0], atol=1e-12)
    weights = corners.model.basis.evaluate(np.random.default_rng(0).uniform(BOX.lower, BOX.upper, (50, 2)))
    assert weights.min() >= 0 and np.allclose(weights.sum(axis=1), 1)
    back = to_polynomial(corners.model, 2)
    assert back.error < 1e-13 and gap(old, back.model) < 1e-13
    phi = old.basis.evaluate(np.array([[0.3, 4.0]])), back.model.basis.evaluate(np.array([[0.3, 4.0]]))
    np.testing.assert_allclose(phi[1] @ back.model.state_offset, phi[0] @ old.state_offset, atol=1e-12)


def test_an_affine_fit_states_what_it_leaves_out():
    old = system(Polynomial("p", 2))
    form = to_affine(old)
    assert not form.exact and form.error == pytest.approx(gap(old, form.model), rel=0.1)
    assert "off by" in str(form) and "2000 points" in str(form)
    assert to_polynomial(old, 2).exact and to_polynomial(old, 5).exact
    with pytest.raises(InputError, match="not affine in each"):
        to_polytopic(old)


@pytest.mark.seconds
def test_a_grid_is_exact_at_its_points():
    old = system(Product(Fourier("p", 1), Polynomial("q", 1)))
    form = to_gridded(old, {"p": (-1.0, 0.2, 1.1, 2.0), "q": (2.0, 5.0)})
    for p, q in ((0.2, 2.0), (1.1, 5.0), (0.2, 3.3)):
        np.testing.assert_allclose(form.model.frozen([p, q])[0], old.frozen([p, q])[0], atol=1e-13)
    assert form.error == pytest.approx(gap(old, form.model, 3000), rel=0.05)


@pytest.mark.parametrize("basis", [Polynomial(("p", "q"), 2), Fourier("p", 2), Spline("p", 3, 1, (-1, 0, 1, 2)),
                                   Product(Fourier("p", 1), Polynomial("q", 1))])
def test_lifted_systems_are_affine_and_exact_and_their_box_holds_every_value(basis):
    old = system(basis, offsets=True)
    lifted = lift(old)
    points = np.random.default_rng(3).uniform(old.box.lower, old.box.upper, (300, len(old.box.names)))
    theta = lifted.variables(points)
    assert np.all(lifted.system.box.contains(theta)) and lifted.system.basis.degree == 1
    for p, t in zip(points[:20], theta[:20], strict=True):
        for x, y in zip(old.frozen(p), lifted.system.frozen(t), strict=True):
            np.testing.assert_allclose(y, x, atol=1e-12)
        offset = lifted.system.basis.evaluate(t[None])[0] @ lifted.system.state_offset
        np.testing.assert_allclose(offset, old.basis.evaluate(p[None])[0] @ old.state_offset, atol=1e-12)
    assert to_polytopic(lifted.system).exact


def test_ranges_of_monomials_are_attained():
    basis = Polynomial(("p", "q"), 3, (0.5, 1.0), (2.0, 1.0))
    low, high = basis.ranges(BOX.limits)
    values = basis.evaluate(BOX.grid(61))
    np.testing.assert_allclose(low, values.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(high, values.max(axis=0), atol=1e-12)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: to_lft(system(Fourier("p", 1))), r"cos\(p\).*lift"),
    (lambda: to_lft(system(Polynomial("p", 1), offsets=True)), "constant terms"),
    (lambda: to_gridded(system(Polynomial("p", 1)), {"q": (0.0, 1.0)}), "no axis of the grid 'p'"),
    (lambda: to_gridded(system(Polynomial("p", 1)), {"p": (0.0, 2.0)}), "does not reach the ends"),
    (lambda: to_gridded(system(Polynomial("p", 1)), {"p": (0.0,)}), "two rising values"),
    (lambda: to_affine(system(Shifted(Polynomial("p", 2), 1))), "several times"),
    (lambda: lift(system(Shifted(Polynomial("p", 2), 1))), "several times"),
])
def test_what_has_no_such_form_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
