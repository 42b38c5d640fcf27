"""Baselines and catalogues of installed packages by name, through entry points.

A package registers its baselines in the group ``lpvid.baselines``: a factory ``(records, parameters=None) -> Baseline``
or a mapping from names to such factories. It registers its causes in the group ``lpvid.effects``, a tuple of effects::

    [project.entry-points."lpvid.effects"]
    mine = "my_package.causes:CATALOGUE"
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

from lpvid import _checks
from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.effect import Effect, by_name
from lpvid.errors import InputError
from lpvid.record import Record

BASELINES, EFFECTS = "lpvid.baselines", "lpvid.effects"
KINDS = {"extended": ("lpvid.diagnosis.extended_baseline", "ExtendedBaseline"),
         "fleet": ("lpvid.diagnosis.fleet_law", "FleetLaw"), "lpv": ("lpvid.diagnosis.lpv_baseline", "LpvBaseline")}
"""Modules of lpvid's own kinds of baseline, by the kind in their files."""
Factory = Callable[[Sequence[Record], Any], Baseline]
"""From prepared records and, where they are given, parameters (a file, a loaded model, a baseline's `to_dict`)."""


def factories() -> dict[str, Factory]:
    """Every installed baseline by name.

    Returns
    -------
    dict of str to Factory
        Empty where none is installed.

    Raises
    ------
    InputError
        An entry point that does not load, or is neither a factory nor a mapping to factories; one name twice.
    """
    found: dict[str, Factory] = {}
    for name, value in loaded(BASELINES):
        table: Mapping[str, Any] = value if isinstance(value, Mapping) else {name: value}
        for key, factory in table.items():
            if not callable(factory):
                raise InputError(f"the entry point '{name}' of {BASELINES} gives no factory for '{key}'",
                                 got=type(factory).__name__, mend="update or remove the package that names it")
            if key in found:
                raise InputError(f"two installed baselines are called '{key}'", mend="remove one of the packages")
            found[key] = cast(Factory, factory)
    return found


def catalogues() -> dict[str, tuple[Effect, ...]]:
    """Every installed catalogue of effects by the name of its entry point.

    Returns
    -------
    dict of str to tuple of Effect
        Those of entry points of one name together; empty where none is installed.

    Raises
    ------
    InputError
        An entry point that does not load, or is no tuple of effects.
    """
    found: dict[str, tuple[Effect, ...]] = {}
    for name, value in loaded(EFFECTS):
        listed = tuple(value) if isinstance(value, (tuple, list)) else ()
        if not listed or not all(isinstance(e, Effect) for e in listed):
            raise InputError(f"the entry point '{name}' of {EFFECTS} is no tuple of effects", got=type(value).__name__,
                             mend="update or remove the package that names it")
        found[name] = (*found.get(name, ()), *listed)
    return found


def catalogue(wanted: Sequence[str] | None = None) -> tuple[Effect, ...]:
    """Effects of the catalogues of these names, all installed ones where none is named.

    Parameters
    ----------
    wanted : sequence of str, optional
        Names of entry points; a repeated one counts once.

    Returns
    -------
    tuple of Effect

    Raises
    ------
    InputError
        An unknown name, nothing installed, two effects of one name.
    """
    known = catalogues()
    chosen = [_checks.known_name(n, list(known), "catalogue") for n in wanted] if wanted else list(known)
    effects = tuple(e for n in dict.fromkeys(chosen) for e in known[n])
    if not effects:
        raise InputError("no catalogue of effects is installed", why=f"no package names one in {EFFECTS}",
                         mend="install quartercar, or give a tuple of effects")
    by_name(effects)
    return effects


def named_baseline(name: str, records: Sequence[Record], parameters: Any = None) -> Baseline:
    """The baseline of a name, in the form that these records allow.

    Parameters
    ----------
    name : str
    records : sequence of Record
        Prepared.
    parameters : path, object or mapping, optional
        As the factory takes them: a file, a loaded model, a baseline's `to_dict`.

    Returns
    -------
    Baseline
    """
    known = factories()
    return known[_checks.known_name(name, list(known), "baseline", "give a saved model file")](records, parameters)


def named_effects(names: Sequence[str]) -> list[Effect]:
    """Installed effects by name, for a file that holds only their names.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    list of Effect
        In the order of the names; of several catalogues with one name the first counts.

    Raises
    ------
    InputError
        A name that no installed catalogue has.
    """
    known: dict[str, Effect] = {}
    for effects in catalogues().values():
        known |= {e.name: e for e in effects if e.name not in known}
    missing = [n for n in names if n not in known]
    if missing:
        raise InputError(f"no installed catalogue has the effect '{missing[0]}'", got=", ".join(known)[:200] or "none",
                         mend="install the package that it comes from")
    return [known[n] for n in names]


def stored_baseline(data: Mapping) -> Baseline:
    """The baseline that an extended model's file holds: one of lpvid's own kinds, or an installed one by its name.

    Parameters
    ----------
    data : mapping
        ``name``, and what the baseline's `to_dict` wrote under ``data``.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        A name that no installed package has.
    """
    inner = data["data"]
    if inner.get("kind") not in KINDS:
        return named_baseline(str(data["name"]), (), inner)
    module, name = KINDS[inner["kind"]]
    return getattr(importlib.import_module(module), name).from_dict(inner)


def loaded(group: str) -> list[tuple[str, Any]]:
    """The objects of a group's entry points, by name.

    Parameters
    ----------
    group : str
        Of entry points.

    Returns
    -------
    list of (str, object)
        Names with the objects loaded, sorted by name.

    Raises
    ------
    InputError
        An entry point that does not load.
    """
    from importlib.metadata import entry_points

    found = []
    for point in sorted(entry_points(group=group), key=lambda p: (p.name, p.value)):
        try:
            found.append((point.name, point.load()))
        except Exception as error:  # whatever a foreign module raises when it is imported
            why = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(f"the entry point '{point.name}' of {group} does not load", why=why,
                             mend="update or remove the package that names it") from None
    return found
