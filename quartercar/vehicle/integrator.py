"""Steps of the quarter car: its linear part exactly, the force of the strut by stages that are implicit in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quartercar.dampers.stepper import GAMMA


@dataclass(frozen=True)
class LinearPart:
    """What of the car is linear: masses, springs, dashpots and an inerter of inertance b between the masses.

    Attributes
    ----------
    sprung_mass, unsprung_mass, inertance : float
        m_s, m_us, b [kg].
    stiffness, damping : float
        k [N/m], c [N·s/m] between the masses.
    tyre_stiffness, tyre_damping : float
        k_t [N/m], c_t [N·s/m].
    """

    sprung_mass: float
    unsprung_mass: float
    inertance: float
    stiffness: float
    damping: float
    tyre_stiffness: float
    tyre_damping: float

    @property
    def inverse_mass(self) -> np.ndarray:
        """(2, 2) accelerations by the forces on the sprung and the unsprung mass."""
        b = self.inertance
        return np.linalg.inv(np.array([[self.sprung_mass + b, -b], [-b, self.unsprung_mass + b]]))

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """ẋ = A x + B_r (z_r, ż_r) + B_f (f, g) with x = (z_s, ż_s, z_us, ż_us).

        f pulls the masses together, g presses the unsprung mass down beside the tyre's linear force.

        Returns
        -------
        tuple of three arrays
            A (4, 4), B_r (4, 2) and B_f (4, 2).
        """
        k, c, kt, ct = self.stiffness, self.damping, self.tyre_stiffness, self.tyre_damping
        forces = np.array([[-k, -c, k, c], [k, c, -k - kt, -c - ct]])
        a, road, extra = np.zeros((4, 4)), np.zeros((4, 2)), np.zeros((4, 2))
        a[0, 1] = a[2, 3] = 1.0
        a[1::2] = self.inverse_mass @ forces
        road[1::2] = self.inverse_mass @ np.array([[0.0, 0.0], [kt, ct]])
        extra[1::2] = self.inverse_mass @ np.array([[-1.0, 0.0], [1.0, -1.0]])
        return a, road, extra


@dataclass(frozen=True, eq=False)
class IntegratorStages:
    """One step as stages: x_j = P_j x + R_j (z_r, ż_r) + Σ_i W_ji (f, g)_i, exact for the forces' assumed course.

    Attributes
    ----------
    ends : (S,) array
        Where each stage ends, as a share of the step; the last is 1.
    state : (S, 4, 4) array
        P.
    road : (S, 4, 2) array
        R, for z_r at the step's start and its constant rate.
    force : (S, S + 1, 4, 2) array
        W; i = 0 is the force at the end of the step before.
    """

    ends: np.ndarray
    state: np.ndarray
    road: np.ndarray
    force: np.ndarray

    @classmethod
    def held(cls, part: LinearPart, step: float) -> IntegratorStages:
        """Two stages with a force constant in each, order 2, L-stable: for laws that may be as steep as a sign.

        f_1 acts over (1−γ)h and f_2 over the last γh; f_1 is the law at the end of a trial step γh under f_1.

        Parameters
        ----------
        part : LinearPart
            Masses, springs and linear damping.
        step : float
            h [s].

        Returns
        -------
        IntegratorStages
            Stages that end at γ and 1.
        """
        whole, tail = _exponential(part, (1 - GAMMA) * step), _exponential(part, GAMMA * step)
        early = tail.state @ whole.state
        shift = np.array([[1.0, (1 - GAMMA) * step], [0.0, 1.0]])
        force = np.zeros((2, 3, 4, 2))
        force[0, 1], force[1, 1], force[1, 2] = tail.level, tail.state @ whole.level, tail.level
        return cls(np.array([GAMMA, 1.0]), np.array([tail.state, early]),
                   np.array([tail.road, tail.state @ whole.road + tail.road @ shift]), force)

    @classmethod
    def ramp(cls, part: LinearPart, step: float) -> IntegratorStages:
        """One stage with a force that is linear over the step, order 2: for dampers with a memory or a clock.

        Parameters
        ----------
        part : LinearPart
            Masses, springs and linear damping.
        step : float
            [s].

        Returns
        -------
        IntegratorStages
            One stage, which ends at 1.
        """
        e = _exponential(part, step)
        force = np.array([[e.level - e.slope / step, e.slope / step]])
        return cls(np.ones(1), e.state[None], e.road[None], force)


@dataclass(frozen=True, eq=False)
class _Exponential:
    """Exact response over a time: to the state, to road level and rate, to a level and a slope of the forces."""

    state: np.ndarray
    road: np.ndarray
    level: np.ndarray
    slope: np.ndarray


def _exponential(part: LinearPart, time: float) -> _Exponential:
    from scipy.linalg import expm

    a, road, extra = part.matrices()
    block = np.zeros((10, 10))
    block[:4, :4], block[:4, 4:6], block[:4, 6:8] = a, road, extra
    block[4, 5] = block[6, 8] = block[7, 9] = 1.0
    e = expm(block * time)[:4]
    return _Exponential(e[:, :4].copy(), e[:, 4:6].copy(), e[:, 6:8].copy(), e[:, 8:].copy())
