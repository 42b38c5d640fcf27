"""Log-log slopes of a static characteristic: rising 1 → 2 in series, falling 2 → 1 in parallel, both when mixed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from quartercar.dampers.bench.log_fit import Points

WINDOW = 5
"""neighbouring points behind a local slope"""
CLEAR = 3.0
"""standard errors by which a force must exceed friction, and a slope must change"""
PLACES = (0.05, 0.5, 0.95)
"""places of the range of ln v at which the trend is read"""


@dataclass(frozen=True, eq=False)
class SlopeDiagnosis:
    """d ln(F − F_c)/d ln v over speed.

    Attributes
    ----------
    speed, slope, std : (m,) array
        Local slopes over five neighbouring points, at their mean ln v [m/s].
    ends : (3,) array
        Slopes of the smoothing cubic at the slow end, in the middle, at the fast end.
    ends_std : (3,) array
    trend : str
        ``"rising"``, ``"falling"``, ``"rising, then falling"``, ``"falling, then rising"``, ``"constant"``.
    points_left_out : int
        Points whose force does not exceed the friction.
    """

    speed: np.ndarray
    slope: np.ndarray
    std: np.ndarray
    ends: np.ndarray
    ends_std: np.ndarray
    trend: str
    points_left_out: int

    @property
    def network(self) -> str | None:
        """The network whose signature this is, where there is one."""
        return {"rising": "series", "falling": "parallel", "rising, then falling": "mixed"}.get(self.trend)

    def __repr__(self) -> str:
        a, b, c = (f"{s:.2f} ± {e:.2f}" for s, e in zip(self.ends, self.ends_std, strict=True))
        points = f", {self.points_left_out} slow point(s) below the friction's error" if self.points_left_out else ""
        return f"slope d ln(F − F_c)/d ln v {a} slow, {b} mid, {c} fast: {self.trend}{points}"


def log_slopes(points: Points, friction: float, friction_std: float = 0.0) -> SlopeDiagnosis:
    """Diagnose the order of losses by the slopes of the log-log curve, 1 for laminar and 2 for turbulent.

    Friction must be known: F_c + c v^m has a slope below m at low speed whatever the network. Its error enters those of
    the slopes.

    Parameters
    ----------
    points : Points
        One flow direction; the errors are taken as they stand.
    friction : float
        F_c [N], of a fit.
    friction_std : float
        [N].

    Returns
    -------
    SlopeDiagnosis
        Local slopes, those of a smoothing cubic at three places, and their trend.

    Raises
    ------
    InputError
        Fewer than six forces exceed friction clearly.

    Examples
    --------
    >>> v = np.geomspace(1e-5, 1e-2, 13)
    >>> log_slopes(Points(v, v + 1e3 * v**2, np.full(13, 1e-3)), 0.0).trend
    'rising'
    """
    net = points.force - friction
    error = np.hypot(points.force * points.error, friction_std)
    keep = net > CLEAR * error
    if keep.sum() < 6:
        raise InputError("too few points exceed the friction", got=f"{keep.sum()} of {keep.size}, 6 needed",
                         mend="higher speeds, or more repeats")
    u, y = np.log(points.speed[keep]), np.log(net[keep])
    sigma = points.force[keep] * points.error[keep] / net[keep]
    shift = friction_std / net[keep]  # d ln(F − F_c) for one standard error of friction, common to all points
    rows = [slice(k, k + WINDOW) for k in range(u.size - WINDOW + 1)]
    local = [_line(u[r], y[r], sigma[r], shift[r]) for r in rows]
    at, slope, std = (np.array(c) for c in zip(*local, strict=True))
    ends, covariance = _cubic(u, y, sigma, shift)
    return SlopeDiagnosis(np.exp(at), slope, std, ends, np.sqrt(np.diag(covariance)), _trend(ends, covariance),
                          int((~keep).sum()))


def _line(u: np.ndarray, y: np.ndarray, sigma: np.ndarray, shift: np.ndarray) -> tuple[float, float, float]:
    w = 1.0 / sigma**2
    centre = float(w @ u / w.sum())
    gain = w * (u - centre) / float(w @ (u - centre) ** 2)
    return centre, float(gain @ y), float(np.hypot(np.sqrt(gain**2 @ sigma**2), gain @ shift))


def _cubic(u: np.ndarray, y: np.ndarray, sigma: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes of a weighted cubic at three places, and their covariance, which covers the misfit of the cubic too."""
    half = 0.5 * (u[-1] - u[0])
    s = (u - u[0]) / half - 1.0
    design = np.polynomial.legendre.legvander(s, 3)
    solver = np.linalg.pinv(design / sigma[:, None]) / sigma
    coefficients = solver @ y
    residual = (y - design @ coefficients) / sigma
    scale = max(1.0, float(residual @ residual) / max(u.size - 4, 1))
    read = np.array([np.polynomial.legendre.legval(2 * np.array(PLACES) - 1, np.polynomial.legendre.legder(e))
                     for e in np.eye(4)]).T / half
    gain = read @ solver
    drag = gain @ shift
    return read @ coefficients, scale * (gain * sigma**2) @ gain.T + np.outer(drag, drag)


def _trend(ends: np.ndarray, covariance: np.ndarray) -> str:
    step = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [-1.0, 0.0, 1.0]])
    change, std = step @ ends, np.sqrt(np.maximum(np.diag(step @ covariance @ step.T), 1e-300))
    sense = np.where(np.abs(change) > CLEAR * std, np.sign(change), 0).astype(int)
    if sense[0] * sense[1] < 0:
        return "rising, then falling" if sense[0] > 0 else "falling, then rising"
    whole = sense[2] or sense[0] or sense[1]
    return {1: "rising", -1: "falling", 0: "constant"}[int(whole)]
