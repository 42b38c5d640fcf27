"""Parameter sets from files: a published set written by hand, or a damper that `lpvid.save` wrote."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers import model_class
from quartercar.dampers.contract import Damper

KEYS = ("model", "label", "settings", "parameters", "centre", "current_unit", "current_range", "source")
LARGEST = 2**24
"""bytes above which a file is refused"""


def read_parameters(path: str | Path, like: Damper | None = None) -> Damper:
    """A damper from a JSON file of parameters.

    The file holds ``{"model": "bouc-wen", "parameters": {"viscous_damping": "21 N*s/cm", …}}`` with the parameter names
    that `quartercar fit` writes, values SI or text with a unit; parameters left out take their defaults. ``label``,
    ``settings``, ``centre`` [m], ``current_unit``, ``current_range`` and ``source`` are optional. A file written by
    `lpvid.save` will do as well.

    Parameters
    ----------
    path : str or Path
    like : Damper, optional
        Damper of the same model whose settings and place (centre, currents) serve for what the file leaves out.

    Returns
    -------
    Damper

    Raises
    ------
    InputError
        No such file, no JSON, an unknown model, parameter, unit or key.
    """
    path = Path(path)
    data = _object(path)
    if "schema" in data:
        from lpvid.export.serialise import load

        damper = load(path)
        if not isinstance(damper, Damper):
            raise InputError(f"'{path}' holds no damper model", got=type(damper).__name__,
                             mend="a MODEL.json of quartercar fit, or a parameter set")
        return _labelled(damper, {}, path)
    for key in data:
        if key not in KEYS:
            raise InputError(f"'{path}': unknown key '{key}'", mend=f"known are {', '.join(KEYS)}")
    if not isinstance(data.get("model"), str) or not isinstance(data.get("parameters"), Mapping):
        raise InputError(f"'{path}' is no parameter set", got=", ".join(data) or "an empty object",
                         mend='{"model": "guo", "parameters": {"NAME": VALUE, …}}')
    cls = model_class(data["model"])
    try:
        damper = _empty(cls, data.get("settings"), like)
        units = {p.name: p.unit for p in damper.parameters}
        values = {n: _si(v, units.get(n, ""), n) for n, v in data["parameters"].items()}
        damper = replace(damper, values=values, **{k: data[k] for k in ("centre", "current_unit", "current_range")
                                                   if k in data})
    except (InputError, TypeError) as error:
        raise InputError(f"'{path}': {' '.join(str(error).split())}") from None
    return _labelled(damper, data, path)


def model_of(path: str | Path) -> str | None:
    """Name of the model that a parameter set belongs to; None for a file of `lpvid.save`, which holds its own.

    Parameters
    ----------
    path : str or Path
        A JSON file.

    Returns
    -------
    str or None
        Name on the command line, e.g. ``"bouc-wen"``, as the file states it.
    """
    name = _object(Path(path)).get("model")
    return name if isinstance(name, str) else None


def read_values(path: str | Path, model: str, units: Mapping[str, str]) -> dict[str, float]:
    """Parameters [SI] of a set for something that is no damper, e.g. a car; `units` names all that it may hold.

    Parameters
    ----------
    path : str or Path
        A JSON file of the form that `read_parameters` reads.
    model : str
        Name that the file must state as its ``model``.
    units : mapping of str to str
        SI unit by parameter name.

    Returns
    -------
    dict of str to float
        Values in SI, of the parameters in the file only.

    Raises
    ------
    InputError
        No such file, no JSON, a set of something else, an unknown parameter, a value without number or with a wrong
        unit.
    """
    path = Path(path)
    data = _object(path)
    if data.get("model") != model or not isinstance(data.get("parameters"), Mapping):
        raise InputError(f"'{path}' is no parameter set of '{model}'", got=repr(data.get("model")),
                         mend=f'{{"model": "{model}", "parameters": {{"NAME": VALUE, …}}}}')
    try:
        for name in data["parameters"]:
            checks.known_name(name, list(units), f"parameter of {model}")
        return {n: _si(v, units[n], n) for n, v in data["parameters"].items()}
    except InputError as error:
        raise InputError(f"'{path}': {' '.join(str(error).split())}") from None


def _object(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"no file '{path}'", mend="check the path")
    if path.stat().st_size > LARGEST:
        raise InputError(f"'{path}' is too large for a parameter set")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"'{path}' is not a JSON file", got=" ".join(str(error).split())[:120]) from None
    if not isinstance(data, dict):
        raise InputError(f"'{path}' is no parameter set", got=f"a JSON {type(data).__name__}",
                         mend='{"model": "guo", "parameters": {"NAME": VALUE, …}}')
    return data


def _empty(cls: type[Damper], settings: Mapping | None, like: Damper | None) -> Damper:
    """A damper of the class with these settings, else with those of `like`."""
    own: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in (settings or {}).items()}
    if isinstance(like, cls):
        return like.replace(values={}, **own)
    return cls(**own)


def _si(value: object, unit: str, name: str) -> float:
    """A bare number taken as SI, or text with a unit of the right dimension."""
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"{name} must be a number or text with a unit", got=repr(value))
        return float(value)
    from lpvid.units import quantity_to_si

    number, found = quantity_to_si(value)
    if found != quantity_to_si(f"1 {unit}")[1]:
        raise InputError(f"{name} has the wrong unit", got=repr(value), why=f"it is a quantity in {unit or '1'}")
    return float(number)


def _labelled(damper: Damper, data: Mapping[str, Any], path: Path) -> Damper:
    label = str(data.get("label", path.stem))
    extra = {"label": label, **({"source": data["source"]} if "source" in data else {})}
    return damper.replace(metadata={**damper.metadata, **extra})
