"""Drive: what moves a damper, as plain arrays on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks

ROLES = ("displacement", "velocity", "current", "force")
"""Channel names, or roles, under which a damper looks for its signals."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Motion, current and (where measured) force of a damper, (n,) each, uniformly sampled, linear in between.

    Attributes
    ----------
    sample_time : float
        [s].
    velocity : (n,) array
        Positive in extension [m/s].
    displacement : (n,) array
        Positive in extension [m]; zeros where the model does not read it.
    current : (n,) array
        Coil current [A], or the voltage or duty that stands for it; zeros where the model does not read it.
    force : (n,) array or None
        Measured force, positive in tension [N].
    rate : (n,) array or None
        Rate of change of the velocity, where it is known of the record and these are other speeds, at which a law is
        only evaluated [m/s²].
    """

    sample_time: float
    velocity: np.ndarray
    displacement: np.ndarray
    current: np.ndarray
    force: np.ndarray | None = None
    rate: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("velocity", "displacement", "current"):
            object.__setattr__(self, name, checks.read_only(getattr(self, name)))

    @cached_property
    def acceleration(self) -> np.ndarray:
        """(n,) rate of change of the velocity [m/s²]; where it is not given, without the noise beyond its band."""
        if self.rate is not None:
            return self.rate
        from lpvid.baselines.signals import Signals
        from lpvid.baselines.spectra import derivative

        return derivative(Signals(self.sample_time, {"velocity": self.velocity}, self.velocity), "velocity")

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return self.velocity.size

    @property
    def times(self) -> np.ndarray:
        """(n,) time from the first sample [s]."""
        return self.sample_time * np.arange(self.n_samples)

    @classmethod
    def of(cls, record: Record, reads: Sequence[str], force: bool = False, centre: float = 0.0,
           polarity: int = 1) -> Drive:
        """The signals of a record that a model reads.

        Parameters
        ----------
        record : Record
            Uniform, with channels or roles named as in `ROLES`.
        reads : sequence of str
            Roles that the model needs, the force apart.
        force : bool
            Whether the measured force is needed; where not, it is taken along if there is one.
        centre : float
            Displacement that the model calls zero [m].
        polarity : {1, −1}
            Sense in which the record's force is measured; −1 turns it.

        Returns
        -------
        Drive
            One array for each role.

        Raises
        ------
        InputError
            No uniform clock, a missing channel, NaN, another unit.
        """
        if record.sample_time is None:
            raise InputError(f"record '{record.name}' has no uniform clock", mend="lpvid.condition.resample")
        n = record.n_samples
        signals = {role: _signal(record, role) if role in reads else np.zeros(n) for role in ROLES[:3]}
        if "displacement" in reads and centre:
            signals["displacement"] = signals["displacement"] - centre
        measured = _signal(record, "force") if force or record.has("force") else None
        return cls(record.sample_time, signals["velocity"], signals["displacement"], signals["current"],
                   None if measured is None else polarity * measured)

    def head(self, samples: int) -> Drive:
        """The first samples.

        Parameters
        ----------
        samples : int
            How many.

        Returns
        -------
        Drive
            The part.
        """
        return self.slice(0, samples)

    def slice(self, first: int, last: int) -> Drive:
        """Samples first … last−1.

        Parameters
        ----------
        first, last : int
            Places of samples.

        Returns
        -------
        Drive
            The part.
        """
        return Drive(self.sample_time, self.velocity[first:last], self.displacement[first:last],
                     self.current[first:last], None if self.force is None else self.force[first:last])


def joined(drives: Sequence[Drive], *names: str) -> list[np.ndarray]:
    """Signals of several drives, one drive after the other.

    Parameters
    ----------
    drives : sequence of Drive
    *names : str
        Of `ROLES`.

    Returns
    -------
    list of (n,) array
        One for each name.
    """
    return [np.concatenate([getattr(d, name) for d in drives]) for name in names]


UNITS = {"displacement": "m", "velocity": "m/s", "force": "N"}
ROTARY = ("rad", "rad/s", "N*m")
"""units that a rotary damper's channels have"""
MENDS = {"displacement": f"measure it, or fit a model that does not read it; {checks.role_mend('displacement')}",
         "velocity": "lpvid.condition.with_velocity(record) derives it from displacement",
         "current": f"a model without current dependence, or {checks.role_mend('current')}",
         "force": checks.role_mend("force")}


def wrong_unit(record: Record, role: str, wanted: str) -> InputError:
    """That a channel is of another quantity than a damper has in this role.

    Parameters
    ----------
    record : Record
    role : str
    wanted : str
        SI unit of the role.

    Returns
    -------
    InputError
        For the caller to raise.
    """
    from lpvid.units import contradiction_mend

    channel = record.channel(role)
    mend = "dampers here are translational; lpvid identify --input ANGULAR_VELOCITY --output TORQUE takes a rotary one"
    if channel.unit not in ROTARY:
        mend = contradiction_mend(channel.unit, (wanted,), record.resolve(role), role)
    return InputError(f"record '{record.name}': {role} has a wrong unit",
                      got=channel.source_unit or channel.unit, why=f"{wanted} expected", mend=mend)


def _signal(record: Record, role: str) -> np.ndarray:
    if not record.has(role):
        raise InputError(f"record '{record.name}' has no {role}", got=", ".join(record.channels), mend=MENDS[role])
    channel = record.channel(role)
    if channel.fault is not None:
        raise InputError(f"record '{record.name}': {role} cannot be used", got=channel.fault)
    wanted = UNITS.get(role)
    if wanted and channel.unit not in (wanted, ""):
        raise wrong_unit(record, role, wanted)
    values = np.ascontiguousarray(channel.values)
    return checks.finite(values, f"record '{record.name}': {role}")
