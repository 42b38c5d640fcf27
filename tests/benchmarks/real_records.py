"""Measured record groups, split once into training and held-out, for the user's command and for plain numpy.

Nothing of the project is imported: what is read here judges it. A part of a file is cut by shares of its rows, so that
one long record has a later stretch that no fit has seen. The measurements are not part of the project; `folder` is
where they lie (``LPVID_DATA``).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

UNITS = {"s": 1.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "N": 1.0, "A": 1.0,
         "V": 1.0, "degC": 1.0, "raw": 1.0}


@dataclass(frozen=True)
class Part:
    """Rows of one file.

    Attributes
    ----------
    file : str
        Below the data folder.
    first, last : float
        Shares of the rows, from and to.
    """

    file: str
    first: float = 0.0
    last: float = 1.0

    @property
    def is_whole(self) -> bool:
        """Whether nothing is cut away."""
        return (self.first, self.last) == (0.0, 1.0)


@dataclass(frozen=True)
class Group:
    """One set of records of one specimen.

    Attributes
    ----------
    name : str
    training, held_out : tuple of Part
    options : tuple of str
        Of the user's command, beyond files and baseline.
    baselines : tuple of str
        Baselines that make sense here.
    flipped : bool
        Whether the force has the other sense: it opposes the velocity.
    of : str
        For other records of a specimen that has a group: the group whose fair answers hold here too.
    """

    name: str
    training: tuple[Part, ...]
    held_out: tuple[Part, ...]
    options: tuple[str, ...] = ()
    baselines: tuple[str, ...] = ("linear",)
    flipped: bool = False
    of: str = ""


def _cut(name: str, file: str, baselines: tuple[str, ...] = ("linear",), flipped: bool = False) -> Group:
    """One file: two thirds to fit, the last third held out."""
    return Group(name, (Part(file, 0.0, 2 / 3),), (Part(file, 2 / 3, 1.0),), baselines=baselines, flipped=flipped)


def _files(folder: str, *names: str) -> tuple[Part, ...]:
    return tuple(Part(f"{folder}/{n}.csv") for n in names)


def _sines(*names: str) -> tuple[Part, ...]:
    return tuple(Part(f"mr_damper_sines/{n}{i}A.csv") for n in names for i in ("0", "0p25", "0p75", "1"))


GROUPS: tuple[Group, ...] = (
    _cut("random", "mr_damper_random/estimation.csv", ("guo", "linear", "lpv-arx")),
    _cut("fixed", "mr_damper_fixed_voltage/estimation.csv", ("guo", "linear"), flipped=True),
    Group("sines", _sines("10mm1Hz", "25mm0p25Hz", "5mm3Hz"), _sines("25mm0p5Hz", "2mm5Hz"),
          ("--sample-rate", "200"), ("guo", "linear", "lpv-arx")),
    _cut("race-heat", "race_damper_dyno/t1_3_3_24_24_s5_n100_100psi_with_heat_gun.csv"),
    _cut("race-24", "race_damper_dyno/t1_2_2_24_24_s5_n10_100psi.csv"),
    _cut("race-slow", "race_damper_dyno/t1_1_1_18_18_s1_n10_100psi.csv", flipped=True),
    _cut("race-fast", "race_damper_dyno/t1_1_1_18_18_s5_n10_150psi.csv", flipped=True),
    Group("car", (Part("quarter_car_rig/run1.csv"),), (Part("quarter_car_rig/run2.csv"),),
          ("--role", "actuator=actuator force"), ("quarter-car",)),
    Group("labcontrol-0V", _files("labcontrol_0V", "ensaio1.1", "ensaio4.1", "ensaio7.1"),
          _files("labcontrol_0V", "ensaio2.1"), baselines=("linear", "guo")),
    Group("labcontrol-0.87V", _files("labcontrol_0.87V", "ensaio3.2.2", "ensaio9.2.2"),
          _files("labcontrol_0.87V", "ensaio8.2.2"), baselines=("linear", "guo")),
    Group("labcontrol-1.98V", _files("labcontrol_1.98V", "ensaio.B.1", "ensaio.B.6", "ensaio.B.8"),
          _files("labcontrol_1.98V", "ensaio.B.5"), baselines=("linear", "guo")),
    Group("labcontrol-voltages",
          _files("labcontrol_voltages", "ensaio1.1", "ensaio7.1", "ensaio4.2.2", "ensaio10.2.2", "ensaio.B.1",
                 "ensaio.B.8", "ensaio.A.1", "ensaio.A.7"),
          _files("labcontrol_voltages", "ensaio4.1", "ensaio8.2.2", "ensaio.B.5", "ensaio.A.4"),
          baselines=("guo", "linear")),
    Group("emps", _files("emps", "first"), _files("emps", "last")),
    Group("bouc-wen", _files("bouc_wen", "period1_first"), _files("bouc_wen", "period2_rest"),
          baselines=("linear", "bouc-wen")),
    Group("silverbox", _files("silverbox", "multisine_a"), _files("silverbox", "multisine_b")),
)


def _thirds(name: str) -> tuple[Group, ...]:
    """A third of one record to fit, another held out, in three turns."""
    whole = group(name)
    file, cut = whole.training[0].file, (0.0, 1 / 3, 2 / 3, 1.0)
    return tuple(replace(whole, name=f"{name}:{i + 1}", of=name, training=(Part(file, cut[i], cut[i + 1]),),
                         held_out=(Part(file, cut[(i + 1) % 3], cut[(i + 1) % 3 + 1]),)) for i in range(3))


def _other(name: str, turn: int, training: tuple[Part, ...], held_out: tuple[Part, ...]) -> Group:
    return replace(group(name), name=f"{name}:{turn}", of=name, training=training, held_out=held_out)


def _halves(name: str) -> tuple[Group, ...]:
    """Half of the training record to fit, what its group holds out held out."""
    whole = group(name)
    return tuple(replace(whole, name=f"{name}:{i + 1}", of=name,
                         training=(Part(whole.training[0].file, i / 2, (i + 1) / 2),)) for i in range(2))


def siblings() -> tuple[Group, ...]:
    """The same specimens with less or other data than in `GROUPS`: what is true of a damper is true of all its records.

    Fitted and held-out parts are parts of files, or files, that `GROUPS` combines otherwise; fair answers are those of
    the group `Group.of`, although less data may leave more rivals.
    """
    lab = {volt: lambda *names, volt=volt: _files(f"labcontrol_{volt}", *(f"ensaio{n}" for n in names))
           for volt in ("0V", "0.87V", "1.98V", "voltages")}
    return (
        *_thirds("random"), *_thirds("fixed"), *_thirds("race-heat"), *_thirds("race-24"), *_thirds("race-slow"),
        *_thirds("race-fast"), *_halves("emps"), *_halves("bouc-wen"), *_halves("silverbox"),
        _other("sines", 1, _sines("25mm0p1Hz", "25mm0p5Hz", "5mm3Hz"), _sines("10mm1Hz")),
        _other("sines", 2, _sines("10mm1Hz", "2mm5Hz"), _sines("5mm3Hz")),
        _other("car", 1, (Part("quarter_car_rig/run2.csv"),), (Part("quarter_car_rig/run1.csv"),)),
        _other("labcontrol-0V", 1, lab["0V"]("1.1", "2.1"), lab["0V"]("4.1")),
        _other("labcontrol-0V", 2, lab["0V"]("2.1", "7.1"), lab["0V"]("1.1")),
        _other("labcontrol-0.87V", 1, lab["0.87V"]("8.2.2", "9.2.2"), lab["0.87V"]("3.2.2")),
        _other("labcontrol-0.87V", 2, lab["0.87V"]("3.2.2", "8.2.2"), lab["0.87V"]("9.2.2")),
        _other("labcontrol-1.98V", 1, lab["1.98V"](".B.5", ".B.6"), lab["1.98V"](".B.8")),
        _other("labcontrol-1.98V", 2, lab["1.98V"](".B.5", ".B.8"), lab["1.98V"](".B.1")),
        _other("labcontrol-voltages", 1, lab["voltages"]("4.1", "8.2.2", ".B.5", ".A.4"),
               lab["voltages"]("7.1", "10.2.2", ".B.8", ".A.7")),
    )


def drawn(seed: int) -> tuple[Group, ...]:
    """The same specimens with parts drawn anew: unlike `GROUPS` and `siblings`, no engine was set on them.

    Of a single record a window of a quarter to three fifths is fitted, and the longest part of what lies on one side of
    it is held out, three tenths of the record at most. Of a specimen with many files some are drawn for either.
    """
    rng = np.random.default_rng(seed)
    return tuple(replace(whole, name=f"{whole.name}@{seed}", of=whole.name, training=training, held_out=held_out)
                 for whole in GROUPS for training, held_out in [_draw(whole, rng)])


def _draw(whole: Group, rng: np.random.Generator) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Parts to fit and parts to hold out."""
    parts = (*whole.training, *whole.held_out)
    files = tuple(dict.fromkeys(p.file for p in parts))
    if whole.name == "sines":
        motions = rng.permutation(["10mm1Hz", "25mm0p25Hz", "5mm3Hz", "25mm0p5Hz", "2mm5Hz", "25mm0p1Hz"])
        count = int(rng.integers(2, 4))
        return _sines(*motions[:count]), _sines(*motions[count:count + 2])
    if whole.name.startswith("labcontrol"):
        mixed = [Part(str(f)) for f in rng.permutation(files)]
        count = max(2, round(len(files) * rng.uniform(0.4, 0.7)))
        return tuple(mixed[:count]), tuple(mixed[count:])
    if len(files) == 2:
        first, second = (str(f) for f in rng.permutation(files))
        return (_window(first, rng),), (_window(second, rng),)
    share = rng.uniform(0.25, 0.6)
    start = rng.uniform(0.0, 1.0 - share)
    before, after = start, 1.0 - start - share
    rest = (max(0.0, start - 0.3), start) if before > after else (start + share, min(1.0, start + share + 0.3))
    return (Part(files[0], start, start + share),), (Part(files[0], *rest),)


def _window(file: str, rng: np.random.Generator) -> Part:
    share = rng.uniform(0.3, 0.8)
    start = rng.uniform(0.0, 1.0 - share)
    return Part(file, start, start + share)


def group(name: str) -> Group:
    """The group of a name, siblings by ``NAME:TURN``, drawn ones by ``NAME@SEED``."""
    many = drawn(int(name.partition("@")[2])) if "@" in name else siblings() if ":" in name else GROUPS
    return next(g for g in many if g.name == name)


def read(folder: Path, part: Part) -> dict[str, np.ndarray]:
    """Channels of a part in SI units: ``time``, and whatever else the file has, by its column's name.

    Parameters
    ----------
    folder : path
        Where the measurements lie.
    part : Part

    Returns
    -------
    dict of str to (n,) array
        `current` is whatever is commanded: a current in A or a voltage in V.
    """
    header, rows = _table(folder / part.file)
    first, last = round(part.first * len(rows)), round(part.last * len(rows))
    values = np.array([[float(c) for c in row] for row in rows[first:last]])
    found = {}
    for column, title in enumerate(header):
        name, _, unit = title.partition(" [")
        found[{"voltage": "current"}.get(name, name)] = values[:, column] * UNITS[unit.rstrip("]")]
    return found


def written(folder: Path, parts: tuple[Part, ...], out: Path) -> list[str]:
    """Paths for the user's command: the files themselves, and cut ones below `out`."""
    paths = []
    for part in parts:
        source = folder / part.file
        if not part.is_whole:
            header, rows = _table(source)
            first, last = round(part.first * len(rows)), round(part.last * len(rows))
            target = out / f"{source.stem}_{first}_{last}.csv"
            out.mkdir(parents=True, exist_ok=True)
            with target.open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows([header, *rows[first:last]])
            source = target
        paths.append(str(source))
    return paths


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    return header, rows
