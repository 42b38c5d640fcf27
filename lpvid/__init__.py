"""lpvid: identification, analysis and control of linear parameter-varying systems.

>>> import lpvid as lpv
>>> lpv.Polynomial("current", degree=1).labels
('1', 'current')

Names load on first use, so that ``import lpvid`` stays quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from lpvid.analysis.certificates import certify_stability, verify
    from lpvid.analysis.critical import critical_scheduling
    from lpvid.analysis.frozen_stability import frozen_stability
    from lpvid.analysis.pole_locus import pole_locus
    from lpvid.analysis.stability_certificate import StabilityCertificate, Verification
    from lpvid.analysis.uncertainty import pole_band, stability_probability
    from lpvid.auditing import Audit, audit
    from lpvid.errors import InputError, LpvError, NumericalError
    from lpvid.export.python_control import from_control, to_grid
    from lpvid.export.serialise import load, model_hash, save
    from lpvid.files import read
    from lpvid.identification import Identification, identify
    from lpvid.identification.arx import ARX
    from lpvid.model.input_stage import TanhStage, ThreeZoneStage
    from lpvid.model.signals import Signal
    from lpvid.model.state_space import LPVStateSpace
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.realization import Gap, Realization, realize
    from lpvid.record import Channel, Record
    from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked
    from lpvid.simulation import Simulation, predict, simulate
    from lpvid.validation import Validation, validate

_EXPORTS = {
    "lpvid.analysis.certificates": ("certify_stability", "verify"),
    "lpvid.analysis.stability_certificate": ("StabilityCertificate", "Verification"),
    "lpvid.analysis.critical": ("critical_scheduling",),
    "lpvid.analysis.frozen_stability": ("frozen_stability",),
    "lpvid.analysis.pole_locus": ("pole_locus",),
    "lpvid.analysis.uncertainty": ("pole_band", "stability_probability"),
    "lpvid.auditing": ("Audit", "audit"),
    "lpvid.errors": ("InputError", "LpvError", "NumericalError"),
    "lpvid.export.python_control": ("from_control", "to_grid"),
    "lpvid.export.serialise": ("load", "model_hash", "save"),
    "lpvid.files": ("read",),
    "lpvid.identification": ("Identification", "identify"),
    "lpvid.identification.arx": ("ARX",),
    "lpvid.model.input_stage": ("TanhStage", "ThreeZoneStage"),
    "lpvid.model.signals": ("Signal",),
    "lpvid.model.state_space": ("LPVStateSpace",),
    "lpvid.model.transfer_function": ("LPVTransferFunction",),
    "lpvid.realization": ("Gap", "Realization", "realize"),
    "lpvid.record": ("Channel", "Record"),
    "lpvid.scheduling": ("Polynomial", "Product", "Scheduling", "Shifted", "Spline", "Stacked"),
    "lpvid.simulation": ("Simulation", "predict", "simulate"),
    "lpvid.validation": ("Validation", "validate"),
}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = [
    "ARX", "Audit", "Channel", "Gap", "Identification", "InputError", "LPVStateSpace", "LPVTransferFunction",
    "LpvError", "NumericalError", "Polynomial", "Product", "Realization", "Record", "Scheduling", "Shifted",
    "Signal", "Simulation", "Spline", "StabilityCertificate", "Stacked", "TanhStage", "ThreeZoneStage",
    "Validation", "Verification", "audit", "certify_stability", "critical_scheduling", "from_control",
    "frozen_stability", "identify", "load", "model_hash", "pole_band", "pole_locus", "predict", "read",
    "realize", "save", "simulate", "stability_probability", "to_grid", "validate", "verify",
]


def __getattr__(name: str):
    if name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'lpvid' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
