"""One clock for the files of a data set: units that differ, calendar stamps that count from each file's own first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.files.streaming import Chunks, read_chunks

N, RATE = 400, 200
START = np.datetime64("2026-01-01T23:59:58", "ms")


def stamps(t: np.ndarray) -> np.ndarray:
    return START + (1e3 * t).round().astype("timedelta64[ms]")


def text(path: Path, head: str, clock: list[str], values: np.ndarray) -> None:
    path.write_text(f"{head},v [m/s]\n" + "\n".join(f"{a},{b}" for a, b in zip(clock, values, strict=True)) + "\n")


def in_units(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
    text(folder / f"part{k}.csv", "time [ms]" if k == 1 else "time [s]",
         [f"{x * (1000 if k == 1 else 1):.4f}" for x in t], v)


def dates(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
    text(folder / f"part{k}.csv", "time", [str(s).replace("T", " ") for s in stamps(t)], v)


def times_of_day(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
    text(folder / f"part{k}.csv", "time", [str(s)[11:] for s in stamps(t)], v)


def parquet(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    step = ("ms", "ns", "us")[k]
    pq.write_table(pa.table({"time": pa.array(stamps(t).astype(f"datetime64[{step}]")), "v [m/s]": v}),
                   folder / f"part{k}.parquet")


Writer = Callable[[Path, int, np.ndarray, np.ndarray], None]


def data_set(tmp_path: Path, write: Writer, rows: int, shared: int = 0) -> Chunks:
    folder = tmp_path / "run.parquet"
    folder.mkdir()
    for k in range(3):
        write(folder, k, (k * (N - shared) + np.arange(N)) / RATE, np.arange(N) + 1000.0 * k)
    return read_chunks(folder, rows=rows)


@pytest.mark.parametrize("write", [in_units, dates, times_of_day, parquet])
@pytest.mark.parametrize("rows", [150, 1000])
def test_the_clock_runs_on_across_files(tmp_path, write: Writer, rows: int) -> None:
    chunks = data_set(tmp_path, write, rows)
    placed = list(chunks.located())
    times = np.concatenate([r.times for _, r in placed])
    np.testing.assert_allclose(times, np.arange(3 * N) / RATE, atol=1e-12)
    for place, _ in placed[:-1]:  # a restart finds the same clock
        rest = np.concatenate([r.times for _, r in chunks.located(place)])
        np.testing.assert_allclose(rest, times[-rest.size:], atol=1e-12)


@pytest.mark.parametrize("rows", [150, 1000])
def test_a_stamp_that_two_files_share_in_different_units_is_one_row(tmp_path, rows: int) -> None:
    def write(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
        v = v.astype(object)
        if k:
            v[0] = ""
        in_units(folder, k, t, v)

    found = list(data_set(tmp_path, write, rows, shared=1))
    times = np.concatenate([r.times for r in found])
    assert times.size == 3 * N - 2 and np.ptp(np.diff(times)) < 1e-12
    assert sum("repeats a time stamp" in str(n) for r in found for n in r.notes) == 2


def test_dates_behind_times_of_day_are_refused(tmp_path) -> None:
    def write(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
        (dates if k else times_of_day)(folder, k, t, v)

    with pytest.raises(InputError, match=r"part1.csv: the clock has another kind.*dates behind times of day"):
        list(data_set(tmp_path, write, 1000))


def test_dates_with_a_zone_behind_dates_without_one_are_refused(tmp_path) -> None:
    """The zone of those without is not known: an hour or more may lie between."""
    def write(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
        text(folder / f"part{k}.csv", "time", [f"{s}{'+01:00' if k else ''}" for s in stamps(t)], v)

    with pytest.raises(InputError, match=r"part1.csv: the clock has another kind.*dates with zone behind dates"):
        list(data_set(tmp_path, write, 1000))


def test_seconds_behind_dates_are_refused(tmp_path) -> None:
    def write(folder: Path, k: int, t: np.ndarray, v: np.ndarray) -> None:
        (in_units if k else dates)(folder, k, t, v)

    with pytest.raises(InputError, match=r"part1.csv: the clock has another kind.*numbers behind dates"):
        list(data_set(tmp_path, write, 1000))
