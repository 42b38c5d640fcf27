"""Convertible: models with python-control forms, whose makers stand in a higher layer and are looked up when wanted."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

if TYPE_CHECKING:
    import control


class Convertible:
    """A model with its python-control forms.

    Attributes
    ----------
    CONVERTED_BY : str
        Module with `frozen_state_space` and `nonlinear_io_system` for it.
    """

    CONVERTED_BY: ClassVar[str] = "lpvid.export.python_control"

    def to_control(self, at: Sequence[float] | np.ndarray) -> control.StateSpace:
        """The frozen model as a python-control `StateSpace` (its linear part, after any input stage).

        Parameters
        ----------
        at : (n_scheduling,) array
            In the units of the variables.

        Returns
        -------
        control.StateSpace
            At the model's period.
        """
        return importlib.import_module(self.CONVERTED_BY).frozen_state_space(self, at)

    def to_nonlinear_io_system(self) -> control.NonlinearIOSystem:
        """The varying model as a python-control `NonlinearIOSystem` with inputs (u…, p…).

        Returns
        -------
        control.NonlinearIOSystem
            The scheduling is a further input.
        """
        return importlib.import_module(self.CONVERTED_BY).nonlinear_io_system(self)
