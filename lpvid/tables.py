"""Tables of TOML files: fields of dataclasses with unit and meaning, strict values, and the JSON schema."""

from __future__ import annotations

import dataclasses
import tomllib
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lpvid import _checks
from lpvid.codec import expect_table
from lpvid.errors import InputError

T = TypeVar("T")


# -- fields ------------------------------------------------------------------------------------------------------------
def si(unit: str, description: str = "") -> dict[str, Any]:
    """Metadata of a field that is a quantity in an SI unit.

    Parameters
    ----------
    unit : str
        Of a bare number; text must have its dimension.
    description : str
        For templates and schemas.

    Returns
    -------
    dict
        For `dataclasses.field`.
    """
    return {"unit": unit, "description": description, "read": lambda value, where: to_si(value, unit, where)}


def quantity(default: float | None, unit: str, description: str) -> Any:
    """Dataclass field for a physical quantity in an SI unit.

    Parameters
    ----------
    default : float or None
        In SI.
    unit : str
        Of a bare number; text must have its dimension.
    description : str
        For templates and schemas.

    Returns
    -------
    dataclasses.Field
    """
    return dataclasses.field(default=default, metadata=si(unit, description))


def option(default: Any, description: str, choices: Sequence[str] = (), *, at_least: int | None = None) -> Any:
    """Dataclass field for a number without unit, a switch, a word or a count.

    Parameters
    ----------
    default : bool, int, float or str
    description : str
        For templates and schemas.
    choices : sequence of str
        Words that are taken; any where it is empty.
    at_least : int, optional
        Smallest count (0).

    Returns
    -------
    dataclasses.Field
    """
    def read(value: object, where: str) -> Any:
        if choices:
            if not isinstance(value, str):
                raise InputError(f"{where} must be one of {', '.join(choices)}", got=repr(value))
            return _checks.one_of(value, choices, where)
        return to_si(value, "", where) if isinstance(default, float) else _checks.count(value, where,
                                                                                       at_least=at_least or 0)

    counted = isinstance(default, int) and not isinstance(default, bool)
    own = {"read": read} if choices or counted or isinstance(default, float) else {}
    return dataclasses.field(default=default, metadata={"description": description, "choices": tuple(choices), **own})


# -- files and tables --------------------------------------------------------------------------------------------------
def read_toml(path: str | Path, template: str = "--template prints one") -> dict[str, Any]:
    """The table of a TOML file.

    Parameters
    ----------
    path : str or Path
    template : str
        Where to find an example, for the message.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        A missing file, a folder, an empty file, or text that is not TOML.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read '{path}'", why=why, mend=f"check the path; {template}") from None
    if not text.strip():
        raise InputError(f"{path.name} is empty", why="all that it should state would be left to defaults",
                         mend=template)
    return parse_toml(text, path.name, template)


def parse_toml(text: str, where: str, template: str = "--template prints one") -> dict[str, Any]:
    """The table of a TOML text.

    Parameters
    ----------
    text : str
    where : str
        Names it in the message.
    template : str
        Where to find an example, for the message.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        Text that is not TOML.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not TOML", why=str(error), mend=template) from None


def within(where: str, read: Callable[[], T]) -> T:
    """`read()`, its faults named with the file they are in, once.

    Parameters
    ----------
    where : str
        The file, for messages.
    read : callable
        Takes nothing.

    Returns
    -------
    object
        What `read` gives.

    Raises
    ------
    InputError
        That of `read`, with the file in front where it is not there yet.
    """
    try:
        return read()
    except InputError as error:
        named = error.what.startswith(f"{where} ") or (error.what.startswith("cannot read ") and where in error.what)
        what = error.what if named else f"{where}: {error.what}"
        raise InputError(what, got=error.got, why=error.why, mend=error.mend) from None


def known_keys(table: Mapping[str, Any], allowed: Sequence[str], what: str) -> None:
    """Refuse keys that nothing reads.

    Parameters
    ----------
    table : mapping
        As read.
    allowed : sequence of str
        Keys that are read.
    what : str
        What the table is, for the message, which also names the nearest key.
    """
    for key in table:
        _checks.known_name(key, list(allowed), f"key of {what}")


def tables_of(value: object, what: str) -> list[Mapping[str, Any]]:
    """A list of tables, or one table.

    Parameters
    ----------
    value : object
        As read.
    what : str
        Its key, for messages.

    Returns
    -------
    list of mapping

    Raises
    ------
    InputError
        Something else than tables.
    """
    if isinstance(value, Mapping):
        return [value]
    if not isinstance(value, list):
        raise InputError(f"{what} must be a list of tables", got=repr(value)[:60], mend=f"write [[{what}]]")
    return [expect_table(entry, f"{what}[{k}]") for k, entry in enumerate(value)]


def kind_of(table: object, kinds: Mapping[str, T], where: str) -> tuple[T, dict[str, Any]]:
    """What the key ``kind`` of a table names, and the rest of the table.

    Parameters
    ----------
    table : mapping
        As TOML gave it.
    kinds : mapping
        What there is, by name.
    where : str
        Place of the table in the file, for messages.

    Returns
    -------
    object, dict

    Raises
    ------
    InputError
        No name, or one that is not among them.
    """
    rest = dict(expect_table(table, where))
    name = rest.pop("kind", None)
    if not isinstance(name, str):
        raise InputError(f"{where} needs a kind", got=repr(name), mend=f"choose one of {', '.join(kinds)}")
    return kinds[_checks.known_name(name, list(kinds), f"kind of {where}")], rest


# -- values ------------------------------------------------------------------------------------------------------------
def to_si(value: object, unit: str | None, where: str) -> float:
    """A bare number taken as SI, or text such as "5 mm".

    Parameters
    ----------
    value : object
        As TOML gave it.
    unit : str or None
        Whose dimension the text must have; None for any.
    where : str
        Place, for messages.

    Returns
    -------
    float
        In SI.

    Raises
    ------
    InputError
        No number, or a unit of another dimension.
    """
    if isinstance(value, str):
        if unit is not None and value.strip().lower() in ("inf", "+inf"):
            return float("inf")
        from lpvid.units import quantity_to_si

        number, found = within(where, lambda: quantity_to_si(value))
        if unit is not None and found != quantity_to_si(f"1 {unit}")[1]:
            raise InputError(f"{where} has the wrong unit", got=repr(value), why=f"it is a quantity in {unit or '1'}")
        return float(number)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{where} must be a number or text with a unit", got=repr(value))
    if unit is None:
        return _checks.real(value, where)
    if value != value:
        raise InputError(f"{where} must be a number", got="nan")
    return float(value)


def numbers_of(table: object, units: Mapping[str, str], where: str, what: str = "") -> dict[str, float]:
    """Quantities of a table by their units.

    Parameters
    ----------
    table : mapping
        As TOML gave it.
    units : mapping of str to str
        Unit by key; no other key is taken.
    where : str
        Place of the table in the file, for messages.
    what : str
        What a key is called; ``key of`` the place when left out.

    Returns
    -------
    dict of str to float
        In SI.

    Raises
    ------
    InputError
        An unknown key (with its nearest match), a value of the wrong type or unit.
    """
    table = expect_table(table, where)
    for key in table:
        _checks.known_name(key, list(units), what or f"key of {where}")
    return {key: to_si(value, units[key], f"{where}.{key}") for key, value in table.items()}


def texts_of(value: object, what: str) -> tuple[str, ...]:
    """A text or a list of texts.

    Parameters
    ----------
    value : object
        As read.
    what : str
        Its key, for messages.

    Returns
    -------
    tuple of str

    Raises
    ------
    InputError
        Something else than texts.
    """
    listed = [value] if isinstance(value, str) else value
    if not isinstance(listed, list) or not all(isinstance(v, str) for v in listed):
        raise InputError(f"{what} must be a list of names", got=repr(value))
    return tuple(listed)


def matrix_of(value: object, shape: tuple[int | None, int | None], what: str) -> np.ndarray:
    """A matrix written as a list of rows.

    Parameters
    ----------
    value : object
        As read; its entries are numbers taken as SI, or texts such as "5 mm".
    shape : (int or None, int or None)
        Rows and columns that it must have; None for any number.
    what : str
        Its key, for messages.

    Returns
    -------
    (rows, columns) array

    Raises
    ------
    InputError
        No list of rows, rows of unequal length, or another shape.
    """
    rows = value if isinstance(value, list) else None
    if rows is None or not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows):
        raise InputError(f"{what} must be a list of rows of equal length", got=repr(value))
    matrix = np.array([[to_si(x, None, f"an entry of {what}") for x in row] for row in rows], dtype=float)
    matrix = matrix.reshape(len(rows), -1) if rows else np.zeros((0, shape[1] or 0))
    return _checks.shaped(matrix, shape, what)


# -- schemas -----------------------------------------------------------------------------------------------------------
def schema(cls: type, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """JSON schema of the table that `lpvid.codec.build` reads into a dataclass.

    Parameters
    ----------
    cls : type
        Dataclass of `quantity` and `option` fields.
    extra : mapping, optional
        Further properties.

    Returns
    -------
    dict
        Plain data.
    """
    hints = typing.get_type_hints(cls)
    properties: dict[str, Any] = dict(extra or {})
    for field in dataclasses.fields(cls):
        properties[field.name] = _property(hints[field.name], field)
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _property(hint: Any, field: dataclasses.Field) -> dict[str, Any]:
    description = str(field.metadata.get("description", ""))
    if "unit" in field.metadata:
        unit = field.metadata["unit"] or "1"
        number: dict[str, Any] = quantity_schema(f"{description} [{unit}]")
        if hint == tuple[float, ...]:
            description = number.pop("description")
            default = list(typing.cast(tuple[float, ...], field.default))
            return {"type": "array", "items": number, "minItems": 1, "default": default, "description": description}
        if field.default is not None and field.default is not dataclasses.MISSING and field.default != float("inf"):
            number["default"] = field.default
        return number
    if field.metadata.get("choices"):
        entry: dict[str, Any] = {"enum": list(field.metadata["choices"])}
    else:
        names = {bool: "boolean", int: "integer", float: "number"}
        entry = {"type": names.get(hint, "string")}
    return {**entry, "default": field.default, "description": description}


def quantity_schema(description: str) -> dict[str, Any]:
    """JSON schema of a number in SI or text with a unit.

    Parameters
    ----------
    description : str
        With the SI unit.

    Returns
    -------
    dict
        Plain data.
    """
    return {"type": ["number", "string"], "description": f"{description}; SI, or text with a unit"}
