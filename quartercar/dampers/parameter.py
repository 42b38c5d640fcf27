"""Parameter: one number of a law, with its unit and the bounds that physics sets; Parametrised: a law made of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.codec import encode
from lpvid.errors import InputError
from lpvid.toolkit import ReadOnlyState, checks
from lpvid.units import base_exponents, is_known, quantity_to_si

if TYPE_CHECKING:
    import control


POSITIVE = 1e-30
"""least value of a positive number, SI: below any that a record in whatever size can show"""


@dataclass(frozen=True)
class Parameter:
    """A number of a damper model.

    Attributes
    ----------
    name : str
        As in files and on the command line, e.g. ``"viscous_damping"``.
    unit : str
        SI, e.g. ``"N*s/m"``, its exponents numbers; empty for a pure number.
    description : str
        What it is, in a few words, with the paper's symbol.
    default : float
        A typical value, in SI.
    lower, upper : float
        Physical bounds; ±inf where there are none.
    log : bool
        Whether searches move its logarithm: a positive number that may lie anywhere over decades.
    search : (float, float) or None
        Where a search looks in a damper of `quartercar.dampers.sizes.TYPICAL` sizes, SI; None: all of the bounds.

    Examples
    --------
    >>> Parameter("viscous_damping", "N*s/m", "c", 1000.0, lower=0.0).checked(-3.0)
    Traceback (most recent call last):
    ...
    lpvid.errors.InputError: viscous_damping lies outside its physical bounds: got -3 N*s/m; 0 to inf.
    """

    name: str
    unit: str
    description: str
    default: float
    lower: float = -math.inf
    upper: float = math.inf
    log: bool = False
    search: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.lower <= self.default <= self.upper or (self.log and not self.lower > 0):
            raise InputError(f"parameter {self.name} is inconsistent",
                             got=f"default {self.default}, bounds {self.lower} to {self.upper}")
        if self.search is not None and not self.lower <= self.search[0] <= self.default <= self.search[1] <= self.upper:
            raise InputError(f"parameter {self.name} is inconsistent",
                             got=f"default {self.default}, search from {self.search[0]} to {self.search[1]}")
        base_exponents(self.unit)  # an exported file states the unit by its exponents

    def checked(self, value: object) -> float:
        """`value`, a number in SI or text such as "0.6 kN", as a float inside the bounds, or an InputError.

        Parameters
        ----------
        value : object
            Number in SI, or text with a unit.

        Returns
        -------
        float
            In SI.

        Raises
        ------
        InputError
            No finite number, text with a unit of another dimension, or a value outside the physical bounds.
        """
        number = checks.real(self._read(value) if isinstance(value, str) else value, self.name)
        if not self.lower <= number <= self.upper:
            raise InputError(f"{self.name} lies outside its physical bounds", got=f"{number:g} {self.unit}".strip(),
                             why=f"{self.lower:g} to {self.upper:g}")
        return number

    def _read(self, text: str) -> float:
        try:
            return quantity_to_si(text, self.unit if is_known(self.unit) else "1")[0]
        except InputError as error:
            raise InputError(f"{self.name}: {error.what}", got=error.got, why=error.why,
                             mend=f'a number, or text such as "3 {self.unit}"') from None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Parametrised(ReadOnlyState, ABC):
    """A law with named, bounded parameters: what dampers and control laws have in common.

    Attributes
    ----------
    values : mapping of str to float
        Parameters by name, SI; those left out take their defaults.
    """

    name: ClassVar[str]
    """in kebab case, as on the command line"""
    title: ClassVar[str]
    """as in a table"""
    source: ClassVar[str]
    """paper and equation"""

    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.check_settings()
        if not isinstance(self.values, Mapping):
            raise InputError("values are a mapping of names to numbers", got=type(self.values).__name__)
        known = {p.name: p for p in self.parameters}
        for name in self.values:
            checks.known_name(name, list(known), f"parameter of {self.name}")
        values = {n: p.checked(self.values.get(n, p.default)) for n, p in known.items()}
        object.__setattr__(self, "values", MappingProxyType(values))

    def check_settings(self) -> None:
        """Refuse settings (orders, tables, models) that make no law; called before the parameters are read."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter with its unit, bounds and default, in the order of `vector`."""

    @property
    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Fields that a kind adds to the common ones (orders, tables, models, schedules)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in order."""
        return tuple(p.name for p in self.parameters)

    @property
    def vector(self) -> np.ndarray:
        """(P,) parameters."""
        return np.array([self.values[n] for n in self.names])

    def with_values(self, **values: float) -> Self:
        """The same law with some parameters replaced.

        Parameters
        ----------
        **values : float
            New values by parameter name, SI.

        Returns
        -------
        Parametrised
            A copy.
        """
        return replace(self, values={**self.values, **values})

    def with_vector(self, vector: np.ndarray) -> Self:
        """The same law with other parameters.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        Parametrised
            A copy.
        """
        return replace(self, values=dict(zip(self.names, map(float, vector), strict=True)))

    def to_control(self, sample_time: float | None = None) -> control.NonlinearIOSystem:
        """This law as a discrete python-control system, from the signals that it reads to its force or demand.

        Parameters
        ----------
        sample_time : float, optional
            Period [s]; left out for a law that runs at one of its own; a control law without one takes 1 ms.

        Returns
        -------
        control.NonlinearIOSystem

        Raises
        ------
        InputError
            A law that no step in closed form exists for; a control law that needs its car's parameters or is to be
            designed first; another period than the law's own.
        """
        from lpvid.export.control_file import to_control

        return to_control(self, sample_time=sample_time)

    def to_dict(self) -> dict:
        """Plain data for JSON, with units.

        Returns
        -------
        dict
            What `from_dict` reads.
        """
        return {"kind": self.name, "settings": encode(self.settings),
                "parameters": [{"name": p.name, "value": self.values[p.name], "unit": p.unit} for p in self.parameters]}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._shown()})"

    def _shown(self) -> str:
        """The first parameters, for `repr`."""
        return ", ".join(f"{p.name}={self.values[p.name]:.4g}{' ' + p.unit if p.unit else ''}"
                         for p in self.parameters[:8])
