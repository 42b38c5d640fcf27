"""ScheduledController: any LPV state-space controller in the loop, with its schedule and its anti-windup."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.controllers.contract import DEMANDS, SIGNALS, Controller, Law, Setting, Signals, Values
from quartercar.controllers.designed.schedule_rules import Rule
from quartercar.dampers.parameter import Parameter

SCALE = Parameter("gain", "", "of the controller's output", 1.0, 0.0, 3.0)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ScheduledController(Controller):
    """x⁺ = A(ρ)x + B(ρ)y + L (attained − demanded), demand = u_0 + c_nom v_d + gain·(C(ρ)x + D(ρ)y).

    ρ is evaluated by one rule per scheduling variable, clamped to the model's box (and counted where it had to be);
    y are the signals that the model's inputs are named after. The attained demand is that of the last sample, so that
    no algebraic loop arises, whatever D.

    Attributes
    ----------
    model : LPVStateSpace
        Discrete, at the loop's rate; inputs named as in `contract.SIGNALS`, one output.
    schedule : tuple of Rule
        In the order of the model's scheduling variables.
    asks : {"force", "current"}
    around : float
        u_0 [N or A].
    nominal_damping : float
        c_nom [N·s/m]; for a demand of force only.
    anti_windup : (n,) array or None
        L, from the part of the last demand that was not attained to the states.
    label : str
        Name in tables.
    """

    name: ClassVar[str] = "scheduled"
    title: ClassVar[str] = "LPV, scheduled"
    source: ClassVar[str] = "equation sheet 4.3"

    model: LPVStateSpace
    schedule: tuple[Rule, ...] = ()
    asks: str = "force"
    around: float = 0.0
    nominal_damping: float = 0.0
    anti_windup: np.ndarray | None = None
    label: str = ""
    parameters: ClassVar[tuple[Parameter, ...]] = (SCALE,)

    def check_settings(self) -> None:
        model = self.model
        object.__setattr__(self, "schedule", tuple(self.schedule))
        checks.one_of(self.asks, tuple(DEMANDS), "asks")
        if model.sample_time is None:
            raise InputError("a controller in the loop is discrete", got="a continuous model",
                             mend="lpvid.synthesis discretises it at the loop's rate")
        if model.input_stage is not None or model.scheduling_stage is not None or model.n_outputs != 1:
            raise InputError("a controller in the loop is a linear state-space model of one output",
                             got=f"{model.n_outputs} outputs" if model.n_outputs != 1 else "a filter stage")
        for signal in model.inputs:
            checks.known_name(signal.name, tuple(SIGNALS), "signal of a law")
        if len(self.schedule) != len(model.box.names):
            raise InputError("every scheduling variable needs one rule", got=f"{len(self.schedule)} rules for "
                             f"{', '.join(model.box.names) or 'no variable'}")
        if self.nominal_damping and self.asks != "force":
            raise InputError("a nominal damping belongs to a demand of force", got=f"asks='{self.asks}'")
        if self.anti_windup is not None:
            gain = checks.shaped(checks.frozen_array(self.anti_windup, "anti_windup"), (model.order,), "anti_windup")
            object.__setattr__(self, "anti_windup", checks.finite(gain, "anti_windup"))

    @property
    def reads(self) -> tuple[str, ...]:
        names = [s.name for s in self.model.inputs] + [n for rule in self.schedule for n in rule.reads]
        names += ["suspension_velocity"] if self.nominal_damping else []
        return tuple(dict.fromkeys([*names, "demanded", "attained"]))

    @property
    def demands(self) -> str:
        return self.asks

    def begin(self, values: Values, setting: Setting) -> Law:
        assert self.model.sample_time is not None
        if abs(setting.sample_time / self.model.sample_time - 1) > RATE_TOLERANCE:
            raise InputError("the controller runs at another rate than the loop",
                             got=f"{1 / self.model.sample_time:.6g} Hz against {1 / setting.sample_time:.6g} Hz",
                             mend="design it at the damper's rate")
        return ScheduledLaw(self, values, setting)

    @classmethod
    def settings_from(cls, data: Mapping) -> dict[str, Any]:
        given = dict(data)
        gain = given.get("anti_windup")
        return {**given, "model": LPVStateSpace.from_dict(given["model"]),
                "schedule": tuple(map(Rule.from_dict, given["schedule"])),
                "anti_windup": None if gain is None else np.asarray(gain, dtype=float)}


class ScheduledLaw(Law):
    """A running scheduled controller; `states` (cars, n) may be read.

    Parameters
    ----------
    controller : ScheduledController
        Its model, schedule and anti-windup.
    values : mapping of str to (cars,) array
        `gain` of every car.
    setting : Setting
        For the number of cars, and for the rules of the schedule.

    Attributes
    ----------
    states : (cars, n) array
        x of every car; zero at the start.
    """

    def __init__(self, controller: ScheduledController, values: Values, setting: Setting) -> None:
        model = controller.model
        assert model.state_offset is not None and model.output_offset is not None
        self._model = model
        self._c, self._gain = controller, values["gain"]
        self._rules = [rule.start(setting) for rule in controller.schedule]
        self._inputs = [s.name for s in model.inputs]
        top = np.concatenate([model.A, model.B, model.state_offset[:, :, None]], axis=2)
        bottom = np.concatenate([model.C, model.D, model.output_offset[:, :, None]], axis=2)
        self._stacked = np.concatenate([top, bottom], axis=1)
        self._low, self._high = np.array(model.box.lower), np.array(model.box.upper)
        self._slack = 1e-9 * (1 + self._high - self._low)
        self.states = np.zeros((setting.cars, model.order))
        self._outside = np.zeros(setting.cars)

    def step(self, seen: Signals) -> np.ndarray:
        c, cars = self._c, len(self.states)
        rho = np.column_stack([rule(seen) for rule in self._rules]) if self._rules else np.zeros((cars, 0))
        kept = np.clip(rho, self._low, self._high)
        self._outside += np.any(np.abs(rho - kept) > self._slack, axis=1)
        matrices = np.einsum("cm,mij->cij", self._model.basis.evaluate(kept), self._stacked)
        stacked = np.concatenate([self.states, *(seen[n][:, None] for n in self._inputs), np.ones((cars, 1))], axis=1)
        ahead = np.einsum("cij,cj->ci", matrices, stacked)
        self.states = ahead[:, :-1]
        if c.anti_windup is not None:
            self.states = self.states + (seen["attained"] - seen["demanded"])[:, None] * c.anti_windup
        out = c.around + self._gain * ahead[:, -1]
        return out + c.nominal_damping * seen["suspension_velocity"] if c.nominal_damping else out

    def counted(self) -> dict[str, np.ndarray]:
        """Samples whose scheduling had to be clamped to the box."""
        return {"scheduling_outside": self._outside}
