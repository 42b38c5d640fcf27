"""Kinds of remarks: strings whose class states their subject, so that no code matches their words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


class Cut(str):
    """What a record lost at gaps and missing samples.

    Examples
    --------
    >>> notes = ("units from the header", Cut("cut into 2 pieces at missing samples"))
    >>> [n for n in notes if isinstance(n, Cut)]
    ['cut into 2 pieces at missing samples']
    """

    __slots__ = ()


class LeftOut(Cut):
    """That a record was left out as a whole; it names the record itself, since another one carries it."""

    __slots__ = ()


class ReadAs(str):
    """How a file was read where it leaves that open: its clock, a unit, rows of one time stamp."""

    __slots__ = ()


class Repeated(ReadAs):
    """That rows of one time stamp were read as one."""

    __slots__ = ()


class Turned(str):
    """That the sign of a channel was turned."""

    __slots__ = ()


class Derivation(str):
    """How a velocity that was not measured was derived."""

    __slots__ = ()


class QuietDerivation(Derivation):
    """How it was derived without the noise of the displacement's sensor."""

    __slots__ = ()


class Cost(str):
    """What a constraint costs a fitted model."""

    __slots__ = ()


class OutOfTime(str):
    """Why something was not done: the budget of time was spent."""

    __slots__ = ()


def of_records(notes: Iterable[tuple[str, Sequence[str]]], kinds: type[str] | tuple[type[str], ...]) -> tuple[str, ...]:
    """The notes of some kinds, each once and with the record that it is about; how files were read, by all of them.

    Parameters
    ----------
    notes : iterable of (str, sequence of str)
        Name and notes of every record.
    kinds : type or tuple of types
        Of this module.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> of_records([("a", [ReadAs("in mm"), "other"]), ("b", [ReadAs("in mm")]), ("b", [Cut("cut")])], (Cut, ReadAs))
    ("records 'a', 'b': in mm", "record 'b': cut")
    """
    found = dict.fromkeys((name, n) for name, listed in notes for n in listed if isinstance(n, kinds))
    alike: dict[str, list[str]] = {}
    for name, note in found:
        alike.setdefault(note if isinstance(note, (LeftOut, ReadAs)) else f"record '{name}': {note}", []).append(name)
    return tuple(_headed(note, names) if isinstance(note, ReadAs) else str(note) for note, names in alike.items())


def _headed(note: str, names: Sequence[str]) -> str:
    listed = ", ".join(f"'{n}'" for n in names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    return f"record{'s' * (len(names) > 1)} {listed}: {note}"
