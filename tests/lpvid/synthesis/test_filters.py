"""Filters that steady a plant: what moves afterwards, and the loop with the controller completed by them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shaped_plants import spring_mass

import lpvid as lpv
from lpvid.synthesis.filters import add_actuator_filters
from lpvid.synthesis.interconnection import close_loop


def geared(sample_time: float | None = None) -> lpv.GeneralizedPlant:
    """The platform with an actuator and a sensor whose gains follow the stiffness."""
    plant = spring_mass(full=False, sample_time=sample_time)
    b, c = plant.system.B.copy(), plant.system.C.copy()
    b[1, :, 2], c[1, 2] = 0.3 * b[0, :, 2], 0.2 * c[0, 2]
    return lpv.GeneralizedPlant(plant.system.replace(B=b, C=c), plant.controls, plant.measurements)


@pytest.mark.parametrize("sample_time", [None, 0.05])
def test_nothing_that_multiplies_the_gain_moves_any_more(sample_time):
    found = add_actuator_filters(geared(sample_time), 50.0)
    m = found.plant.at(found.plant.box.grid(4))
    assert found.bandwidths == {"u0": 50.0, "y0": 50.0}
    assert not any(np.ptp(x, axis=0).any() for x in (m.B2, m.D12, m.C2, m.D21))


@pytest.mark.seconds
def test_the_completed_controller_closes_the_loop_that_was_designed():
    plant = geared()
    found = add_actuator_filters(plant, 50.0)
    design = lpv.MultiObjective().solve(found.plant)
    assert design.solved and design.between_grid
    whole = close_loop(plant, found.complete(design.controller))
    for p in (1.0, 2.3, 4.0):
        one, other = (np.sort_complex(np.linalg.eigvals(x.frozen([p])[0])) for x in (whole, design.closed_loop))
        np.testing.assert_allclose(one, other, rtol=1e-6)
        s = 0.7j
        np.testing.assert_allclose(whole.to_control([p])(s)[0], design.closed_loop.to_control([p])(s)[0], rtol=1e-6)


def test_a_steady_plant_is_left_alone_and_impossible_filters_are_refused():
    plain = spring_mass(full=False)
    assert add_actuator_filters(plain, 50.0).plant is plain and not add_actuator_filters(plain, 50.0).bandwidths
    with pytest.raises(lpv.InputError, match="faster than the sampling"):
        add_actuator_filters(geared(0.1), 50.0)
