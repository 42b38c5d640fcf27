"""An identified model on the command line: designed for, ridden, compared; one line where it is no damper for a car."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.identified_cases import RATE, model, run
from helpers.no_dampers import CAR_REFUSES, NO_DAMPERS, linear
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app as lpvid_app
from lpvid.export.tables import write_table
from lpvid.scheduling import Scheduling
from quartercar.cli.app import app
from quartercar.controllers import Skyhook
from quartercar.rig import default_records

pytestmark = pytest.mark.usefixtures("undrawn")

SHORT = """
seeds = 2
damper = "model.json"
[[roads]]
kind = "iso"
class = "F"
speed = 30.0
duration = 1.0
[[controllers]]
law = "passive"
[[controllers]]
law = "skyhook-linear"
"""


def call(*arguments: object, code: int = 0, of=app):
    result = CliRunner().invoke(of, list(map(str, arguments)), catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


def csv(path: Path, record, names=("velocity", "displacement", "voltage", "force")) -> Path:
    return write_table({"time": (record.times, "s"), **{n: (record[n], record.unit(n)) for n in names}}, path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("identified")
    lpv.save(model("arx"), path / "model.json")
    for name, (make, _) in {**NO_DAMPERS, **CAR_REFUSES}.items():
        lpv.save(make(), path / f"{name}.json")
    lpv.save(linear(b=[[400.0, -300.0]]), path / "active.json")
    lpv.save(linear(b=[[-4000.0, 5000.0]]), path / "wild.json")
    lpv.save(linear(sample_time=0.05), path / "slow.json")
    lpv.save(linear(sample_time=0.004), path / "quarter.json")
    lpv.save(Skyhook(), path / "controller.json")
    (path / "text.json").write_text("no model\n")
    (path / "text.csv").write_text("time,force\n0,1\n")
    (path / "ride.toml").write_text(SHORT)
    csv(path / "run.csv", run(1))
    return path


@pytest.mark.seconds
def test_it_rides_with_its_own_unit_and_range_and_says_where_it_extrapolates(folder, tmp_path):
    stated = call("ride", folder / "ride.toml", "--out", tmp_path).stdout
    described = json.loads((tmp_path / "ride.json").read_text())
    volts = run()["voltage"]
    assert described["damper"] == "identified" and described["coil"]["unit"] == "V"
    assert described["coil"]["lowest"] == pytest.approx(volts.min(), abs=0.02)
    assert described["coil"]["highest"] == pytest.approx(volts.max(), abs=0.02)
    assert described["sample_time"] == pytest.approx(1 / RATE)
    shares = [r["extrapolation"] for r in described["rides"]]
    assert all(s["current"] == 0 and 0 < s["speed"] < 1 for s in shares)
    beyond = [note for note in described["notes"] if "leaves its training records" in note]
    assert len(beyond) == 1 and "speed leaves" in beyond[0] and "m/s" in beyond[0]
    assert all(note in stated for note in described["notes"])
    assert f"command {described['coil']['lowest']:g} to {described['coil']['highest']:g} V, loop at 500 Hz" in stated


@pytest.mark.slow
def test_it_is_compared_as_it_is_with_fitted_dampers(folder, tmp_path):
    call("fit", folder / "run.csv", "--models", "linear", "--parameters", folder / "model.json", "--out", tmp_path)
    rows = json.loads((tmp_path / "comparison.json").read_text())["models"]
    assert [r["name"] for r in rows] == ["identified (model)", "linear"] and not rows[0]["fitted"]
    assert rows[0]["held_out"]["free_run"]["esr"] < 0.01


@pytest.mark.slow
def test_the_data_beside_it_are_read_as_its_training_data_were(folder, tmp_path):
    reading = {"time": "Zeit [ms]", "velocity": "v [mm/s]"}
    remembers = model("arx")
    roles = {**remembers.metadata["roles"], "velocity": "v"}
    lpv.save(remembers.replace(metadata={**remembers.metadata, "reading": reading, "roles": roles}),
             tmp_path / "m.json")
    record = run(1)
    others = ("displacement", "voltage", "force")
    columns = [1e3 * record.times, 1e3 * record["velocity"], *(record[n] for n in others)]
    header = ",".join(["Zeit", "v", *(f"{n} [{record.unit(n)}]" for n in others)])
    np.savetxt(tmp_path / "run.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    fitted = call("fit", tmp_path / "run.csv", "--parameters", tmp_path / "m.json").output
    page = call("characterise", tmp_path / "run.csv", "--damper", tmp_path / "m.json", "--json").output
    for printed in (fitted, page):
        assert "column 'v' is read in mm/s" in printed


@pytest.mark.seconds
def test_a_diagnosis_starts_from_it_although_the_channel_has_another_name(folder, tmp_path):
    call("diagnose", folder / "run.csv", "--baseline", folder / "model.json", "--out", tmp_path, of=lpvid_app)
    described = json.loads((tmp_path / "diagnosis.json").read_text())
    assert described["baseline"]["esr_as_given"]["training"] < 0.01 and described["verdict"] != "explained"
    if (tmp_path / "extended_model.json").exists():
        call("validate", tmp_path / "extended_model.json", folder / "run.csv", of=lpvid_app)


REFUSED = {**{n: stated for n, (_, stated) in {**NO_DAMPERS, **CAR_REFUSES}.items() if n != "unstable"},
           "unstable": "a pole of modulus 1.3 at current 2 A", "slow": "runs at 20 Hz only",
           "controller": "holds a controller, no damper", "text": "is not a JSON file", "none": "no file"}


@pytest.mark.parametrize("verb", ["design", "ride"])
@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_damper_for_a_car_ends_with_one_line_and_a_mend(folder, tmp_path, verb, case):
    result = call(verb, "--damper", folder / f"{case}.json", "--out", tmp_path / "out", code=2)
    assert REFUSED[case] in result.stderr and "Mend:" in result.stderr
    assert result.stderr.count("\n") == 1 and not (tmp_path / "out").exists()


@pytest.mark.parametrize("verb", ["simulate", "validate", "compare", "stability"])
def test_a_controller_given_as_a_model_ends_with_one_line_and_a_mend(folder, tmp_path, verb):
    data = [] if verb == "stability" else [folder / "run.csv"]
    result = call(verb, folder / "controller.json", *data, "--out", tmp_path / "out", code=2, of=lpvid_app)
    assert "Mend: give" in result.stderr and result.stderr.count("\n") == 1 and not (tmp_path / "out").exists()


def test_results_and_folders_lead_to_the_model_beside_or_in_them(folder):
    (folder / "identification.json").write_text('{"schema": "lpvid/identification/1"}\n')
    for given, stated in (("identification.json", "holds results, no model"), (".", "got a folder")):
        result = call("design", "--damper", folder / given, code=2).stderr
        assert stated in result and f"give '{folder / 'model.json'}'" in result


@pytest.mark.slow
def test_a_damper_without_current_is_ridden_with_a_note(folder, tmp_path):
    lpv.save(linear(b=[[400.0]], a=[[-0.5]], scheduling=Scheduling((), (), ())),
             folder / "fixed.json")
    stated = call(
        "ride",
        "--damper",
        folder / "fixed.json",
        "--controller",
        "passive",
        "--road",
        "bump@8",
        "--seeds",
        1,
        "--out",
        tmp_path,
    ).stdout
    assert "does not depend on the command" in stated and "--schedule current" in stated


def test_a_table_is_no_model(folder):
    assert "is no model file" in call("ride", "--damper", folder / "text.csv", code=2).stderr


def test_the_configuration_takes_it_too_and_names_itself_where_it_is_at_fault(folder, tmp_path):
    (folder / "bad.toml").write_text('damper = "several outputs.json"\n')
    for verb in ("design", "ride"):
        result = call(verb, folder / "bad.toml", code=2)
        assert "bad.toml:" in result.stderr and "has 2 outputs" in result.stderr and "Mend:" in result.stderr
    (folder / "good.toml").write_text('damper = "model.json"\n')
    for verb in ("design", "ride"):  # the option counts before the file
        stated = call(verb, "--damper", folder / "several outputs.json", folder / "good.toml", code=2).stderr
        assert "has 2 outputs" in stated


def test_a_coil_that_reaches_an_unstable_current_is_refused(folder):
    lpv.save(linear(a=[[-0.5, -0.2]]), folder / "edge.json")  # poles 0.5 + 0.2 i: stable below 2.5 A, records to 2 A
    (folder / "coil.toml").write_text('damper = "edge.json"\n[coil]\nhighest = 3.0\n')
    stated = call("ride", folder / "coil.toml", code=2).stderr
    assert "a pole of modulus 1.1 at current 3 A" in stated and "coil.toml" in stated


def test_a_damper_known_at_another_rate_than_the_loop_is_refused(folder):
    (folder / "known.toml").write_text('damper = "model.json"\nknown_damper = "quarter.json"\n')
    stated = call("ride", folder / "known.toml", code=2).stderr
    assert "runs at 250 Hz only" in stated and "a loop at 500 Hz" in stated and "--sample-rate 500" in stated


def test_negative_nominal_damping_names_currents_and_speeds(folder):
    stated = call("design", "--damper", folder / "active.json", code=2).stderr
    assert "nominal damping of the 'identified' damper must be positive: got -" in stated
    assert "gives energy at 1.4 to 2 A between" in stated and "--passive" in stated


def test_a_car_that_leaves_all_bounds_says_where_its_damper_gives_energy(folder):
    """F(k) = 0.5 F(k−1) + (5000 i − 4000) v(k): below 0.8 A, where a passive car rests, it drives the motion."""
    result = call("ride", "--damper", folder / "wild.json", "--controller", "passive", "--road", "bump@8", "--seeds", 1,
                  "--car", "megane", code=3)
    assert "left all bounds" in result.output and "it gives energy at 0 to" in result.output
    assert "--passive" in result.output


# -- what fit writes, in lpvid ---------------------------------------------------------------------------------------
MODELS = ("linear", "power-law", "power-law-friction-gas", "guo", "guo-6", "kwok", "narx-2", "network-parallel",
          "lpv-arx")
JUDGED = ("lpv-arx", "narx-2", "guo-6")
"""Models whose LPV form is one that lpvid judges: certified or not."""


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[Path, Path]:
    """Models of every family that are fitted within seconds, as `quartercar fit` writes them."""
    path = tmp_path_factory.mktemp("fit")
    record = default_records(part="training", names=["test-1"])[0].slice(0, 3000)
    data = csv(path / "rig.csv", record, ("velocity", "displacement", "current", "force"))
    call("fit", data, "--models", ",".join(MODELS), "--out", path / "fit")
    return data, path / "fit"


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_what_fit_writes_runs_in_lpvid_without_further_options(written, tmp_path, name):
    data, fit = written
    file = fit / f"{name}.json"
    if not file.exists():
        pytest.skip(f"{name} does not suit these data")
    described = json.loads(call("validate", file, data, "--json", of=lpvid_app).stdout)
    call("simulate", file, data, "--out", tmp_path, of=lpvid_app)
    again = json.loads((tmp_path / "simulation.json").read_text())
    assert again["overall"]["esr"] == pytest.approx(described["overall"]["free_run"]["esr"])
    damper, record = lpv.load(file), lpv.read(data)[0]
    table = lpv.read(tmp_path / "simulation.csv")[0]
    np.testing.assert_allclose(table["simulated"], damper.simulate(record).output[:, 0], rtol=0, atol=1e-6)
    result = CliRunner().invoke(lpvid_app, ["stability", str(file)], catch_exceptions=False)
    if result.exit_code == 2:
        assert "Mend:" in result.stderr and result.stderr.count("\n") == 1 and "no LPV form" in result.stderr
    assert result.exit_code in ((0, 3) if name in JUDGED else (0, 2, 3)), result.output


# -- the whole chain -------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_the_chain_on_a_record_of_the_rig(tmp_path):
    record = default_records(part="training", names=["test-1"])[0]
    data = csv(tmp_path / "rig.csv", record, ("velocity", "displacement", "current", "force"))
    chain(tmp_path, [data, "--schedule", "current", "--nk", 0, "--na", 2, "--nb", 2, "--affine"])
    assert json.loads((tmp_path / "ride" / "ride.json").read_text())["coil"]["unit"] == "A"


@pytest.mark.slow
def test_the_chain_on_a_measured_damper_with_a_random_voltage(shared_data, tmp_path):
    chain(tmp_path, [shared_data / "mr_damper_random" / "estimation.csv", "--role", "current=voltage", "--schedule",
                     "current", "--sample-rate", 500.8])
    described = json.loads((tmp_path / "ride" / "ride.json").read_text())
    assert described["coil"]["unit"] == "V" and 2.2 < described["coil"]["highest"] < 2.6
    assert described["sample_time"] == pytest.approx(1 / 500.8)


def chain(folder: Path, identification: list) -> None:
    """identify, design for the model, ride it under the controller."""
    call("identify", *identification, "--out", folder / "m", of=lpvid_app)
    damper = folder / "m" / "model.json"
    call("design", "--damper", damper, "--out", folder / "design")
    described = json.loads((folder / "design" / "synthesis.json").read_text())
    assert described["gamma_verified"] <= described["gamma"]
    call("ride", "--damper", damper, "--controller", folder / "design" / "controller.json", "--controller", "passive",
         "--road", "bump@8", "--seeds", 1, "--out", folder / "ride")
    rides = {r["controller"]: r["figures"] for r in json.loads((folder / "ride" / "ride.json").read_text())["rides"]}
    assert 0 < rides["controller"]["comfort"]["mean"] < 3 and rides["controller"]["dissipated"]["mean"] > 0
