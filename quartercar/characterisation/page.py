"""The page: sections, tables and figures of a characterisation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lpvid.report import Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section, number
from lpvid.units import driver
from quartercar.characterisation.currents import worst_off_line
from quartercar.characterisation.figures import Drawn, figures_of
from quartercar.characterisation.points import DIRECTIONS
from quartercar.characterisation.readings import Readings
from quartercar.characterisation.wording import amps, label_of, newtons, shortened, verdict

OPEN = 12
"""Rows above which a table of tests is folded."""


def characterisation_page(found: Readings, figures: Sequence[Drawn] | None = None) -> Page:
    """A page about a characterisation.

    Parameters
    ----------
    found : Readings
    figures : sequence of Drawn, optional
        As `figures_of` gives them; drawn here where left out.

    Returns
    -------
    Page
    """
    drawn = {f.name: PageFigure.of(f.figure, f.caption) for f in (figures_of(found) if figures is None else figures)}

    def shown(name: str) -> list[Item]:
        return [drawn[name]] if name in drawn else []

    def table(rows: Sequence[Any], made: Callable[[Readings], list[Item]]) -> list[Item]:
        return made(found) if rows else []

    word = driver(found.data.current_unit)
    sections = [
        Section("Forces at standard speeds", (*_forces(found), *table(found.ratios, _ratio))),
        Section("Peak velocity", (*shown("peak_velocity"), *table(found.peaks, _peaks))),
        Section("Continuous velocity and loops", (*shown("continuous_velocity"), *shown("force_displacement"))),
        Section("Gas force, spring rate, friction", (*table(found.static, _static), *shown("static"))),
        Section("Hysteresis and energy", (*table(found.loops, _loops), *shown("stiffness"))),
        Section(f"Over the {word}", (*shown("by_current"), *table(found.spreads, _spreads))),
        Section("Switching time", (*table(found.switching, _switching), *shown("switching"))),
        Section("Drift and temperature", (*table(found.drifts, _drift), *shown("drift"))),
        Section("Velocity histogram", (*shown("velocity_histogram"), *table(found.histograms, _histogram))),
        Section("Tolerance and specimens", (*table(found.checks, _tolerance), *shown("specimens"),
                                            *table(found.specimens, _specimens))),
        Section("Not in these records", _missing(found)),
        Section("Tests and remarks", _tests(found)),
    ]
    out = any(c.inside is False for c in found.checks)
    mark: Mark = "bad" if out else "good" if found.checks else "plain" if found.given else "warn"
    return Page("Damper characteristics", verdict(found), mark, _facts(found), found.data.caveats,
                tuple(s for s in sections if s.items), _steps(found))


def _steps(found: Readings) -> tuple[NextStep, ...]:
    """Run what is missing, then a model."""
    missing = (NextStep("Run the tests that 'Not in these records' lists: each names the quantity it gives."),)
    return (*(missing if found.missing else ()),
            NextStep("Fit damper laws to these records and rank them.", "quartercar fit DATA --out fit"),
            NextStep("Find what such a law leaves out.", "lpvid diagnose DATA --baseline guo --out diagnosis"))


def _value(value: float | None, std: float | None, digits: int = 4) -> str:
    """A value with its standard error: to the error's second digit, but no more than one digit beyond `digits`."""
    if value is None or not np.isfinite(value):
        return "–"
    if std is None or not np.isfinite(std) or std <= 0:
        return number(value, digits)
    most = digits - int(np.floor(np.log10(max(abs(value), std))))  # decimals that `digits` + 1 figures have
    places = int(np.clip(min(1 - np.floor(np.log10(std)), most), 0, 9))
    error = max(std, 10.0**-places)
    return f"{value + 0.0:.{places}f} ± {error:.{places}f}"


def _where(found: Readings, specimen: str, current: float | None) -> str:
    parts = [specimen, "" if current is None else amps(current, found.data.current_unit)]
    return ", ".join(p for p in parts if p) or "all"


def _first(found: Readings) -> str:
    """Heading of the column that `_where` fills."""
    if all(f.current is None for f in found.forces):
        return "records" if len(found.data.specimens) < 2 else "specimen"
    word = driver(found.data.current_unit)
    return word if len(found.data.specimens) < 2 else f"specimen, {word}"


def _test(label: str) -> str:
    """A test's label that breaks only behind its comma."""
    return label.replace(", ", "|").replace(" ", "\u00a0").replace("|", ", ")


def _facts(found: Readings) -> tuple[tuple[str, str], ...]:
    sign, unit = found.settings.sign, found.data.current_unit
    facts: list[tuple[str, str]] = []
    keys = list(dict.fromkeys((f.specimen, f.current) for f in found.given))
    for key in dict.fromkeys((keys[0], keys[-1])) if keys else ():
        own = [f for f in found.given if (f.specimen, f.current) == key]
        for direction, name in DIRECTIONS.items():
            best = max((f for f in own if f.direction == direction), key=lambda f: f.speed, default=None)
            if best is not None and best.force is not None:
                label = f"{name}, {best.speed:g} m/s"
                label += f", {_where(found, shortened(key[0], 14), key[1])}" if len(keys) > 1 else ""
                facts.append((label, f"{newtons(sign * best.force)} N"))
    creep = next((s for s in found.static if s.creep), None)
    if creep is not None:
        at = "" if creep.current is None or len(found.data.levels) < 2 else f", {amps(creep.current, unit)}"
        facts += [(f"gas force at mid stroke{at}", f"{newtons(creep.gas)} N"),
                  (f"friction at {1e3 * creep.speed:.2g} mm/s{at}", f"{newtons(creep.friction, 3)} N")]
    for s in found.switching[:2]:
        facts.append((f"switching {amps(s.low, unit)} → {amps(s.high, unit)}", f"{1e3 * s.time:.3g} ms"))
    return tuple(facts)


def _forces(found: Readings) -> list[Item]:
    if not found.forces:
        word = driver(found.data.current_unit)
        return [Paragraph(f"No force at a constant {word}: see what is not in these records.")]
    sign = found.settings.sign
    keys = list(dict.fromkeys((f.specimen, f.current, f.direction) for f in found.forces))
    at = {(f.specimen, f.current, f.direction, f.speed): f for f in found.forces}
    speeds = [v for v in found.settings.speeds if any(f.speed == v for f in found.given)]
    if not speeds:
        return [Paragraph("None of the standard speeds is reached.")]
    rows = []
    for key in keys:
        cells = [at[(*key, v)] for v in speeds]
        rows.append((_where(found, *key[:2]), DIRECTIONS[key[2]], *(
            "–" if f.force is None else newtons(sign * f.force) for f in cells)))
    worst = max((f for f in found.given if f.std), key=lambda f: f.std or 0.0, default=None)
    caption = (f"Force [N], rebound {found.settings.rebound}; mean of the branches of rising and falling speed, of the "
               "slowest test that reaches the speed. A dash: not reached.")
    if worst is not None:
        caption += f" Largest standard error {number(worst.std, 2)} N; each is listed below."
    items: list[Item] = [PageTable((_first(found), "direction",
                                *(f"{v:g} m/s" for v in speeds)), tuple(rows), caption,
                               tuple(range(2, 2 + len(speeds))))]
    if found.model:
        rows = [(_where(found, *key[:2]), DIRECTIONS[key[2]], *(
            "–" if f.modelled is None or f.force is None else f"{sign * (f.modelled - f.force):+.3g}"
            for f in (at[(*key, v)] for v in speeds))) for key in keys]
        items.append(PageTable((_first(found), "direction", *(f"{v:g} m/s" for v in speeds)), tuple(rows),
                           f"{found.model} (free run) less measured [N], by the same estimator.",
                           tuple(range(2, 2 + len(speeds)))))
    detail = tuple((_where(found, f.specimen, f.current), DIRECTIONS[f.direction], f"{f.speed:g}",
                    _value(sign * (f.force or 0.0), f.std), "–" if f.last is None else newtons(sign * f.last),
                    number(f.hysteresis, 3), str(f.cycles or "–"), f.source) for f in found.given)
    items.append(PageTable(
        (_first(found), "direction", "speed [m/s]", "force [N]", "last cycle [N]", "branch difference [N]", "cycles",
         "read from"), detail, "Branch difference: force while the speed rises minus the force while it falls.",
        (2, 3, 4, 5, 6), folded=f"Where each of the {len(detail)} forces was read"))
    return items


def _ratio(found: Readings) -> list[Item]:
    gas = any(r.without_gas is not None for r in found.ratios)
    pushed = any(r.pushed for r in found.ratios)
    rows = tuple((_where(found, r.specimen, r.current), f"{r.speed:g}", "–" if r.pushed else _value(r.ratio, r.std, 3),
                  *((number(r.without_gas, 3),) if gas else ())) for r in found.ratios)
    return [PageTable((_first(found), "speed [m/s]", "rebound / compression", *(("without gas force",) if gas else ())),
                  rows,
                  "Rebound over compression force, both as magnitudes."
                  + (" A dash: the gas pushes more than one of them damps." if pushed else ""),
                  (1, 2, 3) if gas else (1, 2),
                  folded=f"Rebound over compression, {len(rows)} rows" if len(rows) > OPEN else "")]


def _peaks(found: Readings) -> list[Item]:
    sign = found.settings.sign
    rows = tuple((_where(found, p.block.run.specimen, p.block.run.level),
                  _test(label_of(found, p.block.run.name, p.block.label)), DIRECTIONS[p.direction],
                  f"{1e3 * p.speed:.4g}", _value(sign * p.force, p.std), number(p.spread, 2),
                  str(len(p.block.settled))) for p in sorted(found.peaks, key=lambda p: (
                      p.block.run.specimen, -np.inf if p.block.run.level is None else p.block.run.level, p.speed)))
    return [PageTable((_first(found), "test", "direction", "speed [mm/s]", "force [N]", "between cycles [N]", "cycles"),
                  rows,
                  "Force at mid stroke by test, mean over the settled cycles.", (3, 4, 5, 6),
                  folded=f"{len(rows)} peak-velocity points" if len(rows) > OPEN else "")]


def _static(found: Readings) -> list[Item]:
    rows, marks = [], []
    for s in found.static:
        rows.append((_where(found, s.specimen, s.current), _test(label_of(found, s.record, s.test)),
                     f"{1e3 * s.speed:.3g}",
                     _value(s.gas, s.gas_std), _value(1e-3 * s.rate, 1e-3 * s.rate_std, 3),
                     ("" if s.creep else "≤ ") + _value(s.friction, s.friction_std)))
        marks.append("plain" if s.creep else "warn")
    items: list[Item] = [PageTable(
        (_first(found), "test", "speed [mm/s]", "gas force, outwards [N]", "spring rate [N/mm]", "friction [N]"),
        tuple(rows), "Gas force: the mean of the two directions at one place, counted outwards. Friction: half "
        "their difference, which includes the damping at the speed of the test and the yield force of a "
        "magnetorheological fluid.", (2, 3, 4, 5), tuple(marks))]
    if not all(s.creep for s in found.static):
        items.append(Paragraph("Marked rows are faster than 10 mm/s, or still hold damping that a slower test "
                               "does not. Their friction is an upper bound. Their gas force "
                               "includes half the difference between the damping forces of the two directions."))
    return items


def _loops(found: Readings) -> list[Item]:
    rows = tuple((_where(found, x.specimen, x.current), _test(label_of(found, x.record, x.test)),
                  _value(x.energy, x.energy_std, 3),
                  "–" if x.loss_angle is None else f"{np.degrees(x.loss_angle):.1f}",
                  number(None if x.dynamic_stiffness is None else 1e-3 * x.dynamic_stiffness, 3),
                  number(None if x.elastic_stiffness is None else 1e-3 * x.elastic_stiffness, 3),
                  number(None if x.damping is None else 1e-3 * x.damping, 3), number(x.velocity_area, 3))
                 for x in sorted(found.loops, key=lambda x: (x.specimen, -np.inf if x.current is None else x.current,
                                                             x.frequency)))
    return [PageTable((_first(found), "test", "energy per cycle [J]", "loss angle [°]", "dynamic stiffness [N/mm]",
                   "elastic stiffness [N/mm]", "equivalent damping [N·s/mm]", "F-v loop area [W]"), rows,
                  "Energy: area of the force-displacement loop. Stiffness of the fundamentals, K* = F₁/x₁; elastic "
                  "is its real part.", (2, 3, 4, 5, 6, 7), folded=f"{len(rows)} tests" if len(rows) > 2 * OPEN else "")]


def _spreads(found: Readings) -> list[Item]:
    items: list[Item] = []
    word = driver(found.data.current_unit)
    worst = worst_off_line(found.spreads)
    if worst is not None and abs(worst.off_line) > 2 * worst.share_std:
        items.append(Paragraph(f"Furthest from a straight line over the {word}: {100 * worst.off_line:+.0f} % of the "
                               f"spread at {amps(worst.current, found.data.current_unit)}, "
                               f"{DIRECTIONS[worst.direction]} {worst.speed:g} m/s."))
    rows = []
    for specimen, direction, speed in dict.fromkeys((s.specimen, s.direction, s.speed) for s in found.spreads):
        own = {f.current: abs(f.force) for f in found.given if (f.specimen, f.direction, f.speed) ==
               (specimen, direction, speed) and f.force is not None and f.current is not None}
        shares = {s.current: s for s in found.spreads if (s.specimen, s.direction, s.speed) ==
                  (specimen, direction, speed)}
        soft, hard = min(own.values()), max(own.values())
        rows.append((*((specimen,) if specimen else ()), DIRECTIONS[direction], f"{speed:g}", f"{hard - soft:.4g}",
                     number(hard / soft if soft > 0 else None, 3),
                     *(f"{100 * shares[level].share:z.1f}" if level in shares else "–"
                       for level in found.data.levels)))
    first = ("specimen",) if any(s.specimen for s in found.spreads) else ()
    start = len(first)
    items.append(PageTable((*first, "direction", "speed [m/s]", "hard − soft [N]", "hard / soft",
                        *(f"{amps(level, found.data.current_unit)} [%]" for level in found.data.levels)), tuple(rows),
                       f"Place of each {word} between the softest and the hardest, (F − F_soft)/(F_hard − F_soft).",
                       tuple(range(start + 1, start + 4 + len(found.data.levels)))))
    return items


def _switching(found: Readings) -> list[Item]:
    unit = found.data.current_unit
    rows = tuple((f"{amps(s.low, unit)} → {amps(s.high, unit)}", DIRECTIONS[s.direction], f"{1e3 * s.speed:.3g}",
                  _value(1e3 * s.time, 1e3 * s.time_std), number(1e3 * s.spread, 2),
                  number(None if s.settling is None else 1e3 * s.settling, 3), f"{100 * s.dip:.1f}",
                  f"{100 * s.overshoot:.1f}", number(s.step, 4), str(s.events)) for s in found.switching)
    return [PageTable(("step", "direction", "speed [mm/s]", "t(F90) − t(I10) [ms]", "between steps [ms]",
                   "settled after [ms]", "dip [%]", "overshoot [%]", "step of the force [N]", "steps"), rows,
                  f"From 10 % of the {driver(unit)}'s step to 90 % of the force's, at steady speed, from the samples "
                  "as measured. ± holds the clock's resolution. Settled: within 5 % for good. Delays of sensors and "
                  "filters are in it unless given with --delay.", (2, 3, 4, 5, 6, 7, 8, 9))]


def _drift(found: Readings) -> list[Item]:
    rows = tuple((_where(found, d.specimen, d.current), _test(label_of(found, d.record, d.test)),
                  DIRECTIONS[d.direction], str(d.cycles),
                  number(d.duration, 3), _value(100 * d.change, 100 * d.change_std, 2),
                  "–" if d.coolest is None or d.warmest is None else
                  f"{d.coolest - 273.15:.1f} … {d.warmest - 273.15:.1f}",
                  _value(None if d.per_kelvin is None else 100 * d.per_kelvin,
                        None if d.per_kelvin_std is None else 100 * d.per_kelvin_std, 2)) for d in found.drifts)
    return [PageTable((_first(found), "test", "direction", "cycles", "over [s]", "change of |F| [%]",
                       "temperature [°C]", "per kelvin [%/K]"), rows,
                      "Trend of the force at mid stroke over the settled cycles.", (3, 4, 5, 6, 7),
                      folded=f"{len(rows)} trends" if len(rows) > OPEN else "")]


def _histogram(found: Readings) -> list[Item]:
    rows = tuple((h.record, number(h.duration, 3), f"{1e3 * h.rms:.3g}", f"{1e3 * h.largest:.3g}",
                  f"{100 * h.slow:.1f}", f"{100 * (h.below + h.above):.2f}",
                  " / ".join(f"{1e3 * q:z.0f}" for q in h.quantiles), number(h.power, 3)) for h in found.histograms)
    return [PageTable(("record", "length [s]", "rms [mm/s]", "largest [mm/s]", "below 50 mm/s [% of time]",
                   "beyond ±250 mm/s [% of time]", "1 / 5 / 50 / 95 / 99 % [mm/s]", "mean power [W]"), rows,
                  "Records without periodic motion.", (1, 2, 3, 4, 5, 6, 7))]


def _tolerance(found: Readings) -> list[Item]:
    sign = found.settings.sign
    words: dict[bool | None, tuple[str, Mark]] = {True: ("inside", "good"), False: ("outside", "bad"),
                                                  None: ("undecided", "warn")}
    ordered = sorted(found.checks, key=lambda c: {False: 0, None: 1, True: 2}[c.inside])
    rows = tuple((_where(found, c.force.specimen, c.force.current), DIRECTIONS[c.force.direction], f"{c.force.speed:g}",
                  _value(sign * (c.force.force or 0.0), c.force.std), number(c.nominal), number(c.lower),
                  number(c.upper), words[c.inside][0]) for c in ordered)
    return [PageTable((f"specimen, {driver(found.data.current_unit)}", "direction", "speed [m/s]", "force [N]",
                   "nominal [N]", "lower [N]", "upper [N]", "verdict"), rows,
                  "Undecided: within two standard errors of a limit.", (2, 3, 4, 5, 6),
                  tuple(words[c.inside][1] for c in ordered),
                  folded=f"{len(rows)} forces against their bands" if len(rows) > 2 * OPEN else "")]


def _specimens(found: Readings) -> list[Item]:
    sign = found.settings.sign
    rows = tuple((amps(s.current, found.data.current_unit), DIRECTIONS[s.direction], f"{s.speed:g}",
                  number(sign * s.mean), number(s.std, 3),
                  f"{100 * s.std / abs(s.mean):.2f}" if s.mean else "–", number(s.within, 2),
                  f"{shortened(s.lowest[0])} ({sign * s.lowest[1]:.4g})",
                  f"{shortened(s.highest[0])} ({sign * s.highest[1]:.4g})",
                  str(s.count)) for s in found.specimens)
    return [PageTable((driver(found.data.current_unit), "direction", "speed [m/s]", "mean [N]",
                   "std between specimens [N]", "[%]",
                   "of which measurement [N]", "weakest", "strongest", "specimens"), rows,
                  "Specimen-to-specimen spread.", (2, 3, 4, 5, 6, 9),
                  folded=f"{len(rows)} rows" if len(rows) > 2 * OPEN else "")]


def _missing(found: Readings) -> tuple[Item, ...]:
    if not found.missing:
        return (Paragraph("Everything that this page can hold is in these records."),)
    return (Paragraph("Nothing here is guessed. What is missing, why, and the test that gives it:"),
            Notes(tuple(f"{m.what[0].upper()}{m.what[1:]}: {m.why}. To have it, {m.run}." for m in found.missing)))


def _tests(found: Readings) -> tuple[Item, ...]:
    rows = []
    for run in found.data.runs:
        own = [b for b in found.blocks if b.run is run]
        what = "; ".join(f"{b.label}, {len(b.cycles)} cycles" for b in own) or "no periodic motion"
        kind = {"varies": "moving", "none": "–"}.get(run.current, amps(run.level, found.data.current_unit))
        rows.append((run.name, run.specimen or "–", kind, f"{1.0 / run.period:.5g}",
                     f"{run.duration:.3g}", what))
    table = PageTable(("record", "specimen", driver(found.data.current_unit), "rate [Hz]", "length [s]",
                   "what it holds"), tuple(rows),
                  "Records as used.", (3, 4), folded=f"{len(rows)} records" if len(rows) > OPEN else "")
    lines = (*found.data.notes, *found.notes, *_conventions(any(r.held is not None for r in found.data.runs)))
    return table, Notes(tuple(lines))


def _conventions(held: bool) -> tuple[str, ...]:
    stepped = ("Where a record holds several levels of the current, the first cycle after a step of the current is "
               "left out of means too, if the level lasts for more than two cycles: the force is still on its way. The "
               "length of such a row is that of the cycles at its level.",)
    return ("A cycle goes from one upward passage of mid stroke to the next; three or more in a row with period and "
            "amplitude within 5 % make a test, and its first cycle is left out of means.",
            "Along a sine, velocity is the derivative of the Fourier series of the displacement, so that no sensor or "
            "filter delays it against the displacement.",
            *(stepped if held else ()),
            "Displacement is positive in extension (rebound), force in tension; the force of the gas pushes outwards.")
