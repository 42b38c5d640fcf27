"""LPV embeddings E1-E9 of the nonlinear quarter car (equation sheet 4.3), and plants for the design of controllers.

Names load on first use.

>>> from quartercar import plant
>>> plant.SaturationPair.number
'E1'
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quartercar.plant.admissible import AdmissibleForce
    from quartercar.plant.embedding import Embedding, replay
    from quartercar.plant.frozen_damper import FrozenDamper
    from quartercar.plant.identified import IdentifiedDamper
    from quartercar.plant.identified_continuous import ContinuousDamper
    from quartercar.plant.identified_ramp import RampedDamper
    from quartercar.plant.limited_pair import LimitedPair
    from quartercar.plant.nominal_force import LimitedForce, NominalForce
    from quartercar.plant.prefilter import Prefiltered, prefiltered
    from quartercar.plant.region import Region
    from quartercar.plant.saturation_pair import SaturationPair
    from quartercar.plant.speed_scheduled import SpeedScheduled
    from quartercar.plant.strip import pair_box, pair_hull
    from quartercar.plant.variable_damping import VariableDamping
    from quartercar.plant.yielding import Reach, YieldingLaw

_EXPORTS = {"admissible": ("AdmissibleForce",), "embedding": ("Embedding", "replay"),
            "frozen_damper": ("FrozenDamper",), "identified": ("IdentifiedDamper",),
            "identified_continuous": ("ContinuousDamper",), "identified_ramp": ("RampedDamper",),
            "limited_pair": ("LimitedPair",),
            "nominal_force": ("LimitedForce", "NominalForce"), "prefilter": ("Prefiltered", "prefiltered"),
            "region": ("Region",), "saturation_pair": ("SaturationPair",), "speed_scheduled": ("SpeedScheduled",),
            "strip": ("pair_box", "pair_hull"), "variable_damping": ("VariableDamping",),
            "yielding": ("Reach", "YieldingLaw")}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = ["AdmissibleForce", "ContinuousDamper", "Embedding", "FrozenDamper", "IdentifiedDamper", "LimitedForce",
           "LimitedPair", "NominalForce", "Prefiltered", "RampedDamper", "Reach", "Region", "SaturationPair",
           "SpeedScheduled", "VariableDamping", "YieldingLaw", "pair_box", "pair_hull", "prefiltered", "replay"]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(f"quartercar.plant.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'quartercar.plant' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
