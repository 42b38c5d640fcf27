"""Rates and forces of dampers with states as expressions, for model-exchange FMUs."""

from __future__ import annotations

import math

from lpvid.export.expression import Expr, RealConstant, call, select
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.dampers.laws.wang_kamath import WangKamath


def bouc_wen_flow(b: StepBuilder, damper: BoucWen, x: Expr, v: Expr, i: Expr) -> Expr:
    """F = c_1 ẏ + k_1 x + F_g; see `BoucWen`.

    Parameters
    ----------
    b : StepBuilder
        Takes the parameters, and the states y, z and the lagged current with their rates.
    damper : BoucWen
        At its own parameters.
    x, v, i : Expr
        Displacement from the centre [m], velocity [m/s], current.

    Returns
    -------
    Expr
        Force in the damper's own sense [N].
    """
    values = {p.name: b.parameter(p.name, damper.values[p.name], p.unit, p.description) for p in damper.parameters}
    zero = RealConstant(0.0)
    y, z = b.state("node", "m", "internal node y"), b.state("hysteresis", "", "hysteretic state z, saturated at 1")
    felt = None
    if damper.scheduled:
        felt = b.state("current_felt", damper.current_unit, "current behind the lag")

    def at(name: str) -> Expr:
        return values[name] if felt is None else values[name] + values[f"{name}_per_current"] * felt

    c0, c1 = b.let("c0", at("viscous_damping")), b.let("c1", at("series_damping"))
    spring = values["parallel_stiffness"] * (x - y) if damper.springs else zero
    rise = b.let("rise", (at("yield_force") * z + c0 * v + spring) / (c0 + c1))
    slip = b.let("slip", v - rise)
    exponent = values.get("exponent", RealConstant(damper.exponent))
    size = b.let("size", call("pow", call("fabs", z), exponent))
    sign = select(z > 0.0, 1.0, select(z < 0.0, -1.0, 0.0))
    shape = values["hysteresis_shape"]
    bend = (1.0 - shape) * call("fabs", slip) * sign + shape * slip
    b.rate(y, rise)
    b.rate(z, (slip - bend * size) / values["yield_displacement"])
    if felt is not None:
        b.rate(felt, values["current_rate"] * (call("fmax", i, 0.0) - felt))
    force = c1 * rise + values["gas_force"]
    return force + values["gas_stiffness"] * x if damper.springs else force


def wang_kamath_flow(b: StepBuilder, damper: WangKamath, v: Expr, i: Expr) -> Expr:
    """ẋ_1 = x_2, ẋ_2 = (v − w_2 x_2 − P(x_1))/w_1, F = F_s(1 + g i) x_1.

    Parameters
    ----------
    b : StepBuilder
        Takes the parameters, and the scaled force and its rate as states.
    damper : WangKamath
        At its own parameters.
    v, i : Expr
        Velocity [m/s], current.

    Returns
    -------
    Expr
        Force in the damper's own sense [N].
    """
    values = [b.parameter(p.name, damper.values[p.name], p.unit, p.description) for p in damper.parameters]
    d = damper.degree
    u = b.let("share", call("fmin", call("fmax", i / damper.current_scale, 0.0), 1.0)) if d else RealConstant(0.0)

    def coefficient(place: int) -> Expr:
        if not d:
            return values[place]
        rest = 1.0 - u
        total: Expr = RealConstant(0.0)
        for m in range(d + 1):
            term: Expr = values[place * (d + 1) + m] * float(math.comb(d, m))
            for factor in (*[u] * m, *[rest] * (d - m)):
                term = term * factor
            total = total + term
        return total

    w = [b.let("w", coefficient(k)) for k in range(5)]
    f = b.state("scaled_force", "", "force by its scale")
    g = b.state("scaled_rate", "1/s", "its derivative")
    s = b.let("square", f * f)
    b.rate(f, g)
    b.rate(g, (v - w[1] * g - f * (w[2] + s * (w[3] + s * w[4]))) / w[0])
    scale: Expr = b.parameter("force_scale", damper.force_scale, "N", "force scale F_s")
    return scale * (1.0 + values[5] * call("fmax", i, 0.0)) * f if damper.growing else scale * f
