"""Model predictive control within the limits of the identified damper's current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller, Law, Setting, Signals, Values
from quartercar.controllers.laws.horizon import CostWeights, Horizon
from quartercar.controllers.laws.horizon_uncertainty import Uncertainty
from quartercar.dampers.parameter import Parameter
from quartercar.vehicle.nonlinear import Coil

TYRE = Parameter("tyre_weight", "", "rho_t, of the tyre's force", 0.3, 1e-2, 10.0, log=True)
STROKE = Parameter("stroke_weight", "", "rho_z, of the spring's force", 1e-2, 1e-4, 1.0, log=True)
FIRST = 1e6
"""step length to begin with, in units of a force² over the cost: an iteration that raises the cost halves it"""
FEWEST = 8
"""samples that a horizon has at least"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Predictive(Controller):
    """The first current of the sequence of least cost over the next samples, found anew at every sample.

    The prediction (`quartercar.controllers.laws.horizon`) is the nonlinear car with the damper as identified: its
    memory, its limits of current, the lag of coil and damper. What of the road is known ahead (`road_ahead`) is in it,
    and the road stays level after that: the expected course of a road of white velocity. What the state and the road
    may deviate by from there, and the damping that this meets, is in the cost (`horizon_uncertainty`). The sequence of
    the sample before, moved on, or the lowest current throughout where that costs less, is where a fixed number of
    iterations starts (Diehl, Bock, Schlöder 2005, SIAM J. Control Optim. 43, 1714-1736).

    Attributes
    ----------
    horizon : float
        [s]; longer where more of the road is known ahead, all of which it then covers.
    rounds : int
        Iterations per sample.
    given_weight : float
        ρ_e, of the energy that an identified model gives [(m/s²)²/W].

    Examples
    --------
    >>> Predictive(horizon=0.1)
    Predictive(tyre_weight=0.3, stroke_weight=0.01)
    """

    name: ClassVar[str] = "mpc"
    title: ClassVar[str] = "MPC"
    source: ClassVar[str] = "Mayne, Rawlings, Rao, Scokaert 2000, Automatica 36, 789-814; " \
                            "quartercar.controllers.laws.horizon"

    horizon: float = 0.15
    rounds: int = 3
    given_weight: float = 1.0
    parameters: ClassVar[tuple[Parameter, ...]] = TYRE, STROKE
    reads: ClassVar[tuple[str, ...]] = (
        "suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity", "suspension_velocity",
        "current", "road_ahead")
    demands: ClassVar[str] = "current"

    def check_settings(self) -> None:
        checks.positive(self.horizon, "horizon of mpc", "s")
        checks.count(self.rounds, "rounds of mpc", at_least=1)
        if checks.real(self.given_weight, "given_weight of mpc") < 0:
            raise InputError("given_weight of mpc must not be negative", got=f"{self.given_weight:g}")

    def begin(self, values: Values, setting: Setting) -> Law:
        samples = round(self.horizon / setting.sample_time)
        if samples < FEWEST:
            raise InputError("the horizon of mpc is too short", got=f"{self.horizon:g} s, {samples} samples",
                             mend=f"at least {FEWEST * setting.sample_time:.3g} s")
        samples = max(samples, setting.preview)
        coil = Coil(setting.coil.rise_time, setting.coil.fall_time, *setting.currents)
        model = Horizon.of(setting.parameters, setting.damper, coil, setting.sample_time, samples)
        weights = CostWeights(values["tyre_weight"], values["stroke_weight"], np.full(setting.cars, self.given_weight))
        rows = model.weights(weights)
        return PredictiveLaw(model, rows, model.uncertain(rows, _unknown(setting, samples)), self.rounds)


def _unknown(setting: Setting, samples: int) -> Uncertainty:
    """What the observer leaves, and the road: beyond the preview all of it, before that what its estimate leaves."""
    road = np.full(samples, setting.road_level)
    road[:setting.preview] *= setting.road_error
    return Uncertainty(setting.estimate_error, road)


class PredictiveLaw(Law):
    """A horizon that recedes, for many cars.

    Parameters
    ----------
    model : Horizon
    weights : ((cars, 4), (cars, n, n) arrays)
        As `Horizon.weights` gives them.
    unknown : (cars, N, G) array
        As `Horizon.uncertain` gives it.
    rounds : int

    Attributes
    ----------
    plan : (cars, N) array
        Commands from here on.
    cost : (cars,) array
        Of that plan.
    """

    def __init__(self, model: Horizon, weights: tuple[np.ndarray, np.ndarray], unknown: np.ndarray, rounds: int
                 ) -> None:
        self._model, self._rounds, self._unknown = model, rounds, unknown
        self._weights, self._ends = weights
        cars, n = len(self._weights), model.samples
        forces, inputs = model.history
        low = float(model.limits[0])
        self.plan, self.cost = np.full((cars, n), low), np.zeros(cars)
        self._lengths = np.full(cars, FIRST)
        self._forces = np.full((cars, forces), model.settled_force(low))
        self._inputs = np.zeros((cars, inputs, 3))
        self._filtered = np.zeros((cars, len(model.shape) - 1))
        self._currents = np.full((cars, 2), low)
        self._levels = np.zeros((cars, n + 1))

    def step(self, seen: Signals) -> np.ndarray:
        from quartercar.controllers.laws._horizon_search_kernels import improve_all

        m = self._model
        motion = self._note(seen)
        ahead = seen["road_ahead"]
        known = min(ahead.shape[1], m.samples)
        self._levels[:, 1:known + 1] = ahead[:, :known]
        self._levels[:, known + 1:] = self._levels[:, known:known + 1]
        self.plan[:, :-1] = self.plan[:, 1:]
        improve_all(self.plan, self.cost, self._levels, self._lengths, self._rounds, m.sample_time, m.car, m.table,
                    m.grid, m.sizes, m.lag, m.shape, self._weights, self._ends, self._unknown, m.limits, motion,
                    self._forces, self._inputs, self._filtered, self._currents)
        return self.plan[:, 0].copy()

    def _note(self, seen: Signals) -> np.ndarray:
        """(cars, 4) motion z_s, ż_s, z_us, ż_us on a present elevation of zero; takes the sample into the histories."""
        from quartercar.controllers.laws._horizon_search_kernels import note_all

        m = self._model
        z, v, tyre = seen["suspension_deflection"], seen["suspension_velocity"], seen["tyre_deflection"]
        gap = self._currents[:, 1] - seen["current"]
        self._currents[:, 0] = seen["current"]
        self._currents[:, 1] = seen["current"] + gap * np.where(gap > 0, m.lag[1, 0], m.lag[1, 1])
        note_all(z, v, self._currents[:, 1].copy(), m.car, m.table, m.grid, m.sizes, m.shape, self._forces,
                 self._inputs, self._filtered)
        return np.column_stack([tyre + z, seen["body_velocity"], tyre, seen["wheel_velocity"]])
