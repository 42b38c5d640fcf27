"""Channels computed from the velocity, which a model may take as inputs: its sign, its square, its rebound part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.record import Record

REVERSAL = 2e-3
"""speed over which the sign of the velocity is smoothed [m/s]"""


@dataclass(frozen=True)
class Derived:
    """A channel that is computed from another one, sample by sample but for the acceleration.

    Attributes
    ----------
    name, source, unit : str
    make : callable
        (values of the source, period [s]) to values.
    """

    name: str
    source: str
    unit: str
    make: Callable[[np.ndarray, float], np.ndarray]

    def on(self, record: Record) -> Record:
        """The record with this channel, unless it has one of this name or lacks the source.

        Parameters
        ----------
        record : Record
            With a steady clock where the acceleration is computed.

        Returns
        -------
        Record
            The same where nothing is added.
        """
        if record.has(self.name) or not record.has(self.source):
            return record
        return record.with_channel(self.name, self.make(record[self.source], record.time_base.period), self.unit)


DERIVED: Mapping[str, Derived] = {
    "acceleration": Derived("acceleration", "velocity", "m/s^2", lambda v, period: np.gradient(v, period)),
    "sign(velocity)": Derived("velocity_sign", "velocity", "", lambda v, period: np.tanh(v / REVERSAL)),
    "velocity|velocity|": Derived("velocity_square", "velocity", "m^2/s^2", lambda v, period: v * np.abs(v)),
    "positive(velocity)": Derived("velocity_rebound", "velocity", "m/s", lambda v, period: np.maximum(v, 0.0)),
}
"""By the expression that a diagnosis uses for it."""


def derived(records: Sequence[Record], channels: Sequence[str] | None = None) -> list[Record]:
    """Records with every channel of `DERIVED` that they allow, or with those of these names.

    Parameters
    ----------
    records : sequence of Record
    channels : sequence of str, optional
        Names; those that are not in `DERIVED` are passed over. Left out, all of `DERIVED`.

    Returns
    -------
    list of Record

    Examples
    --------
    >>> record = Record({"velocity": [0.2, -0.1]}, sample_time=0.1, units={"velocity": "m/s"})
    >>> derived([record], ["velocity_rebound"])[0]["velocity_rebound"].tolist()
    [0.2, 0.0]
    """
    found = []
    for record in records:
        for channel in DERIVED.values():
            if channels is None or channel.name in channels:
                record = channel.on(record)
        found.append(record)
    return found
