"""Delays as blocks: exact in samples, all-pass in continuous time, inside loops with known margins."""

import numpy as np
import pytest

import lpvid as lpv

ONE = lpv.Polynomial((), 0)


def response(system, s):
    a, b, c, d = system.frozen(())
    return (c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d)[0, 0]


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_register_is_exact(samples):
    block = lpv.delay(0.01 * samples, 0.01)
    z = np.exp(0.7j)
    assert response(block, z) == pytest.approx(z**-samples, abs=1e-14)


def test_share_of_a_sample_is_interpolated():
    """(1 − η) z⁻¹ + η z⁻²; off by at most ω²T²/8."""
    block = lpv.delay(0.0135, 0.01)
    for omega in (5.0, 30.0):
        z = np.exp(0.01j * omega)
        assert abs(response(block, z) - np.exp(-0.0135j * omega)) <= (0.01 * omega) ** 2 / 8 * (1 + 1e-9)


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_pade_is_all_pass_with_its_error_stated(order):
    block = lpv.delay(0.2, order=order)
    omega = np.linspace(0.01, 15.0, 300)
    values = np.array([response(block, 1j * w) for w in omega])
    np.testing.assert_allclose(np.abs(values), 1.0, rtol=1e-9)
    gap = np.abs(values - np.exp(-0.2j * omega)).max()
    assert gap == pytest.approx(lpv.delay_error(0.2, order, 15.0), rel=0.02, abs=1e-9)
    first = (response(block, 1e-3j) - 1) / 1e-3j
    assert first == pytest.approx(-0.2, rel=1e-3)                # slope at rest: the delay


def test_pade_of_order_one_is_the_textbook_one():
    assert response(lpv.delay(0.5, order=1), 3.0) == pytest.approx((1 - 0.75) / (1 + 0.75))


def test_loop_with_delay_is_stable_below_its_margin():
    """ẏ = −k y(t − τ) is stable for kτ < π/2."""
    plant = lpv.LPVStateSpace([[[0.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], ONE, None, inputs=("u",), outputs=("y",))
    late = lpv.delay(0.1, order=4, input="y", output="seen")
    for gain, stable in ((15.5, True), (15.9, False)):           # π/2/0.1 = 15.708
        loop = lpv.connect([plant, late], ["r"], ["y"], {"u": f"r - {gain} seen"})
        assert (np.linalg.eigvals(loop.frozen(())[0]).real.max() < 0) == stable


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="not negative"):
        lpv.delay(-0.1)
    with pytest.raises(lpv.InputError, match="loses its digits"):
        lpv.delay(0.1, order=12)
