"""Units: header text to SI values with a readable SI unit; pint is loaded only for what the table lacks."""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lpvid.errors import InputError


class InSI(NamedTuple):
    """Values in SI, the SI unit as text, and whether the source unit was understood.

    Parameters
    ----------
    values : array
        As given where the source unit was not understood.
    unit : str
        Empty for a pure number, and where the source unit was not understood.
    known : bool
    """

    values: np.ndarray
    unit: str
    known: bool


@dataclass(frozen=True)
class _UnitScale:
    """si = (numerator·value + offset) / denominator; a whole denominator keeps 25.4 mm at exactly 0.0254 m."""

    unit: str
    numerator: float = 1.0
    denominator: float = 1.0
    offset: float = 0.0

    def to_si(self, value: Any) -> Any:
        if self.numerator != 1.0 or self.offset != 0.0:
            value = value * self.numerator + self.offset
        return value / self.denominator if self.denominator != 1.0 else value

    def from_si(self, value: Any) -> Any:
        return (value * self.denominator - self.offset) / self.numerator


_INCH, _FOOT, _POUND_FORCE, _GRAVITY = 0.0254, 0.3048, 4.4482216152605, 9.80665

_SAME = (
    "m", "s", "A", "V", "K", "N", "kg", "Hz", "rad", "Pa", "W", "J", "ohm", "H", "T", "C", "m/s", "m/s^2", "m/s^3",
    "rad/s", "rad/s^2", "1/s", "N*s/m", "N/m", "N*m", "kg/s", "N/A", "A/s", "V/s", "N/s", "m^2", "m^3", "kg*m^2",
    "Pa*s", "K/s",
)
_SCALES: dict[str, _UnitScale] = {text: _UnitScale(text) for text in _SAME} | {
    "": _UnitScale(""),
    "1": _UnitScale(""),
    "-": _UnitScale(""),
    "%": _UnitScale("", 1, 100),
    "percent": _UnitScale("", 1, 100),
    "km": _UnitScale("m", 1000),
    "dm": _UnitScale("m", 1, 10),
    "cm": _UnitScale("m", 1, 100),
    "mm": _UnitScale("m", 1, 1000),
    "um": _UnitScale("m", 1, 1e6),
    "in": _UnitScale("m", _INCH),
    "inch": _UnitScale("m", _INCH),
    "ft": _UnitScale("m", _FOOT),
    "mm/s": _UnitScale("m/s", 1, 1000),
    "cm/s": _UnitScale("m/s", 1, 100),
    "in/s": _UnitScale("m/s", _INCH),
    "ft/s": _UnitScale("m/s", _FOOT),
    "km/h": _UnitScale("m/s", 10, 36),
    "mm/s^2": _UnitScale("m/s^2", 1, 1000),
    "cm/s^2": _UnitScale("m/s^2", 1, 100),
    "g0": _UnitScale("m/s^2", _GRAVITY),
    "mN": _UnitScale("N", 1, 1000),
    "kN": _UnitScale("N", 1000),
    "MN": _UnitScale("N", 1e6),
    "daN": _UnitScale("N", 10),
    "kgf": _UnitScale("N", _GRAVITY),
    "lbf": _UnitScale("N", _POUND_FORCE),
    "mA": _UnitScale("A", 1, 1000),
    "uA": _UnitScale("A", 1, 1e6),
    "mV": _UnitScale("V", 1, 1000),
    "kV": _UnitScale("V", 1000),
    "ms": _UnitScale("s", 1, 1000),
    "us": _UnitScale("s", 1, 1e6),
    "ns": _UnitScale("s", 1, 1e9),
    "min": _UnitScale("s", 60),
    "h": _UnitScale("s", 3600),
    "kHz": _UnitScale("Hz", 1000),
    "mrad": _UnitScale("rad", 1, 1000),
    "deg": _UnitScale("rad", math.pi, 180),
    "deg/s": _UnitScale("rad/s", math.pi, 180),
    "rpm": _UnitScale("rad/s", math.pi, 30),
    "deg/s^2": _UnitScale("rad/s^2", math.pi, 180),
    "hPa": _UnitScale("Pa", 100),
    "kPa": _UnitScale("Pa", 1000),
    "MPa": _UnitScale("Pa", 1e6),
    "mbar": _UnitScale("Pa", 100),
    "bar": _UnitScale("Pa", 1e5),
    "psi": _UnitScale("Pa", _POUND_FORCE / _INCH**2),
    "degC": _UnitScale("K", 1, 1, 273.15),
    "degF": _UnitScale("K", 5, 9, 5 * 459.67),
    "g": _UnitScale("kg", 1, 1000),
    "kW": _UnitScale("W", 1000),
    "kJ": _UnitScale("J", 1000),
    "mH": _UnitScale("H", 1, 1000),
    "mT": _UnitScale("T", 1, 1000),
    "mohm": _UnitScale("ohm", 1, 1000),
    "N/mm": _UnitScale("N/m", 1000),
    "kN/m": _UnitScale("N/m", 1000),
    "kN/mm": _UnitScale("N/m", 1e6),
    "N*s/mm": _UnitScale("N*s/m", 1000),
    "kN*s/m": _UnitScale("N*s/m", 1000),
    "N/(m/s)": _UnitScale("N*s/m"),
    "N/(mm/s)": _UnitScale("N*s/m", 1000),
    "kN*m": _UnitScale("N*m", 1000),
    "N*mm": _UnitScale("N*m", 1, 1000),
    "kWh": _UnitScale("J", 3.6e6),
    "g/s": _UnitScale("kg/s", 1, 1000),
    "kg/min": _UnitScale("kg/s", 1, 60),
    "kg/h": _UnitScale("kg/s", 1, 3600),
    "gauss": _UnitScale("T", 1, 10000),
}
"""Source unit to SI; each entry is checked against pint by a test."""

QUANTITIES = {"displacement": ("m", "rad"), "position": ("m", "rad"), "velocity": ("m/s", "rad/s", "1/s"),
              "acceleration": ("m/s^2", "rad/s^2", "1/s^2"), "force": ("N", "N*m"), "current": ("A", "V", "")}
"""SI units that a channel or role of this name can have, linear or rotary, or derived from a motion
without a unit; a current may be given as its command."""

_ACCELERATION = re.compile(r"((?<![^\W_])(acc|beschl)|accel(eration|erometer)?s?|beschleunigung(en)?)(?![^\W\d_])")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_MASS = re.compile(r"mass|weight|gewicht|load|ladung|last(?![^\W_])")
"""Words in names of channels, in lower case; German compounds such as Zuladung or Radlast count. Of an acceleration
only whole words and ends of words do: accelerated masses, accelerators and accumulators are none."""
_ALIASES = {"–": "-", "sec": "s", "Sec": "s", "C°": "degC", "F°": "degF"}
_RUN_TOGETHER = re.compile(r"(?<![A-Za-z])([kMm]?N)(mm|m|s)(?![A-Za-z])")
"""Nm and Ns: engineers mean newton metre and newton second; pint reads a yarn number, or nothing."""

_NOT_UNITS = frozenset({"a.u.", "a.u", "a. u."})
"""Arbitrary units, which pint would read as year times atomic mass."""

_CHARACTERS = str.maketrans({
    "·": "*", "⋅": "*", "∙": "*", "×": "*", "µ": "u", "μ": "u", "\u03a9": "ohm", "\u2126": "ohm", "℃": "degC",
    "℉": "degF", "−": "-",
})
_SUPERSCRIPTS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_ATOMS = {
    "N": "kg*m/s^2", "Pa": "kg/(m*s^2)", "J": "kg*m^2/s^2", "W": "kg*m^2/s^3", "V": "kg*m^2/(s^3*A)",
    "ohm": "kg*m^2/(s^3*A^2)", "H": "kg*m^2/(s^2*A^2)", "T": "kg/(s^2*A)", "Wb": "kg*m^2/(s^2*A)", "C": "s*A",
    "F": "s^4*A^2/(kg*m^2)", "Hz": "1/s",
}
_READABLE = ("N", "N/m", "N*s/m", "N*m", "N/s", "W", "Pa", "Pa*s", "Pa/s", "V", "V/s", "ohm", "H", "T", "Wb", "C", "F",
             "N/A", "N*s/(m*A)", "W/m^2", "N*s", "N*m*s")
_ORDER = ("kg", "m", "s", "A", "K", "rad")
_HEADER = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]$", re.DOTALL)
_ROUND_HEADER = re.compile(r"^(?P<name>.*?)\s*\((?P<unit>[^()]*)\)$", re.DOTALL)
_SLASH_HEADER = re.compile(r"^(?P<name>.*?\S)\s+/\s+(?:\((?P<bracketed>[^()]*)\)|(?P<unit>\S.*))$", re.DOTALL)
"""``Force / N`` and ``Velocity / (m/s)``, as ISO 80000-1 writes a quantity over its unit; without the spaces ``F/N``
may be a name."""
_LETTERS = frozenset("mgsAKNJWCVFSTHdhlLt")
"""Units of one letter that the SI brochure has (tables 2, 4 and 8). Pint also knows a year, a barn, the speed of light:
``force (a)`` and ``force (b)`` are names, and so is ``L / R``."""
_CAPITALISED = re.compile(r"[A-Z](?:[a-z]{3,}|mp|ec)")
"""A unit written out with a capital, Newton or Millimeter, Amp, Sec; shorter ones are symbols, in which it counts."""
_QUANTITY = re.compile(r"^\s*(?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?P<unit>(?:\D.*)?)$", re.DOTALL)
_TOWER = re.compile(r"\)\s*(\*\*|\^)|(\*\*|\^)\s*\(|(\*\*|\^)[^*/^]*(\*\*|\^)|\d{3}")


def parse_header(text: str) -> tuple[str, str | None]:
    """Split a column header ``name [unit]`` into its name and the unit's text.

    ``name (unit)`` and ``name / unit`` are read alike where the unit is known: "force (filtered)" and "force (b)" are
    names.

    Parameters
    ----------
    text : str
        The header cell; spaces and quotes around it do not matter.

    Returns
    -------
    name : str
    unit : str or None
        Text between the brackets, empty for ``[]``; None when there are no brackets.

    Examples
    --------
    >>> parse_header('"motor current [mA]"'), parse_header("p1")
    (('motor current', 'mA'), ('p1', None))
    >>> parse_header("Time (s)"), parse_header("force (filtered)"), parse_header("Force / kN")
    (('Time', 's'), ('force (filtered)', None), ('Force', 'kN'))
    """
    text = text.strip().strip("\"'").strip()
    match = _HEADER.match(text)
    if match is None:
        match = _SLASH_HEADER.match(text) or _ROUND_HEADER.match(text)
        found = match.groupdict() if match else {}
        unit = (found.get("unit") or found.get("bracketed") or "").strip()
        return (found["name"].strip(), unit) if _stated(unit) else (text, None)
    return match["name"].strip(), match["unit"].strip()


def _stated(unit: str) -> bool:
    """Whether text that round brackets or a slash set off from a name is a unit, and no part of the name."""
    letters = unit in _LETTERS if len(unit) == 1 and unit.isalpha() and unit.isascii() else any(
        c.isalpha() or c in "°%‰" for c in unit)
    return letters and is_known(unit)


def to_si(values: Any, unit: str | None) -> InSI:
    """Convert samples to SI.

    Parameters
    ----------
    values : array
        Samples in `unit`.
    unit : str or None
        Unit as the header gave it; None or "" leaves the values as they are.

    Returns
    -------
    InSI
        Values, readable SI unit (``""`` for a pure number) and True; for an unknown unit, or a logarithmic
        one, the values as they were, ``""`` and False.

    Examples
    --------
    >>> to_si([250.0, 25.4], "mm/s")
    InSI(values=array([0.25  , 0.0254]), unit='m/s', known=True)
    >>> to_si([3.0], "kN·s/m").unit, to_si([1.0], "raw").known
    ('N*s/m', False)
    """
    array = np.array(values, dtype=float)
    scale = _scale(unit or "")
    if scale is None:
        return InSI(array, "", False)
    with np.errstate(over="ignore", invalid="ignore"):
        return InSI(scale.to_si(array), scale.unit, True)


def convert(value: Any, unit_from: str, unit_to: str) -> Any:
    """Convert a number or an array from one unit to another of the same kind.

    Parameters
    ----------
    value : float or array
        Value in `unit_from`.
    unit_from, unit_to : str
        Units; hertz and rad/s are not of the same kind (a factor 2π stands between them).

    Returns
    -------
    float or array
        Value in `unit_to`.

    Raises
    ------
    InputError
        A unit is not known, or the two measure different things.

    Examples
    --------
    >>> round(convert(1.0, "bar", "psi"), 4), round(convert(212.0, "degF", "degC"), 9)
    (14.5038, 100.0)
    """
    source, target = _known_scale(unit_from), _known_scale(unit_to)
    if not same_kind(source.unit, target.unit):
        raise InputError(f"cannot convert '{unit_from}' to '{unit_to}'",
                         got=f"{source.unit or 'a pure number'} against {target.unit or 'a pure number'}")
    number = value if isinstance(value, (int, float)) else np.asarray(value, dtype=float)
    return target.from_si(source.to_si(number))


def quantity_to_si(value: object, unit: str | None = None) -> tuple[float, str]:
    """Read a setting: a number in SI, or text with a unit such as ``"5 mm"``.

    Parameters
    ----------
    value : float or str
        The setting.
    unit : str, optional
        Unit of the kind that is wanted, e.g. ``"m/s"``; another kind is refused, a bare number is taken in its SI unit.

    Returns
    -------
    value : float
        In SI.
    unit : str
        SI unit; ``""`` for a pure number or a bare number of unstated kind.

    Raises
    ------
    InputError
        Not a finite number with a known unit of the kind wanted.

    Examples
    --------
    >>> quantity_to_si("5 mm"), quantity_to_si(3, unit="N")
    ((0.005, 'm'), (3.0, 'N'))
    """
    wanted = None if unit is None else _known_scale(unit).unit
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool):
        number, text = float(value), ""
    elif match:
        number, text = float(match["number"]), match["unit"].strip()
    else:
        raise InputError("a setting must be a number (SI) or text with a unit", got=repr(value),
                         mend='write e.g. "5 mm"')
    if not math.isfinite(number):
        raise InputError("a setting must be finite", got=repr(value))
    if not text:
        return number, wanted or ""
    scale = _known_scale(text)
    if wanted is not None and not same_kind(scale.unit, wanted):
        raise InputError(f"a setting in {wanted or 'pure numbers'} is wanted", got=repr(value))
    return float(scale.to_si(number)), scale.unit if wanted is None else wanted


def is_known(unit: str) -> bool:
    """True when the unit can be converted to SI.

    Parameters
    ----------
    unit : str
        As it stands in a header.

    Returns
    -------
    bool
    """
    return _scale(unit) is not None


def contradicts(name: str, si_unit: str, source_unit: str | None = None) -> tuple[str, ...]:
    """Units that a channel or role of this name would have, where its own is known and none of them; empty otherwise.

    Parameters
    ----------
    name : str
        Channel or role, in upper or lower case.
    si_unit : str
        As this module writes it; empty where it is not known.
    source_unit : str, optional
        As the header of a channel of this name writes it. ``g`` and ``mg``, which are grams in every system of units
        and the usual sign of multiples of gravity on a test bench, are masses only where the name states a mass.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> contradicts("velocity", "m"), contradicts("velocity", "m/s"), contradicts("speed of oil", "m")
    (('m/s', 'rad/s', '1/s'), (), ())
    >>> contradicts("body_acceleration", "kg")                                          # a header [g]
    ('m/s^2', 'rad/s^2', '1/s^2')
    >>> contradicts("z body", "kg", "g")[0], contradicts("payload", "kg", "g"), contradicts("z body", "kg", "kg")
    ('m/s^2', (), ())
    >>> contradicts("accelerated mass", "kg", "kg"), contradicts("massAcc", "kg", "g")[0]
    ((), 'm/s^2')
    """
    expected = QUANTITIES.get(name.casefold(), ())
    if si_unit == "kg" and not expected:
        mass, acceleration = bool(_MASS.search(name.casefold())), _names_acceleration(name)
        if (acceleration or not mass) if _grams_or_gravity(source_unit) else (acceleration and not mass):
            expected = QUANTITIES["acceleration"]
    return expected if si_unit and expected and si_unit not in expected else ()


def _names_acceleration(name: str) -> bool:
    return bool(_ACCELERATION.search(_CAMEL.sub(" ", name).casefold()))


def _grams_or_gravity(source_unit: str | None) -> bool:
    return (source_unit or "").strip() in ("g", "mg")


def in_doubt(name: str, source_unit: str | None) -> bool:
    """Whether a unit may be grams or gravity, and the channel's name states neither mass nor acceleration.

    Parameters
    ----------
    name : str
        Channel, in upper or lower case.
    source_unit : str or None
        As the header writes it.

    Returns
    -------
    bool

    Examples
    --------
    >>> in_doubt("specimen", "g"), in_doubt("payload", "g"), in_doubt("wheel acc", "g"), in_doubt("specimen", "kg")
    (True, False, False, False)
    """
    stated = name.casefold() in QUANTITIES or _MASS.search(name.casefold()) or _names_acceleration(name)
    return _grams_or_gravity(source_unit) and not stated


def contradiction_mend(si_unit: str, expected: tuple[str, ...], channel: str, role: str = "", doubt: str = "") -> str:
    """What to write instead of a unit that contradicts its channel's name.

    Parameters
    ----------
    si_unit : str
        The channel's.
    expected : tuple of str
        Of `contradicts`.
    channel : str
        Its name.
    role : str
        In which the channel is used; empty where its own name is contradicted.
    doubt : str
        The unit as the header writes it where `in_doubt`; empty otherwise.

    Returns
    -------
    str
    """
    own = channel.casefold() if channel.casefold() in QUANTITIES else "ROLE"
    stated = f"--role '{role or own}={channel} [%s]'"
    if doubt:
        return f"[{doubt}] may be grams or gravity: write [{doubt}_0] for multiples of gravity, or " \
               f"{stated % f'{doubt}_0'}, or name the channel as a mass"
    if si_unit == "kg" and "m/s^2" in expected:
        return f"write [g_0] for multiples of 9.80665 m/s^2, or {stated % 'g_0'}: [g] is the gram; a mass in [kg]"
    if si_unit == "kg" and "N" in expected:
        return f"write [lbf] for [lb], [kgf] for [kg], in the header or by {stated % 'lbf'}: [lb] and [kg] are masses"
    if role:
        return f"map a channel in {expected[0]}, --role {role}=CHANNEL, or correct the unit in the header, or " \
               f"{stated % 'UNIT'}"
    return f"correct the unit in the header, or {stated % 'UNIT'}, convert a sensor's volts by its calibration, or " \
           "name the channel by what it is"


def same_kind(si_unit: str, other: str) -> bool:
    """True when two SI unit texts have the same dimension (radians count as one).

    Parameters
    ----------
    si_unit, other : str
        As this module writes them.

    Returns
    -------
    bool

    Examples
    --------
    >>> same_kind("N*s/m", "kg/s"), same_kind("1/s", "rad/s")
    (True, False)
    """
    return _dimension(si_unit) == _dimension(other)


def _known_scale(unit: str) -> _UnitScale:
    scale = _scale(unit)
    if scale is None:
        raise InputError("unknown unit", got=repr(unit), mend="write it as in 'mm/s', 'N*s/m' or 'degC'")
    return scale


def _normal(unit: str) -> str:
    text = " ".join(unit.translate(_CHARACTERS).split()).replace("**", "^").replace("°C", "degC").replace("°F", "degF")
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda run: "^" + run[0].translate(_SUPERSCRIPTS), text.replace("°", "deg"))
    text = _RUN_TOGETHER.sub(r"\1*\2", re.sub(r"\s*([*/^])\s*", r"\1", text))
    return _ALIASES.get(text, text)


@functools.lru_cache(maxsize=512)
def _scale(unit: str) -> _UnitScale | None:
    text = _normal(unit)
    if text in _SCALES:
        return _SCALES[text]
    if text in _NOT_UNITS or len(text) > 60 or _TOWER.search(text):
        return None
    found = _pint_scale(text)
    return _scale(text.lower()) if found is None and _CAPITALISED.fullmatch(text) else found


@functools.lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def _pint_scale(text: str) -> _UnitScale | None:
    """Scale of a unit that the table lacks; None when pint does not know it or it is not a straight line."""
    registry = _registry()
    try:
        unit = registry.Unit(text)
        points = [registry.Quantity(x, unit).to_base_units() for x in (0.0, 1.0, 2.0)]
        low, middle, high = (float(p.magnitude) for p in points)
        base = _dimension(format(points[0].units, "~C"))
    except Exception:  # pint's tokenizer and evaluator raise half a dozen unrelated types on odd text
        return None
    slope = middle - low
    if not (math.isfinite(slope) and slope != 0 and math.isclose(high - middle, slope, rel_tol=1e-9)):
        return None
    return _UnitScale(_readable(base), slope, 1.0, low)


def base_exponents(si_unit: str) -> dict[str, float]:
    """Exponents of the base units in an SI unit as this module writes it; an unknown name stands as it is.

    Parameters
    ----------
    si_unit : str
        Empty for a pure number.

    Returns
    -------
    dict of str to float
        Those that are 0 left out; empty for a pure number.

    Raises
    ------
    InputError
        An exponent that is no number.

    Examples
    --------
    >>> base_exponents("N*s/m"), base_exponents("")
    ({'kg': 1.0, 's': -1.0}, {})
    """
    return dict(_dimension(si_unit))


@functools.lru_cache(maxsize=512)
def _dimension(si_unit: str) -> tuple[tuple[str, float], ...]:
    """Exponents of the base units in a product such as ``N*s/(m*A)``, sorted by name."""
    exponents: dict[str, float] = {}
    sign, depth_sign = 1, 1
    for token in re.findall(r"[*/()]|[^*/()]+", si_unit.replace(" ", "").replace("**", "^")):
        if token in "*/":
            sign = -1 if token == "/" else 1
        elif token == "(":
            depth_sign, sign = sign, 1
        elif token == ")":
            depth_sign = 1
        elif token != "1":
            symbol, _, power = token.partition("^")
            try:
                times = depth_sign * sign * float(power or 1)
            except ValueError:
                raise InputError("a unit has exponents that are numbers", got=repr(si_unit),
                                 mend="divide by a reference before the power, as in K (v / 1 m/s)^n") from None
            parts = _dimension(_ATOMS[symbol]) if symbol in _ATOMS else ((symbol, 1.0),)
            for name, exponent in parts:
                exponents[name] = exponents.get(name, 0.0) + times * exponent
            sign = 1
    return tuple(sorted((name, e) for name, e in exponents.items() if e))


def quotient(above: str, below: str) -> str:
    """The unit of one quantity over another, as figures and remarks print it.

    Parameters
    ----------
    above, below : str
        Units; "" and "1" of a pure number.

    Returns
    -------
    str
        In brackets what is itself a product or a quotient; what is divided by a pure number keeps its unit.

    Examples
    --------
    >>> quotient("N", "m/s"), quotient("N", "1"), quotient("m/s", "V"), quotient("", "V"), quotient("N", "N")
    ('N/(m/s)', 'N', '(m/s)/V', '1/V', 'N/N')
    """
    over, under = ((f"({u})" if any(c in u for c in "*/ ·") else u) for u in (above or "1", below or "1"))
    return above or "1" if under == "1" else f"{over}/{under}"


def driver(unit: str) -> str:
    """The word for what plays the part of the current: a voltage does where the current was not recorded.

    Parameters
    ----------
    unit : str
        Of the channel that plays the current's part.

    Returns
    -------
    str

    Examples
    --------
    >>> driver("A"), driver("V")
    ('current', 'voltage')
    """
    return "voltage" if unit == "V" else "current"


def _readable(dimension: tuple[tuple[str, float], ...]) -> str:
    """Name a dimension: N rather than kg*m/s^2; angles, counts and temperatures stand behind."""
    core = tuple(d for d in dimension if d[0] in ("kg", "m", "s", "A"))
    rest = [d for d in dimension if d not in core]
    named = next((text for text in _READABLE if _dimension(text) == core), None)
    if named is None:
        return _product(list(dimension))
    if not rest:
        return named
    head, _, tail = named.partition("/")
    below = [p for p in (tail.strip("()"), *(_power(n, -e) for n, e in rest if e < 0)) if p]
    above = "*".join([head, *(_power(n, e) for n, e in rest if e > 0)])
    return f"{above}/({'*'.join(below)})" if len(below) > 1 else f"{above}/{below[0]}" if below else above


def _product(dimension: list[tuple[str, float]]) -> str:
    ranked = sorted(dimension, key=lambda d: (_ORDER.index(d[0]) if d[0] in _ORDER else len(_ORDER), d[0]))
    above = "*".join(_power(n, e) for n, e in ranked if e > 0)
    below = [_power(n, -e) for n, e in ranked if e < 0]
    if not below:
        return above
    return f"{above or '1'}/({'*'.join(below)})" if len(below) > 1 else f"{above or '1'}/{below[0]}"


def _power(symbol: str, exponent: float) -> str:
    return symbol if exponent == 1 else f"{symbol}^{exponent:g}"
