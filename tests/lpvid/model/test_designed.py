"""What runs outside the box that it was designed for says so, and what was never designed does not."""

from __future__ import annotations

import json
import re
import warnings

import numpy as np
import pytest
from helpers.shaped_plants import spring_mass

import lpvid as lpv


@pytest.fixture(scope="module")
def found() -> lpv.Synthesis:
    """A state feedback for a stiffness between 1 and 4, sampled at 10 Hz."""
    return lpv.StateFeedback().solve(spring_mass(sample_time=0.1))


def record_of(model: lpv.LPVStateSpace, stiffness: np.ndarray) -> lpv.Record:
    n = len(stiffness)
    channels = {s.name: np.sin(0.3 * np.arange(n) + k) for k, s in enumerate(model.inputs)}
    return lpv.Record({**channels, "stiffness": stiffness}, sample_time=0.1, name="drive")


def test_a_controller_names_what_leaves_its_range_and_for_how_long(found):
    stiffness = np.r_[np.full(75, 2.0), np.full(25, 5.0)]
    with pytest.warns(lpv.ExtrapolationWarning) as described:
        run = lpv.simulate(found.controller, record_of(found.controller, stiffness), "zero")
    text = str(described[0].message)
    assert len(described) == 1 and described[0].filename == __file__
    for part in ("controller", "'drive'", "'stiffness'", "1 to 4", "2 to 5", "25 %"):
        assert part in text
    y = np.column_stack([np.sin(0.3 * np.arange(100) + k) for k in range(2)])
    gains = np.array([found.controller.frozen([p])[3] for p in stiffness])
    np.testing.assert_allclose(run.output, np.einsum("kij,kj->ki", gains, y), atol=1e-12)  # warned, not clamped


def test_nothing_is_said_inside_the_box_up_to_its_ends(found):
    stiffness = np.r_[1.0, np.linspace(1.0, 4.0, 50), 4.0]
    for model in (found.controller, found.closed_loop):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            lpv.simulate(model, record_of(model, stiffness), "zero")


def test_the_closed_loop_says_it_too(found):
    record = record_of(found.closed_loop, np.full(20, 0.5))
    with pytest.warns(lpv.ExtrapolationWarning, match="closed loop.*100 %"):
        lpv.simulate(found.closed_loop, record, "zero")


def test_a_stored_controller_remembers(found):
    stored = lpv.LPVStateSpace.from_dict(json.loads(json.dumps(found.controller.to_dict())))
    with pytest.warns(lpv.ExtrapolationWarning):
        lpv.simulate(stored, record_of(stored, np.full(20, 9.0)), "zero")


def test_a_controller_that_is_sampled_remembers():
    sampled = lpv.discretise(lpv.StateFeedback().solve(spring_mass()).required(), 0.1).model
    with pytest.warns(lpv.ExtrapolationWarning, match=re.escape("1 to 4")):
        lpv.simulate(sampled, record_of(sampled, np.full(20, 0.0)), "zero")


def test_a_model_that_nobody_designed_is_left_to_validation():
    model = spring_mass(sample_time=0.1).system
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lpv.simulate(model, record_of(model, np.full(20, 9.0)), "zero")
