"""Force output: the condition that effects on a force share."""

from __future__ import annotations

from lpvid.diagnosis.baseline import Baseline


def no_force(baseline: Baseline) -> str | None:
    """Why an effect on the force cannot be composed with a baseline; None where its output is a force.

    Parameters
    ----------
    baseline : Baseline

    Returns
    -------
    str or None
    """
    return None if baseline.output == "force" else f"{baseline.name} does not simulate a force"
