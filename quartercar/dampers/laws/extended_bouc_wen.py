"""ExtendedBoucWen: hysteresis with parameters by direction and current, gas spring, and lagged current; source 002."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lpvid.toolkit import checks
from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.semi_active import SemiActiveDamper, gas_spring, proposed_nodes, sub_steps
from quartercar.dampers.parameter import POSITIVE, Parameter
from quartercar.dampers.real_time import RealTime
from quartercar.dampers.sizes import Sizes

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder

DIRECTIONS = ("compression", "rebound")
ROW = (
    Parameter("damping", "N*s/m", "damping c_0", 1000.0, 0.0),
    Parameter("stiffness", "N/m", "stiffness k_0 beside it", 1000.0, 0.0),
    Parameter("roll_off_damping", "N*s/m", "damping c_1 in series, low-speed roll-off", 20000.0, POSITIVE,
              log=True, search=(10.0, math.inf)),
    Parameter("yield_force", "N", "force alpha of the saturated hysteresis", 100.0, 0.0),
    Parameter("sharpness", "1/m", "slope delta of the hysteresis at z = 0", 1000.0, POSITIVE, log=True,
              search=(1.0, 1e7)),
    Parameter("unloading", "", "gamma/delta; 1/2: unloads as stiffly as it loads at first", 0.7, 0.5, 5.0),
)
"""parameters of one current and one direction"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ExtendedBoucWen(SemiActiveDamper):
    """F = c_1 ẏ + k_1 (x_d − x_0), with parameters by current u_f and direction of v_d.

        ẏ = [α z + c_0 v_d + k_0 (x_d − y)]/(c_0 + c_1),      r = v_d − ẏ
        ż = δ r − γ |r| z |z|^{n−1} − β r |z|^n,              δ = β + γ
        θ = s θ_rebound(u_f) + (1 − s) θ_compression(u_f),    s = ½ tanh(v_d/ε) + ½

    The scale of z is free in the paper's seven parameters; δ = β + γ makes |z| = 1 the saturated state, so that α is a
    force and six numbers are left. All are linear between the nodes of the current, which keeps δ = β + γ.

    The pair (y, z) is integrated by L-stable implicit steps of at most 1 ms. On a sine of 25 mm, 0.8 Hz sampled at 1 ms
    its force stays within 7e-4 of the force's standard deviation (rms 3e-5) from a Radau solution to 1e-10, for
    sharpnesses from 5e3 to 1e6 1/m; the classical Runge-Kutta method at 1 ms is 20 % off at 2e4 and diverges from 5e4.

    Attributes
    ----------
    exponent : float
        n.

    References
    ----------
    Source 002 (doi 10.3384/ECP14096283), equations (1) to (5), with the redundancy of z removed.

    Examples
    --------
    >>> damper = ExtendedBoucWen(nodes=(0.1, 0.5), current_unit="1")
    >>> len(damper.parameters)  # 2 nodes, 2 directions, 6 each; gas; T and τ by edge and direction
    34
    >>> round(damper.fastest_rate(0.13, current=0.5))  # 1/s, so that Runge-Kutta 4 takes steps up to 12 ms
    218
    """

    name: ClassVar[str] = "extended-bouc-wen"
    title: ClassVar[str] = "Generalised extended Bouc-Wen"
    source: ClassVar[str] = "source 002, equations (1)-(5)"
    exponent: float = 2.0
    row_parameters: ClassVar[tuple[Parameter, ...]] = tuple(
        Parameter(f"{p.name}_{d}", p.unit, f"{p.description}, {d}",
                  p.default * (2 if d == "rebound" and p.name in ("damping", "yield_force") else 1),
                  p.lower, p.upper, p.log, p.search) for d in DIRECTIONS for p in ROW)
    gas_parameters: ClassVar[tuple[Parameter, ...]] = gas_spring(True)
    growing: ClassVar[tuple[str, ...]] = tuple(f"{name}_{d}" for name in ("damping", "yield_force") for d in DIRECTIONS)
    needs_displacement: ClassVar[bool] = True
    linear: ClassVar[tuple[str, ...]] = ()
    """the gas spring is, but projecting off two of so many costs more than it saves"""
    start: ClassVar[int] = 1
    forward: ClassVar[bool] = True

    def check_settings(self) -> None:
        checks.positive(self.exponent - 0.999, "exponent of the Bouc-Wen law, from 1")
        self.check_rows()

    @classmethod
    def suited(cls, facts: Facts) -> ExtendedBoucWen:
        facts.need_displacement(cls.name)
        return cls(nodes=proposed_nodes(facts), lag="full" if facts.switches else "none",
                   switch_speed=facts.turning_speed, **facts.common)

    def tables(self, vector: np.ndarray) -> np.ndarray:
        """(2, M, 7) of c_0, k_0, c_1, α, β, γ, δ for compression and rebound, over the nodes.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (2, M, 7) array
            SI; compression first.
        """
        rows = self.parted(vector)[0].reshape(self.rows, 2, len(ROW)).transpose(1, 0, 2)
        delta, share = rows[..., 4], rows[..., 5]
        turned = np.stack([(1 - share) * delta, share * delta, delta], axis=-1)
        return np.ascontiguousarray(np.concatenate([rows[..., :4], turned], axis=-1))

    # -- running -----------------------------------------------------------------------------------------------------
    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._semi_active_kernels import bouc_wen_run

        _, gas, lag = self.parted(vector)
        force = None if drive.force is None else float(drive.force[0])
        state = self.rest(drive.displacement[0], drive.velocity[0], drive.current[0], force, vector)
        times, delays = self.current_lag.unpack(lag)
        return bouc_wen_run(drive.displacement, drive.velocity, drive.current, drive.sample_time,
                            sub_steps(drive.sample_time), self.switch_speed, np.array(self.nodes), self.tables(vector),
                            times, delays, gas, float(self.exponent), state)

    def rest(self, displacement: float, velocity: float, current: float, force: float | None,
             vector: np.ndarray) -> np.ndarray:
        """(3,) u_f, y and z at the start of a run: k_0 unloaded, z by the measured force or settled at the speed.

        Parameters
        ----------
        displacement, velocity : float
            Motion at the first sample [m], [m/s].
        current : float
            Command at the first sample, taken as settled.
        force : float or None
            Measured force at the first sample [N]; None for a settled z.
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (3,) array
            u_f, y [m] and z [1], of the type of `vector`; |z| is 1 at most.
        """
        c0, _, c1, alpha = self.mixture(velocity, current, vector)[:4]
        preload = self.parted(vector)[1]
        if force is None:
            z = self._settled(velocity, c0, c1, alpha)
        elif alpha.real > 0:
            z = ((force - preload[0] * displacement - preload[1]) * (c0 + c1) / c1 - c0 * velocity) / alpha
        else:
            z = 0.0 * alpha
        z = z if abs(z.real) <= 1 else 0.0 * z + math.copysign(1.0, z.real)
        return np.array([current + 0.0 * z, displacement + 0.0 * z, z], vector.dtype)

    @staticmethod
    def _settled(velocity: float, c0, c1, alpha):
        """z at a constant speed: saturated where the yield force slips, c_1 v/α where c_1 alone takes the speed."""
        if alpha.real <= c1.real * abs(velocity):
            return 0.0 * alpha + float(np.sign(velocity))
        return c1 * velocity / alpha

    def mixture(self, velocity: float, current: float, vector: np.ndarray) -> np.ndarray:
        """(7,) c_0, k_0, c_1, α, β, γ, δ at a speed and a settled current.

        Parameters
        ----------
        velocity : float
            v_d, which separates compression and rebound [m/s].
        current : float
            u_f, in the damper's `current_unit`.
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (7,) array
            SI.
        """
        from quartercar.dampers.laws._semi_active_kernels import mixed, sense

        row = np.empty(7, vector.dtype)
        mixed(self.tables(vector), np.array(self.nodes), sense(velocity, self.switch_speed),
              current + 0.0 * vector[0], row)
        return row

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Tangents carried along the run in every table entry, lag and the first z; then the chain rule."""
        from quartercar.dampers.laws._semi_active_tangents import tangent_run

        force = None if drive.force is None else float(drive.force[0])
        begin = drive.displacement[0], drive.velocity[0], drive.current[0], force
        tables, lag = self.tables(vector), self.current_lag
        times, delays = lag.unpack(self.parted(vector)[2])
        first, last = self._touched(drive.current)
        entries, lags, initial = tangent_run(
            drive.displacement, drive.velocity, drive.current, drive.sample_time, sub_steps(drive.sample_time),
            self.switch_speed, np.array(self.nodes), tables, times, delays, float(self.exponent),
            self.rest(*begin, vector), first, last)
        out, width, gas = np.zeros((drive.n_samples, len(columns))), 2 * len(ROW), self.rows * 2 * len(ROW)
        beside = self._touched(drive.current[:1])
        for i, j in enumerate(columns):
            moved = vector.astype(complex)
            moved[j] += 1e-30j
            if beside[0] <= j // width <= beside[1] or gas <= j < gas + 2:  # what the first z depends on
                out[:, i] = initial * (np.imag(self.rest(*begin, moved)[2]) / 1e-30)
            if j < gas:
                row, place = divmod(j, width)
                if first <= row <= last:
                    side, p = divmod(place, len(ROW))
                    out[:, i] += entries[side, row - first].T @ self._chain(p, vector[j - p: j - p + len(ROW)])
            elif j < gas + 2:
                out[:, i] += (drive.displacement, 1.0)[j - gas]
            else:
                out[:, i] += np.imag(np.concatenate(lag.unpack(self.parted(moved)[2]))) / 1e-30 @ lags
        return out

    @staticmethod
    def _chain(place: int, row: np.ndarray) -> np.ndarray:
        """(7,) derivative of c_0, k_0, c_1, α, β, γ, δ in one of a row's six parameters."""
        out = np.zeros(7)
        if place < 4:
            out[place] = 1.0
        else:
            out[4:] = (1 - row[5], row[5], 1.0) if place == 4 else (-row[4], row[4], 0.0)
        return out

    def _touched(self, current: np.ndarray) -> tuple[int, int]:
        """First and last row that a command reaches; the lag never leaves the range of the command."""
        if not self.nodes:
            return 0, 0
        nodes = np.array(self.nodes)
        return (max(int(np.searchsorted(nodes, current.min(), "right")) - 1, 0),
                min(int(np.searchsorted(nodes, current.max(), "left")), nodes.size - 1))

    # -- asking ------------------------------------------------------------------------------------------------------
    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """(n,) force once z has settled, with k_0 unloaded: a stroke is too short to load it [N]."""
        out = []
        for v in np.atleast_1d(np.asarray(velocity, dtype=float)):
            c0, _, c1, alpha = self.mixture(float(v), float(current), self.vector)[:4]
            out.append(c1 * (alpha * self._settled(float(v), c0, c1, alpha) + c0 * v) / (c0 + c1))
        return np.array(out) + self.conservative_force(np.array(float(displacement)))

    def fastest_rate(self, speed: float, current: float = 0.0) -> float:
        """Fastest rate of (y, z) at speeds up to ±`speed` [1/s]: a Runge-Kutta-4 step h is unstable from 2.785/rate on.

        The largest of (α δ max(1, 2γ/δ) + k_0)/(c_0 + c_1), z being far from or leaving its saturation, and of n δ |r|,
        z being saturated while the hysteresis slips at r = (c_1 |v| − α)/(c_0 + c_1). The second can be the larger one
        by far: a sharp hysteresis ends an explicit step even where its force is small.

        Parameters
        ----------
        speed : float
            Largest speed, its sign not read [m/s].
        current : float
            u_f, in the damper's `current_unit`.

        Returns
        -------
        float
            [1/s].
        """
        rates = []
        for v in (-abs(speed), abs(speed)):
            c0, k0, c1, alpha, _, gamma, delta = self.mixture(v, current, self.vector)
            slip = max(c1 * abs(v) - alpha, 0.0) / (c0 + c1)
            rates += [(alpha * max(delta, 2 * gamma) + k0) / (c0 + c1), self.exponent * delta * slip]
        return float(max(rates))

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """The result of the step-by-step identification: many starts of so many parameters would take too long."""
        from quartercar.dampers.fitting.stepwise import stepwise_start

        return [stepwise_start(self, drives).vector]

    def row_starts(self, drives: Sequence[Drive], gas_known: bool) -> list[ExtendedBoucWen]:
        """Gas, c_0 and α from the force at higher speeds; c_1 and δ over a grid."""
        x, v, f = joined(drives, "displacement", "velocity", "force")
        fastest, stroke = float(np.abs(v).max()), float(np.ptp(x)) or Sizes.of(drives).length
        if gas_known:
            f = f - self.conservative_force(x)
        plateau = np.abs(v) > 0.3 * fastest
        sides = [g for side in (v < 0, v > 0) for g in (side * v, side * np.sign(v))]
        columns = np.column_stack([*sides, *([] if gas_known else [x, np.ones(x.size)])])[plateau]
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        found = [float(a) for a in np.linalg.lstsq(columns / size, f[plateau], rcond=1e-6)[0] / size]
        guess = {} if gas_known else {"gas_stiffness": max(found[4], 0.0), "gas_preload": found[5]}
        sized = {p.name: Sizes.of(drives).sized(p) for p in self.row_parameters}
        scale = float(np.abs(f - guess.get("gas_preload", 0.0)).max()) / fastest
        for d, c0, alpha in zip(DIRECTIONS, found[0:4:2], found[1:4:2], strict=True):
            guess[f"damping_{d}"] = max(c0, 0.02 * scale)
            guess[f"yield_force_{d}"] = max(alpha, 0.02 * scale * fastest)
        return [self.with_values(**guess, **{n: max(factor * scale, sized[n].lower) for d in DIRECTIONS
                                              for n in (f"roll_off_damping_{d}",)},
                                 **{f"sharpness_{d}": share / stroke for d in DIRECTIONS})
                for factor in (3.0, 20.0) for share in (5.0, 50.0)]

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        from quartercar.dampers.laws.semi_active_expressions import extended_bouc_wen

        tables = self.tables(self.vector)
        return lambda x, v, i: extended_bouc_wen(b, self, tables, float(self.exponent), x, v, i)

    def real_time(self, step: float = 1e-3) -> RealTime:
        from quartercar.dampers.laws._semi_active_kernels import bouc_wen_force, bouc_wen_step, mixed, sense

        vector, parts, width, n = self.vector, sub_steps(step), self.switch_speed, float(self.exponent)
        tables, nodes, gas = self.tables(vector), np.array(self.nodes), self.parted(vector)[1]
        times, delays = self.current_lag.unpack(self.parted(vector)[2])
        row = np.empty(tables.shape[2])

        def begin(x: float, v: float, u: float, buffer: np.ndarray, state: np.ndarray) -> float:
            state[:] = self.rest(x, v, u, None, vector)
            mixed(tables, nodes, sense(v, width), u, row)
            return bouc_wen_force(state, row, x, v, gas[0], gas[1])

        def advance(x0: float, x1: float, v0: float, v1: float, k: int, buffer: np.ndarray, state: np.ndarray) -> float:
            return bouc_wen_step(state, row, buffer, k, x0, x1, v0, v1, step, parts, width, nodes, tables, times,
                                 delays, gas, n)

        return RealTime(step, begin, advance, 3)
