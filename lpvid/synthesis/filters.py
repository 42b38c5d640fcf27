"""Fast filters before controls and behind measurements, so that what multiplies an unknown gain does not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.attach_weights import weigh
from lpvid.synthesis.design_grid import varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import connect
from lpvid.synthesis.weights import lowpass


@dataclass(frozen=True, eq=False)
class Filtered:
    """A plant whose B2, D12, C2 and D21 are constant, and the filters that made it so.

    ::

                      ┌──────────┐   ┌───────┐   ┌──────────┐
        u' (design) ─>│ ω/(s+ω)  │──>│ plant │──>│ ω/(s+ω)  │─> y' (design)
                      └──────────┘   └───────┘   └──────────┘
                      └─ part of the controller that is built ─┘

    Parameters
    ----------
    plant : GeneralizedPlant
        What to design for; signals keep their names.
    bandwidths : dict of signal to rad/s
        The filters put in; empty if nothing moved.
    """

    plant: GeneralizedPlant
    bandwidths: dict[str, float]

    def complete(self, controller: LPVStateSpace) -> LPVStateSpace:
        """The controller together with its filters, for the plant as it was.

        Parameters
        ----------
        controller : LPVStateSpace
            Designed for `plant`, with the names of its signals.

        Returns
        -------
        LPVStateSpace
            Same signals; the controller itself where no filter was put in.
        """
        blocks: list[LPVStateSpace] = []
        inputs, outputs = [s.name for s in controller.inputs], [s.name for s in controller.outputs]
        inner = {n: f"{n} inside" for n in (*inputs, *outputs) if n in self.bandwidths}
        renamed = controller.replace(
            inputs=tuple(Signal(inner.get(s.name, s.name), s.unit) for s in controller.inputs),
            outputs=tuple(Signal(inner.get(s.name, s.name), s.unit) for s in controller.outputs))
        units = {s.name: s.unit for s in (*controller.inputs, *controller.outputs)}
        for name, inside in inner.items():
            ends = (name, inside) if name in inputs else (inside, name)
            blocks.append(_filter(self.bandwidths[name], controller.sample_time).replace(
                inputs=(Signal(ends[0], units[name]),), outputs=(Signal(ends[1], units[name]),)))
        return connect([renamed, *blocks], inputs, outputs) if blocks else controller


def add_actuator_filters(plant: GeneralizedPlant, bandwidth: float) -> Filtered:
    """Filters of one bandwidth where the gains of a control or measurement move with the scheduling, and only there.

    The design inequalities are then affine in the scheduling, and hold between the corners of the box (Apkarian &
    Gahinet 1995). The price is the filters' lag: choose a bandwidth well above that of the loop.

    Parameters
    ----------
    plant : GeneralizedPlant
    bandwidth : float
        rad/s.

    Returns
    -------
    Filtered
        The plant as it was, without filters, where nothing moves.

    Raises
    ------
    InputError
        A bandwidth that is not positive, or that reaches the Nyquist frequency of a discrete plant.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial, Scheduling
    >>> system = LPVStateSpace([[[-1.0]], [[0.0]]], [[[1.0, 1.0]], [[0.0, 0.5]]], [[[1.0], [1.0]], [[0.0], [0.0]]],
    ...                        np.zeros((2, 2, 2)), Polynomial("p", 1), None, Scheduling(("p",), (0.0,), (1.0,)),
    ...                        inputs=(Signal("road"), Signal("force")), outputs=(Signal("comfort"), Signal("sensor")))
    >>> found = add_actuator_filters(GeneralizedPlant(system, ("force",), ("sensor",)), 100.0)
    >>> found.bandwidths, found.plant.order
    ({'force': 100.0}, 2)
    """
    omega = _checks.positive(bandwidth, "the bandwidth of the filters", "rad/s")
    if plant.sample_time is not None and omega * plant.sample_time >= np.pi:
        raise InputError("the filters are faster than the sampling", got=f"{omega:g} rad/s at {plant.sample_time:g} s",
                         mend=f"stay below {np.pi / plant.sample_time:.4g} rad/s")
    m = plant.at(plant.box.grid(3))
    push, seen = np.concatenate([m.B2, m.D12], axis=1), np.concatenate([m.C2, m.D21], axis=2)
    moving = [n for j, n in enumerate(plant.controls) if varies(push[:, :, j])]
    shown = [n for i, n in enumerate(plant.measurements) if varies(seen[:, i])]
    block = _filter(omega, plant.sample_time)
    weighed = weigh(plant, dict.fromkeys(moving, block), dict.fromkeys(shown, block)) if moving or shown else plant
    return Filtered(weighed, dict.fromkeys([*moving, *shown], omega))


def _filter(omega: float, sample_time: float | None) -> LPVStateSpace:
    """ω/(s + ω), or the same by a zero-order hold."""
    if sample_time is None:
        return lowpass(1.0, omega)
    pole = np.exp(-omega * sample_time)
    a, b, c, d = (np.full((1, 1), value) for value in (pole, 1 - pole, 1.0, 0.0))
    return LPVStateSpace.still(a, b, c, d, sample_time, inputs=(Signal("in"),), outputs=(Signal("out"),))


steadied = add_actuator_filters
"""Deprecated name of `add_actuator_filters`."""
