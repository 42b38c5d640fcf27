"""Compiled loops of the self-scheduled models: arrays only, no checks (their callers have checked).

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

import numpy as np

from lpvid._compiling import copy_values, njit

# -- quasi-LPV input-output model --------------------------------------------------------------------------------------
# own = 0: hat functions on `knots`; own = 1: powers of the saturated (ρ − knots[0])/knots[1].
# theta (m, e, r): own function, external function, regressor (na own lags, negated; measured ones; the constant).
# ρ(k) = feedback·y(k−1) + kappa·drive(k).


@njit()
def _own_functions(own, knots, rho, value, slope):
    """Values and slopes of the own functions at ρ, clamped; returns the range of places that may be non-zero."""
    m = value.size
    if own == 0:
        last = knots.size - 1
        x = min(max(rho, knots[0]), knots[last])
        s = min(max(np.searchsorted(knots, x, side="right") - 1, 0), last - 1)
        width = knots[s + 1] - knots[s]
        part = (x - knots[s]) / width
        value[s], value[s + 1] = 1.0 - part, part
        steep = 1.0 / width if knots[0] < rho < knots[last] else 0.0
        slope[s], slope[s + 1] = -steep, steep
        return s, s + 2
    z = (rho - knots[0]) / knots[1]
    steep = 1.0 / knots[1] if -1.0 < z < 1.0 else 0.0
    z = min(max(z, -1.0), 1.0)
    value[0], slope[0] = 1.0, 0.0
    for j in range(1, m):
        value[j] = value[j - 1] * z
        slope[j] = j * value[j - 1] * steep
    return 0, m


@njit()
def _step(own, knots, theta, phi, row, rho, value, slope):
    """One sample: Σ_m φ_m(ρ) Σ_e φ_e Σ_r θ row; returns the output and its slope over ρ."""
    low, high = _own_functions(own, knots, rho, value, slope)
    total, steep = 0.0, 0.0
    for m in range(low, high):
        part = 0.0
        for e in range(phi.size):
            inner = 0.0
            for r in range(row.size):
                inner += theta[m, e, r] * row[r]
            part += phi[e] * inner
        total += value[m] * part
        steep += slope[m] * part
    return total, steep


@njit()
def _regressors(rows, drive, kappa, feedback, na, k, outputs, last, row):
    """Fill the regressors of sample k, the own lags from outputs[last] backwards; returns ρ."""
    copy_values(rows[k], row)
    for i in range(na):
        row[i] = -outputs[last - i]
    rho = feedback * outputs[last]
    for j in range(kappa.size):
        rho += kappa[j] * drive[k, j]
    return rho


@njit()
def free_run_quasi(own, knots, theta, kappa, feedback, na, phi, rows, drive, y, begin, limit):
    """Fill y[begin:] in place; rows (n, r) holds the measured regressors, its first na columns are scratch.

    Returns the first sample whose modulus exceeds `limit`, or −1.
    """
    value, slope, row = np.zeros(theta.shape[0]), np.zeros(theta.shape[0]), np.empty(rows.shape[1])
    for k in range(begin, y.size):
        rho = _regressors(rows, drive, kappa, feedback, na, k, y, k - 1, row)
        y[k], _ = _step(own, knots, theta, phi[k], row, rho, value, slope)
        if not abs(y[k]) < limit:
            return k
    return -1


@njit()
def ahead_quasi(own, knots, theta, kappa, feedback, na, phi, rows, drive, y, begin, horizon, out):
    """Predict every sample from measured outputs up to k − horizon; out holds y before `begin`."""
    value, slope, row = np.zeros(theta.shape[0]), np.zeros(theta.shape[0]), np.empty(rows.shape[1])
    back = max(na, 1)
    past = np.zeros(back + horizon)
    for k in range(begin, y.size):
        first = max(k - horizon + 1, begin)
        for i in range(back):
            past[i] = y[first - back + i]
        for t in range(first, k + 1):
            at = back + t - first
            rho = _regressors(rows, drive, kappa, feedback, na, t, past, at - 1, row)
            past[at], _ = _step(own, knots, theta, phi[t], row, rho, value, slope)
        out[k] = past[back + k - first]


@njit()
def sensitivity_quasi(own, knots, theta, kappa, feedback, na, phi, rows, drive, y, begin, limit, jacobian):
    """As `free_run_quasi`, with ∂y/∂(theta, kappa) in jacobian (n, size), zero on the measured past.

    dy(k) = φ⊗φ_e⊗row dθ − Σ a_i dy(k−i) + (∂y/∂ρ)(feedback·dy(k−1) + drive·dκ): the exact total derivative.
    """
    n_own, n_external, width = theta.shape
    value, slope, row = np.zeros(n_own), np.zeros(n_own), np.empty(rows.shape[1])
    size = theta.size
    for k in range(begin, y.size):
        rho = _regressors(rows, drive, kappa, feedback, na, k, y, k - 1, row)
        y[k], steep = _step(own, knots, theta, phi[k], row, rho, value, slope)
        if not abs(y[k]) < limit:
            return k
        low, high = _own_functions(own, knots, rho, value, slope)
        now = jacobian[k]
        for i in range(na):
            gain = 0.0
            for m in range(low, high):
                for e in range(n_external):
                    gain += value[m] * phi[k, e] * theta[m, e, i]
            before = jacobian[k - 1 - i]
            for p in range(now.size):
                now[p] -= gain * before[p]
        if steep != 0.0:
            before = jacobian[k - 1]
            for p in range(now.size):
                now[p] += steep * feedback * before[p]
            for j in range(kappa.size):
                now[size + j] += steep * drive[k, j]
        for m in range(low, high):
            for e in range(n_external):
                weight = value[m] * phi[k, e]
                place = (m * n_external + e) * width
                for r in range(width):
                    now[place + r] += weight * row[r]
    return -1


# -- compliance element -----------------------------------------------------------------------------------------------
# Ḟ = k_h (v − w), F = F_s(w, i): F_s piecewise linear in the fluid speed w, values `law` (q, m) at `knots`, mixed by
# φ_q(i). Implicit Euler: F⁺ + k_h h w⁺ = F + k_h h v has one solution, found exactly segment by segment.


@njit()
def _mixed(law, phi_before, phi_now, share, nodes):
    for m in range(nodes.size):
        total = 0.0
        for q in range(law.shape[0]):
            total += (phi_before[q] * (1.0 - share) + phi_now[q] * share) * law[q, m]
        nodes[m] = total


@njit()
def _euler(nodes, knots, gain, force, velocity):
    """Segment, place in it and fluid speed of the solution of F⁺ + gain·w⁺ = force + gain·velocity."""
    target = force + gain * velocity
    low, high = 0, knots.size - 1
    while high - low > 1:
        mid = (low + high) // 2
        if target >= nodes[mid] + gain * knots[mid]:
            low = mid
        else:
            high = mid
    rise = nodes[low + 1] - nodes[low]
    width = knots[low + 1] - knots[low]
    part = (target - nodes[low] - gain * knots[low]) / (rise + gain * width)
    return low, part, knots[low] + part * width


@njit()
def run_compliance(law, knots, gain, phi, v, begin, substeps, out):
    """Fill out[begin+1:] from out[begin]; gain = k_h·T_s/substeps; v and φ are linear between samples."""
    nodes = np.empty(knots.size)
    force = out[begin]
    for k in range(begin + 1, v.size):
        for s in range(substeps):
            share = (s + 1.0) / substeps
            _mixed(law, phi[k - 1], phi[k], share, nodes)
            low, part, _ = _euler(nodes, knots, gain, force, v[k - 1] * (1.0 - share) + v[k] * share)
            force = nodes[low] * (1.0 - part) + nodes[low + 1] * part
        out[k] = force


@njit()
def ahead_compliance(law, knots, gain, phi, v, begin, substeps, horizon, known, out):
    """out(k) = force after `horizon` samples from the known force at k − horizon (not before `begin`)."""
    nodes = np.empty(knots.size)
    for k in range(begin + 1, v.size):
        first = max(k - horizon, begin)
        force = known[first]
        for t in range(first + 1, k + 1):
            for s in range(substeps):
                share = (s + 1.0) / substeps
                _mixed(law, phi[t - 1], phi[t], share, nodes)
                low, part, _ = _euler(nodes, knots, gain, force, v[t - 1] * (1.0 - share) + v[t] * share)
                force = nodes[low] * (1.0 - part) + nodes[low + 1] * part
        out[k] = force


@njit()
def sensitivity_compliance(law, knots, gain, phi, v, begin, substeps, out, jacobian):
    """As `run_compliance`, with ∂F/∂(law nodes, ln k_h, F(begin)) in jacobian (n, q·m + 2); row `begin` is given.

    From F⁺ + g w⁺ = F + g v and F⁺ = F_s(w⁺): dw⁺ = (dF + (v − w⁺) dg − dF_s(w⁺)) / (F_s' + g), dF⁺ = dF_s + F_s' dw⁺.
    """
    q, m = law.shape
    nodes = np.empty(m)
    force = out[begin]
    change = jacobian[begin].copy()
    stiff = q * m
    for k in range(begin + 1, v.size):
        for s in range(substeps):
            share = (s + 1.0) / substeps
            _mixed(law, phi[k - 1], phi[k], share, nodes)
            speed = v[k - 1] * (1.0 - share) + v[k] * share
            low, part, fluid = _euler(nodes, knots, gain, force, speed)
            force = nodes[low] * (1.0 - part) + nodes[low + 1] * part
            steep = (nodes[low + 1] - nodes[low]) / (knots[low + 1] - knots[low])
            keep = steep / (steep + gain)
            for p in range(change.size):
                change[p] *= keep
            change[stiff] += keep * (speed - fluid) * gain
            for c in range(q):
                weight = (phi[k - 1, c] * (1.0 - share) + phi[k, c] * share) * (1.0 - keep)
                change[c * m + low] += weight * (1.0 - part)
                change[c * m + low + 1] += weight * part
        out[k] = force
        copy_values(change, jacobian[k])
