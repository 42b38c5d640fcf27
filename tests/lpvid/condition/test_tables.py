"""as_records: dicts and data frames where records are taken, and one line for what is neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lpvid as lpv
from lpvid.condition.tables import as_records
from lpvid.errors import InputError


class Frame:
    """What pandas and polars frames have in common: columns, and a column by its name."""

    def __init__(self, data: dict) -> None:
        self._data, self.columns = data, list(data)

    def __getitem__(self, name: str) -> object:
        return self._data[name]


def columns(n: int = 400, rate: float = 200.0) -> dict:
    rng = np.random.default_rng(0)
    v = rng.standard_normal(n)
    return {"t [ms]": 1e3 * np.arange(n) / rate, "velocity [mm/s]": 1e3 * v, "Force (kN)": 0.002 * v}


@pytest.mark.parametrize("wrap", [dict, Frame])
def test_columns_become_a_record_in_si(wrap):
    record, = as_records(wrap(columns()))
    assert record.sample_time == pytest.approx(0.005)
    assert (record.unit("velocity"), record.unit("Force")) == ("m/s", "N")
    np.testing.assert_allclose(record["force"], 2.0 * record["velocity"])


def test_the_verbs_take_them():
    """The same model from a dict, a frame, and a list with a record."""
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    data = columns()
    models = [lpv.identify(d, structure).model for d in (data, Frame(data), [data], as_records(data))]
    for model in models:
        np.testing.assert_allclose(model.b[0, 0, 0], 2.0, rtol=1e-9)
    assert lpv.audit(data).names == ("data",)
    assert lpv.validate(models[0], Frame(data)).overall.free_run.esr == pytest.approx(0.0, abs=1e-12)


def test_several_are_numbered_and_records_keep_their_names():
    named = lpv.Record({"velocity": [0.0, 1.0], "force": [0.0, 2.0]}, 0.1, name="mine")
    assert [r.name for r in as_records([columns(), named, columns()])] == ["data 1", "mine", "data 3"]


@pytest.mark.parametrize("wrong, description", [
    (np.zeros((10, 2)), r"got ndarray.*Mend: wrap it in lpv\.Record"),
    ("run.csv", r"got str.*lpv\.read"),
    (Path("run.csv"), r"lpv\.read"),
    ([np.zeros(3)], r"got ndarray.*lpv\.Record"),
    (3.0, "got float"),
    ({"velocity": [1.0, 2.0]}, "no time column"),
    ({"t": [0.0, 1.0], "force": ["a", "b"]}, "column 'force' must hold numbers"),
    ({"t": [0.0, 1.0], "force": [[1.0], [2.0]]}, "one dimension"),
    ({"t": [0.0, 1.0], "force": [1.0]}, "differ in length"),
])
def test_what_holds_no_columns_gets_one_line(wrong, description):
    with pytest.raises(InputError, match=description):
        lpv.audit(wrong)
