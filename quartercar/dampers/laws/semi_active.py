"""SemiActiveDamper: what the models of source 002 share: rows of parameters over the current, a gas spring, the lag."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.errors import InputError
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import LawDamper
from quartercar.dampers.laws.current_lag import CurrentLag
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.stepper import DamperStepper, RealTimeStepper

if TYPE_CHECKING:
    from quartercar.dampers.facts import Facts
    from quartercar.dampers.real_time import RealTime

LONGEST_STEP = 1e-3
"""longest sub-step [s]"""
MOST_NODES = 6
"""a finer table than this is not proposed for data"""
FEW_NODES = 4
"""rows proposed where the current takes no few distinct levels"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SemiActiveDamper(LawDamper):
    """Parameters in rows over current nodes, linear in between and held beyond the ends, and a gas spring.

    Attributes
    ----------
    nodes : tuple of float
        Currents of the rows, rising, in `current_unit`; empty for a damper without current.
    lag : {"none", "shared", "edges", "full"}
        How many delays and time constants the current has; see `CurrentLag`.
    switch_speed : float
        ε of the switch between compression and rebound [m/s].
    """

    of_typical_size: ClassVar[bool] = True
    nodes: tuple[float, ...] = ()
    lag: str = "full"
    switch_speed: float = 5e-3

    # -- what a kind adds --------------------------------------------------------------------------------------------
    @property
    @abstractmethod
    def row_parameters(self) -> tuple[Parameter, ...]:
        """Parameters of one row, with the defaults of the lowest current."""

    @property
    @abstractmethod
    def gas_parameters(self) -> tuple[Parameter, ...]:
        """Gas spring and preload, as far as they are parameters."""

    @property
    @abstractmethod
    def growing(self) -> tuple[str, ...]:
        """Row parameters whose default grows from node to node."""

    @abstractmethod
    def row_starts(self, drives: Sequence[Drive], gas_known: bool) -> list[Self]:
        """Dampers of one row, with values, and gas where it is unknown, read off forces at one current.

        Parameters
        ----------
        drives : sequence of Drive
            At one constant current, with forces.
        gas_known : bool
            Whether the damper's own gas values hold.

        Returns
        -------
        list of SemiActiveDamper
            Of one row, without nodes.
        """

    @abstractmethod
    def real_time(self, step: float = 1e-3) -> RealTime:
        """A stepper for fixed-step simulation [s]: one sample in, one force out.

        Parameters
        ----------
        step : float
            Time from call to call [s].

        Returns
        -------
        RealTime
            Its first call starts it settled.
        """

    def stepper(self, step: float) -> DamperStepper:
        return RealTimeStepper(self, step)

    # -- settled here ------------------------------------------------------------------------------------------------
    def check_rows(self) -> None:
        """Refuse nodes that make no table.

        Raises
        ------
        InputError
            A single node, nodes that do not rise, an unknown kind of lag, a switch speed that is not positive.
        """
        if len(self.nodes) == 1 or any(b <= a for a, b in pairwise(self.nodes)):
            raise InputError(f"{self.name}: current nodes must rise and be at least two, or none at all",
                             got=str(self.nodes))
        _ = self.current_lag

    @property
    def current_lag(self) -> CurrentLag:
        """From the command to the current that counts."""
        return CurrentLag(self.lag if self.nodes else "none", self.switch_speed)

    def at(self, index: int) -> str:
        """A node with its unit, as in prose.

        Parameters
        ----------
        index : int
            Place in `nodes`, from 0.

        Returns
        -------
        str
            E.g. ``"0.5 A"``; without unit for a duty.
        """
        return f"{self.nodes[index]:g}" + (f" {self.current_unit}" if self.current_unit != "1" else "")

    @property
    def rows(self) -> int:
        """Number of rows."""
        return max(len(self.nodes), 1)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    @cached_property
    def _parameters(self) -> tuple[Parameter, ...]:
        if not self.nodes:
            return (*self.row_parameters, *self.gas_parameters)
        table = [replace(p, name=f"{p.name}_{j + 1}", description=f"{p.description} at {self.at(j)}",
                         default=p.default * (1 + j if p.name in self.growing else 1))
                 for j in range(len(self.nodes)) for p in self.row_parameters]
        return (*table, *self.gas_parameters, *self.current_lag.parameters)

    @property
    def reads(self) -> tuple[str, ...]:
        gas = ("displacement",) if self.needs_displacement else ()
        return (*gas, "velocity", *(("current",) if self.nodes else ()))

    @property
    @abstractmethod
    def needs_displacement(self) -> bool:
        """Whether it reads the displacement."""

    def parted(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (M, R), gas (2,) stiffness and preload, and lag part of a vector.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI, real or complex.

        Returns
        -------
        rows : (M, R) array
            One row for each node, in the order of `row_parameters`; a single one without nodes.
        gas : (2,) array
            k_1 [N/m] and F_0 [N]; k_1 is 0 where it is no parameter.
        lag : array
            Values of the parameters of `current_lag`; empty without one.
        """
        width, springs = self._sizes
        table = vector[: self.rows * width].reshape(self.rows, width)
        end = self.rows * width + springs
        gas = np.zeros(2, vector.dtype)
        gas[2 - springs:] = vector[self.rows * width: end]
        return table, gas, vector[end:]

    @cached_property
    def _sizes(self) -> tuple[int, int]:
        """Numbers of parameters of a row and of the gas spring."""
        return len(self.row_parameters), len(self.gas_parameters)

    def row(self, index: int) -> Self:
        """The damper at one node, without current.

        Parameters
        ----------
        index : int
            Place of the node, from 0; not read without nodes.

        Returns
        -------
        SemiActiveDamper
            Of one row, with this damper's gas values; the damper itself without nodes.
        """
        if not self.nodes:
            return self
        values = {p.name: self.values[f"{p.name}_{index + 1}"] for p in self.row_parameters}
        return replace(self, nodes=(), values={**values, **self.gas_values}, current_range=None)

    def with_row(self, index: int, row: Self) -> Self:
        """The same damper with one row and the gas spring taken from another one.

        Parameters
        ----------
        index : int
            Place of the node, from 0; not read without nodes.
        row : SemiActiveDamper
            Of one row, without nodes.

        Returns
        -------
        SemiActiveDamper
            A copy.
        """
        mark = f"_{index + 1}" if self.nodes else ""
        return self.with_values(**{f"{p.name}{mark}": row.values[p.name] for p in self.row_parameters},
                                **row.gas_values)

    @property
    def gas_values(self) -> dict[str, float]:
        """Gas parameters by name."""
        return {p.name: self.values[p.name] for p in self.gas_parameters}

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        return self.values.get("gas_stiffness", 0.0) * np.asarray(displacement) + self.values["gas_preload"]

    def to_lpv(self, sample_time: float) -> Any:
        raise InputError(f"no LPV form of '{self.name}'",
                         why="its current is delayed by times that switch with the motion",
                         mend="fit lpv-arx, or lpvid's own LPV estimates, to the same records")

    def jacobian(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        return self.sensitivity(drive, vector, range(vector.size))


def proposed_nodes(facts: Facts) -> tuple[float, ...]:
    """Levels of the current where they are few, else rows evenly over its range; none where it is constant.

    Parameters
    ----------
    facts : Facts
        Levels and range of the current in the training records.

    Returns
    -------
    tuple of float
        Rising, in the unit of the records' current; at most `MOST_NODES`.
    """
    if not facts.current_varies or facts.current_range is None:
        return ()
    if 2 <= len(facts.levels) <= MOST_NODES:
        return facts.levels
    low, high = facts.current_range
    return tuple(float(u) for u in np.linspace(low, high, FEW_NODES))


def gas_spring(displacement: bool) -> tuple[Parameter, ...]:
    """Parameters of F_gas = k_1 (x_d − x_0) = k_1 x_d + F_0; the constant alone where no displacement is read.

    Parameters
    ----------
    displacement : bool
        Whether the damper reads the displacement.

    Returns
    -------
    tuple of Parameter
        ``gas_stiffness`` where it does, and ``gas_preload``.
    """
    constant = Parameter("gas_preload", "N", "force at rest F_0 = -k_1 x_0", 0.0)
    return (Parameter("gas_stiffness", "N/m", "gas spring k_1", 1000.0, 0.0), constant) if displacement else (constant,)


def sub_steps(period: float) -> int:
    """Sub-steps of a sampling interval.

    Parameters
    ----------
    period : float
        Sampling interval [s].

    Returns
    -------
    int
        At least one; none is longer than `LONGEST_STEP`.
    """
    return max(1, math.ceil(period / LONGEST_STEP - 1e-9))
