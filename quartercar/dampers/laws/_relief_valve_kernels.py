"""The relief-valve damper in scaled form: its hydraulic laws and its settled state.

Scaled states: lifts s = x_V/X_CRIT and their rates r [1/s] of valve 1 and 2, hydraulic force F = A_P Δp [N]:

    Ḟ   = k_h(y) {v − R(F) [1/√a_O + e(s_1) + e(s_2)]},     R(F) = F/(F² + δ²)^{1/4}
    s̈_j = ω² {max(σ_j F, 0) u(s_j)/F_c − 1 − s_j} − 2ζω ṡ_j,   s_j ≥ 0,   σ = ±1

with w = γX s²/(1 + γX s), e = w/√(a_V + a_S w²), u = (1 − J w) a_V/(a_V + a_S w²). Decisions follow real parts, so
that every kernel also runs with complex parameters.

A law is the tuple (k_h, a_O, F_c, a_V, ω, ζ, a_S); a shape the tuple (γX, J, s_max, δ/F_c, 1/l_1, 1/l_2) of floats.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit


@njit(error_model="numpy")
def inverse(x):
    """1/x to first order in the imaginary part, which is what a complex step reads: a third of a complex division's
    time; exact for a real x."""
    whole = 1.0 / x.real
    return whole - (x - x.real) * (whole * whole)


@njit(error_model="numpy")
def square_root(x):
    """√x for a positive real part, to first order in the imaginary part, as `inverse`."""
    whole = math.sqrt(x.real)
    return whole + (x - x.real) * (0.5 / whole)


@njit(error_model="numpy")
def passage(lift, law, shape):
    """(e, de/ds, u, du/ds): flow coefficient of a by-pass [m/(s·√N)] and push on its poppet per unit of F/F_c."""
    a_v, a_s, rise, jet = law[3], law[6], shape[0], shape[1]
    zero = 0.0 * lift + 0.0 * a_v
    one = zero + 1.0
    if lift.real <= 0.0:
        return zero, zero, one, zero
    grown = inverse(1.0 + rise * lift)
    w = rise * lift * lift * grown
    slope = rise * lift * (2.0 + rise * lift) * grown * grown
    root = inverse(square_root(a_v + a_s * w * w))
    share = a_v * root * root
    bore = 1.0 - jet * w
    return w * root, slope * share * root, bore * share, -slope * share * (jet + 2.0 * a_s * w * bore * root * root)


@njit(error_model="numpy")
def root_of(force, law, shape):
    """(R, dR/dF): the regularised signed square root of the hydraulic force."""
    delta = shape[3] * law[2]
    square = force * force + delta * delta
    fourth = inverse(square_root(square_root(square)))
    whole = fourth * fourth
    return force * fourth, (0.5 * force * force + delta * delta) * (whole * whole * fourth)


@njit(error_model="numpy")
def settled_lift(force, law, shape):
    """Lift at which the poppet on the side of `force` ≥ 0 rests: F u(s) = F_c (1 + s), or its stop."""
    zero = 0.0 * force + 0.0 * law[2]
    if force.real <= law[2].real:
        return zero
    low, high = 0.0, 1.0
    while high < shape[2] and high < 1e6:
        push = passage(zero + high, law, shape)[2]
        if (force * push - law[2] * (1.0 + high)).real < 0.0:
            break
        low, high = high, 2.0 * high
    high = min(high, shape[2])
    if (force * passage(zero + high, law, shape)[2] - law[2] * (1.0 + high)).real >= 0.0:
        return zero + high
    for _ in range(40):
        middle = 0.5 * (low + high)
        if (force * passage(zero + middle, law, shape)[2] - law[2] * (1.0 + middle)).real > 0.0:
            low = middle
        else:
            high = middle
    lift = zero + 0.5 * (low + high)
    for _ in range(3):  # Newton: to round-off, in the imaginary part too
        push, bend = passage(lift, law, shape)[2:]
        lift = lift - (force * push - law[2] * (1.0 + lift)) / (force * bend - law[2])
    return lift


@njit(error_model="numpy")
def settled_speed(force, law, shape):
    """Velocity that a constant hydraulic force ≥ 0 settles at (β = 0): v = R(F)[1/√a_O + e(s(F))]."""
    lift = settled_lift(force, law, shape)
    return root_of(force, law, shape)[0] * (1.0 / np.sqrt(law[1]) + passage(lift, law, shape)[0])


@njit(error_model="numpy")
def settled_branches(forces, law, shape):
    """R(F) and e(s(F))·R(F) at hydraulic forces ≥ 0: main orifice per 1/√a_O, and by-pass flow [m/s]."""
    out = np.empty((forces.size, 2))
    for k in range(forces.size):
        out[k, 0] = root_of(forces[k], law, shape)[0]
        out[k, 1] = out[k, 0] * passage(settled_lift(forces[k], law, shape), law, shape)[0]
    return out


@njit(error_model="numpy")
def settled_force(speed, law, shape):
    """Hydraulic force at a constant velocity [N], the odd inverse of `settled_speed`; bisection in its logarithm."""
    size = abs(speed.real)
    zero = 0.0 * speed + 0.0 * law[1]
    if size == 0.0:
        return zero
    low, high = -60.0, math.log(2.0 * law[1].real * size * size + 10.0 * shape[3] * law[2].real)
    for _ in range(60):
        middle = 0.5 * (low + high)
        if settled_speed(zero + math.exp(middle), law, shape).real < size:
            low = middle
        else:
            high = middle
    force = zero + math.exp(0.5 * (low + high))
    for _ in range(2):  # secant with a real slope: exact in the imaginary part after the first
        step = 1e-6 * force.real
        slope = (settled_speed(force + step, law, shape) - settled_speed(force - step, law, shape)).real / (2.0 * step)
        force = force + (size - settled_speed(force, law, shape)) / slope
    return force if speed.real > 0 else -force


@njit(error_model="numpy")
def settled_forces(speeds, law, shape):
    """`settled_force` of an array of velocities, for real parameters."""
    out = np.empty(speeds.size)
    for k in range(speeds.size):
        out[k] = settled_force(speeds[k], law, shape)
    return out
