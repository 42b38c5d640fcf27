"""Controlled force: a damping force that depends on a current which the law does not read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.condition.derivation import REVERSAL
from lpvid.effects.effect import SPREAD, Effect, EffectParameter, LpvChange
from quartercar.effects.electrical import is_constant
from quartercar.effects.force_output import no_force
from quartercar.effects.viscous import SLOW


class CurrentDependence(Effect):
    """The yield force and the viscous share of a damper depend on a current that the law does not read.

    The controllable part of a Bingham damper, affine in the current (Stanway, Sproston, Stevens 1987; Spencer et al.
    1997, c_0 and α affine in the voltage), in parallel to a law that is the same at every current. Elements in series
    carry it together with the law, and the electrical causes act on its current.
    """

    name: ClassVar[str] = "current-dependence"
    title: ClassVar[str] = "the damping depends on the current, which the law does not read"
    family: ClassVar[str] = "electrical"
    stage: ClassVar[str] = "core"
    layer: ClassVar[int] = 1
    equation: ClassVar[str] = "F += i (F_y tanh(v/eps) + c_i v)"
    reference: ClassVar[str] = "equation sheet 1.1, 1.4.6; Stanway, Sproston, Stevens 1987; Spencer et al. 1997"
    experiment: ClassVar[str] = "one motion at constant currents over the full range; a baseline that reads the current"
    needs: ClassVar[tuple[str, ...]] = ("velocity", "current")
    memoryless: ClassVar[bool] = True
    strengths: ClassVar[int] = 2
    brings: ClassVar[tuple[str, ...]] = ("current",)
    partners: ClassVar[tuple[str, ...]] = ("coulomb-friction",)

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("yield_force", "N/A", "F_y, dry force per ampere", 0.0, (-1e3, 1e3), (-1e7, 1e7),
                                (-20.0, 20.0)),
                EffectParameter("viscous", "N*s/m/A", "c_i, viscous damping per ampere", 0.0, (-1e4, 1e4), (-1e8, 1e8),
                                (0.0,)),
                EffectParameter("turning_speed", "m/s", "eps, over which the fluid yields", REVERSAL, (1e-5, 0.2),
                                (1e-6, 2.0), (REVERSAL,)))

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """Dry and viscous forces per ampere, either sign, at a share of their plausible range.

        Parameters
        ----------
        signals : tuple of Signals

        Returns
        -------
        list of (3,) arrays
            N/A, N·s/m/A, m/s.
        """
        force, viscous = (SPREAD[1] * p.plausible[1] for p in self.parameters[:2])
        return [np.array([*p, REVERSAL]) for p in ((force, 0.0), (-force, 0.0), (0.0, viscous), (0.0, -viscous))]

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """The same at sizes that follow from the data, and both together.

        Parameters
        ----------
        signals : tuple of Signals
        scale : callable
            Natural size of a quantity of a unit.

        Returns
        -------
        list of (3,) arrays
            N/A, N·s/m/A, m/s.
        """
        speed = scale("m/s") or REVERSAL / SLOW
        sizes = [SPREAD[1] * (scale(p.unit) or 1.0) for p in self.parameters[:2]]
        turns = min(REVERSAL, SLOW * speed), SPREAD[1] * speed
        strengths = [(sizes[0], 0.0, t) for t in turns] + [(0.0, sizes[1], turns[-1]), (*sizes, turns[-1])]
        return [np.array([sign * a, sign * b, t]) for a, b, t in strengths for sign in (1.0, -1.0)]

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        """Why it cannot be composed: the law reads the current, or that is the same in all records.

        Parameters
        ----------
        baseline : Baseline
        signals : tuple of Signals

        Returns
        -------
        str or None
        """
        if reason := no_force(baseline):
            return reason
        if "current" in baseline.channels:
            return f"{baseline.name} reads the current"
        if at_rest(signals):
            return "the current is the same in all records, but for the noise of its sensor"
        return None

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        """The law's force and i (F_y tanh(v/ε) + c_i v) (Stanway, Sproston, Stevens 1987).

        Parameters
        ----------
        core : callable
            Simulation without it.
        values : (3,) array
            F_y [N/A], c_i [N·s/m/A], ε [m/s].
        baseline : Baseline

        Returns
        -------
        callable
            Simulation with it, from signals to (n,) forces [N].
        """
        force, viscous, turn = (float(v) for v in values)
        if not force and not viscous:
            return core

        def run(s: Signals) -> np.ndarray:
            v = s["velocity"]
            return core(s) + s["current"] * (force * np.tanh(v / turn) + viscous * v)

        return run

    def lpv_change(self) -> LpvChange | None:
        """The current as a scheduling variable.

        Returns
        -------
        LpvChange
        """
        return LpvChange("scheduled on the current too", schedule=("current",))


def at_rest(signals: Sequence[Signals]) -> bool:
    """Whether the current is the same in all signals, but for the noise of its sensor.

    Parameters
    ----------
    signals : sequence of Signals
        With a channel ``current`` [A].

    Returns
    -------
    bool
    """
    largest = max(float(np.abs(s["current"]).max()) for s in signals)
    levels = np.concatenate([np.full(s.n_samples, s["current"].mean()) for s in signals])
    return all(is_constant(s["current"], largest) for s in signals) and is_constant(levels, largest)
