"""The blocks of a plant as matrix functions of the scheduling, and systems assembled from such functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.matrix_function import MatrixFunction

BLOCKS = ("A", "B1", "B2", "C1", "D11", "D12", "C2", "D21", "D22")


def plant_functions(plant: GeneralizedPlant) -> dict[str, MatrixFunction]:
    """A, B1, B2, C1, D11, D12, C2, D21 and D22 of a plant over its own basis.

    Parameters
    ----------
    plant : GeneralizedPlant
        Over its own basis; signals sorted by their roles.

    Returns
    -------
    dict of str to MatrixFunction
        By the names in `BLOCKS`.
    """
    s = plant.system
    parts = plant.parted(s.A, s.B, s.C, s.D)
    return {name: MatrixFunction(s.basis, part) for name, part in zip(BLOCKS, parts, strict=True)}


def assembled(whole: MatrixFunction, order: int, plant: GeneralizedPlant, inputs: Sequence[Signal],
              outputs: Sequence[Signal]) -> LPVStateSpace:
    """[A B; C D](p) as a system with a plant's clock and scheduling.

    Parameters
    ----------
    whole : MatrixFunction
        (n + n_outputs, n + n_inputs), over variables of the plant's box.
    order : int
        n, number of states.
    plant : GeneralizedPlant
        Gives sample time and box.
    inputs, outputs : sequence of Signal
        In the order of the columns of B and the rows of C.

    Returns
    -------
    LPVStateSpace
        Over no more functions than it needs.
    """
    whole = whole.trimmed()
    return LPVStateSpace.of(whole.coefficients, order, whole.basis, plant.sample_time,
                            plant.box.part(whole.basis.names), inputs=tuple(inputs), outputs=tuple(outputs))


def written(plant: GeneralizedPlant, whole: np.ndarray, order: int, basis: Basis) -> LPVStateSpace:
    """[A B; C D](p) as a controller from a plant's measurements to its controls.

    Parameters
    ----------
    plant : GeneralizedPlant
        Gives names, units and period.
    whole : (M, order + n_u, order + n_y) array
        The matrix over the basis.
    order : int
        States.
    basis : Basis
        M functions.

    Returns
    -------
    LPVStateSpace
        The controller.
    """
    return LPVStateSpace.of(whole, order, basis, plant.sample_time, plant.box.part(basis.names),
                            inputs=named(plant, plant.measurements), outputs=named(plant, plant.controls))


def named(plant: GeneralizedPlant, names: Sequence[str], suffix: str = "") -> tuple[Signal, ...]:
    """Signals of a plant by name, with a suffix to the name.

    Parameters
    ----------
    plant : GeneralizedPlant
        Whose signals they are.
    names : sequence of str
        Inputs or outputs of its system.
    suffix : str
        Put behind every name.

    Returns
    -------
    tuple of Signal
        In the order of the names, with their units.
    """
    signals = {s.name: s for s in (*plant.system.inputs, *plant.system.outputs)}
    return tuple(replace(signals[n], name=signals[n].name + suffix) for n in names)
