"""Signals by name and unit: what a model's inputs and outputs are called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lpvid.codec import Coded


@dataclass(frozen=True)
class Signal(Coded):
    """A named signal with its SI unit.

    Parameters
    ----------
    name : str
    unit : str
        SI unit; empty where there is none, or it is not known.

    Examples
    --------
    >>> print(Signal("force", "N"))
    force [N]
    """

    name: str
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} [{self.unit or '1'}]"


def signals(names: tuple[str, ...] | list[str], prefix: str, count: int) -> tuple[Signal, ...]:
    """Signals from names, or numbered ones where none were given.

    Parameters
    ----------
    names : sequence of str
        May be empty.
    prefix : str
        Of numbered names: ``u`` gives ``u1``, ``u2`` …
    count : int
        How many numbered ones.

    Returns
    -------
    tuple of Signal
        Without units.
    """
    return tuple(Signal(n) for n in names) if names else tuple(Signal(f"{prefix}{i + 1}") for i in range(count))


def as_signals(given: Sequence, prefix: str, count: int) -> tuple[Signal, ...]:
    """Signals from signals or names, one or several; numbered ones where none were given.

    Parameters
    ----------
    given : Signal, str, or sequence of them
        Empty where none were given.
    prefix : str
        Of numbered ones.
    count : int
        How many numbered ones.

    Returns
    -------
    tuple of Signal
    """
    listed = (given,) if isinstance(given, (str, Signal)) else tuple(given)
    return tuple(s if isinstance(s, Signal) else Signal(str(s)) for s in listed) or signals((), prefix, count)


def signal_names(signals: Sequence[Signal]) -> tuple[str, ...]:
    """Names without units.

    Parameters
    ----------
    signals : sequence of Signal
        Inputs or outputs of a model.

    Returns
    -------
    tuple of str
        In their order.
    """
    return tuple(s.name for s in signals)


def listed_signals(signals: Sequence[Signal]) -> str:
    """Names for a message.

    Parameters
    ----------
    signals : sequence of Signal
        Inputs or outputs of a model.

    Returns
    -------
    str
        In their order.
    """
    return ", ".join(signal_names(signals))
