"""Remainder: whether the error that is left still follows the inputs, where no repeats tell the noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.signals import Signals

LAGS = (1, 2, 4, 8, 16, 32, 64)
RIDGE = 1e-3


def predictable_share(problem: Problem, errors: Sequence[np.ndarray], channels: Sequence[str]) -> tuple[float, float]:
    """Share of the squared error that a flexible regression on the inputs predicts out of fold, and its standard error.

    Ridge regression of the whitened error on products, moduli, soft signs, lags and differences of the inputs and on
    slow drifts, fitted to one fold of blocks and tested on the other, both ways. At best 0 for noise (a little below,
    by the number of features over the number of samples).

    Parameters
    ----------
    problem : Problem
    errors : sequence of (n,) arrays
        Unwhitened, per record.
    channels : sequence of str
        Inputs.
    """
    features = problem.stack([_features(s, channels) for s in problem.signals])
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


def _features(s: Signals, channels: Sequence[str]) -> np.ndarray:
    """(n, f) functions of the inputs."""
    units = []
    for name in channels:
        x = s[name] - s[name].mean()
        spread = x.std()
        if spread > 1e-9 * max(float(np.abs(s[name]).max(initial=0.0)), 1e-300):
            units.append(x / spread)
    columns = [np.linspace(-1.0, 1.0, s.n_samples) ** k for k in (0, 1, 2, 3)]
    for k, x in enumerate(units):
        soft = np.tanh(5 * x)
        columns += [x, np.abs(x), x * np.abs(x), x**3, soft, np.tanh(20 * x), np.maximum(x, 0.0) ** 2]
        columns += [_lag(x, j) - x for j in LAGS] + [_lag(soft, j) - soft for j in LAGS]
        for y in units[k + 1:]:
            columns += [x * y, x * np.abs(y), soft * y, x * np.tanh(5 * y), x * y**2, x**2 * y,
                        soft * (_lag(y, 4) - y), soft * (_lag(y, 16) - y)]
    return np.column_stack(columns)


def _lag(x: np.ndarray, samples: int) -> np.ndarray:
    return np.concatenate([np.full(min(samples, x.size), x[0]), x[:-samples]])[: x.size]
