"""What every file reader must do: the same record from every format, and one line for a file that is none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.measurement_files import WRITERS, Columns

from lpvid.errors import InputError
from lpvid.files import READERS, read
from lpvid.record import Record

COLUMNS: Columns = {"time": ("s", 0.01 * np.arange(60)),
                    "displacement": ("mm", 5.0 * np.sin(0.3 * np.arange(60))),
                    "force": ("kN", np.where(np.arange(60) % 7 == 3, np.nan, np.cos(0.3 * np.arange(60)))),
                    "current": ("A", 0.5 + 0.01 * np.arange(60))}
FORMATS = {extension: WRITERS[extension] for extensions, _ in READERS for extension in extensions}
every = pytest.mark.parametrize("extension", FORMATS)


def written(extension: str, path: Path, columns: Columns = COLUMNS) -> Path:
    """The columns in a file of the format; skips where its library is not installed."""
    for library in {".mf4": ("asammdf",), ".mdf": ("asammdf",), ".tdms": ("nptdms",)}.get(extension, ()):
        pytest.importorskip(library)
    write: Callable[[Path, Columns], None] = FORMATS[extension]
    write(path, columns)
    return path


@every
def test_the_record_is_that_of_the_columns_in_si(extension: str, tmp_path: Path) -> None:
    record, = read(written(extension, tmp_path / f"run{extension}"))
    assert isinstance(record, Record) and record.name == "run"
    assert record.sample_time == pytest.approx(0.01, rel=1e-9)
    assert {n: c.unit for n, c in record.channels.items()} == {"displacement": "m", "force": "N", "current": "A"}
    np.testing.assert_allclose(record["displacement"], 5e-3 * np.sin(0.3 * np.arange(60)), rtol=1e-12, atol=1e-15)


@every
def test_missing_samples_stay_missing(extension: str, tmp_path: Path) -> None:
    record, = read(written(extension, tmp_path / f"run{extension}"))
    missing = np.arange(60) % 7 == 3
    np.testing.assert_array_equal(np.isnan(record["force"]), missing)
    np.testing.assert_allclose(record["force"][~missing], 1e3 * np.cos(0.3 * np.arange(60))[~missing], rtol=1e-12)


@every
def test_twice_the_same_and_the_file_is_left_as_it_is(extension: str, tmp_path: Path) -> None:
    path = written(extension, tmp_path / f"run{extension}")
    before = path.read_bytes()
    one, two = read(path)[0], read(path)[0]
    assert path.read_bytes() == before and list(one.channels) == list(two.channels)
    for name in one.channels:
        np.testing.assert_array_equal(one[name], two[name])


@every
def test_a_role_goes_to_its_channel(extension: str, tmp_path: Path) -> None:
    record, = read(written(extension, tmp_path / f"run{extension}"), roles={"output": "force"})
    np.testing.assert_array_equal(record["output"], record["force"])


@every
@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02\xff\xfe no such format" * 40], ids=["empty", "noise"])
def test_a_file_that_is_none_is_refused_in_one_line(extension: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"run{extension}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1 and path.name in message and "Mend: " in message


@every
def test_a_file_cut_short_is_read_in_part_or_refused_in_one_line(extension: str, tmp_path: Path) -> None:
    path = written(extension, tmp_path / f"run{extension}")
    whole = path.read_bytes()
    for share in (0.1, 0.4, 0.7, 0.95):
        path.write_bytes(whole[:int(share * len(whole))])
        try:
            record, = read(path)
        except InputError as error:
            assert len(str(error).splitlines()) == 1 and path.name in str(error)
        else:
            assert 0 < record.n_samples <= 60


def test_every_reader_is_in_this_suite() -> None:
    """A new format writes itself in helpers/measurement_files.py."""
    assert set(FORMATS) == {e for extensions, _ in READERS for e in extensions} == set(WRITERS)
