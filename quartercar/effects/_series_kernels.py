"""Compiled march of elements in series with a law; arrays only.

A law at one sample is Σ_r b_r φ_r(w), φ_r cubic between nodes that lie evenly in u = asinh(w/w_0). The series element has
the deflection d = D(F), ḋ = v − w, F = law(w): each stage of the stiffly accurate three-stage rule of order three
(Alexander 1977) is one scalar equation D(law(w)) + γh w = R.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid._compiling import njit

GAMMA = 0.43586652150845906
LAST = (-1.5 * GAMMA**2 + 4.0 * GAMMA - 0.25, 1.5 * GAMMA**2 - 5.0 * GAMMA + 1.25)
"""weights of the first two stages in the last"""
HEAD = 0.05
"""part of a step before a sample in which a held signal already has the sample's value"""


@njit()
def law_along(speed, grid, nodes, rows, out):
    """Law at one speed per sample: speed (n,), nodes (G + 2, r), rows (n, r)."""
    for k in range(speed.size):
        out[k] = _law(speed[k], grid, nodes, rows[k])[0]


@njit()
def march(velocity, grid, nodes, rows, before, tilt, held, element, step, out):
    """Force of a law in series with elements (n,).

    Parameters
    ----------
    velocity : (n,) array
    grid : (3,) array
        First u, spacing of u, w_0.
    nodes : (G + 2, r) array
        φ at the nodes, one more on either side.
    rows, before, tilt : (n, r) arrays
        b at the samples, b just before them, and −∂b/∂x for a law that depends on the position of the fluid's side.
    held : bool
        Whether b jumps at the samples.
    element : (5,) array
        Compliance [m/N], stroke of the air [m], its force [N], half of the play [m], floor of the force [N].
    step : float
        [s].
    """
    rank = rows.shape[1]
    b = np.empty(rank)
    w = velocity[0]
    for r in range(rank):
        b[r] = rows[0, r]
    force = max(_law(w, grid, nodes, b)[0], element[4])
    d = _deflection(force, element)[0]
    if force != 0.0:
        d += math.copysign(element[3], force)
    state = np.array([d, w, 0.0])
    out[0] = force
    for k in range(1, velocity.size):
        v0, v1 = velocity[k - 1], velocity[k]
        if held:
            early = v0 + (1.0 - HEAD) * (v1 - v0)
            _advance(state, v0, early, rows[k - 1], before[k], tilt[k], 1.0 - HEAD, grid, nodes, element,
                     (1.0 - HEAD) * step, b)
            for r in range(rank):
                b[r] = rows[k, r] + state[0] * tilt[k, r]
            force = _stage(state[0] + HEAD * step * v1, HEAD * step, HEAD * step, state, grid, nodes, b, element)
            state[0] += HEAD * step * (v1 - state[1])
        else:
            force = _advance(state, v0, v1, rows[k - 1], rows[k], tilt[k], 1.0, grid, nodes, element, step, b)
        out[k] = force


@njit()
def _advance(state, v0, v1, row0, row1, tilt, share, grid, nodes, element, step, b):
    """One step of the three-stage rule; `state` holds deflection, fluid speed, void. Returns the force at its end."""
    h = GAMMA * step
    start = state[0]
    first = second = force = 0.0
    for part in range(3):
        at = GAMMA if part == 0 else 0.5 * (1.0 + GAMMA) if part == 1 else 1.0
        if part == 0:
            known = start
            moved = GAMMA
        elif part == 1:
            known = start + 0.5 * (1.0 - GAMMA) * step * first
            moved = 0.5 * (1.0 - GAMMA)
        else:
            known = start + step * (LAST[0] * first + LAST[1] * second)
            moved = 0.5 * (1.0 - GAMMA)
        v = v0 + at * (v1 - v0)
        for r in range(b.size):
            b[r] = row0[r] + at * share * (row1[r] - row0[r]) + state[0] * tilt[r]
        force = _stage(known + h * v, h, moved * step, state, grid, nodes, b, element)
        rate = v - state[1]
        if part == 0:
            first = rate
        elif part == 1:
            second = rate
        state[0] = known + h * rate
    return force


@njit()
def _stage(target, h, passed, state, grid, nodes, b, element):
    """Force and fluid speed at one instant; an open void holds the force at the floor until it is refilled."""
    floor = element[4]
    if floor > -1e290:
        speed = state[1]
        if state[2] > 0.0:
            w = (target - _deflection(floor, element)[0] + element[3]) / h
            fill = _speed_at(floor, grid, nodes, b)
            void = state[2] + passed * (fill - 0.5 * (speed + w))
            if void > 0.0:
                state[1] = w
                state[2] = void
                return floor
            state[2] = 0.0
        w, force = _root(target, h, speed, grid, nodes, b, element)
        if force <= floor:
            fill = _speed_at(floor, grid, nodes, b)
            now, then = fill - w, fill - speed
            if now > 0.0:
                state[2] = passed * (0.5 * (now + then) if then >= 0.0 else 0.5 * now * now / (now - then))
        state[1] = w
        return force
    w, force = _root(target, h, state[1], grid, nodes, b, element)
    state[1] = w
    return force


@njit()
def _root(target, h, guess, grid, nodes, b, element):
    """w with D(F) + h w = target, F = max(law(w), floor), by Newton's rule inside a shrinking bracket."""
    low, high = -1e300, 1e300
    w, force = guess, 0.0
    half, floor = element[3], element[4]
    for sweep in range(120):
        force, slope = _law(w, grid, nodes, b)
        if force < floor:
            force, slope = floor, 0.0
        d, soft = _deflection(force, element)
        gap = d + h * w - target
        if half > 0.0:
            gap += half if force > 0.0 else -half
        if gap > 0.0:
            high = w
        else:
            low = w
        new = w - gap / (soft * max(slope, 0.0) + h)
        if (not low < new < high) or (sweep > 5 and sweep % 2 == 1 and high - low < 1e299):
            new = 0.5 * (low + high)
        if abs(new - w) <= 1e-13 + 1e-11 * abs(w):
            w = new
            break
        w = new
    return w, max(_law(w, grid, nodes, b)[0], floor)


@njit()
def _speed_at(force, grid, nodes, b):
    """Speed at which the law reaches a force."""
    low, high = -1.0, 1.0
    for _ in range(30):
        if _law(low, grid, nodes, b)[0] < force:
            break
        low *= 2.0
    for _ in range(30):
        if _law(high, grid, nodes, b)[0] > force:
            break
        high *= 2.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _law(middle, grid, nodes, b)[0] < force:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit()
def _deflection(force, element):
    """Deflection of spring and air, and its slope."""
    d, slope = element[0] * force, element[0]
    if element[1] > 0.0:
        ratio = 1.0 + abs(force) / element[2]
        power = ratio ** (-1.0 / 1.3)
        d += math.copysign(element[1] * (1.0 - power), force)
        slope += element[1] * power / (1.3 * ratio * element[2])
    return d, slope


@njit()
def _law(w, grid, nodes, b):
    """Law and slope at one speed: cubic of Catmull and Rom in u between the nodes, straight beyond them."""
    last = nodes.shape[0] - 4
    place = (math.asinh(w / grid[2]) - grid[0]) / grid[1]
    cell = int(min(max(math.floor(place), 0.0), float(last)))
    t = min(max(place - cell, 0.0), 1.0)
    t2 = t * t
    t3 = t2 * t
    a0, a1 = 0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0)
    a2, a3 = 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)
    s0, s1 = 0.5 * (-3.0 * t2 + 4.0 * t - 1.0), 0.5 * (9.0 * t2 - 10.0 * t)
    s2, s3 = 0.5 * (-9.0 * t2 + 8.0 * t + 1.0), 0.5 * (3.0 * t2 - 2.0 * t)
    value = slope = 0.0
    for r in range(b.size):
        p0, p1, p2, p3 = nodes[cell, r], nodes[cell + 1, r], nodes[cell + 2, r], nodes[cell + 3, r]
        value += b[r] * (a0 * p0 + a1 * p1 + a2 * p2 + a3 * p3)
        slope += b[r] * (s0 * p0 + s1 * p1 + s2 * p2 + s3 * p3)
    here = grid[2] * math.sinh(grid[0] + grid[1] * (cell + t))
    slope /= grid[1] * math.sqrt(here * here + grid[2] * grid[2])
    if place < 0.0 or place > last + 1.0:
        value += slope * (w - here)
    return value, slope
