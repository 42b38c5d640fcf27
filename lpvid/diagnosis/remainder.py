"""Remainder: whether the error that is left still follows the inputs, where no repeats tell the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.signals import Signals

LAGS = (2, 6, 16)
"""samples by which inputs are delayed"""
UNITS = 300
"""random features"""
STEEPNESS = (0.5, 1.5, 5.0)
"""widths of the random directions, in standard deviations of the inputs"""
RIDGE = 1e-4


def predictable_share(problem: Problem, errors: Sequence[np.ndarray], channels: Sequence[str]) -> tuple[float, float]:
    """Share of the squared error that a flexible regression on the inputs predicts out of fold, and its standard error.

    Ridge regression on random features tanh(wᵀz + b) of the inputs, their soft signs, their values some samples ago and
    their slopes, and on slow drifts, fitted to one fold of blocks and tested on the other, both ways (Rahimi, Recht
    2007, random features). About 0 for noise, a little below it by the number of features over that of samples.

    Parameters
    ----------
    problem : Problem
    errors : sequence of (n,) arrays
        Unwhitened, per record.
    channels : sequence of str
        Inputs.
    """
    features = problem.stack(_features(problem.signals, channels))
    target = problem.stack(errors)
    scale = features.std(axis=0)
    features = features[:, scale > 1e-12 * max(float(scale.max(initial=0.0)), 1e-300)]
    features = features / features.std(axis=0)
    before, after = target**2, np.zeros_like(target)
    for fold in (0, 1):
        train, test = problem.in_fold(1 - fold), problem.in_fold(fold)
        gram = features[train].T @ features[train]
        weights = np.linalg.solve(gram + RIDGE * train.sum() * np.eye(len(gram)), features[train].T @ target[train])
        after[test] = (target[test] - features[test] @ weights) ** 2
    gains = problem.block_sums(before - after)
    total = float(before.sum())
    if not total > 0:
        return 0.0, 0.0
    spread = float(gains.std(ddof=1) * np.sqrt(gains.size))
    return float(gains.sum()) / total, spread / total


def _features(signals: Sequence[Signals], channels: Sequence[str]) -> list[np.ndarray]:
    """Per record, (n, f) random functions of the inputs, the same for all records."""
    raw = [_regressors(s, channels) for s in signals]
    together = np.vstack(raw)
    centre, spread = together.mean(axis=0), together.std(axis=0)
    moving = spread > 1e-9 * np.maximum(np.abs(together).max(axis=0), 1e-300)
    rng = np.random.default_rng(0)
    width = int(moving.sum())
    weights = rng.standard_normal((width, UNITS)) / np.sqrt(max(width, 1))
    weights *= np.repeat(STEEPNESS, -(-UNITS // len(STEEPNESS)))[:UNITS]
    shift = rng.uniform(-1.5, 1.5, UNITS)
    out = []
    for values in raw:
        z = (values[:, moving] - centre[moving]) / spread[moving]
        drift = np.linspace(-1.0, 1.0, len(values))[:, None] ** np.arange(4)
        out.append(np.hstack([np.tanh(z @ weights + shift), z, drift]))
    return out


def _regressors(s: Signals, channels: Sequence[str]) -> np.ndarray:
    columns = []
    for name in channels:
        x = s[name]
        soft = np.tanh(8 * (x - x.mean()) / max(float(x.std()), 1e-300))
        columns += [x, soft, np.gradient(x), *(_lag(x, k) for k in LAGS), *(_lag(soft, k) for k in LAGS)]
    return np.column_stack(columns)


def _lag(x: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([np.full(min(samples, x.size), x[0]), x[:-samples]])[: x.size]
