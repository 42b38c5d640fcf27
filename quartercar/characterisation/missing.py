"""Missing: what the records do not hold, why, and which test gives it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.units import driver
from quartercar.characterisation.drift import ENOUGH
from quartercar.characterisation.forces import Between, TooSlow, propose_sine, round_down
from quartercar.characterisation.readings import Missing, Readings
from quartercar.characterisation.settings import CREEP

if TYPE_CHECKING:
    from quartercar.characterisation.forces import StandardForce
    from quartercar.characterisation.tolerance import Tolerance

CREEP_TEST = "run a triangle of ±2 mm at 1 mm/s (three cycles), at each current"


def missing_of(found: Readings, refused: tuple[str, ...]) -> tuple[Missing, ...]:
    """All that is not on the page.

    Parameters
    ----------
    found : Readings
    refused : tuple of str
        Why runs with moving current gave no switching time.

    Returns
    -------
    tuple of Missing
        In the order of the page; empty where it holds everything.
    """
    rows = [*_forces(found), *_static(found), *_loops(found), *_currents(found), *_switching(found, refused)]
    if not found.histograms:
        rows.append(Missing("velocity histogram", "all records are periodic",
                            "record a drive, or play a road on the rig, for 30 s or more"))
    if not found.drifts:
        rows.append(Missing("drift over the cycles", f"no test of {ENOUGH} settled cycles at constant current, whose "
                            "force is not zero at mid stroke", "run 100 cycles of one sine at constant current"))
    if not any(d.per_kelvin is not None for d in found.drifts):
        have = any(r.temperature is not None for r in found.data.runs)
        why = "the temperature does not rise by more than its scatter in any block of five cycles" if have else (
            "no channel 'temperature'")
        rows.append(Missing("temperature coefficient", why, "record the wall temperature over 100 cycles of one sine" if
                            have else "record the wall temperature beside the force (--role temperature=CHANNEL)"))
    if not found.specimens:
        rows.append(Missing("spread between specimens", "no force of two specimens at one speed" if
                            len(found.data.specimens) > 1 else "these records are of one specimen",
                            "run the same tests on more specimens, named by --specimen; --tolerance 10%+20N "
                            "--nominal TABLE.csv compares a single one with its nominal forces"))
    if driver(found.data.current_unit) == "voltage":  # the texts name the current, whose part it plays
        rows = [Missing(*(re.sub(r"\bcurrent", "voltage", text) for text in (row.what, row.why, row.run)))
                for row in rows]
    return tuple(rows)


def unchecked_band(forces: Sequence[StandardForce], tolerance: Tolerance) -> tuple[Missing, ...]:
    """Why no force has a band, though a tolerance was given.

    Parameters
    ----------
    forces : sequence of StandardForce
    tolerance : Tolerance

    Returns
    -------
    tuple of Missing
    """
    if not any(f.force is not None for f in forces):
        why, run = "no force at a standard speed", "see there"
    elif tolerance.nominal:
        why = "the table of nominal forces holds none of these speeds, directions and currents"
        run = "--nominal with a row for each (speed, direction, current, force)"
    else:
        why = "a percentage is one of the mean over specimens, and these records are of one"
        run = "the same tests on more specimens (named by --specimen), or --nominal TABLE.csv"
    return (Missing("tolerance band", why, run),)


def _sines(speeds: Sequence[float]) -> str:
    return "run sines: " + "; ".join(f"{v:g} m/s: {propose_sine(v).removeprefix('run a sine of ')}" for v in speeds)


def _forces(found: Readings) -> list[Missing]:
    if not found.forces:
        return [Missing("forces at standard speeds", "the current moves in all records with a force",
                        f"{propose_sine(found.settings.speeds[-1])} at a constant current")]
    rows = []
    lacking = [f for f in found.forces if f.force is None]
    whole = {v: sum(f.speed == v for f in found.forces) for v in found.settings.speeds}
    short = {v: [f for f in lacking if f.speed == v] for v in found.settings.speeds}
    never, between = ([v for v in found.settings.speeds if short[v] and len(short[v]) == whole[v]
                       and all(isinstance(f.why, kind) for f in short[v])] for kind in (TooSlow, Between))
    if never:
        fastest = max(float(np.quantile(np.abs(r.velocity), 0.999)) for r in found.data.runs)
        rows.append(Missing(f"forces at {', '.join(f'{v:g}' for v in never)} m/s", "no test is as fast: the "
                            f"fastest reaches {fastest:.3g} m/s", f"{_own_speeds(found)}{_sines(never)}"))
    if between:
        rows.append(Missing(f"forces at {', '.join(f'{v:g}' for v in between)} m/s", "the triangles have one speed "
                            "each, and none of these", _sines(between)))
    for speed in found.settings.speeds:
        if speed in (*never, *between) or not short[speed]:
            continue
        own, which = short[speed], ""
        if len(own) < whole[speed]:
            several = len(found.data.specimens) > 1
            names = dict.fromkeys(f.specimen for f in own)
            which = f" of {', '.join(names)}" if several else ""
            which += f" ({len(own)} of {whole[speed]} {'specimens, ' if several else ''}directions and currents)"
        why, _, run = own[0].why.partition(": ")
        rows.append(Missing(f"force at {speed:g} m/s{which}", why, run))
    return rows


def _own_speeds(found: Readings) -> str:
    """Where the records reach no speed of the table, those that they do reach: a device of another size."""
    peaks = sorted({round_down(b.peak) for b in found.blocks if b.run.has_force})
    if found.given or not peaks:
        return ""
    chosen = dict.fromkeys((peaks[0], peaks[len(peaks) // 2], peaks[-1]))
    return f"name speeds of these tests, --speeds {','.join(f'{v:g}' for v in chosen)}, or "


def _static(found: Readings) -> list[Missing]:
    if any(s.creep for s in found.static):
        return []
    slow = min((s.speed for s in found.static), default=None)
    why = "no record of constant current and constant speed below 10 mm/s"
    if slow is not None and slow <= CREEP:
        return [Missing("gas force, spring rate and friction at creep", "at the slowest steady test's "
                        f"{1e3 * slow:.3g} mm/s the force is damping for the most part: it grows with the speed, to "
                        "the next faster test", f"run a triangle of ±2 mm at {100 * slow:.1g} mm/s (three cycles)")]
    if slow is not None:
        why += (f"; the slowest steady test reaches {1e3 * slow:.3g} mm/s: half its difference bounds the friction, "
                "its mean holds what the dampings of the two directions differ by")
    return [Missing("gas force, spring rate and friction at creep", why, CREEP_TEST)]


def _loops(found: Readings) -> list[Missing]:
    frequencies = {round(loop.frequency, 2) for loop in found.loops if loop.loss_angle is not None}
    if not frequencies:
        return [Missing("loss angle, dynamic and elastic stiffness", "no sine of three or more like cycles at constant "
                        "current", "run sines of one amplitude, e.g. ±5 mm at 1, 2, 5 and 10 Hz, five cycles each")]
    if len(frequencies) == 1:
        return [Missing("hysteresis over frequency", f"one frequency only, {frequencies.pop():g} Hz",
                        "run the same amplitude at two more frequencies")]
    return []


def _currents(found: Readings) -> list[Missing]:
    if found.spreads:
        return []
    kinds = {r.current for r in found.data.runs}
    if kinds == {"none"}:
        why, run = "no channel 'current'", "record the current (--role current=CHANNEL); none for a passive damper"
    elif len(found.data.levels) < 2:
        why = f"{len(found.data.levels)} constant current" + ("" if len(found.data.levels) == 1 else "s")
        run = "run the same sines at three or more constant currents, from soft to hard"
    else:
        why, run = "no speed that two currents reach", "run the same sine at every current"
    return [Missing("spread and linearity over the current", why, run)]


def _switching(found: Readings, refused: tuple[str, ...]) -> list[Missing]:
    if found.switching:
        return []
    why = refused[0] if refused else "the current does not step in any record"
    return [Missing("switching time", why, "run a triangle of ±20 mm at 0.1 m/s, step the current between soft and "
                    "hard once per stroke, hold each level for 100 ms or more, and record at 5 kHz or more")]
