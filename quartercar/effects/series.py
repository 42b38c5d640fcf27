"""Elements in series with a simulation, and small changes of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core, Linearised, Remembered, Signals
from quartercar.effects.series_march import Elements, SeriesMarch, empty_trace
from quartercar.effects.series_tangent import near


@dataclass(frozen=True, eq=False)
class InSeries(SeriesMarch, Linearised):
    """A core with elements in series: ḋ = v − w, d = D(F − F_0), F = core(w, x − d, i)::

        v ──►[ D ]── w ──►[ core ]── F

    F_0 is the force of the core at rest in the middle of the stroke: a gas preload acts in parallel to the elements, as
    those of the catalogue do, and takes up no play.

    For a core without memory, integrated with a rule of order two at the record's rate, with a current that is held or
    linear between samples as the data are; a core with memory takes the form F + (c'/k) dF/dt = core (equation sheet
    9.3), c' its local slope. As the elements vanish the result equals the core to the last digit: the interpolation
    error of the table is subtracted.

    Attributes
    ----------
    core : Core
    elements : Elements
    static : bool
        Whether the core may be without memory, which is then tested at some samples.
    """

    def with_elements(self, **more: float) -> InSeries:
        """Further elements in the same series.

        Parameters
        ----------
        **more : float
            Fields of `Elements`; they replace those of the same name.

        Returns
        -------
        InSeries
        """
        return replace(self, elements=replace(self.elements, **more))

    def __call__(self, s: Signals) -> np.ndarray:
        rigid = self.core(s)
        if not np.isfinite(rigid).all():
            return rigid
        if s.coarse is not None:  # at the record's rate: a march on the faster clock costs more and changes little
            return rigid + s.refined(self(s.coarse) - self.core(s.coarse))
        return self.march(s, rigid, self.law(s, rigid), empty_trace(0))

    def near(self, others: Sequence[Core]) -> list[Core]:
        return near(self, others)


def in_series(core: Core, baseline: Baseline, **more: float) -> InSeries:
    """The core with elements in series, in addition to those that it has.

    Parameters
    ----------
    core : Core
    baseline : Baseline
        Its `static` is that of the series.
    **more : float
        Fields of `Elements`.

    Returns
    -------
    InSeries
    """
    inner = core.core if isinstance(core, Remembered) else core
    if isinstance(inner, InSeries):
        return inner.with_elements(**more)
    return InSeries(core, Elements(**more), baseline.static)
