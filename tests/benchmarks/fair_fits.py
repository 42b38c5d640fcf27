"""Independent fits of the real records: which physical parts the data support, by held-out error.

    python tests/benchmarks/fair_fits.py FOLDER [GROUP ...]
    python tests/benchmarks/fair_fits.py FOLDER [GROUP ...] --siblings
    python tests/benchmarks/fair_fits.py FOLDER [GROUP ...] --draw SEED

Plain numpy and scipy on the laws of `fair_laws`; the project's models, effects and engine are not used. Every
structure is a set of named terms; its nonlinear parameters are fitted by least squares from several starts, the linear
ones solved for (variable projection). The error is of the free run, over the variance of the force, the first quarter
of a second of each record left out. ``--siblings`` takes other records of the same specimens
(`real_records.siblings`), and of each the best structure of its group; ``--draw`` parts drawn anew
(`real_records.drawn`).
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import real_answers
import real_records
from fair_laws import BRANCH, advanced, branch, lagged, presliding
from scipy.optimize import least_squares
from scipy.signal import butter, decimate, sosfiltfilt

HEAD = 0.25
"""s of each record on which no error is counted"""
RATE = 500.0
"""Hz to which records beyond twice that are decimated, but for those whose motion reaches further"""
KEPT = ("bouc-wen", "silverbox")
CORNER = {"race": 40.0, "labcontrol": 12.0}
"""Hz of the zero-phase low-pass before a displacement is differentiated: well above the motion's harmonics"""


@dataclass(frozen=True, eq=False)
class Run:
    """One record in scaled units: velocity over V, displacement over X, force over F, current over I."""

    v: np.ndarray
    x: np.ndarray
    a: np.ndarray
    i: np.ndarray
    force: np.ndarray
    dt: float
    heat: np.ndarray

    def since(self, first: float = HEAD) -> slice:
        """Samples on which the error is counted, from a time on [s]."""
        return slice(round(first / self.dt), None)


@dataclass(frozen=True)
class Scales:
    """What one unit of a scaled quantity is: m/s, m, N, A."""

    velocity: float
    displacement: float
    force: float
    current: float


def runs(folder: Path, group: real_records.Group, held_out: bool) -> list[dict[str, np.ndarray]]:
    """Channels in SI units at the rate of the fit, the velocity derived where it was not measured."""
    return [_prepared(real_records.read(folder, p), group) for p in (group.held_out if held_out else group.training)]


def _prepared(raw: dict[str, np.ndarray], group: real_records.Group) -> dict[str, np.ndarray]:
    time = raw["time"]
    rate = (time.size - 1) / float(time[-1] - time[0])
    even = time[0] + np.arange(int((time[-1] - time[0]) * rate) + 1) / rate
    channels = {k: np.interp(even, time, y) for k, y in raw.items() if k != "time"}
    factor = 1 if (group.of or group.name) in KEPT else max(1, round(rate / RATE))
    if factor > 1:
        channels = {k: decimate(y, factor, ftype="fir", zero_phase=True) for k, y in channels.items()}
    rate /= factor
    if "displacement" in channels and "velocity" not in channels:
        corner = next(c for name, c in CORNER.items() if group.name.startswith(name))
        sos = butter(4, corner, fs=rate, output="sos")
        channels["velocity"] = np.gradient(sosfiltfilt(sos, channels["displacement"])) * rate
    if group.flipped:
        channels["force"] = -channels["force"]
    return channels | {"rate": np.array(rate)}


def scaled(many: list[dict[str, np.ndarray]], scales: Scales) -> list[Run]:
    """Records in units of the scales."""
    out = []
    for c in many:
        rate, v = float(c["rate"]), c["velocity"] / scales.velocity
        force = c["force"] / scales.force
        heat = np.cumsum(np.abs(force * v)) / rate
        x = c.get("displacement", np.cumsum(c["velocity"]) / rate)
        out.append(Run(v, x / scales.displacement, np.gradient(v), c.get("current", np.ones(v.size)) / scales.current,
                       force, 1.0 / rate, heat / max(heat[-1], 1e-300)))
    return out


def scales_of(many: list[dict[str, np.ndarray]]) -> Scales:
    """Root mean squares over the training records; the largest current."""
    def size(name: str) -> float:
        found = [c[name] for c in many if name in c]
        return float(np.sqrt(np.mean(np.concatenate(found) ** 2))) if found else 1.0
    highest = max((float(np.abs(c["current"]).max()) for c in many if "current" in c), default=1.0)
    return Scales(size("velocity"), size("displacement"), size("force"), highest or 1.0)


# -- structures ---------------------------------------------------------------------------------------------------
SHAPES: dict[str, dict[str, tuple[float, float, tuple[float, ...]]]] = {
    "friction": {"f0": (1e-4, 20.0, (0.3, 1.0)), "eps": (1e-3, 3.0, (0.03, 0.3))},
    "power": {"n": (0.2, 3.0, (0.6,))},
    "series": {"kappa": (1e-5, 1.0, (1e-3, 1e-2, 1e-1))},
    "gap": {"gap": (1e-5, 1.0, (3e-3, 3e-2))},
    "hardening": {"hard": (1e-4, 1e3, (1.0,))},
    "pre-sliding": {"depth": (1e-5, 1.0, (1e-3, 1e-2, 1e-1))},
    "lag": {"rise": (1e-4, 0.2, (0.01,))},
    "rise-fall": {"rise": (1e-4, 0.2, (0.01,)), "fall": (1e-4, 0.2, (0.01,))},
    "fade": {"fade": (1e-4, 3.0, (0.1,))},
    "saturation": {"q": (1e-3, 10.0, (0.5,))},
    "motion-filter": {"tau": (1e-4, 0.1, (0.003, 0.01))},
    "outer-friction": {"eps_o": (1e-3, 3.0, (0.03, 0.3))},
}
"""Nonlinear parameters of a term, all positive and searched by their logarithm: lowest, highest, starts. Deflections
are in units of V times a second, times in seconds."""
SIGNED = {"asymmetry": ("g",), "friction-asymmetry": ("gf",), "force-late": ("late",), "motion-late": ("early",)}
"""Nonlinear parameters that may be of either sign, from 0."""
PARALLEL = {"spring": "x", "cubic": "x3", "quadratic-spring": "x2", "mass": "a", "dashpot": "v", "turbulent": "v|v|"}


@dataclass(frozen=True)
class Fitted:
    """A structure and what it leaves: free-run error over the variance of the force; `whole` with the first quarter of
    a second of the held-out records, as the program counts it."""

    terms: tuple[str, ...]
    training: float
    held_out: float
    whole: float
    values: dict[str, float]


def _names(terms: tuple[str, ...]) -> list[tuple[str, bool]]:
    found: list[tuple[str, bool]] = [("c0", True)]
    for t in terms:
        found += [(n, True) for n in SHAPES.get(t, ())]
        found += [(n, False) for n in SIGNED.get(t, ())]
    if "current" in terms:
        found += [("c1", False)] + ([("f1", True)] if "friction" in terms else [])
    return list(dict.fromkeys(found))


def _starts(terms: tuple[str, ...]) -> list[dict[str, float]]:
    grids = {n: grid for t in terms for n, (_, _, grid) in SHAPES.get(t, {}).items()}
    fixed = {"c0": 0.5, "c1": 0.1, "f1": 1.0, "g": 0.0, "gf": 0.0, "late": 0.0, "early": 0.0}
    return [fixed | dict(zip(grids, chosen, strict=True)) for chosen in product(*grids.values())]


def _bounds(name: str, positive: bool) -> tuple[float, float]:
    if not positive:
        return {"g": (-0.9, 9.0), "gf": (-0.9, 9.0)}.get(name, (-20.0, 20.0))
    for shape in SHAPES.values():
        if name in shape:
            return float(np.log(shape[name][0])), float(np.log(shape[name][1]))
    return float(np.log(1e-5)), float(np.log(50.0))


def simulate(run: Run, terms: tuple[str, ...], values: dict[str, float], sub: int) -> tuple[np.ndarray, np.ndarray]:
    """Force of the branch and the parallel columns (n, m) of a structure."""
    i = run.i
    if "lag" in terms or "rise-fall" in terms:
        i = lagged(i, run.dt, values["rise"], values.get("fall", values["rise"]))
    if "saturation" in terms:
        i = np.tanh(values["q"] * i) / values["q"]
    v, x = run.v, run.x
    if "motion-late" in terms:
        v, x = (advanced(y, values["early"]) for y in (v, x))
    if "motion-filter" in terms:  # of first order, undone: y + tau dy/dt
        v, x = (y + values["tau"] * np.gradient(y) / run.dt for y in (v, x))
    p = np.array([values.get(n, {"n": 1.0, "eps": 1.0}.get(n, 0.0)) for n in BRANCH])
    force = branch(v, i, run.dt, sub, p)
    if "fade" in terms:
        force = force * (1.0 - values["fade"] * run.heat)
    columns = [np.ones(v.size)]
    table = {"x": x, "x2": x**2, "x3": x**3, "a": run.a, "v": v, "v|v|": v * np.abs(v)}
    columns += [table[PARALLEL[t]] for t in terms if t in PARALLEL]
    if "pre-sliding" in terms:
        columns.append(presliding(v, run.dt, values["depth"]))
    if "outer-friction" in terms:
        columns.append(np.tanh(v / values["eps_o"]))
    block = np.column_stack(columns)
    if "force-late" in terms:
        force, block = advanced(force, values["late"]), np.column_stack([advanced(c, values["late"]) for c in block.T])
    return force, block


def fit(training: list[Run], held_out: list[Run], terms: tuple[str, ...], sub: int = 2) -> Fitted:
    """Fit a structure to the training records, and its error on those held out."""
    names = _names(terms)
    low, high = np.array([_bounds(*n) for n in names]).T
    target = np.concatenate([r.force[r.since()] for r in training])

    def stacked(some: list[Run], q: np.ndarray, first: float = HEAD) -> tuple[np.ndarray, np.ndarray]:
        values = {n: float(np.exp(u) if positive else u) for (n, positive), u in zip(names, q, strict=True)}
        parts = [simulate(r, terms, values, sub) for r in some]
        return (np.concatenate([f[r.since(first)] for (f, _), r in zip(parts, some, strict=True)]),
                np.concatenate([b[r.since(first)] for (_, b), r in zip(parts, some, strict=True)]))

    def errors(q: np.ndarray) -> np.ndarray:
        force, block = stacked(training, q)
        left = np.nan_to_num(target - force, nan=1e3)
        return left - block @ np.linalg.lstsq(block, left, rcond=1e-10)[0]

    best = None
    first = [np.array([np.log(s[n]) if positive else s[n] for n, positive in names]) for s in _starts(terms)]
    costs = [float(np.mean(errors(q) ** 2)) for q in first]
    for k in np.argsort(costs)[:3]:
        found = least_squares(errors, np.clip(first[k], low + 1e-6, high - 1e-6), bounds=(low, high), diff_step=1e-4,
                              max_nfev=40, x_scale=1.0)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    force, block = stacked(training, best.x)
    weights = np.linalg.lstsq(block, target - force, rcond=1e-10)[0]
    later = []
    for head in (HEAD, 0.0):
        there = np.concatenate([r.force[r.since(head)] for r in held_out])
        force, block = stacked(held_out, best.x, head)
        later.append(float(np.mean((there - force - block @ weights) ** 2) / np.var(there)))
    values = {n: float(np.exp(u) if positive else u) for (n, positive), u in zip(names, best.x, strict=True)}
    values |= {t: float(w) for t, w in zip(("offset", *(t for t in terms if t in PARALLEL)), weights, strict=False)}
    return Fitted(terms, 2 * float(best.cost) / target.size / float(np.var(target)), *later, values)


BASE = ("spring", "mass")
STRUCTURES = (
    (), ("friction",), ("friction", "asymmetry"), ("friction", "friction-asymmetry"), ("friction", "power"), ("power",),
    ("friction", "turbulent"), ("series",), ("friction", "series"), ("friction", "series", "gap"),
    ("friction", "series", "hardening"), ("series", "outer-friction"), ("pre-sliding",), ("pre-sliding", "power"),
    ("friction", "force-late"), ("friction", "motion-late"), ("friction", "series", "motion-filter"), ("cubic",),
    ("quadratic-spring", "cubic"),
    ("friction", "cubic"), ("friction", "series", "power"), ("friction", "series", "outer-friction"),
    ("friction", "series", "asymmetry", "friction-asymmetry"), ("friction", "asymmetry", "friction-asymmetry", "power"),
    ("friction", "series", "dashpot"), ("friction", "fade"), ("friction", "series", "gap", "power"),
    ("friction", "series", "cubic", "quadratic-spring"))


def main() -> None:
    """Print one line of JSON per group and structure."""
    parser = argparse.ArgumentParser(description="Independent fits of the real records.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("group", nargs="*")
    parser.add_argument("--terms", nargs="*", default=[], help="structures instead of the list, terms joined by +")
    parser.add_argument("--without-current", action="store_true", help="laws that do not read the current")
    parser.add_argument("--siblings", action="store_true", help="other records of the same specimens")
    parser.add_argument("--draw", type=int, metavar="SEED", help="parts of the same specimens drawn anew")
    options = parser.parse_args()
    best = {a.group: a.best for a in real_answers.ANSWERS}
    others = real_records.siblings() if options.siblings else ()
    others = real_records.drawn(options.draw) if options.draw is not None else others
    for group in others or real_records.GROUPS:
        if "car" in (group.name, group.of) or (options.group and group.name not in options.group):
            continue
        asked = options.terms or ([best[group.of]] if others else [])
        structures = tuple(tuple(t.split("+")) for t in asked) or STRUCTURES
        for row in table(options.folder, group, structures, not options.without_current):
            print(json.dumps(row), flush=True)


def table(folder: Path, group: real_records.Group, structures: tuple[tuple[str, ...], ...],
          with_current: bool = True) -> Iterator[dict]:
    """A row per structure, the linear baseline's terms with it."""
    raw, later = runs(folder, group, False), runs(folder, group, True)
    scales = scales_of(raw)
    training, held_out = scaled(raw, scales), scaled(later, scales)
    levels = np.concatenate([r.i for r in training])
    varies = with_current and float(np.std(levels)) > 0.05
    for structure in structures:
        terms = BASE + structure + (("current",) if varies else ())
        begun = time.perf_counter()
        found = fit(training, held_out, terms)
        yield {"group": group.name, "terms": "+".join(structure), "training": round(found.training, 5),
               "held_out": round(found.held_out, 5), "whole": round(found.whole, 5),
               "seconds": round(time.perf_counter() - begun, 1),
               "values": {k: float(f"{v:.3g}") for k, v in found.values.items()}, "scales": scales.__dict__}


if __name__ == "__main__":
    main()
