"""Every structure through the command line: identify, stability, validate; a choice by itself; a second fit."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.signals import Signal

pytestmark = pytest.mark.usefixtures("undrawn")

RATE = 200.0
LEVEL = 0.02
"""Noise over output."""


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def write(path: Path, **columns: np.ndarray) -> Path:
    units = {"time": "time [s]", "velocity": "velocity [m/s]", "current": "current [A]", "force": "force [N]"}
    rows = [",".join(units.get(n, n) for n in columns)]
    rows += [",".join(repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


def system(n: int, seed: int = 0) -> dict[str, np.ndarray]:
    """x(k) = (0.8 − 0.1 p) x(k−1) + (30 + 20 p) u(k), measured with white output noise."""
    rng = np.random.default_rng(seed)
    u, p = 0.1 * rng.standard_normal(n), np.repeat(rng.uniform(0, 2, n // 10 + 1), 10)[:n]
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = (0.8 - 0.1 * p[k]) * x[k - 1] + (30 + 20 * p[k]) * u[k]
    y = x + LEVEL * x.std() * rng.standard_normal(n)
    return {"time": np.arange(n) / RATE, "velocity": u, "current": p, "force": y}


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("data") / "run.csv", **system(600))


def pole_at_one_ampere(described: dict) -> float:
    """−a1 at 1 A, from the parameters of identification.json."""
    values = {row["name"]: row["value"] for row in described["parameters"]}
    norm = described["normalisation"]
    return -(values["a1[1]"] + values["a1[current]"] * (1.0 - norm["centre"][0]) / norm["half_width"][0])


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("structure, options, noise", [
    ("arx", (), "equation"), ("oe", (), "output"), ("bj", ("--nc", 1, "--nd", 1), "box-jenkins"),
    ("armax", ("--nc", 1), "armax"), ("riv", (), "output"), ("riv", ("--nc", 1, "--nd", 1), "box-jenkins"),
    ("recursive", ("--forgetting", 1.0), "equation")])
def test_transfer_functions_find_the_pole(file, structure, options, noise):
    described = json.loads(
        run(
            "identify",
            file,
            "--schedule",
            "current",
            "--structure",
            structure,
            "--na",
            1,
            "--nb",
            1,
            "--nk",
            0,
            *options,
            "--json",
        ).stdout
    )
    assert described["noise"]["kind"] == noise
    assert described["structure"]["kind"].replace("refined-iv", "riv") == structure
    assert pole_at_one_ampere(described) == pytest.approx(0.7, abs=0.01)
    assert described["training"]["overall"]["free_run"]["esr"] == pytest.approx(LEVEL**2 / (1 + LEVEL**2), rel=0.25)
    if noise == "output":  # the noise is white and on the output: nothing is left in the residual
        assert described["training"]["residual_tests"][0]["passed"]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("structure, options", [("subspace", ("--order", 1)),
                                                ("pem-ss", ("--order", 1, "--innovation")),
                                                ("coprime", ("--na", 1, "--nb", 2))])
def test_state_space(file, tmp_path, structure, options):
    """One state holds the system up to when p is read: within 10 % of the output's spread, stable, no forms."""
    run("identify", file, "--schedule", "current", "--structure", structure, "--nk", 0, *options, "--hold-out", "1/3",
        "--out", tmp_path)
    described = json.loads((tmp_path / "identification.json").read_text())
    assert described["held_out"]["overall"]["free_run"]["fit_percent"] > 85 and described["realizations"] == []
    found = lpv.load(tmp_path / "model.json")
    assert isinstance(found, lpv.LPVStateSpace)
    assert np.abs(found.frozen_poles([1.0])).max() == pytest.approx(0.7, abs=0.05)
    if structure == "coprime":
        return  # the rest is alike for every state space
    page = (tmp_path / "report.html").read_text()
    assert "<h2>How sure the model is</h2>" in page and "<h2>State-space forms</h2>" not in page
    judged = json.loads(run("stability", tmp_path / "model.json", "--json").stdout)
    assert judged["certified"] and judged["probability"]["draws"] == 300


@pytest.mark.seconds
def test_noise_of_a_box_jenkins_model_does_not_concern_its_stability(file, tmp_path):
    run("identify", file, "--schedule", "current", "--structure", "bj", "--na", 1, "--nb", 1, "--nk", 0, "--out",
        tmp_path)
    assert json.loads(run("stability", tmp_path / "model.json", "--json").stdout)["certified"]
    again = json.loads(run("validate", tmp_path / "model.json", file, "--training", "--json").stdout)
    described = json.loads((tmp_path / "identification.json").read_text())
    assert again["overall"]["free_run"]["esr"] == pytest.approx(described["training"]["overall"]["free_run"]["esr"])


@pytest.mark.thinned(4, "slow", "seconds")
@pytest.mark.parametrize("structure, options", [("arx", ("--na", 1, "--nb", 1, "--nk", 0)),
                                                ("oe", ("--na", 1, "--nb", 1, "--nk", 0)),
                                                ("coprime", ("--na", 1, "--nb", 1, "--nk", 0)),
                                                ("compliance", ("--segments", 1))])
def test_a_scheduling_filter_is_compared_with_none(file, structure, options):
    common = ("identify", file, "--schedule", "current", "--structure", structure, *options, "--hold-out", "1/2",
              "--json")
    described, bare = json.loads(run(*common, "--schedule-lag").stdout), json.loads(run(*common).stdout)
    assert described["scheduling_stage"]["kind"] == "lag" and bare["scheduling_stage"] is None
    esr = bare["held_out"]["overall"]["free_run"]["esr"]
    assert any(
        f"without the scheduling filter, held-out: free-run ESR {esr:.4g}" in note for note in described["notes"]
    )
    assert described["scheduling_stage"]["tau_rise"] < 1 / RATE  # there is none in the system


# -- models that schedule themselves ----------------------------------------------------------------------------------
def bounds(judged: dict) -> list[tuple[float, float]]:
    return [(row["inputs_within"], row["output_within"]) for row in judged["output_bounds"]]


def largest(model, amplitude: float) -> float:
    """Largest output from rest over inputs that switch at random between ±amplitude, and a constant one."""
    rng = np.random.default_rng(3)
    held = [np.repeat(rng.choice([-1.0, 1.0], 600 // k + 1), k)[:600] for k in (1, 3, 20, 600)]
    p = np.repeat(rng.uniform(model.box.lower, model.box.upper, (60, len(model.box.names))), 10, axis=0)
    return max(float(np.abs(model.free_run(amplitude * u[:, None], p, np.zeros(model.start), 1e12)[0]).max())
               for u in held)


@pytest.mark.seconds
@pytest.mark.parametrize("structure, options", [("quasi", ("--nb", 2, "--segments", 4, "--odd", 100, "--trial", 2)),
                                                ("compliance", ("--segments", 1))])
def test_bounded_by_construction(file, tmp_path, structure, options):
    run("identify", file, "--schedule", "current", "--structure", structure, *options, "--out", tmp_path)
    described = json.loads((tmp_path / "identification.json").read_text())
    assert described["structure"]["kind"] in ("quasi-lpv", "compliance") and described["realizations"] == []
    judged = json.loads(run("stability", tmp_path / "model.json", "--out", tmp_path / "s", "--json").stdout)
    assert judged["certified"] and judged["certificate"]["kind"] == "by construction"
    assert judged["certificate"]["verified"] and judged["certificate"]["between_grid"]
    model = lpv.load(tmp_path / "model.json")
    for amplitude, bound in bounds(judged):
        assert 0 < largest(model, amplitude) <= bound
    assert "by construction" in (tmp_path / "s" / "report.html").read_text()
    again = json.loads(run("validate", tmp_path / "model.json", file, "--json").stdout)
    assert again["overall"]["free_run"]["esr"] == pytest.approx(described["training"]["overall"]["free_run"]["esr"])


def feedback(steep: float) -> QuasiLPVModel:
    """y(k) = a(ρ) y(k−1) + u(k), with a = 0.5 at ρ = −1 and `steep` at ρ = 1."""
    theta = [[[-0.5, 1.0, 0.0]], [[-steep, 1.0, 0.0]]]
    return QuasiLPVModel(theta, lpv.Spline("y", 1, 1, (-1.0, 1.0)), 1, (1,), (0,), 0.1, (Signal("u"),), (Signal("y"),))


def test_feedback_is_covered_by_the_embedding(tmp_path):
    lpv.save(feedback(0.8), tmp_path / "m.json")
    shown = run("stability", tmp_path / "m.json", "--out", tmp_path / "s").stdout
    assert "moves freely within the clamped range" in shown
    judged = json.loads((tmp_path / "s" / "stability.json").read_text())
    assert judged["certified"] and judged["range"] == {"rho": [-1.0, 1.0]}
    assert judged["frozen"]["max_modulus"] == pytest.approx(0.8)
    assert np.array(bounds(judged)) == pytest.approx(np.array([(0.1, 0.5), (1.0, 5.0)]))  # U/(1 − 0.8)
    assert largest(feedback(0.8), 1.0) <= 5.0


@pytest.mark.seconds
def test_what_no_embedding_covers_is_open_and_ends_with_three(tmp_path):
    lpv.save(feedback(1.1), tmp_path / "m.json")
    shown = run("stability", tmp_path / "m.json", "--out", tmp_path / "s", code=3).stdout
    assert "Not certified" in shown and "open" in shown
    judged = json.loads((tmp_path / "s" / "stability.json").read_text())
    assert not judged["certified"] and judged["output_bounds"] == []
    assert (tmp_path / "s" / "locus.png").exists() and (tmp_path / "s" / "report.html").exists()


def test_ranges_and_rates_of_a_self_scheduled_model(tmp_path):
    spring = Element([[-100.0, 0.0, 100.0], [-200.0, 0.0, 300.0]], 1000.0)
    box = lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",))
    lpv.save(ComplianceModel((spring,), np.array([-1.0, 0.0, 1.0]), np.zeros(1), np.zeros(0), 0.0, 0.1,
                             (Signal("velocity", "m/s"),), (Signal("force", "N"),),
                             lpv.Spline("current", 1, 1).bound(box), box), tmp_path / "model.json")
    judged = json.loads(run("stability", tmp_path / "model.json", "--range", "0.5:1", "--rate", 3, "--json").stdout)
    assert judged["range"] == {"current": [0.5, 1.0]}
    assert np.array(bounds(judged)) == pytest.approx(np.array([(0.1, 30.0), (1.0, 300.0)]))  # the steeper law's end
    assert "voltage" in run("stability", tmp_path / "model.json", "--range", "voltage=0:1", code=2).stderr


# -- a choice by itself -----------------------------------------------------------------------------------------------
def plain(n: int, seed: int, noise: float = 0.2) -> tuple[dict[str, np.ndarray], float]:
    """Second-order system without units, its output with white noise; and the noise over the measured spread."""
    rng = np.random.default_rng(seed)
    u, x = rng.standard_normal(n), np.zeros(n)
    for k in range(2, n):
        x[k] = 1.2 * x[k - 1] - 0.5 * x[k - 2] + u[k - 1]
    e = noise * rng.standard_normal(n)
    return {"time": np.arange(n) / RATE, "u": u, "y": x + e}, float(e.std() / (x + e).std())


@pytest.fixture(scope="module")
def chosen(tmp_path_factory) -> tuple[dict, dict, Path, float]:
    folder = tmp_path_factory.mktemp("auto")
    columns, share = plain(900, 0)
    write(folder / "a.csv", **columns)
    shown = run("identify", folder / "a.csv", "--input", "u", "--output", "y", "--auto", "--hold-out", "1/3", "--refit",
                "--out", folder / "out").stdout
    assert "chosen from" in shown and "what the noise leaves possible" in shown and "refitted to all data" in shown
    described = json.loads((folder / "out" / "identification.json").read_text())
    return described, json.loads((folder / "out" / "selection.json").read_text()), folder, share


@pytest.mark.seconds
def test_the_choice_reaches_the_ceiling(chosen):
    described, selection, _, share = chosen
    assert selection["schema"] == "lpvid/selection/1" and selection["complete"]
    assert selection["candidates"] == len(selection["table"]) > 50
    reached = described["held_out"]["overall"]["free_run"]["fit_percent"]
    assert reached == pytest.approx(100 * (1 - share), abs=0.6)
    assert selection["ceiling"]["held_out_fit_percent"] == pytest.approx(100 * (1 - share), abs=1.0)
    assert described["selection"]["best"] == selection["best"] and "identification" not in described["selection"]


@pytest.mark.seconds
def test_a_budget_states_what_came_on_top_of_it(tmp_path):
    write(tmp_path / "a.csv", **plain(300, 0)[0])
    shown = run("identify", tmp_path / "a.csv", "--input", "u", "--output", "y", "--auto", "--budget", "1")
    assert re.search(r"--budget 1: [\d.]+ s of processor time up to the model and its forms, [\d.]+ s for the report",
                     shown.stderr)


@pytest.mark.seconds
def test_an_interrupted_search_ends_with_130_and_its_best(tmp_path, monkeypatch):
    from lpvid.identification.selection.search import StructureSearch

    write(tmp_path / "a.csv", **plain(300, 0)[0])
    late, calls = StructureSearch.late, []

    def stop(self: StructureSearch) -> bool:
        if (ended := late(self)) or self.best is not None:
            calls.append(ended)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return ended

    monkeypatch.setattr(StructureSearch, "late", stop)
    shown = run("identify", tmp_path / "a.csv", "--input", "u", "--output", "y", "--auto", "--out", tmp_path / "out",
                code=130)
    assert "marked incomplete" in shown.stderr
    assert not json.loads((tmp_path / "out" / "selection.json").read_text())["complete"]


@pytest.mark.slow
def test_held_out_data_have_no_say(chosen, tmp_path):
    """Another last third changes the held-out figures and nothing else."""
    described, selection = chosen[:2]
    columns, _ = plain(900, 0)
    columns["y"] = np.where(np.arange(900) < 600, columns["y"], -5 * columns["y"] ** 2)
    other = write(tmp_path / "a.csv", **columns)
    again = json.loads(run("identify", other, "--input", "u", "--output", "y", "--auto", "--hold-out", "1/3",
                           "--json").stdout)
    assert again["selection"]["table"] == selection["table"] and again["parameters"] == described["parameters"]
    assert again["held_out"]["overall"]["free_run"]["esr"] > 0.5


@pytest.mark.seconds
def test_refit_writes_the_fit_to_all_data(chosen):
    described, _, folder, _ = chosen
    assert described["refitted"]["n_samples"] > described["n_samples"]
    written = lpv.load(folder / "out" / "model.json")
    assert written.metadata["training"]["n_samples"] == described["refitted"]["n_samples"]
    values = {row["name"]: row["value"] for row in described["refitted"]["parameters"]}
    assert written.a[0, 0, 0, 0] == pytest.approx(values["a1[1]"])
    assert values["a1[1]"] != {row["name"]: row["value"] for row in described["parameters"]}["a1[1]"]
    assert "How the structure was chosen" in (folder / "out" / "report.html").read_text()


# -- affine terms where the scheduling is constant -------------------------------------------------------------------
@pytest.mark.seconds
def test_one_affine_term_where_the_scheduling_stands_still(tmp_path):
    """Records at 0, 1 and 2 A with an offset of 5 − 2 p: one c_0, and a mend that names it when more are asked for."""
    rng = np.random.default_rng(0)
    files = []
    for p in (0.0, 1.0, 2.0):
        u, y = rng.standard_normal(200), np.zeros(200)
        for k in range(1, 200):
            y[k] = 0.5 * y[k - 1] + (3 + p) * u[k] + 5 - 2 * p
        files.append(write(tmp_path / f"{p:.0f}.csv", time=np.arange(200) / RATE, velocity=u,
                           current=np.full(200, p), force=y))
    common = ("identify", *files, "--schedule", "current", "--na", 1, "--nb", 1, "--nk", 0, "--json")
    described = json.loads(run(*common, "--affine").stdout)
    values = {row["name"]: row["value"] for row in described["parameters"]}
    assert [n for n in values if n.startswith("c")] == ["c0[1]", "c0[current]"]
    assert values["c0[1]"] == pytest.approx(3.0, abs=1e-8) and values["c0[current]"] == pytest.approx(-2.0, abs=1e-8)
    assert any("one affine term" in note for note in described["notes"])
    line = run(*common, "--affine-terms", 2, code=2).stderr
    assert "affine=1" in line and len(line.splitlines()) == 1


# -- the form that is used, re-estimated -------------------------------------------------------------------------------
def moving_form(n: int, seed: int) -> dict[str, np.ndarray]:
    """A canonical form whose scheduling takes a new value every third sample."""
    rng = np.random.default_rng(seed)
    u, p = 0.1 * rng.standard_normal(n), np.repeat(rng.uniform(0, 2, n // 3 + 1), 3)[:n]
    w, y = np.zeros(n + 1), np.zeros(n)
    for k in range(2, n + 1):
        w[k] = u[k - 1] + (1.4 - 0.4 * p[k - 1]) * w[k - 1] - (0.8 - 0.3 * p[k - 1]) * w[k - 2]
    y[1:] = (500 + 250 * p[1:]) * w[1:n] + (350 - 200 * p[1:]) * w[: n - 1]
    return {"time": np.arange(n) / RATE, "velocity": u, "current": p,
            "force": y + 0.01 * y.std() * rng.standard_normal(n)}


@pytest.mark.seconds
@pytest.mark.thinned(2)
@pytest.mark.parametrize("form", ["controllable", "observable"])
def test_refit_form_writes_the_form_with_its_own_figures(tmp_path, form):
    data = write(tmp_path / "run.csv", **moving_form(1500, 0))
    shown = run("identify", data, "--schedule", "current", "--na", 2, "--nb", 2, "--nk", 1, "--form", form,
                "--refit-form", "--hold-out", "1/3", "--out", tmp_path / "m").output
    assert "form re-estimated" in shown and "held-out" in shown
    described = json.loads((tmp_path / "m" / "form.json").read_text())
    esr = {name: parts["held-out"]["esr"] for name, parts in described["free_run"].items()}
    verdict = described["gap"]["verdict"]
    assert f"as realised {verdict}" in shown and described["gap"]["judgement"]["label"] == "training"
    if form == "controllable":
        assert esr["form re-estimated"] < 5e-4
    assert esr["form re-estimated"] < esr["form as realised"]
    model = lpv.load(tmp_path / "m" / "state_space.json")
    assert isinstance(model, lpv.LPVStateSpace) and model.metadata["free_run"] == described["free_run"]
    assert isinstance(lpv.load(tmp_path / "m" / "model.json"), lpv.LPVTransferFunction)
    summary = json.loads((tmp_path / "m" / "identification.json").read_text())["form_refit"]
    assert summary == {"form": form, "free_run": described["free_run"]}
    run("validate", tmp_path / "m" / "state_space.json", data)


@pytest.mark.slow
def test_refit_form_takes_stages_filter_and_affine_terms_and_all_data(tmp_path):
    data = write(tmp_path / "run.csv", **system(900))
    run("identify", data, "--schedule", "current", "--na", 1, "--nb", 1, "--nk", 0, "--shape", "three-zone",
        "--schedule-lag", "--affine-terms", 1, "--form", "controllable", "--refit-form", "--hold-out", "1/3", "--refit",
        "--out", tmp_path / "m")
    model = lpv.load(tmp_path / "m" / "state_space.json")
    assert model.input_stage is not None and model.scheduling_stage is not None
    whole, training = model.metadata["training"]["n_samples"], json.loads(
        (tmp_path / "m" / "form.json").read_text())["identification"]["training"]["overall"]["free_run"]
    assert whole == 900 and training["esr"] is not None


def test_refit_form_refuses_exact_forms_and_none(tmp_path):
    data = write(tmp_path / "run.csv", **system(300))
    for options, word in ((("--form", "augmented"), "--form controllable"), ((), "no --form")):
        result = CliRunner().invoke(app, ["identify", str(data), "--schedule", "current", "--refit-form", *options])
        assert result.exit_code == 2 and word in result.output and "Traceback" not in result.output
