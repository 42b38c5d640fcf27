"""LPV H-infinity control with the damper's limits inside the design: scheduled on the share of a demand it can give."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller, Law, Setting, Signals, Values, by_car
from quartercar.controllers.designed.schedule_rules import GivenShare, share
from quartercar.controllers.designed.scheduled import ScheduledController
from quartercar.controllers.designed.suspension_design import CRITERIA, Task, nominal_damping, running
from quartercar.dampers.contract import Damper
from quartercar.dampers.parameter import Parameter
from quartercar.lpv_models.weighted import MEASUREMENTS, SuspensionWeights

WEIGHTS = (
    Parameter("tyre_force", "N", "dynamic tyre force that counts as 1 m/s^2 of the body", 8000.0, 500.0, 50000.0,
              log=True),
    Parameter("stroke", "m", "suspension deflection that counts as that", 0.35, 0.02, 1.0, log=True),
    Parameter("demand", "N", "demand that counts as that", 400.0, 100.0, 30000.0, log=True),
    Parameter("comfort_high", "Hz", "upper corner of the comfort band", 15.0, 4.0, 60.0, log=True),
    Parameter("wheel_low", "Hz", "lower corner of the wheel band", 1.6, 0.5, 10.0, log=True),
    Parameter("nominal_share", "", "c_nom, between the damper's weakest and strongest", -0.02, -0.2, 0.3),
)
LIMITS = (
    Parameter("relief", "", "share of the weights where the damper gives nothing", 0.7, 0.05, 1.0),
    Parameter("least_share", "", "smallest share of a demand in the design", 0.87, 0.0, 0.95),
)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class DesignedLaw(Controller):
    """F = c_nom v_d + u, u = K y, with K by synthesis from weights: what the laws on the nominal plant share.

    Attributes
    ----------
    measured : str
        What y is: a name of `quartercar.lpv_models.weighted.MEASUREMENTS`.
    criterion : {"hinf", "h2"}
        As in `suspension_design.Task`.
    lag : float
        From demand to force [s].
    """

    measured: str = "observed"
    criterion: str = "hinf"
    lag: float = 0.004
    demands: ClassVar[str] = "force"

    @abstractmethod
    def least_share(self, values: Mapping[str, float]) -> float | None:
        """Smallest share of a demand in the design.

        Parameters
        ----------
        values : mapping of str to float
            As in `task`.

        Returns
        -------
        float or None
            None leaves the damper's limits out.
        """

    def check_settings(self) -> None:
        checks.one_of(self.measured, tuple(MEASUREMENTS), "measured")
        checks.one_of(self.criterion, CRITERIA, "criterion")
        checks.positive(self.lag, "lag", "s")

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys([*MEASUREMENTS[self.measured], "suspension_velocity", "demanded", "attained"]))

    def task(self, values: Mapping[str, float], setting: Setting) -> Task:
        """The design that values stand for, in a setting; c_nom follows from its damper.

        Parameters
        ----------
        values : mapping of str to float
            Every parameter of the law by name, each in its unit. Weights that it does not have keep the defaults of
            `SuspensionWeights`.
        setting : Setting
            Its car, damper model and limits of current count.

        Returns
        -------
        Task
            Ready for synthesis.

        Raises
        ------
        InputError
            A setting without a damper model, or a nominal damping that is not positive.
        """
        names = ("tyre_force", "stroke", "demand", "comfort_high", "wheel_low", "relief")
        given = {n: values[n] for n in names if n in values}
        damping = nominal_damping(known_damper(setting), setting.currents, values["nominal_share"])
        return Task(setting.parameters, damping, SuspensionWeights(**given), self.least_share(values), self.measured,
                    self.lag, criterion=self.criterion)

    def begin(self, values: Values, setting: Setting) -> Law:
        tasks = [self.task(row, setting) for row in by_car(values, setting.cars)]
        return BankedLaw(tasks, setting.sample_time)

    def designed(self, setting: Setting) -> ScheduledController:
        """The controller as it runs, to be stored: needs no synthesis any more.

        Parameters
        ----------
        setting : Setting
            Its sample time is that of the stored controller.

        Returns
        -------
        ScheduledController
            Discrete; scheduled on the given share of the demand where the limits are in the design.
        """
        return scheduled(self.task(self.values, setting), setting.sample_time, self.title)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LpvHinf(DesignedLaw):
    """F = c_nom v_d + u, u = K(ρ) y, ρ = sat(u)/u of the damper's own limits; K by LPV H-infinity synthesis.

    The plant is the car behind the coil's lag with F = c_nom v_d + ρ u_lagged (`quartercar.lpv_models.LimitedForce`),
    whose weights are the parameters here; ρ may jump. Equation sheet 4.3, E2, E3 and E5; Do, Sename, Dugard (2010).
    """

    name: ClassVar[str] = "lpv-hinf"
    title: ClassVar[str] = "LPV H-infinity, limits inside"
    source: ClassVar[str] = "Do, Sename, Dugard 2010; equation sheet 4.3"
    parameters: ClassVar[tuple[Parameter, ...]] = (*WEIGHTS, *LIMITS)

    def least_share(self, values: Mapping[str, float]) -> float:
        return values["least_share"]


def known_damper(setting: Setting) -> Damper:
    """The damper model of a setting.

    Parameters
    ----------
    setting : Setting

    Returns
    -------
    Damper

    Raises
    ------
    InputError
        A viscous car.
    """
    if setting.damper is None:
        raise InputError("an H-infinity suspension law needs a damper model", got="a viscous car",
                         mend="give the car a damper model")
    return setting.damper


def scheduled(task: Task, sample_time: float, label: str) -> ScheduledController:
    """A designed controller with the rule of its schedule.

    Parameters
    ----------
    task : Task
        Its synthesis is looked up, or run where there is none yet.
    sample_time : float
        Of the loop [s].
    label : str
        Name in tables.

    Returns
    -------
    ScheduledController
        With the rule `GivenShare`; without a schedule where the task leaves the limits out.
    """
    model = running(task, sample_time)
    rules = () if task.least_share is None else (GivenShare(task.nominal_damping, task.least_share),)
    return ScheduledController(model=model, schedule=rules, nominal_damping=task.nominal_damping, label=label)


class BankedLaw(Law):
    """Designed controllers of many cars, each with its own; the same steps as a `ScheduledController` for each.

    Parameters
    ----------
    tasks : list of Task
        One for each car; all measure the same signals and are scheduled alike. Equal tasks share one synthesis.
    sample_time : float
        Of the loop [s].
    """

    def __init__(self, tasks: list[Task], sample_time: float) -> None:
        models = {task: running(task, sample_time) for task in dict.fromkeys(tasks)}
        first = next(iter(models.values()))
        self._names = [s.name for s in first.inputs]
        order, places = max(m.order for m in models.values()), {t: k for k, t in enumerate(models)}
        self._stacked = np.array([_padded(m, order) for m in models.values()])
        self._which = np.array([places[t] for t in tasks])
        self._nodes = self._stacked.shape[1]
        self._least = np.array([0.0 if t.least_share is None else t.least_share for t in tasks])
        self._damping = np.array([t.nominal_damping for t in tasks])
        self._x = np.zeros((len(tasks), order))
        self._base = np.zeros(len(tasks))
        self._short = np.zeros(len(tasks))

    def step(self, seen: Signals) -> np.ndarray:
        stacked = np.concatenate([self._x, *(seen[n][:, None] for n in self._names)], axis=1)
        rho = share(seen["demanded"] - self._base, seen["attained"] - self._base, self._least)
        self._short += rho < 1
        if self._nodes == 1:
            matrices = self._stacked[self._which, 0]
        else:
            at = (rho - self._least) / (1 - self._least) * (self._nodes - 1)
            low = np.minimum(at.astype(int), self._nodes - 2)
            part = (at - low)[:, None, None]
            matrices = (1 - part) * self._stacked[self._which, low] + part * self._stacked[self._which, low + 1]
        ahead = np.einsum("cij,cj->ci", matrices, stacked)
        self._x = ahead[:, :-1]
        self._base = self._damping * seen["suspension_velocity"]
        return self._base + ahead[:, -1]

    def counted(self) -> dict[str, np.ndarray]:
        """Samples at which the damper did not give all that was asked."""
        return {"demand_not_met": self._short}


def _padded(model: Any, order: int) -> np.ndarray:
    """(M, order + 1, order + inputs): [A B; C D] at every node, filled up with idle states."""
    m, n, nu = model.A.shape[0], model.order, model.n_filter_inputs
    out = np.zeros((m, order + 1, order + nu))
    out[:, :n, :n], out[:, :n, order:] = model.A, model.B
    out[:, order, :n], out[:, order, order:] = model.C[:, 0], model.D[:, 0]
    return out
