"""Model structure: forms that the simulation lacks, other than components of the damper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import MOST_POINTS, Effect, EffectParameter, GridEffect, LpvChange
from quartercar.effects.electrical import NO_BEND, CurrentEffect, along_current
from quartercar.effects.force_output import no_force
from quartercar.effects.structure import resonance_filtered

MODES = 10
"""number of slow cosines in an unlogged modulation"""


class SchedulingDegree(CurrentEffect):
    """The law depends on the current to a higher degree than the model (equation sheet 1.4.5).

    i_e = i + q (i² − i) + r (i³ − i), i in A: 0 and 1 A are unchanged, whatever the record.
    """

    name: ClassVar[str] = "scheduling-degree"
    memoryless: ClassVar[bool] = True
    flexible: ClassVar[bool] = True
    of_changes: ClassVar[bool] = False
    title: ClassVar[str] = "the law depends on the current to a higher degree than the model"
    family: ClassVar[str] = "model"
    between_two: ClassVar[str] = NO_BEND
    equation: ClassVar[str] = "i_e = i + q (i^2 - i) + r (i^3 - i), i in A"
    reference: ClassVar[str] = "equation sheet 1.4.5, 3.15"
    experiment: ClassVar[str] = "constant currents over the full range, at least five levels, the same motion at each"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("quadratic", "1/A", "q", 0.0, (-1.2, 1.2), (-4.0, 4.0), (-0.08, 0.08)),
                EffectParameter("cubic", "1/A^2", "r", 0.0, (-0.7, 0.7), (-4.0, 4.0), (0.0,)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        q, r = float(values[0]), float(values[1])
        if q == 0 and r == 0:
            return core

        def bent(s: Signals) -> np.ndarray:
            i = s["current"]
            return i + q * (i**2 - i) + r * (i**3 - i)

        return along_current(core, (self.name, q, r), bent, same_jumps=True)

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return ("current-saturation",)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one more degree in the current", degree=1)


class MissingScheduling(Effect):
    """The force is modulated slowly by a quantity that was not logged, or not used (equation sheet 1.4.5).

    Cosines have no slope at the ends, which the linear and the quadratic term add: a sine of four periods is
    approximated to 5 % instead of 23 %.

    t runs through all records of a diagnosis, one after the other, and T is their total length. On other records, whose
    place in that time is unknown, the modulation is unknown too and is left out.
    """

    name: ClassVar[str] = "missing-scheduling"
    flexible: ClassVar[bool] = True
    title: ClassVar[str] = "the force is modulated slowly by a quantity that the model does not read"
    family: ClassVar[str] = "model"
    stage: ClassVar[str] = "core"
    equation: ClassVar[str] = "F -> F (1 + sum_k m_k cos(pi k t/T) + a u + b (u^2 - 1/3)), k = 1..10, u = 2 t/T - 1"
    reference: ClassVar[str] = "equation sheet 1.4.5"
    experiment: ClassVar[str] = "log temperature, position and supply voltage along with a repeated segment"
    layer: ClassVar[int] = 2
    strengths: ClassVar[int] = MODES + 2

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        named = [*((f"mode_{k}", f"m_{k}") for k in range(1, MODES + 1)), ("slope", "a"), ("bend", "b")]
        return tuple(EffectParameter(name, "", description, 0.0, (-0.65, 0.65), (-0.9, 0.9), (-0.03, 0.03))
                     for name, description in named)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """The slowest cosines alone, either sign, as many as an effect has points."""
        sizes = self.parameters[0].grid[::-1]
        return [size * mode for mode in np.eye(MODES + 2)[: MOST_POINTS // 2] for size in sizes]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        if not np.any(values):
            return core

        def run(s: Signals) -> np.ndarray:
            if s.span is None:
                return core(s)
            record = s if s.record is None else s.record
            span, n = s.span, record.n_samples
            spans = [(t.span, last - first) for t, (first, last) in zip(record.stretches, record.pieces, strict=True)] \
                if record.stretches else [(span, n)]
            modes = record.cached(("slow modes", span), lambda: slow_modes(
                np.concatenate([np.linspace(*where, size) for where, size in spans])))
            return core(s) * s.of_record(1 + modes @ values)

        return run

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return ("thermal-fade", "viscous-fade")

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("a further scheduling variable, once it is logged", schedule=("temperature",))


def slow_modes(place: np.ndarray) -> np.ndarray:
    """(n, MODES + 2) basis functions of a slow modulation, at places from 0 to 1.

    Parameters
    ----------
    place : (n,) array
        Place in the time of all records, 0 their start and 1 their end.

    Returns
    -------
    (n, MODES + 2) array
        cos(π k place) for k from 1 on, u and u² − 1/3, u = 2 place − 1.
    """
    u = 2 * place - 1
    return np.column_stack([np.cos(np.pi * np.outer(place, np.arange(1, MODES + 1))), u, u**2 - 1 / 3])


class ModelOrder(GridEffect):
    """Part of the force passes a further mode (equation sheet 7.1)."""

    name: ClassVar[str] = "model-order"
    path: ClassVar[str] = "force"
    flexible: ClassVar[bool] = True
    title: ClassVar[str] = "a further dynamic mode between motion and force"
    family: ClassVar[str] = "model"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "F -> F + g (q - F), q = F/(1 + 2 zeta T s + T^2 s^2)"
    reference: ClassVar[str] = "equation sheet 7.1"
    experiment: ClassVar[str] = "a sweep beyond 50 Hz at small amplitude"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("share", "", "g; 1 is a resonance of the fixture", 0.0, (0.0, 0.8), (-2.0, 0.9),
                                (0.1,)),
                EffectParameter("time_constant", "s", "T = 1/omega = 1/(2 pi f)", 0.006, (0.001, 0.08), (0.0004, 0.3),
                                (0.0025, 0.006, 0.015, 0.04), former=("period",)),
                EffectParameter("damping", "", "zeta", 0.3, (0.01, 1.5), (0.005, 3.0), (0.1, 0.3, 0.8)))

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        share, period, damping = (float(v) for v in values)
        if share == 0:
            return core

        def run(s: Signals) -> np.ndarray:
            force = core(s)
            return force + share * (resonance_filtered(core, s, period, damping, baseline) - force)

        return run

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        return ("fixture-resonance", "force-delay", "valve-dynamics")

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one order more", order=1)


class ColouredNoise(Effect):
    """Coloured noise: found in the error left, by its whitening filter, and never composed."""

    name: ClassVar[str] = "coloured-noise"
    title: ClassVar[str] = "coloured noise on the force"
    family: ClassVar[str] = "noise"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F + v, A(q) v = e"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "the same segment repeated: noise differs, a cause does not"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("level", "N", "standard deviation", 0.0, (0.0, 1e4), (0.0, 1e6), (1.0,)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return []

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return "noise is estimated from the colour of the error left"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return core

    def lpv_change(self) -> LpvChange | None:
        return None
