"""PLAN files: a TOML text that states which damper, which sensors, which causes and which experiments."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from lpvid.codec import build, expect_table, values_of
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.tables import (
    kind_of,
    numbers_of,
    option,
    parse_toml,
    quantity,
    quantity_schema,
    read_toml,
    schema,
    to_si,
    within,
)
from lpvid.toolkit import checks
from quartercar.rig.causes import CAUSES, CHANNELS, RigEffect, find_cause
from quartercar.rig.damper import RigDamper
from quartercar.rig.patterns import CURRENTS, EXPERIMENTS, MOTIONS, Experiment
from quartercar.rig.sensors import Sensors
from quartercar.rig.virtual import Rig

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_MOST_SAMPLES = 200_000_000


@dataclass(frozen=True)
class Plan:
    """A rig and what to run on it.

    Attributes
    ----------
    rig : Rig
    experiments : tuple of Experiment
    seed : int
        Seed of everything random.
    truth : bool
        Add the channels that no sensor measures (names ending in ``_true``).
    """

    rig: Rig
    experiments: tuple[Experiment, ...]
    seed: int = 0
    truth: bool = False

    def __post_init__(self) -> None:
        names = [e.name for e in self.experiments]
        if not names:
            raise InputError("a plan needs at least one experiment", mend='add [[experiments]] with preset = "test-1"')
        twice = next((n for n in names if names.count(n) > 1), None)
        if twice is not None:
            raise InputError(f"two experiments of the plan are called '{twice}'", mend="give one of them a name")
        samples = sum(e.duration * e.replicates * self.rig.sample_rate for e in self.experiments)
        if samples > _MOST_SAMPLES:
            raise InputError("the plan asks for too much data", got=f"{samples:.3g} samples",
                             why=f"{_MOST_SAMPLES:.0e} is the limit", mend="shorten the experiments or split the plan")


def load_plan(path: str | Path) -> Plan:
    """Read a PLAN file.

    Parameters
    ----------
    path : str or Path
        TOML file; `plan_template` gives a commented one.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        A file that cannot be read, TOML that does not parse, an unknown key (with its nearest match), a value of the
        wrong type, range or unit.
    """
    path = Path(path)
    return within(path.name, lambda: _plan(read_toml(path)))


def parse_plan(text: str, where: str = "plan") -> Plan:
    """Plan from TOML text; `where` names it in messages. Raises InputError as `load_plan`.

    Parameters
    ----------
    text : str
        TOML.
    where : str
        Name of the text in messages.

    Returns
    -------
    Plan
        Rig and experiments as the text states them, defaults for the rest.
    """
    table = parse_toml(text, where)
    return within(where, lambda: _plan(table))


def run_plan(plan: Plan) -> list[Record]:
    """Run every replicate of every experiment of a plan, in order.

    Parameters
    ----------
    plan : Plan
        Rig, experiments and seed.

    Returns
    -------
    list of Record
        Named ``name-r0``, ``name-r1``, … after the experiments.
    """
    return list(iterate_plan(plan))


def iterate_plan(plan: Plan) -> Iterator[Record]:
    """Records of a plan one at a time, to be stored as they come.

    Parameters
    ----------
    plan : Plan
        Rig, experiments and seed.

    Yields
    ------
    Record
        One replicate; experiments in the order of the plan, replicates from 0.
    """
    for experiment in plan.experiments:
        for replicate in range(experiment.replicates):
            yield plan.rig.run(experiment, plan.seed, replicate, truth=plan.truth)


# -- reading ------------------------------------------------------------------------------------------------------
def _plan(table: Mapping[str, Any]) -> Plan:
    found = build(_PlanTable, table, noun="the plan", partial=True)
    rig = Rig(damper=found.damper, sensors=found.sensors, effects=found.effects, sample_rate=found.sample_rate,
              oversampling=found.oversampling)
    return Plan(rig, found.experiments, found.seed, found.truth)


def _each(read: Callable[[object, str, int], Any]) -> dict[str, Any]:
    """Metadata of a field that is a list of tables, each of which `read` reads with its place and number."""
    def listed(value: object, where: str) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise InputError(f"{where} must be a list of tables", got=repr(value), mend=f"write [[{where}]]")
        return tuple(read(entry, f"{where}[{k}]", k) for k, entry in enumerate(value))

    return {"read": listed}


def _effect(table: object, where: str, index: int) -> RigEffect:
    values = dict(expect_table(table, where))
    name = values.pop("name", None)
    if not isinstance(name, str):
        raise InputError(f"{where} needs a name", got=repr(name))
    cause = find_cause(name)
    strength = to_si(values.pop("strength", 1.0), "", f"{where}.strength")
    units = {n.name: n.unit for n in cause.numbers}
    words = {"channel": values.pop("channel")} if "channel" in values and "channel" in units else {}
    numbers = numbers_of(values, {**units, "strength": ""}, where, f"key of {where} ('{cause.name}'):")
    return RigEffect(cause.name, strength, {**words, **numbers})


def _pattern(classes: tuple[type, ...]) -> dict[str, Any]:
    """Metadata of a field that is a table of one of some kinds."""
    def read(value: object, where: str) -> Any:
        cls, values = kind_of(value, {c.kind: c for c in classes}, where)  # type: ignore[attr-defined]
        return build(cls, values, where, partial=True)

    return {"read": read}


@dataclass(frozen=True)
class _ExperimentTable:
    """An entry of [[experiments]] in a PLAN file; what it leaves out is as in its preset."""

    preset: str | None = None
    name: str | None = None
    displacement: Any = field(default=None, metadata=_pattern(MOTIONS))
    current: Any = field(default=None, metadata=_pattern(CURRENTS))
    duration: float | None = quantity(None, "s", "length of a record")
    replicates: int = option(1, "of the experiment", at_least=1)
    redraw: bool = False


def _experiment(table: object, where: str, index: int) -> Experiment:
    changes = values_of(_ExperimentTable, expect_table(table, where), where, partial=True)
    preset = changes.pop("preset", None)
    name = changes.pop("name", preset or f"experiment-{index + 1}")
    if not _NAME.fullmatch(name):
        raise InputError(f"{where}.name must be made of letters, digits, dots, dashes and underscores",
                         got=repr(name), why="it becomes the name of a file")
    if preset is not None:
        return replace(EXPERIMENTS[checks.known_name(preset, list(EXPERIMENTS), "preset")], name=name, **changes)
    missing = [key for key in ("displacement", "current") if key not in changes]
    if missing:
        raise InputError(f"{where} lacks {' and '.join(missing)}", mend="name both, or a preset such as \"test-1\"")
    return Experiment(name, **changes)


@dataclass(frozen=True)
class _PlanTable:
    """Keys of a PLAN file."""

    seed: int = option(0, "of everything random")
    truth: bool = False
    sample_rate: float = quantity(512.0, "Hz", "rate of the records")
    oversampling: int = option(16, "integration steps per sample", at_least=1)
    damper: RigDamper = field(default_factory=RigDamper)
    sensors: Sensors = field(default_factory=Sensors)
    effects: tuple[RigEffect, ...] = field(default=(), metadata=_each(_effect))
    experiments: tuple[Experiment, ...] = field(default=(), metadata=_each(_experiment))


# -- describing ---------------------------------------------------------------------------------------------------
def plan_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a PLAN file, as a plain dict.

    Returns
    -------
    dict
        Keys, types and ranges of every table; other keys are not allowed.

    Examples
    --------
    >>> sorted(plan_schema()["properties"])[:3]
    ['damper', 'effects', 'experiments']
    """
    experiment = {
        "type": "object", "additionalProperties": False,
        "anyOf": [{"required": ["preset"]}, {"required": ["displacement", "current"]}],
        "properties": {
            "preset": {"enum": list(EXPERIMENTS), "description": "experiment whose settings the other keys change"},
            "name": {"type": "string", "pattern": f"^{_NAME.pattern}$", "description": "name of the records"},
            "displacement": {"oneOf": [_pattern_schema(c) for c in MOTIONS]},
            "current": {"oneOf": [_pattern_schema(c) for c in CURRENTS]},
            "duration": quantity_schema("length of a record [s]"),
            "replicates": {"type": "integer", "minimum": 1},
            "redraw": {"type": "boolean", "description": "a new drawing for every replicate"},
        },
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema", "title": "plan of the virtual rig",
        "type": "object", "additionalProperties": False, "required": ["experiments"],
        "properties": {
            "seed": {"type": "integer", "minimum": 0, "default": 0},
            "truth": {"type": "boolean", "default": False, "description": "add channels that no sensor sees"},
            "sample_rate": {**quantity_schema("rate of the records [Hz]"), "default": 512.0},
            "oversampling": {"type": "integer", "minimum": 1, "default": 16},
            "damper": schema(RigDamper), "sensors": schema(Sensors),
            "effects": {"type": "array", "items": {"oneOf": [_effect_schema(c.name) for c in CAUSES]}},
            "experiments": {"type": "array", "minItems": 1, "items": experiment},
        },
    }


def _pattern_schema(cls: type) -> dict[str, Any]:
    table = schema(cls, {"kind": {"const": cls.kind}})  # type: ignore[attr-defined]
    return {**table, "required": ["kind"], "description": (cls.__doc__ or "").splitlines()[0]}


def _effect_schema(name: str) -> dict[str, Any]:
    cause = find_cause(name)
    properties: dict[str, Any] = {"name": {"const": name}, "strength": {"type": "number", "minimum": 0, "default": 1.0}}
    for number in cause.numbers:
        if number.name == "channel":
            entry: dict[str, Any] = {"enum": list(CHANNELS), "description": number.description}
        else:
            entry = quantity_schema(f"{number.description} [{number.unit or '1'}]")
        properties[number.name] = {**entry, "default": number.default}
    return {"type": "object", "additionalProperties": False, "required": ["name"], "properties": properties,
            "description": cause.equation}


def plan_template() -> str:
    """A commented PLAN file that loads as it stands.

    Returns
    -------
    str
        TOML with every key of rig and sensors at its default, and every cause as a comment.
    """
    lines = ["# Plan of the virtual rig. Values are SI numbers or text with a unit: 0.005 or \"5 mm\".", "",
             "seed = 0              # of everything random", "truth = false         # true adds what no sensor sees",
             "sample_rate = 512.0   # Hz, of the records", "oversampling = 16     # integration steps per sample", ""]
    lines += ["[damper]              # all defaults: leave out what you do not change", *_settings(RigDamper), ""]
    lines += ["[sensors]", *_settings(Sensors), ""]
    lines += ["# Causes to switch on, by name; strength 0 is off, 1 the size that the parameters give."]
    for cause in CAUSES:
        lines += ["#", f"# [[effects]]         # {cause.equation}", f"# name = \"{cause.name}\""]
        lines += [f"# {_setting(n.name, n.default, n.unit, n.description)}" for n in cause.numbers]
    lines += ["", "# The eight experiments are presets " + ", ".join(EXPERIMENTS) + "; other keys change them.",
              "[[experiments]]", "preset = \"test-1\"", "replicates = 1", "duration = \"30 s\"", "",
              "[[experiments]]", "name = \"sine\"", "displacement = { kind = \"sine\", amplitude = \"10 mm\", "
              "frequency = \"3 Hz\" }", "current = { kind = \"constant\", levels = [0.0, 1.2, 2.5] }",
              "duration = \"4 s\"", "replicates = 3        # one for each level", ""]
    lines += ["# Kinds of displacement and of current, with their defaults:"]
    for cls in (*MOTIONS, *CURRENTS):
        shown = ", ".join(_setting(f.name, f.default).strip() for f in fields(cls))
        lines += [f"#   {{ kind = \"{cls.kind}\", {shown} }}"]  # type: ignore[attr-defined]
    return "\n".join(lines) + "\n"


def _settings(cls: type) -> list[str]:
    return [_setting(f.name, f.default, f.metadata.get("unit", ""), f.metadata.get("description", ""))
            for f in fields(cls)]


def _setting(name: str, value: object, unit: str = "", description: str = "") -> str:
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = f"\"{value}\""
    elif isinstance(value, tuple):
        text = "[" + ", ".join(map(repr, value)) + "]"
    else:
        text = repr(value)
    comment = ", ".join(part for part in (unit, description) if part)
    return f"{name} = {text}" + (f"  # {comment}" if comment else "")
