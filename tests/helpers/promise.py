"""What a closed loop does on a fine grid and along random admissible trajectories, found without any inequality."""

from __future__ import annotations

import numpy as np

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.synthesis.interconnection import close_loop_at

STEPS = 240


def loops(plant: lpv.GeneralizedPlant, controller: lpv.LPVStateSpace, points: np.ndarray, rates: np.ndarray):
    """A, B, C, D of the closed loop (N, …) at points and rates of the plant's scheduling, both (N, n_scheduling)."""
    values = dict(zip(plant.box.names, points.T, strict=True))
    values |= {f"{n}_rate": r for n, r in zip(plant.box.names, rates.T, strict=True)}
    own = [values[n] for n in controller.box.names]
    phi = controller.basis.evaluate(np.column_stack(own) if own else np.zeros((len(points), 0)))
    k = [np.tensordot(phi, m, axes=1) for m in (controller.A, controller.B, controller.C, controller.D)]
    return close_loop_at(plant.at(points), *k)


def frozen_peak(plant: lpv.GeneralizedPlant, controller: lpv.LPVStateSpace, rng: np.random.Generator
                ) -> tuple[float, float]:
    """Largest frozen H-infinity norm over grid points and as many random ones, and its frequency [rad/s]."""
    s = len(plant.box.names)
    points = plant.box.grid({0: 1, 1: 60, 2: 8}.get(s, 4))
    points = np.vstack([points, rng.uniform(plant.box.lower, plant.box.upper, points.shape)])
    discrete = plant.sample_time is not None
    best = (0.0, 1.0)
    for a, b, c, d in zip(*loops(plant, controller, points, 0 * points), strict=True):
        poles = np.linalg.eigvals(a)
        if (np.abs(poles) >= 1).any() if discrete else (poles.real >= 0).any():
            return np.inf, 1.0
        norm, omega = h_infinity_norm((a, b, c, d), discrete)
        if norm > best[0]:
            best = (norm, omega if np.isfinite(omega) and omega > 0 else 1e-3 * np.abs(poles).min())
    return best


def moving_peak(plant: lpv.GeneralizedPlant, controller: lpv.LPVStateSpace, frequency: float, paths: int,
                rng: np.random.Generator) -> float:
    """Largest finite-horizon gain over random admissible paths, each with its worst input (power iteration).

    In continuous time the implicit midpoint rule, which adds no gain of its own where one storage function serves; a
    variable with a rate bound takes at least fifteen steps across its range.
    """
    box = plant.box
    quick = max((r / w for r, w in zip(box.rate, box.half_width, strict=True) if r and w > 0), default=0.0)
    h = plant.sample_time or 1 / max(4 * frequency, 8 * quick, 1e-9)
    found = 0.0
    for _ in range(max(1, paths // 20)):
        points, rates = _paths(box, h, min(paths, 20), rng)
        shape = points.shape[:2]
        a, b, c, d = (m.reshape(*shape, *m.shape[1:]) for m in
                      loops(plant, controller, *(m.reshape(shape[0] * shape[1], m.shape[2]) for m in (points, rates))))
        if plant.sample_time is None:
            eye = np.eye(a.shape[2])
            inverse = np.linalg.inv(eye - h / 2 * a)
            a, b, c, d = (inverse @ (eye + h / 2 * a), inverse @ b * np.sqrt(h), c @ inverse * np.sqrt(h),
                          d + h / 2 * c @ inverse @ b)
        found = max(found, _power(a, b, c, d, rng))
    return found


def _power(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray, rng: np.random.Generator) -> float:
    """Largest singular value, nearly, of the maps w → z of time-varying discrete systems (T, paths, …)."""
    w = rng.normal(size=(*b.shape[:2], b.shape[3]))
    gain = np.zeros(b.shape[1])
    for _ in range(6):
        w /= np.sqrt((w**2).sum(axis=(0, 2), keepdims=True))
        z, x = np.zeros((*c.shape[:2], c.shape[2])), np.zeros((b.shape[1], a.shape[2]))
        for k in range(len(a)):
            z[k] = _times(c[k], x) + _times(d[k], w[k])
            x = _times(a[k], x) + _times(b[k], w[k])
        gain = np.sqrt((z**2).sum(axis=(0, 2)))
        x = np.zeros_like(x)
        for k in range(len(a) - 1, -1, -1):
            w[k] = _times(b[k].swapaxes(1, 2), x) + _times(d[k].swapaxes(1, 2), z[k])
            x = _times(a[k].swapaxes(1, 2), x) + _times(c[k].swapaxes(1, 2), z[k])
    return float(gain.max())


def _times(matrix: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (matrix @ x[..., None])[..., 0]


def _paths(box: lpv.Scheduling, h: float, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(T, count, n_scheduling) scheduling and its rate: jumps between random corners and points where the rate has no
    bound, else waves at the bound."""
    points = np.zeros((STEPS, count, len(box.names)))
    rates = np.zeros_like(points)
    t = h * (np.arange(STEPS) + 0.5)
    for i, (low, high, rate) in enumerate(zip(box.lower, box.upper, box.rate, strict=True)):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        for j in range(count):
            if rate is None:
                dwell = int(rng.integers(1, 30))
                values = rng.choice([-1.0, 1.0, rng.uniform(-1, 1)], size=STEPS // dwell + 1)
                points[:, j, i] = middle + half * np.repeat(values, dwell)[:STEPS]
            else:
                size = half * rng.uniform(0.3, 1.0)
                omega, phase = rate / size * rng.uniform(0.3, 1.0), rng.uniform(0, 2 * np.pi)
                points[:, j, i] = middle + size * np.sin(omega * t + phase)
                rates[:, j, i] = size * omega * np.cos(omega * t + phase)
    return points, rates
