"""Damper models: every law of the source documents behind one contract, fitted, simulated and compared."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import lazy_loader

from lpvid.named_classes import NamedClasses

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper

D = TypeVar("D")

MODELS: tuple[tuple[str, str, str], ...] = (
    ("linear", "quartercar.dampers.laws.linear", "Linear"),
    ("force-map", "quartercar.dampers.laws.force_map", "ForceMap"),
    ("extended-bouc-wen", "quartercar.dampers.laws.extended_bouc_wen", "ExtendedBoucWen"),
    ("power-law", "quartercar.dampers.laws.power_law", "PowerLaw"),
    ("power-law-friction-gas", "quartercar.dampers.laws.power_law", "PowerLawFrictionGas"),
    ("guo", "quartercar.dampers.laws.guo", "Guo"),
    ("guo-5", "quartercar.dampers.laws.guo", "Guo5"),
    ("guo-6", "quartercar.dampers.laws.guo", "Guo6"),
    ("guo-7", "quartercar.dampers.laws.guo", "Guo7"),
    ("guo-15", "quartercar.dampers.laws.guo", "Guo15"),
    ("kwok", "quartercar.dampers.laws.kwok", "Kwok"),
    ("bouc-wen", "quartercar.dampers.laws.bouc_wen", "BoucWen"),
    ("relief-valve", "quartercar.dampers.laws.relief_valve", "ReliefValve"),
    ("relief-valve-orifice", "quartercar.dampers.laws.relief_valve", "ReliefValveOrifice"),
    ("wang-kamath", "quartercar.dampers.laws.wang_kamath", "WangKamath"),
    ("narx-2", "quartercar.dampers.blackbox.narx", "Narx2"),
    ("narx-3", "quartercar.dampers.blackbox.narx", "Narx3"),
    ("lpv-arx", "quartercar.dampers.blackbox.lpv", "LpvArx"),
    ("quasi-lpv", "quartercar.dampers.blackbox.compliance", "QuasiLpv"),
    ("compliance", "quartercar.dampers.blackbox.compliance", "Compliance"),
    ("network-series", "quartercar.dampers.laws.network", "SeriesNetwork"),
    ("network-parallel", "quartercar.dampers.laws.network", "ParallelNetwork"),
    ("network-mixed", "quartercar.dampers.laws.network", "MixedNetwork"),
)
"""Every model by its name on the command line: name, module, class. A new model adds its line here."""

_EXPORTS = {
    "evaluation.compared": ("Compared", "Comparison"),
    "evaluation.comparison": ("CompareSettings", "compare"),
    "contract": ("Damper", "ExtrapolationWarning", "Run"),
    "drive": ("Drive",),
    "evaluation.energy": ("Cycle", "steady_cycle"),
    "facts": ("Facts",),
    "fitting": ("DamperFit", "FitSettings", "fit"),
    "blackbox.identified": ("Identified",),
    "families": ("DynamicDamper", "LawDamper", "StaticDamper"),
    "loading": ("load_damper",),
    "parameter": ("Parameter",),
    "real_time": ("RealTime",),
    "fitting.stepwise": ("Stepwise", "identify_stepwise"),
    "preparing": ("Prepared", "prepare"),
    "published": ("read_parameters",),
    "laws.relief_valve_design": ("ReliefValveDesign",),
    "evaluation.passivity": ("Passivity", "check_passivity"),
    "bench.log_fit": ("fit_log_force",),
    "bench.slopes": ("SlopeDiagnosis", "log_slopes"),
    "laws.bridged": ("Branch", "Bridged"),
    "bench.network_squares": ("NetworkSquares", "fit_network_squares"),
    "bench.topology": ("NetworkChoice", "choose_network"),
    "bench.static_characteristic": ("StaticCharacteristic", "static_points"),
    "bench.steady_windows": ("WindowSettings", "steady_windows"),
    **{module.removeprefix(f"{__name__}."): tuple(c for _, m, c in MODELS if m == module) for _, module, _ in MODELS},
}

DAMPERS = NamedClasses("damper model", "quartercar.dampers", MODELS, "quartercar.dampers.contract:Damper")
"""`MODELS`, those of other packages (entry-point group ``quartercar.dampers``), and those that `register` adds."""

__getattr__: Callable[[str], Any]
__getattr__, __dir__, _exported = lazy_loader.attach(__name__, submod_attrs=_EXPORTS)
__all__ = ["DAMPERS", "MODELS", "model_class", "model_names", "register", *_exported]  # pyright: ignore


STORED = (*MODELS, ("identified", "quartercar.dampers.blackbox.identified", "Identified"))
"""Name, module and class of every damper that a file can hold: `MODELS`, and those that lpvid identified."""


def stored_damper(data: Mapping[str, Any]) -> Damper:
    """The damper that `Damper.to_dict` described, of any kind in `STORED`.

    Parameters
    ----------
    data : mapping
        Plain data of a damper: ``kind``, ``settings``, ``parameters`` and the fields common to all dampers.

    Returns
    -------
    Damper
        Of the class that stands behind its ``kind``.
    """
    kind, (name, module, cls) = str(data["kind"]), STORED[-1]
    found = getattr(importlib.import_module(module), cls) if kind == name else model_class(kind)
    return found.from_dict(data)


def model_class(name: str) -> type[Damper]:
    """The class behind a name of `DAMPERS`; InputError with the nearest name where there is none.

    Parameters
    ----------
    name : str
        Name on the command line, e.g. ``"bouc-wen"``.

    Returns
    -------
    type
        Class derived from `Damper`.

    Examples
    --------
    >>> model_class("linear").title
    'Mass, viscous, spring'
    """
    return DAMPERS.get(name)


def model_names() -> tuple[str, ...]:
    """Names of every damper model that is known, the package's own first.

    Returns
    -------
    tuple of str
        Names in kebab case, those of other packages and of `register` after the package's own.
    """
    return DAMPERS.names


def register(cls: type[D]) -> type[D]:
    """Make a damper model of the running program known by its name; serves as a decorator.

    It is then fitted and compared, saved and loaded, and a baseline of a diagnosis, like the package's own. An
    installed package names its dampers in the entry-point group ``quartercar.dampers`` instead.

    Parameters
    ----------
    cls : type
        A class derived from `Damper` that writes every abstract method; see docs/extending.md.

    Returns
    -------
    type
        `cls` itself.

    Raises
    ------
    InputError
        Methods that it lacks, or a name that is taken.
    """
    return DAMPERS.register(cls)
