"""as_records: dicts and data frames where records are taken, and one line for what is neither."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

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


class Dataset:
    """What an xarray Dataset has: variables and indices by name, each with attributes."""

    class Variable(np.ndarray):
        """An array with attributes."""

        attrs: dict

    def __init__(self, data: dict, units: dict) -> None:
        self._data = {name: np.asarray(values).view(Dataset.Variable) for name, values in data.items()}
        for name, variable in self._data.items():
            variable.attrs = {"units": units[name]}
        self.indexes = {"time": self._data["time"]}
        self.data_vars = {name: v for name, v in self._data.items() if name != "time"}

    def __getitem__(self, name: str) -> object:
        return self._data[name]


def test_structured_arrays_and_datasets_have_columns():
    """The same record as from a dict: names of a structured array, units from a dataset's attributes."""
    expected, = as_records(columns())
    data = columns()
    table = np.array(list(zip(*data.values(), strict=True)), dtype=[(name, float) for name in data])
    plain = {"time": data["t [ms]"], "velocity": data["velocity [mm/s]"], "Force": data["Force (kN)"]}
    for given in (table, Dataset(plain, {"time": "ms", "velocity": "mm/s", "Force": "kN"})):
        record, = as_records(given)
        assert record.sample_time == pytest.approx(expected.sample_time)
        for name in ("velocity", "Force"):
            assert record.unit(name) == expected.unit(name)
            np.testing.assert_allclose(record[name], expected[name])


@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("library", ["pandas", "polars", "xarray"])
def test_frames_of_the_libraries_themselves(library):
    module = pytest.importorskip(library)
    data = columns()
    if library == "xarray":
        given = module.Dataset({n: ("time", v, {"units": u}) for n, v, u in (
            ("velocity", data["velocity [mm/s]"], "mm/s"), ("Force", data["Force (kN)"], "kN"))},
            coords={"time": ("time", data["t [ms]"], {"units": "ms"})})
    else:
        given = module.DataFrame(data)
    record, = as_records(given)
    np.testing.assert_allclose(record["Force"], 2.0 * record["velocity"])
    assert record.sample_time == pytest.approx(0.005)


@pytest.mark.seconds
def test_polars_frames_go_through_the_verbs():
    """Nulls are missing samples, integers and single precision become double; what is no frame gets one line."""
    polars = pytest.importorskip("polars")
    data = columns()
    frame = polars.DataFrame(data)
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    found = lpv.identify(frame, structure, held_out=frame)
    assert found.fit == lpv.identify(data, structure, held_out=data).fit and not lpv.audit(frame).count("fault")
    bare = polars.DataFrame({"t": data["t [ms]"], "velocity": data["velocity [mm/s]"], "force": data["Force (kN)"]})
    assert lpv.identify(bare, structure, units={"t": "ms", "velocity": "mm/s", "force": "kN"}).fit == found.fit
    holed = [None if k == 7 else float(y) for k, y in enumerate(data["Force (kN)"])]
    mixed = frame.with_columns(polars.Series("Force (kN)", holed), polars.Series("count", range(len(holed))),
                               polars.col("velocity [mm/s]").cast(polars.Float32))
    record, = as_records(mixed)
    assert np.flatnonzero(np.isnan(record["Force"])).tolist() == [7] and record["count"][-1] == len(holed) - 1
    for wrong, said in ((frame.lazy(), r"frame\.collect\(\)"), (frame["Force (kN)"], "got Series.*Record"),
                        (polars.DataFrame(), "no columns")):
        with pytest.raises(InputError, match=said):
            lpv.audit(wrong)


def test_several_are_numbered_and_records_keep_their_names():
    named = lpv.Record({"velocity": [0.0, 1.0], "force": [0.0, 2.0]}, 0.1, name="mine")
    assert [r.name for r in as_records([columns(), named, columns()])] == ["data 1", "mine", "data 3"]


@pytest.mark.parametrize("wrong, description", [
    (np.zeros((10, 2)), r"got ndarray.*Mend: wrap it in lpv\.Record"),
    ("run.csv", r"got str.*lpv\.read"),
    (Path("run.csv"), r"lpv\.read"),
    ([np.zeros(3)], r"got ndarray.*lpv\.Record"),
    (3.0, "got float"),
    ([3.0, 4.0], "got list"),
    ({"velocity": [1.0, 2.0]}, "no time column"),
    ({"t": [0.0, 1.0], "force": ["a", "b"]}, "column 'force' must hold numbers"),
    ({"t": [0.0, 1.0], "force": [[1.0], [2.0]]}, "one dimension"),
    ({"t": [0.0, 1.0], "force": np.array([1.0, 2j])}, "column 'force' must hold numbers; complex.*Mend: leave it out"),
    ({"t": [0.0, 1.0], "force": [1.0]}, "differ in length"),
])
def test_what_holds_no_columns_gets_one_line(wrong, description):
    with pytest.raises(InputError, match=description):
        lpv.audit(wrong)


def test_units_name_what_the_columns_do_not():
    """A plain array with units= is the dict with units in its names; so is a dict without."""
    data = columns()
    expected, = as_records(data)
    units = {"t": "ms", "velocity": "mm/s", "Force": "kN"}
    bare = dict(zip(units, data.values(), strict=True))
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    wanted = lpv.identify(data, structure, held_out=data)
    for given in (bare, np.column_stack(list(data.values()))):
        record, = as_records(given, units=units)
        assert record.sample_time == pytest.approx(expected.sample_time)
        for name in ("velocity", "Force"):
            assert record.unit(name) == expected.unit(name)
            np.testing.assert_allclose(record[name], expected[name])
        found = lpv.identify(given, structure, held_out=given, units=units)
        np.testing.assert_allclose(found.model.b, wanted.model.b)
        assert found.held_out.to_dict()["overall"] == wanted.held_out.to_dict()["overall"]
        assert lpv.audit(given, units=units).to_dict() == lpv.audit(data).to_dict()


@pytest.mark.parametrize(("given", "units", "stated"), [
    (np.zeros((9, 3)), {"t": "s", "force": "N"}, "2 names, 3 columns"),
    (np.zeros((9, 2)), None, "units="),
    ({"t": np.arange(9.0), "force": np.ones(9)}, {"Kraft": "N"}, "Kraft"),
    (lpv.Record({"force": np.ones(9)}, sample_time=0.1), {"force": "kN"}, "its own"),
])
def test_units_that_do_not_fit_are_one_line(given, units, stated):
    with pytest.raises(InputError, match=stated) as caught:
        as_records(given, units=units)
    assert "\n" not in str(caught.value)


def dated(kind: str, n: int = 400, rate: float = 200.0) -> object:
    """The clock of `columns` as dates or durations of several makes; numpy's own count in ns and in µs."""
    since = np.round(1e9 * np.arange(n) / rate).astype("timedelta64[ns]")
    dates = np.datetime64("2026-11-26T16:00:00", "ns") + since
    plain = [datetime(2026, 11, 26, tzinfo=UTC) + timedelta(seconds=k / rate) for k in range(n)]
    return {"ns": dates, "us": dates.astype("datetime64[us]"), "durations": since, "with a zone": plain}[kind]


@pytest.mark.parametrize("kind", ["ns", "us", "durations", "with a zone"])
def test_dates_are_seconds_from_the_first(kind):
    """Ticks are whole numbers of ns or µs; read as seconds the clock was a billion or a million times too slow."""
    data = columns()
    del data["t [ms]"]
    record, = as_records({"time": dated(kind), **data})
    assert record.sample_time == pytest.approx(0.005, rel=1e-9)
    assert record.times[[0, -1]] == pytest.approx([0.0, 399 * 0.005])


def test_dates_of_polars_with_a_missing_one():
    """A null date is what nan is in a clock of numbers."""
    polars = pytest.importorskip("polars")
    data = columns()
    numbers = data.pop("t [ms]") / 1e3
    numbers[5] = np.nan
    frame = polars.DataFrame({"time": dated("us"), **data})
    frame[5, "time"] = None
    record, expected = as_records(frame)[0], as_records({"time [s]": numbers, **data})[0]
    np.testing.assert_allclose(record.time, expected.time)
    assert record.time_base.invalid == expected.time_base.invalid == (5,)


@pytest.mark.parametrize("kind", ["ns", "us", "durations", "with a zone"])
def test_a_record_takes_dates_and_no_channel_does(kind):
    assert lpv.Record({"force": np.zeros(400)}, time=dated(kind)).sample_time == pytest.approx(0.005, rel=1e-9)
    with pytest.raises(InputError, match="must hold numbers"):
        lpv.Record({"force": dated(kind)}, sample_time=0.1)


def test_masked_entries_are_missing():
    """Of columns, of a plain array, of integers, of dates and in a Record: NaN where the mask is."""
    n, mask = 12, np.arange(12) == 5
    force = np.ma.masked_array(np.full(n, 1e9), mask)
    counted = np.ma.masked_array(np.arange(n), mask)
    dates = np.ma.masked_array(np.datetime64("2026-11-28T10:00", "ms") + np.arange(n), mask)
    for record in (*as_records({"t": 0.1 * np.arange(n), "force": force, "count": counted}),
                   *as_records(np.ma.stack([0.1 * np.arange(n), force, counted], axis=1),
                               units={"t": "s", "force": "N", "count": "1"}),
                   lpv.Record({"force": force, "count": counted}, sample_time=0.1)):
        for name in ("force", "count"):
            assert np.flatnonzero(np.isnan(record[name])).tolist() == [5]
    assert as_records({"time": dates, "force": np.zeros(n)})[0].time_base.invalid == (5,)
    whole, = as_records({"t": 0.1 * np.arange(n), "count": np.ma.masked_array(np.arange(n), False)})
    assert whole["count"].tolist() == list(range(n))


class IndexedFrame(Frame):
    """A frame of pandas: rows have labels."""

    iloc = None

    def __init__(self, data: dict, index: object, name: str | None) -> None:
        super().__init__(data)
        self.index = np.asarray(index).view(Index)
        self.index.name = name


class Index(np.ndarray):
    """An array with a name."""

    name: str | None


@pytest.mark.parametrize(("index", "name"), [(0.005 * np.arange(400), "time"), (5.0 * np.arange(400), "t [ms]"),
                                             (dated("ns"), None), (dated("durations"), "when")])
def test_the_index_of_a_frame_is_its_clock(index, name):
    data = columns()
    del data["t [ms]"]
    record, = as_records(IndexedFrame(data, index, name))
    assert record.sample_time == pytest.approx(0.005, rel=1e-9)
    assert tuple(record.channels) == ("velocity", "Force")


def test_an_index_that_only_counts_rows_is_no_clock():
    data = columns()
    assert as_records(IndexedFrame(data, np.arange(400), None))[0].sample_time == pytest.approx(0.005)
    del data["t [ms]"]
    with pytest.raises(InputError, match="no time column"):
        as_records(IndexedFrame(data, np.arange(400), None))


def test_a_missing_column_names_the_way_in_python():
    """A frame has no roles: the line says how a record gets one, or to name the column."""
    with pytest.raises(InputError, match=r"in Python record\.with_roles\({'velocity': 'CHANNEL'}\) or a column"):
        lpv.identify({"t": 0.01 * np.arange(50), "v": np.arange(50.0), "force": np.arange(50.0)},
                     lpv.ARX(na=1, nb=1, input="velocity", output="force"))


class Array:
    """What an xarray DataArray has: a name, dimensions, and itself as a Dataset."""

    def __init__(self, name, dims):
        self.name, self.dims = name, dims

    def __iter__(self):
        raise TypeError("iteration over a 0-d array")

    def to_dataset(self):
        return {"time [s]": np.arange(4) / 10, f"{self.name} [N]": np.ones(4)}


def test_a_data_array_is_one_channel():
    (read,) = as_records(Array("force", ("time",)))
    assert list(read.channels) == ["force"]
    for name, dims in ((None, ("time",)), ("force", ("time", "run")), ("force", ())):
        with pytest.raises(InputError, match=r"one channel with a name and one dimension.*to_dataset"):
            as_records(Array(name, dims))


def test_a_frame_with_two_columns_of_one_name_is_named():
    twice = type("Twice", (SimpleNamespace,), {"__getitem__": lambda self, _: np.zeros((4, 2))})
    frame = twice(columns=["time [s]", "force [N]", "force [N]"])
    with pytest.raises(InputError, match="two columns are named 'force"):
        as_records(frame)
