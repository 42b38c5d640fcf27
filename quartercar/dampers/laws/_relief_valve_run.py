"""The stiff free run of the relief-valve damper: linearly implicit steps that end where a poppet meets a stop.

The grid is dyadic: steps of T_s/2^m, m by error control. Between two changes of m the result is smooth in the
parameters, and the events are solved for in complex arithmetic where the parameters are complex: the complex
step differentiates through them.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import copy_values, njit
from quartercar.dampers.laws._relief_valve_kernels import inverse, passage, root_of, settled_lift, square_root
from quartercar.dampers.stepper import DamperStepper

HELD, FREE, STOPPED = 0, 1, 2
"""a poppet on its seat, between its stops, at its lift stop"""
FINEST = 20
"""most halvings of a sample"""
EVENTS = 16
"""most events within one step"""
STANDING = 0.05
"""force to which an error of a standing damper is relative, as a share of the opening force"""
SEARCH = 30
"""most trial steps towards one event"""


def workspace(dtype: np.dtype) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """State, modes of the poppets, stages of a step with the state kept, slopes: zeros.

    Made here, as numba compiles what makes an array into the kernel for every type and number of dimensions.
    """
    return np.zeros(5, dtype), np.zeros(2, dtype=np.int64), np.zeros((6, 5), dtype), np.zeros((2, 2, 6), dtype)


@njit(error_model="numpy")
def run(velocity, displacement, period, law, shape, tolerance, z, mode, stages, slopes, out):
    """Hydraulic force [N] at every sample into `out`, of the type of `law`; NaN from where it diverges.

    Rodas3 (Sandu et al. 1997, Atmos. Environ. 31, 3459-3472): linearly implicit, third order, L-stable and stiffly
    accurate. A poppet leaves its seat where F = F_c and lands on it, or on its lift stop, without rebound.

    Parameters
    ----------
    velocity, displacement : (n,) float array
        Linear between samples [m/s], [m].
    period : float
        [s].
    law, shape : tuple
        Floats; the law's may be complex.
    tolerance : float
        Relative error of a step.
    z, mode, stages, slopes : array
        As `workspace` makes them. z[4] is the hydraulic force at the first sample [N]; the poppets start at rest where
        it holds them.
    out : (n,) array
    """
    z[0], z[2] = settled_lift(z[4], law, shape), settled_lift(-z[4], law, shape)
    for j in range(2):
        if z[2 * j].real > 0.0:
            mode[j] = STOPPED if z[2 * j].real >= shape[2] else FREE
    fastest = 0.0
    for k in range(velocity.size):
        fastest = max(fastest, abs(velocity[k]))
    typical = min(law[2].real, law[1].real * fastest * fastest)
    out[0] = z[4]
    level = np.int64(0)  # of its final type at once: a literal would have `sample` compiled for itself too
    for k in range(velocity.size - 1):
        motion = (velocity[k], (velocity[k + 1] - velocity[k]) / period,
                  displacement[k], (displacement[k + 1] - displacement[k]) / period)
        level = sample(z, mode, motion, period, level, law, shape, tolerance, typical, stages, slopes)
        out[k + 1] = z[4]
        if not math.isfinite(z[4].real):
            for j in range(k + 1, out.size):
                out[j] = math.nan
            return


@njit(error_model="numpy")
def sample(z, mode, motion, period, level, law, shape, tolerance, typical, stages, slopes):
    """Advance through one sample on the dyadic grid; the level that the next sample starts with."""
    whole = 1 << FINEST
    place = 0
    kept = stages[5]
    copy_values(z, kept)
    one, two = mode[0], mode[1]
    while place < whole:
        stride = 1 << (FINEST - level)
        error = _stretch(z, mode, motion, period * (place / whole), period * (stride / whole), law, shape, tolerance,
                         typical, stages, slopes)
        if not error <= 1.0 and level < FINEST:
            copy_values(kept, z)
            mode[0], mode[1] = one, two
            level = min(level + (1 if error < 16.0 else 2), FINEST)
            continue
        if not math.isfinite(z[4].real):
            return level
        copy_values(z, kept)
        one, two = mode[0], mode[1]
        place += stride
        if error < 0.04 and level > 0 and place % (2 * stride) == 0:
            level -= 1
    return level


@njit(error_model="numpy")
def _stretch(z, mode, motion, begin, length, law, shape, tolerance, typical, stages, slopes):
    """Advance the state by one stride of the grid, through the events in it; the largest error, 1 being allowed."""
    now, left = begin + 0.0 * z[4], length + 0.0 * z[4]
    new = stages[4]
    worst = 0.0
    for _ in range(EVENTS):
        _release(z, mode, law, shape)
        _step(z, mode, motion, now, left, law, shape, stages, slopes)
        valve = _first_event(z, new, mode, law, shape)
        h = left
        if valve >= 0:
            h = _locate(z, mode, motion, now, left, valve, law, shape, stages, slopes)
        for i in range(5):
            size = abs(z[i].real) + (typical if i == 4 else 0.05 * (law[4].real if i % 2 else 1.0))
            share = abs(stages[3, i].real) / (tolerance * size)
            if not share <= worst:
                worst = share
        if not worst <= 1.0:
            z[4] = new[4]
            return worst
        copy_values(new, z)
        now, left = now + h, left - h
        if valve < 0:
            _land(z, mode, shape)
            return worst
        _meet(z, mode, valve, shape)
        if left.real <= 1e-14 * length:
            return worst
    return math.inf


@njit(error_model="numpy")
def _gap(z, mode, j, law, shape):
    """What is left, in the real part, before poppet j meets its next event; negative where it is past."""
    side = z[4] if j == 0 else -z[4]
    lift = z[2 * j]
    if mode[j] == HELD:
        return 1.0 - side * inverse(law[2])
    if mode[j] == STOPPED:
        return side * inverse(law[2]) * passage(lift, law, shape)[2] - 1.0 - lift
    return lift if lift.real < shape[2] - lift.real else shape[2] - lift


@njit(error_model="numpy")
def _first_event(z, new, mode, law, shape):
    """Which poppet (0, 1) meets an event first in a step from `z` to `new`; −1 where none does."""
    first, valve = 1.0, -1
    for j in range(2):
        before, after = _gap(z, mode, j, law, shape).real, _gap(new, mode, j, law, shape).real
        if before > 1e-13 and after < 0.0 and before / (before - after) < first:
            first, valve = before / (before - after), j
    return valve


@njit(error_model="numpy")
def _locate(z, mode, motion, now, left, j, law, shape, stages, slopes):
    """Step length at which poppet j meets its event, by the Illinois method; that step is then the last one made."""
    new = stages[4]
    low, high = 0.0 * left, left
    at_low, at_high = _gap(z, mode, j, law, shape), _gap(new, mode, j, law, shape)
    side = 0
    h = left
    polish = 0
    for _ in range(SEARCH):
        h = (low * at_high - high * at_low) / (at_high - at_low)
        _step(z, mode, motion, now, h, law, shape, stages, slopes)
        gap = _gap(new, mode, j, law, shape)
        if abs(gap.real) < 1e-12:
            polish += 1  # once more: the imaginary part follows the real one
            if polish == 3:
                break
        if gap.real < 0.0:
            high, at_high = h, gap
            if side < 0:
                at_low = 0.5 * at_low
            side = -1
        else:
            low, at_low = h, gap
            if side > 0:
                at_high = 0.5 * at_high
            side = 1
        if at_high.real == at_low.real:
            break
    return h


@njit(error_model="numpy")
def _meet(z, mode, j, shape):
    """Poppet j at its event: off the seat or the stop, or onto it without rebound."""
    if mode[j] != FREE:
        mode[j] = FREE
        return
    seat = z[2 * j].real < shape[2] - z[2 * j].real
    z[2 * j] = 0.0 if seat else shape[2]
    z[2 * j + 1] = 0.0
    mode[j] = HELD if seat else STOPPED


@njit(error_model="numpy")
def _release(z, mode, law, shape):
    """Let go the poppets that nothing holds."""
    for j in range(2):
        if mode[j] != FREE and (_gap(z, mode, j, law, shape).real < -1e-9):
            mode[j] = FREE


@njit(error_model="numpy")
def _land(z, mode, shape):
    """Poppets that a step brought past a stop from which it had started."""
    for j in range(2):
        if mode[j] == FREE and (z[2 * j].real < 0.0 or z[2 * j].real > shape[2]):
            _meet(z, mode, j, shape)


@njit(error_model="numpy")
def _rates(z, mode, v, stiffness, law, shape, out, slopes):
    """Time derivative into `out`; into `slopes` per poppet ∂s̈/∂s, ∂s̈/∂F, ∂Ḟ/∂s; [0, 4:] is ∂Ḟ/∂F, v − q."""
    root, bend = root_of(z[4], law, shape)
    passing, closing = inverse(square_root(law[1])), inverse(law[2])
    for j in range(2):
        if mode[j] == HELD:
            out[2 * j] = 0.0
            out[2 * j + 1] = 0.0
            continue
        flow, steep, push, relief = passage(z[2 * j], law, shape)
        passing = passing + flow
        if mode[j] == STOPPED:
            out[2 * j] = 0.0
            out[2 * j + 1] = 0.0
            continue
        sign = 1.0 if j == 0 else -1.0
        side = sign * z[4] * closing
        if side.real <= 0.0:
            side, sign = 0.0 * side, 0.0
        square = law[4] * law[4]
        out[2 * j] = z[2 * j + 1]
        out[2 * j + 1] = square * (side * push - 1.0 - z[2 * j]) - 2.0 * law[5] * law[4] * z[2 * j + 1]
        slopes[j, 0] = square * (side * relief - 1.0)
        slopes[j, 1] = sign * square * push * closing
        slopes[j, 2] = -stiffness * root * steep
    out[4] = stiffness * (v - root * passing)
    slopes[0, 4] = -stiffness * bend * passing
    slopes[0, 5] = v - root * passing


@njit(error_model="numpy")
def _stiffness(y, law, shape):
    """(k_h(y), dk_h/dy): stiffness of the oil columns l_1 − y and l_2 + y in series, k_h at y = 0."""
    one, two = 1.0 - y * shape[4], 1.0 + y * shape[5]
    one, two = inverse(one), inverse(two)
    k = law[0] * one * two
    return k, k * (shape[4] * one - shape[5] * two)


@njit(error_model="numpy")
def _step(z, mode, motion, now, h, law, shape, stages, slopes):
    """One Rodas3 step of length h from time `now` in the sample: the new state into stages[4], its error stages[3]."""
    u1, u2, u3, error, new = stages[0], stages[1], stages[2], stages[3], stages[4]
    tangent, spare = slopes[0], slopes[1]
    v0, slope_v, y0, slope_y = motion
    k, bend = _stiffness(y0 + slope_y * now, law, shape)
    _rates(z, mode, v0 + slope_v * now, k, law, shape, u1, tangent)
    drift = k * slope_v + bend * slope_y * tangent[0, 5]
    g, half = 2.0 * inverse(h), 0.5 * h
    arrow = g - tangent[0, 4]
    for j in range(2):  # eliminate each poppet from the row of the force
        if mode[j] == FREE:
            tangent[j, 3] = inverse(g + 2.0 * law[5] * law[4] - tangent[j, 0] * half)
            arrow = arrow - tangent[j, 2] * tangent[j, 1] * tangent[j, 3] * half
    arrow = inverse(arrow)
    copy_values(u1, u2)
    u1[4] += 0.5 * h * drift
    _solve(u1, mode, half, tangent, arrow)
    for i in range(5):
        u2[i] += 2.0 * g * u1[i]
    u2[4] += 1.5 * h * drift
    _solve(u2, mode, half, tangent, arrow)
    for i in range(5):
        new[i] = z[i] + 2.0 * u1[i]
    k = _stiffness(y0 + slope_y * (now + h), law, shape)[0]
    v = v0 + slope_v * (now + h)
    _rates(new, mode, v, k, law, shape, u3, spare)
    for i in range(5):
        u3[i] += (u1[i] - u2[i]) * (0.5 * g)
    _solve(u3, mode, half, tangent, arrow)
    for i in range(5):
        new[i] += u3[i]
    _rates(new, mode, v, k, law, shape, error, spare)
    for i in range(5):
        error[i] += (u1[i] - u2[i] - 8.0 / 3.0 * u3[i]) * (0.5 * g)
    _solve(error, mode, half, tangent, arrow)
    for i in range(5):
        new[i] += error[i]


@njit(error_model="numpy")
def _solve(b, mode, half, tangent, arrow):
    """(g I − J) u = b in place, `half` = 1/g: both poppets are eliminated, the force solved for, the poppets put back.
    """
    force = b[4]
    for j in range(2):
        if mode[j] == FREE:
            b[2 * j + 1] = (b[2 * j + 1] + tangent[j, 0] * b[2 * j] * half) * tangent[j, 3]
            force = force + tangent[j, 2] * (b[2 * j + 1] + b[2 * j]) * half
    force = force * arrow
    b[4] = force
    for j in range(2):
        if mode[j] == FREE:
            b[2 * j + 1] += tangent[j, 1] * tangent[j, 3] * force
            b[2 * j] = (b[2 * j] + b[2 * j + 1]) * half
        else:
            b[2 * j] = 0.0
            b[2 * j + 1] = 0.0


class ReliefValveStepper(DamperStepper):
    """The relief-valve damper, whose integration carries its poppets' modes and its step size beside the states."""

    def __init__(self, damper, step: float, tolerance: float) -> None:
        self._sample, self._tolerance, self._damper, self._step = sample, tolerance, damper, step
        self._law = tuple(float(p) for p in np.real(damper.law(damper.vector)))
        self._shape = damper.shape
        self._work = workspace(np.dtype(float))[2:]

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
        typical = min(self._law[2], max(self._law[1] * max(v0 * v0, velocity * velocity), STANDING * self._law[2]))
        level = self._sample(z, mode, motion, h, self._level, self._law, self._shape, self._tolerance, typical,
                             *self._work)
        return z, mode, level

    def trial(self, displacement: float, velocity: float) -> float:
        return float(self._moved(displacement, velocity)[0][4]) + self._outside(velocity)

    def commit(self, displacement: float, velocity: float) -> None:
        self._state, self._mode, self._level = self._moved(displacement, velocity)
        self._now = (displacement, velocity)
