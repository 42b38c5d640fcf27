"""GeneralizedPlant: an LPV system whose signals are sorted, by name, into w, u, z and y."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import signal_names
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Scheduling


@dataclass(frozen=True, eq=False)
class PlantMatrices:
    """The blocks of a generalised plant at N points of the scheduling; every array starts with that axis.

    Attributes
    ----------
    A, B1, B2 : (N, n, n), (N, n, n_w) and (N, n, n_u) arrays
        Of ẋ, or of x⁺.
    C1, D11, D12 : (N, n_z, n), (N, n_z, n_w) and (N, n_z, n_u) arrays
        Of the performance signals z.
    C2, D21, D22 : (N, n_y, n), (N, n_y, n_w) and (N, n_y, n_u) arrays
        Of the measurements y.
    """

    A: np.ndarray
    B1: np.ndarray
    B2: np.ndarray
    C1: np.ndarray
    D11: np.ndarray
    D12: np.ndarray
    C2: np.ndarray
    D21: np.ndarray
    D22: np.ndarray

    def point(self, k: int | slice | Sequence[int]) -> PlantMatrices:
        """The blocks at one point, as matrices; or at some of the points.

        Parameters
        ----------
        k : int, slice or sequence of int
            Which of the N points.

        Returns
        -------
        PlantMatrices
            Without the first axis, where k is a number.
        """
        return PlantMatrices(*(getattr(self, f)[k] for f in self.__dataclass_fields__))


def refuse_offsets(system: LPVStateSpace, what: str) -> None:
    """Raise for a system with constant terms.

    Parameters
    ----------
    system : LPVStateSpace
        The system.
    what : str
        What it is to be, for the error.

    Raises
    ------
    InputError
        A state or output offset that is not zero.
    """
    for name in ("state_offset", "output_offset"):
        if np.any(getattr(system, name)):
            raise InputError(f"{what} has no constant terms", got=f"{name} is not zero",
                             mend="shift states and outputs to the equilibrium first")


@dataclass(frozen=True, eq=False)
class GeneralizedPlant:
    """What a controller is designed for.

    ::

              ┌──────────────┐
        w ───>│  system(p)   │───> z        ẋ or x⁺ = A x + B1 w + B2 u
        u ─┬─>│              │─┬─> y              z = C1 x + D11 w + D12 u
           │  └──────────────┘ │                  y = C2 x + D21 w + D22 u
           │  ┌──────────────┐ │
           └──│ controller(p)│<┘
              └──────────────┘

    Parameters
    ----------
    system : LPVStateSpace
        Its inputs are w and u, its outputs z and y, in any order; its `scheduling` carries box and rate bounds.
    controls : sequence of str
        Names of the inputs u; all other inputs are disturbances w.
    measurements : sequence of str
        Names of the outputs y; all others are performance signals z.

    Raises
    ------
    InputError
        Names that the system does not have; no disturbance or no performance signal left; affine terms or an input
        stage in the system.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> system = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [1.0]]], [[[0.0, 1.0], [1.0, 0.0]]],
    ...                        Polynomial((), 0), None, inputs=(Signal("road"), Signal("force")),
    ...                        outputs=(Signal("comfort"), Signal("sensor")))
    >>> plant = GeneralizedPlant(system, controls=["force"], measurements=["sensor"])
    >>> plant.disturbances, plant.performance
    (('road',), ('comfort',))
    """

    system: LPVStateSpace
    controls: tuple[str, ...]
    measurements: tuple[str, ...]

    def __post_init__(self) -> None:
        inputs, outputs = signal_names(self.system.inputs), signal_names(self.system.outputs)
        for field, known in (("inputs", inputs), ("outputs", outputs)):
            if len(set(known)) != len(known):
                raise InputError(f"two {field} of a plant bear one name", got=", ".join(known), mend="rename one")
        for field, known in (("controls", inputs), ("measurements", outputs)):
            chosen: Sequence[str] = getattr(self, field)
            chosen = (chosen,) if isinstance(chosen, str) else tuple(chosen)
            if len(set(chosen)) != len(chosen):
                raise InputError(f"{field} of a plant are named once each", got=", ".join(chosen))
            object.__setattr__(self, field, tuple(_checks.known_name(n, known, field[:-1]) for n in chosen))
        if self.system.input_stage is not None:
            raise InputError("a plant for synthesis is linear in its inputs", got="a system with an input stage",
                             mend="put the stage's inverse into the controller and design for the linear part")
        refuse_offsets(self.system, "a plant for synthesis")
        if not self.disturbances or not self.performance:
            raise InputError("a plant needs a disturbance and a performance signal that are neither control nor "
                             "measurement", got=f"inputs {', '.join(inputs)}; outputs {', '.join(outputs)}")

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Names of w."""
        return tuple(n for n in signal_names(self.system.inputs) if n not in self.controls)

    @property
    def performance(self) -> tuple[str, ...]:
        """Names of z."""
        return tuple(n for n in signal_names(self.system.outputs) if n not in self.measurements)

    @property
    def box(self) -> Scheduling:
        """Scheduling variables, their box and rate bounds."""
        return self.system.box

    @property
    def order(self) -> int:
        """Number of states."""
        return self.system.order

    @property
    def sample_time(self) -> float | None:
        """Sampling period [s]; None in continuous time."""
        return self.system.sample_time

    def parted(self, a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, ...]:
        """Matrices of the whole system sorted by its signals.

        Parameters
        ----------
        a, b, c, d : (N, …) arrays
            A, B, C, D of the system, in the order of its inputs and outputs.

        Returns
        -------
        tuple of arrays
            A, B1, B2, C1, D11, D12, C2, D21 and D22.
        """
        inputs, outputs = signal_names(self.system.inputs), signal_names(self.system.outputs)
        w, u = ([inputs.index(n) for n in names] for names in (self.disturbances, self.controls))
        z, y = ([outputs.index(n) for n in names] for names in (self.performance, self.measurements))
        return (a, b[:, :, w], b[:, :, u], c[:, z], d[:, z][:, :, w], d[:, z][:, :, u], c[:, y], d[:, y][:, :, w],
                d[:, y][:, :, u])

    def at(self, points: np.ndarray) -> PlantMatrices:
        """The blocks at points of shape (N, n_scheduling).

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the units of the box.

        Returns
        -------
        PlantMatrices
            In SI of the signals.
        """
        return PlantMatrices(*self.parted(*self.system.at(points)))
