"""Does a damper law identified from ramps predict sines, in work per cycle (its paper's claim) and at every instant?"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid import excitation
from lpvid.plot import show
from lpvid.plot.style import label, look, panels
from quartercar.dampers.bench.creep import static_forces
from quartercar.dampers.bench.gas_damper_study import measured, work_table
from quartercar.dampers.bench.ramps import fit_ramps

CREEP = ((0.010, 0.002), (0.063, 0.020))    # X [m], speed [m/s]


def draw(loops: list[lpv.Record], path: Path | None) -> None:
    """Work diagrams above, force over velocity below: as measured, and the law from the ramps."""
    with look():
        figure, axes = panels(2, len(loops), height=2.8)
        for pair, loop in zip(axes.T, loops, strict=True):
            for ax, name in zip(pair, ("displacement", "velocity"), strict=True):
                ax.plot(loop[name], loop["force"], loop[name], loop["law"], linewidth=1)
                ax.set(xlabel=label(name, loop.unit(name)), ylabel=label("force", "N"), title=loop.name)
        axes[0, 0].legend(("virtual rig", "law from ramps"), loc="center")
        show(figure, path)


def main(figure: Path | None = None) -> dict[tuple[float, float], tuple[float, float]]:
    """Fit on ramps and creep, check on the paper's sines; returns (deviation of work, ESR) by (X, f)."""
    rng = np.random.default_rng(1)
    print(work_table(), *work_table().contradictions(), sep="\n")
    creep = [measured(excitation.triangle(int(9000 * x / v), 1000.0, amplitude=x, frequency=v / (4 * x)), 1000.0, rng)
             for x, v in CREEP]
    ramps = [measured(excitation.triangle(int(2500 / f), 1000.0, amplitude=0.063, frequency=f, acceleration=60.0),
                      1000.0, rng) for f in (0.2, 0.4, 1.0, 2.0, 2.7)]     # the paper's ramps [Hz]
    found = fit_ramps([*ramps, *creep])
    print(found, static_forces(creep, found.law), sep="\n")
    results, loops = {}, []
    for row in work_table().rows:
        x = excitation.sine(2000, 1000 * row.frequency, amplitude=row.amplitude, frequency=row.frequency)
        name = f"{1e3 * row.amplitude:g} mm, {row.frequency:g} Hz"
        last = measured(x, 1000 * row.frequency, rng, name).slice(1000, 2000)
        force, law = last["force"], found.law.simulate(last).output[:, 0]
        done, predicted = (float(np.mean(f * last["velocity"])) / row.frequency for f in (force, law))
        esr = float(np.sum((force - law) ** 2) / np.sum((force - force.mean()) ** 2))
        results[row.amplitude, row.frequency] = predicted / done - 1, esr
        loops.append(last.with_channel("law", law, "N"))
        print(f"{name}: work {done:.3f} J, law {predicted:.3f} J ({predicted / done - 1:+.1%}), ESR {esr:.4f}")
    draw(loops[1::2], figure)
    return results


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
