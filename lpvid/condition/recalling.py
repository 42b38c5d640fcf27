"""How the files of a model's training data were read: what their headers left open and `--role` stated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lpvid import units
from lpvid.errors import InputError

TIME_ROLE = "time"
READING = "reading"
"""Key of a model's metadata that holds a `Record.reading`, or several where the files were read differently."""


def channel_of(text: str, names: Iterable[str]) -> tuple[str, str | None]:
    """Channel and unit that the right side of a role states: the unit counts where no channel is named like the whole.

    Parameters
    ----------
    text : str
        ``CHANNEL`` or ``CHANNEL [UNIT]``.
    names : iterable of str
        The channels that there are.

    Returns
    -------
    str
    str or None
        None where no unit is stated.

    Examples
    --------
    >>> channel_of("x [mm]", ["t", "x"]), channel_of("force (kN)", ["force (kN)"])
    (('x', 'mm'), ('force (kN)', None))
    """
    return (text, None) if text in set(names) else units.parse_header(text)


def readings_of(like: Any) -> tuple[Mapping[str, str], ...]:
    """How the training data of models were read, by their metadata; models that state nothing are left out.

    Parameters
    ----------
    like : object, sequence of objects, or None
        Models; of anything without metadata nothing is known.

    Returns
    -------
    tuple of mapping of str to str
        As `Record.reading`.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> readings_of(SimpleNamespace(metadata={"reading": {"time": "Zeit [ms]"}})), readings_of([None])
    (({'time': 'Zeit [ms]'},), ())
    >>> readings_of(SimpleNamespace(metadata={"reading": [{"time": "Zeit [ms]"}, {"time": "uhr"}]}))
    ({'time': 'Zeit [ms]'}, {'time': 'uhr'})
    """
    listed = like if isinstance(like, (list, tuple)) else (like,)
    kept = [getattr(one, "metadata", {}).get(READING) for one in listed]
    found = [one for own in kept for one in (own if isinstance(own, (list, tuple)) else (own,))]
    return tuple({str(r): str(c) for r, c in one.items()} for one in found if isinstance(one, Mapping) and one)


def recalled_clock(readings: Sequence[Mapping[str, str]], names: Sequence[str], where: str) -> str | None:
    """The column of this file that was the clock of the models' training data; None where the file has none such.

    Parameters
    ----------
    readings : sequence of mapping of str to str
        As `Record.reading`.
    names : sequence of str
        Columns of the file.
    where : str
        The file, for the message.

    Returns
    -------
    str or None

    Raises
    ------
    InputError
        Models whose training data had different clocks, both of them in this file.

    Examples
    --------
    >>> recalled_clock([{"time": "Zeit [ms]"}], ["Zeit", "force"], "run.csv")
    'Zeit'
    """
    found = dict.fromkeys(channel_of(r[TIME_ROLE], names)[0] for r in readings if TIME_ROLE in r)
    held = [column for column in found if column in names]
    if len(held) > 1:
        raise InputError(f"{where}: the models' training data had different clocks", got=", ".join(held),
                         mend=f"name the clock of these data: --role {TIME_ROLE}={held[0]}")
    return held[0] if held else None


def recalled_units(readings: Sequence[Mapping[str, str]], names: Sequence[str], where: str
                   ) -> dict[str, tuple[str, str]]:
    """Role and unit by column, where a role stated the unit of a column of the models' training data.

    Parameters
    ----------
    readings : sequence of mapping of str to str
        As `Record.reading`.
    names : sequence of str
        Columns of the file whose unit is open.
    where : str
        The file, for the message.

    Returns
    -------
    dict of str to (str, str)

    Raises
    ------
    InputError
        Models for whose training data different units of a column were stated.

    Examples
    --------
    >>> recalled_units([{"time": "Zeit", "displacement": "s [mm]"}], ["Zeit", "s"], "run.csv")
    {'s': ('displacement', 'mm')}
    """
    found: dict[str, tuple[str, str]] = {}
    for role, text in (pair for r in readings for pair in r.items()):
        column, unit = channel_of(text, names)
        if unit is None or column not in names:
            continue
        other = found.setdefault(column, (role, unit))
        if other[1] != unit:
            raise InputError(f"{where}: the models' training data had column '{column}' in different units",
                             got=f"[{other[1]}] and [{unit}]",
                             mend=f"state the one of these data: --role '{role}={column} [{unit}]'")
    return found
