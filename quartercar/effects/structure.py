"""Structure: stops, and the fixture between damper and load cell."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.baselines.spectra import SHORT, derivative
from lpvid.effects.effect import Effect, EffectParameter, GridEffect, LpvChange
from quartercar.effects.between_samples import between, times_as_fast
from quartercar.effects.electrical import SEEN_AFTER, clocked
from quartercar.effects.force_output import SAME_FORM, no_force
from quartercar.effects.resonances import natural_frequencies
from quartercar.effects.second_order import second_order
from quartercar.effects.viscous import thresholds

DEPTH = 1e-3
"""depth at which the stiffness of a progressive stop is defined [m]"""


class EndStop(Effect):
    """A stop that engages beyond a position on either side, linear or progressive (equation sheet 3.18)."""

    name: ClassVar[str] = "end-stop"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "an end stop engages near the end of the stroke"
    family: ClassVar[str] = "elastic"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "F += k d (d/mm)^(n-1) sign x, d = (|x| - x_s)+"
    reference: ClassVar[str] = "equation sheet 3.18"
    experiment: ClassVar[str] = "the full stroke, slowly and fast"
    needs: ClassVar[tuple[str, ...]] = ("displacement",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("stiffness", "N/m", "k, at a depth of 1 mm", 0.0, (0.0, 1e6), (0.0, 1e10), (3e4,)),
                EffectParameter("position", "m", "x_s from mid stroke", 0.01, (0.0, 0.2), (0.0, 0.5), (0.01,)),
                EffectParameter("exponent", "", "n, 1 for a linear stop, 1.5 for a rubber ball", 1.0, (1.0, 2.0),
                                (1.0, 3.0), (1.0,)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        stiffness, _, exponent = (p.grid[0] for p in self.parameters)
        *positions, _ = thresholds([s["displacement"] for s in signals])
        return [np.array([stiffness, position, exponent]) for position in positions]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        stiffness, position, exponent = map(float, values)
        if stiffness == 0:
            return core

        def run(s: Signals) -> np.ndarray:
            x = s["displacement"]
            depth = np.maximum(np.abs(x) - position, 0.0)
            return core(s) + stiffness * np.sign(x) * depth * (depth / DEPTH) ** (exponent - 1)

        return run

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """A spring for a linear stop at mid stroke, a hardening one for a progressive stop engaged in most samples."""
        position, exponent = float(values[1]), float(values[2])
        reach = np.concatenate([np.abs(s["displacement"]) for s in signals])
        if exponent - 1 < SAME_FORM:
            return ("gas-stiffness",) if position < SAME_FORM * reach.max() else ()
        return ("cubic-spring",) if position < np.median(reach) else ()

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on the displacement too", schedule=("displacement",))


class FixtureInertia(GridEffect):
    """Mass between the damper and the load cell (equation sheet 3.19)."""

    name: ClassVar[str] = "fixture-inertia"
    title: ClassVar[str] = "mass of the fixture between damper and load cell"
    family: ClassVar[str] = "structure"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "F_recorded = F + m a"
    reference: ClassVar[str] = "equation sheet 3.19"
    experiment: ClassVar[str] = "a sweep to 15 Hz and more without the damper, or with an accelerometer on the fixture"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("mass", "kg", "m", 0.0, (0.0, 20.0), (0.0, 1e6), (1.0,)),)

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        mass = float(values[0])
        return lambda s: core(s) + mass * acceleration(s)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the acceleration as a further input", regressors=("acceleration",))


class FixtureResonance(GridEffect):
    """A resonance of the fixture: the force passes a second-order low-pass before the load cell (sheet 3.19).

    A law without memory is evaluated between the samples too: the response of a resonance near half the sample rate
    depends on the time at which the force reverses, between two samples.
    """

    name: ClassVar[str] = "fixture-resonance"
    path: ClassVar[str] = "force"
    title: ClassVar[str] = "a resonance of the fixture colours the force"
    family: ClassVar[str] = "structure"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F/(1 + 2 zeta T s + T^2 s^2), T = 1/(2 pi f)"
    reference: ClassVar[str] = "equation sheet 3.10, 3.19"
    experiment: ClassVar[str] = "a hammer blow on the fixture, or a sweep to 200 Hz"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/omega = 1/(2 pi f)", 0.0, (0.0, 0.008), (0.0, 0.05),
                                (0.0012, 0.0016, 0.0021, 0.0027, 0.0036, 0.0048, 0.0065), former=("period",)),
                EffectParameter("damping", "", "zeta", 0.1, (0.005, 1.0), (0.002, 2.0), (0.05, 0.3)))

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """The same at natural frequencies that follow from the data (`natural_frequencies`)."""
        time_constant, damping = self.parameters
        bounds = 1 / (2 * np.pi * time_constant.bounds[1]), np.inf
        found = natural_frequencies(len(time_constant.grid), bounds, signals, scale)
        if found is None:
            return self.points(signals)
        return [np.array(p) for p in itertools.product(1 / (2 * np.pi * found[::-1]), damping.grid)]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        period, damping = float(values[0]), float(values[1])
        if period <= 0:
            return core
        return lambda s: resonance_filtered(core, s, period, damping, baseline)

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Delays and filters, where the resonance is above half the sample rate: its effect is a delay of the force."""
        beyond = np.pi * float(values[0]) / max(s.sample_time for s in signals) < 1
        return ("force-delay", "displacement-delay", "one-sided-filter") if beyond else ()

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two orders more", order=2)


def acceleration(s: Signals) -> np.ndarray:
    """(n,) measured acceleration, or the derivative of the velocity without its sensor's noise.

    Parameters
    ----------
    s : Signals
        With acceleration or velocity.

    Returns
    -------
    (n,) array
        [m/s²].
    """
    if s.has("acceleration"):
        return s["acceleration"]
    if s.coarse is not None:  # the band of its motion is that of the record
        return s.refined(acceleration(s.coarse))
    return s.fact("velocity", "rate of change", lambda v: derivative(s, "velocity"))


def resonance_filtered(core: Core, s: Signals, period: float, damping: float, baseline: Baseline) -> np.ndarray:
    """(n,) simulation filtered by 1/(1 + 2ζTs + T²s²), evaluated between the samples too where it has no memory.

    Parameters
    ----------
    core : Core
    s : Signals
    period : float
        T [s].
    damping : float
        ζ.
    baseline : Baseline
        Innermost law of the core; one with memory is simulated at the samples only.

    Returns
    -------
    (n,) array
        In the unit of the core.
    """
    finer = times_as_fast(baseline, s) if s.n_samples >= SHORT else 1
    fine = between(s, finer)
    before = _before_steps(core, fine) if clocked(s) else None
    return second_order(core(fine), period, damping, fine.sample_time, before, finer * SEEN_AFTER)[::finer]


def _before_steps(core: Core, s: Signals) -> np.ndarray:
    """(n,) simulation just before each sample, where a current steps at samples."""
    def current_of_before() -> Signals:
        return replace(s.replace(current=np.concatenate([s["current"][:1], s["current"][:-1]])), coarse=s.coarse)

    return core(s.cached("signals with the current before each sample", current_of_before))
