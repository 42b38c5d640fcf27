"""Profile likelihood of the friction beside a hydraulic network (E3.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quartercar.dampers.bench.log_fit import NETWORKS, LogFit, Points, fit_log_force, upper_bound


@dataclass(frozen=True, eq=False)
class FrictionProfile:
    """Profile likelihood of the friction: what the points show of F_c once everything else has been adapted to it.

    Attributes
    ----------
    friction : (m,) array
        Trial values [N].
    deviance : (m,) array
        2 ln(L_max/L) = N ln(RSS/RSS_min).
    interval : (float, float)
        95 % interval [N], within the range tried: deviance below N ln(1 + F₀.₉₅(1, N − p)/(N − p)).
    """

    friction: np.ndarray
    deviance: np.ndarray
    interval: tuple[float, float]


def friction_profile(points: Points, fit: LogFit, count: int = 25) -> FrictionProfile:
    """Refit a network at fixed frictions about the fitted one, as far out as the interval reaches."""
    from scipy.stats import f as fisher

    freedom = max(fit.n_points - len(NETWORKS[fit.network]), 1)
    cut = fit.n_points * float(np.log1p(fisher.ppf(0.95, 1, freedom) / freedom))
    best = float(fit.theta[3])
    std = max((upper_bound(points, fit, "friction") - best) / 1.645, 1e-9 * float(points.force.min()))
    for reach in (4.0, 16.0, 64.0):
        steps = std * np.linspace(0.0, reach, count // 2 + 1)
        up, down = best + steps, np.unique(np.maximum(best - steps, 0.0))[::-1]
        grid = np.concatenate([down[:0:-1], up])
        deviance = np.concatenate([_deviance(points, fit, down)[:0:-1], _deviance(points, fit, up)])
        if deviance[-1] > cut and (grid[0] == 0.0 or deviance[0] > cut):
            break
    inside = np.flatnonzero(deviance <= cut)
    low, high = int(inside[0]), int(inside[-1])
    ends = [float(grid[low]), float(grid[high])]
    if low > 0:
        ends[0] = float(np.interp(cut, deviance[[low, low - 1]], grid[[low, low - 1]]))
    if high < grid.size - 1:
        ends[1] = float(np.interp(cut, deviance[[high, high + 1]], grid[[high, high + 1]]))
    return FrictionProfile(grid, deviance, (ends[0], ends[1]))


def _deviance(points: Points, fit: LogFit, frictions: np.ndarray) -> np.ndarray:
    """N ln(RSS/RSS_min) along frictions that lead away from the fitted one, each fit starting from the last."""
    out, theta = np.zeros(frictions.size), fit.theta
    for k, friction in enumerate(frictions):
        if k:
            again = fit_log_force(points, fit.network, theta, float(friction))
            out[k] = fit.n_points * np.log(max(again.rss, 1e-300) / max(fit.rss, 1e-300))
            theta = again.theta
    return np.maximum(out, 0.0)
