"""What the diagnosis says of measured data: `python real_data_diagnosis.py FOLDER [CASE …]`.

Not a test: it needs the measurements, which are not part of the project. Nothing is tuned to them. The cases:

- ``random-MODEL``: mr_damper_random (12 s), at 500.8 Hz; the voltage command stands for the current.
- ``fixed-MODEL``: mr_damper_fixed_voltage, one voltage, velocity and force alone; its force opposes the velocity.
- ``heat-MODEL``: race_damper_dyno, the run with the heat gun (96 s), 27 to 70 degC.
- ``pressure-MODEL``: race_damper_dyno at one clicker setting, a slow run at 100 psi and a fast one at 150 psi, force
  turned.
- ``car-nominal``, ``car-fitted``, ``car-unsprung``: quarter_car_rig, the published parameters held; fitted around them;
  the motion of the wheel instead of the body's.
- ``sines-MODEL``: mr_damper_sines, four currents, at 200 Hz.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from pathlib import Path

import lpvid as lpv
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.record import Record
from quartercar.baselines.quarter_car import QuarterCarBaseline

MODELS = {"random": ("guo", "kwok", "bouc-wen", "lpv-arx"), "fixed": ("guo", "lpv-arx", "linear"),
          "heat": ("power-law-friction-gas", "guo", "lpv-arx"), "pressure": ("power-law-friction-gas",),
          "sines": ("guo", "lpv-arx")}
RATES = {"sines": 200.0}


def records(data: Path, name: str) -> list[Record]:
    """Records of a data set."""
    def read(pattern: str) -> list[Record]:
        return lpv.read(str(data / pattern))

    if name == "random":
        return read("mr_damper_random/estimation.csv")
    if name == "fixed":
        return read("mr_damper_fixed_voltage/estimation.csv")
    if name == "heat":
        return read("race_damper_dyno/*heat_gun.csv")
    if name == "pressure":
        return [r.flip("force") for r in read("race_damper_dyno/t1_1_1_*.csv")]
    if name == "sines":
        return read("mr_damper_sines")
    return [r.with_roles({"actuator": "actuator force"}) for r in read("quarter_car_rig/run*.csv")]


def cases(data: Path) -> dict[str, Callable[[], Diagnosis]]:
    """Every case by name."""
    found: dict[str, Callable[[], Diagnosis]] = {}
    for name, models in MODELS.items():
        for model in models:
            found[f"{name}-{model}"] = lambda n=name, m=model: lpv.diagnose(records(data, n), m,
                                                                          sample_rate=RATES.get(n))
    cars = {"nominal": QuarterCarBaseline(free=()), "fitted": QuarterCarBaseline(),
            "unsprung": QuarterCarBaseline(output="unsprung")}
    for name, car in cars.items():
        found[f"car-{name}"] = lambda c=car: lpv.diagnose(records(data, "car"), c)
    return found


def row(name: str, found: Diagnosis, seconds: float) -> str:
    """One case in a few lines."""
    lines = [f"## {name}: {found.verdict} ({seconds:.0f} s)", f"   {found.reason}",
             f"   free-run ESR held-out {found.before.esr_held_out:.4g} -> {found.after.esr_held_out:.4g}"]
    lines += [f"   cause {c.name} ({c.description}): {', '.join(map(str, c.parameters))}; held-out gain "
              f"{c.held_out_gain:.1f} %, better in {c.blocks_better:.0%} of the blocks" for c in found.causes]
    lines += [f"   rivals {' / '.join(r.names)}" for r in found.rivals]
    lines += [f"   rejected {r.name}: {r.why}" for r in found.rejected]
    return "\n".join(line for line in lines if line)


def main() -> None:
    """Diagnose and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folder", type=Path)
    parser.add_argument("case", nargs="*", help="names, or their beginnings")
    wanted = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    for name, run in cases(wanted.folder).items():
        if wanted.case and not any(name.startswith(c) for c in wanted.case):
            continue
        begun = time.perf_counter()
        try:
            print(row(name, run(), time.perf_counter() - begun), flush=True)
        except lpv.errors.InputError as error:
            print(f"## {name}: {error}", flush=True)


if __name__ == "__main__":
    main()
