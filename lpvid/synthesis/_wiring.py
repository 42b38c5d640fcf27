"""Who drives whom: the names of signals turned into the constant matrices that join systems."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace

_TERM = re.compile(r"\s*(?P<sign>[+-]?)\s*"
                   r"(?:(?P<factor>\d+\.?\d*(?:[eE][+-]?\d+)?)\s*\*?\s*)?"
                   r"(?P<name>[^\W\d][\w.]*)\s*")

Drive = str | Mapping[str, float]
"""What drives an input: a signed sum, as text or as factors by name."""


def signed_sum(text: Drive) -> dict[str, float]:
    """Factors by name of a sum such as ``"r - 2 y"``.

    Examples
    --------
    >>> signed_sum("reference - 2 speed + 0.5*slip")
    {'reference': 1.0, 'speed': -2.0, 'slip': 0.5}
    """
    if not isinstance(text, str):
        return {name: _checks.real(factor, f"the factor of '{name}'") for name, factor in text.items()}
    factors: dict[str, float] = {}
    place = 0
    while place < len(text.rstrip()):
        match = _TERM.match(text, place)
        if match is None or (place and not match["sign"]):
            raise InputError("a sum of signals cannot be read", got=repr(text), mend='write it as "r - 2 y"')
        size = float(match["factor"] or 1.0) * (-1.0 if match["sign"] == "-" else 1.0)
        factors[match["name"]] = factors.get(match["name"], 0.0) + size
        place = match.end()
    if not factors:
        raise InputError("a sum of signals is empty", got=repr(text), mend='write it as "r - 2 y"')
    return factors


@dataclass(frozen=True, eq=False)
class Wiring:
    """u = feedback y + entry r and z = exit y + passed r, with the signals of r, y and z."""

    feedback: np.ndarray
    entry: np.ndarray
    exit: np.ndarray
    passed: np.ndarray
    inputs: tuple[Signal, ...]
    produced: tuple[str, ...]
    outputs: tuple[Signal, ...]


def wire(systems: Sequence[LPVStateSpace], inputs: Sequence[str], outputs: Sequence[str],
         wires: Mapping[str, Drive]) -> Wiring:
    """The matrices that join systems; every refusal names the signal."""
    driven = [s for system in systems for s in system.inputs]
    made = {s.name: s for system in systems for s in system.outputs}
    produced = [s.name for system in systems for s in system.outputs]
    twice = sorted({n for n in produced if produced.count(n) > 1})
    if twice:
        raise InputError("a signal is produced by two blocks", got=", ".join(twice), mend="rename one of the outputs")
    both = sorted(set(inputs) & set(produced))
    if both:
        raise InputError("an input of the whole is also the output of a block", got=", ".join(both),
                         mend="rename it, and add the two in `wires`")
    for name in wires:
        _checks.known_name(name, [s.name for s in driven], "input of a block")
    into = np.zeros((len(driven), len(produced) + len(inputs)))
    sources = [*produced, *inputs]
    for row, signal in enumerate(driven):
        drive = signed_sum(wires[signal.name]) if signal.name in wires else {signal.name: 1.0}
        for name, factor in drive.items():
            if name not in sources:
                raise InputError(f"nothing drives the input '{signal.name}'" if name == signal.name else
                                 f"'{name}', which drives '{signal.name}', does not exist",
                                 got=f"outputs {', '.join(produced) or 'none'}; inputs {', '.join(inputs) or 'none'}",
                                 mend="name it among the inputs of the whole, or wire it")
            into[row, sources.index(name)] += factor
    out, leaving = np.zeros((len(outputs), len(sources))), []
    for row, text in enumerate(outputs):
        name, factors = _leaving(text, sources)
        leaving.append(name)
        for source, factor in factors.items():
            out[row, sources.index(_checks.known_name(source, sources, "output of a block"))] += factor
    n = len(produced)
    idle = [name for k, name in enumerate(inputs) if not into[:, n + k].any() and not out[:, n + k].any()]
    if idle:
        raise InputError("an input of the whole drives nothing", got=", ".join(idle),
                         why=f"the blocks have the inputs {', '.join(s.name for s in driven)}")
    entering = tuple(_entering(name, driven, into[:, n + k]) for k, name in enumerate(inputs))
    known = {**{s.name: s for s in entering}, **made}
    named = tuple(known.get(name) or Signal(name, _unit(row, sources, known)) for name, row in
                  zip(leaving, out, strict=True))
    return Wiring(into[:, :n], into[:, n:], out[:, :n], out[:, n:], entering, tuple(produced), named)


def _leaving(text: str, sources: Sequence[str]) -> tuple[str, dict[str, float]]:
    """Name and factors of an output: a signal, a signed sum, or ``"name = sum"``.

    Examples
    --------
    >>> _leaving("error = r - 2 y", ["r", "y"])
    ('error', {'r': 1.0, 'y': -2.0})
    >>> _leaving("r - y", ["r", "y"])
    ('r - y', {'r': 1.0, 'y': -1.0})
    """
    if text in sources:
        return text, {text: 1.0}
    name, equals, drive = text.partition("=")
    if equals and name.strip():
        return name.strip(), signed_sum(drive.strip())
    factors = signed_sum(text) if re.search(r"\s[+-]|^\s*[+-]|\d\s*\*", text) else {text: 1.0}
    return text, factors


def _unit(row: np.ndarray, sources: Sequence[str], known: Mapping[str, Signal]) -> str:
    """The unit that all terms of a sum share, with factors of one; none where they differ."""
    terms = np.flatnonzero(row)
    units = {known[sources[int(k)]].unit for k in terms}
    return units.pop() if len(units) == 1 and np.all(np.abs(row[terms]) == 1.0) else ""


def _entering(name: str, driven: Sequence[Signal], column: np.ndarray) -> Signal:
    """An input of the whole, with the unit of the first input that it alone drives."""
    units = [s.unit for s, factor in zip(driven, column, strict=True) if abs(factor) == 1.0]
    same = [s.unit for s in driven if s.name == name]
    return Signal(name, next(iter([*same, *units]), ""))
