"""CONFIG files of `quartercar design`: a TOML text that states which car, damper, law, measurements and weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lpvid.codec import build
from lpvid.errors import InputError
from lpvid.tables import numbers_of, option, quantity, quantity_schema, read_toml, within
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
from quartercar.controllers.designed.suspension_design import CRITERIA
from quartercar.dampers.parameter import Parameter
from quartercar.lpv_models.frozen_damper import FrozenDamper
from quartercar.lpv_models.weighted import MEASUREMENTS
from quartercar.parameters import SETS as CARS
from quartercar.rides.config import build_car, options_of
from quartercar.vehicle.nonlinear import QuarterCar

LAWS: Mapping[str, type[LpvHinf] | type[LpvHinfClipped]] = {c.name: c for c in (LpvHinf, LpvHinfClipped)}
PLANTS = ("identified", "nominal")
"""the damper's own dynamics, or c_nom alone"""
OF_NOMINAL = ("law", "measured", "criterion")
"""keys that only the nominal plant has"""
WORDS: Mapping[str, tuple[str, ...]] = {"law": tuple(LAWS), "measured": tuple(MEASUREMENTS), "criterion": CRITERIA}


@dataclass(frozen=True, eq=False)
class DesignConfig:
    """What is to be designed.

    Attributes
    ----------
    car : QuarterCar
    law : LpvHinf, LpvHinfClipped or LpvHinfIdentified
        The last on the identified plant.
    tune : int
        Evaluations by which the weights are tuned first; 0 takes them as given.
    """

    car: QuarterCar
    law: LpvHinf | LpvHinfClipped | LpvHinfIdentified
    tune: int = 0


def load_design(path: str | Path, plant: str | None = None, car: str | None = None,
                damper: Path | None = None) -> DesignConfig:
    """Read a CONFIG file; a damper file is found beside it. What is given here counts before what the file states.

    Parameters
    ----------
    path : str or Path
        A TOML file.
    plant : {"identified", "nominal"}, optional
        In place of the file's key of that name.
    car : str, optional
        Name of a set.
    damper : Path, optional
        File, found from the working folder.

    Returns
    -------
    DesignConfig
        With the damper of the file, or the embedded one.

    Raises
    ------
    InputError
        A file that cannot be read, TOML that does not parse, an unknown key, a value of the wrong type, range or unit.
    """
    path = Path(path)
    given = options_of(car, damper) | ({} if plant is None else {"plant": plant})
    return within(path.name, lambda: read_design({**read_toml(path), **given}, path.parent))


@dataclass(frozen=True)
class _DesignTable:
    """Keys of a CONFIG file."""

    car: Any = "megane"
    damper: str | None = None
    stops: Mapping = field(default_factory=dict)
    coil: Mapping = field(default_factory=dict)
    plant: str = option("identified", "the damper's own dynamics, or c_nom alone", PLANTS)
    law: str = option(next(iter(LAWS)), "on the nominal plant", tuple(LAWS))
    measured: str = option("observed", "by the law", tuple(MEASUREMENTS))
    criterion: str = option(CRITERIA[0], "that is made small", CRITERIA)
    lag: float = quantity(0.004, "s", "from demand to force")
    tune: int = option(0, "evaluations by which the weights are tuned")
    weights: Mapping = field(default_factory=dict)


def read_design(table: Mapping[str, Any], folder: Path = Path()) -> DesignConfig:
    """A configuration from a TOML table; the damper's file is relative to `folder`.

    Without the key `plant` it is the identified one where the damper has an identified transfer function from velocity
    and current, and nothing in the table belongs to the nominal plant alone.

    Parameters
    ----------
    table : mapping
        Keys of a CONFIG file; numbers in SI, or text with a unit. An empty one takes all defaults.
    folder : Path
        Where the damper's file lies; the working folder by default.

    Returns
    -------
    DesignConfig
        Checked: every key, type, range and unit.

    Raises
    ------
    InputError
        An unknown key, a value of the wrong type, range or unit, or a key of the nominal plant beside the identified
        one.

    Examples
    --------
    >>> read_design({"law": "lpv-hinf-clipped", "weights": {"stroke": "8 cm"}}).law.values["stroke"]
    0.08
    >>> read_design({}).law.name, read_design({"plant": "nominal"}).law.name
    ('lpv-hinf-identified', 'lpv-hinf')
    """
    found = build(_DesignTable, table, noun="the configuration", partial=True)
    car = build_car(found.car, found.damper, folder, found.stops, found.coil)
    if (found.plant if "plant" in table else _plant(table, car, found.weights)) == "identified":
        law: Any = _on_identified(table, found)
    else:
        law = LAWS[found.law](measured=found.measured, criterion=found.criterion, lag=found.lag)
    weights = numbers_of(found.weights, {p.name: p.unit for p in law.parameters}, "weights", f"weight of {law.name}")
    return DesignConfig(car, law.with_values(**weights), found.tune)


def _plant(table: Mapping[str, Any], car: QuarterCar, weights: Mapping[str, Any]) -> str:
    """The plant that a table's damper and its other keys allow."""
    own = {p.name for p in LpvHinf().parameters} - {p.name for p in LpvHinfIdentified().parameters}
    if car.damper is None or any(key in table for key in OF_NOMINAL) or own & set(weights):
        return "nominal"
    try:
        FrozenDamper.of(car.damper, car.coil.lowest)
    except InputError:
        return "nominal"
    return "identified"


def _on_identified(table: Mapping[str, Any], found: _DesignTable) -> LpvHinfIdentified:
    for key in OF_NOMINAL:
        if key in table:
            raise InputError(f"the key '{key}' belongs to the nominal plant", got=repr(table[key]),
                             why="on the identified plant the law is a state feedback of what the observer estimates",
                             mend='leave it out, or plant = "nominal"')
    return LpvHinfIdentified(lag=found.lag)


def design_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a CONFIG file of `quartercar design`, as a plain dict.

    Returns
    -------
    dict
        Can be written as JSON.

    Examples
    --------
    >>> design_schema()["properties"]["law"]["enum"]
    ['lpv-hinf', 'lpv-hinf-clipped']
    """
    weights = {p.name: {**quantity_schema(f"{p.description} [{p.unit or '1'}]"), "default": p.default}
               for p in LpvHinf().parameters}
    words: dict[str, Any] = {k: {"enum": list(known), "default": "observed" if k == "measured" else known[0]}
                             for k, known in WORDS.items()}
    words["plant"] = {"enum": list(PLANTS), "description": "identified where left out, the damper has an identified "
                                                           "transfer function and no key is of the nominal plant"}
    numbers = {"type": "object", "additionalProperties": {"type": ["number", "string"]}}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "suspension controller design",
            "type": "object", "additionalProperties": False,
            "properties": {"car": {"oneOf": [{"enum": list(CARS)}, {"type": "object"}], "default": "megane"},
                           "damper": {"type": "string", "description": "a file of lpvid identify or quartercar fit"},
                           "stops": numbers, "coil": numbers, **words,
                           "lag": {**quantity_schema("from demand to force [s]"), "default": 0.004},
                           "tune": {"type": "integer", "minimum": 0, "default": 0},
                           "weights": {"type": "object", "additionalProperties": False, "properties": weights}}}


def design_template() -> str:
    """A commented CONFIG that loads as it stands.

    Returns
    -------
    str
        TOML, with every key and its default.
    """
    law, nominal = LpvHinfIdentified(), LpvHinf()
    others = ", ".join(n for n in MEASUREMENTS if n != "observed")
    lines = ["# quartercar design CONFIG: a car, its damper, a plant and weights. Numbers are SI, or text: \"5 mm\".",
             "", "car = \"megane\"              # a set, or a table [car] of set and changes",
             "# damper = \"model.json\"     # of lpvid identify, quartercar fit; left out: embedded",
             "plant = \"identified\"        # the damper's own dynamics in the plant; nominal: c_nom alone",
             "lag = \"4 ms\"                # from demand to force: the coil",
             "tune = 0                    # evaluations by which the weights are tuned; 0: as given", "",
             "[weights]                   # each states what counts as much as 1 m/s^2 of the body"]
    lines += [_weight(p, law.values[p.name]) for p in law.parameters]
    lines += ["", "# With plant = \"nominal\", before [weights]:",
              "# law = \"lpv-hinf\"          # the damper's limits inside the design; lpv-hinf-clipped: outside",
              f"# measured = \"observed\"     # states of the observer, or {others}: sensors alone",
              "# criterion = \"hinf\"        # least worst gain; h2: least rms on a random road",
              "# and among the weights (relief and least_share of lpv-hinf alone), with these defaults:"]
    lines += [f"# {_weight(p, nominal.values[p.name])}" for p in nominal.parameters]
    return "\n".join(lines) + "\n"


def _weight(parameter: Parameter, value: float) -> str:
    unit = f"{parameter.unit}, " if parameter.unit else ""
    return f"{parameter.name} = {value!r:<20}# {unit}{parameter.description}"
