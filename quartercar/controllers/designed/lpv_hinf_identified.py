"""LPV H-infinity control on the plant with the identified damper's own dynamics: the law, and a design to be stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller, Law, Setting, Values, by_car
from quartercar.controllers.designed.damper_design import DamperTask, feasible, gain_vector
from quartercar.controllers.designed.damper_law import READS, DamperGain, DamperLaw
from quartercar.controllers.designed.lpv_hinf import WEIGHTS, known_damper
from quartercar.controllers.designed.scheduled import SCALE
from quartercar.dampers.contract import Damper
from quartercar.dampers.parameter import Parameter
from quartercar.lpv_models.weighted import SuspensionWeights

START = {"tyre_force": 8000.0, "stroke": 0.06, "demand": 200.0, "comfort_high": 9.0, "wheel_low": 3.0}
"""where 48 evaluations on ISO C and a bump with the embedded damper ended, rounded"""
OWN = tuple(replace(p, default=START[p.name]) for p in WEIGHTS if p.name in START)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LpvHinfIdentified(Controller):
    """u = K x over car, damper and weights, and the current whose added force is nearest to u; K by LPV H-infinity.

    The plant is the car with the identified damper frozen at i_0 and, behind the coil's lag, the force that the current
    adds (`quartercar.lpv_models.ContinuousDamper`); K is a dissipative feedback
    (`lpvid.synthesis.dissipative_feedback`): what vanishing velocity and the coil's limits take of u leaves its bound
    as it is. The weights are the parameters. Equation sheet 4.3, E9.

    Attributes
    ----------
    lag : float
        From demand to added force [s].
    centre : float or None
        i_0 [A]; None for the lowest current at which the frozen car is stable.
    order : int or None
        Of the damper in the plant; None for the least that is good enough.
    back_off : float
        As in `DissipativeFeedback`.
    """

    name: ClassVar[str] = "lpv-hinf-identified"
    title: ClassVar[str] = "LPV H-infinity, identified plant"
    source: ClassVar[str] = "equation sheet 4.3, E9; Scruggs 2007"

    lag: float = 0.004
    centre: float | None = None
    order: int | None = None
    back_off: float = 3.0
    parameters: ClassVar[tuple[Parameter, ...]] = OWN
    reads: ClassVar[tuple[str, ...]] = READS
    demands: ClassVar[str] = "current"

    def check_settings(self) -> None:
        checks.positive(self.lag, "lag", "s")

    def task(self, values: Mapping[str, float], setting: Setting) -> DamperTask:
        """The design that values stand for, in a setting.

        Parameters
        ----------
        values : mapping of str to float
            Every parameter of the law by name, each in its unit: the fields of `SuspensionWeights` of these names.
        setting : Setting
            Its car, damper model and limits of current count.

        Returns
        -------
        DamperTask
            With the law's `lag`, `centre`, `order` and `back_off`.

        Raises
        ------
        InputError
            A setting without a damper model.
        """
        return DamperTask(setting.parameters, known_damper(setting), setting.currents, SuspensionWeights(**values),
                          self.lag, self.centre, self.order, self.back_off)

    def begin(self, values: Values, setting: Setting) -> Law:
        tasks = [self.task(row, setting) for row in by_car(values, setting.cars)]
        made = {task: gain_of(task) for task in dict.fromkeys(tasks)}
        return DamperLaw([made[t] for t in tasks], setting)

    def designed(self, setting: Setting) -> IdentifiedController:
        """The controller as it runs, to be stored: needs no synthesis any more.

        Parameters
        ----------
        setting : Setting
            Its car, damper model and limits of current count.

        Returns
        -------
        IdentifiedController
            With the damper's model inside, which it runs.
        """
        found = gain_of(self.task(self.values, setting))
        return IdentifiedController(damper=found.damper, centre=found.centre, filter=found.filter, bands=found.bands,
                                    limits=found.limits, gain_vector=found.gain, label=self.title)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class IdentifiedController(Controller):
    """A designed gain over car, damper and weights, with the damper's model that it runs.

    Attributes
    ----------
    damper : Damper
    centre, filter, bands, limits, gain_vector
        As in `damper_law.DamperGain`.
    label : str
        Name in tables.
    """

    name: ClassVar[str] = "identified-plant"
    title: ClassVar[str] = "LPV H-infinity, identified plant"
    source: ClassVar[str] = "equation sheet 4.3, E9; Scruggs 2007"

    damper: Damper
    centre: float
    filter: tuple[np.ndarray, ...]
    bands: tuple[tuple[float, float, float], tuple[float, float, float]]
    limits: np.ndarray
    gain_vector: np.ndarray
    label: str = ""
    parameters: ClassVar[tuple[Parameter, ...]] = (SCALE,)
    reads: ClassVar[tuple[str, ...]] = READS
    demands: ClassVar[str] = "current"

    def check_settings(self) -> None:
        n = len(np.atleast_2d(self.filter[0]))
        for name, shape in (("limits", (2,)), ("gain_vector", (n + 9,))):
            array = checks.shaped(checks.frozen_array(getattr(self, name), name), shape, name)
            object.__setattr__(self, name, checks.finite(array, name))

    def begin(self, values: Values, setting: Setting) -> Law:
        return DamperLaw([DamperGain(self.damper, self.centre, self.filter,  # type: ignore[arg-type]
                                     self.bands, self.limits, g * self.gain_vector)
                          for g in values["gain"]], setting)

    @classmethod
    def settings_from(cls, data: Mapping) -> dict[str, Any]:
        from quartercar.dampers import stored_damper

        given = dict(data)
        bands = [tuple(map(float, band)) for band in given["bands"]]
        return {**given, "damper": stored_damper(given["damper"]),
                "filter": tuple(np.asarray(m, dtype=float) for m in given["filter"]), "bands": (bands[0], bands[1]),
                **{n: np.asarray(given[n], dtype=float) for n in ("limits", "gain_vector")}}


def gain_of(task: DamperTask) -> DamperGain:
    """A designed gain with what it runs on, for the largest box that admits one.

    Parameters
    ----------
    task : DamperTask
        Where the box of ρ_v admits no controller, its `slow` is raised along `SLOW`.

    Returns
    -------
    DamperGain
        K, with limits of ρ_v of zero where the plant has none.

    Raises
    ------
    NumericalError
        No box of `SLOW` admits a controller.
    """
    task = feasible(task)
    bands, plant = task.weights.bands, task.embedding
    return DamperGain(task.damper, plant.frozen.current, plant.matrices,
                      (bands["body_acceleration"], bands["tyre_force"]), np.array(plant.limits or (0.0, 0.0)),
                      gain_vector(task))
