"""Certificates of loops that read ṗ: against closed forms, and what a certificate with ṗ free of p cannot show."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.rated_certificate import RatedGainCertificate
from lpvid.lmi.certificate import EPS
from lpvid.lmi.coordinates import Coordinates
from lpvid.lmi.driven import driven


def turned(rate: float = 1.0, wrong: float = 1.0) -> lpv.LPVStateSpace:
    """x = exp(0.5 p) ξ of ξ̇ = −ξ + w, z = ξ: ẋ = (−1 + 0.5 ṗ) x + exp(0.5 p) w, z = exp(−0.5 p) x; degree 3 in p."""
    p = lpv.Polynomial("p", 3)
    box = lpv.Scheduling(("p", "p_rate"), (-1.0, -rate), (1.0, rate), (rate, None))
    grow = np.polynomial.polynomial.polyfit(x := np.linspace(-1, 1, 50), np.exp(0.5 * x), 3)
    fall = np.polynomial.polynomial.polyfit(x, np.exp(-0.5 * x), 3)
    basis = lpv.Product(p, lpv.Polynomial("p_rate", 1))
    a, b, c = np.zeros((8, 1, 1)), np.zeros((8, 1, 1)), np.zeros((8, 1, 1))
    a[0], a[1] = -1.0, 0.5 * wrong
    b[::2, 0, 0], c[::2, 0, 0] = grow, fall
    return lpv.LPVStateSpace(a, b, c, np.zeros((8, 1, 1)), basis, None, box, inputs=("w",), outputs=("z",))


def storage() -> tuple[lpv.Polynomial, np.ndarray]:
    """V = ξ² = exp(−p) x², which the motion of p leaves alone."""
    x = np.linspace(-1, 1, 100)
    return lpv.Polynomial("p", 4), np.polynomial.polynomial.polyfit(x, np.exp(-x), 4)[:, None, None]


def test_a_change_of_coordinates_that_moves_keeps_the_gain_of_one():
    basis, matrices = storage()
    found = RatedGainCertificate.of(turned(), matrices, basis, 1.02)
    assert found is not None and found.between_grid and "which the loop reads" in found.claim
    assert lpv.verify(found, turned()).holds
    assert RatedGainCertificate.of(turned(), matrices, basis, 0.98) is None


def test_the_tie_between_p_and_its_rate_is_what_proves_it():
    """With the rate read with the wrong sign the same storage function proves nothing."""
    basis, matrices = storage()
    assert RatedGainCertificate.of(turned(wrong=-1.0), matrices, basis, 1.02) is None


def test_what_lies_between_the_points_of_a_grid_is_not_passed_over():
    """ẋ = (−1 + f(p) + 0.1 ṗ)x + w, z = x with P = 1: a gain of 1/0.9, but for f = 0.9 between two grid points."""
    knots, height = (-1.0, 0.0021, 0.0025, 0.0029, 1.0), np.array([0.0, 0, 0.9, 0, 0])
    box = lpv.Scheduling(("p", "p_rate"), (-1.0, -1.0), (1.0, 1.0), (1.0, None))
    basis = lpv.Product(lpv.Spline("p", 4, 1, knots), lpv.Polynomial("p_rate", 1))
    ones = np.zeros((10, 1, 1))
    ones[::2] = 1.0
    for lift, proven in ((0.0, True), (1.0, False)):
        a = -ones
        a[::2, 0, 0] += lift * height
        a[1::2] = 0.1
        loop = lpv.LPVStateSpace(a, ones, ones, np.zeros((10, 1, 1)), basis, None, box, inputs=("w",), outputs=("z",))
        found = RatedGainCertificate.of(loop, np.eye(1)[None], lpv.Polynomial((), 0), 1.12)
        assert found is not None and found.between_grid is proven
        assert lpv.verify(replace(found, between_grid=True), loop).holds is proven
        assert RatedGainCertificate.of(loop, np.eye(1)[None], lpv.Polynomial((), 0), 1.1) is None


def test_a_changed_certificate_does_not_hold(tmp_path):
    basis, matrices = storage()
    found, loop = RatedGainCertificate.of(turned(), matrices, basis, 1.02), turned()
    lpv.save(found, tmp_path / "c.json")
    kept = lpv.load(tmp_path / "c.json")
    assert lpv.verify(kept, loop).holds and kept.gamma == found.gamma
    assert not lpv.verify(replace(found, gamma=0.9), loop).holds
    assert not lpv.verify(replace(found, margin=0.5), loop).holds
    with pytest.raises(lpv.InputError, match="reads rates"):
        RatedGainCertificate.from_dict({"schema": "other"})


def skewed(loop: lpv.LPVStateSpace, t: np.ndarray, units: np.ndarray) -> lpv.LPVStateSpace:
    """Two of it side by side, x = Tξ, with ξ in units of their own."""
    two = np.eye(2)
    a, b, c, d = (np.array([np.kron(two, m) for m in each]) for each in (loop.A, loop.B, loop.C, loop.D))
    back = np.linalg.inv(t)
    return lpv.LPVStateSpace(t @ a @ back, t @ (b / units[:, None]), (c * units) @ back, d, loop.basis, None, loop.box)


def test_a_storage_function_over_its_own_states_keeps_the_digits_that_the_loops_states_lose(tmp_path):
    """V = ξ1² + 2^42 (x1 + x2)², as of a plant and its observer: as one matrix over x its rounding is the larger part.

    x1 = ξ1, x2 = ξ2 − ξ1.
    """
    t, units = np.array([[1.0, 0.0], [-1.0, 1.0]]), np.array([1.0, 2.0**21])
    loop, (basis, one) = skewed(turned(), t, units), storage()
    matrices, back = np.kron(one, np.diag(units**2)), np.linalg.inv(t)
    assert RatedGainCertificate.of(loop, back.T @ matrices @ back, basis, 1.02) is None
    found = RatedGainCertificate.of(loop, matrices, basis, 1.02, t)
    assert found is not None and found.margin > 0
    assert RatedGainCertificate.of(loop, matrices, basis, 0.98, t) is None
    assert RatedGainCertificate.of(loop, matrices, basis, 1.02, np.ones((2, 2))) is None
    lpv.save(found, tmp_path / "c.json")
    lpv.save(loop, tmp_path / "l.json")
    kept, model = lpv.load(tmp_path / "c.json"), lpv.load(tmp_path / "l.json")
    assert lpv.verify(kept, model).holds
    assert not lpv.verify(replace(kept, states=t[::-1]), model).holds
    assert not lpv.verify(replace(kept, states=np.eye(3)), model).holds
    assert "states" not in RatedGainCertificate.of(turned(), one, basis, 1.02).to_dict()


def exact(m: np.ndarray) -> list[list[Fraction]]:
    return [[Fraction(float(x)) for x in row] for row in m]


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*b, strict=True)] for row in a]


def inverse(m: np.ndarray) -> list[list[Fraction]]:
    """Gauss and Jordan, in fractions."""
    n = len(m)
    rows = [row + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(exact(m))]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


@pytest.mark.parametrize("spread", [0, 3, 6])
def test_what_a_change_of_states_rounds_is_below_its_magnitudes(spread):
    """T⁻¹AT, T⁻¹B, CT in fractions, for states up to 10^spread apart and mixed."""
    rng, n = np.random.default_rng(spread), 5
    for _ in range(10):
        t = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-spread, spread, (n, 1))
        a, b, c = rng.normal(size=(n, n)), rng.normal(size=(n, 2)), rng.normal(size=(3, n))
        over, back = Coordinates.of(t, n), inverse(t)
        assert over is not None
        true = product(product(back, exact(a)), exact(t)), product(back, exact(b)), product(exact(c), exact(t))
        found = over.back @ a @ over.into, over.back @ b, c @ over.into
        for value, truth, size in zip(found, true, over.magnitudes(a, b, c), strict=True):
            off = np.array([[abs(float(x - Fraction(float(v)))) for x, v in zip(r, w, strict=True)]
                            for r, w in zip(truth, value, strict=True)])
            assert np.all(off <= 6 * n * EPS * size)


@pytest.mark.parametrize("gamma", [100.0, -1.0, 0.0, np.nan, np.inf])
def test_a_p_that_moves_needs_a_model_that_reads_the_rate(gamma):
    """A switching p makes this system grow; without a reading of the rate Ṗ would be taken for zero."""
    box = lpv.Scheduling(("p", "p_rate"), (-1.0, -50.0), (1.0, 50.0))
    basis = lpv.Product(lpv.Polynomial("p", 1), lpv.Polynomial(("p_rate",), 0))
    a = np.array([[[-0.1, -2.0], [2.0, -0.1]], [[0.0, -1.9], [-1.9, 0.0]]])
    unit = np.array([np.eye(2), np.zeros((2, 2))])
    model = lpv.LPVStateSpace(a, unit, unit, np.zeros((2, 2, 2)), basis, None, box)
    subject = driven(model)
    moving = np.array([np.diag([4.0, 4.0]), np.diag([-3.8, 3.8])])
    found = RatedGainCertificate(gamma, moving, lpv.Polynomial("p", 1), model.box, subject.digest, subject.inputs,
                                 subject.outputs, 1e-3, True).check(model)
    assert not found.holds and found.why
