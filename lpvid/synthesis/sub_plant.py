"""A generalised plant without some of its disturbances and performance signals."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.synthesis.figures import channel
from lpvid.synthesis.generalized_plant import GeneralizedPlant


def channels_of(plant: GeneralizedPlant, disturbances: Sequence[str], performance: Sequence[str]) -> GeneralizedPlant:
    """The plant with these disturbances and performance signals alone, in its own order.

    Parameters
    ----------
    plant : GeneralizedPlant
        The plant.
    disturbances, performance : sequence of str
        Names that stay.

    Returns
    -------
    GeneralizedPlant
        The plant itself where all stay.
    """
    inputs, outputs = {*plant.controls, *disturbances}, {*plant.measurements, *performance}
    s = plant.system
    j = [k for k, signal in enumerate(s.inputs) if signal.name in inputs]
    i = [k for k, signal in enumerate(s.outputs) if signal.name in outputs]
    if len(j) == len(s.inputs) and len(i) == len(s.outputs):
        return plant
    return GeneralizedPlant(channel(s, j, i), plant.controls, plant.measurements)
