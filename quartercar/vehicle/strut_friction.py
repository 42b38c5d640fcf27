"""A quarter car as a simulation: linear but for the friction of its strut, along measured road and actuator force."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.baselines.signals import Signals
from quartercar.parameters import CarParameters
from quartercar.vehicle.linear import LinearCar

SMOOTH = 1e-3
"""speed over which the friction of the strut is smoothed [m/s]"""
SUBSTEPS = 4
"""steps within a sample while there is friction"""
OUTPUTS = ("sprung", "unsprung")
"""Motions that can be compared."""


@dataclass(frozen=True)
class CarCore:
    """A linear quarter car with friction in the strut, as a simulation of one of its motions (equation sheet 4.1).

    ::

        m_s z̈_s   = −k_s (z_s − z_us) − c (ż_s − ż_us) − F_f + F
        m_us z̈_us =  k_s (z_s − z_us) + c (ż_s − ż_us) + F_f − F − k_t (z_us − z_r) − c_t (ż_us − ż_r)
        F_f = F_c tanh((ż_s − ż_us)/ε), ε = 1 mm/s

    It starts at rest from the measured positions of both masses; road and force are linear between samples.

    Attributes
    ----------
    car : CarParameters
    friction : float
        F_c [N].
    output : {"sprung", "unsprung"}
    """

    car: CarParameters
    friction: float = 0.0
    output: str = "sprung"

    def changed(self, friction: float = 0.0, **changes: float) -> CarCore:
        """The same with friction added, and some parameters replaced.

        Parameters
        ----------
        friction : float
            Added to F_c [N].
        **changes : float
            Fields of `CarParameters` by name, SI.

        Returns
        -------
        CarCore
            With the same output.
        """
        return replace(self, car=self.car.replace(**changes), friction=self.friction + friction)

    def states(self, s: Signals) -> np.ndarray:
        """(n, 4) z_s, ż_s, z_us, ż_us along signals.

        Parameters
        ----------
        s : Signals
            `road` [m], the measured positions of both masses [m], and `actuator` [N] where there is one.

        Returns
        -------
        (n, 4) array
            [m, m/s, m, m/s].
        """
        from quartercar.vehicle import _strut_friction_kernels as kernels

        force = s["actuator"] if s.has("actuator") else np.zeros(s.n_samples)
        inputs = np.column_stack([s["road"], force])
        parts = SUBSTEPS if self.friction > 0 else 1
        start = {m: s.output[0] if m == self.output else s[m][0] for m in OUTPUTS}
        first = np.array([start["sprung"], 0.0, start["unsprung"], 0.0])
        out = np.empty((s.n_samples, 4))
        step = discretised(self.car, s.sample_time / parts)
        kernels.run_with_friction(*step, np.array([0.0, 1.0, 0.0, -1.0]), inputs, parts, float(self.friction), SMOOTH,
                                  first, out)
        return out

    def __call__(self, s: Signals) -> np.ndarray:
        return np.ascontiguousarray(self.states(s)[:, 2 * OUTPUTS.index(self.output)])


def discretised(car: CarParameters, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Exact step of the linear car for road and actuator force that are linear between samples.

    Parameters
    ----------
    car : CarParameters
        Masses, springs and dampings.
    step : float
        [s].

    Returns
    -------
    ad : (4, 4) array
        States z_s, ż_s, z_us, ż_us.
    b0, b1 : (4, 2) arrays
        Weights of road and actuator force at the step's start and end.
    bf : (4,) array
        Weight of a friction force that opposes extension, held over the step.
    """
    from scipy.linalg import expm

    linear = LinearCar(car).absolute()  # inputs: road, its rate, force of a damper, against that of the actuator
    block = np.zeros((8, 8))
    block[:4, :4] = linear.A
    block[:4, 4], block[:4, 5], block[:4, 6] = linear.B[:, 0], -linear.B[:, 2], linear.B[:, 1]
    block[4:6, 6:] = np.eye(2)
    e = expm(block * step)
    ramp = e[:4, 6:] / step
    held = np.zeros((5, 5))
    held[:4, :4], held[:4, 4] = linear.A, linear.B[:, 2]
    return (np.ascontiguousarray(e[:4, :4]), e[:4, 4:6] - ramp, ramp,
            np.ascontiguousarray(expm(held * step)[:4, 4]))
