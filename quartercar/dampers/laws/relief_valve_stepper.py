"""Steps of the relief-valve damper inside a simulation."""

from __future__ import annotations

import numpy as np

from quartercar.dampers.laws._relief_valve_run import sample
from quartercar.dampers.stepper import DamperStepper


class ReliefValveStepper(DamperStepper):
    """The relief-valve damper, whose integration carries its poppets' modes and its step size beside the states."""

    def __init__(self, damper, step: float) -> None:
        from quartercar.dampers.laws.relief_valve import TOLERANCE

        self._sample, self._tolerance, self._damper, self._step = sample, TOLERANCE, damper, step
        self._law = tuple(float(p) for p in np.real(damper.law(damper.vector)))
        self._shape = damper.shape
        self._work = np.zeros((5, 5)), np.zeros((2, 2, 6))

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        rest = np.real(self._damper.rest(displacement, velocity, current, None, self._damper.vector))
        top = self._damper.precompression
        area = self._damper.piston_area
        self._state = np.array([rest[0] / top, 0.0, rest[2] / top, 0.0, rest[4] * area])
        lifts = self._state[[0, 2]]
        self._mode = np.where(lifts > 0, np.where(lifts >= self._shape[2], 2, 1), 0).astype(np.int64)
        self._level, self._now = 0, (displacement, velocity)
        return float(self._state[4]) + self._outside(velocity)

    def _outside(self, velocity: float) -> float:
        return float(np.real(self._damper._outside(np.array([velocity]), self._damper.vector)[0]))

    def approach(self, current: float) -> None:
        pass

    def _moved(self, displacement: float, velocity: float) -> tuple[np.ndarray, np.ndarray, int]:
        z, mode, h = self._state.copy(), self._mode.copy(), self._step
        x0, v0 = self._now
        motion = (v0, (velocity - v0) / h, x0, (displacement - x0) / h)
        typical = min(self._law[2], self._law[1] * max(v0 * v0, velocity * velocity, 1e-4))
        level = self._sample(z, mode, motion, h, self._level, self._law, self._shape, self._tolerance, typical,
                             *self._work)
        return z, mode, level

    def trial(self, displacement: float, velocity: float) -> float:
        return float(self._moved(displacement, velocity)[0][4]) + self._outside(velocity)

    def commit(self, displacement: float, velocity: float) -> None:
        self._state, self._mode, self._level = self._moved(displacement, velocity)
        self._now = (displacement, velocity)
