"""Tall matrices: the numbers are numpy's to the last bit, the memory is that of one copy."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from lpvid._tall import ROWS, column_norms, factor_overwriting, least_squares_overwriting, triangular_factor
from lpvid.least_squares import FunctionResiduals, StopRule, minimise_dense

SHAPES = [(5, 1), (5, 5), (3, 4), (2 * ROWS + 7, 3), (ROWS, 40)]


def matrix(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=shape) * np.logspace(0, 6, shape[1])


def peak(call: Callable[[], object]) -> int:
    """Bytes that are in memory at most while it runs, beyond those before."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("shape", [*SHAPES, (0, 3)])
def test_the_factor_is_numpys(shape: tuple[int, int], rng: np.random.Generator) -> None:
    a, b, scale = matrix(shape, rng), rng.normal(size=shape[0]), np.arange(1.0, 1 + shape[1])
    before = a.copy()
    np.testing.assert_array_equal(triangular_factor(a), np.linalg.qr(a, mode="r"))
    np.testing.assert_array_equal(triangular_factor(a, scale, b),
                                  np.linalg.qr(np.column_stack([a / scale, b]), mode="r"))
    np.testing.assert_array_equal(a, before)
    np.testing.assert_array_equal(factor_overwriting(np.asfortranarray(a)), np.linalg.qr(before, mode="r"))


@pytest.mark.parametrize("shape", SHAPES)
def test_least_squares_are_numpys(shape: tuple[int, int], rng: np.random.Generator) -> None:
    a, b = matrix(shape, rng), rng.normal(size=shape[0])
    if shape[1] > 2:
        a[:, 1] = a[:, 0]  # of least norm
    wanted = np.linalg.lstsq(a, b, rcond=1e-8)[0]
    np.testing.assert_array_equal(least_squares_overwriting(np.asfortranarray(a), b, 1e-8), wanted)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ["C", "F"])
def test_norms_are_numpys(shape: tuple[int, int], order: str, rng: np.random.Generator) -> None:
    a = np.array(matrix(shape, rng), order=order)  # type: ignore[call-overload]
    np.testing.assert_array_equal(column_norms(a), np.linalg.norm(a, axis=0))


def test_a_step_of_a_search_holds_one_copy_of_its_jacobian(rng: np.random.Generator) -> None:
    """Five before: with the residual beside it, twice inside of numpy's QR, and turned round."""
    jacobian, target = rng.normal(size=(100_000, 10)), rng.normal(size=100_000)
    problem = FunctionResiduals(lambda x: jacobian @ x - target, lambda x: jacobian)
    most = peak(lambda: minimise_dense(problem, np.zeros(10), StopRule(iterations=2)))
    assert most < 1.7 * jacobian.nbytes
    assert peak(lambda: column_norms(jacobian)) < 0.2 * jacobian.nbytes
