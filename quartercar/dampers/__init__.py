"""Damper models: every law of the source documents behind one contract, fitted, simulated and compared."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from lpvid import _checks

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper

_EXPORTS = {
    "quartercar.dampers.contract": ("Damper", "DynamicDamper", "ExtrapolationWarning", "LawDamper", "Run",
                                    "StaticDamper"),
    "quartercar.dampers.drive": ("Drive",),
    "quartercar.dampers.energy": ("Cycle", "steady_cycle"),
    "quartercar.dampers.facts": ("Facts",),
    "quartercar.dampers.fitting": ("DamperFit", "FitSettings", "fit"),
    "quartercar.dampers.linear": ("Linear",),
    "quartercar.dampers.parameter": ("Parameter",),
    "quartercar.dampers.passivity": ("Passivity", "check_passivity"),
}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

MODELS: tuple[tuple[str, str, str], ...] = (
    ("linear", "quartercar.dampers.linear", "Linear"),
)
"""Every model by its name on the command line: name, module, class. A new model adds its line here."""

__all__ = ["MODELS", "model_class", *sorted(_HOME)]


def model_class(name: str) -> type[Damper]:
    """The class behind a name of `MODELS`; InputError with the nearest name where there is none.

    Examples
    --------
    >>> model_class("linear").title
    'Mass, viscous, spring'
    """
    table = {n: (module, cls) for n, module, cls in MODELS}
    module, cls = table[_checks.known_name(name, list(table), "damper model")]
    return getattr(importlib.import_module(module), cls)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'quartercar.dampers' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
