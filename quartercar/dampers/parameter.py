"""Parameter: one number of a damper law, with its unit and the bounds that physics sets."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lpvid.errors import InputError
from lpvid.toolkit import checks
from lpvid.units import is_known, quantity_to_si


@dataclass(frozen=True)
class Parameter:
    """A number of a damper model.

    Attributes
    ----------
    name : str
        As in files and on the command line, e.g. ``"viscous_damping"``.
    unit : str
        SI, e.g. ``"N*s/m"``; empty for a pure number.
    says : str
        What it is, in a few words, with the paper's symbol.
    default : float
        A typical value, in SI.
    lower, upper : float
        Physical bounds; ±inf where there are none.
    log : bool
        Whether searches move its logarithm: a positive number that may lie anywhere over decades.

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

    def __post_init__(self) -> None:
        if not self.lower <= self.default <= self.upper or (self.log and not self.lower > 0):
            raise InputError(f"parameter {self.name} is inconsistent",
                             got=f"default {self.default}, bounds {self.lower} to {self.upper}")

    def checked(self, value: object) -> float:
        """`value`, a number in SI or text such as "0.6 kN", as a float inside the bounds, or an InputError."""
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
