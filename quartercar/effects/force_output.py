"""Force output: the condition that effects on a force share, and when one of them is another one's form."""

from __future__ import annotations

from lpvid.baselines.baseline import Baseline

SAME_FORM = 0.05
"""share of a range, or difference of a share or an exponent from 1, within which the form of one effect is another's"""


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
