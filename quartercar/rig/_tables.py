"""From a TOML table to a frozen dataclass whose fields know their unit and meaning, and to its JSON schema."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Mapping
from typing import Any

from lpvid import _checks
from lpvid.errors import InputError


def quantity(default: float | None, unit: str, description: str) -> Any:
    """Dataclass field for a physical quantity in an SI unit."""
    return dataclasses.field(default=default, metadata={"unit": unit, "says": description})


def option(default: Any, description: str, choices: tuple[str, ...] = ()) -> Any:
    """Dataclass field for a number without unit, a switch or a word."""
    return dataclasses.field(default=default, metadata={"says": description, "choices": choices})


def build(cls: type, table: Mapping[str, Any], where: str) -> Any:
    """Instance of a dataclass from a table; unknown keys, wrong types and wrong units are refused by name.

    Parameters
    ----------
    cls : type
        Dataclass made of `quantity` and `option` fields.
    table : mapping
        Keys and values as TOML gave them.
    where : str
        Place of the table in the file, for messages.

    Returns
    -------
    instance of `cls`

    Raises
    ------
    InputError
        An unknown key (with its nearest match), a value of the wrong type or unit.
    """
    table = expect_table(table, where)
    known = {f.name: f for f in dataclasses.fields(cls)}
    hints = typing.get_type_hints(cls)
    values = {}
    for key, value in table.items():
        _checks.known_name(key, list(known), f"key of {where}")
        values[key] = _value(value, hints[key], known[key].metadata, f"{where}.{key}")
    return cls(**values)


def expect_table(table: object, where: str) -> Mapping[str, Any]:
    """Refuse what is not a table."""
    if not isinstance(table, Mapping):
        raise InputError(f"{where} must be a table", got=repr(table))
    return table


def to_si(value: object, unit: str, where: str) -> float:
    """A bare number taken as SI, or text such as "5 mm" whose unit must have the dimension of `unit`."""
    if isinstance(value, str):
        if value.strip().lower() in ("inf", "+inf"):
            return float("inf")
        from lpvid.units import quantity_to_si

        try:
            number, found = quantity_to_si(value)
        except InputError as error:
            raise InputError(f"{where}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None
        if found != quantity_to_si(f"1 {unit}")[1]:
            raise InputError(f"{where} has the wrong unit", got=repr(value), why=f"it is a quantity in {unit or '1'}")
        return float(number)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{where} must be a number or text with a unit", got=repr(value))
    if value != value:
        raise InputError(f"{where} must be a number", got="nan")
    return float(value)


def _value(value: object, hint: Any, metadata: Mapping[str, Any], where: str) -> Any:
    if "unit" in metadata:
        if hint == tuple[float, ...]:
            if not isinstance(value, list) or not value:
                raise InputError(f"{where} must be a list of numbers", got=repr(value))
            return tuple(to_si(v, metadata["unit"], where) for v in value)
        return to_si(value, metadata["unit"], where)
    if metadata.get("choices"):
        if not isinstance(value, str):
            raise InputError(f"{where} must be one of {', '.join(metadata['choices'])}", got=repr(value))
        return _checks.one_of(value, metadata["choices"], where)
    if hint is bool:
        if not isinstance(value, bool):
            raise InputError(f"{where} must be true or false", got=repr(value))
        return value
    if hint is int:
        return _checks.count(value, where)
    if hint is float:
        return to_si(value, "", where)
    if not isinstance(value, str):
        raise InputError(f"{where} must be text", got=repr(value))
    return value


def schema(cls: type, extra: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """JSON schema of the table that `build` reads."""
    hints = typing.get_type_hints(cls)
    properties: dict[str, Any] = dict(extra or {})
    for field in dataclasses.fields(cls):
        properties[field.name] = _property(hints[field.name], field)
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _property(hint: Any, field: dataclasses.Field) -> dict[str, Any]:
    description = str(field.metadata.get("says", ""))
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
    """JSON schema of a number in SI or text with a unit."""
    return {"type": ["number", "string"], "description": f"{description}; SI, or text with a unit"}
