"""Which hydraulic network a static characteristic shows: series, parallel, mixed, or that it cannot decide."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.toolkit import checks
from quartercar.dampers.bench.log_fit import NETWORKS, LogFit, Points, fit_log_force, held_out_error, upper_bound
from quartercar.dampers.bench.slopes import SlopeDiagnosis, log_slopes
from quartercar.dampers.bench.static_characteristic import StaticCharacteristic
from quartercar.dampers.laws.network import MixedNetwork, NetworkDamper, ParallelNetwork, SeriesNetwork

FOLDS = 6
"""speeds held out in turn, every sixth"""
DECISIVE = 6.0
"""difference of AICc between series and parallel that decides: odds of 20 to 1"""
LEVEL = 0.01
"""probability below which a further loss counts as shown"""
ASYMMETRIC = 0.03
"""difference between the directions, as a share of the force, from which it is reported"""
BEYOND = 30.0
"""factor by which missing speeds are looked for outside the range"""
KINDS: dict[str, type[NetworkDamper]] = {"series": SeriesNetwork, "parallel": ParallelNetwork, "mixed": MixedNetwork}


@dataclass(frozen=True)
class LikelihoodRatio:
    """Likelihood ratio of two nested networks in log-force.

    Attributes
    ----------
    smaller, larger : str
    statistic : float
        N ln(RSS_smaller/RSS_larger).
    p_value : float
        That the further loss is zero: a parameter on its bound, so half of the tail of F(1, N − p)
        (Self, Liang 1987, J. Am. Stat. Assoc. 82, 605-610).
    """

    smaller: str
    larger: str
    statistic: float
    p_value: float


@dataclass(frozen=True, eq=False)
class NetworkChoice:
    """The choice between networks and what it rests on.

    Attributes
    ----------
    verdict : str
        ``"series"``, ``"parallel"``, ``"mixed"`` or ``"cannot tell"``.
    reason : str
        In a sentence; where it cannot decide, with the speeds that are missing.
    fits : dict of str to LogFit
        Every network of `NETWORKS`, all in the norm of log-force.
    ratios : tuple of LikelihoodRatio
    slopes : SlopeDiagnosis
    points : Points
    notes : tuple of str
    """

    verdict: str
    reason: str
    fits: dict[str, LogFit]
    ratios: tuple[LikelihoodRatio, ...]
    slopes: SlopeDiagnosis
    points: Points
    notes: tuple[str, ...] = ()

    @property
    def best(self) -> LogFit:
        """The verdict's fit; where it cannot decide, the one of least AICc."""
        return self.fits[self.verdict] if self.verdict in self.fits else min(self.fits.values(), key=lambda f: f.aicc)

    @cached_property
    def held_out(self) -> dict[str, float]:
        """Rms of ln F − ln F̂ over speeds that the fit has not seen, by network."""
        return dict(zip(self.fits, held_out_error(self.points, list(self.fits.values()), FOLDS), strict=True))

    @cached_property
    def friction(self) -> FrictionProfile:
        """Profile likelihood of the best fit's friction."""
        return friction_profile(self.points, self.best)

    def damper(self, network: str | None = None) -> NetworkDamper:
        """A damper with the fitted values, by default of the best network, its friction smooth below the slowest speed.

        A purely laminar or turbulent fit is a series network with one loss.

        Parameters
        ----------
        network : str, optional
            A name of `NETWORKS`.

        Returns
        -------
        NetworkDamper
            One network for both directions, offset 0.
        """
        fit = self.fits[checks.known_name(network, list(self.fits), "network")] if network else self.best
        kind = KINDS.get(fit.network, SeriesNetwork)
        bare = kind(smoothing=0.2 * float(self.points.speed.min()))
        hydraulic = bare.network_vector(*map(float, fit.theta[:3]))
        return bare.with_vector(np.array([*hydraulic, fit.theta[3], 0.0]))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        rows = {n: {"values": f.values, "std": f.std, "aicc": f.aicc, "bic": f.bic, "held_out_log_force_rms":
                    self.held_out[n]} for n, f in self.fits.items()}
        return {"verdict": self.verdict, "reason": self.reason, "n_points": self.points.speed.size, "networks": rows,
                "ratios": [vars(r) for r in self.ratios], "slope_trend": self.slopes.trend,
                "friction_interval_N": list(self.friction.interval), "notes": list(self.notes)}

    def __repr__(self) -> str:
        least = min(f.aicc for f in self.fits.values())
        lines = [f"Network: {self.verdict}: {self.reason}",
                 f"  {self.points.speed.size} points, errors of ln F; held out: every {FOLDS}th speed in turn",
                 "  network     AICc     BIC  held-out error  free"]
        for n, f in sorted(self.fits.items(), key=lambda item: item[1].aicc):
            lines.append(f"  {n:<9} {f.aicc - least:+7.1f} {f.bic:7.1f}  {self.held_out[n]:13.2%}  {len(f.values)}")
        lines.append("  " + "; ".join(f"{r.larger} against {r.smaller}: LR {r.statistic:.1f}, p {r.p_value:.1g}"
                                      for r in self.ratios if r.larger == "mixed"))
        lines.append(f"  {self.slopes}")
        low, high = self.friction.interval
        lines.append(f"  friction {self.best.theta[3]:.4g} N, 95 % {low:.4g} to {high:.4g} N")
        return "\n".join([*lines, *(f"  {n}" for n in self.notes)])


def choose_network(characteristic: StaticCharacteristic, direction: int | None = None) -> NetworkChoice:
    """Choose between hydraulic networks on the evidence of a static characteristic.

    Laminar, turbulent, series, parallel and mixed networks are fitted in log-force with friction. Mixed is chosen where
    both of its parents are refuted (p < 0.01); else series or parallel where AICc differs by 6 and both of its losses
    are shown (p < 0.01); else it cannot decide, and names the speeds that would.

    Parameters
    ----------
    characteristic : StaticCharacteristic
    direction : {1, −1}, optional
        One direction alone (E3.8); by default the odd part of both where both were run.

    Returns
    -------
    NetworkChoice

    Raises
    ------
    InputError
        Fewer than 6 points in one direction.

    Examples
    --------
    >>> v = np.geomspace(2e-5, 2e-3, 23)
    >>> force = (10 + 5e4 * v + 2e8 * v**2) * np.exp(0.01 * np.sin(40 * np.arange(23)))
    >>> choose_network(StaticCharacteristic(v, force, 0.01 * force)).verdict
    'series'
    """
    side, notes = _one_side(characteristic, direction)
    points = Points.of(side)
    if points.speed.size < side.n_points:
        notes.append(f"{side.n_points - points.speed.size} point(s) without a resisting force left out")
    fits = {n: fit_log_force(points, n) for n in NETWORKS}
    for parent in ("series", "parallel"):  # a larger network never fits worse than what it contains
        if fits["mixed"].rss > fits[parent].rss:
            again = fit_log_force(points, "mixed", fits[parent].theta)
            fits["mixed"] = min(again, fits["mixed"], key=lambda f: f.rss)
    pairs = [(s, n) for n, kept in NETWORKS.items() for s, some in NETWORKS.items()
             if set(some) < set(kept) and len(some) == len(kept) - 1]
    ratios = {(s, n): _ratio(fits[s], fits[n]) for s, n in pairs}
    # laminar alone is the limit c_Q → ∞ of a parallel network, not one of its subsets
    ratios["laminar", "parallel"] = _ratio(fits["laminar"], fits["parallel"])
    verdict, reason = _decide(fits, ratios, points)
    best = fits[verdict] if verdict in fits else min(fits.values(), key=lambda f: f.aicc)
    slopes = log_slopes(points, float(best.theta[3]), best.std["friction"])
    if verdict in ("series", "parallel") and slopes.network not in (None, verdict):
        notes.append(f"caution: the slopes are {slopes.trend}, which supports {slopes.network}")
    if verdict in ("series", "parallel") and ratios[verdict, "mixed"].p_value < 0.1:
        notes.append(f"a mixed network is not excluded (p {ratios[verdict, 'mixed'].p_value:.1g})")
    notes += _misfit(best, points)
    return NetworkChoice(verdict, reason, fits, tuple(ratios.values()), slopes, points, tuple(notes))


def _one_side(c: StaticCharacteristic, direction: int | None) -> tuple[StaticCharacteristic, list[str]]:
    if direction is not None:
        return c.side(direction), []
    if np.all(c.direction == c.direction[0]):
        return c.side(int(c.direction[0])), []
    odd, offset, std = c.parts()
    out, back = c.side(1), c.side(-1)
    other = np.exp(np.interp(np.log(out.speed), np.log(back.speed), np.log(np.maximum(back.force + offset, 1e-300))))
    unequal = float(np.median(np.abs((out.force - offset) / other - 1.0)))
    notes = [f"both directions folded; offset {offset:.3g} ± {std:.2g} N removed as the even part"]
    if unequal > ASYMMETRIC:
        notes.append(f"extension and compression differ by {unequal:.0%}: choose for each with direction=1, -1")
    return odd, notes


def _ratio(smaller: LogFit, larger: LogFit) -> LikelihoodRatio:
    from scipy.stats import f as fisher

    n, freedom = smaller.n_points, larger.n_points - len(NETWORKS[larger.network])
    share = max(smaller.rss / max(larger.rss, 1e-300), 1.0)
    return LikelihoodRatio(smaller.network, larger.network, n * float(np.log(share)),
                 0.5 * float(fisher.sf((share - 1.0) * freedom, 1, freedom)))


def _decide(fits: dict[str, LogFit], ratios: dict[tuple[str, str], LikelihoodRatio], points: Points) -> tuple[str, str]:
    against = [ratios[p, "mixed"].p_value for p in ("series", "parallel")]
    if max(against) < LEVEL:
        return "mixed", f"neither series nor parallel alone explains the points, p {max(against):.1g}"
    first, second = sorted(("series", "parallel"), key=lambda n: fits[n].aicc)
    margin = fits[second].aicc - fits[first].aicc
    for regime in ("laminar", "turbulent"):
        if ratios[regime, first].p_value >= LEVEL:
            return "cannot tell", _one_regime(regime, fits, points)
    if margin < DECISIVE:
        return "cannot tell", f"series and parallel differ by {margin:.1f} in AICc only; {_missing(fits, points)}"
    return first, (f"AICc below {second} by {margin:.0f}, equal shares at {_transition(fits[first]):.3g} mm/s; "
                   f"{_unseen(first, fits['mixed'], points)} would not show")


def _transition(fit: LogFit) -> float:
    """Speed of equal laminar and turbulent shares [mm/s]: c_L/c_Q in series, 2 c_leak/c_Q in parallel."""
    laminar, quadratic, leak, _ = fit.theta
    return 1e3 * float(laminar / quadratic if fit.network == "series" else 2.0 / (leak * quadratic))


def _unseen(network: str, mixed: LogFit, points: Points) -> str:
    """What a mixed network has more than this one, with its one-sided 95 % bound."""
    if network == "series":
        return f"a leak below {upper_bound(points, mixed, 'leak_mobility'):.2g} m/(N s)"
    return f"a laminar loss before the orifice below {upper_bound(points, mixed, 'laminar_damping'):.2g} N s/m"


def _one_regime(regime: str, fits: dict[str, LogFit], points: Points) -> str:
    """Where to measure when a single loss explains everything."""
    series, parallel = fits["series"], fits["parallel"]
    if regime == "laminar":
        turning = series.theta[0] / max(upper_bound(points, series, "quadratic_damping"), 1e-300)
        return (f"a laminar loss alone explains the points; speeds above {1e3 * turning:.3g} mm/s are missing, where a "
                "series network would turn turbulent, or slower ones, where a parallel one would")
    low = upper_bound(points, series, "laminar_damping") / series.theta[1]
    high = 2.0 / max(upper_bound(points, parallel, "leak_mobility") * parallel.theta[1], 1e-300)
    return (f"a turbulent loss alone explains the points; speeds below {1e3 * low:.3g} mm/s are missing, where a "
            f"series network would turn laminar, or above {1e3 * high:.3g} mm/s, where a parallel one would")


def _missing(fits: dict[str, LogFit], points: Points) -> str:
    """Nearest speeds outside the range at which series and parallel differ by five errors of a point."""
    clear = 5.0 * float(np.median(points.error)) if np.ptp(points.error) else 0.1
    low, high = float(points.speed.min()), float(points.speed.max())
    out = []
    outside = {"below": np.geomspace(low, low / BEYOND, 60), "above": np.geomspace(high, high * BEYOND, 60)}
    for word, grid in outside.items():
        gap = np.abs(np.log(fits["series"].force(grid) / fits["parallel"].force(grid)))
        found = np.flatnonzero(gap > clear)
        if found.size:
            out.append(f"{word} {1e3 * grid[found[0]]:.3g} mm/s")
    return f"speeds {' or '.join(out)} would decide" if out else "more repeats are needed: they differ nowhere near"


def _misfit(fit: LogFit, points: Points) -> list[str]:
    """A word where the best network misses the points by more than their errors."""
    ratio = float(np.sqrt(fit.rss / max(fit.n_points - len(NETWORKS[fit.network]), 1)))
    if ratio > 3 and np.ptp(points.error):
        return [f"caution: the points scatter {ratio:.1f} times their errors about the {fit.network} network"]
    return []


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
    """Refit a network at fixed frictions about the fitted one, as far out as the interval reaches.

    Parameters
    ----------
    points : Points
        That the fit was made to.
    fit : LogFit
        With friction free.
    count : int
        Frictions tried, half of them on either side of the fitted one.

    Returns
    -------
    FrictionProfile
        Reaches as far as the interval does, at most 64 standard errors; to zero friction where that lies inside.
    """
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
