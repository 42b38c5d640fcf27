"""Compiled integrator of the rig's damper: arrays only, no checks. Import it inside the function that simulates.

The series element (deflection d between the rig's end and the fluid) obeys ḋ = v − w with d = D(F), F = F_s(w). Both
functions rise monotonically, so each stage of the L-stable two-stage SDIRK rule (Alexander 1977) is one scalar equation
D(F_s(w)) + γΔt·w = R with exactly one root between 0 and R/(γΔt): Newton's method inside that bracket. A rigid damper
(D = 0) is the same equation without a special case. A step is divided where k/c beyond the yield is fast against it.
"""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit

GAMMA = 1.0 - math.sqrt(0.5)
LAYOUT = 3881273693
"""Checksum of the field names of `Physics`. numba's cache looks at this file's time stamp only: a change of the
fields changes this number (a test checks it), and with it what is cached."""


@njit()
def integrate(x, v, command, physics, dt, every, total_force, states):
    """March the damper over displacement x, velocity v and driver current (n,) each.

    `total_force` (n,) becomes the force of all but fixture and fixture dynamics; of each `every`-th step, rows of
    `states` (5, n / every rounded up) become the force of the series element, effective current, temperature rise,
    speed of the fluid, deflection of the series element.
    """
    p = physics
    driver = magnet = coil = late = flux = command[0]
    temperature = void = deflection = 0.0
    valve = np.zeros(3)
    mode = np.zeros(3)
    w, moved, force, gain, last = v[0], 0.0, 0.0, _yield_force(flux, p), flux
    parts = _parts(p, dt)
    step = dt / parts
    h = GAMMA * step
    for k in range(x.size):
        driver = command[k]
        if magnet != driver:
            magnet = _lag(magnet, driver, p.rise_time, p.fall_time, dt)
        coil = _lag(coil, magnet, p.coil_time, p.coil_time, dt)
        late = _lag(late, coil, p.extra_rise_time, p.extra_fall_time, dt)
        flux = min(max(flux, late - p.remanence), late + p.remanence)
        fade = max(1.0 - p.thermal_fade * temperature, 0.05)
        if p.hidden_gain != 0.0:
            fade *= 1.0 + p.hidden_gain * math.sin(2.0 * math.pi * k * dt / p.hidden_period)
        c = p.viscous + p.viscous_per_current * max(flux, 0.0)
        if p.viscous_fade != 0.0:
            c *= math.exp(-p.viscous_fade * temperature)
        old_gain = gain
        if flux != last:
            gain, last = _yield_force(flux, p), flux
        before = v[k - 1] if k > 0 else v[0]
        for part in range(parts):
            v_old = before + (v[k] - before) * part / parts
            v_new = before + (v[k] - before) * (part + 1) / parts
            gain_new = old_gain + (gain - old_gain) * (part + 1) / parts
            gain_stage = gain_new - (1.0 - GAMMA) * (gain - old_gain) / parts
            v_stage = v_old + GAMMA * (v_new - v_old)
            floor = -1e300 if p.cavitation_force > 1e299 else -p.cavitation_force
            w_stage, _ = _stage(deflection + h * v_stage, h, w + GAMMA * moved, c, gain_stage, fade, floor, void, p)
            reached = deflection + (1.0 - GAMMA) * step * (v_stage - w_stage) + h * v_new
            w_old = w
            w, force = _stage(reached, h, w_stage + (1.0 - GAMMA) * moved, c, gain_new, fade, floor, void, p)
            moved = w - w_old
            deflection = _deflection(force, p)[0]
            if floor > -1e299:
                void = _next_void(void, force, w, c, gain_new, fade, floor, step, p)
        total = force + _parallel(x[k], v[k], p)
        if p.valve_share != 0.0:
            hydraulic = fade * _side(w, p) * _hydraulic(abs(w), c, p)[0] * math.copysign(1.0, w)
            total += p.valve_share * (_oscillator(valve, hydraulic, p.valve_frequency, p.valve_damping, dt) - hydraulic)
        if p.mode_share != 0.0:
            total += p.mode_share * (_oscillator(mode, force, p.mode_frequency, p.mode_damping, dt) - force)
        temperature += dt * (max(total * v[k], 0.0) - p.heat_loss * temperature) / p.heat_capacity
        total_force[k] = total
        if k % every == 0:
            at = k // every
            states[0, at] = force
            states[1, at] = flux
            states[2, at] = temperature
            states[3, at] = w
            states[4, at] = deflection


@njit()
def _parts(p, dt):
    """Substeps of a step: enough that k/c beyond the yield stays below 1/(2 substep), at most 8."""
    softest = p.viscous * p.relief_slope * p.compliance
    if p.compliance == 0.0:
        return 1
    return 8 if softest <= 0.25 * dt else max(1, math.ceil(2.0 * dt / softest))


@njit()
def second_order(signal, frequency, damping, dt, out):
    """ω²/(s² + 2ζωs + ω²) by the trapezoidal rule, started at rest on the first sample."""
    state = np.array([signal[0], 0.0, signal[0]])
    for k in range(signal.size):
        out[k] = _oscillator(state, signal[k], frequency, damping, dt)


@njit()
def _oscillator(state, target, frequency, damping, dt):
    """One trapezoidal step of q̈ + 2ζω q̇ + ω² q = ω² target.

    The state holds q, q̇ and the last target, from which the input runs in a straight line: held over the step, it would
    act half a step early.
    """
    omega = 2.0 * math.pi * frequency
    h = 0.5 * dt
    q, rate = state[0], state[1]
    acceleration = omega * omega * (0.5 * (state[2] + target) - q) - 2.0 * damping * omega * rate
    new_rate = rate + dt * (acceleration - h * omega * omega * rate) / (
        1.0 + 2.0 * damping * omega * h + h * h * omega * omega)
    state[0] = q + h * (rate + new_rate)
    state[1] = new_rate
    state[2] = target
    return state[0]


@njit()
def _lag(state, target, rise, fall, dt):
    """Exact first-order step towards a held target, with a time constant for each direction."""
    tau = rise if target > state else fall
    if tau <= 0.0:
        return target
    return target + (state - target) * math.exp(-dt / tau)


@njit()
def _yield_force(current, p):
    i = max(current, 0.0)
    if p.current_limit > 0.0:
        i = math.tanh(i * p.current_limit) / p.current_limit
    ratio = i / p.current_range
    share = math.tanh(i * p.yield_saturation) / p.yield_saturation if p.yield_saturation > 0.0 else i
    force = p.yield_base + p.yield_per_current * share
    force += p.yield_square * (ratio * ratio - ratio) + p.yield_cube * (ratio * ratio * ratio - ratio)
    return max(force, 0.0)


@njit()
def _hydraulic(s, c, p):
    """Hydraulic force and slope at fluid speed s ≥ 0."""
    if p.exponent == 1.0:
        force, slope = c * s, c
    else:
        ratio = (s + 1e-9) / p.exponent_speed
        slope = p.exponent * c * ratio ** (p.exponent - 1.0)
        force = c * s * ratio ** (p.exponent - 1.0)
    if p.parallel_share > 0.0:
        a = 1.0 / math.sqrt(p.parallel_quadratic)
        root = math.sqrt(a * a + 4.0 * s / p.parallel_viscous)
        half = 2.0 * s / (a + root)
        force += p.parallel_share * (half * half - force)
        slope += p.parallel_share * (2.0 * half / root - slope)
    force += p.quadratic * s * s
    slope += 2.0 * p.quadratic * s
    if p.relief_slope != 1.0 and force > p.relief_force:
        force = p.relief_force + p.relief_slope * (force - p.relief_force)
        slope *= p.relief_slope
    if s > p.orifice_speed:
        force += p.orifice * (s - p.orifice_speed) ** 2
        slope += 2.0 * p.orifice * (s - p.orifice_speed)
    return force, slope


@njit()
def _tanh(x):
    """tanh x = (1 − e)/(1 + e), e = exp(−2|x|), with the sign of x: within 2e-16, in half the time of the library's."""
    e = math.exp(-2.0 * abs(x))
    return math.copysign((1.0 - e) / (1.0 + e), x)


@njit()
def _side(w, p):
    return p.asymmetry if w > 0.0 else 1.0


@njit()
def _static(w, c, gain, fade, p):
    """Force and slope of hydraulics and yield at fluid speed w."""
    scale = fade * _side(w, p)
    force, slope = _hydraulic(abs(w), c, p)
    t = _tanh(w / p.yield_speed)
    signed = force if w >= 0.0 else -force
    return scale * (signed + gain * t), scale * (slope + gain * (1.0 - t * t) / p.yield_speed)


@njit()
def _deflection(force, p):
    """Series deflection and its slope: compliance, compressed air, backlash taken up within 5 N."""
    d, slope = p.compliance * force, p.compliance
    if p.air_stroke > 0.0:
        ratio = 1.0 + abs(force) / p.air_force
        power = ratio ** (-1.0 / 1.3)
        d += math.copysign(p.air_stroke * (1.0 - power), force)
        slope += p.air_stroke * power / (1.3 * ratio * p.air_force)
    if p.backlash > 0.0:
        t = math.tanh(force / 5.0)
        d += 0.5 * p.backlash * t
        slope += 0.1 * p.backlash * (1.0 - t * t)
    return d, slope


@njit()
def _stage(target, h, guess, c, gain, fade, floor, void, p):
    """Root w of D(max(F_s(w), floor)) + h w = target, and the force there; an open void holds the force at `floor`."""
    if void > 0.0:
        return (target - _deflection(floor, p)[0]) / h, floor
    low, high = min(target / h, 0.0), max(target / h, 0.0)
    w = min(max(guess, low), high)
    force = 0.0
    for _ in range(100):
        force, slope = _static(w, c, gain, fade, p)
        if force < floor:
            force, slope = floor, 0.0
        d, d_slope = _deflection(force, p)
        gap = d + h * w - target
        step = gap / (d_slope * slope + h)
        if abs(step) <= 1e-13 + 1e-11 * abs(w):  # before the bracket: a step of rounding leaves it, which is no miss
            return w - step, max(force - slope * step, floor)
        if gap > 0.0:
            high = w
        else:
            low = w
        new = w - step
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - w) <= 1e-13 + 1e-11 * abs(w):
            w = new
            break
        w = new
    force = max(_static(w, c, gain, fade, p)[0], floor)
    return w, force


@njit()
def _next_void(void, force, w, c, gain, fade, floor, dt, p):
    """Stroke of vapour [m]: grows by what the fluid at the broken pressure cannot fill, shrinks by what it can."""
    if void == 0.0 and force > floor:
        return 0.0
    low, high = -1.0, 0.0
    while _static(low, c, gain, fade, p)[0] > floor and low > -1e6:
        low *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _static(middle, c, gain, fade, p)[0] > floor:
            high = middle
        else:
            low = middle
    return max(void + dt * (0.5 * (low + high) - w), 0.0)


@njit()
def _parallel(x, v, p):
    """Friction, gas and end stops."""
    force = 0.0
    if p.friction != 0.0 or p.stiction != 0.0:
        level = p.friction
        if p.stiction != 0.0:
            ratio = v / p.stiction_speed
            level += p.stiction * math.exp(-ratio * ratio)
        force += level * _tanh(v / p.friction_speed)
    if p.gas_preload > 0.0:
        force -= p.gas_preload * max(1.0 + p.gas_stiffness * x / (1.3 * p.gas_preload), 1e-3) ** -1.3
    else:
        force += p.gas_stiffness * x
    over = abs(x) - p.stop_position
    if over > 0.0:
        force += math.copysign(p.stop_stiffness * over, x)
    return force
