"""Preview against SH-ADD: three dampers, empty and loaded car, five roads, twenty seeds.

``python tests/benchmarks/preview_matrix.py --out FOLDER`` keeps tuned laws and figures in FOLDER, so that it continues
where it was stopped. The dampers are the embedded identified one and a Guo and a Kwok damper of typical values. Laws
are tuned for every damper with `--budget` evaluations on 8 s of ISO C and the bump with the empty car, three other
seeds: for ½ comfort + ½ tyre load over those of the passive car, `mpc` with the front axle for the least comfort number
at a tyre load of at most 91 % of SH-ADD's, on ISO C alone or (embedded damper) on both. `mpc` without preview keeps its
defaults, which were the best of 16 on the embedded damper. The loaded car has a sprung mass 30 % above that of the laws
and observers. Sensors are stroke and body acceleration with noise at both axles, the coil's lag is in the dampers or
the car, the road ahead is the front axle's estimate. Differences are to SH-ADD without preview on the same damper, load
and road, paired by seed, in per cent with 95 % intervals.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from preview_study import FRONT, LOADED, REFERENCE, SEEDS, TUNED_ON, Case, difference, line, ridden

from lpvid import load, save
from quartercar.controllers import law_class
from quartercar.controllers.contract import Controller
from quartercar.dampers import Guo, Kwok
from quartercar.parameters import MEGANE
from quartercar.rides.config import build_car
from quartercar.rides.tuning import Objective, Trial, tune
from quartercar.roads.ride_roads import Bump, IsoRoad, MeasuredRoad, RideRoad
from quartercar.vehicle.nonlinear import QuarterCar

CASES = (Case(REFERENCE, "sh-add"), Case("skyhook-linear", "skyhook-linear"), Case("mpc, no preview", "mpc"),
         Case("preview-lpv, front", "preview-lpv", FRONT), Case("mpc, front", "mpc", FRONT),
         Case("mpc, front, bump", "mpc", FRONT))
UNTUNED = ("mpc, no preview",)
AIMED = {"mpc, front": TUNED_ON, "mpc, front, bump": (*TUNED_ON, Bump())}
"""roads on which laws are tuned for the aim"""
FEW = ("mpc, no preview", "mpc, front, bump")
"""cases of the empty car alone, and of the embedded damper alone"""
PLAN = (("embedded", "empty"), ("guo", "empty"), ("kwok", "empty"), ("embedded", "loaded"), ("guo", "loaded"),
        ("kwok", "loaded"))
CAP = 0.91
"""tyre load over SH-ADD's up to which that is tuned: the aim of .92 with a per cent for other seeds"""
AIM = (-4.0, -8.0)
"""comfort and tyre load of the aim, against SH-ADD [%]"""


def cars(folder: Path) -> dict[str, QuarterCar]:
    """The empty car with each damper."""
    found = {"embedded": build_car()}
    for kind in (Guo, Kwok):
        path = folder / f"{kind.name}.json"
        save(kind(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0)), path)
        found[kind.name] = build_car(damper=str(path))
    return found


def roads(classes: str) -> dict[str, RideRoad]:
    """By name in the tables: ISO roads of some classes, bump and blocks; these need the folder LPVID_DATA."""
    found: dict[str, RideRoad] = {f"ISO {c}": IsoRoad(c, 20.0, 10.0) for c in classes}
    found["bump"] = Bump()
    track = Path(os.environ.get("LPVID_DATA", "")) / "belgian_block_road" / "profiles.csv"
    if track.exists():
        found["blocks"] = MeasuredRoad.read(track, 8.0, 0)
    return found


def tuned(case: Case, name: str, car: QuarterCar, reference: Controller | None, budget: int,
          folder: Path) -> Controller:
    """The law of a case for a damper; from its file where that is there."""
    path = folder / f"{name}-{case.label.replace(', ', '-').replace(' ', '-')}.json"
    if path.exists():
        return load(path)
    started = time.process_time()
    if case.label in UNTUNED:
        return law_class(case.law)()
    trial = Trial(car, (*TUNED_ON, Bump()), SEEDS, case.settings)
    if case.label in AIMED:
        objective = Objective(1.0, 0.0, tyre_cap=CAP)
        trial = replace(trial, roads=AIMED[case.label], objective=objective, reference=reference)
    found = tune(law_class(case.law)(), trial, budget)
    save(found.controller, path)
    print(f"{name}, {case.label}: {found}  {time.process_time() - started:.0f} s", flush=True)
    return found.controller


def laws_of(name: str, car: QuarterCar, cases: Sequence[Case], budget: int, folder: Path) -> Mapping[str, Controller]:
    """Every law for a damper."""
    found: dict[str, Controller] = {}
    for case in cases:
        found[case.label] = tuned(case, name, car, found.get(REFERENCE), budget, folder)
    return found


def compared(condition: tuple[str, str, str], driven: QuarterCar, road: RideRoad, laws: Mapping[str, Controller],
             cases: Sequence[Case], seeds: Sequence[int], folder: Path) -> dict[str, str]:
    """Rides of one condition, printed; cells of the table by the label of the case."""
    print(f"\n{', '.join(condition)}, {len(seeds)} seeds", flush=True)
    reference: dict = {}
    cells: dict[str, str] = {}
    for case in cases:
        path = folder / f"{'-'.join(condition)}-{case.label}.ride.json".replace(" ", "-")
        mine = ridden(case, laws[case.label], driven, road, seeds, path, MEGANE)
        reference = mine if case.label == REFERENCE else reference
        if not mine:
            continue
        print(line(case.label, mine, reference), flush=True)
        pair = [difference(mine, reference, n) for n in ("comfort", "tyre_load")]
        met = all(float(p.split()[0]) <= a for p, a in zip(pair, AIM, strict=True))
        cells[case.label] = " | ".join(pair) + (" *" if met else "")
    return cells


def main() -> None:
    """Tune what is missing, ride what is missing, print."""
    parser = argparse.ArgumentParser(description="Preview on dampers, loads and roads.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--budget", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--classes", default="ACE", help="ISO classes, such as ABCDE")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    table: dict[tuple[str, str, str], dict[str, str]] = {}
    dampers = cars(given.out)
    for name, loaded in PLAN:
        left_out = FEW[:loaded == "loaded"] + FEW[1:] * (name != "embedded")
        cases = [c for c in CASES if c.label not in left_out]
        laws = laws_of(name, dampers[name], cases, given.budget, given.out)
        mass = MEGANE.sprung_mass * (LOADED if loaded == "loaded" else 1.0)
        driven = replace(dampers[name], parameters=MEGANE.replace(sprung_mass=mass))
        for road_name, road in roads(given.classes).items():
            condition = name, loaded, road_name
            table[condition] = compared(condition, driven, road, laws, cases, range(given.seeds), given.out)
    print("\n| damper | load | road | " + " | ".join(f"{c.label}: comfort | tyre load" for c in CASES[1:]) + " |")
    for condition, cells in table.items():
        print(f"| {' | '.join((*condition, *(cells.get(c.label, ' | ') for c in CASES[1:])))} |")


if __name__ == "__main__":
    main()
