"""Couplings: how each family of damper models is carried along inside a car, step by step.

A step is tried as often as the car's implicit solution asks, then committed. Nothing looks ahead of the step.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from lpvid.errors import InputError
from quartercar.dampers.contract import Damper
from quartercar.dampers.families import DynamicDamper, StaticDamper

FINE = 4
"""steps of a compiled damper within one step of the car."""


class Coupling(ABC):
    """A damper of which one step is tried, and then taken.

    Call `begin` once; then for every step `approach` with the current at its end, `trial` at motions of its end, and
    `commit` at the motion that it has.
    """

    memory: bool = True
    """False for a law without states, which steps of any length may ask."""

    @abstractmethod
    def begin(self, displacement: float, velocity: float, current: float) -> float:
        """Start settled; the force [N]."""

    @abstractmethod
    def approach(self, current: float) -> None:
        """The current at the end of the coming step."""

    @abstractmethod
    def trial(self, displacement: float, velocity: float) -> float:
        """Force at the end of the step, were this the motion there [N]."""

    @abstractmethod
    def commit(self, displacement: float, velocity: float) -> None:
        """Take the step."""


class StaticCoupling(Coupling):
    """A law without memory."""

    memory = False

    def __init__(self, damper: StaticDamper) -> None:
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


class StateCoupling(Coupling):
    """A damper with states, advanced by a function from one end of a step to the other."""

    def __init__(self, damper: DynamicDamper, move: Move) -> None:
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


class SteppedCoupling(Coupling):
    """A semi-active damper through its own real-time stepper."""

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


def couple(damper: Damper, step: float) -> Coupling:
    """The coupling of a damper at a fixed step.

    Parameters
    ----------
    damper : Damper
    step : float
        Of the car [s]; a model with a clock of its own wants that.

    Raises
    ------
    InputError
        A kind of damper that no coupling knows, or a clock that is not the step.
    """
    from quartercar.dampers.blackbox.sampled import SampledDamper
    from quartercar.dampers.laws.bouc_wen import BoucWen
    from quartercar.dampers.laws.relief_valve import LagDamper
    from quartercar.dampers.laws.semi_active import SemiActiveDamper
    from quartercar.dampers.laws.wang_kamath import WangKamath

    if isinstance(damper, StaticDamper):
        return StaticCoupling(damper)
    if isinstance(damper, SampledDamper):
        from quartercar.vehicle.sampled_coupling import sampled_coupling

        return sampled_coupling(damper, step)
    if isinstance(damper, SemiActiveDamper):
        return SteppedCoupling(damper, step)
    if isinstance(damper, BoucWen):
        return StateCoupling(damper, bouc_wen_move(damper, step))
    if isinstance(damper, WangKamath):
        return StateCoupling(damper, wang_kamath_move(damper, step))
    if isinstance(damper, LagDamper):
        return ReliefCoupling(damper, step)
    if isinstance(damper, DynamicDamper):
        return StateCoupling(damper, rates_move(damper, step))
    raise InputError(f"a car does not know how to carry a '{damper.name}' damper along", got=type(damper).__name__,
                     mend="a static, dynamic, semi-active or sampled damper of quartercar.dampers")


def bouc_wen_move(damper, step: float) -> Move:
    """Steps of the modified Bouc-Wen model by its own compiled integration."""
    from quartercar.dampers.laws._bouc_wen_kernels import advance, node_rate

    theta, (stiffness, gas) = damper.coefficients(damper.vector)
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = map(float, theta)
    h = step / FINE

    def move(state, here, there):
        y, z = float(state[0]), float(state[1])
        w = float(state[2]) if damper.scheduled else 0.0
        dx, dv = (there[0] - here[0]) / FINE, (there[1] - here[1]) / FINE
        i0, i1 = max(here[2], 0.0), max(there[2], 0.0)
        for j in range(FINE):
            old, w = w, lagged(w, i0 + (i1 - i0) * j / FINE, i0 + (i1 - i0) * (j + 1) / FINE, h, eta)
            mid = 0.5 * (old + w)
            y, z = advance(y, z, here[0] + j * dx, here[0] + (j + 1) * dx, here[1] + j * dv, here[1] + (j + 1) * dv, h,
                           c0a + c0b * mid, k0, c1a + c1b * mid, aa + ab * mid, beta, gamma, delta, n)
        c1 = c1a + c1b * w
        rate = node_rate(y, z, there[0], there[1], c0a + c0b * w, k0, c1, aa + ab * w)
        return np.array([y, z, w][: len(state)]), c1 * rate + stiffness * there[0] + gas

    return move


def lagged(w: float, u0: float, u1: float, h: float, rate: float) -> float:
    """ẇ = −η(w − u) over h, exact for a linear u; at once where η is 0."""
    if rate <= 0.0:
        return u1
    behind = (u1 - u0) / (h * rate)
    return u1 - behind + (w - u0 + behind) * math.exp(-h * rate)


def wang_kamath_move(damper, step: float) -> Move:
    """Steps of the phase transition model by its own compiled integration."""
    from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_step

    vector = damper.vector

    def move(state, here, there):
        theta = np.ascontiguousarray(damper.coefficients(np.array([here[2], there[2]]), vector))
        f, g = wang_kamath_step(float(state[0]), float(state[1]), here[1], there[1], step, FINE, theta)
        return np.array([f, g]), float(damper.scale(np.array([there[2]]), vector)[0]) * f

    return move


def rates_move(damper: DynamicDamper, step: float) -> Move:
    """Steps of any damper with states, from its `rates` alone: two implicit stages, L-stable, order 2."""
    from quartercar.vehicle.integrator import GAMMA

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
        z = stage(state + (1 - GAMMA) / GAMMA * (first - state), first, there)
        return z, damper.output(z, *there)

    return move


class ReliefCoupling(Coupling):
    """The relief-valve damper, whose integration carries its poppets' modes and its step size beside the states."""

    def __init__(self, damper, step: float) -> None:
        from quartercar.dampers.laws._relief_valve_run import sample
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
