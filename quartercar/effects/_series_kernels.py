"""Compiled integration (march) of elements in series with a law; arrays only.

A law at one sample is Σ_r b_r φ_r(w), φ_r linear between nodes. The series element has the deflection d = D(F − F_0),
ḋ = v − w, F = law(w): each stage of the stiffly accurate two-stage rule of order two (Alexander 1977) is one scalar
equation D(law(w) − F_0) + γh w = R. The search for the cell of its root starts at the last one; inside the cell, it is
linear for a spring. The march is one function: a call with arrays would cost more than its computation.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.rounding import EXPLODED, HALF_DIGITS, STEP
from lpvid.toolkit import njit
from quartercar.dampers.stepper import GAMMA
from quartercar.effects.electrical import SEEN_AFTER
from quartercar.effects.friction_gas import POLYTROPIC

CLOSE = HALF_DIGITS
"""last step of Newton's method, as a share of the force; the error left is its square"""
TAKEN = -math.log(HALF_DIGITS)
"""force from which play is taken up to the last digit, over the force F_t over which it is: its deflection is
play/2 tanh(F/F_t), and 1 − tanh x = 2e^(−2x)"""


def _tables() -> tuple[np.ndarray, np.ndarray]:
    """tanh(F/F_t) at even steps of F/F_t from 0 to `TAKEN`, and the same number of steps of the deflection of air.

    The steps of F/F_t are √`STEP`, so that linear interpolation has an error of `STEP`/8 times the curvature. Air:
    1 − (1 + |F|/F_p)^(−1/n) at even steps of |F|/(|F| + F_p) from 0 to 1. Both are concave.
    """
    share = np.linspace(0.0, 1.0, 1 + int(np.ceil(TAKEN / np.sqrt(STEP))))
    return np.tanh(TAKEN * share), 1 - (1 - share) ** (1 / POLYTROPIC)


SIGN, AIR = _tables()


@njit(error_model="numpy", fastmath={"contract"})
def law_along(speed, speeds, nodes, rows, out):
    """Law at one speed per sample: speed (n,), speeds (G,), nodes (G, r), rows (n, r)."""
    for k in range(speed.size):
        cell = _cell(speed[k], speeds)
        low = high = 0.0
        for r in range(rows.shape[1]):
            low += rows[k, r] * nodes[cell, r]
            high += rows[k, r] * nodes[cell + 1, r]
        out[k] = low + (speed[k] - speeds[cell]) / (speeds[cell + 1] - speeds[cell]) * (high - low)


@njit(error_model="numpy", fastmath={"contract"})
def march(velocity, rise, corner, speeds, nodes, rows, before, tilt, element, step, trace, parts, ends, out):
    """Force of a law in series with elements (n,).

    Parameters
    ----------
    velocity : (n,) array
    rise, corner : (n,) arrays
        Mean velocity in the interval before each sample less that of a linear course, added as a triangle, and the
        place of the triangle's vertex, as a share of the interval.
    speeds : (G,) array
        Nodes of φ.
    nodes : (G, r) array
        φ there.
    rows, before, tilt : (n, r) arrays
        b at the samples, b just before them, and −∂b/∂x for a law that depends on the position behind the elements.
    element : tuple of seven floats
        Compliance [m/N], stroke of the air [m], its force [N], half of the play [m], floor of the force [N], the
        force at rest, which acts beside the elements [N], and the force over which the play is taken up [N].
    step : float
        [s].
    trace : (stages, 5) array
        Filled with w, the deflection at which the law was evaluated, F, ∂F/∂w (−1 on the floor) and ∂F/∂d at every
        stage, unless it has no rows.
    parts : (n,) array of int
        Steps from the sample before to each.
    ends : (n,) bool array
        Samples that a short step of first order precedes, with the values of the held signals from there on.
    """
    floor = element[4]
    curved, rigid = element[1] > 0.0 or element[3] > 0.0, element[0] == 0.0 and element[1] == 0.0 and element[3] == 0.0
    at_floor = _deflection(floor, element)[0] if floor > -EXPLODED else 0.0
    last, b = speeds.size - 1, rows[0].copy()
    low = _cell(velocity[0], speeds)
    deflection = force = force_low = force_high = w = void = known = 0.0
    count, traced = 0, trace.shape[0] > 0
    for k in range(velocity.size):
        first = max(k - 1, 0)
        share = 1.0 - SEEN_AFTER if ends[k] else 1.0
        stages = 2 * parts[k] + ends[k] if k else 1
        full = share * step / parts[k]
        for stage in range(stages):
            if stage == 2 * parts[k] or k == 0:
                h = passed = SEEN_AFTER * step
                v, known = velocity[k], deflection
                for r in range(b.size):
                    b[r] = rows[k, r] + deflection * tilt[k, r]
            else:
                part = GAMMA if stage % 2 == 0 else 1.0
                if stage % 2 == 0:
                    known = deflection
                place = share * (stage // 2 + part) / parts[k]
                v = velocity[first] + place * (velocity[k] - velocity[first])
                v += 2.0 * rise[k] * min(place / corner[k], (1.0 - place) / (1.0 - corner[k]))
                for r in range(b.size):
                    b[r] = rows[first, r] + place * (before[k, r] - rows[first, r]) + deflection * tilt[k, r]
                h, passed = GAMMA * full, (GAMMA if stage % 2 == 0 else 1.0 - GAMMA) * full
            target, speed, seen = known + h * v, w, deflection
            if void > 0.0:
                w = (target - at_floor) / h
                void += passed * (_speed_at(floor, low, speeds, nodes, b) - 0.5 * (speed + w))
                force = floor
            if not void > 0.0:
                void = 0.0
                if rigid or k == 0:
                    w = target / h if k else velocity[0]
                    while w < speeds[low] and low > 0:
                        low -= 1
                    while w >= speeds[low + 1] and low + 1 < last:
                        low += 1
                found = low
                force_low = force_high = 0.0
                for r in range(b.size):
                    force_low += b[r] * nodes[low, r]
                    force_high += b[r] * nodes[low + 1, r]
                if rigid or k == 0:
                    t = (w - speeds[low]) / (speeds[low + 1] - speeds[low])
                else:
                    below = _residual(force_low, speeds[low], target, h, element, curved)
                    above = _residual(force_high, speeds[low + 1], target, h, element, curved)
                    if below > 0.0 and low > 0:
                        low = _bracket(low, -1, speeds, nodes, b, target, h, element, curved)
                    elif above <= 0.0 and low + 1 < last:
                        low = _bracket(low, 1, speeds, nodes, b, target, h, element, curved)
                    if low != found:
                        force_low, force_high = _node_force(low, nodes, b), _node_force(low + 1, nodes, b)
                        below = _residual(force_low, speeds[low], target, h, element, curved)
                        above = _residual(force_high, speeds[low + 1], target, h, element, curved)
                    t = below / (below - above)
                    cell = speeds[low + 1] - speeds[low]
                    inside = 0.0 <= t <= 1.0  # beyond the table both nodes may lie on one side of the play
                    taken = inside and element[1] == 0.0 and (
                        min(force_low, force_high) - element[5] > TAKEN * element[6]
                        or max(force_low, force_high) - element[5] < -TAKEN * element[6])
                    if (curved and not taken) or min(force_low, force_high) < floor:
                        t = _root_in_cell(force_low, force_high - force_low, speeds[low], cell, target, h, element,
                                          inside)
                    w = speeds[low] + t * cell
                force = max(force_low + t * (force_high - force_low), floor)
                if force <= floor and k:
                    fill = _speed_at(floor, low, speeds, nodes, b)
                    now, then = fill - w, fill - speed
                    if now > 0.0:
                        void = passed * (0.5 * (now + then) if then >= 0.0 else 0.5 * now * now / (now - then))
            if k == 0:
                deflection = _deflection(force, element)[0]
            else:
                rate = v - w
                deflection = known + h * rate
                known += (1.0 - GAMMA) * full * rate
            if traced:
                trace[count, 0], trace[count, 1], trace[count, 2] = w, seen, force
                trace[count, 3] = trace[count, 4] = 0.0
                t = (w - speeds[low]) / (speeds[low + 1] - speeds[low])
                if force <= floor:
                    trace[count, 3] = -1.0
                else:
                    trace[count, 3] = max(force_high - force_low, 0.0) / (speeds[low + 1] - speeds[low])
                    for r in range(b.size):
                        trace[count, 4] += tilt[k, r] * (nodes[low, r] + t * (nodes[low + 1, r] - nodes[low, r]))
                count += 1
        out[k] = force


@njit(error_model="numpy", fastmath={"contract"})
def stages(parts, ends, last, place):
    """Last sample of the interval of each stage of `march`, and its place in it; 2 at the step into a sample."""
    count = 0
    for k in range(parts.size):
        share = 1.0 - SEEN_AFTER if ends[k] else 1.0
        for stage in range(2 * parts[k] + ends[k] if k else 1):
            last[count] = k
            if stage == 2 * parts[k] or k == 0:
                place[count] = 2.0
            else:
                place[count] = share * (stage // 2 + (GAMMA if stage % 2 == 0 else 1.0)) / parts[k]
            count += 1


@njit(error_model="numpy", fastmath={"contract"})
def softer(trace, element, other, out):
    """(stages,) change of the deflection under the forces of a march from one element to another."""
    for count in range(out.size):
        force = trace[count, 2]
        out[count] = _deflection(force, other)[0] - _deflection(force, element)[0]


@njit(error_model="numpy", fastmath={"contract"})
def tangent(trace, direct, softer, falls, element, step, parts, ends, first, state, out):
    """First-order change of the force of `march` for changes of the law and of the elements, several at a time.

    δF = ∂F/∂w δw + ∂F/∂d δd + δ_law at each stage, D' δF + δD + h δw = δ(known part).

    Parameters
    ----------
    trace : (stages, 5) array
        Of the march.
    direct, softer : (m, stages) arrays
        Changes of the law at given speed and position, and of the deflection at given force.
    falls : (m,) array
        Changes of the floor.
    element, step, parts, ends
        As for the march; consecutive samples of it, and the stages of these.
    first : bool
        Whether these begin with the first sample of the march.
    state : (2, m) array
        Changes of the known part and of the deflection, at the sample before; afterwards at the last one.
    out : (m, n) array
    """
    changes = direct.shape[0]
    known, deflection = state[0], state[1]
    count = 0
    for k in range(parts.size):
        start = first and k == 0
        share = 1.0 - SEEN_AFTER if ends[k] else 1.0
        full = share * step / parts[k]
        for stage in range(1 if start else 2 * parts[k] + ends[k]):
            head = stage == 2 * parts[k] or start
            h = SEEN_AFTER * step if head else GAMMA * full
            renewed = head or stage % 2 == 0
            steep, shifted = trace[count, 3], trace[count, 4]
            soft = _deflection(trace[count, 2], element)[1]
            inverse = 1.0 / (soft * max(steep, 0.0) + h)
            for j in range(changes):
                if renewed:
                    known[j] = deflection[j]
                if steep < 0.0:
                    force = falls[j]
                    moved = soft * force + softer[j, count]
                    faster = (known[j] - moved) * inverse
                elif start:
                    force, faster = direct[j, count], 0.0
                    moved = soft * force + softer[j, count]
                else:
                    force = direct[j, count] + shifted * deflection[j]
                    faster = (known[j] - soft * force - softer[j, count]) * inverse
                    force += steep * faster
                    moved = known[j] - h * faster
                deflection[j] = moved
                known[j] -= (1.0 - GAMMA) * full * faster
                out[j, k] = force
            count += 1


@njit(error_model="numpy", fastmath={"contract"})
def _residual(force, w, target, h, element, curved):
    """D(max(F, floor)) + h w − target."""
    held = max(force, element[4])
    return (_deflection(held, element)[0] if curved else element[0] * (held - element[5])) + h * w - target


@njit(error_model="numpy", fastmath={"contract"})
def _bracket(cell, way, speeds, nodes, b, target, h, element, curved):
    """Cell in which the residual passes zero, sought from one on upwards (way 1) or downwards (way -1)."""
    last, width = speeds.size - 2, 1
    near, far = cell, cell
    while True:
        far = min(max(near + way * width, 0), last)
        node = far + 1 if way > 0 else far
        passed = _residual(_node_force(node, nodes, b), speeds[node], target, h, element, curved) > 0.0
        if passed == (way > 0) or far == 0 or far == last:
            break
        near, width = far, 2 * width
    low, high = min(near, far), max(near, far)
    while low < high:
        middle = (low + high) // 2
        node = middle + 1
        if _residual(_node_force(node, nodes, b), speeds[node], target, h, element, curved) > 0.0:
            high = middle
        else:
            low = middle + 1
    return low


@njit(error_model="numpy", fastmath={"contract"})
def _root_in_cell(start, rise, w, cell, target, h, element, inside):
    """Place in a cell at which the residual is zero, with the law linear in the cell; `inside` where it is within."""
    if rise > 0.0:
        inverse = cell / rise
        right = target - h * (w + (element[5] - start) * inverse)
        ends = start - element[5], start + rise - element[5]
        least = min(abs(ends[0]), abs(ends[1])) if inside and ends[0] * ends[1] > 0.0 else 0.0
        size = _force_above_rest(abs(right), element[0] + h * inverse, least, element)
        force = element[5] + math.copysign(size, right)
        if force >= element[4]:
            return (force - start) / rise
        start = element[4]
    return ((target - _deflection(max(start, element[4]), element)[0]) / h - w) / cell


@njit(error_model="numpy", fastmath={"contract"})
def _force_above_rest(right, stiff, least, element):
    """Force F ≥ 0 beyond that at rest with stiff F + D(F) = right, D of play and air; it is `least` at least.

    The left side increases and is concave, so that Newton's method from below converges without passing the root. Two
    lower bounds are the roots with the tangent of D at zero force and with the largest deflection of play and air.
    """
    soft = _play_and_air(0.0, element)[1]
    force = max(right / (stiff + soft), (right - element[3] - element[1]) / stiff, least)
    for _ in range(SIGN.size + AIR.size):  # but for the last one, each step leaves a cell of a table
        d, soft = _play_and_air(force, element)
        move = (right - d - stiff * force) / (stiff + soft)
        force += move
        if abs(move) <= CLOSE * force:
            break
    return force


@njit(error_model="numpy", fastmath={"contract"})
def _speed_at(force, cell, speeds, nodes, b):
    """Speed at which an increasing law reaches a force, sought from a cell on; the outermost one if it does not."""
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
def _node_force(node, nodes, b):
    force = 0.0
    for r in range(b.size):
        force += b[r] * nodes[node, r]
    return force


@njit(error_model="numpy", fastmath={"contract"})
def _deflection(force, element):
    """Deflection of spring, play and air, and its slope."""
    force -= element[5]
    d, soft = _play_and_air(abs(force), element)
    return element[0] * force + math.copysign(d, force), element[0] + soft


@njit(error_model="numpy", fastmath={"contract"})
def _play_and_air(size, element):
    """Deflection of play and air under a force of a size, and its slope."""
    d = slope = 0.0
    if element[3] > 0.0:
        place = size / (TAKEN * element[6]) * (SIGN.size - 1)
        if place < SIGN.size - 1:
            node = max(int(place), 0)  # Newton's method may reach a negative force where the law is steep
            rise = SIGN[node + 1] - SIGN[node]
            d += element[3] * (SIGN[node] + (place - node) * rise)
            slope += element[3] * rise * (SIGN.size - 1) / (TAKEN * element[6])
        else:
            d += element[3]
    if element[1] > 0.0:
        whole = size + element[2]
        # the force of a diverging march is infinite or undefined here: int(nan) is no index
        place = size / whole * (AIR.size - 1) if size < np.inf else AIR.size - 1.0
        node = max(min(int(place), AIR.size - 2), 0)
        rise = AIR[node + 1] - AIR[node]
        d += element[1] * (AIR[node] + (place - node) * rise)
        slope += element[1] * rise * (AIR.size - 1) * element[2] / (whole * whole)
    return d, slope


@njit(error_model="numpy", fastmath={"contract"})
def _cell(w, speeds):
    """Number of the node below a speed."""
    return min(max(np.searchsorted(speeds, w, side="right") - 1, 0), speeds.size - 2)
