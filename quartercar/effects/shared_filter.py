"""Shared filter: every channel has passed the same low-pass, with which a nonlinear law does not commute."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.baselines.spectra import SHORT, before_filter, low_passed, weighed_alike
from lpvid.effects.effect import EffectParameter, LpvChange
from quartercar.effects.between_samples import times_as_fast
from quartercar.effects.current_edges import LEAST_DAMPED, Edges, current_before, edges_of, is_sharp
from quartercar.effects.measurement import ChainEffect


class SharedFilter(ChainEffect):
    """All channels have passed the same low-pass, which does not commute with a nonlinear law (sheet 1.4.10).

    The times of a current's jumps between levels are estimated with the filter's step response (`current_edges`);
    around jumps to levels that are too short the simulation is unchanged. Where the edges are unfiltered it is no
    candidate.
    """

    name: ClassVar[str] = "shared-filter"
    flexible: ClassVar[bool] = True
    title: ClassVar[str] = "all channels have passed the same low-pass, with which a nonlinear law does not commute"
    stage: ClassVar[str] = "measurement"
    equation: ClassVar[str] = "F_recorded = F(X)/H, X = H X_recorded, H = 1 + 2 zeta T s + T^2 s^2"
    reference: ClassVar[str] = "equation sheet 1.4.10, E4.10"
    experiment: ClassVar[str] = "the same record at a higher corner frequency of the amplifiers' filters"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    path: ClassVar[str] = "all"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("time_constant", "s", "T = 1/(2 pi corner frequency)", 0.0, (0.0, 0.01), (0.0, 0.05),
                                (5e-4, 1e-3, 3e-3)),
                EffectParameter("damping", "", "zeta", 0.7071, (LEAST_DAMPED, 1.2), (0.3, 2.0), (0.7071,)))

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        for s in signals if "current" in baseline.channels else ():
            edges = edges_of(s)
            if edges is not None and is_sharp(s):
                return ("the current jumps, and its edges are unfiltered" if edges.known.any() else
                        "the current jumps, and between its jumps it rests too briefly, or has too much noise, to show "
                        "whether its edges are filtered")
        return super().applies(baseline, signals)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        t, zeta = float(values[0]), float(values[1])
        if t <= 0:
            return core

        def run(s: Signals) -> np.ndarray:
            if s.n_samples < SHORT:
                return core(s)
            finer = times_as_fast(baseline, s)
            edges = edges_of(s)
            before = s.remembered("before the filter", (t, zeta, finer, baseline.static),
                                  lambda: _before(s, t, zeta, finer, edges, baseline.static))
            passed = low_passed(core(before), s.sample_time / finer, t, zeta)[::finer]
            if edges is None:
                return passed
            left = edges.near(~edges.known if baseline.static else np.full(edges.first.size, True))
            return np.where(left, core(s), passed) if left.any() else passed

        return run

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("two more samples of input and output", order=2)


def _before(s: Signals, t: float, zeta: float, finer: int, edges: Edges | None, sharp: bool) -> Signals:
    """Signals before a filter that all channels have passed, `finer` times as fast.

    The edges of the current are sharp only for a law that can be evaluated between the samples.
    """
    factors = (2 * zeta * t, t**2)
    channels = {c: before_filter(s, c, factors, finer) for c in s.channels if c != "current" or edges is None}
    if edges is not None:
        channels["current"] = current_before(s, edges, t, zeta, finer) if sharp else s["current"]
    found = Signals(s.sample_time / finer, channels, np.repeat(s.output, finer), s.name, s.span, record=s.record,
                    finer=finer * s.finer)
    return weighed_alike(found, s)
