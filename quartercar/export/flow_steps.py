"""Dampers with states whose integration has no fixed step, as derivatives: for model-exchange FMUs."""

from __future__ import annotations

import numpy as np

from lpvid.export.contract import Options
from lpvid.export.expression import Expr, RealConstant
from lpvid.export.flow import Flow
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.drive import UNITS
from quartercar.dampers.families import DynamicDamper
from quartercar.export.damper_steps import excite

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
    low, high = noun.current_range or (0.0, 1.0)
    description = f"damper '{noun.title}' ({noun.source}): {', '.join(noun.reads)} -> force"
    b = StepBuilder(options.name or noun.name, description, 0.0)
    given: dict[str, Expr] = {}
    for name in noun.reads:
        unit = noun.current_unit if name == "current" else UNITS[name]
        ends = (low, high) if name == "current" and noun.current_range else (-np.inf, np.inf)
        given[name] = b.input(name, "" if unit == "1" else unit, name, *ends)
    x, v, i = (given.get(n, RealConstant(0.0)) for n in ("displacement", "velocity", "current"))
    if noun.centre and "displacement" in given:
        x = b.let("from_centre", x - b.parameter("centre", noun.centre, "m", "displacement that counts as zero"))
    force = noun.flow(b, x, v, i)
    if force is None:
        return None
    b.output("force", noun.polarity * force, "N", "damper force")
    return _flow(noun, b)


def _flow(damper: DynamicDamper, b: StepBuilder) -> Flow:
    names = damper.reads

    def motion(row: np.ndarray) -> tuple[float, float, float]:
        at = dict(zip(names, map(float, row), strict=True))
        return at.get("displacement", damper.centre) - damper.centre, at["velocity"], at.get("current", 0.0)

    def start(n: int, rng: np.random.Generator) -> np.ndarray:
        u = excite(damper, n, rng, STEP, False)
        for k, name in enumerate(names):
            if name == "displacement":
                u[:, k] += damper.centre - u[0, k]  # the internal node starts at zero displacement
        return u

    return Flow(b.program(), lambda z, row: damper.rates(z, *motion(row)),
                lambda z, row: np.array([damper.polarity * damper.output(z, *motion(row))]), start, STEP)
