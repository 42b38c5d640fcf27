"""A car about a nominal damping, its weights and a register of the road ahead: what laws with linear gains share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from quartercar.controllers.contract import Controller, Law, Setting, Signals, Values
from quartercar.controllers.laws.clipped_optimal import STATES
from quartercar.controllers.laws.damping import HIGH, LOW, between
from quartercar.controllers.laws.horizon import comfort_filter
from quartercar.dampers.parameter import Parameter
from quartercar.parameters import CarParameters
from quartercar.vehicle.linear import LinearCar

LAG = Parameter("force_lag", "s", "tau, from the demanded force to the damper's", 0.01, 1e-3, 0.03, log=True)
"""The embedded damper's frozen poles have 3 to 10 ms (`FrozenDamper`)"""


@dataclass(frozen=True, eq=False)
class PreviewModel:
    """x(k+1) = A x(k) + B u(k) + E w(k), weighted outputs C x: the car at the loop's rate, held over a sample.

    ::

        F = c_nom v_d + u_τ,   u_τ(k+1) = u_τ(k) + (1 − e^{−T/τ})(u(k) − u_τ(k))
        x = (z_d, ż_s, z_t, ż_us, u_τ, states of W_k)           w the road's rate over the sample
        C x = (a_w, √ρ_t F_t/m_s, √ρ_z k_s z_d/m_s)

    Attributes
    ----------
    step, control, road : (n, n), (n,), (n,) arrays
        A, B, E.
    shown : (3, n) array
        C: weighted outputs, each [m/s²].
    sample_time : float
        T [s].
    """

    step: np.ndarray
    control: np.ndarray
    road: np.ndarray
    shown: np.ndarray
    sample_time: float

    @classmethod
    def of(cls, parameters: CarParameters, tyre_weight: float, stroke_weight: float, force_lag: float,
           sample_time: float) -> Self:
        """The model of a car.

        Parameters
        ----------
        parameters : CarParameters
            Its damping is c_nom.
        tyre_weight, stroke_weight : float
            ρ_t, ρ_z, dimensionless.
        force_lag : float
            τ [s].
        sample_time : float
            T [s].

        Returns
        -------
        PreviewModel
        """
        from scipy.linalg import expm

        car = LinearCar(parameters).relative()
        block = np.zeros((6, 6))
        block[:4, :4], block[:4, 4:] = car.A, car.B
        held = expm(block * sample_time)[:4]
        shape = comfort_filter(sample_time)
        nf = len(shape) - 1
        n, mass = 5 + nf, parameters.sprung_mass
        a, b, e, c = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros((3, n))
        a[:4, :4], a[:4, 4], e[:4] = held[:, :4], held[:, 5], held[:, 4]
        left = float(np.exp(-sample_time / force_lag))
        a[4, 4], b[4] = left, 1 - left
        body, tyre = (np.append(car.C[row], car.D[row, 1]) for row in
                      (car.outputs.index("body_acceleration"), car.outputs.index("tyre_force")))
        a[5:, 5:], a[5:, :5] = shape[:nf, :nf], np.outer(shape[:nf, nf], body)
        c[0, :5], c[0, 5:] = shape[nf, nf] * body, shape[nf, :nf]
        c[1, :5] = np.sqrt(tyre_weight) / mass * tyre
        c[2, 0] = np.sqrt(stroke_weight) * parameters.spring_stiffness / mass
        return cls(a, b, e, c, sample_time)


@dataclass(frozen=True, eq=False)
class PreviewGains:
    """u = −K x − Σ_j K_j w(k+j) about a nominal damping, for many cars.

    Attributes
    ----------
    gain : (cars, n) array
        K over `PreviewModel`'s x.
    ahead : (cars, P) array
        K_j, j = 0 … P − 1 [N·s/m].
    nominal_damping : (cars,) array
        c_nom [N·s/m].
    """

    gain: np.ndarray
    ahead: np.ndarray
    nominal_damping: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LinearPreview(Controller):
    """A law with linear gains over the car and a register of the road ahead: `LinearPreviewLaw`, and its export.

    Its parameters hold `LAG`, `LOW` and `HIGH`.
    """

    @abstractmethod
    def preview_gains(self, values: Values, setting: Setting) -> PreviewGains:
        """The gains for (cars,) values of every parameter.

        Parameters
        ----------
        values : mapping of (cars,) arrays
            Every parameter by name, SI.
        setting : Setting
            Car, period, and how many samples of the road are known ahead.

        Returns
        -------
        PreviewGains
        """

    def running(self, values: Values, setting: Setting) -> LinearPreviewLaw:
        """The law at rest.

        Parameters
        ----------
        values : mapping of (cars,) arrays
            Every parameter by name, SI.
        setting : Setting

        Returns
        -------
        LinearPreviewLaw
        """
        found = self.preview_gains(values, setting)
        return LinearPreviewLaw(found.gain, found.ahead, values[LAG.name], found.nominal_damping, values[LOW.name],
                                values[HIGH.name], setting)


class LinearPreviewLaw(Law):
    """F = c_nom v_d − K x − Σ_j K_j w(k+j) within c_min and c_max, for many cars; it keeps u_τ and the states of W_k.

    Parameters
    ----------
    gain : (cars, n) array
        K.
    ahead : (cars, P) array
        K_j, j = 0 … P − 1.
    force_lag, nominal_damping, low_damping, high_damping : (cars,) arrays
        τ [s], c_nom, c_min, c_max [N·s/m].
    setting : Setting

    Attributes
    ----------
    base, wanted : (cars,) arrays
        c_nom v_d and u of the last step [N].
    """

    def __init__(self, gain: np.ndarray, ahead: np.ndarray, force_lag: np.ndarray, nominal_damping: np.ndarray,
                 low_damping: np.ndarray, high_damping: np.ndarray, setting: Setting) -> None:
        self._gain, self._ahead, self._nominal = gain, ahead, nominal_damping
        self._low, self._high = low_damping, high_damping
        self._left = np.exp(-setting.sample_time / force_lag)
        self._shape, self._car = comfort_filter(setting.sample_time), setting.parameters
        self._period, cars = setting.sample_time, len(gain)
        self._force, self._filtered = np.zeros(cars), np.zeros((cars, len(self._shape) - 1))
        self.base, self.wanted = np.zeros(cars), np.zeros(cars)

    def step(self, seen: Signals) -> np.ndarray:
        nf, v = len(self._shape) - 1, seen["suspension_velocity"]
        had = seen["attained"] - self.base
        self._force = had + (self._force - had) * self._left
        self.base = self._nominal * v
        x = np.column_stack([*(seen[n] for n in STATES), self._force, self._filtered])
        wanted = -np.einsum("cn,cn->c", self._gain, x)
        ahead = seen["road_ahead"]
        if ahead.shape[1]:
            rates = np.diff(ahead, axis=1, prepend=0.0) / self._period
            wanted = wanted - np.einsum("cp,cp->c", self._ahead, rates)
        self.wanted = wanted
        force = self.base + self._force
        body = -(self._car.spring_stiffness * seen["suspension_deflection"] + force) / self._car.sprung_mass
        self._filtered = (np.einsum("ij,cj->ci", self._shape[:nf, :nf], self._filtered)
                          + body[:, None] * self._shape[:nf, nf])
        return between(self.base + wanted, v, self._low, self._high)
