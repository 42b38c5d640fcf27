"""The projected inequalities with unknown matrices, against the same ones with numbers."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.synthesis_plants import sb10fd, scherer, wu

import lpvid as lpv
from lpvid.lmi.affine import Unknowns
from lpvid.lmi.native import Conic
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.output_feedback_search import FeedbackProblem
from lpvid.synthesis.projected_half import Half, Variation
from lpvid.synthesis.projected_search import least_bound


@pytest.mark.parametrize("seed", range(6))
def test_inequalities_at_known_matrices_are_their_values(seed):
    """Moving matrices with slopes, other unknowns between them, coordinates of their own, either sign."""
    rng = np.random.default_rng(seed)
    n, w, u, z, points, functions, corners = (int(k) for k in rng.integers(1, 4, size=7))
    variation = Variation(rng.normal(size=(points, functions)), rng.normal(size=(points, corners, functions)))
    sizes = (n, n), (n, w), (n, u), (z, n), (z, w), (z, u)
    half = Half(*(rng.normal(size=(points, *s)) for s in sizes), variation, float(rng.choice([-1, 1])))
    unknowns, matrices = Unknowns(), []
    for _ in range(functions):
        unknowns.scalar()
        matrices.append(unknowns.symmetric(n))
    x, root = rng.normal(size=unknowns.size), rng.normal(size=(n, n)) + 3 * np.eye(n)
    known = np.array([root @ m.value(x) @ root.T for m in matrices])
    found = [1.7 * weight - matrix.value(x) for matrix, weight in half.inequalities(root, matrices)]
    assert len(found) == points * corners
    for one, other in zip(found, half.values(root, known, 1.7), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-11 * max(1.0, np.abs(other).max()))


def _problem(case, basis=None):
    design = lpv.OutputFeedback(basis)
    grid = design._grid(case)
    return FeedbackProblem(BalancedPlant.of(case, grid.points), Variations(basis, "both", case.box), grid.axes,
                           grid.corners, False, grid.points[:0])


@pytest.mark.parametrize(("make", "optimum"), [(scherer, 9.50808), (sb10fd, 10.1843)])
def test_dual_matrices_end_the_search_for_the_least_bound(monkeypatch, make, optimum):
    """One solve: nothing needs to be found twice where no pair can be lower."""
    calls, run = [], Conic._run
    monkeypatch.setattr(Conic, "_run", lambda *args: calls.append(1) or run(*args))
    pair = least_bound(_problem(make()).projected)
    assert len(calls) == 1
    assert pair.floor <= optimum * (1 + 1e-5) and pair.floor == pytest.approx(pair.gamma, rel=1e-3)
    assert pair.gamma == pytest.approx(optimum, rel=1e-3)


def test_the_ends_of_a_whole_period_are_one_point():
    """Wu et al. 1996: p = −π and p = π have the same inequalities, which are imposed once."""
    problem = _problem(wu(5.0), lpv.Fourier("rho", 1))
    assert len(problem.points) == 7
    projected = problem.projected
    assert [len(v) for v in (projected.plant.A, projected.controls.values, projected.measurements.slopes)] == [6, 6, 6]
