"""Input that is at fault: one line, exit code 2, nothing written. And what is a finding instead goes through."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app

pytestmark = pytest.mark.usefixtures("undrawn")
N, RATE = 400, 200.0
T = np.arange(N) / RATE
V = 0.1 * np.sin(2 * np.pi * 1.7 * T) + 0.05 * np.sin(2 * np.pi * 9.1 * T + 1) + 0.02 * np.sin(2 * np.pi * 23 * T)
CURRENT = np.repeat(np.random.default_rng(0).uniform(0, 2, N // 10), 10)
FORCE = (200 + 300 * CURRENT) * V + np.random.default_rng(1).standard_normal(N)
HEADER = "time [s],velocity [m/s],current [A],force [N]"


def table(header: str = HEADER, *, n: int = N, t=T, v=V, current=CURRENT, force=FORCE) -> str:
    rows = (",".join(x if isinstance(x, str) else repr(float(x)) for x in row)
            for row in zip(t[:n], v[:n], current[:n], force[:n], strict=True))
    return "\n".join([header, *rows]) + "\n"


def with_cell(values: np.ndarray, row: int, text: str) -> list:
    cells: list = [float(x) for x in values]
    cells[row] = text
    return cells


def mat_claim() -> bytes:
    """A MAT version 5 file whose header claims 10.4 GB and that holds one number."""
    body = (struct.pack("<4I", 6, 8, 6, 0) + struct.pack("<2I2i", 5, 8, 1_300_000_000, 1)
            + struct.pack("<2I", 1, 1) + b"x".ljust(8, b"\0") + struct.pack("<2Id", 9, 8, 1.0))
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<2I", 14, len(body)) + body


def corrupt_mat() -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + bytes(range(256)) * 8


def corrupt_parquet() -> bytes:
    return b"PAR1" + bytes(range(256)) * 4 + b"PAR1"


def nan_every(period: int) -> np.ndarray:
    v = V.copy()
    v[::period] = np.nan
    return v


JITTER = T + 0.15 / RATE * np.random.default_rng(2).uniform(-1, 1, N)
BACKWARD = np.where(np.arange(N) == 200, T - 20 / RATE, T)
REPEATED = np.where(np.arange(N) == 200, T - 1 / RATE, T)

BAD_DATA: dict[str, tuple[str, str | bytes, tuple[str, ...], tuple[str, ...]]] = {
    "missing column": ("a.csv", table(HEADER.replace("force", "load")), (), ("force", "load", "--role")),
    "unknown unit in use": ("a.csv", table(HEADER.replace("[N]", "[raw]")), (), ("force", "raw", "unit")),
    "text in use": ("a.csv", table(v=with_cell(V, 16, "abc")), (), ("velocity", "'abc'", "row 17")),
    "inf in use": ("a.csv", table(v=with_cell(V, 16, "inf")), (), ("velocity", "inf", "row 17")),
    "-inf in use": ("a.csv", table(force=with_cell(FORCE, 3, "-inf")), (), ("force", "-inf", "row 4")),
    "empty file": ("a.csv", "", (), ("a.csv", "empty")),
    "header only": ("a.csv", HEADER + "\n", (), ("a.csv", "no data")),
    "one row": ("a.csv", table(n=1), (), ("too few rows",)),
    "two rows": ("a.csv", table(n=2), (), ("2",)),
    "no segment long enough": ("a.csv", table(v=nan_every(5)), (), ("long",)),
    "all NaN": ("a.csv", table(v=np.full(N, np.nan)), (), ("holds no number",)),
    "jittered time": ("a.csv", table(t=JITTER), (), ("jitter", "--sample-rate")),
    "backward time": ("a.csv", table(t=BACKWARD), (), ("backward", "row 201")),
    "repeated time": ("a.csv", table(t=REPEATED), (), ("repeats", "row 201")),
    "constant current": ("a.csv", table(current=np.full(N, 1.25)), (), ("current", "constant")),
    "two levels, degree 2": ("a.csv", table(current=np.where(CURRENT > 1, 2.0, 0.0)), ("--degree", "2"),
                             ("current", "2 levels")),
    "fewer samples than parameters": ("a.csv", table(n=18), (), ("equations", "parameters")),
    "10 GB claim": ("a.mat", mat_claim(), (), ("a.mat", "claims")),
    "corrupt mat": ("a.mat", corrupt_mat(), (), ("a.mat",)),
    "corrupt parquet": ("a.parquet", corrupt_parquet(), (), ("a.parquet",)),
    "binary as csv": ("a.csv", bytes(range(256)) * 8, (), ("a.csv", "not text")),
    "unknown format": ("a.xlsx", b"PK\x03\x04", (), ("a.xlsx", ".csv")),
    "noise orders of an arx": ("a.csv", table(), ("--nc", "2"), ("--nc", "arx", "--na")),
    "lags of a state space": ("a.csv", table(), ("--structure", "subspace", "--na", "2"), ("--na", "--order")),
    "an order of a bj": ("a.csv", table(), ("--structure", "bj", "--order", "2"), ("--order", "--nc")),
    "a shape that rls cannot fit": ("a.csv", table(), ("--structure", "recursive", "--shape", "tanh"), ("--shape",)),
    "auto with orders": ("a.csv", table(), ("--auto", "--degree", "2"), ("--auto", "--nk", "--degree")),
    "a budget without auto": ("a.csv", table(), ("--budget", "10"), ("--budget", "--auto")),
    "auto with a structure": ("a.csv", table(), ("--auto", "--structure", "oe"), ("--auto", "--structure")),
    "a delay of two states": ("a.csv", table(), ("--structure", "pem-ss", "--nk", "2"), ("--nk 2", "order")),
    "a form of a state space": ("a.csv", table(), ("--structure", "coprime", "--form", "observable"), ("--form",)),
    "a trial without a trial": ("a.csv", table(), ("--structure", "quasi", "--on", "output", "--trial", "2"),
                                ("--trial", "--on output")),
    "refit without held-out": ("a.csv", table(), ("--refit",), ("--refit", "--hold-out")),
    "two inputs of a compliance": ("a.csv", table(), ("--structure", "compliance", "--input", "velocity,current"),
                                   ("compliance", "--side")),
    "a side of an arx": ("a.csv", table(), ("--side", "displacement"), ("--side", "arx")),
    "too much forgetting": ("a.csv", table(), ("--structure", "recursive", "--forgetting", "1.5"), ("forgetting",)),
    "an unknown structure": ("a.csv", table(), ("--structure", "arxx"), ("arxx", "arx")),
    "input is output": ("a.csv", table(), ("--input", "force"), ("input and output",)),
    "two nb for one input": ("a.csv", table(), ("--nb", "3,4"), ("nb",)),
    "nb is no number": ("a.csv", table(), ("--nb", "four"), ("--nb", "four")),
    "nothing held out": ("a.csv", table(), ("--hold-out", "0"), ("--hold-out", "between 0 and 1")),
    "hold-out is no share": ("a.csv", table(), ("--hold-out", "some"), ("--hold-out", "1/3")),
    "a role without channel": ("a.csv", table(), ("--role", "force"), ("--role", "ROLE=CHANNEL")),
    "a role of an absent channel": ("a.csv", table(), ("--role", "force=F"), ("F", "force")),
    "flip in files that are not there": ("a.csv", table(), ("--flip", "force@b*"), ("force@b*", "'b*'", "got a")),
    "flip without a channel": ("a.csv", table(), ("--flip", "@a"), ("--flip @a",)),
    "flip of an absent channel in one file": ("a.csv", table(), ("--flip", "F@a*"), ("F", "force")),
    "flip of an absent channel": ("a.csv", table(), ("--flip", "F"), ("F", "force")),
    "negative rate": ("a.csv", table(), ("--sample-rate", "-5"), ("--sample-rate", "-5")),
    "form of many outputs": ("a.csv", table(), ("--output", "force,current", "--schedule", "",
                                                "--form", "controllable"), ("controllable",)),
}


def refused(tmp_path: Path, *arguments: object, parts: tuple[str, ...] = ()) -> str:
    """The command's one line; checks exit code, silence on standard output, and that nothing appeared."""
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")}
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 2, result.output
    lines = result.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), result.stderr
    assert result.stdout == ""
    for part in parts:
        assert part in lines[0], lines[0]
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*")} == before
    return lines[0]


@pytest.mark.parametrize("case", BAD_DATA, ids=str)
def test_bad_data(tmp_path, case):
    name, content, options, parts = BAD_DATA[case]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    schedule = () if "--schedule" in options else ("--schedule", "current")
    delay = () if "compliance" in options or "--nk" in options else ("--nk", 0)
    refused(tmp_path, "identify", tmp_path / name, *schedule, *delay, *options, "--out", tmp_path / "out",
            parts=parts)


def test_the_same_without_a_chosen_delay(tmp_path):
    """The delay search meets bad data first: its complaint is as short."""
    for name in ("constant current", "fewer samples than parameters", "no segment long enough"):
        file, content, _, parts = BAD_DATA[name]
        (tmp_path / file).write_text(str(content))
        refused(tmp_path, "identify", tmp_path / file, "--schedule", "current", "--out", tmp_path / "out", parts=parts)


@pytest.mark.parametrize("command", ["inspect", "identify"])
def test_no_such_file(tmp_path, command):
    refused(tmp_path, command, tmp_path / "none.csv", "--out", tmp_path / "out", parts=("none.csv", "no such file"))
    refused(tmp_path, command, str(tmp_path / "*.csv"), "--out", tmp_path / "out", parts=("no file matches",))


@pytest.mark.parametrize(("name", "mend"), [("run.parquet", "run; a table's format is --format parquet"),
                                            ("report.html", "report."), ("damper.fmu", "damper."),
                                            ("unit.c", "unit.")])
def test_a_folder_that_is_called_like_a_file(tmp_path, name, mend):
    (tmp_path / "a.csv").write_text(table())
    refused(tmp_path, "inspect", tmp_path / "a.csv", "--out", tmp_path / name,
            parts=("--out names a folder: got", name, f"Mend: --out {tmp_path}/{mend}"))
    (tmp_path / name).mkdir()  # one that is there is meant
    done = CliRunner().invoke(app, ["inspect", str(tmp_path / "a.csv"), "--out", str(tmp_path / name)])
    assert done.exit_code == 0, done.output


def test_records_of_different_rates(tmp_path):
    (tmp_path / "a.csv").write_text(table())
    (tmp_path / "b.csv").write_text(table(t=2 * T))
    refused(tmp_path, "identify", tmp_path / "a.csv", tmp_path / "b.csv", "--schedule", "current",
            parts=("rates", "--sample-rate"))


def test_a_file_twice(tmp_path):
    (tmp_path / "a.csv").write_text(table())
    refused(tmp_path, "identify", tmp_path / "a.csv", "--held-out", tmp_path / "a.csv", "--schedule", "current",
            parts=("a.csv", "training and held-out"))


def test_out_is_a_file(tmp_path):
    (tmp_path / "a.csv").write_text(table())
    (tmp_path / "out").write_text("mine")
    refused(tmp_path, "inspect", tmp_path / "a.csv", "--out", tmp_path / "out", parts=("--out", "file"))


def test_a_scheduling_channel_that_is_not_there(tmp_path):
    (tmp_path / "a.csv").write_text(table())
    refused(tmp_path, "inspect", tmp_path / "a.csv", "--schedule", "voltage", parts=("voltage", "current"))


# -- model files ------------------------------------------------------------------------------------------------------
@pytest.fixture
def good_model(tmp_path) -> dict:
    model = lpv.LPVTransferFunction.siso([[-0.5, 0.1]], [[1.0, 0.0]], lpv.Polynomial("current", degree=1), 1 / RATE,
                                         scheduling=lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",)),
                                         inputs="velocity", outputs="force")
    lpv.save(model, tmp_path / "model.json")
    return json.loads((tmp_path / "model.json").read_text())


BAD_MODELS: dict[str, tuple[Callable[[dict], str], tuple[str, ...]]] = {
    "another schema": (lambda d: json.dumps({**d, "schema": "lpvid/validation/1"}), ("schema",)),
    "another package": (lambda d: json.dumps({**d, "schema": "other/model/1"}), ("schema",)),
    "no schema": (lambda d: json.dumps({k: v for k, v in d.items() if k != "schema"}), ("schema",)),
    "a newer version": (lambda d: json.dumps({**d, "schema": "lpvid/model/99"}), ("newer", "99")),
    "another kind": (lambda d: json.dumps({**d, "kind": "neural"}), ("neural",)),
    "a missing key": (lambda d: json.dumps({k: v for k, v in d.items() if k != "b"}), ("'b'",)),
    "another shape": (lambda d: json.dumps({**d, "a": [1.0, 2.0, 3.0]}), ("model.json",)),
    "a coefficient that is no number": (lambda d: json.dumps(d).replace("-0.5", "NaN"), ("NaN",)),
    "cut in the middle": (lambda d: json.dumps(d)[:200], ("JSON",)),
    "empty": (lambda d: "", ("JSON",)),
    "a list": (lambda d: "[1, 2]", ("model.json",)),
}


@pytest.mark.parametrize("case", BAD_MODELS, ids=str)
def test_bad_models(tmp_path, good_model, case):
    spoil, parts = BAD_MODELS[case]
    (tmp_path / "model.json").write_text(spoil(good_model))
    (tmp_path / "a.csv").write_text(table())
    refused(tmp_path, "stability", tmp_path / "model.json", "--out", tmp_path / "out", parts=parts)
    refused(tmp_path, "validate", tmp_path / "model.json", tmp_path / "a.csv", "--out", tmp_path / "out", parts=parts)


@pytest.mark.parametrize("options, parts", [
    (("--rate", "-1"), ("rate", "negative")), (("--rate", "fast"), ("--rate", "fast")),
    (("--rate", "voltage=1"), ("voltage",)), (("--range", "2"), ("--range", "A:B")),
    (("--range", "2:1"), ("lower end",)), (("--range", "voltage=0:1"), ("voltage", "current")),
    (("--range", "a:b"), ("--range", "a")),
])
def test_bad_stability_options(tmp_path, good_model, options, parts):
    refused(tmp_path, "stability", tmp_path / "model.json", *options, "--out", tmp_path / "out", parts=parts)


def test_stability_of_something_else(tmp_path, monkeypatch):
    monkeypatch.setattr("lpvid.export.serialise.load", lambda path: object())
    refused(tmp_path, "stability", "m.json", parts=("m.json", "transfer function"))


def test_validate_misses_a_channel(tmp_path, good_model):
    (tmp_path / "a.csv").write_text(table(HEADER.replace("current", "amps")))
    refused(tmp_path, "validate", tmp_path / "model.json", tmp_path / "a.csv", parts=("current", "amps"))
    refused(tmp_path, "validate", tmp_path / "model.json", tmp_path / "a.csv", "--schedule", "amps,force",
            parts=("--schedule", "current"))


@pytest.mark.parametrize("command", ["validate", "compare"])
def test_a_measured_output_that_never_moves_has_no_figures(tmp_path, good_model, command):
    (tmp_path / "model.json").write_text(json.dumps(good_model))
    (tmp_path / "a.csv").write_text(table(force=np.full(N, 100.0)))
    refused(tmp_path, command, tmp_path / "model.json", tmp_path / "a.csv", "--out", tmp_path / "out",
            parts=("'force'", "never moves", "lpvid simulate"))


def test_held_out_records_without_motion_of_the_output_are_refused_before_the_fit(tmp_path):
    (tmp_path / "a.csv").write_text(table())
    (tmp_path / "b.csv").write_text(table(force=np.full(N, 100.0)))
    refused(tmp_path, "identify", tmp_path / "a.csv", "--held-out", tmp_path / "b.csv", "--input", "velocity",
            "--output", "force", "--schedule", "current", "--out", tmp_path / "out",
            parts=("'force'", "the held-out records"))


# -- findings that are no errors --------------------------------------------------------------------------------------
@pytest.mark.thinned(3)
@pytest.mark.parametrize("content, names", [
    (table(HEADER.replace("[N]", "[raw]")), ["unknown-unit"]),
    (table(v=with_cell(V, 16, "abc")), []),
    (table(v=with_cell(V, 16, "inf")), []),
    (table(v=nan_every(5)), []),
    (table(v=np.full(N, np.nan)), []),
    (table(t=JITTER), []),
    (table(t=BACKWARD), []),
    (table(t=REPEATED), []),
    (table(current=np.full(N, 1.25)), []),
    (table(force=-FORCE), ["reversed-polarity"]),
    (table(n=1), []),
    (table(n=2), []),
    (table(HEADER.replace("force", "load").replace("velocity", "speed")), []),
    (table(t=np.where(np.arange(N) > 200, T + 1, T)), []),
    ("time [s],x\n0,1\n,2\n0.2,3\n", []),
])
def test_inspect_takes_whatever_parses(tmp_path, content, names):
    (tmp_path / "a.csv").write_text(content)
    result = CliRunner().invoke(app, ["inspect", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out")],
                                catch_exceptions=False)
    assert result.exit_code == 0
    found = {f["name"] for f in json.loads((tmp_path / "out" / "audit.json").read_text())["findings"]}
    assert set(names) <= found
    assert found, "every one of these has something to say"


def test_a_velocity_in_a_unit_of_length_is_not_compared_with_itself(tmp_path):
    (tmp_path / "a.csv").write_text(table(HEADER.replace("m/s", "cm")))
    found = json.loads(CliRunner().invoke(app, ["inspect", str(tmp_path / "a.csv"), "--json"]).stdout)["findings"]
    assert "unit-contradicts-name" in {f["name"] for f in found}
    assert not any(f["name"].startswith("velocity-") for f in found)


@pytest.mark.parametrize("out", ["x" * 300, "model.csv/x"])
def test_a_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path, out):
    (tmp_path / "model.csv").write_text(table())
    refused(tmp_path, "inspect", tmp_path / "model.csv", "--out", tmp_path / out, parts=("--out",))


def test_a_name_that_no_file_can_have(tmp_path):
    refused(tmp_path, "inspect", "x" * 300 + ".csv", parts=("xxx",))


def identified(tmp_path: Path, content: str, *options: object) -> dict:
    (tmp_path / "a.csv").write_text(content)
    result = CliRunner().invoke(app, ["identify", str(tmp_path / "a.csv"), "--schedule", "current", "--na", "1", "--nb",
                                      "1", "--nk", "0", *map(str, options), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def names(described: dict) -> set[str]:
    return {f["name"] for f in described["audit"]["findings"]}


def test_missing_samples_cut_the_record(tmp_path):
    v = V.copy()
    v[150:153] = np.nan
    described = identified(tmp_path, table(v=v))
    assert [r["name"] for r in described["training"]["records"]] == ["a#1", "a#2"]
    assert [r["n_samples"] for r in described["training"]["records"]] == [150, N - 153]
    assert names(described) & {"missing", "missing-samples", "gaps"} or any("miss" in n for n in names(described))


def test_a_gap_in_time_cuts_the_record(tmp_path):
    described = identified(tmp_path, table(t=np.where(np.arange(N) >= 200, T + 1.0, T)))
    assert [r["n_samples"] for r in described["training"]["records"]] == [200, 200]


def test_reversed_polarity_is_kept_and_said(tmp_path):
    described = identified(tmp_path, table(force=-FORCE))
    assert "reversed-polarity" in names(described)
    turned = identified(tmp_path, table(force=-FORCE), "--flip", "force")
    assert "reversed-polarity" not in names(turned)
    assert any("turned on request" in note for note in turned["notes"])
    kept = {p["name"]: p["value"] for p in described["parameters"]}
    other = {p["name"]: p["value"] for p in turned["parameters"]}
    assert kept["b0[1]"] == pytest.approx(-other["b0[1]"], rel=1e-9) and kept["b0[1]"] < 0


@pytest.mark.seconds
def test_reversed_polarity_travels_with_the_model(tmp_path):
    (tmp_path / "a.csv").write_text(table(force=-FORCE))
    CliRunner().invoke(app, ["identify", str(tmp_path / "a.csv"), "--schedule", "current", "--nk", "0", "--out",
                             str(tmp_path / "out")], catch_exceptions=False)
    assert lpv.load(tmp_path / "out" / "model.json").metadata["polarity"] == "reversed"


def test_unknown_unit_on_an_unused_channel(tmp_path):
    rows = table().splitlines()
    content = "\n".join([rows[0] + ",extra [raw]", *(f"{row},{i}" for i, row in enumerate(rows[1:]))]) + "\n"
    assert "unknown-unit" in names(identified(tmp_path, content))


def test_jitter_with_a_sample_rate(tmp_path):
    described = identified(tmp_path, table(t=JITTER), "--sample-rate", 100)
    assert described["training"]["records"][0]["n_samples"] == pytest.approx(N / 2, abs=2)


@pytest.mark.parametrize("options", [("--hold-out", "last-third"), (), ("--chunk", "100")])
@pytest.mark.parametrize("rows", [1, 3])
def test_text_is_named_before_the_record_is_called_too_short(tmp_path, rows, options) -> None:
    """Also where a held-out part is cut off first: of one row, or without the row of the text."""
    path = tmp_path / "run.csv"
    path.write_text(table(n=rows, v=with_cell(V, 0, "abc")))
    found = CliRunner().invoke(app, ["identify", str(path), "--input", "velocity", "--output", "force", *options])
    assert found.exit_code == 2 and "got text 'abc' in row 1 (line 2 of the file)" in found.stderr
