"""Matrices over a basis: values of sums, products and blocks against plain matrix algebra at points."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.scheduling import Fourier, Polynomial, Spline
from lpvid.synthesis.matrix_function import MatrixFunction, block


@pytest.mark.parametrize("bases", [(Polynomial("p", 2), Polynomial("p", 1, (0.4,), (3.0,))),
                                   (Fourier("p", 1), Polynomial("p", 1)),
                                   (Spline("p", 2, 1, (-1, 0, 1)), Fourier("p", 2)),
                                   (Polynomial(), Spline("p", 2, 3, (-1, 0, 1)))])
def test_algebra_is_that_of_the_values(bases):
    rng = np.random.default_rng(2)
    x, y = (MatrixFunction(b, rng.normal(size=(b.size, 2, 2))) for b in bases)
    k = rng.normal(size=(2, 2))
    points = rng.uniform(-1, 1, (7, 1))

    def at(f):
        return f.at(points if f.basis.names else points[:, :0])

    for got, expected in ((x + y, at(x) + at(y)), (x - y, at(x) - at(y)), (x @ y, at(x) @ at(y)), (k @ x, k @ at(x)),
                          (x @ k, at(x) @ k), (x + 2.0, at(x) + 2 * np.eye(2)), (1.0 - x, np.eye(2) - at(x)),
                          (x @ y - y @ x, at(x) @ at(y) - at(y) @ at(x)),
                          (block([[x, y], [k, x @ y]]), np.block([[at(x), at(y)], [np.tile(k, (7, 1, 1)),
                                                                                   at(x) @ at(y)]]))):
        np.testing.assert_allclose(at(got), expected, atol=1e-11)
        np.testing.assert_allclose(at(got.trimmed()), expected, atol=1e-11)


def test_shapes_must_fit():
    with pytest.raises(InputError, match="different shapes"):
        _ = MatrixFunction.constant(np.eye(2)) + np.eye(3)


def test_a_matrix_function_is_trimmed_to_the_degree_it_needs():
    p = MatrixFunction(Polynomial("p", 1), np.array([[[0.0]], [[1.0]]]))
    square = p @ p
    assert square.basis.degree == 2
    assert (square - square + p).trimmed().basis == Polynomial("p", 1)
    assert (square - square).still is not None and not (square - square).still.any()
    assert block([[p, np.zeros((1, 0))]]).shape == (1, 1)
