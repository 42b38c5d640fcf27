"""Tables: forces.csv, characteristics.csv and the JSON of a characterisation."""

from __future__ import annotations

import csv
import io
from dataclasses import fields
from pathlib import Path
from typing import Any

from quartercar.characterisation.points import DIRECTIONS
from quartercar.characterisation.readings import Readings
from quartercar.characterisation.wording import verdict

SCHEMA = "quartercar/characterisation/1"


def forces_csv(found: Readings) -> str:
    """The force table; forces in the sign that was chosen. An earlier one serves as --nominal.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    str
        With a header; columns of the model and of the band only where there are these.
    """
    unit, sign = found.data.current_unit, found.settings.sign
    header = ["specimen", f"current [{unit}]", "direction", "speed [m/s]", "force [N]", "std_error [N]",
              "last_cycle [N]", "branch_difference [N]", "cycles", "method", "source", "why_none"]
    header += ["model [N]", "model_less_measured [N]"] if found.model else []
    bands = {id(c.force): c for c in found.checks}
    header += ["lower [N]", "upper [N]", "verdict"] if found.checks else []
    rows = []
    for f in found.forces:
        turned = [None if v is None else sign * v for v in (f.force, f.last)]
        row = [f.specimen, f.current, DIRECTIONS[f.direction], f.speed, turned[0], f.std, turned[1], f.hysteresis,
               f.cycles, f.method, f.source, f.why]
        if found.model:
            row += [None if f.modelled is None else sign * f.modelled,
                    None if f.modelled is None or f.force is None else sign * (f.modelled - f.force)]
        if found.checks:
            c = bands.get(id(f))
            row += [None, None, ""] if c is None else [c.lower, c.upper, {True: "inside", False: "outside",
                                                                          None: "undecided"}[c.inside]]
        rows.append(row)
    return _csv(header, rows)


def characteristics_csv(found: Readings) -> str:
    """Everything else, one quantity a row: group, where it was read, name, value, standard error, unit.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    str
        With a header; in SI.
    """
    header = ["group", "specimen", f"current [{found.data.current_unit}]", "source", "quantity", "value", "std_error",
              "unit", "remark"]
    rows: list[list[Any]] = []
    sign = found.settings.sign
    for p in found.peaks:
        rows.append(["peak velocity", p.block.run.specimen, p.block.run.level, f"{p.block.run.name}: {p.block.label}",
                     f"{DIRECTIONS[p.direction]} force at {p.speed:.6g} m/s", sign * p.force, p.std, "N", ""])
    for s in found.static:
        remark = "" if s.creep else f"not creep: {s.speed:.4g} m/s"
        gas = "" if s.creep else f"{remark}, with half of what the directions' damping differs by"
        friction = "at the test's speed" if s.creep else f"{remark}, an upper bound"
        where = ["static", s.specimen, s.current, f"{s.record}: {s.test}"]
        rows += [[*where, "gas force outwards at mid stroke", s.gas, s.gas_std, "N", gas],
                 [*where, "spring rate", s.rate, s.rate_std, "N/m", remark],
                 [*where, "friction", s.friction, s.friction_std, "N", friction]]
    for loop in found.loops:
        where = ["loop", loop.specimen, loop.current, f"{loop.record}: {loop.test}"]
        rows += [[*where, "energy per cycle", loop.energy, loop.energy_std, "J", ""],
                 [*where, "area of the force-velocity loop", loop.velocity_area, None, "W", ""],
                 [*where, "dynamic stiffness", loop.dynamic_stiffness, loop.stiffness_std, "N/m", ""],
                 [*where, "elastic stiffness", loop.elastic_stiffness, loop.stiffness_std, "N/m", ""],
                 [*where, "loss angle", loop.loss_angle, loop.loss_angle_std, "rad", ""],
                 [*where, "equivalent damping", loop.damping, None, "N*s/m", ""]]
    for r in found.ratios:
        rows.append(["ratio", r.specimen, r.current, "", f"rebound over compression at {r.speed:g} m/s", r.ratio, r.std,
                     "1", "; ".join(("the gas pushes more than one of them damps",) * r.pushed
                                    + (() if r.without_gas is None else (f"{r.without_gas:.6g} without gas force",)))])
    for s in found.spreads:
        rows.append(["spread", s.specimen, s.current, "", f"{DIRECTIONS[s.direction]} share at {s.speed:g} m/s",
                     s.share, s.share_std, "1", f"{s.off_line:+.4g} off a straight line"])
    for w in found.switching:
        where = ["switching", w.specimen, None, f"{w.record}: {w.low:.4g} to {w.high:.4g}, {DIRECTIONS[w.direction]} "
                 f"{w.speed:.3g} m/s"]
        rows += [[*where, "switching time", w.time, w.time_std, "s", f"{w.events} steps"],
                 [*where, "settling time", w.settling, None, "s", ""], [*where, "dip", w.dip, None, "1", ""],
                 [*where, "overshoot", w.overshoot, None, "1", ""]]
    for d in found.drifts:
        where = ["drift", d.specimen, d.current, f"{d.record}: {d.test}"]
        rows += [[*where, f"{DIRECTIONS[d.direction]} change over {d.cycles} cycles", d.change, d.change_std, "1", ""],
                 [*where, f"{DIRECTIONS[d.direction]} per kelvin", d.per_kelvin, d.per_kelvin_std, "1/K", ""]]
    return _csv(header, [r for r in rows if r[5] is not None])


def histogram_csv(found: Readings) -> str:
    """Classes of the velocity histograms.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    str
        With a header; velocities in m/s.
    """
    rows = [[h.record, low, high, share] for h in found.histograms
            for low, high, share in zip(h.edges[:-1], h.edges[1:], h.share, strict=True)]
    return _csv(["record", "from [m/s]", "to [m/s]", "share of time"], rows)


def write_tables(found: Readings, folder: str | Path) -> list[Path]:
    """forces.csv, characteristics.csv and, with random motion, velocity_histogram.csv.

    Parameters
    ----------
    found : Readings
    folder : str or Path
        Made where it is missing.

    Returns
    -------
    list of Path
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in named_tables(found).items():
        (folder / name).write_text(text, encoding="utf-8", newline="")
        written.append(folder / name)
    return written


def named_tables(found: Readings) -> dict[str, str]:
    """CSV text by file name.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    dict of str to str
        Histograms only where there are some.
    """
    named = {"forces.csv": forces_csv(found), "characteristics.csv": characteristics_csv(found)}
    return {**named, "velocity_histogram.csv": histogram_csv(found)} if found.histograms else named


def to_dict(found: Readings) -> dict[str, Any]:
    """Plain data for JSON.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    dict
        In SI, forces positive in tension; those against a tolerance band in the sign that was chosen.
    """
    return {
        "schema": SCHEMA, "verdict": verdict(found), "convention": "SI; displacement positive in extension, force "
        "positive in tension; direction 1 rebound, -1 compression", "caveats": list(found.data.caveats),
        "current_unit": found.data.current_unit, "currents": list(found.data.levels),
        "records": [{"name": r.name, "specimen": r.specimen, "current": r.level, "current_kind": r.current,
                     "sample_rate": 1.0 / r.period, "duration": r.duration}
                    for r in found.data.runs],
        "blocks": [{"record": b.run.name, "kind": b.kind, "frequency": b.frequency, "amplitude": b.amplitude,
                    "peak_speed": b.peak, "cycles": len(b.cycles), "distortion": b.distortion} for b in found.blocks],
        "peak_velocity": [{"record": p.block.run.name, "test": p.block.label, "specimen": p.block.run.specimen,
                           "current": p.block.run.level, "direction": p.direction, "speed": p.speed, "force": p.force,
                           "std": p.std, "spread": p.spread} for p in found.peaks],
        "forces": [_plain(f) for f in found.forces], "static": [_plain(s) for s in found.static],
        "loops": [_plain(x) for x in found.loops], "ratios": [_plain(r) for r in found.ratios],
        "spreads": [_plain(s) for s in found.spreads],
        "switching": [_plain(s, ("times", "response")) for s in found.switching],
        "drift": [_plain(d) for d in found.drifts],
        "histograms": [{**_plain(h, ("edges", "share")), "edges": h.edges.tolist(), "share": h.share.tolist()}
                       for h in found.histograms],
        "tolerance": [{**_plain(c, ("force",)), "specimen": c.force.specimen, "current": c.force.current,
                       "direction": c.force.direction, "speed": c.force.speed,
                       "force": found.settings.sign * (c.force.force or 0.0)} for c in found.checks],
        "specimens": [_plain(s) for s in found.specimens], "missing": [_plain(m) for m in found.missing],
        "model": found.model or None, "notes": [*found.data.notes, *found.notes],
    }


def _plain(row: Any, without: tuple[str, ...] = ()) -> dict[str, Any]:
    return {f.name: getattr(row, f.name) for f in fields(row) if f.name not in without}


def _csv(header: list[str], rows: list[list[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([["" if v is None or v != v else f"{v:.9g}" if isinstance(v, float) else v for v in row]
                      for row in rows])
    return out.getvalue()
