"""Uphill from a periodic scheduling: each step of its path moves the way that raises the gain of its worst input.

With x_{k+1} = S_k ξ_k, ξ = [x; w] and energy Σ ξᵀE_kξ, the worst input w of a path is found by power iteration; with
the costates λ of its adjoint the energy changes with the path as ∂J/∂p_k = λ_{k+1}ᵀ ∂S_k ξ_k + ½ ξ_kᵀ ∂E_k ξ_k.
A variable that may jump goes to the end of its box that this points to; one with a rate bound moves along it, and
is then brought between the largest path below it and the smallest above it that keep the rate.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lpvid.scheduling import Scheduling

Forms = Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray] | None]
"""(steps S (L, n, n + m), energies E (L, n + m, n + m)) at L points for a step of so many seconds."""
WINDOW = 320
"""steps of the window over which a path is improved; the gain of the best one is then taken over the longer window"""
ROUNDS, ITERATIONS = 12, 5
SHARES = (1.0, 0.3, 0.1, 0.03)
"""of the half width of the box by which a path is moved at most, the largest first"""
GAINED = 1e-4
"""relative rise of the gain below which the ascent ends"""


def ascended(forms: Forms, box: Scheduling, path: np.ndarray, tick: float) -> np.ndarray:
    """(L, n_scheduling) a periodic path with at least the gain of the given one over the window.

    forms : callable
        As `Forms`; None where the system cannot be stepped along a path.
    box : Scheduling
        Range and rates [units per second] to be kept.

    Parameters
    ----------
    path : (L, n_scheduling) array
        One period.
    tick : float
        Seconds from one point to the next.

    Returns
    -------
    (L, n_scheduling) array
        The given path where nothing raises its gain.
    """
    repeats = max(2, WINDOW // len(path))
    known = _state(forms, path, tick)
    if known is None:
        return path
    gain, w, slope = _worst(known, forms, box, path, tick, repeats, None)
    for _ in range(ROUNDS):
        for share in SHARES:
            trial = _moved(box, path, slope, share, tick)
            at = _state(forms, trial, tick)
            if at is None:
                continue
            raised, input_, uphill = _worst(at, forms, box, trial, tick, repeats, w)
            if raised > gain * (1 + GAINED):
                path, gain, w, slope = trial, raised, input_, uphill
                break
        else:
            break
    return path


def _state(forms: Forms, path: np.ndarray, tick: float) -> tuple[np.ndarray, np.ndarray] | None:
    found = forms(path, tick)
    return found if found is not None and all(np.all(np.isfinite(m)) for m in found) else None


def _worst(at: tuple[np.ndarray, np.ndarray], forms: Forms, box: Scheduling, path: np.ndarray, tick: float,
           repeats: int, w: np.ndarray | None) -> tuple[float, np.ndarray, np.ndarray]:
    """Gain over the window, its worst input, and the slope of the gain's square along the path (L, n_scheduling)."""
    step, energy = at
    length, n = len(path), step.shape[1]
    m, total = step.shape[2] - n, repeats * len(path)
    if w is None:
        w = np.random.default_rng(1).normal(size=(total, m))
    gain, xi, costate = 0.0, np.zeros((total, n + m)), np.zeros((total + 1, n))
    for _ in range(ITERATIONS):
        w = w / max(float(np.linalg.norm(w)), 1e-300)
        x, total_energy = np.zeros(n), 0.0
        for k in range(total):
            xi[k, :n], xi[k, n:] = x, w[k]
            total_energy += float(xi[k] @ energy[k % length] @ xi[k])
            x = step[k % length] @ xi[k]
        gain = float(np.sqrt(max(total_energy, 0.0)))
        costate[total] = 0.0
        w = np.empty_like(w)
        for k in range(total - 1, -1, -1):
            back = step[k % length].T @ costate[k + 1] + energy[k % length] @ xi[k]
            costate[k], w[k] = back[:n], back[n:]
    slope = np.zeros_like(path)
    for i, half in enumerate(box.half_width):
        if not half > 0:
            continue
        ahead, behind = path.copy(), path.copy()
        ahead[:, i] = np.minimum(path[:, i] + 1e-4 * half, box.upper[i])
        behind[:, i] = np.maximum(path[:, i] - 1e-4 * half, box.lower[i])
        more, less = _state(forms, ahead, tick), _state(forms, behind, tick)
        if more is None or less is None:
            continue
        width = (ahead[:, i] - behind[:, i])[:, None, None]
        d_step, d_energy = (more[0] - less[0]) / width, (more[1] - less[1]) / width
        for k in range(total):
            j = k % length
            slope[j, i] += costate[k + 1] @ d_step[j] @ xi[k] + 0.5 * xi[k] @ d_energy[j] @ xi[k]
    return gain, w, slope


def _moved(box: Scheduling, path: np.ndarray, slope: np.ndarray, share: float, tick: float) -> np.ndarray:
    """The path a share of the box further along the slope, within the box and the rates."""
    moved = path.copy()
    for i, (low, high, half, rate) in enumerate(zip(box.lower, box.upper, box.half_width, box.rate, strict=True)):
        steepest = float(np.abs(slope[:, i]).max())
        if not half > 0 or rate == 0 or not steepest > 0:
            continue
        if rate is None:
            moved[:, i] = np.clip(path[:, i] + 2 * share * half * np.sign(slope[:, i]), low, high)
            continue
        wished = np.clip(path[:, i] + share * half * slope[:, i] / steepest, low, high)
        moved[:, i] = _within_rate(wished, rate * tick)
    return moved


def _within_rate(path: np.ndarray, most: float) -> np.ndarray:
    """The mean of the largest path below and the smallest above that change by `most` per step, around the period."""
    k = np.arange(len(path))
    apart = np.abs(k[:, None] - k)
    apart = np.minimum(apart, len(path) - apart) * most
    return 0.5 * ((path + apart).min(axis=1) + (path - apart).max(axis=1))
