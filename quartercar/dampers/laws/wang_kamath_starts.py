"""Starting points of the phase transition model: its equation error, linear in the coefficients."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.fitting.starting import column_size
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import Sizes, path

WINDOWS = (7, 21)
"""samples of the smoothing that differentiates the force"""
LAGS = (0.0, 0.003, 0.03, 0.3)
"""w_2 held at these shares of the rms displacement; 0 leaves it to the regression"""
FACTORS = (0.1, 1.0)
"""on the w_1 of the regression, which noise in the force makes uncertain"""
GROWTHS = (0.5, 2.0, 8.0)
"""share by which the largest current raises the force, where the model has one law that grows with it"""


def regression_candidates(parameters: Sequence[Parameter], basis: Callable[[np.ndarray], np.ndarray],
                          force_scale: float, drives: Sequence[Drive]) -> Iterator[np.ndarray]:
    """Vectors from the regression of v on (f̈, ḟ, f, f³, f⁵).

    Parameters
    ----------
    parameters : sequence of Parameter
        Of a `WangKamath`.
    basis : callable
        (n,) currents -> (n, degree + 1) functions of them in the coefficients.
    force_scale : float
        F_s [N].
    drives : sequence of Drive
        With forces.

    Returns
    -------
    iterator of (P,) arrays
        By growth with the current, smoothing window, lag and inertia.
    """
    v, current = joined(drives, "velocity", "current")
    travel = float(np.concatenate([path(d) for d in drives]).std())
    top = float(np.abs(current).max()) or 1.0
    growing = parameters[-1].name == "force_growth"
    sizes = Sizes.of(drives)
    parameters = [sizes.sized(p) for p in parameters]
    for growth, window in product([g / top for g in GROWTHS] if growing else [0.0], WINDOWS):
        columns = np.vstack([_columns(basis, force_scale, d, window, growth) for d in drives])
        for lag, factor in product(LAGS, FACTORS):
            vector = _regressed(parameters, columns, v, lag * travel)
            vector[: vector.size // 5] *= factor
            yield _bounded(parameters, np.append(vector, growth) if growing else vector)


def _columns(basis: Callable[[np.ndarray], np.ndarray], force_scale: float, drive: Drive, window: int,
             growth: float) -> np.ndarray:
    """(n, 5(degree + 1)) regressors of one drive."""
    from scipy.signal import savgol_filter

    assert drive.force is not None
    f = drive.force / (force_scale * (1.0 + growth * np.maximum(drive.current, 0.0)))
    window = min(window, (drive.n_samples - 1) // 2 * 2 + 1)
    if window > 4:
        rate, bend = (savgol_filter(f, window, 4, deriv=k, delta=drive.sample_time) for k in (1, 2))
    else:
        rate, bend = np.gradient(f, drive.sample_time), np.zeros(f.size)
    shares = basis(drive.current)
    return np.hstack([signal[:, None] * shares for signal in (bend, rate, f, f**3, f**5)])


def _regressed(parameters: Sequence[Parameter], columns: np.ndarray, v: np.ndarray, lag: float) -> np.ndarray:
    """Least squares with w_1, w_2, w_5 not below zero; w_2 held at `lag` unless that is 0."""
    from scipy.optimize import lsq_linear

    wide, size = columns.shape[1] // 5, column_size(columns)
    held = np.zeros(5 * wide, dtype=bool)
    held[wide: 2 * wide] = lag > 0
    lower = np.where([p.log for p in parameters[: 5 * wide]], 0.0, -np.inf)
    target = v - lag * columns[:, held].sum(axis=1)
    out = np.full(5 * wide, lag)
    out[~held] = lsq_linear((columns / size)[:, ~held], target, (lower[~held], np.inf), method="bvls").x / size[~held]
    return out


def _bounded(parameters: Sequence[Parameter], vector: np.ndarray) -> np.ndarray:
    """Inside the bounds, with coefficients that came out as zero at a hundredth of their defaults."""
    floor = [max(0.01 * p.default, p.lower) if p.log else p.lower for p in parameters]
    return np.clip(vector, floor, [p.upper for p in parameters])
