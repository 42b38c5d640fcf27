"""SimulatedDamper: what a damper is in a simulation, its force; `contract.Damper` is the whole contract."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.drive import ROLES, Drive
from quartercar.dampers.parameter import Parametrised


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SimulatedDamper(Parametrised):
    """A law with named parameters, from motion and current to force: what its energy and passivity follow from.

    Attributes
    ----------
    values : mapping of str to float
        Parameters by name, SI; those left out take their defaults.
    current_range : (float, float) or None
        Currents that the fit has seen.
    current_unit : str
        Unit of what schedules the model: ``"A"``, ``"V"`` or ``"1"`` (duty).
    centre : float
        Displacement of the record that the model calls zero [m].
    polarity : {1, −1}
        −1 where the record's force is measured against the velocity; stated wherever it matters.
    metadata : mapping
    """

    current_range: tuple[float, float] | None = None
    current_unit: str = "A"
    centre: float = 0.0
    polarity: int = 1
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        for role in self.reads:
            checks.one_of(role, ROLES[:3], f"every name in reads of {self.name}")
        if self.polarity not in (1, -1):
            raise InputError("polarity is 1 or -1", got=self.polarity)
        if not isinstance(self.current_unit, str):
            raise InputError("current_unit is text", got=self.current_unit)
        if not isinstance(self.metadata, Mapping):
            raise InputError("metadata are a mapping", got=type(self.metadata).__name__)
        if self.current_range is not None:
            low, high = (checks.real(x, "a current of the fitted range") for x in self.current_range)
            if low > high:
                raise InputError("current_range runs from low to high", got=f"{low:g} to {high:g}")
            object.__setattr__(self, "current_range", (low, high))

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Roles that it needs of a record, of ``displacement``, ``velocity``, ``current``."""

    @property
    @abstractmethod
    def start(self) -> int:
        """Samples at the head of a record that a free run takes from the measurement."""

    @property
    @abstractmethod
    def clock(self) -> float | None:
        """Period at which it runs, and at no other [s]; None for a law, which runs at any."""

    @abstractmethod
    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        """(n,) force [N] along a drive with the parameters in `vector`, of that array's type (float or complex).

        Parameters
        ----------
        drive : Drive
            Velocity [m/s], displacement [m] and current of one record.
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        (n,) array
            Force [N].
        """

    @abstractmethod
    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        """(n,) force that depends on displacement alone: gas spring and preload [N].

        Parameters
        ----------
        displacement : (n,) array
            [m]

        Returns
        -------
        (n,) array
            Force [N].
        """

    @abstractmethod
    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """(n,) force at constant velocities, once everything has settled [N].

        Parameters
        ----------
        velocity : (n,) array
            [m/s]
        current : float
            In the unit of the records' current.
        displacement : float
            [m]

        Returns
        -------
        (n,) array
            Force [N].
        """

    @property
    def largest_speed(self) -> float | None:
        """Largest speed of the training records [m/s]; None where that is not known."""
        training = self.metadata.get("training", {})
        held = training.get("ranges", {}) if isinstance(training, Mapping) else {}
        if not isinstance(held, Mapping) or "velocity" not in held:
            return None
        return max(abs(checks.real(v, "a speed of the training")) for v in held["velocity"]) or None

    @property
    def usual_currents(self) -> tuple[float, float] | None:
        """Fitted range without the ripple of filters and the rarest hundredth at either end, where that is known.

        What a filter overshoots at steps of the current is in `current_range`, since the fit has seen it and a run may
        meet it, but no damper is driven there; see `usual_range`.
        """
        training = self.metadata.get("training", {})
        given = training.get("usual_currents") if isinstance(training, Mapping) else None
        if given is None or self.current_range is None:
            return self.current_range
        low, high = (checks.real(c, "a usual current of the training") for c in given)
        return max(low, self.current_range[0]), min(high, self.current_range[1])
