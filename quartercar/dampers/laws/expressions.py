"""Damper laws without memory as expressions of a step program."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from lpvid.export.expression import Expr, call, select
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.coefficients import Coefficient, Controlled, Proportional, Quotient
from quartercar.dampers.laws.kwok import Kwok
from quartercar.dampers.laws.power_law import PowerLawDamper, PowerLawFrictionGas
from quartercar.dampers.laws.tanh_law import TanhLaw

Law = Callable[[Expr, Expr, Expr], Expr]
"""(displacement from the centre, velocity, current) -> force in the damper's own sense."""


def parameters(b: StepBuilder, damper: StaticDamper) -> dict[str, Expr]:
    """Every parameter of a damper as one of the program, under its own name.

    Parameters
    ----------
    b : StepBuilder
        The program that takes them.
    damper : StaticDamper
        Gives values, units and descriptions.

    Returns
    -------
    dict of str to Expr
        By parameter name.
    """
    return {p.name: b.parameter(p.name, damper.values[p.name], p.unit, p.description) for p in damper.parameters}


def coefficient(c: Coefficient, named: dict[str, Expr]) -> Callable[[Expr], Expr]:
    """A coefficient as a function of the current, by the rule of `Coefficient.value`.

    Parameters
    ----------
    c : Coefficient
        Of one of the three kinds of `quartercar.dampers.laws.coefficients`.
    named : dict of str to Expr
        Parameters by name, as `parameters` returns them.

    Returns
    -------
    callable
        Current -> coefficient.
    """
    if isinstance(c, Controlled):
        return _controlled(c, [named[p.name] for p in c.parameters])
    if isinstance(c, Proportional):
        return lambda current: named[c.parameter.name] * current
    assert isinstance(c, Quotient)
    above = _controlled(c.numerator, [named[p.name] for p in c.numerator.parameters])
    rest: list[Expr | float] = [1.0, *(named[p.name] for p in c.denominator.parameters[1:])]
    below = _controlled(c.denominator, rest)
    return lambda current: above(current) / below(current)


def _controlled(c: Controlled, theta: list) -> Callable[[Expr], Expr]:
    low, high = c.span

    def value(current: Expr) -> Expr:
        if c.degree == 0:
            return theta[0]
        s = (current - low) / (high - low)
        level = list(theta)
        while len(level) > 1:
            level = [a + s * (other - a) for a, other in itertools.pairwise(level)]
        return level[0]

    return value


def tanh_expression(b: StepBuilder, damper: TanhLaw) -> Law:
    """F = A_1 tanh[A_3 (v + κ x)] + A_2 (v + κ' x) + F_0.

    Parameters
    ----------
    b : StepBuilder
        Takes the parameters.
    damper : TanhLaw
        At its own parameters.

    Returns
    -------
    callable
        (displacement from the centre, velocity, current) -> force in the damper's own sense.
    """
    named, terms = parameters(b, damper), damper.terms
    parts = [None if c is None else coefficient(c, named) for c in terms]
    force, sharp, post, ratio, post_ratio = parts
    assert force is not None and sharp is not None and post is not None

    def law(x: Expr, v: Expr, i: Expr) -> Expr:
        lagged = v if ratio is None else b.let("lagged", v + ratio(i) * x)
        post_lagged = lagged if post_ratio is None else v + post_ratio(i) * x
        total = force(i) * call("tanh", sharp(i) * lagged) + post(i) * post_lagged
        return total + named["offset"] if damper.offset else total

    return law


def kwok_expression(b: StepBuilder, damper: Kwok) -> Law:
    """F = c v + k x + α tanh(β v + δ tanh(x/ε)) + f_0.

    Parameters
    ----------
    b : StepBuilder
        Takes the parameters.
    damper : Kwok
        At its own parameters.

    Returns
    -------
    callable
        (displacement from the centre, velocity, current) -> force in the damper's own sense.
    """
    named = parameters(b, damper)
    width = b.parameter("turning_stroke", damper.turning_stroke, "m", "stroke over which the offset turns its sign")
    c, k, alpha, delta, offset = (coefficient(f, named) for f in damper.functions.values())

    def law(x: Expr, v: Expr, i: Expr) -> Expr:
        side = b.let("side", call("tanh", x / width))
        return (c(i) * v + k(i) * x + alpha(i) * call("tanh", named["sharpness"] * v + delta(i) * side)) + offset(i)

    return law


def power_law_expression(b: StepBuilder, damper: PowerLawDamper) -> Law:
    """F = C_1 v + C_n |v/v_ref|^n sign v, by direction; friction and gas beside it.

    Parameters
    ----------
    b : StepBuilder
        Takes the parameters.
    damper : PowerLawDamper
        At its own parameters.

    Returns
    -------
    callable
        (displacement from the centre, velocity, current) -> force in the damper's own sense.
    """
    named = parameters(b, damper)
    theta = [named[n] for n in damper.names]
    reference = b.parameter("reference_speed", damper.reference_speed, "m/s", "speed at which the power force is given")

    def law(x: Expr, v: Expr, i: Expr) -> Expr:
        rising, speed = v > 0.0, b.let("speed", call("fabs", v))
        linear, power, exponent = (b.let("side", select(rising, a, c)) for a, c in
                                   zip(theta[:3], theta[3:6], strict=True))
        sign = select(rising, 1.0, select(v < 0.0, -1.0, 0.0))
        total = sign * (linear * speed + power * call("pow", speed / reference, exponent))
        if isinstance(damper, PowerLawFrictionGas):
            columns = [call("tanh", v / damper.friction_speed), None, x][: 3 if damper.spring else 2]
            for weight, column in zip(theta[6:], columns, strict=True):
                total = total - weight if column is None else total + weight * column
        return total

    return law
