"""Held-out free-run ESR of every applicable damper model on measured data: `python real_data_comparison.py FOLDER`.

Not a test: it takes minutes and needs the measurements, which are not part of the project. The splits:

- ``random``: mr_damper_random, train on the first 8 s, test on the last 4 s, at 500.8 Hz; the voltage command stands
  for the current. The published Bouc-Wen parameters of this prototype run along, not fitted.
- ``sines``: mr_damper_sines, train on the records at 0, 0.25 and 1 A, test on those at 0.75 A, all at 200 Hz.
- ``fixed``: mr_damper_fixed_voltage, test on the last third; velocity and force alone.
- ``race-pressure``: race_damper_dyno at one clicker setting, train on the fast run at 150 psi, test on the slow run at
  100 psi: other speeds, and another gas preload that no model is told of.
- ``race-heat``: the run with the heat gun, test on its last third: the oil gets warmer than the fit has seen.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import lpvid as lpv
from lpvid.condition import split_tail
from lpvid.record import Record
from quartercar.dampers import BoucWen, CompareSettings, Comparison, compare
from quartercar.dampers.laws.bouc_wen import LORD

Split = tuple[list[Record], list[Record], float | None]


def splits(data: Path) -> dict[str, Split]:
    """Training records, held-out records and rate of every data set."""
    def read(name: str) -> list[Record]:
        return lpv.read(str(data / name))

    random, = read("mr_damper_random/estimation.csv")
    fixed, = read("mr_damper_fixed_voltage/estimation.csv")
    heat, = read("race_damper_dyno/*heat_gun.csv")
    sines = read("mr_damper_sines")
    race = [r.flip("force") for r in read("race_damper_dyno/t1_1_1_*.csv")]
    cut = round(8 / random.time_base.period)
    return {
        "random": ([random.slice(0, cut)], [random.slice(cut, random.n_samples)], None),
        "sines": ([r for r in sines if not r.name.endswith("0p75A")], [r for r in sines if r.name.endswith("0p75A")],
                  200.0),
        "fixed": (*([part] for part in split_tail(fixed)), None),
        "race-pressure": ([r for r in race if "150psi" in r.name], [r for r in race if "100psi" in r.name], None),
        "race-heat": (*([part] for part in split_tail(heat)), None),
    }  # type: ignore[return-value]


def table(found: dict[str, Comparison]) -> str:
    """One row for each model, best on the first data set first."""
    names = list(dict.fromkeys(row.name for c in found.values() for row in c.rows))
    lines = [f"{'held-out free-run ESR':<26}" + "".join(f"{key:>15}" for key in found)]
    for name in names:
        cells = []
        for comparison in found.values():
            row = next((r for r in comparison.rows if r.name == name), None)
            esr = None if row is None else row.held_out.total.esr
            cells.append("n/a" if row is None else "diverged" if esr is None else f"{esr:.4f}")
        lines.append(f"{name:<26}" + "".join(f"{cell:>15}" for cell in cells))
    return "\n".join(lines)


def main() -> None:
    """Run the data sets that were asked for and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default=os.environ.get("LPVID_DATA", "."), type=Path)
    parser.add_argument("--only", default="random,sines,fixed,race-pressure,race-heat")
    parser.add_argument("--models", default="all")
    options = parser.parse_args()
    found: dict[str, Comparison] = {}
    for name, (training, held_out, rate) in splits(options.folder).items():
        if name not in options.only.split(","):
            continue
        given = [_published()] if name == "random" else []
        began = time.perf_counter()
        found[name] = compare(training, [*options.models.split(","), *given], held_out,
                              CompareSettings(sample_rate=rate), lambda text: print(f"  {text}", file=sys.stderr))
        print(f"== {name} ({time.perf_counter() - began:.0f} s)\n{found[name]}\n", flush=True)
    print(table(found))


def _published() -> BoucWen:
    """The fourteen published parameters of this very prototype, not fitted."""
    damper = BoucWen.from_published(LORD, current_range=(0.0, 2.25))
    return damper.replace(metadata={"label": "published"})


if __name__ == "__main__":
    main()
