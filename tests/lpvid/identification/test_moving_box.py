"""R follows the range of the scheduling: one pass over a stream gives the estimate of the whole."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.files.streaming import read_ahead
from lpvid.identification.moving_box import carried_over
from lpvid.record import Record
from lpvid.scheduling import Polynomial


def drifting(samples: int = 3000) -> Record:
    """A second-order system of two scheduling variables whose ranges grow to the end."""
    rng = np.random.default_rng(5)
    t = np.linspace(0, 1, samples)
    p, q = 40.0 + 30 * t**2 * np.sin(40 * t), -2.0 + 1e-3 * np.exp(5 * t) * np.cos(90 * t)
    u, y = rng.normal(size=samples), np.zeros(samples)
    for k in range(1, samples):
        y[k] = (0.5 + 0.004 * p[k]) * y[k - 1] + (1 - 0.2 * q[k]) * u[k - 1] + 0.05 * rng.normal()
    return Record({"u": u, "y": y, "p": p, "q": q}, sample_time=0.01, name="run")


STRUCTURE = lpv.ARX(2, 2, 1, "u", "y", lpv.Polynomial(("p", "q"), degree=2), affine=2, lagged=True)


def pieces(record: Record, rows: int) -> Iterator[Record]:
    for first in range(0, record.n_samples, rows):
        yield record.slice(first, min(first + rows, record.n_samples))


@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("rows", [37, 500, 3000])
def test_one_pass_over_a_generator_is_the_estimate_of_the_whole(rows: int) -> None:
    whole = drifting()
    found, one = lpv.identify_stream(pieces(whole, rows), STRUCTURE), STRUCTURE.estimate([whole])
    np.testing.assert_allclose(found.parameters, one.parameters, rtol=1e-9, atol=1e-10 * np.abs(one.parameters).max())
    assert found.model.box.lower == one.model.box.lower and found.model.box.upper == one.model.box.upper
    np.testing.assert_allclose(found.covariance, one.covariance, rtol=1e-7)


def test_a_basis_that_cannot_follow_needs_its_range_first() -> None:
    spline = lpv.ARX(1, 1, 1, "u", "y", lpv.Spline("p", segments=3, order=1))
    with pytest.raises(InputError, match="range of the scheduling"):
        lpv.identify_stream(pieces(drifting(500), 100), spline)


def test_a_variable_that_stands_still_is_refused_at_the_end() -> None:
    still = drifting(500).with_channel("q", np.full(500, 3.0), "")
    with pytest.raises(InputError, match="'q' is constant"):
        lpv.identify_stream(pieces(still, 100), STRUCTURE)


def test_change_of_basis_is_that_of_the_functions() -> None:
    rng = np.random.default_rng(0)
    old = Polynomial(("a", "b"), 3, (0.3, -1.0), (0.5, 2.0))
    new = Polynomial(("a", "b"), 3, (0.1, 0.5), (1.5, 4.0))
    p = rng.normal(size=(50, 2))
    np.testing.assert_allclose(old.evaluate(p) @ old.change_to(new), new.evaluate(p), rtol=1e-12, atol=1e-12)


def test_carried_over_is_the_factor_of_the_rows_in_the_new_basis() -> None:
    rng = np.random.default_rng(1)
    old, new = Polynomial("p", 2, (0.0,), (1.0,)), Polynomial("p", 2, (2.0,), (4.0,))
    p, u, y = rng.uniform(-1, 1, (200, 1)), rng.normal(size=(200, 2)), rng.normal(size=(200, 1))
    places = np.array([(0, 0, s, f) for s in range(2) for f in range(3)])

    def factor(basis: Polynomial) -> np.ndarray:
        rows = np.hstack([u[:, [s]] * basis.evaluate(p) for s in range(2)])
        return np.linalg.qr(np.hstack([rows, y]), mode="r")

    moved, direct = carried_over(factor(old), places, old, new), factor(new)
    np.testing.assert_allclose(moved.T @ moved, direct.T @ direct, rtol=1e-10, atol=1e-10)


def test_what_goes_wrong_while_reading_ahead_is_raised_in_its_place() -> None:
    def source() -> Iterator[int]:
        yield 1
        yield 2
        raise OSError("unplugged")

    seen = []
    with pytest.raises(OSError, match="unplugged"):
        for item in read_ahead(source()):
            seen.append(item)
    assert seen == [1, 2]
