"""Gains over polytopes of the scheduling: closed forms, the box as oracle, and designs for the hull."""

import json

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm

TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def model(sample_time=None, basis=None):
    """A(p, q) = A₀ + p A₁ + q A₂: damping falls with p, stiffness rises with q; both at once are worst."""
    a = np.array([[[0, 1.0], [-1, -1.2]], [[0, 0], [0, 0.8]], [[0, 0], [-0.3, 0.35]]])
    b, c = np.zeros((3, 2, 1)), np.zeros((3, 1, 2))
    b[0], c[0] = [[0.0], [1.0]], [[1.0, 0.0]]
    if sample_time is not None:
        a, b = a * sample_time, b * sample_time
        a[0] += np.eye(2)
    return lpv.LPVStateSpace(a, b, c, np.zeros((3, 1, 1)), basis or lpv.Polynomial(("p", "q"), 1), sample_time,
                             lpv.Scheduling(("p", "q"), (0.0, 0.0), (1.0, 1.0)))


@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_hull_is_between_its_frozen_norms_and_the_box(sample_time):
    system = model(sample_time)
    found = lpv.hull_gain(system, lpv.Hull.of(("p", "q"), TRIANGLE))
    inside = [h_infinity_norm(system.frozen([p, q]), sample_time is not None)[0]
              for p in np.linspace(0, 1, 9) for q in np.linspace(0, 1 - p, 5)]
    assert found.verdict == "certified"
    assert max(inside) <= found.upper * (1 + 1e-9)
    box = lpv.l2_gain(system, basis=lpv.Polynomial((), 0), trajectories=False)
    assert found.upper < 0.9 * box.upper
    again = type(found).from_dict(json.loads(json.dumps(found.to_dict())))
    assert lpv.verify(again.certificate, system).holds
    assert not lpv.verify(again.certificate, model(sample_time).replace(A=1.01 * system.A)).holds


def test_hull_that_is_the_box_gives_its_gain():
    corners = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    hull = lpv.hull_gain(model(), lpv.Hull.of(("p", "q"), corners))
    box = lpv.l2_gain(model(), basis=lpv.Polynomial((), 0), trajectories=False)
    assert hull.upper == pytest.approx(box.upper, rel=2e-3)


@pytest.mark.seconds
def test_disc_holds_the_circle():
    """A + cos θ A₁ + sin θ A₂ of a rotating frame: polygons of more sides come closer from above."""
    a = np.array([[[-1.0, 0], [0, -2.0]], [[0.5, 0], [0, -0.5]], [[0, 0.5], [0.5, 0]]])
    b, c = np.zeros((3, 2, 2)), np.zeros((3, 2, 2))
    b[0] = c[0] = np.eye(2)
    turning = lpv.LPVStateSpace(a, b, c, np.zeros((3, 2, 2)), lpv.Polynomial(("c", "s"), 1), None)
    gains = [lpv.hull_gain(turning, lpv.Hull.disc(("c", "s"), sides=k)).upper for k in (4, 8, 32)]
    assert gains[0] > gains[1] > gains[2]
    frozen = max(h_infinity_norm(turning.frozen([np.cos(t), np.sin(t)]))[0] for t in np.linspace(0, 6.3, 60))
    assert frozen <= gains[2]
    exact = lpv.Hull.disc(("c", "s"), sides=32)
    angles = np.linspace(0, 2 * np.pi, 200)
    assert exact.contains(np.column_stack([np.cos(angles), np.sin(angles)])).all()


def test_vertices_are_those_of_the_samples():
    samples = np.vstack([TRIANGLE, 0.3 * TRIANGLE + 0.1])
    np.testing.assert_allclose(lpv.Hull.of(("p", "q"), samples * [10.0, 0.1]).vertices(),
                               [[0, 0], [0, 0.1], [10, 0]], atol=1e-9)
    np.testing.assert_allclose(lpv.Hull.of(("p",), np.array([[2.0], [5.0], [3.0]])).vertices(), [[2.0], [5.0]])


@pytest.mark.slow
def test_gain_table_for_a_hull():
    """A corner of the box that was never measured has half the stiffness: without it the gain at rest is 1, not 2."""
    a = np.array([[[0, 1.0], [-1.5, -0.3]], [[0, 0], [0.5, 0.4]], [[0, 0], [0.5, 0.4]]])
    b, c, d = np.zeros((3, 2, 2)), np.zeros((3, 3, 2)), np.zeros((3, 3, 2))
    b[0], c[0], d[0, 1, 1] = [[0, 0], [1, 1.0]], [[1.0, 0], [0, 0], [0, 1.0]], 0.3
    system = lpv.LPVStateSpace(a, b, c, d, lpv.Polynomial(("p", "q"), 1), None,
                               lpv.Scheduling(("p", "q"), (0.0, 0.0), (1.0, 1.0)), inputs=("push", "force"),
                               outputs=("stroke", "effort", "speed"))
    plant = lpv.GeneralizedPlant(system, ["force"], ["speed"])
    hull = lpv.Hull.of(("p", "q"), TRIANGLE)
    small = lpv.synthesize(plant, lpv.FixedStructure(hull=hull, starts=2, points=3))
    whole = lpv.synthesize(plant, lpv.FixedStructure(starts=2, points=3))
    assert small.solved and small.between_grid
    assert lpv.verify(small.certificate, small.closed_loop).holds
    assert small.gamma_verified == pytest.approx(1.0, abs=0.02)
    assert whole.gamma_verified >= 1.99


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="affine in its scheduling"):
        quadratic = lpv.Polynomial(("p", "q"), 2)
        zero, curved = np.zeros((quadratic.size, 1, 1)), np.ones((quadratic.size, 1, 1))
        lpv.hull_gain(lpv.LPVStateSpace(curved, zero, zero, zero, quadratic, None), lpv.Hull.of(("p", "q"), TRIANGLE))
    with pytest.raises(lpv.InputError, match="lacks a scheduling variable"):
        lpv.hull_gain(model(), lpv.Hull.of(("p", "r"), TRIANGLE))
    with pytest.raises(lpv.InputError, match="no inside"):
        lpv.Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]])).vertices()


def test_the_unstable_vertex_is_named_by_what_the_system_reads():
    """The hull lists q first, and the system reads p alone, or p before q: unstable at (q, p) = (1, 0.5) only."""
    hull = lpv.Hull.of(("q", "p"), np.array([[0.0, 0.0], [3.0, 0.1], [1.0, 0.5], [0.5, 0.3]]))
    zero, one = np.zeros((3, 1, 1)), np.zeros((3, 1, 1))
    one[0] = 1.0
    for names, where in ((("p",), "at p = 0.5"), (("p", "q"), "at p = 0.5, q = 1")):
        a = np.array([[[-1.0]], [[3.0]], [[0.1]]])[:1 + len(names)]
        part = slice(0, len(a))
        system = lpv.LPVStateSpace(a, one[part], one[part], zero[part], lpv.Polynomial(names, 1), None)
        found = lpv.hull_gain(system, hull)
        assert found.verdict == "unstable" and found.why.endswith(where), found.why
