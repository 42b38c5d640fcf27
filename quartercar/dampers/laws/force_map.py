"""ForceMap: force looked up over velocity and current, a gas spring, and the lag of the current; source 002."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar
from weakref import WeakKeyDictionary

import numpy as np

from lpvid.errors import InputError
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.current_lag import CurrentLag
from quartercar.dampers.laws.semi_active import SemiActiveDamper, gas_spring, proposed_nodes
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.real_time import RealTime

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder

SPREAD = (0.03, 0.1, 0.25, 0.5, 0.9)
"""knots on either side of zero that are proposed for data, as shares of the largest speed"""

_FOLLOWED: WeakKeyDictionary[Drive, tuple[tuple[CurrentLag, bytes], np.ndarray]] = WeakKeyDictionary()
"""What a lag last made of each drive's current: variable projection uses one lag with many tables."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ForceMap(SemiActiveDamper):
    """F = F_lookup(v_d, u_f) + k_1 (x_d − x_0), with T u̇_f + u_f = u(t − τ).

    The table is bilinear between its knots (velocity) and nodes (current); beyond the ends it keeps its slope in
    velocity and its value in current. At v_d = 0 it is zero for every current, so that the force at rest is the gas
    spring's alone; a table with a free entry there could not be separated from x_0.

    Attributes
    ----------
    knots : tuple of float
        Velocities of the table's columns, rising, with 0 between others [m/s].
    spring : bool
        Whether k_1 x_d is part of it; without it no displacement is read.

    References
    ----------
    Source 002 (doi 10.3384/ECP14096283), equation (6).

    Examples
    --------
    >>> ForceMap(knots=(-1.0, 0.0, 1.0), spring=False,
    ...          values={"force_compression_1": -300.0, "force_rebound_1": 900.0}).static_force(np.array([-2.0, 0.5]))
    array([-600.,  450.])
    """

    name: ClassVar[str] = "force-map"
    title: ClassVar[str] = "Force map with current lag"
    source: ClassVar[str] = "source 002, equation (6)"
    knots: tuple[float, ...] = (-0.5, -0.2, -0.05, 0.0, 0.05, 0.2, 0.5)
    spring: bool = True
    start: ClassVar[int] = 0

    def check_settings(self) -> None:
        k = self.knots
        if 0.0 not in k[1:-1] or any(b <= a for a, b in pairwise(k)):
            raise InputError("force-map: velocity knots must rise and have 0 between others", got=str(k), why="m/s")
        self.check_rows()

    @property
    def row_parameters(self) -> tuple[Parameter, ...]:
        zero = self.knots.index(0.0)
        found = []
        for j, v in enumerate(self.knots):
            place, slope = ("rebound", 2000.0) if v > 0 else ("compression", 1000.0)
            if j != zero:
                found.append(Parameter(f"force_{place}_{abs(j - zero)}", "N", f"force at {v:.4g} m/s", slope * v))
        return tuple(found)

    @property
    def gas_parameters(self) -> tuple[Parameter, ...]:
        return gas_spring(self.spring)

    @property
    def growing(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.row_parameters)

    @property
    def needs_displacement(self) -> bool:
        return self.spring

    @property
    def linear(self) -> tuple[str, ...]:
        return self.names[: self._affine]

    @property
    def _affine(self) -> int:
        width, springs = self._sizes
        return self.rows * width + springs

    @classmethod
    def suited(cls, facts: Facts) -> ForceMap:
        shares = np.array([-s for s in reversed(SPREAD)] + [0.0, *SPREAD])
        return cls(nodes=proposed_nodes(facts), knots=tuple(float(v) for v in facts.speed * shares),
                   spring=facts.has_displacement, lag="full" if facts.switches else "none",
                   switch_speed=facts.turning_speed, **facts.common)

    def table(self, vector: np.ndarray) -> np.ndarray:
        """(M, N) forces over nodes and knots [N].

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        (M, N) array
            One row for each node, a single one without nodes; the column of velocity 0 is zero [N].
        """
        rows = self.parted(vector)[0]
        return np.ascontiguousarray(np.insert(rows, self.knots.index(0.0), 0.0, axis=1))

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        from quartercar.dampers.laws._semi_active_kernels import map_run

        return map_run(drive.displacement, drive.velocity, self._followed(drive, vector), np.array(self.knots),
                       np.array(self.nodes), self.table(vector), self.parted(vector)[1])

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        from quartercar.dampers.laws._semi_active_kernels import map_columns

        n, size, zero = drive.n_samples, len(self.knots), self.knots.index(0.0)
        entries = [r * size + j for r in range(self.rows) for j in range(size) if j != zero]
        gas = (drive.displacement, np.ones(n))[0 if self.spring else 1:]
        places = np.full(self.rows * size, -1)
        for i, j in enumerate(columns):
            if j < len(entries):
                places[entries[j]] = i
        out, slope = np.zeros((n, len(columns))), np.zeros(n)
        map_columns(drive.velocity, self._followed(drive, vector), np.array(self.knots), np.array(self.nodes),
                    self.table(vector), places, out, slope)
        for i, j in enumerate(columns):
            if len(entries) <= j < self._affine:
                out[:, i] = gas[j - len(entries)]
        late = [(i, j - self._affine) for i, j in enumerate(columns) if j >= self._affine]
        if late:
            lag = self.current_lag.sensitivity(drive.current, drive.velocity, drive.sample_time, self.parted(vector)[2])
            for i, j in late:
                out[:, i] = slope * lag[:, j]
        return out

    def _followed(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        part, lag = self.parted(vector)[2], self.current_lag
        key = (lag, part.tobytes())
        if drive not in _FOLLOWED or _FOLLOWED[drive][0] != key or np.iscomplexobj(part):
            found = lag.follow(drive.current, drive.velocity, drive.sample_time, part)
            if np.iscomplexobj(part):
                return found
            _FOLLOWED[drive] = key, found
        return _FOLLOWED[drive][1]

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Three sets of time constants and delays; the table follows by least squares."""
        first, lag = self.vector, slice(self._affine, None)
        found = [first]
        for factor in (0.3, 3.0):
            moved = first.copy()
            moved[lag] *= factor
            found.append(np.clip(moved, [p.lower for p in self.parameters], [p.upper for p in self.parameters]))
        return found if self.current_lag.parameters else [first]

    def row_starts(self, drives: Sequence[Drive], gas_known: bool) -> list[ForceMap]:
        """As it stands: a table is found by linear least squares from anywhere."""
        return [self]

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        v = np.atleast_1d(np.asarray(velocity, dtype=float))
        settled = Drive(1.0, v, np.full(v.size, float(displacement)), np.full(v.size, float(current)))
        return self.response(settled, self.vector)

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        from quartercar.dampers.laws.semi_active_expressions import force_map

        knots, table = np.array(self.knots), self.table(self.vector)
        return lambda x, v, i: force_map(b, self, knots, table, x, v, i)

    def real_time(self, step: float = 1e-3) -> RealTime:
        from quartercar.dampers.laws._semi_active_kernels import map_force, map_step

        lag, vector = self.current_lag, self.vector
        knots, nodes = np.array(self.knots), np.array(self.nodes)
        table, gas = self.table(vector), self.parted(vector)[1]
        times, delays = lag.unpack(self.parted(vector)[2])

        def begin(x: float, v: float, u: float, buffer: np.ndarray, state: np.ndarray) -> float:
            state[0] = u
            return map_force(v, u, knots, nodes, table) + gas[0] * x + gas[1]

        def advance(x0: float, x1: float, v0: float, v1: float, k: int, buffer: np.ndarray, state: np.ndarray) -> float:
            return map_step(state, buffer, k, x1, v0, v1, step, lag.parts, lag.width, nodes, knots, table, times,
                            delays, gas)

        return RealTime(step, begin, advance, 1)

