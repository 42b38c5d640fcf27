"""Tuning of several laws: whatever the number of processes, the result is the same."""

from __future__ import annotations

import numpy as np
import pytest

import quartercar as qc
from quartercar.controllers import law_class
from quartercar.dampers.laws.guo import Guo
from quartercar.rides.tuning import Trial, tune, tune_all
from quartercar.roads.ride_roads import IsoRoad
from quartercar.vehicle.nonlinear import Coil


@pytest.mark.slow
def test_the_number_of_workers_changes_nothing() -> None:
    car = qc.QuarterCar(qc.parameters.MEGANE, Guo(), coil=Coil(highest=2.5))
    trial = Trial(car, (IsoRoad("C", 20.0, 2.0),), (100,))
    laws = {n: law_class(n)() for n in ("skyhook-linear", "sh-add")}
    one, two = (tune_all(laws, trial, 5, workers=n) for n in (1, 2))
    alone = tune(laws["sh-add"], trial, 5)
    for name in laws:
        np.testing.assert_array_equal(one[name].costs, two[name].costs)
        np.testing.assert_array_equal(one[name].controller.vector, two[name].controller.vector)
    np.testing.assert_array_equal(alone.costs, two["sh-add"].costs)
