"""E8, the sign of the damper force in the car's equations, and LPV plants made of the car and a row for that force."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.region import Region
from quartercar.parameters import CarParameters
from quartercar.vehicle.linear import OUTPUTS, RELATIVE, LinearCar, StateSpace

STATES = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity")
"""x = (z_d, ż_s, z_t, ż_us) of the car in every embedding."""
SPEED = np.array([0.0, 1.0, 0.0, -1.0])
"""v_d = SPEED @ x."""
PROBE = 0.3
"""speed at which the sense of a damper's force is evaluated [m/s]."""

Row = tuple[np.ndarray, np.ndarray]
"""Force over (states, inputs beside the road)."""


def bare_car(parameters: CarParameters) -> StateSpace:
    """The car without its passive damper: ẋ = A_0 x + B_w ż_r + B_F F, B_F = (0, −1/m_s, 0, 1/m_us)ᵀ.

    E8 of the equation sheet 4.3: a damper force that is positive in extension pulls the sprung mass down and the
    unsprung mass up.

    Parameters
    ----------
    parameters : CarParameters
        Its damping is left out, that of the tyre is kept.

    Returns
    -------
    StateSpace
        States as `STATES`; inputs are the road's velocity [m/s] and the damper force [N].

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> (bare_car(MEGANE).B[:, 1] * MEGANE.sprung_mass).round(2).tolist()
    [0.0, -1.0, 0.0, 8.4]
    """
    return LinearCar(parameters.replace(damping=0.0)).relative()


def with_force(parameters: CarParameters, rows: Mapping[str, Row], region: Region, inputs: tuple[Signal, ...],
               units: tuple[str, ...] = ()) -> LPVStateSpace:
    """The car with F = (f_0 + Σ p_j f_j) x + (g_0 + Σ p_j g_j) u between its masses.

    Parameters
    ----------
    parameters : CarParameters
    rows : mapping of str to ((4,), (n_u,)) arrays
        f and g; the key ``""`` holds f_0 and g_0, the others are scheduling variables of `region`.
    region : Region
    inputs : tuple of Signal
        u; the road's velocity comes before them.
    units : tuple of str
        Of the scheduling variables.

    Returns
    -------
    LPVStateSpace
        Continuous; outputs as `quartercar.vehicle.linear.RELATIVE`, then ``damper_force``.
    """
    force = np.zeros((1 + len(region.names), 5 + len(inputs)))
    for row, name in zip(force, ("", *region.names), strict=True):
        if name in rows:
            row[:4], row[5:] = rows[name]
    return car_plant(bare_car(parameters), force, np.zeros((len(force), 0, force.shape[1])), region, inputs, units)


def car_plant(car: StateSpace, force: np.ndarray, inner: np.ndarray, region: Region, inputs: tuple[Signal, ...],
              units: tuple[str, ...] = (), sample_time: float | None = None) -> LPVStateSpace:
    """The car with F = f(p)·(x, d, ż_r, u) between its masses, and states d beside it that move by g(p)·(x, d, ż_r, u).

    Parameters
    ----------
    car : StateSpace
        As `bare_car` gives it, continuous or sampled.
    force : (1 + n_p, 4 + n_d + 1 + n_u) array
        f: f_0, then one row for each scheduling variable.
    inner : (1 + n_p, n_d, 4 + n_d + 1 + n_u) array
        g likewise.
    region : Region
    inputs : tuple of Signal
        u; the road's velocity comes before them.
    units : tuple of str
        Of the scheduling variables.
    sample_time : float or None
        [s]; None for a continuous car.

    Returns
    -------
    LPVStateSpace
        Outputs as `quartercar.vehicle.linear.RELATIVE`, then ``damper_force``.
    """
    terms, width = force.shape
    split, names = 4 + inner.shape[1], region.names
    flow, out = np.zeros((terms, split, width)), np.zeros((terms, 8, width))
    flow[0, :4, :4], flow[0, :4, split] = car.A, car.B[:, 0]
    flow[:, :4] += car.B[:, 1][None, :, None] * force[:, None]
    flow[:, 4:] = inner
    out[0, :7, :4], out[0, :7, split] = car.C, car.D[:, 0]
    out[:, :7] += car.D[:, 1][None, :, None] * force[:, None]
    out[:, 7] = force
    return LPVStateSpace(flow[:, :, :split], flow[:, :, split:], out[:, :, :split], out[:, :, split:],
                         Polynomial(names, 1 if names else 0), sample_time, region.scheduling(units),
                         inputs=(Signal("road_velocity", "m/s"), *inputs),
                         outputs=(*(Signal(n, OUTPUTS[n]) for n in RELATIVE), Signal("damper_force", "N")))


def passive_sense(damper: Damper) -> Damper:
    """The damper, if its force acts against the motion.

    Parameters
    ----------
    damper : Damper
        Its force is evaluated at the middle of its usual currents.

    Returns
    -------
    Damper
        `damper` itself.

    Raises
    ------
    InputError
        A model of reversed polarity: one whose records gave mean F·v < 0, or whose force at ±0.3 m/s gives energy.
    """
    if damper.polarity < 0:
        raise InputError(f"the '{damper.name}' model was identified from a force of reversed sign",
                         got="mean of force times velocity below zero",
                         why="a plant made of it as measured would be driven by its damper",
                         mend="turn the channel (--flip force) and fit again")
    low, high = damper.usual_currents or (0.0, 0.0)
    rebound, compression = (float(damper.static_force(np.array([v]), 0.5 * (low + high))[0]) for v in (PROBE, -PROBE))
    if rebound <= compression:
        raise InputError(f"the force of the '{damper.name}' model points along the motion",
                         got=f"{rebound:.4g} N in extension and {compression:.4g} N in compression at {PROBE} m/s",
                         why="a damper pulls in extension and pushes in compression",
                         mend="turn the force or the velocity of its records (--flip) and fit again")
    return damper
