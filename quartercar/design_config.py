"""CONFIG files of `quartercar design`: a TOML text that says which car, damper, law, measurements and weights."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lpvid import _checks
from lpvid.errors import InputError
from quartercar.car import QuarterCar
from quartercar.controllers.lpv_hinf import LpvHinf
from quartercar.controllers.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.suspension_design import CRITERIA
from quartercar.parameters import SETS as CARS
from quartercar.plant.weighted import MEASUREMENTS
from quartercar.ride_config import build_car
from quartercar.rig._tables import expect_table, quantity_schema, to_si

LAWS: Mapping[str, type[LpvHinf] | type[LpvHinfClipped]] = {c.name: c for c in (LpvHinf, LpvHinfClipped)}
KEYS = ("car", "damper", "stops", "coil", "law", "measured", "criterion", "lag", "tune", "weights")
WORDS: Mapping[str, tuple[str, ...]] = {"law": tuple(LAWS), "measured": tuple(MEASUREMENTS), "criterion": CRITERIA}


@dataclass(frozen=True, eq=False)
class DesignConfig:
    """What is to be designed.

    Attributes
    ----------
    car : QuarterCar
    law : LpvHinf or LpvHinfClipped
    tune : int
        Evaluations by which the weights are tuned first; 0 takes them as given.
    """

    car: QuarterCar
    law: LpvHinf | LpvHinfClipped
    tune: int = 0


def load_design(path: str | Path) -> DesignConfig:
    """Read a CONFIG file; a damper file is found beside it.

    Raises
    ------
    InputError
        A file that cannot be read, TOML that does not parse, an unknown key, a value of the wrong type, range or unit.
    """
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read '{path}'", why=str(why), mend="check the path") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path.name} is not TOML", why=str(error)) from None
    try:
        return read_design(table, path.parent)
    except InputError as error:
        raise InputError(f"{path.name}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None


def read_design(table: Mapping[str, Any], folder: Path = Path()) -> DesignConfig:
    """A configuration from a TOML table; the damper's file is relative to `folder`.

    Examples
    --------
    >>> read_design({"law": "lpv-hinf-clipped", "weights": {"stroke": "8 cm"}}).law.values["stroke"]
    0.08
    """
    for key in table:
        _checks.known_name(key, KEYS, "key of the configuration")
    car = build_car(table.get("car", "megane"), table.get("damper"), folder, table.get("stops", {}),
                    table.get("coil", {}))
    words = {k: _checks.one_of(str(table.get(k, known[0] if k != "measured" else "observed")), known, k)
             for k, known in WORDS.items()}
    law = LAWS[words["law"]](measured=words["measured"], criterion=words["criterion"],
                             lag=to_si(table.get("lag", 0.004), "s", "lag"))
    units = {p.name: p.unit for p in law.parameters}
    weights = expect_table(table.get("weights", {}), "weights")
    for key in weights:
        _checks.known_name(key, list(units), f"weight of {law.name}")
    law = law.with_values(**{k: to_si(v, units[k], f"weights.{k}") for k, v in weights.items()})
    return DesignConfig(car, law, _checks.count(table.get("tune", 0), "tune"))


def design_schema() -> dict[str, Any]:
    """JSON schema (2020-12) of a CONFIG file of `quartercar design`, as a plain dict.

    Examples
    --------
    >>> design_schema()["properties"]["law"]["enum"]
    ['lpv-hinf', 'lpv-hinf-clipped']
    """
    weights = {p.name: {**quantity_schema(f"{p.says} [{p.unit or '1'}]"), "default": p.default}
               for p in LpvHinf().parameters}
    words = {k: {"enum": list(known), "default": "observed" if k == "measured" else known[0]}
             for k, known in WORDS.items()}
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
    """A commented CONFIG that loads as it stands."""
    law = LpvHinf()
    lines = ["# quartercar design CONFIG: a car, its damper, a law and its weights. Numbers are SI, or text: \"5 mm\".",
             "", "car = \"megane\"              # a set, or a table [car] of set and changes",
             "# damper = \"model.json\"     # of lpvid identify, quartercar fit; left out: embedded",
             "law = \"lpv-hinf\"            # the damper's limits inside the design; lpv-hinf-clipped: outside",
             "measured = \"observed\"       # states of the observer, or " + ", ".join(
                 n for n in MEASUREMENTS if n != "observed") + ": sensors alone",
             "criterion = \"hinf\"          # least worst gain; h2: least rms on a random road",
             "lag = \"4 ms\"                # from demand to force: the coil",
             "tune = 0                    # evaluations by which the weights are tuned; 0: as given", "",
             "# relief and least_share: of lpv-hinf alone; leave them out for lpv-hinf-clipped",
             "[weights]                   # each says what counts as much as 1 m/s^2 of the body"]
    lines += [f"{p.name} = {law.values[p.name]!r:<20}# {f'{p.unit}, ' if p.unit else ''}{p.says}"
              for p in law.parameters]
    return "\n".join(lines) + "\n"
