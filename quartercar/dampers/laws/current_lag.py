"""CurrentLag: how a semi-active damper's valve follows its command: a delay and a first-order lag, both switched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.toolkit import checks
from quartercar.dampers.parameter import POSITIVE, Parameter

PLACES = ("compression", "compression", "rebound", "rebound")
EDGES = ("rise", "fall", "rise", "fall")
SHARING: dict[str, tuple[tuple[str, str], ...]] = {
    "none": (),
    "shared": (("time_constant", "delay"),) * 4,
    "edges": tuple((f"{e}_time", f"{e}_delay") for e in EDGES),
    "full": tuple((f"{e}_time_{p}", f"{e}_delay_{p}") for e, p in zip(EDGES, PLACES, strict=True)),
}
"""Names of (T, τ) for compression rise, compression fall, rebound rise, rebound fall, by how much they share."""
SHORTEST, LONGEST = 1e-4, 1.0
"""range of a search for the time constants in records at 1 kHz, of 10 s [s]"""
NO_LAG = 1e-12
"""time constant that stands for none [s]"""
LATEST = 0.1
"""that of the delays [s]"""


@dataclass(frozen=True)
class CurrentLag:
    """T u̇_f + u_f = u(t − τ), with T and τ by direction of motion and by edge.

        T = s T_rebound + (1 − s) T_compression, likewise τ;    s = ½ tanh(v_d/ε) + ½

    The edge is that of sign(u(t − τ) − u_f), which stays as it is after a step while u̇ is back at zero: a rise follows
    u(t − τ_rise) while that lies above u_f, a fall follows u(t − τ_fall) while that lies below; if both do, the later
    command counts; if neither does, u_f rests. The step is exact for a command that is linear between samples, and the
    delays need not be whole samples.

    Attributes
    ----------
    sharing : {"none", "shared", "edges", "full"}
        No lag; one T and one τ; by edge; by edge and direction.
    width : float
        ε of the switch [m/s].

    References
    ----------
    Source 002 (doi 10.3384/ECP14096283), block firstOrder_varT and equations (4), (5).

    Examples
    --------
    A step of 1 A, 4 ms late, reaches 1 − 1/e after one more time constant of 20 ms, whatever the sampling:

    >>> lag = CurrentLag("shared")
    >>> command = np.r_[0.0, np.ones(49)]
    >>> u = lag.follow(command, np.zeros(50), 1e-3, np.array([0.020, 0.0035]))
    >>> round(float(u[24]), 4), round(float(1 - np.exp(-1)), 4)
    (0.6321, 0.6321)
    """

    sharing: str = "full"
    width: float = 5e-3

    parts: ClassVar[int] = 2
    """sub-steps of a sample interval, in which the direction is held"""

    def __post_init__(self) -> None:
        checks.one_of(self.sharing, tuple(SHARING), "lag")
        checks.positive(self.width, "switch_speed", "m/s")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """T and τ of every edge and direction that has its own."""
        found = {}
        for place, edge, (time, delay) in zip(PLACES, EDGES, SHARING[self.sharing], strict=False):
            where = {"shared": "", "edges": f" of a {edge}", "full": f" of a {edge} in {place}"}[self.sharing]
            found[time] = Parameter(time, "s", f"time constant T{where}", 0.010, POSITIVE, log=True,
                                    search=(SHORTEST, LONGEST))
            found[delay] = Parameter(delay, "s", f"delay tau{where}", 0.005, 0.0, search=(0.0, LATEST))
        return tuple(found.values())

    def unpack(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(4,) time constants and (4,) delays of a vector in the order of `parameters`.

        Parameters
        ----------
        vector : array
            Values of `parameters`, real or complex.

        Returns
        -------
        times : (4,) array
            T of compression rise, compression fall, rebound rise, rebound fall [s]; `NO_LAG` without a lag.
        delays : (4,) array
            τ in the same order [s].
        """
        if self.sharing == "none":
            return np.full(4, NO_LAG, vector.dtype), np.zeros(4, vector.dtype)
        names = [p.name for p in self.parameters]
        pairs = SHARING[self.sharing]
        return (vector[[names.index(time) for time, _ in pairs]], vector[[names.index(delay) for _, delay in pairs]])

    def follow(self, current: np.ndarray, velocity: np.ndarray, sample_time: float, vector: np.ndarray) -> np.ndarray:
        """(n,) u_f at the samples of a command, settled at the first one.

        Parameters
        ----------
        current, velocity : (n,) array
            Command u and v_d [m/s], linear between samples.
        sample_time : float
            [s]
        vector : array
            Values of `parameters`, real or complex.

        Returns
        -------
        (n,) array
            In the unit of the command, of the type of `vector`; the command itself where it is constant or has no lag.
        """
        if self.sharing == "none" or not np.ptp(current):
            return current.astype(vector.dtype)
        from quartercar.dampers.laws._semi_active_kernels import lagged

        times, delays = self.unpack(vector)
        return lagged(current, velocity, sample_time, self.parts, self.width, times, delays)

    def sensitivity(self, current: np.ndarray, velocity: np.ndarray, sample_time: float,
                    vector: np.ndarray) -> np.ndarray:
        """(n, P) derivatives of what `follow` returns, carried along it: one run for all parameters.

        Parameters
        ----------
        current, velocity : (n,) array
            As for `follow`.
        sample_time : float
            [s]
        vector : (P,) array
            Values of `parameters`, real.

        Returns
        -------
        (n, P) array
            In the unit of the command per second.
        """
        if self.sharing == "none" or not np.ptp(current):
            return np.zeros((current.size, vector.size))
        from quartercar.dampers.laws._semi_active_tangents import lagged_tangents

        found = lagged_tangents(current, velocity, sample_time, self.parts, self.width, *self.unpack(vector))
        return found.T @ self.shares

    @property
    def shares(self) -> np.ndarray:
        """(8, P) derivatives of the four T and four τ of `unpack` in the parameters: ones and zeros."""
        return np.array([np.concatenate(self.unpack(unit)) for unit in np.eye(len(self.parameters))]).T
