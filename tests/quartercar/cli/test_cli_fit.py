"""`quartercar fit`, through its own door: what it prints, what it writes, how it ends."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import BROWSER, dump
from typer.testing import CliRunner

import lpvid as lpv
from quartercar.cli.app import app
from quartercar.dampers import MODELS

RATE = 400.0


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, ["fit", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def measured(path: Path, seed: int = 0, n: int = 900, sign: float = 1.0, header: str = "displacement [mm],"
             "velocity [mm/s],current [mA],force [kN]", factor: tuple[float, ...] = (1e3, 1e3, 1e3, 1e-3)) -> Path:
    """A csv of a damper with yield force and viscosity that follow the current, in mixed units."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    omega, phase = 2 * np.pi * np.array([0.9, 2.3, 5.1]), rng.uniform(0, 6, 3)
    x = 0.004 * np.sin(np.outer(t, omega) + phase).sum(axis=1)
    v = 0.004 * (omega * np.cos(np.outer(t, omega) + phase)).sum(axis=1)
    i = np.repeat(rng.integers(0, 3, n // 60 + 1), 60)[:n] / 2
    force = (250 + 600 * i) * np.tanh(15 * v) + (500 + 300 * i) * v + 10 * rng.standard_normal(n)
    named = dict(zip(("displacement", "velocity", "current", "force"), (x, v, i, sign * force), strict=True))
    columns = [named[c.split(" ")[0]] for c in header.split(",")]
    rows = [f"time [s],{header}"]
    for k in range(n):
        cells = [repr(float(c[k] * f)) for c, f in zip(columns, factor, strict=True)]
        rows.append(",".join([repr(float(t[k])), *cells]))
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("data")
    return measured(folder / "a-run.csv", 0), measured(folder / "b-run.csv", 1)


@pytest.fixture(scope="module")
def written(files, tmp_path_factory) -> tuple[Path, str]:
    out = tmp_path_factory.mktemp("fit") / "out"
    return out, run(files[0], "--held-out", files[1], "--models", "linear,guo,power-law", "--out", out).stdout


@pytest.fixture(autouse=True)
def drawn_once(written, without_drawing) -> Iterator[None]:
    """What other tests write than `written` needs no pictures."""
    with without_drawing():
        yield


def test_it_writes_the_comparison_the_models_the_figures_and_a_report(written):
    out, _ = written
    assert {p.name for p in out.iterdir() if p.name[0] != "."} == {
        "comparison.json", "report.html", "linear.json", "guo.json", "power-law.json", "ranking.png",
        "force_time.png", "force_velocity.png", "law.png"}
    assert all(p.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and p.stat().st_size > 8000 for p in out.glob("*.png"))
    page = (out / "report.html").read_text()
    assert page.count('<figure class="traces"') == 1 and "The fitted law by current" in page
    assert "<h1>Damper models compared</h1>" in page and "http" not in page.replace("http://www.w3.org", "")


def test_the_table_is_that_of_the_saved_models(written, files):
    """comparison.json against free runs of the models that were written, by the definition of ESR."""
    out, shown = written
    described = json.loads((out / "comparison.json").read_text())
    assert described["schema"] == "quartercar/comparison/1" and described["best"] == "guo"
    assert shown.splitlines()[0] == described["verdict"]
    record, *_ = lpv.read(files[1])
    for row in described["models"]:
        model = lpv.load(out / f"{row['name']}.json").simulate(record).output[:, 0]
        force = record["force"][described["data"]["first_sample"]:]
        esr = np.sum((force - model[described["data"]["first_sample"]:]) ** 2) / np.sum((force - force.mean()) ** 2)
        assert row["held_out"]["free_run"]["esr"] == pytest.approx(esr, rel=1e-6)
        assert row["held_out"]["free_run"]["n_samples"] == force.size
    assert [m["held_out"]["free_run"]["esr"] for m in described["models"]] == sorted(
        m["held_out"]["free_run"]["esr"] for m in described["models"])


def test_json_alone_on_standard_output(files):
    result = run(files[0], "--models", "linear", "--json")
    described = json.loads(result.stdout)
    assert result.stderr == "" and described["models"][0]["name"] == "linear"
    assert any("the last third of every record" in n for n in described["notes"])
    assert described["data"]["held_out"][0]["n_samples"] == 300  # 900 − floor(2·900/3)


@pytest.mark.seconds
def test_hold_out_and_seed(files):
    described = json.loads(run(files[0], "--models", "guo", "--hold-out", "1/4", "--json").stdout)
    assert described["data"]["held_out"][0]["n_samples"] == 225
    again = json.loads(run(files[0], "--models", "guo", "--hold-out", "1/4", "--seed", 0, "--json").stdout)
    assert again["models"][0]["parameters"] == described["models"][0]["parameters"]


@pytest.mark.seconds
def test_models_that_are_none_of_their_training_data_are_a_shortfall(files, tmp_path, monkeypatch):
    """Every free run as bad as the mean: the files are written all the same."""
    monkeypatch.setattr("quartercar.dampers.evaluation.compared.Comparison.fails", True)
    shown = run(files[0], "--models", "linear", "--out", tmp_path / "out", code=3).stdout
    assert "No fitted model simulates the data that it was fitted to better than their mean." in shown.splitlines()[0]
    assert (tmp_path / "out" / "comparison.json").exists()


@pytest.mark.seconds
def test_channels_of_other_names(files, tmp_path):
    plain = json.loads(run(files[0], "--models", "guo", "--json").stdout)
    text = files[0].read_text()
    for old, new in (("displacement [", "s ["), ("velocity [", "vel ["), ("current [", "coil ["), ("force [", "F [")):
        text = text.replace(old, new, 1)
    (tmp_path / "other.csv").write_text(text)
    renamed = json.loads(run(tmp_path / "other.csv", "--input", "vel,s", "--schedule", "coil", "--output", "F",
                             "--models", "guo", "--json").stdout)
    assert renamed["models"][0]["held_out"]["free_run"]["esr"] == pytest.approx(
        plain["models"][0]["held_out"]["free_run"]["esr"], rel=1e-9)
    roles = json.loads(run(tmp_path / "other.csv", "--role", "velocity=vel,displacement=s", "--role",
                           "current=coil,force=F", "--models", "guo", "--json").stdout)
    assert roles["models"][0]["parameters"] == renamed["models"][0]["parameters"]


@pytest.mark.seconds
def test_a_voltage_stands_in_and_it_says_so(files, tmp_path):
    (tmp_path / "v.csv").write_text(files[0].read_text().replace("current [mA]", "voltage [mV]"))
    shown = run(tmp_path / "v.csv", "--models", "guo").stdout
    assert "'voltage' stands for it" in shown


@pytest.mark.seconds
def test_an_interruption_before_any_model_is_done_ends_with_one_line(files, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("quartercar.dampers.evaluation.comparison.in_processes", interrupted)
    result = run(files[0], "--models", "linear", "--out", tmp_path / "out", code=130)
    assert result.stderr.splitlines()[-1] == "interrupted: nothing was written"
    assert "Traceback" not in result.output and not (tmp_path / "out").exists()


@pytest.mark.seconds
def test_reversed_polarity_comes_first_and_flip_mends_it(files, tmp_path):
    turned = measured(tmp_path / "t-psi.csv", 0, sign=-1.0)
    shown = run(turned, "--models", "guo").stdout
    assert shown.startswith("Reversed polarity")
    flipped = json.loads(run(turned, "--models", "guo", "--flip", "force", "--json").stdout)
    plain = json.loads(run(files[0], "--models", "guo", "--json").stdout)
    assert flipped["data"]["polarity"] == 1
    kept = json.loads(run(turned, "--models", "guo", "--json").stdout)
    assert kept["data"]["polarity"] == -1
    for a, b in zip(kept["models"][0]["parameters"], plain["models"][0]["parameters"], strict=True):
        assert a["value"] == pytest.approx(b["value"], rel=1e-3)
    line = run(files[1], turned, "--models", "linear", code=2).stderr
    assert len(line.splitlines()) == 1 and "t-psi" in line and "--flip" in line
    mended = json.loads(run(files[1], turned, "--models", "linear", "--flip", "force@*psi*", "--json").stdout)
    assert mended["data"]["polarity"] == 1 and len(mended["data"]["training"]) == 2


def test_a_displacement_of_the_wrong_unit_is_stated(files, tmp_path):
    """Millimetres written as metres: the velocity is a thousandth of the displacement's slope."""
    text = files[0].read_text().replace("displacement [mm]", "displacement [m]", 1)
    (tmp_path / "wrong.csv").write_text(text)
    shown = run(tmp_path / "wrong.csv", "--models", "linear").stdout
    assert shown.count("velocity-scale") == 1 and "0.001 times the derivative of 'displacement'" in shown
    assert "velocity-scale" not in run(files[0], "--models", "linear").stdout


@pytest.mark.seconds
def test_a_published_set_beside_the_fits(files, tmp_path):
    (tmp_path / "handbook.json").write_text(json.dumps({"model": "guo", "parameters": {}}))
    described = json.loads(
        run(files[0], "--models", "linear", "--parameters", tmp_path / "handbook.json", "--json").stdout
    )
    assert sorted(m["name"] for m in described["models"]) == ["guo (handbook)", "linear"]
    alone = json.loads(run(files[0], "--parameters", tmp_path / "handbook.json", "--json").stdout)
    assert [m["name"] for m in alone["models"]] == ["guo (handbook)"] and alone["models"][0]["fitted"] is False


def test_a_model_file_is_run_again_as_it_was(files, written):
    out, _ = written
    described = json.loads((out / "comparison.json").read_text())
    again = json.loads(run(files[0], "--held-out", files[1], "--models", "linear", "--parameters", out / "guo.json",
                           "--json").stdout)
    esr = {m["name"]: m["held_out"]["free_run"]["esr"] for m in described["models"]}
    assert again["models"][0]["name"] == "guo (as given)"
    assert again["models"][0]["held_out"]["free_run"]["esr"] == pytest.approx(esr["guo"], rel=1e-9)


def test_list_names_every_model():
    shown = run("--list").stdout
    assert [line.split()[0] for line in shown.splitlines()] == [name for name, _, _ in MODELS]


BAD = {
    "unknown model": (("--models", "gou"), ("gou", "guo")),
    "no such role": (("--role", "force=F"), ("F",)),
    "two schedules": (("--schedule", "current,force"), ("--schedule",)),
    "an input that is no motion": (("--input", "current"), ("--input current", "--role")),
    "absurd share": (("--hold-out", "2"), ("--hold-out",)),
    "no parameter file": (("--parameters", "nowhere.json"), ("nowhere.json",)),
    "a rate below zero": (("--sample-rate", "-3"), ("--sample-rate",)),
    "flip of no file": (("--flip", "force@zzz"), ("zzz",)),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_words_end_with_one_line_and_nothing_written(case, files, tmp_path):
    words, parts = BAD[case]
    arguments = [*(() if words[0] == "--models" else ("--models", "linear")), *words]
    result = run(files[0], *arguments, "--out", tmp_path / "out", code=2)
    lines = result.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: ") and result.stdout == ""
    assert all(part in lines[0] for part in parts), lines[0]
    assert not (tmp_path / "out").exists()


def test_bad_data_end_with_one_line(files, tmp_path):
    text = files[0].read_text()
    (tmp_path / "a.csv").write_text(text.replace("force [kN]", "load [kN]"))
    assert "no force" in run(tmp_path / "a.csv", "--models", "linear", code=2).stderr
    (tmp_path / "b.csv").write_text(text.replace("force [kN]", "force [raw]"))
    assert "unknown unit" in run(tmp_path / "b.csv", "--models", "linear", code=2).stderr
    assert "both training and held-out" in run(files[0], "--held-out", files[0], code=2).stderr
    bare = measured(tmp_path / "c.csv", header="velocity [m/s],force [N]", factor=(1.0, 1.0))
    line = run(bare, "--models", "kwok", code=2).stderr
    assert "no damper model could be fitted" in line and "displacement" in line and len(line.splitlines()) == 1


@pytest.mark.seconds
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_a_report_opens_in_a_browser(written, tmp_path):
    dom = dump(written[0] / "report.html", tmp_path)
    assert "Damper models compared" in dom and dom.count("<figure>") >= 3


@pytest.mark.slow
def test_real_random_data(shared_data):
    """The prototype MR damper at 3004.8 Hz: decimated, the voltage standing for the current."""
    file = shared_data / "mr_damper_random" / "estimation.csv"
    described = json.loads(run(file, "--models", "linear,guo", "--json").stdout)
    assert described["best"] == "guo" and described["data"]["sample_rate"] == pytest.approx(500.8, rel=1e-6)
    assert described["models"][0]["held_out"]["free_run"]["esr"] < 0.13
    assert any("decimated by 6" in n for n in described["notes"]) and any("voltage" in n for n in described["notes"])


@pytest.mark.seconds
def test_published_parameters_on_real_data(shared_data, tmp_path):
    """Fourteen published Bouc-Wen parameters of the very prototype, not fitted: ESR about 0.055 on the raw record."""
    from quartercar.dampers import BoucWen
    from quartercar.dampers.laws.bouc_wen import LORD

    file = shared_data / "mr_damper_random" / "estimation.csv"
    lpv.save(BoucWen.from_published(LORD, current_range=(0.0, 2.25)), tmp_path / "lord.json")
    described = json.loads(run(file, "--parameters", tmp_path / "lord.json", "--sample-rate", 3004.8, "--json").stdout)
    row, = described["models"]
    assert row["name"] == "bouc-wen (lord)" and not row["fitted"]
    assert row["training"]["free_run"]["esr"] == pytest.approx(0.055, abs=0.006)
    assert "extrapolates" in row["flags"]  # the driver's command leaves 0 to 2.25 V now and then


@pytest.mark.seconds
def test_a_budget_too_small_for_any_model_names_its_mend(files):
    message = run(files[0], "--models", "wang-kamath", "--budget", 1, code=2).stderr
    assert "not done within --budget 1 s" in message and "Mend: a larger --budget" in message


@pytest.mark.seconds
def test_what_a_budget_does_not_cover_is_stated(files):
    shown = run(files[0], "--models", "linear", "--budget", 60)
    assert re.search(r"--budget 60: reading [\d.]+ s, fits and their comparison [\d.]+ s, report [\d.]+ s",
                     shown.stderr)


@pytest.mark.seconds
@pytest.mark.parametrize(("columns", "sign", "stated", "absent"), [
    ("displacement [mm],velocity [mm/s],force [kN]", 1.0, "--controller passive --out ride", "compare control laws"),
    ("displacement [mm],velocity [mm/s],force [kN]", -1.0, "fit again with --flip force", "quartercar ride"),
    ("displacement [mm],velocity [mm/s],current [mA],force [kN]", 1.0, "compare control laws", "--controller passive"),
])
def test_the_next_step_is_one_that_the_model_can_take(columns, sign, stated, absent, tmp_path):
    """A damper without current has no laws to compare, and one of reversed polarity is refused by `ride`."""
    factor = (1e3, 1e3, 1e-3) if "current" not in columns else (1e3, 1e3, 1e3, 1e-3)
    run(measured(tmp_path / "run.csv", sign=sign, header=columns, factor=factor), "--models", "guo", "--out",
        tmp_path / "out")
    page = re.sub("<[^>]+>", "", (tmp_path / "out" / "report.html").read_text().partition("<h2>Ranking")[0])
    assert stated in page and absent not in page


def test_a_record_that_the_held_out_share_makes_too_short_names_that_share(tmp_path):
    line = run(measured(tmp_path / "short.csv", n=60), "--models", "linear", code=2).stderr
    assert "got 40 samples in the longest; 50 are needed; --hold-out last-third leaves 40 of 60 samples" in line
    assert "Mend: hold out a smaller share, or a longer record" in line


def test_text_is_named_where_the_record_is_too_short_to_be_cut(tmp_path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("time [s],velocity [m/s],force [N]\n0,0.1,abc\n")
    found = CliRunner().invoke(app, ["fit", str(path)])
    assert found.exit_code == 2 and "'force' is not all numbers: got text 'abc' in row 1" in found.stderr
