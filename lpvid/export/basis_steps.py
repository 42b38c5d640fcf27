"""Scheduling bases, input stages and scheduling filters as steps of a program."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Array, Expr, Symbol, call, clipped, select
from lpvid.export.step_builder import StepBuilder
from lpvid.model.input_stage import InputStage, TanhStage, ThreeZoneStage
from lpvid.model.scheduling_stage import SchedulingLag, SchedulingStage
from lpvid.scheduling import Basis, Fourier, Polynomial, Product, Shifted, Spline, Stacked

History = Mapping[str, Callable[[int], Expr]]
"""For every scheduling variable, its value some samples ago."""


# -- bases -----------------------------------------------------------------------------------------------------------
def basis_values(b: StepBuilder, basis: Basis, past: History) -> list[Expr]:
    """The M functions of a basis as local values.

    Parameters
    ----------
    b : StepBuilder
    basis : Basis
    past : mapping of str to callable
        past[name](i) is p(k − i).

    Returns
    -------
    list of Expr
        φ_1 … φ_M at this sample, in the basis's own order; declared as locals where they are computed.

    Raises
    ------
    InputError
        A basis that reads future scheduling, or one that no step is known for.
    """
    if isinstance(basis, Polynomial):
        return _polynomial(b, basis, past)
    if isinstance(basis, Spline):
        return _spline(b, basis, past[basis.name](0))
    if isinstance(basis, Fourier):
        return _fourier(b, basis, past[basis.name](0))
    if isinstance(basis, Product):
        first, second = basis_values(b, basis.first, past), basis_values(b, basis.second, past)
        return [b.let("phi", f * g) for f in first for g in second]
    if isinstance(basis, Stacked):
        return [v for f in basis.factors for v in basis_values(b, f, past)]
    if isinstance(basis, Shifted):
        lag = basis.lag
        moved = {n: (lambda i, at=at: at(i + lag)) for n, at in past.items()}
        return basis_values(b, basis.basis, moved)
    raise InputError("this basis has no exported form", got=type(basis).__name__,
                     mend="lpvid.to_polynomial or lpvid.to_gridded rewrite a model over another basis")


def _polynomial(b: StepBuilder, basis: Polynomial, past: History) -> list[Expr]:
    powers: dict[tuple[int, int], Expr] = {}
    for j, name in enumerate(basis.names):
        centre, half = basis.centre[j], basis.half_width[j]
        plain = not centre and half == 1.0
        z: Expr = past[name](0) if plain else b.let(f"z_{name}", (past[name](0) - centre) / half)
        powers[j, 1] = z
        for e in range(2, basis.degree + 1):
            powers[j, e] = b.let(f"z_{name}_{e}", powers[j, e - 1] * z)
    values: list[Expr] = []
    for row in basis.exponents.tolist():
        factors = [powers[j, e] for j, e in enumerate(row) if e]
        value: Expr | None = None
        for f in factors:
            value = f if value is None else value * f
        values.append(b.let("phi", 1.0 if value is None else value))
    return values


def _fourier(b: StepBuilder, basis: Fourier, p: Expr) -> list[Expr]:
    values: list[Expr] = [b.let("phi", 1.0)]
    z = b.let(f"z_{basis.name}", p - basis.origin)
    for k in range(1, basis.harmonics + 1):
        angle = b.let("angle", z * (k * (2 * math.pi / basis.period)))
        values += [b.let("phi", call("cos", angle)), b.let("phi", call("sin", angle))]
    return values


def _spline(b: StepBuilder, basis: Spline, p: Expr) -> list[Expr]:
    """Cox-de Boor recursion on the segment that holds p; every value is written, so that no loop depends on data.

    C. de Boor, A Practical Guide to Splines (2001), X (20)-(23): B_{j,d} = Δ⁻ B_{j,d−1} + Δ⁺ B_{j+1,d−1} with
    quotients of knot differences.
    """
    d, n = basis.order, basis.size
    full = np.array(basis.knots)
    if not full.size:
        raise InputError(f"the spline in '{basis.name}' has no knots yet", mend="bind it to a box with .bound(box)")
    knots = b.table(f"knots_{basis.name}", np.concatenate([np.repeat(full[0], d), full, np.repeat(full[-1], d)]), "",
                    f"knots of the splines in {basis.name}")
    x = b.let(f"held_{basis.name}", clipped(p, full[0], full[-1]))
    values = b.array("spline", n)
    at = b.index("segment", d)
    with b.loop("knot", d + basis.segments, d + 1) as i, b.when(x >= knots[i]):
        b.set_index(at, i)
    # work[j] holds B_{at−d+j}; the recursion raises the degree in place, the highest place first
    work = b.array("work", d + 1)
    b.set(work[d], 1.0)
    for degree in range(1, d + 1):
        for j in range(d - degree, d + 1):
            place = at + (j - d)
            left: Expr = (x - knots[place]) / (knots[place + degree] - knots[place]) * work[j] if j > d - degree else \
                _ZERO
            right: Expr = (knots[place + degree + 1] - x) / (knots[place + degree + 1] - knots[place + 1]) \
                * work[j + 1] if j < d else _ZERO
            b.set(work[j], right if left is _ZERO else left if right is _ZERO else left + right)
    for j in range(d + 1):
        b.set(values[at + (j - d)], work[j])
    return [values[i] for i in range(n)]


_ZERO = Symbol("local", "zero")
"""Stands for a term that is not there."""


# -- input stages ----------------------------------------------------------------------------------------------------
def staged(b: StepBuilder, stage: InputStage | None, u: Sequence[Expr], p: Sequence[Expr]) -> list[Expr]:
    """Filter inputs from measured inputs and (filtered) scheduling.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements and the stage's parameters are added to.
    stage : InputStage or None
        None: the inputs pass unchanged.
    u : sequence of Expr
        Measured inputs at this sample, in the SI unit of each channel.
    p : sequence of Expr
        Scheduling behind its filter; empty for a model without scheduling, which drops the stage's slopes.

    Returns
    -------
    list of Expr
        Filter inputs: of a tanh stage the inputs and one shaped channel behind them, of a three-zone stage the inputs
        with its channel shaped in place.

    Raises
    ------
    InputError
        A stage that no step is known for.
    """
    if stage is None:
        return list(u)
    if isinstance(stage, TanhStage):
        v0 = b.parameter("knee", stage.v0, "", "velocity scale v_0 of the tanh input stage")
        scale: Expr = v0
        if stage.slope and p:
            slope = b.parameter("knee_slope", stage.slope, "", "change of v_0 per unit of the scheduling")
            scale = b.let("scale", call("fmax", v0 + slope * p[stage.variable], 0.05 * v0))
        return [*u, b.let("shaped", call("tanh", u[stage.channel] / scale))]
    if isinstance(stage, ThreeZoneStage):
        return _three_zone(b, stage, u, p)
    raise InputError("this input stage has no exported form", got=type(stage).__name__,
                     mend="a tanh or three-zone stage")


def _three_zone(b: StepBuilder, stage: ThreeZoneStage, u: Sequence[Expr], p: Sequence[Expr]) -> list[Expr]:
    stated = {"limit": "limit v_high of the middle zone", "upper": "slope ratio of the upper zone",
            "lower": "slope ratio of the lower zone"}
    named = {n: b.parameter(f"zone_{n}", getattr(stage, n), "", description) for n, description in stated.items()}
    values: dict[str, Expr] = dict(named)
    for n, description in stated.items():
        if p and getattr(stage, f"{n}_slope"):
            slope = b.parameter(f"zone_{n}_slope", getattr(stage, f"{n}_slope"), "", f"change of the {description}")
            values[n] = named[n] + slope * p[stage.variable]
    v = u[stage.channel]
    high = b.let("high", call("fmax", values["limit"], 0.02 * named["limit"]))
    shaped = clipped(v, -high, high) + values["upper"] * call("fmax", v - high, 0.0) \
        + values["lower"] * call("fmin", v + high, 0.0)
    out = list(u)
    out[stage.channel] = b.let("shaped", shaped)
    return out


# -- scheduling filters ----------------------------------------------------------------------------------------------
def filtered(b: StepBuilder, stage: SchedulingStage | None, names: Sequence[str], p: Sequence[Expr],
             first: Expr) -> list[Expr]:
    """Filtered scheduling of this sample; the filter starts settled where the condition `first` holds.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements and the filter's states and parameters are added to.
    stage : SchedulingStage or None
        None: the scheduling passes unchanged.
    names : sequence of str
        Scheduling variables, in the order of `p`.
    p : sequence of Expr
        Scheduling at this sample, in the unit of each variable.
    first : Expr
        Condition that holds at the first sample alone.

    Returns
    -------
    list of Expr
        As `p`, with the filter's variable replaced by its lagged value.

    Raises
    ------
    InputError
        A filter that no step is known for.
    """
    if stage is None:
        return list(p)
    if not isinstance(stage, SchedulingLag):
        raise InputError("this scheduling filter has no exported form", got=type(stage).__name__,
                         mend="a first-order lag (SchedulingLag)")
    i, period = stage.variable, b.sample_time
    name = names[i]
    command = p[i] if not stage.delay else _delayed(b, name, p[i], stage.delay / period, first)
    rise, fall = (1.0 if tau == 0 else float(-np.expm1(-period / tau)) for tau in (stage.tau_rise, stage.tau_fall))
    held = b.state(f"filtered_{name}", "", f"filtered {name}")
    up = b.parameter(f"{name}_rise", rise, "", f"share of the way per sample while {name} rises: 1 - exp(-T/tau_rise)")
    down = b.parameter(f"{name}_fall", fall, "", f"the same while {name} falls: 1 - exp(-T/tau_fall)")
    with b.when(first):
        b.set(held, command)
    error = b.let("error", command - held)
    b.set(held, held + select(error > 0.0, up, down) * error)
    out = list(p)
    out[i] = b.let(f"now_{name}", held)
    return out


def _delayed(b: StepBuilder, name: str, p: Expr, samples: float, first: Expr) -> Expr:
    """p some samples ago, linear in between; the log holds the newest first."""
    depth = int(np.ceil(samples)) + 1
    log = b.states(f"logged_{name}", np.zeros(depth), "", f"past values of {name}, the newest first")
    with b.when(first), b.loop("place", depth) as i:
        b.set(log[i], p)
    push(b, log, p)
    whole = int(np.floor(samples))
    share = samples - whole
    if not share:
        return log[whole]
    return b.let(f"late_{name}", (1.0 - share) * log[whole] + share * log[whole + 1])


def push(b: StepBuilder, log: Array, value: Expr) -> None:
    """A value at the head of a log; the oldest falls out.

    Parameters
    ----------
    b : StepBuilder
        Program that the statements are added to.
    log : Array
        (depth,) states, the newest first.
    value : Expr
        Newest value, in the unit of the log.
    """
    if log.shape[0] > 1:
        with b.loop("place", log.shape[0], 1, down=True) as i:
            b.set(log[i], log[i - 1])
    b.set(log[0], value)
