"""E3: a lag on the control that makes B_2 and D_12 constant, and with it a plant for polytopic synthesis."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.lpv_models.embedding import Embedding, Trajectory
from quartercar.lpv_models.region import Region
from quartercar.lpv_models.saturation_pair import SaturationPair
from quartercar.lpv_models.yielding import yield_force
from quartercar.vehicle.result import CarRun


def prefiltered(system: LPVStateSpace, control: str, lag: float) -> LPVStateSpace:
    """The system behind u = x_f, τ ẋ_f = u_f − x_f, in place of its input `control` (E3).

    ::

        A = [ A  B_2 ;  0  −1/τ ]    B_2 = [ 0 ; 1/τ ]    C = [ C  D_12 ]    D_12 = 0

    What depended on the scheduling in B_2 and D_12 now does so in A and C. A discrete system takes the lag's exact
    step, x_f⁺ = e^(−T/τ) x_f + (1 − e^(−T/τ)) u_f.

    Parameters
    ----------
    system : LPVStateSpace
    control : str
    lag : float
        τ [s].

    Returns
    -------
    LPVStateSpace
        With the lag's state last; inputs, outputs, basis and box are those of `system`.

    Raises
    ------
    InputError
        A lag that is not positive, an input that the system does not have, or a basis without a constant function.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> plant = LPVStateSpace([[[-1.0]], [[0.0]]], [[[0.0]], [[2.0]]], [[[1.0]], [[0.0]]], [[[0.0]], [[0.0]]],
    ...                       Polynomial("rho", 1), None, inputs=(Signal("u"),))
    >>> wide = prefiltered(plant, "u", 0.1)
    >>> wide.B[:, :, 0].tolist(), wide.A[1].tolist()
    ([[0.0, 10.0], [0.0, 0.0]], [[0.0, 2.0], [0.0, 0.0]])
    """
    tau = checks.positive(lag, "lag of the prefilter", "s")
    names = [s.name for s in system.inputs]
    j = names.index(checks.known_name(control, names, "input"))
    m, n, ny = system.A.shape[0], system.order, system.n_outputs
    pole, gain = -1 / tau, 1 / tau
    if system.sample_time is not None:
        pole = float(np.exp(-system.sample_time / tau))
        gain = 1 - pole
    constant = system.basis.evaluate(system.box.centre[None])[0]
    place = [k for k, label in enumerate(system.basis.labels) if label == "1"]
    if not place:
        raise InputError("a prefilter needs a constant among the basis functions", got=", ".join(system.basis.labels),
                         mend="a Polynomial basis")
    assert constant[place[0]] == 1.0
    a, b = np.zeros((m, n + 1, n + 1)), np.zeros((m, n + 1, len(names)))
    c, d = np.zeros((m, ny, n + 1)), system.D.copy()
    a[:, :n, :n], a[:, :n, n] = system.A, system.B[:, :, j]
    a[place[0], n, n] = pole
    b[:, :n] = system.B
    b[:, :, j] = 0.0
    b[place[0], n, j] = gain
    c[:, :, :n], c[:, :, n] = system.C, system.D[:, :, j]
    d[:, :, j] = 0.0
    return LPVStateSpace(a, b, c, d, system.basis, system.sample_time, system.box, inputs=system.inputs,
                         outputs=system.outputs)


@dataclass(frozen=True, eq=False)
class Prefiltered(Embedding):
    """An embedding behind a first-order lag (E3): the coil's own, or a fast one put there for the design.

    Exact for a coil whose current rises and falls with the same time constant, a yield force affine in the current, and
    no limits reached; otherwise the lag is a model of the coil.

    Attributes
    ----------
    inner : Embedding
        With a control. A run is replayed (`along`) where this is the yield force itself, as in E1.
    lag : float
        τ [s].
    """

    number: ClassVar[str] = "E3"
    inner: Embedding
    lag: float

    @property
    def held(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the inner plant holds, and its control: the command of a coil keeps its value between samples."""
        return (*self.inner.held, self.control)

    @property
    def region(self) -> Region:  # type: ignore[override]
        return self.inner.region

    @property
    def control(self) -> str:  # type: ignore[override]
        if self.inner.control is None:
            raise InputError("a plant without control has nothing to filter", got=self.inner.number)
        return self.inner.control

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        return prefiltered(self.inner.system, self.control, self.lag)

    def along(self, run: CarRun) -> Trajectory:
        """As the base class; the filter's state is the inner control, its input that at the commanded current.

        Raises
        ------
        InputError
            An inner plant whose control is not the yield force: what lags in a coil is its current, and with it the
            yield force.
        """
        if self.control != SaturationPair.control:
            raise InputError("the lag of a coil is that of the yield force", got=f"control '{self.control}'",
                             mend="Prefiltered(SaturationPair(...), lag) (E3 on E1)")
        path = self.inner.along(run)
        place = [s.name for s in self.inner.system.inputs].index(self.control)
        inputs = path.inputs.copy()
        inputs[:, place] += yield_force(run, "command") - yield_force(run)
        return Trajectory(np.column_stack([path.states, path.inputs[:, place]]), inputs, path.scheduling)
