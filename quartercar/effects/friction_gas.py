"""Friction and gas: forces in parallel with the law that depend on the direction of motion or on the position."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.condition.derivation import REVERSAL
from lpvid.effects.effect import EffectParameter, GridEffect, LpvChange
from quartercar.effects.force_output import no_force
from quartercar.effects.viscous import SLOW

FRICTION = EffectParameter("friction", "N", "F_c", 0.0, (0.0, 300.0), (0.0, 1e6), (20.0,))
"""force of dry friction, beside the law or behind a spring"""
TURNING = 0.1
"""share of the displacement travelled within which dry friction reverses: .07 at most in fits to measured dampers"""
POLYTROPIC = 1.3
"""exponent of gas between slow and quick strokes, as of air in the oil (equation sheet 3.5)"""
SHORTEST = 0.05
"""share of its length to which a column of gas is compressed at most: a refit must not reach the pole at zero length"""
NIL = 1e-7
"""deflection below which it counts as zero [m]: the few samples within it would not determine it"""


class ParallelForce(GridEffect):
    """A force that adds to that of the law."""

    family: ClassVar[str] = "friction"
    memoryless: ClassVar[bool] = True
    stage: ClassVar[str] = "force"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)


class CoulombFriction(ParallelForce):
    """Seal and guide friction F_c sign v, smoothed, or built up over a presliding deflection (equation sheet 3.1).

    With a deflection d, F = F_c z and d dz/d|x| = tanh(v/ε) − z: Dahl's model (1968), to which LuGre's reduces without
    breakaway. As d → 0 the force is F_c tanh(v/ε). The speed ε of the reversal, over which a film of lubricant builds
    up, is fitted: one that is too high leaves an error about every reversal, which a valve or a backlash would then
    explain (EMPS: three fifths of the error left by friction and damping were below 20 mm/s).
    """

    name: ClassVar[str] = "coulomb-friction"
    title: ClassVar[str] = "dry friction"
    equation: ClassVar[str] = "F += F_c z, d dz/d|x| = tanh(v/eps) - z; z = tanh(v/eps) for d = 0"
    reference: ClassVar[str] = "equation sheet 3.1; Dahl 1968"
    added_later: ClassVar[tuple[str, ...]] = ("turning_speed",)
    experiment: ClassVar[str] = "a triangle below 2 mm/s at constant current: half the difference of the two directions"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    partners: ClassVar[tuple[str, ...]] = ("series-compliance", "backlash")

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (FRICTION,
                EffectParameter("deflection", "m", "d, over which it builds up after a reversal", 0.0, (0.0, 3e-4),
                                (0.0, 0.5), (0.0, 2e-5, 1e-4)),
                EffectParameter("turning_speed", "m/s", "eps, over which the friction reverses", REVERSAL,
                                (1e-5, 0.01), (1e-6, 2.0), (REVERSAL,)))

    def is_static(self, values: np.ndarray) -> bool:
        return bool(values[1] < NIL)

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        turn = min(REVERSAL, SLOW * (scale("m/s") or np.inf))
        return [np.append(p[:2], turn) for p in super().spread_points(signals, scale)]

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Valves, where it reverses over much of the displacement: beyond their pressure, the force is constant too."""
        turning = travelled = 0.0
        for s in signals:
            way = np.abs(s["velocity"]) * s.sample_time
            travelled += float(way.sum())
            turning += float(way[np.abs(s["velocity"]) < float(values[2])].sum())
        return ("saturating-damping", "relief-valve") if turning > TURNING * travelled else ()

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        friction, deflection, turn = (float(v) for v in values)
        if not friction:
            return core
        return lambda s: core(s) + friction * direction(s, deflection, turn)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the sign of the velocity as a further input", regressors=("sign(velocity)",))


def direction(s: Signals, deflection: float, turn: float = REVERSAL) -> np.ndarray:
    """(n,) direction of motion in [−1, 1], which reverses over a speed [m/s] and a deflection [m].

    The motion before a record is unknown. The initial value is the mean of the record for that direction:
    σ Σzσ/Σσ², σ = tanh(v/ε), z from rest, limited to [0, σ]. That is near σ (sliding) where strokes are long, and near
    zero where they are shorter than d, for which an initial value of σ would decay over many strokes only.

    Parameters
    ----------
    s : Signals
        With velocity.
    deflection : float
        d [m]; below `NIL` it counts as zero.
    turn : float
        ε [m/s].

    Returns
    -------
    (n,) array
    """
    if deflection < NIL:
        return s.remembered("direction", turn, lambda: np.tanh(s["velocity"] / turn))

    def simulate() -> np.ndarray:
        from quartercar.effects._friction_kernels import NODES, bristles

        velocity, out = np.ascontiguousarray(s["velocity"]), np.empty(s.n_samples)
        goal = np.tanh(velocity / turn)
        bristles(velocity, s.sample_time, deflection, turn, NODES, 0.0, out)
        start = goal[0] * min(max(float(out @ goal) / max(float(goal @ goal), np.finfo(float).tiny), 0.0), 1.0)
        bristles(velocity, s.sample_time, deflection, turn, NODES, start, out)
        return out

    return s.remembered("bristles", (deflection, turn), simulate)


class InnerFriction(ParallelForce):
    """Dry friction in parallel to the law and, with it, in series with a spring.

    In the load path ``motion → spring → (law ∥ friction)`` the friction depends on the speed w = v − (1/k) dF/dt behind
    the spring, not on the measured one: after a reversal the force changes along the spring. Without an element in
    series it equals `CoulombFriction` without a deflection and is no candidate. The speed of its reversal is a
    parameter: lip seals and guides slide on oil, over a tenth of the speeds.
    """

    name: ClassVar[str] = "inner-friction"
    placement_of: ClassVar[str] = "coulomb-friction"
    behind: ClassVar[str] = "series"
    title: ClassVar[str] = "dry friction behind a series spring"
    stage: ClassVar[str] = "core"
    layer: ClassVar[int] = 2
    equation: ClassVar[str] = "F = law(w) + F_c tanh(w/eps), v = w + (1/k) dF/dt"
    reference: ClassVar[str] = "equation sheet 3.1, 3.5; Iwan 1966, a spring and a slider in series"
    experiment: ClassVar[str] = "small, slow strokes about a reversal: the slope of force over position is the spring's"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    partners: ClassVar[tuple[str, ...]] = ("series-compliance", "backlash")
    added_later: ClassVar[tuple[str, ...]] = ("turning_speed",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (FRICTION,
                EffectParameter("turning_speed", "m/s", "eps, over which the friction reverses", REVERSAL, (1e-4, 0.05),
                                (1e-6, 1.0), (REVERSAL,)))

    def is_static(self, values: np.ndarray) -> bool:
        return True

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        friction, speed = float(values[0]), float(values[1])
        if not friction:
            return core
        return lambda s: core(s) + friction * s.remembered("turning", speed, lambda: np.tanh(s["velocity"] / speed))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the sign of the velocity as a further input, and one more state",
                         regressors=("sign(velocity)",), order=1)


class StribeckFriction(ParallelForce):
    """Breakaway friction that decreases with speed (equation sheet 3.2)."""

    name: ClassVar[str] = "stribeck-friction"
    form_of: ClassVar[str] = "coulomb-friction"
    title: ClassVar[str] = "breakaway friction that decreases with speed"
    equation: ClassVar[str] = "F += F_s exp(-(v/v_S)^2) tanh(v/eps)"
    reference: ClassVar[str] = "equation sheet 3.2"
    experiment: ClassVar[str] = "a staircase of speeds from 0.1 to 50 mm/s in both directions, and dwells"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("breakaway", "N", "F_s, above the sliding friction", 0.0, (0.0, 300.0), (0.0, 1e6),
                                (30.0,)),
                EffectParameter("stribeck_speed", "m/s", "v_S", 0.01, (1e-3, 0.05), (1e-6, 2.0),
                                (0.002, 0.005, 0.01, 0.02, 0.05)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        force, speed = float(values[0]), float(values[1])
        return lambda s: core(s) + force * np.exp(-(s["velocity"] / speed) ** 2) * np.tanh(s["velocity"] / REVERSAL)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the sign of the velocity as a further input", regressors=("sign(velocity)",))


class GasPreload(ParallelForce):
    """Gas pressure on the rod: a constant outward force (equation sheet 3.3)."""

    name: ClassVar[str] = "gas-preload"
    title: ClassVar[str] = "gas force at mid stroke"
    family: ClassVar[str] = "elastic"
    equation: ClassVar[str] = "F -= P"
    reference: ClassVar[str] = "equation sheet 3.3"
    experiment: ClassVar[str] = "creep at several positions and temperatures: gas depends on both, an offset on neither"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("preload", "N", "P", 0.0, (0.0, 800.0), (0.0, 1e6), (50.0,)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        preload = float(values[0])
        return lambda s: core(s) - preload

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("a constant as a further input", regressors=("1",))


class GasStiffness(ParallelForce):
    """Gas spring (equation sheet 3.4), which hardens where the rod compresses a short column of gas.

    F = (K/(n c)) ((1 − c x)^(−n) − 1), n = `POLYTROPIC`: K at mid stroke, 1/c the length of the column there along the
    displacement, negative where the gas is compressed at negative displacement. As c → 0 it is K x. The ideal gas law
    of a closed column, p V^n constant; a column is compressed to a twentieth of its length at most.
    """

    name: ClassVar[str] = "gas-stiffness"
    title: ClassVar[str] = "gas spring"
    family: ClassVar[str] = "elastic"
    equation: ClassVar[str] = "F += K/(n c) ((1 - c x)^-n - 1); K x for c = 0"
    reference: ClassVar[str] = "equation sheet 3.4; polytropic gas column"
    added_later: ClassVar[tuple[str, ...]] = ("closing",)
    experiment: ClassVar[str] = "creep over the full stroke, or the same stroke at two frequencies"
    needs: ClassVar[tuple[str, ...]] = ("displacement",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("stiffness", "N/m", "K at mid stroke", 0.0, (0.0, 2e4), (0.0, 1e8), (500.0,)),
                EffectParameter("closing", "1/m", "c, one over the length of the gas column", 0.0,
                                (-1.0, 1.0), (-1e4, 1e4), (-3.0, 0.0, 3.0)))  # its prior is scaled to the data

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        stiffness, closing = float(values[0]), float(values[1])
        return (lambda s: core(s) + stiffness * column(s["displacement"], closing)) if stiffness else core

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the displacement as a further input", regressors=("displacement",))


def column(displacement: np.ndarray, closing: float) -> np.ndarray:
    """(n,) force of a gas column over its stiffness at mid stroke [m]: ((1 − c x)^(−n) − 1)/(n c), x for c = 0.

    Parameters
    ----------
    displacement : (n,) array
        x [m].
    closing : float
        c [1/m].

    Returns
    -------
    (n,) array

    Examples
    --------
    >>> column(np.array([-0.01, 0.0, 0.01]), 5.0).round(5).tolist()
    [-0.00946, 0.0, 0.01061]
    >>> bool(np.allclose(column(np.array([-0.01, 0.01]), 1e-7), [-0.01, 0.01]))
    True
    """
    logarithm = np.log1p(np.maximum(-closing * displacement, SHORTEST - 1.0))
    return np.expm1(-POLYTROPIC * logarithm) / (POLYTROPIC * closing) if closing else displacement
