"""Networks fitted to a static characteristic in one and the same norm: the logarithm of the force (E3.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.covariance import inverse_gram
from lpvid.least_squares import Trial
from lpvid.toolkit import checks
from quartercar.dampers.bench.static_characteristic import StaticCharacteristic
from quartercar.dampers.fitting.solver import SearchCoordinates, search_law
from quartercar.dampers.laws.network import LAMINAR, LEAK, LEAKS, QUADRATIC, SHARES, network_force, network_gradient
from quartercar.dampers.parameter import Parameter

FRICTION = Parameter("friction", "N", "Coulomb friction F_c", 0.0, 0.0)
PARAMETERS = (LAMINAR, QUADRATIC, LEAK, FRICTION)
NETWORKS: dict[str, tuple[str, ...]] = {
    "laminar": ("laminar_damping", "friction"),
    "turbulent": ("quadratic_damping", "friction"),
    "series": ("laminar_damping", "quadratic_damping", "friction"),
    "parallel": ("quadratic_damping", "leak_mobility", "friction"),
    "mixed": ("laminar_damping", "quadratic_damping", "leak_mobility", "friction"),
}
"""Networks by name, with the parameters that are free; the others are zero."""
POLISHED = 2
"""starts that are followed to the end"""
EVALUATIONS, TOLERANCE = 200, 1e-9
FLOOR = 0.5
"""least error of a point, as a share of the median one, so that no single point decides"""


@dataclass(frozen=True, eq=False)
class Points:
    """Speeds and resisting forces of one flow direction, with the errors of ln F.

    Attributes
    ----------
    speed, force : (n,) array
        [m/s], [N], both positive.
    error : (n,) array
        Standard error of ln F, up to a common factor.
    """

    speed: np.ndarray
    force: np.ndarray
    error: np.ndarray

    @classmethod
    def of(cls, side: StaticCharacteristic) -> Points:
        """Points of one side of a characteristic; those whose force does not resist have no logarithm and are left out.

        Parameters
        ----------
        side : StaticCharacteristic
            One direction in the first quadrant, as `StaticCharacteristic.side` and `parts` return it.

        Returns
        -------
        Points
            With equal errors where the characteristic has none.

        Raises
        ------
        InputError
            Both directions at once, or fewer than 6 points left.
        """
        if np.any(side.velocity < 0):
            raise InputError("a fit in log-force takes one direction", mend="side(1), side(-1) or parts()")
        keep = side.force > 0
        if keep.sum() < 6:
            raise InputError("too few points for a network", got=f"{keep.sum()} with a resisting force, 6 needed")
        speed, force = side.speed[keep], side.force[keep]
        error = side.std[keep] / force
        typical = float(np.median(error))
        return cls(speed, force, np.hypot(error, FLOOR * typical) if typical > 0 else np.ones(speed.size))

    def select(self, keep: np.ndarray) -> Points:
        """Some of the points.

        Parameters
        ----------
        keep : (n,) array of bool or of int
            Which to keep.

        Returns
        -------
        Points
            A copy.
        """
        return Points(self.speed[keep], self.force[keep], self.error[keep])


@dataclass(frozen=True, eq=False)
class LogFit:
    """A network fitted by min Σ ((ln F − ln F̂)/σ)².

    Attributes
    ----------
    network : str
        A name of `NETWORKS`.
    theta : (4,) array
        c_L, c_Q, 1/c_leak, F_c; zeros where the network has none.
    covariance : (4, 4) array
        With the scatter that the fit leaves; zeros at bounds and for what is not free.
    rss : float
        Weighted sum of squares.
    n_points : int
    """

    network: str
    theta: np.ndarray
    covariance: np.ndarray
    rss: float
    n_points: int

    @property
    def values(self) -> dict[str, float]:
        """Parameters by name, SI."""
        return {p.name: float(self.theta[k]) for k, p in enumerate(PARAMETERS) if p.name in NETWORKS[self.network]}

    @property
    def std(self) -> dict[str, float]:
        """Standard errors by name; 0 where a parameter rests on its bound."""
        root = np.sqrt(np.diag(self.covariance))
        return {p.name: float(root[k]) for k, p in enumerate(PARAMETERS) if p.name in NETWORKS[self.network]}

    @property
    def log_likelihood(self) -> float:
        """ln L of a normal error of ln F whose common factor is profiled out, −(N/2) ln(RSS/N), constants left out."""
        return -0.5 * self.n_points * float(np.log(max(self.rss, 1e-300) / self.n_points))

    @property
    def aicc(self) -> float:
        """Akaike's criterion with the correction for few points; the common error factor counts as a parameter."""
        k = len(NETWORKS[self.network]) + 1
        return -2 * self.log_likelihood + 2 * k + 2 * k * (k + 1) / max(self.n_points - k - 1, 1e-9)

    @property
    def bic(self) -> float:
        """Schwarz's criterion."""
        return -2 * self.log_likelihood + (len(NETWORKS[self.network]) + 1) * float(np.log(self.n_points))

    def force(self, speed: np.ndarray | float) -> np.ndarray:
        """F̂ at speeds > 0, friction included [N].

        Parameters
        ----------
        speed : array or float
            [m/s].

        Returns
        -------
        array
            Of the shape of `speed` [N].
        """
        return network_force(np.asarray(speed, dtype=float), *self.theta[:3]) + self.theta[3]


class _LogForceProblem:
    """ln F̂ − ln F over σ, as `search_law` takes it; a fixed friction is not searched."""

    def __init__(self, network: str, points: Points, friction: float | None) -> None:
        names = [n for n in NETWORKS[network] if friction is None or n != "friction"]
        self.free = [k for k, p in enumerate(PARAMETERS) if p.name in names]
        self.coordinates = SearchCoordinates([PARAMETERS[k] for k in self.free])
        self.points, self.friction = points, friction

    def trial(self, point: np.ndarray) -> Trial | None:
        theta = np.zeros(4)
        theta[self.free] = point
        if self.friction is not None:
            theta[3] = self.friction
        p = self.points
        model = network_force(p.speed, *theta[:3]) + theta[3]
        if not np.all(model > 0):
            return None
        return Trial(point, theta, np.log(model / p.force) / p.error)

    def jacobian(self, trial: Trial) -> np.ndarray:
        p, theta = self.points, trial.theta
        gradient = network_gradient(p.speed, *theta[:3])
        gradient[:, 3] = 1.0
        model = network_force(p.speed, *theta[:3]) + theta[3]
        return (gradient / (model * p.error)[:, None])[:, self.free]


def fit_log_force(points: Points, network: str, start: np.ndarray | None = None,
                  friction: float | None = None) -> LogFit:
    """Fit one network to points in log-force.

    All networks are judged by the error of ln F: (7) of the source minimises that of Δp and (8) that of Q with noisy
    regressors, so that part of its verdict could be the norm (E3.6).

    Parameters
    ----------
    points : Points
    network : str
        A name of `NETWORKS`.
    start : (4,) array, optional
        c_L, c_Q, 1/c_leak, F_c from which to search; by default a grid of shapes and frictions.
    friction : float, optional
        F_c held at this value [N]; by default it is found with the rest (E3.7).

    Returns
    -------
    LogFit
        The best of the starts.

    Raises
    ------
    InputError
        No start at which the force is positive at every point.

    Examples
    --------
    >>> v = np.geomspace(1e-5, 2e-3, 12)
    >>> f = fit_log_force(Points(v, 20 + 1e5 * v + 1e8 * v**2, np.ones(12)), "series")
    >>> {k: float(f"{x:.6g}") for k, x in f.values.items()}
    {'laminar_damping': 100000.0, 'quadratic_damping': 100000000.0, 'friction': 20.0}
    """
    checks.one_of(network, tuple(NETWORKS), "network")
    problem = _LogForceProblem(network, points, friction)
    starts = _starts(problem, points, network) if start is None else [np.asarray(start, dtype=float)[problem.free]]
    found = [f for s in starts if (f := search_law(problem, s, EVALUATIONS, TOLERANCE)) is not None]
    if not found:
        raise InputError(f"the {network} network has no start for these points", got=f"friction {friction}")
    best = min((f.trial for f in found), key=lambda t: t.cost)
    inside = best.theta[problem.free] > 0
    return LogFit(network, best.theta, _covariance(problem, best, inside), best.cost, points.speed.size)


def _starts(problem: _LogForceProblem, points: Points, network: str) -> list[np.ndarray]:
    """A grid of laminar shares, leaks and frictions, each scaled to the points; the best few."""
    top, least = float(points.speed.max()), float(points.force.min())
    names = NETWORKS[network]
    shares = {"laminar": (1.0,), "turbulent": (0.0,), "parallel": (0.0,)}.get(network, SHARES)
    leaks = LEAKS[1:] if "leak_mobility" in names else (0.0,)
    frictions = (0.0, 0.5 * least, 0.95 * least) if problem.friction is None else (problem.friction,)
    weight = 1.0 / points.error**2
    ranked = []
    for share in shares:
        for leak in leaks:
            shape = network_force(points.speed, share / top, (1.0 - share) / top**2, leak)
            for rest in frictions:
                net = np.maximum(points.force - rest, 0.02 * points.force)
                scale = float(np.exp(weight @ np.log(net / shape) / weight.sum()))
                theta = np.array([scale * share / top, scale * (1.0 - share) / top**2, leak / scale, rest])
                trial = problem.trial(theta[problem.free])
                if trial is not None:
                    ranked.append((trial.cost, theta[problem.free]))
    ranked.sort(key=lambda pair: pair[0])
    return [point for _, point in ranked[:POLISHED]]


def _covariance(problem: _LogForceProblem, trial: Trial, inside: np.ndarray) -> np.ndarray:
    """s² (JᵀJ)⁻¹ over some of what is free."""
    jacobian = problem.jacobian(trial)[:, inside]
    freedom = max(trial.residual.size - len(problem.free), 1)
    covariance = np.zeros((4, 4))
    places = np.array(problem.free)[inside]
    covariance[np.ix_(places, places)] = trial.cost / freedom * inverse_gram(jacobian)
    return covariance


def upper_bound(points: Points, fit: LogFit, name: str) -> float:
    """One-sided 95 % bound on a parameter, also where the fit has it at zero.

    Parameters
    ----------
    points : Points
        That the fit was made to.
    fit : LogFit
        With friction free.
    name : str
        Parameter that is free in the fit's network, e.g. ``"leak_mobility"``.

    Returns
    -------
    float
        Estimate and 1.645 standard errors, in the parameter's SI unit.
    """
    problem = _LogForceProblem(fit.network, points, None)
    trial = problem.trial(fit.theta[problem.free])
    assert trial is not None
    place = [p.name for p in PARAMETERS].index(name)
    covariance = _covariance(problem, trial, np.ones(len(problem.free), dtype=bool))
    return float(fit.theta[place] + 1.645 * np.sqrt(covariance[place, place]))


def held_out_error(points: Points, fits: Sequence[LogFit], folds: int) -> list[float]:
    """Rms of ln F − ln F̂ at points that the fit has not seen, every `folds`-th speed held out in turn.

    Parameters
    ----------
    points : Points
        That the fits were made to.
    fits : sequence of LogFit
        Each is the start of its refits.
    folds : int
        Number of parts.

    Returns
    -------
    list of float
        [1], one for each fit.
    """
    squares = np.zeros(len(fits))
    for fold in range(folds):
        out = np.arange(points.speed.size) % folds == fold
        for k, fit in enumerate(fits):
            again = fit_log_force(points.select(~out), fit.network, fit.theta)
            squares[k] += float(np.sum(np.log(again.force(points.speed[out]) / points.force[out]) ** 2))
    return [float(np.sqrt(s / points.speed.size)) for s in squares]
