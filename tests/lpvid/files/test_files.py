"""Reading files that are in order: every format gives the same record; layout, units, time, names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.sparse import csc_matrix

from lpvid import units
from lpvid.errors import InputError
from lpvid.files import find, read, record_names

HEADER = "time [s],velocity [mm/s],force [kN]"
ROWS = [(0.0, 10.0, 1.5), (0.01, np.nan, -2.25), (0.02, 30.0, 3.0), (0.03, 40.5, 4.0)]


def put(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def write_delimited(path: Path, headers, columns, delimiter=",") -> Path:
    rows = [delimiter.join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    return put(path, "\n".join([delimiter.join(headers), *rows]) + "\n")


def write_parquet(path: Path, headers, columns) -> Path:
    pq.write_table(pa.table([pa.array(c) for c in columns], names=list(headers)), path)
    return path


def write_mat5(path: Path, names, units_, columns) -> Path:
    content = {n: c[:, None] for n, c in zip(names, columns, strict=True)}
    stated = {n: u for n, u in zip(names, units_, strict=True) if u is not None}
    savemat(path, {**content, "units": stated} if stated else content, do_compression=True)
    return path


def write_mat73(path: Path, names, units_, columns) -> Path:
    """A version 7.3 file as MATLAB writes it: 512 bytes of text, transposed arrays, text as uint16."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in zip(names, columns, strict=True):
            file.create_dataset(name, data=column[None, :]).attrs["MATLAB_class"] = np.bytes_("double")
        group = file.create_group("units")
        for name, unit in zip(names, units_, strict=True):
            if unit:
                codes = np.array([[ord(c)] for c in unit], dtype=np.uint16)
                group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def assert_same(first, second):
    assert set(first.channels) == set(second.channels)  # HDF5 sorts names
    np.testing.assert_array_equal(first.times, second.times)
    for name, channel in first.channels.items():
        other = second.channels[name]
        np.testing.assert_array_equal(channel.values, other.values)
        assert (channel.unit, channel.source_unit, channel.unit_known, channel.fault) == (
            other.unit, other.source_unit, other.unit_known, other.fault)


NAMES = st.lists(st.from_regex(r"[a-z][a-z_]{2,12}", fullmatch=True).filter(lambda n: n not in ("time", "units")),
                 min_size=1, max_size=4, unique=True)
UNITS = ("mm", "kN", "degC", "rad/s", "lbf*s/in", None)
VALUES = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(float("nan")))


@pytest.mark.seconds
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), names=NAMES, n=st.integers(2, 12))
def test_every_format_gives_the_same_record(tmp_path, data, names, n):
    chosen = [data.draw(st.sampled_from(UNITS)) for _ in names]
    columns = [np.arange(n) * 0.25, *(np.array(data.draw(st.lists(VALUES, min_size=n, max_size=n))) for _ in names)]
    plain, stated = ["time", *names], ["s", *chosen]
    headers = [name if unit is None else f"{name} [{unit}]" for name, unit in zip(plain, stated, strict=True)]
    for old in tmp_path.iterdir():
        old.unlink()
    files = [
        write_delimited(tmp_path / "a.csv", headers, columns),
        write_delimited(tmp_path / "b.csv", headers, columns, ";"),
        write_delimited(tmp_path / "c.tsv", headers, columns, "\t"),
        write_delimited(tmp_path / "d.txt", headers, columns, "   "),
        write_parquet(tmp_path / "e.parquet", headers, columns),
        write_mat5(tmp_path / "f.mat", plain, stated, columns),
        write_mat73(tmp_path / "g.mat", plain, stated, columns),
    ]
    records = read(files)
    for name, unit, column in zip(names, chosen, columns[1:], strict=True):
        np.testing.assert_array_equal(records[0][name], units.to_si(column, unit).values)
    for other in records[1:]:
        assert_same(records[0], other)


@pytest.mark.parametrize("text", [
    HEADER + "\n0,10,1.5\n0.01,,-2.25\n0.02,30,3\n0.03,40.5,4\n",
    "\ufeff" + HEADER + "\r\n0,10,1.5\r\n0.01,NaN,-2.25\r\n0.02,30,3\r\n0.03,40.5,4",
    "# rig 3\n\n" + HEADER + "\n# begin\n0,10,1.5\n\n0.01,NA,-2.25\n0.02,30,3\n# half\n0.03,40.5,4\n",
    '"time [s]", "velocity [mm/s]", "force [kN]"\n"0","10","1.5"\n0.01, n/a ,-2.25\n0.02,30,3\n0.03,40.5,4\n',
    "time [s];velocity [mm/s];force [kN]\n0;10;1,5\n0,01;;-2,25\n0,02;30;3\n0,03;40,5;4\n",
    "time [s]\tvelocity [mm/s]\tforce [kN]\n0\t10\t1.5\n0.01\t\t-2.25\n0.02\t30\t3\n0.03\t40.5\t4\n",
    "time [s]  velocity [mm/s]  force [kN]\n 0 10 1.5\n 0.01 nan -2.25\n 0.02 30 3\n 0.03 40.5 4\n",
    "time [ms],velocity [cm/s],force [N]\n0,1,1500\n10,nan,-2250\n20,3,3000\n30,4.05,4000\n",
    HEADER + ",\n0,10,1.5,\n0.01,,-2.25,\n0.02,30,3,\n0.03,40.5,4,\n",
    HEADER + "\r0,10,1.5\r0.01,,-2.25\r0.02,30,3\r0.03,40.5,4\r",
])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_layouts(tmp_path, text, encoding):
    raw = text.lstrip("\ufeff").encode(encoding) if encoding != "utf-8" else text.encode()
    record = read(put(tmp_path / "run.csv", raw))[0]
    np.testing.assert_allclose(record.times, [r[0] for r in ROWS], atol=1e-15)
    np.testing.assert_allclose(record["velocity"], [r[1] / 1000 for r in ROWS], rtol=1e-15)
    np.testing.assert_allclose(record["force"], [r[2] * 1000 for r in ROWS], rtol=1e-15)
    assert (record.unit("velocity"), record.unit("force"), record.name) == ("m/s", "N", "run")
    assert record.sample_time == pytest.approx(0.01)


def test_latin_1_names_survive(tmp_path):
    text = "time [s],Dämpferkraft [N],Öltemperatur [°C]\n0,1,20\n1,2,20\n"
    record = read(put(tmp_path / "a.csv", text.encode("latin-1")))[0]
    assert list(record.channels) == ["Dämpferkraft", "Öltemperatur"]
    np.testing.assert_array_equal(record["Öltemperatur"], [293.15, 293.15])


def test_text_marks_its_channel_and_leaves_the_others(tmp_path):
    text = HEADER + "\n0,10,1\n# pause\n0.01,abc,2\n0.02,12,3\n0.03,1_000,4\n"
    record = read(put(tmp_path / "a.csv", text))[0]
    fault = record.channel("velocity").fault
    assert fault == "text 'abc' in row 2 (line 4 of the file) and in 1 more row(s)"
    assert record.notes == (f"channel 'velocity': {fault}",)
    np.testing.assert_array_equal(record["velocity"], [0.01, np.nan, 0.012, np.nan])
    assert record.channel("force").fault is None


def test_infinity_is_kept(tmp_path):
    record = read(put(tmp_path / "a.csv", HEADER + "\n0,inf,1\n0.01,-inf,2\n0.02,1e999,3\n"))[0]
    np.testing.assert_array_equal(record["velocity"], [np.inf, -np.inf, np.inf])


def test_units_missing_and_unknown(tmp_path):
    record = read(put(tmp_path / "a.csv", "t,motor current [mA],p1,x [raw],y []\n0,1,2,3,4\n1,1,2,3,4\n"))[0]
    known = {k: (c.unit, c.source_unit, c.unit_known, c.values[0]) for k, c in record.channels.items()}
    assert known == {"motor current": ("A", "mA", True, 0.001), "p1": ("", None, True, 2.0),
                     "x": ("", "raw", False, 3.0), "y": ("", "", True, 4.0)}


def test_time_that_is_missing_or_not_a_number(tmp_path):
    record = read(put(tmp_path / "a.csv", "time [s],x\n0,1\nnan,2\ninf,3\n3,4\n"))[0]
    assert record.time_base.invalid == (1, 2)
    assert not record.is_uniform


def test_two_rows_are_a_record(tmp_path):
    assert read(put(tmp_path / "a.csv", "time [s],x\n0,1\n1,2\n"))[0].n_samples == 2
    assert read(put(tmp_path / "b.csv", "time [s],x\n0,1\n"))[0].n_samples == 1


def test_a_stated_rate_serves_files_without_time(tmp_path):
    path = put(tmp_path / "a.csv", "distance [m],height [mm]\n0,1\n0.1,2\n0.2,3\n")
    record = read(path, sample_rate=50.0, name="road")[0]
    assert (record.sample_time, record.name, record["height"][2]) == (0.02, "road", 0.003)
    timed = read(put(tmp_path / "b.csv", "time [s],x\n0,1\n1,2\n"), sample_rate=50.0)[0]
    assert timed.sample_time == 1.0
    assert "not used" in timed.notes[0]


def test_a_single_column(tmp_path):
    record = read(put(tmp_path / "a.csv", "motor current [A]\n1\n2\n3\n"), sample_rate=10.0)[0]
    np.testing.assert_array_equal(record["motor current"], [1, 2, 3])


def test_roles(tmp_path):
    path = put(tmp_path / "a.csv", "time [s],F_cell [N]\n0,1\n1,2\n")
    assert read(path, roles={"force": "F_cell"})[0]["force"][1] == 2.0
    with pytest.raises(InputError, match=r"a\.csv.*F_call"):
        read(path, roles={"force": "F_call"})


# -- finding files --------------------------------------------------------------------------------------------------
def test_patterns_folders_and_order(tmp_path):
    for name in ("run10", "run2", "Run1"):
        put(tmp_path / f"{name}.csv", "time [s],x\n0,1\n1,2\n")
    put(tmp_path / "notes.md", "no data")
    assert [r.name for r in read(str(tmp_path / "*.csv"))] == ["Run1", "run2", "run10"]
    assert [r.name for r in read(tmp_path)] == ["Run1", "run2", "run10"]
    assert [r.name for r in read([tmp_path / "run10.csv", str(tmp_path / "run[2].csv")])] == ["run10", "run2"]


def test_a_name_with_brackets_is_a_file_first(tmp_path):
    path = put(tmp_path / "run[1].CSV", "time [s],x\n0,1\n1,2\n")
    assert find(path) == [path]


def test_colliding_stems_take_their_folder(tmp_path):
    paths = [tmp_path / "a" / "x.csv", tmp_path / "b" / "x.csv", tmp_path / "b" / "y.csv"]
    assert record_names(paths) == ["a/x", "b/x", "y"]
    assert record_names([tmp_path / "x.csv", tmp_path / "x.mat", tmp_path / "z.csv"]) == ["x.csv", "x.mat", "z"]
    deep = [tmp_path / "1" / "a" / "x.csv", tmp_path / "2" / "a" / "x.csv"]
    assert record_names(deep) == ["1/a/x", "2/a/x"]
    mixed = [tmp_path / "a" / "x.csv", tmp_path / "b" / "x.csv", tmp_path / "b" / "x.mat"]
    assert record_names(mixed) == ["x", "x.csv", "x.mat"]


# -- formats --------------------------------------------------------------------------------------------------------
def test_parquet_metadata_text_nulls_and_dates(tmp_path):
    start = 1_700_000_000_000_000_123
    fields = [pa.field("time", pa.timestamp("ns")), pa.field("v", pa.float32(), metadata={b"unit": b"cm/s"}),
              pa.field("i [mA]", pa.int64()), pa.field("tag", pa.string()), pa.field("on", pa.bool_()),
              pa.field("list", pa.list_(pa.int8())), pa.field("void", pa.null())]
    data = [[start, start + 1_000_000, start + 2_000_000], [1.0, None, 3.0], [1, 2, None], ["1", "x", None],
            [True, False, None], [[1], [2], [3]], [None] * 3]
    arrays = [pa.array(d, type=f.type) for d, f in zip(data, fields, strict=True)]
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), tmp_path / "a.parquet")
    record = read(tmp_path / "a.parquet")[0]
    np.testing.assert_array_equal(record.time, [0.0, 0.001, 0.002])
    np.testing.assert_array_equal(record["v"], [0.01, np.nan, 0.03])
    np.testing.assert_array_equal(record["i"], [0.001, 0.002, np.nan])
    np.testing.assert_array_equal(record["on"], [1.0, 0.0, np.nan])
    assert record.channel("tag").fault == "text 'x' in row 2"
    assert np.isnan(record["void"]).all()
    assert "column 'list' is left out" in record.notes[0]


def test_parquet_states_its_rate(tmp_path):
    table = pa.table({"x [m]": [1.0, 2.0]}).replace_schema_metadata({"sample_rate": "2 kHz"})
    pq.write_table(table, tmp_path / "a.parquet")
    assert read(tmp_path / "a.parquet")[0].sample_time == 5e-4


def test_mat_structs_matrices_and_leftovers(tmp_path):
    n = 5
    savemat(tmp_path / "a.mat", {
        "rig": {"time": np.arange(n) * 10.0, "force": np.arange(n) * 2, "units": {"time": "ms", "force": "kN"}},
        "sensors": np.arange(2.0 * n).reshape(n, 2), "units": {"sensors": "mm", "force": "N"},
        "other": np.arange(3.0), "comment": "a run", "gain": 3.0, "z": np.ones(n) * 1j, "row": np.ones((1, n)),
    })
    record = read(tmp_path / "a.mat")[0]
    assert list(record.channels) == ["force", "sensors_1", "sensors_2", "row"]
    np.testing.assert_array_equal(record["force"], np.arange(n) * 2000.0)
    np.testing.assert_array_equal(record["sensors_2"], np.arange(1, 2 * n, 2) / 1000)
    assert record.sample_time == pytest.approx(0.01)
    assert {note.split("'")[1] for note in record.notes} == {"other", "comment", "gain", "z"}


def test_mat_fields_that_share_a_name_and_a_stated_clock(tmp_path):
    savemat(tmp_path / "a.mat", {"front": {"force": np.arange(4.0)}, "rear": {"force": np.arange(4.0)},
                                 "sample_rate": 200.0})
    record = read(tmp_path / "a.mat")[0]
    assert list(record.channels) == ["front.force", "rear.force"]
    assert record.sample_time == 0.005


@pytest.mark.parametrize("compressed", [False, True])
def test_mat_kinds_agree_with_what_scipy_wrote(tmp_path, compressed):
    kinds = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", "?")
    arrays = {f"v_{i}": (np.arange(7) % 3).astype(kind) for i, kind in enumerate(kinds)}
    odd = {"cells": np.array([1, "a"], dtype=object), "packed": csc_matrix(np.eye(7)), "text": "µ-bearing",
           "many": np.zeros(2, dtype=[("a", float)]), "deep": {"deeper": {"x": np.arange(7.0)}}}
    savemat(tmp_path / "a.mat", {**arrays, **odd}, do_compression=compressed)
    record = read(tmp_path / "a.mat", sample_rate=1.0)[0]
    assert list(record.channels) == [*arrays, "x"]
    for name, array in arrays.items():
        np.testing.assert_array_equal(record[name], array.astype(float))
    assert {note.split("'")[1] for note in record.notes} == {"cells", "packed", "text", "many"}


def test_mat_version_4(tmp_path):
    savemat(tmp_path / "a.mat", {"time": np.arange(4.0) / 4, "x": np.arange(4.0)}, format="4")
    record = read(tmp_path / "a.mat")[0]
    assert record.sample_time == 0.25
    np.testing.assert_array_equal(record["x"], np.arange(4))


def test_mat73_follows_no_links(tmp_path):
    put(tmp_path / "secret.h5", "")
    path = write_mat73(tmp_path / "a.mat", ["time", "x"], ["s", "mm"], [np.arange(3.0), np.arange(3.0)])
    with h5py.File(path, "r+") as file:
        file["elsewhere"] = h5py.ExternalLink("secret.h5", "/x")
        file["loop"] = file["units"]
        file["units/back"] = file["/"]
    record = read(path)[0]
    assert list(record.channels) == ["x"]
    np.testing.assert_array_equal(record["x"], [0, 0.001, 0.002])


def test_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    t = np.arange(100) / 100
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(1e3 * t, t, unit="mm", name="displacement"),
                     asammdf.Signal(np.cos(t), t, unit="kN", name="force")])
        file.append([asammdf.Signal(t + 1, t, unit="A", name="current")])
        file.save(tmp_path / "a.mf4")
        file.append([asammdf.Signal(t[::2], t[::2], unit="A", name="slow")])
        file.save(tmp_path / "b.mf4")
    record = read(tmp_path / "a.mf4")[0]
    assert {k: c.unit for k, c in record.channels.items()} == {"displacement": "m", "force": "N", "current": "A"}
    np.testing.assert_array_equal(record["force"], 1000 * np.cos(t))
    assert record.sample_time == pytest.approx(0.01)
    with pytest.raises(InputError, match=r"b\.mf4.*slow.*one raster"):
        read(tmp_path / "b.mf4")


def test_tdms(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    x = np.arange(50.0)

    def write(name, *increments):
        with nptdms.TdmsWriter(str(tmp_path / name)) as file:
            file.write_segment([
                nptdms.ChannelObject(f"g{i}", "force", x + i, properties={"unit_string": "kN", "wf_increment": dt})
                for i, dt in enumerate(increments)])

    write("a.tdms", 0.01, 0.01)
    record = read(tmp_path / "a.tdms")[0]
    assert list(record.channels) == ["g0/force", "g1/force"]
    assert (record.sample_time, record.unit("g0/force")) == (0.01, "N")
    np.testing.assert_array_equal(record["g1/force"], 1000 * (x + 1))
    write("b.tdms", 0.01, 0.02)
    with pytest.raises(InputError, match="different sampling periods"):
        read(tmp_path / "b.tdms")


def test_reading_loads_no_heavy_library(tmp_path):
    path = put(tmp_path / "a.csv", HEADER + "\n0,1,2\n1,2,3\n")
    code = (f"import sys; from lpvid.files import read; read({str(path)!r});"
            "print([m for m in ('pint', 'pandas', 'pyarrow', 'h5py', 'scipy', 'asammdf', 'nptdms')"
            " if m in sys.modules])")
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


# -- real measurements ----------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_every_real_measurement_reads(shared_data):
    files = sorted(shared_data.glob("*/*.csv"))
    records = read(files, sample_rate=100.0)
    assert len(records) == len(files) >= 20
    assert len({r.name for r in records}) == len(files)
    for path, record in zip(files, records, strict=True):
        lines = path.read_text().splitlines()
        assert record.n_samples == len(lines) - 1
        last_header, last_cell = lines[0].split(",")[-1], lines[-1].split(",")[-1]
        name, unit = units.parse_header(last_header)
        assert record[name][-1] == units.to_si([float(last_cell)], unit).values[0]
        assert not any(c.fault for c in record.channels.values())
    named = {r.name: r for r in records}
    damper = named["mr_damper_random/estimation"]
    assert damper.sample_time == pytest.approx(1 / 3004.8, rel=1e-6)
    assert not damper.channel("acceleration").unit_known
