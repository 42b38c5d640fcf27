"""The frozen matrices of an LPV model on a grid of its box, and the state space whose matrices vary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.python_control import frozen_state_space
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Realization, realize
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.saturated import SaturatedController

MOST = 500
"""grid points at most; fewer per variable where there are many variables"""
ALONG = 11
"""grid points along one scheduling variable"""


@dataclass(frozen=True, eq=False)
class FrozenGrid:
    """Matrices of a model at points of its scheduling.

    Attributes
    ----------
    names : tuple of str
        Scheduling variables.
    points : (k, variables) array
    a, b, c, d : (rows, columns, k) arrays
    inputs, outputs : tuple of Signal
    """

    names: tuple[str, ...]
    points: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    inputs: tuple
    outputs: tuple


def linear_model(model: Any) -> LPVTransferFunction | LPVStateSpace | None:
    """The LPV model in a noun, where there is one with frozen matrices."""
    if isinstance(model, Synthesis):
        return model.controller
    if isinstance(model, SaturatedController):
        return model.controller
    if isinstance(model, Realization):
        return model.model
    if isinstance(model, (LPVTransferFunction, LPVStateSpace)):
        return model
    inner = getattr(model, "model", None)  # a controller that holds one
    return inner if isinstance(inner, (LPVTransferFunction, LPVStateSpace)) else None


def frozen_grid(model: LPVTransferFunction | LPVStateSpace) -> FrozenGrid:
    """Matrices on an even grid of the box: of the linear part, behind any input stage and scheduling filter."""
    count = len(model.box.names)
    along = ALONG if count <= 1 else max(2, int(MOST ** (1 / count)))
    points = model.box.grid(along)
    systems = [frozen_state_space(model, p) for p in points]
    a, b, c, d = (np.stack([np.asarray(getattr(s, m)) for s in systems], axis=2) for m in ("A", "B", "C", "D"))
    return FrozenGrid(model.box.names, points, a, b, c, d, model.filter_inputs, model.outputs)


def varying_state_space(model: LPVTransferFunction | LPVStateSpace) -> LPVStateSpace | None:
    """A state space of the same free run whose matrices need the present scheduling alone; None where there is none."""
    if isinstance(model, LPVStateSpace):
        found = model
    else:
        try:
            found = realize(model, "observable" if model.lagged else "augmented").model
        except InputError:
            return None
    return found if found.basis.lags == (0, 0) else None
