"""PLAN files: a TOML text that states which damper, which sensors, which causes and which experiments."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.rig import _tables
from quartercar.rig.causes import CAUSES, CHANNELS, Effect, find_cause
from quartercar.rig.damper import RigDamper
from quartercar.rig.patterns import CURRENTS, EXPERIMENTS, MOTIONS, Experiment
from quartercar.rig.sensors import Sensors
from quartercar.rig.virtual import Rig

_KEYS = ("seed", "truth", "sample_rate", "oversampling", "damper", "sensors", "effects", "experiments")
_EXPERIMENT_KEYS = ("preset", "name", "displacement", "current", "duration", "replicates", "redraw")
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
        Add the channels that no sensor sees (names ending in ``_true``).
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
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read plan '{path}'", why=str(why)) from None
    return parse_plan(text, path.name)


def parse_plan(text: str, where: str = "plan") -> Plan:
    """Plan from TOML text; `where` names it in messages. Raises InputError as `load_plan`."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{where} is not TOML", why=str(error), mend="--template prints one") from None
    try:
        return _plan(table)
    except InputError as error:
        raise InputError(f"{where}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None


def run_plan(plan: Plan) -> list[Record]:
    """Run every replicate of every experiment of a plan, in order."""
    return list(iterate_plan(plan))


def iterate_plan(plan: Plan) -> Iterator[Record]:
    """Records of a plan one at a time, to be stored as they come."""
    for experiment in plan.experiments:
        for replicate in range(experiment.replicates):
            yield plan.rig.run(experiment, plan.seed, replicate, truth=plan.truth)


# -- reading ------------------------------------------------------------------------------------------------------
def _plan(table: Mapping[str, Any]) -> Plan:
    for key in table:
        _checks.known_name(key, _KEYS, "key of the plan")
    rig = Rig(
        damper=_tables.build(RigDamper, table.get("damper", {}), "damper"),
        sensors=_tables.build(Sensors, table.get("sensors", {}), "sensors"),
        effects=tuple(_effect(t, k) for k, t in enumerate(_list(table, "effects"))),
        sample_rate=_tables.to_si(table.get("sample_rate", 512.0), "Hz", "sample_rate"),
        oversampling=_checks.count(table.get("oversampling", 16), "oversampling", at_least=1),
    )
    truth = table.get("truth", False)
    if not isinstance(truth, bool):
        raise InputError("truth must be true or false", got=repr(truth))
    experiments = tuple(_experiment(t, k) for k, t in enumerate(_list(table, "experiments")))
    return Plan(rig, experiments, _checks.count(table.get("seed", 0), "seed"), truth)


def _list(table: Mapping[str, Any], key: str) -> list[Any]:
    entries = table.get(key, [])
    if not isinstance(entries, list):
        raise InputError(f"{key} must be a list of tables", got=repr(entries), mend=f"write [[{key}]]")
    return entries


def _effect(table: object, index: int) -> Effect:
    where = f"effects[{index}]"
    values = dict(_tables.expect_table(table, where))
    name = values.pop("name", None)
    if not isinstance(name, str):
        raise InputError(f"{where} needs a name", got=repr(name))
    units = {n.name: n.unit for n in find_cause(name).numbers}
    strength = _tables.to_si(values.pop("strength", 1.0), "", f"{where}.strength")
    parameters = {}
    for key, value in values.items():
        _checks.known_name(key, [*units, "strength"], f"key of {where} ('{name}'):")
        parameters[key] = value if key == "channel" else _tables.to_si(value, units[key], f"{where}.{key}")
    return Effect(name, strength, parameters)


def _experiment(table: object, index: int) -> Experiment:
    where = f"experiments[{index}]"
    values = _tables.expect_table(table, where)
    for key in values:
        _checks.known_name(key, _EXPERIMENT_KEYS, f"key of {where}")
    changes: dict[str, Any] = {}
    if "displacement" in values:
        changes["displacement"] = _pattern(values["displacement"], MOTIONS, f"{where}.displacement")
    if "current" in values:
        changes["current"] = _pattern(values["current"], CURRENTS, f"{where}.current")
    if "duration" in values:
        changes["duration"] = _tables.to_si(values["duration"], "s", f"{where}.duration")
    if "replicates" in values:
        changes["replicates"] = _checks.count(values["replicates"], f"{where}.replicates", at_least=1)
    if "redraw" in values:
        if not isinstance(values["redraw"], bool):
            raise InputError(f"{where}.redraw must be true or false", got=repr(values["redraw"]))
        changes["redraw"] = values["redraw"]
    name = values.get("name", values.get("preset", f"experiment-{index + 1}"))
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(f"{where}.name must be made of letters, digits, dots, dashes and underscores",
                         got=repr(name), why="it becomes the name of a file")
    preset = values.get("preset")
    if preset is not None:
        return replace(EXPERIMENTS[_checks.known_name(str(preset), list(EXPERIMENTS), "preset")], name=name, **changes)
    missing = [key for key in ("displacement", "current") if key not in changes]
    if missing:
        raise InputError(f"{where} lacks {' and '.join(missing)}", mend="name both, or a preset such as \"test-1\"")
    return Experiment(name, **changes)


def _pattern(table: object, classes: tuple[type, ...], where: str) -> Any:
    values = dict(_tables.expect_table(table, where))
    kinds = {c.kind: c for c in classes}  # type: ignore[attr-defined]
    kind = values.pop("kind", None)
    if not isinstance(kind, str):
        raise InputError(f"{where} needs a kind", got=repr(kind), mend=f"choose one of {', '.join(kinds)}")
    return _tables.build(kinds[_checks.known_name(kind, list(kinds), f"kind of {where}:")], values, where)


# -- describing ---------------------------------------------------------------------------------------------------
def plan_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a PLAN file, as a plain dict.

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
            "duration": _tables.quantity_schema("length of a record [s]"),
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
            "sample_rate": {**_tables.quantity_schema("rate of the records [Hz]"), "default": 512.0},
            "oversampling": {"type": "integer", "minimum": 1, "default": 16},
            "damper": _tables.schema(RigDamper), "sensors": _tables.schema(Sensors),
            "effects": {"type": "array", "items": {"oneOf": [_effect_schema(c.name) for c in CAUSES]}},
            "experiments": {"type": "array", "minItems": 1, "items": experiment},
        },
    }


def _pattern_schema(cls: type) -> dict[str, Any]:
    table = _tables.schema(cls, {"kind": {"const": cls.kind}})  # type: ignore[attr-defined]
    return {**table, "required": ["kind"], "description": (cls.__doc__ or "").splitlines()[0]}


def _effect_schema(name: str) -> dict[str, Any]:
    cause = find_cause(name)
    properties: dict[str, Any] = {"name": {"const": name}, "strength": {"type": "number", "minimum": 0, "default": 1.0}}
    for number in cause.numbers:
        if number.name == "channel":
            entry: dict[str, Any] = {"enum": list(CHANNELS), "description": number.description}
        else:
            entry = _tables.quantity_schema(f"{number.description} [{number.unit or '1'}]")
        properties[number.name] = {**entry, "default": number.default}
    return {"type": "object", "additionalProperties": False, "required": ["name"], "properties": properties,
            "description": cause.equation}


def plan_template() -> str:
    """A commented PLAN file that loads as it stands."""
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
    return [_setting(f.name, f.default, f.metadata.get("unit", ""), f.metadata.get("says", "")) for f in fields(cls)]


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
