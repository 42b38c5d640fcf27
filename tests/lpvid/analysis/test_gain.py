"""Induced gains: published numbers, LTI norms of python-control, closed forms, and bounds that never cross."""

from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys
from dataclasses import replace

import control
import numpy as np
import pytest
from helpers.gain_systems import random_stable, rotating, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis.gain import Gain, l2_gain, l2_gains
from lpvid.analysis.gain_bounds import GainBounds, stronger
from lpvid.errors import InputError
from lpvid.lmi import storage_search
from lpvid.lmi.driven import driven
from lpvid.lmi.native import Conic
from lpvid.lmi.program import SOLVERS
from lpvid.scheduling import Fourier, Polynomial, Scheduling, Spline

REFERENCE = {0.1: 0.09925, 1.0: 0.66240, 4.0: 0.86630}
"""Gain on a grid of ten points with P of degree 3 (synthesis sheet, section 1)."""


@pytest.mark.seconds
@pytest.mark.parametrize(("rate", "gain"), REFERENCE.items())
def test_the_reference_case_with_bounded_rates(rate, gain):
    found = l2_gain(vanishing(), rate=rate, basis=Polynomial("d", degree=3), trajectories=False)
    assert found.verdict == "certified" and found.between_grid
    assert gain * (1 - 1e-4) < found.upper < gain * 1.004  # the reference holds on its ten points only
    assert lpv.verify(found.certificate, vanishing()).holds


@pytest.mark.seconds
def test_a_degree_that_is_of_no_use_does_not_end_the_search():
    """At this rate P of degree 2 is no better than of degree 1 (it is 1.0); the third brings what the reference has."""
    found = l2_gain(vanishing(), rate=4.0, trajectories=False)
    assert found.between_grid and REFERENCE[4.0] * (1 - 1e-4) < found.upper < 1.004 * REFERENCE[4.0]


@pytest.mark.seconds
def test_the_reference_case_at_any_speed():
    found = l2_gain(vanishing())
    assert found.upper == pytest.approx(1.0, abs=1e-4) and found.certificate.kind == "quadratic"
    assert 0.98 < found.lower <= found.upper  # a square wave comes close to the bound


@pytest.mark.parametrize("discrete", [False, True])
def test_time_invariant_systems_have_their_h_infinity_norm(discrete, rng):
    for n in (1, 3, 6):
        np.random.seed(n)  # noqa: NPY002
        plant = control.drss(n, 2, 2) if discrete else control.rss(n, 2, 2)
        plant = control.StateSpace(0.9 * plant.A if discrete else plant.A - 0.1 * np.eye(n), plant.B, plant.C, plant.D,
                                   0.1 if discrete else 0)
        found = l2_gain(time_invariant(plant.A, plant.B, plant.C, plant.D, 0.1 if discrete else None))
        norm = control.norm(plant, p="inf", tol=1e-9)
        assert found.between_grid
        assert found.upper == pytest.approx(norm, rel=1e-4) and found.upper >= norm * (1 - 1e-9)
        assert found.lower == pytest.approx(norm, rel=1e-6)


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("rate", [0.0, 0.3, 1.0])
def test_a_trigonometric_storage_function_is_exact_for_a_rotating_system(rate):
    inner, turn = np.array([[-1.0, 2.0], [0.0, -1.5]]), np.array([[0.0, -1.0], [1.0, 0.0]])
    found = l2_gain(rotating(inner), rate=rate, basis=Fourier("q", 2), trajectories=False)
    exact = max(control.norm(control.ss(inner + w * turn, np.eye(2), np.eye(2), np.zeros((2, 2))), p="inf", tol=1e-9)
                for w in np.linspace(-rate, rate, 41))
    assert found.between_grid
    assert exact * (1 - 1e-9) < found.upper < exact * 1.0005


@pytest.mark.parametrize(("variables", "discrete"), [(1, False), (1, True), (2, False)])
@pytest.mark.slow
def test_upper_bounds_stay_above_every_lower_bound(variables, discrete, rng):
    model = random_stable(rng, 3, variables, discrete)
    found = l2_gain(model)
    assert found.between_grid and found.certificate.kind in ("quadratic", "parameter-dependent")
    assert found.lower <= found.upper
    assert found.upper >= _simulated(model, rng)
    fast = l2_gain(model, rate=math.inf, basis=Polynomial((), 0), trajectories=False)
    assert fast.upper >= found.upper * (1 - 2e-3)


def _simulated(model, rng) -> float:
    """Largest gain over random admissible trajectories, integrated step by step with python arithmetic only."""
    best, step = 0.0, model.sample_time or 0.002
    names, box = len(model.box.names), model.box
    for _ in range(5):
        n = 400 if model.sample_time else 4000
        p = np.clip(np.cumsum(rng.choice([-1, 1], size=(n // 50, names)).repeat(50, axis=0) * step
                              * np.array(box.rate), axis=0), box.lower, box.upper)
        w, x, energy = rng.normal(size=(n, 2)), np.zeros(model.order), 0.0
        for k in range(n):
            a, b, c, d = model.frozen(p[k])
            energy += float(np.sum((c @ x + d @ w[k]) ** 2))
            x = a @ x + b @ w[k] if model.sample_time else x + step * (a @ x + b @ w[k])
        best = max(best, math.sqrt(energy / np.sum(w**2)))
    return best


@pytest.mark.seconds
def test_a_sweep_over_rates_is_what_single_calls_give():
    rates = [0.2, 1.0, 3.0]
    sweep = l2_gains(vanishing(), rates, Polynomial("d", degree=3))
    single = [l2_gain(vanishing(), r, Polynomial("d", degree=3), trajectories=False).upper for r in rates]
    assert [g.upper for g in sweep] == pytest.approx(single, rel=1e-6)
    assert sweep[0].upper < sweep[1].upper < sweep[2].upper


@pytest.mark.seconds
def test_a_sweep_compiles_everything_in_its_first_call(monkeypatch):
    """Whatever a later rate needs, the programs of both stages are there."""
    compiled, stated = [], Conic.of

    def counted(*given):
        compiled.append(len(calls))
        return stated(*given)

    calls, certify = [], GainBounds.certify

    def called(*given):
        calls.append(given)
        return certify(*given)

    monkeypatch.setattr(Conic, "of", counted)
    monkeypatch.setattr(GainBounds, "certify", called)
    sweep = l2_gains(vanishing(), [0.1, 0.5, 1.0, 2.0, 3.0], Polynomial("d", degree=2))
    assert all(g.between_grid for g in sweep) and len(calls) == 5
    assert len(compiled) >= 2 and max(compiled) == 0


def test_changing_units_changes_the_gain_by_their_ratio(rng):
    model = random_stable(rng, 3, 1, discrete=False)
    scaled = replace(model, B=1e3 * model.B, C=1e-6 * model.C, D=1e-3 * model.D)
    plain, small = (l2_gain(m, trajectories=False).upper for m in (model, scaled))
    assert small == pytest.approx(1e-3 * plain, rel=1e-3)


@pytest.mark.seconds
def test_badly_scaled_states_change_nothing(rng):
    model = random_stable(rng, 4, 1, discrete=False)
    t = np.diag([1e-4, 1.0, 1e3, 1e5])
    other = replace(model, A=t @ model.A @ np.linalg.inv(t), B=t @ model.B, C=model.C @ np.linalg.inv(t))
    plain, stretched = (l2_gain(m, trajectories=False) for m in (model, other))
    assert stretched.between_grid and stretched.upper == pytest.approx(plain.upper, rel=2e-3)


@pytest.mark.seconds
def test_a_spline_may_carry_the_storage_function():
    basis = Spline("d", segments=4, order=3)
    found = l2_gain(vanishing(), rate=1.0, basis=basis, trajectories=False)
    assert found.between_grid and 0.5 < found.upper < 0.70  # ten points and a cubic: 0.6624
    with pytest.raises(InputError, match="slope that jumps"):
        l2_gain(vanishing(), rate=1.0, basis=Spline("d", segments=4, order=1))


def test_an_unstable_model_has_no_gain():
    found = l2_gain(time_invariant([[0.1]], [[1.0]], [[1.0]], [[0.0]]))
    assert found.verdict == "unstable" and math.isinf(found.upper) and found.certificate is None
    assert "does not decay" in str(found) and found.to_dict()["upper"] is None


@pytest.mark.seconds
def test_frozen_stability_is_not_enough():
    up, down = np.array([[0, 1.8], [0, 0]]), np.array([[0, 0], [1.8, 0]])  # alternating: 1.8-fold every sample
    pair = lpv.LPVStateSpace([0.5 * (up + down), 0.5 * (down - up)], np.ones((2, 2, 1)) * [[[1]], [[0]]],
                             np.ones((2, 1, 2)) * [[[1]], [[0]]], np.zeros((2, 1, 1)), Polynomial("p", degree=1), 1.0)
    found = l2_gain(pair, trajectories=False)
    assert found.verdict == "not certified" and math.isinf(found.upper) and found.mend


def test_a_model_without_states_has_its_feedthrough():
    model = lpv.LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), [[[1.0]], [[0.5]]],
                              Polynomial("p", degree=1), None)
    found = l2_gain(model)
    assert found.upper == pytest.approx(1.5, rel=1e-4) and found.lower == pytest.approx(1.5, rel=1e-9)


def test_rates_and_bases_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="no bound"):
        l2_gain(vanishing(), basis=Polynomial("d", degree=1))
    with pytest.raises(InputError, match="does not read"):
        l2_gain(vanishing(), rate=1.0, basis=Polynomial("speed", degree=1))
    with pytest.raises(InputError, match="negative"):
        l2_gain(vanishing(), rate=-1.0)
    with pytest.raises(InputError, match="state-space model"):
        l2_gain(lpv.LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], Polynomial((), 0), 0.1))


@pytest.mark.seconds
def test_the_rate_of_the_box_is_taken_where_none_is_given():
    own = l2_gain(vanishing(rate=1.0), trajectories=False)
    assert own.certificate.box.rate == (1.0,) and own.upper < 0.7


@pytest.mark.seconds
def test_a_gain_survives_its_dictionary():
    found = l2_gain(vanishing(), rate=1.0)
    again = Gain.from_dict(json.loads(json.dumps(found.to_dict())))
    assert str(again) == str(found) and again.certificate.gamma == found.certificate.gamma


@pytest.mark.seconds
def test_checking_a_saved_certificate_needs_neither_solver_nor_scipy(tmp_path):
    model = vanishing()
    lpv.save(l2_gain(model, rate=1.0, trajectories=False).certificate, tmp_path / "c.json")
    lpv.save(model, tmp_path / "m.json")
    script = """
import sys
sys.modules["cvxpy"] = sys.modules["scipy"] = None
import lpvid as lpv
print(lpv.verify(lpv.load("c.json"), lpv.load("m.json")))
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("holds: proven on the whole box")
    assert SOLVERS[0] == "CLARABEL"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(16))
def test_no_false_promise_over_random_systems(seed):
    """Orders 2 to 9, continuous and discrete, states in units up to 10⁶ apart: no gain is reached above the bound."""
    rng = np.random.default_rng(seed)
    discrete, order = bool(seed % 2), 2 + seed // 2
    model = random_stable(rng, order, 1, discrete)
    t = np.diag(10.0 ** rng.uniform(-3, 3, order)) @ np.linalg.qr(rng.normal(size=(order, order)))[0]
    model = replace(model, A=t @ model.A @ np.linalg.inv(t), B=t @ model.B, C=model.C @ np.linalg.inv(t))
    found = l2_gain(model)
    assert found.between_grid and lpv.verify(found.certificate, model).holds
    frozen = max(_peak(model, p) for p in np.linspace(-1, 1, 41))
    assert found.upper >= max(frozen, found.lower, _simulated(model, rng)) * (1 - 1e-9)
    assert found.upper <= 1.25 * frozen  # these systems vary slowly


def _peak(model, p: float) -> float:
    """Largest gain on a grid of frequencies."""
    a, b, c, d = model.frozen([p])
    w = np.concatenate([[0.0], np.logspace(-3, 3, 200)]) if model.sample_time is None else np.linspace(0, np.pi, 200)
    points = 1j * w if model.sample_time is None else np.exp(1j * w)
    response = c @ np.linalg.solve(points[:, None, None] * np.eye(len(a)) - a, b.astype(complex)) + d
    return float(np.linalg.norm(response, 2, axis=(1, 2)).max())


def test_a_loop_reads_its_variables_with_the_degrees_that_it_uses():
    """Bilinear in two variables, written down over all monomials of degree two: a degree of one in each."""
    p, box = Polynomial(("p", "q"), 2), lpv.Scheduling(("p", "q"), (0.0, 0.0), (1.0, 1.0))
    a = np.zeros((6, 1, 1))
    a[0], a[p.labels.index("p*q")] = -2.0, 1.0
    b = np.zeros((6, 1, 1))
    b[0] = 1.0
    bilinear = lpv.LPVStateSpace(a, b, b, 0 * b, p, None, box)
    assert [r.degree for r in driven(bilinear).readings] == [1, 1]
    a[p.labels.index("q^2")] = -0.5
    assert [r.degree for r in driven(replace(bilinear, A=a)).readings] == [1, 2]
    found = l2_gain(bilinear, trajectories=False)
    assert found.between_grid and found.upper == pytest.approx(1.0, rel=1e-4)  # 1/(2 − pq) at p = q = 1


@pytest.mark.seconds
def test_a_richer_basis_gives_no_larger_bound(monkeypatch):
    """Also where the richer one gives none of its own: too many unknowns, or a solver that fails."""
    model = vanishing()
    bounds = [l2_gain(model, rate=0.5, basis=Polynomial("d" if d else (), d), trajectories=False) for d in range(3)]
    assert all(b.upper <= a.upper * (1 + 1e-9) and b.between_grid for a, b in itertools.pairwise(bounds))
    assert bounds[2].upper < 0.99 * bounds[1].upper
    monkeypatch.setattr(storage_search, "MOST_UNKNOWNS", 6)  # two matrices of two states
    large = l2_gain(model, rate=0.5, basis=Polynomial("d", 2), trajectories=False)
    assert large.verdict == "certified" and large.upper == pytest.approx(bounds[1].upper, rel=1e-6)


@pytest.mark.parametrize("better", [0, 1])
def test_a_proof_on_the_whole_box_goes_before_a_lower_bound_on_a_grid(better):
    found = l2_gain(vanishing(), rate=1.0, basis=Polynomial("d", 1), trajectories=False).certificate
    whole, grid = replace(found, gamma=2.0), replace(found, gamma=1.0, between_grid=False)
    assert stronger(*((whole, grid), (grid, whole))[better]) is whole
    lower = replace(found, gamma=1.5)
    assert stronger(whole, lower) is lower and stronger(None, grid) is grid


def test_a_given_basis_costs_no_search_once_the_bound_meets_what_is_reached(monkeypatch):
    looked_at, search = [], GainBounds._with
    monkeypatch.setattr(GainBounds, "_with", lambda self, own, box: looked_at.append(own) or search(self, own, box))
    one, box = np.ones((1, 1, 1)), Scheduling(("p",), (0.0,), (1.0,), (0.1,))
    still = lpv.LPVStateSpace(-one, one, one, 0 * one, Polynomial("p", 0), None, box)
    found = l2_gain(still, basis=Polynomial("p", 3), trajectories=False)
    assert found.upper <= 1.005 * found.lower and [b.degree for b in looked_at] == [3]
