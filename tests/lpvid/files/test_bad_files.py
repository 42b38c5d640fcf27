"""Reading files that are not in order: one line that names the file, what is wrong and how to mend it."""

from __future__ import annotations

import builtins
import os
import struct
import sys
import tracemalloc
import zlib
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from lpvid.errors import InputError
from lpvid.files import read
from lpvid.files._table import check_claim


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refused(path, *parts: str, **options) -> str:
    with pytest.raises(InputError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert "Mend: " in message
    for part in parts:
        assert part in message
    return message


@pytest.mark.parametrize("content, parts", [
    ("", ["empty"]),
    ("\n\n# only a comment\n", ["empty", "header"]),
    ("time [s],force [N]\n", ["header but no data", "force"]),
    ("0,1\n1,2\n", ["line 1 holds numbers only", "header row"]),
    ("time [s],x,x [m]\n0,1,2\n", ["two columns are named 'x'", "columns 2 and 3"]),
    ("time [s],x,y\n0,1,2\n1,2\n", ["line 3 has 2 cells", "3 columns"]),
    ("# note\ntime [s],x\n\n0,1\n1,2,3\n", ["line 5 has 3 cells"]),
    ("time [s],x\n0,1,\n1,2,\n", ["line 2 has 3 cells"]),
    ("time [s],,x\n0,1,2\n", ["column 2 has no name"]),
    ("time [s],[N]\n0,1\n", ["column 2 has no name"]),
    ("time [s]\n0\n1\n", ["no channel beside 'time'"]),
    ("time [s],x\n0,1\nabc,2\n", ["time column", "'abc' in row 2 (line 3 of the file)"]),
    ("time [m],x\n0,1\n1,2\n", ["'m'", "not one of time"]),
    ("time [ticks],x\n0,1\n1,2\n", ["'ticks'", "not one of time"]),
    ("time [Hz],x\n0,1\n1,2\n", ["not one of time"]),
    ("distance [m],height [m]\n0,1\n1,2\n", ["no time column", "distance, height", "--sample-rate HZ"]),
    (b"\x00\x01\x02binary\xff\xfe" * 50, ["not text"]),
    (b"\xff\xfe\x00", ["not text"]),
    (b"PAR1\x00\x00", ["not text"]),
    ('time [s],x\n0,"' + "1" * 200_000 + "\n", ["line 2"]),
])
def test_bad_text(tmp_path, content, parts):
    refused(put(tmp_path / "bad.csv", content), "bad.csv", *parts)


def test_bad_paths(tmp_path):
    refused(tmp_path / "none.csv", "none.csv", "no such file")
    refused(str(tmp_path / "*.csv"), "no file matches")
    refused(tmp_path, "no file that can be read")
    refused([], "no files")
    refused(put(tmp_path / "a.xlsx", "x"), "a.xlsx", "'.xlsx'", ".parquet")
    refused(put(tmp_path / "noextension", "x"), "noextension")
    good = put(tmp_path / "good.csv", "time [s],x\n0,1\n1,2\n")
    refused([good, tmp_path / "." / "good.csv"], "named twice")
    refused([good, tmp_path / "*.csv"], "named twice")
    (tmp_path / "folder.csv").mkdir()
    refused(tmp_path / "folder.csv", "no file that can be read")
    for wrong in ("", " ", "a\0b.csv", 3):
        with pytest.raises(InputError, match="path must"):
            read([wrong])
    for rate in (0.0, -1.0, np.nan, "fast"):
        with pytest.raises(InputError, match="sample_rate"):
            read(good, sample_rate=rate)
    other = put(tmp_path / "other.csv", "time [s],x\n0,1\n1,2\n")
    refused([good, other], "one name", name="run")


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    refused(tmp_path / "pipe.csv", "not a file")


def test_no_permission(tmp_path, monkeypatch):
    path = put(tmp_path / "locked.csv", "time [s],x\n0,1\n1,2\n")

    def refuse(self, *args, **kwargs):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    refused(path, "locked.csv", "Permission denied", "permissions")


@pytest.mark.parametrize("module, file, library", [
    ("pyarrow", "a.parquet", "pyarrow"), ("h5py", "a.mat", "h5py"), ("asammdf", "a.mf4", "asammdf"),
    ("nptdms", "a.tdms", "npTDMS"),
])
def test_a_missing_library_is_named(tmp_path, monkeypatch, module, file, library):
    head = {"a.mat": b"\x89HDF\r\n\x1a\n", "a.mf4": b"MDF     4.10"}.get(file, b"x")
    path = put(tmp_path / file, head.ljust(600, b"\0"))
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.split(".")[0] == module:
            raise ImportError(name)
        return real(name, *args, **kwargs)

    for loaded in [m for m in sys.modules if m.split(".")[0] == module]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setattr(builtins, "__import__", without)
    refused(path, file, library, "pip install 'lpvid[files]'")


# -- damage ---------------------------------------------------------------------------------------------------------
def good_files(folder: Path) -> list[Path]:
    t, x = np.arange(200) / 100, np.sin(np.arange(200.0))
    pq.write_table(pa.table({"time": t, "x": x}), folder / "a.parquet")
    savemat(folder / "plain.mat", {"time": t, "x": x})
    savemat(folder / "packed.mat", {"time": t, "x": x, "s": {"y": x}}, do_compression=True)
    with h5py.File(folder / "new.mat", "w") as file:
        file.create_dataset("time", data=t[None, :], compression="gzip")
        file["x"] = x[None, :]
    return [folder / n for n in ("a.parquet", "plain.mat", "packed.mat", "new.mat")]


def test_truncated_files(tmp_path):
    for path in good_files(tmp_path):
        whole = path.read_bytes()
        assert read(path)[0].n_samples == 200
        for share in (0.02, 0.3, 0.6, 0.97):
            put(path, whole[: int(share * len(whole))])
            refused(path, path.name)


@pytest.mark.parametrize("name", ["a.parquet", "a.mat", "a.mf4", "a.tdms", "a.mdf"])
@pytest.mark.parametrize("content", [b"x", b"\0" * 1000, b"time,x\n0,1\n1,2\n" * 20, bytes(range(256)) * 8])
def test_another_format_under_this_name(tmp_path, name, content):
    library = {"mf4": "asammdf", "mdf": "asammdf", "tdms": "nptdms"}.get(name.split(".")[1])
    if library:
        pytest.importorskip(library)
    refused(put(tmp_path / name, content), name)


@pytest.mark.seconds
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_flipped_bytes_never_escape_as_another_error(tmp_path, data):
    path = data.draw(st.sampled_from(good_files(tmp_path)))
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    put(path, bytes(raw))
    try:
        record = read(path)[0]
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert record.n_samples > 0


@pytest.mark.seconds
@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=300), st.text(alphabet="0123456789.,;\t -#\"\nabtime[]s", max_size=200)))
def test_any_text_is_a_record_or_an_input_error(tmp_path, content):
    try:
        record = read(put(tmp_path / "a.csv", content), sample_rate=1.0)[0]
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert record.n_samples > 0


# -- claims ---------------------------------------------------------------------------------------------------------
def mat5(shape: tuple[int, int], *, compressed: bool) -> bytes:
    """A MAT version 5 file whose header claims `shape` and that holds one number."""
    flags = struct.pack("<4I", 6, 8, 6, 0)
    dimensions = struct.pack("<2I2i", 5, 8, *shape)
    name = struct.pack("<2I", 1, 1) + b"x".ljust(8, b"\0")
    number = struct.pack("<2Id", 9, 8, 1.0)
    body = flags + dimensions + name + number
    element = struct.pack("<2I", 14, len(body)) + body
    if compressed:
        packed = zlib.compress(element)
        element = struct.pack("<2I", 15, len(packed)) + packed
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element


def hdf5_claim(path: Path) -> bytes:
    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(1, 1_300_000_000), dtype="f8", chunks=(1, 1000))
    return path.read_bytes()


def parquet_claim(path: Path) -> bytes:
    """Run-length coding keeps 6e8 nulls in a few kilobytes: the claim is true, and yet too large."""
    with pq.ParquetWriter(path, pa.schema([("x", pa.null())])) as writer:
        block = pa.table({"x": pa.nulls(60_000_000)})
        for _ in range(10):
            writer.write_table(block, row_group_size=60_000_000)
    return path.read_bytes()


@pytest.mark.thinned(4, "seconds")
@pytest.mark.parametrize("make", [
    lambda path: mat5((1_300_000_000, 1), compressed=False), lambda path: mat5((40_000, 40_000), compressed=True),
    hdf5_claim, parquet_claim,
])
def test_ten_gigabytes_in_a_header(tmp_path, make):
    content = make(tmp_path / "source")
    name = "a.parquet" if content[:4] == b"PAR1" else "a.mat"
    path = put(tmp_path / name, content)
    tracemalloc.start()
    try:
        refused(path, name, "claims", "MB of samples")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 50e6


def test_claims():
    check_claim(1000, "f", held=10)
    with pytest.raises(InputError, match="corrupt"):
        check_claim(10**7, "f", held=1000)
    with pytest.raises(InputError, match="limit"):
        check_claim(2**33, "f")


def test_columns_of_a_mat_file_that_cannot_be_used(tmp_path):
    savemat(tmp_path / "a.mat", {"comment": "none"})
    refused(tmp_path / "a.mat", "no numeric vector")
    savemat(tmp_path / "b.mat", {"x": np.arange(5.0)})
    refused(tmp_path / "b.mat", "no time column", "x", "--sample-rate HZ")
    for name, value in {"Fs": 250.0, "f_s": 250, "sampling_rate": 250.0, "Ts": 0.004, "dt": 0.004}.items():
        savemat(tmp_path / "b.mat", {"x": np.arange(5.0), "gain": 2.0, name: value})
        refused(tmp_path / "b.mat", "--sample-rate 250, in Python")
    savemat(tmp_path / "c.mat", {"x": np.arange(5.0), "sample_time": -1.0})
    refused(tmp_path / "c.mat", "sample_time must be positive")
