"""Pickle and copy of dampers, laws, cars and their runs; what is refused as such."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import quartercar as qc
from lpvid.errors import InputError
from quartercar.rig.causes import RigEffect
from quartercar.roads.ride_roads import IsoRoad


@pytest.mark.parametrize("again", [lambda noun: pickle.loads(pickle.dumps(noun)), copy.deepcopy])
def test_a_car_with_its_damper_comes_back(again):
    damper = qc.dampers.Guo(values={"yield_force": 600.0, "sharpness": 20.0})
    car = qc.QuarterCar(qc.parameters.MEGANE, damper)
    run = car.run(np.linspace(0.0, 0.01, 50), 1e-3)
    back = again(run)
    assert dict(back.car.damper.values) == dict(damper.values)
    np.testing.assert_array_equal(again(car).run(run["road"], 1e-3)["damper_force"], run["damper_force"])
    with pytest.raises(TypeError):
        back.car.damper.values["yield_force"] = 0.0


def test_laws_and_causes_come_back():
    law = pickle.loads(pickle.dumps(qc.controllers.Skyhook(values={"high_damping": 3000.0})))
    assert law.values["high_damping"] == 3000.0
    effect = RigEffect("coulomb-friction", 0.5)
    assert pickle.loads(pickle.dumps(effect)) == effect


@pytest.mark.parametrize(("wrong", "says"), [
    (lambda car, road: qc.ride(car, road, "skyhook"), "control law"),
    (lambda car, road: qc.ride(car, road, qc.controllers.Skyhook), "the class Skyhook"),
    (lambda car, road: qc.ride(car, "iso-c@20", qc.controllers.Skyhook()), "IsoRoad"),
    (lambda car, road: qc.ride("car", road, qc.controllers.Skyhook()), "QuarterCar"),
    (lambda car, road: qc.QuarterCar({"sprung_mass": 300.0}), "CarParameters"),
])
def test_a_ride_of_something_else_is_refused_in_one_line(wrong, says):
    with pytest.raises(InputError, match=says):
        wrong(qc.QuarterCar(qc.parameters.MEGANE), IsoRoad("C", 20.0, 1.0))
