"""Design on the identified plant: the law that runs, its controller file, and the command."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.known_dampers import STEP, damper
from typer.testing import CliRunner

import lpvid as lpv
from lpvid._workers import packed
from lpvid.errors import InputError
from lpvid.synthesis.dissipative_feedback import KEPT
from lpvid.synthesis.result import Synthesis
from quartercar.cli.app import app
from quartercar.controllers.contract import Setting
from quartercar.controllers.designed import damper_design
from quartercar.controllers.designed.damper_design import DamperTask, feasible, synthesized_gain
from quartercar.controllers.designed.damper_law import DamperLaw
from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified, gain_of
from quartercar.dampers import Guo
from quartercar.design.config import read_design
from quartercar.design.identified import IdentifiedDesign
from quartercar.design.nominal import design
from quartercar.lpv_models.frozen_damper import filtered
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.rides.simulation import ride
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.nonlinear import Coil, QuarterCar

SETTING = Setting(STEP, 1, MEGANE, identified_damper(), (0.0, 2.5))
CAR = QuarterCar(MEGANE, identified_damper(), coil=Coil(highest=2.5))


@pytest.fixture(scope="module")
def task() -> DamperTask:
    law = LpvHinfIdentified()
    return law.task(law.values, SETTING)


@pytest.fixture(scope="module")
def found() -> IdentifiedDesign:
    made = design(CAR, LpvHinfIdentified())
    assert isinstance(made, IdentifiedDesign)
    return made


def seen(run, k: int) -> dict[str, np.ndarray]:
    names = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity", "suspension_velocity",
             "current")
    return {n: run[n][k:k + 1] for n in names}


# -- the synthesis -----------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_design_that_was_sent_does_not_study_the_damper_anew(task: DamperTask,
                                                               monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = task.embedded
    sent = pickle.loads(packed(task).getvalue())

    def again(*given: object) -> None:
        raise AssertionError("studied anew")

    monkeypatch.setattr(damper_design, "study", again)
    assert sent.embedded.order == wanted.order
    np.testing.assert_array_equal(sent.embedded.velocities, wanted.velocities)
    assert replace(sent, slow=0.5) != sent


@pytest.mark.seconds
def test_the_gain_is_certified_for_every_share(task: DamperTask) -> None:
    result = synthesized_gain(task)
    assert result.solved and result.between_grid and lpv.verify(result.certificate, result.closed_loop).holds
    assert result.closed_loop.box.names == ("secant", "given_share")
    rng, worst = np.random.default_rng(0), 0.0
    low, high = (np.array(getattr(result.closed_loop.box, n)) for n in ("lower", "upper"))
    for p in (*result.closed_loop.box.grid(7), *(low + (high - low) * rng.random((40, 2)))):
        a, b, c, d = result.closed_loop.frozen(p)
        for f in np.geomspace(0.3, 40.0, 40):
            s = 2j * np.pi * f
            worst = max(worst, float(np.linalg.norm(c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d, 2)))
    assert worst <= result.gamma_lower * (1 + 1e-6) <= result.gamma_verified


@pytest.mark.seconds
def test_a_demand_that_is_met_makes_the_gain_smaller(found: IdentifiedDesign) -> None:
    curves = dict(found.gains)
    for name, curve in found.passive_gains.items():
        np.testing.assert_allclose(curves[0.0][name], curve)
    assert curves[1.0]["body_acceleration"].max() < curves[0.0]["body_acceleration"].max()


# -- the law -----------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_its_states_are_those_of_the_plant_along_a_run(task: DamperTask) -> None:
    # the nonlinear car under random currents: damper states, added force and force, against the plant's own trajectory
    rng = np.random.default_rng(2)
    road = np.convolve(np.cumsum(rng.standard_normal(700)) * 6e-4, np.hanning(21) / 10, "same")
    currents = np.concatenate([[0.0], rng.uniform(0, 2.5, 17)])
    run = CAR.run(road - road[0], STEP, np.repeat(currents, 40)[:700])
    law, plant = DamperLaw([gain_of(task)], SETTING), task.embedding
    drive = plant.damper_inputs(run)
    states, _ = filtered(plant.matrices, drive, STEP)
    for k in range(700):
        demand = law.step(seen(run, k))
        np.testing.assert_allclose(law._states[0], states[k], atol=2e-4 * np.abs(states).max())
        np.testing.assert_allclose(law._drive[0, -1], drive[k, -1], atol=2e-4 * np.abs(drive[:, -1]).max())
        assert 0.0 <= demand[0] <= 2.5


def test_rows_are_what_the_model_then_adds(task: DamperTask) -> None:
    # motion and filtered current held for a sample: the added force foretold for a current is the one found there
    law = DamperLaw([gain_of(task)], SETTING)
    still = {n: np.array([x]) for n, x in (("suspension_deflection", 0.01), ("body_velocity", 0.1),
                                           ("tyre_deflection", 1e-3), ("wheel_velocity", -0.15),
                                           ("suspension_velocity", 0.25), ("current", 0.8))}
    for _ in range(5):
        law.step(still)
    law._felt[:] = law._grid[4]
    described = law._added_ahead(still["suspension_deflection"], still["suspension_velocity"])[0, 4]
    law._own = Coil()  # which follows at once
    law.step({**still, "current": law._grid[4:5]})
    np.testing.assert_allclose(law._drive[0, -1], described, rtol=1e-9)


def test_another_rate_is_refused() -> None:
    with pytest.raises(InputError, match="runs at the damper's rate"):
        LpvHinfIdentified().start(replace(SETTING, sample_time=0.002))
    with pytest.raises(InputError, match="needs a damper model"):
        LpvHinfIdentified().start(replace(SETTING, damper=None))


# -- the design --------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_the_stored_controller_rides_as_the_law(found: IdentifiedDesign, tmp_path: Path) -> None:
    back = lpv.load(lpv.save(found.controller, tmp_path / "controller.json"))
    road = Bump(duration=0.6)
    one, other = (ride(CAR, road, law, 1).run["current"] for law in (back, LpvHinfIdentified()))
    np.testing.assert_allclose(one, other, atol=1e-9)
    kept = found.to_dict()
    assert kept["plant"]["kind"] == "identified" and kept["gamma_verified"] <= KEPT * kept["gamma"]
    assert kept["plant"]["damper_order"] == 2 and "whatever share" in kept["summary"]


def test_slow_motion_is_left_out_where_nothing_covers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    task = LpvHinfIdentified().task(LpvHinfIdentified().values, SETTING)
    real = synthesized_gain(task)
    monkeypatch.setattr("quartercar.controllers.designed.damper_design.synthesized_gain",
                        lambda t: real if t.slow >= 1e-2 else Synthesis("infeasible"))
    feasible.cache_clear()
    left = feasible(task)
    feasible.cache_clear()
    assert left.slow == 1e-2 and left.embedding.limits[1] < task.embedding.limits[1]
    v, u = left.embedded.slowest(1e-2), left.embedded.velocities
    assert np.sum(u[u < v]**2) / np.sum(u**2) == pytest.approx(1e-2, rel=1e-2)
    assert left.embedding.limits[1] == pytest.approx(left.embedding.frozen.secant(v))


# -- configuration and command -----------------------------------------------------------------------------------------
def test_the_plant_follows_from_damper_and_keys() -> None:
    assert isinstance(read_design({}).law, LpvHinfIdentified)
    for table in ({"plant": "nominal"}, {"law": "lpv-hinf"}, {"criterion": "h2"}, {"weights": {"relief": 0.5}}):
        assert not isinstance(read_design(table).law, LpvHinfIdentified)


@pytest.mark.parametrize("table, description", [
    ({"plant": "linear"}, "plant must be one of"),
    ({"plant": "identified", "law": "lpv-hinf"}, "belongs to the nominal"),
    ({"plant": "identified", "weights": {"relief": 0.5}}, "weight of lpv-hinf-identified")])
def test_plants_at_fault(table: dict, description: str) -> None:
    with pytest.raises(InputError, match=description):
        read_design(table)


@pytest.mark.slow
def test_the_command_designs_on_the_identified_plant(tmp_path: Path) -> None:
    lpv.save(damper(2), tmp_path / "arx.json")
    (tmp_path / "design.toml").write_text('damper = "arx.json"\n')
    out, runner = tmp_path / "out", CliRunner()
    run = runner.invoke(app, ["design", "--json", "--out", str(out), str(tmp_path / "design.toml")])
    assert run.exit_code == 0, run.output
    described = json.loads(run.stdout)
    assert described["law"]["kind"] == "lpv-hinf-identified" and described["between_grid"]
    assert {"controller.json", "certificate.json", "report.html", "gains.png"} <= {p.name for p in out.iterdir()}
    assert "The plant" in (out / "report.html").read_text()
    run = runner.invoke(app, ["ride", "--json", "--damper", str(tmp_path / "arx.json"), "--seeds", "1", "--road",
                              "bump@8", "--controller", f"{out / 'controller.json'},passive"])
    assert run.exit_code == 0, run.output
    assert "scheduling_outside" in json.loads(run.stdout)["rides"][0]["counts"]


def test_the_command_refuses_a_damper_without_dynamics(tmp_path: Path) -> None:
    lpv.save(Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5), hysteresis=False), tmp_path / "guo.json")
    (tmp_path / "design.toml").write_text('damper = "guo.json"\n')
    run = CliRunner().invoke(app, ["design", "--plant", "identified", "--out", str(tmp_path / "o"),
                                   str(tmp_path / "design.toml")])
    assert run.exit_code == 2 and "nominal" in run.output and not (tmp_path / "o").exists()
