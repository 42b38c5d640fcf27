"""Worst trajectories: admissible, reached, and never above what is proven."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.gain_systems import random_stable, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis.frozen_norms import largest_frozen_norm
from lpvid.analysis.worst_case import WorstCase, worst_trajectory
from lpvid.lmi.driven import driven
from lpvid.lmi.readings import box_of


def searched(model, rate) -> WorstCase:
    plant = driven(model)
    box = replace(box_of(plant.readings, model.box), rate=(rate,))
    norm, point, frequency = largest_frozen_norm(plant, box)
    return worst_trajectory(plant, box, WorstCase.frozen(box, point, frequency, norm))


@pytest.mark.parametrize("rate", [
    pytest.param(1.0, marks=pytest.mark.seconds), *(pytest.param(r, marks=pytest.mark.slow) for r in (0.1, 4.0))])
def test_a_triangle_keeps_the_rate_and_stays_below_the_reference(rate):
    found = searched(vanishing(), rate)
    bound = {0.1: 0.09925, 1.0: 0.66240, 4.0: 0.86630}[rate]  # synthesis sheet, section 1
    assert found.kind == "periodic" and 0.5 * bound < found.gain <= bound * 1.01
    steps = np.diff(np.vstack([found.points, found.points[:1]]), axis=0)
    assert np.abs(steps).max() <= rate * found.period / len(found.points) * (1 + 1e-9)
    assert np.abs(found.points).max() <= 1


@pytest.mark.seconds
def test_the_gain_is_reached_in_an_independent_simulation():
    """A square wave of d with the input sin(t + φ) that it turns into something: gain by plain Euler steps."""
    found = searched(vanishing(), None)
    assert 0.97 < found.gain <= 1.0
    step, n = found.period / 2000, 10_000
    t = step * np.arange(n)[:, None]
    d = np.sign(np.sin(2 * np.pi * t[:, 0] / found.period))
    w = np.sin(2 * np.pi * t / found.period + np.linspace(0, np.pi, 13))  # a column for each φ
    x, z = np.zeros((2, 13)), np.zeros((n, 13))
    for k in range(n):
        z[k] = d[k] * x[0] - x[1]
        x = x + step * (-x + np.outer([1.0, d[k]], w[k]))
    best = math.sqrt((np.sum(z**2, axis=0) / np.sum(w**2, axis=0)).max())
    assert 0.5 < best <= found.gain + 0.01


def test_nothing_moves_in_a_time_invariant_system():
    model = time_invariant([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    plant = driven(model)
    box = box_of(plant.readings, model.box)
    held = WorstCase.frozen(box, np.zeros(0), 0.0, 1.0)
    assert worst_trajectory(plant, box, held) is held


@pytest.mark.seconds
def test_discrete_trajectories_and_their_dictionary(rng):
    model = random_stable(rng, 2, 1, discrete=True)
    found = searched(model, 5.0)
    again = WorstCase.from_dict(json.loads(json.dumps(found.to_dict())))
    assert str(again) == str(found) and np.array_equal(again.points, found.points)
    if found.kind == "periodic":
        assert found.period == pytest.approx(0.1 * len(found.points))


@pytest.mark.slow
def test_paths_go_uphill_beyond_triangles():
    """A spring that moves at a bounded rate: sharper paths than triangles feed the oscillation better."""
    from unittest import mock

    import lpvid as lpv
    from lpvid.analysis import worst_case

    a, z = [[[0, 1], [-4, -0.4]], [[0, 0], [-1.2, 0]]], np.zeros
    model = lpv.LPVStateSpace(a, [[[0], [1]], [[0], [0]]], [[[1, 0]], [[0, 0]]], z((2, 1, 1)), lpv.Polynomial("d", 1),
                              None, lpv.Scheduling(("d",), (-1,), (1,), (2.0,)))
    system = driven(model)
    box = box_of(system.readings, model.box)
    norm, point, frequency = largest_frozen_norm(system, box)
    frozen = WorstCase.frozen(box, point, frequency, norm)
    found = worst_trajectory(system, box, frozen)
    with mock.patch.object(worst_case, "ascended", lambda forms, box, path, tick: path):
        before = worst_trajectory(system, box, frozen)
    assert 1.03 * before.gain < found.gain < 3.41  # the upper bound of l2_gain is 3.408
    turns = np.abs(np.diff(np.vstack([found.points, found.points[:1]]), axis=0)).max()
    assert turns <= 2.0 * found.period / len(found.points) * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.01, 0.03, 0.3])
def test_what_is_owed_to_steps_of_a_slow_scheduling_is_not_reached(rate: float) -> None:
    """Two lags whose difference feeds through as d moves: the gain falls with the rate, the jumps of a grid do not."""
    eye = np.eye(2)
    model = lpv.LPVStateSpace([-eye, 0 * eye], [[[1], [0]], [[0], [1]]], [[[0, -1]], [[1, 0]]], np.zeros((2, 1, 1)),
                              lpv.Polynomial("d", degree=1), None, lpv.Scheduling(("d",), (-1,), (1,)))
    found = lpv.l2_gains(model, (rate,), trajectories=True)[0]
    assert 0 <= found.lower <= found.upper <= 1.1 * rate
