"""Hysteresis: a force that depends on the displacement since the last reversals, not on the speed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import EffectParameter, LpvChange
from quartercar.effects.friction_gas import NIL, ParallelForce


class BoucWenHysteresis(ParallelForce):
    """A Bouc-Wen element beside the law, of order one (Bouc 1967; Wen 1976; Ismail, Ikhouane, Rodellar 2009)::

        F += F_z z,    d ż = v − (1 − s)|v| z − s v |z|

    s = 0 is Dahl's friction; the larger s, the straighter and stiffer the force after a reversal. Its slope at z = 0
    is F_z/d.
    """

    name: ClassVar[str] = "hysteresis"
    placement_of: ClassVar[str] = "coulomb-friction"
    contains: ClassVar[tuple[str, ...]] = ("series-compliance",)  # it is deflected by d before it slides
    title: ClassVar[str] = "hysteresis over the displacement in parallel to the law"
    equation: ClassVar[str] = "F += F_z z, d z' = v - (1 - s)|v| z - s v |z|"
    reference: ClassVar[str] = "equation sheet 1.1; Wen 1976, order one"
    experiment: ClassVar[str] = "slow triangles of several amplitudes at constant current: closed loops"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)
    memoryless: ClassVar[bool] = False
    flexible: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("force", "N", "F_z, at which it yields", 0.0, (0.0, 300.0), (0.0, 1e6), (20.0,)),
                EffectParameter("deflection", "m", "d, over which it builds up", 1e-4, (1e-6, 3e-3), (NIL, 0.5),
                                (1e-5, 1e-4, 1e-3)),
                EffectParameter("straightness", "", "s, 0 for Dahl's loop, 1 for straight flanks", 0.3, (0.0, 0.99),
                                (0.0, 0.99), (0.0, 0.6)))

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        force, deflection, share = (float(v) for v in values)
        return (lambda s: core(s) + force * loop(s, deflection, share)) if force else core

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one more state, and the sign of the velocity as a further input",
                         regressors=("sign(velocity)",), order=1)


def loop(s: Signals, deflection: float, share: float) -> np.ndarray:
    """(n,) z of a Bouc-Wen element of order one, from rest.

    Parameters
    ----------
    s : Signals
        With velocity.
    deflection : float
        d [m], above zero.
    share : float
        s, from 0 to below 1.

    Returns
    -------
    (n,) array
        In [−1, 1].
    """
    def simulate() -> np.ndarray:
        from quartercar.effects._friction_kernels import hysteresis

        out = np.empty(s.n_samples)
        hysteresis(np.ascontiguousarray(s["velocity"]), s.sample_time, deflection, share, out)
        return out

    return s.remembered("hysteresis", (deflection, share), simulate)
