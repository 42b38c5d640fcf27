"""Hydraulics: restrictions, valves and cavities that change the viscous share of the law."""

from __future__ import annotations

import itertools
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import SPREAD, Effect, EffectParameter, LpvChange
from lpvid.rounding import TINY
from quartercar.effects.force_output import SAME_FORM, no_force
from quartercar.effects.likeness import closer_to_sign
from quartercar.effects.resonances import natural_frequencies
from quartercar.effects.second_order import second_order
from quartercar.effects.series import in_series
from quartercar.effects.viscous import (
    SLOW,
    measured_slope,
    speed_quantiles,
    thresholds,
    top_speed,
    viscous_slope,
)

UNIT_SPEED = 0.1
"""speed at which the exponent of the viscous share does not change the force [m/s]"""


class HydraulicEffect(Effect):
    """A cause in the hydraulic path, which reads the speed and the viscous share of the law."""

    family: ClassVar[str] = "hydraulics"
    memoryless: ClassVar[bool] = True
    stage: ClassVar[str] = "core"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @abstractmethod
    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        """(n,) force that it adds.

        Parameters
        ----------
        s : Signals
        core : Core
            The simulation without it [N].
        values : (k,) array
            Parameters of the effect.
        baseline : Baseline
            Innermost law of the core.

        Returns
        -------
        (n,) array
            [N].
        """

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        if values[0] == self.parameters[0].neutral:
            return core
        return lambda s: core(s) + self.added(s, core, values, baseline)


class QuadraticLoss(HydraulicEffect):
    """A turbulent restriction in series with the law's own (equation sheet 3.8)."""

    name: ClassVar[str] = "quadratic-loss"
    title: ClassVar[str] = "turbulent loss"
    equation: ClassVar[str] = "F += c_Q v |v|"
    reference: ClassVar[str] = "equation sheet 3.8; source 003, (4)"
    experiment: ClassVar[str] = "triangles at ten speeds over 1.5 decades, log-log slope of the force"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("coefficient", "N*s^2/m^2", "c_Q", 0.0, (0.0, 5e4), (0.0, 1e9), (1000.0,)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([p.grid[0]]) for p in self.parameters]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if baseline.name.startswith("network-"):
            return "a network has turbulent losses of its own; 'network-topology' connects them otherwise"
        if baseline.name.startswith("relief-valve"):
            return ("its main orifice is turbulent, so that a further one acts above the opening of the valve only: "
                    "'series-orifice'")
        return super().applies(baseline, signals)

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        return float(values[0]) * s.cached("v|v|", lambda: s["velocity"] * np.abs(s["velocity"]))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("v|v| as a further input", regressors=("velocity|velocity|",))


class Asymmetry(HydraulicEffect):
    """Rebound and compression differ: separate valves for the two directions (equation sheet 3.11)."""

    name: ClassVar[str] = "asymmetry"
    title: ClassVar[str] = "rebound and compression differ by a factor"
    equation: ClassVar[str] = "F -> F + g (F - F(v = 0)) where v > 0"
    reference: ClassVar[str] = "equation sheet 3.11"
    experiment: ClassVar[str] = "both directions at several speeds and currents: the even part grows with the speed"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("gain", "", "g, rebound over compression less one", 0.0, (-0.8, 7.0), (-0.95, 20.0),
                                (-0.1, 0.1)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([g]) for g in self.parameters[0].grid]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        gain, force = float(values[0]), core(s)
        if not baseline.static:  # the force of a core with memory lags; its sign is the direction of the flow
            return gain * np.maximum(force, 0.0)
        resting = s.cached("signals at rest", lambda: s.evaluated(velocity=np.zeros(s.n_samples)))
        return gain * np.where(s["velocity"] > 0, force - core(resting), 0.0)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on the sign of the velocity", schedule=("sign(velocity)",))


class ReliefValve(HydraulicEffect):
    """A spring-loaded valve beside the main path opens at a pressure (equation sheet 3.9)."""

    name: ClassVar[str] = "relief-valve"
    title: ClassVar[str] = "a relief valve opens beyond a force"
    equation: ClassVar[str] = "F -= r (c(i)|v| - F_b)+ sign v, c(i) the viscous share of the law"
    reference: ClassVar[str] = "equation sheet 3.9; source 001"
    experiment: ClassVar[str] = "triangles of at least 15 speeds up to three times that of the knee, at two currents"
    smooth: ClassVar[bool] = False
    rugged: ClassVar[str] = "opening_force"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("relief", "", "r, share of the slope that goes beyond the knee", 0.0, (0.0, 1.0),
                                (0.0, 1.2), (0.5,)),
                EffectParameter("opening_force", "N", "F_b", 100.0, (5.0, 5e3), (0.1, 1e6), (30.0, 100.0, 300.0)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """By the slope of the force over the speed and, where currents or friction hide that, by the force itself."""
        by_slope = [measured_slope(signals) * v for v in thresholds([s["velocity"] for s in signals])]
        by_force = thresholds([s.output for s in signals])
        least = self.parameters[1].bounds[0]
        return [np.array([r, max(f, least)]) for r in self.parameters[0].grid for f in (*by_slope, *by_force) if f > 0]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        v = s["velocity"]
        flow = np.abs(v) * viscous_slope(s, core, baseline)
        return -float(values[0]) * np.maximum(flow - float(values[1]), 0.0) * np.sign(v)

    def lpv_change(self) -> LpvChange | None:
        return None


class SeriesOrifice(HydraulicEffect):
    """An orifice in series with a valve (equation sheet 3.9; source 001, extended model)."""

    name: ClassVar[str] = "series-orifice"
    title: ClassVar[str] = "an orifice behind the valve, with a loss from some speed on"
    equation: ClassVar[str] = "F += c_o (|v| - v_o)+^2 sign v"
    reference: ClassVar[str] = "equation sheet 3.9; source 001, extended model"
    experiment: ClassVar[str] = "triangles up to well beyond the knee: the force changes from concave to convex"
    smooth: ClassVar[bool] = False
    rugged: ClassVar[str] = "onset"
    contains: ClassVar[tuple[str, ...]] = ("quadratic-loss",)  # it opens at once

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("coefficient", "N*s^2/m^2", "c_o", 0.0, (0.0, 1e6), (0.0, 1e9), (5e3,)),
                EffectParameter("onset", "m/s", "v_o, speed from which flow passes it", 0.05, (0.0, 2.0), (0.0, 20.0),
                                (0.02, 0.05, 0.1)))

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """A turbulent loss where it begins at the slowest speeds: viscous share and friction explain the difference."""
        return ("quadratic-loss",) if float(values[1]) < speed_quantiles(signals, (SAME_FORM,))[0] else ()

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        *onsets, top = thresholds([s["velocity"] for s in signals])
        force = SPREAD[1] * np.mean([s.output.std() for s in signals])
        return [np.array([force / (top - onset) ** 2, onset]) for onset in (0.0, *onsets) if onset < top]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if baseline.name.startswith("network-"):
            return "a network has no valve; a restriction in series with it is 'network-topology'"
        return super().applies(baseline, signals)

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        v = s["velocity"]
        return float(values[0]) * np.maximum(np.abs(v) - float(values[1]), 0.0) ** 2 * np.sign(v)

    def lpv_change(self) -> LpvChange | None:
        return None


class InputNonlinearity(HydraulicEffect):
    """The viscous share is another power of the speed (equation sheet 9.1)."""

    name: ClassVar[str] = "input-nonlinearity"
    flexible: ClassVar[bool] = True
    title: ClassVar[str] = "the viscous share is another power of the speed"
    equation: ClassVar[str] = "c(i) v becomes c(i) v (|v|/0.1 m/s)^(n - 1)"
    reference: ClassVar[str] = "equation sheet 9.1; source 000, (1)"
    experiment: ClassVar[str] = "triangles at ten speeds over 1.5 decades, log-log slope of the force"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("exponent", "", "n", 1.0, (0.3, 3.0), (0.1, 6.0), (0.5, 0.8, 1.25, 1.6, 2.2)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([n]) for n in self.parameters[0].grid]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        v = s["velocity"]
        ratio = np.maximum(np.abs(v), TINY) / UNIT_SPEED
        return viscous_slope(s, core, baseline) * v * (ratio ** (float(values[0]) - 1.0) - 1.0)

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Dry friction with another reversal, where |v|^n sgn v is closer to it than to a viscous loss along the data.

        With speeds that are evenly distributed, n < .37.
        """
        speed = np.concatenate([np.abs(s["velocity"]) for s in signals])
        return ("coulomb-friction",) if closer_to_sign(speed ** float(values[0]), speed) else ()

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Turbulent losses where the force grows faster than the speed, valves that open where it grows less fast."""
        grows = float(values[0]) > 1
        return ("quadratic-loss", "series-orifice", "network-topology") if grows else \
            ("saturating-damping", "relief-valve", "network-topology")

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("v|v| as a further input", regressors=("velocity|velocity|",))


class NetworkTopology(HydraulicEffect):
    """Laminar and turbulent losses are connected otherwise: in parallel instead of in series (source 003).

    Of a parallel network, laminar leak c beside an orifice c_Q, ::

        |v| = F/c + √(F/c_Q)        F = c|v| q,  (1 − q)² = q v_t/(2|v|),  v_t = 2c/c_Q

    replaces the viscous share c(i)v. Where the baseline is itself a parallel network, the series network
    c|v|(1 + |v|/v_t) replaces all of its hydraulic force.
    """

    name: ClassVar[str] = "network-topology"
    title: ClassVar[str] = "the restrictions are connected otherwise"
    equation: ClassVar[str] = ("c v -> (1 - s) c v + s c v q, (1 - q)^2 = q v_t/(2|v|); "
                               "a parallel network -> s c v (1 + |v|/v_t)")
    reference: ClassVar[str] = "equation sheet 3.8; source 003, (5), (6)"
    experiment: ClassVar[str] = "triangles at ten speeds over 1.5 decades: log-log slope 1 to 2 or 2 to 1"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("share", "", "s, of the other network", 0.0, (0.0, 1.0), (0.0, 1.2), (0.5, 1.0)),
                EffectParameter("transition", "m/s", "v_t, speed between laminar and turbulent", 0.2, (1e-3, 5.0),
                                (1e-4, 50.0), (0.05, 0.2, 1.0)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        top = top_speed(signals)
        return [np.array([s, t * top]) for s in self.parameters[0].grid for t in 4.0 ** np.arange(-2, 1)]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        share, transition = float(values[0]), float(values[1])
        v = s["velocity"]
        viscous = viscous_slope(s, core, baseline) * v
        if baseline.name == "network-parallel":
            return share * (viscous * (1 + np.abs(v) / transition) - _hydraulic_force(s, core))
        speed, quarter = np.abs(v), transition / 4
        q = speed / (speed + quarter + np.sqrt(quarter * (quarter + 2.0 * speed)))
        return share * viscous * (q - 1.0)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("v|v| as a further input", regressors=("velocity|velocity|",))


def _hydraulic_force(s: Signals, core: Core) -> np.ndarray:
    """(n,) force of an odd law less its dry friction, the force at the lowest speeds."""
    v = s["velocity"]
    slow = np.clip(v, *(SLOW * float(np.abs(v).max()) * np.array([-1.0, 1.0])))
    parts = [core(s.replace(velocity=sign * x)) * sign * share for x, share in ((v, 0.5), (slow, -0.5))
             for sign in (1.0, -1.0)]
    return np.sum(parts, axis=0)


class ValveDynamics(HydraulicEffect):
    """The valve has a mass: its share of the force has second-order dynamics (equation sheet 3.10)."""

    name: ClassVar[str] = "valve-dynamics"
    path: ClassVar[str] = "force"
    memoryless: ClassVar[bool] = False
    title: ClassVar[str] = "the valve has a mass and a spring of its own"
    stage: ClassVar[str] = "force"
    equation: ClassVar[str] = "F += s (q - f), f = c(i) v, q'' + 2 zeta w q' + w^2 q = w^2 f"
    reference: ClassVar[str] = "equation sheet 3.10"
    experiment: ClassVar[str] = "triangles with sharp corners, sampled at 1 kHz or more: ringing after each reversal"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("share", "", "s, of the viscous force that passes it", 0.0, (0.0, 1.0), (0.0, 1.0),
                                (0.5,)),
                EffectParameter("frequency", "Hz", "w/(2 pi)", 50.0, (5.0, 500.0), (1.0, 2000.0), (15.0, 40.0, 100.0)),
                EffectParameter("damping", "", "zeta", 0.2, (0.02, 0.4), (0.005, 0.7), (0.15, 0.5)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array(p) for p in itertools.product(*(p.grid for p in self.parameters))]

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """The same at natural frequencies that follow from the data (`natural_frequencies`)."""
        share, frequency, damping = self.parameters
        found = natural_frequencies(len(frequency.grid), frequency.bounds, signals, scale)
        if found is None:
            return self.points(signals)
        return [np.array(p) for p in itertools.product(share.grid, found, damping.grid)]

    def added(self, s: Signals, core: Core, values: np.ndarray, baseline: Baseline) -> np.ndarray:
        share, frequency, damping = (float(v) for v in values)
        viscous = viscous_slope(s, core, baseline) * s["velocity"]
        return share * (second_order(viscous, 1 / (2 * np.pi * frequency), damping, s.sample_time) - viscous)

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """A resonance of the fixture, where all of the viscous force passes the valve."""
        return ("fixture-resonance",) if abs(float(values[0]) - 1.0) < SAME_FORM else ()

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more states", order=2)


class Cavitation(Effect):
    """The oil cavitates where compression would empty a chamber; the void refills before force returns (sheet 3.17)."""

    name: ClassVar[str] = "cavitation"
    title: ClassVar[str] = "the oil cavitates in compression"
    family: ClassVar[str] = "hydraulics"
    stage: ClassVar[str] = "series"
    equation: ClassVar[str] = "F >= -F_cav = -1/r; void u' = g(-F_cav) - v >= 0, F = -F_cav while u > 0, g = law^-1"
    reference: ClassVar[str] = "equation sheet 3.17"
    experiment: ClassVar[str] = "short strokes at 8 to 15 Hz and 0.5 m/s or more, at a reduced gas pressure"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("reciprocal_limit", "1/N", "r = 1/F_cav", 0.0, (0.0, 0.03), (0.0, 1e6), (1e-3,)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        pulled = [s.output[s.output < 0] for s in signals]
        return [np.array([1 / force]) for force in thresholds(pulled)] if sum(map(len, pulled)) else []

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if all(float(s.output.min()) >= 0 for s in signals):
            return "the force is never one of compression"
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return in_series(core, baseline, limit=1 / float(values[0])) if values[0] > 0 else core

    def lpv_change(self) -> LpvChange | None:
        return None


