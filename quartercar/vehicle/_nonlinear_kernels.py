"""Compiled quarter car around a law of velocity and displacement; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit

ITERATIONS = 100
"""most evaluations of the law in one stage; two or three are usual"""
CLOSE = 1e-9
"""relative and absolute [N] error of the force at which a stage ends"""


@njit()
def law_slopes(z, v, c, stop):
    """Law without stops, its slopes by z and v, tanh of its shape, force and slope of the stops; c as in `law`."""
    shape, by_z = c[4] * v + c[5] * z, c[5]
    if c[6] != 0.0:
        t = math.tanh(z / c[7])
        shape += c[6] * t
        by_z += c[6] * (1.0 - t * t) / c[7]
    s = math.tanh(shape)
    steep = c[3] * (1.0 - s * s)
    bump, hard = 0.0, 0.0
    if z > stop[2]:
        bump, hard = stop[0] * (z - stop[2]), stop[0]
    elif z < -stop[1]:
        bump, hard = stop[0] * (z + stop[1]), stop[0]
    return (c[0] + c[1] * v + c[2] * z + c[3] * s, c[2] + steep * by_z, c[1] + steep * c[4], s, bump, hard)


@njit()
def law(z, v, c, stop):
    """Force of the law and the stops at deflection z and rate v.

    c: (8,) of a_0 + a_1 v + a_2 z + a_3 tanh(a_4 v + a_5 z + a_6 tanh(z/a_7)); stop: stiffness, room in compression,
    room in rebound.
    """
    force, _, _, _, bump, _ = law_slopes(z, v, c, stop)
    return force + bump


@njit()
def lost(base, weight, level, rate, f, tyre):
    """g ≤ 0 by which the tyre's force falls short of its linear law, so that it never pulls more than the load.

    The linear law at a stage's end is a + w f + b g with b > −1; g = min(0, (load − a − w f)/(1 + b)).
    """
    linear = tyre[0] * (base[2] + weight[2, 0] * f - level) + tyre[1] * (base[3] + weight[3, 0] * f - rate)
    short = (tyre[2] - linear) / (1.0 + tyre[0] * weight[2, 1] + tyre[1] * weight[3, 1])
    return min(0.0, short)


@njit()
def closed(base, weight, level, rate, f, tyre, coefficients, stop):
    """The law's force for a trial force f of the strut, and the tyre's g."""
    g = lost(base, weight, level, rate, f, tyre)
    z = base[0] - base[2] + (weight[0, 0] - weight[2, 0]) * f + (weight[0, 1] - weight[2, 1]) * g
    v = base[1] - base[3] + (weight[1, 0] - weight[3, 0]) * f + (weight[1, 1] - weight[3, 1]) * g
    return law(z, v, coefficients, stop), g


@njit()
def settle(base, weight, level, rate, f, slope, tyre, coefficients, stop):
    """f = law(f) by secant steps inside the bracket that the residual's sign builds; (f, g, slope)."""
    low, high = -math.inf, math.inf
    y, g = closed(base, weight, level, rate, f, tyre, coefficients, stop)
    for count in range(ITERATIONS):
        r = f - y
        if abs(r) <= CLOSE * (1.0 + abs(f)):
            break
        if r > 0.0:
            high = f
        else:
            low = f
        if high - low <= CLOSE * (1.0 + abs(f)):
            break
        new = f - r / (1.0 - slope)
        if not low < new < high:
            new = 0.5 * (low + high) if high - low < math.inf else y
        elif count % 3 == 2 and high - low < math.inf:
            new = 0.5 * (low + high)
        ahead, g = closed(base, weight, level, rate, new, tyre, coefficients, stop)
        if new != f:
            slope = min((ahead - y) / (new - f), 0.9)
        f, y = new, ahead
    return f, g, slope


@njit()
def advance(ends, state, road_in, force_in, profile, step, coefficients, stop, tyre, x, held, out):
    """Advance the car along a road that is linear between samples.

    Parameters
    ----------
    ends, state, road_in, force_in : arrays
        As in `IntegratorStages`.
    profile : (n + 1,) array
        Elevation at the samples, the present one first.
    step : float
        Of the integration; a whole number fit between two samples [s].
    coefficients : (n, steps per sample, S, 8) array
        Of `law`.
    stop, tyre : (3,) arrays
        As in `law`; k_t, c_t, load.
    x : (4,) array
        State, in place.
    held : (3,) array
        f and g at the last step's end, slope of the law; in place.
    out : (n, 6) array
        State, f and g at the samples 1 … n.
    """
    stages, parts = ends.size, coefficients.shape[1]
    base, kept = np.empty(4), np.empty((stages + 1, 2))
    end = np.empty(4)
    for k in range(out.shape[0]):
        rate = (profile[k + 1] - profile[k]) / (parts * step)
        for part in range(parts):
            start = profile[k] + part * step * rate
            kept[0, 0], kept[0, 1] = held[0], held[1]
            for j in range(stages):
                for i in range(4):
                    total = road_in[j, i, 0] * start + road_in[j, i, 1] * rate
                    for m in range(4):
                        total += state[j, i, m] * x[m]
                    for m in range(j + 1):
                        total += force_in[j, m, i, 0] * kept[m, 0] + force_in[j, m, i, 1] * kept[m, 1]
                    base[i] = total
                weight = force_in[j, j + 1]
                f, g, held[2] = settle(base, weight, start + ends[j] * step * rate, rate, kept[j, 0], held[2], tyre,
                                       coefficients[k, part, j], stop)
                kept[j + 1, 0], kept[j + 1, 1] = f, g
                for i in range(4):
                    end[i] = base[i] + weight[i, 0] * f + weight[i, 1] * g
            for i in range(4):
                x[i] = end[i]
            held[0], held[1] = kept[stages, 0], kept[stages, 1]
        for i in range(4):
            out[k, i] = x[i]
        out[k, 4], out[k, 5] = held[0], held[1]


@njit()
def advance_all(ends, state, road_in, force_in, here, there, step, coefficients, stop, tyre, x, held):
    """Every car to its next sample, in place: x (cars, 4), held (cars, 3); roads (cars,) at both ends of the sample.

    coefficients: (cars, steps per sample, S, 8); the rest as in `_nonlinear_car_kernels.advance`.
    """
    profile, out = np.empty(2), np.empty((1, 6))
    for car in range(x.shape[0]):
        profile[0], profile[1] = here[car], there[car]
        advance(ends, state, road_in, force_in, profile, step, coefficients[car:car + 1], stop, tyre, x[car],
                held[car], out)
