"""H-infinity control designed without limits; what the damper cannot give is clipped outside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller, Law, Setting, Values
from quartercar.controllers.designed.lpv_hinf import WEIGHTS, BankedLaw, scheduled, task_of
from quartercar.controllers.designed.scheduled import ScheduledController
from quartercar.controllers.designed.suspension_design import CRITERIA, Task
from quartercar.dampers.parameter import Parameter
from quartercar.lpv_models.weighted import MEASUREMENTS


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LpvHinfClipped(Controller):
    """F = c_nom v_d + u, u = K y; K by H-infinity synthesis for a damper that could give any force.

    The same plant and weights as `LpvHinf` at ρ = 1 throughout; the inverse damper model then takes the nearest force
    that there is. The design does not take that into account.

    Attributes
    ----------
    measured : str
        What y is: a name of `quartercar.lpv_models.weighted.MEASUREMENTS`.
    criterion : {"hinf", "h2"}
        As in `suspension_design.Task`.
    lag : float
        From demand to force [s].
    """

    name: ClassVar[str] = "lpv-hinf-clipped"
    title: ClassVar[str] = "H-infinity, clipped"
    source: ClassVar[str] = "Poussot-Vassal 2008; equation sheet 4.3"

    measured: str = "observed"
    criterion: str = "hinf"
    lag: float = 0.004
    parameters: ClassVar[tuple[Parameter, ...]] = WEIGHTS
    demands: ClassVar[str] = "force"

    def check_settings(self) -> None:
        checks.one_of(self.measured, tuple(MEASUREMENTS), "measured")
        checks.one_of(self.criterion, CRITERIA, "criterion")
        checks.positive(self.lag, "lag", "s")

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys([*MEASUREMENTS[self.measured], "suspension_velocity", "demanded", "attained"]))

    def task(self, values: Mapping[str, float], setting: Setting) -> Task:
        """The design that values stand for, in a setting.

        Parameters
        ----------
        values : mapping of str to float
            Every parameter of the law by name, each in its unit.
        setting : Setting
            Its car, damper model and limits of current count.

        Returns
        -------
        Task
            With the law's `measured`, `lag` and `criterion`; the damper's limits are left out.
        """
        return task_of(values, setting, self, None)

    def begin(self, values: Values, setting: Setting) -> Law:
        rows = [{n: float(a[k]) for n, a in values.items()} for k in range(setting.cars)]
        return BankedLaw([self.task(row, setting) for row in rows], setting.sample_time)

    def designed(self, setting: Setting) -> ScheduledController:
        """The controller as it runs, to be stored: needs no synthesis any more.

        Parameters
        ----------
        setting : Setting
            Its sample time is that of the stored controller.

        Returns
        -------
        ScheduledController
            Discrete, without a schedule.
        """
        return scheduled(self.task(self.values, setting), setting.sample_time, self.title)
