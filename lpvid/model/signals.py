"""Signals by name and unit: what a model's inputs and outputs are called."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Signal:
    """A named signal with its SI unit.

    Examples
    --------
    >>> print(Signal("force", "N"))
    force [N]
    """

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit or '1'}]"

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            What `from_dict` reads.
        """
        return {"name": self.name, "unit": self.unit}

    @classmethod
    def from_dict(cls, data: Mapping) -> Signal:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        Signal
            With the same values.
        """
        return cls(data["name"], data["unit"])


def signals(names: tuple[str, ...] | list[str], prefix: str, count: int) -> tuple[Signal, ...]:
    """Signals from names, or numbered ones where none were given."""
    return tuple(Signal(n) for n in names) if names else tuple(Signal(f"{prefix}{i + 1}") for i in range(count))
