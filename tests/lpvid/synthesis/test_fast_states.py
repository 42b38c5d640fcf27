"""Controllers without states that are faster than anything in their plant."""

import numpy as np
import pytest
from helpers.badly_scaled_plants import random_case
from helpers.promise import frozen_peak, moving_peak
from helpers.synthesis_plants import scherer

import lpvid as lpv
from lpvid.synthesis.fast_states import FAST, residual


def _response(k, s):
    a, b, c, d = k
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def test_states_at_rest_leave_the_static_gain_and_the_slow_response():
    """Two slow modes and a fast one behind unknown coordinates: the same at zero, and near it where the pole is far."""
    rng = np.random.default_rng(0)
    split = rng.normal(size=(3, 3))
    a, b, c = np.diag([-1.0, -3.0, -1e6]), np.array([[1.0], [2.0], [1e6]]), np.array([[1.0, -1.0, 2.0]])
    k = split @ a @ np.linalg.inv(split), split @ b, c @ np.linalg.inv(split), np.array([[0.5]])
    small, rest = residual(tuple(m[None] for m in k), split, 2)
    small = tuple(m[0] for m in small)
    assert small[0].shape == (2, 2) and rest.shape == (1, 1, 3)
    assert _response(small, 0.0) == pytest.approx(_response(k, 0.0), rel=1e-8)
    for omega in (0.1, 1.0, 10.0):
        assert _response(small, 1j * omega) == pytest.approx(_response(k, 1j * omega), rel=1e-4)


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("seed", [86, 88])
def test_what_is_kept_is_slow_and_keeps_its_bound(seed):
    """Weak penalties and weak noise: the states that went were ten times faster than the plant."""
    case, design, _ = random_case(seed)
    found = lpv.synthesize(case, design)
    (note,) = [n for n in found.notes if "stand for their static gain" in n]
    plant = max(np.abs(case.system.frozen_poles(p)).max() for p in case.box.grid(3))
    assert found.controller.order == case.order - int(note.split()[0])
    if seed == 88:  # in 86 one stays that is needed
        assert max(np.abs(found.controller.frozen_poles(p)).max() for p in case.box.grid(3)) <= FAST * plant * 1.1
    rng = np.random.default_rng(seed)
    frozen, frequency = frozen_peak(case, found.controller, rng)
    assert frozen <= found.gamma_verified * (1 + 1e-6)
    assert moving_peak(case, found.controller, frequency, 20, rng) <= found.gamma_verified * (1 + 1e-6)
    assert found.certificate is None or lpv.verify(found.certificate, found.closed_loop).holds


@pytest.mark.seconds
def test_no_feedthrough_is_added_where_none_was_wanted():
    case, _, _ = random_case(86)
    found = lpv.synthesize(case, lpv.OutputFeedback(strictly_proper=True))
    assert found.controller.order == case.order and not found.controller.D.any()


def test_a_controller_no_faster_than_its_plant_stays_as_it_is():
    found = lpv.synthesize(scherer(), lpv.OutputFeedback())
    poles = np.abs(found.controller.frozen_poles(np.zeros(0)))
    limit = FAST * np.abs(scherer().system.frozen_poles(np.zeros(0))).max()
    assert found.controller.order == 3 or poles.max() < limit
