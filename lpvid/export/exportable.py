"""Exportable: a model as a step program, with the simulation that the program must reproduce."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.export.expression import Array, Symbol
from lpvid.export.step_program import StepProgram

ENTRY_POINTS = "lpvid.exports"
"""Group under which another package names its `Exporter`, as ``name = "package.module:EXPORTER"``."""
SAMPLES = 200
"""samples of the reference data of a self-test"""


@dataclass(frozen=True, eq=False)
class Options:
    """How a model is exported.

    Attributes
    ----------
    name : str
        Prefix of files and functions; left out, one from the model's kind.
    clamp : bool or None
        Hold the scheduling inside the model's box; left out, for designed controllers only.
    sample_time : float or None
        Period of what runs at any [s]; what is sampled keeps its own.
    at : mapping of str to float
        Inputs to hold: a model frozen at its scheduling.
    """

    name: str = ""
    clamp: bool | None = None
    sample_time: float | None = None
    at: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Exportable:
    """A step program with its oracle.

    Attributes
    ----------
    program : StepProgram
    reference : callable
        (n, inputs) samples to (n, outputs): this package's own simulation from rest, not the program.
    excite : callable
        (n, rng) to (n, inputs): a random trajectory inside the ranges.
    model : object
        What was exported.
    """

    program: StepProgram
    reference: Callable[[np.ndarray], np.ndarray]
    excite: Callable[[int, np.random.Generator], np.ndarray]
    model: Any

    def __repr__(self) -> str:
        return f"Exportable {type(self.model).__name__} as {self.program!r}"

    def trial(self, samples: int = SAMPLES, seed: int = 0, single: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """A random trajectory and what the simulation makes of it.

        Parameters
        ----------
        samples, seed : int
        single : bool
            Inputs that single precision holds exactly, so that only the arithmetic is compared.

        Returns
        -------
        (n, inputs) array
        (n, outputs) array

        Raises
        ------
        InputError
            A simulation that is not finite.
        """
        u = self.excite(samples, np.random.default_rng(seed))
        u = u.astype(np.float32).astype(float) if single else u
        y = np.asarray(self.reference(u), dtype=float).reshape(samples, len(self.program.outputs))
        if not np.isfinite(y).all():
            raise InputError("an unstable model is not exported as a step",
                             got=f"a self-test of {self.program.name} that leaves all bounds at sample "
                             f"{int(np.argmin(np.isfinite(y).all(axis=1)))}",
                             mend="identify again with a lower order, or with --passive")
        return u, y

    def rounding(self, samples: int = SAMPLES) -> float:
        """How far rounding of the inputs to single precision moves the simulation, relative to the largest output.

        No arithmetic in single precision can be expected to do better: it is the condition of the task times 6e-8.

        Parameters
        ----------
        samples : int
            Length of the random trajectory; its sample time is that of the program.

        Returns
        -------
        float
            Largest over the outputs; 0 where there are none.
        """
        u, y = self.trial(samples, single=True)
        signs = np.random.default_rng(1).choice([-1.0, 1.0], u.shape)
        moved = np.asarray(self.reference(u * (1 + signs * 2.0**-24)), dtype=float).reshape(y.shape)
        scale = np.abs(y).max(axis=0, initial=0.0)
        return float((np.abs(moved - y).max(axis=0, initial=0.0) / np.where(scale > 0, scale, 1.0)).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Exporter:
    """What one package can export.

    Attributes
    ----------
    accepts : callable
        Noun to bool.
    prepare : callable
        (noun, Options) to Exportable; InputError where this one has no step, with the nearest that has.
    flow : callable
        (noun, Options) to `lpvid.export.flow.Flow`, or None for what is not continuous.
    """

    accepts: Callable[[Any], bool]
    prepare: Callable[[Any, Options], Exportable]
    flow: Callable[[Any, Options], Any] = lambda noun, options: None


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
    from importlib.metadata import entry_points

    from lpvid.export.model_steps import EXPORTER

    found = [EXPORTER]
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda e: (e.name, e.value)):
        try:
            exporter = point.load()
        except Exception as error:  # whatever a foreign module raises when it is imported
            raise InputError(f"the entry point '{point.name}' of {ENTRY_POINTS} does not load", why=str(error),
                             mend="update or remove the package that names it") from None
        if not isinstance(exporter, Exporter):
            raise InputError(f"the entry point '{point.name}' of {ENTRY_POINTS} is no Exporter",
                             got=type(exporter).__name__, mend="update or remove the package that names it")
        found.append(exporter)
    return found


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


def smooth_noise(samples: int, columns: int, rng: np.random.Generator, memory: float = 0.7) -> np.ndarray:
    """(n, columns) low-passed noise within ±1: a random trajectory that visits the whole range.

    Parameters
    ----------
    samples, columns : int
        Length and number of the trajectories.
    rng : numpy.random.Generator
        Source of the white noise.
    memory : float
        Pole of the first-order low pass in z, in [0, 1).

    Returns
    -------
    (samples, columns) array
        Every column scaled so that its largest magnitude is 1.
    """
    raw = rng.standard_normal((samples + 50, columns))
    out = np.zeros_like(raw)
    for k in range(1, len(raw)):
        out[k] = memory * out[k - 1] + (1 - memory) * raw[k]
    out = out[50:]
    return out / np.maximum(np.abs(out).max(axis=0, initial=0.0), 1e-300)


def within(samples: int, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, k) random trajectories that fill [low, high].

    Parameters
    ----------
    samples : int
        Length of the trajectories.
    low, high : (k,) arrays
        Ends of each range, in the unit of the channel.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    (samples, k) array
        Each trajectory touches one end of its range at least.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return 0.5 * (low + high) + 0.5 * (high - low) * smooth_noise(samples, low.size, rng)


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
    if not at:
        return found
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
