"""The hidden effect of source 002: a valve that follows its command late, missing in the model (DLR, Modelica 2014).

The device is the source's own Force Map with another spring, force 2.3 times larger in rebound, and a valve with eight
different time constants and delays; the baseline is a Force Map whose duty acts at once. Nothing in the records names
the valve.

Expected before the first run: the diagnosis names the electrical family (`rise-fall-lag` or `coil-lag`, with or
without `command-delay`) and nothing else; the time constants that it gives lie between the smallest and the largest of
the device; what depends on the direction of the stroke stays unexplained or is left to the lag, since no cause of the
catalogue has eight numbers.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import numpy as np
from study_002 import TRUE_LAG

import lpvid as lpv
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers import ForceMap
from quartercar.dampers.bench.semi_active_study import measured
from quartercar.effects import CATALOGUE

WORDS = ("time", "delay")
SHAPE = {"nodes": (0.1, 0.5), "knots": (-0.15, -0.03, -0.005, 0.0, 0.005, 0.03, 0.15), "current_unit": "1"}
HOLD = 160
"""samples (160 ms) between two steps of the duty: several time constants"""
SECONDS = 5.0


def device() -> ForceMap:
    """The Force Map with its valve."""
    values = {f"{e}_{w}_{p}": v for (p, e), pair in TRUE_LAG.items() for w, v in zip(WORDS, pair, strict=True)}
    for row, duty in enumerate(SHAPE["nodes"], 1):
        for k, speed in enumerate((0.005, 0.03, 0.15), 1):
            force = (40 + 1400 * duty) * (1 - np.exp(-speed / 0.02)) + (300 + 1500 * duty) * speed
            values[f"force_compression_{k}_{row}"], values[f"force_rebound_{k}_{row}"] = -force, 2.3 * force
    return ForceMap(**SHAPE, values={**values, "gas_stiffness": 1300.0, "gas_preload": -190.0})


def records() -> tuple[list[lpv.Record], lpv.Record]:
    """Saw-teeth with steps of the duty between random levels: two to learn from, one held out."""
    rng, n = np.random.default_rng(5), round(SECONDS * 1000)
    found = []
    for name, amplitude, speed in (("first", 0.025, 0.14), ("second", 0.018, 0.08), ("held-out", 0.022, 0.11)):
        duty = np.repeat(rng.uniform(0.1, 0.5, n // HOLD + 1), HOLD)[:n]
        found.append(measured(device(), name, duty, "saw", amplitude, speed, SECONDS, rng))
    return found[:2], found[2]


def diagnose() -> lpv.Diagnosis:
    """The whole catalogue over a Force Map without valve dynamics."""
    training, held_out = records()
    return lpv.diagnose(training, DamperBaseline(ForceMap(**SHAPE, lag="none")), CATALOGUE, held_out=[held_out])


def summary(found: lpv.Diagnosis) -> dict[str, Any]:
    """What the page shows."""
    rivals = [n for r in found.rivals for n in r.names]
    numbers = [[f"{c.name}: {p.name}", f"{p.value:.3g} {p.unit}" + ("" if p.std is None else f" ± {p.std:.1g}")]
               for c in found.causes for p in c.parameters]
    return {"verdict": found.verdict, "causes": [c.name for c in found.causes], "rivals": rivals, "numbers": numbers,
            "before": found.before.esr_held_out, "after": found.after and found.after.esr_held_out,
            "gain_percent": found.gain_percent}


if __name__ == "__main__":
    begun = time.perf_counter()
    result = diagnose()
    print(result, file=sys.stderr)
    print(json.dumps(summary(result)))
    print(f"{time.perf_counter() - begun:.0f} s", file=sys.stderr)
