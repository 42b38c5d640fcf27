"""Dates and times of day in text cells, as seconds since the first."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from lpvid.files._table import MISSING

_CLOCK = r"(?P<clock>\d{1,2}:\d{2}:\d{2}(?:\.\d{1,9})?)"
_ISO = re.compile(rf"(?P<date>\d{{4}}-\d{{2}}-\d{{2}})[T ]{_CLOCK}Z?")
_DOTTED = re.compile(rf"(?P<day>\d{{2}})\.(?P<month>\d{{2}})\.(?P<year>\d{{4}}) {_CLOCK}")
_TIME = re.compile(_CLOCK)


def origin(cell: str) -> np.datetime64 | None:
    """The instant that a cell states, None where it states none.

    A time of day counts on 1 January 1970. A date with slashes is none: it does not say which number is the month.

    Parameters
    ----------
    cell : str

    Returns
    -------
    datetime64[ns] or None

    Examples
    --------
    >>> bool(origin("26.11.2026 10:12:13.5") == origin("2026-11-26T10:12:13.5")), origin("11/26/2026 10:12:13")
    (True, None)
    """
    text = cell.strip().strip("\"'")
    if found := _ISO.fullmatch(text):
        date = found["date"]
    elif found := _DOTTED.fullmatch(text):
        date = f"{found['year']}-{found['month']}-{found['day']}"
    elif found := _TIME.fullmatch(text):
        date = "1970-01-01"
    else:
        return None
    whole, point, part = found["clock"].partition(".")
    try:
        return np.datetime64(f"{date}T{whole.zfill(8)}{point}{part}", "ns")
    except ValueError:  # the 31st of February, 25 o'clock
        return None


def seconds(cells: Sequence[str], first: np.datetime64) -> tuple[np.ndarray, list[int]]:
    """Seconds of each cell since `first`: NaN where it is missing, and where it states no instant, which is listed.

    Parameters
    ----------
    cells : sequence of str
    first : datetime64[ns]

    Returns
    -------
    values : (n,) array
    at_fault : list of int
        Places of the cells that hold other text.

    Examples
    --------
    >>> seconds(["10:00:00.5", "", "noon"], origin("10:00:00"))
    (array([0.5, nan, nan]), [2])
    """
    found = [origin(cell) for cell in cells]
    values = np.array([np.nan if at is None else float((at - first) / np.timedelta64(1, "s")) for at in found])
    missing = [cell.strip().casefold() in MISSING for cell in cells]
    return values, [i for i, at in enumerate(found) if at is None and not missing[i]]
