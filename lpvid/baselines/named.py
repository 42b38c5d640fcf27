"""Baselines by name: those of installed packages, through entry points.

A package registers its baselines in the group ``lpvid.baselines``: a factory ``(records, parameters=None) -> Baseline``
or a mapping from names to such factories.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

from lpvid import _checks
from lpvid.baselines.baseline import Baseline
from lpvid.entry_points import loaded
from lpvid.errors import InputError
from lpvid.record import Record

BASELINES = "lpvid.baselines"
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
