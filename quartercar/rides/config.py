"""CONFIG files of `quartercar ride`: a TOML text that states which car, damper, roads, sensors and laws."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from quartercar.controllers import LAWS, law_class, law_names
from quartercar.controllers.contract import Controller
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import SETS as SENSORS
from quartercar.dampers.contract import Damper
from quartercar.parameters import SETS as CARS
from quartercar.parameters import CarParameters
from quartercar.rides.preview import preview_from_table
from quartercar.rides.simulation import RideSettings
from quartercar.rig._tables import to_si
from quartercar.roads.ride_roads import Bump, IsoRoad, MeasuredRoad, RideRoad, SineSweep
from quartercar.vehicle.adjoint import has_gradient
from quartercar.vehicle.damper_from_file import car_damper, check_rate, check_stable, current_limits
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

STATIC_COIL = (0.005, 0.010)
"""rise and fall time of a coil whose damper model has no lag of its own [s]"""
HIGHEST = 2.5
"""of the command where the damper knows no range of its own [A]"""
LAW_NAMES = tuple(name for name, _, _ in LAWS if name not in ("scheduled", "identified-plant"))
"""the package's own laws that need no file"""
PREVIEW_LAWS = ("preview-lqr", "mpc")
"""those that make use of the road ahead; the second needs a damper with a gradient"""
DEFAULT_LAWS = tuple(name for name in LAW_NAMES if name not in ("lpv-hinf-identified", *PREVIEW_LAWS))
"""those that every damper admits"""
UNITS: Mapping[str, str] = {"speed": "m/s", "duration": "s", "height": "m", "length": "m", "amplitude": "m",
                            "lowest": "Hz", "highest": "Hz", "stiffness": "N/m", "compression": "m", "rebound": "m",
                            "rise_time": "s", "fall_time": "s"}
ROADS: Mapping[str, type] = {"iso": IsoRoad, "bump": Bump, "sweep": SineSweep}
KEYS = ("car", "damper", "known_damper", "measurements", "seeds", "first_seed", "tune", "tune_seed", "bound",
        "bound_seeds", "preview", "stops", "coil", "roads", "controllers")


@dataclass(frozen=True, eq=False)
class RideConfig:
    """What a ride compares.

    Attributes
    ----------
    car : QuarterCar
    roads : tuple of RideRoad
    controllers : mapping of str to Controller
        By name in tables.
    seeds : tuple of int
    settings : RideSettings
    tune : int
        Evaluations per law; 0 keeps the given values.
    tune_seed : int
        Of the tuning's roads, which are others than those of the comparison.
    bound : bool
        Also what the damper could have reached, the roads known.
    bound_seeds : int
        Of the comparison's, for which that is searched.
    """

    car: QuarterCar
    roads: tuple[RideRoad, ...] = (IsoRoad(), Bump())
    controllers: Mapping[str, Controller] = field(default_factory=lambda: given_laws(DEFAULT_LAWS))
    seeds: tuple[int, ...] = tuple(range(5))
    settings: RideSettings = field(default_factory=RideSettings)
    tune: int = 0
    tune_seed: int = 100_000
    bound: bool = False
    bound_seeds: int = 2

    def with_changes(self, **changes: Any) -> RideConfig:
        """A copy with what is not None replaced."""
        return replace(self, **{n: v for n, v in changes.items() if v is not None})


def ride_template() -> str:
    """A commented CONFIG with the defaults."""
    return TEMPLATE


def load_config(path: str | Path) -> RideConfig:
    """Read a CONFIG file; damper, controller and road files are found beside it.

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
        raise InputError(f"{path.name} is not TOML", why=str(error), mend="--template prints one") from None
    try:
        return read_config(table, path.parent)
    except InputError as error:
        raise InputError(f"{path.name}: {error.what}", got=error.got, why=error.why, mend=error.mend) from None


def read_config(table: Mapping[str, Any], folder: Path) -> RideConfig:
    """A configuration from a TOML table; files are relative to `folder`."""
    for key in table:
        _checks.known_name(key, KEYS, "key of the configuration")
    given: dict[str, Any] = {"car": build_car(table.get("car", "megane"), table.get("damper"), folder,
                                              table.get("stops", {}), table.get("coil", {}))}
    if "roads" in table:
        given["roads"] = tuple(_road(t, f"roads[{k}]", folder) for k, t in enumerate(_tables(table, "roads")))
    if "controllers" in table:
        given["controllers"] = named([_law(t, f"controllers[{k}]", folder)
                                      for k, t in enumerate(_tables(table, "controllers"))])
    first = _checks.count(table.get("first_seed", 0), "first_seed")
    if "seeds" in table or first:
        given["seeds"] = tuple(range(first, first + _checks.count(table.get("seeds", 5), "seeds", at_least=1)))
    if "measurements" in table or "known_damper" in table:
        known = read_damper(table["known_damper"], folder) if "known_damper" in table else None
        given["settings"] = replace(measuring(table.get("measurements", "stroke-body")), model=known)
    if "preview" in table:
        if not isinstance(table["preview"], Mapping):
            raise InputError("preview must be a table", got=repr(table["preview"])[:60], mend="[preview]")
        given["settings"] = replace(given.get("settings", RideSettings()),
                                    preview=preview_from_table(table["preview"], "preview"))
        if "controllers" not in table:
            given["controllers"] = given_laws(laws_with_preview(given["car"]))
    for key in ("tune", "tune_seed"):
        if key in table:
            given[key] = _checks.count(table[key], key)
    if "bound_seeds" in table:
        given["bound_seeds"] = _checks.count(table["bound_seeds"], "bound_seeds", at_least=1)
    if "bound" in table:
        if not isinstance(table["bound"], bool):
            raise InputError("bound is true or false", got=repr(table["bound"]))
        given["bound"] = table["bound"]
    return RideConfig(**given)


def build_car(car: Any = "megane", damper: str | None = None, folder: Path = Path(), stops: Mapping[str, Any] = {},
              coil: Mapping[str, Any] = {}) -> QuarterCar:
    """A nonlinear car from a set's name or a table, with a damper from a file or the embedded identified one.

    Without a table `coil` its limits are the range of the damper's current, or of what else schedules it.
    """
    model, parameters = read_damper(damper, folder), _parameters(car)
    check_rate(model, parameters, "the embedded damper" if damper is None else f"'{damper}'")
    lag = (0.0, 0.0) if _has_lag(model) else STATIC_COIL
    low, high = current_limits(model, HIGHEST)
    numbers = {"rise_time": lag[0], "fall_time": lag[1], "lowest": low, "highest": high,
               **_numbers(coil, Coil, "coil", model.current_unit)}
    if coil and damper is not None and np.isfinite(numbers["highest"]):
        check_stable(model, f"'{damper}'", (numbers["lowest"], numbers["highest"]))
    return QuarterCar(parameters, model, BumpStops(**_numbers(stops, BumpStops, "stops")), Coil(**numbers))


def measuring(name: Any) -> RideSettings:
    """Settings with a measurement set by name."""
    return RideSettings(ChainSettings(sensors=SENSORS[_checks.known_name(str(name), list(SENSORS), "measurement set")]))


def laws_with_preview(car: QuarterCar) -> tuple[str, ...]:
    """Default laws of a ride with preview, as far as the damper admits them."""
    return (*DEFAULT_LAWS, *(n for n in PREVIEW_LAWS if n != "mpc" or has_gradient(car.damper)))


def read_damper(name: str | None, folder: Path = Path()) -> Damper:
    """A damper from a file of `quartercar fit` or `lpvid identify`, or the embedded identified one for None."""
    if name is None:
        from quartercar.rides.default_damper import identified_damper

        return identified_damper()
    return car_damper(folder / str(name))


def given_laws(names: Sequence[str], folder: Path = Path()) -> dict[str, Controller]:
    """Laws by name, with their defaults, or from controller files."""
    return named([_law({"file": n} if Path(n).suffix == ".json" else {"law": n}, "--controller", folder)
                  for n in names])


def road_from_text(text: str) -> RideRoad:
    """A road from ``iso-c@20``, ``bump@8``, ``sweep``, ``FILE@10`` or ``FILE#TRACK@10``: kind or file, speed in m/s.

    TRACK is a height column by its name or its place from 1; a file with several of them needs one.

    Examples
    --------
    >>> road_from_text("iso-c@20").name
    'ISO C, 20 m/s'
    """
    kind, _, speed = text.rpartition("@") if "@" in text else (text, "", "")
    table: dict[str, Any] = {"speed": to_si(_number(speed), "m/s", f"--road {text}")} if speed else {}
    if kind.startswith("iso-"):
        table |= {"kind": "iso", "class": kind.removeprefix("iso-")}
    elif kind in ROADS:
        table |= {"kind": kind}
    else:
        path, mark, track = kind.rpartition("#")
        table |= {"kind": "file", "path": path if mark else kind}
        if mark:
            table["track"] = int(track) - 1 if track.isdecimal() else track
    return _road(table, f"--road {text}", Path())


# -- reading -----------------------------------------------------------------------------------------------------------
def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def _tables(table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    found = table[key]
    if not isinstance(found, list) or not found or not all(isinstance(t, Mapping) for t in found):
        raise InputError(f"{key} is a list of tables", got=repr(found)[:60], mend=f"[[{key}]]")
    return found


def _parameters(car: Any) -> CarParameters:
    if isinstance(car, str):
        return CARS[_checks.known_name(car, list(CARS), "car")]
    if not isinstance(car, Mapping):
        raise InputError("car is the name of a set or a table", got=repr(car), mend=f"one of {', '.join(CARS)}")
    known = [f.name for f in fields(CarParameters)]
    for key in car:
        _checks.known_name(key, [*known, "set"], "key of car")
    base = CARS[_checks.known_name(str(car.get("set", "megane")), list(CARS), "car")]
    units = {"sprung_mass": "kg", "unsprung_mass": "kg", "damping": "N*s/m", "tyre_damping": "N*s/m"}
    return base.replace(**{k: to_si(v, units.get(k, "N/m"), f"car.{k}") for k, v in car.items()
                           if k not in ("set", "source")})


def _numbers(table: Any, cls: type, where: str, current: str = "A") -> dict[str, float]:
    if not isinstance(table, Mapping):
        raise InputError(f"{where} must be a table", got=repr(table))
    known = [f.name for f in fields(cls)]
    for key in table:
        _checks.known_name(key, known, f"key of {where}")
    command = "" if current == "1" else current
    units = {**UNITS, "lowest": command, "highest": command} if cls is Coil else UNITS
    return {k: to_si(v, units[k], f"{where}.{k}") for k, v in table.items()}


def _road(table: Mapping[str, Any], where: str, folder: Path) -> RideRoad:
    kind = _checks.known_name(str(table.get("kind", "")), [*ROADS, "file"], f"kind of {where}")
    rest = {k: v for k, v in table.items() if k != "kind"}
    if kind == "file":
        for key in rest:
            _checks.known_name(key, ("path", "speed", "track", "laps"), f"key of {where}")
        if "path" not in rest:
            raise InputError(f"{where} needs a path", mend='path = "profiles.csv"')
        return MeasuredRoad.read(folder / str(rest["path"]), to_si(rest.get("speed", 10.0), "m/s", f"{where}.speed"),
                                 rest.get("track"), rest.get("laps"))
    if "class" in rest:
        rest["road_class"] = str(rest.pop("class"))
    known = [f.name for f in fields(ROADS[kind])]
    for key in rest:
        _checks.known_name(key, [*known, "class"], f"key of {where}")
    return ROADS[kind](**{k: v if k == "road_class" else to_si(v, UNITS[k], f"{where}.{k}") for k, v in rest.items()})


def _law(table: Mapping[str, Any], where: str, folder: Path) -> tuple[str, Controller]:
    rest = {k: v for k, v in table.items() if k not in ("law", "file", "name")}
    if "file" in table:
        from lpvid.export.serialise import load

        law = load(folder / str(table["file"]))
        if not isinstance(law, Controller):
            raise InputError(f"'{table['file']}' holds no controller of a car", got=type(law).__name__,
                             mend="a controller file that `quartercar design` wrote")
        label = str(table.get("name", Path(str(table["file"])).stem))
    else:
        known = [n for n in law_names() if n not in ("scheduled", "identified-plant")]
        name = _checks.known_name(str(table.get("law", "")), known, f"law of {where}")
        law, label = law_class(name)(), str(table.get("name", name))
    units = {p.name: p.unit for p in law.parameters}
    for key in rest:
        _checks.known_name(key, list(units), f"parameter of {law.name}")
    return label, law.with_values(**{k: to_si(v, units[k], f"{where}.{k}") for k, v in rest.items()}) if rest else law


def named(laws: Sequence[tuple[str, Controller]]) -> dict[str, Controller]:
    """Laws by their labels; InputError where two have the same."""
    names = [n for n, _ in laws]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise InputError(f"two controllers are called '{twice}'", mend="give one of them a name")
    return dict(laws)


def _has_lag(damper: Damper) -> bool:
    from quartercar.dampers.blackbox.sampled import SampledDamper

    inner = damper.held.model if isinstance(damper, SampledDamper) and damper.stored is not None else None
    return inner is not None and inner.scheduling_stage is not None


TEMPLATE = '''\
# quartercar ride CONFIG: a car, its damper, the roads and the laws. Numbers are SI, or text such as "5 mm".

car = "megane"                 # a set (megane, savaresi, sh-add, motorcycle), or a table [car] of set and changes
# damper = "model.json"        # written by `lpvid identify` or `quartercar fit`; left out: the embedded damper
# known_damper = "guo.json"    # the damper as inverse and observer know it; left out: as it is
measurements = "stroke-body"   # stroke-body, stroke-body-wheel or ideal
seeds = 5                      # roads and noise of the comparison: the same for every law
tune = 0                       # evaluations for each law before the comparison, on other seeds; 0: values as given
bound = false                  # true: also what this damper could have reached, the road known (--bound)
bound_seeds = 2                # for how many of the seeds

# [preview]                    # the car as a rear axle: what the front one met, wheelbase/speed earlier (--preview)
# wheelbase = "2.7 m"          # or time = "0.1 s"
# front = "estimated"          # from the front axle's sensors; or known: the profile itself
# sensors = "stroke-body-wheel"  # of the front axle; left out: as measurements

[stops]
stiffness = "200 N/mm"
compression = "60 mm"
rebound = "60 mm"

[coil]                         # rise_time and fall_time: left out, 5 and 10 ms, or none where the damper has its own
# lowest = 0.0                 # left out: the range of the damper's current (or of the voltage that schedules it)
# highest = 2.5

[[roads]]
kind = "iso"
class = "C"
speed = 20.0
duration = 20.0

[[roads]]
kind = "bump"
height = "50 mm"
length = 2.0
speed = 8.0

# [[roads]]
# kind = "file"                # a distance and one or more heights
# path = "profiles.csv"
# speed = "30 km/h"
# track = 0                    # which height column, by place or name; needed where there are several
# laps = 3                     # left out: for at least 5 s

[[controllers]]
law = "passive"
fixed_current = 0.0

[[controllers]]
law = "skyhook-linear"

[[controllers]]
law = "sh-add"
crossover = 12.0

# [[controllers]]
# file = "controller.json"     # written by `quartercar design`
'''
