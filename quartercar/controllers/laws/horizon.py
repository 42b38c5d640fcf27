"""Horizon: a quarter car with its identified damper over the next few samples, and the commands of least cost there.

::

    minimise over lowest ≤ u(0 … N−1) ≤ highest
        Σ_{k=1}^{N} [ a_w(k)² + ρ_t (F_t(k)/m_s)² + ρ_z (k_s z_d(k)/m_s)² + ρ_e (−F v_d)_+ + E(k−1, i(k)) ]
        + e(N)ᵀ P e(N)
    with    coil and damper's lag: i⁺ = u + (i − u) e^{−T/τ}, τ by rising or falling
            damper: F(k) = law(z, v, i) + past forces and inputs, as identified
            car:    exact between samples for a force that is linear there (`IntegratorStages.ramp`), the road known
            a_w:    body acceleration behind W_k without its band limits
            E:      of what is not known of state and road (`quartercar.controllers.laws.horizon_uncertainty`)
    e, P:   what is left after the horizon, the damper then a dashpot: the sum of all later terms

ρ_e charges the energy that an identified model gives where no damper would. Without bump stops and lift-off. The
prediction is that of `adjoint.AdjointCar`, the gradient exact (discrete adjoint).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from lpvid.errors import InputError
from quartercar.controllers.laws.horizon_uncertainty import (
    Uncertainty,
    dashpot,
    deviations,
    expected_cost,
    linearised,
    sum_of_powers,
)
from quartercar.criteria import comfort_transition
from quartercar.criteria.figures import F3
from quartercar.dampers.contract import Damper
from quartercar.parameters import CarParameters
from quartercar.vehicle.adjoint import coefficients_at, has_gradient
from quartercar.vehicle.batch import lag_coil
from quartercar.vehicle.filter_bank import filter_of
from quartercar.vehicle.integrator import IntegratorStages, LinearPart
from quartercar.vehicle.nonlinear import Coil
from quartercar.vehicle.tanh_coefficients import tanh_form

CURRENTS = 65
"""at which coefficients are tabulated, linear in between: exact for coefficients affine in the current; those of the
Guo law (tanh of a polynomial) are within 1e-3 of their range"""
SPEED = 0.3
"""of the damper's slope at the lowest current that stands for it after the horizon [m/s], the scale of v_d on ISO C"""


@dataclass(frozen=True, eq=False)
class CostWeights:
    """Of a cost, one entry per car: ρ_t, ρ_z, ρ_e [(m/s²)²/W] of the module.

    Attributes
    ----------
    tyre, stroke : (cars,) arrays
        ρ_t, ρ_z, dimensionless.
    given : (cars,) array
        ρ_e [(m/s²)²/W].
    """

    tyre: np.ndarray
    stroke: np.ndarray
    given: np.ndarray


@dataclass(frozen=True, eq=False)
class Horizon:
    """The model of one car and damper over N samples; arrays as `_horizon_kernels.predict` reads them.

    Attributes
    ----------
    sample_time : float
        [s].
    samples : int
        N.
    car, table, grid, sizes, lag, shape : arrays
    limits : (2,) array
        Of the command.
    rest : float
        Damper's force at rest [N].
    parameters : CarParameters
    damping : float
        Of the dashpot after the horizon [N·s/m].
    dampings : (S, G) array
        By `horizon_uncertainty.DEVIATIONS` of the deflection's velocity and the current of the table [N·s/m].
    """

    sample_time: float
    samples: int
    car: np.ndarray
    table: np.ndarray
    grid: np.ndarray
    sizes: np.ndarray
    lag: np.ndarray
    shape: np.ndarray
    limits: np.ndarray
    rest: float
    parameters: CarParameters
    damping: float
    dampings: np.ndarray

    @classmethod
    def of(cls, parameters: CarParameters, damper: Damper | None, coil: Coil, sample_time: float,
           samples: int) -> Horizon:
        """The predictive model of a car.

        Parameters
        ----------
        parameters : CarParameters
            Its damping is left out.
        damper : Damper or None
            None is refused.
        coil : Coil
            Its limits are those of the commands; both are finite.
        sample_time : float
            [s].
        samples : int
            N.

        Returns
        -------
        Horizon
            Coefficients tabulated at `CURRENTS` currents between the coil's limits.

        Raises
        ------
        InputError
            A damper that is neither a law of one tanh nor an identified transfer function; a coil without limits.
        """
        if damper is None or not has_gradient(damper):
            raise InputError("this damper cannot be predicted over a horizon",
                             got="no damper model" if damper is None else f"'{damper.name}'",
                             why="its gradient by the current is not built", mend="preview-lqr, which takes any "
                             "damper; or an identified transfer function (lpv-arx), or a law of one tanh (guo, kwok)")
        if not np.isfinite(coil.highest) or coil.highest <= coil.lowest:
            raise InputError("a horizon needs limits of the current", got=f"{coil.lowest:g} to {coil.highest:g}",
                             mend="a coil with a highest current")
        part = LinearPart(parameters.sprung_mass, parameters.unsprung_mass, 0.0, parameters.spring_stiffness, 0.0,
                          parameters.tyre_stiffness, parameters.tyre_damping)
        stages = IntegratorStages.ramp(part, sample_time)
        car = np.zeros((4, 10))
        car[:, :4], car[:, 4:6] = stages.state[0], stages.road[0]
        car[:, 6], car[:, 7] = stages.force[0, 0, :, 0], stages.force[0, 1, :, 0]
        car[:3, 8] = part.stiffness, part.damping, part.sprung_mass
        car[:2, 9] = part.tyre_stiffness, part.tyre_damping
        currents = np.linspace(coil.lowest, coil.highest, CURRENTS)
        rest = float(np.atleast_1d(damper.conservative_force(np.zeros(1)))[0])
        table, sizes, own = _coefficient_table(damper, currents, rest)
        lag = np.array([[_left(sample_time, c.fall_time), _left(sample_time, c.rise_time)] for c in (coil, own)])
        low = damper.static_force(np.array([-SPEED, SPEED]), coil.lowest)
        dampings = np.column_stack([linearised(partial(damper.static_force, current=i)) for i in currents.tolist()])
        return cls(sample_time, samples, car, table, np.array([currents[0], currents[1] - currents[0]]), sizes, lag,
                   comfort_filter(sample_time), np.array([coil.lowest, coil.highest]), rest, parameters,
                   float(low[1] - low[0]) / (2 * SPEED), dampings)

    def weights(self, given: CostWeights) -> tuple[np.ndarray, np.ndarray]:
        """(cars, 4) weights of `_horizon_kernels.predict`, (cars, 4 + nf, 4 + nf) cost of what the horizon leaves.

        Parameters
        ----------
        given : CostWeights
            ρ_t, ρ_z, ρ_e of every car.

        Returns
        -------
        weights : (cars, 4) array
            Of a_w², of the tyre force squared, of the deflection squared and of the power given: 1, ρ_t/m_s², ρ_z
            (k_s/m_s)², ρ_e.
        left : (cars, 4 + nf, 4 + nf) array
            P of the module, over (z_d, ż_s, z_t, ż_us) and the states of the comfort filter.
        """
        p = self.parameters
        rows = np.column_stack([np.ones(given.tyre.size), given.tyre / p.sprung_mass**2,
                                given.stroke * (p.spring_stiffness / p.sprung_mass) ** 2, given.given])
        return rows, np.array([self._left_over(row[:3]) for row in rows])

    def _left_over(self, weights: np.ndarray) -> np.ndarray:
        """P = Σ over all later samples of the cost of the car with the dashpot on a road that stays level."""
        step, out = self._dashpot(self.damping)
        return sum_of_powers(step, out.T @ (weights[:, None] * out))

    def uncertain(self, weights: tuple[np.ndarray, np.ndarray], unknown: Uncertainty) -> np.ndarray:
        """(cars, N, G) what is expected beside the cost of the expected motion, by sample and current of the table.

        Parameters
        ----------
        weights : ((cars, 4), (cars, n, n) arrays)
            As `weights` gives them.
        unknown : Uncertainty
            N samples of road.

        Returns
        -------
        (cars, N, G) array
            In the unit of the cost.
        """
        spread, damping = deviations(unknown, self.dampings, self._dashpot, self.sample_time)
        return np.array([expected_cost(self._dashpot, damping, row[:3], end, spread)
                         for row, end in zip(*weights, strict=True)])

    def _dashpot(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        return dashpot(self.parameters, damping, self.sample_time, self.shape)

    @property
    def history(self) -> tuple[int, int]:
        """Forces and inputs, the present ones included, that a prediction starts from."""
        return max(int(self.sizes[0]), 1), max(int(self.sizes[1]), 1)


    def settled_force(self, current: float) -> float:
        """At rest under a current that is held, about the static equilibrium [N].

        Parameters
        ----------
        current : float
            In the damper's unit of current; beyond the limits the force is that at the limit.

        Returns
        -------
        float
            [N].
        """
        c = np.array([np.interp(current, self.grid[0] + self.grid[1] * np.arange(len(self.table)), column)
                      for column in self.table.T])
        return float(c[0] / (1 + c[8:8 + self.sizes[0]].sum()))


def _coefficient_table(damper: Damper, currents: np.ndarray, rest: float) -> tuple[np.ndarray, np.ndarray, Coil]:
    """(G, 8 + na + 3 nb) coefficients, (na, nb), and the lag that the damper's model puts on its current."""
    found = coefficients_at(damper, currents, rest)
    law = found.law[:, 0].copy()
    law[:, 0] -= rest * found.a.sum(axis=1)
    table = np.concatenate([law, found.a, found.b.reshape(currents.size, -1)], axis=1)
    own = Coil() if tanh_form(damper) is not None else lag_coil(filter_of(damper))
    return table, np.array([found.a.shape[1], found.b.shape[1]]), own


@lru_cache(maxsize=16)
def comfort_filter(sample_time: float) -> np.ndarray:
    """(5, 5) of (A, B; C, D): W_k without its band limits, sampled by the trapezoidal rule.

    The limits at 0.4 and 100 Hz take 4 of 8 states and move |W_k| by less than 0.01 between 0.9 and 40 Hz.

    Parameters
    ----------
    sample_time : float
        [s].

    Returns
    -------
    (5, 5) array
        Four states, one input and one output, both accelerations [m/s²].

    Examples
    --------
    >>> m = comfort_filter(1 / 512)
    >>> z = np.exp(2j * np.pi * 5.0 / 512)
    >>> round(float(abs(m[4, :4] @ np.linalg.solve(z * np.eye(4) - m[:4, :4], m[:4, 4]) + m[4, 4])), 3)
    1.039
    """
    from scipy.signal import bilinear, tf2ss

    top, bottom = comfort_transition()
    unit = 2 * np.pi * F3  # time in units of 1/ω_3, in which the coefficients are of order one
    scaled = [p * unit ** np.arange(p.size - 1, -1, -1) for p in (top, bottom)]
    a, b, c, d = tf2ss(*bilinear(*scaled, fs=1 / (sample_time * unit)))
    return np.block([[a, b], [c, d]])


def _left(time: float, tau: float) -> float:
    return float(np.exp(-time / tau)) if tau > 0 else 0.0
