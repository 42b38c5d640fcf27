"""Compliance: springs, compressed air and lost motion in series with the law."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Signals
from lpvid.effects.effect import EffectParameter, GridEffect, LpvChange
from quartercar.effects.force_output import no_force
from quartercar.effects.friction_gas import POLYTROPIC
from quartercar.effects.likeness import closer_to_sign
from quartercar.effects.series import in_series
from quartercar.effects.series_march import TAKE_UP


class SeriesElement(GridEffect):
    """An element in series that carries the force of the law: v = w + dD(F)/dt, F = law(w) (equation sheet 9.3)."""

    family: ClassVar[str] = "elastic"
    stage: ClassVar[str] = "series"
    needs: ClassVar[tuple[str, ...]] = ("velocity",)

    @abstractmethod
    def elements(self, values: np.ndarray) -> dict[str, float]:
        """Fields of `Elements`.

        Parameters
        ----------
        values : (k,) array
            Parameters of the effect.

        Returns
        -------
        dict of str to float
        """

    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        return no_force(baseline)

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        return in_series(core, baseline, **self.elements(values)) if values[0] > 0 else core


class SeriesCompliance(SeriesElement):
    """A spring in series: oil column, bush, top mount, fixture, together 1/k (equation sheet 3.5, 3.6).

    It is as probable as not (`common`): fits by hand have one at each of five measured dampers, each on its rig, and in
    one of four other benchmarks (`tests/benchmarks/real_answers.py`, the records that the board marks too).
    """

    common: ClassVar[bool] = True
    name: ClassVar[str] = "series-compliance"
    title: ClassVar[str] = "a spring in series with the damper"
    equation: ClassVar[str] = "v = w + (1/k) dF/dt, F = law(w, x - F/k, i)"
    reference: ClassVar[str] = "equation sheet 3.5, 3.6, 9.3"
    experiment: ClassVar[str] = ("sines of one peak velocity at several frequencies: the lag follows the slope of the "
                                 "law; oil against bush needs another gas pressure or a second displacement")
    partners: ClassVar[tuple[str, ...]] = ("coulomb-friction", "inner-friction", "backlash")

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("compliance", "m/N", "1/k", 0.0, (0.0, 5e-6), (0.0, 1.0), (2e-8, 1e-7, 5e-7, 2e-6)),)

    def elements(self, values: np.ndarray) -> dict[str, float]:
        return {"compliance": float(values[0])}

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one more state: the force itself", order=1)


class Backlash(SeriesElement):
    """Lost motion in the force path: nothing is carried until the play is taken up (equation sheet 3.7)."""

    name: ClassVar[str] = "backlash"
    title: ClassVar[str] = "play in series with the damper"
    rugged: ClassVar[str] = "play"
    equation: ClassVar[str] = "v = w + dD/dt, D = (delta/2) tanh(F/F_t), F = law(w)"
    reference: ClassVar[str] = "equation sheet 3.7"
    experiment: ClassVar[str] = "strokes of falling amplitude at one frequency, down to the play itself"
    smooth: ClassVar[bool] = False
    added_later: ClassVar[tuple[str, ...]] = ("take_up",)
    partners: ClassVar[tuple[str, ...]] = ("coulomb-friction", "inner-friction", "series-compliance")

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("play", "m", "delta, from end to end", 0.0, (0.0, 2e-3), (0.0, 0.5),
                                (2e-5, 6e-5, 2e-4, 6e-4)),
                EffectParameter("take_up", "N", "F_t, force over which the play is taken up", TAKE_UP, (1e-3, 1e3),
                                (1e-6, 1e6), (TAKE_UP,), held=True))

    def elements(self, values: np.ndarray) -> dict[str, float]:
        return {"play": float(values[0]), "take_up": float(values[1])}

    def lpv_change(self) -> LpvChange | None:
        return None


class EntrainedAir(SeriesElement):
    """Air in the oil: a polytropic spring in series, soft until the air is compressed (equation sheet 3.5)."""

    name: ClassVar[str] = "entrained-air"
    form_of: ClassVar[str] = "series-compliance"
    title: ClassVar[str] = "air in the oil"
    equation: ClassVar[str] = "v = w + dD/dt, D = s (1 - (1 + |F|/F_p)^(-1/1.3)) sign F, F = law(w)"
    reference: ClassVar[str] = "equation sheet 3.5"
    experiment: ClassVar[str] = "the same sines cold and after a long run, and at two gas pressures"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return (EffectParameter("stroke", "m", "s, deflection that compresses all the air", 0.0, (0.0, 3e-3),
                                (0.0, 0.5), (6e-6, 5e-5, 3e-4)),
                EffectParameter("pressure_force", "N", "F_p, pressure of the air times piston area", 500.0,
                                (50.0, 5e3), (1e-3, 1e7), (200.0, 1000.0)))

    def elements(self, values: np.ndarray) -> dict[str, float]:
        return {"air_stroke": float(values[0]), "air_force": float(values[1])}

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Play of 2 s from end to end, where D is closer to it than to a spring along the force about its mean.

        With forces evenly distributed up to F_max, F_p < .15 F_max.
        """
        force = np.concatenate([np.abs(s.output - s.output.mean()) for s in signals])
        deflection = 1.0 - (1.0 + force / float(values[1])) ** (-1 / POLYTROPIC)
        return ("backlash",) if closer_to_sign(deflection, force) else ()

    def lpv_change(self) -> LpvChange | None:
        return LpvChange("one more state: the force itself", order=1)
