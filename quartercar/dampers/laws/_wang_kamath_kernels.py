"""Free run of the phase transition model, implicit."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit
from quartercar.dampers.stepper import FINE, GAMMA, RATIO, Move

ITERATIONS = 60
"""most Newton steps of one stage; three are usual"""
CLOSE = 1e-9
"""relative Newton step after which one further step ends the stage, at round-off in the real and the imaginary part"""


@njit(error_model="numpy")
def landau(f, w3, w4, w5):
    """(w_3 f + w_4 f³ + w_5 f⁵, its derivative)."""
    s = f * f
    return f * (w3 + s * (w4 + s * w5)), w3 + s * (3.0 * w4 + 5.0 * s * w5)


@njit(error_model="numpy")
def wang_kamath_run(v, h, substeps, theta, f, g):
    """Scaled force at every sample of w_1 f̈ + w_2 ḟ + w_3 f + w_4 f³ + w_5 f⁵ = v.

    Parameters
    ----------
    v : (N,) float array
        Velocity, linear between samples [m/s].
    h : float
        Sample time [s].
    substeps : (N − 1,) int array
        Steps from each sample to the next.
    theta : (N, 5) array, float or complex
        w_1 … w_5 at the samples, linear in between.
    f, g : float or complex
        Scaled force and its rate at the first sample.

    Returns
    -------
    (N,) array
        Of the type of `theta`.
    """
    out = np.empty(v.size, theta.dtype)
    out[0] = f
    f, g = f + 0.0 * theta[0, 0], g + 0.0 * theta[0, 0]
    for k in range(v.size - 1):
        f, g = wang_kamath_step(f, g, v[k], v[k + 1], h, substeps[k], theta[k:k + 2])
        out[k + 1] = f
    return out


@njit(error_model="numpy")
def wang_kamath_step(f, g, v0, v1, h, count, theta):
    """(f, g) one sample later, for a velocity from v0 to v1 and theta (2, 5) at both ends, in `count` steps."""
    ah = GAMMA * h / count
    for j in range(count):
        early, late = (j + GAMMA) / count, (j + 1.0) / count
        fa, ga = _stage(f, g, v0 + early * (v1 - v0), ah, theta, early)
        fb, gb = f + RATIO * (fa - f), g + RATIO * (ga - g)
        f, g = _stage(fb, gb, v0 + late * (v1 - v0), ah, theta, late)
    return f, g


@njit(error_model="numpy")
def _stage(f, g, v, ah, theta, share):
    """(f', g') with f' = f + a h g', w_1(g' − g) = a h [v − w_2 g' − P(f')], by guarded Newton steps in f'."""
    w1 = theta[0, 0] + share * (theta[1, 0] - theta[0, 0])
    w2 = theta[0, 1] + share * (theta[1, 1] - theta[0, 1])
    w3 = theta[0, 2] + share * (theta[1, 2] - theta[0, 2])
    w4 = theta[0, 3] + share * (theta[1, 3] - theta[0, 3])
    w5 = theta[0, 4] + share * (theta[1, 4] - theta[0, 4])
    lead = w1 / ah + w2
    root = f
    low, high = -math.inf, math.inf
    done = False
    for _ in range(ITERATIONS):
        force, slope = landau(root, w3, w4, w5)
        error = lead * (root - f) - w1 * g - ah * (v - force)
        steep = lead + ah * slope
        if error.real > 0.0:
            high = min(high, root.real)
        elif error.real < 0.0:
            low = max(low, root.real)
        step = error / (steep if steep.real > 0.0 else lead)
        if done:
            root = root - step
            break
        guess = root.real - step.real
        small = abs(step.real) <= CLOSE * (abs(root.real) + 1e-3)
        if not small and (guess <= low or guess >= high) and high - low < math.inf:
            root = root + (0.5 * (low + high) - root.real)
            continue
        root = root - step
        done = small
    return root, (root - f) / ah


def wang_kamath_move(damper, step: float) -> Move:
    """Steps of the phase transition model by its own compiled integration."""
    vector = damper.vector

    def move(state, here, there):
        theta = np.ascontiguousarray(damper.coefficients(np.array([here[2], there[2]]), vector))
        f, g = wang_kamath_step(float(state[0]), float(state[1]), here[1], there[1], step, FINE, theta)
        return np.array([f, g]), float(damper.scale(np.array([there[2]]), vector)[0]) * f

    return move
