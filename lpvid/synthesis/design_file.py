"""DESIGN files: a TOML text that names a design and its settings; templates and schemas of both files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.codec import decode
from lpvid.errors import InputError
from lpvid.model.hull import Hull
from lpvid.scheduling import Polynomial
from lpvid.synthesis.controller_structures import PID, LowOrder, ObserverBased, StaticGain
from lpvid.synthesis.criteria import H2, Cone, Criterion, Disc, GeneralizedH2, HalfPlane, HInfinity, Region
from lpvid.synthesis.dissipative_feedback import DissipativeFeedback
from lpvid.synthesis.fixed_structure import FixedStructure
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.lft_synthesis import LFTFeedback
from lpvid.synthesis.multiobjective import MultiObjective
from lpvid.synthesis.observer import Filter, Observer
from lpvid.synthesis.output_feedback import VARYING, OutputFeedback
from lpvid.synthesis.plant_file import WEIGHTS
from lpvid.synthesis.state_feedback import StateFeedback
from lpvid.synthesis.synthesizing import Design
from lpvid.tables import kind_of, known_keys, tables_of, texts_of, to_si

DESIGNS: Mapping[str, tuple[type, tuple[str, ...]]] = {
    "output-feedback": (OutputFeedback, ("lyapunov_degree", "varying", "strictly_proper", "regions", "bound",
                                         "back_off", "points", "hull")),
    "state-feedback": (StateFeedback, ("criteria", "regions", "lyapunov_degree", "back_off", "points", "hull")),
    "dissipative-feedback": (DissipativeFeedback, ("back_off", "points")),
    "multi-objective": (MultiObjective, ("criteria", "regions", "lyapunov_degree", "varying", "feedthrough", "back_off",
                                         "points", "hull")),
    "observer": (Observer, ("criteria", "regions", "lyapunov_degree", "back_off", "points", "hull")),
    "filter": (Filter, ("criteria", "regions", "feedthrough", "back_off", "points", "hull")),
    "lft": (LFTFeedback, ("back_off",)),
    "fixed-structure": (FixedStructure, ("structure", "order", "filter", "gain_degree", "lyapunov_degree", "points",
                                         "hull")),
}
"""Designs by their name in a file, with the settings they take."""
CRITERIA = {"h-infinity": HInfinity, "h2": H2, "generalized-h2": GeneralizedH2}
STRUCTURES: Mapping[str, tuple[type, tuple[str, ...]]] = {
    "static-gain": (StaticGain, ()), "pid": (PID, ("filter",)), "low-order": (LowOrder, ("order",)),
    "observer-based": (ObserverBased, ())}
REGIONS: Mapping[str, tuple[type, tuple[str, ...]]] = {
    "half-plane": (HalfPlane, ("decay",)), "disc": (Disc, ("centre", "radius")), "cone": (Cone, ("damping",))}


def design_of(table: Mapping[str, Any], plant: GeneralizedPlant) -> Design:
    """The design that a table describes.

    Parameters
    ----------
    table : mapping
        As `read_toml` gives it.
    plant : GeneralizedPlant
        What it is for.

    Returns
    -------
    Design
        One of the classes in `DESIGNS`, with SI values.

    Raises
    ------
    InputError
        An unknown design, key, signal or value.
    """
    if "design" not in table:
        raise InputError("the design lacks its name", mend=f"design = \"{next(iter(DESIGNS))}\"; there are "
                         + ", ".join(DESIGNS))
    name = _checks.known_name(decode(str, table["design"], "design"), list(DESIGNS), "design")
    kind, allowed = DESIGNS[name]
    settings = {k: v for k, v in table.items() if k != "design"}
    known_keys(settings, allowed, f"the design '{name}'")
    given: dict[str, Any] = {}
    for key, value in settings.items():
        if key == "lyapunov_degree":
            given["lyapunov"] = _lyapunov(_checks.count(value, key), plant)
        elif key == "criteria":
            given[key] = [_criterion(entry, plant, k) for k, entry in enumerate(tables_of(value, key))]
        elif key == "regions":
            given[key] = [_region(entry, k) for k, entry in enumerate(tables_of(value, key))]
        elif key == "gain_degree":
            given["gain"] = Polynomial(plant.box.names, _checks.count(value, key))
        elif key in ("structure", "order", "filter"):
            given["structure"] = _structure(settings)
        elif key == "hull":
            given[key] = _hull(value, plant)
        elif key == "points":
            given[key] = _checks.count(value, key, at_least=2)
        elif key == "varying":
            given[key] = _checks.one_of(decode(str, value, key), VARYING, key)
        elif key in ("strictly_proper", "feedthrough"):
            given[key] = decode(bool, value, key)
        else:
            given[key] = to_si(value, None, key)
    return kind(**given)


def _lyapunov(degree: int, plant: GeneralizedPlant) -> Polynomial | None:
    """Polynomials in the variables whose rate is bounded; all of them in discrete time."""
    box, discrete = plant.box, plant.sample_time is not None
    names = tuple(n for n, r in zip(box.names, box.rate, strict=True) if discrete or r is not None)
    if degree and not names:
        raise InputError("a Lyapunov matrix that moves needs a scheduling variable with a rate bound",
                         got=", ".join(box.names) or "no scheduling variable",
                         mend="give scheduling.NAME.rate, or leave lyapunov_degree out")
    return Polynomial(names, degree) if degree else None


def _hull(rows: Any, plant: GeneralizedPlant) -> Hull:
    """The convex hull of points over the plant's scheduling variables, in their order."""
    names = plant.box.names
    if not isinstance(rows, list) or not rows or not all(isinstance(r, list) and len(r) == len(names) for r in rows):
        raise InputError("the hull is a list of points over the scheduling variables", got=rows,
                         why=f"the plant has {', '.join(names) or 'none'}",
                         mend="hull = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] for two variables")
    found = Hull.of(names, np.array([[to_si(v, None, f"hull[{k}]") for v in row] for k, row in enumerate(rows)]))
    found.vertices()  # refuses points without inside
    return found


def _structure(settings: Mapping[str, Any]) -> Any:
    """The structure with the settings that belong to it."""
    name = _checks.known_name(decode(str, settings.get("structure", ""), "structure"), list(STRUCTURES), "structure")
    kind, own = STRUCTURES[name]
    for key in ("order", "filter"):
        if key in settings and key not in own:
            raise InputError(f"the structure '{name}' has no '{key}'", got=settings[key], mend=f"leave {key} out")
    if name == "low-order" and "order" not in settings:
        raise InputError("the structure 'low-order' lacks its order", mend="order = 2")
    given = {key: _checks.count(settings[key], key, at_least=1) if key == "order" else to_si(settings[key], None, key)
             for key in own if key in settings}
    return kind(**given)


def _criterion(entry: Mapping[str, Any], plant: GeneralizedPlant, k: int) -> Criterion:
    where = f"criteria[{k}]"
    kind, entry = kind_of(entry, CRITERIA, where)
    known_keys(entry, ("disturbances", "performance", "bound", "weight"), where)
    names = {key: texts_of(entry.get(key, []), f"{where}.{key}") for key in ("disturbances", "performance")}
    numbers = {key: to_si(entry[key], None, f"{where}.{key}") for key in ("bound", "weight") if key in entry}
    criterion = kind(**names, **numbers)
    criterion.selection(plant)
    return criterion


def _region(entry: Mapping[str, Any], k: int) -> Region:
    where = f"regions[{k}]"
    (kind, settings), entry = kind_of(entry, REGIONS, where)
    known_keys(entry, settings, where)
    for key in settings:
        if key not in entry:
            raise InputError(f"{where} lacks '{key}'")
    return kind(**{key: to_si(entry[key], None, f"{where}.{key}") for key in settings})


TEMPLATE = """\
# Plant and design for `lpvid synthesize`. Numbers are SI; text with a unit ("5 mm") is converted.

# Signals, in the order of the columns of B and D and of the rows of C and D: "name [unit]".
inputs = ["road [m/s]", "force [N]"]
outputs = ["comfort [m/s^2]", "stroke [m]", "sensor [m]"]
controls = ["force"]           # what the controller drives; the other inputs are disturbances
measurements = ["sensor"]      # what it sees; the other outputs are performance signals, to be kept small
# sample_time = 0.002          # s; left out: continuous time
# model = "model.json"         # a saved state-space model in place of inputs, outputs and matrices

[scheduling.damping]           # one table for each scheduling variable; none for a fixed plant
range = [1.0, 3.0]
rate = 20.0                    # units per second; left out: it may jump
unit = "1/s"

# Matrices by powers of the scheduling: [matrices.1], [matrices.p], [matrices."p^2*q"]. Blocks left out are zero.
[matrices.1]                   # states: stroke [m], body speed [m/s]
A = [[0.0, 1.0], [-80.0, 0.0]]
B = [[-1.0, 0.0], [0.0, 1.0]]
C = [[-80.0, 0.0], [1.0, 0.0], [1.0, 0.0]]
D = [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]

[matrices.damping]
A = [[0.0, 0.0], [0.0, -1.0]]
C = [[0.0, -1.0], [0.0, 0.0], [0.0, 0.0]]

# Weights, by the signal they stand at: a gain, or kind = KINDS
# (frequencies in rad/s, or text: "9.5 Hz"). `of` makes a new performance signal of another one.
[weights.comfort]
kind = "lowpass"
gain = 0.2
corner = 60.0

[weights.stroke]
gain = 10.0

[weights.effort]
of = "force"
gain = 0.02

# The design may stand here or in a file of its own (--design DESIGN.toml, the same keys without [design]).
[design]
design = "output-feedback"     # NAMES
back_off = 0.02                # how far above the least gain to stop, for moderate controller gains
# lyapunov_degree = 1          # a Lyapunov matrix that moves with the scheduling; in continuous time it needs rates
# hull = [[1.0], [2.5]]        # points whose convex hull the scheduling stays in, in place of its box
# structure = "low-order"      # of the design "fixed-structure": STRUCTURES
# order = 2                    # of low-order; filter = 0.01 (s) adds a derivative to pid; gain_degree = 1
# strictly_proper = true       # no direct path from measurement to control
# [[design.regions]]           # where frozen poles must lie: half-plane, disc, cone
# kind = "half-plane"
# decay = 1.0                  # 1/s
# [[design.criteria]]          # of state-feedback, multi-objective, observer, filter: h-infinity, h2, generalized-h2
# kind = "h-infinity"
# performance = ["comfort"]
# bound = 2.0                  # left out: as low as possible
"""


def template() -> str:
    """A commented file that loads as it stands, as plant and as design.

    Returns
    -------
    str
        TOML text.
    """
    return TEMPLATE.replace("KINDS", ", ".join(WEIGHTS)).replace("NAMES", ", ".join(DESIGNS)).replace(
        "STRUCTURES", ", ".join(STRUCTURES))


def plant_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a PLANT file, as a plain dict.

    Returns
    -------
    dict
        With the schema of the design inside.

    Examples
    --------
    >>> plant_schema()["required"]
    ['controls', 'measurements']
    """
    number = {"type": ["number", "string"], "description": "SI, or text with a unit"}
    names = {"type": "array", "items": {"type": "string"}}
    matrix = {"type": "array", "items": {"type": "array", "items": number}}
    blocks = {"type": "object", "additionalProperties": False, "properties": dict.fromkeys("ABCD", matrix)}
    variable = {"type": "object", "additionalProperties": False, "properties": {
        "range": {"type": "array", "items": number, "minItems": 2, "maxItems": 2}, "rate": number,
        "unit": {"type": "string"}}}
    weight = {"type": "object", "additionalProperties": False, "properties": {
        "kind": {"enum": list(WEIGHTS)}, "of": {"type": "string"},
        **{key: number for _, keys in WEIGHTS.values() for key in keys}}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "plant of lpvid synthesize",
        "type": "object", "additionalProperties": False, "required": ["controls", "measurements"],
        "anyOf": [{"required": ["model"]}, {"required": ["inputs", "outputs", "matrices"]}],
        "properties": {
            "name": {"type": "string"}, "model": {"type": "string"}, "inputs": names, "outputs": names,
            "controls": names, "measurements": names, "sample_time": number,
            "scheduling": {"type": "object", "additionalProperties": variable},
            "matrices": {"type": "object", "additionalProperties": blocks},
            "weights": {"type": "object", "additionalProperties": weight}, "design": design_schema()}}


def design_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a DESIGN file, as a plain dict.

    Returns
    -------
    dict
        One alternative for each design of `DESIGNS`.

    Examples
    --------
    >>> len(design_schema()["oneOf"])
    8
    """
    number = {"type": ["number", "string"], "description": "SI, or text with a unit"}
    names = {"type": ["array", "string"], "items": {"type": "string"}}
    criterion = {"type": "object", "additionalProperties": False, "required": ["kind"], "properties": {
        "kind": {"enum": list(CRITERIA)}, "disturbances": names, "performance": names, "bound": number,
        "weight": number}}
    region = {"oneOf": [{"type": "object", "additionalProperties": False, "required": ["kind", *keys],
                         "properties": {"kind": {"const": name}, **dict.fromkeys(keys, number)}}
                        for name, (_, keys) in REGIONS.items()]}
    settings: dict[str, Any] = {
        "lyapunov_degree": {"type": "integer", "minimum": 0}, "points": {"type": "integer", "minimum": 2},
        "varying": {"enum": list(VARYING)}, "strictly_proper": {"type": "boolean"}, "feedthrough": {"type": "boolean"},
        "criteria": {"type": "array", "items": criterion}, "regions": {"type": "array", "items": region},
        "bound": number, "back_off": number, "structure": {"enum": list(STRUCTURES)}, "filter": number,
        "hull": {"type": "array", "items": {"type": "array", "items": number}},
        "order": {"type": "integer", "minimum": 1}, "gain_degree": {"type": "integer", "minimum": 0}}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "design of lpvid synthesize",
            "oneOf": [{"type": "object", "additionalProperties": False, "required": ["design"], "properties": {
                "design": {"const": name}, **{key: settings[key] for key in keys}}}
                for name, (_, keys) in DESIGNS.items()]}
