"""Baseline: what the diagnosis starts from, a simulation with parameters that can be fitted."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from lpvid.baselines.signals import Core, Signals
from lpvid.record import Record


@dataclass(frozen=True)
class Coefficient:
    """A free number of a baseline: name, unit, bounds; `scale` is a step that matters (for differences).

    Attributes
    ----------
    name : str
    unit : str
        Of this number, its bounds and its scale; "" where it has none.
    lower, upper : float
        Infinite where it is free on that side.
    scale : float
        Above zero.
    """

    name: str
    unit: str
    lower: float
    upper: float
    scale: float


class Baseline(ABC):
    """A simulation of one output from measured inputs: a damper law, a saved LPV model, a car."""

    name: ClassVar[str] | str
    output: str
    """role of the output, e.g. ``force``"""
    output_unit: str
    static: bool
    """whether the output at an instant depends on the signals at that instant alone, so that a series element can be
    solved sample by sample"""
    adaptive: bool = False
    """whether it chooses its own steps, so that differences of it are noise and only `sensitivities` counts"""
    forward: bool = False
    """whether `sensitivities` follows the run forwards, along any signals, for less than one more run for each
    coefficient"""
    polarity: int = 1
    """−1 where the records' output has the other sign than the simulation's: `signals` turns it"""
    schedule: tuple[str, ...] = ()
    """roles that schedule it, in the sense of an LPV model"""

    apart: tuple[str, ...] = ()
    """names of coefficients whose force, zero where they are, stands beside the law: an inertia, which neither passes
    what is in series with the damper nor its valves"""

    @property
    def clock(self) -> float | None:
        """Sample time [s] at which alone it runs; None where it runs at any."""
        return None

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Roles that it needs."""

    @property
    @abstractmethod
    def coefficients(self) -> tuple[Coefficient, ...]:
        """Free parameters, in the order of `vector`."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(P,) parameters."""

    @abstractmethod
    def with_vector(self, vector: np.ndarray) -> Self:
        """The same baseline with other parameters.

        Parameters
        ----------
        vector : (P,) array

        Returns
        -------
        Baseline
        """

    @abstractmethod
    def signals(self, record: Record) -> Signals:
        """What it, and the effects around it, can read of a record: every channel whose role is known.

        Parameters
        ----------
        record : Record

        Returns
        -------
        Signals
        """

    @abstractmethod
    def core(self, vector: np.ndarray) -> Core:
        """The simulation with these parameters.

        Parameters
        ----------
        vector : (P,) array

        Returns
        -------
        Core
            From signals to the (n,) output, in its unit.
        """

    @abstractmethod
    def fit(self, records: Sequence[Record]) -> Self:
        """Fitted to the free run along records.

        Parameters
        ----------
        records : sequence of Record

        Returns
        -------
        Baseline
        """

    @abstractmethod
    def sensitivities(self, signals: Signals, vector: np.ndarray) -> np.ndarray:
        """(n, P) derivative of the simulation in its parameters.

        Parameters
        ----------
        signals : Signals
        vector : (P,) array

        Returns
        -------
        (n, P) array
            In the output's unit over that of the parameter.
        """

    @abstractmethod
    def starts(self, signals: Sequence[Signals]) -> list[np.ndarray]:
        """Further start vectors of a fit; none where the fit is unique.

        Parameters
        ----------
        signals : sequence of Signals

        Returns
        -------
        list of (P,) array
        """

    @abstractmethod
    def to_dict(self) -> dict:
        """Plain data for JSON, from which the entry point of its kind builds it again.

        Returns
        -------
        dict
        """

    @property
    @abstractmethod
    def start(self) -> int:
        """Samples at the head of a record that the simulation takes from the measurement."""

    def describe(self) -> Mapping[str, Any]:
        """Plain data: name, parameters with units.

        Returns
        -------
        dict
            ``name``, and ``parameters``: a list of ``name``, ``value`` and ``unit`` of each coefficient.
        """
        return {"name": self.name, "parameters": [
            {"name": c.name, "value": float(v), "unit": c.unit}
            for c, v in zip(self.coefficients, self.vector, strict=True)]}
