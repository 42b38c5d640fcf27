"""Stability certificates: found where they must exist, never where a trajectory grows, and hard to forge."""

from __future__ import annotations

import ast
import itertools
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lpvid.lmi
from lpvid.analysis.certificates import certify_stability, verify
from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.errors import InputError
from lpvid.lmi.bounds import recheck_decrease
from lpvid.lmi.driven import autonomous
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked

UNIT = Scheduling(("p",), (0.0,), (1.0,))
D0 = [-1.63, 0.964, -0.149, -0.083]
D1 = [0.15, -0.1745, 0.06372222, -0.01844444]


def state_space(a, basis, sample_time=1.0, scheduling=None) -> LPVStateSpace:
    a = np.asarray(a, dtype=float)
    m, n, _ = a.shape
    return LPVStateSpace(a, np.zeros((m, n, 1)), np.zeros((m, 1, n)), np.zeros((m, 1, 1)), basis, sample_time,
                         scheduling)


def alternating(size: float) -> LPVStateSpace:
    """size·[(1−p)·[0 2; 0 0] + p·[0 0; 2 0]]: nilpotent at both ends; jumping between them grows 2·size a sample."""
    up, down = np.array([[0, 2.0], [0, 0]]), np.array([[0, 0], [2.0, 0]])
    return state_space(size * np.array([up, down - up]), Polynomial("p", degree=1), scheduling=UNIT)


def synthetic_damper(scale: float = 1.0, unit: str = "A") -> LPVTransferFunction:
    """Fourth order, affine in the current; poles at 0 A: 0.83, 0.5 ± 0.5j, −0.2; frozen-unstable above 9 A."""
    box = Scheduling(("current",), (0.0,), (2.5 * scale,), units=(unit,))
    a = [[x, y / scale] for x, y in zip(D0, D1, strict=True)]
    return LPVTransferFunction.siso(a, [[0, 0], [1, 0]], Polynomial("current", degree=1), 1 / 512, scheduling=box)


def admissible_path(rng, low, high, step, length):
    path = np.empty(length)
    path[0] = rng.uniform(low, high)
    for k in range(1, length):
        bold = rng.choice([-step, step, rng.uniform(-step, step)])
        path[k] = np.clip(path[k - 1] + bold, low, high)
    return path


# -- the trap of frozen stability -----------------------------------------------------------------------------------
@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("size", [1.0, 0.9, 0.6])
def test_alternating_nilpotent_pair_is_never_certified_and_its_growth_is_shown(size):
    found = certify_stability(alternating(size))
    assert (found.kind, found.verified, found.between_grid) == ("none", False, False)
    assert found.divergence.growth == pytest.approx(2 * size, rel=1e-9)  # eig(A_a A_b) = {4 size², 0}
    # the trajectory is replayed here, on its own
    x, model = np.array([1.0, 1.0]), alternating(size)
    for _ in range(8):
        for p in found.divergence.points:
            x = model.companion(p) @ x
    grown = np.linalg.norm(x) ** (1 / (8 * len(found.divergence.points)))
    assert grown == pytest.approx(2 * size, rel=0.15)
    assert "not certified" in str(found)


@pytest.mark.seconds
def test_slow_variation_is_certified_only_where_no_admissible_cycle_grows(rng):
    # jumping ±step/2 about p = ½ grows by 4 size² (½ + step/2)² every two samples: the exact limit of this family
    size = 0.9
    for step in (0.5, 0.2, 0.1, 0.01):
        found = certify_stability(alternating(size), rate=step)
        grows = 2 * size * (0.5 + step / 2) > 1
        assert found.verified is not grows
        if grows:
            assert found.divergence.growth >= 2 * size * (0.5 + step / 2) * (1 - 1e-9)
            moves = np.abs(np.diff(np.append(found.divergence.points[:, 0], found.divergence.points[0, 0])))
            assert moves.max() <= step * (1 + 1e-9)
        else:
            assert found.kind == "parameter-dependent"
            assert found.between_grid
            assert found.decay >= 2 * size * (0.5 + step / 2)


def test_marginal_frozen_model_grows_under_the_smallest_move():
    found = certify_stability(alternating(1.0), rate=0.01)  # frozen radius exactly 1 at p = ½
    assert not found.verified
    assert found.divergence.growth == pytest.approx(1.01, rel=1e-6)


def test_frozen_unstable_point_is_named():
    found = certify_stability(synthetic_damper(), range=(0.0, 9.2))
    assert found.kind == "none"
    assert found.divergence.kind == "frozen"
    assert found.divergence.points[0, 0] == pytest.approx(9.2)
    assert "current = 9.2 A" in str(found)


# -- found where it must exist -------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_common_lyapunov_function_is_always_found_when_it_exists_by_construction(rng):
    for trial in range(30):
        n, degree = int(rng.integers(1, 6)), int(rng.integers(1, 4))
        basis = Polynomial("p", degree=degree)
        parts = rng.normal(size=(basis.size, n, n))
        parts /= np.linalg.norm(parts, 2, axis=(1, 2))[:, None, None]
        weights = rng.uniform(0.2, 1.0, size=basis.size)
        shape = rng.normal(size=(n, n)) + 2 * np.eye(n)
        a = np.linalg.solve(shape, parts * (0.93 * weights / weights.sum())[:, None, None]) @ shape
        found = certify_stability(state_space(a, basis, 0.01))
        assert found.kind == "quadratic", trial
        assert found.verified
        assert found.between_grid


@pytest.mark.seconds
def test_poly_quadratic_where_one_matrix_is_not_enough(rng):
    # two matrices whose joint spectral radius stays below 1 although no common P exists
    one, two = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([[0.0, 1.0], [0.0, -1.0]])
    limit = 1.0  # products of these two are again ± one of them: the joint spectral radius is 1 (Ando & Shih 1998)
    a = 0.9 * limit * np.array([one, two - one])
    model = state_space(a, Polynomial("p", degree=1), scheduling=UNIT)
    found = certify_stability(model)
    assert found.kind == "poly-quadratic"
    assert found.between_grid
    assert verify(found, model).holds
    for word in itertools.product(rng.uniform(size=3), repeat=6):
        product = np.linalg.multi_dot([model.companion([p]) for p in word])
        assert np.abs(np.linalg.eigvals(product)).max() ** (1 / 6) <= found.decay + 1e-9


@pytest.mark.seconds
@settings(max_examples=60, deadline=None)
@given(st.integers(1, 5), st.floats(0.0, 1.4), st.integers(0, 2**31))
def test_time_invariant_model_is_certified_exactly_when_its_spectral_radius_is_below_one(n, radius, seed):
    if abs(radius - 1) < 1e-4:
        return
    a = np.random.default_rng(seed).normal(size=(n, n))
    a *= radius / np.abs(np.linalg.eigvals(a)).max()
    model = state_space(a[None], Polynomial((), degree=0), 0.1)
    found = certify_stability(model)
    assert found.verified is (radius < 1)
    if found.verified:
        assert found.between_grid
        assert found.decay is None or found.decay >= min(radius, 1) * (1 - 1e-9)
    else:
        assert found.divergence.growth == pytest.approx(radius, rel=1e-6)


# -- no false promise ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("rate", [None, 40.0, 4.0])
@pytest.mark.slow
def test_certified_models_decay_along_random_and_worst_trajectories(rng, rate):
    certified = 0
    for _ in range(8):
        basis = Polynomial("p", degree=2)
        a = rng.normal(size=(basis.size, 3, 3))
        frozen = np.tensordot(basis.evaluate(np.linspace(-1, 1, 41)[:, None]), a, axes=1)
        a *= rng.uniform(0.6, 0.97) / np.abs(np.linalg.eigvals(frozen)).max()
        model = state_space(a, basis, 0.01)
        found = certify_stability(model, rate=rate)
        if not found.verified:
            continue
        certified += 1
        step = 2.0 if rate is None else rate * 0.01
        for _ in range(25):
            path = admissible_path(rng, -1.0, 1.0, step, 400)
            phi = basis.evaluate(path[:, None])
            product, log = np.eye(3), 0.0
            for matrix in np.tensordot(phi, a, axes=1):
                product = matrix @ product
                size = np.linalg.norm(product)
                product, log = product / size, log + math.log(size)
            assert log < 0
        points = np.linspace(-1, 1, 5) if step >= 0.5 else np.array([1 - step, 1, step - 1, -1])
        words = np.array(list(itertools.product(range(len(points)), repeat=5)))
        moves = np.abs(np.diff(points[words], axis=1, append=points[words[:, :1]]))
        matrices = np.array([model.companion([p]) for p in points])[words[moves.max(axis=1) <= step * (1 + 1e-9)]]
        products = matrices[:, 4] @ matrices[:, 3] @ matrices[:, 2] @ matrices[:, 1] @ matrices[:, 0]
        assert np.abs(np.linalg.eigvals(products)).max() ** (1 / 5) <= (found.decay or 1) + 1e-9
    assert certified >= 3


def test_certificate_is_about_the_recursion_that_is_simulated(rng):
    # V is recomputed along y(k) = −Σ a_i(p_k) y(k−i), or with a_i(p_{k−i}), from the definition of the model
    for lagged in (False, True):
        model = synthetic_damper().replace(lagged=lagged)
        found = certify_stability(model)
        path = rng.uniform(0, 2.5, size=60)
        a = np.array([model.coefficients([p])[0][:, 0, 0] for p in path])
        y = list(rng.normal(size=4))
        for k in range(4, 60):
            terms = (a[k - i, i - 1] if lagged else a[k, i - 1] for i in range(1, 5))
            y.append(-sum(c * y[k - i] for i, c in enumerate(terms, start=1)))
        values = []
        for k in range(4, 56):
            past = np.array([y[k - i] for i in range(1, 5)])
            # observer state: x_i(k) = −Σ_{j≥i} a_j(p_{k+i−1−j}) y(k+i−1−j)
            x = np.array([-sum(a[k + i - 1 - j, j - 1] * y[k + i - 1 - j] for j in range(i, 5)) for i in range(1, 5)]
                         ) if lagged else past
            values.append(x @ found.matrices[0] @ x)
        assert np.all(np.diff(np.log(values)) <= 2 * math.log(found.decay) + 1e-9)


# -- named cases -----------------------------------------------------------------------------------------------------
def test_synthetic_damper_over_its_range():
    model = synthetic_damper()
    for rate in (None, 125.0):
        found = certify_stability(model, rate=rate)
        assert found.kind == "quadratic"
        assert found.between_grid
        assert 0.83 <= found.decay < 0.9  # the common pole at 0.83 bounds every decay from below
        assert found.to_dict()["rate_bound"] == {"current": rate}
        assert verify(found, model).holds


@pytest.mark.seconds
def test_continuous_switched_oscillators_grow_fast_and_are_stable_slowly():
    one, two = np.array([[-0.1, 1.0], [-10, -0.1]]), np.array([[-0.1, 10.0], [-1, -0.1]])
    model = state_space([one, two - one], Polynomial("p", degree=1), None, UNIT)
    free = certify_stability(model)
    assert free.kind == "none"
    assert free.divergence.growth_rate > 1
    assert free.divergence.growth is None
    slow = certify_stability(model, rate=0.01)
    assert slow.kind == "parameter-dependent"
    assert slow.between_grid
    assert slow.time_constant >= 10  # the frozen poles have real part −0.1
    assert verify(slow, model).holds
    assert not certify_stability(model, rate=1.0).verified


def test_rotating_continuous_counterexample_is_not_certified():
    # −1 + 1.5 cos² = −¼ + ¾ cos 2ωt, …: grows as exp(t/2) along (c, s) = (cos 2t, sin 2t) though frozen poles are
    # −0.25 ± 0.66j there; with 0.2 of the rotation it is stable by |A + Aᵀ|/2 <= −0.25 + 0.15·√2 < 0
    a = np.array([[[-0.25, 1], [-1, -0.25]], [[0.75, 0], [0, -0.75]], [[0, -0.75], [-0.75, 0]]])
    basis = Polynomial(("c", "s"), degree=1)
    assert not certify_stability(state_space(a, basis, None)).verified
    assert not certify_stability(state_space(a, basis, None), rate=2.0).verified
    a[1:] *= 0.2
    found = certify_stability(state_space(a, basis, None))
    assert found.kind == "quadratic"
    assert found.between_grid


def test_quarter_car_with_damping_that_moves_arbitrarily():
    # states: deflection, body velocity, tyre deflection, wheel velocity; entries from 1 to 5500
    body, wheel, spring, tyre = 315.0, 37.5, 29_500.0, 208_000.0
    still = [[0, 1, 0, -1], [-spring / body, 0, 0, 0], [0, 0, 0, 1], [spring / wheel, 0, -tyre / wheel, 0]]
    damped = [[0, 0, 0, 0], [0, -1 / body, 0, 1 / body], [0, 0, 0, 0], [0, 1 / wheel, 0, -1 / wheel]]
    box = Scheduling(("c",), (300.0,), (3000.0,), units=("N s/m",))
    model = state_space([still, damped], Polynomial("c", degree=1), None, box)
    found = certify_stability(model)
    assert found.kind == "quadratic"
    assert found.between_grid
    slowest = min(-model.frozen_poles([c]).real.max() for c in np.linspace(300, 3000, 201))
    assert 0.3 * slowest < found.decay_rate <= slowest
    # energy decays only weakly (no damping at zero relative speed), so it is not what was found
    energy = replace(found, matrices=np.diag([spring, body, tyre, wheel])[None], decay_rate=0.0, margin=0.0)
    assert not verify(energy, model).holds


@pytest.mark.seconds
def test_splines_products_and_delayed_readings():
    box = Scheduling(("p", "q"), (0.0, -1.0), (1.0, 1.0))
    spline = Spline("p", segments=3, order=2).bound(box)
    basis = Product(spline, Polynomial("q", degree=1))
    a = np.zeros((basis.size, 2, 2))
    a[0::2] = [[0.5, 0.3], [-0.3, 0.5]]
    a[1::2] = [[0.1, 0.0], [0.0, -0.1]]
    found = certify_stability(state_space(a, basis, 0.1, box), rate={"p": 0.2})
    assert found.between_grid
    assert found.box.rate == (0.2, None)
    delayed = Stacked((Polynomial("p", degree=1), Shifted(Polynomial("p", degree=1), 1)))
    growing = LPVTransferFunction.siso([[0.0, 0.9, 0.0, -0.9]], [[0.0] * 4, [1.0, 0, 0, 0]], delayed, 1.0,
                                       scheduling=Scheduling(("p",), (-1.0,), (1.0,)))
    found = certify_stability(growing)  # a_1 = 0.9 (p(k) − p(k−1)) reaches ±1.8, but is 0 for every held p
    assert found.kind == "none"
    assert found.box.names == ("p", "p(k-1)")
    assert found.divergence.growth == pytest.approx(1.8)
    assert certify_stability(growing.replace(a=growing.a / 2)).verified  # then |a_1| <= 0.9


@pytest.mark.seconds
@pytest.mark.parametrize(("height", "stable"), [(1e-9, False), (-1e-9, True)])
def test_a_peak_between_grid_points_decides(height, stable):
    # A = 1 + height − 50 (p − c)²: above 1 only within 4.5e-6 of c, where no grid of the search has a point
    c = 0.33337
    peak = Polynomial("p", degree=2, centre=(c,), half_width=(1.0,))
    box = Scheduling(("p",), (c - 0.1,), (c + 0.1377,))
    model = state_space([[[1 + height]], [[0.0]], [[-50.0]]], peak, scheduling=box)
    assert np.abs(np.linspace(c - 0.1, c + 0.1377, 201) - c).min() > 1e-4
    found = certify_stability(model)
    assert found.verified is stable
    assert found.between_grid is stable


@pytest.mark.seconds
def test_without_budget_the_claim_is_on_the_grid_only():
    model = alternating(0.9)
    found = certify_stability(model, rate=0.1)
    system = autonomous(model)
    storage = Storage(found.matrices, found.basis, found.box, system.sample_time)
    full, poor = recheck_decrease(system, storage), recheck_decrease(system, storage, budget=1)
    assert (full.holds, full.between_grid) == (True, True)
    assert (poor.holds, poor.between_grid) == (True, False)
    assert "not between" in poor.why
    assert full.margin <= poor.margin  # the grid sees less than the whole box
    plain = replace(found, between_grid=False)
    assert plain.verdict == "certified on a grid only"
    assert "not proven between" in str(plain)


def test_model_without_memory():
    model = LPVTransferFunction.siso([], [[1.0, 0.5]], Polynomial("p", degree=1), 0.1)
    found = certify_stability(model, rate=1.0)
    assert found.verified
    assert verify(StabilityCertificate.from_dict(json.loads(json.dumps(found.to_dict()))), model).holds


# -- kept, handed on, tampered with -----------------------------------------------------------------------------------
@pytest.mark.seconds
def test_round_trip_through_json_is_verified_by_numpy_alone():
    model = alternating(0.6)
    found = certify_stability(model, rate=0.5)
    again = StabilityCertificate.from_dict(json.loads(json.dumps(found.to_dict())))
    outcome = verify(again, model)
    assert outcome.holds
    assert outcome.between_grid
    assert outcome.margin == pytest.approx(found.margin)
    assert again.to_dict() == found.to_dict()
    lost = certify_stability(alternating(1.0))
    assert StabilityCertificate.from_dict(json.loads(json.dumps(lost.to_dict()))).to_dict() == lost.to_dict()


def test_tampering_and_other_models_fail():
    model = alternating(0.6)
    found = certify_stability(model, rate=0.5)
    wide = Scheduling(("p",), (0.0,), (1.0,), rate=(None,))
    bent = found.matrices + 0
    bent[1] *= -1
    skewed = found.matrices + 0
    skewed[0, 0, 1] += 1e-3
    forged = {"sign of a matrix": replace(found, matrices=bent), "not symmetric": replace(found, matrices=skewed),
              "negated": replace(found, matrices=-found.matrices), "zeroed": replace(found, matrices=0 * bent),
              "missing": replace(found, matrices=found.matrices[:1]),
              "not a number": replace(found, matrices=found.matrices * np.nan),
              "arbitrary rate": replace(found, box=wide), "margin": replace(found, margin=2 * found.margin),
              "decay": replace(found, decay_rate=2 * found.decay_rate), "kind": replace(found, kind="quadratic"),
              "claimed from nothing": replace(certify_stability(alternating(1.0)), verified=True, kind="quadratic")}
    for how, certificate in forged.items():
        assert not verify(certificate, model).holds, how
    assert verify(found, model).holds
    for other in (alternating(0.61), model.replace(sample_time=2.0), synthetic_damper()):
        outcome = verify(found, other)
        assert not outcome.holds
        assert "another model" in outcome.why


@pytest.mark.seconds
def test_rescaling_the_scheduling_unit_changes_nothing():
    ampere, milliampere = (certify_stability(synthetic_damper(s, u)) for s, u in ((1.0, "A"), (1000.0, "mA")))
    assert milliampere.kind == ampere.kind
    assert milliampere.margin == pytest.approx(ampere.margin, rel=1e-3)
    assert milliampere.decay == pytest.approx(ampere.decay, rel=1e-3)
    slow = certify_stability(alternating(0.9), rate=0.1)
    a = alternating(0.9).A * np.array([1.0, 1e-3])[:, None, None]
    thousand = state_space(a, Polynomial("p", degree=1), scheduling=Scheduling(("p",), (0.0,), (1000.0,)))
    other = certify_stability(thousand, rate=100.0)
    assert other.kind == slow.kind
    assert other.margin == pytest.approx(slow.margin, rel=1e-2)


@pytest.mark.parametrize("arguments", [{"rate": -1.0}, {"rate": {"q": 1.0}}, {"rate": [1.0, 2.0]}, {"range": (1.0,)},
                                       {"range": (2.0, 1.0)}, {"range": {"p": (0.0, float("nan"))}}])
def test_bad_requests_are_refused(arguments):
    with pytest.raises(InputError):
        certify_stability(alternating(0.5), **arguments)


@pytest.mark.seconds
def test_verification_runs_without_a_solver(tmp_path):
    model = alternating(0.6)
    (tmp_path / "c.json").write_text(json.dumps(certify_stability(model, rate=0.5).to_dict()), encoding="utf-8")
    (tmp_path / "m.json").write_text(json.dumps(model.to_dict()), encoding="utf-8")
    script = """
import json, sys
sys.modules["cvxpy"] = sys.modules["scipy"] = None
from lpvid.analysis.certificates import verify
from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.model.state_space import LPVStateSpace
certificate = StabilityCertificate.from_dict(json.load(open("c.json")))
print(verify(certificate, LPVStateSpace.from_dict(json.load(open("m.json")))))
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("holds: proven on the whole box")


def test_a_continuous_model_cannot_read_past_samples():
    basis = Shifted(Polynomial("p", degree=1), 1)
    with pytest.raises(InputError, match="delay"):
        certify_stability(state_space([[[-1.0]], [[0.1]]], basis, None))


def test_only_one_module_imports_cvxpy():
    package = Path(lpvid.lmi.__file__).parents[1]
    importers = set()
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "cvxpy" in text else ():
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else (
                [node.module or ""] if isinstance(node, ast.ImportFrom) else [])
            if any(name.split(".")[0] == "cvxpy" for name in names):
                importers.add(path.relative_to(package).as_posix())
    assert importers == {"lmi/program.py"}


@pytest.mark.seconds
def test_a_scheduling_filter_counts_in_the_statement():
    """Two nilpotent ends (scaled): arbitrary motion diverges, but a slow lag on p leaves only slow motion."""
    from lpvid.model.scheduling_stage import SchedulingLag

    a, b = np.array([[0.0, 2.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])
    matrices = 0.9 * np.array([0.5 * (a + b), 0.5 * (b - a)])
    plain = LPVStateSpace(matrices, np.zeros((2, 2, 1)), np.zeros((2, 1, 2)), np.zeros((2, 1, 1)),
                          Polynomial("p", degree=1), sample_time=1.0)
    slow = plain.replace(scheduling_stage=SchedulingLag(tau_rise=40.0, tau_fall=60.0))
    assert not certify_stability(plain).verified
    found = certify_stability(slow)
    assert found.verified and found.box.rate[0] == pytest.approx((1 - np.exp(-1 / 40)) * 2.0)
    assert verify(found, slow).holds
    p = SchedulingLag(tau_rise=40.0, tau_fall=60.0).apply(np.tile([-1.0, 1.0], 500)[:, None], 1.0)
    assert np.abs(np.diff(p[:, 0])).max() <= found.box.rate[0] + 1e-12


def test_a_gramian_of_huge_powers_ends_before_it_overflows():
    """|A| of 1e160 at a spectral radius of 0.5: the first product of the sum would be beyond every double."""
    from lpvid.lmi.search import frozen_gramian

    found = frozen_gramian(np.array([[0.5, 1e160], [0.0, 0.5]]), np.eye(2))
    assert np.all(np.isfinite(found))
    small = frozen_gramian(np.array([[0.5]]), np.eye(1))
    assert small[0, 0] == pytest.approx(1 / (1 - 0.25))
