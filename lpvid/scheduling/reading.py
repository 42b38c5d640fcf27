"""Reading: one scheduling variable as a basis reads it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Reading:
    """One scheduling variable as it is read: at p(k − lag), with what degree, and where its pieces meet.

    A trigonometric dependence has a highest angular frequency [rad per unit] instead of a degree.

    Parameters
    ----------
    name : str
        Scheduling variable.
    lag : int
        [samples]; negative reads future p.
    degree : int
        0 for a trigonometric dependence.
    breaks : tuple of float
        In the unit of the variable; empty for a single piece.
    frequency : float
        0 without trigonometric functions.
    kinks : tuple of float
        Those breaks at which the slope may jump.
    """

    name: str
    lag: int
    degree: int
    breaks: tuple[float, ...] = ()
    frequency: float = 0.0
    kinks: tuple[float, ...] = ()

    def jumps(self, low: float, high: float) -> tuple[float, ...]:
        """Where the slope may jump inside an interval; at its ends there is but one side.

        Parameters
        ----------
        low, high : float
            Ends of the interval, in the unit of the variable.

        Returns
        -------
        tuple of float
            Rising.
        """
        return tuple(k for k in self.kinks if low < k < high)

    @property
    def label(self) -> str:
        """Name, with the delay if there is one."""
        return f"{self.name}(k{-self.lag:+d})" if self.lag else self.name


def merged(parts: Iterable[tuple[Reading, ...]], combine: Callable[[Iterable], Any]) -> tuple[Reading, ...]:
    """One reading for each variable and delay.

    Parameters
    ----------
    parts : iterable of tuple of Reading
        Of several bases.
    combine : callable
        `sum` or `max`, for degrees and frequencies of the same variable at the same delay.

    Returns
    -------
    tuple of Reading
    """
    together: dict[tuple[str, int], list[Reading]] = {}
    for reading in (r for part in parts for r in part):
        together.setdefault((reading.name, reading.lag), []).append(reading)
    return tuple(Reading(name, lag, combine(r.degree for r in same), tuple(sorted({b for r in same for b in r.breaks})),
                         combine(r.frequency for r in same), tuple(sorted({k for r in same for k in r.kinks})))
                 for (name, lag), same in together.items())
