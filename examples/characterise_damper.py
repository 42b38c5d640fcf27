"""What does a dynamometer's page show of a damper? Sines, a creep run and current steps on the virtual rig.

Run: python examples/characterise_damper.py [FOLDER]. Writes forces.csv, characteristics.csv and characteristics.png.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import quartercar as qc
from lpvid.plot import show
from quartercar.characterisation import Characterisation, CharacteriseSettings, write_tables
from quartercar.rig import Constant, Creep, Experiment, Prbs, Rig, Sine, Triangle

CURRENTS = (0.0, 1.2)


def records() -> list:
    """Two sines at two currents, one creep run, one run with steps of the current."""
    sines = [Experiment(f"sine-{v:g}", Sine(0.03, v / (2 * np.pi * 0.03)), Constant(CURRENTS), 6.0, len(CURRENTS))
             for v in (0.13, 0.52)]
    creep = Experiment("creep", Creep(0.002, 0.001), Constant((0.0,)), duration=24.0)
    steps = Experiment("switch", Triangle(0.03, 0.1 / 0.12, 40.0), Prbs(0.12, 0.0, 2.0, cells=7), duration=4.0)
    rig, fast = Rig(sample_rate=512.0, oversampling=8), Rig(sample_rate=10_000.0, oversampling=2)
    return [*(r for e in (*sines, creep) for r in rig.run_all(e)), fast.run(steps)]


def main(folder: str | Path = ".") -> Characterisation:
    """Characterise, print, and keep the tables and one figure."""
    found = qc.characterise(records(), CharacteriseSettings(speeds=(0.05, 0.13, 0.26, 0.52)))
    print(found)
    write_tables(found, folder)
    from quartercar.characterisation.figures import figures_of

    figure = next(f for f in figures_of(found) if f.name == "continuous_velocity").figure
    show(figure, Path(folder) / "characteristics.png")
    show(figure)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:])
