"""Tables of a TOML file read strictly: every fault names the file and the key."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError

T = TypeVar("T")


def read_toml(path: Path) -> dict[str, Any]:
    """The table of a TOML file; one line for a missing file, a folder, or text that is not TOML."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read '{path}'", why=error.strerror, mend="check the path") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"'{path}' is not TOML", why=str(error),
                         mend="lpvid synthesize --template prints an example") from None


def within(where: str, read: Callable[[], T]) -> T:
    """`read()`, its faults named with the file they are in."""
    try:
        return read()
    except InputError as error:
        raise InputError(f"{where}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None


def known_keys(table: Mapping[str, Any], allowed: Sequence[str], what: str) -> None:
    """Refuse keys that nothing reads."""
    for key in table:
        _checks.known_name(key, list(allowed), f"key of {what}:")


def table_of(value: object, what: str) -> Mapping[str, Any]:
    """Refuse what is not a table."""
    if not isinstance(value, Mapping):
        raise InputError(f"{what} must be a table", got=repr(value))
    return value


def tables_of(value: object, what: str) -> list[Mapping[str, Any]]:
    """A list of tables, or one table."""
    if isinstance(value, Mapping):
        return [value]
    if not isinstance(value, list):
        raise InputError(f"{what} must be a list of tables", got=repr(value), mend=f"write [[{what}]]")
    return [table_of(entry, f"{what}[{k}]") for k, entry in enumerate(value)]


def number_of(value: object, what: str) -> float:
    """A number, or text with a unit, in SI."""
    if isinstance(value, str):
        from lpvid.units import quantity_to_si

        return within(what, lambda: float(quantity_to_si(value)[0]))
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{what} must be a number or text with a unit", got=repr(value))
    return _checks.real(value, what)


def switch_of(value: object, what: str) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise InputError(f"{what} must be true or false", got=repr(value))
    return value


def text_of(value: object, what: str) -> str:
    """A text."""
    if not isinstance(value, str):
        raise InputError(f"{what} must be text", got=repr(value))
    return value


def texts_of(value: object, what: str) -> tuple[str, ...]:
    """A text or a list of texts."""
    listed = [value] if isinstance(value, str) else value
    if not isinstance(listed, list) or not all(isinstance(v, str) for v in listed):
        raise InputError(f"{what} must be a list of names", got=repr(value))
    return tuple(listed)


def matrix_of(value: object, shape: tuple[int | None, int | None], what: str) -> np.ndarray:
    """A matrix written as a list of rows."""
    rows = value if isinstance(value, list) else None
    if rows is None or not all(isinstance(row, list) and len(row) == len(rows[0]) for row in rows):
        raise InputError(f"{what} must be a list of rows of equal length", got=repr(value))
    matrix = np.array([[number_of(x, f"an entry of {what}") for x in row] for row in rows], dtype=float)
    matrix = matrix.reshape(len(rows), -1) if rows else np.zeros((0, shape[1] or 0))
    return _checks.shaped(matrix, shape, what)
