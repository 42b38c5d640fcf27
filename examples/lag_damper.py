"""A helicopter lag damper's relief valve: what does a model without the holes behind the valve miss at speed?"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import lpvid as lpv
from lpvid.plot import show
from quartercar.dampers import FitSettings
from quartercar.dampers.bench.characteristic import characteristic_line
from quartercar.dampers.fitting import fit
from quartercar.dampers.laws.relief_valve import LagDamper, ReliefValve, ReliefValveOrifice

AMPLITUDES = np.geomspace(0.23e-3, 27.28e-3, 11)
FREQUENCY, RATE = 3.5, 512.0
TRAINING, FAST = (0, 2, 4, 6, 7, 8), (9, 10)


def measured(truth: LagDamper, amplitude: float, rng: np.random.Generator) -> lpv.Record:
    """Two cycles on the virtual rig, with 1 % noise."""
    angle = 2 * np.pi * FREQUENCY * np.arange(round(2 * RATE / FREQUENCY)) / RATE
    motion = {"displacement": amplitude * np.sin(angle), "velocity": 2 * np.pi * FREQUENCY * amplitude * np.cos(angle)}
    units = {"displacement": "m", "velocity": "m/s", "force": "N"}
    force = truth.simulate(lpv.Record(motion, sample_time=1 / RATE, units=units)).output[:, 0]
    return lpv.Record({**motion, "force": force + 0.01 * force.std() * rng.normal(size=force.size)},
                      sample_time=1 / RATE, units=units, name=f"{1e3 * amplitude:.2f} mm")


def main(figure: Path | None = None) -> dict[str, float]:
    """Fit on low and middle amplitudes; free-run ESR on the two fastest, which no fit has seen."""
    rng = np.random.default_rng(1)
    records = [measured(ReliefValveOrifice(values={"friction": 80.0}), a, rng) for a in AMPLITUDES]
    settings = FitSettings(starts=2, polished=1, short_evaluations=5, evaluations=25, tolerance=1e-5)
    training, fast = [records[k] for k in TRAINING], [records[k] for k in FAST]
    fits = {m.name: fit(m, training, fast, settings) for m in (ReliefValve(), ReliefValveOrifice())}
    esr = {}
    print(f"{'held-out free run':24}{'training ESR':>14}{'held-out ESR':>14}")
    for name, found in fits.items():
        assert found.training.esr is not None and found.held_out is not None and found.held_out.esr is not None
        esr[name] = found.held_out.esr
        print(f"{name:24}{found.training.esr:14.5f}{found.held_out.esr:14.5f}")
    canvas = Figure(figsize=(7, 4), layout="constrained")
    axes = canvas.add_subplot(xlabel="largest velocity [m/s]", ylabel="largest force [kN]")
    largest = np.array([[r["velocity"].max(), 1e-3 * r["force"].max()] for r in records])
    axes.plot(*largest.T, "ko", label="virtual rig")
    for name, found in fits.items():
        line = characteristic_line(found.damper, AMPLITUDES, FREQUENCY)
        axes.plot(line.speed, 1e-3 * line.highest, label=name)
    axes.legend()
    show(canvas, figure)
    return esr


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
