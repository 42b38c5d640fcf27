"""Compiled prediction of a quarter car over a short horizon, its cost and the exact gradient of that; arrays only."""

from __future__ import annotations

import math

from lpvid.toolkit import njit

NEWTON = 12
"""most Newton steps of one force; one or two are usual from the force before"""
CLOSE = 1e-6
"""relative and absolute [N] residual of a force at which its steps end"""


@njit(error_model="numpy", fastmath=True)
def read_table(table, grid, felt, c):
    """Coefficients at a lagged current, into c; the cell of the table that it lies in."""
    place = (felt - grid[0]) / grid[1]
    cell = min(max(math.floor(place), 0), table.shape[0] - 2)
    for m in range(c.size):
        c[m] = table[cell, m] + (place - cell) * (table[cell + 1, m] - table[cell, m])
    return cell


@njit(error_model="numpy", fastmath=True)
def remembered(c, past, h, na, nb):
    """Force that does not depend on the coming motion; rows h, h − 1 … of past: force, velocity, displacement, tanh."""
    found = c[0]
    for j in range(na):
        found -= c[8 + j] * past[h - j, 0]
    for j in range(nb):
        o = 8 + na + 3 * j
        found += c[o] * past[h - j, 1] + c[o + 1] * past[h - j, 2] + c[o + 2] * past[h - j, 3]
    return found


@njit(error_model="numpy", fastmath=True)
def bent(c, z, v):
    """tanh of the law's shape, and its slopes by z, v and the shape."""
    arg, arg_z = c[4] * v + c[5] * z, c[5]
    if c[6] != 0.0:
        w = math.tanh(z / c[7])
        arg += c[6] * w
        arg_z += c[6] * (1.0 - w * w) / c[7]
    t = math.tanh(arg)
    bend = 1.0 - t * t
    return t, bend * arg_z, bend * c[4], bend


@njit(error_model="numpy", fastmath=True)
def solve_force(c, memory, zb, vb, gz, gv, f):
    """f = memory + law(zb + gz f, vb + gv f) by Newton's steps from a start: f, z, v, `bent` there, 1 − df/df."""
    for _ in range(NEWTON):
        z, v = zb + gz * f, vb + gv * f
        t, by_z, by_v, bend = bent(c, z, v)
        r = f - (memory + c[1] * v + c[2] * z + c[3] * t)
        slope = 1.0 - (c[1] + c[3] * by_v) * gv - (c[2] + c[3] * by_z) * gz
        if abs(r) <= CLOSE * (1.0 + abs(f)):
            break
        f -= r / slope
    z, v = zb + gz * f, vb + gv * f
    return f, z, v, t, by_z, by_v, bend, slope


@njit(error_model="numpy", fastmath=True)
def begin(start, outs, hist):
    """First rows of the work space from what a prediction starts from."""
    motion, forces, inputs, filtered, currents = start
    x, past, _, felt, xw, _, _ = outs
    for j in range(hist + 1):
        past[hist - j] = 0.0
        if j < forces.size:
            past[hist - j, 0] = forces[j]
        if j < inputs.shape[0]:
            for m in range(3):
                past[hist - j, 1 + m] = inputs[j, m]
    for m in range(4):
        x[0, m] = motion[m]
    for m in range(filtered.size):
        xw[0, m] = filtered[m]
    felt[0, 0], felt[0, 1] = currents[0], currents[1]


@njit(error_model="numpy", fastmath=True)
def lagged(u, k, lag, felt, rates):
    """Currents in the coil and behind the field's lag at sample k + 1 under a command u; the second."""
    rates[k, 0] = lag[0, 1] if u > felt[k, 0] else lag[0, 0]
    i = u + (felt[k, 0] - u) * rates[k, 0]
    rates[k, 1] = lag[1, 1] if i > felt[k, 1] else lag[1, 0]
    felt[k + 1, 0], felt[k + 1, 1] = i, i + (felt[k, 1] - i) * rates[k, 1]
    return felt[k + 1, 1]


@njit(error_model="numpy", fastmath=True)
def filtered_on(shape, xw, k, a):
    """Weighted acceleration at sample k + 1; takes the filter there."""
    nf = shape.shape[0] - 1
    shown = shape[nf, nf] * a
    for m in range(nf):
        shown += shape[nf, m] * xw[k, m]
        total = shape[m, nf] * a
        for j in range(nf):
            total += shape[m, j] * xw[k, j]
        xw[k + 1, m] = total
    return shown


@njit(error_model="numpy", fastmath=True)
def predict(command, levels, step, car, table, grid, sizes, lag, shape, weights, end, unknown, limits, start, work,
            outs):
    """Cost of (N,) commands, and what `back` needs of the course.

    Parameters
    ----------
    command : (N,) array
        Held from each sample to the next.
    levels : (N + 1,) array
        Elevation at the samples [m].
    step : float
        Between samples [s].
    car : (4, 10) array
        P, R and both W of `IntegratorStages.ramp` side by side (4, 2, 1, 1 columns), then (k, c, m_s) and (k_t, c_t).
    table, grid : (G, 8 + na + 3 nb) array, (2,) array
        Coefficients of law, past forces, past inputs by the lagged current: piecewise linear from grid[0] in steps
        grid[1]. Forces are about that at rest.
    sizes : (2,) int array
        na, nb.
    lag : (2, 2) array
        What a step leaves of the gap between command and current, then between current and the lagged one: falling,
        rising.
    shape : (nf + 1, nf + 1) array
        Weighting filter (A, B; C, D).
    weights : (4,) array
        Of weighted acceleration², tyre force², deflection², and of the power that the damper gives where F v < 0.
    end : (4 + nf, 4 + nf) array
        Cost of what the horizon leaves: z_d, ż_s, z_t, ż_us and the filter's states.
    unknown : (N, G) array
        Further cost by the sample and the lagged current after it, between currents as coefficients are.
    limits : (2,) array
        Of the command.
    start : tuple of arrays
        Motion (4,), forces and inputs so far, the newest first, filter's states, (current, lagged current).
    work, outs : arrays
        Work space, as `improve_all` makes it.

    Returns
    -------
    float
    """
    x, past, slopes, felt, xw, shown, rates = outs
    n, na, nb, nf = command.size, sizes[0], sizes[1], xw.shape[1]
    hist = past.shape[0] - n - 1
    begin(start, outs, hist)
    c = work[:table.shape[1]]
    cost, gz, gv = 0.0, car[0, 7] - car[2, 7], car[1, 7] - car[3, 7]
    for k in range(n):
        q = lagged(min(max(command[k], limits[0]), limits[1]), k, lag, felt, rates)
        cell = read_table(table, grid, q, c)
        cost += unknown[k, cell] + ((q - grid[0]) / grid[1] - cell) * (unknown[k, cell + 1] - unknown[k, cell])
        h, level, rate = hist + k, levels[k], (levels[k + 1] - levels[k]) / step
        f = past[h, 0]
        for m in range(4):
            x[k + 1, m] = (car[m, 0] * x[k, 0] + car[m, 1] * x[k, 1] + car[m, 2] * x[k, 2] + car[m, 3] * x[k, 3]
                           + car[m, 4] * level + car[m, 5] * rate + car[m, 6] * f)
        f, z, v, t, by_z, by_v, bend, slope = solve_force(c, remembered(c, past, h, na, nb), x[k + 1, 0] - x[k + 1, 2],
                                                          x[k + 1, 1] - x[k + 1, 3], gz, gv, f)
        for m in range(4):
            x[k + 1, m] += car[m, 7] * f
        past[h + 1, 0], past[h + 1, 1], past[h + 1, 2], past[h + 1, 3] = f, v, z, t
        slopes[k, 0], slopes[k, 1], slopes[k, 2], slopes[k, 3], slopes[k, 4] = slope, by_z, by_v, bend, cell
        heavy = filtered_on(shape, xw, k, -(car[0, 8] * z + car[1, 8] * v + f) / car[2, 8])
        tyre = car[0, 9] * (x[k + 1, 2] - levels[k + 1]) + car[1, 9] * (x[k + 1, 3] - rate)
        shown[k, 0], shown[k, 1] = heavy, tyre
        cost += weights[0] * heavy * heavy + weights[1] * tyre * tyre + weights[2] * z * z
        if f * v < 0.0:
            cost -= weights[3] * f * v
    e = work[-(4 + nf):]
    e[0], e[1], e[2], e[3] = x[n, 0] - x[n, 2], x[n, 1], x[n, 2] - levels[n], x[n, 3]
    for m in range(nf):
        e[4 + m] = xw[n, m]
    for m in range(4 + nf):
        for j in range(4 + nf):
            cost += e[m] * end[m, j] * e[j]
    return cost


@njit(error_model="numpy", fastmath=True)
def end_back(end, e, xb, wb):
    """Gradients of the cost of what the horizon leaves, by the last state."""
    bars = wb.size + 4
    for m in range(bars):
        total = 0.0
        for j in range(bars):
            total += 2.0 * end[m, j] * e[j]
        if m < 4:
            xb[m] = total
        else:
            wb[m - 4] = total
    xb[2] -= xb[0]


@njit(error_model="numpy", fastmath=True)
def filter_back(shape, wb, kept, shown):
    """Gradient by the acceleration from that by the weighted one, and the filter's adjoint a sample back."""
    nf = wb.size
    by = shape[nf, nf] * shown
    for m in range(nf):
        by += shape[m, nf] * wb[m]
        kept[m] = shape[nf, m] * shown
        for j in range(nf):
            kept[m] += shape[j, m] * wb[j]
    for m in range(nf):
        wb[m] = kept[m]
    return by


@njit(error_model="numpy", fastmath=True)
def current_slope(c, d, past, h, na, nb, bend):
    """Slopes of the force and of the law's shape by the lagged current, at the motion in row h + 1; d those of c."""
    v, z = past[h + 1, 1], past[h + 1, 2]
    arg = d[4] * v + d[5] * z
    if c[6] != 0.0 or d[6] != 0.0:
        w = math.tanh(z / c[7])
        arg += d[6] * w - c[6] * (1.0 - w * w) * z / c[7] ** 2 * d[7]
    found = d[1] * v + d[2] * z + d[3] * past[h + 1, 3] + c[3] * bend * arg + remembered(d, past, h, na, nb)
    return found, bend * arg


@njit(error_model="numpy", fastmath=True)
def memory_back(c, pb, h, na, nb, force):
    """Gradients by past forces and inputs, from that by the force they are in."""
    for j in range(na):
        pb[h - j, 0] -= force * c[8 + j]
    for j in range(nb):
        o = 8 + na + 3 * j
        for m in range(3):
            pb[h - j, 1 + m] += force * c[o + m]


@njit(error_model="numpy", fastmath=True)
def state_back(car, xb):
    """Adjoint of the car's state a sample back; the gradient by the force at that sample."""
    carried = car[0, 6] * xb[0] + car[1, 6] * xb[1] + car[2, 6] * xb[2] + car[3, 6] * xb[3]
    n0 = car[0, 0] * xb[0] + car[1, 0] * xb[1] + car[2, 0] * xb[2] + car[3, 0] * xb[3]
    n1 = car[0, 1] * xb[0] + car[1, 1] * xb[1] + car[2, 1] * xb[2] + car[3, 1] * xb[3]
    n2 = car[0, 2] * xb[0] + car[1, 2] * xb[1] + car[2, 2] * xb[2] + car[3, 2] * xb[3]
    n3 = car[0, 3] * xb[0] + car[1, 3] * xb[1] + car[2, 3] * xb[2] + car[3, 3] * xb[3]
    xb[0], xb[1], xb[2], xb[3] = n0, n1, n2, n3
    return carried


@njit(error_model="numpy", fastmath=True)
def back(car, table, grid, sizes, shape, weights, end, unknown, work, outs, bars, gradient, scale):
    """(N,) gradient by its commands of the cost last predicted, and Σ_j (∂i_j/∂u_k)(∂F_j/∂i_j)², the scale of a step.

    Discrete adjoint of `predict`; it uses up the filter's states.
    """
    _, past, slopes, felt, xw, shown, rates = outs
    xb, pb, wb, d = bars
    n, na, nb = gradient.size, sizes[0], sizes[1]
    hist = past.shape[0] - n - 1
    gz, gv = car[0, 7] - car[2, 7], car[1, 7] - car[3, 7]
    c = work[:table.shape[1]]
    pb[:] = 0.0
    end_back(end, work[-(4 + wb.size):], xb, wb)
    ib = qb = i2 = q2 = 0.0
    for k in range(n - 1, -1, -1):
        h, cell = hist + k, int(slopes[k, 4])
        read_table(table, grid, felt[k + 1, 1], c)
        for m in range(c.size):
            d[m] = (table[cell + 1, m] - table[cell, m]) / grid[1]
        f, v, z = past[h + 1, 0], past[h + 1, 1], past[h + 1, 2]
        by_z, by_v = slopes[k, 1], slopes[k, 2]
        xb[2] += 2.0 * weights[1] * shown[k, 1] * car[0, 9]
        xb[3] += 2.0 * weights[1] * shown[k, 1] * car[1, 9]
        force = -filter_back(shape, wb, xw[k], 2.0 * weights[0] * shown[k, 0]) / car[2, 8]
        zt = pb[h + 1, 2] + pb[h + 1, 3] * by_z + 2.0 * weights[2] * z + force * car[0, 8]
        vt = pb[h + 1, 1] + pb[h + 1, 3] * by_v + force * car[1, 8]
        if f * v < 0.0:
            vt -= weights[3] * f
            force -= weights[3] * v
        total = pb[h + 1, 0] + force + gz * zt + gv * vt
        for m in range(4):
            total += car[m, 7] * xb[m]
        one = total / slopes[k, 0]
        zt += one * (c[2] + c[3] * by_z)
        vt += one * (c[1] + c[3] * by_v)
        xb[0], xb[1], xb[2], xb[3] = xb[0] + zt, xb[1] + vt, xb[2] - zt, xb[3] - vt
        by_q, bent_q = current_slope(c, d, past, h, na, nb, slopes[k, 3])
        memory_back(c, pb, h, na, nb, one)
        qb += one * by_q + pb[h + 1, 3] * bent_q + (unknown[k, cell + 1] - unknown[k, cell]) / grid[1]
        q2 += by_q * by_q
        pb[h, 0] += state_back(car, xb)
        left, left2 = rates[k, 0], rates[k, 1]
        ib, i2 = ib + qb * (1.0 - left2), i2 + q2 * (1.0 - left2)
        qb, q2 = qb * left2, q2 * left2
        gradient[k], scale[k] = ib * (1.0 - left), i2 * (1.0 - left)
        ib, i2 = ib * left, i2 * left
