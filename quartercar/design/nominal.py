"""design: a suspension controller from weights, with what its closed loop was shown to do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np

from lpvid.errors import InputError
from quartercar.controllers.contract import Setting
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
from quartercar.controllers.designed.suspension_design import (
    Task,
    admissible,
    nodes_of,
    running,
    synthesized,
    to_the_end,
)
from quartercar.dampers.contract import Damper
from quartercar.design.figures import FREQUENCIES, SHOWN, SuspensionDesign, names_of
from quartercar.design.identified import IdentifiedDesign, design_identified
from quartercar.lpv_models.car_part import passive_sense
from quartercar.rides.simulation import RideSettings
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import QuarterCar


@dataclass(frozen=True, eq=False)
class Design(SuspensionDesign):
    """A designed controller, or why there is none.

    Attributes
    ----------
    car : QuarterCar
    law : LpvHinf or LpvHinfClipped
        With the weights.
    task : Task
    synthesis : Synthesis
    setting : Setting
    """

    law: LpvHinf | LpvHinfClipped
    task: Task

    baseline = "c_nom alone"
    plant_rows = ()
    shares = "The share ρ of the demand that the damper gives frozen at values over its range; dashed: the nominal " \
             "damping alone."

    @cached_property
    def gains(self) -> tuple[tuple[float, dict[str, np.ndarray]], ...]:
        """(ρ, gains from the road's elevation to `SHOWN` at `FREQUENCIES`) over the scheduling range, ρ frozen."""
        nodes, system = nodes_of(self.task), self.task.weighted.system
        outputs = [s.name for s in system.outputs]
        rows = [outputs.index(n) for n in SHOWN]
        names = [s.name for s in nodes.inputs]
        seen = [outputs.index(n) for n in names]
        s = 2j * np.pi * FREQUENCIES[:, None, None]
        found = []
        for k, point in enumerate(nodes.points):
            a, b, c, d = system.frozen(point[:len(system.box.names)])
            plant = c @ np.linalg.solve(s * np.eye(len(a)) - a, b + 0j) + d
            ka, kb, kc, kd = (m[k] for m in nodes.matrices)
            law = kc @ np.linalg.solve(s * np.eye(len(ka)) - ka, kb + 0j) + kd
            road, own = plant[:, :, :1], plant[:, :, 1:]
            demand = np.linalg.solve(np.eye(1) - law @ own[:, seen], law @ road[:, seen])
            whole = np.abs(s[:, :, 0] * (road[:, rows] + own[:, rows] @ demand)[:, :, 0])
            share = float(point[0]) if point.size else 1.0
            found.append((share, dict(zip(SHOWN, whole.T, strict=True))))
        return tuple(found)

    @property
    def passive_gains(self) -> dict[str, np.ndarray]:
        """The same of the car with c_nom alone."""
        system = LinearCar(self.car.parameters.replace(damping=self.task.nominal_damping)).relative()
        s = 2j * np.pi * FREQUENCIES[:, None, None]
        found = np.abs(s * (system.C @ np.linalg.solve(s * np.eye(4) - system.A, system.B[:, :1] + 0j)
                            + system.D[:, :1]))[:, :, 0]
        return {n: found[:, system.outputs.index(n)] for n in SHOWN}

    @property
    def promise(self) -> str:
        s = self.synthesis
        return (f"{self.law.title}: gain from {names_of(s, 'inputs')} to {names_of(s, 'outputs')} at most "
                f"{s.gamma_verified:.4g}, verified {self.verified_where}; c_nom {self.task.nominal_damping:.0f} N*s/m, "
                f"command {self.car.coil.lowest:g} to {self.car.coil.highest:g} {self._unit}.")

    @property
    def _unit(self) -> str:
        """Of the command: what schedules the damper."""
        return "A" if self.car.damper is None else self.car.damper.current_unit

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Name and value, for the head of a report."""
        return (("law", self.law.title), ("measured", self.law.measured), ("plant", "nominal"),
                ("c_nom", f"{self.task.nominal_damping:.0f} N*s/m"), ("loop", f"{1 / self.setting.sample_time:.6g} Hz"))

    @property
    def caveats(self) -> tuple[str, ...]:
        """What the verdict does not cover."""
        lines = []
        if self.synthesis.solved and not self.synthesis.between_grid:
            lines.append("The gain is verified at points of a grid of the scheduling only.")
        if self.law.measured == "observed":
            lines.append("The gain is that of the loop with the car's own states; the observer is not in it.")
        if self.task.least_share is None:
            lines.append("The design does not include the damper's limits; the bound holds while no demand is clipped.")
        elif self.task.least_share > 0:
            lines.append(f"The bound holds while the damper gives at least {self.task.least_share:.0%} of each demand.")
        return tuple(lines)

    def plant_facts(self) -> dict[str, Any]:
        coil = self.car.coil
        return {"plant": {"kind": "nominal", "nominal_damping": self.task.nominal_damping},
                "nominal_damping": self.task.nominal_damping,
                "command": {"lowest": coil.lowest, "highest": coil.highest, "unit": self._unit},
                "sample_time": self.setting.sample_time, "measured": self.law.measured,
                "criterion": self.law.criterion}


@overload
def design(car: QuarterCar, law: LpvHinf | LpvHinfClipped | None = None,
           settings: RideSettings | None = None) -> Design: ...
@overload
def design(car: QuarterCar, law: LpvHinfIdentified, settings: RideSettings | None = None) -> IdentifiedDesign: ...
@overload
def design(car: QuarterCar, law: LpvHinf | LpvHinfClipped | LpvHinfIdentified,
           settings: RideSettings | None = None) -> Design | IdentifiedDesign: ...
def design(car: QuarterCar, law: LpvHinf | LpvHinfClipped | LpvHinfIdentified | None = None,
           settings: RideSettings | None = None) -> Design | IdentifiedDesign:
    """Design a controller for a car with a semi-active damper.

    Parameters
    ----------
    car : QuarterCar
        With a damper model and a coil whose limits are finite.
    law : LpvHinf, LpvHinfClipped or LpvHinfIdentified, optional
        Its parameters are the weights, and its kind decides the plant; `LpvHinf()` if left out.
    settings : RideSettings, optional
        For the loop's rate and the designer's models.

    Returns
    -------
    Design or IdentifiedDesign
        A synthesis that fails comes back with its verdict.

    Raises
    ------
    InputError
        A damper of reversed polarity, one whose force does not follow the current, a car without a damper model, a
        coil without a highest current.
    """
    law, settings = law or LpvHinf(), settings or RideSettings()
    damper = settings.model or car.damper
    currents = (car.coil.lowest, car.coil.highest)
    if damper is not None:
        passive_sense(damper)
        _commanded(damper, currents)
    setting = Setting(settings.period(car), 1, settings.parameters or car.parameters, damper, currents)
    if isinstance(law, LpvHinfIdentified):
        return design_identified(car, law, setting)
    task = law.task(law.values, setting)
    return Design(car, law, task, to_the_end(synthesized, task, running), setting)


def _commanded(damper: Damper, currents: tuple[float, float]) -> None:
    """Refuse a coil without limits and a damper on which the current has no effect."""
    unit = damper.current_unit
    if not np.isfinite(currents[1]):
        raise InputError("a design needs limits of the current", got=f"{currents[0]:g} to {currents[1]:g} {unit}",
                         mend="give the car a coil with a highest current")
    band = admissible(damper, currents)
    if np.ptp([band.least, band.most], axis=0).max() <= 1e-6 * np.abs(band.most).max():
        raise InputError(f"the damper '{damper.name}' has the same force at every current, so that there is nothing to "
                         "command", got=f"currents from {currents[0]:g} to {currents[1]:g} {unit}",
                         mend="fit a model that depends on the current")

