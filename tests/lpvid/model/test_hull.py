"""The training hull of the scheduling: membership against a linear program, size limits, what validation says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lpvid.condition import split_tail
from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.model.hull import FACETS, Hull, corners_of, directions, hull_of, inside, outside_share
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot.controllers import controller_gains
from lpvid.plot.synthesis import line_of
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.validation import validate


def in_hull(point: np.ndarray, samples: np.ndarray) -> bool:
    """Oracle: is the point a convex combination of the samples (a linear program)?"""
    from scipy.optimize import linprog

    n = len(samples)
    found = linprog(np.zeros(n), A_eq=np.vstack([samples.T, np.ones(n)]), b_eq=np.append(point, 1.0))
    return bool(found.status == 0)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_exact_hull_agrees_with_a_linear_program(rng, n):
    corners = rng.uniform(-1, 1, (2 * n + 1, n)) * np.logspace(-3, 4, n)
    weights = rng.dirichlet(np.ones(len(corners)), 300)
    samples = np.vstack([corners, weights @ corners])
    hull = Hull.of([f"p{i}" for i in range(n)], samples)
    assert hull.exact and len(hull.normals) <= FACETS
    assert hull.contains(samples).all()
    points = samples.min(axis=0) + rng.uniform(0, 1, (60, n)) * np.ptp(samples, axis=0)
    expected = [in_hull(q / np.ptp(samples, axis=0), corners / np.ptp(samples, axis=0)) for q in points]
    assert hull.contains(points).tolist() == expected
    assert 0 < sum(expected) < 60


def test_many_samples_change_nothing(rng):
    """Above the size at which candidates are picked first, the same hull comes out."""
    samples = rng.uniform(-1, 1, (30_000, 3)) @ rng.normal(size=(3, 3))
    few = Hull.of("abc", samples[:20_000])
    points = 2.2 * rng.uniform(-1, 1, (500, 3)) @ rng.normal(size=(3, 3))
    again = Hull.of("abc", np.vstack([samples[:20_000], 0.5 * samples[:15_000]]))
    assert again.contains(points).tolist() == few.contains(points).tolist()


def test_a_round_hull_is_held_by_as_many_directions_as_allowed(rng):
    angle = rng.uniform(0, 2 * np.pi, 5000)
    circle = np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(-1, 1, 5000)])
    hull = Hull.of(("cos", "sin", "rate"), circle)
    assert not hull.exact and len(hull.normals) == FACETS
    assert hull.contains(circle).all()
    outside = np.array([[0.95, 0.95, 0.0], [-0.9, 0.9, 0.5], [0.0, 0.0, 1.3]])
    assert not hull.contains(outside).any()
    flat = Hull.of(("p", "q"), np.column_stack([angle, 2 * angle]))
    assert not flat.exact and flat.contains(np.array([[1.0, 2.0]])).all()
    assert not flat.contains(np.array([[1.0, 4.0]])).any()
    assert np.allclose(np.linalg.norm(directions(5, 150), axis=1), 1)


def test_a_model_file_carries_it_and_validation_counts_with_it(rng):
    n = 1200
    u, p = rng.normal(size=n), rng.uniform(-1, 1, n)
    q = np.where(np.arange(n) < 900, 0.9 * p, -0.9 * p) + 0.1 * rng.uniform(-1, 1, n)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = (0.4 + 0.2 * p[k]) * y[k - 1] + (1 + q[k]) * u[k - 1] + 0.01 * rng.normal()
    record = Record({"u": u, "p": p, "q": q, "y": y}, sample_time=0.01)
    arx = ARX(na=1, nb=1, input="u", output="y", basis=Polynomial(("p", "q"), degree=1))
    found = identify(record.slice(0, 900), arx)
    assert found.training.extrapolation_share == 0.0
    restored = LPVTransferFunction.from_dict(json.loads(json.dumps(found.model.to_dict())))
    hull = hull_of(restored)
    assert hull is not None and hull.names == ("p", "q")
    kept = record.slice(900, n)
    share = validate(restored, kept).extrapolation_share
    assert share == pytest.approx(np.mean(np.abs(kept["q"] - 0.9 * kept["p"]) > 0.1), abs=0.05) and share > 0.8
    assert restored.box.contains(kept.matrix(["p", "q"])).mean() > 0.95
    assert "outside the training" in repr(validate(restored, kept))


def test_models_without_a_hull_are_judged_by_their_box():
    model = LPVTransferFunction.siso([[-0.5, 0.0]], [[1.0, 0.0]], Polynomial("p", degree=1), 0.1)
    assert hull_of(model) is None
    assert outside_share(model, np.array([[0.0], [2.0]])) == 0.5
    assert outside_share(model, np.empty((3, 0))) == 0.0
    with pytest.raises(InputError, match="a hull needs samples"):
        Hull.of(("p", "q"), np.zeros((4, 3)))


def test_gyroscope_leaves_the_hull_more_often_than_the_box(shared_data):
    from lpvid.files import read

    training, held_out = split_tail(read(shared_data / "gyroscope" / "estimation.csv")[0])
    names = ["p1", "p2", "p3"]
    hull = Hull.of(names, training.matrix(names))
    p = held_out.matrix(names)
    box = np.all((p >= training.matrix(names).min(axis=0)) & (p <= training.matrix(names).max(axis=0)), axis=1)
    assert np.mean(~hull.contains(p)) > np.mean(~box)
    assert hull.contains(training.matrix(names)).all()


def designed_over(names: tuple[str, ...], hull: Hull) -> LPVStateSpace:
    """A constant gain on the box of ±1 whose metadata name a hull."""
    n = len(names)
    d = np.zeros((1 + n, 1, 1))
    return LPVStateSpace(np.zeros((1 + n, 0, 0)), np.zeros((1 + n, 0, 1)), np.zeros((1 + n, 1, 0)), d,
                         Polynomial(names, 1), 0.1, Scheduling(names, (-1,) * n, (1,) * n),
                         metadata={"hull": hull.to_dict()})


def test_the_hull_of_one_variable_is_narrower_than_its_box():
    model = designed_over(("r",), Hull.of(("r",), np.array([[-0.2], [0.3]])))
    np.testing.assert_allclose(corners_of(model, 4), [[-0.2], [0.3]])
    assert inside(model, np.array([[0.2], [0.9]])).tolist() == [True, False]


def test_variables_of_a_hull_in_another_order_than_those_of_the_box():
    model = designed_over(("p", "q"), Hull.of(("q", "p"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.1]])))
    assert inside(model, np.array([[0.01, 0.8], [0.8, 0.01]])).tolist() == [True, False]  # q up to 1, p up to 0.1


def test_one_value_of_one_variable_has_no_inside():
    with pytest.raises(InputError, match="no inside"):
        Hull.of(("r",), np.array([[0.3]])).vertices()


def test_curves_of_a_hull_beside_the_diagonal_of_its_box_are_inside():
    model = designed_over(("p", "q"), Hull.of(("p", "q"), np.array([[0.2, -0.9], [0.9, -0.9], [0.9, -0.2]])))
    points = line_of(model)
    assert len(points) > 1 and np.ptp(points[:, 0]) == pytest.approx(0.7) and inside(model, points).all()
    axes = np.atleast_1d(controller_gains(model)).ravel()
    over = axes[1].get_lines()[0].get_xdata()
    assert [over[0], over[-1]] == pytest.approx([0.2, 0.9])  # the gains too are drawn across the hull


def test_a_hull_from_a_file_without_widths_or_without_end_is_refused_in_one_line():
    """What a hull in the metadata of a model file may be; `Hull.of` makes neither."""
    data = Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])).to_dict()
    with pytest.raises(InputError, match="half widths of a hull must be positive"):
        Hull.from_dict({**data, "half_width": [0.0, 1.0]})
    strip = {**data, "normals": [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]], "offsets": [1.0, 1.0, 1.0]}
    with pytest.raises(InputError, match="hull of p, q has no end: got 3 facets"):
        Hull.from_dict(strip).vertices()
    line = {**data, "names": ["p"], "centre": [0.0], "half_width": [1.0], "normals": [[1.0]], "offsets": [1.0]}
    with pytest.raises(InputError, match="hull of p has no end"):
        Hull.from_dict(line).vertices()
