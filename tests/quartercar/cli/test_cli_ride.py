"""`quartercar ride`, through its own door: what it prints, what it writes, how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.browser import BROWSER, dump
from typer.testing import CliRunner

import lpvid as lpv
from lpvid import _threads
from lpvid.errors import InputError
from quartercar.cli.app import app
from quartercar.controllers import Controller, Skyhook
from quartercar.dampers import BoucWen, Guo
from quartercar.parameters import SAVARESI
from quartercar.rides.config import RideConfig, build_car, load_config, ride_template, road_from_text, roads_from_texts

pytestmark = pytest.mark.usefixtures("undrawn")
QUICK = """
seeds = 2
[[roads]]
kind = "iso"
class = "C"
speed = "72 km/h"
duration = 0.5
[[controllers]]
law = "passive"
fixed_current = 0.0
[[controllers]]
law = "skyhook-linear"
high_damping = "4 kN*s/m"
[[controllers]]
law = "sh-add"
name = "mixed"
"""


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, ["ride", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def quick(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("config") / "quick.toml"
    path.write_text(QUICK)
    return path


@pytest.fixture(scope="module")
def written(quick, tmp_path_factory) -> tuple[Path, str]:
    out = tmp_path_factory.mktemp("ride") / "out"
    return out, run(quick, "--out", out).stdout


def test_it_writes_the_comparison_the_laws_the_figures_and_a_report(written):
    out, stated = written
    assert {p.name for p in out.iterdir() if p.name[0] != "."} == {
        "ride.json", "report.html", "pareto.png", "time_1.png", "passive.json",
                                               "skyhook-linear.json", "mixed.json"}
    described = json.loads((out / "ride.json").read_text())
    assert described["schema"] == "quartercar/ride/1" and described["verdict"] in stated
    assert [r["controller"] for r in described["rides"]] == ["passive", "skyhook-linear", "mixed"]
    assert not described["tuned"] and described["measurements"]["name"] == "stroke-body"
    assert described["roads"] == [{"kind": "iso", "class": "C", "speed": 20.0, "duration": 0.5}]
    row = described["rides"][1]
    assert 0.3 < row["figures"]["comfort"]["mean"] < 3 and row["passivity"]["storage"] == "unknown"
    assert 0 <= row["figures"]["negative_share"]["mean"] < 0.5
    page = (out / "report.html").read_text()
    assert "Ride comparison" in page and "mixed" in page and "http" not in page
    assert "No spectra of this road" in page  # half a second is no average, and the page states so


@pytest.mark.seconds
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_the_report_opens_in_a_browser(written, tmp_path):
    dom = dump(written[0] / "report.html", tmp_path, height=9000)
    assert "Ride comparison" in dom and dom.count("<figure>") == 1
    assert dom.count('<figure class="traces"') == 1  # drawn when near the view: test_report_page.py


def came_back(out: Path) -> dict[str, float]:
    """Values of a law that is as it rode."""
    law = lpv.load(out / "mixed.json")
    assert isinstance(law, Controller) and law.name == "sh-add"
    described = json.loads((out / "ride.json").read_text())["controllers"]["mixed"]["parameters"]
    assert {p["name"]: p["value"] for p in described} == dict(law.values)
    return dict(law.values)


def test_laws_come_back_as_they_rode(written):
    came_back(written[0])


@pytest.mark.seconds
def test_tuned_laws_come_back_as_they_rode(quick, written, tmp_path, monkeypatch):
    monkeypatch.setattr(_threads, "processors", lambda: 1)  # new processes would take longer to begin than the tuning
    run(quick, "--tune", 4, "--out", tmp_path / "out")
    assert json.loads((tmp_path / "out" / "ride.json").read_text())["tuned"]["mixed"]["evaluations"] == 4
    assert came_back(tmp_path / "out").keys() == came_back(written[0]).keys()


@pytest.mark.seconds
def test_a_law_from_a_file_and_json_alone(written):
    out, _ = written
    found = run("--controller", f"passive,{out / 'mixed.json'}", "--road", "bump@8", "--seeds", 1, "--json",
                "--measurements", "ideal")
    described = json.loads(found.stdout)
    assert [r["controller"] for r in described["rides"]] == ["passive", "mixed"] and described["seeds"] == [0]
    assert described["rides"][0]["figures"]["comfort"]["low"] is None


@pytest.mark.slow
def test_a_measured_road_and_a_damper_of_ones_own(tmp_path: Path):
    track = tmp_path / "track.csv"
    track.write_text("distance [m],height [mm]\n" + "\n".join(f"{0.1 * k},{10 * (k % 7)}" for k in range(120)) + "\n")
    damper = lpv.save(Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5)), tmp_path / "guo.json")
    described = json.loads(
        run(
            "--road",
            f"{track}@5",
            "--damper",
            damper,
            "--car",
            "savaresi",
            "--seeds",
            1,
            "--controller",
            "skyhook",
            "--json",
        ).stdout
    )
    assert described["roads"][0] == {"kind": "measured", "track": "height", "length": pytest.approx(11.9), "speed": 5.0,
                                "laps": 3}
    assert described["damper"] == "guo" and described["car"]["sprung_mass"] == SAVARESI.sprung_mass
    assert described["coil"]["rise_time"] == 0.005 and described["sample_time"] == 0.002


@pytest.mark.slow
def test_a_bound_stands_beside_the_laws(quick: Path, tmp_path: Path):
    found = run(quick, "--bound", "--bound-seeds", 1, "--out", tmp_path / "out")
    assert "clairvoyant bound over the nonlinear car" in found.stdout and "certified that no force" in found.stdout
    described = json.loads((tmp_path / "out" / "ride.json").read_text())
    nonlinear, linear = described["bounds"]
    assert (nonlinear["car"], linear["car"]) == ("nonlinear", "linear") and nonlinear["seeds"] == [0]
    shares = nonlinear["shares"]
    assert list(shares) == ["passive", "skyhook-linear", "mixed"]
    assert shares["passive"]["objective"]["mean"] == pytest.approx(0, abs=1e-7) and shares["mixed"]["comfort"][
        "mean"] < 1
    assert linear["floor"][0]["value"] < linear["best"]["objective"]["figures"]["objective"]["mean"] < 1
    page = (tmp_path / "out" / "report.html").read_text()
    assert "What the damper could have reached" in page


@pytest.mark.slow
def test_a_rear_axle_with_the_road_of_the_front_one(quick: Path, tmp_path: Path):
    text = quick.read_text() + '[[controllers]]\nlaw = "preview-lqr"\n[[controllers]]\nlaw = "mpc"\ntyre_weight = 0.4\n'
    path = tmp_path / "preview.toml"
    path.write_text(text + '[preview]\nwheelbase = "2.7 m"\nsensors = "stroke-body-wheel"\n')
    found = run(path, "--out", tmp_path / "out")
    assert "preview: wheelbase 2.7 m, front estimated by stroke-body-wheel" in found.stdout
    assert "mm rms off" in found.stdout
    described = json.loads((tmp_path / "out" / "ride.json").read_text())
    assert described["preview"] == {
        "wheelbase": 2.7,
        "time": None,
        "front": "estimated",
        "sensors": "stroke-body-wheel",
        "law": described["preview"]["law"],
    }
    assert [r["controller"] for r in described["rides"]][-2:] == ["preview-lqr", "mpc"]
    assert all(1e-4 < r["road_ahead_error"] < 3e-3 for r in described["rides"])
    law = lpv.load(tmp_path / "out" / "mpc.json")
    assert isinstance(law, Controller) and law.values["tyre_weight"] == 0.4
    blind = json.loads(run(path, "--preview", "none", "--json").stdout)
    assert blind["preview"] is None and blind["rides"][0]["road_ahead_error"] is None


@pytest.mark.seconds
def test_the_laws_that_use_the_road_join_where_none_are_named():
    from quartercar.cli.ride import _chosen

    found = _chosen(None, None, None, None, None, None, None, None, "time=0.1,front=known")
    assert list(found.controllers)[-3:] == ["preview-lqr", "preview-lpv", "mpc"] and found.settings.preview is not None
    assert "mpc" not in _chosen(None, None, None, None, None, None, None, None, None).controllers


def test_a_bound_of_a_damper_without_gradient_is_refused_before_anything_runs(tmp_path: Path):
    path = lpv.save(BoucWen(), tmp_path / "bouc-wen.json")
    lines = run("--damper", path, "--bound", "--out", tmp_path / "out", code=2).stderr.strip().splitlines()
    assert len(lines) == 1 and "no bound is available" in lines[0] and "lpv-arx" in lines[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_belgian_block_road(shared_data: Path):
    """A measured track of 10 m, there and back: the stones are far rougher than ISO C."""
    file = shared_data / "belgian_block_road" / "profiles.csv"
    refused = CliRunner().invoke(app, ["ride", "--road", f"{file}@8", "--seeds", "2"])
    assert refused.exit_code == 2 and "3 tracks" in refused.stderr and "#" in refused.stderr
    described = json.loads(
        run("--road", f"{file}#1@8", "--controller", "passive,sh-add", "--seeds", 2, "--json").stdout
    )
    assert described["roads"][0]["laps"] == 4 and described["roads"][0]["length"] == pytest.approx(10.0, abs=0.1)
    rows = {r["controller"]: r["figures"] for r in described["rides"]}
    assert rows["sh-add"]["comfort"]["mean"] < rows["passive"]["comfort"]["mean"]


def test_the_template_is_a_configuration(tmp_path: Path):
    path = tmp_path / "ride.toml"
    path.write_text(run("--template").stdout)
    found = load_config(path)
    assert path.read_text() == ride_template()
    default = RideConfig(build_car())
    assert found.car.coil == default.car.coil and found.car.stops == default.car.stops
    assert [r.name for r in found.roads] == [r.name for r in default.roads] and found.seeds == default.seeds
    assert list(found.controllers) == ["passive", "skyhook-linear", "sh-add"]


@pytest.mark.parametrize(("text", "message"), [
    ("seeds = 0", "seeds"), ("bound = 3", "true or false"),
    ("bound_seeds = 0", "bound_seeds"), ("sede = 3", "seeds"), ("car = 'megan'", "megane"),
    ("car = {sprung_mas = 3}", "sprung_mass"), ("car = {sprung_mass = '3 m'}", "unit"),
    ("damper = 'none.json'", "none.json"), ("measurements = 'all'", "stroke-body"),
    ("[[roads]]\nkind = 'isso'", "iso"), ("[[roads]]\nkind = 'iso'\nclass = 'X'", "class"),
    ("[[roads]]\nkind = 'iso'\nspeed = 'fast'", "speed"), ("[[roads]]\nkind = 'file'", "path"),
    ("roads = 3", "list of"), ("[[controllers]]\nlaw = 'skyhok'", "skyhook"),
    ("[[controllers]]\nlaw = 'add'\nlow_damping = -1", "bounds"),
    ("[[controllers]]\nlaw = 'add'\nlow = 1", "low_damping"),
    ("[[controllers]]\nlaw='add'\n[[controllers]]\nlaw='add'", "two"), ("[coil]\nhigh = 2", "highest"),
    ("[preview]\nwheelbase = 0", "positive"), ("preview = 2.7", "table"), ("[preview]\nwheel = 2.7", "wheelbase"),
    ("[stops]\nstiffness = 0", "positive"), ("seeds = [", "TOML")])
def test_a_wrong_configuration_ends_with_one_line(text: str, message: str, tmp_path: Path):
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    found = run(path, "--out", tmp_path / "out", code=2)
    lines = found.stderr.strip().splitlines()
    assert len(lines) == 1 and message in lines[0] and "wrong.toml" in lines[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("arguments", "message"), [
    (["--road", "isso-c@20"], "isso-c"), (["--controller", "skyhok"], "skyhook"), (["--measurements", "two"], "stroke"),
    (["--car", "golf"], "car"), (["missing.toml"], "missing.toml"), (["--damper", "missing.json"], "missing.json"),
    (["--road", "iso-c@0"], "speed"), (["--preview", "2.7"], "key=value"), (["--preview", "wheelbase=2.7", "--road",
                                                                              "sweep"], "no speed"),
    (["--preview", "time=0.1,front=sen"], "known")])
def test_wrong_options_end_with_one_line(arguments: list[str], message: str):
    lines = run(*arguments, code=2).stderr.strip().splitlines()
    assert len(lines) == 1 and message in lines[0]


def test_a_damper_measured_the_other_way_round_is_refused(tmp_path: Path):
    path = lpv.save(Guo(polarity=-1), tmp_path / "turned.json")
    assert "reversed polarity" in run("--damper", path, code=2).stderr


def test_a_file_of_another_sort_is_refused(tmp_path: Path):
    path = lpv.save(Skyhook(), tmp_path / "law.json")
    assert "no damper" in run("--damper", path, code=2).stderr
    path = lpv.save(Guo(), tmp_path / "damper.json")
    assert "no controller" in run("--controller", path, code=2).stderr


def test_tuning_on_the_seeds_of_the_comparison_is_refused(quick, tmp_path: Path):
    path = tmp_path / "clash.toml"
    path.write_text("tune = 4\ntune_seed = 1\n" + QUICK)
    assert "share a seed" in run(path, code=2).stderr


def test_a_car_that_flies_apart_is_told_with_code_3(tmp_path: Path):
    track = tmp_path / "cliff.csv"
    track.write_text("distance [m],height [m]\n0,0\n1,0\n1.01,90000\n3,90000\n")
    out = tmp_path / "out"
    run("--road", f"{track}@5", "--seeds", 1, "--controller", "skyhook", "--out", out, code=3)
    described = json.loads((out / "ride.json").read_text())
    assert "all bounds" in described["verdict"] and described["rides"] == []


def test_roads_in_words():
    assert road_from_text("sweep").name == "sweep 0.5-20 Hz"
    assert road_from_text("bump@36 km/h").to_dict()["speed"] == pytest.approx(10.0)
    with pytest.raises(InputError, match="iso-b@quick"):
        road_from_text("iso-b@quick")


def test_an_empty_file_is_no_ride_of_defaults(tmp_path):
    (tmp_path / "ride.toml").write_text("\n", encoding="utf-8")
    result = CliRunner().invoke(app, ["ride", str(tmp_path / "ride.toml"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "error: ride.toml is empty" in result.stderr
    assert not (tmp_path / "out").exists()


def test_several_roads_in_one_word_as_the_help_shows(tmp_path):
    from quartercar.cli.app import EXAMPLES
    from quartercar.cli.ride import ride

    lines = [line.split() for _, line in EXAMPLES[ride]]
    named = [words[k + 1] for words in lines for k, word in enumerate(words) if word == "--road"]
    assert any("," in text for text in named)
    assert [r.name for r in roads_from_texts(named[:1])] == ["ISO C, 20 m/s", "bump 50 mm x 2 m, 8 m/s"]
    (tmp_path / "a,b.csv").write_text("distance [m],height [m]\n0,0\n50,0.01\n100,0\n")
    assert len(roads_from_texts([f"{tmp_path / 'a,b.csv'}@10"])) == 1


@pytest.mark.seconds
def test_a_damper_without_current_rides_alike_and_the_result_states_it(tmp_path):
    lpv.save(Guo(values={"yield_force": 200.0, "post_yield_damping": 900.0}, hysteresis=False), tmp_path / "guo.json")
    (tmp_path / "bump.toml").write_text('seeds = 1\n[[roads]]\nkind = "bump"\nduration = 1.0\n')
    given = (tmp_path / "bump.toml", "--damper", tmp_path / "guo.json", "--controller")
    stated = run(*given, "passive,skyhook", "--json").stdout
    described = json.loads(stated)
    assert "not distinguishable from skyhook" in described["verdict"]
    assert any("does not depend on the command" in note and "follows the current" in note
               for note in described["notes"])
    text = run(*given, "passive").stdout
    assert "follows no command" in text and "2.5 A" not in text and "at limits" not in text
    assert all(r["figures"]["at_limits"]["mean"] is None for r in described["rides"])


@pytest.mark.seconds
def test_a_track_of_centimetres_and_a_body_of_grams_are_remarked(tmp_path):
    (tmp_path / "short.csv").write_text("distance [m],height [mm]\n0,0\n0.01,1\n0.02,0\n")
    (tmp_path / "ride.toml").write_text("""
seeds = 1
[car]
set = "megane"
sprung_mass = "315 g"
[[roads]]
kind = "file"
path = "short.csv"
speed = 10.0
laps = 400
[[controllers]]
law = "passive"
""")
    stated = run(tmp_path / "ride.toml").stdout
    assert "excites nothing below 250 Hz" in stated and "The body bounces at 48.7 Hz" in stated
    assert "off the road in" in stated  # the figures of a wheel that flies are those of a car in the air


@pytest.mark.parametrize(("rows", "stated"), [
    ("distance [m],height [m]\n0,0\n1,\n2,0\n", "short.csv: 'height' is not finite"),
    ("distance [m],height [m]\n0,inf\n1,0\n2,0\n", "'height' is not finite: got inf in sample 1"),
    ("distance,height [m]\n0,0\n1,0\n2,0\n", "Mend: state its unit in the header: 'distance [mm]'"),
])
def test_a_profile_with_holes_or_without_units_is_refused_by_name(rows, stated, tmp_path, recwarn):
    (tmp_path / "short.csv").write_text(rows)
    assert stated in run("--road", f"{tmp_path / 'short.csv'}@10", code=2).stderr
    assert not recwarn.list


def test_a_tyre_of_steel_is_no_matter_of_the_sample_rate(tmp_path):
    (tmp_path / "ride.toml").write_text('[car]\nset = "megane"\ntyre_stiffness = 1e9\n')
    message = run(tmp_path / "ride.toml", code=2).stderr
    assert "check the car's tyre stiffness and unsprung mass" in message and "--sample-rate" not in message


@pytest.mark.seconds
def test_options_count_before_the_configuration_as_the_help_says(tmp_path, monkeypatch):
    """`quartercar design --damper model.json design.toml` of the guide was refused."""
    from quartercar.design.config import load_design

    for folder in ("configs", "models"):
        (tmp_path / folder).mkdir()
    monkeypatch.chdir(tmp_path)
    lpv.save(Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0), hysteresis=False), "models/guo.json")
    Path("configs/ride.toml").write_text('car = "savaresi"\ndamper = "gone.json"\n')
    found = load_config("configs/ride.toml", "megane", Path("models/guo.json"))
    assert found.car.parameters.sprung_mass == 315 and found.car.damper.name == "guo"
    assert load_config("configs/ride.toml", damper=Path("models/guo.json")).car.parameters == SAVARESI
    found = load_design("configs/ride.toml", "nominal", damper=Path("models/guo.json"))
    assert found.car.damper.name == "guo" and found.car.parameters == SAVARESI
    Path("configs/short.toml").write_text('damper = "gone.json"\n[[roads]]\nkind = "bump"\nduration = 1.0\n')
    result = run("configs/short.toml", "--damper", "models/guo.json", "--controller", "passive", "--seeds", 1)
    assert "with damper guo" in result.stdout


def test_a_configuration_that_is_not_there_is_named_once(tmp_path):
    message = run(tmp_path / "nowhere.toml", code=2).stderr
    assert message.startswith("error: cannot read '") and message.count("nowhere.toml") == 1


@pytest.mark.seconds
def test_the_current_of_the_passive_car_is_stated(tmp_path):
    """What laws gain over it depends on it: at 0 A the embedded damper's passive car rides as well as SH-ADD."""
    (tmp_path / "ride.toml").write_text(QUICK.replace('fixed_current = 0.0', 'fixed_current = "400 mA"'))
    assert "passive: 0.4 A held throughout." in run(tmp_path / "ride.toml").stdout
