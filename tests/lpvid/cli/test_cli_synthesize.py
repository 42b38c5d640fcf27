"""`lpvid synthesize` and `lpvid verify`, from the files to the exit codes."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.synthesis.design_file import DESIGNS, design_of, design_schema, plant_schema, template
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_file import plant_of

pytestmark = pytest.mark.usefixtures("undrawn")
SCHERER = """
name = "example 7 of Scherer, Gahinet & Chilali 1997"
inputs = ["noise", "push [N]"]
outputs = ["offset [m]", "effort", "sensor"]
controls = ["push"]
measurements = ["sensor"]
[matrices.1]
A = [[0, 10, 2], [-1, 1, 0], [0, 2, -5]]
B = [[1, 0], [0, 1], [1, 0]]
C = [[1, 0, 0], [0, 0, 0], [0, 1, 0]]
D = [[0, 0], [0, 1], [2, 0]]
"""
HINF = '[design]\ndesign = "output-feedback"\n'


def run(*arguments: object):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def written(folder: Path, text: str, name: str = "plant.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def no_model(path: Path) -> object:
    raise AssertionError(path)


def test_published_optimum_from_files_to_a_certificate_that_verifies(tmp_path):
    plant, out = written(tmp_path, SCHERER + HINF), tmp_path / "out"
    found = run("synthesize", plant, "--out", out)
    assert found.exit_code == 0, found.output
    assert {p.name for p in out.iterdir() if p.name[0] != "."} == {
        "controller.json", "synthesis.json", "closed_loop.json",
                                               "certificate.json", "report.html"}
    data = json.loads((out / "synthesis.json").read_text())
    assert data["schema"] == "lpvid/synthesis/1" and data["verdict"] == "solved"
    assert 9.508 <= data["gamma_verified"] <= 9.508 * 1.03 and data["gamma_lower"] <= data["gamma_verified"]
    controller = lpv.load(out / "controller.json")
    table = tomllib.loads(SCHERER)
    loop = close_loop(plant_of(table, tmp_path, no_model), controller)
    w = 1j * np.geomspace(1e-3, 1e3, 400)
    peak = max(np.linalg.svd(loop.to_control([])(s, squeeze=False))[1][0] for s in w)
    assert 9.0 < peak <= data["gamma_verified"]
    assert run("verify", out / "certificate.json", out / "closed_loop.json").exit_code == 0
    checked = run("verify", out / "synthesis.json")
    assert checked.exit_code == 0 and "--out" not in checked.output  # verify keeps nothing
    wrong = run("verify", out / "certificate.json", out / "controller.json")
    assert wrong.exit_code == 3 and "another model" in wrong.output
    assert "http" not in (out / "report.html").read_text().replace("http://www.w3.org", "")


def test_json_on_standard_output_is_json_alone(tmp_path):
    found = run("synthesize", written(tmp_path, SCHERER + HINF), "--json")
    assert json.loads(found.stdout)["verdict"] == "solved"


@pytest.mark.seconds
def test_a_bound_that_cannot_be_had_ends_with_three_and_its_mend(tmp_path):
    out = tmp_path / "out"
    found = run("synthesize", written(tmp_path, SCHERER + HINF + "bound = 9.0\n"), "--out", out)
    assert found.exit_code == 3 and "infeasible" in found.output
    data = json.loads((out / "synthesis.json").read_text())
    assert data["controller"] is None and data["mend"] and not (out / "controller.json").exists()
    assert (out / "report.html").exists()


@pytest.mark.parametrize(("change", "description"), [
    (('controls = ["push"]', 'controls = ["pusch"]'), "no control 'pusch'"),
    (("[0, 2, -5]]", "[0, 2]]"), "rows of equal length"),
    (("C = [[1, 0, 0], [0, 0, 0], [0, 1, 0]]", "C = [[1, 0, 0], [0, 0, 0]]"), "must have shape (3, 3)"),
    (("[matrices.1]", "[matrices.speed]"), "no scheduling variable 'speed'"),
    (("[matrices.1]", '[matrices."1 + x"]'), "product of scheduling variables"),
    (("A = ", "Ax = "), "lacks the constant part of A"),
    (('measurements = ["sensor"]', "measurements = 3"), "list of names"),
    (("name =", "nam ="), "did you mean 'name'"),
    (('design = "output-feedback"', 'design = "h-infinity"'), "no design 'h-infinity'"),
    (('design = "output-feedback"', 'design = "output-feedback"\nstates = 3'), "no key of the design"),
    (('design = "output-feedback"', 'design = "output-feedback"\nlyapunov_degree = 1'), "rate bound"),
    (('design = "output-feedback"', 'design = "observer"\ncriteria = [{kind = "h-infinity", performance = "x"}]'),
     "no performance signal 'x'"),
    (('design = "output-feedback"', 'design = "multi-objective"\nregions = [{kind = "cone"}]'), "lacks 'damping'"),
    (('"sensor"]\ncontrols', '"sensor"]\nmodel = "m.json"\ncontrols'), "not both"),
    (("inputs = [\"noise\"", "inputs = [\"noise [\""), "unit in brackets"),
    (("[matrices.1]", "[weights.offset]\ngain = 2\nkind = \"lowpass\"\n[matrices.1]"), "lacks 'corner'"),
    (("[matrices.1]", "[weights.ofset]\ngain = 2\n[matrices.1]"), "no signal to weigh 'ofset'"),
])
def test_faults_are_one_line_and_write_nothing(tmp_path, change, description):
    text = (SCHERER + HINF).replace(*change)
    assert text != SCHERER + HINF
    found = run("synthesize", written(tmp_path, text), "--out", tmp_path / "out")
    assert found.exit_code == 2 and not (tmp_path / "out").exists()
    assert description in found.stderr and found.stderr.startswith("error: ") and found.stderr.count("\n") == 1
    assert "plant.toml" in found.stderr


def test_missing_and_broken_files(tmp_path):
    assert "cannot read" in run("synthesize", tmp_path / "none.toml").stderr
    assert "is not TOML" in run("synthesize", written(tmp_path, "a = [")).stderr
    assert "has no design" in run("synthesize", written(tmp_path, SCHERER)).stderr
    assert "needs a plant" in run("synthesize").stderr
    assert run("verify", tmp_path / "none.json").exit_code == 2


@pytest.mark.seconds
def test_a_design_file_takes_the_place_of_the_table_and_a_saved_model_that_of_matrices(tmp_path):
    plant = plant_of(tomllib.loads(SCHERER), tmp_path, no_model)
    lpv.save(plant.system, tmp_path / "model.json")
    text = 'model = "model.json"\ncontrols = ["push"]\nmeasurements = ["sensor"]\n[weights.offset]\ngain = 0.5\n'
    design = written(tmp_path, 'design = "multi-objective"\ncriteria = [{kind = "h2"}]\n', "design.toml")
    found = run("synthesize", written(tmp_path, text), "--design", design, "--json")
    assert found.exit_code == 0, found.stderr
    data = json.loads(found.stdout)
    assert any(n.startswith("H2 from noise to offset, effort: at most") for n in data["notes"])


@pytest.mark.parametrize("entry", [
    ('kind = "lowpass"\ngain = 2.0\ncorner = {}'),
    ('kind = "performance"\nbandwidth = {}'),
    ('kind = "bandpass"\ngain = 2.0\ncentre = {}'),
])
@pytest.mark.parametrize("text, factor", [('"3 Hz"', 2 * np.pi * 3), ('"0.003 kHz"', 2 * np.pi * 3), ('"3 rad/s"', 3.0),
                                          ("3.0", 3.0)])
def test_hertz_of_an_angular_frequency_count_with_their_two_pi(tmp_path, entry, text, factor):
    """A corner of 3 Hz is one of 18.85 rad/s; a unit alone would make it 3."""
    def poles(value):
        table = f"{SCHERER.split('[weights')[0]}\n[weights.offset]\n{entry.format(value)}\n"
        system = plant_of(tomllib.loads(table), tmp_path, no_model).system
        return np.sort_complex(system.frozen_poles(system.box.grid(2)[0]))

    np.testing.assert_allclose(poles(text), poles(repr(factor)), rtol=1e-12)
    assert not np.allclose(poles(text), poles(repr(1.1 * factor)))


def test_powers_and_products_of_the_scheduling_are_what_they_say(tmp_path):
    text = """
inputs = ["w", "u"]
outputs = ["z", "y"]
controls = ["u"]
measurements = ["y"]
sample_time = "10 ms"
[scheduling.p]
range = [0, 2]
rate = 3
unit = "A"
[scheduling.q]
range = [-1, 1]
[matrices.1]
A = [[0.1]]
B = [[1, 1]]
C = [[1], [1]]
[matrices."p*q"]
A = [[0.2]]
[matrices."q^2"]
A = [[0.05]]
"""
    plant = plant_of(tomllib.loads(text), tmp_path, no_model)
    assert plant.system.frozen([2.0, 0.5])[0][0, 0] == pytest.approx(0.1 + 0.2 * 2 * 0.5 + 0.05 * 0.25)
    assert plant.sample_time == 0.01 and plant.box.rate == (3.0, None) and plant.box.units == ("A", "")


def test_the_template_loads_and_names_what_the_schema_knows(tmp_path):
    table = tomllib.loads(template())
    assert isinstance(design_of(table["design"], plant_of(table, tmp_path, no_model)), lpv.OutputFeedback)
    assert run("synthesize", "--template").stdout == template()
    assert json.loads(run("synthesize", "--schema").stdout) == plant_schema()
    assert set(table) <= set(plant_schema()["properties"])
    assert {d["properties"]["design"]["const"] for d in design_schema()["oneOf"]} == set(DESIGNS)


@pytest.mark.seconds
def test_the_schema_accepts_the_template_and_refuses_what_it_does_not_know():
    jsonschema = pytest.importorskip("jsonschema")
    table = tomllib.loads(template())
    jsonschema.validate(table, plant_schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**table, "extra": 1}, plant_schema())


@pytest.mark.parametrize("name", list(DESIGNS))
def test_every_design_is_reached_by_its_name(name, tmp_path):
    table = tomllib.loads(template())
    settings = {"back_off": 1.0} if "back_off" in DESIGNS[name][1] else {}
    design = design_of({"design": name, **settings}, plant_of(table, tmp_path, no_model))
    assert type(design) is DESIGNS[name][0]


@pytest.mark.seconds
def test_a_failed_design_leaves_no_controller_of_an_earlier_one(tmp_path):
    out = tmp_path / "out"
    assert run("synthesize", written(tmp_path, SCHERER + HINF), "--out", out).exit_code == 0
    assert (out / "controller.json").exists()
    assert run("synthesize", written(tmp_path, SCHERER + HINF + "bound = 1.0\n"), "--out", out).exit_code == 3
    assert sorted(p.name for p in out.iterdir() if p.name[0] != ".") == ["report.html", "synthesis.json"]


@pytest.mark.seconds
def test_a_quoted_gain_below_the_certified_one_does_not_hold(tmp_path):
    out = tmp_path / "out"
    run("synthesize", written(tmp_path, SCHERER + HINF), "--out", out)
    path = out / "synthesis.json"
    assert run("verify", path).exit_code == 0
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | {"gamma_verified": 0.9 * data["gamma_verified"]}))
    found = run("verify", path)
    assert found.exit_code == 3 and "is quoted" in found.output
    refused = run("verify", out / "controller.json")
    assert refused.exit_code == 2 and "holds no certificate" in refused.output


TURNING = """
inputs = ["push", "noise", "force"]
outputs = ["angle", "effort", "sensor"]
controls = ["force"]
measurements = ["sensor"]
[scheduling.c]
range = [-1.0, 1.0]
[scheduling.s]
range = [-1.0, 1.0]
[matrices.1]
A = [[0, 1], [-1, -0.4]]
B = [[0, 0, 0], [1, 0, 1]]
C = [[1, 0], [0, 0], [1, 0]]
D = [[0, 0, 0], [0, 0, 0.3], [0, 0.1, 0]]
[matrices.c]
A = [[0, 0], [0.8, 0.3]]
[matrices.s]
A = [[0, 0], [0.3, 0.8]]
"""


@pytest.mark.seconds
def test_a_hull_from_a_file_is_what_the_certificate_states(tmp_path):
    """The hexagon around the circle of (cos θ, sin θ); against the same design in Python."""
    hexagon = lpv.Hull.disc(("c", "s"), sides=6).vertices()
    text = TURNING + HINF + f"hull = {hexagon.tolist()}\n"
    out = tmp_path / "out"
    found = run("synthesize", written(tmp_path, text), "--out", out)
    assert found.exit_code == 0, found.output
    data = json.loads((out / "synthesis.json").read_text())
    assert data["verdict"] == "solved" and data["between_grid"]
    assert "polytope of 6 vertices" in json.loads((out / "certificate.json").read_text())["claim"]
    page = (out / "report.html").read_text()
    assert "whole scheduling polytope" in page and "polytope: c<" in page
    plant = plant_of(tomllib.loads(TURNING), tmp_path, no_model)
    same = lpv.synthesize(plant, lpv.OutputFeedback(hull=lpv.Hull.disc(("c", "s"), sides=6)))
    assert data["infimum"] == pytest.approx(same.infimum, rel=1e-3)
    assert run("verify", out / "certificate.json", out / "closed_loop.json").exit_code == 0
    again = tmp_path / "stability"
    examined = run("stability", out / "closed_loop.json", "--gain", "--out", again)
    assert examined.exit_code == 0 and "polytope of 6 vertices" in examined.output, examined.output
    stability = json.loads((again / "stability.json").read_text())
    np.testing.assert_allclose(np.sort(stability["hull"]["vertices"], axis=0), np.sort(hexagon, axis=0), atol=1e-9)
    assert stability["l2_gain"]["upper"] == pytest.approx(data["gamma_verified"], rel=0.03)
    assert stability["l2_gain"]["lower"] <= data["gamma_verified"]
    assert run("verify", again / "certificate.json", out / "closed_loop.json").exit_code == 0
    assert "hull of the design" in (again / "report.html").read_text()
    boxed = run("stability", out / "closed_loop.json", "--range", "c=-1:1", "--range", "s=-1:1", "--out", again)
    assert "polytope" not in boxed.output and json.loads((again / "stability.json").read_text())["hull"] is None


@pytest.mark.seconds
def test_a_moving_matrix_on_a_hull_from_a_file(tmp_path, monkeypatch):
    """A triangle at a tenth per second: below one X and Y, and its certificate, report and stability know the set."""
    monkeypatch.setattr("lpvid.analysis.certified_margins.PRECISION", 0.5)  # a few steps of the bisection
    text = TURNING.replace("range = [-1.0, 1.0]", "range = [-1.0, 1.0]\nrate = 0.1")
    hull = HINF + "hull = [[-1.0, -1.0], [1.0, -1.0], [0.0, 1.0]]\npoints = 4\n"
    still, moved = tmp_path / "still", tmp_path / "moved"
    for out, more in ((still, ""), (moved, 'lyapunov_degree = 1\nvarying = "controls"\n')):
        found = run("synthesize", written(tmp_path, text + hull + more), "--out", out)
        assert found.exit_code == 0, found.output
    gains = [json.loads((out / "synthesis.json").read_text())["gamma_verified"] for out in (still, moved)]
    assert gains[1] < 0.98 * gains[0]
    claim = json.loads((moved / "certificate.json").read_text())["claim"]
    assert "polytope of 3 vertices with |d c/dt| <= 0.1" in claim
    assert "polytope: c<" in (moved / "report.html").read_text()
    assert run("verify", moved / "certificate.json", moved / "closed_loop.json").exit_code == 0
    examined = run("stability", moved / "closed_loop.json", "--rate", "0.1", "--largest-range", "--json")
    assert examined.exit_code == 0, examined.output
    data = json.loads(examined.stdout)
    assert data["largest_range"]["factor"] > 1 and len(data["largest_range"]["vertices"]) == 3


@pytest.mark.parametrize(("rows", "line"), [("[[0.0], [1.0]]", "the plant has c, s"), ("3", "the plant has c, s"),
                                            ("[]", "the plant has c, s"),
                                            ("[[0.0, 0.0], [1.0, 1.0]]", "no inside"),
                                            ("[[0.0, 0.0], [nan, 0.0], [0.0, 1.0]]", "hull"),
                                            ("[[5.0, 5.0], [6.0, 5.0], [5.0, 6.0]]", "outside the plant's"),
                                            ('[["much", 0.0], [1.0, 1.0], [0.0, 1.0]]', "hull[0]")])
def test_a_hull_that_is_none_ends_with_two(tmp_path, rows, line):
    out = tmp_path / "out"
    found = run("synthesize", written(tmp_path, TURNING + HINF + f"hull = {rows}\n"), "--out", out)
    assert found.exit_code == 2 and line in found.output and not out.exists(), found.output


@pytest.mark.seconds
@pytest.mark.parametrize("design", ["observer", "filter", "multi-objective"])
def test_a_hull_with_a_pole_region_from_a_file(tmp_path, design):
    """Poles of the loop at mixtures of the vertices; the plant is stable inside the hull for the filter."""
    text = (TURNING + f'[design]\ndesign = "{design}"\nhull = [[-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2]]\n'
            '[[design.criteria]]\nkind = "h-infinity"\n[[design.regions]]\nkind = "half-plane"\ndecay = 0.05\n')
    out = tmp_path / "out"
    found = run("synthesize", written(tmp_path, text), "--out", out)
    assert found.exit_code == 0, found.output
    data = json.loads((out / "synthesis.json").read_text())
    assert any("HalfPlane(decay=0.05) in the whole polytope" in note for note in data["notes"])
    loop = lpv.load(out / "closed_loop.json")
    weights = np.random.default_rng(1).dirichlet(np.ones(3), 50)
    for p in weights @ np.array([[-0.2, -0.2], [0.2, -0.2], [-0.2, 0.2]]):
        assert np.linalg.eigvals(loop.frozen(p)[0]).real.max() < -0.05
    assert run("verify", out / "certificate.json", out / "closed_loop.json").exit_code == 0
