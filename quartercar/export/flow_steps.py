"""Dampers with states whose integration has no fixed step, as derivatives: for model-exchange FMUs."""

from __future__ import annotations

import numpy as np

from lpvid.export.contract import Options
from lpvid.export.flow import Flow
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.families import DynamicDamper
from quartercar.export.damper_steps import excite, motion

STEP = 2e-3
"""time between the samples of the random trajectory [s]"""


def flow_of(noun: object, options: Options) -> Flow | None:
    """The flow of a damper with smooth rates; None for what has none.

    Parameters
    ----------
    noun : object
        What is to be exported.
    options : Options
        Its name alone counts.

    Returns
    -------
    Flow or None
        From the inputs in `reads` to the force [N], with the sign of the records.
    """
    if not isinstance(noun, DynamicDamper):
        return None
    description = f"damper '{noun.title}' ({noun.source}): {', '.join(noun.reads)} -> force"
    b = StepBuilder(options.name or noun.name, description, 0.0)
    force = noun.flow(b, *motion(b, noun, {}))
    if force is None:
        return None
    b.output("force", noun.polarity * force, "N", "damper force")
    return _flow(noun, b)


def _flow(damper: DynamicDamper, b: StepBuilder) -> Flow:
    names = damper.reads

    def moved(row: np.ndarray) -> tuple[float, float, float]:
        at = dict(zip(names, map(float, row), strict=True))
        return at.get("displacement", damper.centre) - damper.centre, at["velocity"], at.get("current", 0.0)

    def start(n: int, rng: np.random.Generator) -> np.ndarray:
        u = excite(damper, n, rng, STEP, False)
        for k, name in enumerate(names):
            if name == "displacement":
                u[:, k] += damper.centre - u[0, k]  # the internal node starts at zero displacement
        return u

    return Flow(b.program(), lambda z, row: damper.rates(z, *moved(row)),
                lambda z, row: np.array([damper.polarity * damper.output(z, *moved(row))]), start, STEP)
