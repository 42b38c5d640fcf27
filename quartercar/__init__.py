"""quartercar: dampers, roads, the car between them and a virtual test rig.

Names load on first use, so that ``import quartercar`` stays quick.

>>> import quartercar
>>> quartercar.dampers.model_class("linear").title
'Mass, viscous, spring'
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quartercar import controllers, criteria, dampers, effects, lpv_models, parameters, rig, roads
    from quartercar.characterisation import characterise
    from quartercar.dampers.fitting import fit
    from quartercar.parameters import CarParameters
    from quartercar.rides.simulation import ride
    from quartercar.vehicle.nonlinear import QuarterCar

_MODULES = ("controllers", "criteria", "dampers", "effects", "lpv_models", "parameters", "rig", "roads")
_EXPORTS = {"quartercar.vehicle.nonlinear": ("QuarterCar",), "quartercar.characterisation": ("characterise",),
            "quartercar.dampers.fitting": ("fit",),
            "quartercar.parameters": ("CarParameters",), "quartercar.rides.simulation": ("ride",)}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = ["CarParameters", "QuarterCar", "characterise", "controllers", "criteria", "dampers", "effects", "fit",
           "lpv_models", "parameters", "ride", "rig", "roads"]


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
