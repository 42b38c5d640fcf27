"""Passive: a fixed current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from quartercar.controllers.contract import Controller, Law, Memoryless, Setting, Values
from quartercar.dampers.parameter import Parameter


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Passive(Controller):
    """i = constant, whatever the car does: the reference of every other law.

    Examples
    --------
    >>> Passive(values={"fixed_current": 0.4})
    Passive(fixed_current=0.4 A)
    """

    name: ClassVar[str] = "passive"
    title: ClassVar[str] = "Passive"
    source: ClassVar[str] = "a constant current"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("fixed_current", "A", "i", 0.25, 0.0, 2.5),)
    reads: ClassVar[tuple[str, ...]] = ()
    demands: ClassVar[str] = "current"

    def begin(self, values: Values, setting: Setting) -> Law:
        return Memoryless(lambda seen: values["fixed_current"])
