"""Codec: frozen dataclasses to plain data for JSON and back, by their fields.

What is written beyond the fields, such as a verdict, is a property that `JSON` names. msgspec renames and refuses keys
for its own structures only, and cattrs has no computed keys and takes 50 ms to import.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import inspect
import math
import sys
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError

VERBATIM = {"verbatim": True}
"""of a field that is the caller's own: passed on as it is"""
ADDED = {"added": True}
"""of a field that older files lack: its default holds"""
UNWRITTEN = {"added": True, "unwritten": True}
"""of a field that older files lack, and that is not written where it is None"""


def null(value: float) -> dict[str, float]:
    """Metadata of a field whose null in a file stands for a number that JSON cannot hold.

    Parameters
    ----------
    value : float
        inf or nan.

    Returns
    -------
    dict
        For `dataclasses.field`.
    """
    return {"null": value}


class MissingKey(InputError):
    """A key that an object in a file needs and lacks.

    Parameters
    ----------
    key : str
        Its place, with dots.
    """

    def __init__(self, key: str) -> None:
        self.key = key
        super().__init__(f"the key '{key}' is missing")


class UnknownKind(InputError):
    """An object in a file whose kind no class that was imported has."""


class Encoded:
    """A dataclass that goes to plain data.

    Attributes
    ----------
    JSON : tuple
        Keys in order: the name of a field or a property, or (key, name) where they differ; ``...`` stands for every
        field that the constructor takes.
    """

    JSON: ClassVar[tuple[Any, ...]] = (...,)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; a number that is not finite is None.

        Returns
        -------
        dict
            Plain values by key; arrays and tuples as lists.
        """
        own = _metadata(type(self))
        return {key: dict(value) if own.get(name, {}).get("verbatim") else encode(value)
                for key, name in layout(type(self)) for value in (getattr(self, name),)
                if not (own.get(name, {}).get("unwritten") and getattr(self, name) is None)}


class Coded(Encoded):
    """A dataclass that goes to plain data and comes back; keys that are no field are written and not read.

    Attributes
    ----------
    NOUN : str
        What an abstract class is called in a message.
    KINDS_IN : tuple of str
        Modules with subclasses of an abstract class that nothing else may have imported.
    BESIDE : tuple of str
        Keys that a command writes beside the object's own; not read.
    """

    NOUN: ClassVar[str] = ""
    KINDS_IN: ClassVar[tuple[str, ...]] = ()
    BESIDE: ClassVar[tuple[str, ...]] = ("schema", "lpvid_version")

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Inverse of `to_dict`; an abstract class looks up the subclass by its ``kind``.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        Coded
            With the same values.

        Raises
        ------
        InputError
            An unknown or missing key or kind, a value of the wrong type.
        """
        if inspect.isabstract(cls):
            return _of_kind(cls, expect_table(data, cls.NOUN).get("kind")).from_dict(data)
        return build(cls, data)

    @classmethod
    def array_shapes(cls, values: Mapping[str, Any]) -> Mapping[str, tuple[int, ...]]:
        """Shapes of arrays that a list may have lost because it is empty, by field.

        Parameters
        ----------
        values : mapping
            Decoded fields, and the keys that are none.

        Returns
        -------
        mapping of str to tuple of int
            With -1 as `numpy.reshape` has it.
        """
        return {}


def encode(value: Any) -> Any:
    """A value as JSON has it: arrays and tuples as lists, complex as [real, imaginary], not finite as None.

    Parameters
    ----------
    value : object
        Number, text, array, mapping, sequence, dataclass or what has `to_dict`.

    Returns
    -------
    object
        Plain value.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.ndarray):
        plain, kind = value.tolist(), value.dtype.kind
        return plain if kind in "biu" or (kind == "f" and np.isfinite(value).all()) else encode(plain)
    if isinstance(value, np.generic):
        return encode(value.item())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(k): encode(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [encode(v) for v in value]
    if dataclasses.is_dataclass(value):
        return {f.name: encode(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return value


def build(cls: type, data: Mapping[str, Any], where: str = "", *, noun: str = "", partial: bool = False) -> Any:
    """Instance of a dataclass from plain data; unknown and missing keys and wrong types are refused by name.

    Parameters
    ----------
    cls : type
        Dataclass; `Encoded.JSON` counts where it has one.
    data : mapping
        Values by key.
    where : str
        Place in the file, for messages.
    noun : str
        What has the keys, where that is not the place.
    partial : bool
        Keys may be left out for the defaults of their fields, here and in tables inside.

    Returns
    -------
    instance of `cls`

    Raises
    ------
    InputError
        An unknown key (with its nearest match), a missing one, a value of the wrong type.
    """
    values = values_of(cls, data, where, noun=noun, partial=partial)
    try:
        shapes = cls.array_shapes({**data, **values}) if issubclass(cls, Coded) else {}
    except KeyError as error:
        raise MissingKey(error.args[0]) from None
    values.update({name: values[name].reshape(shape) for name, shape in shapes.items() if values[name] is not None})
    return cls(**values)


def values_of(cls: type, data: Mapping[str, Any], where: str = "", *, noun: str = "",
              partial: bool = False) -> dict[str, Any]:
    """What plain data give for the fields of a dataclass, as `build` reads it.

    Parameters
    ----------
    cls, data, where, noun, partial
        See `build`.

    Returns
    -------
    dict
        Values by field; those left out are not in it.

    Raises
    ------
    InputError
        As `build`.
    """
    noun = noun or where or cls.__name__
    data, keys, own, hints = expect_table(data, noun), layout(cls), _metadata(cls), _hints(cls)
    for key in data:
        if key not in getattr(cls, "BESIDE", ()):
            _checks.known_name(key, [k for k, _ in keys], f"key of {noun}")
    values = {}
    for key, name in ((k, n) for k, n in keys if n in own):
        if key in data:
            try:
                values[name] = decode(hints[name], data[key], f"{where}.{key}" if where else key, own[name], partial)
            except MissingKey as error:
                raise MissingKey(f"{key}.{error.key}") from None
        elif not partial and not own[name].get("added"):
            raise MissingKey(key)
    return values


def decode(hint: Any, value: Any, where: str, rules: Mapping[str, Any] = types.MappingProxyType({}),
           partial: bool = False) -> Any:
    """A plain value as its type hint has it.

    Parameters
    ----------
    hint : type or annotation
        Number, text, array, tuple, mapping, union, dataclass or what has `from_dict`.
    value : object
        As JSON or TOML gave it.
    where : str
        Place, for messages.
    rules : mapping
        Metadata of the field: ``null``, ``verbatim``, and ``read``, a function of value and place that counts before
        the hint.
    partial : bool
        See `build`.

    Returns
    -------
    object

    Raises
    ------
    InputError
        A value of the wrong type.
    """
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if value is None and "null" in rules:
        return rules["null"]
    if rules.get("verbatim"):
        return value
    if origin in (typing.Union, types.UnionType):
        return None if value is None and type(None) in inner else _first(inner, value, where, rules, partial)
    if "read" in rules and not (origin is tuple and "unit" in rules):
        return rules["read"](value, where)
    if origin in (tuple, Sequence):
        if not isinstance(value, (list, tuple)) or ("unit" in rules and not value):
            of = " of numbers" if "unit" in rules else " of tables" if Mapping in inner else ""
            raise InputError(f"{where} must be a list{of}", got=repr(value)[:60],
                             mend=f"write [[{where}]]" if Mapping in inner else None)
        fixed = origin is tuple and inner[-1] is not ...
        if fixed and len(value) != len(inner):
            raise InputError(f"{where} must be a list of {len(inner)}", got=repr(value))
        hints = inner if fixed else inner[:1] * len(value)
        return tuple(decode(h, v, where, rules, partial) for h, v in zip(hints, value, strict=True))
    if hint is np.ndarray:
        try:
            return np.asarray(value, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"{where} must hold numbers", got=type(value).__name__, why=str(error)) from None
    if hint is Mapping or origin in (Mapping, dict):
        table = expect_table(value, where)
        return {k: decode(inner[1], v, f"{where}.{k}", partial=partial) if inner else v for k, v in table.items()}
    if hasattr(hint, "from_dict"):
        return hint.from_dict(value)
    if dataclasses.is_dataclass(hint):
        return build(typing.cast(type, hint), expect_table(value, where), where, partial=partial)
    if hint in WORDS:
        accepted, words = WORDS[hint]
        if not isinstance(value, accepted) or (isinstance(value, bool) and hint is not bool):
            raise InputError(f"{where} must be {words}", got=repr(value))
    return value  # of any type


WORDS: Mapping[Any, tuple[Any, str]] = {bool: (bool, "true or false"), int: (int, "a whole number"),
                                        float: ((int, float), "a number"), str: (str, "text")}


def expect_table(data: object, where: str) -> Mapping[str, Any]:
    """Refuse what is not a mapping.

    Parameters
    ----------
    data : object
        As JSON or TOML gave it.
    where : str
        Place, for the message.

    Returns
    -------
    mapping
        `data`.

    Raises
    ------
    InputError
        Anything else.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{where} must be a table", got=repr(data))
    return data


@functools.cache
def layout(cls: type) -> tuple[tuple[str, str], ...]:
    """Keys of a dataclass in order, each with the name of the field or property that it holds.

    Parameters
    ----------
    cls : type
        Dataclass.

    Returns
    -------
    tuple of (str, str)
    """
    every = [f.name for f in dataclasses.fields(cls) if f.init] if dataclasses.is_dataclass(cls) else []
    named = [n for entry in getattr(cls, "JSON", (...,)) for n in (every if entry is ... else [entry])]
    return tuple((n, n) if isinstance(n, str) else n for n in named)


def _first(hints: Sequence[Any], value: Any, where: str, rules: Mapping[str, Any], partial: bool) -> Any:
    """By the first member of a union that takes the value; the last one's refusal where none does."""
    *others, last = [h for h in hints if h is not type(None)]
    for hint in others:
        try:
            return decode(hint, value, where, rules, partial)
        except InputError:
            continue
    return decode(last, value, where, rules, partial)


def _of_kind(cls: type[Coded], kind: object) -> Any:
    for module in cls.KINDS_IN:
        importlib.import_module(module)
    found, waiting = {}, [cls]
    while waiting:
        own = waiting.pop().__subclasses__()
        found.update({vars(c)["kind"]: c for c in own if "kind" in vars(c)})
        waiting += own
    if kind not in found:
        raise UnknownKind(f"unknown {cls.NOUN} in a model file", got=kind, why=f"known: {', '.join(sorted(found))}",
                          mend="import the module that defines it first")
    return found[kind]


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    """Types of the fields; `typing.get_type_hints` would evaluate those of every base as well, fields or not."""
    written = {name: (hint, owner.__module__) for owner in reversed(cls.__mro__)
               for name, hint in vars(owner).get("__annotations__", {}).items()}
    return {f.name: typing.get_type_hints(types.SimpleNamespace(__annotations__={f.name: written[f.name][0]}),
                                          vars(sys.modules[written[f.name][1]]))[f.name]
            for f in dataclasses.fields(cls) if f.init}


@functools.cache
def _metadata(cls: type) -> dict[str, Mapping[str, Any]]:
    return {f.name: f.metadata for f in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else {}
