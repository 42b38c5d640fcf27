"""Clipped optimal control."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from quartercar.controllers.contract import Controller, Law, Memoryless, Setting, Signals, Values
from quartercar.controllers.laws.damping import HIGH, LOW, between
from quartercar.dampers.parameter import Parameter
from quartercar.parameters import CarParameters
from quartercar.vehicle.linear import LinearCar

STATES = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity")
"""in the order of the equation sheet, 4.1"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ClippedOptimal(Controller):
    """F = −K x of the best active car, within what dampings from c_min to c_max can do.

    K minimises E[z̈_s² + q_t (k_t z_t)² + q_d (k_s z_d)² + r F²]/m_s² for a white road velocity, x as `STATES`. The
    masses and springs are the designer's, the damper none: all of its force is the control.
    """

    name: ClassVar[str] = "clipped-optimal"
    title: ClassVar[str] = "Clipped optimal"
    source: ClassVar[str] = "Karnopp 1983; Butsuen 1989; equation sheet 4.8"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        LOW, HIGH, Parameter("tyre_weight", "", "q_t, of the tyre's force", 0.1, 1e-3, 10.0, log=True),
        Parameter("stroke_weight", "", "q_d, of the spring's force", 0.05, 1e-3, 10.0, log=True))
    reads: ClassVar[tuple[str, ...]] = (*STATES, "suspension_velocity")
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        pairs = zip(values["tyre_weight"].tolist(), values["stroke_weight"].tolist(), strict=True)
        gain = np.array([optimal_gain(setting.parameters, *pair) for pair in pairs]).T
        low, high = values["low_damping"], values["high_damping"]

        def force(s: Signals) -> np.ndarray:
            wanted = -sum(k * s[name] for k, name in zip(gain, STATES, strict=True))
            return between(np.asarray(wanted), s["suspension_velocity"], low, high)

        return Memoryless(force)


@lru_cache(maxsize=4096)
def optimal_gain(parameters: CarParameters, tyre_weight: float, stroke_weight: float) -> tuple[float, ...]:
    """K of F = −K x, in the order of `STATES` [N/m, N·s/m, N/m, N·s/m].

    Parameters
    ----------
    parameters : CarParameters
        Masses and springs of the design model; its dampings are left out.
    tyre_weight, stroke_weight : float
        q_t, q_d of `ClippedOptimal`, dimensionless.

    Returns
    -------
    tuple of four floats
        K.

    Raises
    ------
    InputError
        Masses and springs for which there is no optimum.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> k = optimal_gain(MEGANE, 0.1, 0.05)
    >>> k[1] < 0 < k[3]  # the force pulls the body back while it rises, and the wheel while it falls
    True
    """
    from scipy.linalg import LinAlgError, solve_continuous_are

    system = LinearCar(parameters.replace(damping=0.0, tyre_damping=0.0)).relative()
    a, b = system.A, system.B[:, 1:]
    rows, direct = system.C, system.D[:, 1:]
    scale = np.array([1.0, parameters.spring_stiffness / parameters.sprung_mass * np.sqrt(stroke_weight), 0.0,
                      np.sqrt(tyre_weight) / parameters.sprung_mass])
    z, d = scale[:, None] * rows[:4], scale[:, None] * direct[:4]
    control = 1e-6 / parameters.sprung_mass**2
    try:
        p = solve_continuous_are(a, b, z.T @ z, d.T @ d + control, s=z.T @ d)
    except (LinAlgError, ValueError) as error:
        raise InputError("there is no optimal force for this car and these weights",
                         got=f"tyre_weight {tyre_weight:g}, stroke_weight {stroke_weight:g}", why=str(error)) from None
    return tuple(np.linalg.solve(d.T @ d + control, b.T @ p + d.T @ z)[0].tolist())
