"""Every control law on ISO C at 20 m/s and over a bump: tuned with one budget on other seeds, compared on twenty.

    python tests/benchmarks/ride_study.py --out FOLDER [--budget 64] [--seeds 20] [--weights 0.5] [--laws add,sh-add]

Resumable: what is in FOLDER is not done again. Sensors are those of a production car (stroke and body acceleration,
with noise), the coil's lag is that of the identified damper; the roads of the tuning are others than those of the
comparison. Prints the table, differences to SH-ADD paired by seed, and, for several weights, each law's front.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from lpvid import load, save
from quartercar.controllers import LAWS, law_class
from quartercar.controllers.contract import Controller
from quartercar.ride_comparison import RideComparison, compare_rides
from quartercar.ride_config import build_car
from quartercar.ride_roads import Bump, IsoRoad
from quartercar.tuning import Objective, Trial, tune

TUNING = (IsoRoad("C", 20.0, 8.0), Bump())
COMPARED = (IsoRoad("C", 20.0, 20.0), Bump())
SEEDS = (100_000, 100_001, 100_002)
REFERENCE = "sh-add"


def tuned(name: str, weight: float, budget: int, folder: Path) -> Controller:
    """A law at its best for this weight of comfort; from the folder where it is there."""
    path = folder / f"{name}-{weight:g}-{budget}.json"
    if path.exists():
        return load(path)
    started = time.perf_counter()
    trial = Trial(build_car(), TUNING, SEEDS, objective=Objective(weight, 1 - weight))
    found = tune(law_class(name)(), trial, budget)
    save(found.controller, path)
    print(f"{found}  {time.perf_counter() - started:.0f} s", flush=True)
    return found.controller


def compared(laws: dict[str, Controller], weight: float, budget: int, seeds: int, folder: Path) -> dict:
    """ride.json of all laws at this weight."""
    path = folder / f"ride-{weight:g}-{budget}-{seeds}.json"
    if path.exists():
        kept = json.loads(path.read_text())
        if set(kept["controllers"]) == set(laws):
            return kept
    found: RideComparison = compare_rides(build_car(), COMPARED, laws, range(seeds))
    data = found.to_dict()
    path.write_text(json.dumps(data, indent=1))
    return data


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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--budget", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--weights", default="0.5", help="weights of comfort against tyre load, with commas")
    parser.add_argument("--laws", default=",".join(n for n, _, _ in LAWS if n != "scheduled"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for weight in map(float, given.weights.split(",")):
        laws = {n: tuned(n, weight, given.budget, given.out) for n in given.laws.split(",")}
        print(f"\n=== comfort weighs {weight:g}, tyre load {1 - weight:g}; {given.budget} evaluations each")
        table(compared(laws, weight, given.budget, given.seeds, given.out))


if __name__ == "__main__":
    main()
