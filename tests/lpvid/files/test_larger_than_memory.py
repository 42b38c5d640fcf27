"""identify, audit and validate on files read in parts: the result of the whole; going on behind the last part."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks, read_chunks
from lpvid.identification.recursive import Recursive
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.record import Record
from lpvid.validation.streamed import LagSums, validate_stream

TS = 0.002
PLAIN = lpv.ARX(2, 2, 1, "velocity", "force", lpv.Polynomial("current", degree=1), affine=1)
FILTERED = replace(PLAIN, schedule_filter=SchedulingLag(0.01, 0.02))


def measured(samples: int = 6000, seed: int = 0) -> Record:
    """A damper with a lagged current; virtual."""
    rng = np.random.default_rng(seed)
    v, current = rng.normal(0, 0.1, samples), 1 + 0.9 * np.sin(0.003 * np.arange(samples) + seed)
    force = np.zeros(samples)
    for k in range(1, samples):
        force[k] = 0.6 * force[k - 1] + (800 + 300 * current[k]) * v[k - 1] + rng.normal(0, 2)
    channels = {"velocity": v, "current": current, "force": force + 20.0}
    return Record(channels, sample_time=TS, name="run", units={"velocity": "m/s", "current": "A", "force": "N"})


def parquet(path: Path, record: Record, first: int, last: int, clock: bool = True) -> None:
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    columns = {f"{n} [{record.unit(n)}]": record[n][first:last] for n in record.channels}
    head = {"time [s]": record.times[first:last]} if clock else {}
    table = pa.table({**head, **columns, "remark": ["x"] * (last - first)})
    pq.write_table(table.replace_schema_metadata({"sample_time": str(TS)}), path, row_group_size=700)


@pytest.fixture(params=["parquet", "data set", "unclocked", "mdf", "csv"])
def stored(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Chunks, Record]:
    """The same samples in a file of each kind, read in parts, and whole."""
    record, kind = measured(), request.param
    path = tmp_path / "run.parquet"
    if kind == "parquet":
        parquet(path, record, 0, 6000)
    elif kind in ("data set", "unclocked"):
        path.mkdir()
        for k, (a, b) in enumerate(((0, 2500), (2500, 2501), (2501, 6000))):
            parquet(path / f"part-{k}.parquet", record, a, b, clock=kind == "data set")
    elif kind == "mdf":
        asammdf = pytest.importorskip("asammdf")
        path = tmp_path / "run.mf4"
        with asammdf.MDF(version="4.10") as file:
            file.append([asammdf.Signal(record[n], record.times, unit=record.unit(n), name=n)
                         for n in record.channels])
            file.save(path)
    else:
        path = tmp_path / "run.csv"
        rows = np.column_stack([record.times, *(record[n] for n in record.channels)])
        np.savetxt(path, rows, fmt="%.17g", delimiter=",", comments="",
                   header="time [s],velocity [m/s],current [A],force [N]")
    return read_chunks(path, rows=900), record


@pytest.mark.thinned(3)
@pytest.mark.parametrize("structure", [PLAIN, FILTERED, Recursive(PLAIN, forgetting=1.0)],
                         ids=["plain", "filter", "rls"])
def test_the_estimate_of_the_parts_is_that_of_the_whole(stored: tuple[Chunks, Record], structure: lpv.ARX) -> None:
    chunks, whole = stored
    parts, one = lpv.identify(chunks, structure), lpv.identify(whole, structure)
    np.testing.assert_allclose(parts.parameters, one.parameters, rtol=1e-10, atol=1e-10)
    assert parts.n_samples == one.n_samples == 5998
    assert parts.training is not None and one.training is not None
    for kind in ("free_run", "one_step"):
        mine, other = getattr(parts.training.overall, kind), getattr(one.training.overall, kind)
        assert mine.esr == pytest.approx(other.esr, rel=1e-9)
        assert (mine.n_samples, mine.rmse_unit) == (other.n_samples, other.rmse_unit)
        assert mine.mean_error == pytest.approx(other.mean_error, abs=1e-9)
    others = {t.name: t for t in one.training.residual_tests}
    for test in parts.training.residual_tests:
        assert test.statistic == pytest.approx(others[test.name].statistic, rel=1e-7), test.name
    assert parts.model.metadata["training"]["rows"] == one.model.metadata["training"]["rows"]
    for name, pair in one.model.metadata["training"]["ranges"].items():
        assert parts.model.metadata["training"]["ranges"][name] == pytest.approx(pair)


def test_gaps_and_missing_samples_are_cut_as_in_memory() -> None:
    whole = measured(4000)
    force = whole["force"].copy()
    force[[1500, 1501]] = np.nan
    holed = whole.with_channel("force", force, "N")
    parts = [holed.slice(a, a + 500) for a in range(0, 4000, 500) if a != 2500]
    model = lpv.identify(whole, PLAIN).model
    found = validate_stream(model, parts)
    pieces = [holed.slice(0, 1500), holed.slice(1502, 2500), holed.slice(3000, 4000)]
    one = lpv.validate(model, [replace(p, name=f"run#{k + 1}", time=None) for k, p in enumerate(pieces)])
    assert [r.name for r in found.records] == ["run#1", "run#2", "run#3"]
    for mine, other in zip(found.records, one.records, strict=True):
        assert mine.free_run.esr == pytest.approx(other.free_run.esr, rel=1e-9)
    assert found.overall.free_run.esr == pytest.approx(one.overall.free_run.esr, rel=1e-9)
    assert found.label == one.label == "training"


def test_a_run_that_diverges_says_where() -> None:
    whole = measured(2000)
    found = lpv.identify(whole, PLAIN)
    wild = found.model.replace(a=found.model.a * 6.0)
    parts = validate_stream(wild, [whole.slice(a, a + 100) for a in range(0, 2000, 100)])
    one = lpv.validate(wild, whole)
    assert parts.overall.free_run.esr is None and one.overall.free_run.esr is None
    assert abs(parts.overall.free_run.diverged_at - one.overall.free_run.diverged_at) < 5  # type: ignore[operator]


def test_lag_sums_are_the_covariances_of_the_whole(rng: np.random.Generator) -> None:
    x, y = rng.normal(5.0, 1.0, 300), rng.normal(-3.0, 2.0, 300)
    for parts in ([300], [7, 1, 50, 242], [1] * 300):
        sums, at = LagSums(20, 0), 0
        for size in parts:
            sums.add(x[at: at + size], y[at: at + size])
            at += size
        assert sums.close()
        a, b = x - x.mean(), y - y.mean()
        expected = [a[k:] @ b[: 300 - k] for k in range(21)]
        np.testing.assert_allclose(sums.total, expected, rtol=1e-9, atol=1e-9)


# -- going on ----------------------------------------------------------------------------------------------------------
class Broken(Chunks):
    """Parts of a file, the reading of which ends with an error after some."""

    def located(self, place: tuple[int, int, int] = (0, 0, 0)) -> Iterator[tuple[tuple[int, int, int], Record]]:
        for number, found in enumerate(super().located(place)):
            if number == 4:
                raise OSError("unplugged")
            yield found


@pytest.mark.thinned(3)
@pytest.mark.parametrize("structure", [PLAIN, FILTERED, Recursive(PLAIN, forgetting=0.999)],
                         ids=["plain", "filter", "rls"])
def test_a_stream_goes_on_behind_its_last_part(stored: tuple[Chunks, Record], structure: lpv.ARX,
                                               tmp_path: Path) -> None:
    chunks, _ = stored
    whole = lpv.identify_stream(chunks, structure)
    state, stated = tmp_path / "state.npz", []
    box = whole.model.box
    with pytest.raises(OSError, match="unplugged"):
        lpv.identify_stream(Broken(**vars(chunks)), structure, box=box, checkpoint=state)
    assert state.is_file()
    again = lpv.identify_stream(chunks, structure, box=box, checkpoint=state, report_progress=stated.append)
    assert stated[0].startswith("going on behind") and not state.exists()
    np.testing.assert_allclose(again.parameters, whole.parameters, rtol=1e-11, atol=1e-11)
    assert (again.n_samples, again.notes) == (whole.n_samples, whole.notes)
    mine, other = (dict(f.model.metadata["training"]) for f in (again, whole))
    usual = mine.pop("usual"), other.pop("usual")  # of stretches from each part, which begin elsewhere now
    assert usual[0]["current"] == pytest.approx(usual[1]["current"], abs=0.02) and mine == other


def test_a_state_of_other_data_is_no_state(tmp_path: Path) -> None:
    parquet(tmp_path / "run.parquet", measured(3000), 0, 3000)
    chunks, state = read_chunks(tmp_path / "run.parquet", rows=400), tmp_path / "state.npz"
    with pytest.raises(OSError, match="unplugged"):
        lpv.identify_stream(Broken(**vars(chunks)), PLAIN, box=lpv.identify_stream(chunks, PLAIN).model.box,
                            checkpoint=state)
    other = replace(PLAIN, na=1)
    stated: list[str] = []
    lpv.identify_stream(chunks, other, checkpoint=state, report_progress=stated.append)
    assert not any(s.startswith("going on") for s in stated)
    state.write_bytes(b"PK no state")
    lpv.identify_stream(chunks, PLAIN, checkpoint=state)


# -- audit -------------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_the_audit_of_the_parts_finds_what_stands_in_one_of_them() -> None:
    whole = measured(6000)
    v = whole["velocity"].copy()
    force = -1000 * v
    v[5100:5110] = np.nan
    wrong = whole.with_channel("force", force, "N").with_channel("velocity", v, "m/s").with_channel(
        "temperature", np.where(np.arange(6000) < 5900, 300.0, 301.0), "K")
    parts = [wrong.slice(a, a + 1000) for a in range(0, 6000, 1000)]
    from lpvid.auditing.streamed import audit_stream

    found, one = audit_stream(parts, scheduling=["current"]), lpv.audit(wrong, scheduling=["current"])
    assert {f.name for f in one.findings} <= {f.name for f in found.findings}
    assert found.of("reversed-polarity")[0].evidence.endswith("(in 6 of 6 parts)")
    missing, = found.of("missing-samples")
    assert missing.evidence.startswith("from 10 s:") and missing.evidence.endswith("(in 1 of 6 parts)")
    assert not found.of("constant-channel")  # it moves in the last part
    assert found.records == ("Record 'run': 6000 samples in 6 parts",)
    gap = audit_stream([p for k, p in enumerate(parts) if k != 2]).of("time-gaps")
    assert "2 s, before this part" in gap[0].evidence


# -- refusals and the command line -------------------------------------------------------------------------------------
def test_what_a_stream_cannot_do_is_one_line(tmp_path: Path) -> None:
    parquet(tmp_path / "run.parquet", measured(2000), 0, 2000)
    chunks = read_chunks(tmp_path / "run.parquet", rows=300)
    with pytest.raises(InputError, match="only ARX and Recursive"):
        lpv.identify(chunks, lpv.OutputError(2, 2, 1, "velocity", "force"))
    with pytest.raises(InputError, match="keeps its own rate"):
        lpv.identify(chunks, PLAIN, sample_rate=100.0)
    model = lpv.identify(chunks, PLAIN).model
    with pytest.raises(InputError, match="free run and one step"):
        lpv.validate(model, chunks, horizons=[5])
    with pytest.raises(InputError, match="equation or output noise"):
        validate_stream(lpv.realize(model, form="controllable").model, chunks)
    with pytest.raises(InputError, match="needs its velocity"):
        lpv.identify_stream([Record({"displacement": np.zeros(9), "force": np.zeros(9)}, sample_time=TS)],
                            lpv.ARX(1, 1, 1, "velocity", "force"))
    (tmp_path / "empty.parquet").mkdir()
    with pytest.raises(InputError, match="holds no file"):
        read_chunks(tmp_path / "empty.parquet")


@pytest.mark.seconds
@pytest.mark.usefixtures("undrawn")
def test_the_commands_read_in_parts(tmp_path: Path) -> None:
    parquet(tmp_path / "run.parquet", measured(5000), 0, 5000)
    parquet(tmp_path / "other.parquet", measured(3000, seed=1), 0, 3000)
    words = ["--input", "velocity", "--output", "force", "--schedule", "current", "--na", "2", "--nb", "2", "--nk", "1"]

    def run(*more: str) -> dict:
        result = CliRunner().invoke(app, [*more, "--json"])
        assert result.exit_code == 0, result.output
        return json.loads(result.stdout)

    out = tmp_path / "model"
    parts = run("identify", str(tmp_path / "run.parquet"), *words, "--chunk", "700", "--held-out",
                str(tmp_path / "other.parquet"), "--out", str(out))
    one = run("identify", str(tmp_path / "run.parquet"), *words, "--held-out", str(tmp_path / "other.parquet"))
    for mine, other in zip(parts["parameters"], one["parameters"], strict=True):
        assert mine["value"] == pytest.approx(other["value"], rel=1e-9)
    assert parts["held_out"]["overall"]["free_run"]["esr"] == pytest.approx(
        one["held_out"]["overall"]["free_run"]["esr"], rel=1e-8)
    assert sorted(p.name for p in out.iterdir() if not p.name.startswith(".")) == ["identification.json", "model.json",
                                                                                    "report.html"]
    checked = run("validate", str(out / "model.json"), str(tmp_path / "other.parquet"), "--chunk", "700")
    assert checked["overall"]["free_run"]["esr"] == pytest.approx(parts["held_out"]["overall"]["free_run"]["esr"])
    assert run("inspect", str(tmp_path / "run.parquet"), "--chunk", "1000")["schema"] == "lpvid/audit/1"
    for wrong, stated in ((["--auto"], "--auto"), (["--structure", "oe"], "arx and recursive"), (["--hold-out", "1/3"],
                        "--hold-out"), (["--shape", "tanh"], "cannot fit an input stage")):
        result = CliRunner().invoke(app, ["identify", str(tmp_path / "run.parquet"), *words, "--chunk", "700", *wrong])
        assert result.exit_code == 2 and stated in result.stderr, result.output
