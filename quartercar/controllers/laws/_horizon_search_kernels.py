"""Compiled search for the commands of least cost over a short horizon, for many cars; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import copy_values, njit
from quartercar.controllers.laws._horizon_kernels import back, bent, filtered_on, predict, read_table, remembered

FLOOR = 0.02
"""of the scale of a step, as a share of its mean over the horizon: where the current moves no force, no step is taken
that is more than 50 times the usual one. Between 0.005 and 0.1 the cost after six iterations moves by less than 1 %"""
GROWTH, SHRINK = 1.3, 0.5
"""of the step length after an iteration that lowered the cost, and after one that did not"""

SAME = 1e-6
"""relative rise of the cost that is the rounding of its forces, `CLOSE`, and ends the iterations"""


@njit(error_model="numpy", fastmath=True)
def improve(command, levels, length, rounds, step, car, table, grid, sizes, lag, shape, weights, end, unknown, limits,
            start, work, outs, bars, space):
    """Lower the cost of (N,) commands in place by accelerated projected gradient; the cost reached.

    Nesterov (1983) with restart where the cost rises (O'Donoghue, Candes 2015, Found. Comput. Math. 15, 715-732), in
    the scale of the force that each command moves; length: (1,) step length, kept from call to call. The start is the
    command given or the lowest one throughout, whichever costs less: a damper that is stiff enough to stand still has
    no gradient towards a soft one, and what begins there would stay.
    """
    n = command.size
    trial, before, best, slope, scale, kept, sized = space
    for k in range(n):
        trial[k] = before[k] = best[k] = min(max(command[k], limits[0]), limits[1])
    for k in range(n):
        slope[k] = limits[0]
    passive = predict(slope, levels, step, car, table, grid, sizes, lag, shape, weights, end, unknown, limits, start,
                      work, outs)
    least, momentum, beta = math.inf, 1.0, 0.0
    for r in range(rounds):
        cost = predict(trial, levels, step, car, table, grid, sizes, lag, shape, weights, end, unknown, limits, start,
                       work, outs)
        if r == 0 and passive < cost:
            for k in range(n):
                trial[k] = before[k] = limits[0]
            cost = predict(trial, levels, step, car, table, grid, sizes, lag, shape, weights, end, unknown, limits,
                           start, work, outs)
        if cost <= least:
            back(car, table, grid, sizes, shape, weights, end, unknown, work, outs, bars, slope, scale)
            mean = 0.0
            for k in range(n):
                mean += scale[k]
            mean *= FLOOR / n
            least = cost
            for k in range(n):
                best[k], kept[k], sized[k] = trial[k], slope[k], scale[k] + mean
            if momentum > 1.0 and beta == 0.0:
                length[0] *= GROWTH
            grown = 0.5 * (1.0 + math.sqrt(1.0 + 4.0 * momentum * momentum))
            beta, momentum = (momentum - 1.0) / grown, grown
        elif beta == 0.0 and cost <= least * (1.0 + SAME):
            break
        else:
            if beta == 0.0:
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
                unknown, limits, motion, forces, inputs, filtered, currents):
    """`improve` for every car, in place; levels (cars, N + 1), weights (cars, 4), ends (cars, 4 + nf, 4 + nf),
    unknown (cars, N, G).
    """
    n, nf = commands.shape[1], filtered.shape[1]
    hist = max(max(sizes[0], sizes[1]) - 1, 0)
    work = np.empty(table.shape[1] + 4 + nf)
    outs = (np.empty((n + 1, 4)), np.empty((n + 1 + hist, 4)), np.empty((n, 5)), np.empty((n + 1, 2)),
            np.empty((n + 1, nf)), np.empty((n, 2)), np.empty((n, 2)))
    bars = np.empty(4), np.empty((n + 1 + hist, 4)), np.empty(nf), np.empty(table.shape[1])
    space = (np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    for c in range(commands.shape[0]):
        start = motion[c], forces[c], inputs[c], filtered[c], currents[c]
        costs[c] = improve(commands[c], levels[c], lengths[c:c + 1], rounds, step, car, table, grid, sizes, lag, shape,
                           weights[c], ends[c], unknown[c], limits, start, work, outs, bars, space)


@njit(error_model="numpy")
def note_all(z, v, felt, car, table, grid, sizes, shape, forces, inputs, filtered):
    """Every car's damper and weighting filter at a new sample, in place: forces and inputs the newest first."""
    na, nb = sizes[0], sizes[1]
    width = max(forces.shape[1], inputs.shape[1])
    c, past, xw = np.empty(table.shape[1]), np.zeros((width, 4)), np.empty((2, filtered.shape[1]))
    for i in range(z.size):
        read_table(table, grid, felt[i], c)
        for j in range(forces.shape[1]):
            past[width - 1 - j, 0] = forces[i, j]
        for j in range(inputs.shape[1]):
            copy_values(inputs[i, j], past[width - 1 - j, 1:])
        t = bent(c, z[i], v[i])[0]
        f = remembered(c, past, width - 1, na, nb) + c[1] * v[i] + c[2] * z[i] + c[3] * t
        for j in range(forces.shape[1] - 1, 0, -1):
            forces[i, j] = forces[i, j - 1]
        for j in range(inputs.shape[1] - 1, 0, -1):
            copy_values(inputs[i, j - 1], inputs[i, j])
        forces[i, 0], inputs[i, 0, 0], inputs[i, 0, 1], inputs[i, 0, 2] = f, v[i], z[i], t
        copy_values(filtered[i], xw[0])
        filtered_on(shape, xw, 0, -(car[0, 8] * z[i] + car[1, 8] * v[i] + f) / car[2, 8])
        copy_values(xw[1], filtered[i])
