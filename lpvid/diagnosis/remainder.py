"""Remainder: the share of the error left that is predictable from the inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.rounding import HALF_DIGITS, TINY

LAGS = (2, 6, 16)
"""samples by which inputs are delayed"""
UNITS = 300
"""random features"""
KNOTS = 32
"""of a piecewise linear function of each input by itself"""
RIDGES = (1e-4, 1e-2, 1.0)
"""penalties of the ridge regression; the one with the least error out of fold is used"""


def predictable_share(
    problem: DiagnosisProblem, errors: Sequence[np.ndarray], channels: Sequence[str]
) -> tuple[float, float]:
    """Share of the squared error that a flexible regression on the inputs predicts out of fold, and its standard error.

    Ridge regression on random features tanh(wᵀz + b) of the inputs, their signs, their values some samples ago and
    their slopes, on a piecewise linear function of each input, and on slow drifts, fitted to one fold of blocks and
    tested on the other, both ways (Rahimi, Recht 2007, random features). About 0 for noise, at most a little below it.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Per record.
    channels : sequence of str
        Inputs.

    Returns
    -------
    share, deviation : float
        Both 0 where there is no error.
    """
    features = problem.stack(_features(problem.signals, channels))
    target = problem.stack(errors)
    scale = features.std(axis=0)
    moving = scale > HALF_DIGITS * max(float(scale.max(initial=0.0)), TINY)
    features = features[:, moving] / scale[moving]
    before, after = target**2, np.zeros((target.size, len(RIDGES)))
    for fold in (0, 1):
        train, test = (problem.blocks.turn[problem.block] == k for k in (1 - fold, fold))
        gram, moment = features[train].T @ features[train], features[train].T @ target[train]
        for k, ridge in enumerate(RIDGES):
            weights = np.linalg.solve(gram + ridge * train.sum() * np.eye(len(gram)), moment)
            after[test, k] = (target[test] - features[test] @ weights) ** 2
    total = float(before.sum())
    if not total > 0:
        return 0.0, 0.0
    gains = problem.block_sums(before - after[:, int(np.argmin(after.sum(axis=0)))])
    spread = float(gains.std(ddof=1) * np.sqrt(gains.size))
    return float(gains.sum()) / total, spread / total


def predicted_share(problem: DiagnosisProblem, errors: Sequence[np.ndarray], channels: Sequence[str]) -> float:
    """`predictable_share` where it exceeds twice its standard error, else 0.

    Parameters
    ----------
    problem : DiagnosisProblem
    errors : sequence of (n,) arrays
        Per record.
    channels : sequence of str
        Inputs.

    Returns
    -------
    float
        From 0 to 1.
    """
    share, spread = predictable_share(problem, errors, channels)
    return float(np.clip(share if share > 2 * spread else 0.0, 0.0, 1.0))


def _features(signals: Sequence[Signals], channels: Sequence[str]) -> list[np.ndarray]:
    """Per record, (n, f) random functions of the inputs, the same for all records."""
    raw = [_regressors(s, channels) for s in signals]
    pooled = np.vstack(raw)
    centre, spread = pooled.mean(axis=0), pooled.std(axis=0)
    moving = spread > HALF_DIGITS * np.maximum(np.abs(pooled).max(axis=0), TINY)
    rng = np.random.default_rng(0)
    width = int(moving.sum())
    weights = rng.standard_normal((width, UNITS)) / np.sqrt(max(width, 1))
    shift = rng.standard_normal(UNITS)
    knots = [knots_of(np.concatenate([s[c] for s in signals])) for c in channels]
    out = []
    for s, values in zip(signals, raw, strict=True):
        z = (values[:, moving] - centre[moving]) / spread[moving]
        drift = np.linspace(-1.0, 1.0, len(values))[:, None] ** np.arange(4)
        single = [hats(s[c], at) for c, at in zip(channels, knots, strict=True)]
        out.append(np.hstack([np.tanh(z @ weights + shift), z, drift, *single]))
    return out


def knots_of(values: np.ndarray) -> np.ndarray:
    """Knots spaced evenly in the mean of two coordinates: the rank and the place within the range, each from 0 to 1.

    The spacing is at most 2/`KNOTS` in either. Half of the knots by rank and half by range would coincide where the
    values are evenly distributed, as the positions of a triangle are.

    Parameters
    ----------
    values : (n,) array
        Of one input.

    Returns
    -------
    (m,) array
        Increasing, at most `KNOTS`, in the unit of the values; one where they are constant.
    """
    ordered = np.sort(values)
    span = ordered[-1] - ordered[0]
    if not span > 0:
        return ordered[:1]
    place = (np.linspace(0, 1, ordered.size) + (ordered - ordered[0]) / span) / 2
    return np.unique(np.interp(np.linspace(0, 1, KNOTS), place, ordered))


def hats(x: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(n, knots) piecewise linear functions, one at its knot and zero at the others.

    Parameters
    ----------
    x : (n,) array
    knots : (m,) array
        Increasing, in the unit of x; the outer functions are 1 beyond the outer knots.

    Returns
    -------
    (n, m) array
        (n, 0) for fewer than two knots.
    """
    if knots.size < 2:
        return np.zeros((x.size, 0))
    return np.column_stack([np.interp(x, knots, row) for row in np.eye(knots.size)])


def _regressors(s: Signals, channels: Sequence[str]) -> np.ndarray:
    columns = []
    for name in channels:
        x = s[name]
        sign = np.sign(x - x.mean())
        columns += [x, sign, np.gradient(x), *(_lag(x, k) for k in LAGS), *(_lag(sign, k) for k in LAGS)]
    return np.column_stack(columns)


def _lag(x: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([np.full(min(samples, x.size), x[0]), x[:-samples]])[: x.size]
