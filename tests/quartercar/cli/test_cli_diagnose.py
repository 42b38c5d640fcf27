"""`lpvid diagnose` through its own door, on the virtual rig: files, exit codes, closed loops."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from helpers.browser import BROWSER, screenshot
from typer.testing import CliRunner

import lpvid as lpv
import quartercar as qc
from lpvid.cli.app import app
from lpvid.effects.effect import by_name
from lpvid.effects.lpv_extension import measured_extension
from lpvid.errors import InputError
from quartercar.experiments import PLANS, plan_for
from quartercar.rig import (
    EXPERIMENTS,
    Experiment,
    Rig,
    RigDamper,
    Road,
    Sensors,
    effect,
    parse_plan,
    run_plan,
    write_csv,
)

FEW = ("coulomb-friction", "coil-lag", "command-delay", "gas-stiffness", "asymmetry", "force-delay",
       "displacement-delay", "fixture-inertia")
SOME = tuple(e for e in qc.effects.CATALOGUE if e.name in FEW)


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def bench(name: str = "", strength: float = 1.0, **sensors: float) -> Rig:
    """A rig with a damper that Guo's law describes exactly, and one cause."""
    return Rig(damper=RigDamper.static(), sensors=Sensors(**sensors),
               effects=(effect(name, strength),) if name else ())


def road(seconds: float = 12.0, name: str = "test-3") -> Experiment:
    return replace(EXPERIMENTS[name], duration=seconds)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("rig")
    rig = bench("coulomb-friction", 0.5)
    return tuple(write_csv(rig.run(road(5.0), 0, k), folder / f"run-{k}.csv") for k in (0, 1))  # type: ignore[return-value]


def diagnosed(files: tuple[Path, Path], out: Path) -> tuple[Path, str]:
    shown = run("diagnose", files[0], "--baseline", "guo", "--held-out", files[1], "--catalogue", "quartercar",
                "--plan-experiment", "--out", out)
    return out, shown.stdout


@pytest.fixture(scope="module")
def written(files, tmp_path_factory, without_drawing) -> tuple[Path, str]:
    with without_drawing():
        return diagnosed(files, tmp_path_factory.mktemp("diagnose") / "out")


def test_it_names_the_cause_and_writes_its_files(written):
    out, shown = written
    described = json.loads((out / "diagnosis.json").read_text())
    assert {p.name for p in out.iterdir()} >= {"diagnosis.json", "extended_model.json", "extended_lpv.json",
                                               "report.html"}
    assert described["schema"] == "lpvid/diagnosis/2" and described["verdict"] in {"explained", "partly-explained"}
    cause, = described["causes"]
    number = cause["parameters"][0]
    assert cause["name"] == "coulomb-friction" and abs(number["value"] - 30.0) < 4 * number["std"]  # half of 60 N
    assert shown.startswith(f"{described['verdict']}: coulomb-friction") and "LPV extension" in shown
    assert described["extended"]["model"] == "extended_model.json" and described["complete"]
    for key in ("baseline", "wrong", "causes", "rivals", "cannot_tell", "rejected", "extended"):
        assert key in described
    assert described["baseline"]["esr"]["held_out"] > described["extended"]["esr"]["held_out"] > 0
    assert described["audit"]["findings"]


@pytest.mark.slow
def test_the_extended_model_gives_the_figures_that_the_diagnosis_claims(written, files, tmp_path):
    out, _ = written
    described = json.loads((out / "diagnosis.json").read_text())
    run("validate", out / "extended_model.json", files[1], "--out", tmp_path / "v")
    figures = json.loads((tmp_path / "v" / "validation.json").read_text())
    assert figures["data"] == "held-out"
    assert figures["overall"]["free_run"]["esr"] == pytest.approx(described["extended"]["esr"]["held_out"], rel=1e-9)
    run("validate", out / "extended_lpv.json", files[1], "--out", tmp_path / "w")
    figures = json.loads((tmp_path / "w" / "validation.json").read_text())
    assert figures["overall"]["free_run"]["esr"] == pytest.approx(described["extended_lpv"]["esr"]["after"], rel=1e-9)
    assert described["extended_lpv"]["gain_percent"] > 15


@pytest.mark.slow
def test_the_extended_model_as_baseline_leaves_nothing(written, files):
    shown = run("diagnose", files[0], "--baseline", written[0] / "extended_model.json", "--json").stdout
    described = json.loads(shown)
    assert described["verdict"] == "nothing-to-explain" and not described["causes"]
    assert described["baseline"]["name"] == "guo+coulomb-friction"


@pytest.mark.seconds
def test_the_report_opens_in_a_browser(files, tmp_path):
    report = diagnosed(files, tmp_path / "out")[0] / "report.html"  # drawn, which `written` is not
    page = report.read_text()
    assert "<h1>Diagnosis of guo</h1>" in page and "http" not in page.replace("http://www.w3.org", "")
    assert page.count("data:image/svg+xml") >= 5 and "coulomb-friction" in page
    if BROWSER is None:
        pytest.skip("no browser here")
    shot = tmp_path / "page.png"
    screenshot(report, shot, tmp_path / "profile", 1200, 3000)
    assert shot.stat().st_size > 50_000


@pytest.mark.slow
def test_reversed_records_are_diagnosed_and_said(tmp_path):
    record = bench("coulomb-friction").run(road(), 0).flip("force")
    found = lpv.diagnose(record, "guo", SOME)
    assert [c.name for c in found.causes] == ["coulomb-friction"]
    assert found.causes[0].parameters[0].value == pytest.approx(60.0, rel=0.05)
    assert "reversed polarity" in found.notes[0]
    run_of_it = lpv.simulate(lpv.load(lpv.save(found.extended, tmp_path / "m.json")), record).output[:, 0]
    assert np.mean((run_of_it - record["force"]) ** 2) < 4e-3 * np.var(record["force"])


@pytest.mark.slow
def test_given_parameters_and_other_names_of_channels(tmp_path):
    record = bench().run(road(6.0), 0)
    other = lpv.Record({n: record.channel(r) for n, r in (("F", "force"), ("v", "velocity"), ("i", "current"))},
                       record.sample_time, name="run")
    file = write_csv(other, tmp_path / "run.csv")
    given = tmp_path / "set.json"
    given.write_text(json.dumps({"model": "linear", "parameters": {"damping": "900 N*s/m"}}))
    described = json.loads(
        run(
            "diagnose",
            file,
            "--baseline",
            "linear",
            "--parameters",
            given,
            "--input",
            "v",
            "--output",
            "F",
            "--schedule",
            "i",
            "--json",
        ).stdout
    )
    force, velocity = record["force"], record["velocity"]
    esr = np.sum((force - 900 * velocity) ** 2) / np.sum((force - force.mean()) ** 2)
    assert described["baseline"]["esr_as_given"]["training"] == pytest.approx(esr, rel=1e-3)
    assert described["baseline"]["esr"]["training"] < esr  # the search moves the slope; a line stays no yield law
    assert described["baseline"]["esr"]["training"] > 0.05


@pytest.mark.parametrize(("arguments", "stated"), [
    (["--baseline", "gou"], "no baseline 'gou'"),
    (["--baseline", "guo", "--catalogue", "quartercr"], "no catalogue 'quartercr'"),
    (["--baseline", "missing.json"], "no file 'missing.json'"),
    (["--baseline", "guo", "--parameters", "missing.json"], "no file 'missing.json'"),
    (["--baseline", "guo", "--role", "force=nothing"], "nothing"),
    (["--baseline", "quarter-car"], "has no road"),
    (["--baseline", "guo", "--plan-experiment"], "add --out DIR"),
])
def test_what_is_wrong_ends_in_one_line_and_nothing_is_written(files, tmp_path, arguments, stated):
    extra = [] if "--plan-experiment" in arguments else ["--out", tmp_path / "out"]
    result = run("diagnose", files[0], *arguments, *extra, code=2)
    assert stated in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.seconds
def test_an_interruption_keeps_what_is_known(files, tmp_path, monkeypatch):
    from lpvid.diagnosis.evidence import engine

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, "diagnose", stopped)
    result = run("diagnose", files[0], "--baseline", "guo", "--out", tmp_path, code=130)
    described = json.loads((tmp_path / "diagnosis.json").read_text())
    assert (
        not described["complete"] and not described["causes"] and described["wrong"] and "interrupted" in result.stderr
    )
    assert (tmp_path / "report.html").exists()


@pytest.mark.parametrize(("name", "strength"), [("coulomb-friction", 1.0), ("coil-lag", 0.5), ("asymmetry", 0.3),
                                                ("gas-stiffness", 1.0)])
@pytest.mark.slow
def test_closure(name, strength):
    """A cause is found; in the model extended by it nothing more is; its parameters do not move when asked again."""
    record = bench(name, strength).run(road(), 0)
    found = lpv.diagnose(record, "guo", SOME)
    assert [c.name for c in found.causes] == [name] and found.gain_percent > 20
    again = lpv.diagnose(record, found.extended, SOME)
    assert again.verdict == "nothing-to-explain" and not again.causes and not again.rivals
    assert again.before.esr_training == pytest.approx(found.after.esr_training, rel=0.02)


@pytest.mark.parametrize("name", ["coil-lag", "scheduling-degree", "asymmetry", "gas-stiffness"])
@pytest.mark.slow
def test_the_cause_in_an_lpv_model_gains_on_held_out_data(name):
    rig = bench(name)
    records = [rig.run(road(20.0, "test-1"), 0, k) for k in (0, 1)]
    structure = lpv.ARX(4, 4, 0, basis=lpv.Polynomial(("current",), 1), stage="tanh")
    found = measured_extension(records[:1], structure, [by_name(qc.effects.CATALOGUE)[name]], records[1:])
    assert found.gain_percent > 50


@pytest.mark.slow
def test_a_saved_lpv_model_is_a_baseline(tmp_path):
    """An LPV model of the clean damper, on a record of the same damper with dry friction."""
    clean = bench().run(road(name="test-1"), 0)
    structure = lpv.ARX(2, 2, 0, basis=lpv.Polynomial(("current",), 1), stage="tanh")
    file = lpv.save(lpv.identify(clean, structure).model, tmp_path / "model.json")
    record = bench("coulomb-friction", 2.0).run(road(name="test-1"), 0, 1)
    found = lpv.diagnose(record, file, [e for e in SOME if e.name in ("coulomb-friction", "coil-lag", "asymmetry")])
    assert [c.name for c in found.causes] == ["coulomb-friction"]
    assert found.causes[0].parameters[0].value == pytest.approx(120.0, rel=0.1)
    assert found.baseline["esr_as_given"]["training"] >= found.before.esr_training > 2 * found.after.esr_training
    again = lpv.load(lpv.save(found.extended, tmp_path / "m.json"))
    assert np.array_equal(again.predict(record), found.extended.predict(record))
    assert np.array_equal(lpv.simulate(again, record).output[:, 0][again.to_model(record.sample_time).start:],
                          again.predict(record)[again.to_model(record.sample_time).start:])


# -- experiments -----------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class SineCurrent:
    """A current that only ever swings at one frequency."""

    kind: ClassVar[str] = "sine-current"

    def current(self, samples, rate, rng, replicate):
        return 1.2 + 0.8 * np.sin(2 * np.pi * 3.0 * np.arange(samples) / rate)


@pytest.mark.slow
def test_what_constant_currents_cannot_tell_the_proposed_experiment_tells():
    rig = bench("coil-lag")  # its current sensor is noisy: that is no excitation
    records = [rig.run(road(8.0, "test-6"), 0, k) for k in (0, 3, 6)]
    found = lpv.diagnose(records, "guo", SOME)
    blind = {c.name: c for c in found.cannot_tell}
    assert found.verdict == "nothing-to-explain" and {"coil-lag", "command-delay"} <= set(blind)
    assert blind["coil-lag"].smallest_detectable is None and "constant" in blind["coil-lag"].reason
    proposal = plan_for(found)
    assert proposal is not None and "coil-lag" in proposal.names
    plan = parse_plan(proposal.text)
    measured = run_plan(replace(plan, rig=rig, experiments=(replace(plan.experiments[0], duration=15.0),)))
    described = lpv.diagnose(measured, "guo", SOME)
    assert [c.name for c in described.causes] == ["coil-lag"]
    assert described.causes[0].parameters[0].value == pytest.approx(0.02, rel=0.02)


@pytest.mark.slow
def test_rivals_under_a_sinusoidal_current_are_told_apart_by_the_proposed_experiment():
    """Behind a sine a lag of 4 ms and a delay of 4 ms are the same shift; behind steps they are not."""
    rig = bench("coil-lag", 0.2, current_noise=0.0)
    found = lpv.diagnose(rig.run(Experiment("sine", Road(), SineCurrent(), 15.0), 0), "guo", SOME)
    assert found.verdict == "cannot-tell" and not found.causes
    assert set(found.rivals[0].names) >= {"coil-lag", "command-delay"}
    proposal = plan_for(found)
    assert proposal is not None
    plan = parse_plan(proposal.text)
    described = lpv.diagnose(run_plan(replace(plan, rig=rig)), "guo", SOME)
    assert [c.name for c in described.causes] == ["coil-lag"] and not described.rivals
    assert described.causes[0].parameters[0].value == pytest.approx(0.004, rel=0.05)


def test_every_plan_can_be_run_and_is_for_a_cause_of_the_catalogue():
    known = {e.name for e in qc.effects.CATALOGUE}
    parts = {p.name: p for parts in PLANS.values() for p in parts}
    assert len(parts) == len({p for parts in PLANS.values() for p in parts})
    text = "\n".join(p.toml(("any",)) for p in parts.values())
    plan = parse_plan(text)
    assert [e.name for e in plan.experiments] == list(parts)
    short = replace(plan, experiments=tuple(replace(e, duration=1.0) for e in plan.experiments))
    assert all(np.isfinite(r["force"]).all() for r in run_plan(short))
    assert set(PLANS) - known <= {"input-nonlinearity"}


@pytest.mark.parametrize("rows", [3, 300])
def test_text_in_the_velocity_is_named(tmp_path, rows) -> None:
    """It was a missing velocity, or a record too short: the text was nowhere."""
    t = np.arange(rows) / 200
    lines = [f"{x:.4f},{0.01 * np.sin(9 * x):.6f},{0.09 * np.cos(9 * x) if k != 1 else 'abc'},{90 * np.cos(9 * x):.4f}"
             for k, x in enumerate(t)]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["time [s],displacement [m],velocity [m/s],force [N]", *lines]) + "\n")
    with pytest.raises(InputError, match="'velocity' is not all numbers: got text 'abc' in row 2"):
        lpv.diagnose(lpv.read(path), "linear")
