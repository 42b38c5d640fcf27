"""Dampers of source 002 as step programs: the lagged current, the force map, and the extended Bouc-Wen model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.export.expression import Array, ByPrecision, Expr, Index, Real, Rounded, Symbol, call, select
from lpvid.export.step_builder import StepBuilder
from quartercar.dampers.laws._bouc_wen_kernels import ITERATIONS
from quartercar.dampers.laws.semi_active import SemiActiveDamper, sub_steps
from quartercar.dampers.stepper import GAMMA, RATIO

CLOSE = ByPrecision(1e-8, 3e-4)
"""relative Newton step after which one further step ends the stage: about the root of the arithmetic's round-off"""
BEYOND = ByPrecision(1e300, 1e30)
"""end of a bracket that is not known yet"""


# -- current ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class LaggedCurrent:
    """u_f and what moves it; see `quartercar.dampers.laws.current_lag.CurrentLag`.

    Attributes
    ----------
    state : Symbol
        u_f.
    log : Array
        Commands, the newest first.
    times, delays : Array
        (4,) compression rise, fall, rebound rise, fall [s].
    """

    state: Symbol
    log: Array
    times: Array
    delays: Array

    @classmethod
    def of(cls, b: StepBuilder, damper: SemiActiveDamper, command: Expr) -> LaggedCurrent:
        """Settled at the first command.

        Parameters
        ----------
        b : StepBuilder
            Takes the states and tables, and the shift of the log at every step.
        damper : SemiActiveDamper
            Gives time constants and delays.
        command : Expr
            Commanded current at this sample.

        Returns
        -------
        LaggedCurrent
            Its state still stands at the last sample, until `advance`.
        """
        times, delays = damper.current_lag.unpack(damper.parted(damper.vector)[2])
        depth = int(np.ceil(float(np.max(delays)) / b.sample_time)) + 3
        log = b.states("commands", np.zeros(depth), damper.current_unit, "commanded current, the newest first")
        state = b.state("current_felt", damper.current_unit, "current behind delay and lag")
        with b.when(b.first()):
            with b.loop("place", depth) as i:
                b.set(log[i], command)
            b.set(state, command)
        with b.loop("place", depth, 1, down=True) as i:
            b.set(log[i], log[i - 1])
        b.set(log[0], command)
        stated = "compression rise, compression fall, rebound rise, rebound fall"
        return cls(state, log, b.table("times", times, "s", f"time constants: {stated}"),
                   b.table("delays", delays, "s", f"delays: {stated}"))

    def delayed(self, b: StepBuilder, q: Expr) -> Expr:
        """Command at q ≤ 0 samples after this one, linear in between.

        Parameters
        ----------
        b : StepBuilder
            Takes the variables.
        q : Expr
            Samples from this one, not above zero; not earlier than the log reaches.

        Returns
        -------
        Expr
            In the unit of the command.
        """
        back = b.let("back", call("fmin", -call("fmin", call("floor", q), -1.0), float(self.log.shape[0] - 1)))
        share = b.let("share", q + back)
        return b.let("late", self.log[Rounded(back)] * (1.0 - share) + self.log[Rounded(back) - 1] * share)

    def advance(self, b: StepBuilder, begin: Expr, end: Expr, sense: Expr) -> None:
        """Over the part begin…end of the interval that ends now; the edge by the command at its end.

        Parameters
        ----------
        b : StepBuilder
            Takes the statements.
        begin, end : Expr
            Ends of the part, as shares of the sampling interval, 0 to 1.
        sense : Expr
            s of `sense`, held over the part.
        """
        h, uf, t, d = b.sample_time, self.state, self.times, self.delays
        up = b.let("up", ((1.0 - sense) * d[0] + sense * d[2]) / h)
        down = b.let("down", ((1.0 - sense) * d[1] + sense * d[3]) / h)
        rising = self.delayed(b, end - 1.0 - up) - uf > 0.0
        falling = self.delayed(b, end - 1.0 - down) - uf < 0.0
        rise = b.let("rise", select(rising & (~falling | (up < down)), 1.0, 0.0))
        with b.when(rising | falling):
            late = b.let("lateness", select(rise > 0.5, up, down))
            time = b.let("time", select(rise > 0.5, (1.0 - sense) * t[0] + sense * t[2],
                                        (1.0 - sense) * t[1] + sense * t[3]))
            first, last = b.let("from_here", begin - 1.0 - late), b.let("to_here", end - 1.0 - late)
            kink = b.let("kink", call("floor", last))
            u0, u1 = self.delayed(b, first), self.delayed(b, last)
            with b.when((kink > first) & (kink < last)):
                place = b.let("turn_place", call("fmin", -kink, float(self.log.shape[0] - 1)))
                turn = b.let("turn", self.log[Rounded(place)])
                self._ramp(b, u0, turn, (kink - first) * h, time)
                self._ramp(b, turn, u1, (last - kink) * h, time)
            with b.otherwise():
                self._ramp(b, u0, u1, (end - begin) * h, time)

    def _ramp(self, b: StepBuilder, u0: Expr, u1: Expr, dt: Expr, time: Expr) -> None:
        """T u̇_f + u_f = u over dt, exact for an input that is linear from u0 to u1."""
        r = b.let("ratio", dt / time)
        decay = b.let("decay", call("exp", -r))
        held = b.let("held", 1.0 - 0.5 * r)
        with b.when(r > ByPrecision(1e-7, 1e-3)):
            b.set(held, (1.0 - decay) / r)
        b.set(self.state, u1 + (self.state - u0) * decay - (u1 - u0) * held)


def sense(v: Expr, width: float) -> Expr:
    """s(v) = ½ tanh(v/ε) + ½: 1 in rebound, 0 in compression.

    Parameters
    ----------
    v : Expr
        v_d [m/s].
    width : float
        ε [m/s].

    Returns
    -------
    Expr
        Between 0 and 1.
    """
    return 0.5 * call("tanh", v / width) + 0.5


def place(b: StepBuilder, nodes: Array, value: Expr) -> tuple[Index, Expr]:
    """Index and weight of a value between rising nodes, held beyond the ends.

    Parameters
    ----------
    b : StepBuilder
        Takes the search.
    nodes : Array
        Rising, two at least.
    value : Expr
        In the unit of the nodes.

    Returns
    -------
    index : Index
        Of the node below.
    weight : Expr
        Of the node above, between 0 and 1.
    """
    j = b.index("node")
    with b.loop("node_scan", nodes.shape[0] - 1, 1) as i, b.when(value >= nodes[i]):
        b.set_index(j, i)
    return j, b.let("weight", call("fmin", call("fmax", (value - nodes[j]) / (nodes[j + 1] - nodes[j]), 0.0),
                                         1.0))


# -- force map -------------------------------------------------------------------------------------------------------
def force_map(b: StepBuilder, damper: SemiActiveDamper, speeds: np.ndarray, forces: np.ndarray, x: Expr, v: Expr,
              current: Expr) -> Expr:
    """Bilinear look-up of (v, u_f) and the gas spring.

    Parameters
    ----------
    b : StepBuilder
    damper : SemiActiveDamper
        Nodes of the current, its lag and the gas spring.
    speeds : (N,) array
        Knots [m/s].
    forces : (M, N) array
        Over nodes and knots [N].
    x, v, current : Expr
        Displacement from the centre, velocity, commanded current.

    Returns
    -------
    Expr
        [N].
    """
    lag = damper.current_lag
    table = b.table("forces", forces, "N", "force: node of the current, knot of the velocity")
    knots = b.table("knots", speeds, "m/s", "velocities of the table")
    felt: Expr = current
    nodes = None
    if damper.nodes:
        nodes = b.table("nodes", np.array(damper.nodes), damper.current_unit, "currents of the table")
    if damper.nodes and lag.sharing != "none":
        lagged = LaggedCurrent.of(b, damper, current)
        before = b.state("velocity_before", "m/s", "velocity at the last sample")
        with b.when(~b.first()), b.loop("part", lag.parts) as i:
            begin, end = b.let("begin", Real(i) / float(lag.parts)), b.let("end_part", (Real(i) + 1.0) / lag.parts)
            middle = before + 0.5 * (begin + end) * (v - before)
            lagged.advance(b, begin, end, b.let("direction", sense(middle, lag.width)))
        b.set(before, v)
        felt = lagged.state
    j = b.index("segment")
    with b.loop("knot", knots.shape[0] - 1, 1) as i, b.when(v >= knots[i]):
        b.set_index(j, i)
    w = b.let("share", (v - knots[j]) / (knots[j + 1] - knots[j]))
    if nodes is None:
        force: Expr = table[0, j] + w * (table[0, j + 1] - table[0, j])
    else:
        row, weight = place(b, nodes, felt)
        above = row + 1
        low = b.let("below", table[row, j] + w * (table[row, j + 1] - table[row, j]))
        high = b.let("above", table[above, j] + w * (table[above, j + 1] - table[above, j]))
        force = low + weight * (high - low)
    return force + _gas(b, damper, x)


def _gas(b: StepBuilder, damper: SemiActiveDamper, x: Expr) -> Expr:
    stiffness, preload = damper.parted(damper.vector)[1]
    constant = b.parameter("gas_preload", preload, "N", "force at rest")
    return b.parameter("gas_stiffness", stiffness, "N/m", "gas spring") * x + constant if damper.needs_displacement \
        else constant


# -- extended Bouc-Wen -----------------------------------------------------------------------------------------------
def extended_bouc_wen(b: StepBuilder, damper: SemiActiveDamper, tables: np.ndarray, exponent: float, x: Expr, v: Expr,
                      current: Expr) -> Expr:
    """F = c_1 ẏ + gas by implicit sub-steps of at most 1 ms; Newton's iteration is a loop of `ITERATIONS` passes.

    Parameters
    ----------
    b : StepBuilder
    damper : SemiActiveDamper
        Nodes of the current, its lag and the gas spring.
    tables : (2, M, 7) array
        c_0, k_0, c_1, α, β, γ, δ by direction and node.
    exponent : float
        n.
    x, v, current : Expr
        Displacement from the centre, velocity, commanded current.

    Returns
    -------
    Expr
        [N].
    """
    model = _Pair(b, damper, tables, exponent)
    lag = damper.current_lag
    felt = LaggedCurrent.of(b, damper, current) if damper.nodes else None
    before_x, before_v = (b.state(f"{n}_before", unit, f"{n} at the last sample") for n, unit in
                          (("displacement", "m"), ("velocity", "m/s")))
    with b.when(b.first()):
        b.set(model.y, x)
        model.mix(sense(v, lag.width), current)
        model.settle(v)
    with b.otherwise():
        parts = sub_steps(b.sample_time)
        h = b.sample_time / parts
        dx, dv = b.let("moved", x - before_x), b.let("sped", v - before_v)
        with b.loop("part", parts) as i:
            begin, end = b.let("begin", Real(i) / float(parts)), b.let("end_part", (Real(i) + 1.0) / float(parts))
            va, vb = b.let("va", before_v + begin * dv), b.let("vb", before_v + end * dv)
            direction = b.let("direction", sense(0.5 * (va + vb), lag.width))
            middle: Expr = current
            if felt is not None:
                old = b.let("old", felt.state)
                felt.advance(b, begin, end, direction)
                middle = b.let("middle", 0.5 * (old + felt.state))
            model.mix(direction, middle)
            model.advance(b.let("xa", before_x + begin * dx), b.let("xb", before_x + end * dx), va, vb, h)
    b.set(before_x, x)
    b.set(before_v, v)
    model.mix(sense(v, lag.width), current if felt is None else felt.state)
    c0, k0, c1, alpha = (model.row[i] for i in range(4))
    rate = (alpha * model.z + c0 * v + k0 * (x - model.y)) / (c0 + c1)
    return c1 * rate + _gas(b, damper, x)


class _Pair:
    """The internal node y and the hysteretic state z, with the parameters of the present direction and current."""

    def __init__(self, b: StepBuilder, damper: SemiActiveDamper, tables: np.ndarray, exponent: float) -> None:
        self._b, self._n = b, exponent
        self._tables = b.table("rows", tables, "", "c_0, k_0, c_1, alpha, beta, gamma, delta: direction (compression, "
                               "rebound), node of the current, parameter")
        self._nodes = b.table("nodes", np.array(damper.nodes), damper.current_unit, "currents of the rows") \
            if damper.nodes else None
        self.y = b.state("node", "m", "internal node y")
        self.z = b.state("hysteresis", "", "hysteretic state z, saturated at 1")
        self.row = b.array("row", tables.shape[2])

    def mix(self, s: Expr, felt: Expr) -> None:
        """Parameters at u_f and s: linear between nodes, s·rebound + (1 − s)·compression."""
        b, t = self._b, self._tables
        s = b.let("mix_sense", s)
        if self._nodes is None:
            with b.loop("parameter", t.shape[2]) as i:
                b.set(self.row[i], (1.0 - s) * t[0, 0, i] + s * t[1, 0, i])
            return
        j, weight = place(b, self._nodes, felt)
        after = j + 1
        with b.loop("parameter", t.shape[2]) as i:
            low = b.let("low_row", (1.0 - s) * t[0, j, i] + s * t[1, j, i])
            high = b.let("high_row", (1.0 - s) * t[0, after, i] + s * t[1, after, i])
            b.set(self.row[i], (1.0 - weight) * low + weight * high)

    def settle(self, v: Expr) -> None:
        """z at a constant speed: saturated where the yield force slips, else c_1 v/α."""
        b, c1, alpha = self._b, self.row[2], self.row[3]
        with b.when(alpha <= c1 * call("fabs", v)):
            b.set(self.z, select(v > 0.0, 1.0, select(v < 0.0, -1.0, 0.0)))
        with b.otherwise():
            b.set(self.z, c1 * v / alpha)

    def advance(self, x0: Expr, x1: Expr, v0: Expr, v1: Expr, h: float) -> None:
        """Two implicit stages (Alexander 1977); see `quartercar.dampers.laws._bouc_wen_kernels.advance`."""
        b, ah = self._b, GAMMA * h
        va, xa = b.let("v_stage", v0 + GAMMA * (v1 - v0)), b.let("x_stage", x0 + GAMMA * (x1 - x0))
        slip, za = self._stage(self.y, self.z, xa, va, ah)
        yb = b.let("y_between", self.y + RATIO * (ah * va - slip))
        zb = self._capped(b.let("z_between", self.z + RATIO * (za - self.z)))
        slip, zc = self._stage(yb, zb, x1, v1, ah)
        b.set(self.y, yb + ah * v1 - slip)
        b.set(self.z, zc)

    def _capped(self, ahead: Expr) -> Expr:
        """Not beyond saturation where z is not, either."""
        b, n = self._b, self._n
        beta, gamma, delta = self.row[4], self.row[5], self.row[6]
        out = b.let("z_start", ahead)
        ratio = b.let("bend_ratio", 0.0)
        with b.when(delta > 0.0):
            b.set(ratio, (beta + gamma) / delta)
        with b.when(ratio > 0.0):
            size = b.let("z_size", call("fabs", ahead))
            share = ratio * size * size if n == 2.0 else ratio * call("pow", size, n)
            top = b.let("z_top", call("pow", ratio, -1.0 / n))  # as the kernel rounds it: z may lie there exactly
            with b.when((share > 1.0) & (call("fabs", self.z) <= top)):
                b.set(out, select(ahead >= 0.0, top, -top))
        return out

    def _stage(self, y: Expr, z: Expr, x: Expr, v: Expr, ah: float) -> tuple[Expr, Expr]:
        """Slip and state of an implicit stage: Newton's iteration inside a bracket that only shrinks."""
        b, n = self._b, self._n
        c0, k0, c1, alpha, beta, gamma, delta = (self.row[i] for i in range(7))
        span = b.let("span", c0 + c1 + ah * k0)
        p = b.let("push", ah * (c1 * v - k0 * (x - y - ah * v)) / span)
        q = b.let("pull", ah * alpha / span)
        w0 = b.let("slip_first", p - q * z)
        side_of_slip = b.let("slip_side", select(w0 >= 0.0, 1.0, -1.0))
        root, low, high = b.let("root", z), b.let("lowest", -BEYOND), b.let("highest", BEYOND)
        scale = b.let("scale", call("fabs", z) + call("fabs", delta * w0))
        phase = b.let("phase", 0.0)  # 0: searching, 1: one step more, 2: done
        with b.loop("pass_number", ITERATIONS), b.when(phase < 1.5):
            side = b.let("root_side", select(root >= 0.0, 1.0, -1.0))
            size = b.let("root_size", side * root)
            bend = b.let("bend", gamma * side_of_slip * side + beta)
            power, slope = b.let("power", 0.0), b.let("slope", 0.0)
            with b.when(size > 0.0):
                b.set(power, size * size if n == 2.0 else call("pow", size, n))
                b.set(slope, -bend * n * power / root)
            gain, w = b.let("gain", delta - bend * power), b.let("slip_now", p - q * root)
            error = b.let("error", root - z - gain * w)
            with b.when(error > 0.0):
                b.set(high, call("fmin", high, root))
            with b.when(error < 0.0):
                b.set(low, call("fmax", low, root))
            steep = b.let("steep", 1.0 + q * gain - slope * w)
            step = b.let("newton", error)
            with b.when(steep > 0.0):
                b.set(step, error / steep)
            guess = b.let("guess", root - step)
            close = call("fabs", step) <= CLOSE * scale
            with b.when((phase < 0.5) & ((guess <= low) | (guess >= high)) & ~close & (high - low < BEYOND)):
                b.set(root, 0.5 * (low + high))
            with b.otherwise():
                b.set(root, guess)
                b.set(phase, select(phase > 0.5, 2.0, select(close, 1.0, 0.0)))
        return b.let("slip", p - q * root), root
