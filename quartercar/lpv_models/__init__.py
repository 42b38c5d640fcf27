"""LPV embeddings E1-E9 of the nonlinear quarter car (equation sheet 4.3), and plants for the design of controllers.

Names load on first use.

>>> from quartercar import lpv_models
>>> lpv_models.SaturationPair.number
'E1'
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quartercar.lpv_models.admissible import AdmissibleForce
    from quartercar.lpv_models.embedding import Embedding, replay
    from quartercar.lpv_models.frozen_damper import FrozenDamper
    from quartercar.lpv_models.identified import IdentifiedDamper
    from quartercar.lpv_models.identified_continuous import ContinuousDamper
    from quartercar.lpv_models.identified_ramp import RampedDamper
    from quartercar.lpv_models.limited_pair import LimitedPair
    from quartercar.lpv_models.nominal_force import LimitedForce, NominalForce
    from quartercar.lpv_models.prefilter import Prefiltered, prefiltered
    from quartercar.lpv_models.region import Region
    from quartercar.lpv_models.saturation_pair import SaturationPair
    from quartercar.lpv_models.speed_scheduled import SpeedScheduled
    from quartercar.lpv_models.strip import pair_box, pair_hull
    from quartercar.lpv_models.variable_damping import VariableDamping
    from quartercar.lpv_models.yielding import Reach, YieldingLaw

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
        value = getattr(importlib.import_module(f"quartercar.lpv_models.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'quartercar.lpv_models' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
