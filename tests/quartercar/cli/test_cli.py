"""`quartercar rig` and `quartercar demo`: what they write, how they end, and what the demo claims."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import BROWSER, axe_source, grave_findings
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app as lpvid_app
from quartercar.cli.app import app
from quartercar.demo import run as demo
from quartercar.rig import EXPERIMENTS

PLAN = """seed = 3
[[experiments]]
preset = "test-1"
duration = "2 s"
replicates = 2
[[experiments]]
name = "sine"
displacement = { kind = "sine", amplitude = "10 mm", frequency = "3 Hz" }
current = { kind = "constant", levels = [0.5] }
duration = "1 s"
"""


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def records(tmp_path_factory, undrawn) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    (folder / "plan.toml").write_text(PLAN)
    run("rig", folder / "plan.toml", "--out", folder / "records")
    return folder / "records"


def test_version_and_help():
    assert run("--version").stdout == f"quartercar {lpv.__version__}\n"
    shown = run("--help").stdout
    assert "rig" in shown and "demo" in shown and "Exit codes" in shown


@pytest.mark.seconds
def test_rig_writes_records(records):
    assert sorted(p.name for p in records.iterdir() if p.name[0] != ".") == [
        "report.html", "sine-r0.csv", "test-1-r0.csv", "test-1-r1.csv"]
    first, *_ = lpv.read(records / "test-1-r0.csv")
    assert first.n_samples == 1024 and first.sample_time == pytest.approx(1 / 512, rel=1e-9)
    assert [first.unit(n) for n in ("displacement", "velocity", "current", "force")] == ["m", "m/s", "A", "N"]
    sine, *_ = lpv.read(records / "sine-r0.csv")
    amplitude = np.abs(np.fft.rfft(sine["displacement"]))[3] * 2 / 512  # three whole periods in one second
    assert amplitude == pytest.approx(0.01, rel=0.02)


@pytest.mark.seconds
def test_rig_is_repeatable(records, tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    described = json.loads(run("rig", tmp_path / "plan.toml", "--out", tmp_path / "again", "--json").stdout)
    assert [r["name"] for r in described["records"]] == ["test-1-r0", "test-1-r1", "sine-r0"]
    for r in described["records"]:
        assert (tmp_path / "again" / r["file"]).read_bytes() == (records / r["file"]).read_bytes()


def test_records_go_through_lpvid(records):
    result = CliRunner().invoke(lpvid_app, ["inspect", str(records), "--json"], catch_exceptions=False)
    assert result.exit_code == 0 and len(json.loads(result.stdout)["records"]) == 3


@pytest.mark.seconds
def test_template_is_a_plan(tmp_path):
    text = run("rig", "--template").stdout
    (tmp_path / "plan.toml").write_text(text.replace('duration = "30 s"', 'duration = "1 s"').replace(
        'duration = "4 s"', 'duration = "0.5 s"'))
    run("rig", tmp_path / "plan.toml", "--out", tmp_path / "records")
    assert len(list((tmp_path / "records").glob("*.csv"))) == 4


@pytest.mark.parametrize("plan, parts", [
    (None, ("plan",)), ("", ("error: plan.toml is empty",)), ("seed = [", ("plan.toml",)),
    ("[[experiments]]\npreset = \"test-9\"\n", ("test-9", "test-1")), ("sed = 1\n", ("sed", "seed")),
    ("[[experiments]]\npreset = \"test-1\"\nduration = \"5 kg\"\n", ("duration",)),
    ("[[effects]]\nname = \"rust\"\n[[experiments]]\npreset = \"test-1\"\n", ("rust",)),
])
def test_bad_plans(tmp_path, plan, parts):
    if plan is not None:
        (tmp_path / "plan.toml").write_text(plan)
    before = sorted(tmp_path.rglob("*"))
    result = run("rig", tmp_path / "plan.toml", "--out", tmp_path / "out", code=2)
    lines = result.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: ") and result.stdout == ""
    assert all(part in lines[0] for part in parts), lines[0]
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("arguments, part", [(("rig",), "needs a plan"), (("rig", "plan.toml"), "--out")])
def test_rig_needs_plan_and_folder(tmp_path, monkeypatch, arguments, part):
    monkeypatch.chdir(tmp_path)
    assert part in run(*arguments, code=2).stderr


# -- demo -------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def short_demo(tmp_path_factory) -> tuple[Path, str]:
    """The demo on a short version of its data: five records of three seconds for training, four for testing."""
    from dataclasses import replace

    from quartercar.rig import Rig

    def short(seed: int = 0):
        runs = {name: replace(EXPERIMENTS[name], duration=3.0) for name in EXPERIMENTS}
        rig = Rig()
        training = [rig.run(runs[name], seed, 0) for name in ("test-1", "test-2", "test-3")]
        held_out = [rig.run(runs[name], seed + 1, 3) for name in EXPERIMENTS]
        return training, held_out

    folder = tmp_path_factory.mktemp("demo") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "rig_data", short)
        result = run("demo", "--out", folder)
    return folder, result.stdout


@pytest.mark.slow
def test_demo_writes_everything(short_demo):
    folder, _ = short_demo
    assert {p.name for p in folder.iterdir() if p.name[0] != "."} == {
        "model.json", "identification.json", "stability.json", "demo.json", "report.html", "overview.png",
        "experiments.png", "locus.png", "test-1-r3.csv", "extended_model.json", "controller.json", "ride.json"}


@pytest.mark.slow
def test_demo_tells_every_stage(short_demo):
    _, shown = short_demo
    for heading in ("1 Virtual rig", "2 Audit", "3 LPV-ARX", "4 Every experiment", "5 State-space", "6 Stability",
                    "7 A hidden cause", "8 A controller, and its ride"):
        assert heading in shown
    assert "does not cover a moving scheduling variable" in shown
    for name in EXPERIMENTS:
        assert name in shown


@pytest.mark.slow
def test_demo_finds_what_the_rig_hides(short_demo):
    """What the rig hid against what was named; the gain against the saved model on the rig's own record."""
    from dataclasses import replace

    from quartercar.demo.diagnosis import DURATION, HIDDEN
    from quartercar.rig import Rig, RigDamper, effect

    folder, _ = short_demo
    described = json.loads((folder / "demo.json").read_text())["diagnosis"]
    assert described["named"] == [described["hidden"]]
    rig = Rig(damper=RigDamper.static(), effects=(effect(described["hidden"], dict(HIDDEN)[described["hidden"]]),))
    record = rig.run(replace(EXPERIMENTS["test-3"], duration=DURATION), 0, 1)
    force = record["force"]
    error = force - lpv.simulate(lpv.load(folder / "extended_model.json"), record).output[:, 0]
    esr = described["diagnosis"]["extended"]["esr"]["held_out"]
    assert error @ error / np.sum((force - force.mean()) ** 2) == pytest.approx(esr, rel=1e-9)


@pytest.mark.slow
def test_demo_controller_keeps_its_promise(short_demo):
    """The gain that is told against the certificate's own; every law on both roads, and the controller as saved."""
    folder, _ = short_demo
    described = json.loads((folder / "demo.json").read_text())
    assert described["design"]["verdict"] in ("solved", "backed-off")
    assert described["design"]["gamma_lower"] <= described["design"]["gamma_verified"]
    rides = json.loads((folder / "ride.json").read_text())
    assert {(r["controller"], r["road"].split(",")[0]) for r in rides["rides"]} >= {
        (name, road) for name in ("passive", "skyhook-linear", "sh-add", "lpv-hinf-identified")
        for road in ("ISO C", "bump 50 mm x 2 m")}
    assert lpv.load(folder / "controller.json").to_dict() == rides["controllers"]["lpv-hinf-identified"]


@pytest.mark.slow
def test_demo_figures_are_those_of_the_model(short_demo):
    """The table of demo.json against free runs of the saved model, computed here from the definition of ESR."""
    folder, _ = short_demo
    described = json.loads((folder / "demo.json").read_text())
    model = lpv.load(folder / "model.json")
    record, *_ = lpv.read(folder / "test-1-r3.csv")
    run_ = lpv.simulate(model, record)
    y, model_y = record["force"][run_.start:], run_.output[run_.start:, 0]
    esr = np.sum((y - model_y) ** 2) / np.sum((y - y.mean()) ** 2)
    row = next(e for e in described["experiments"] if e["name"] == "test-1")
    assert row["esr"] == pytest.approx(esr, rel=1e-6) and row["data"] == "held-out" and row["run"] == "free-run"
    assert described["mean_esr"] == pytest.approx(np.mean([e["esr"] for e in described["experiments"]]), rel=1e-12)
    assert len(described["experiments"]) == 8 and model.na == 4 and model.basis.degree == 1


def test_pooled_figures_add_squares():
    """Two records with the same denominator: the pooled ESR is the mean of theirs, weighted by length."""
    from lpvid.validation import Figures, RecordFigures

    def row(esr: float, n: int, rmse: float) -> RecordFigures:
        figures = Figures("free-run", esr, None, rmse, "N", n)
        return RecordFigures("test-1-r0", n, figures, figures, 0.0)

    rows = [row(0.1, 100, 1.0), row(0.3, 100, 3.0)]
    error, power = 100 * 1.0 + 100 * 9.0, 100 / 0.1 + 900 / 0.3
    assert demo._pooled(rows) == (pytest.approx(error / power), pytest.approx(np.sqrt(error / 200)))
    assert demo._pooled([*rows, row(None, 10, None)]) == (None, None)  # type: ignore[arg-type]


@pytest.mark.slow
def test_demo_report_is_self_contained(short_demo):
    folder, _ = short_demo
    html = (folder / "report.html").read_text()
    assert "<link" not in html and " src=\"http" not in html and len(html.encode()) <= 1_500_000
    assert html.count('<figure class="traces"') >= len(EXPERIMENTS)  # a whole record of every experiment
    for heading in ("Eight experiments", "The virtual rig and the model", "Energy", "State-space forms", "Stability",
                    "Frozen poles", "Critical values"):
        assert f"<h2>{heading}</h2>" in html


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None or axe_source() is None, reason="no Chromium or no axe-core here")
@pytest.mark.parametrize("width", [1200, 390])
def test_no_grave_findings_of_accessibility_on_the_page_of_the_demo(short_demo, width, tmp_path):
    folder, _ = short_demo
    assert grave_findings((folder / "report.html").read_text(), tmp_path, width) == ""


def test_demo_structure_is_the_thesis_class():
    structure = demo.structure()
    assert (structure.na, structure.nb, structure.basis.degree) == (4, (4,), 1)
    assert structure.basis.names == ("current",)


@pytest.mark.slow
def test_demo_runs_one_model_through_the_whole_chain():
    """Full length, held-out, free run: the structure below 0.04, the passive model better than the plain one; its
    certificate, its controller and its ride are of the same model."""
    found = demo.run_demo(0)
    assert all(e.free_esr is not None and e.free_esr < demo.TARGET for e in found.experiments)
    assert found.mean_esr is not None and found.plain_mean_esr is not None
    assert found.free_mean_esr < found.mean_esr < 0.5 * found.plain_mean_esr
    certificate = lpv.PassivityCertificate.from_dict(found.found.model.metadata["passive"])
    assert lpv.verify(certificate, found.found.model).holds and certificate.between_grid
    assert found.study.frozen.stable and found.study.certificate.verified
    design = found.ride.design
    assert design.synthesis.solved and design.synthesis.between_grid
    inner = design.car.damper.at_clock(found.found.model.sample_time)
    np.testing.assert_array_equal(inner.a, found.found.model.a)
    rows = {r.name: r for r in found.ride.rides.on(found.ride.rides.roads[0])}
    assert rows["lpv-hinf-identified"].interval("comfort").mean < rows["passive"].interval("comfort").mean
