"""What test benches write around and into their tables: preambles, rows of units, dates, other names of time."""

import re

import numpy as np
import pytest

import lpvid as lpv
from lpvid.condition import segments
from lpvid.errors import InputError
from lpvid.files import _parts, csv
from lpvid.files._stamps import Midnight
from lpvid.files.streaming import read_chunks

TIMES = np.arange(40) / 500
FORCE = 100.0 + np.arange(40)
STROKE = 0.5 * np.arange(40)
PLAIN = "time [s],displacement [mm],force [kN]\n"
PREAMBLE = "MTS793|MPT|ENU|1|2|/|.|:|1|0|0|A\nData Header: ; Time: 10 Sec\nStation: DAMPER 2\n\n"


def rows(delimiter=",", comma=False, stamps=None):
    """Lines of the table in mm and kN."""
    stamps = [f"{t:.3f}" for t in TIMES] if stamps is None else stamps
    cells = zip(stamps, STROKE, FORCE, strict=True)
    lines = [delimiter.join((stamp, f"{x:.4f}", f"{f / 1e3:.4f}")) for stamp, x, f in cells]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


LAYOUTS = {
    "preamble": PREAMBLE + "time [s];displacement [mm];force [kN]\n" + rows(";", comma=True),
    "preamble and units": PREAMBLE + "Time\tdisplacement\tforce\nSec\tmm\tkN\n" + rows("\t"),
    "preamble of short lines": "Customer,ACME\nRig,3\nOperator,Miss X\n" + PLAIN + rows(),
    "preamble of one name": "Rig,3\n" + PLAIN + rows(),
    "preamble padded by a spreadsheet": "Customer,ACME,\nRig,3,\n" + PLAIN + rows(),
    "preamble of as many cells": "Customer,ACME,Ltd\nRig,3,east\n" + PLAIN + rows(),
    "units in a row": "time,displacement,force\ns,mm,kN\n" + rows(),
    "units in brackets": "time,displacement,force\n[s],[mm],[kN]\n" + rows(),
    "dates": "time,displacement [mm],force [kN]\n" + rows(stamps=[
        *(f"2026-11-26T23:59:59.{990 + 2 * k:03d}" for k in range(5)),
        *(f"2026-11-27 00:00:00.{2 * k:03d}" for k in range(35))]),
    "dates with points": "time;displacement [mm];force [kN]\n" + rows(";", stamps=[
        f"26.11.2026 10:12:13,{2 * k:03d}" for k in range(40)]),
    "a preamble above dates": PREAMBLE + "time;displacement;force\n;mm;kN\n" + rows(";", comma=True, stamps=[
        f"26.11.2026 10:12:13.{2 * k:03d}" for k in range(40)]),
    "a first date in another notation": "time,displacement [mm],force [kN]\n" + rows(stamps=[
        "26.11.2026 10:12:13", *(f"2026-11-26T10:12:13.{2 * k:03d}" for k in range(1, 40))]),
    "times of day over midnight": "time,displacement [mm],force [kN]\n" + rows(stamps=[
        *(f"23:59:59.{960 + 2 * k:03d}" for k in range(20)), *(f"0:00:00.{2 * k:03d}" for k in range(20))]),
    "the end of summer time, with the offset": "time,displacement [mm],force [kN]\n" + rows(stamps=[
        *(f"2026-10-25T02:59:59.{960 + 2 * k:03d}+02:00" for k in range(20)),
        *(f"2026-10-25T02:00:00.{2 * k:03d}+01:00" for k in range(20))]),
    "times of day": "time,displacement [mm],force [kN]\n" + rows(stamps=[f"9:59:59.{2 * k:03d}" for k in range(40)]),
}


@pytest.mark.parametrize("text", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("parts", [False, True], ids=["whole", "in parts"])
def test_a_table_is_the_same_whatever_is_written_around_it(tmp_path, text, parts):
    path = tmp_path / "run.csv"
    path.write_text(text)
    records = list(read_chunks(path, 16)) if parts else lpv.read(path)
    np.testing.assert_allclose(np.concatenate([r["force"] for r in records]), FORCE, rtol=1e-12)
    np.testing.assert_allclose(np.concatenate([r["displacement"] for r in records]), STROKE / 1e3, rtol=1e-12)
    assert records[0].sample_time == pytest.approx(1 / 500, rel=1e-9)
    assert sum(r.n_samples for r in records) == 40
    assert np.concatenate([r.times for r in records])[-1] == pytest.approx(TIMES[-1], abs=1e-9)


def test_a_role_names_the_time_column(tmp_path):
    path = tmp_path / "fahrt.csv"
    path.write_text("Zeit [ms];Weg [mm];Kraft [kN]\n" + rows(";", comma=True, stamps=[f"{1e3 * t:.1f}" for t in TIMES]))
    roles = {"time": "Zeit", "force": "Kraft"}
    record, = lpv.read(path, roles=roles)
    assert record.sample_time == pytest.approx(1 / 500, rel=1e-9)
    np.testing.assert_allclose(record["force"], FORCE, rtol=1e-12)
    assert "Zeit" not in record.channels
    streamed = list(read_chunks(path, 16, roles=roles))
    assert np.concatenate([r["force"] for r in streamed]).tolist() == record["force"].tolist()
    with pytest.raises(InputError, match="--role time=Zeit"):
        lpv.read(path)
    with pytest.raises(InputError, match="no column 'Uhr'"):
        lpv.read(path, roles={"time": "Uhr"})


@pytest.mark.seconds
def test_a_role_names_the_time_column_of_a_parquet_file_in_parts(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    pyarrow = pytest.importorskip("pyarrow")
    path = tmp_path / "run.parquet"
    parquet.write_table(pyarrow.table({"Zeit [s]": TIMES, "Weg [m]": STROKE, "Kraft [N]": FORCE}), path)
    chunks = read_chunks(path, 16, roles={"time": "Zeit", "force": "Kraft"}).only(("force",))
    assert np.concatenate([r.times for r in chunks])[-1] == pytest.approx(TIMES[-1])


def test_a_date_that_does_not_say_which_number_is_the_month_is_refused(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(PLAIN + rows(stamps=[f"11/10/2026 10:12:13.{k:03d}" for k in range(40)]))
    with pytest.raises(InputError, match="2026-11-26T10:12:13"):
        lpv.read(path)


DATES = [f"2026-11-26T10:12:13.{2 * k:03d}" for k in range(40)]


@pytest.mark.parametrize("first", ["10:12:13.000", "0", "start", "2026-02-31T10:12:13.000", DATES[0] + "Z"])
@pytest.mark.parametrize("place", [0, 7])
def test_an_odd_stamp_is_named_and_sets_no_clock(tmp_path, first, place):
    path = tmp_path / "run.csv"
    path.write_text("time,displacement [mm],force [kN]\n" + rows(stamps=[*DATES[:place], first, *DATES[place + 1:]]))
    with pytest.raises(InputError, match=r"line \d+ of the file\).*alike") as refused:
        lpv.read(path)
    assert f"holds text '{first}' in row {place + 1} (line {place + 2} of the file). " in str(refused.value)


@pytest.mark.parametrize("parts", [False, True], ids=["whole", "in parts"])
def test_a_missing_first_stamp_leaves_the_clock_as_it_is(tmp_path, parts):
    path = tmp_path / "run.csv"
    path.write_text("time,displacement [mm],force [kN]\n" + rows(stamps=["", *DATES[1:]]))
    read = list(read_chunks(path, 40)) if parts else lpv.read(path)
    np.testing.assert_allclose(read[0].times[1:], TIMES[:-1], atol=1e-12)
    with pytest.raises(InputError, match=r"not a finite number in row 1.*restore its stamp"):
        segments(read, ("force",))


def test_a_first_row_from_another_day_is_a_gap(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,displacement [mm],force [kN]\n" + rows(stamps=["2026-11-25T23:00:00.000", *DATES[1:]]))
    record, = lpv.read(path)
    assert record.time_base.gaps == (1,)
    piece, = segments([record], ("force",))
    assert piece.n_samples == 39
    assert piece.sample_time == pytest.approx(1 / 500, rel=1e-6)


def test_chunks_that_begin_after_midnight_know_of_it(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(LAYOUTS["times of day over midnight"])
    late = next(iter(_parts.reader(path)(path, 10, 25, None)))
    np.testing.assert_allclose(late.columns[0].values, TIMES[25:35], atol=1e-9)


def clock(k):
    """Time of day of a number of milliseconds."""
    return f"{k // 3_600_000 % 24:02d}:{k // 60_000 % 60:02d}:{k // 1000 % 60:02d}.{k % 1000:03d}"


@pytest.mark.parametrize("hour, wrong", [(13, "00:00:00.000"), (23.9, "00:00:00.000"), (1, "23:00:00.000"),
                                         (10, "00:00:00.000")])
def test_one_wrong_time_of_day_is_no_midnight(tmp_path, hour, wrong):
    """A step of more than half a day that the next row undoes is a fault of that row; the rest stays where it is."""
    path = tmp_path / "run.csv"
    stamps = [clock(round(hour * 3_600_000) + 2 * k) for k in range(40)]
    stamps[20] = wrong
    path.write_text("time,displacement [mm],force [kN]\n" + rows(stamps=stamps))
    record, = lpv.read(path)
    np.testing.assert_allclose(np.delete(record.times, 20), np.delete(TIMES, 20), atol=1e-9)
    with pytest.raises(InputError, match="time runs backward in row 21"):
        segments([record], ("force",))


@pytest.mark.parametrize("place", [10, 20, 21])
def test_a_wrong_time_of_day_shifts_nothing_wherever_blocks_end(place):
    for wrong in (-46_800.0, 40_000.0):
        values = np.arange(40.0) - (0.0 if wrong < 0 else 40_000.0)
        values[20] = wrong
        carry = Midnight()
        carried = np.concatenate([carry.on(values[:place]), carry.on(values[place:])])
        np.testing.assert_array_equal(np.delete(carried, 20), np.delete(values, 20))
        assert (np.diff(carried) < 0).any()


def test_a_long_pause_after_midnight_is_a_gap():
    """Sessions over midnight, at noon, in the evening and the next morning."""
    minutes = np.arange(10) / 60
    starts = np.array([23.9, 37.0, 47.0, 58.0])[:, None] + minutes
    hours = starts.ravel()
    np.testing.assert_allclose(Midnight().on(3600 * (hours % 24)) / 3600, hours)


def test_rows_before_the_first_are_passed_over_in_blocks(tmp_path, monkeypatch):
    """Of the rows before, only stamps are parsed, once for a block; comments and blank lines are no rows."""
    path = tmp_path / "run.csv"
    lines = [f"{clock(36_000_000 + 10 * k)},{k}" for k in range(2000)]
    path.write_text("\n".join(["time,force [kN]", *lines[:5], "# a comment", "", *lines[5:]]) + "\n")
    late = next(iter(_parts.reader(path)(path, 500, 1500, None)))
    np.testing.assert_array_equal(late.columns[1].values, np.arange(1500, 2000))
    np.testing.assert_allclose(late.columns[0].values, 0.01 * np.arange(1500, 2000), atol=1e-9)
    blocks = []
    monkeypatch.setattr(_parts, "_passed", lambda block, *a, _passed=_parts._passed: blocks.append(len(block)) or
                        _passed(block, *a))
    next(iter(_parts.reader(path)(path, 500, 1500, None)))
    assert len(blocks) < 6


def test_text_in_the_first_row_is_no_header(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(PLAIN + rows().replace("0.000,0.0000", "0.000,off", 1))
    record, = lpv.read(path)
    assert record.n_samples == 40
    assert "off" in str(record.channels["displacement"].fault)


@pytest.mark.parametrize("first", ["NaN,NaN", ",", "NA,nan"])
def test_a_first_row_without_a_sample_is_no_header(tmp_path, first):
    path = tmp_path / "run.csv"
    path.write_text(f"displacement [mm],force [N]\n{first}\n" + "\n".join(f"{k},{2 * k}" for k in range(30)) + "\n")
    record, = lpv.read(path, sample_rate=100.0)
    assert list(record.channels) == ["displacement", "force"]
    assert np.isnan(record["force"][0])
    assert record["force"][-1] == 58.0
    assert record["displacement"][-1] == pytest.approx(0.029)


@pytest.mark.parametrize("above", ["Start,End\n10:12:13,10:13:00\n", "Time,Operator\n10:12:13,Miller\n",
                                   "Start,End\n2026-11-26T10:12:13,2026-11-26T10:13:00\nRig,3\n",
                                   "Start,End\n,10:13:00\n"])
@pytest.mark.parametrize("header", ["time [s],force [N]\n", "time,force\ns,N\n"], ids=["in one row", "in two"])
def test_stamps_in_a_preamble_are_no_samples(tmp_path, above, header):
    path = tmp_path / "run.csv"
    path.write_text(above + header + "".join(f"{k / 500},{k}\n" for k in range(30)))
    record, = lpv.read(path)
    assert list(record.channels) == ["force"]
    assert record.n_samples == 30
    assert record.sample_time == pytest.approx(1 / 500, rel=1e-9)


@pytest.mark.parametrize("above", ["Start,End\n10:12:13,10:13:00\n", "Rate,Rows\n500,40\n"])
def test_a_row_in_a_preamble_above_stamps_is_no_sample(tmp_path, above):
    path = tmp_path / "run.csv"
    path.write_text(f"{above}time,force [N]\n" + "".join(f"{s},1\n" for s in DATES))
    record, = lpv.read(path)
    assert list(record.channels) == ["force"]
    assert record.n_samples == 40


def test_an_odd_row_below_the_first_stays_a_fault(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time,force [N]\n" + "".join(f"{s},1\n" for s in [DATES[0], "noon", *DATES[2:]]))
    with pytest.raises(InputError, match="holds text 'noon' in row 2"):
        lpv.read(path)


def test_a_line_below_the_data_is_named_as_such(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(PLAIN + rows() + "End of test\n")
    with pytest.raises(InputError, match=r"line 42 has 1 cell.*below the data"):
        lpv.read(path)


def test_a_line_above_the_header_is_named_as_such(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("Customer,ACME\nRig,3\n" + "time,,force\n" + rows())
    with pytest.raises(InputError, match=r"line 3 has 3 cells.*above the header"):
        lpv.read(path)


@pytest.mark.parametrize("parts", [False, True], ids=["whole", "in parts"])
def test_a_role_states_the_unit_that_a_file_does_not(tmp_path, parts):
    path = tmp_path / "run.csv"
    path.write_text("t,x,F [kN]\n" + rows(stamps=[f"{1e3 * t:.1f}" for t in TIMES]))
    roles = {"time": "t [ms]", "displacement": "x [mm]", "force": "F"}
    records = list(read_chunks(path, 16, roles=roles).only(("displacement", "force"))) if parts else \
        lpv.read(path, roles=roles)
    np.testing.assert_allclose(np.concatenate([r["displacement"] for r in records]), STROKE / 1e3, rtol=1e-12)
    np.testing.assert_allclose(np.concatenate([r["force"] for r in records]), FORCE, rtol=1e-12)
    assert records[0].unit("x") == "m"
    assert records[0].sample_time == pytest.approx(1 / 500, rel=1e-9)
    with pytest.raises(InputError, match=r"states its own unit: got 'F \[kN\]' in the file, \[N\] in --role force.*"
                       "leave the unit out, --role force=F,"):
        lpv.read(path, roles={"force": "F [N]"})
    with pytest.raises(InputError, match=r"two roles.*'x': got \[mm\] in --role displacement, \[m\] in --role stroke"):
        lpv.read(path, roles={"time": "t [ms]", "displacement": "x [mm]", "stroke": "x [m]"})


@pytest.mark.parametrize(("header", "role", "factor"), [
    ("Force (lbs)", "force=Force [lbf]", 4.4482216152605), ("Force [kg]", "force=Force [kgf]", 9.80665),
    ("F (lb)", "force=F [lbf]", 4.4482216152605), ("acc_body (g)", "bounce=acc_body [g_0]", 9.80665),
    ("F [Nwt]", "force=F [daN]", 10.0)])
def test_a_role_states_the_unit_where_that_of_the_file_could_not_be_used(tmp_path, header, role, factor):
    path = tmp_path / "run.csv"
    path.write_text(f"t [s],x [mm],{header}\n" + rows())
    name, _, text = role.partition("=")
    record, = lpv.read(path, roles={name: text})
    np.testing.assert_allclose(record[name], factor * FORCE / 1e3, rtol=1e-6, atol=1e-3)
    assert any("is read in" in note and f"--role {name} states" in note for note in record.notes)
    assert not lpv.audit([record]).of("unit-contradicts-name")


def test_the_line_on_a_refused_unit_holds_the_option_that_mends_it(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t [s],x [mm],Force (lbs)\n" + rows())
    fault, = lpv.audit(lpv.read(path)).of("unit-contradicts-name")
    assert "--role 'force=Force [lbf]'" in fault.mend
    with pytest.raises(InputError, match=r"--role 'force=Force \[lbf\]'"):
        lpv.identify(lpv.read(path), lpv.ARX(input="x", output="Force"))
    assert not lpv.audit(lpv.read(path, roles={"force": "Force [lbf]"})).of("unit-contradicts-name")


def test_a_spreadsheet_is_to_be_saved_as_csv(tmp_path):
    path = tmp_path / "run.xlsx"
    path.write_bytes(b"PK")
    with pytest.raises(InputError, match=r"save the sheet as CSV; readable are \.csv"):
        lpv.read(path)


@pytest.mark.parametrize("header, above, names", [
    ("t,x,F", "Customer,Rig,Operator", ["x", "F"]),
    ("time,s,F", "Customer,Rig,Operator", ["s", "F"]),
    ("t,s,F", "Customer,Rig,Operator", ["s", "F"]),
    ("s,A,T", "time,current,field", ["current", "field"]),
])
def test_a_symbol_of_a_unit_in_a_header_is_a_name(tmp_path, header, above, names):
    path = tmp_path / "run.csv"
    path.write_text(f"{above}\n{header}\n" + rows())
    record, = lpv.read(path)
    assert list(record.channels) == names
    assert record.sample_time == pytest.approx(1 / 500, rel=1e-9)


@pytest.mark.parametrize(("delimiter", "written", "expected"), [
    (";", ["-1.024,735", "998,5", "12.345.678,25"], [-1024.735, 998.5, 12345678.25]),
    (";", ["1.024.735", "998", "-2.000.000"], [1024735.0, 998.0, -2e6]),
    ("\t", ["1,024.5", "998.5", "-1,000,000.5"], [1024.5, 998.5, -1000000.5]),
    (",", ['"1,024.5"', "998.5", '"-2,000,000"'], [1024.5, 998.5, -2e6]),
    (";", ["1.024", "1.345,25", "987,5"], [1024.0, 1345.25, 987.5]),
    ("\t", ["1,024", "12,345.25", "987.5"], [1024.0, 12345.25, 987.5]),
    (",", ["1.024", '"1.345,25"', "987"], [1024.0, 1345.25, 987.0]),
    (";", ["1'024,5", "998,5", "1\u202f024,5"], [1024.5, 998.5, 1024.5]),
])
def test_thousands_separators_are_read_where_they_have_one_meaning(delimiter, written, expected, tmp_path):
    path = tmp_path / "run.csv"
    point = "," if delimiter == ";" else "."
    rows = [delimiter.join(["time [s]", "force [N]"])]
    rows += [delimiter.join([f"{0.1 * k:.1f}".replace(".", point), cell]) for k, cell in enumerate(written)]
    path.write_text("\n".join(rows), encoding="utf-8")
    record, = lpv.read(path)
    assert record.channel("force").fault is None
    assert record["force"].tolist() == expected
    assert [r for c in read_chunks(path, 2) for r in c["force"].tolist()] == expected


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("place", [0, 3, 6])
def test_one_cell_shows_what_separates_thousands_in_a_column_wherever_it_stands(suffix, place, tmp_path, monkeypatch):
    """In another block than the cells that leave it open, in memory and in parts, read from the beginning or not."""
    monkeypatch.setattr(csv, "_BLOCK", 2)
    cells, truth = [f"{k}.024" for k in range(1, 8)], [1000.0 * k + 24 for k in range(1, 8)]
    cells[place], truth[place] = "1.345,25", 1345.25
    other = [f"{k}.5" for k in range(7)]  # of another column, whose point is of decimals
    path = tmp_path / f"run{suffix}"
    if suffix == ".csv":
        rows = [f"0,{k};{c};{o}" for k, (c, o) in enumerate(zip(cells, other, strict=True))]
        path.write_text("time [s];force [N];x [m]\n" + "\n".join(rows))
    else:
        pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        held = {"time [s]": [0.1 * k for k in range(7)], "force [N]": cells, "x [m]": [float(o) for o in other]}
        pq.write_table(pa.table(held), path, row_group_size=3)
    record, = lpv.read(path)
    assert record["force"].tolist() == truth
    assert record["x"].tolist() == [k + 0.5 for k in range(7)]
    chunks = read_chunks(path, 2)
    (_, begun), (behind, second), *rest = chunks.located()
    assert [f for part in (begun, second, *(p for _, p in rest)) for f in part["force"].tolist()] == truth
    assert [f for _, part in chunks.located(behind) for f in part["force"].tolist()] == truth[behind[2]:]


def test_what_thousands_separators_leave_open_stays_as_it_was(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time [s];force [N]\n0,0;1.024\n0,1;2,048\n0,2;1.02.4\n")
    record, = lpv.read(path)
    assert record["force"].tolist()[:2] == [1.024, 2.048]
    assert "'1.02.4' in row 3" in str(record.channel("force").fault)


@pytest.mark.parametrize("header", [
    "Time / s,Displacement / mm,Force / kN",  # ISO 80000-1
    "Time [Sec],Displacement [Millimeter],Force [Kilonewton]",
    "# time [s],displacement [mm],force [kN]",  # numpy.savetxt
    "# rig 3\n# time [s],displacement [mm],force [kN]",
    "% time [s],displacement [mm],force [kN]",  # MATLAB
    "% rig 3, by hand, made today\n%\n% time [s],displacement [mm],force [kN]",
    "Time / s,Displacement / (mm),Force / (kN)",
])
def test_headers_of_other_programs(tmp_path, header) -> None:
    path = tmp_path / "run.csv"
    path.write_text(header + "\n" + "\n".join(f"{0.01 * k:g},{k % 7},{k % 5}" for k in range(50)) + "\n")
    for record in (lpv.read(path)[0], *read_chunks(path)):
        names = list(record.channels)
        assert [n.casefold() for n in names] == ["displacement", "force"]
        assert [record.unit(n) for n in names] == ["m", "N"]
        assert record[names[0]][3] == pytest.approx(0.003) and record[names[1]][3] == pytest.approx(3000)


def test_a_comment_that_is_no_header_stays_one(tmp_path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("# made today, by me\n0,1\n1,2\n")
    with pytest.raises(InputError, match="line 2 holds numbers only"):
        lpv.read(path)


def test_an_error_value_of_a_spreadsheet_is_no_comment(tmp_path) -> None:
    """Its row was lost in silence."""
    path = tmp_path / "run.csv"
    path.write_text("force [N],time [s]\n1,0\n#DIV/0!,1\n3,2\n")
    record, = lpv.read(path)
    assert record.n_samples == 3 and "#DIV/0!" in str(record.channels["force"].fault)


@pytest.mark.parametrize(("header", "mend"), [
    ("time_ms,force", "--role 'time=time_ms [ms]'"), ("Zeit,force", "--role time=Zeit"),
    ("a.time,a.force", "--role time=a.time"), ("CH1,force", "--role time=COLUMN")])
def test_the_column_that_may_be_the_clock_is_proposed(tmp_path, header, mend) -> None:
    path = tmp_path / "run.csv"
    path.write_text(header + "\n0,1\n2,2\n4,1\n")
    with pytest.raises(InputError, match=re.escape(mend)):
        lpv.read(path)
