"""What the laws without memory share as expressions of a step program."""

from __future__ import annotations

from collections.abc import Callable

from lpvid.export.expression import Expr
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.families import LawDamper

Law = Callable[[Expr, Expr, Expr], Expr]
"""(displacement from the centre, velocity, current) -> force in the damper's own sense."""


def named_parameters(b: StepBuilder, damper: LawDamper) -> dict[str, Expr]:
    """Every parameter of a damper as one of the program, under its own name.

    Parameters
    ----------
    b : StepBuilder
    damper : LawDamper

    Returns
    -------
    dict of str to Expr
    """
    return {p.name: b.parameter(p.name, damper.values[p.name], p.unit, p.description) for p in damper.parameters}
