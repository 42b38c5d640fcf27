"""The commands, through their own door: what they print, what they write, how they end."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli import data as words
from lpvid.cli.app import app
from lpvid.errors import InputError, NumericalError

pytestmark = pytest.mark.usefixtures("undrawn")

RATE = 200.0
A1, B0, B1 = (-0.8, 0.1), (30.0, 20.0), (5.0, -10.0)
"""Coefficients of the true system as (constant, slope per ampere)."""


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def true_system(n: int = 1500, seed: int = 0) -> dict[str, np.ndarray]:
    """Current, velocity and force of y = −a1(p) y(k−1) + b0(p) u(k) + b1(p) u(k−1)."""
    rng = np.random.default_rng(seed)
    u = 0.1 * rng.standard_normal(n)
    p = np.repeat(rng.uniform(0, 2, n // 10 + 1), 10)[:n]
    y = np.zeros(n)
    for k in range(1, n):
        a, b0, b1 = (c + d * p[k] for c, d in (A1, B0, B1))
        y[k] = -a * y[k - 1] + b0 * u[k] + b1 * u[k - 1]
    return {"velocity": u, "current": p, "force": y}


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = ["" if header is None else header]
    rows += [",".join(repr(float(x)) for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


def measured(path: Path, n: int = 1500, seed: int = 0, **scales: float) -> Path:
    """The true system as a csv in mixed units."""
    s = true_system(n, seed)
    t = np.arange(n) / RATE
    return write(path, "time [s],velocity [mm/s],current [mA],force [N]", t, 1e3 * s["velocity"], 1e3 * s["current"],
                 scales.get("force", 1.0) * s["force"])


@pytest.fixture(scope="module")
def run1(tmp_path_factory) -> Path:
    return measured(tmp_path_factory.mktemp("data") / "run1.csv")


@pytest.fixture(scope="module")
def model(run1, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("model") / "out"
    run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--hold-out", "1/3", "--out",
        folder)
    return folder / "model.json"


def test_version_and_help():
    assert run("--version").stdout == f"lpvid {lpv.__version__}\n"
    shown = run("--help").stdout
    assert all(name in shown for name in ("inspect", "identify", "validate", "stability", "Exit codes"))


@pytest.mark.seconds
def test_door_opens_quickly_and_lazily():
    """The help loads none of the heavy libraries, not even numpy."""
    probe = ("import sys; from lpvid.cli.app import app; import lpvid.cli.data; "
             "print([m for m in ('numpy', 'scipy', 'matplotlib', 'cvxpy', 'numba', 'pint') if m in sys.modules])")
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert set(eval(done.stdout)) <= {"numpy"}
    command = [sys.executable, "-c", "from lpvid.cli import main; main()", "--help"]
    times = []
    for _ in range(3):
        before = os.times()
        subprocess.run(command, capture_output=True, check=True)
        after = os.times()  # of the processor: what else runs on the machine does not count
        times.append(after.children_user + after.children_system - before.children_user - before.children_system)
    assert min(times) < 0.7


@pytest.mark.seconds
def test_identify_finds_the_true_system(model):
    found = lpv.load(model)
    for current in (0.0, 0.7, 2.0):
        a, b, _ = found.coefficients([current])
        assert a[0, 0, 0] == pytest.approx(A1[0] + A1[1] * current, rel=1e-9)
        assert b[:, 0, 0] == pytest.approx([B0[0] + B0[1] * current, B1[0] + B1[1] * current], rel=1e-9)
    assert found.box.units == ("A",)


def test_identify_says_what_it_did(model):
    described = json.loads((model.parent / "identification.json").read_text())
    assert [row["name"] for row in described["parameters"][:2]] == ["a1[1]", "a1[current]"]
    assert all(row["std"] >= 0 for row in described["parameters"])
    assert described["training"]["data"] == "training" and described["held_out"]["data"] == "held-out"
    assert described["training"]["records"][0]["n_samples"] == 1000  # floor(2·1500/3) raw samples
    assert described["held_out"]["records"][0]["n_samples"] == 500
    assert described["held_out"]["overall"]["free_run"]["esr"] < 1e-20
    gaps = {g["form"]: g for g in described["realizations"]}
    assert gaps["augmented"]["exact"] and max(gaps["augmented"]["esr"]) < 1e-18
    assert not gaps["controllable"]["exact"] and max(gaps["controllable"]["esr"]) > 1e-6
    assert described["condition"] > 1 and described["audit"]["verdict"]
    assert (model.parent / "report.html").stat().st_size > 10_000


@pytest.mark.seconds
def test_json_is_alone_on_standard_output(run1, model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for arguments in (("inspect", run1), ("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0),
                      ("validate", model, run1), ("stability", model)):
        result = run(*arguments, "--json")
        assert json.loads(result.stdout)
        assert result.stderr == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.seconds
def test_validate_resamples_and_says_so(model, tmp_path):
    s, n = true_system(600, 3), 600
    slow = np.repeat(np.column_stack(list(s.values())), 2, axis=0)
    fast = write(tmp_path / "fast.csv", "time [s],velocity [m/s],current [A],force [N]", np.arange(2 * n) / (2 * RATE),
                 *slow.T)
    run("validate", model, fast, "--out", tmp_path / "v")
    described = json.loads((tmp_path / "v" / "validation.json").read_text())
    assert described["schema"] == "lpvid/validation/1"
    assert "<h1>Validation of model.json</h1>" in (tmp_path / "v" / "report.html").read_text()
    assert any("resampled to the model's 200 Hz" in note for note in described["notes"])
    assert described["records"][0]["n_samples"] == n
    assert {"esr", "fit_percent", "rmse", "rmse_unit"} <= set(described["overall"]["free_run"])
    assert described["overall"]["free_run"]["rmse_unit"] == "N"
    assert {"one_step", "free_run"} <= set(described["overall"]) and "extrapolation_share" in described
    assert (tmp_path / "v" / "report.html").exists()


def test_validate_takes_other_names_and_signs(model, tmp_path):
    s = true_system(400, 4)
    other = write(tmp_path / "other.csv", "t [s],v [m/s],i [A],F_cell [N]", np.arange(400) / RATE, s["velocity"],
                  s["current"], -s["force"])
    described = run("validate", model, other, "--input", "v", "--schedule", "i", "--role", "force=F_cell", "--flip",
               "F_cell", "--json")
    assert json.loads(described.stdout)["overall"]["free_run"]["esr"] < 1e-20
    wrong = run("validate", model, other, "--input", "v", "--schedule", "i", "--output", "F_cell", "--json")
    assert json.loads(wrong.stdout)["overall"]["free_run"]["esr"] == pytest.approx(4.0, rel=0.05)  # (y+y)²/y²


@pytest.mark.seconds
def test_a_sign_turned_in_some_files_only(model, run1, tmp_path):
    """Mixed signs, as on a dyno whose load cell was turned round between tests: each file says how it was read."""
    straight, turned = measured(tmp_path / "a1.csv", 300, 5), measured(tmp_path / "b-psi.csv", 300, 6, force=-1.0)
    described = json.loads(run("validate", model, straight, turned, "--flip", "force@*psi*", "--json").stdout)
    assert [r["free_run"]["esr"] < 1e-20 for r in described["records"]] == [True, True]
    mixed = json.loads(run("validate", model, straight, turned, "--json").stdout)
    assert mixed["records"][1]["free_run"]["esr"] == pytest.approx(4.0, rel=0.05)  # (y+y)²/y²
    for pattern in ("b-psi", "b-psi.csv", str(turned)):
        same = json.loads(run("validate", model, straight, turned, "--flip", f"force@{pattern}", "--json").stdout)
        assert same["records"] == described["records"]
    found = json.loads(run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--held-out",
                           turned, "--flip", "force@b-*", "--json").stdout)  # a pattern of held-out files alone
    assert found["held_out"]["overall"]["free_run"]["esr"] < 1e-18


def test_validate_further_ahead(model, tmp_path):
    other = measured(tmp_path / "run2.csv", 400, seed=9)
    described = json.loads(run("validate", model, other, "--horizon", 5, "--horizon", 20, "--json").stdout)
    assert described["overall"]["5_step"]["esr"] < 1e-20 and described["overall"]["20_step"]["esr"] < 1e-20


def test_validate_knows_training_data(model, run1, tmp_path):
    """The first two thirds of the file were fitted: the model says so, whatever it is asked."""
    lines = run1.read_text().splitlines()
    (tmp_path / "head.csv").write_text("\n".join(lines[:900]) + "\n")
    assert json.loads(run("validate", model, tmp_path / "head.csv", "--json").stdout)["data"] == "training"
    assert json.loads(run("validate", model, run1, "--training", "--json").stdout)["data"] == "training"


@pytest.mark.seconds
def test_velocity_is_derived_and_said(tmp_path):
    t = np.arange(3000) / RATE
    x = 0.01 * np.sin(2 * np.pi * 1.3 * t) + 0.004 * np.sin(2 * np.pi * 4.1 * t + 1)
    v = 0.01 * 2 * np.pi * 1.3 * np.cos(2 * np.pi * 1.3 * t) + 0.004 * 2 * np.pi * 4.1 * np.cos(2 * np.pi * 4.1 * t + 1)
    file = write(tmp_path / "x.csv", "time [s],displacement [mm],force [N]", t, 1e3 * x, 700.0 * v)
    result = run("identify", file, "--na", 0, "--nb", 1, "--nk", 0, "--hold-out", "0.25", "--out", tmp_path / "m")
    assert "velocity derived from displacement" in result.stdout
    found = lpv.load(tmp_path / "m" / "model.json")
    assert found.box.names == () and found.b.ravel() == pytest.approx([700.0], rel=1e-3)


def test_delay_is_chosen_when_left_open(run1):
    shown = run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2).stdout
    assert "took nk=0" in shown


@pytest.mark.thinned(3, "seconds")
@pytest.mark.parametrize("extra", [("--affine",), ("--basis", "spline", "--segments", 2), ("--ridge", "1e-12"),
                                   ("--shape", "tanh"), ("--affine-terms", 1), ("--na", 2)])
def test_richer_structures_hold_the_true_system(run1, extra):
    described = json.loads(run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, *extra,
                          "--json").stdout)
    assert described["training"]["overall"]["free_run"]["esr"] < 1e-6


def test_lagged_coefficients_are_exact_in_observer_form(run1):
    described = json.loads(run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--lagged",
                          "--json").stdout)
    gap = next(g for g in described["realizations"] if g["form"] == "observable")
    assert gap["exact"] and gap["causal"] and max(gap["esr"]) < 1e-18


def test_several_channels_by_repeat_or_comma(tmp_path):
    rng = np.random.default_rng(2)
    u, w, p, q = rng.standard_normal((4, 600))
    y = np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.4 * y[k - 1] + (2 + p[k]) * u[k] + (3 - q[k]) * w[k]
    file = write(tmp_path / "miso.csv", "time [s],u,w,p,q,y", np.arange(600) / RATE, u, w, p, q, y)
    common = ("identify", file, "--output", "y", "--na", 1, "--nb", 1, "--nk", 0, "--json")
    comma = run(*common, "--input", "u,w", "--schedule", "p,q")
    repeat = run(*common, "--input", "u", "--input", "w", "--schedule", "p", "--schedule", "q")
    assert comma.stdout == repeat.stdout
    assert json.loads(comma.stdout)["training"]["overall"]["free_run"]["esr"] < 1e-20


@pytest.mark.seconds
def test_state_space_in_the_form_asked_for(run1, tmp_path):
    run("identify", run1, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--form", "augmented", "--out",
        tmp_path / "m")
    assert isinstance(lpv.load(tmp_path / "m" / "state_space.json"), lpv.LPVStateSpace)


def test_held_out_files(run1, tmp_path):
    other = measured(tmp_path / "run2.csv", 500, seed=7)
    described = json.loads(
        run(
            "identify", run1, "--held-out", other, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--json"
        ).stdout
    )
    assert [r["name"] for r in described["held_out"]["records"]] == ["run2"]
    assert described["training"]["records"][0]["n_samples"] == 1500


# -- stability --------------------------------------------------------------------------------------------------------
GOLDEN = {"a": [[-1.63, 0.15], [0.964, -0.1745], [-0.149, 0.06372222], [-0.083, -0.01844444]], "b": [[0, 0], [1.0, 0]]}
"""Equation sheet 6.9: a fixed pole at 0.83, critical through −1 at 9.000 A."""


def golden(path: Path, upper: float = 2.5) -> Path:
    box = lpv.Scheduling(("current",), (0.0,), (upper,), units=("A",))
    return lpv.save(lpv.LPVTransferFunction.siso(**GOLDEN, basis=lpv.Polynomial("current", degree=1),
                                                 sample_time=1 / 512, scheduling=box), path)


def test_stability_of_the_golden_case(tmp_path):
    shown = run("stability", golden(tmp_path / "m.json"), "--out", tmp_path / "s").stdout
    assert "does not cover a moving scheduling variable" in shown
    described = json.loads((tmp_path / "s" / "stability.json").read_text())
    leaving = [c for c in described["critical"] if c["direction"] == "to-unstable"]
    assert leaving[0]["value"] == pytest.approx(9.0, abs=5e-3) and leaving[0]["crossing"] == "-1"
    assert described["range"] == {"current": [0.0, 2.5]} and described["frozen"]["stable"]
    assert {"kind", "rate_bound", "verified", "margin", "between_grid"} <= set(described["certificate"])
    assert described["certificate"]["verified"] and described["probability"] is None
    assert (tmp_path / "s" / "locus.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "s" / "report.html").exists()


@pytest.mark.seconds
def test_unstable_ends_with_three_and_the_result(tmp_path):
    file = golden(tmp_path / "m.json")
    for extra in (("--range", "0:10"), ("--range", "current=8:9.5", "--rate", "current=1")):
        shown = run("stability", file, *extra, "--out", tmp_path / "s", code=3).stdout
        assert "NOT stable" in shown
        described = json.loads((tmp_path / "s" / "stability.json").read_text())
        assert (
            not described["frozen"]["stable"] and not described["certified"] and described["frozen"]["max_modulus"] > 1
        )


@pytest.mark.seconds
def test_frozen_stable_is_not_enough(tmp_path):
    """Two matrices with poles on the real axis inside the circle whose alternation grows: no certificate, exit 3."""
    one, two = np.array([[0.0, 1.7], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.7, 0.0]])
    pair = lpv.LPVStateSpace(np.array([0.5 * (one + two), 0.5 * (two - one)]), np.zeros((2, 2, 1)), np.zeros((2, 1, 2)),
                             np.zeros((2, 1, 1)), lpv.Polynomial("p", degree=1), sample_time=1.0)
    lpv.save(pair, tmp_path / "pair.json")
    described = json.loads(run("stability", tmp_path / "pair.json", "--json", code=3).stdout)
    assert described["frozen"]["stable"] and described["frozen"]["max_modulus"] == pytest.approx(0.85, abs=1e-6)
    assert not described["certificate"]["verified"] and described["certificate"]["divergence"]["growth_rate"] > 0
    assert "only while the scheduling is constant" in described["verdict"]


@pytest.mark.seconds
def test_stability_with_covariance(model, tmp_path):
    """The model file carries its parameters' covariance: the share of stable draws is reported."""
    described = json.loads(run("stability", model, "--rate", 100, "--json").stdout)
    assert 0 <= described["probability"]["interval"][0] <= described["probability"]["probability"] <= 1
    assert described["probability"]["draws"] == 300
    described = json.loads(run("stability", model, "--rate", 100, "--draws", 40, "--json").stdout)
    assert described["probability"]["draws"] == 40


def test_stability_without_scheduling(tmp_path):
    plain = lpv.LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], lpv.Polynomial(), 0.1)
    lpv.save(plain, tmp_path / "m.json")
    described = json.loads(run("stability", tmp_path / "m.json", "--json").stdout)
    assert described["frozen"]["max_modulus"] == pytest.approx(0.5) and described["range"] == {}
    run("stability", tmp_path / "m.json", "--out", tmp_path / "s")
    assert (tmp_path / "s" / "locus.png").exists()


# -- results ----------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_existing_folder_keeps_its_other_files(run1, tmp_path):
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    (folder / "mine.txt").write_text("keep")
    run("inspect", run1, "--out", folder)
    run("inspect", run1, "--out", folder)
    assert sorted(p.name for p in folder.iterdir()) == [".results.json", "audit.json", "mine.txt", "report.html"]
    assert json.loads((folder / "audit.json").read_text())["schema"] == "lpvid/audit/1"
    assert [p.name for p in folder.parent.iterdir()] == ["b"]


@pytest.mark.seconds
def test_a_second_run_leaves_nothing_of_the_first(run1, tmp_path):
    """What the same command wrote before and does not write again goes; files of others stay."""
    folder = tmp_path / "out"
    common = ("identify", run1, "--schedule", "current", "--nk", 0, "--out", folder)
    run(*common, "--form", "controllable")
    run("inspect", run1, "--out", folder)
    (folder / "state_space.csv").write_text("mine")
    assert (folder / "state_space.json").exists()
    run(*common)
    left = {p.name for p in folder.iterdir()}
    assert "state_space.json" not in left
    assert {"model.json", "audit.json", "state_space.csv"} <= left


@pytest.mark.seconds
def test_a_folder_may_hold_the_data_and_the_results(run1, tmp_path):
    """Results that lie in the folder of the data are no data, with a pattern either; named by themselves they are."""
    data = shutil.copy(run1, tmp_path / "run.csv")
    run("identify", data, "--nk", 0, "--na", 1, "--nb", 1, "--out", tmp_path)
    words = ("validate", tmp_path / "model.json")
    for given in (tmp_path, tmp_path, tmp_path / "*.csv"):
        run(*words, given, "--out", tmp_path)
        assert [r["name"] for r in json.loads((tmp_path / "validation.json").read_text())["records"]] == ["run"]
    assert "no channel" in run(*words, tmp_path / "simulation.csv", code=2).stderr
    shutil.copy(data, tmp_path / "simulation.csv")  # the user's now, whatever the list names
    assert len(json.loads(run(*words, tmp_path, "--json").stdout)["records"]) == 2


@pytest.mark.parametrize("name", ["audit.json", "report.html"])
def test_a_file_of_the_users_is_not_replaced(run1, tmp_path, monkeypatch, name):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).write_text("mine")
    with monkeypatch.context() as patch:
        patch.setattr("lpvid.files.read", lambda *_, **__: pytest.fail("data were read"))
        shown = run("inspect", run1, "--out", folder, code=2).stderr
    assert f"its result {name} would replace a file of that name that this program did not write" in shown
    assert [p.name for p in folder.iterdir()] == [name] and (folder / name).read_text() == "mine"
    (folder / name).unlink()
    run("inspect", run1, "--out", folder)
    (folder / name).write_text("mine again")
    assert "or that was changed since" in run("inspect", run1, "--out", folder, code=2).stderr
    assert (folder / name).read_text() == "mine again"


@pytest.mark.seconds
def test_a_result_that_is_not_written_deletes_no_file_of_the_users(run1, tmp_path):
    run("identify", run1, "--nk", 0, "--out", tmp_path / "m")
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "certificate.json").write_text("mine")
    unstable = lpv.LPVTransferFunction.siso([[-1.5]], [[0.0], [1.0]], lpv.Polynomial(), 0.1)
    lpv.save(unstable, tmp_path / "u.json")
    CliRunner().invoke(app, ["stability", str(tmp_path / "u.json"), "--out", str(tmp_path / "s")])
    assert (tmp_path / "s" / "stability.json").exists()
    assert (tmp_path / "s" / "certificate.json").read_text() == "mine"


def test_an_output_folder_that_cannot_be_made_is_refused_before_the_work(run1, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("lpvid.files.read", lambda *_, **__: pytest.fail("data were read"))
    result = CliRunner().invoke(app, ["inspect", str(run1), "--out", str(tmp_path / "file" / "out")])
    assert result.exit_code == 2
    assert "is a file" in result.stderr


def test_it_is_said_that_nothing_was_saved(run1):
    result = CliRunner().invoke(app, ["inspect", str(run1)])
    assert result.exit_code == 0
    assert result.stderr.splitlines() == ["nothing was saved: --out DIR keeps the result and its report"]


def test_missing_parents_are_made(run1, tmp_path):
    run("inspect", run1, "--out", tmp_path / "x" / "y" / "z")
    assert (tmp_path / "x" / "y" / "z" / "audit.json").exists()


@pytest.mark.parametrize("error, code, line", [
    (InputError("no such thing", got="x"), 2, "error: no such thing: got x."),
    (NumericalError("it did not converge"), 3, "error: it did not converge"),
    (KeyboardInterrupt(), 130, "interrupted: nothing was written"),
])
def test_endings(run1, tmp_path, monkeypatch, error, code, line):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr("lpvid.auditing.audit", fail)
    result = run("inspect", run1, "--out", tmp_path / "o", code=code)
    assert result.stderr.strip() == line and result.stdout == ""
    assert not (tmp_path / "o").exists()


def test_bugs_keep_their_traceback(run1, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("a bug")

    monkeypatch.setattr("lpvid.auditing.audit", fail)
    with pytest.raises(RuntimeError, match="a bug"):
        CliRunner().invoke(app, ["inspect", str(run1)], catch_exceptions=False)


def test_nothing_is_left_when_writing_fails(run1, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("lpvid.export.serialise.write_json", fail)
    result = run("inspect", run1, "--out", tmp_path / "p" / "o", code=2)
    assert "No space left" in result.stderr and len(result.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


# -- words ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("text, value", [("1/3", 1 / 3), ("last-third", 1 / 3), ("33%", 0.33), ("0.25", 0.25),
                                         ("half", 0.5), ("last quarter", 0.25)])
def test_shares(text, value):
    assert words.share(text) == pytest.approx(value, rel=1e-12)


def test_rates_and_ranges():
    assert words.rates(None, ["p"]) is None
    assert words.rates(["125"], ["p"]) == 125.0
    assert words.rates(["p=1", "q=2.5"], ["p", "q", "r"]) == {"p": 1.0, "q": 2.5, "r": None}
    assert words.interval("-1:2", "--range") == ("", (-1.0, 2.0))
    with pytest.raises(InputError, match="NAME=R"):
        words.rates(["p=1", "2"], ["p", "q"])
    with pytest.raises(InputError, match="no scheduling variable 'r'; there are p, q"):
        words.rates(["r=1"], ["p", "q"])
    with pytest.raises(InputError, match="names 'p' twice"):
        words.rates(["p=1,p=2"], ["p", "q"])


def test_sample_rate_of_a_file_without_clock(tmp_path):
    s = true_system(600)
    file = write(tmp_path / "bare.csv", "velocity [m/s],current [A],force [N]", *s.values())
    run("identify", file, "--schedule", "current", code=2)
    described = json.loads(
        run(
            "identify", file, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0, "--sample-rate", 200, "--json"
        ).stdout
    )
    assert described["training"]["overall"]["free_run"]["esr"] < 1e-20


def test_only_files_without_a_clock_take_the_rate(run1, tmp_path):
    """A rate for resampling is no remark on a file's clock, also when another file has none."""
    file = write(tmp_path / "bare.csv", "velocity [m/s],current [A],force [N]", *true_system(600, 5).values())
    described = json.loads(run("identify", run1, file, "--schedule", "current", "--na", 1, "--nb", 2, "--nk", 0,
                          "--sample-rate", 200, "--json").stdout)
    assert [r["n_samples"] for r in described["training"]["records"]] == [1500, 600]
    assert not any("sets the clock" in note for note in described["notes"])


def test_validate_a_file_without_clock(model, tmp_path):
    """Measured at twice the model's rate, every sample twice: resampled to the model's."""
    twice = [np.repeat(x, 2) for x in true_system(600, 6).values()]
    file = write(tmp_path / "bare.csv", "velocity [m/s],current [A],force [N]", *twice)
    described = json.loads(run("validate", model, file, "--sample-rate", 400, "--json").stdout)
    assert described["records"][0]["n_samples"] == 600 and any("resampled" in note for note in described["notes"])
    clocked = measured(tmp_path / "clocked.csv", 300)
    assert "own rate" in run("validate", model, clocked, "--sample-rate", 400, code=2).stderr


@pytest.mark.seconds
def test_an_interrupt_from_the_keyboard(tmp_path):
    """A real signal to a real process, while it works: 130, one line, nothing written."""
    program = ("import os, signal, threading, lpvid.auditing as a\n"
               "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell may ignore it
               "def slow(*_, **__):\n"
               "    os.kill(os.getpid(), signal.SIGINT)\n"
               "    threading.Event().wait(20)\n"
               "a.audit = slow\n"
               "from lpvid.cli import main\n"
               "main()")
    file = measured(tmp_path / "run.csv", 50)
    done = subprocess.run([sys.executable, "-c", program, "inspect", str(file), "--out", str(tmp_path / "o")],
                          capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 130 and done.stderr == "interrupted: nothing was written\n" and done.stdout == ""
    assert [p.name for p in tmp_path.iterdir()] == ["run.csv"]
