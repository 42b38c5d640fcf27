"""The Fourier basis: closed forms, files, and what holds between samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.scheduling import Fourier


def test_the_functions_by_hand():
    p = np.array([[0.3], [2.0]])
    x = 2 * np.pi * (p[:, 0] - 0.5) / 4.0
    np.testing.assert_allclose(Fourier("p", 2, 4.0, 0.5).evaluate(p),
                               np.column_stack([np.ones(2), np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)]))
    assert lpv.Fourier("p", 1, 4.0, 0.5).labels == ("1", "cos(2pi*(p-0.5)/4)", "sin(2pi*(p-0.5)/4)")


@pytest.mark.seconds
@settings(deadline=None, max_examples=60)
@given(degree=st.integers(1, 5), extra=st.integers(1, 20), seed=st.integers(0, 10**6))
def test_between_samples_a_sum_exceeds_them_by_no_more_than_the_overshoot(degree, extra, seed):
    basis, n = Fourier("p", degree), 2 * degree + extra
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(basis.size, 3, 3))
    matrix = matrix + matrix.transpose(0, 2, 1)

    def eigenvalues(count):
        p = rng.uniform(0, 1) + 2 * np.pi * np.arange(count) / count
        return np.linalg.eigvalsh(np.tensordot(basis.evaluate(p[:, None]), matrix, axes=1))

    seen, everywhere = eigenvalues(n), eigenvalues(2000)
    assert np.abs(everywhere).max() <= np.abs(seen).max() * basis.overshoot(n) * (1 + 1e-12)
    low, high = seen.min(), seen.max()
    assert everywhere.max() <= (high + low) / 2 + (high - low) / 2 * basis.overshoot(n) + 1e-9


def test_the_overshoot_is_attained():
    p = 2 * np.pi * np.arange(12) / 12 + np.pi / 12  # every maximum of |cos 3p| lies midway between two samples
    samples = Fourier("p", 3).evaluate(p[:, None])[:, -2]
    assert Fourier("p", 3).overshoot(12) * abs(samples).max() == pytest.approx(1.0, abs=1e-12)
    assert Fourier("p", 3).overshoot(12) == pytest.approx(math.sqrt(2))


def wu_1996() -> lpv.LPVStateSpace:
    """A(ρ) of Wu, Yang, Packard and Becker 1996."""
    a = np.zeros((3, 4, 4))
    a[0] = [[0.75, 2, 0, 0], [0, 0.5, 0, 0], [0, 0, -10, 0], [0, 0, 0, -10]]
    a[1, 0, 2] = a[1, 1, 3] = a[2, 0, 3] = 1.0
    a[2, 1, 2] = -1.0
    return lpv.LPVStateSpace(a, np.zeros((3, 4, 1)), np.zeros((3, 1, 4)), np.zeros((3, 1, 1)), Fourier("rho"), None,
                             lpv.Scheduling(("rho",), (-math.pi,), (math.pi,), (5.0,), ("rad",)))


def test_a_model_over_angles_is_saved_and_read_back(tmp_path):
    model = wu_1996()
    a = lpv.load(lpv.save(model, tmp_path / "wu.json")).frozen([0.4])[0]
    np.testing.assert_array_equal(a, model.frozen([0.4])[0])
    np.testing.assert_allclose(a[:2, 2:], [[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])


def test_a_certificate_by_bernstein_coefficients_is_refused_not_given_wrongly():
    with pytest.raises(InputError, match=r"basis of polynomials or splines: got .*cos"):
        lpv.certify_stability(wu_1996())


@pytest.mark.parametrize(("call", "message"), [
    (lambda: Fourier("p,q"), "one variable"),
    (lambda: Fourier("p", 0), "harmonics"),
    (lambda: Fourier("p", 1, -1.0), "period"),
    (lambda: Fourier("p", 2).overshoot(4), "more than 4"),
    (lambda: Fourier("p", 2).derivative(np.zeros((1, 1)), "q"), "no scheduling variable 'q'"),
])
def test_bad_input_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
