"""Pickle and copy of dampers, laws, cars and their runs."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import quartercar as qc
from quartercar.rig.causes import Effect


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
    effect = Effect("coulomb-friction", 0.5)
    assert pickle.loads(pickle.dumps(effect)) == effect
