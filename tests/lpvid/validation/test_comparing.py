"""compare_models and `lpvid compare`: order, refusals, reports."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.errors import InputError
from lpvid.record import Record

pytestmark = pytest.mark.usefixtures("undrawn")


def gain(k: float, output: str = "force") -> lpv.LPVTransferFunction:
    return lpv.LPVTransferFunction.siso([], [[k]], lpv.Polynomial(), 0.01, inputs="velocity", outputs=output)


def record(name: str = "run") -> Record:
    v = np.sin(np.arange(500) / 7)
    return Record({"velocity": v, "force": 2.0 * v}, 0.01, name=name)


def test_esr_of_a_wrong_gain_is_analytic_and_sets_the_order():
    """y = 2v − mean, ŷ = kv: ESR = Σ((2 − k)v)²/Σ(2v − mean)²."""
    found = lpv.compare_models({"low": gain(1.0), "near": gain(1.9), "exact": gain(2.0)}, record())
    assert [m.name for m in found.models] == ["exact", "near", "low"]
    y = record()["force"]
    for m, k in zip(found.models, (2.0, 1.9, 1.0), strict=True):
        assert m.esr == pytest.approx(np.sum(((2 - k) * y / 2) ** 2) / np.sum((y - y.mean()) ** 2), abs=1e-14)


def test_a_model_that_diverges_is_last_and_one_that_lacks_a_channel_is_left_out():
    unstable = lpv.LPVTransferFunction.siso([[-1.5]], [[1.0]], lpv.Polynomial(), 0.01, inputs="velocity",
                                            outputs="force")
    other = lpv.LPVTransferFunction.siso([], [[1.0]], lpv.Polynomial(), 0.01, inputs="pressure", outputs="force")
    found = lpv.compare_models({"unstable": unstable, "exact": gain(2.0), "other": other}, record())
    assert [m.name for m in found.models] == ["exact", "unstable"]
    assert list(found.refused) == ["other"] and "pressure" in found.refused["other"]


@pytest.mark.parametrize("models, description", [
    ({}, "no models"),
    ({"a": gain(1.0, "torque")}, "the model cannot run"),
])
def test_nothing_to_compare_is_one_line(models, description):
    with pytest.raises(InputError, match=description):
        lpv.compare_models(models, record())


def test_other_outputs_are_refused():
    with pytest.raises(InputError, match="different outputs"):
        lpv.compare_models({"a": gain(1.0), "b": gain(1.0, "velocity2")},
                           Record({**record().channels, "velocity2": record()["velocity"]}, 0.01))


def test_the_command(tmp_path: Path):
    for name, k in (("a", 2.0), ("b", 1.0)):
        lpv.save(gain(k), tmp_path / f"{name}.json")
    rows = "\n".join(f"{0.01 * k:.2f},{v},{2 * v + 0.1}" for k, v in enumerate(record()["velocity"]))
    (tmp_path / "run.csv").write_text(f"time [s],velocity [m/s],force [N]\n{rows}\n")
    files = [str(tmp_path / n) for n in ("b.json", "a.json", "run.csv")]
    done = CliRunner().invoke(app, ["compare", *files, "--out", str(tmp_path / "out")], catch_exceptions=False)
    assert done.exit_code == 0 and "free-run ESR" in done.stdout
    kept = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert [m["name"] for m in kept["models"]] == ["a", "b"]
    assert kept["models"][0]["overall"]["free_run"]["mean_error"] == pytest.approx(0.1)
    assert "Models compared" in (tmp_path / "out" / "report.html").read_text()
    bad = CliRunner().invoke(app, ["compare", files[0]])
    assert bad.exit_code == 2 and bad.stderr.startswith("error: lpvid compare needs model files and data")
