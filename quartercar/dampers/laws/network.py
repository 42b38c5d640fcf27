"""Hydraulic networks as dampers (source 003): laminar and turbulent losses in series, in parallel, and mixed."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.parameter import Parameter

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder

SIDES = ("extension", "compression")
STATICS = (Parameter("friction", "N", "Coulomb friction F_c", 20.0, 0.0),
           Parameter("offset", "N", "constant F_0: gas preload, zero of the load cell", 0.0))
LAMINAR = Parameter("laminar_damping", "N*s/m", "laminar loss c_L = A_p² C_L", 1000.0, 0.0)
QUADRATIC = Parameter("quadratic_damping", "N*s^2/m^2", "turbulent loss c_Q = A_p³ C_Q", 2000.0, 0.0)
ORIFICE = Parameter("orifice_mobility", "m/(s*N^0.5)", "turbulent path c_Q^(−1/2) = A_p^(−3/2) C_Q^(−1/2)", 0.02, 0.0)
LEAK = Parameter("leak_mobility", "m/(N*s)", "laminar leak 1/c_leak = 1/(A_p² C_leak)", 1e-4, 0.0)
SHARES = (0.0, 0.03, 0.1, 0.3, 0.6, 0.9, 1.0)
"""trial shares of the laminar loss at the largest speed"""
LEAKS = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""trial leaks, in units of the reciprocal loss at the largest speed"""
SAMPLES = 2000
"""samples that rank the starts"""


def network_force(speed: np.ndarray, laminar: float, quadratic: float, leak: float) -> np.ndarray:
    """Force of a mixed network at speeds ≥ 0, `hydraulics.mixed_pressure` in the force domain [N].

    F = c_L q + c_Q q², q + F/c_leak = v; series for leak = 0, parallel for laminar = 0.

    Parameters
    ----------
    speed : (n,) array
        |v|, not below zero [m/s].
    laminar : float
        c_L [N·s/m].
    quadratic : float
        c_Q [N·s²/m²].
    leak : float
        1/c_leak [m/(N·s)].

    Returns
    -------
    (n,) array
        [N].
    """
    q, _ = _path_speed(speed, laminar, quadratic, leak)
    return (laminar + quadratic * q) * q


def network_gradient(speed: np.ndarray, laminar: float, quadratic: float, leak: float) -> np.ndarray:
    """(n, 4) derivative of `network_force` in c_L, c_Q, 1/c_leak and speed.

    With D = 1 + (c_L + 2c_Q q)/c_leak: ∂F/∂c_L = q/D, ∂F/∂c_Q = q²/D, ∂F/∂(1/c_leak) = −F F_q/D, ∂F/∂v = F_q/D.

    Parameters
    ----------
    speed : (n,) array
        |v|, not below zero [m/s].
    laminar : float
        c_L [N·s/m].
    quadratic : float
        c_Q [N·s²/m²].
    leak : float
        1/c_leak [m/(N·s)].

    Returns
    -------
    (n, 4) array
        [N per unit of the argument].
    """
    q, d = _path_speed(speed, laminar, quadratic, leak)
    slope = laminar + 2 * quadratic * q
    return np.column_stack([q / d, q**2 / d, -(laminar + quadratic * q) * q * slope / d, slope / d])


def _root_force(speed: np.ndarray, orifice: float, leak: float) -> tuple[np.ndarray, np.ndarray]:
    """s = √F from a s² + b s = v, and 2as + b."""
    bottom = np.sqrt(orifice**2 + 4 * leak * speed)
    return np.divide(2 * speed, orifice + bottom, out=np.zeros(speed.shape), where=bottom > 0), bottom


def _path_speed(speed: np.ndarray, laminar: float, quadratic: float, leak: float) -> tuple[np.ndarray, np.ndarray]:
    """Speed that the series path carries, and D."""
    p = 1.0 + leak * laminar
    d = np.sqrt(p**2 + 4 * leak * quadratic * speed)
    return 2 * speed / (p + d), d


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class NetworkDamper(StaticDamper):
    """What the networks share::

        F = sign(v) F_network(|v|) + F_c tanh(v/ε) + F_0

    in the force domain, F = A_p Δp and Q = A_p v, so that c_L = A_p² C_L, c_Q = A_p³ C_Q. Friction is identified with
    the rest; subtracting min F first, as the source does, forces one residual to zero and biases c_L (E3.7).

    Attributes
    ----------
    asymmetric : bool
        Whether extension and compression have their own network (E3.8).
    smoothing : float
        ε [m/s]: below it friction turns with the velocity instead of jumping.
    """

    of_typical_size: ClassVar[bool] = True
    asymmetric: bool = False
    smoothing: float = 1e-3
    reads: ClassVar[tuple[str, ...]] = ("velocity",)

    @property
    @abstractmethod
    def network(self) -> tuple[Parameter, ...]:
        """Parameters of one network."""

    @abstractmethod
    def _network_law(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(n,) force of one network at speeds ≥ 0 [N]."""

    @abstractmethod
    def _network_slopes(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(n, k) derivative of `_network_law` in its parameters."""

    @abstractmethod
    def network_vector(self, laminar: float, quadratic: float, leak: float) -> np.ndarray:
        """(k,) parameters of the network with these c_L, c_Q, 1/c_leak, those dropped that it has not.

        Parameters
        ----------
        laminar : float
            c_L [N·s/m].
        quadratic : float
            c_Q [N·s²/m²].
        leak : float
            1/c_leak [m/(N·s)].

        Returns
        -------
        (k,) array
            In the order of `network`, SI.
        """

    def check_settings(self) -> None:
        checks.positive(self.smoothing, "smoothing", "m/s")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        if not self.asymmetric:
            return (*self.network, *STATICS)
        sided = [replace(p, name=f"{p.name}_{side}", description=f"{p.description}, {side}")
                 for side in SIDES for p in self.network]
        return (*sided, *STATICS)

    @classmethod
    def suited(cls, facts: Facts) -> Self:
        """Any moving record: a network per direction, friction smoothed over 1 % of the top speed."""
        if facts.speed <= 0:
            raise InputError(f"{cls.name} needs motion", got="zero velocity throughout")
        return cls(asymmetric=True, smoothing=facts.turning_speed, **facts.common)

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        raise InputError(f"'{self.name}' has no exported step", why="its force solves an equation of its own",
                         mend="fit and export 'power-law-friction-gas', or 'force-map'")

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        hydraulic = np.zeros(velocity.size)
        for sign, places in self._sides():
            moving = np.maximum(sign * velocity, 0.0)
            hydraulic += sign * self._network_law(moving, vector[places])
        return hydraulic + vector[-2] * np.tanh(velocity / self.smoothing) + vector[-1]

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        out = np.zeros((velocity.size, vector.size))
        for sign, places in self._sides():
            moving = np.maximum(sign * velocity, 0.0)
            out[:, places] += sign * self._network_slopes(moving, vector[places])
        out[:, -2] = np.tanh(velocity / self.smoothing)
        out[:, -1] = 1.0
        return out

    def _sides(self) -> tuple[tuple[float, slice], ...]:
        k = len(self.network)
        return (1.0, slice(0, k)), (-1.0, slice(k, 2 * k) if self.asymmetric else slice(0, k))

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """A grid over laminar share and leak; force scale, friction and offset by least squares; the best first."""
        from quartercar.dampers.fitting.starting import nonnegative_fit

        v, f = joined(drives, "velocity", "force")
        keep = slice(None, None, -(-v.size // SAMPLES))
        v, f, top = v[keep], f[keep], float(np.abs(v).max())
        shares = SHARES if LAMINAR in self.network else (0.0,)
        leaks = LEAKS if LEAK in self.network else (0.0,)
        grid = [(s, 1.0 - s, h) for s in shares for h in leaks]
        rest = [np.tanh(v / self.smoothing), np.ones(v.size), -np.ones(v.size)]
        ranked = []
        for share, turbulent, leak in grid:
            shape = [network_force(np.maximum(sign * v, 0.0), share / top, turbulent / top**2, leak)
                     for sign in (1, -1)]
            columns = [shape[0], -shape[1]] if self.asymmetric else [shape[0] - shape[1]]
            found, cost = nonnegative_fit(np.column_stack([*columns, *rest]), f)
            sides = [self.network_vector(k * share / top, k * turbulent / top**2, leak / k)
                     for k in np.maximum(found[:-3], 1e-12 * float(np.abs(f).max()))]
            ranked.append((cost, np.concatenate([*sides, [found[-3], found[-2] - found[-1]]])))
        ranked.sort(key=lambda pair: pair[0])
        return [vector for _, vector in ranked[:count]]

    @property
    def linear(self) -> tuple[str, ...]:
        hydraulic = () if LEAK in self.network else self.names[:-2]
        return (*hydraulic, *self.names[-2:])

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return np.full(np.shape(displacement), self.values["offset"])

    def to_lpv(self, sample_time: float) -> Any:
        raise self.without_lpv_form()


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SeriesNetwork(NetworkDamper):
    """A laminar and a turbulent loss one after the other: F = c_L|v| + c_Q v², resisting.

    Source 003, (5). Log-log slope 1 → 2 with rising speed; equal shares at v_t = c_L/c_Q.

    Examples
    --------
    >>> s = SeriesNetwork(values={"laminar_damping": 1e5, "quadratic_damping": 1e8, "friction": 0.0}, smoothing=1e-5)
    >>> s.force(0.0, [-1e-3, 1e-3, 2e-3]).round(9)
    array([-200.,  200.,  600.])
    """

    name: ClassVar[str] = "network-series"
    title: ClassVar[str] = "Series network"
    source: ClassVar[str] = "source 003, (5)"
    network: ClassVar[tuple[Parameter, ...]] = LAMINAR, QUADRATIC

    def _network_law(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return network_force(speed, theta[0], theta[1], 0.0)

    def _network_slopes(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return network_gradient(speed, theta[0], theta[1], 0.0)[:, :2]

    def network_vector(self, laminar: float, quadratic: float, leak: float) -> np.ndarray:
        return np.array([laminar, quadratic])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ParallelNetwork(NetworkDamper):
    """A laminar leak beside a turbulent orifice: v = F/c_leak + √(F/c_Q), resisting.

    Source 003, (6), with a = 1/c_leak and b = c_Q^(−1/2) (E3.2) as its parameters: either may be zero. Log-log
    slope 2 → 1 with rising speed; equal shares at F_t = c_leak²/c_Q, that is v_t = 2 c_leak/c_Q.

    Examples
    --------
    >>> p = ParallelNetwork(values={"orifice_mobility": 0.7, "leak_mobility": 1.3, "friction": 0.0})
    >>> p.force(0.0, [2.0, -2.0]).round(9)
    array([ 1., -1.])
    """

    name: ClassVar[str] = "network-parallel"
    title: ClassVar[str] = "Parallel network"
    source: ClassVar[str] = "source 003, (6)"
    network: ClassVar[tuple[Parameter, ...]] = ORIFICE, LEAK

    def _network_law(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """`hydraulics.parallel_pressure` in the force domain."""
        return _root_force(speed, theta[0], theta[1])[0] ** 2

    def _network_slopes(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """By c_Q^(−1/2) and 1/c_leak: −2s²/(2as + b), −2s³/(2as + b), s = √F."""
        root, bottom = _root_force(speed, theta[0], theta[1])
        common = np.divide(-2 * root**2, bottom, out=np.zeros_like(root), where=bottom > 0)
        return np.column_stack([common, common * root])

    def network_vector(self, laminar: float, quadratic: float, leak: float) -> np.ndarray:
        return np.array([max(quadratic, 1e-300) ** -0.5, leak])


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class MixedNetwork(NetworkDamper):
    """A series path with a laminar leak around it: v = v_series(F) + F/c_leak, resisting.

    Equations.md E3.9, which the source does not test. Log-log slope 1, towards 2, and back to 1. Without leak it is the
    series network, without laminar loss in the main path the parallel one.

    Examples
    --------
    >>> m = MixedNetwork(values={"laminar_damping": 1.0, "quadratic_damping": 1.0, "leak_mobility": 0.5,
    ...                          "friction": 0.0})
    >>> m.force(0.0, 2.0).round(9)
    array([2.])
    """

    name: ClassVar[str] = "network-mixed"
    title: ClassVar[str] = "Mixed network"
    source: ClassVar[str] = "equations.md, E3.9"
    network: ClassVar[tuple[Parameter, ...]] = LAMINAR, QUADRATIC, LEAK

    def _network_law(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return network_force(speed, theta[0], theta[1], theta[2])

    def _network_slopes(self, speed: np.ndarray, theta: np.ndarray) -> np.ndarray:
        return network_gradient(speed, theta[0], theta[1], theta[2])[:, :3]

    def network_vector(self, laminar: float, quadratic: float, leak: float) -> np.ndarray:
        return np.array([laminar, quadratic, leak])
