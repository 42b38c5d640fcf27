"""Compiled march of elements in series with a law; arrays only.

A law at one sample is Σ_r b_r φ_r(w), φ_r straight between nodes. The series element has the deflection d = D(F),
ḋ = v − w, F = law(w): each stage of the stiffly accurate three-stage rule of order three (Alexander 1977) is one scalar
equation D(law(w)) + γh w = R. Its cell is sought from the last one on; inside, it is linear for a spring.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid._compiling import njit

GAMMA = 0.43586652150845906
LAST = (-1.5 * GAMMA**2 + 4.0 * GAMMA - 0.25, 1.5 * GAMMA**2 - 5.0 * GAMMA + 1.25)
"""weights of the first two stages in the last"""
HALF = 0.5 * (1.0 - GAMMA)
"""part of a step from its first stage to the second, and on to the last"""
HEAD = 0.03
"""part of a step before a sample in which a held signal already has the sample's value"""
CLOSE = 1e-7
"""last move of Newton's rule, in cells; what it leaves is of second order"""
TAKEN_UP = 5.0
"""force over which play is taken up [N]"""
TAKEN = 20.0 * TAKEN_UP
"""force from which it is, to the last digit [N]"""


@njit(error_model="numpy", fastmath={"contract"})
def law_along(speed, speeds, nodes, rows, out):
    """Law at one speed per sample: speed (n,), speeds (G,), nodes (G, r), rows (n, r)."""
    for k in range(speed.size):
        out[k] = _law(speed[k], _cell(speed[k], speeds), speeds, nodes, rows[k])


@njit(error_model="numpy", fastmath={"contract"})
def march(velocity, speeds, nodes, rows, before, tilt, element, step, parts, ends, out):
    """Force of a law in series with elements (n,).

    Parameters
    ----------
    velocity : (n,) array
    speeds : (G,) array
        At which φ is given.
    nodes : (G, r) array
        φ there.
    rows, before, tilt : (n, r) arrays
        b at the samples, b just before them, and −∂b/∂x for a law that depends on the position of the fluid's side.
    element : (5 + n,) array
        Compliance [m/N], stroke of the air [m], its force [N], half of the play [m], floor of the force [N]; the air's
        curve at even places.
    step : float
        [s].
    parts : (n,) array of int
        Steps from the sample before to each.
    ends : (n,) bool array
        Samples before which a short step of first order is put, with what the held signals are from there on.
    """
    rank = rows.shape[1]
    b = rows[0].copy()
    w = velocity[0]
    cell = _cell(w, speeds)
    force = max(_law(w, cell, speeds, nodes, b), element[4])
    state = np.array([_deflection(force, element)[0], w, 0.0, float(cell)])
    out[0] = force
    start = first = second = 0.0
    for k in range(1, velocity.size):
        change = velocity[k] - velocity[k - 1]
        share = 1.0 - HEAD if ends[k] else 1.0
        count = parts[k]
        full = share * step / count
        h = GAMMA * full
        for part in range(count):
            for stage in range(3):
                if stage == 0:
                    start = state[0]
                    at, known, passed = GAMMA, start, GAMMA
                elif stage == 1:
                    at, known, passed = 0.5 * (1.0 + GAMMA), start + 0.5 * (1.0 - GAMMA) * full * first, HALF
                else:
                    at, known, passed = 1.0, start + full * (LAST[0] * first + LAST[1] * second), HALF
                place = share * (part + at) / count
                v = velocity[k - 1] + place * change
                for r in range(rank):
                    b[r] = rows[k - 1, r] + place * (before[k, r] - rows[k - 1, r]) + state[0] * tilt[k, r]
                force = _stage(known + h * v, h, passed * full, state, speeds, nodes, b, element)
                rate = v - state[1]
                if stage == 0:
                    first = rate
                elif stage == 1:
                    second = rate
                state[0] = known + h * rate
        if ends[k]:
            for r in range(rank):
                b[r] = rows[k, r] + state[0] * tilt[k, r]
            last = HEAD * step
            force = _stage(state[0] + last * velocity[k], last, last, state, speeds, nodes, b, element)
            state[0] += last * (velocity[k] - state[1])
        out[k] = force


@njit(error_model="numpy", fastmath={"contract"})
def _stage(target, h, passed, state, speeds, nodes, b, element):
    """Force at one instant; `state` holds deflection, fluid speed, void, cell. An open void holds it at the floor."""
    floor, speed = element[4], state[1]
    if state[2] > 0.0:
        w = (target - _deflection(floor, element)[0]) / h
        void = state[2] + passed * (_speed_at(floor, int(state[3]), speeds, nodes, b) - 0.5 * (speed + w))
        if void > 0.0:
            state[1] = w
            state[2] = void
            return floor
        state[2] = 0.0
    force = _root(target, h, state, speeds, nodes, b, element)
    if force <= floor:
        fill = _speed_at(floor, int(state[3]), speeds, nodes, b)
        now, then = fill - state[1], fill - speed
        if now > 0.0:
            state[2] = passed * (0.5 * (now + then) if then >= 0.0 else 0.5 * now * now / (now - then))
    return force


@njit(error_model="numpy", fastmath={"contract"})
def _node_force(node, nodes, b):
    force = 0.0
    for r in range(b.size):
        force += b[r] * nodes[node, r]
    return force


@njit(error_model="numpy", fastmath={"contract"})
def _gap(force, w, target, h, element):
    """D(max(F, floor)) + h w − target."""
    if element[1] == 0.0 and element[3] == 0.0:
        return element[0] * max(force, element[4]) + h * w - target
    return _deflection(max(force, element[4]), element)[0] + h * w - target


@njit(error_model="numpy", fastmath={"contract"})
def _root(target, h, state, speeds, nodes, b, element):
    """Force at the w with D(F) + h w = target, F = max(law(w), floor)."""
    last = speeds.size - 1
    low, high = int(state[3]), int(state[3]) + 1
    if element[0] == 0.0 and element[1] == 0.0 and element[3] == 0.0:  # nothing gives way: only the floor is there
        w = target / h
        while w < speeds[low] and low > 0:
            low -= 1
        while w >= speeds[low + 1] and low + 1 < last:
            low += 1
        state[1], state[3] = w, low
        return max(_law(w, low, speeds, nodes, b), element[4])
    force_low, force_high = _node_force(low, nodes, b), _node_force(high, nodes, b)
    gap_low = _gap(force_low, speeds[low], target, h, element)
    gap_high = _gap(force_high, speeds[high], target, h, element)
    width = 1
    while gap_low > 0.0 and low > 0:
        high, force_high, gap_high = low, force_low, gap_low
        low, width = max(low - width, 0), 3 * width
        force_low = _node_force(low, nodes, b)
        gap_low = _gap(force_low, speeds[low], target, h, element)
    while gap_high <= 0.0 and high < last:
        low, force_low, gap_low = high, force_high, gap_high
        high, width = min(high + width, last), 3 * width
        force_high = _node_force(high, nodes, b)
        gap_high = _gap(force_high, speeds[high], target, h, element)
    while high - low > 1:
        middle = (low + high) // 2
        force = _node_force(middle, nodes, b)
        gap = _gap(force, speeds[middle], target, h, element)
        if gap > 0.0:
            high, force_high, gap_high = middle, force, gap
        else:
            low, force_low, gap_low = middle, force, gap
    state[3] = low
    t = gap_low / (gap_low - gap_high)
    rise, cell = force_high - force_low, speeds[high] - speeds[low]
    floor = element[4]
    if element[1] != 0.0 or element[3] != 0.0 or min(force_low, force_high) < floor:
        t = _within(t, force_low, rise, speeds[low], cell, target, h, element)
    state[1] = speeds[low] + t * cell
    return max(force_low + t * rise, floor)


@njit(error_model="numpy", fastmath={"contract"})
def _within(t, start, rise, w, cell, target, h, element):
    """Place in a cell, by Newton's rule inside a shrinking bracket."""
    below, above = min(t, 0.0), max(t, 1.0)
    for sweep in range(100):
        force, slope = start + t * rise, max(rise, 0.0)
        if force < element[4]:
            force, slope = element[4], 0.0
        d, soft = _deflection(force, element)
        gap = d + h * (w + t * cell) - target
        if gap > 0.0:
            above = t
        else:
            below = t
        new = t - gap / (soft * slope + h * cell)
        if not below <= new <= above or (sweep > 5 and sweep % 2 == 1):
            new = 0.5 * (below + above)
        move = new - t
        t = new
        if abs(move) <= CLOSE:
            break
    return t


@njit(error_model="numpy", fastmath={"contract"})
def _speed_at(force, cell, speeds, nodes, b):
    """Speed at which a rising law reaches a force, sought from a cell on; the outermost where it does not."""
    low, high, last, width = cell, cell + 1, speeds.size - 1, 1
    force_low, force_high = _node_force(low, nodes, b), _node_force(high, nodes, b)
    while force_low >= force and low > 0:
        high, force_high = low, force_low
        low, width = max(low - width, 0), 3 * width
        force_low = _node_force(low, nodes, b)
    while force_high < force and high < last:
        low, force_low = high, force_high
        high, width = min(high + width, last), 3 * width
        force_high = _node_force(high, nodes, b)
    while high - low > 1:
        middle = (low + high) // 2
        between = _node_force(middle, nodes, b)
        if between < force:
            low, force_low = middle, between
        else:
            high, force_high = middle, between
    if force_high <= force_low:
        return speeds[low]
    share = min(max((force - force_low) / (force_high - force_low), 0.0), 1.0)
    return speeds[low] + share * (speeds[high] - speeds[low])


@njit(error_model="numpy", fastmath={"contract"})
def _deflection(force, element):
    """Deflection of spring, play and air, and its slope."""
    d, slope = element[0] * force, element[0]
    if element[3] > 0.0:
        t = math.tanh(force / TAKEN_UP) if abs(force) < TAKEN else math.copysign(1.0, force)
        d += element[3] * t
        slope += element[3] * (1.0 - t * t) / TAKEN_UP
    if element[1] > 0.0:
        size = abs(force) + element[2]
        last = element.size - 6
        place = abs(force) / size * last
        node = min(int(place), last - 1)
        rise = element[6 + node] - element[5 + node]
        d += math.copysign(element[1] * (element[5 + node] + (place - node) * rise), force)
        slope += element[1] * rise * last * element[2] / (size * size)
    return d, slope


@njit(error_model="numpy", fastmath={"contract"})
def _cell(w, speeds):
    """Number of the node below a speed."""
    low, high = 0, speeds.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if speeds[middle] > w:
            high = middle
        else:
            low = middle
    return low


@njit(error_model="numpy", fastmath={"contract"})
def _law(w, cell, speeds, nodes, b):
    """Law at a speed in a cell, or beyond the outermost."""
    share = (w - speeds[cell]) / (speeds[cell + 1] - speeds[cell])
    low = _node_force(cell, nodes, b)
    return low + share * (_node_force(cell + 1, nodes, b) - low)
