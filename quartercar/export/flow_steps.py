"""Dampers with states whose integration has no fixed step, as derivatives: for model-exchange FMUs."""

from __future__ import annotations

import math

import numpy as np

from lpvid.export.exportable import Options
from lpvid.export.expression import Expr, Number, call, select
from lpvid.export.flow import Flow
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.drive import UNITS
from quartercar.dampers.families import DynamicDamper
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.dampers.laws.wang_kamath import WangKamath
from quartercar.export.damper_steps import excite

STEP = 2e-3
"""time between the samples of the random trajectory [s]"""


def flow_of(noun: object, options: Options) -> Flow | None:
    """The flow of a damper with smooth rates; None for what has none."""
    if not isinstance(noun, (BoucWen, WangKamath)):
        return None
    low, high = noun.current_range or (0.0, 1.0)
    says = f"damper '{noun.title}' ({noun.source}): {', '.join(noun.reads)} -> force"
    b = StepBuilder(options.name or noun.name, says, 0.0)
    given: dict[str, Expr] = {}
    for name in noun.reads:
        unit = noun.current_unit if name == "current" else UNITS[name]
        ends = (low, high) if name == "current" and noun.current_range else (-np.inf, np.inf)
        given[name] = b.input(name, "" if unit == "1" else unit, name, *ends)
    x, v, i = (given.get(n, Number(0.0)) for n in ("displacement", "velocity", "current"))
    if noun.centre and "displacement" in given:
        x = b.let("from_centre", x - b.parameter("centre", noun.centre, "m", "displacement that counts as zero"))
    force = _bouc_wen(b, noun, x, v, i) if isinstance(noun, BoucWen) else _wang_kamath(b, noun, v, i)
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


def _bouc_wen(b: StepBuilder, damper: BoucWen, x: Expr, v: Expr, i: Expr) -> Expr:
    """F = c_1 ẏ + k_1 x + F_g; see `BoucWen`."""
    values = {p.name: b.parameter(p.name, damper.values[p.name], p.unit, p.says) for p in damper.parameters}
    zero = Number(0.0)
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
    exponent = values.get("exponent", Number(damper.exponent))
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


def _wang_kamath(b: StepBuilder, damper: WangKamath, v: Expr, i: Expr) -> Expr:
    """ẋ_1 = x_2, ẋ_2 = (v − w_2 x_2 − P(x_1))/w_1, F = F_s(1 + g i) x_1."""
    values = [b.parameter(p.name, damper.values[p.name], p.unit, p.says) for p in damper.parameters]
    d = damper.degree
    u = b.let("share", call("fmin", call("fmax", i / damper.current_scale, 0.0), 1.0)) if d else Number(0.0)

    def coefficient(place: int) -> Expr:
        if not d:
            return values[place]
        rest = 1.0 - u
        total: Expr = Number(0.0)
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
