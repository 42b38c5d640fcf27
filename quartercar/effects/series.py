"""Elements in series with a simulation: the march along the law of the core."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.signals import Core, Linearised, Remembered, Signals, most_kept
from lpvid.toolkit import checks
from quartercar.effects.corners import corners
from quartercar.effects.series_law import Law, read_law

STEEP = 3
"""steps of the march from one sample to the next with air, play or a fluid that may tear, after a jump of the current
and along a steep change of it; elsewhere 1"""
CORNER = 6
"""steps over an interval in which the velocity bends: the rule is of order two where it does not"""
LAWS = 4
"""laws that signals keep, so that the derivative after a run need not read its law again"""
NO_TRACE = np.empty((0, 5))


@dataclass(frozen=True)
class Elements:
    """What lies in series with the law.

    Attributes
    ----------
    compliance : float
        1/k [m/N].
    air_stroke, air_force : float
        Deflection that compresses all the air [m]; pressure of it times piston area [N].
    play : float
        Total lost motion [m].
    limit : float
        Force of compression at which the fluid tears [N].
    """

    compliance: float = 0.0
    air_stroke: float = 0.0
    air_force: float = 1.0
    play: float = 0.0
    limit: float = np.inf

    def numbers(self, rest: float = 0.0) -> tuple[float, float, float, float, float, float]:
        """For the kernels; `rest` is the force at rest, which acts beside the elements.

        Parameters
        ----------
        rest : float
            [N].

        Returns
        -------
        tuple of six floats
            Compliance [m/N], stroke of the air [m], its force [N], half of the play [m], floor of the force [N], rest
            [N].
        """
        floor = rest - float(min(self.limit, 1e300))
        return float(self.compliance), float(self.air_stroke), float(self.air_force), float(self.play) / 2, floor, rest

    def deflection(self, force: np.ndarray) -> np.ndarray:
        """(n,) deflection of spring, air and play under a force [m].

        Parameters
        ----------
        force : (n,) array
            Less that at rest [N].

        Returns
        -------
        (n,) array
        """
        size = np.abs(force)
        air = self.air_stroke * (1 - (1 + size / self.air_force) ** (-1 / 1.3))
        return np.sign(force) * (self.compliance * size + self.play / 2 + air)


@dataclass(frozen=True, eq=False)
class InSeries(Linearised):
    """A core with elements in series: ḋ = v − w, d = D(F − F_0), F = core(w, x − d, i)::

        v ──►[ D ]── w ──►[ core ]── F

    F_0 is the force of the core at rest in the middle of the stroke: a gas preload acts beside the elements, as those
    of the catalogue do, and takes up no play.

    Exact (to a second-order rule at the record's clock, current held or straight as the data show) for a core without
    memory; one with memory takes the form F + (c'/k) dF/dt = core (equation sheet 9.3), c' its local slope. As the
    elements vanish the result is the core's own to the last digit: what the table misses is taken off.

    Attributes
    ----------
    core : Core
    elements : Elements
    static : bool
        Whether the core may be without memory, which is then tested at some of its samples.
    """

    core: Core
    elements: Elements
    static: bool = field(default=True)

    def with_elements(self, **more: float) -> InSeries:
        """Further elements in the same series.

        Parameters
        ----------
        **more : float
            Fields of `Elements`; one that is there already is replaced.

        Returns
        -------
        InSeries
        """
        return replace(self, elements=replace(self.elements, **more))

    def __call__(self, s: Signals) -> np.ndarray:
        rigid = self.core(s)
        if not np.isfinite(rigid).all():
            return rigid
        if s.coarse is not None:  # a march on the faster clock would cost as many times more, and show little
            return rigid + s.refined(self(s.coarse) - self.core(s.coarse))
        return self.march(s, rigid, self.law(s, rigid), NO_TRACE)

    def near(self, others: Sequence[Core]) -> list[Core]:
        from quartercar.effects.series_tangent import near

        return near(self, others)

    def law(self, s: Signals, rigid: np.ndarray) -> Law:
        """The law of the core, whose simulation along the signals is given; the last `LAWS` are kept.

        Parameters
        ----------
        s : Signals
        rigid : (n,) array
            Force of the core [N].

        Returns
        -------
        Law
        """
        def read() -> Law:
            return read_law(self.core, s, rigid, self.elements.deflection(rigid), self.static)

        if not isinstance(self.core, Remembered):
            return read()
        kept: OrderedDict = s.cached("laws", OrderedDict)
        key = (self.core.key, self.elements, self.static)
        law = kept.pop(key, None) or read()
        kept[key] = law
        with suppress(KeyError):  # several threads may share the signals
            if len(kept) > most_kept(LAWS, s.n_samples):
                kept.popitem(last=False)
        return law

    def steps(self, s: Signals, law: Law) -> tuple[np.ndarray, np.ndarray]:
        """(n,) steps up to each sample, and whether a short one precedes it.

        Parameters
        ----------
        s : Signals
        law : Law
            Along these signals.

        Returns
        -------
        parts : (n,) int array
        short : (n,) bool array
        """
        sudden = bool(np.isfinite(self.elements.limit)) or self.elements.play > 0
        parts = np.where(law.steep | sudden | (self.elements.air_stroke > 0), STEEP, 1)
        return np.where(corners(s).sharp, CORNER, parts), law.jumps | sudden

    def march(self, s: Signals, rigid: np.ndarray, law: Law, trace: np.ndarray) -> np.ndarray:
        """(n,) force; `trace`, as long as the march has stages or empty, is filled by the kernel.

        Parameters
        ----------
        s : Signals
            With velocity.
        rigid : (n,) array
            Force of the core [N].
        law : Law
            Along these signals.
        trace : (stages, 5) array
            (0, 5) for none.

        Returns
        -------
        (n,) array
            [N].
        """
        from quartercar.effects import _series_kernels as kernels

        velocity = checks.read_only(np.ascontiguousarray(s["velocity"], dtype=float))
        out, without, found = np.empty(s.n_samples), np.empty(s.n_samples), corners(s)
        kernels.march(velocity, found.rise, found.place, law.speeds, law.nodes, law.rows, law.before, law.tilt,
                      self.elements.numbers(law.rest), s.sample_time, trace, *self.steps(s, law), out)
        kernels.law_along(velocity, law.speeds, law.nodes, law.rows, without)
        return rigid + (out - without)


def in_series(core: Core, baseline: Baseline, **more: float) -> InSeries:
    """The core with elements in series, those that it already has included.

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
