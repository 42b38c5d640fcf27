"""Elements in series with a simulation, and small changes of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import AlongTangent, Core, Linearised, Remembered, Signals
from lpvid.rounding import STEP
from quartercar.baselines.damper import DamperCore
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.effects.series_march import Elements, SeriesMarch, empty_trace
from quartercar.effects.series_tangent import near


@dataclass(frozen=True, eq=False)
class InSeries(SeriesMarch, Linearised):
    """A core with elements in series: ḋ = v − w, d = D(F − F_0), F = core(w, x − d, i)::

        v ──►[ D ]── w ──►[ core ]── F

    F_0 is the force of the core at rest in the middle of the stroke: a gas preload acts in parallel to the elements, as
    those of the catalogue do, and takes up no play.

    For a core without memory, integrated with a rule of order two at the record's rate, with a current that is held or
    linear between samples as the data are. A core with memory takes the form F + (c'/k) dF/dt = core (equation sheet
    9.3), c' its local slope: an approximation, of which `BoucWenInSeries` has no need. As the elements vanish the
    result equals the core to the last digit: the interpolation error of the table is subtracted.

    Attributes
    ----------
    core : Core
    elements : Elements
    static : bool
        Whether the core may be without memory, which is then tested at some samples.
    """

    def __call__(self, s: Signals) -> np.ndarray:
        rigid = self.core(s)
        if not np.isfinite(rigid).all():
            return rigid
        if s.coarse is not None:  # at the record's rate: a march on the faster clock costs more and changes little
            return rigid + s.refined(self(s.coarse) - self.core(s.coarse))
        return self.march(s, rigid, self.law(s, rigid), empty_trace(0))

    def near(self, others: Sequence[Core]) -> list[Core]:
        return near(self, others)


@dataclass(frozen=True, eq=False)
class BoucWenInSeries:
    """A Bouc-Wen damper with elements in series, its hysteresis along the motion behind the elements.

    The same equations as of `InSeries`, for a core with memory: of a damper behind a soft spring that form was wrong by
    half of the spring's effect. In derivatives the whole is run anew, at five times the cost of the damper alone.

    Attributes
    ----------
    core : Core
        The damper alone.
    law : DamperCore
        The same, on the records' own clock.
    elements : Elements
        Without cavitation.
    """

    core: Core
    law: DamperCore
    elements: Elements

    def __call__(self, s: Signals) -> np.ndarray:
        if s.coarse is not None:
            return self.core(s) + s.refined(self(s.coarse) - self.core(s.coarse))
        from quartercar.effects._bouc_wen_series_kernels import spencer_in_series

        damper, drive = self.law.baseline.damper, self.law.baseline.drive(s)
        assert isinstance(damper, BoucWen)
        theta, springs = damper.coefficients(self.law.vector)
        out = np.empty(s.n_samples)
        spencer_in_series(drive.displacement, drive.velocity, damper.command(drive), drive.sample_time,
                          motion_steps(drive), theta, springs, damper.begun(drive, self.law.vector),
                          self.elements.numbers(springs[1]), STEP**2 * float(np.abs(drive.velocity).max()), out)
        return out


def in_series(core: Core, baseline: Baseline, **more: float) -> InSeries | BoucWenInSeries:
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
    InSeries or BoucWenInSeries
        The latter of a Bouc-Wen damper with nothing between it and the elements, unless it cavitates.
    """
    inner = core.core if isinstance(core, Remembered) else core
    if isinstance(inner, InSeries | BoucWenInSeries):
        core, elements = inner.core, replace(inner.elements, **more)
    else:
        elements = Elements(**more)
    law = _law_of(core)
    if law is None or np.isfinite(elements.limit) or not isinstance(law.baseline.damper, BoucWen):
        return InSeries(core, elements, baseline.static)
    return BoucWenInSeries(core, law, elements)


def _law_of(core: Core) -> DamperCore | None:
    """The law that a core is, run anew; None where something acts between it and what is around it."""
    core = core.core if isinstance(core, Remembered) else core
    core = core.whole if isinstance(core, AlongTangent) else core
    return core if isinstance(core, DamperCore) else None
