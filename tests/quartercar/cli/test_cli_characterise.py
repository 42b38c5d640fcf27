"""`quartercar characterise`, through its own door: what it writes, how bad input ends, and the shared measurements."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from quartercar.cli.app import app

pytestmark = pytest.mark.usefixtures("undrawn")
RATE = 400.0
GROUPS = {
    "mr_damper_sines": (), "mr_damper_random": (), "mr_damper_fixed_voltage": (), "labcontrol_0V": (),
    "labcontrol_0.87V": (), "labcontrol_1.98V": (), "labcontrol_voltages": (),
    "race_damper_dyno": ("--flip", "force@t1_1*"), "emps": (), "bouc_wen": (), "silverbox": (),
}
"""Every damper group, and the motion-and-force records beside them."""


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, ["characterise", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def csv_of(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = np.column_stack(list(columns.values()))
    path.write_text(",".join(columns) + "\n" + "\n".join(",".join(f"{x:.9g}" for x in row) for row in rows) + "\n")
    return path


def motion(n: int = 2000, amplitude: float = 0.02, frequency: float = 1.6) -> dict[str, np.ndarray]:
    t = np.arange(n) / RATE
    x = amplitude * np.sin(2 * np.pi * frequency * t)
    v = 2 * np.pi * frequency * amplitude * np.cos(2 * np.pi * frequency * t)
    return {"time [s]": t, "displacement [m]": x, "force [N]": 1500.0 * v + 100 * np.tanh(v / 0.01)}


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("characterise")
    return folder / "out", run(csv_of(folder / "run.csv", motion()), "--out", folder / "out").stdout


@pytest.mark.seconds
def test_it_writes_tables_json_figures_and_a_report(written):
    out, shown = written
    names = {p.name for p in out.iterdir() if p.name[0] != "."}
    assert {"forces.csv", "characteristics.csv", "characterisation.json", "report.html", "peak_velocity.png",
            "continuous_velocity.png", "force_displacement.png", "static.png", "drift.png"} <= names
    page = (out / "report.html").read_text()
    assert "<h1>Damper characteristics</h1>" in page and "http" not in page.replace("http://www.w3.org", "")
    assert len(page) < 1_500_000
    found = json.loads((out / "characterisation.json").read_text())
    assert found["schema"] == "quartercar/characterisation/1" and shown.splitlines()[0] == found["verdict"]


def test_the_table_has_the_force_of_the_formula(written):
    out, _ = written
    rows = list(csv.DictReader((out / "forces.csv").read_text().splitlines()))
    given = [r for r in rows if r["force [N]"]]
    assert {float(r["speed [m/s]"]) for r in given} == {0.05, 0.1, 0.13}
    for r in given:
        v = float(r["speed [m/s]"]) * (1 if r["direction"] == "rebound" else -1)
        assert float(r["force [N]"]) == pytest.approx(1500 * v + 100 * np.tanh(v / 0.01), abs=0.5)
    assert all("run a sine of" in r["why_none"] for r in rows if not r["force [N]"])


def test_the_report_says_what_to_run(written):
    out, shown = written
    page = (out / "report.html").read_text()
    for text in ("run a triangle of ±2 mm at 1 mm/s", "no channel &#39;current&#39;", "0.26, 0.3, 0.52, 0.6, 1.05 m/s"):
        assert text in page
    assert "missing:" in shown


@pytest.mark.seconds
def test_options_change_what_they_say(tmp_path):
    file = csv_of(tmp_path / "S1_a.csv", motion())
    other = csv_of(tmp_path / "S2_a.csv", {**motion(), "force [N]": 1.1 * motion()["force [N]"]})
    found = json.loads(run(file, other, "--speeds", "0.15,.08", "--rebound", "negative", "--specimen", "(S[0-9])_",
                           "--tolerance", "3%", "--json").stdout)
    assert [f["speed"] for f in found["forces"][:2]] == [0.08, 0.15]
    assert {s["count"] for s in found["specimens"]} == {2}
    assert [c["inside"] for c in found["tolerance"]] == [False] * 8
    assert all((c["force"] < 0) == (c["direction"] == 1) for c in found["tolerance"])


@pytest.mark.seconds
def test_a_nominal_table_of_an_earlier_run(written, tmp_path):
    out, _ = written
    file = csv_of(tmp_path / "run.csv", {**motion(), "force [N]": 1.04 * motion()["force [N]"]})
    inside = json.loads(run(file, "--tolerance", "5%", "--nominal", out / "forces.csv", "--json").stdout)
    assert len(inside["tolerance"]) == 6 and all(c["inside"] for c in inside["tolerance"])
    table = tmp_path / "band.csv"
    table.write_text("speed [mm/s],direction,lower [N],upper [kN]\n100,rebound,200,0.25\n130,compression,-250,-.2\n")
    found = json.loads(run(file, "--tolerance", table, "--json").stdout)["tolerance"]
    assert [(c["lower"], c["upper"], c["inside"]) for c in found] == [(200.0, 250.0, False), (-250.0, -200.0, False)]


@pytest.mark.seconds
def test_a_model_is_drawn_beside_the_measurement(tmp_path):
    file = csv_of(tmp_path / "run.csv", motion())
    model = tmp_path / "linear.json"
    from quartercar.dampers.laws.linear import Linear

    lpv.save(Linear(values={"damping": 1500.0, "stiffness": 0.0, "mass": 0.0, "offset": 0.0}), model)
    run(file, "--damper", model, "--out", tmp_path / "out")
    rows = list(csv.DictReader((tmp_path / "out" / "forces.csv").read_text().splitlines()))
    for r in (r for r in rows if r["force [N]"]):
        sign = 1 if r["direction"] == "rebound" else -1
        assert float(r["model [N]"]) == pytest.approx(sign * 1500 * float(r["speed [m/s]"]), abs=0.5)
        assert float(r["model_less_measured [N]"]) == pytest.approx(-sign * 100, abs=1.0)
    assert "linear" in (tmp_path / "out" / "report.html").read_text()


def without(*names: str) -> dict[str, np.ndarray]:
    return {k: v for k, v in motion().items() if k.split(" ")[0] not in names}


BAD = {
    "no motion": (without("displacement"), "neither displacement nor velocity"),
    "no force": (without("force"), "no record has a force"),
    "too short": ({k: v[:20] for k, v in motion().items()}, "long enough"),
    "at rest": ({**motion(), "displacement [m]": np.full(2000, 0.01)}, "nothing moves"),
    "a dead load cell": ({**motion(), "force [N]": np.full(2000, 80.0)}, "the force never moves"),
    "all NaN": ({**motion(), "force [N]": np.full(2000, np.nan)}, "no number"),
    "wrong unit": ({("displacement [kg]" if k.startswith("disp") else k): v for k, v in motion().items()}, "unit"),
    "unknown unit": ({("force [blub]" if k.startswith("force") else k): v for k, v in motion().items()}, "unit"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_ends_with_one_line(name, tmp_path):
    columns, stated = BAD[name]
    result = run(csv_of(tmp_path / "bad.csv", columns), "--out", tmp_path / "out", code=2)
    assert result.stderr.startswith("error: ") and len(result.stderr.splitlines()) == 1 and stated in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [
    ("--rebound", "up"), ("--speeds", "fast"), ("--speeds", "0,1"), ("--speeds", "3 kg"), ("--tolerance", "much"),
    ("--nominal", "x.csv"),
    ("--tolerance", "5%", "--nominal", "nowhere.csv"), ("--specimen", "("), ("--specimen", "Z+"),
    ("--delay", "force"), ("--delay", "force=3kg")])
def test_bad_options_end_with_one_line(arguments, tmp_path):
    result = run(csv_of(tmp_path / "run.csv", motion()), *arguments, code=2)
    assert result.stderr.startswith("error: ") and len(result.stderr.splitlines()) == 1


def test_one_way_motion_gives_one_direction(tmp_path):
    t = np.arange(2000) / RATE
    ramp = {"time [s]": t, "displacement [m]": 0.02 * t + 2e-4 * np.sin(3 * t), "force [N]": 30 + np.sin(t)}
    found = json.loads(run(csv_of(tmp_path / "ramp.csv", ramp), "--speeds", "0.02", "--json").stdout)
    assert all(f["force"] is None for f in found["forces"] if f["direction"] == -1)
    assert found["missing"]


def test_gaps_and_unequal_rates_are_cut_and_used(tmp_path):
    holed = motion()
    holed["force [N]"][900:905] = np.nan
    slow = {k: v[::4] for k, v in motion().items()}
    found = json.loads(run(csv_of(tmp_path / "a.csv", holed), csv_of(tmp_path / "b.csv", slow), "--speeds", "0.1",
                           "--json").stdout)
    assert len(found["records"]) == 3 and {round(r["sample_rate"]) for r in found["records"]} == {100, 400}
    assert all(abs(abs(f["force"]) - 250) < 1 for f in found["forces"])


def test_a_displacement_in_the_wrong_unit_is_a_caveat(tmp_path):
    wrong = {**motion(), "displacement [m]": 1e3 * motion()["displacement [m]"]}
    found = json.loads(run(csv_of(tmp_path / "mm.csv", wrong), "--json").stdout)
    assert any("stroke of 40 m" in c for c in found["caveats"])


# -- shared measurements -------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_every_shared_group_yields_a_page(group, shared_data, tmp_path):
    run(shared_data / group, *GROUPS[group], "--out", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "characterisation.json").read_text())
    assert found["records"] and (tmp_path / "out" / "report.html").stat().st_size < 1_500_000
    for loop in found["loops"]:
        assert loop["energy"] > 0 and loop["frequency"] > 0
        if loop["loss_angle"] is not None:
            assert 0 < loop["loss_angle"] < np.pi


def branch_mean(x: np.ndarray, f: np.ndarray, period: float, speed: float) -> float:
    """Force at a speed by numpy alone: linear interpolation at every passage of the smoothed derivative, averaged."""
    width = max(3, round(0.02 / period) | 1)
    v = np.convolve(np.gradient(x, period), np.ones(width) / width, "same")
    middle = slice(x.size // 5, -x.size // 5)
    v, f = v[middle], f[middle]
    k = np.flatnonzero((v[:-1] - speed) * (v[1:] - speed) < 0)
    share = (speed - v[k]) / (v[k + 1] - v[k])
    up = v[k + 1] > v[k]
    forces = f[k] + share * (f[k + 1] - f[k])
    return 0.5 * (float(forces[up].mean()) + float(forces[~up].mean()))


@pytest.mark.parametrize(("file", "flip", "speed"), [
    ("mr_damper_sines/10mm1Hz0A.csv", 1, 0.05), ("mr_damper_sines/10mm1Hz1A.csv", 1, 0.05),
    ("race_damper_dyno/t1_1_1_18_18_s5_n10_150psi.csv", -1, 0.1),
    ("race_damper_dyno/t1_2_2_24_24_s5_n10_100psi.csv", 1, 0.1), ("labcontrol_0V/ensaio1.1.csv", 1, 0.05),
    ("labcontrol_1.98V/ensaio.B.1.csv", 1, 0.05)])
def test_forces_of_measured_records_are_those_of_direct_interpolation(file, flip, speed, shared_data):
    import quartercar as qc
    from quartercar.characterisation import CharacteriseSettings

    (record,) = lpv.read(shared_data / file)
    found = qc.characterise(record, CharacteriseSettings(speeds=(speed,), raw=True))
    period = record.time_base.period
    for f in found.given:
        plain = branch_mean(record["displacement"], flip * record["force"], period, f.direction * speed)
        span = float(np.ptp(record["force"]))
        assert f.force == pytest.approx(plain, abs=0.02 * span), (f, plain)
    assert len(found.given) == 2


@pytest.mark.seconds
def test_a_heated_damper_fades(shared_data):
    """Hot air on a race damper over 95 cycles: force falls as the temperature rises; numpy's line agrees."""
    import quartercar as qc

    (record,) = lpv.read(shared_data / "race_damper_dyno" / "t1_3_3_24_24_s5_n100_100psi_with_heat_gun.csv")
    found = qc.characterise(record)
    for d in found.drifts:
        assert d.cycles >= 90 and d.warmest > d.coolest
        n = record.n_samples // 95
        side = d.direction * record["force"][: 95 * n].reshape(95, n)
        peak = np.quantile(side, 0.98, axis=1)
        line = np.polyfit(np.arange(95), peak, 1)
        assert d.change == pytest.approx(line[0] * 94 / peak.mean(), abs=0.02)


@pytest.mark.seconds
def test_results_never_replace_the_data_that_were_read(tmp_path):
    data = csv_of(tmp_path / "forces.csv", motion())
    before = data.read_bytes()
    message = run(data, "--out", tmp_path, code=2).stderr
    assert "forces.csv would replace the file of that name that was read" in message
    assert data.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["forces.csv"]
    run(csv_of(tmp_path / "run.csv", motion()), "--tolerance", "10%", "--out", tmp_path / "out")
    run(tmp_path / "run.csv", "--tolerance", "10%", "--nominal", tmp_path / "out" / "forces.csv", "--out",
        tmp_path / "out")  # its own earlier table is no data: it may be replaced


@pytest.mark.seconds
def test_speeds_may_have_a_unit(tmp_path):
    shown = run(csv_of(tmp_path / "run.csv", motion()), "--speeds", "100 mm/s,0.15", "--json").stdout
    assert sorted({f["speed"] for f in json.loads(shown)["forces"]}) == [0.1, 0.15]
