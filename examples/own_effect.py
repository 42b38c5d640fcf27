"""How do I teach the diagnosis a cause of my own? Write what it does to a simulation; the rest is there.

Here: a scoring mark in the cylinder, a drag near one position of the stroke. The rig knows no such thing: its records
get the drag added, as if it had been measured.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

import lpvid as lpv
import quartercar as qc
from lpvid.diagnosis.effect import EffectParameter, GridEffect
from quartercar.rig import EXPERIMENTS, Rig, RigDamper

WIDTH, PLACE, DRAG = 0.001, 0.003, 60.0  # m, m, N


def drag(displacement, velocity, place):
    """Drag per newton of strength."""
    return np.exp(-((displacement - place) / WIDTH) ** 2) * np.tanh(velocity / 0.002)


class Scoring(GridEffect):
    """F += F_d exp(-((x - x_d)/w)^2) sign v."""

    name: ClassVar[str] = "scoring"
    title: ClassVar[str] = "drag near one position of the stroke"
    family: ClassVar[str] = "friction and gas"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "F += F_d exp(-((x - x_d)/w)^2) tanh(v/eps)"
    reference: ClassVar[str] = "this example"
    experiment: ClassVar[str] = "creep over the whole stroke"
    needs: ClassVar[tuple[str, ...]] = ("displacement", "velocity")
    parameters = (EffectParameter("drag", "N", "F_d", 0.0, (0.0, 500.0), (0.0, 1e4), (20.0,)),
                  EffectParameter("place", "m", "x_d", 0.0, (-0.05, 0.05), (-0.1, 0.1), (-0.006, -0.003, 0.0, 0.003)))

    def applies(self, baseline, signals):
        return None if baseline.output == "force" else "it adds to a force"

    def compose(self, core, values, baseline):
        return lambda s: core(s) + values[0] * drag(s["displacement"], s["velocity"], values[1])

    def lpv_change(self):
        return None


def main() -> lpv.Diagnosis:
    record = Rig(damper=RigDamper.static()).run(replace(EXPERIMENTS["test-3"], duration=20.0), seed=2)
    scored = record["force"] + DRAG * drag(record["displacement"], record["velocity"], PLACE)
    return lpv.diagnose(record.with_channel("force", scored, "N"), "guo", (*qc.effects.CATALOGUE, Scoring()))


if __name__ == "__main__":
    print(main())
