"""Compiled prediction of a quarter car over a short horizon, its cost, exact gradient and minimisation; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid._compiling import njit

NEWTON = 12
"""most Newton steps of one force; one or two are usual from the force before"""
CLOSE = 1e-6
"""relative and absolute [N] residual of a force at which its steps end"""
FLOOR = 0.02
"""of the scale of a step, as a share of its mean over the horizon: where the current moves no force, no step is taken
that is more than 50 times the usual one. Between 0.005 and 0.1 the cost after six iterations moves by less than 1 %"""
GROWTH, SHRINK = 1.3, 0.5
"""of the step length after an iteration that lowered the cost, and after one that did not"""

SAME = 1e-6
"""relative rise of the cost that is the rounding of its forces, `CLOSE`, and ends the iterations"""


@njit(error_model="numpy", fastmath=True)
def predict(command, levels, step, car, table, grid, sizes, lag, shape, weights, end, limits, start, work, outs):
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
        P, R and both W of `car_steps.Stages.ramp` side by side: 4, 2 and 2 columns; then, in rows, what `outputs` reads.
    table, grid : (G, 8 + na + 3 nb) array, (2,) array
        Coefficients of law, past forces, past inputs by the current felt: piecewise linear from grid[0] in steps
        grid[1]. The law's first coefficient is less the force at rest plus what the past forces have in rest.
    sizes : (2,) int array
        na, nb.
    lag : (2, 2) array
        What is left after a step of the gap between command and current, then between current and the one felt; falling,
        rising.
    shape : (nf + 1, nf + 1) array
        Weighting filter (A, B; C, D).
    weights : (4,) array
        Of weighted acceleration², tyre force², deflection², and of the power that the damper gives where F v < 0.
    end : (4 + nf, 4 + nf) array
        Cost of what the horizon leaves: z_d, ż_s, z_t, ż_us and the filter's states.
    start : arrays
        (motion (4,), forces (na+1,), inputs (nb+1, 3), filter's states (nf,), (current, felt) (2,)).
    work, outs : arrays
        Work space, see `work_space`.

    Returns
    -------
    float
    """
    motion, forces, inputs, filtered, currents = start
    x, past, slopes, felt, xw, shown, rates = outs
    n, na, nb, nf = command.size, sizes[0], sizes[1], filtered.size
    hist = past.shape[0] - n - 1
    for j in range(hist + 1):
        for m in range(4):
            past[hist - j, m] = 0.0
        if j < forces.size:
            past[hist - j, 0] = forces[j]
        if j < inputs.shape[0]:
            for m in range(3):
                past[hist - j, 1 + m] = inputs[j, m]
    for m in range(4):
        x[0, m] = motion[m]
    for m in range(nf):
        xw[0, m] = filtered[m]
    felt[0, 0], felt[0, 1] = currents[0], currents[1]
    cost = 0.0
    last = table.shape[0] - 2
    gz, gv = car[0, 7] - car[2, 7], car[1, 7] - car[3, 7]
    for k in range(n):
        u = min(max(command[k], limits[0]), limits[1])
        left = lag[0, 1] if u > felt[k, 0] else lag[0, 0]
        i = u + (felt[k, 0] - u) * left
        left2 = lag[1, 1] if i > felt[k, 1] else lag[1, 0]
        q = i + (felt[k, 1] - i) * left2
        felt[k + 1, 0], felt[k + 1, 1] = i, q
        rates[k, 0], rates[k, 1] = left, left2
        place = (q - grid[0]) / grid[1]
        cell = min(max(int(math.floor(place)), 0), last)
        s = place - cell
        c = work
        for m in range(table.shape[1]):
            c[m] = table[cell, m] + s * (table[cell + 1, m] - table[cell, m])
        memory = c[0]
        h = hist + k
        for j in range(na):
            memory -= c[8 + j] * past[h - j, 0]
        for j in range(nb):
            memory += (c[8 + na + 3 * j] * past[h - j, 1] + c[9 + na + 3 * j] * past[h - j, 2]
                       + c[10 + na + 3 * j] * past[h - j, 3])
        level = levels[k]
        rate = (levels[k + 1] - level) / step
        f0 = past[h, 0]
        for m in range(4):
            x[k + 1, m] = (car[m, 0] * x[k, 0] + car[m, 1] * x[k, 1] + car[m, 2] * x[k, 2] + car[m, 3] * x[k, 3]
                           + car[m, 4] * level + car[m, 5] * rate + car[m, 6] * f0)
        zb, vb = x[k + 1, 0] - x[k + 1, 2], x[k + 1, 1] - x[k + 1, 3]
        f = f0
        z = v = t = by_z = by_v = bend = 0.0
        for _ in range(NEWTON):
            z, v = zb + gz * f, vb + gv * f
            arg, arg_z = c[4] * v + c[5] * z, c[5]
            if c[6] != 0.0:
                w = math.tanh(z / c[7])
                arg += c[6] * w
                arg_z += c[6] * (1.0 - w * w) / c[7]
            t = math.tanh(arg)
            bend = 1.0 - t * t
            by_z, by_v = bend * arg_z, bend * c[4]
            r = f - (memory + c[1] * v + c[2] * z + c[3] * t)
            slope = 1.0 - (c[1] + c[3] * by_v) * gv - (c[2] + c[3] * by_z) * gz
            if abs(r) <= CLOSE * (1.0 + abs(f)):
                break
            f -= r / slope
        slope = 1.0 - (c[1] + c[3] * by_v) * gv - (c[2] + c[3] * by_z) * gz
        for m in range(4):
            x[k + 1, m] += car[m, 7] * f
        past[h + 1, 0], past[h + 1, 1], past[h + 1, 2], past[h + 1, 3] = f, v, z, t
        slopes[k, 0], slopes[k, 1], slopes[k, 2], slopes[k, 3], slopes[k, 4] = slope, by_z, by_v, bend, cell
        a = -(car[0, 8] * z + car[1, 8] * v + f) / car[2, 8]
        tyre = car[0, 9] * (x[k + 1, 2] - levels[k + 1]) + car[1, 9] * (x[k + 1, 3] - rate)
        heavy = shape[nf, nf] * a
        for m in range(nf):
            heavy += shape[nf, m] * xw[k, m]
            total = shape[m, nf] * a
            for j in range(nf):
                total += shape[m, j] * xw[k, j]
            xw[k + 1, m] = total
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
def back(command, car, table, grid, sizes, lag, shape, weights, end, limits, work, outs, bars, gradient, scale):
    """(N,) gradient of the cost last predicted by its commands, and the scale of each command's effect on a force."""
    x, past, slopes, felt, xw, shown, rates = outs
    xb, pb, wb = bars
    n, na, nb, nf = command.size, sizes[0], sizes[1], shape.shape[0] - 1
    hist = past.shape[0] - n - 1
    width = table.shape[1]
    gz, gv = car[0, 7] - car[2, 7], car[1, 7] - car[3, 7]
    pb[:] = 0.0
    e = work[-(4 + nf):]  # as `predict` left it
    for m in range(4 + nf):
        total = 0.0
        for j in range(4 + nf):
            total += 2.0 * end[m, j] * e[j]
        if m == 0:
            xb[0], xb[2] = total, -total
        elif m == 1:
            xb[1] = total
        elif m == 2:
            xb[2] += total
        elif m == 3:
            xb[3] = total
        else:
            wb[m - 4] = total
    c, d = np.empty(width), np.empty(width)
    ib = qb = i2 = q2 = 0.0
    for k in range(n - 1, -1, -1):
        h = hist + k
        cell, q = int(slopes[k, 4]), felt[k + 1, 1]
        s = (q - grid[0]) / grid[1] - cell
        for m in range(width):
            rise = table[cell + 1, m] - table[cell, m]
            c[m] = table[cell, m] + s * rise
            d[m] = rise / grid[1]
        f, v, z, t = past[h + 1, 0], past[h + 1, 1], past[h + 1, 2], past[h + 1, 3]
        slope, by_z, by_v, bend = slopes[k, 0], slopes[k, 1], slopes[k, 2], slopes[k, 3]
        hb, tb = 2.0 * weights[0] * shown[k, 0], 2.0 * weights[1] * shown[k, 1]
        ab = shape[nf, nf] * hb
        for m in range(nf):
            ab += shape[m, nf] * wb[m]
        for m in range(nf):
            total = shape[nf, m] * hb
            for j in range(nf):
                total += shape[j, m] * wb[j]
            xw[k, m] = total  # its value is no longer needed
        for m in range(nf):
            wb[m] = xw[k, m]
        xb[2] += car[0, 9] * tb
        xb[3] += car[1, 9] * tb
        force = -ab / car[2, 8]
        zt = pb[h + 1, 2] + pb[h + 1, 3] * by_z + 2.0 * weights[2] * z + force * car[0, 8]
        vt = pb[h + 1, 1] + pb[h + 1, 3] * by_v + force * car[1, 8]
        if f * v < 0.0:
            vt -= weights[3] * f
            force -= weights[3] * v
        ft = pb[h + 1, 0] + force + gz * zt + gv * vt
        for m in range(4):
            ft += car[m, 7] * xb[m]
        one = ft / slope
        zt += one * (c[2] + c[3] * by_z)
        vt += one * (c[1] + c[3] * by_v)
        xb[0] += zt
        xb[2] -= zt
        xb[1] += vt
        xb[3] -= vt
        arg_q = d[4] * v + d[5] * z
        if c[6] != 0.0 or d[6] != 0.0:
            w = math.tanh(z / c[7])
            arg_q += d[6] * w - c[6] * (1.0 - w * w) * z / c[7] ** 2 * d[7]
        by_q = d[0] + d[1] * v + d[2] * z + d[3] * t + c[3] * bend * arg_q
        for j in range(na):
            by_q -= d[8 + j] * past[h - j, 0]
            pb[h - j, 0] -= one * c[8 + j]
        for j in range(nb):
            o = 8 + na + 3 * j
            for m in range(3):
                by_q += d[o + m] * past[h - j, 1 + m]
                pb[h - j, 1 + m] += one * c[o + m]
        qb += one * by_q + pb[h + 1, 3] * bend * arg_q
        q2 += by_q * by_q
        carried = 0.0
        for m in range(4):
            carried += car[m, 6] * xb[m]
        pb[h, 0] += carried
        n0 = car[0, 0] * xb[0] + car[1, 0] * xb[1] + car[2, 0] * xb[2] + car[3, 0] * xb[3]
        n1 = car[0, 1] * xb[0] + car[1, 1] * xb[1] + car[2, 1] * xb[2] + car[3, 1] * xb[3]
        n2 = car[0, 2] * xb[0] + car[1, 2] * xb[1] + car[2, 2] * xb[2] + car[3, 2] * xb[3]
        n3 = car[0, 3] * xb[0] + car[1, 3] * xb[1] + car[2, 3] * xb[2] + car[3, 3] * xb[3]
        xb[0], xb[1], xb[2], xb[3] = n0, n1, n2, n3
        left, left2 = rates[k, 0], rates[k, 1]
        ib += qb * (1.0 - left2)
        i2 += q2 * (1.0 - left2)
        qb, q2 = qb * left2, q2 * left2
        gradient[k], scale[k] = ib * (1.0 - left), i2 * (1.0 - left)
        ib, i2 = ib * left, i2 * left


@njit(error_model="numpy", fastmath=True)
def improve(command, levels, length, rounds, step, car, table, grid, sizes, lag, shape, weights, end, limits, start,
            work, outs, bars, space):
    """Lower the cost of (N,) commands in place by accelerated projected gradient; the cost reached.

    Nesterov (1983) with restart where the cost rises (O'Donoghue, Candes 2015, Found. Comput. Math. 15, 715-732), in
    the scale of the force that each command moves; length: (1,) step length, kept from call to call.
    """
    n = command.size
    trial, before, best, slope, scale, kept, sized = space
    for k in range(n):
        trial[k] = before[k] = best[k] = min(max(command[k], limits[0]), limits[1])
    least, momentum = math.inf, 1.0
    for _ in range(rounds):
        cost = predict(trial, levels, step, car, table, grid, sizes, lag, shape, weights, end, limits, start, work,
                       outs)
        if cost <= least:
            back(trial, car, table, grid, sizes, lag, shape, weights, end, limits, work, outs, bars, slope, scale)
            mean = 0.0
            for k in range(n):
                mean += scale[k]
            mean *= FLOOR / n
            least = cost
            for k in range(n):
                best[k], kept[k], sized[k] = trial[k], slope[k], scale[k] + mean
            if momentum > 1.0:
                length[0] *= GROWTH
            grown = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
            beta, momentum = (momentum - 1.0) / grown, grown
        elif cost <= least * (1.0 + SAME):
            break
        else:
            length[0] *= SHRINK
            beta, momentum = 0.0, 1.0
            for k in range(n):
                before[k] = best[k]
        for k in range(n):
            moved = best[k] - (length[0] * kept[k] / sized[k] if sized[k] > 0.0 else 0.0)
            moved = min(max(moved, limits[0]), limits[1])
            trial[k] = min(max(moved + beta * (moved - before[k]), limits[0]), limits[1])
            before[k] = moved
    for k in range(n):
        command[k] = best[k]
    return least


@njit(error_model="numpy", fastmath=True)
def improve_all(commands, costs, levels, lengths, rounds, step, car, table, grid, sizes, lag, shape, weights, ends,
                limits, motion, forces, inputs, filtered, currents):
    """`improve` for every car, in place: commands (cars, N); levels (cars, N + 1); weights (cars, 4); ends (cars, …)."""
    n, nf = commands.shape[1], filtered.shape[1]
    hist = max(max(sizes[0], sizes[1]) - 1, 0)
    work = np.empty(table.shape[1] + 4 + nf)
    outs = (np.empty((n + 1, 4)), np.empty((n + 1 + hist, 4)), np.empty((n, 5)), np.empty((n + 1, 2)),
            np.empty((n + 1, nf)), np.empty((n, 2)), np.empty((n, 2)))
    bars = np.empty(4), np.empty((n + 1 + hist, 4)), np.empty(nf)
    space = (np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    for c in range(commands.shape[0]):
        start = motion[c], forces[c], inputs[c], filtered[c], currents[c]
        costs[c] = improve(commands[c], levels[c], lengths[c:c + 1], rounds, step, car, table, grid, sizes, lag, shape,
                           weights[c], ends[c], limits, start, work, outs, bars, space)


@njit(error_model="numpy")
def note_all(z, v, felt, car, table, grid, sizes, shape, forces, inputs, filtered):
    """Every car's damper and weighting filter at a new sample, in place: forces and inputs the newest first."""
    na, nb, nf, last = sizes[0], sizes[1], filtered.shape[1], table.shape[0] - 2
    c, new = np.empty(table.shape[1]), np.empty(nf)
    for i in range(z.size):
        place = (felt[i] - grid[0]) / grid[1]
        cell = min(max(int(math.floor(place)), 0), last)
        for m in range(c.size):
            c[m] = table[cell, m] + (place - cell) * (table[cell + 1, m] - table[cell, m])
        f = c[0]
        for j in range(na):
            f -= c[8 + j] * forces[i, j]
        for j in range(nb):
            for m in range(3):
                f += c[8 + na + 3 * j + m] * inputs[i, j, m]
        arg = c[4] * v[i] + c[5] * z[i]
        if c[6] != 0.0:
            arg += c[6] * math.tanh(z[i] / c[7])
        t = math.tanh(arg)
        f += c[1] * v[i] + c[2] * z[i] + c[3] * t
        for j in range(forces.shape[1] - 1, 0, -1):
            forces[i, j] = forces[i, j - 1]
        for j in range(inputs.shape[1] - 1, 0, -1):
            for m in range(3):
                inputs[i, j, m] = inputs[i, j - 1, m]
        forces[i, 0], inputs[i, 0, 0], inputs[i, 0, 1], inputs[i, 0, 2] = f, v[i], z[i], t
        a = -(car[0, 8] * z[i] + car[1, 8] * v[i] + f) / car[2, 8]
        for m in range(nf):
            new[m] = shape[m, nf] * a
            for j in range(nf):
                new[m] += shape[m, j] * filtered[i, j]
        for m in range(nf):
            filtered[i, m] = new[m]
