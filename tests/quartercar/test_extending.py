"""What a user adds from outside the packages goes through the whole chain, registered or installed."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from helpers.user_classes import NAMES, install
from typer.testing import CliRunner

import lpvid as lpv
import quartercar as qc
from lpvid.cli.app import app as lpvid_app
from lpvid.cli.structures import Request
from lpvid.errors import InputError
from lpvid.export.expression import call
from lpvid.export.python_printer import run as run_program
from lpvid.export.step_builder import StepBuilder
from lpvid.identification.structure import STRUCTURES
from lpvid.named_classes import NamedClasses
from quartercar.cli.app import app as quartercar_app
from quartercar.controllers import CONTROLLERS, Setting, Skyhook, law_class
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.forces import StaticForces, forces_of
from quartercar.controllers.loop.sensing import SETS
from quartercar.dampers import DAMPERS, model_class
from quartercar.dampers.families import DynamicDamper
from quartercar.dampers.parameter import Parameter
from quartercar.export.loop_steps import LoopLaw
from quartercar.rides.config import DEFAULT_LAWS, given_laws
from quartercar.rides.tuning import Trial, tune
from quartercar.roads.ride_roads import IsoRoad
from quartercar.vehicle.adjoint import refuse_without_gradient
from quartercar.vehicle.batch import start_fleet
from quartercar.vehicle.nonlinear import Coil, QuarterCar

SHORT = IsoRoad("C", 20.0, 1.0)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A package of the user's classes on Python's path."""
    monkeypatch.syspath_prepend(str(install(tmp_path, getattr(request, "param", False))))
    importlib.invalidate_caches()
    yield tmp_path
    sys.modules.pop("my_extensions", None)


def record(rng: np.random.Generator, n: int = 1500) -> lpv.Record:
    """Motion, current and the force of an orifice with noise."""
    t = np.arange(n) / 500
    v = 0.2 * np.sin(9 * t) + 0.1 * np.sin(31 * t + 1)
    i = rng.choice([0.4, 1.0, 1.6], n // 100 + 1).repeat(100)[:n]
    force = 700 * v + (500 + 1100 * i) * v * np.abs(v) + rng.normal(size=n)
    return lpv.Record({"velocity": v, "current": i, "force": force}, sample_time=1 / 500, name="rig",
                      units={"velocity": "m/s", "current": "A", "force": "N"})


def run(app, *words: object) -> str:
    found = CliRunner().invoke(app, [str(w) for w in words], catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return found.output


def program_error(noun) -> float:
    """Largest gap between the exported program, interpreted, and the class, by the largest output."""
    u, y = noun.trial(150)
    return float(np.abs(run_program(noun.program, u) - y).max() / np.abs(y).max())


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("installed", [False, True], indirect=True, ids=["named", "named and registered"])
def test_an_installed_package_is_found_by_its_names(installed):
    """Its module may be the page's blocks as they stand, with their decorators."""
    for known, name in zip((DAMPERS, CONTROLLERS, STRUCTURES), NAMES, strict=True):
        assert name in known.names and known.get(name).__module__ == "my_extensions"
        assert known.register(known.get(name)) is known.get(name)
        other = type(known.get(name).__name__, (known.get(name),), {"__module__": "another"})
        with pytest.raises(InputError, match=f"'{name}' already"):
            known.register(other)


@pytest.mark.seconds
def test_a_damper_of_an_installed_package_through_the_chain(installed, tmp_path):
    data = record(np.random.default_rng(1))
    found = qc.dampers.compare([data], ["orifice", "linear"]).best.damper
    assert found.name == "orifice" and found.values["per_current"] == pytest.approx(1100, rel=0.01)
    again = lpv.load(lpv.save(found, tmp_path / "orifice.json"))
    assert type(again) is type(found) and np.array_equal(again.vector, found.vector)
    car = QuarterCar(qc.parameters.MEGANE, found, coil=Coil(lowest=0.4, highest=1.6))
    road = 0.005 * np.sin(np.arange(40) / 4)
    alone = car.run(road, 1e-3, 1.0)
    many = start_fleet(car, 1e-3, np.zeros(2), np.full(2, 1.0))
    for k in range(1, road.size):
        many.advance(np.full(2, road[k]), np.full(2, 1.0))
    assert np.allclose(many.motion, many.motion[0]) and np.allclose(many.motion[0, 0], alone["body_displacement"][-1])
    with pytest.raises(InputError, match="no bound is available for this damper"):
        refuse_without_gradient(found)
    assert isinstance(forces_of(found, 0.0, 1, np.array([0.4, 1.6]), 0), StaticForces)
    noun = lpv.exportable(found)
    assert program_error(noun) < 1e-14
    inverse = lpv.exportable(LoopLaw(Skyhook(), Setting(0.002, 1, qc.parameters.MEGANE, found, (0.4, 1.6)),
                                     Coil(0.005, 0.01, 0.4, 1.6), ChainSettings(SETS["stroke-body"])))
    assert program_error(inverse) < 1e-12
    from lpvid.baselines.named import named_baseline

    assert named_baseline("orifice", [data]).name == "orifice"


@pytest.mark.slow
def test_a_law_of_an_installed_package_is_ridden_tuned_and_saved(installed, tmp_path):
    law = given_laws(["groundhook-rate"])["groundhook-rate"].with_values(rate=2e4)
    assert type(law) is law_class("groundhook-rate") and "groundhook-rate" not in DEFAULT_LAWS
    assert program_error(lpv.exportable(law)) < 1e-14
    again = lpv.load(lpv.save(law, tmp_path / "law.json"))
    assert again.values == law.values
    damper = qc.dampers.Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0), hysteresis=False)
    car = QuarterCar(qc.parameters.MEGANE, damper, coil=Coil(0.005, 0.01, highest=2.0))
    slow, quick = (qc.ride(car, SHORT, law.with_values(rate=r)).figures.comfort for r in (1e2, 1e6))
    assert slow != quick > 0
    tuned = tune(law, Trial(car, (SHORT,), (5,)), 4)
    assert type(tuned.controller) is type(law)


@pytest.mark.slow
def test_commands_take_the_names_of_an_installed_package(installed, tmp_path):
    data = tmp_path / "rig.csv"
    made = record(np.random.default_rng(2))
    columns = ("time", "velocity", "current", "force")
    rows = np.column_stack([np.arange(made.n_samples) / 500, *(made[n] for n in columns[1:])])
    np.savetxt(data, rows, delimiter=",", header=",".join(columns), comments="")
    assert "orifice" in run(quartercar_app, "fit", "--list")
    run(lpvid_app, "identify", data, "--input", "velocity", "--output", "force", "--schedule", "current", "--structure",
        "noisy-output", "--na", 1, "--nb", 2, "--nk", 0, "--out", tmp_path / "model")
    written = json.loads((tmp_path / "model" / "identification.json").read_text())
    assert written["structure"]["kind"] == "noisy-output" and written["structure"]["na"] == 1
    assert isinstance(lpv.load(tmp_path / "model" / "model.json"), lpv.LPVTransferFunction)
    run(lpvid_app, "validate", tmp_path / "model" / "model.json", data)
    bad = CliRunner().invoke(lpvid_app, ["identify", str(data), "--structure", "noisy-output", "--past", "3"])
    assert bad.exit_code == 2 and "--past does not apply" in bad.output + str(bad.stderr)


def test_names_are_unknown_without_the_package():
    with pytest.raises(InputError, match="no damper model 'orifice'"):
        model_class("orifice")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Dahl(DynamicDamper):
    """Ḟ_d = σ(v − |v| F_d/F_c), F = F_d + c v (Dahl 1968): a dynamic law whose car steps come from `rates`."""

    name: ClassVar[str] = "dahl"
    title: ClassVar[str] = "Dahl"
    source: ClassVar[str] = "Dahl (1968), TOR-0158(3107-18)-1"

    @property
    def parameters(self):
        return (Parameter("viscous", "N*s/m", "c", 500.0, 0.0),
                Parameter("friction", "N", "F_c", 80.0, 1.0, 1e4, log=True),
                Parameter("stiffness", "N/m", "sigma", 2e5, 1e2, 1e7, log=True))

    @property
    def reads(self):
        return ("velocity",)

    @property
    def linear(self):
        return ("viscous",)

    @property
    def states(self):
        return ("friction force [N]",)

    @classmethod
    def suited(cls, facts):
        return cls(**facts.common)

    def rest(self, displacement, velocity, current, force, vector):
        return np.array([0.0 if force is None else force - vector[0] * velocity], dtype=vector.dtype)

    def rates(self, state, displacement, velocity, current):
        _, most, stiffness = self.vector
        return stiffness * (velocity - abs(velocity) * state / most)

    def output(self, state, displacement, velocity, current):
        return float(state[0] + self.values["viscous"] * velocity)

    def response(self, drive, vector):
        viscous, most, stiffness = vector
        v, inner = drive.velocity, np.zeros(drive.n_samples, dtype=vector.dtype)
        inner[0] = self.rest(0.0, v[0], 0.0, None if drive.force is None else drive.force[0], vector)[0]
        for k in range(1, v.size):  # exact where v is held at its mean over the sample
            mean = 0.5 * (v[k - 1] + v[k])
            end = most * np.sign(mean)
            inner[k] = end + (inner[k - 1] - end) * np.exp(-stiffness * abs(mean) * drive.sample_time / most)
        return inner + viscous * v

    def starts(self, drives, count, rng):
        return [self.vector]

    def conservative_force(self, displacement):
        return np.zeros_like(np.asarray(displacement, dtype=float))

    def static_force(self, velocity, current=0.0, displacement=0.0):
        v = np.asarray(velocity, dtype=float)
        return self.values["friction"] * np.sign(v) + self.values["viscous"] * v

    def to_lpv(self, sample_time):
        raise InputError("no LPV form of 'dahl'")


@pytest.mark.seconds
def test_a_registered_dynamic_damper_is_stepped_from_its_rates(tmp_path):
    qc.dampers.register(Dahl)
    try:
        damper = Dahl()
        assert type(lpv.load(lpv.save(damper, tmp_path / "dahl.json"))) is Dahl
        step, v = 2e-4, 0.1 * np.sin(2 * np.pi * 4 * 2e-4 * np.arange(1500))
        stepper = damper.stepper(step)
        forces = [stepper.begin(0.0, 0.0, 0.0)]
        for speed in v[1:]:
            stepper.approach(0.0)
            forces.append(stepper.trial(0.0, float(speed)))
            stepper.commit(0.0, float(speed))
        own = damper.simulate(lpv.Record({"velocity": v}, sample_time=step, units={"velocity": "m/s"})).output[:, 0]
        assert np.abs(np.array(forces) - own).max() < 0.01 * np.abs(own).max()
        with pytest.raises(InputError, match="has no exported step"):
            lpv.exportable(damper)
        assert QuarterCar(qc.parameters.MEGANE, damper).run(np.linspace(0, 0.01, 20), 1e-3).sample_time == 1e-3
    finally:
        DAMPERS.forget("dahl")


def test_what_cannot_be_registered_is_refused():
    class Half(DynamicDamper):
        name: ClassVar[str] = "half"

    class Taken(Dahl):
        name: ClassVar[str] = "guo"

    class Nameless:
        pass

    known = NamedClasses("damper model", "none", (), "quartercar.dampers.contract:Damper")
    with pytest.raises(InputError, match=r"Half is not complete.*conservative_force"):
        known.register(Half)
    with pytest.raises(InputError, match="there is a damper model 'guo' already"):
        DAMPERS.register(Taken)
    with pytest.raises(InputError, match="derived from Damper"):
        known.register(Nameless)


def test_what_a_class_states_wrongly_is_refused_where_it_is_made(installed):
    """Not in the first ride, fit or export."""
    damper, law = DAMPERS.get(NAMES[0]), CONTROLLERS.get(NAMES[1])
    for kind, stated, found in ((damper, {"reads": ("speed", "current")}, "'speed'"),
                                (law, {"reads": ("suspension_velocity", "acceleration")}, "mean 'body_acceleration'"),
                                (law, {"demands": "forces"}, "mean 'force'")):
        with pytest.raises(InputError, match=found):
            type("Wrong", (kind,), stated)()
    with pytest.raises(InputError, match="exponents that are numbers"):
        Parameter("consistency", "N*(s/m)^n", "K", 1.0)
    b = StepBuilder("held", "", 0.1)
    with pytest.raises(InputError, match="start of state 'held' is a number"):
        b.state("held", start=b.parameter("first", 2.0))
    with pytest.raises(InputError, match="must be one of tanh"):
        call("copysign", 1.0, -1.0)
    with pytest.raises(InputError, match=r"save its \.model"):
        lpv.save(lpv.identify(record(np.random.default_rng(0)), lpv.ARX(na=1, nb=1)), "never.json")


def test_a_default_of_a_structure_of_its_own_stands_on_the_command_line():
    @dataclass(frozen=True)
    class Shrunk(lpv.ARX):
        name: ClassVar[str] = "shrunk"
        na: int = 2
        ridge: float = 0.25

    STRUCTURES.register(Shrunk)
    try:
        plain, asked = (Request(("u",), ("y",), (), "shrunk", given, None).build(1) for given in (
            {}, {"na": 3, "ridge": 0.5, "no-constant": True}))
    finally:
        STRUCTURES.forget("shrunk")
    assert isinstance(plain, Shrunk) and (plain.na, plain.ridge, plain.nb, plain.affine) == (2, 0.25, (4,), 1)
    assert isinstance(asked, Shrunk) and (asked.na, asked.ridge, asked.nb, asked.affine) == (3, 0.5, (4,), 0)


@pytest.mark.seconds
def test_noisy_outputs_bias_least_squares_and_not_the_estimator_of_the_page(installed):
    """Oracle: the true coefficients, over realisations; the bias of ARX has the size that theory gives."""
    kind, found = STRUCTURES.get("noisy-output"), {}
    orders = {"na": 1, "nb": 1, "input": "u", "output": "y", "basis": lpv.Polynomial("p", degree=0)}
    for name, cls in (("arx", lpv.ARX), ("own", kind)):
        values = []
        for seed in range(6):
            rng = np.random.default_rng(seed)
            u, y = rng.normal(size=3000), np.zeros(3000)
            for k in range(1, 3000):
                y[k] = 0.7 * y[k - 1] + u[k - 1]
            data = lpv.Record({"u": u, "p": rng.uniform(size=3000), "y": y + rng.normal(size=3000)}, sample_time=0.01)
            values.append(lpv.identify(data, cls(**orders)).parameters[0])
        found[name] = np.array(values)
    power = 1 / (1 - 0.7**2)
    assert found["arx"].mean() == pytest.approx(-0.7 * power / (power + 1), abs=0.02)
    assert abs(found["own"].mean() + 0.7) < 4 * found["own"].std(ddof=1) / np.sqrt(6)
    assert found["own"].std() < 0.05
