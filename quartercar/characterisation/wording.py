"""Wording: the verdict of a characterisation and its ten lines."""

from __future__ import annotations

import math

from lpvid.units import driver
from quartercar.characterisation.gas import StaticForce
from quartercar.characterisation.points import DIRECTIONS
from quartercar.characterisation.readings import Readings
from quartercar.characterisation.runs import RecordPieces


def amps(current: float | None, unit: str) -> str:
    """A current for a reader.

    Parameters
    ----------
    current : float or None
        None where it was not recorded.
    unit : str
        "1" for a number without one.

    Returns
    -------
    str
        To a thousandth and three digits.

    Examples
    --------
    >>> amps(1.20002, "A"), amps(None, "A")
    ('1.2 A', '–')
    """
    return "–" if current is None else f"{round(current, 3) + 0.0:.3g} {'' if unit == '1' else unit}".strip()


def newtons(value: float, digits: int = 4, sign: str = "") -> str:
    """A force to so many significant digits, written out below a meganewton.

    Parameters
    ----------
    value : float
        [N]
    digits : int
    sign : str
        "+" prints the sign of a positive one too.

    Returns
    -------
    str
        Without the unit; a dash for NaN and infinities.

    Examples
    --------
    >>> newtons(-10837.4), newtons(533.62), newtons(103.0, 2), newtons(60.34, sign="+")
    ('-10840', '533.6', '100', '+60.34')
    """
    if not math.isfinite(value):
        return "–"
    text = f"{value:{sign}.{digits}g}"
    return f"{float(text):{sign}.0f}" if "e+" in text and abs(value) < 1e6 else text


def shortened(name: str, most: int = 20) -> str:
    """A long name with its middle left out.

    Parameters
    ----------
    name : str
    most : int
        Characters that are left.

    Returns
    -------
    str
        The name itself where it is no longer.

    Examples
    --------
    >>> shortened("t1_3_3_24_24_s5_n100_100psi_with_heat_gun"), shortened("S1")
    ('t1_3_3_24_…_heat_gun', 'S1')
    """
    return name if len(name) <= most else f"{name[: most // 2]}…{name[len(name) - most + most // 2 + 1:]}"


def speed_text(speed: float) -> str:
    """A speed in mm/s, whole from 100 on.

    Parameters
    ----------
    speed : float
        [m/s], at least zero.

    Returns
    -------
    str

    Examples
    --------
    >>> speed_text(1.0499), speed_text(0.0023)
    ('1050 mm/s', '2.3 mm/s')
    """
    mm = 1e3 * speed
    return f"{mm:.0f} mm/s" if mm >= 100 else f"{mm:.3g} mm/s"


def label_of(found: Readings, record: str, label: str) -> str:
    """A test's label, with its record where another record holds a test of the same label, specimen and current.

    Parameters
    ----------
    found : Readings
    record : str
        Its name.
    label : str
        As `Block.label`.

    Returns
    -------
    str
    """
    same = [b.run for b in found.blocks if b.label == label]
    own = {(r.specimen, r.level) for r in same if r.name == record}
    others = any(r.name != record and (r.specimen, r.level) in own for r in same)
    return f"{label}, {shortened(record)}" if others else label


def _currents_text(data: RecordPieces) -> str:
    """Which currents were held."""
    if not data.levels:
        return f"a moving {driver(data.current_unit)}" if any(r.current == "varies" for r in data.runs) else (
            "no recorded current")
    if len(data.levels) == 1:
        return f"{amps(data.levels[0], data.current_unit)}"
    return (f"{len(data.levels)} {driver(data.current_unit)}s, {amps(data.levels[0], data.current_unit)} to "
            f"{amps(data.levels[-1], data.current_unit)}")


def verdict(found: Readings) -> str:
    """What was measured, over which range, and whether it is inside its tolerance.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    str
    """
    names, pieces = {r.source for r in found.data.runs}, {r.name for r in found.data.runs}
    given = found.given
    count = f"{len(names)} record{'s' if len(names) > 1 else ''}"
    if len(pieces) > len(names):
        count += f" in {len(pieces)} pieces"
    specimens = len(found.data.specimens)
    if specimens > 1:
        count += f" of {specimens} specimens"
    if not given:
        text = (f"{count}, {_currents_text(found.data)}: none of the standard speeds is reached at constant "
                f"{driver(found.data.current_unit)}.")
    else:
        low, high = min(f.speed for f in given), max(f.speed for f in given)
        range_ = f"{high:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
        text = (f"{count}, {_currents_text(found.data)}: forces at {len({f.speed for f in given})} of "
                f"{len(found.settings.speeds)} standard speeds, {range_}." + _key_figures(found))
    if found.checks:
        out = sum(c.inside is False for c in found.checks)
        open_ = sum(c.inside is None for c in found.checks)
        text += (f" {out} of {len(found.checks)} forces outside the tolerance band" if out else
                 f" All {len(found.checks) - open_} decided forces inside the tolerance band")
        text += f", {open_} within two standard errors of a limit." if open_ else "."
    return text


def _key_figures(found: Readings) -> str:
    """Force ratios, switching times: each where the records hold it."""
    unit, stated = found.data.current_unit, []
    ratios = [r for r in found.ratios if not r.pushed]
    top = max(ratios, key=lambda r: r.speed, default=None)
    if top is not None:
        own = [r.ratio for r in ratios if (r.speed, r.current) == (top.speed, top.current)]
        low, high = f"{min(own):.2f}", f"{max(own):.2f}"
        range_ = low if len(own) == 1 else f"{low} to {high} over {len(own)} specimens"
        stated.append(f"force ratio rebound/compression {range_} at {top.speed:g} m/s"
                    + ("" if top.current is None or len(found.data.levels) < 2 else f" and {amps(top.current, unit)}"))
    if found.spreads:
        fastest = max(s.speed for s in found.spreads)
        own = [abs(f.force) for f in found.given if f.force is not None and f.current is not None
               and (f.direction, f.speed, f.specimen) == (1, fastest, found.spreads[0].specimen)]
        if len(own) > 1 and min(own) > 0:
            stated.append(f"force ratio hard/soft {max(own) / min(own):.2f} in rebound at {fastest:g} m/s")
    if found.switching:
        low, high = min(s.time for s in found.switching), max(s.time for s in found.switching)
        stated.append(f"switching {1e3 * low:.3g} to {1e3 * high:.3g} ms" if len(found.switching) > 1 else
                    f"switching {1e3 * low:.3g} ms")
    return f" {'; '.join(stated)[0].upper()}{'; '.join(stated)[1:]}." if stated else ""


def _static_line(found: Readings, test: StaticForce) -> str:
    """One slow test: whose, at which current and speed, and what its two directions give."""
    whose = f"{test.specimen}: " if len(found.data.specimens) > 1 else ""
    at = f"at {1e3 * test.speed:.3g} mm/s"
    if test.current is not None:
        at += f" and {amps(test.current, found.data.current_unit)}"
    rate = f"rate {1e-3 * test.rate:.3g} N/mm"
    if test.creep:
        return (f"{whose}{at} (creep): gas {newtons(test.gas)} ± {newtons(test.gas_std, 2)} N, {rate}, "
                f"friction {newtons(test.friction)} N")
    mean = -found.settings.sign * test.gas
    return (f"{whose}{at}, no creep: mean of both directions {newtons(mean, sign='+')} N (the gas, which pushes "
            f"outwards, and half the difference of their damping), {rate}, friction at most {newtons(test.friction)} N")


def summary(found: Readings) -> str:
    """Verdict, key numbers, what is missing.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    str
        Lines.
    """
    sign, unit = found.settings.sign, found.data.current_unit
    lines = [verdict(found)]
    lines += [f"  caveat: {c}" for c in found.data.caveats]
    for specimen, level in dict.fromkeys((f.specimen, f.current) for f in found.given):
        parts = []
        for direction, name in DIRECTIONS.items():
            own = [f for f in found.given if (f.specimen, f.current, f.direction) == (specimen, level, direction)]
            if own:
                top = max(own, key=lambda f: f.speed)
                parts.append(f"{name} {newtons(sign * (top.force or 0.0))} ± {newtons(top.std or 0.0, 2)} N at "
                             f"{top.speed:g} m/s")
        label = " ".join(p for p in (specimen, amps(level, unit) if level is not None else "") if p)
        lines.append(f"  {label + ': ' if label else ''}{', '.join(parts)}")
    lines += [f"  {_static_line(found, s)}" for s in found.static[:2]]
    for s in found.switching[:2]:
        lines.append(f"  switching {amps(s.low, unit)} to {amps(s.high, unit)}, {DIRECTIONS[s.direction]}: "
                     f"{1e3 * s.time:.3g} ± {1e3 * s.time_std:.2g} ms")
    lines = lines[:12]
    lines += [f"  missing: {m.what}: {m.why}; {m.run}" for m in found.missing[:4]]
    if len(found.missing) > 4:
        lines.append(f"  and {len(found.missing) - 4} more missing; see the report")
    return "\n".join(lines)
