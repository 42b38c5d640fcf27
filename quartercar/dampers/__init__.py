"""Damper models: every law of the source documents behind one contract, fitted, simulated and compared."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from lpvid import _checks

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper

_EXPORTS = {
    "quartercar.dampers.compared": ("Compared", "Comparison"),
    "quartercar.dampers.comparison": ("CompareSettings", "compare"),
    "quartercar.dampers.contract": ("Damper", "ExtrapolationWarning", "Run"),
    "quartercar.dampers.bouc_wen": ("BoucWen",),
    "quartercar.dampers.drive": ("Drive",),
    "quartercar.dampers.energy": ("Cycle", "steady_cycle"),
    "quartercar.dampers.facts": ("Facts",),
    "quartercar.dampers.fitting": ("DamperFit", "FitSettings", "fit"),
    "quartercar.dampers.guo": ("Guo", "Guo5", "Guo6", "Guo7", "Guo15"),
    "quartercar.dampers.identified": ("Identified",),
    "quartercar.dampers.kwok": ("Kwok",),
    "quartercar.dampers.families": ("DynamicDamper", "LawDamper", "StaticDamper"),
    "quartercar.dampers.extended_bouc_wen": ("ExtendedBoucWen",),
    "quartercar.dampers.force_map": ("ForceMap",),
    "quartercar.dampers.linear": ("Linear",),
    "quartercar.dampers.compliance": ("Compliance", "QuasiLpv"),
    "quartercar.dampers.loading": ("load_damper",),
    "quartercar.dampers.lpv": ("LpvArx",),
    "quartercar.dampers.narx": ("Narx2", "Narx3"),
    "quartercar.dampers.network": ("MixedNetwork", "ParallelNetwork", "SeriesNetwork"),
    "quartercar.dampers.parameter": ("Parameter",),
    "quartercar.dampers.real_time": ("RealTime",),
    "quartercar.dampers.stepwise": ("Stepwise", "identify_stepwise"),
    "quartercar.dampers.preparing": ("Prepared", "prepare"),
    "quartercar.dampers.published": ("read_parameters",),
    "quartercar.dampers.relief_valve": ("ReliefValve", "ReliefValveOrifice"),
    "quartercar.dampers.relief_valve_design": ("ReliefValveDesign",),
    "quartercar.dampers.wang_kamath": ("WangKamath",),
    "quartercar.dampers.passivity": ("Passivity", "check_passivity"),
    "quartercar.dampers.log_fit": ("fit_log_force",),
    "quartercar.dampers.slopes": ("SlopeDiagnosis", "log_slopes"),
    "quartercar.dampers.bridged": ("Branch", "Bridged"),
    "quartercar.dampers.network_squares": ("NetworkSquares", "fit_network_squares"),
    "quartercar.dampers.topology": ("NetworkChoice", "choose_network"),
    "quartercar.dampers.static_characteristic": ("StaticCharacteristic", "static_points"),
    "quartercar.dampers.steady_windows": ("WindowSettings", "steady_windows"),
    "quartercar.dampers.power_law": ("PowerLaw", "PowerLawFrictionGas"),
}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

MODELS: tuple[tuple[str, str, str], ...] = (
    ("linear", "quartercar.dampers.linear", "Linear"),
    ("force-map", "quartercar.dampers.force_map", "ForceMap"),
    ("extended-bouc-wen", "quartercar.dampers.extended_bouc_wen", "ExtendedBoucWen"),
    ("power-law", "quartercar.dampers.power_law", "PowerLaw"),
    ("power-law-friction-gas", "quartercar.dampers.power_law", "PowerLawFrictionGas"),
    ("guo", "quartercar.dampers.guo", "Guo"),
    ("guo-5", "quartercar.dampers.guo", "Guo5"),
    ("guo-6", "quartercar.dampers.guo", "Guo6"),
    ("guo-7", "quartercar.dampers.guo", "Guo7"),
    ("guo-15", "quartercar.dampers.guo", "Guo15"),
    ("kwok", "quartercar.dampers.kwok", "Kwok"),
    ("bouc-wen", "quartercar.dampers.bouc_wen", "BoucWen"),
    ("relief-valve", "quartercar.dampers.relief_valve", "ReliefValve"),
    ("relief-valve-orifice", "quartercar.dampers.relief_valve", "ReliefValveOrifice"),
    ("wang-kamath", "quartercar.dampers.wang_kamath", "WangKamath"),
    ("narx-2", "quartercar.dampers.narx", "Narx2"),
    ("narx-3", "quartercar.dampers.narx", "Narx3"),
    ("lpv-arx", "quartercar.dampers.lpv", "LpvArx"),
    ("quasi-lpv", "quartercar.dampers.compliance", "QuasiLpv"),
    ("compliance", "quartercar.dampers.compliance", "Compliance"),
    ("network-series", "quartercar.dampers.network", "SeriesNetwork"),
    ("network-parallel", "quartercar.dampers.network", "ParallelNetwork"),
    ("network-mixed", "quartercar.dampers.network", "MixedNetwork"),
)
"""Every model by its name on the command line: name, module, class. A new model adds its line here."""

__all__ = ["MODELS", "model_class", *sorted(_HOME)]


STORED = (*MODELS, ("identified", "quartercar.dampers.identified", "Identified"))
"""Name, module and class of every damper that a file can hold: `MODELS`, and those that lpvid identified."""


def stored_damper(data: Mapping[str, Any]) -> Damper:
    """The damper that `Damper.to_dict` described, of any kind in `STORED`."""
    table = {n: (module, cls) for n, module, cls in STORED}
    module, cls = table[_checks.known_name(str(data["kind"]), list(table), "damper model")]
    return getattr(importlib.import_module(module), cls).from_dict(data)


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
