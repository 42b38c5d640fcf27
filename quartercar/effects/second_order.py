"""Second-order low-pass 1/(1 + 2ζTs + T²s²): its free motion in closed form, and responses that follow from it."""

from __future__ import annotations

import numpy as np


def free_motion(angle: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """c and s of the transition [[c + ζs, s], [−s, c − ζs]] of the state (q, T q̇) over a time θT.

    c = e^(−ζθ) cosh μθ and s = e^(−ζθ) sinh(μθ)/μ, μ² = ζ² − 1; sinh(μθ) = e^(μθ) (1 − e^(−2μθ))/2, so that neither
    a damping near 1 nor a long time loses digits.

    Parameters
    ----------
    angle : array
        θ ≥ 0, time over T.
    damping : float
        ζ > 0.

    Returns
    -------
    c, s : arrays
        Of the shape of `angle`.
    """
    root = np.sqrt(complex(damping**2 - 1))
    decay, twice = np.exp((root - damping) * angle), np.expm1(-2 * root * angle)
    return np.real(decay * (1 + twice / 2)), np.real(decay * (-twice / (2 * root) if root else angle))


def step_response(time: np.ndarray, period: float, damping: float) -> np.ndarray:
    """Response to a unit step at 0: 1 − c − ζs.

    Parameters
    ----------
    time : array
        Since the step [s].
    period : float
        T > 0, in the unit of the time.
    damping : float
        ζ > 0.

    Returns
    -------
    array
        Of the shape of `time`; 0 before the step.
    """
    c, s = free_motion(np.maximum(time, 0.0) / period, damping)
    return 1 - c - damping * s


def total_variation(damping: float) -> float:
    """Total variation of the step response: (1 + M)/(1 − M), M = exp(−πζ/√(1 − ζ²)) its overshoot.

    Parameters
    ----------
    damping : float
        ζ between 0 and 1.

    Returns
    -------
    float
        In sizes of the step.

    Examples
    --------
    >>> time = np.linspace(0, 100, 20_001)
    >>> round(float(np.abs(np.diff(step_response(time, 1.0, 0.4))).sum()), 3), round(total_variation(0.4), 3)
    (1.68, 1.68)
    """
    return float(1 / np.tanh(np.pi * damping / np.sqrt(1 - damping**2) / 2))


def second_order(values: np.ndarray, period: float, damping: float, step: float,
                 before: np.ndarray | None = None, seen_after: float = 0.0) -> np.ndarray:
    """Values filtered by 1/(1 + 2ζTs + T²s²), at rest at the first; exact for signals that are linear between samples.

    A signal that jumps at its samples is the sum of a continuous part and of one that is held between jumps, whose
    response is taken `seen_after` of a step after each sample. As T → 0 the result tends to the values.

    Parameters
    ----------
    values : (n,) array
    period, damping, step : float
        T > 0 [s], ζ, sampling period [s].
    before : (n,) array, optional
        Left limits of a signal that jumps at its samples: it runs from values[k] to before[k+1].
    seen_after : float
        Share of a step after a jump at which the response to it is taken.

    Returns
    -------
    (n,) array
        In the unit of the values.
    """
    if before is None:
        return _ramped(values, period, damping, step)
    jumps = np.cumsum(values - before)
    return _ramped(values - jumps, period, damping, step) + _held(jumps, period, damping, step, seen_after)


def _ramped(values: np.ndarray, period: float, damping: float, step: float) -> np.ndarray:
    """Response to a signal that is linear between samples."""
    f, early, late = _propagated(period, damping, step)
    return _recursion(f, [late[0], early[0] + f[0, 1] * late[1] - f[1, 1] * late[0],
                          f[0, 1] * early[1] - f[1, 1] * early[0]], values)


def _held(values: np.ndarray, period: float, damping: float, step: float, seen_after: float) -> np.ndarray:
    """Response to a signal that is held between samples, taken shortly after each of them."""
    f, early, late = _propagated(period, damping, step)
    g, seen = early + late, _transition(period, damping, seen_after * step)[0]
    direct, b1, b2 = 1 - seen[0], *_denominator(f)
    turned = np.array([f[0, 1] * g[1] - f[1, 1] * g[0], f[1, 0] * g[0] - f[0, 0] * g[1]])
    return _recursion(f, [direct, direct * b1 + seen @ g, direct * b2 + seen @ turned], values)


def _recursion(f: np.ndarray, numerator: list[float], values: np.ndarray) -> np.ndarray:
    """Values, less their first, by the recursion of a transition."""
    from scipy.signal import lfilter

    return np.asarray(lfilter(numerator, [1.0, *_denominator(f)], values - values[0])) + values[0]


def _denominator(f: np.ndarray) -> tuple[float, float]:
    """−tr F and det F."""
    return -(f[0, 0] + f[1, 1]), f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]


def _transition(period: float, damping: float, time: float) -> np.ndarray:
    """(2, 2) transition of the state (q, T q̇) over a time."""
    c, s = (float(x) for x in free_motion(np.array(time / period), damping))
    return np.array([[c + damping * s, s], [-s, c - damping * s]])


def _propagated(period: float, damping: float, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State (q, T q̇) over a step: its transition F, and the weights of the input's values at both ends.

    Along f₀ + (f₁ − f₀) t/h the state (f, 0) + (f₁ − f₀) r/h, r = T (−2ζ, 1), solves the equation; the difference from
    it moves freely: late = (1, 0) + (I − F) r/h, early = −F (1, 0) − (I − F) r/h.
    """
    f = _transition(period, damping, step)
    lag = (np.eye(2) - f) @ np.array([-2 * damping, 1.0]) * (period / step)
    return f, -f[:, 0] - lag, np.array([1.0, 0.0]) + lag
