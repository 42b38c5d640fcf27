"""Every control law on ISO C at 20 m/s and over a bump: tuned with one budget on other seeds, compared on twenty.

    python tests/benchmarks/ride_study.py --out FOLDER [--budget 64] [--seeds 20] [--weights 0.5] [--laws add,sh-add]
                                          [--capped] [--sensors stroke-body] [--roads iso,bump] [--bound 20]

Resumable: what is in FOLDER is not done again. Sensors are those of a production car (stroke and body acceleration,
with noise), the coil's lag is that of the identified damper; the roads of the tuning are others than those of the
comparison. Prints the table, differences to SH-ADD paired by seed, and, for several weights, each law's front. With
--capped every law is tuned once more, for comfort at a tyre load no higher than that of SH-ADD as first tuned. With
--bound N the clairvoyant bound is searched for the first N seeds, some 20 s each, and every law is given as a share of
the way from the passive car to it; each road and seed is kept as it comes.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from lpvid import load, save
from quartercar.controllers import LAWS, law_class
from quartercar.controllers.contract import Controller
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import SETS
from quartercar.rides.bound import MEASURES, BoundSettings, bound_rides
from quartercar.rides.comparison import Interval, RideComparison, compare_rides
from quartercar.rides.config import build_car
from quartercar.rides.simulation import RideSettings
from quartercar.rides.tuning import Objective, Trial, tune
from quartercar.roads.ride_roads import Bump, IsoRoad

TUNING = {"iso": IsoRoad("C", 20.0, 8.0), "bump": Bump()}
COMPARED = {"iso": IsoRoad("C", 20.0, 20.0), "bump": Bump()}
SEEDS = (100_000, 100_001, 100_002)
REFERENCE = "sh-add"
MARGIN = 0.999
"""of the reference's tyre load: three seeds do not tell a thousandth"""


def tuned(law: Controller, trial: Trial, budget: int, path: Path) -> Controller:
    """A law at its best for this trial; from its file where that is there."""
    if path.exists():
        return load(path)
    started = time.perf_counter()
    found = tune(law, trial, budget)
    save(found.controller, path)
    print(f"{found}  {time.perf_counter() - started:.0f} s", flush=True)
    return found.controller


def compared(laws: dict[str, Controller], roads: list[str], settings: RideSettings, seeds: int, path: Path) -> dict:
    """ride.json of all laws."""
    if path.exists():
        kept = json.loads(path.read_text())
        if kept["controllers"] == json.loads(json.dumps({n: law.to_dict() for n, law in laws.items()})):
            return kept
    found: RideComparison = compare_rides(build_car(), [COMPARED[r] for r in roads], laws, range(seeds), settings)
    data = found.to_dict()
    path.write_text(json.dumps(data, indent=1))
    return data


def bounded(laws: dict[str, Controller], roads: list[str], settings: RideSettings, seeds: int, weight: float,
            folder: Path, mark: str) -> None:
    """Shares of the way from passive to bound, seed by seed, pooled over the seeds."""
    known = json.loads(json.dumps({n: law.to_dict() for n, law in laws.items()}))
    for road in roads:
        rows: list[dict] = []
        for seed in range(seeds):
            path = folder / f"bound-{weight:g}-{mark}-{road}-{seed}.json"
            kept = json.loads(path.read_text()) if path.exists() else {}
            if kept.get("controllers") != known:
                found = compare_rides(build_car(), [COMPARED[road]], laws, [seed], settings, REFERENCE)
                both = bound_rides(build_car(), [COMPARED[road]], found, settings,
                                   BoundSettings(1, Objective(weight, 1 - weight)))
                kept = {"controllers": known, "bounds": [{**b.to_dict(), "measures": {
                    "passive": _measures(b, b.passive), **{a: _measures(b, b.at(a)) for a in b.best},
                    "laws": {n: _measures(b, f) for n, f in b.laws.items()}}} for b in both]}
                path.write_text(json.dumps(kept, indent=1))
            rows.append(kept["bounds"][0]["measures"])
            print(f"  bound: {road}, seed {seed}", flush=True)
        _shares(COMPARED[road].name, rows)


def _measures(bound, figures) -> dict[str, float]:
    return {m: float(bound.values(figures, m)[0]) for m in MEASURES}


def _shares(road: str, rows: list[dict]) -> None:
    def column(get, measure: str) -> np.ndarray:
        return np.array([get(r)[measure] for r in rows])

    print(f"\n{road}, {len(rows)} seeds, nonlinear car: share of the way from passive to bound [%], energy held at "
          f"that under {REFERENCE}; 95 % intervals")
    print(f"{'law':<28}" + "".join(f"{m:>16}" for m in MEASURES))
    for law in rows[0]["laws"]:
        cells = []
        for m in MEASURES:
            passive, best, mine = (column(g, m) for g in (lambda r: r["passive"], lambda r: r["objective"],
                                                          lambda r, law=law: r["laws"][law]))
            cells.append(_share(Interval.of((passive - mine) / np.mean(passive - best)).to_dict()))
        print(f"{law:<28}" + "".join(f"{c:>16}" for c in cells))
    print(f"bound, difference to {REFERENCE} [%]")
    for aim in ("objective", "comfort", "tyre_load"):
        cells = [_share(Interval.of((column(lambda r, aim=aim: r[aim], m) - column(lambda r: r["laws"][REFERENCE], m))
                                    / np.mean(column(lambda r: r["laws"][REFERENCE], m))).to_dict()) for m in MEASURES]
        print(f"{'  least ' + aim:<28}" + "".join(f"{c:>16}" for c in cells))


def table(data: dict) -> None:
    """Figures with intervals, differences to the reference, the front."""
    for road in data["front"]:
        print(f"\n{road}, {len(data['seeds'])} seeds; differences to {data['reference']} in per cent, 95 % intervals")
        print(f"{'law':<18}{'comfort [m/s²]':>18}{'tyre load [N]':>16}{'stroke [mm]':>14}{'Δ comfort':>16}"
              f"{'Δ tyre load':>16}{'at limits':>11}{'F·v<0':>8}  front")
        for row in (r for r in data["rides"] if r["road"] == road):
            f, a = row["figures"], row["against"]
            print(f"{row['controller']:<18}{_half(f['comfort'], 1, 4):>18}{_half(f['tyre_load'], 1, 4):>16}"
                  f"{_half(f['stroke'], 1e3, 3):>14}{_share(a['comfort']):>16}{_share(a['tyre_load']):>16}"
                  f"{f['at_limits']['mean']:>11.0%}{f['negative_share']['mean']:>8.1%}"
                  f"{'  *' if row['controller'] in data['front'][road] else ''}")


def _half(figure: dict, scale: float, digits: int) -> str:
    half = "" if figure["high"] is None else f" ±{scale * (figure['high'] - figure['mean']):.2g}"
    return f"{scale * figure['mean']:.{digits}g}{half}"


def _share(figure: dict) -> str:
    half = "" if figure["high"] is None else f" ±{100 * (figure['high'] - figure['mean']):.2f}"
    return f"{100 * figure['mean']:+.2f}{half}"


def main() -> None:
    """Tune what is missing, compare, print."""
    parser = argparse.ArgumentParser(description="Control laws on ISO C and over a bump.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--budget", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--weights", default="0.5", help="weights of comfort against tyre load, with commas")
    parser.add_argument("--laws", default=",".join(n for n, _, _ in LAWS if n != "scheduled"))
    parser.add_argument("--sensors", default="stroke-body", choices=list(SETS))
    parser.add_argument("--capped", action="store_true", help="and once more, tyre load capped at that of SH-ADD")
    parser.add_argument("--roads", default="iso,bump", help="on which laws are tuned and compared, with commas")
    parser.add_argument("--bound", type=int, default=0, metavar="N", help="clairvoyant bound of the first N seeds")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    names, settings = given.laws.split(","), RideSettings(ChainSettings(sensors=SETS[given.sensors]))
    roads = given.roads.split(",")
    mark = "-".join([str(given.budget), given.sensors, *([] if len(roads) > 1 else roads)])
    for weight in map(float, given.weights.split(",")):
        trial = Trial(build_car(), tuple(TUNING[r] for r in roads), SEEDS, settings, Objective(weight, 1 - weight))
        laws = {n: tuned(law_class(n)(), trial, given.budget, given.out / f"{n}-{weight:g}-{mark}.json") for n in names}
        print(f"\n=== {trial.objective.description}; {given.budget} evaluations each")
        table(compared(laws, roads, settings, given.seeds, given.out / f"ride-{weight:g}-{mark}-{given.seeds}.json"))
        if given.bound:
            bounded(laws, roads, settings, given.bound, weight, given.out, mark)
        if not given.capped:
            continue
        trial = replace(trial, objective=Objective(1.0, 0.0, tyre_cap=MARGIN), reference=laws[REFERENCE])
        best = {n: tuned(law, trial, given.budget, given.out / f"{n}-{weight:g}-capped-{mark}.json")
                for n, law in laws.items() if n != REFERENCE}
        print(f"\n=== {trial.objective.description} ({REFERENCE} as above); {given.budget} further evaluations each")
        table(compared({REFERENCE: laws[REFERENCE], **best}, roads, settings, given.seeds,
                       given.out / f"ride-{weight:g}-capped-{mark}-{given.seeds}.json"))


if __name__ == "__main__":
    main()
