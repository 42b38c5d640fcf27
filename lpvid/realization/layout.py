"""What a form hands over: its matrices under construction, and whether they reproduce the model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.varying import Varying, assemble, constant_part


@dataclass(frozen=True, eq=False)
class RealizationLayout:
    """Matrices of a realisation before they share a basis.

    Attributes
    ----------
    arrays : mapping of str to Varying
        Fields of `LPVStateSpace` by name.
    exact : bool
        True when the input-output behaviour is kept for moving scheduling.
    settling : int
        Outputs from which the state is to be recovered.
    """

    arrays: Mapping[str, Varying]
    exact: bool
    settling: int


def padded(model: LPVTransferFunction, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a of n lags, b and c of n + 1 lags from lag 0 on, filled up with zeros.

    Parameters
    ----------
    model : LPVTransferFunction
        With no more than n lags.
    n : int
        Order of the state space.

    Returns
    -------
    (n, …), (n + 1, …), (n + 1, …) arrays
        In the shapes of the model's a, b and c.
    """
    assert model.c is not None

    def fill(x: np.ndarray, rows: int) -> np.ndarray:
        return np.concatenate([x[:rows], np.zeros((max(rows - x.shape[0], 0), *x.shape[1:]))])

    return fill(model.a, n), fill(model.b, n + 1), fill(model.c, n + 1)


def still(model: LPVTransferFunction, which: str) -> bool:
    """True when none of the named coefficients ("a", "b", "c") depends on the scheduling.

    Parameters
    ----------
    model : LPVTransferFunction
    which : str
        Letters, such as "ac".

    Returns
    -------
    bool
    """
    coefficients = {"a": model.a, "b": model.b, "c": model.c}
    return not model.basis.names or all(constant_part((model.basis, coefficients[w])) is not None for w in which)


def build(model: LPVTransferFunction, layout: RealizationLayout, metadata: Mapping) -> LPVStateSpace:
    """The state-space model of a layout, with everything else carried over from `model`.

    Parameters
    ----------
    model : LPVTransferFunction
        That was realised.
    layout : RealizationLayout
        Its matrices.
    metadata : mapping
        Of the result.

    Returns
    -------
    LPVStateSpace
        In discrete time, over one basis for all matrices.
    """
    basis, matrices = assemble(model.basis, layout.arrays)
    return LPVStateSpace(**matrices, basis=basis, sample_time=model.sample_time, scheduling=model.box,
                         inputs=model.inputs, outputs=model.outputs, input_stage=model.input_stage,
                         scheduling_stage=model.scheduling_stage, noise_covariance=model.noise_covariance,
                         metadata=metadata)
