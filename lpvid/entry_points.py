"""Entry points: the objects that installed packages name in a group."""

from __future__ import annotations

from typing import Any

from lpvid.errors import InputError


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
