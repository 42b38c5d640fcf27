"""PLANT files: a TOML text with matrices by powers of the scheduling, signals by name and role, and weights."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.codec import decode, expect_table
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.synthesis import weights
from lpvid.synthesis.attach_weights import weigh
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.tables import kind_of, known_keys, matrix_of, texts_of, to_si

KEYS = ("name", "model", "inputs", "outputs", "controls", "measurements", "sample_time", "scheduling", "matrices",
        "weights", "design")
WEIGHTS: Mapping[str, tuple[Callable[..., LPVStateSpace], tuple[str, ...]]] = {
    "first-order": (weights.first_order, ("dc", "crossover", "high")),
    "lead-lag": (weights.lead_lag, ("gain", "zero", "pole")),
    "lowpass": (weights.lowpass, ("gain", "corner")),
    "performance": (weights.performance, ("bandwidth", "peak", "floor")),
    "control-effort": (weights.control_effort, ("bandwidth", "peak", "roll_off")),
    "bandpass": (weights.bandpass, ("gain", "centre", "damping")),
}
"""Weights by their name in a file, with their settings (angular frequencies in rad/s)."""
ANGULAR = ("crossover", "zero", "pole", "corner", "bandwidth", "centre")
"""Those of them that are angular frequencies: text in Hz counts with its 2π."""
_HERTZ = re.compile(r"(?i)h(ert)?z\s*$")
OPTIONAL = ("peak", "floor", "roll_off", "damping")
_SIGNAL = re.compile(r"\s*([^\[\]]+?)\s*(?:\[([^\[\]]*)\])?\s*")
_TERM = re.compile(r"\s*([A-Za-z_][\w.-]*)\s*(?:\^\s*(\d+))?\s*")


def plant_of(table: Mapping[str, Any], folder: Path, load: Callable[[Path], object]) -> GeneralizedPlant:
    """The plant that a table describes.

    Parameters
    ----------
    table : mapping
        As `read_toml` gives it.
    folder : Path
        Where the path of a saved model is looked up.
    load : callable
        Reads a saved model.

    Returns
    -------
    GeneralizedPlant
        In SI, with the weights of the file attached.

    Raises
    ------
    InputError
        Unknown keys, signals or powers, matrices that do not fit together.
    """
    known_keys(table, KEYS, "the plant")
    if "model" in table:
        own = [k for k in ("inputs", "outputs", "matrices", "sample_time") if k in table]
        if own:
            raise InputError("a plant has a saved model or matrices of its own, not both", got=f"model and {own[0]}")
        path = folder / decode(str, table["model"], "model")
        system = load(path)
        if not isinstance(system, LPVStateSpace):
            raise InputError(f"'{path}' holds a {type(system).__name__}", mend="give a state-space model "
                             "(lpvid.realize makes one of a transfer function)")
        if "scheduling" in table:
            system = system.replace(scheduling=_box(table["scheduling"], system.box))
    else:
        system = _system(table)
    controls, measurements = (texts_of(_needed(table, k), k) for k in ("controls", "measurements"))
    plant = GeneralizedPlant(system, controls, measurements)
    return _weighed(plant, expect_table(table.get("weights", {}), "weights"))


def output_weights(table: Mapping[str, Any], plant: GeneralizedPlant) -> dict[str, LPVStateSpace | float]:
    """The weights of a plant's performance signals, by signal, as its file has them.

    Parameters
    ----------
    table : mapping
        Of the PLANT file.
    plant : GeneralizedPlant
        What `plant_of` made of it.

    Returns
    -------
    dict of str to LPVStateSpace or float
    """
    found: dict[str, LPVStateSpace | float] = {}
    for name, value in expect_table(table.get("weights", {}), "weights").items():
        if name in plant.performance:
            entry = dict(expect_table(value, f"weights.{name}"))
            entry.pop("of", None)
            found[name] = _weight(entry, name)
    return found


def _needed(table: Mapping[str, Any], key: str, what: str = "the plant") -> Any:
    if key not in table:
        raise InputError(f"{what} lacks '{key}'", mend="lpvid synthesize --template prints an example")
    return table[key]


def _system(table: Mapping[str, Any]) -> LPVStateSpace:
    inputs, outputs = (tuple(map(_signal, texts_of(_needed(table, k), k))) for k in ("inputs", "outputs"))
    box = _box(table.get("scheduling", {}), None)
    terms = {_exponents(key, box.names): (key, expect_table(value, f"matrices.\"{key}\""))
             for key, value in expect_table(_needed(table, "matrices"), "matrices").items()}
    constant = terms.get((0,) * len(box.names))
    if constant is None or "A" not in constant[1]:
        raise InputError("the plant lacks the constant part of A", mend="write it under [matrices.1]")
    n = len(matrix_of(constant[1]["A"], (None, None), "matrices.1.A"))
    basis = Polynomial(box.names, max(map(sum, terms)))
    place = {tuple(int(e) for e in row): k for k, row in enumerate(basis.exponents)}
    shapes = {"A": (n, n), "B": (n, len(inputs)), "C": (len(outputs), n), "D": (len(outputs), len(inputs))}
    stacks = {name: np.zeros((basis.size, *shape)) for name, shape in shapes.items()}
    for exponents, (key, blocks) in terms.items():
        known_keys(blocks, tuple(shapes), f"matrices.\"{key}\"")
        for name, value in blocks.items():
            stacks[name][place[exponents]] = matrix_of(value, shapes[name], f"matrices.\"{key}\".{name}")
    period = to_si(table["sample_time"], None, "sample_time") if "sample_time" in table else None
    return LPVStateSpace(stacks["A"], stacks["B"], stacks["C"], stacks["D"], basis,
                         period, box, inputs=inputs, outputs=outputs)


def _signal(text: str) -> Signal:
    found = _SIGNAL.fullmatch(text)
    if found is None:
        raise InputError("a signal is written as a name with its unit in brackets", got=repr(text),
                         mend='for example "stroke [m]"')
    return Signal(found[1], found[2] or "")


def _exponents(key: str, names: tuple[str, ...]) -> tuple[int, ...]:
    """Powers of a product of scheduling variables: "1", "p", "p^2*q"."""
    powers = dict.fromkeys(names, 0)
    for factor in () if key.strip() == "1" else key.split("*"):
        found = _TERM.fullmatch(factor)
        if found is None:
            raise InputError("matrices stand under 1 or a product of scheduling variables", got=repr(key),
                             mend='for example [matrices."p^2*q"]')
        powers[_checks.known_name(found[1], names, "scheduling variable")] += int(found[2] or 1)
    return tuple(powers.values())


def _box(value: object, known: Scheduling | None) -> Scheduling:
    """The scheduling variables of a table; those of a model keep what the table leaves out."""
    tables = {n: expect_table(entry, f"scheduling.{n}") for n, entry in expect_table(value, "scheduling").items()}
    names = tuple(tables) if known is None else known.names
    rows = []
    for name in tables:
        _checks.known_name(name, names, "scheduling variable of the model")
    for k, name in enumerate(names):
        entry = tables.get(name, {})
        known_keys(entry, ("range", "rate", "unit"), f"scheduling.{name}")
        if "range" in entry:
            pair = entry["range"]
            if not isinstance(pair, list) or len(pair) != 2:
                raise InputError(f"scheduling.{name}.range needs a lower and an upper value", got=repr(pair))
            low, high = (to_si(v, None, f"scheduling.{name}.range") for v in pair)
        elif known is None:
            raise InputError(f"scheduling.{name} lacks its range", mend="range = [lowest, highest]")
        else:
            low, high = known.lower[k], known.upper[k]
        rate = to_si(entry["rate"], None, f"scheduling.{name}.rate") if "rate" in entry else (
            None if known is None else known.rate[k])
        unit = decode(str, entry["unit"], f"scheduling.{name}.unit") if "unit" in entry else (
            "" if known is None else known.units[k])
        rows.append((low, high, rate, unit))
    lower, upper, rates, units = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Scheduling(names, lower, upper, rates, units)


def _weighed(plant: GeneralizedPlant, table: Mapping[str, Any]) -> GeneralizedPlant:
    """Weights in front of inputs and behind outputs, by the signal they stand at."""
    inputs: dict[str, Any] = {}
    outputs: dict[str, Any] = {}
    names_in = [s.name for s in plant.system.inputs]
    names_out = [s.name for s in plant.system.outputs]
    for name, value in table.items():
        entry = dict(expect_table(value, f"weights.{name}"))
        source = entry.pop("of", None)
        weight = _weight(entry, name)
        if source is not None:
            outputs[name] = (decode(str, source, f"weights.{name}.of"), weight)
        elif name in names_in:
            inputs[name] = weight
        else:
            outputs[_checks.known_name(name, [*names_in, *names_out], "signal to weigh",
                                       "name the signal that a new one is made of: of = \"…\"")] = weight
    return weigh(plant, inputs, outputs) if table else plant


def _weight(entry: dict[str, Any], name: str) -> LPVStateSpace | float:
    if "kind" not in entry:
        known_keys(entry, ("gain",), f"weights.{name}")
        return to_si(_needed(entry, "gain", f"weights.{name}"), None, f"weights.{name}.gain")
    (make, settings), entry = kind_of(entry, WEIGHTS, f"weights.{name}")
    known_keys(entry, settings, f"weights.{name}")
    for key in settings:
        if key not in OPTIONAL:
            _needed(entry, key, f"weights.{name}")
    return make(**{key: _setting(key, value, f"weights.{name}.{key}") for key, value in entry.items()})


def _setting(key: str, value: Any, where: str) -> float:
    """In SI: for a unit, 1 Hz is 1/s; of an angular frequency it is 2π rad/s."""
    number = to_si(value, None, where)
    turns = key in ANGULAR and isinstance(value, str) and _HERTZ.search(value)
    return 2 * np.pi * number if turns else number
