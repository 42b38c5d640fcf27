"""Electrical and magnetic causes between the commanded current and the field in the fluid."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.condition.band_limited import jumps
from lpvid.condition.constancy import DISTINCT, constant
from lpvid.effects.effect import BETWEEN, EffectParameter, GridEffect, LpvChange
from lpvid.rounding import TINY
from quartercar.effects.current_edges import SPACING, edges_of, is_sharp

SEEN_AFTER = 0.03
"""part of a sample after a step of a held current at which the force is taken"""
NO_BEND = "a linear law passes through both, as every other does"
SENSOR_NOISE = 0.05
"""rms of uncorrelated noise, as a share of the largest current, that a sensor may have: 0.5 % of a range of 5 A, at
0.5 A; a low-pass takes it off the simulated force, so that it would be evidence for every lag of the current"""
ALIKE = 0.15
"""correlation of neighbouring increments from which on edges take more than one sample, as after a filter; its
negative, from which on levels do"""
LAG_SHARE = EffectParameter("lag_share", "", "lambda, share of T that is a first-order lag", 0.0, (0.0, 0.5),
                            (0.0, 0.5), (0.0,))
"""the second parameter of a `LateEffect`, after its delay T"""


def is_held(current: np.ndarray) -> bool:
    """Whether a current is constant between its samples, within the noise of its sensor, and jumps at them.

    Most increments are far below their rms, or it has two levels, between which it may jump at every second sample. And
    neighbouring increments are uncorrelated: an edge that was recorded after a filter takes two samples or more.

    Parameters
    ----------
    current : (n,) array
        [A].

    Returns
    -------
    bool

    Examples
    --------
    >>> steps = np.repeat([0.0, 2.0, 1.0], 10)
    >>> is_held(steps), is_held(np.convolve(steps, [0.6, 0.3, 0.1])[:30]), is_held(np.sin(np.linspace(0, 9, 200)))
    (True, False, False)
    """
    return (jumps(current) or _has_two_levels(current)) and _correlation(np.diff(current)) < ALIKE


def _correlation(increments: np.ndarray) -> float:
    """Correlation of neighbouring increments; 0 without any."""
    return float(increments[1:] @ increments[:-1]) / max(float(increments @ increments), TINY)


def _has_two_levels(current: np.ndarray) -> bool:
    """Whether a current is at one of two levels throughout, within `SENSOR_NOISE` of their distance."""
    if not current.size or np.ptp(current) == 0:
        return False
    low, high = (current[part] for part in (current <= current.mean(), current > current.mean()))
    return float(np.sqrt((low.size * low.var() + high.size * high.var()) / current.size)) < \
        SENSOR_NOISE * float(high.mean() - low.mean())


def is_constant(current: np.ndarray, largest: float) -> bool:
    """Whether a current is constant as `lpvid.condition.constancy` defines it, or but for uncorrelated noise.

    Parameters
    ----------
    current : (n,) array
        [A].
    largest : float
        Largest modulus of the current in all records, to which the ripple is compared [A].

    Returns
    -------
    bool

    Examples
    --------
    >>> noise = np.random.default_rng(0).standard_normal(500)
    >>> is_constant(1 + 0.03 * noise, 1.1), is_constant(np.repeat(noise[:50], 10), 2.0)
    (True, False)
    """
    if np.ptp(current) <= DISTINCT * largest:
        return True
    ripple = current - current.mean()
    size = float(ripple @ ripple)
    spread = float(np.sqrt(size / current.size))
    return spread < SENSOR_NOISE * largest and float(ripple[1:] @ ripple[:-1]) < 0.5 * size


def held(s: Signals) -> bool:
    """Whether the current of these signals is held between samples and its jumps are unfiltered; computed once.

    Parameters
    ----------
    s : Signals

    Returns
    -------
    bool
        False without a current.
    """
    def find(current: np.ndarray) -> bool:
        whole = [p["current"] for p in s.as_recorded("current")] if s.stretches else [current]
        largest = max(float(np.abs(c).max()) for c in whole)
        moving = [c for c in whole if not is_constant(c, largest)]
        return bool(moving) and all(map(is_held, moving)) and is_sharp(s)

    return s.has("current") and s.fact("current", "is held", find)


def with_same_jumps(s: Signals, to: Signals) -> Signals:
    """The same signals, whose current is a function of another one without memory: it jumps at the same samples.

    Parameters
    ----------
    s : Signals
        Changed in place, where it has a current.
    to : Signals
        With the current as recorded.

    Returns
    -------
    Signals
        `s` itself.
    """
    if s.has("current"):
        s.facts["current", "is held"], s.facts["current", "is clocked"] = held(to), clocked(to)
        s.facts["current", "is sharp"] = is_sharp(to)
    return s


def clocked(s: Signals) -> bool:
    """Whether a held current jumps at samples: all times between its jumps are multiples of some samples.

    Decided over all records together, as `is_sharp`. A current with a clock of its own jumps between two samples,
    half-way on average. A current with many levels of one sample is taken to have the clock of the samples: its
    neighbouring jumps oppose each other, whereas the two parts of one jump over two samples have one sign.

    Parameters
    ----------
    s : Signals

    Returns
    -------
    bool
        False for a current that is not held; True for a held one of which fewer than two times between jumps are known.

    Examples
    --------
    >>> def steps(*lengths):
    ...     return Signals(0.01, {"current": np.repeat(np.arange(len(lengths)) % 2, lengths)}, np.zeros(sum(lengths)))
    >>> [clocked(steps(*n)) for n in ((20, 30, 10, 20, 10), (25, 26, 25, 26, 26), (25, 1, 1, 3, 1, 2, 1, 1, 5))]
    [True, False, True]
    """
    def jumps_of(current: np.ndarray) -> np.ndarray:
        steps = np.diff(current)
        return np.where(np.abs(steps) > DISTINCT * np.ptp(current), steps, 0.0)

    def find(_: np.ndarray) -> bool:
        found = [jumps_of(p["current"]) for p in s.as_recorded("current") if p.has("current")]
        times = np.concatenate([np.diff(np.flatnonzero(d)) for d in found])
        return times.size < 2 or int(np.gcd.reduce(times)) > 1 or _correlation(np.concatenate(found)) < -ALIKE

    return held(s) and s.fact("current", "is clocked", find)


def levels(signals: Sequence[Signals]) -> int:
    """Number of levels of the currents of all records; 0 where they do not consist of a few levels.

    Parameters
    ----------
    signals : sequence of Signals
        With current.

    Returns
    -------
    int
        1 for a current that is constant throughout.

    Examples
    --------
    >>> def current(i):
    ...     return Signals(0.01, {"current": i}, np.zeros(i.size))
    >>> levels([current(np.repeat([0.0, 2.0, 0.0], 9)), current(np.full(9, 2.0))]), levels([current(np.arange(9.0))])
    (2, 0)
    """
    i = np.sort(np.concatenate([s["current"] for s in signals]))
    span = float(i[-1] - i[0])
    if constant(float(i[0]), float(i[-1]), "A"):
        return 1
    groups = np.split(i, np.flatnonzero(np.diff(i) > DISTINCT * span) + 1)
    return len(groups) if all(np.ptp(g) < DISTINCT * span for g in groups) and len(groups) < 0.5 * i.size else 0


def later(s: Signals, delay: float) -> np.ndarray:
    """(n,) current that acts `delay` [s] later.

    With a held current that changes at a sample, every delay within one sample has the effect of a whole sample, so
    that a delay of d samples acts as d + ½ on average; below half a sample that is reduced to 2 d.

    Parameters
    ----------
    s : Signals
        With current.
    delay : float
        At least zero [s].

    Returns
    -------
    (n,) array
        [A]; the first value is held at the head.
    """
    d = delay / s.sample_time
    if held(s):
        d = min(2 * d, d + 0.5)
    n = np.arange(s.n_samples)
    return np.interp(n - d, n, s["current"])


def read_earlier(s: Signals, delay: float) -> np.ndarray:
    """(n,) current of `delay` [s] ago, for a force that is itself recorded late; a held one in whole samples.

    Parameters
    ----------
    s : Signals
        With current.
    delay : float
        At least zero [s].

    Returns
    -------
    (n,) array
        [A]; the first value is held at the head.
    """
    d = delay / s.sample_time
    if held(s):
        d = float(np.ceil(d - SEEN_AFTER))
    n = np.arange(s.n_samples)
    return np.interp(n - d, n, s["current"])


def lagged(s: Signals, rise: float, fall: float, between: bool = False) -> np.ndarray:
    """(n,) current after a first-order lag with unequal edges; the current itself where both are zero.

    Parameters
    ----------
    s : Signals
        With current.
    rise, fall : float
        Time constants while the magnitude of the lagged current grows and while it shrinks [s], so that a current and
        its negative are lagged alike.
    between : bool
        Whether the current is taken as linear between samples, even if it was held when it was recorded.

    Returns
    -------
    (n,) array
        [A].
    """
    from quartercar.effects import _current_kernels as kernels

    current = np.ascontiguousarray(s["current"])
    if rise <= 0 and fall <= 0:
        return current
    out = np.empty_like(current)
    if not between and held(s):
        kernels.lag_held(current, rise, fall, s.sample_time, SEEN_AFTER, out)
    else:
        kernels.lag_linear(current, rise, fall, s.sample_time, out)
    return out


def _jump_error(signals: Sequence[Signals]) -> float:
    """Standard error of a lag due to the unknown time of a jump between two samples [s].

    Uniform between the samples for a held current; after a filter, the edges determine the time.
    """
    if any(held(s) for s in signals):
        return signals[0].sample_time / (2 * np.sqrt(3))
    edges = [edges_of(s) for s in signals]
    return signals[0].sample_time * (SPACING if any(e is not None and e.known.any() for e in edges) else BETWEEN)


def along_current(core: Core, key: Hashable, current: Callable[[Signals], np.ndarray],
                  same_jumps: bool = False) -> Core:
    """A core along another current; the last ones are kept, with what was simulated along them.

    Parameters
    ----------
    core : Core
    key : hashable
        Of an effect's name and parameters, equal for equal currents.
    current : callable
        From signals to the (n,) current that the core reads [A].
    same_jumps : bool
        Whether it is a function of their current without memory, which jumps at the same samples.

    Returns
    -------
    Core
    """
    def changed(s: Signals) -> Signals:
        found = s.replace(current=current(s))
        return with_same_jumps(found, s) if same_jumps else found

    return lambda s: s.along_others("current", key, lambda: changed(s), core)


class CurrentEffect(GridEffect):
    """A cause that acts on the current before the law reads it."""

    family: ClassVar[str] = "electrical"
    stage: ClassVar[str] = "current"
    needs: ClassVar[tuple[str, ...]] = ("current",)
    turns: ClassVar[str] = "current"
    between_two: ClassVar[str] = ""
    """reason why it cannot be determined where the current takes two levels only; empty where it can"""

    of_changes: ClassVar[bool] = True
    """whether it has an effect only where the current changes within a record"""

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        if "current" not in baseline.channels:
            return f"{baseline.name} does not depend on the current"
        return self.determined(signals)

    def determined(self, signals: tuple[Signals, ...]) -> str | None:
        """Why these currents cannot reveal it: constant in every record, or of two levels.

        Parameters
        ----------
        signals : tuple of Signals

        Returns
        -------
        str or None
        """
        largest = max(float(np.abs(s["current"]).max()) for s in signals)
        if self.of_changes and all(is_constant(s["current"], largest) for s in signals):
            return "the current is constant within every record, except for the noise of its sensor"
        if self.between_two and levels(signals) == 2:
            return f"the current takes two levels only: {self.between_two}"
        return None


class CoilLag(CurrentEffect):
    """Coil and eddy currents: τ di_e/dt = i − i_e (equation sheet 3.12)."""

    name: ClassVar[str] = "coil-lag"
    path: ClassVar[str] = "current"
    title: ClassVar[str] = "the field follows the current with a first-order lag"
    equation: ClassVar[str] = "tau di_e/dt = i - i_e"
    reference: ClassVar[str] = "equation sheet 3.12; Sename & Do, coil L/R and eddy currents"
    experiment: ClassVar[str] = "current steps up and down at constant piston speed, and a random current (APRBS)"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "tau", 0.0, (0.0, 0.1), (0.0, 0.5),
                                (0.002, 0.005, 0.01, 0.02, 0.05)),)

    def clock_error(self, signals: Sequence[Signals]) -> float:
        return _jump_error(signals)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        tau = float(values[0])
        return along_current(core, (self.name, tau), lambda s: lagged(s, tau, tau)) if tau > 0 else core

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on the lagged current", schedule_filter="lag")


class RiseFallLag(CurrentEffect):
    """Unequal edges: the field builds up and decays with different time constants (equation sheet 3.14)."""

    name: ClassVar[str] = "rise-fall-lag"
    form_of: ClassVar[str] = "coil-lag"
    path: ClassVar[str] = "current"
    title: ClassVar[str] = "the field rises and falls with different time constants"
    equation: ClassVar[str] = "tau di_e/dt = i - i_e, tau = T r where |i_e| rises, T/r where it falls"
    reference: ClassVar[str] = "equation sheet 3.14; source 002, block firstOrder_varT"
    experiment: ClassVar[str] = "current steps up and down of several heights at constant piston speed"
    between_two: ClassVar[str] = "unequal edges have the effect of one lag before a law nonlinear in the current"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T, geometric mean of both", 0.0, (0.0, 0.1), (0.0, 0.5),
                                (0.003, 0.008, 0.02)),
                EffectParameter("ratio", "", "r, square root of rise over fall", 1.0, (0.2, 5.0), (0.1, 10.0),
                                (0.5, 1.0, 2.0)))

    def clock_error(self, signals: Sequence[Signals]) -> float:
        return _jump_error(signals)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        tau, ratio = float(values[0]), float(values[1])
        if tau <= 0:
            return core
        return along_current(core, (self.name, tau, ratio), lambda s: lagged(s, tau * ratio, tau / ratio))

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on a current that rises and falls unequally", schedule_filter="rise-fall")


class LateEffect(GridEffect):
    """A delay T of which a share is a first-order lag; its parameters are T and `LAG_SHARE`."""

    stepwise: ClassVar[bool] = True
    added_later: ClassVar[tuple[str, ...]] = ("lag_share",)

    def clock_errors(self, values: np.ndarray, signals: Sequence[Signals]) -> np.ndarray:
        """Standard errors of the delay and, as large in time, of the lag's share of it."""
        error = self.clock_error(signals)
        return np.array([error, error / max(float(values[0]), error)])


class CommandDelay(CurrentEffect, LateEffect):
    """Driver and bus: the current acts T later than it is recorded, part of it by the driver's own lag (sheet 3.13).

    I_e = exp(-(1 - lambda) T s) / (1 + lambda T s) I. A larger lag than delay is that of a coil (`CoilLag`).
    """

    name: ClassVar[str] = "command-delay"
    path: ClassVar[str] = "current"
    title: ClassVar[str] = "the current acts later than it is recorded"
    equation: ClassVar[str] = "lambda T i_e' + i_e = i(t - (1 - lambda) T)"
    reference: ClassVar[str] = "equation sheet 3.13"
    experiment: ClassVar[str] = "current steps at constant piston speed, sampled at least ten times within the delay"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("delay", "s", "T", 0.0, (0.0, 0.03), (0.0, 0.1), (0.002, 0.004, 0.008, 0.016)),
                LAG_SHARE)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        delay, share = (float(v) for v in values)
        if delay <= 0:
            return core

        def late(s: Signals) -> np.ndarray:
            delayed = s.replace(current=later(s, (1 - share) * delay))
            return lagged(delayed, share * delay, share * delay, between=True)

        return along_current(core, (self.name, delay, share), late)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("scheduled on the delayed current", schedule_filter="delay")


class CurrentSaturation(CurrentEffect):
    """Magnetic saturation: the slope of the field over the current decreases (equation sheet 3.15).

    Between a sharp bend, tanh(q i)/q, and a soft one, Froehlich's i/(1 + q|i|): both start with slope 1.
    """

    name: ClassVar[str] = "current-saturation"
    memoryless: ClassVar[bool] = True
    title: ClassVar[str] = "the field saturates with the current"
    equation: ClassVar[str] = "i_e = (1 - b) tanh(q i)/q + b i/(1 + q|i|)"
    reference: ClassVar[str] = "equation sheet 3.15; Froehlich 1881"
    experiment: ClassVar[str] = "constant currents over the full range, at least five levels, the same motion at each"
    smooth: ClassVar[bool] = False
    between_two: ClassVar[str] = NO_BEND
    of_changes: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("saturation", "1/A", "q, reciprocal of the current at which the field bends", 0.0,
                                (0.0, 2.0), (0.0, 1e4), (0.1, 0.25, 0.5, 1.0)),
                EffectParameter("softness", "", "b, 0 for a sharp bend, 1 for a soft one", 0.0, (0.0, 1.0), (0.0, 1.0),
                                (0.0, 1.0)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        q, soft = float(values[0]), float(values[1])
        if q <= 0:
            return core

        def bent(s: Signals) -> np.ndarray:
            i = s["current"]
            return (1 - soft) * np.tanh(q * i) / q + soft * i / (1 + q * np.abs(i))

        return along_current(core, (self.name, q, soft), bent, same_jumps=True)

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one more degree in the current", degree=1)


class Remanence(CurrentEffect):
    """Magnetic hysteresis as play between current and field (equation sheet 3.15)."""

    name: ClassVar[str] = "remanence"
    title: ClassVar[str] = "the field has hysteresis over the current: play between the two"
    equation: ClassVar[str] = "i_e = play(i, w): moves only with i at either end of a gap of 2w"
    reference: ClassVar[str] = "equation sheet 3.15; Visintin 1994, play operator"
    experiment: ClassVar[str] = "a slow triangle of the current at constant piston speed, up and down"
    smooth: ClassVar[bool] = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("half_width", "A", "w, half of the gap", 0.0, (0.0, 0.5), (0.0, 1e3),
                                (0.03, 0.08, 0.2, 0.4)),)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        from quartercar.effects._play_kernel import play

        width = float(values[0])

        def behind(s: Signals) -> np.ndarray:
            out = np.empty(s.n_samples)
            play(np.ascontiguousarray(s["current"]), width, out)
            return out

        return along_current(core, (self.name, width), behind) if width > 0 else core

    def lpv_change(self) -> LpvChange | None:
        return None
