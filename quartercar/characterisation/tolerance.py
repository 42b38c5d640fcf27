"""Tolerance: bands about nominal forces, and how much specimens differ from one another."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lpvid.errors import InputError
from lpvid.units import parse_header, to_si
from quartercar.characterisation.forces import StandardForce
from quartercar.characterisation.points import DIRECTIONS
from quartercar.dampers.bench.static_characteristic import SAME_SPEED
from quartercar.dampers.facts import DISTINCT

MEND = ("a CSV with columns 'speed [m/s]', 'direction', 'force [N]' and, as needed, 'current [A]', 'lower [N]', "
        "'upper [N]'")
_TEXT = re.compile(r"^\s*(?:([\d.]+)\s*%)?\s*\+?\s*(?:([\d.]+)\s*N?)?\s*$")


@dataclass(frozen=True)
class Nominal:
    """One row of a nominal table: force and band as shown (sign of `rebound` applied) [N]; None where not given.

    Attributes
    ----------
    speed : float
        [m/s].
    direction : {1, −1}
        1 in rebound.
    current : float or None
        [A]; None for all currents.
    force : float or None
        Nominal force.
    lower, upper : float or None
        Ends of the band.
    """

    speed: float
    direction: int
    current: float | None
    force: float | None
    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class Tolerance:
    """Bands: share and newtons about the nominal force, or the table's own lower and upper.

    Attributes
    ----------
    share, newtons : float
        Half width is share · |nominal| + newtons.
    nominal : tuple of Nominal
        Empty: the mean over the specimens is the nominal force.

    Examples
    --------
    >>> t = Tolerance.parse("10% + 20 N")
    >>> t.share, t.newtons
    (0.1, 20.0)
    """

    share: float = 0.0
    newtons: float = 0.0
    nominal: tuple[Nominal, ...] = ()

    @classmethod
    def parse(cls, text: str, nominal: str | Path | None = None) -> Tolerance:
        """From ``10%+20N``, ``10%``, ``20N``, or the path of a table with its own lower and upper.

        Parameters
        ----------
        text : str
        nominal : str or Path, optional
            A table of nominal forces (`read_nominal`), about which percentage and newtons lie.

        Returns
        -------
        Tolerance

        Raises
        ------
        InputError
            Text that is neither; a table without columns of the band; a table that cannot be read.
        """
        rows = read_nominal(nominal) if nominal is not None else ()
        if Path(text).suffix.lower() in (".csv", ".tsv", ".txt"):
            table = read_nominal(text)
            if nominal is None and all(r.lower is None and r.upper is None for r in table):
                raise InputError(f"{text}: no column 'lower [N]' or 'upper [N]'",
                                 mend=f"--tolerance 10%+20N --nominal {text}")
            return cls(nominal=table)
        found = _TEXT.match(text)
        if found is None or not any(found.groups()):
            raise InputError("--tolerance takes a percentage and newtons, or a table", got=repr(text),
                             mend="e.g. --tolerance 10%+20N, or a CSV with columns lower and upper")
        try:
            share, newtons = (float(g or 0.0) for g in found.groups())
        except ValueError:
            raise InputError("--tolerance takes numbers", got=repr(text), mend="e.g. --tolerance 10%+20N") from None
        return cls(share / 100.0, newtons, rows)


@dataclass(frozen=True)
class Check:
    """One force against its band, all in the sign of the table [N].

    Attributes
    ----------
    force : StandardForce
    nominal : float or None
    lower, upper : float
    inside : bool or None
        None where the force is not further from a limit than two of its standard errors.
    """

    force: StandardForce
    nominal: float | None
    lower: float
    upper: float
    inside: bool | None


@dataclass(frozen=True)
class SpecimenSpread:
    """Specimens compared at one speed, direction and current.

    Attributes
    ----------
    current : float or None
    direction : {1, −1}
    speed, mean : float
        [m/s], [N].
    std : float
        Standard deviation between specimens [N].
    lowest, highest : (str, float)
        Specimen and force of least and largest |F|.
    count : int
    within : float
        Root mean square of the specimens' own standard errors [N]: the part of `std` that is not theirs.
    """

    current: float | None
    direction: int
    speed: float
    mean: float
    std: float
    lowest: tuple[str, float]
    highest: tuple[str, float]
    count: int
    within: float


def read_nominal(path: str | Path) -> tuple[Nominal, ...]:
    """Rows of a nominal table; `forces.csv` of an earlier characterisation is one.

    Parameters
    ----------
    path : str or Path
        CSV with columns ``speed``, ``direction`` and at least one of ``force``, ``lower``, ``upper``; units in the
        header.

    Returns
    -------
    tuple of Nominal
        In SI.

    Raises
    ------
    InputError
        A file that cannot be read, no rows, a missing column, a number or a direction that is none.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [r for r in csv.reader(file) if any(c.strip() for c in r)]
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"cannot read '{path}'", why=str(why)) from None
    if len(rows) < 2:
        raise InputError(f"{path}: no rows", mend=MEND)
    columns = {name.strip().lower(): (k, unit) for k, (name, unit) in enumerate(map(parse_header, rows[0]))}
    missing = [c for c in ("speed", "direction") if c not in columns]
    if missing or not {"force", "lower", "upper"} & set(columns):
        raise InputError(f"{path}: no column '{(missing or ['force'])[0]}'", got=", ".join(rows[0]), mend=MEND)
    found = []
    for number, row in enumerate(rows[1:], start=2):
        def value(name: str, row=row, number=number) -> float | None:
            if name not in columns:
                return None
            place, unit = columns[name]
            text = row[place].strip() if place < len(row) else ""
            if not text or text == "–":
                return None
            try:
                return float(to_si([float(text)], unit).values[0])
            except ValueError:
                raise InputError(f"{path}: line {number}, column '{name}' is no number", got=repr(text)) from None

        speed, place = value("speed"), columns["direction"][0]
        word = row[place].strip().lower() if place < len(row) else ""
        direction = next((d for d, name in DIRECTIONS.items() if word and name.startswith(word)), None)
        if speed is None or direction is None:
            raise InputError(f"{path}: line {number} needs a speed and a direction", got=", ".join(row),
                             mend="direction is 'rebound' or 'compression'")
        found.append(Nominal(speed, direction, value("current"), value("force"), value("lower"), value("upper")))
    return tuple(found)


def checks_of(forces: Sequence[StandardForce], tolerance: Tolerance, sign: int) -> tuple[Check, ...]:
    """Every force that has a band, against it.

    Parameters
    ----------
    forces : sequence of StandardForce
    tolerance : Tolerance
    sign : {1, −1}
        In which rebound is shown.

    Returns
    -------
    tuple of Check
        In the order of the forces; those without a band are left out.
    """
    rows = []
    reach = max((abs(f.current) for f in forces if f.current is not None), default=0.0)
    for f in forces:
        if f.force is None:
            continue
        shown = sign * f.force
        band = _band(f, tolerance, forces, sign, DISTINCT * reach)
        if band is None:
            continue
        nominal, lower, upper = band
        doubt = 2.0 * (f.std or 0.0)
        inside: bool | None = lower <= shown <= upper
        if min(abs(shown - lower), abs(shown - upper)) < doubt:
            inside = None
        rows.append(Check(f, nominal, lower, upper, inside))
    return tuple(rows)


def _band(f: StandardForce, tolerance: Tolerance, forces: Sequence[StandardForce], sign: int,
          near: float) -> tuple[float | None, float, float] | None:
    if tolerance.nominal:
        like = [n for n in tolerance.nominal if n.direction == f.direction and abs(n.speed / f.speed - 1) < SAME_SPEED
                and (n.current is None or f.current is None or abs(n.current - f.current) <= max(near, 1e-9))]
        if not like:
            return None
        n = min(like, key=lambda n: abs(n.speed - f.speed))
        centre = n.force
        if n.lower is not None or n.upper is not None:
            ends = (-np.inf if n.lower is None else n.lower, np.inf if n.upper is None else n.upper)
            return centre, min(ends), max(ends)
    else:
        same = [g.force for g in forces if g.force is not None
                and (g.current, g.direction, g.speed) == (f.current, f.direction, f.speed)]
        if len(same) < 2:
            return None
        centre = sign * float(np.mean(same))
    if centre is None:
        return None
    half = tolerance.share * abs(centre) + tolerance.newtons
    return centre, centre - half, centre + half


def specimen_spreads(forces: Sequence[StandardForce]) -> tuple[SpecimenSpread, ...]:
    """Mean and scatter over specimens wherever two or more have a force.

    Parameters
    ----------
    forces : sequence of StandardForce

    Returns
    -------
    tuple of SpecimenSpread
        One for each current, direction and speed.
    """
    rows = []
    for key in dict.fromkeys((f.current, f.direction, f.speed) for f in forces):
        own = [f for f in forces if f.force is not None and (f.current, f.direction, f.speed) == key]
        if len({f.specimen for f in own}) < 2:
            continue
        values = np.array([f.force for f in own], dtype=float)
        low, high = own[int(np.abs(values).argmin())], own[int(np.abs(values).argmax())]
        within = float(np.sqrt(np.mean([(f.std or 0.0) ** 2 for f in own])))
        rows.append(SpecimenSpread(*key, float(values.mean()), float(values.std(ddof=1)),
                                   (low.specimen, low.force or 0.0), (high.specimen, high.force or 0.0), len(own),
                                   within))
    return tuple(rows)
