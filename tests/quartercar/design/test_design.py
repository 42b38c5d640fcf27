"""Suspension design: the weighted plant, the controllers that run, and the command, against independent answers."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.export.serialise import jsonable
from lpvid.synthesis.result import Synthesis
from quartercar.cli.app import app
from quartercar.controllers.contract import Setting
from quartercar.controllers.designed.lpv_hinf import BankedLaw, LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
from quartercar.controllers.designed.schedule_rules import GivenShare
from quartercar.controllers.designed.scheduled import ScheduledController
from quartercar.controllers.designed.suspension_design import Nodes, Task, held, nodes_of, running, synthesized
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.inverse import InverseSettings
from quartercar.dampers import Guo
from quartercar.design.config import design_schema, design_template, read_design
from quartercar.design.nominal import FREQUENCIES, design
from quartercar.lpv_models import LimitedForce
from quartercar.lpv_models.prefilter import prefiltered
from quartercar.lpv_models.weighted import MEASUREMENTS, SensorNoise, SuspensionWeights, WeightedCar
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.rides.simulation import RideSettings, ride
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

DAMPER = Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5), hysteresis=False,
             values={"yield_force_at_low": 60.0, "yield_force_at_high": 1500.0, "sharpness": 25.0,
                     "post_yield_damping_at_low": 900.0, "post_yield_damping_at_high": 1600.0})
CAR = QuarterCar(MEGANE, DAMPER, stops=BumpStops(), coil=Coil(0.005, 0.010, highest=2.5))
SETTING = Setting(0.002, 1, MEGANE, DAMPER, (0.0, 2.5))
LAWS = [LpvHinf(), LpvHinfClipped(criterion="h2"), LpvHinfClipped(measured="stroke-body")]


def weighted(least: float | None = 0.2, **weights: float) -> WeightedCar:
    return Task(MEGANE, 1200.0, SuspensionWeights(**weights), least, "stroke-body").weighted


# -- the weighted plant ------------------------------------------------------------------------------------------------
def test_signals_have_names_and_the_controls_path_is_constant() -> None:
    plant = weighted().plant()
    assert plant.disturbances == ("road", "noise_suspension_deflection", "noise_body_acceleration")
    assert plant.performance == ("comfort", "road_holding", "room", "effort")
    assert plant.measurements == ("measured_suspension_deflection", "measured_body_acceleration")
    at = plant.at(np.array([[0.2], [0.6], [1.0]]))
    for name in ("B2", "D12", "C2", "D21", "D22"):
        assert not np.ptp(getattr(at, name), axis=0).any()
    assert np.linalg.matrix_rank(at.D21[0]) == 2 and np.abs(at.D12[0]).max() > 0


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_performance_is_the_weighted_car(share: float) -> None:
    # python-control: the linear car of c_nom times the weights as transfer functions, times the relief
    w = SuspensionWeights(acceleration=0.5, tyre_force=700.0, stroke=0.03, relief=0.4, road=0.2, comfort_low=0.8)
    plant = replace(weighted(), weights=w).plant()
    at = plant.at(np.array([[share]])).point(0)
    car = LinearCar(MEGANE.replace(damping=1200.0)).relative()
    factor = 0.4 + 0.6 * share
    for f in (0.5, 1.4, 3.0, 12.0, 25.0):
        s = 2j * np.pi * f
        found = at.C1 @ np.linalg.solve(s * np.eye(plant.order) - at.A, at.B1[:, 0]) + at.D11[:, 0]
        plain = car.C @ np.linalg.solve(s * np.eye(4) - car.A, car.B[:, 0]) + car.D[:, 0]
        wanted = {}
        for row, signal, level, low, high in ((0, "body_acceleration", 0.5, 0.8, 12.0),
                                              (1, "tyre_force", 700.0, 8.0, 15.0)):
            a, b = 2 * np.pi * low, 2 * np.pi * high
            wanted[row] = (a + b) * s / ((s + a) * (s + b)) / level * plain[car.outputs.index(signal)]
        wanted[2] = plain[car.outputs.index("suspension_deflection")] / 0.03
        for row, value in wanted.items():
            np.testing.assert_allclose(abs(found[row]), 0.2 * factor * abs(value), rtol=1e-9)
        assert found[3] == 0


def test_the_drawn_weights_are_those_of_the_plant() -> None:
    w = SuspensionWeights(acceleration=0.5, tyre_force=800.0)
    np.testing.assert_allclose(w.comfort_gain(np.array([12**0.5])), 2.0)
    np.testing.assert_allclose(w.wheel_gain(np.array([120**0.5])), 1 / 800)
    assert np.all(w.comfort_gain(np.array([0.1, 100.0])) < 0.35)


def test_what_cannot_be_weighted_is_refused() -> None:
    embedding = LimitedForce(MEGANE, 1200.0)
    system = prefiltered(embedding.system, embedding.control, 0.008)
    with pytest.raises(InputError, match="no sensor for 'tyre_force'"):
        WeightedCar(system, embedding.control, measured=("tyre_force",))
    with pytest.raises(InputError, match="no input 'force'"):
        WeightedCar(system, "force")
    with pytest.raises(InputError, match="a band runs from low to high"):
        SuspensionWeights(comfort_low=20.0)
    with pytest.raises(InputError, match="relief is a share"):
        SuspensionWeights(relief=1.5)
    with pytest.raises(InputError, match="must be positive"):
        SensorNoise(bandwidth=0.0)


# -- controllers -------------------------------------------------------------------------------------------------------
@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.name}-{law.criterion}-{law.measured}")
def test_the_verified_gain_bounds_what_the_loop_does(law) -> None:
    found = synthesized(law.task(law.values, SETTING))
    assert found.solved and found.between_grid
    loop, worst = found.closed_loop, 0.0
    for p in loop.box.grid(5):
        a, b, c, d = loop.frozen(p)
        assert np.linalg.eigvals(a).real.max() < 0
        for f in np.geomspace(0.1, 60.0, 150):
            s = 2j * np.pi * f
            worst = max(worst, float(np.linalg.norm(c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d, 2)))
    assert worst <= found.gamma_verified * (1 + 1e-9)


def test_state_feedback_with_memory_has_the_poles_of_the_design() -> None:
    law = LpvHinf()
    task = law.task(law.values, SETTING)
    nodes, plant, gain = nodes_of(task), task.plant(), synthesized(task).required()
    system = task.weighted.system
    outputs = [s.name for s in system.outputs]
    rows = [outputs.index(n) for n in MEASUREMENTS["observed"]]
    places = [[s.name for s in gain.inputs].index(n) for n in plant.measurements]
    for k, p in enumerate(nodes.points):
        at = plant.at(p[None]).point(0)
        wanted = np.linalg.eigvals(at.A + at.B2 @ gain.frozen(p[: len(gain.box.names)])[3][:, places])
        a, b, c, _ = system.frozen(p)
        ka, kb, kc, kd = (m[k] for m in nodes.matrices)
        loop = np.block([[a + b[:, 1:] @ kd @ c[rows], b[:, 1:] @ kc], [kb @ c[rows], ka]])
        poles = np.linalg.eigvals(loop)
        # the controller has the coil's lag a second time, as its model
        assert all(np.abs(poles - z).min() < 1e-6 * (1 + abs(z)) for z in wanted)


def test_sampling_is_exact_for_held_readings() -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((2, 3, 3)) - 2 * np.eye(3)
    b, c, d = rng.standard_normal((2, 3, 2)), rng.standard_normal((2, 1, 3)), rng.standard_normal((2, 1, 2))
    box = lpv.Scheduling(("p",), (0.0,), (1.0,))
    nodes = Nodes((lpv.Signal("x"), lpv.Signal("y")), (lpv.Signal("u"),), box, np.array([[0.0], [1.0]]), (a, b, c, d))
    found = held(nodes, 0.05)
    for k, p in enumerate((0.0, 1.0)):
        wanted = cont2discrete((a[k], b[k], c[k], d[k]), 0.05, "zoh")[:4]
        for mine, theirs in zip(found.frozen([p]), wanted, strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-12)


@pytest.mark.seconds
def test_many_cars_at_once_are_the_stored_controllers_one_by_one() -> None:
    rng = np.random.default_rng(3)
    laws = [LpvHinf(values={"tyre_force": t, "least_share": q}) for t, q in ((5000.0, 0.2), (20000.0, 0.8))]
    tasks = [law.task(law.values, SETTING) for law in laws]
    banked = BankedLaw(tasks, SETTING.sample_time)
    single = [law.designed(SETTING).start(SETTING) for law in laws]
    for _ in range(60):
        seen = {n: rng.standard_normal(2) * s for n, s in (
            ("suspension_deflection", 0.01), ("body_velocity", 0.2), ("tyre_deflection", 2e-3), ("wheel_velocity", 0.5),
            ("suspension_velocity", 0.5), ("demanded", 800.0), ("attained", 800.0))}
        apart = [law.step({n: a[k: k + 1] for n, a in seen.items()})[0] for k, law in enumerate(single)]
        np.testing.assert_allclose(banked.step(seen), apart, rtol=1e-9, atol=1e-6)


@pytest.mark.seconds
def test_a_stored_controller_rides_like_the_law(tmp_path: Path) -> None:
    law, road = LpvHinf(), Bump(duration=1.0)
    lpv.save(law.designed(SETTING), tmp_path / "controller.json")
    stored = lpv.load(tmp_path / "controller.json")
    assert isinstance(stored, ScheduledController)
    runs = [ride(CAR, road, c).run for c in (law, stored)]
    for signal in ("body_acceleration", "command"):
        np.testing.assert_allclose(runs[0][signal], runs[1][signal], atol=1e-6 * np.abs(runs[0][signal]).max())


@pytest.mark.slow
def test_the_settings_of_the_inverse_reach_the_loop_of_a_designed_law() -> None:
    car = QuarterCar(MEGANE, identified_damper(), stops=BumpStops(), coil=Coil(0.005, 0.010, highest=2.5))
    assert InverseSettings() == InverseSettings(steps=0, lag_compensated=False)

    def command(inverse: InverseSettings) -> np.ndarray:
        return ride(car, Bump(duration=1.0), LpvHinf(), 0, RideSettings(ChainSettings(inverse=inverse))).run["command"]

    plain = command(InverseSettings(steps=0, lag_compensated=False))
    for other in (InverseSettings(steps=1), InverseSettings(lag_compensated=True), InverseSettings(deadband=0.1)):
        assert np.abs(command(other) - plain).max() > 0.1


def test_given_share_follows_the_last_sample() -> None:
    rule = GivenShare(1000.0, 0.1).start(SETTING)

    def seen(demanded: float, attained: float, v: float) -> dict[str, np.ndarray]:
        return {"demanded": np.array([demanded]), "attained": np.array([attained]),
                "suspension_velocity": np.array([v])}

    assert rule(seen(0.0, 0.0, 0.3)) == 1.0  # nothing asked yet
    assert rule(seen(1300.0, 800.0, 0.5)) == 0.5  # 1000 N beside 300 N asked, 500 N given
    assert rule(seen(400.0, 700.0, 0.0)) == 0.1  # the wrong way


# -- a design ----------------------------------------------------------------------------------------------------------
@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("law", [LpvHinf(), LpvHinfClipped(measured="stroke-body")],
                         ids=["observed", "sensors"])
def test_no_controller_moves_the_invariant_point(law) -> None:
    found = design(CAR, law)
    f0 = np.sqrt(MEGANE.tyre_stiffness / MEGANE.unsprung_mass) / 2 / np.pi
    for _, curves in (*found.gains, (0.0, found.passive_gains)):
        at = np.exp(np.interp(np.log(f0), np.log(FREQUENCIES), np.log(curves["body_acceleration"])))
        np.testing.assert_allclose(at, MEGANE.tyre_stiffness / MEGANE.sprung_mass, rtol=2e-2)


@pytest.mark.seconds
def test_passive_gains_are_the_golden_numbers() -> None:
    # equation sheet 6.10, c = 1500
    found = design(CAR, LpvHinfClipped())
    found = replace(found, task=replace(found.task, nominal_damping=1500.0))
    for f, acceleration, stroke in ((1.0, 69.620, 0.7081), (4.0, 169.57, 1.1158), (20.0, 314.09, 0.5186)):
        for name, wanted in (("body_acceleration", acceleration), ("suspension_deflection", stroke)):
            at = np.exp(np.interp(np.log(f), np.log(FREQUENCIES), np.log(found.passive_gains[name])))
            np.testing.assert_allclose(at, wanted, rtol=3e-3)


def test_a_design_tells_what_it_found() -> None:
    found = design(CAR)
    assert "verified" in found.verdict and str(found).startswith(found.verdict)
    data = json.loads(json.dumps(jsonable(found.to_dict()), allow_nan=False))
    assert data["schema"] == "quartercar/design/1" and data["gamma_verified"] == found.synthesis.gamma_verified
    with_law, passive = found.bump(road=Bump(duration=1.0))
    assert with_law.controller is found.controller and passive.run["command"].max() == 0.0


def test_dampers_that_give_energy_and_cars_without_one_are_refused() -> None:
    with pytest.raises(InputError, match="reversed sign"):
        design(QuarterCar(MEGANE, DAMPER.replace(polarity=-1), coil=CAR.coil))
    with pytest.raises(InputError, match="needs a damper model"):
        design(QuarterCar(MEGANE, coil=CAR.coil))


# -- the command -------------------------------------------------------------------------------------------------------
def test_template_and_schema_agree_with_the_reader() -> None:
    import tomllib

    table = tomllib.loads(design_template())
    config, default = read_design(table), LpvHinf()
    assert dict(config.law.values) == dict(LpvHinfIdentified().values)
    nominal = [line.removeprefix("# ") for line in design_template().split("with these defaults:\n")[1].splitlines()]
    given = read_design({"weights": tomllib.loads("\n".join(nominal))}).law
    assert isinstance(given, LpvHinf) and dict(given.values) == dict(default.values)
    schema = design_schema()
    assert set(table) <= set(schema["properties"])
    assert set(schema["properties"]["weights"]["properties"]) == set(default.names)
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema


@pytest.mark.parametrize("table, description", [
    ({"weihgts": {}}, "did you mean 'weights'"), ({"weights": {"tire_force": 1.0}}, "did you mean 'tyre_force'"),
    ({"weights": {"stroke": "5 N"}}, "wrong unit"), ({"law": "lqg"}, "law must be one of"),
    ({"measured": "everything"}, "measured must be one of"), ({"weights": {"stroke": -1.0}}, "stroke"),
    ({"lag": 0.0}, "lag must be positive"), ({"tune": -1}, "tune must be a whole number")])
def test_configurations_at_fault(table: dict, description: str) -> None:
    with pytest.raises(InputError, match=description):
        read_design(table)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    lpv.save(DAMPER, tmp_path / "guo.json")
    (tmp_path / "design.toml").write_text('damper = "guo.json"\ncriterion = "hinf"\n[weights]\nstroke = "10 cm"\n')
    return tmp_path


@pytest.mark.slow
def test_the_command_writes_a_controller_that_rides(folder: Path) -> None:
    out = folder / "out"
    run = CliRunner().invoke(app, ["design", "--json", "--out", str(out), str(folder / "design.toml")])
    assert run.exit_code == 0, run.output
    described = json.loads(run.stdout)
    assert described["verdict"] in ("solved", "backed-off") and described["law"]["parameters"][1]["value"] == 0.1
    kept = json.loads((out / "synthesis.json").read_text())
    assert kept["gamma_verified"] == described["gamma_verified"]
    assert {p.name for p in out.iterdir() if p.name[0] != "."} == {
        "controller.json", "closed_loop.json", "certificate.json",
                                               "synthesis.json", "report.html", "weights.png",
                                               "gains.png", "bump.png", "sensitivity.png", "actuator.png"}
    page = (out / "report.html").read_text()
    assert "What the closed loop does" in page and "Over a bump" in page
    config = folder / "ride.toml"
    config.write_text('damper = "guo.json"\nseeds = 1\n[[roads]]\nkind = "bump"\nduration = 0.5\n'
                      '[[controllers]]\nfile = "out/controller.json"\n')
    run = CliRunner().invoke(app, ["ride", "--json", str(config)])
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["rides"][0]["controller"] == "controller"


@pytest.mark.seconds
def test_the_commands_exit_codes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runner = CliRunner()
    assert runner.invoke(app, ["design", "--template"]).stdout == design_template()
    assert json.loads(runner.invoke(app, ["design", "--schema"]).stdout) == design_schema()
    (folder / "bad.toml").write_text("speed = 3")
    run = runner.invoke(app, ["design", "--out", str(folder / "none"), str(folder / "bad.toml")])
    assert run.exit_code == 2 and not (folder / "none").exists()
    lpv.save(DAMPER.replace(polarity=-1), folder / "guo.json")
    run = runner.invoke(app, ["design", str(folder / "design.toml")])
    assert run.exit_code == 2 and "reversed polarity" in run.output
    lpv.save(DAMPER, folder / "guo.json")
    failed = Synthesis("infeasible", why="no force keeps the bound", mend="raise the levels of the weights")
    monkeypatch.setattr("quartercar.design.nominal.synthesized", lru_cache(lambda task: failed))
    run = runner.invoke(app, ["design", "--out", str(folder / "failed"), str(folder / "design.toml")])
    assert run.exit_code == 3 and "No controller: no force keeps the bound" in run.output
    assert json.loads((folder / "failed" / "synthesis.json").read_text())["verdict"] == "infeasible"
    assert not (folder / "failed" / "controller.json").exists()


def test_running_controllers_are_kept() -> None:
    law = LpvHinf()
    task = law.task(law.values, SETTING)
    assert running(task, 0.002) is running(law.task(law.values, SETTING), 0.002)
