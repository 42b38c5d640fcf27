"""Analyses of what was designed for a polytope: dense mixtures of the vertices, the box and trajectories as oracles."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import lpvid as lpv
from lpvid.analysis.bound import BoundSearch
from lpvid.analysis.certified_margins import largest_rate
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.model.designed import designed
from lpvid.model.hull import KEY, design_hull
from lpvid.report.stability import stability_page, study_stability
from lpvid.report.stability_reach import Questions

TRIANGLE = lpv.Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
NAMES = ("p", "q")


def loop(a, sample_time=None, hull=TRIANGLE, box=((0.0, 0.0), (1.0, 1.0)), rate=(None, None)):
    """x⁺ or ẋ = (A₀ + p A₁ + q A₂) x + w, z = x as a closed loop that was designed for a hull."""
    n = np.shape(a)[-1]
    b, c = np.zeros((3, n, n)), np.zeros((3, n, n))
    b[0] = c[0] = np.eye(n)
    found = lpv.LPVStateSpace(np.array(a, dtype=float), b, c, np.zeros((3, n, n)), lpv.Polynomial(NAMES, 1),
                              sample_time, lpv.Scheduling(NAMES, *box, rate))
    return designed(found.replace(metadata={KEY: hull.to_dict()} if hull else {}), "closed loop")


def scalar(**more):
    """ẋ = −(1.5 − p − q) x + w: unstable in the corner p = q = 1 of the box, slowest rate −0.5 in the triangle."""
    return loop([[[-1.5]], [[1.0]], [[1.0]]], **more)


def oscillator(sample_time=None):
    """Damping falls with p, stiffness with q; unstable in the corner of the box."""
    a = np.array([[[0, 1.0], [-2, -1.2]], [[0, 0], [0.2, 0.7]], [[0, 0], [0.6, 0.65]]])
    if sample_time is not None:
        a = a * sample_time
        a[0] += np.eye(2)
    return loop(a, sample_time)


@pytest.fixture
def coarse(monkeypatch):
    """Largest ranges and rates to a factor of 1.5: each step of their bisections is a semidefinite program or more."""
    monkeypatch.setattr("lpvid.analysis.certified_margins.PRECISION", 0.5)


def mixtures(vertices, count, rng):
    return rng.dirichlet(0.5 * np.ones(len(vertices)), count) @ vertices


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_one_matrix_decreases_at_every_mixture_of_the_vertices(sample_time, rng):
    model = oscillator(sample_time)
    found = lpv.certify_stability(model)
    assert found.verified and found.between_grid and found.kind == "quadratic" and "polytope of 3" in found.claim
    assert not lpv.certify_stability(model, range=((0.0, 1.0), (0.0, 1.0))).verified  # the box has an unstable corner
    p, alpha = found.matrices[0], found.decay_rate
    points = mixtures(TRIANGLE.vertices(), 400, rng)
    slowest = -np.inf
    for a in model.at(points)[0]:
        if sample_time is None:
            inner = a.T @ p + p @ a + 2 * alpha * p
            slowest = max(slowest, np.linalg.eigvals(a).real.max())
        else:
            inner = a.T @ p @ a - np.exp(-2 * alpha * sample_time) * p
            slowest = max(slowest, np.log(np.abs(np.linalg.eigvals(a)).max()) / sample_time)
        assert np.linalg.eigvalsh(inner).max() < 1e-12 * np.abs(p).max()
    assert 0.5 * -slowest < alpha <= -slowest + 1e-9
    x = np.eye(2)[0]
    for point in mixtures(TRIANGLE.vertices(), 60, rng):  # jumps, each held for a while
        a = model.frozen(point)[0]
        step, time = (expm(a * 0.1), 0.1) if sample_time is None else (a, sample_time)
        later = step @ x
        assert later @ p @ later <= np.exp(-2 * alpha * time) * (x @ p @ x) * (1 + 1e-9)
        x = later


@pytest.mark.seconds
def test_certificate_of_a_polytope_is_kept_and_checked(tmp_path):
    model = oscillator()
    lpv.save(lpv.certify_stability(model), tmp_path / "certificate.json")
    again = lpv.load(tmp_path / "certificate.json")
    assert lpv.verify(again, model).holds and again.claim == lpv.certify_stability(model).claim
    data = json.loads((tmp_path / "certificate.json").read_text())
    for change in ({"vertices": [[0.0, 0.0], [2.5, 0.0], [0.0, 1.0]]}, {"vertices": [[0.0], [1.0]]},
                   {"decay_rate": 10 * data["decay_rate"]}, {"margin": 2 * data["margin"]}):
        (tmp_path / "other.json").write_text(json.dumps({**data, **change}))
        assert not lpv.verify(lpv.load(tmp_path / "other.json"), model).holds, change


def test_frozen_poles_are_those_of_the_polytope(rng):
    model = oscillator()
    found = lpv.frozen_stability(model)
    points = mixtures(TRIANGLE.vertices(), 2000, rng)
    worst = max(np.linalg.eigvals(a).real.max() for a in model.at(points)[0])
    assert found.stable and found.hull is not None and worst <= found.max_real_part < 0
    assert TRIANGLE.contains(np.array([[found.at["p"], found.at["q"]]])).all()
    line = lpv.critical_scheduling(model).along("p").line
    locus = lpv.pole_locus(model, "p")
    for low, high in ((line.low, line.high), (locus.p[0], locus.p[-1])):
        assert (low, high) == pytest.approx((0.0, 2 / 3))  # through the middle (1/3, 1/3)
    assert lpv.pole_locus(model, "p", range=(0.0, 1.0)).p[-1] == 1.0
    whole = lpv.frozen_stability(model.replace(metadata={}))
    assert not whole.stable and whole.hull is None


@pytest.mark.seconds
def test_span_of_a_line_by_sampling(rng):
    hull = lpv.Hull.of(("a", "b", "c"), rng.standard_normal((30, 3)) * [1, 10, 100])
    for _ in range(20):
        origin, along = hull.middle + rng.normal(0, 0.4, 3) * [1, 10, 100], rng.standard_normal(3) * [1, 10, 100]
        s = np.linspace(-30, 30, 60001)
        within = s[hull.contains(origin + s[:, None] * along)]
        span = hull.span(origin, along)
        assert (span is None) == (not within.size)
        if span is not None:
            assert span == pytest.approx((within[0], within[-1]), abs=2e-3)
    assert hull.span(hull.vertices().max(axis=0) + 1.0, np.eye(3)[0]) is None


def test_over_fewer_variables_is_the_shadow():
    hull = lpv.Hull.of(("p", "q"), np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 1.0]]))
    assert hull.over(("q",)).vertices().ravel().tolist() == [0.0, 2.0]
    np.testing.assert_allclose(np.sort(hull.over(("q", "p")).vertices(), axis=0),
                               np.sort(hull.vertices()[:, ::-1], axis=0), atol=1e-9)


@pytest.mark.seconds
def test_growth_is_looked_for_inside_only():
    """Two nilpotent vertices, in turn each 1.8-fold a sample; at 0.55 of both each product of two is a contraction."""
    a, b = np.array([[0.0, 1.8], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.8, 0.0]])
    matrices = [np.zeros((2, 2)), a, b]
    found = lpv.certify_stability(loop(matrices, 1.0))
    assert not found.verified and found.divergence.growth == pytest.approx(1.8, rel=1e-6)
    assert TRIANGLE.contains(found.divergence.points).all()
    narrow = lpv.Hull.of(NAMES, 0.55 * TRIANGLE.vertices())
    assert lpv.certify_stability(loop(matrices, 1.0, narrow)).verified
    switching = loop([np.zeros((2, 2)), [[-0.1, 1], [-10, -0.1]], [[-0.1, 10], [-1, -0.1]]])
    edge = lpv.Hull.of(NAMES, np.array([[1.0, 0.0], [0.0, 1.0], [0.9, 0.0]]))
    grows = lpv.certify_stability(designed(switching.replace(metadata={KEY: edge.to_dict()}), "closed loop"))
    assert not grows.verified and edge.contains(grows.divergence.points).all() and grows.divergence.growth_rate > 0


def growing_in_turn():
    """Two vertices between which jumps let the state grow; slow motion does not."""
    turning = [np.array([[-0.5, 1], [-10, -0.5]]), np.array([[0.0, 9], [9, 0]]), np.zeros((2, 2))]
    hull = lpv.Hull.of(NAMES, np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.1]]))
    return loop(turning, hull=hull)


@pytest.mark.seconds
def test_bounded_rates_are_covered_on_the_hull():
    """No P of degree zero serves for both vertices; one of a higher degree does."""
    model = growing_in_turn()
    assert not lpv.certify_stability(model).verified
    slow = lpv.certify_stability(model, rate=0.02)
    assert slow.verified and slow.kind == "parameter-dependent" and len(slow.vertices) == 3
    assert "polytope of 3 vertices with |d p/dt| <= 0.02" in slow.claim
    assert lpv.verify(slow, model).holds
    assert slow.box.limits[slow.box.names[0]] == (0.0, 1.0)


@pytest.mark.seconds
def test_largest_rate_on_a_hull_is_above_one_that_is_covered(coarse):
    found = largest_rate(growing_in_turn())
    assert not found.arbitrary and found.rates is not None and max(found.rates) >= 0.02


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_gain_of_a_designed_loop_is_that_of_its_hull(sample_time, rng):
    model = oscillator(sample_time)
    found = lpv.l2_gain(model)
    most = max(h_infinity_norm(model.frozen(p), sample_time is not None)[0]
               for p in mixtures(TRIANGLE.vertices(), 200, rng))
    assert found.verdict == "certified" and most <= found.upper and found.lower >= 0.98 * most
    one = lpv.hull_gain(model, TRIANGLE).upper
    assert found.upper == pytest.approx(one, rel=1e-6) if sample_time is None else found.upper <= one * (1 + 1e-6)
    assert lpv.l2_gain(model, range=((0, 1), (0, 1)), trajectories=False).verdict == "unstable"
    assert lpv.l2_gain(scalar()).upper == pytest.approx(2.0, rel=1e-3)  # 1/0.5
    assert lpv.l2_gain(scalar(), range=((0, 0.5), (0, 0.5)), trajectories=False).upper == pytest.approx(2.0, rel=1e-3)


def turned():
    """Zero for every frozen p, a gain of 1 for fast p, as in `lpv.l2_gain`; designed for a flat triangle."""
    eye = np.eye(2)
    basis, box = lpv.Polynomial(NAMES, 1), lpv.Scheduling(NAMES, (-1, -1), (1, 1), (0.1, 0.1))
    a, zero = np.array([-eye, 0 * eye, 0 * eye]), np.zeros((2, 1))
    system = lpv.LPVStateSpace(a, np.array([[[1], [0]], [[0], [1]], zero]), np.array([[[0, -1]], [[1, 0]], zero.T]),
                               np.zeros((3, 1, 1)), basis, None, box)
    hull = lpv.Hull.of(NAMES, np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]]))
    return designed(system.replace(metadata={KEY: hull.to_dict()}), "closed loop")


@pytest.mark.seconds
def test_gain_with_bounded_rates_is_lower():
    """By a P(p) on the hull."""
    model = turned()
    slow, fast = lpv.l2_gain(model), lpv.l2_gain(model, rate=np.inf)
    assert slow.upper < 0.2 and fast.upper == pytest.approx(1.0, rel=1e-2) and len(slow.certificate.vertices) == 3
    assert all(lpv.verify(g.certificate, model).holds for g in (slow, fast))


@pytest.mark.seconds
def test_gain_with_bounded_rates_is_no_higher_than_on_the_box_around():
    around = lpv.l2_gain(turned(), range=((-1, 1), (0, 0.1)), trajectories=False)
    assert lpv.l2_gain(turned()).upper <= around.upper * 1.005


@pytest.mark.seconds
def test_share_of_draws_that_the_same_matrix_covers_on_the_polytope(rng):
    """Draws within a thousandth are covered; on the box around it none is, for its corner is unstable."""
    model = oscillator()
    certificate = lpv.certify_stability(model)
    draws = [model.replace(A=model.A * (1 + 1e-3 * rng.standard_normal(model.A.shape))) for _ in range(20)]
    assert lpv.certified_share(certificate, draws).probability == 1.0
    assert lpv.certified_share(certificate, [model.replace(A=model.A * 3.0 - 2.0 * model.A[:1])]).probability == 0.0


def test_region_of_training_data_is_no_set_of_a_design():
    trained = scalar().replace(metadata={KEY: TRIANGLE.to_dict()})
    assert design_hull(trained) is None and design_hull(scalar()) is not None
    assert not lpv.frozen_stability(trained).stable and not lpv.certify_stability(trained).verified


@pytest.mark.seconds
def test_report_states_the_set_that_was_examined(coarse):
    study = study_stability(oscillator(), questions=Questions(True, True, True))
    data = study.to_dict()
    assert data["certified"] and study.mark == "good"
    assert data["hull"]["names"] == ["p", "q"] and len(data["hull"]["vertices"]) == 3
    assert "polytope of 3 vertices" in str(study) and "polytope of 3 vertices" in study.verdict
    assert study.reach.largest_range.factor >= 1 and len(study.reach.largest_range.hull.vertices()) == 3
    assert study.reach.l2_gain.verdict == "certified" and study.reach.largest_rate.arbitrary
    page = stability_page(study, "loop.json")
    assert ("examined, as designed for", "a polytope of 3 vertices over p, q") in page.facts
    assert [found.p[-1] for found, _ in study.loci] == pytest.approx([2 / 3, 2 / 3])
    box = study_stability(oscillator(), range={"p": (0.0, 1.0), "q": (0.0, 1.0)})
    assert box.to_dict()["hull"] is None and not box.certified and "box" not in str(box)
    assert study_stability(oscillator().replace(metadata={})).to_dict()["hull"] is None


def gains(sample_time):
    """A law without states on the triangle: u = (1 + p − q) y."""
    d, none = np.array([1.0, 1.0, -1.0]).reshape(3, 1, 1), np.zeros((3, 0, 0))
    found = lpv.LPVStateSpace(none, np.zeros((3, 0, 1)), np.zeros((3, 1, 0)), d, lpv.Polynomial(NAMES, 1), sample_time,
                              lpv.Scheduling(NAMES, (0.0, 0.0), (1.0, 1.0)))
    return designed(found.replace(metadata={KEY: TRIANGLE.to_dict()}), "controller")


@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_a_law_without_states_has_neither_decay_nor_poles(sample_time):
    for model in (gains(sample_time), gains(sample_time).replace(metadata={})):
        decay, region = lpv.decay_rate(model), lpv.certify_region(model, lpv.HalfPlane(0.1))
        assert (decay.verdict, decay.certificate, decay.why) == ("not certified", None,
                                                                  "the model has no state that could decay")
        assert (region.verdict, region.certificate, region.why) == ("not certified", None, "the model has no poles")
        assert lpv.certify_stability(model).verified and lpv.l2_gain(model).upper == pytest.approx(2.0, rel=1e-3)


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_a_certificate_without_finite_vertices_does_not_hold(sample_time):
    model = oscillator(sample_time)
    region = lpv.HalfPlane(0.01) if sample_time is None else lpv.Disc(0.0, 1.0)
    found = [lpv.certify_stability(model), lpv.hull_gain(model, TRIANGLE).certificate,
             lpv.decay_rate(model).certificate, lpv.h2_norm(model).certificate,
             lpv.certify_region(model, region).certificate]
    for certificate in found:
        assert certificate.vertices is not None and lpv.verify(certificate, model).holds
        for vertices, why in ((np.zeros((0, 2)), "no vertices"), (np.array([[0.0, np.nan]]), "not finite"),
                              (1e200 * TRIANGLE.vertices(), "")):
            outcome = lpv.verify(replace(certificate, vertices=vertices), model)
            assert not outcome.holds and why in outcome.why


@pytest.mark.seconds
def test_a_proven_decay_is_not_left_for_a_faster_one_on_a_grid(monkeypatch):
    """Both are stated by their own verdicts; the search on the box around the hull may end on a grid."""
    model = oscillator()
    proven = lpv.decay_rate(model)
    around = lpv.decay_rate(model, range=((0.0, 0.5), (0.0, 0.5))).certificate
    rough = replace(around, level=10 * proven.lower, between_grid=False)
    monkeypatch.setattr(BoundSearch, "at", lambda self, level, bases: replace(rough, level=level))
    monkeypatch.setattr("lpvid.analysis.decay.worst_pole", lambda plant, box: (-10 * proven.lower, None))
    again = lpv.decay_rate(model)
    assert again.verdict == "certified" and again.lower == proven.lower
    assert lpv.verify(again.certificate, model).holds


@pytest.mark.seconds
def test_largest_rate_on_a_hull_names_the_polytope():
    assert "any motion within the polytope of 3 vertices is covered" in str(largest_rate(oscillator()))
    still = lpv.LPVStateSpace([[[-1.0]], [[0.1]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], np.zeros((2, 1, 1)),
                              lpv.Polynomial("p", 1), None, lpv.Scheduling("p", (0.0,), (1.0,)))
    assert "any motion within the range is covered" in str(largest_rate(still))


def test_ends_of_a_line_are_no_negative_zeros():
    low, high = TRIANGLE.span(np.array([0.0, 0.0]), np.array([1.0, 0.0]))
    assert (np.copysign(1.0, low), high) == (1.0, 1.0)


@pytest.mark.seconds
def test_steps_between_all_pairs_of_many_vertices_are_left_out(monkeypatch):
    """Of 200, as a hull of measured samples may have, 40,000 inequalities: 200 s of a solver. Here 80, too many too."""
    tried = []

    def recorded(system, hull, *, moving=False):
        tried.append((len(hull.vertices()), moving))
        return lpv.hull_gain(system, hull)

    monkeypatch.setattr("lpvid.analysis.gain.hull_gain", recorded)
    for sides in (12, 80):
        around = lpv.Hull.of(NAMES, 0.3 + 0.1 * lpv.Hull.disc(NAMES, sides=sides).vertices())
        assert lpv.l2_gain(oscillator(0.1).replace(metadata={
            **oscillator().metadata, KEY: around.to_dict()})).verdict == "certified"
    assert (12, True) in tried and max(count for count, moving in tried if moving) == 12
    assert max(count for count, moving in tried if not moving) == 80


@pytest.mark.seconds
def test_next_steps_for_a_hull_ask_nothing_that_is_refused():
    """`--largest-range` scales the hull; `--largest-rate` is of use where some motion is not covered."""
    turning = loop([np.array([[-0.5, 1], [-10, -0.5]]), np.array([[0.0, 9], [9, 0]]), np.zeros((2, 2))],
                   hull=lpv.Hull.of(NAMES, np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.1]])))
    for model, rate, text, faster in ((oscillator(), None, "lpvid verify", False), (turning, None, "--rate", False),
                                      (turning, 0.02, "--largest-rate", True)):
        commands = [step.command for step in stability_page(study_stability(model, rate=rate), "loop.json").steps]
        assert any(text in c for c in commands) and any("--largest-range" in c for c in commands), commands
        assert any("--largest-rate" in c for c in commands) == faster
    boxed = stability_page(study_stability(oscillator(), range={"p": (0.0, 0.3), "q": (0.0, 0.3)}), "loop.json")
    assert any("--largest-range" in step.command for step in boxed.steps)


def test_a_draw_that_is_not_affine_is_not_covered_by_vertices():
    """ẋ = −(1.5 − p − q − 8pq) x grows at (0.5, 0.5); at every vertex of the triangle it is that of the certificate."""
    basis = lpv.Polynomial(NAMES, 2)
    labels = list(basis.labels)
    a, one = np.zeros((basis.size, 1, 1)), np.zeros((basis.size, 1, 1))
    one[0], a[0] = 1.0, -1.5
    a[labels.index("p")] = a[labels.index("q")] = 1.0
    bent = a.copy()
    bent[labels.index("p*q")] = 8.0
    box, mark = lpv.Scheduling(NAMES, (0.0, 0.0), (1.0, 1.0)), {KEY: TRIANGLE.to_dict()}
    models = [designed(lpv.LPVStateSpace(x, one, one, 0 * one, basis, None, box).replace(metadata=mark), "closed loop")
              for x in (a, bent)]
    certificate = lpv.certify_stability(models[0])
    assert certificate.vertices is not None and models[1].frozen([0.5, 0.5])[0][0, 0] > 0
    assert lpv.certified_share(certificate, models[:1]).probability == 1.0
    assert lpv.certified_share(certificate, models[1:]).probability == 0.0


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_largest_hull_about_its_middle(sample_time):
    """The pole −(1.5 − p − q), or 1 less T times that, on the triangle about (1/3, 1/3): p + q = 2/3 + k/3, k = 2.5."""
    step = sample_time or 1.0
    model = loop([[[(sample_time is not None) - 1.5 * step]], [[step]], [[step]]], sample_time)
    found = lpv.largest_range(model)
    assert 0.98 * 2.5 <= found.factor <= 2.5 and found.limit == "frozen" and len(found.hull.vertices()) == 3
    assert lpv.verify(found.certificate, model).holds
    assert found.hull.middle == pytest.approx([1 / 3, 1 / 3])
    assert "a polytope of 3 vertices over p, q within" in str(found) and len(found.to_dict()["vertices"]) == 3
    with pytest.raises(lpv.InputError, match="about its middle: got towards upper"):
        lpv.largest_range(model, towards="upper")


@pytest.mark.seconds
def test_a_hull_of_slow_motion_is_larger_than_one_of_jumps(coarse):
    turning = loop([np.array([[-0.5, 1], [-10, -0.5]]), np.array([[0.0, 9], [9, 0]]), np.zeros((2, 2))],
                   hull=lpv.Hull.of(NAMES, np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.1]])))
    jumps, slow = lpv.largest_range(turning), lpv.largest_range(turning, rate=0.02)
    assert jumps.factor < 1 <= slow.factor and jumps.limit == "certificate"
    assert lpv.verify(slow.certificate, turning).holds


@pytest.mark.seconds
def test_a_draw_that_is_not_decided_makes_no_exact_share(monkeypatch):
    """A P that moves, on the triangle: without a budget its simplices decide nothing."""
    turning = loop([np.array([[-0.5, 1], [-10, -0.5]]), np.array([[0.0, 9], [9, 0]]), np.zeros((2, 2))],
                   hull=lpv.Hull.of(NAMES, np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.1]])))
    slow = lpv.certify_stability(turning, rate=0.02)
    grows = loop([np.array([[0.5, 1], [-10, 0.5]]), np.array([[0.0, 9], [9, 0]]), np.zeros((2, 2))])
    for model, share in ((turning, 1.0), (grows, 0.0)):
        found = lpv.certified_share(slow, [model])
        assert found.probability == share and found.exact
    monkeypatch.setattr("lpvid.analysis.certified_margins.PATIENCE", 1)
    undecided = lpv.certified_share(slow, [turning])
    assert undecided.probability == 0.0 and not undecided.exact
