"""FMUs inside a car: a damper FMU solved implicitly with the masses, and a loop-law FMU that commands the current."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lpvid.export.c_build import find_compiler
from lpvid.export.exportable import Options
from lpvid.export.exporting import written
from lpvid.export.fmu import step_content
from quartercar.controllers import law_class
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.chain import ChainSettings, ControllerChain
from quartercar.controllers.loop.sensing import SETS
from quartercar.dampers.stepper import DamperStepper
from quartercar.export import EXPORTER
from quartercar.export.loop_steps import LoopLaw
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import Coil, QuarterCar

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
CURRENT = 0.8


class Slave:
    """An FMU by the names of its variables, one period at a time."""

    def __init__(self, noun, start: dict[str, float], folder: Path) -> None:
        fmpy = pytest.importorskip("fmpy", reason="the extra 'fmu' is not installed")
        from fmpy.fmi2 import FMU2Slave

        found = EXPORTER.prepare(noun, Options())
        path = str(written(step_content(found, 2), folder / "made").files[0])
        described = fmpy.read_model_description(path)
        fmpy.extract(path, str(folder))
        self._named = {v.name: v.valueReference for v in described.modelVariables}
        self._fmu = FMU2Slave(guid=described.guid, unzipDirectory=str(folder), instanceName="part",
                              modelIdentifier=described.coSimulation.modelIdentifier)
        self._fmu.instantiate()
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._set(start)
        self._fmu.exitInitializationMode()
        self._period, self._time = found.program.sample_time, 0.0

    def _set(self, values: dict[str, float]) -> None:
        self._fmu.setReal([self._named[n] for n in values], list(map(float, values.values())))

    def step(self, inputs: dict[str, float], output: str) -> float:
        self._set(inputs)
        self._fmu.doStep(self._time, self._period)
        self._time += self._period
        return self._fmu.getReal([self._named[output]])[0]

    def peek(self, inputs: dict[str, float], output: str) -> float:
        """The output of a step that is then undone."""
        kept, time = self._fmu.getFMUState(), self._time
        out = self.step(inputs, output)
        self._fmu.setFMUState(kept)
        self._fmu.freeFMUState(kept)
        self._time = time
        return out

    def close(self) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()


class FmuStepper(DamperStepper):
    """A damper FMU as the car carries any damper along."""

    def __init__(self, damper, own: DamperStepper, folder: Path) -> None:
        self._own = own
        rest = self._own.begin(0.0, 0.0, CURRENT)
        self._slave = Slave(damper, {f"past_outputs[{i + 1},1]": rest for i in range(damper.start)}, folder)
        self._current = CURRENT

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        return self._own.begin(displacement, velocity, current)

    def approach(self, current: float) -> None:
        self._current = current

    def trial(self, displacement: float, velocity: float) -> float:
        return self._slave.peek({"velocity": velocity, "current": self._current}, "force")

    def commit(self, displacement: float, velocity: float) -> None:
        self._slave.step({"velocity": velocity, "current": self._current}, "force")

    def close(self) -> None:
        self._slave.close()


def test_a_damper_fmu_in_a_quarter_car_drives_like_the_damper(monkeypatch, tmp_path):
    damper = identified_damper()
    car = QuarterCar(MEGANE, damper)
    road = 0.02 * np.sin(2 * np.pi * 3.0 * np.arange(150) / 512)
    own = car.run(road, damper.clock, CURRENT)
    made = []

    own_stepper = type(damper).stepper

    def with_fmu(chosen, step):
        made.append(FmuStepper(chosen, own_stepper(chosen, step), tmp_path))
        return made[-1]

    monkeypatch.setattr(type(damper), "stepper", with_fmu)
    run = car.run(road, damper.clock, CURRENT)
    made[0].close()
    for name in ("damper_force", "body_acceleration", "tyre_force"):
        assert np.abs(run[name] - own[name]).max() < 1e-9 * np.abs(own[name]).max(), name
    assert np.abs(own["damper_force"]).max() > 100


@pytest.mark.seconds
def test_a_loop_law_fmu_commands_like_the_chain_of_a_ride(tmp_path):
    """Readings of a car on a road, sensors with noise: the same current, sample for sample."""
    damper = identified_damper()
    setting = Setting(damper.clock, 1, MEGANE, damper, (0.0, 2.0))
    coil, settings = Coil(0.005, 0.010, 0.0, 2.0), ChainSettings(SETS["stroke-body"])
    law = law_class("skyhook")()
    n = 300
    road = 0.03 * np.sin(2 * np.pi * 1.5 * np.arange(n) / 512) ** 2
    run = QuarterCar(MEGANE, damper).run(road, damper.clock, CURRENT)
    chain = ControllerChain([law], setting, coil, settings, [np.random.default_rng(1)], n)
    slave = Slave(LoopLaw(law, setting, coil, settings), {}, tmp_path)
    commands, given = [], []
    sensing = chain._sensing
    for k in range(n):
        readings = sensing({s: run[s][k : k + 1] for s in SETS["stroke-body"].signals})
        commands.append(chain.react(readings)[0])
        given.append(slave.step({name: values[0] for name, values in readings.items()}, "command"))
    slave.close()
    assert np.ptp(commands) > 0.5
    assert np.abs(np.subtract(commands, given)).max() < 1e-9
