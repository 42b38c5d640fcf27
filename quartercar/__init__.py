"""quartercar: dampers, roads and a virtual test rig.

Names load on first use, so that ``import quartercar`` stays quick.

>>> import quartercar
>>> quartercar.dampers.model_class("linear").title
'Mass, viscous, spring'
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quartercar import dampers, effects, rig, roads
    from quartercar.dampers.fitting import fit

_MODULES = ("dampers", "effects", "rig", "roads")
_EXPORTS = {"quartercar.dampers.fitting": ("fit",)}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = ["dampers", "effects", "fit", "rig", "roads"]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"quartercar.{name}")
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'quartercar' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
