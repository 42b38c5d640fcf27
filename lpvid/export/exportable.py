"""A model as a step program: whose exporter makes it, and what is held in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.export.contract import SAMPLES, Exportable, Exporter, Options, smooth_noise, within
from lpvid.export.expression import Array, Symbol
from lpvid.export.model_steps import EXPORTER
from lpvid.export.serialise import installed

__all__ = ["SAMPLES", "Exportable", "Exporter", "Options", "exportable", "exporters", "flow_of", "has_step", "held",
           "smooth_noise", "within"]

ENTRY_POINTS = "lpvid.exports"
"""Group under which another package names its `Exporter`, as ``name = "package.module:EXPORTER"``."""


def exporters() -> Sequence[Exporter]:
    """lpvid's own exporter, then those that installed packages name in the entry-point group ``lpvid.exports``.

    Returns
    -------
    sequence of Exporter
        The first that accepts a noun exports it; those of packages are sorted by name.

    Raises
    ------
    InputError
        An entry point that does not load, or names something else.
    """
    return [EXPORTER, *installed(ENTRY_POINTS, Exporter)]


def exportable(noun: Any, options: Options | None = None) -> Exportable:
    """A model, damper or controller as a step program.

    Parameters
    ----------
    noun : object
        What `lpvid.load` returns, or an `Exportable` as it is.
    options : Options, optional

    Returns
    -------
    Exportable
        With the inputs of `Options.at` held.

    Raises
    ------
    InputError
        What has no step, with the nearest that has one.
    """
    if isinstance(noun, Exportable):
        return noun
    for exporter in exporters():
        if exporter.accepts(noun):
            chosen = options or Options()
            return held(exporter.prepare(noun, chosen), chosen.at)
    raise InputError("this object cannot be exported as a step", got=type(noun).__name__,
                     mend="export a model, a damper, a controller or a synthesis (its controller); of a diagnosis its "
                          "extended_lpv.json")


def has_step(noun: Any) -> bool:
    """Whether a model, damper or controller can be exported as it is.

    Parameters
    ----------
    noun : object
        What may be exported.

    Returns
    -------
    bool
        False for what needs an option, as a continuous model needs a sample time.

    Examples
    --------
    >>> has_step("a text")
    False
    """
    try:
        exportable(noun)
    except InputError:
        return False
    return True


def flow_of(noun: Any, options: Options | None = None) -> Any:
    """A continuous model as a `lpvid.export.flow.Flow`; None for what is sampled.

    Parameters
    ----------
    noun : object
        What `lpvid.load` returns; of an `Exportable` there is no flow.
    options : Options, optional
        A sample time in it requests a sampled model, and thus no flow.

    Returns
    -------
    lpvid.export.flow.Flow or None
        By the first exporter that accepts the noun.
    """
    for exporter in () if isinstance(noun, Exportable) else exporters():
        if exporter.accepts(noun):
            return exporter.flow(noun, options or Options())
    return None


def held(found: Exportable, at: Mapping[str, float]) -> Exportable:
    """The same step with some inputs held at values: they become parameters, and the model is frozen there.

    Parameters
    ----------
    found : Exportable
    at : mapping of str to float
        By the input's name in the model.

    Returns
    -------
    Exportable
        Its reference is the simulation along a trajectory with these inputs constant.

    Raises
    ------
    InputError
        A name that is no input, a value outside the model's range, or no input left.
    """
    if at is None or (isinstance(at, Mapping) and not at):
        return found
    _checks.instance(at, Mapping, "held inputs go by name", 'at={"current": 1.2}')
    program = found.program
    known = {q.label or q.name: q for q in program.inputs}
    for name, value in at.items():
        q = known[_checks.known_name(name, tuple(known), "input")]
        slack = 1e-9 * max(abs(q.lower), abs(q.upper), 1.0) if np.isfinite(q.lower) and np.isfinite(q.upper) else 0.0
        if not q.lower - slack <= _checks.real(value, f"the held value of '{name}'") <= q.upper + slack:
            raise InputError(f"'{name}' cannot be held there", got=f"{value:g} outside {q.lower:g} to {q.upper:g}",
                             mend="a value inside the range of the model")
    if len(at) == len(known):
        raise InputError("every input would be held", got=", ".join(at), mend="hold the scheduling alone")
    fixed = {known[n].name: float(v) for n, v in at.items()}
    kept = [i for i, q in enumerate(program.inputs) if q.name not in fixed]
    constant = np.array([fixed.get(q.name, 0.0) for q in program.inputs])

    def full(u: np.ndarray) -> np.ndarray:
        out = np.tile(constant, (len(u), 1))
        out[:, kept] = u
        return out

    moved = tuple(dataclasses.replace(q, start=np.array(fixed[q.name]), description=f"{q.description}, held")
                  for q in program.inputs if q.name in fixed)
    text = ", ".join(f"{n} = {v:g}" for n, v in at.items())

    def place(s: Symbol) -> Symbol:
        return Symbol("parameter", s.name) if s.home == "input" and s.name in fixed else s

    frozen = dataclasses.replace(
        program, inputs=tuple(program.inputs[i] for i in kept), parameters=(*moved, *program.parameters),
        body=rewritten(program.body, place),
        notes=(*program.notes, f"Frozen at {text}; that is a parameter."))
    return Exportable(frozen, lambda u: found.reference(full(u)), lambda n, rng: found.excite(n, rng)[:, kept],
                      found.model)


def rewritten(node: Any, change: Callable[[Symbol], Symbol]) -> Any:
    """Statements and expressions with every scalar replaced by what `change` makes of it.

    Parameters
    ----------
    node : object
        A statement, an expression, or a tuple or list of these; anything else comes back as it is.
    change : callable
        Symbol to symbol.

    Returns
    -------
    object
        A copy of the same classes; arrays keep their homes.
    """
    if isinstance(node, Symbol):
        return change(node)
    if isinstance(node, (tuple, list)):
        return type(node)(rewritten(n, change) for n in node)
    if dataclasses.is_dataclass(node) and not isinstance(node, (type, Array)):
        values = {f.name: rewritten(getattr(node, f.name), change) for f in dataclasses.fields(node)}
        return type(node)(**values)
    return node
