"""Elements in series with a simulation, and small changes of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import AlongTangent, Around, Core, Linearised, Remembered, Signals
from lpvid.rounding import STEP
from quartercar.baselines.damper import DamperCore
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.dampers.laws.stepping import motion_steps
from quartercar.effects.series_march import Elements, SeriesMarch, empty_trace
from quartercar.effects.series_tangent import changed, near


@dataclass(frozen=True, eq=False)
class InSeries(SeriesMarch, Linearised):
    """A core with elements in series: ḋ = v − w, d = D(F − F_0), F = core(w, x − d, i)::

        v ──►[ D ]── w ──►[ core ]── F

    F_0 is the force of the core at rest in the middle of the stroke: a gas preload acts in parallel to the elements, as
    those of the catalogue do, and takes up no play.

    For a core without memory, integrated with a rule of order two at the record's rate, with a current that is held or
    linear between samples as the data are. A core with memory takes the form F + (c'/k) dF/dt = core (equation sheet
    9.3), c' its local slope: an approximation, which `BoucWenInSeries` corrects. As the elements vanish the
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
        return near(self, others, changed)


@dataclass(frozen=True, eq=False)
class BoucWenInSeries(Linearised):
    """A Bouc-Wen damper with elements in series: its hysteresis follows the motion behind the elements.

    The equations of `InSeries` for a core with memory, integrated with the damper's own (`spencer_in_series`). What
    acts between the damper and the elements is the difference of two approximations::

        F = InSeries(core) + exact(law) − InSeries(law)

    which is continuous where it vanishes. The approximation alone is wrong by half of what a soft spring does. Where
    the fluid cavitates, the force is no less than the limit, and the void refills at once; without other elements it is
    that of `InSeries`. A run costs 6 (spring) to 20 times (play) that of the damper alone.

    Attributes
    ----------
    core : Core
        What is in series with the elements.
    law : Core
        The damper alone.
    damper : DamperCore
        The same, to be run behind the elements.
    elements : Elements
    """

    core: Core
    law: Core
    damper: DamperCore
    elements: Elements

    def __call__(self, s: Signals) -> np.ndarray:
        elements = replace(self.elements, limit=np.inf)
        if not (elements.compliance or elements.air_stroke or elements.play):
            return InSeries(self.core, self.elements, False)(s)
        if self.core is self.law:
            return np.maximum(_run(self, s)[0], -self.elements.limit)

        def correction() -> np.ndarray:
            return _run(self, s)[0] - InSeries(self.law, elements, False)(s)

        behind = s.remembered("behind elements", (self.law.key, elements), correction) \
            if isinstance(self.law, Remembered) else correction()
        return np.maximum(InSeries(self.core, elements, False)(s) + behind, -self.elements.limit)

    def near(self, others: Sequence[Core]) -> list[Core]:
        return near(self, others, _changed)

    @property
    def alone(self) -> bool:
        """Whether nothing acts between the damper and the elements, and nothing cavitates."""
        return self.core is self.law and not np.isfinite(self.elements.limit)

    def numbers(self, s: Signals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the damper, for the kernels.

        Parameters
        ----------
        s : Signals

        Returns
        -------
        coefficients : (12,) array
        springs : (2,) array
        state : (3,) array
            At the first sample.
        """
        law, vector = self.damper.baseline.damper, self.damper.vector
        assert isinstance(law, BoucWen)
        return *law.coefficients(vector), law.initial_state(self.damper.baseline.drive(s), vector)

    def motion(self, s: Signals) -> tuple:
        """Motion, current, sample time and steps, for the kernels.

        Parameters
        ----------
        s : Signals

        Returns
        -------
        tuple
        """
        law, drive = self.damper.baseline.damper, self.damper.baseline.drive(s)
        assert isinstance(law, BoucWen)
        return drive.displacement, drive.velocity, law.command(drive), drive.sample_time, motion_steps(drive)


def _changed(own: BoucWenInSeries, s: Signals, others: Sequence[Core]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """(n,) a simulation, and the first-order changes from it to those others that are the damper alone in series."""
    near_ones = {j: o for j, o in enumerate(others) if isinstance(o, BoucWenInSeries) and o.alone}
    if not own.alone or not near_ones:
        return own(s), {}
    out, changes = _run(own, s, list(near_ones.values()))
    return out, dict(zip(near_ones, changes, strict=True))


def _run(own: BoucWenInSeries, s: Signals, others: Sequence[BoucWenInSeries] = ()) -> tuple[np.ndarray, np.ndarray]:
    """(n,) the damper alone with its elements, without cavitation, and (m, n) the changes to others."""
    from quartercar.effects._bouc_wen_series_kernels import spencer_in_series

    motion, (coefficients, springs, state) = own.motion(s), own.numbers(s)
    fine = STEP**2 * float(np.abs(motion[1]).max())  # a difference of runs then resolves a derivative
    numbers = np.array([np.concatenate(o.numbers(s)) for o in (own, *others)])
    elements = [o.elements.numbers(springs[1]) for o in (own, *others)]
    out, changes = np.empty(s.n_samples), np.empty((len(others), s.n_samples))
    spencer_in_series(*motion, coefficients, springs, state, elements[0], fine, numbers[1:] - numbers[0],
                      np.array(elements)[1:], out, changes)
    return out, changes


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
        The latter where the baseline is a Bouc-Wen damper.
    """
    inner = _unwrapped(core)
    if isinstance(inner, InSeries | BoucWenInSeries):
        core, elements = inner.core, replace(inner.elements, **more)
    else:
        elements = Elements(**more)
    law = inner.law if isinstance(inner, BoucWenInSeries) else inner.bare if isinstance(inner, Around) else core
    damper = _unwrapped(law)
    damper = _unwrapped(damper.exact) if isinstance(damper, AlongTangent) else damper
    if not (isinstance(damper, DamperCore) and isinstance(damper.baseline.damper, BoucWen)):
        return InSeries(core, elements, baseline.static)
    return BoucWenInSeries(core, law, damper, elements)


def _unwrapped(core: Core) -> Core:
    """A core whose simulations may be kept, itself."""
    while isinstance(core, Remembered):
        core = core.core
    return core
