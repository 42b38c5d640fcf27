"""`lpvid simulate`: tables that readers take back, figures of the free run, one line where the input is at fault."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.export.tables import write_table
from lpvid.record import Record
from lpvid.scheduling import Polynomial

pytestmark = pytest.mark.usefixtures("undrawn")
RATE = 200.0


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, ["simulate", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def record(seed: int, n: int = 500) -> Record:
    rng = np.random.default_rng(seed)
    v = np.convolve(rng.standard_normal(n + 20), np.ones(20) / 60, "valid")[:n]
    volts = np.repeat(rng.uniform(0.0, 2.0, n // 25 + 1), 25)[:n]
    force = np.zeros(n)
    for k in range(1, n):
        force[k] = 0.4 * force[k - 1] + (300 + 200 * volts[k]) * v[k]
    return Record({"velocity": v, "voltage": volts, "force": force + rng.standard_normal(n)}, 1 / RATE,
                  units={"velocity": "m/s", "voltage": "V", "force": "N"}, name=f"run{seed}")


def as_csv(path: Path, given: Record, names=("velocity", "voltage", "force")) -> Path:
    return write_table({"time": (given.times, "s"), **{n: (given[n], given.unit(n)) for n in names}}, path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A model that calls the voltage its current, and files whose channel is the voltage."""
    path = tmp_path_factory.mktemp("simulate")
    training = record(0).with_roles({"current": "voltage"})
    model = lpv.identify(training, lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force",
                                           basis=Polynomial("current", degree=1))).model
    lpv.save(model, path / "model.json")
    for seed in (0, 1):
        as_csv(path / f"run{seed}.csv", record(seed))
    as_csv(path / "blind.csv", record(1), ("velocity", "voltage"))
    return path


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
def test_the_table_is_the_free_run_of_the_model(folder, tmp_path, kind):
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    run(folder / "model.json", folder / "run1.csv", "--format", kind, "--out", tmp_path)
    shown = {p.name for p in tmp_path.iterdir() if not p.name.startswith(".")}
    assert shown == {f"simulation.{kind}", "simulation.json", "report.html"}
    found = lpv.read(tmp_path / f"simulation.{kind}")[0]
    given = lpv.read(folder / "run1.csv", roles={"current": "voltage"})[0]
    wanted = lpv.simulate(lpv.load(folder / "model.json"), given).output[:, 0]
    np.testing.assert_allclose(found["simulated"], wanted, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["residual"], given["force"] - wanted, rtol=0, atol=1e-9)
    assert found.unit("simulated") == found.unit("measured") == "N" and found.unit("current") == "V"
    np.testing.assert_array_equal(found["current"], given["voltage"])


def test_the_figures_are_those_of_the_free_run(folder, tmp_path):
    stated = run(folder / "model.json", folder / "run0.csv", folder / "run1.csv", "--out", tmp_path).stdout
    assert {p.name for p in tmp_path.glob("*.csv")} == {"simulation-run0.csv", "simulation-run1.csv"}
    described = json.loads((tmp_path / "simulation.json").read_text())
    assert (
        described["schema"] == "lpvid/simulation/1"
        and described["kind"] == "free-run"
        and described["data"] == "partly training"
    )
    total = [0.0, 0.0]
    for name in ("run0", "run1"):
        table = lpv.read(tmp_path / f"simulation-{name}.csv")[0]
        start = described["records"][0]["start"]
        y = table["measured"][start:]
        total[0] += np.sum(table["residual"][start:] ** 2)
        total[1] += np.sum((y - y.mean()) ** 2)
    assert described["overall"]["esr"] == pytest.approx(total[0] / total[1]) and "free-run ESR" in stated
    page = (tmp_path / "report.html").read_text()
    assert "Simulation by model.json" in page and page.count("<figure") >= 2 and "http" not in page


def test_without_a_measured_output_it_runs_from_zero(folder, tmp_path):
    stated = run(folder / "model.json", folder / "blind.csv", "--out", tmp_path).stdout
    described = json.loads((tmp_path / "simulation.json").read_text())
    assert described["overall"] is None and described["data"] == "not measured" and "no figures" in stated
    found = lpv.read(tmp_path / "simulation.csv")[0]
    assert "measured" not in found.channels
    given = lpv.read(folder / "run1.csv", roles={"current": "voltage"})[0]
    wanted = lpv.simulate(lpv.load(folder / "model.json"), given, "zero").output[:, 0]
    np.testing.assert_allclose(found["simulated"], wanted, rtol=0, atol=1e-9)


def test_a_run_that_diverges_has_empty_cells_and_says_where(folder, tmp_path):
    model = lpv.load(folder / "model.json")
    a = model.a.copy()
    a[0, 0, 0, 0] = -1.8
    lpv.save(model.replace(a=a), tmp_path / "unstable.json")
    stated = run(tmp_path / "unstable.json", folder / "run1.csv", "--out", tmp_path / "out").stdout
    described = json.loads((tmp_path / "out" / "simulation.json").read_text())
    at = described["records"][0]["diverged_at"]
    assert described["overall"]["esr"] is None and at > 0 and "DIVERGED" in stated
    simulated = lpv.read(tmp_path / "out" / "simulation.csv")[0]["simulated"]
    assert np.isfinite(simulated[:at]).all() and np.isnan(simulated[at:]).all()


@pytest.mark.parametrize(("arguments", "stated"), [
    (("model.json", "none.csv"), "there is no such file"),
    (("run0.csv", "run1.csv"), "the model comes before the data"),
    (("model.json", "run0.csv", "--sample-rate", "100"), "runs at its own rate"),
    (("model.json", "run0.csv", "--sample-rate", "fast"), "must be a number"),
    (("model.json", "run0.csv", "--role", "current=force"), "another"),
    (("model.json", "run0.csv", "--input", "force,velocity"), "--input names 2"),
    (("model.json", "run0.csv", "blind.csv"), "only some records have the model's output"),
])
def test_input_at_fault_ends_with_one_line(folder, tmp_path, arguments, stated):
    paths = [folder / a if str(a).endswith((".csv", ".json")) else a for a in arguments]
    result = run(*paths, "--out", tmp_path / "out", code=2)
    assert stated in result.stderr and result.stderr.count("\n") == 1 and not (tmp_path / "out").exists()


def test_raw_declines_to_resample(folder, tmp_path):
    """Every command that resamples data to a model refuses those of another rate with raw."""
    record = lpv.read(folder / "run0.csv")[0]
    twice = tmp_path / "twice.csv"
    time = np.arange(2 * record.n_samples) * record.time_base.period / 2
    names = list(record.channels)
    values = np.column_stack([time, *(np.repeat(record[n], 2) for n in names)])
    header = ",".join(["time [s]", *(f"{n} [{record.unit(n)}]" for n in names)])
    np.savetxt(twice, values, delimiter=",", header=header, comments="")
    for command in ("simulate", "validate", "compare"):
        for data, code in ((folder / "run0.csv", 0), (twice, 2)):
            done = CliRunner().invoke(app, [command, str(folder / "model.json"), str(data), "--sample-rate", "raw"])
            assert done.exit_code == code, done.output
            assert (code == 0) or "runs at its own rate" in done.stderr
