"""Measurement chain: changes of the signals between the damper and the file."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial
from typing import ClassVar

import numpy as np

from lpvid.auditing.resting import ENOUGH, FLAT
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.baselines.spectra import SHORT, before_filter, weighed_alike
from lpvid.effects.effect import Effect, EffectParameter, GridEffect, LpvChange
from quartercar.effects.electrical import LAG_SHARE, LateEffect, read_earlier
from quartercar.effects.force_output import no_force
from quartercar.effects.splines import spline_shifted
from quartercar.effects.viscous import thresholds

DELAY = EffectParameter("delay", "s", "T", 0.0, (0.0, 0.02), (0.0, 0.1), (0.001, 0.003, 0.008, 0.016))
"""by which a channel is recorded later than another"""
MOTION = ("displacement", "velocity", "acceleration")
"""channels that one position sensor feeds"""
HAIRS = np.geomspace(1e-3, 0.1, 9)
"""widths below the largest force, as shares of it, within which a clipped force may scatter"""


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Values read `samples` later (earlier where negative), linear in between, the ends held.

    Parameters
    ----------
    values : (n,) array
    samples : float
        Need not be whole.

    Returns
    -------
    (n,) array
        In the unit of the values.
    """
    n = np.arange(values.size)
    return np.interp(n + samples, n, values)


class ChainEffect(GridEffect):
    """A cause in the measurement chain."""

    family: ClassVar[str] = "measurement"

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)


class DisplacementDelay(ChainEffect, LateEffect):
    """The motion is recorded later than the force, in part by the sensor's own lag (equation sheet 3.20).

    T is the sum of a pure delay, of buses and buffers, and of the first-order lag of the sensor's electronics:
    X_recorded = exp(-(1 - lambda) T s) / (1 + lambda T s) X. At low frequencies only the sum has an effect.
    """

    name: ClassVar[str] = "displacement-delay"
    path: ClassVar[str] = "motion"
    title: ClassVar[str] = "the motion is recorded later than the force"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "x(t) = x_recorded(t + (1 - lambda) T) + lambda T v_recorded(t + (1 - lambda) T), v alike"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a spring in place of the damper, or a synchronisation pulse on all channels"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return DELAY, LAG_SHARE

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay, share = (float(v) for v in values)
        if delay <= 0:
            return core

        def corrected(s: Signals) -> Signals:
            lag = share * delay if s.n_samples >= SHORT else 0.0
            sharp = {m: before_filter(s, m, (lag,)) if lag > 0 else s[m] for m in MOTION if s.has(m)}
            late = {m: spline_shifted(c, (delay - lag) / s.sample_time) for m, c in sharp.items()}
            return weighed_alike(s.replace(**late), s)

        return lambda s: core(s.remembered("prompt", (delay, share), lambda: corrected(s)))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)


class ForceDelay(ChainEffect):
    """The force is recorded later than all inputs: every input is read T earlier (equation sheet 3.20)."""

    name: ClassVar[str] = "force-delay"
    path: ClassVar[str] = "force"
    stepwise: ClassVar[bool] = True
    title: ClassVar[str] = "the force is recorded later than the motion"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = "F_recorded(t) = F(t - T)"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a spring in place of the damper, or a synchronisation pulse on all channels"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (DELAY,)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay = float(values[0])
        if delay <= 0:
            return core

        def early(s: Signals) -> Signals:
            read = {k: shifted(c, -delay / s.sample_time) for k, c in s.channels.items() if k != "current"}
            found = weighed_alike(s.replace(**read), s)
            return found.replace(current=read_earlier(s, delay)) if s.has("current") else found

        return lambda s: core(s.remembered("early", delay, lambda: early(s)))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("the input's delay chosen anew", delay=True)


class OneSidedFilter(ChainEffect):
    """The motion alone has passed a low-pass of order two or three, which is inverted here (sheet 1.4.10)."""

    name: ClassVar[str] = "one-sided-filter"
    added_later: ClassVar[tuple[str, ...]] = ("further_lag",)
    path: ClassVar[str] = "motion"
    title: ClassVar[str] = "the motion was low-passed and the force was not"
    stage: ClassVar[str] = "channel"
    equation: ClassVar[str] = ("X = (1 + 2 zeta T s + T^2 s^2)(1 + T_3 s) X_recorded, T = 1/(2 pi f_c), in bands with "
                               "more than the sensor's noise")
    reference: ClassVar[str] = "equation sheet 1.4.10, E4.10"
    experiment: ClassVar[str] = "the same record with both channels unfiltered, or both through the same filter"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/(2 pi corner frequency)", 0.0, (0.0, 0.04), (0.0, 0.2),
                                (0.002, 0.005, 0.01, 0.02)),
                EffectParameter("damping", "", "zeta", 0.7071, (0.4, 1.2), (0.3, 2.0), (0.5, 0.7071, 1.0)),
                EffectParameter("further_lag", "s", "T_3, of a third pole", 0.0, (0.0, 0.04), (0.0, 0.2), (0.0,)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """The grid, and filters of order three with the same delay at all frequencies (Bessel's).

        From a filter of order two, the refit converges to these slowly, along a narrow valley of the cost.
        """
        return [*super().points(signals), *map(_order_three, self.parameters[0].grid[::2])]

    def refit_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """The same at lags that follow from the data.

        Parameters
        ----------
        signals : tuple of Signals
        scale : callable
            Natural size of a quantity of a unit.

        Returns
        -------
        list of (3,) arrays
            s, -, s.
        """
        p = self.parameters[0]
        order_three = map(_order_three, p.spread(scale(p.unit), True))
        return [*self.spread_points(signals, scale), *order_three]

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        t, zeta, third = (float(v) for v in values)
        if t <= 0:
            return core

        factors = (2 * zeta * t + third, t**2 + 2 * zeta * t * third, t**2 * third)

        def unfiltered(s: Signals) -> Signals:
            return weighed_alike(s.replace(**{m: before_filter(s, m, factors) for m in MOTION if s.has(m)}), s)

        return lambda s: core(s.remembered("sharp", factors, lambda: unfiltered(s)))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more samples of the input", order=2)


def _order_three(t: float) -> np.ndarray:
    """Parameters of Bessel's filter of order three whose pair of poles has this time constant.

    T, the damping of the pair, and the time constant of the single pole.

    Examples
    --------
    >>> _order_three(1.0).round(4).tolist()
    [1.0, 0.7235, 1.0945]
    """
    order = 3
    poles = np.roots([factorial(order + k) / (2**k * factorial(k) * factorial(order - k)) for k in range(order + 1)])
    pair, single = poles[np.argmax(poles.imag)], -float(poles.real[np.argmin(np.abs(poles.imag))])
    return np.array([t, -pair.real / abs(pair), abs(pair) / single * t])


class ForceOffset(ChainEffect):
    """Zero of the load cell (equation sheet 3.20)."""

    name: ClassVar[str] = "force-offset"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "zero of the load cell"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F + F_0"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "the load cell unloaded before and after; creep at several positions and temperatures"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("offset", "N", "F_0", 0.0, (-500.0, 500.0), (-1e6, 1e6), (-50.0, 50.0)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        offset = float(values[0])
        return lambda s: core(s) + offset

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("a constant as a further input", regressors=("1",))


def piled_up(force: np.ndarray) -> bool:
    """Whether the samples of a force pile up at its largest modulus.

    Within a width h below the peak of a smooth force, F_max − a t², there are half as many samples as within 4h,
    whatever a and h; below a level at which it is clipped, nearly as many. Several widths are tried, since the noise
    that an amplifier adds after its limit is unknown.

    Parameters
    ----------
    force : (n,) array

    Returns
    -------
    bool
        False for a force that is zero throughout.

    Examples
    --------
    >>> wave = 100 * np.sin(np.linspace(0, 60, 4000))
    >>> piled_up(wave), piled_up(np.clip(wave, -90, 90))
    (False, True)
    """
    size = np.abs(force)
    top = float(size.max(initial=0.0))
    if not top > 0:
        return False
    below = np.sort(1.0 - size / top)
    near, wide = (np.searchsorted(below, k * HAIRS, side="right") for k in (1, 4))
    return bool(np.any((wide >= ENOUGH) & (near > FLAT * wide)))


class ForceClipping(Effect):
    """The amplifier saturates (equation sheet 3.20)."""

    name: ClassVar[str] = "force-clipping"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "the force is clipped by its amplifier"
    family: ClassVar[str] = "measurement"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "|F_recorded| <= F_max = 1/r"
    reference: ClassVar[str] = "equation sheet 3.20"
    experiment: ClassVar[str] = "a larger force range of the amplifier, or a smaller motion"
    smooth: ClassVar[bool] = False
    visible: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("reciprocal_limit", "1/N", "r = 1/F_max", 0.0, (0.0, 0.05), (0.0, 1e6), (1e-3,)),)

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return [np.array([1 / force]) for force in thresholds([s.output for s in signals]) if force > 0]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if reason := no_force(baseline):
            return reason
        if piled_up(np.concatenate([s.output for s in signals])):
            return None
        return "the samples do not pile up at the largest force, as those of a clipped one do"

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        reciprocal = float(values[0])
        if reciprocal <= 0:
            return core
        limit = 1 / reciprocal
        return lambda s: np.clip(core(s), -limit, limit)

    def lpv_change(self) -> LpvChange | None:
        return None
