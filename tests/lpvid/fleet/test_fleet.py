"""Fleets: one result per file, one model of all, who differs; workers that die and files that cannot be used."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
import subprocess
import threading
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.cli.fleet import _table
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks
from lpvid.fleet import differing, plan_fleet, run_fleet, running, steps
from lpvid.fleet.causes import read_causes
from lpvid.fleet.differing import (
    departure,
    differing_parameters,
    differing_residuals,
    either,
    needed_score,
    residual_level,
    shift,
)
from lpvid.fleet.running import FleetResult, connected
from lpvid.fleet.state import StepOutcome, keep, outcome
from lpvid.fleet.steps import _here, audit
from lpvid.identification.regression import Factor
from lpvid.identification.streaming import merged_factor, stream_factor
from lpvid.plot.fleet import departures
from lpvid.report import render
from lpvid.report.fleet import fleet_page

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
STRUCTURE = lpv.ARX(2, 2, 0, "velocity", "force", lpv.Polynomial("current", degree=1), affine=1)


def specimen(k: int, friction: float = 0.0, samples: int = 1500) -> lpv.Record:
    """A damper of a series with 3 % spread; virtual."""
    rng = np.random.default_rng(k)
    v = np.zeros(samples)
    for n in range(1, samples):
        v[n] = 0.95 * v[n - 1] + 0.05 * rng.normal()
    current = 1 + 0.9 * np.sin(0.01 * np.arange(samples) + k)
    force = (1000 * (1 + 0.03 * rng.normal()) + 400 * current) * v + friction * np.sign(v) + rng.normal(0, 3, samples)
    return lpv.Record({"velocity": v, "current": current, "force": force}, sample_time=0.002, name=f"d{k:02d}",
                      units={"velocity": "m/s", "current": "A", "force": "N"})


def written(record: lpv.Record, folder: Path) -> None:
    rows = np.column_stack([record.times, *(record[n] for n in record.channels)])
    np.savetxt(folder / f"{record.name}.csv", rows, fmt="%.10g", delimiter=",", comments="",
               header="time [s],velocity [m/s],current [A],force [N]")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("fleet")
    for k in range(12):
        written(specimen(k, friction=150.0 if k == 7 else 0.0), home)
    (home / "broken.csv").write_text("time [s],velocity [m/s]\n0,hello\n")
    return home


# -- factors -----------------------------------------------------------------------------------------------------------
def test_factors_of_parts_give_the_estimate_of_the_whole() -> None:
    whole = [specimen(k) for k in range(5)]
    box = lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",))
    parts = [stream_factor([r.slice(0, 700), r.slice(700, 1500)], STRUCTURE, box) for r in whole]
    merged = merged_factor([p.factor for p in parts], width=2)
    found = STRUCTURE.__class__(**{**vars(STRUCTURE), "basis": STRUCTURE.basis.bound(box)}).solved(
        [h for p in parts for h in p.heads], box, merged)
    streamed = lpv.identify_stream(whole, STRUCTURE, box=box)
    np.testing.assert_allclose(found.parameters, streamed.parameters, rtol=1e-10, atol=1e-10)
    assert found.n_samples == streamed.n_samples == merged.rows
    again = merged_factor([p.factor for p in parts], width=64)
    np.testing.assert_allclose(np.abs(again.r), np.abs(merged.r), atol=1e-9 * np.abs(merged.r).max())


def test_factors_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(InputError, match="no factors"):
        merged_factor([])
    with pytest.raises(InputError, match="different structures"):
        merged_factor([Factor(np.eye(3), 9, 2), Factor(np.eye(4), 9, 3)])


# -- who differs -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("count", [12, 40, 200])
def test_the_false_discovery_rate_holds(count: int) -> None:
    rng = np.random.default_rng(count)
    false, named = [], []
    for _ in range(300):
        esr = {f"h{k}": float(np.exp(rng.normal(-4, 0.3))) for k in range(count)}
        esr |= {f"bad{k}": float(np.exp(-4 + 0.3 * 12)) for k in range(max(1, count // 40))}
        found = differing(esr, 0.05).named
        false.append(sum(n.startswith("h") for n in found) / max(len(found), 1))
        named.append(sum(n.startswith("b") for n in found) / max(1, count // 40))
    assert np.mean(false) <= 0.05 + 2 * np.std(false) / np.sqrt(300)
    assert np.mean(named) > 0.95


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(("count", "size"), [(40, 3), (60, 12), (200, 12)])
def test_the_false_discovery_rate_holds_between_parameters(count: int, size: int) -> None:
    rng = np.random.default_rng(count + size)
    mixing = np.diag(np.geomspace(20.0, 1.0, size)) @ np.linalg.qr(rng.normal(size=(size, size)))[0]
    false, right = [], []
    for _ in range(120):
        files = {f"h{k}": rng.normal(size=size) @ mixing for k in range(count)}
        away = np.linalg.solve(mixing.T @ mixing, rng.normal(size=size))  # a direction of little spread, as well
        away *= 14.0 / np.sqrt(away @ np.linalg.solve(mixing.T @ mixing, away))
        files |= {f"bad{k}": rng.normal(size=size) @ mixing + away for k in range(max(1, count // 40))}
        found = differing_parameters(files, 0.05)
        assert found is not None
        false.append(sum(n.startswith("h") for n in found.named) / max(len(found.named), 1))
        right.append(sum(n.startswith("b") for n in found.named) / max(1, count // 40))
    assert np.mean(false) <= 0.05 + 2 * np.std(false) / np.sqrt(120), np.mean(false)
    assert np.mean(right) > 0.9
    assert differing_parameters({f"h{k}": np.zeros(4) for k in range(19)}) is None


@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("count", [12, 40, 200])
def test_either_of_two_tests_keeps_the_false_discovery_rate(count: int) -> None:
    """One file differs in its parameters, another in its residual alone; healthy ones in neither."""
    rng = np.random.default_rng(count)
    false, right = [], []
    for _ in range(200):
        departures = {f"h{k}": float(np.exp(rng.normal(-4, 0.3))) for k in range(count)}
        levels = {n: float(np.exp(rng.normal(3, 0.1))) for n in departures}
        departures |= {"moved": float(np.exp(-4 + 0.3 * 12)), "unlike": float(np.exp(-4))}
        levels |= {"moved": float(np.exp(3)), "unlike": float(np.exp(3 - 0.1 * 12))}
        found = either(differing(departures), differing_residuals(levels)).named
        false.append(sum(n.startswith("h") for n in found) / max(len(found), 1))
        right.append(len({"moved", "unlike"} & set(found)) / 2)
    assert np.mean(false) <= 0.05 + 2 * np.std(false) / np.sqrt(200), np.mean(false)
    assert np.mean(right) > 0.9, np.mean(right)


def test_the_level_of_a_residual_is_its_mean_square(rng: np.random.Generator) -> None:
    x, y = rng.normal(size=(300, 2)), rng.normal(size=(300, 1))
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    own = Factor(np.linalg.qr(np.hstack([x, y]), mode="r"), 300, 2)
    assert residual_level(own) == pytest.approx(np.sum(left**2) / 298)
    few = {f"a{k}": 1.0 + k for k in range(5)}
    assert either(differing(few), differing_residuals(few)).named == ()


def test_a_departure_is_the_likelihood_ratio_of_common_parameters(rng: np.random.Generator) -> None:
    x, y = rng.normal(size=(200, 3)), rng.normal(size=(200, 1))
    own = Factor(np.linalg.qr(np.hstack([x, y]), mode="r"), 200, 3)
    theta = rng.normal(size=(3, 1))
    least = np.sum((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2)
    assert departure(own, theta) == pytest.approx((np.sum((y - x @ theta) ** 2) - least) / least)
    moved = shift(own, theta)
    assert moved @ moved == pytest.approx(departure(own, theta) * (200 - 3))


def test_few_files_name_nobody_and_a_divergent_run_is_named() -> None:
    assert differing({f"a{k}": 10.0**k for k in range(7)}).named == ()
    rng = np.random.default_rng(1)
    esr = {f"a{k}": float(np.exp(rng.normal())) for k in range(40)} | {"wild": float("inf")}
    assert differing(esr).named[0] == "wild"
    assert differing({**{f"a{k}": 0.1 for k in range(20)}, "b": 0.2}).named == ("b",)


# -- plan and state ----------------------------------------------------------------------------------------------------
def test_names_are_unique_below_the_common_folder(tmp_path: Path) -> None:
    for name in ("x/a.csv", "y/a.csv", "y/b.csv", "y/b.tsv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("t")
    plan = plan_fleet([f"{tmp_path}/**/*.?sv"], tmp_path / "out")
    assert [j.name for j in plan.jobs] == ["x__a", "y__a", "y__b.csv", "y__b.tsv"]
    for wrong in ({"do": ["audit", "guess"]}, {"do": ["diagnose"]}, {"fdr": 0.0}, {"limit": -1.0}):
        with pytest.raises(InputError):
            plan_fleet([f"{tmp_path}/x/*"], tmp_path / "out", **wrong)


def test_an_outcome_counts_for_its_own_settings_only(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t")
    job = plan_fleet([str(tmp_path / "a.csv")], tmp_path / "out").jobs[0]
    assert outcome(job, "audit", "k") is None
    keep(job, StepOutcome("audit", "done", "", 1.0, "k"))
    keep(job, StepOutcome("scan", "refused", "no", 1.0, "k"))
    assert outcome(job, "audit", "k") == StepOutcome("audit", "done", "", 1.0, "k")
    assert outcome(job, "audit", "other") is None
    (job.folder / "state.json").write_text("{ not json")
    assert outcome(job, "audit", "k") is None


def test_a_step_that_hangs_inside_a_worker_is_stopped(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t")
    job = plan_fleet([str(tmp_path / "a.csv")], tmp_path / "out").jobs[0]
    never = threading.Event()
    found = _here("scan", job, "k", lambda: str(never.wait(60)), 0.2)
    never.set()
    assert (found.state, found.message, found.final) == ("stopped", "stopped after 0.2 s", False)
    assert outcome(job, "scan", "k") == found
    assert _here("scan", job, "k", lambda: "fine", 60.0).state == "done"
    with pytest.raises(ZeroDivisionError):
        _here("identify", job, "k", lambda: str(1 / 0), 60.0)


def test_a_command_that_hangs_is_stopped_once_whatever_may_be_tried_again(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text("t")
    plan = plan_fleet([str(tmp_path / "a.csv")], tmp_path / "out", limit=7.0, retries=3)
    waited: list[float] = []

    def hangs(words: Any, timeout: float, **more: Any) -> None:
        waited.append(timeout)
        raise subprocess.TimeoutExpired(words, timeout)

    monkeypatch.setattr(subprocess, "run", hangs)
    found = audit(plan.jobs[0], plan)
    assert (found.state, found.message, waited) == ("stopped", "stopped after 7 s", [7.0])


@pytest.mark.seconds
def test_of_a_file_that_hangs_later_steps_are_skipped_and_it_is_listed(
        folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One time limit is waited for, not one for every step; the steps themselves run here, without a cluster."""
    plan = plan_fleet([f"{folder}/d0*.csv"], tmp_path / "out", do=("audit", "identify"), structure=STRUCTURE)
    run: list[tuple[str, str]] = []

    def here(client: None, step: str, function: Any, jobs: Any, plan: Any, more: tuple, progress: Any) -> Any:
        for job in jobs:
            run.append((step, job.name))
            if step == "audit":
                found = StepOutcome(step, *(("stopped", "stopped after 7 s") if job.name == "d03" else ("done", "")),
                                    0.0, "k")
            else:
                found = function(job, plan, *more)
            yield job, found

    monkeypatch.setattr(running, "connected", lambda *settings: nullcontext())
    monkeypatch.setattr(running, "_stage", here)
    found = run_fleet(plan)
    assert [step for step, name in run if name == "d03"] == ["audit"]
    assert {step for step, name in run if name == "d04"} == {"audit", "scan", "identify", "judge"}
    assert found.hanging == ("d03",) and "hanging: d03" in found.verdict
    assert found.left_out == {"d03": "audit stopped after 7 s"}
    assert "d03: audit stopped: stopped after 7 s" in str(found)
    assert found.to_dict()["files"][3]["steps"]["scan"]["state"] == "skipped"


def test_causes_carry_their_probability_and_rivals(tmp_path: Path) -> None:
    written(specimen(0), tmp_path)
    plan = plan_fleet([str(tmp_path / "*.csv")], tmp_path / "out", do=("diagnose",), structure=STRUCTURE,
                      baseline="guo")
    assert read_causes(plan.jobs) == {}
    data = {"verdict": "partly-explained", "causes": [{"name": "coil-lag", "probability": 0.934}],
            "rivals": [{"names": ["payload", "gas-stiffness"]}]}
    folder = plan.jobs[0].folder / "diagnosis"
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text(json.dumps(data))
    found = FleetResult(plan, {}, None, {}, None, read_causes(plan.jobs), {})
    assert found.causes == {plan.jobs[0].name: ("coil-lag",)}
    row = found.to_dict()["files"][0]
    assert row["causes"] == ["coil-lag"]
    assert row["diagnosis"] == {"verdict": "partly-explained", "causes": data["causes"],
                                "rivals": [["payload", "gas-stiffness"]], "shared": []}
    lines = list(csv.DictReader(io.StringIO(_table(found))))
    assert (lines[0]["probabilities"], lines[0]["rivals"]) == ("0.934", "payload|gas-stiffness")


def test_few_files_leave_it_open_who_differs_and_what_audits_warn_of_is_stated(tmp_path: Path) -> None:
    for k in range(3):
        written(specimen(k), tmp_path)
    plan = plan_fleet([str(tmp_path / "*.csv")], tmp_path / "out", structure=STRUCTURE)
    done = StepOutcome("audit", "done", "", 0.1, "")
    turned = plan.jobs[1]
    (turned.folder / "audit").mkdir(parents=True)
    findings = [{"name": "reversed-polarity", "severity": "warning"}, {"name": "noise-level", "severity": "note"}]
    (turned.folder / "audit" / "audit.json").write_text(json.dumps({"findings": findings}))
    errors = {j.name: {"esr": 0.1, "rmse": 1.0, "unit": "N", "mean_error": 0.0, "diverged": False} for j in plan.jobs}
    few = differing(dict.fromkeys(errors, 0.1))
    found = FleetResult(plan, {j.name: {"audit": done} for j in plan.jobs}, None, errors, few, {}, {})
    assert found.verdict == ("3 of 3 files done; which of them differ is open: that takes 8 files; the audit warns of "
                             "reversed-polarity in 1.")
    assert found.warned == {turned.name: ("reversed-polarity",)}
    assert [row["warnings"] for row in found.to_dict()["files"]] == [[], ["reversed-polarity"], []]
    page = fleet_page(found)
    assert page.mark == "warn"
    assert "reversed-polarity" in render(page)
    assert [s.command for s in page.steps] == ["lpvid validate OUT/model/model.json NEW.csv --out checked"]
    many = differing({f"a{k}": 0.1 for k in range(9)})
    assert "none differs" in FleetResult(plan, {}, None, errors, many, {}, {}).verdict


def test_a_current_that_varies_over_the_fleet_is_no_warning_and_faults_are_counted(tmp_path: Path) -> None:
    """Constant in every file but not the same: no warning. The same in all: one. Errors are called by what they are."""
    for k in range(3):
        written(specimen(k), tmp_path)
    plan = plan_fleet([str(tmp_path / "*.csv")], tmp_path / "out", structure=STRUCTURE)
    done = StepOutcome("audit", "done", "", 0.1, "")
    for job, current in zip(plan.jobs, (0.0, 1.0, 1.0), strict=True):
        (job.folder / "audit").mkdir(parents=True)
        constant = {"name": "constant-scheduling", "severity": "warning", "record": "", "evidence": "", "mend": ""}
        findings = [{**constant, "channel": "current", "value": current}, {**constant, "channel": "lamp", "value": 5.0}]
        findings += [{"name": "jitter", "severity": "fault", "channel": "", "value": 0.2}] * (current == 0.0)
        (job.folder / "audit" / "audit.json").write_text(json.dumps({"findings": findings}))
    found = FleetResult(plan, {j.name: {"audit": done} for j in plan.jobs}, None, {}, None, {}, {})
    assert found.faulty == (plan.jobs[0].name,)
    assert "; the audit finds faults in 1 file, to be mended first; the audit warns of constant-sch" in found.verdict
    lamp = [{"name": "constant-scheduling", "severity": "warning", "channel": "current", "value": 1.0}]
    for job in plan.jobs:
        (job.folder / "audit" / "audit.json").write_text(json.dumps({"findings": lamp}))
    assert set(FleetResult(plan, found.outcomes, None, {}, None, {}, {}).warned) == {j.name for j in plan.jobs}
    (plan.jobs[1].folder / "audit" / "audit.json").write_text(json.dumps({"findings": [{**lamp[0], "value": 0.5}]}))
    assert not FleetResult(plan, found.outcomes, None, {}, None, {}, {}).warned
    assert _table(found).splitlines()[0].split(",")[2:5] == ["free_run_esr_training", "free_run_rmse_training",
                                                             "free_run_mean_error_training"]


@pytest.mark.seconds
def test_few_files_state_how_far_a_file_must_lie_to_be_named() -> None:
    """The score needed is the one from which the rule names a file: just beyond it does, just within it does not."""
    for n in (8, 20):
        needed = needed_score(n, 0.05)
        half = np.exp(np.linspace(-1, 1, n - 1))
        for factor, named in ((1.001, 1), (0.999, 0)):
            departures = {f"a{k}": float(v) for k, v in enumerate(half)}
            low, high = 0.0, 100.0
            for _ in range(200):  # the value whose own score is factor·needed: it moves median and spread
                middle = 0.5 * (low + high)
                score = differing({**departures, "far": float(np.exp(middle))}).score["far"]
                low, high = (middle, high) if score < factor * needed else (low, middle)
            found = either(differing({**departures, "far": float(np.exp(high))}),
                           differing_residuals(dict.fromkeys([*departures, "far"], 1.0)))
            assert len(found.named) == named


@pytest.mark.seconds
def test_a_missing_scheduler_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "SCHEDULER_TIMEOUT", 1.0)  # the port refuses at once; the client tries on until then
    with pytest.raises(InputError, match="does not answer"), connected("tcp://127.0.0.1:9", None):
        pass


# -- on a cluster ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("workers", "files", "count", "share"), [(None, 3, 3, "2"), (None, 20, 6, "1"),
                                                                   (2, 20, 2, "3"), (9, 20, 9, "1")])
def test_workers_and_what_they_start_share_the_cores(monkeypatch: pytest.MonkeyPatch, workers: int | None, files: int,
                                                     count: int, share: str) -> None:
    """Six cores: no more workers than files, and no more processors for each than there are beside the others."""
    seen: dict[str, Any] = {}

    def cluster(**settings: Any) -> Any:
        seen.update(settings)
        return nullcontext()

    monkeypatch.setattr("distributed.LocalCluster", cluster)
    monkeypatch.setattr("distributed.Client", lambda cluster: nullcontext())
    monkeypatch.setattr("dask.system.CPU_COUNT", 6)
    monkeypatch.setattr(running, "processors", lambda: 8)
    with connected(None, workers, files):
        assert (seen["n_workers"], seen["env"]) == (count, {"LPVID_PROCESSORS": share})


def untimed(found: Any) -> Any:
    if isinstance(found, dict):
        return {k: untimed(v) for k, v in found.items() if k != "seconds"}
    return [untimed(v) for v in found] if isinstance(found, list) else found


@pytest.mark.slow
def test_killed_workers_change_nothing(folder: Path, tmp_path: Path) -> None:
    def plan(name: str) -> Any:
        return plan_fleet([f"{folder}/*.csv"], tmp_path / name, do=("identify",), structure=STRUCTURE)

    calm = run_fleet(plan("calm"), workers=2)
    killed: list[int] = []

    def kill_now_and_then(text: str) -> None:
        if text.startswith(("scan", "identify")) and len(killed) < 2 and ": 3 of" in text:
            children = Path(f"/proc/{os.getpid()}/task")
            pids = {int(p) for t in children.iterdir() for p in (t / "children").read_text().split()}
            workers = [p for p in pids if b"nanny" in Path(f"/proc/{p}/cmdline").read_bytes()
                       or b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]
            if workers:
                killed.append(workers[0])
                os.kill(workers[0], signal.SIGKILL)

    stormy = run_fleet(plan("stormy"), workers=3, report_progress=kill_now_and_then)
    assert len(killed) == 2
    one, other = untimed(calm.to_dict()), untimed(stormy.to_dict())
    assert one == other
    assert calm.found is not None and stormy.found is not None
    np.testing.assert_allclose(calm.found.parameters, stormy.found.parameters, rtol=1e-10)
    assert calm.differing is not None and set(calm.differing.score) == {f"d{k:02d}" for k in range(12)}
    assert calm.failed == ("broken",) and "broken" in calm.left_out
    kept = [f"d{k:02d}" for k in range(12) if f"d{k:02d}" not in calm.differing.named]
    records = [lpv.read(folder / f"{name}.csv")[0] for name in kept]
    whole = lpv.identify_stream(records, STRUCTURE)
    np.testing.assert_allclose(calm.found.parameters, whole.parameters, rtol=1e-8, atol=1e-9)

    begun = time.monotonic()
    again = run_fleet(plan("calm"), workers=2)
    assert untimed(again.to_dict()) == one and time.monotonic() - begun < 60


@pytest.mark.slow
def test_a_step_that_takes_too_long_is_reported_and_tried_again_by_the_next_run(folder: Path, tmp_path: Path) -> None:
    def run(limit: str, code: int) -> dict[str, Any]:
        words = ["--do", "audit", "--time-limit", limit, "--retries", "0", "--workers", "2", "--json"]
        result = CliRunner().invoke(app, ["fleet", f"{folder}/d0[01].csv", *words, "--out", str(tmp_path / "out")])
        assert result.exit_code == code, result.output
        return {r["name"]: r["steps"]["audit"]["state"] for r in json.loads(result.stdout)["files"]}

    assert run("0.01", 3) == {"d00": "stopped", "d01": "stopped"}
    assert run("120", 0) == {"d00": "done", "d01": "done"}
    assert (tmp_path / "out" / "files" / "d00" / "audit" / "report.html").is_file()
    assert (tmp_path / "out" / "fleet.csv").read_text().count("\n") == 3


def test_without_a_folder_the_command_says_so(folder: Path) -> None:
    result = CliRunner().invoke(app, ["fleet", f"{folder}/*.csv"])
    assert result.exit_code == 2 and "--out DIR" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.slow
def test_identify_on_a_fleet_is_the_model_of_all_files(folder: Path, tmp_path: Path) -> None:
    words = ["--input", "velocity", "--output", "force", "--schedule", "current", "--na", "2", "--nb", "2", "--nk", "0"]
    files = [str(folder / f"d{k:02d}.csv") for k in range(6)]  # too few for anybody to be left out
    out = tmp_path / "one"
    joint = CliRunner().invoke(app, ["identify", *files, *words, "--fleet", "--out", str(out), "--json"])
    assert joint.exit_code == 0, joint.output
    whole = lpv.identify_stream([r for f in files for r in lpv.read(f)], STRUCTURE)
    found = lpv.load(out / "model.json")
    np.testing.assert_allclose(found.a, whole.model.a, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found.b, whole.model.b, rtol=1e-8, atol=1e-7)
    assert json.loads((out / "identification.json").read_text())["n_samples"] == whole.n_samples
    assert (out / "report.html").exists()


def test_what_a_fleet_cannot_identify_is_one_line(folder: Path, tmp_path: Path) -> None:
    words = ["identify", f"{folder}/d0*.csv", "--input", "velocity", "--output", "force", "--nk", "0", "--fleet"]
    out = ["--out", str(tmp_path / "out")]
    for more, stated in (
        (["--auto", *out], "--auto"),
        (["--structure", "oe", *out], "identifies arx"),
        ([], "--out DIR"),
        (["--shape", "tanh", *out], "identifies arx"),
        (["--hold-out", "1/3", *out], "--hold-out"),
    ):
        result = CliRunner().invoke(app, [w for w in words if "--auto" not in more or w not in ("--nk", "0")] + more)
        assert result.exit_code == 2 and stated in result.stderr and result.stderr.count("\n") == 1, result.output


# -- large files -------------------------------------------------------------------------------------------------------
def judged(plan: Any, model: Path, rate: float) -> dict[str, Any]:
    done = steps.judge(plan.jobs[0], plan, model, rate, "tag")
    assert done.state == "done", done.message
    return json.loads(done.message)


def test_a_large_file_at_another_rate_or_without_its_velocity_is_read_whole(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its parts, neither resampled nor with a derived velocity, are handed on where neither is needed."""
    record = specimen(3)
    (tmp_path / "a").mkdir()
    written(record, tmp_path / "a")
    x = np.cumsum(record["velocity"]) * 0.002
    rows = np.column_stack([record.times, x, record["current"], record["force"]])
    np.savetxt(tmp_path / "b.csv", rows, fmt="%.10g", delimiter=",", comments="",
               header="time [s],displacement [m],current [A],force [N]")
    plain = plan_fleet([str(tmp_path / "a")], tmp_path / "out", structure=STRUCTURE)
    bare = plan_fleet([str(tmp_path / "b.csv")], tmp_path / "out_b", structure=STRUCTURE)
    small = {k: list(steps.records(p.jobs[0], p, r)) for k, (p, r) in
             {"own": (plain, 500.0), "half": (plain, 250.0), "bare": (bare, 500.0)}.items()}
    monkeypatch.setattr(steps, "LARGE", 100.0)
    monkeypatch.setattr(steps, "ROWS", 400)
    own = steps.records(plain.jobs[0], plain, 500.0)
    assert isinstance(own, Chunks) and [r.n_samples for r in own] == [400, 400, 400, 300]
    np.testing.assert_array_equal(np.concatenate([r["force"] for r in own]), small["own"][0]["force"])
    for name, plan, rate in (("half", plain, 250.0), ("bare", bare, 500.0)):
        found = list(steps.records(plan.jobs[0], plan, rate))
        assert [r.n_samples for r in found] == [r.n_samples for r in small[name]]
        np.testing.assert_array_equal(found[0].matrix(STRUCTURE.channels), small[name][0].matrix(STRUCTURE.channels))
    assert steps.scan(bare.jobs[0], bare).state == steps.scan(plain.jobs[0], plain).state == "done"
    assert steps.factor(plain.jobs[0], plain, lpv.Scheduling(("current",), (0.0,), (2.0,)), 250.0, "t").state == "done"


@pytest.mark.seconds
def test_the_model_of_all_files_knows_their_rows_and_ranges(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k in range(4):
        written(specimen(k), tmp_path)
    plan = plan_fleet([str(tmp_path / f"d0{k}.csv") for k in range(3)], tmp_path / "out", structure=STRUCTURE)
    box = lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",))
    assert all(steps.scan(job, plan).state == "done" for job in plan.jobs)
    for large in (steps.LARGE, 100.0):
        monkeypatch.setattr(steps, "LARGE", large)
        monkeypatch.setattr(steps, "ROWS", 400)
        assert all(steps.factor(job, plan, box, 500.0, f"{large:g}").state == "done" for job in plan.jobs)
        model = running._solved(plan, plan.jobs, box, 500.0).model
        for k, label in ((0, "training"), (2, "training"), (3, "held-out")):
            record, = lpv.read(tmp_path / f"d0{k}.csv")
            assert lpv.validate(model, record).label == label
            assert lpv.validate(model, record.slice(400, 1400)).label == label
        lowest, highest = model.metadata["training"]["ranges"]["velocity"]
        every = np.concatenate([lpv.read(job.path)[0]["velocity"] for job in plan.jobs])
        assert (lowest, highest) == (every.min(), every.max())
        assert model.metadata["roles"]["force"] == "force"


def test_a_large_file_is_judged_by_the_free_run_of_the_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data").mkdir()
    written(specimen(4), tmp_path / "data")
    path = lpv.save(lpv.identify([specimen(5)], STRUCTURE).model, tmp_path / "model.json")
    plans = [plan_fleet([str(tmp_path / "data")], tmp_path / k, structure=STRUCTURE) for k in ("small", "large")]
    small = judged(plans[0], path, 500.0)
    monkeypatch.setattr(steps, "LARGE", 100.0)
    monkeypatch.setattr(steps, "ROWS", 400)
    large = judged(plans[1], path, 500.0)
    assert large.keys() == small.keys() and large["unit"] == small["unit"] and small["esr"] > 0
    for name in ("esr", "rmse", "mean_error"):
        assert large[name] == pytest.approx(small[name], rel=1e-9), name


def test_a_file_without_a_record_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(specimen(1), tmp_path)
    plan = plan_fleet([str(tmp_path)], tmp_path / "out", structure=STRUCTURE)
    monkeypatch.setattr(steps, "records", lambda *_: [])
    done = steps.scan(plan.jobs[0], plan)
    assert done.state == "refused" and "holds no record" in done.message


def test_a_run_of_the_common_model_that_diverges_is_stated_and_a_shortfall(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {"a": {"esr": 0.02, "diverged": False}, "b": {"esr": None, "diverged": True},
              "c": {"esr": 0.04, "diverged": False}}
    found = FleetResult(SimpleNamespace(jobs=(), do=("identify",), fdr=0.05), {},  # type: ignore[arg-type]
                        SimpleNamespace(model="M"), errors, None, {}, {})  # type: ignore[arg-type]
    assert found.diverging == ("b",)
    assert "ESR 0.04 in the median; it diverges in 1 (first: b)" in str(found)
    monkeypatch.setattr("lpvid.cli.fleet.identify_fleet", lambda *_: found)
    ended = CliRunner().invoke(app, ["identify", "x.csv", "--fleet"])
    assert ended.exit_code == 3 and "it diverges in 1" in ended.output


def test_the_axes_of_a_fleet_have_more_than_one_number():
    """Values within a decade on linear axes, with no entry in the legend for files that do not exist."""
    errors = {f"a{k}": {"esr": 0.08 + 0.01 * k} for k in range(9)}
    alike = differing({name: 0.1 + 0.01 * k for k, name in enumerate(errors)})
    ax = departures(errors, alike)
    ax.figure.canvas.draw()
    low, high = ax.get_xlim()
    assert sum(low <= v <= high for v in ax.get_xticks()) >= 3 and ax.get_xscale() == "linear"
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["like the fleet"]
    wide = departures({name: {"esr": 10.0**-k} for k, name in enumerate(errors)}, alike)
    assert wide.get_xscale() == "log"
