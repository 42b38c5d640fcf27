"""How does the diagnosis get a cause of its user? Here: drag near one position of the stroke, in a virtual record."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import lpvid as lpv
import quartercar as qc
from lpvid.effects import EffectParameter, GridEffect
from lpvid.plot import show
from lpvid.plot.style import panels
from quartercar.rig import EXPERIMENTS, Rig, RigDamper

WIDTH, PLACE, DRAG = 0.001, 0.003, 60.0  # m, m, N


def drag(displacement, velocity, place):  # per newton of strength
    return np.exp(-((displacement - place) / WIDTH) ** 2) * np.tanh(velocity / 0.002)


class Scoring(GridEffect):
    """F += F_d exp(-((x - x_d)/w)^2) sign v."""

    name, title, family = "scoring", "drag near one position of the stroke", "friction"
    stage, equation, reference = "force", "F += F_d exp(-((x - x_d)/w)^2) tanh(v/eps)", "this example"
    experiment, needs = "creep over the whole stroke", ("displacement", "velocity")
    parameters = (EffectParameter("drag", "N", "F_d", 0.0, (0.0, 500.0), (0.0, 1e4), (20.0,)),
                  EffectParameter("place", "m", "x_d", 0.0, (-0.05, 0.05), (-0.1, 0.1), (-0.006, -0.003, 0.0, 0.003)))

    def applies(self, baseline, signals):
        return None if baseline.output == "force" else "it adds to a force"

    def compose(self, core, values, baseline):
        return lambda s: core(s) + values[0] * drag(s["displacement"], s["velocity"], values[1])

    def lpv_change(self):
        return None


def main(figure: str | None = None) -> lpv.Diagnosis:
    record = Rig(damper=RigDamper.static()).run(replace(EXPERIMENTS["test-3"], duration=20.0), seed=2)
    x, v = record["displacement"], record["velocity"]
    scored = record.with_channel("force", record["force"] + DRAG * drag(x, v, PLACE), "N")
    found = lpv.diagnose(scored, "guo", (*qc.effects.CATALOGUE, Scoring()))
    size, place = (p.value for p in found.causes[0].parameters) if found.causes else (0.0, 0.0)
    canvas, ((axes,),) = panels(1, 1, height=3.0)
    axes.plot(1e3 * x, DRAG * drag(x, v, PLACE), ".", label="added to the virtual record")
    axes.plot(1e3 * x, size * drag(x, v, place), ".", ms=1, label=f"found, verdict {found.verdict}")
    axes.set(xlabel="displacement [mm]", ylabel="drag [N]")
    axes.legend()
    show(canvas, figure)
    return found


if __name__ == "__main__":
    print(main(*sys.argv[1:]))
