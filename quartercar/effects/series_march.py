"""Elements in series with a simulation: the integration (march) along the law of the core."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lpvid.baselines.signals import Core, Remembered, Signals
from lpvid.rounding import EXPLODED
from lpvid.toolkit import checks
from quartercar.effects.corners import corners
from quartercar.effects.friction_gas import POLYTROPIC
from quartercar.effects.series_law import Law, read_law

STEEP = 3
"""steps of the march per sampling interval with air, play or cavitation, after a jump of the current and along a steep
change of it; elsewhere 1"""

TAKE_UP = 5.0
"""force over which play is taken up where none is stated, as in files without that number [N]"""
TRACED = ("speed", "deflection", "force", "force over speed", "force over deflection")
"""what the trace of a march holds of every stage: w, the deflection at which the law was evaluated, F and its slopes,
that over the speed −1 on the floor"""


def empty_trace(stages: int) -> np.ndarray:
    """(stages, 5) memory for the trace of a march, by `TRACED`; of no stages where it is not wanted.

    Parameters
    ----------
    stages : int

    Returns
    -------
    (stages, 5) array
    """
    return np.empty((stages, len(TRACED)))


@dataclass(frozen=True)
class Elements:
    """Elements in series with the law.

    Attributes
    ----------
    compliance : float
        1/k [m/N].
    air_stroke, air_force : float
        Deflection that compresses all the air [m]; pressure of it times piston area [N].
    play : float
        Total lost motion [m].
    limit : float
        Force of compression at which the fluid cavitates [N].
    take_up : float
        Force over which the play is taken up: its deflection is play/2 tanh(F/take_up) [N].
    """

    compliance: float = 0.0
    air_stroke: float = 0.0
    air_force: float = 1.0
    play: float = 0.0
    limit: float = np.inf
    take_up: float = TAKE_UP

    def numbers(self, rest: float = 0.0) -> tuple[float, float, float, float, float, float, float]:
        """For the kernels; `rest` is the force at rest, which acts in parallel to the elements.

        Parameters
        ----------
        rest : float
            [N].

        Returns
        -------
        tuple of seven floats
            Compliance [m/N], stroke of the air [m], its force [N], half of the play [m], floor of the force [N], rest
            [N], force over which the play is taken up [N].
        """
        floor = rest - float(min(self.limit, EXPLODED))
        return (float(self.compliance), float(self.air_stroke), float(self.air_force), float(self.play) / 2, floor,
                rest, float(self.take_up))

    def deflection(self, force: np.ndarray) -> np.ndarray:
        """(n,) deflection of spring, air and play under a force [m].

        Parameters
        ----------
        force : (n,) array
            Without that at rest [N].

        Returns
        -------
        (n,) array
        """
        size = np.abs(force)
        air = self.air_stroke * (1 - (1 + size / self.air_force) ** (-1 / POLYTROPIC))
        return np.sign(force) * (self.compliance * size + self.play / 2 + air)


@dataclass(frozen=True, eq=False)
class SeriesMarch:
    """The march along the law of a core with elements in series; as a simulation it is `series.InSeries`.

    Attributes
    ----------
    core : Core
    elements : Elements
    static : bool
        Whether the core may be without memory, which is then tested at some samples.
    """

    core: Core
    elements: Elements
    static: bool = field(default=True)

    def law(self, s: Signals, rigid: np.ndarray) -> Law:
        """The law of the core, given its simulation along the signals; the last ones are kept.

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
        return s.remembered("laws", (self.core.key, self.elements, self.static), read)

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
        # as many on either side of a corner, across which the rule is not of order two
        return np.where(corners(s).sharp, 2 * STEEP, parts), law.jumps | sudden

    def march(self, s: Signals, rigid: np.ndarray, law: Law, trace: np.ndarray) -> np.ndarray:
        """(n,) force; `trace`, of one row per stage of the march, is filled by the kernel unless it is empty.

        Parameters
        ----------
        s : Signals
            With velocity.
        rigid : (n,) array
            Force of the core [N].
        law : Law
            Along these signals.
        trace : (stages, 5) array
            Of `empty_trace`, of no stages for none.

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
