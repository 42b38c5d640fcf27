"""Catalogues of effects by name: those of installed packages, through entry points.

A package registers its causes in the group ``lpvid.effects``, a tuple of effects::

    [project.entry-points."lpvid.effects"]
    mine = "my_package.causes:CATALOGUE"
"""

from __future__ import annotations

from collections.abc import Sequence

from lpvid import _checks
from lpvid.effects.effect import Effect, by_name
from lpvid.entry_points import loaded
from lpvid.errors import InputError

EFFECTS = "lpvid.effects"


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
