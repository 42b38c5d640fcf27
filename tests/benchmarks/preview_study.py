"""Laws with and without the front axle's road, against tuned SH-ADD and the clairvoyant bound.

    python tests/benchmarks/preview_study.py --out FOLDER [--budget 16] [--seeds 20] [--others 5] [--bound 3] [--aim 3]

Resumable: what is in FOLDER is not done again. Every law is tuned with the same number of evaluations on ISO C at
20 m/s (8 s, three other seeds), with the preview that it rides with. Then ISO C on --seeds seeds, with the share of the
way from the passive car at the lowest current to the bound on the first --bound of them; then, with the values as they
are, other roads, cars and dampers on --others seeds. Sensors are stroke and body acceleration with noise, the coil's
lag is the identified damper's own, the front axle has the same sensors and its own noise. Differences are to SH-ADD
without preview, paired by seed, in per cent with 95 % intervals. --aim searches on the first seeds of ISO A, ISO B and
the bump for the current sequence of least comfort number with the tyre load 8 % below that of SH-ADD, road known; with
it nothing else is printed.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lpvid import load, save
from lpvid.errors import LpvError, NumericalError
from quartercar.controllers import law_class
from quartercar.controllers.contract import Controller
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import SETS
from quartercar.criteria import RideFigures
from quartercar.parameters import MEGANE, CarParameters
from quartercar.rides.bound import BoundSettings, bound_rides
from quartercar.rides.clairvoyant import CurrentSequenceProblem, Effort, best_currents, energy_limit, lowest_current
from quartercar.rides.comparison import Interval, compare_rides
from quartercar.rides.config import build_car
from quartercar.rides.preview import preview_from_text
from quartercar.rides.simulation import Ride, RideSettings, drive
from quartercar.rides.tuning import Objective, Trial, tune
from quartercar.roads.ride_roads import Bump, IsoRoad, MeasuredRoad, RideRoad
from quartercar.vehicle.nonlinear import QuarterCar

TUNED_ON = (IsoRoad("C", 20.0, 8.0),)
SEEDS = (100_000, 100_001, 100_002)
REFERENCE = "sh-add"
FRONT = "wheelbase=2.7"
FEW = 5
"""seeds of the cases that are yardsticks"""
LOADED = 1.3
"""sprung mass of the loaded car over that of the empty one"""
AIM = 0.92
"""tyre load of the aim over that of SH-ADD"""
AIM_EFFORT = Effort(iterations=160, rounds=8, polish=320)
TENTH = 0.1
"""of the range of the current: a constant that a search starts from, beside the commands of the laws and the lowest"""


@dataclass(frozen=True)
class Case:
    """A law with what it has of the road: tuned under ``values_of`` where that is another case, `seeds` at most."""

    label: str
    law: str
    preview: str = "none"
    sensors: str = "stroke-body"
    values_of: str = ""
    seeds: int | None = None

    @property
    def settings(self) -> RideSettings:
        """Of its rides."""
        return RideSettings(ChainSettings(sensors=SETS[self.sensors]), preview=preview_from_text(self.preview))


MAIN = (
    Case("sh-add", "sh-add"), Case("skyhook-linear", "skyhook-linear"), Case("hybrid", "hybrid"),
    Case("clipped-optimal", "clipped-optimal"),
    Case("preview-lqr, no preview", "preview-lqr"), Case("mpc, no preview", "mpc"),
    Case("sh-add, front", "sh-add", FRONT, values_of="sh-add"),
    Case("preview-lqr, front", "preview-lqr", FRONT), Case("preview-lpv, front", "preview-lpv", FRONT),
    Case("mpc, front", "mpc", FRONT),
    Case("mpc, front with wheel sensor", "mpc", f"{FRONT},sensors=stroke-body-wheel", values_of="mpc, front"),
    Case("mpc, front known", "mpc", f"{FRONT},front=known", values_of="mpc, front"),
    Case("mpc, 0.05 s known", "mpc", "time=0.05,front=known", values_of="mpc, front", seeds=FEW),
    Case("mpc, 0.1 s known", "mpc", "time=0.1,front=known", values_of="mpc, front", seeds=FEW),
    Case("mpc, 0.2 s known", "mpc", "time=0.2,front=known", values_of="mpc, front", seeds=FEW),
    Case("mpc, perfect states, no preview", "mpc", sensors="ideal", values_of="mpc, no preview", seeds=FEW),
    Case("mpc, perfect states, 0.1 s known", "mpc", "time=0.1,front=known", "ideal", "mpc, front", FEW),
    Case("mpc, perfect states, front known", "mpc", f"{FRONT},front=known", "ideal", "mpc, front", FEW))
CARRIED = ("sh-add", "mpc, no preview", "preview-lqr, front", "mpc, front")
"""cases that ride under the other conditions"""


@dataclass(frozen=True)
class Condition:
    """A car on a road; `known` is the car as laws and observer have it where that is another."""

    label: str
    road: RideRoad
    car: QuarterCar
    known: CarParameters | None = None


def conditions(dampers: Mapping[str, QuarterCar]) -> list[Condition]:
    """Everything but ISO C with the Mégane and the embedded damper."""
    car = build_car()
    heavy = replace(car, parameters=MEGANE.replace(sprung_mass=LOADED * MEGANE.sprung_mass))
    road = IsoRoad("C", 20.0, 10.0)
    iso = {c: Condition(f"ISO {c} at 20 m/s", IsoRoad(c, 20.0, 10.0), car) for c in "ABDE"}
    found = [iso["B"], iso["D"], Condition("bump 50 mm at 8 m/s", Bump(), car)]
    data = os.environ.get("LPVID_DATA")
    track = None if data is None else Path(data) / "belgian_block_road" / "profiles.csv"
    if track is not None and track.exists():
        found.append(Condition("Belgian blocks at 8 m/s", MeasuredRoad.read(track, 8.0, 0), car))
    soft = MEGANE.replace(tyre_stiffness=0.9 * MEGANE.tyre_stiffness)
    found += [Condition("ISO C, loaded, laws designed for the empty car", road, heavy, MEGANE), iso["A"], iso["E"],
              Condition("ISO C, loaded", road, heavy),
              Condition("ISO C, tyre 10 % softer than in the laws", road, replace(car, parameters=soft), MEGANE)]
    found += [Condition(f"ISO C at {v:g} m/s", IsoRoad("C", v, 10.0), car) for v in (10.0, 30.0)]
    return [Condition(f"ISO C, damper {n}", road, c) for n, c in dampers.items()] + found


def tuned(case: Case, budget: int, folder: Path) -> Controller:
    """The law of a case at its best; from its file where that is there."""
    path = folder / f"{(case.values_of or case.label).replace(', ', '-').replace(' ', '-')}.json"
    if path.exists():
        return load(path)
    started = time.process_time()
    trial = Trial(build_car(), TUNED_ON, SEEDS, case.settings)
    found = tune(law_class(case.law)(), trial, budget)
    save(found.controller, path)
    print(f"{case.label}: {found}  {time.process_time() - started:.0f} s", flush=True)
    return found.controller


def ridden(case: Case, law: Controller, car: QuarterCar, road: RideRoad, seeds: Sequence[int], path: Path,
           known: CarParameters | None = None) -> dict:
    """Figures of a case, one per seed; from its file where that is there with the same law."""
    stamp = json.loads(json.dumps(law.to_dict()))
    if path.exists() and (kept := json.loads(path.read_text()))["law"] == stamp and len(kept["comfort"]) == len(seeds):
        return kept
    started = time.process_time()
    try:
        rides = drive(car, road, [law] * len(seeds), list(seeds), replace(case.settings, parameters=known))
    except LpvError as error:
        print(f"    {case.label}: {error}", flush=True)
        return {}
    found = {"law": stamp, "comfort": [r.figures.comfort for r in rides],
             "tyre_load": [r.figures.tyre_load for r in rides], "stroke": [r.figures.stroke for r in rides],
             "given": [r.passivity.negative_energy for r in rides], "at_limits": [r.at_limits for r in rides],
             "off": [r.road_ahead_error for r in rides], "space": [r.figures.space_used for r in rides],
             "seconds": time.process_time() - started}
    path.write_text(json.dumps(found))
    return found


def difference(mine: dict, other: dict, figure: str) -> str:
    """Mean and half of the interval, in per cent, paired by seed over those that both rode."""
    a = np.array(mine[figure])
    b = np.array(other[figure])[:a.size]
    i = Interval.of((a - b) / b.mean())
    half = "" if i.high is None else f" ± {100 * (i.high - i.mean):.2f}"
    return f"{100 * i.mean:+.2f}{half}"


def line(label: str, mine: dict, reference: dict, shares: str = "") -> str:
    """A row of a table."""
    off = "" if mine["off"][0] in (None, 0.0) else f"{1e3 * np.sqrt(np.mean(np.square(mine['off']))):.2f} mm"
    return (f"{label:<34}{np.mean(mine['comfort']):8.4f}{np.mean(mine['tyre_load']):8.1f}"
            f"{difference(mine, reference, 'comfort'):>16}{difference(mine, reference, 'tyre_load'):>16}"
            f"{np.mean(mine['given']):8.2f} J{np.mean(mine['at_limits']):6.0%}{off:>9}{shares}")


def bound_of(laws: Mapping[str, Controller], road: RideRoad, seeds: int, path: Path) -> dict:
    """Figures of the passive car at the lowest current and of the bound, seed by seed."""
    if path.exists():
        return json.loads(path.read_text())
    car, case = build_car(), MAIN[0]
    found = compare_rides(car, [road], {REFERENCE: laws[REFERENCE]}, range(seeds), case.settings)
    best = bound_rides(car, [road], found, case.settings, BoundSettings(seeds, ends=False, linear=False))[0]
    passive = [lowest_current(car, road, s, case.settings.period(car)) for s in range(seeds)]
    kept = {n: {"comfort": [f.comfort for f in v], "tyre_load": [f.tyre_load for f in v]}
            for n, v in (("passive", passive), ("bound", best.at()))}
    path.write_text(json.dumps(kept))
    return kept


def changes(figures: RideFigures, given: float, other: RideFigures) -> str:
    """Comfort and tyre load against another ride's [%], energy given."""
    values = (100 * (getattr(figures, n) / getattr(other, n) - 1) for n in ("comfort", "tyre_load"))
    return "{:+8.2f}{:+7.2f}".format(*values) + f"{given:8.3f} J"


def least_comfort(car: QuarterCar, road: RideRoad, seed: int, sh_add: Ride, mpc: Ride, path: Path) -> str:
    """mpc, and the least comfort number found at the aim's tyre load with the energy given held, and not held."""
    if path.exists():
        return path.read_text()
    size, low, period = sh_add.run.n_samples, car.coil.lowest, MAIN[0].settings.period(car)
    starts = {"sh-add": sh_add.run["command"], "mpc": mpc.run["command"], "lowest": np.full(size, low),
              "tenth": np.full(size, low + TENTH * (car.coil.highest - low))}
    tyre, given = {"tyre_load": AIM * sh_add.figures.tyre_load}, {"given": energy_limit(sh_add.passivity)}
    out = changes(mpc.figures, mpc.passivity.negative_energy, sh_add.figures)
    for limits in (tyre | given, tyre):
        posed = CurrentSequenceProblem(car, road, seed, period, sh_add.figures, Objective(1.0, 0.0), limits)
        try:
            best = best_currents(posed, starts, AIM_EFFORT)
        except NumericalError:
            out += f"{'none found':>25}"
            continue
        starts = {"held": best.command}
        out += changes(best.figures, best.passivity.negative_energy, sh_add.figures)
    path.write_text(out + f"{sh_add.passivity.negative_energy:9.3f} J")
    return path.read_text()


def print_aim(laws: Mapping[str, Controller], seeds: int, folder: Path) -> None:
    """Where a known road lets both aims be met."""
    print("seed; comfort and tyre load against sh-add [%], energy given: mpc with the front axle; least comfort number "
          "found, energy held; not held; energy of sh-add")
    car, cases = build_car(), {c.label: c for c in MAIN}
    for road in (Bump(), IsoRoad("B", 20.0, 10.0), IsoRoad("A", 20.0, 10.0)):
        sh_add, mpc = (drive(car, road, [laws[n]] * seeds, list(range(seeds)), cases[n].settings)
                       for n in (REFERENCE, "mpc, front"))
        for seed, (one, other) in enumerate(zip(sh_add, mpc, strict=True)):
            path = folder / f"aim-{road.name.replace(' ', '-').replace('/', '-')}-{seed}.txt"
            print(f"{road.name:<26}{seed:>3}{least_comfort(car, road, seed, one, other, path)}", flush=True)


def share(mine: dict, bound: dict) -> str:
    """Of the way from passive to bound: objective, comfort, tyre load [%]."""
    o, n = Objective(), len(bound["passive"]["comfort"])

    def value(row: dict, name: str) -> np.ndarray:
        if name != "objective":
            return np.array(row[name][:n])
        comfort, tyre = (np.array(row[m][:n]) / np.array(bound["passive"][m]) for m in ("comfort", "tyre_load"))
        return o.comfort * comfort + o.tyre_load * tyre

    out = ""
    for name in ("objective", "comfort", "tyre_load"):
        passive = value(bound["passive"], name)
        i = Interval.of((passive - value(mine, name)) / np.mean(passive - value(bound["bound"], name)))
        out += f"{100 * i.mean:9.0f}" + ("" if i.high is None else f" ± {100 * (i.high - i.mean):.0f}")
    return out


def main() -> None:
    """Tune what is missing, ride what is missing, print."""
    parser = argparse.ArgumentParser(description="Laws with and without preview.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--budget", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--others", type=int, default=5)
    parser.add_argument("--bound", type=int, default=3)
    parser.add_argument("--aim", type=int, default=0)
    parser.add_argument("--damper", action="append", default=[], metavar="NAME=FILE", help="further dampers")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.aim:
        laws = {c.label: tuned(c, given.budget, given.out) for c in MAIN if c.label in (REFERENCE, "mpc, front")}
        print_aim(laws, given.aim, given.out)
        return
    laws = {c.label: tuned(c, given.budget, given.out) for c in MAIN}
    road = IsoRoad("C", 20.0, 20.0)
    bound = bound_of(laws, road, given.bound, given.out / "bound.json") if given.bound else None
    print(f"\n{road.name}, {given.seeds} seeds ({FEW} of the yardsticks): comfort [m/s²], tyre load [N], both against "
          f"{REFERENCE} [%], energy given, at limits, road ahead off; shares of passive to bound: objective, comfort, "
          "tyre load [%]")
    reference: dict = {}
    for k, case in enumerate(MAIN):
        seeds = range(min(given.seeds, case.seeds or given.seeds))
        mine = ridden(case, laws[case.label], build_car(), road, seeds, given.out / f"main-{k}.json")
        reference = mine if case.label == REFERENCE else reference
        print(line(case.label, mine, reference, "" if bound is None else share(mine, bound)), flush=True)
    dampers = {n: build_car(damper=f) for n, _, f in (d.partition("=") for d in given.damper)}
    for place, condition in enumerate(conditions(dampers)):
        print(f"\n{condition.label}, {given.others} seeds")
        for k, case in enumerate(c for c in MAIN if c.label in CARRIED):
            mine = ridden(case, laws[case.label], condition.car, condition.road, range(given.others),
                          given.out / f"other-{place}-{k}.json", condition.known)
            reference = mine if case.label == REFERENCE else reference
            if mine:
                print(line(case.label, mine, reference), flush=True)


if __name__ == "__main__":
    main()
