"""From X and Y to the controller: what rounding does on the way (`tests/benchmarks/reconstruction_study.py`)."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from helpers.published_plants import near_integrators, two_disks
from helpers.synthesis_plants import missile

import lpvid as lpv
from lpvid.synthesis import output_feedback_search
from lpvid.synthesis.controller_formula import ControllerFormula
from lpvid.synthesis.interconnection import close_loop_at

HARD = [two_disks, pytest.param(near_integrators, marks=pytest.mark.seconds),
        pytest.param(missile, marks=pytest.mark.seconds)]


def peaks(loops):
    """(N,) gains over frequencies from far below the slowest to beyond the fastest pole."""
    found = []
    for a, b, c, d in zip(*loops, strict=True):
        poles = np.abs(np.linalg.eigvals(a))
        s = 1j * np.geomspace(poles.min() / 10, 10 * poles.max(), 800)
        inside = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, np.tile(b.astype(complex), (len(s), 1, 1)))
        found.append(np.linalg.norm(c @ inside + d, 2, axis=(1, 2)).max())
    return np.array(found)


@pytest.mark.seconds
@pytest.mark.parametrize("case", HARD)
def test_rounding_of_the_lyapunov_matrices_does_not_move_the_loop(case, rng):
    """N = Y − X⁻¹ of condition 1e4 to 2e7 is inverted: the last digit of X and Y moves the gain by less than 1e-6."""
    written, write = [], output_feedback_search._written

    def noted(problem, formula, target=None):
        found = write(problem, formula, target)
        if found is not None and isinstance(formula, ControllerFormula):
            written.append((problem, formula))
        return found

    with mock.patch.object(output_feedback_search, "_written", noted):
        lpv.synthesize(case(), lpv.OutputFeedback())
    problem, formula = written[0]
    pair, plant = formula.pair, problem.plant.plant.at(problem.points)

    def rounded(m):
        noise = rng.normal(size=m.shape)
        return m * (1 + np.finfo(float).eps * (noise + noise.swapaxes(-1, -2)))

    other = replace(formula, pair=replace(pair, x=rounded(pair.x), y=rounded(pair.y)))
    assert np.linalg.cond(formula._lyapunov(problem.points).blocks()[1]).max() > 1e3
    one, two = (peaks(close_loop_at(plant, *f.at(problem.points)[0])) for f in (formula, other))
    np.testing.assert_allclose(two, one, rtol=1e-6)
