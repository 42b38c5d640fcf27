"""DamperStepper: a damper inside a simulation, step by step; `Damper.stepper` gives the one of each model.

A step is tried as often as the car's implicit solution needs, then committed. Nothing looks ahead of the step.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

FINE = 4
"""steps of a compiled damper within one step of the car."""
GAMMA = 1.0 - math.sqrt(0.5)
"""first stage, and diagonal, of the L-stable, stiffly accurate two-stage method of order 2 (Alexander 1977, SIAM J.
Numer. Anal. 14, 1006-1021)"""
RATIO = (1.0 - GAMMA) / GAMMA
"""share of the first stage's move by which the second one starts from it"""


class DamperStepper(ABC):
    """A damper of which one step is tried, and then taken.

    Call `begin` once; then for every step `approach` with the current at its end, `trial` at motions of its end, and
    `commit` at the motion that it has.
    """

    memory: bool = True
    """False for a law without states, which steps of any length may ask."""

    @abstractmethod
    def begin(self, displacement: float, velocity: float, current: float) -> float:
        """Start settled; the force [N].

        Parameters
        ----------
        displacement : float
            From the damper's centre [m].
        velocity : float
            [m/s].
        current : float
            Held so far, in the damper's `current_unit`.

        Returns
        -------
        float
            Force [N].
        """

    @abstractmethod
    def approach(self, current: float) -> None:
        """The current at the end of the coming step.

        Parameters
        ----------
        current : float
            In the damper's `current_unit`.
        """

    @abstractmethod
    def trial(self, displacement: float, velocity: float) -> float:
        """Force at the end of the step, were this the motion there [N].

        Parameters
        ----------
        displacement, velocity : float
            Motion at the end of the step [m], [m/s].

        Returns
        -------
        float
            Force [N]; the state stays as it is.
        """

    @abstractmethod
    def commit(self, displacement: float, velocity: float) -> None:
        """Take the step.

        Parameters
        ----------
        displacement, velocity : float
            Motion at the end of the step [m], [m/s].
        """


class SteppedLaw(ABC):
    """What a simulation asks of a damper without memory to step it."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(P,) its parameters."""

    @abstractmethod
    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        """(n,) force [N].

        Parameters
        ----------
        displacement : (n,) array
            From the damper's centre [m].
        velocity : (n,) array
            [m/s].
        current : (n,) array
            In the damper's `current_unit`.
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        (n,) array
            Force [N].
        """


class SteppedStates(ABC):
    """What a simulation asks of a damper with states to step it."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(P,) its parameters."""

    @abstractmethod
    def rest(self, displacement: float, velocity: float, current: float, force: float | None,
             vector: np.ndarray) -> np.ndarray:
        """(s,) state at the start of a run: one that agrees with the measured `force`, settled where there is none.

        Parameters
        ----------
        displacement, velocity : float
            Motion at the first sample [m], [m/s].
        current : float
            At the first sample, in the damper's `current_unit`.
        force : float or None
            Measured force at the first sample [N].
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        (s,) array
            State, in the order of `states`.
        """

    @abstractmethod
    def rates(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> np.ndarray:
        """(s,) time derivative of the state.

        Parameters
        ----------
        state : (s,) array
            In the order of `states`.
        displacement, velocity : float
            [m], [m/s].
        current : float
            In the damper's `current_unit`.

        Returns
        -------
        (s,) array
            [unit of the state per second].
        """

    @abstractmethod
    def output(self, state: np.ndarray, displacement: float, velocity: float, current: float) -> float:
        """Force at a state [N].

        Parameters
        ----------
        state : (s,) array
            In the order of `states`.
        displacement, velocity : float
            [m], [m/s].
        current : float
            In the damper's `current_unit`.

        Returns
        -------
        float
            Force [N].
        """


class StaticStepper(DamperStepper):
    """A law without memory.

    Parameters
    ----------
    damper : SteppedLaw
        At its own parameters.
    """

    memory = False

    def __init__(self, damper: SteppedLaw) -> None:
        self._damper, self._vector = damper, damper.vector
        self._current = np.zeros(1)

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        self.approach(current)
        return self.trial(displacement, velocity)

    def approach(self, current: float) -> None:
        self._current = np.array([current])

    def trial(self, displacement: float, velocity: float) -> float:
        return float(self._damper.law(np.array([displacement]), np.array([velocity]), self._current, self._vector)[0])

    def commit(self, displacement: float, velocity: float) -> None:
        pass


Move = Callable[[np.ndarray, tuple[float, float, float], tuple[float, float, float]], tuple[np.ndarray, float]]
"""(state, motion and current at the step's start, at its end) -> (state, force) at its end."""


class StateStepper(DamperStepper):
    """A damper with states, advanced by a function from one end of a step to the other.

    Parameters
    ----------
    damper : SteppedStates
        At its own parameters: its `rest` starts the run, its `output` is the force.
    move : callable
        One step: (state, motion and current at its start, the same at its end) -> (state, force [N]) at its end.
    """

    def __init__(self, damper: SteppedStates, move: Move) -> None:
        self._damper, self._move = damper, move
        self._state = np.zeros(0)
        self._now = (0.0, 0.0, 0.0)
        self._ahead = 0.0

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        self._state = np.asarray(self._damper.rest(displacement, velocity, current, None, self._damper.vector), float)
        self._now = (displacement, velocity, current)
        return self._damper.output(self._state, displacement, velocity, current)

    def approach(self, current: float) -> None:
        self._ahead = current

    def trial(self, displacement: float, velocity: float) -> float:
        return self._move(self._state, self._now, (displacement, velocity, self._ahead))[1]

    def commit(self, displacement: float, velocity: float) -> None:
        there = (displacement, velocity, self._ahead)
        self._state = self._move(self._state, self._now, there)[0]
        self._now = there


class RealTimeStepper(DamperStepper):
    """A semi-active damper through its own real-time stepper.

    Parameters
    ----------
    damper : SemiActiveDamper
        A damper with a `real_time` stepper.
    step : float
        Length of a step [s].
    """

    def __init__(self, damper, step: float) -> None:
        self._stepper = damper.real_time(step)
        self._ahead = 0.0

    def begin(self, displacement: float, velocity: float, current: float) -> float:
        self._stepper.reset()
        return float(self._stepper(displacement, velocity, current))

    def approach(self, current: float) -> None:
        self._ahead = current

    def trial(self, displacement: float, velocity: float) -> float:
        return float(self._stepper.peek(displacement, velocity, self._ahead))

    def commit(self, displacement: float, velocity: float) -> None:
        self._stepper(displacement, velocity, self._ahead)


def rates_move(damper: SteppedStates, step: float) -> Move:
    """Steps of any damper with states, from its `rates` alone: two implicit stages, L-stable, order 2.

    Parameters
    ----------
    damper : SteppedStates
        Its `rates` are integrated, with a Jacobian by differences in Newton's method.
    step : float
        Length of a step [s].

    Returns
    -------
    callable
        (state, motion and current at the step's start, the same at its end) -> (state, force [N]) at its end.
    """
    def stage(base: np.ndarray, guess: np.ndarray, motion: tuple[float, float, float]) -> np.ndarray:
        z = guess.copy()
        for _ in range(12):
            gap = z - base - GAMMA * step * damper.rates(z, *motion)
            jacobian = np.eye(z.size)
            for j in range(z.size):
                moved = z.copy()
                moved[j] += 1e-7 * max(abs(z[j]), 1e-6)
                ahead = moved - base - GAMMA * step * damper.rates(moved, *motion)
                jacobian[:, j] = (ahead - gap) / (moved[j] - z[j])
            turn = np.linalg.solve(jacobian, gap)
            z -= turn
            if np.all(np.abs(turn) <= 1e-10 * np.abs(z) + 1e-14):
                break
        return z

    def move(state, here, there):
        middle = tuple(a + GAMMA * (b - a) for a, b in zip(here, there, strict=True))
        first = stage(state, state, middle)  # type: ignore[arg-type]
        z = stage(state + RATIO * (first - state), first, there)
        return z, damper.output(z, *there)

    return move
