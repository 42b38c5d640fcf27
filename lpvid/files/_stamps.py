"""Dates and times of day in text cells, as seconds since the first."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.files._table import MISSING, is_number

DAY = 86400.0
"""[s]"""
DATE, DATE_WITH_ZONE, TIME_OF_DAY = "date", "date with zone", "time of day"
"""kinds of stamps."""
_CLOCK = r"(?P<clock>\d{1,2}:\d{2}:\d{2}(?:\.\d{1,9})?)"
_ZONE = r"(?P<zone>Z|[+-]\d{2}:?\d{2})?"
_ISO = re.compile(rf"(?P<date>\d{{4}}-\d{{2}}-\d{{2}})[T ]{_CLOCK}{_ZONE}")
_DOTTED = re.compile(rf"(?P<day>\d{{2}})\.(?P<month>\d{{2}})\.(?P<year>\d{{4}}) {_CLOCK}")
_TIME = re.compile(_CLOCK)


@dataclass(frozen=True)
class Instant:
    """What one cell states.

    Attributes
    ----------
    at : datetime64[ns]
    kind : {"time of day", "date", "date with zone"}
        A time of day counts on 1 January 1970, a date with a zone is in UTC: the three cannot stand in one column.
    """

    at: np.datetime64
    kind: str


@dataclass(frozen=True)
class Stamps:
    """How a column of text states time: seconds from its first stamp, and which kind of stamp is no fault.

    Attributes
    ----------
    origin : datetime64[ns]
    kind : str
        As in `Instant`.
    """

    origin: np.datetime64
    kind: str

    def seconds(self, cells: Sequence[str]) -> tuple[np.ndarray, list[int]]:
        """Seconds of each cell since the origin: NaN where it is missing, and where it is at fault, which is listed.

        Parameters
        ----------
        cells : sequence of str

        Returns
        -------
        values : (n,) array
            Times of day from the origin's day on, which `Midnight` carries on.
        at_fault : list of int
            Places of the cells that hold other text, or a stamp of another kind.

        Examples
        --------
        >>> stamps(["10:00:00", "10:00:01"]).seconds(["10:00:00.5", "", "noon"])
        (array([0.5, nan, nan]), [2])
        """
        found = [instant(cell) for cell in cells]
        good = [one is not None and one.kind == self.kind for one in found]
        values = np.array([float((one.at - self.origin) / np.timedelta64(1, "s")) if ok and one else np.nan
                           for one, ok in zip(found, good, strict=True)], dtype=float)
        return values, [i for i, ok in enumerate(good) if not ok and not _missing(cells[i])]


@dataclass(frozen=True)
class _Jump:
    """A step of more than half a day: its place from the block's first row on, the reading before it, its sign."""

    place: int
    before: float
    back: bool

    def undone(self, place: int, reading: float, period: float) -> bool:
        """Whether a reading goes on where the clock was, with a pause at most as long as the rows between."""
        rows = place - self.place + 1
        return 0.0 <= reading - self.before <= 2 * rows * period


class Midnight:
    """Times of day carried on over midnight, block after block of one column.

    A clock of 24 h that steps back by more than half a day has stepped forward by less than half a day. A smaller step
    back stays one: a fault of the clock. So is a step of more than half a day that a later one the other way undoes, by
    going on where the clock was: not before, and after a pause no longer than the rows between them. What stands
    between them then runs backward; over the end of a block it is the row after them that does.

    Examples
    --------
    >>> carry = Midnight()
    >>> carry.on(np.array([0.0, 0.5])), carry.on(np.array([1.0 - 86400, 1.5 - 86400]))
    (array([0. , 0.5]), array([1. , 1.5]))
    >>> Midnight().on(np.array([0.0, 1.0, -50000.0, 3.0]))                      # one row of 0:00 among those of 13:53
    array([ 0.e+00,  1.e+00, -5.e+04,  3.e+00])
    """

    def __init__(self) -> None:
        self._last, self._days = np.nan, 0
        self._jump: _Jump | None = None

    def on(self, values: np.ndarray) -> np.ndarray:
        """The next block's seconds, rising over midnight.

        Parameters
        ----------
        values : (n,) array
            [s]; NaN where a stamp is missing.

        Returns
        -------
        (n,) array
            [s].
        """
        seen = np.flatnonzero(np.isfinite(values))
        if not seen.size:
            return values
        known = values[seen]
        days = self._days + np.cumsum(self._turns(known))
        self._last, self._days = float(known[-1]), int(days[-1])
        carried = values.copy()
        carried[seen] = known + DAY * days
        return carried

    def _turns(self, known: np.ndarray) -> np.ndarray:
        """Days that each reading adds to those before it: 1 at a midnight."""
        steps = np.abs(np.diff(known, prepend=self._last))
        period = np.nanmedian(steps) if known.size > 1 else steps[0]
        turns = np.zeros(known.size, dtype=int)
        for k in np.flatnonzero(steps > DAY / 2):
            before = float(known[k - 1]) if k else self._last
            jump, back = self._jump, bool(known[k] < before)
            if jump is None or jump.back == back or not jump.undone(int(k), float(known[k]), float(period)):
                turns[k], self._jump = back, _Jump(int(k), before, back)
                continue
            if jump.place >= 0:
                turns[jump.place] -= 1  # no midnight, or a row of the evening before
            turns[k], self._jump = back - (jump.place < 0), None
        if self._jump is not None:
            self._jump = replace(self._jump, place=self._jump.place - known.size)
        return turns


def instant(cell: str) -> Instant | None:
    """What a cell states of a point in time, None where it states none.

    A date with slashes states none: which number is the month is ambiguous.

    Parameters
    ----------
    cell : str

    Returns
    -------
    Instant or None

    Examples
    --------
    >>> instant("26.11.2026 10:12:13.5") == instant("2026-11-26T10:12:13.5"), instant("11/26/2026 10:12:13")
    (True, None)
    >>> instant("2026-10-25T02:30:00+02:00") == instant("2026-10-25T00:30:00Z")
    True
    """
    text, zone = cell.strip().strip("\"'"), None
    if found := _ISO.fullmatch(text):
        date, zone = found["date"], found["zone"]
    elif found := _DOTTED.fullmatch(text):
        date = f"{found['year']}-{found['month']}-{found['day']}"
    elif found := _TIME.fullmatch(text):
        date = "1970-01-01"
    else:
        return None
    whole, point, part = found["clock"].partition(".")
    try:
        at = np.datetime64(f"{date}T{whole.zfill(8)}{point}{part}", "ns")
    except ValueError:  # the 31st of February, 25 o'clock
        return None
    if zone and zone != "Z":
        east = np.timedelta64(60 * int(zone[1:3]) + int(zone[-2:]), "m")
        at = at - east if zone[0] == "+" else at + east
    return Instant(at, TIME_OF_DAY if found.re is _TIME else DATE_WITH_ZONE if zone else DATE)


def stamps(cells: Sequence[str]) -> Stamps | None:
    """How a column states time by its first cells; None for a column of numbers or of other text.

    One odd row does not decide: the kind is the one that most of the cells are of, the origin the first of that kind.

    Parameters
    ----------
    cells : sequence of str

    Returns
    -------
    Stamps or None

    Examples
    --------
    >>> stamps(["", "0", "10:12:13", "10:12:14"]).kind, stamps(["0.1", "0.2", "10:12:13"])
    ('time of day', None)
    """
    found = [one for cell in cells if (one := instant(cell)) is not None]
    if not found or len(found) < sum(map(is_number, cells)):
        return None
    kind = Counter(one.kind for one in found).most_common(1)[0][0]
    return Stamps(next(one.at for one in found if one.kind == kind), kind)


def _missing(cell: str) -> bool:
    return cell.strip().casefold() in MISSING
