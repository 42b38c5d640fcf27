"""Pickle and copy of records: what joblib, multiprocessing and a notebook's checkpoint do with them."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import lpvid as lpv


def through_pickle(noun: object) -> object:
    return pickle.loads(pickle.dumps(noun))


@pytest.mark.parametrize("again", [through_pickle, copy.deepcopy, copy.copy])
def test_a_record_comes_back_and_stays_read_only(again):
    record = lpv.Record({"velocity": [0.0, 0.1, 0.2], "force": [0.0, 9.0, 21.0]}, time=np.array([0.0, 1.0, 5.0]),
                        units={"velocity": "mm/s", "force": "N"}, roles={"output": "force"})
    back = again(record)
    assert repr(back) == repr(record)
    assert (back.unit("velocity"), dict(back.roles), back.time_base) == ("m/s", {"output": "force"}, record.time_base)
    np.testing.assert_array_equal(back["output"], [0.0, 9.0, 21.0])
    with pytest.raises(TypeError):
        back.channels["force"] = None
    for array in (back["velocity"], back.time):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_an_identification_of_a_pickled_record_is_the_same():
    rng = np.random.default_rng(0)
    v = rng.normal(size=200)
    record = lpv.Record({"velocity": v, "force": 3.0 * v + rng.normal(size=200)}, sample_time=0.01)
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    found, back = (lpv.identify(r, structure) for r in (record, through_pickle(record)))
    np.testing.assert_array_equal(found.parameters, back.parameters)
    np.testing.assert_array_equal(through_pickle(found).covariance, found.covariance)
