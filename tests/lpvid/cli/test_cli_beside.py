"""`--beside`: other models in reports of identify and validate; the worst record in the verdict; names of exports."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from lpvid.cli.app import app

pytestmark = pytest.mark.usefixtures("undrawn")

IO = ["--input", "velocity", "--output", "force", "--nk", "0"]


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(w) for w in words])


def write(file: Path, seed: int, turned: float = 1.0, size: float = 1.0) -> Path:
    rng = np.random.default_rng(seed)
    t = np.arange(1200) / 400.0
    v = size * np.convolve(rng.standard_normal(t.size), np.ones(9) / 9, "same")
    force = turned * (300.0 * v + 100.0 * np.tanh(v / 0.1)) + 2.0 * rng.standard_normal(t.size)
    rows = "\n".join(f"{a:.6g},{b:.6g},{c:.6g}" for a, b, c in zip(t, v, force, strict=True))
    file.write_text(f"time [s],velocity [m/s],force [N]\n{rows}\n")
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two models, two good records, and one whose sensor is turned."""
    root = tmp_path_factory.mktemp("beside")
    for name, seed, turned, size in (("run", 0, 1.0, 1.0), ("new", 1, 1.0, 1.0), ("bad", 2, -1.0, 0.03)):
        write(root / f"{name}.csv", seed, turned, size)
    for name, shape in (("a", "tanh"), ("b", "none")):
        done = run("identify", root / "run.csv", *IO, "--shape", shape, "--out", root / name)
        assert done.exit_code == 0, done.output
    return root


@pytest.mark.slow
def test_validate_sets_another_model_beside(folder: Path) -> None:
    """The figures are those of `compare`; the page has its table and both models' names."""
    out = folder / "checked"
    done = run("validate", folder / "a/model.json", folder / "new.csv", "--beside", folder / "b/model.json",
               "--out", out)
    assert done.exit_code == 0, done.output
    stated = json.loads((out / "validation.json").read_text())
    alone = run("compare", folder / "a/model.json", folder / "b/model.json", folder / "new.csv", "--json")
    assert stated["beside"]["models"] == json.loads(alone.stdout)["models"]
    assert [m["name"] for m in stated["beside"]["models"]] == ["a/model", "b/model"]
    page = (out / "report.html").read_text()
    assert "Beside other models" in page and "b/model" in page


@pytest.mark.slow
def test_identify_sets_another_model_beside(folder: Path) -> None:
    done = run("identify", folder / "run.csv", *IO, "--shape", "tanh", "--held-out", folder / "new.csv", "--beside",
               folder / "b/model.json", "--out", folder / "again")
    assert done.exit_code == 0, done.output
    stated = json.loads((folder / "again/identification.json").read_text())["beside"]["models"]
    assert [m["name"] for m in stated] == ["again/model", "b/model"] and "b/model" in done.output
    assert "Beside other models" in (folder / "again/report.html").read_text()


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("words", [["--beside", "gone.json"], ["--beside", "{run}"]])
def test_what_is_no_model_is_refused_before_the_work(folder: Path, words: list[str]) -> None:
    out = folder / "refused"
    done = run("validate", folder / "a/model.json", folder / "new.csv", *[w.format(run=folder / "run.csv")
                                                                          for w in words], "--out", out)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert done.exit_code == 2 and len(errors) == 1 and not out.exists()


@pytest.mark.seconds
def test_one_bad_record_is_in_the_verdict(folder: Path) -> None:
    """Pooled figures are good, one record's are not: the banner is no longer green, and names it."""
    out = folder / "mixed"
    done = run("validate", folder / "a/model.json", folder / "new.csv", folder / "run.csv", folder / "bad.csv",
               "--out", out)
    assert done.exit_code == 0, done.output
    page = (out / "report.html").read_text()
    found = json.loads((out / "validation.json").read_text())
    bad = next(r for r in found["records"] if r["name"] == "bad")
    assert bad["free_run"]["esr"] > 1
    assert found["overall"]["free_run"]["esr"] < 0.05
    banner = page[page.index('class="verdict'):]
    assert banner.startswith('class="verdict warn"')
    assert "But not record &#39;bad&#39;" in banner and f"{bad['free_run']['fit_percent']:.1f}" in banner


def test_compare_states_a_turned_sensor(folder: Path) -> None:
    """The validations' notes, with a model's name where they are not of all."""
    out = folder / "turned"
    done = run("compare", folder / "a/model.json", folder / "b/model.json", folder / "bad.csv", "--out", out)
    assert done.exit_code == 0 and "--flip force" in done.output
    assert "--flip</span> force" in (out / "report.html").read_text()


@pytest.mark.parametrize("name", ["1bad-name", "a b", "x__y", "é", "a" * 41])
def test_a_name_that_not_every_tool_takes(folder: Path, name: str) -> None:
    out = folder / "exported"
    done = run("export", folder / "b/model.json", "--to", "csv", "--name", name, "--out", out)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert done.exit_code == 2 and len(errors) == 1 and f"'{name}'" in errors[0] and not out.exists()
