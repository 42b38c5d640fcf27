"""CONFIG files of `quartercar ride`: a TOML text that states which car, damper, roads, sensors and laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.codec import build, values_of
from lpvid.errors import InputError
from lpvid.tables import kind_of, numbers_of, option, read_toml, to_si, within
from lpvid.toolkit import checks
from quartercar.controllers import LAWS, law_class, law_names
from quartercar.controllers.contract import Controller
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import SETS as SENSORS
from quartercar.dampers.contract import Damper
from quartercar.parameters import SETS as CARS
from quartercar.parameters import CarParameters
from quartercar.rides.preview import number_or_text, preview_from_table
from quartercar.rides.simulation import RideSettings
from quartercar.roads.ride_roads import Bump, IsoRoad, MeasuredRoad, RideRoad, SineSweep
from quartercar.vehicle.adjoint import has_gradient
from quartercar.vehicle.damper_from_file import car_damper, check_rate, check_stable, current_limits
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

STATIC_COIL = (0.005, 0.010)
"""rise and fall time of a coil whose damper model has no lag of its own [s]"""
HIGHEST = 2.5
"""of the command where the damper has no range of its own [A]"""
LAW_NAMES = tuple(name for name, _, _ in LAWS if name not in ("scheduled", "identified-plant"))
"""the package's own laws that need no file"""
PREVIEW_LAWS = ("preview-lqr", "preview-lpv", "mpc")
"""those that make use of the road ahead; the last needs a damper with a gradient"""
DEFAULT_LAWS = tuple(name for name in LAW_NAMES if name not in ("lpv-hinf-identified", *PREVIEW_LAWS))
"""those that every damper admits"""
ROADS: Mapping[str, type] = {"iso": IsoRoad, "bump": Bump, "sweep": SineSweep}


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
        """A copy with what is not None replaced.

        Parameters
        ----------
        **changes
            Attributes by name.

        Returns
        -------
        RideConfig
        """
        return replace(self, **{n: v for n, v in changes.items() if v is not None})


def ride_template() -> str:
    """A commented CONFIG with the defaults.

    Returns
    -------
    str
        TOML.
    """
    return TEMPLATE


def load_config(path: str | Path, car: str | None = None, damper: Path | None = None) -> RideConfig:
    """Read a CONFIG file; damper, controller and road files are found beside it.

    Parameters
    ----------
    path : str or Path
    car : str, optional
        Name of a set in place of what the file states.
    damper : Path, optional
        File in place of the one that the file names, found from the working folder.

    Returns
    -------
    RideConfig

    Raises
    ------
    InputError
        A file that cannot be read, TOML that does not parse, an unknown key, a value of the wrong type, range or unit.
    """
    path = Path(path)
    given = options_of(car, damper)
    return within(path.name, lambda: _read_config({**read_toml(path), **given}, path.parent))


def options_of(car: str | None, damper: Path | None) -> dict[str, str]:
    """Options of a command as keys of a CONFIG; the damper's path leads to it from any folder.

    Parameters
    ----------
    car : str or None
    damper : Path or None

    Returns
    -------
    dict of str to str
        Those that are given.
    """
    return {k: v for k, v in (("car", car), ("damper", None if damper is None else str(damper.absolute()))) if v}


@dataclass(frozen=True)
class _RideTable:
    """Keys of a CONFIG file; those that it leaves out are as in `RideConfig`."""

    car: Any = "megane"
    damper: str | None = None
    known_damper: str | None = None
    measurements: str = "stroke-body"
    seeds: int = option(5, "roads and noises", at_least=1)
    first_seed: int = option(0, "of them")
    tune: int = option(0, "evaluations per law")
    tune_seed: int = option(0, "of the tuning's roads")
    bound: bool = False
    bound_seeds: int = option(2, "of the comparison's", at_least=1)
    preview: Mapping | None = None
    stops: Mapping = field(default_factory=dict)
    coil: Mapping = field(default_factory=dict)
    roads: tuple[Mapping, ...] = ()
    controllers: tuple[Mapping, ...] = ()


def _read_config(table: Mapping[str, Any], folder: Path) -> RideConfig:
    """A configuration from a TOML table; files are relative to `folder`."""
    found = build(_RideTable, table, noun="the configuration", partial=True)
    given: dict[str, Any] = {k: getattr(found, k) for k in ("tune", "tune_seed", "bound", "bound_seeds") if k in table}
    given["car"] = build_car(found.car, found.damper, folder, found.stops, found.coil)
    if "roads" in table:
        given["roads"] = tuple(_road(t, f"roads[{k}]", folder) for k, t in enumerate(_some(found.roads, "roads")))
    if "controllers" in table:
        given["controllers"] = _named([_law(t, f"controllers[{k}]", folder)
                                       for k, t in enumerate(_some(found.controllers, "controllers"))])
    if "seeds" in table or found.first_seed:
        given["seeds"] = tuple(range(found.first_seed, found.first_seed + found.seeds))
    if "measurements" in table or "known_damper" in table:
        known = _read_damper(found.known_damper, folder) if "known_damper" in table else None
        given["settings"] = replace(measuring(found.measurements), model=known)
    if found.preview is not None:
        given["settings"] = replace(given.get("settings", RideSettings()),
                                    preview=preview_from_table(found.preview, "preview"))
        if "controllers" not in table:
            given["controllers"] = given_laws(laws_with_preview(given["car"]))
    return RideConfig(**given)


def build_car(car: Any = "megane", damper: str | None = None, folder: Path = Path(), stops: Mapping[str, Any] = {},
              coil: Mapping[str, Any] = {}) -> QuarterCar:
    """A nonlinear car from a set's name or a table, with a damper from a file or the embedded identified one.

    Without a table `coil` its limits are the range of the damper's current, or of what else schedules it.

    Parameters
    ----------
    car : str or mapping
        Name of a set of `quartercar.parameters.SETS`, or a table of parameters, with the set that it changes as
        ``set``.
    damper : str, optional
        File; the embedded damper by default.
    folder : Path
        To which the file's path is relative.
    stops : mapping
        Fields of `BumpStops`, numbers in SI or text with a unit.
    coil : mapping
        ``rise_time``, ``fall_time`` [s]; ``lowest``, ``highest`` in the unit of the damper's current.

    Returns
    -------
    QuarterCar
    """
    model, parameters = _read_damper(damper, folder), _parameters(car)
    check_rate(model, parameters, "the embedded damper" if damper is None else f"'{damper}'")
    lag = (0.0, 0.0) if _has_lag(model) else STATIC_COIL
    low, high = current_limits(model, HIGHEST)
    command = "" if model.current_unit == "1" else model.current_unit
    units = {"rise_time": "s", "fall_time": "s", "lowest": command, "highest": command}
    numbers = {"rise_time": lag[0], "fall_time": lag[1], "lowest": low, "highest": high,
               **numbers_of(coil, units, "coil")}
    if coil and damper is not None and np.isfinite(numbers["highest"]):
        check_stable(model, f"'{damper}'", (numbers["lowest"], numbers["highest"]))
    return QuarterCar(parameters, model, build(BumpStops, stops, "stops", partial=True), Coil(**numbers))


def measuring(name: Any) -> RideSettings:
    """Settings with a measurement set by name.

    Parameters
    ----------
    name : str
        Of `quartercar.controllers.loop.sensing.SETS`.

    Returns
    -------
    RideSettings
    """
    return RideSettings(ChainSettings(sensors=SENSORS[checks.known_name(str(name), list(SENSORS), "measurement set")]))


def laws_with_preview(car: QuarterCar) -> tuple[str, ...]:
    """Default laws of a ride with preview, as far as the damper admits them.

    Parameters
    ----------
    car : QuarterCar
        Whose damper needs a gradient for ``mpc``.

    Returns
    -------
    tuple of str
    """
    return (*DEFAULT_LAWS, *(n for n in PREVIEW_LAWS if n != "mpc" or has_gradient(car.damper)))


def _read_damper(name: str | None, folder: Path = Path()) -> Damper:
    """A damper from a file of `quartercar fit` or `lpvid identify`, or the embedded identified one for None."""
    if name is None:
        from quartercar.rides.default_damper import identified_damper

        return identified_damper()
    return car_damper(folder / str(name))


def given_laws(names: Sequence[str], folder: Path = Path()) -> dict[str, Controller]:
    """Laws by name, with their defaults, or from controller files.

    Parameters
    ----------
    names : sequence of str
        Of laws, or of files that end in ``.json``.
    folder : Path
        To which files are relative.

    Returns
    -------
    dict of str to Controller
        A file's law by the name of the file without its ending.
    """
    return _named([_law({"file": n} if Path(n).suffix == ".json" else {"law": n}, "--controller", folder)
                   for n in names])


def road_from_text(text: str) -> RideRoad:
    """A road from ``iso-c@20``, ``bump@8``, ``sweep``, ``FILE@10`` or ``FILE#TRACK@10``: kind or file, speed in m/s.

    TRACK is a height column by its name or its place from 1; a file with several of them needs one.

    Parameters
    ----------
    text : str

    Returns
    -------
    RideRoad
        At its default speed where the text has none; a file's at 10 m/s.

    Examples
    --------
    >>> road_from_text("iso-c@20").name
    'ISO C, 20 m/s'
    """
    kind, _, speed = text.rpartition("@") if "@" in text else (text, "", "")
    table: dict[str, Any] = {"speed": to_si(number_or_text(speed), "m/s", f"--road {text}")} if speed else {}
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


def roads_from_texts(texts: Sequence[str]) -> tuple[RideRoad, ...]:
    """Roads from texts of `road_from_text`, each of one road or of several with commas between them.

    A comma in the name of an existing file separates nothing.

    Parameters
    ----------
    texts : sequence of str

    Returns
    -------
    tuple of RideRoad

    Examples
    --------
    >>> [road.name for road in roads_from_texts(["iso-c@20,bump@8", "sweep"])]
    ['ISO C, 20 m/s', 'bump 50 mm x 2 m, 8 m/s', 'sweep 0.5-20 Hz']
    """
    parts: list[str] = []
    for text in texts:
        file = text.rpartition("@")[0] or text
        is_file = any(Path(name).is_file() for name in (text, file, file.rpartition("#")[0]))
        parts += [text] if is_file else [part for name in text.split(",") if (part := name.strip())]
    return tuple(map(road_from_text, parts))


# -- reading -----------------------------------------------------------------------------------------------------------
def _some(tables: tuple[Mapping[str, Any], ...], key: str) -> tuple[Mapping[str, Any], ...]:
    if not tables:
        raise InputError(f"{key} is a list of tables", got="[]", mend=f"[[{key}]]")
    return tables


def _parameters(car: Any) -> CarParameters:
    if isinstance(car, str):
        return CARS[checks.known_name(car, list(CARS), "car")]
    if not isinstance(car, Mapping):
        raise InputError("car is the name of a set or a table", got=repr(car), mend=f"one of {', '.join(CARS)}")
    rest = {k: v for k, v in car.items() if k != "set"}
    base = CARS[checks.known_name(str(car.get("set", "megane")), list(CARS), "car")]
    changes = values_of(CarParameters, rest, "car", partial=True)
    return base.replace(**{k: v for k, v in changes.items() if k != "source"})


def _road(table: Mapping[str, Any], where: str, folder: Path) -> RideRoad:
    read, rest = kind_of(table, {**ROADS, "file": None}, where)
    if read is not None:
        return build(read, rest, where, partial=True)
    for key in rest:
        checks.known_name(key, ("path", "speed", "track", "laps"), f"key of {where}")
    if "path" not in rest:
        raise InputError(f"{where} needs a path", mend='path = "profiles.csv"')
    return MeasuredRoad.read(folder / str(rest["path"]), to_si(rest.get("speed", 10.0), "m/s", f"{where}.speed"),
                             rest.get("track"), rest.get("laps"))


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
        name = checks.known_name(str(table.get("law", "")), known, f"law of {where}")
        law, label = law_class(name)(), str(table.get("name", name))
    values = numbers_of(rest, {p.name: p.unit for p in law.parameters}, where, f"parameter of {law.name}")
    return label, law.with_values(**values) if rest else law


def _named(laws: Sequence[tuple[str, Controller]]) -> dict[str, Controller]:
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
# known_damper = "guo.json"    # the damper model of inverse and observer; left out: the car's own
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
