"""Hydraulic networks of laminar and turbulent losses, between pressure and flow, in the symbols of source 003."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks

SWEEPS = 36
"""steps of the inversion, each of which divides the error of ln Q by three at least: 3⁻³⁶ = 7e-18."""


def series_pressure(Q: np.ndarray | float, C_L: float, C_Q: float) -> np.ndarray:
    """Δp = C_L Q + C_Q Q|Q| (5) [Pa].

    Parameters
    ----------
    Q : array or float
        Flow [m³/s].
    C_L : float
        Laminar resistance [Pa·s/m³].
    C_Q : float
        Turbulent coefficient [Pa·s²/m⁶].

    Returns
    -------
    array
        Δp, of the shape of `Q` [Pa].
    """
    Q = np.asarray(Q, dtype=float)
    return C_L * Q + C_Q * Q * np.abs(Q)


def series_flow(dp: np.ndarray | float, C_L: float, C_Q: float) -> np.ndarray:
    """Q = 2Δp/(C_L + √(C_L² + 4C_Q|Δp|)): (5) without its cancellation, and finite for C_Q = 0 [m³/s].

    Parameters
    ----------
    dp : array or float
        Δp [Pa].
    C_L : float
        Laminar resistance [Pa·s/m³].
    C_Q : float
        Turbulent coefficient [Pa·s²/m⁶].

    Returns
    -------
    array
        Q, of the shape of `dp` [m³/s]; 0 where both losses are 0.

    Examples
    --------
    >>> float(series_flow(2.0, 1.0, 1.0))
    1.0
    """
    dp = np.asarray(dp, dtype=float)
    return _ratio(2 * dp, C_L + np.sqrt(C_L**2 + 4 * C_Q * np.abs(dp)))


def parallel_flow(dp: np.ndarray | float, a: float, b: float) -> np.ndarray:
    """Q = aΔp + b√Δp, odd (6) [m³/s].

    Parameters
    ----------
    dp : array
        Δp [Pa].
    a : float
        C_P,L⁻¹ [m³/(s Pa)]: the sum of the branches' conductances. The source prints C_P,L = Σ C_P,L,j, which holds for
        branches in series (E3.1).
    b : float
        C_P,Q⁻¹ [m³/(s √Pa)]. An element Δp = C_Q Q|Q| has b = C_Q^(−1/2): C_P,Q of (6) is √C_Q of (4) (E3.2).

    Returns
    -------
    array
        Q, of the shape of `dp` [m³/s].
    """
    dp = np.asarray(dp, dtype=float)
    return a * dp + b * np.sign(dp) * np.sqrt(np.abs(dp))


def parallel_pressure(Q: np.ndarray | float, a: float, b: float) -> np.ndarray:
    """√Δp = 2Q/(b + √(b² + 4aQ)), odd: (6) without its cancellation, and finite for a = 0 or b = 0 [Pa].

    Parameters
    ----------
    Q : array or float
        Flow [m³/s].
    a, b : float
        C_P,L⁻¹ [m³/(s Pa)] and C_P,Q⁻¹ [m³/(s √Pa)], as in `parallel_flow`.

    Returns
    -------
    array
        Δp, of the shape of `Q` [Pa]; 0 where both are 0.

    Examples
    --------
    >>> float(parallel_pressure(2.0, 1.3, 0.7))
    1.0
    """
    Q = np.asarray(Q, dtype=float)
    root = _ratio(2 * np.abs(Q), b + np.sqrt(b**2 + 4 * a * np.abs(Q)))
    return np.sign(Q) * root**2


def mixed_flow(dp: np.ndarray | float, C_L: float, C_Q: float, leak: float) -> np.ndarray:
    """Q = f_series(Δp) + leak·Δp: a series path with a laminar leak around it, leak = 1/C_leak (E3.9) [m³/s].

    Parameters
    ----------
    dp : array or float
        Δp [Pa].
    C_L : float
        Laminar resistance of the series path [Pa·s/m³].
    C_Q : float
        Its turbulent coefficient [Pa·s²/m⁶].
    leak : float
        Conductance of the leak [m³/(s Pa)].

    Returns
    -------
    array
        Q, of the shape of `dp` [m³/s].
    """
    return series_flow(dp, C_L, C_Q) + leak * np.asarray(dp, dtype=float)


def mixed_pressure(Q: np.ndarray | float, C_L: float, C_Q: float, leak: float) -> np.ndarray:
    """Inverse of `mixed_flow`, in closed form [Pa].

    With q the flow of the series path, Q = q + leak (C_L q + C_Q q²) is a quadratic in q, so that::

        q = 2Q/(P + √(P² + 4 leak C_Q Q))        P = 1 + leak C_L        Δp = C_L q + C_Q q²

    leak = 0 is the series network, C_L = 0 the parallel one with a = leak, b = C_Q^(−1/2).

    Parameters
    ----------
    Q : array or float
        Flow [m³/s].
    C_L : float
        Laminar resistance of the series path [Pa·s/m³].
    C_Q : float
        Its turbulent coefficient [Pa·s²/m⁶].
    leak : float
        Conductance of the leak [m³/(s Pa)].

    Returns
    -------
    array
        Δp, of the shape of `Q` [Pa].
    """
    Q = np.asarray(Q, dtype=float)
    size, p = np.abs(Q), 1.0 + leak * C_L
    q = 2 * size / (p + np.sqrt(p**2 + 4 * leak * C_Q * size))
    return np.sign(Q) * (C_L * q + C_Q * q**2)


def _ratio(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    return np.divide(top, bottom, out=np.zeros(np.broadcast(top, bottom).shape), where=bottom > 0)


class Path(ABC):
    """A flow path between two nodes: an element, or several in series or in parallel.

    Every composition of laminar and turbulent elements is odd and monotone, with 1 ≤ d ln Δp/d ln Q ≤ 2.
    """

    @abstractmethod
    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        """Δp that drives a flow [Pa].

        Parameters
        ----------
        flow : array or float
            Q [m³/s]; its sign is that of the pressure.

        Returns
        -------
        array
            Of the shape of `flow` [Pa].
        """

    @abstractmethod
    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        """Q under a pressure difference [m³/s].

        Parameters
        ----------
        pressure : array or float
            Δp [Pa].

        Returns
        -------
        array
            Of the shape of `pressure` [m³/s].
        """


@dataclass(frozen=True)
class Laminar(Path):
    """Δp = C_L Q (4).

    Attributes
    ----------
    resistance : float
        C_L, above zero [Pa·s/m³].
    """

    resistance: float

    def __post_init__(self) -> None:
        checks.positive(self.resistance, "laminar resistance", "Pa*s/m^3")

    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        return self.resistance * np.asarray(flow, dtype=float)

    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        return np.asarray(pressure, dtype=float) / self.resistance


@dataclass(frozen=True)
class Turbulent(Path):
    """Δp = C_Q Q|Q| (4).

    Attributes
    ----------
    coefficient : float
        C_Q, above zero [Pa·s²/m⁶].
    """

    coefficient: float

    def __post_init__(self) -> None:
        checks.positive(self.coefficient, "turbulent coefficient", "Pa*s^2/m^6")

    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        return series_pressure(flow, 0.0, self.coefficient)

    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        return series_flow(pressure, 0.0, self.coefficient)


class Series(Path):
    """Paths one after the other: one flow, the pressures add.

    Parameters
    ----------
    *parts : Path
        One at least.

    Examples
    --------
    >>> round(float(Series(Laminar(1.0), Turbulent(1.0)).flow(2.0)), 12)
    1.0
    """

    def __init__(self, *parts: Path) -> None:
        self.parts = _some(parts, "Series")

    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        return np.sum([p.pressure(flow) for p in self.parts], axis=0)

    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        return invert_odd(self.pressure, np.asarray(pressure, dtype=float), 1.5, self.parts[0].flow)


class Parallel(Path):
    """Paths side by side: one pressure, the flows (the conductances, E3.1) add.

    Parameters
    ----------
    *parts : Path
        One at least.

    Examples
    --------
    >>> float(Parallel(Laminar(2.0), Laminar(2.0)).pressure(1.0))
    1.0
    """

    def __init__(self, *parts: Path) -> None:
        self.parts = _some(parts, "Parallel")

    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        return np.sum([p.flow(pressure) for p in self.parts], axis=0)

    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        return invert_odd(self.flow, np.asarray(flow, dtype=float), 0.75, self.parts[0].pressure)


def _some(parts: tuple[Path, ...], name: str) -> tuple[Path, ...]:
    if not parts:
        raise InputError(f"{name} needs at least one path")
    return parts


def invert_odd(function: Callable[[np.ndarray], np.ndarray], target: np.ndarray, slope: float,
              guess: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Solve function(u) = target for an odd function whose log-log slope s is known to lie in slope·[2/3, 4/3].

    ln u ← ln u + (ln target − ln f(u))/slope multiplies the error of ln u by 1 − s/slope, at most a third: it converges
    from anywhere, without a derivative or a bracket.

    Parameters
    ----------
    function : callable
        Of positive arrays, rising.
    target : array
        Values wanted, of either sign.
    slope : float
        Middle of the log-log slopes that are possible.
    guess : callable
        Of positive targets: where to start, above zero.

    Returns
    -------
    array
        u, of the shape of `target`; 0 where that is 0.
    """
    size = np.abs(target)
    moving = size > 0
    goal = np.log(np.where(moving, size, 1.0))
    u = np.log(np.where(moving, np.abs(guess(np.where(moving, size, 1.0))), 1.0))
    for _ in range(SWEEPS):
        step = (goal - np.log(function(np.exp(u)))) / slope
        u = u + step
        if np.all(np.abs(step[moving]) < 1e-15):
            break
    return np.where(moving, np.sign(target) * np.exp(u), 0.0)
