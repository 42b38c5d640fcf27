"""Preview: what a car has of the road ahead of an axle, and how it is written on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from lpvid.errors import InputError
from lpvid.tables import to_si
from lpvid.toolkit import checks
from quartercar.controllers.contract import Controller
from quartercar.controllers.laws.skyhook_linear import LinearSkyhook
from quartercar.controllers.loop.sensing import SETS, MeasurementSet
from quartercar.roads.ride_roads import RideRoad

FRONTS = ("estimated", "known")
KEYS = ("wheelbase", "time", "front", "sensors")
LONGEST = 2.0
"""of a preview [s]: its register has a sample's elevation each"""


@dataclass(frozen=True, eq=False)
class Preview:
    """The rear axle of a car without pitch: it meets the front axle's road later by wheelbase over speed.

    Attributes
    ----------
    wheelbase : float or None
        [m].
    time : float or None
        Between the axles [s], whatever the speed; one of the two is given.
    front : str
        ``"estimated"`` from the front axle's sensors, or ``"known"``: the profile itself.
    sensors : MeasurementSet or None
        Of the front axle; None for those of the rear one.
    law : Controller
        Of the front axle, which has no preview.
    """

    wheelbase: float | None = None
    time: float | None = None
    front: str = "estimated"
    sensors: MeasurementSet | None = None
    law: Controller = field(default_factory=LinearSkyhook)

    def __post_init__(self) -> None:
        if (self.wheelbase is None) == (self.time is None):
            raise InputError("a preview has a wheelbase or a time", got="both" if self.time is not None else "neither",
                             mend="--preview wheelbase=2.7, or --preview time=0.1")
        for name, unit in (("wheelbase", "m"), ("time", "s")):
            if getattr(self, name) is not None:
                checks.positive(getattr(self, name), f"{name} of a preview", unit)
        if self.front == "known" and self.sensors is not None:
            raise InputError("a front that is known has no sensors", got=self.sensors.name,
                             mend="front=estimated, or no sensors")
        checks.known_name(self.front, FRONTS, "front of a preview")

    def delay(self, road: RideRoad) -> float:
        """Between the axles [s].

        Parameters
        ----------
        road : RideRoad

        Returns
        -------
        float
            [s].

        Raises
        ------
        InputError
            A wheelbase on a road without a speed; a time beyond `LONGEST`.
        """
        if self.time is not None:
            found = self.time
        else:
            speed = road.to_dict().get("speed")
            if speed is None:
                raise InputError(f"{road.name} has no speed", why="a wheelbase is not a time without one",
                                 mend="--preview time=0.1")
            assert self.wheelbase is not None
            found = self.wheelbase / float(speed)
        if found > LONGEST:
            raise InputError("the preview is too long", got=f"{found:.3g} s on {road.name}",
                             mend=f"at most {LONGEST:g} s")
        return found

    def __str__(self) -> str:
        far = f"wheelbase {self.wheelbase:g} m" if self.time is None else f"{self.time:g} s"
        by = "" if self.sensors is None else f" by {self.sensors.name}"
        return f"{far}, front {self.front}{by}"

    def to_dict(self) -> dict:
        """Part of ride.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"wheelbase": self.wheelbase, "time": self.time, "front": self.front,
                "sensors": None if self.sensors is None else self.sensors.name, "law": self.law.to_dict()}


def preview_from_text(text: str) -> Preview | None:
    """``wheelbase=2.7``, ``time=0.1``, with ``,front=known`` or ``,sensors=stroke-body-wheel``; ``none`` for none.

    Parameters
    ----------
    text : str

    Returns
    -------
    Preview or None

    Raises
    ------
    InputError
        A part without ``=``; an unknown key, a value that is no number, front or measurement set.

    Examples
    --------
    >>> print(preview_from_text("wheelbase=2.7,front=known"))
    wheelbase 2.7 m, front known
    """
    if text.strip() == "none":
        return None
    table: dict[str, object] = {}
    for part in text.split(","):
        key, mark, value = (p.strip() for p in part.partition("="))
        if not mark:
            raise InputError(f"--preview {text}", got=part,
                             mend="key=value with commas, as in wheelbase=2.7,front=known")
        table[key] = value
    return preview_from_table(table, f"--preview {text}")


def preview_from_table(table: Mapping[str, object], where: str) -> Preview:
    """From keys and values of a text or of a configuration.

    Parameters
    ----------
    table : mapping of str to object
        ``wheelbase`` [m] or ``time`` [s], numbers or text with a unit; ``front`` and ``sensors`` by name.
    where : str
        What errors name as the source.

    Returns
    -------
    Preview
    """
    for key in table:
        checks.known_name(key, KEYS, f"key of {where}")
    given: dict = {}
    for key, unit in (("wheelbase", "m"), ("time", "s")):
        if key in table:
            given[key] = to_si(number_or_text(table[key]), unit, f"{where}: {key}")
    if "front" in table:
        given["front"] = checks.known_name(str(table["front"]), FRONTS, f"front of {where}")
    if "sensors" in table:
        given["sensors"] = SETS[checks.known_name(str(table["sensors"]), list(SETS), "measurement set")]
    return Preview(**given)


def number_or_text(value: object) -> object:
    """A number that may be written as text, else what was given, e.g. text with a unit.

    Parameters
    ----------
    value : object

    Returns
    -------
    float or object
    """
    try:
        return float(str(value))
    except ValueError:
        return value
