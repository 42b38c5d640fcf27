"""Rows of one time stamp: one row where they nowhere contradict each other, one line where they do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lpvid as lpv
from lpvid.condition import segments, with_derived
from lpvid.condition.repeated_stamps import one_row_per_stamp
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.files.streaming import read_chunks
from lpvid.record import Record
from lpvid.remark import Repeated

N, PERIOD = 600, 0.005
NAN = float("nan")


def columns(seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    v = np.convolve(rng.standard_normal(N + 20), np.ones(20) / 60, "valid")[:N]
    force = np.zeros(N)
    for k in range(1, N):
        force[k] = 0.4 * force[k - 1] + 400 * v[k]
    return {"time [s]": PERIOD * np.arange(N), "velocity [m/s]": v, "force [N]": force + rng.standard_normal(N),
            "temperature [K]": np.full(N, 300.0)}


def repeated(table: dict[str, np.ndarray], rows: list[int]) -> dict[str, np.ndarray]:
    """The table with these rows once more behind themselves."""
    order = np.sort(np.concatenate([np.arange(N), rows]))
    return {n: v[order] for n, v in table.items()}


def write(path: Path, table: dict[str, np.ndarray]) -> Path:
    np.savetxt(path, np.column_stack(list(table.values())), delimiter=",", header=",".join(table), comments="",
               fmt="%.17g")
    return path


@pytest.mark.parametrize("rows", [[7], [7, 7, 300], list(range(0, N, 2)), list(range(N))])
def test_a_row_that_is_written_twice_counts_once(rows, tmp_path):
    table = columns()
    once, = lpv.read(write(tmp_path / "once.csv", table))
    twice, = lpv.read(write(tmp_path / "twice.csv", repeated(table, rows)))
    for record in (twice, *segments(as_records(repeated(table, rows)), ["velocity", "force"])):
        assert record.sample_time == pytest.approx(PERIOD)
        np.testing.assert_array_equal(record["force"], once["force"])
        note, = (n for n in record.notes if isinstance(n, Repeated))
        assert note.startswith(f"{len(rows)} row")
        assert f"first row {min(rows) + 2}" in note
    assert lpv.audit(twice).of("repeated-rows")[0].severity == "note"
    assert not lpv.audit(twice).of("duplicate-time")


def test_the_model_is_that_of_the_record_without_repetitions(tmp_path):
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    clean, = lpv.read(write(tmp_path / "once.csv", columns()))
    twice, = lpv.read(write(tmp_path / "twice.csv", repeated(columns(), [7, 90, 91, 400])))
    one, other = (lpv.identify(r, structure) for r in (clean, twice))
    np.testing.assert_array_equal(one.model.a, other.model.a)
    assert any("4 rows repeat a time stamp" in n for n in other.notes)
    assert any("record 'twice': 4 rows repeat" in n for n in lpv.validate(one.model, twice).notes)
    stamps = np.append(clean.times, clean.times[-1])
    by_hand = Record({n: np.append(c.values, c.values[-1]) for n, c in clean.channels.items()}, time=stamps)
    assert lpv.audit([by_hand]).of("repeated-rows")


def test_a_record_with_repetitions_is_simulated_and_predicted_as_without():
    whole, twice = ({n.split(" ")[0]: v for n, v in t.items()} for t in (columns(), repeated(columns(), [3, 300])))
    run, again = (Record({n: v for n, v in t.items() if n != "time"}, time=t["time"]) for t in (whole, twice))
    model = lpv.identify(run, lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")).model
    assert np.array_equal(lpv.simulate(model, again).output, lpv.simulate(model, run).output)
    assert np.array_equal(lpv.predict(model, again).output, lpv.predict(model, run).output, equal_nan=True)


def test_rows_of_a_bus_that_complete_each_other_are_one():
    record = Record({"v": [0.0, 1.0, NAN, 2.0, 3.0], "F": [0.0, NAN, 5.0, 9.0, NAN]},
                    time=np.array([0.0, 0.1, 0.1, 0.2, 0.3]))
    found = one_row_per_stamp(record)
    assert found["v"].tolist() == [0.0, 1.0, 2.0, 3.0]
    np.testing.assert_array_equal(found["F"], [0.0, 5.0, 9.0, NAN])
    assert one_row_per_stamp(found) is found


def test_two_values_at_one_time_are_refused_with_both(tmp_path):
    table = repeated(columns(), [50, 51, 52, 53, 300])
    table["force [N]"][51] += 1.0
    record, = lpv.read(write(tmp_path / "run.csv", table))
    with pytest.raises(InputError) as caught:
        lpv.identify(record, lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force"))
    line = str(caught.value)
    values = table["force [N]"][[50, 51]]
    assert "time repeats in row 52 with another value of 'force'" in line
    assert f"got {values[0]:.6g} and {values[1]:.6g} N at 0.25 s; 5 row(s) in all" in line
    fault, = lpv.audit(record).of("duplicate-time")
    assert fault.severity == "fault"
    assert "with other values of force" in fault.evidence


def test_a_channel_that_is_not_in_use_decides_nothing(tmp_path):
    table = repeated(columns(), [50, 51, 52, 53, 300])
    table["temperature [K]"][51] += 1.0
    record, = lpv.read(write(tmp_path / "run.csv", table))
    piece, = segments(record, ["velocity", "force"])
    assert piece.n_samples == N
    assert any("no other value of the channels in use" in n for n in piece.notes)
    with pytest.raises(InputError, match="another value of 'temperature'"):
        segments(record, ["force", "temperature"])


def test_a_velocity_is_derived_as_without_the_repetitions(tmp_path):
    t = PERIOD * np.arange(N)
    table = {"time [s]": t, "displacement [m]": 0.01 * np.sin(9 * t), "force [N]": 90 * np.cos(9 * t) + np.sin(40 * t)}
    once, = segments(with_derived(lpv.read(write(tmp_path / "a.csv", table)), ["velocity"]), "velocity")
    more = repeated({**table, "counter": np.zeros(N)}, [50, 300])
    more["counter"][51] = 1.0  # keeps the rows apart on reading
    raw, = with_derived(lpv.read(write(tmp_path / "b.csv", more)), ["velocity"])
    piece, = segments(raw, ["velocity", "force"])
    np.testing.assert_array_equal(piece["velocity"], once["velocity"])
    more["force [N]"][51] += 1.0
    raw, = with_derived(lpv.read(write(tmp_path / "b.csv", more)), ["velocity"])
    with pytest.raises(InputError, match="another value of 'force'"):
        segments(raw, ["velocity", "force"])
    more["displacement [m]"][51] += 1e-3
    with pytest.raises(InputError, match="another value of 'displacement'"):
        with_derived(lpv.read(write(tmp_path / "b.csv", more)), ["velocity"])


def test_a_clock_that_also_runs_backward_keeps_its_rows():
    record = Record({"u": np.arange(5.0)}, time=np.array([0.0, 0.1, 0.1, 0.05, 0.3]))
    assert one_row_per_stamp(record) is record


@pytest.mark.parametrize("row", [149, 150, 151, 80])
def test_parts_of_a_file_follow_the_same_rule(row, tmp_path):
    path = write(tmp_path / "run.csv", repeated(columns(), [row]))
    parts = list(read_chunks(path, 151))
    assert sum(p.n_samples for p in parts) == N
    whole, = lpv.read(path)
    np.testing.assert_array_equal(np.concatenate([p["force"] for p in parts]), whole["force"])
    found = lpv.identify_stream(read_chunks(path, 151), lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force"))
    assert found.training is None or found.training.overall.free_run.n_samples == N - 1
    bad = repeated(columns(), [row])
    bad["force [N]"][row + 1] += 1.0
    with pytest.raises(InputError, match="time repeats in row"):
        lpv.identify_stream(read_chunks(write(path, bad), 151),
                            lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force"))


@pytest.mark.parametrize("rows", [2, 3, 5, 7])
@pytest.mark.parametrize("messages", [2, 3, 6])
def test_parts_of_a_bus_are_the_record_in_memory(rows, messages, tmp_path):
    """Rows of one stamp complete each other, on whichever side of the end of a part they stand."""
    path, cells = tmp_path / "bus.csv", []
    for k in range(8):
        cells += [[f"{0.1 * k:.1f}", *("" for _ in range(messages))] for _ in range(messages)]
        for m in range(messages):
            cells[m - messages][1 + m] = str(100 * m + k)
    header = ["time [s]", *(f"c{m} [N]" for m in range(messages))]
    path.write_text("\n".join(",".join(row) for row in [header, *cells]), encoding="utf-8")
    whole, = lpv.read(path)
    chunks = read_chunks(path, rows)
    placed = list(chunks.located())
    for name in whole.channels:
        together = np.concatenate([part[name] for _, part in placed])
        np.testing.assert_array_equal(together, whole[name])
        assert np.isfinite(together).all()
    for i, (place, _) in enumerate(placed):  # and from where a stream was left
        again = [part["c0"] for _, part in chunks.located(place)]
        np.testing.assert_array_equal(np.concatenate([*(p["c0"] for _, p in placed[: i + 1]), *again]), whole["c0"])


@pytest.mark.parametrize("run", [lambda m, r: lpv.simulate(m, r).output, lambda m, r: lpv.predict(m, r, 1).output])
def test_a_channel_that_the_model_does_not_use_may_contradict_itself(run):
    """A second temperature at one stamp is no matter to a model of velocity and force."""
    table = repeated(columns(), [50, 51, 300])
    model = lpv.identify(columns(), lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")).model
    expected = run(model, columns())
    table["temperature [K]"] = table["temperature [K]"] + np.arange(len(table["time [s]"]))
    np.testing.assert_array_equal(run(model, table), expected)
    table["force [N]"][51] += 1.0
    with pytest.raises(InputError, match="time repeats in row 52 with another value of 'force'"):
        run(model, table)
    table["force [N]"][51] -= 1.0
    table["velocity [m/s]"][51] += 1.0
    with pytest.raises(InputError, match="another value of 'velocity'"):
        run(model, table)


def test_a_free_run_from_rest_does_not_read_the_output():
    table = repeated(columns(), [50])
    model = lpv.identify(columns(), lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")).model
    table["force [N]"][51] += 1.0
    expected = lpv.simulate(model, columns(), "zero").output
    np.testing.assert_array_equal(lpv.simulate(model, table, "zero").output, expected)


def data_set(folder: Path, *tables: dict[str, list[float]]) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder.mkdir()
    for k, table in enumerate(tables):
        pq.write_table(pa.table(table), folder / f"part-{k}.parquet")
    return folder


def test_a_stamp_over_two_files_of_a_data_set_keeps_units_and_columns(tmp_path):
    first = {"time [s]": [0.0, 0.1, 0.2, 0.3], "v [m/s]": [1.0, 2.0, 3.0, NAN], "F [N]": [10.0, 20.0, 30.0, 40.0]}
    second = {"time [s]": [0.3], "v [mm/s]": [4000.0], "T [degC]": [20.0]}
    (record,) = read_chunks(data_set(tmp_path / "run.parquet", first, second), 5)
    np.testing.assert_allclose(record["v"], [1, 2, 3, 4])
    np.testing.assert_allclose(record["F"], [10, 20, 30, 40])
    np.testing.assert_allclose(record["T"], [NAN, NAN, NAN, 293.15])


def test_a_lone_last_row_is_read_in_its_own_unit(tmp_path):
    first = {"time [s]": [0.0, 0.1, 0.2], "F [N]": [10.0, 20.0, 30.0]}
    (record,) = read_chunks(data_set(tmp_path / "run.parquet", first, {"time [s]": [0.3], "F [kN]": [0.04]}), 5)
    np.testing.assert_allclose(record["F"], [10, 20, 30, 40])
    other = data_set(tmp_path / "other.parquet", first, {"time [s]": [0.3], "F [mm]": [0.04]})
    with pytest.raises(InputError, match=r"part-1\.parquet: column 'F' has another unit than in the file before"):
        list(read_chunks(other, 5))


def test_two_values_at_one_time_in_a_later_part_are_refused_with_the_row_of_the_file(tmp_path):
    def written() -> Path:
        text = "\n".join(",".join(f"{x:.9g}" for x in row) for row in zip(*data.values(), strict=True))
        path = tmp_path / "run.csv"
        path.write_text(",".join(data) + "\n" + text)
        return path

    data = columns()
    data["time [s]"][400] = data["time [s]"][399]
    path, structure = written(), lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")
    for chunked in (read_chunks(path, 150), read_chunks(path, 1000)):
        with pytest.raises(InputError, match="time repeats in row 401 with another value of 'velocity'"):
            lpv.identify(chunked, structure)
    for name in ("velocity [m/s]", "force [N]"):
        data[name][400] = data[name][399]
    data["temperature [K]"][400] += 1  # not in use
    found = lpv.identify(read_chunks(written(), 150), structure)
    assert found.training.overall.free_run.fit_percent > 90
