"""LPVModel: what transfer functions and state spaces share; python-control forms are made in a higher layer."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid import _checks
from lpvid._shown import Shown
from lpvid.codec import Coded
from lpvid.errors import InputError
from lpvid.model.input_stage import InputStage
from lpvid.model.signals import Signal, as_signals
from lpvid.scheduling import Basis, Scheduling

if TYPE_CHECKING:
    import control


class LPVModel(Coded, Shown, ABC):
    """A model whose coefficients are linear in a basis of the scheduling variables.

    Attributes
    ----------
    CONVERTED_BY : str
        Module with `frozen_state_space` and `nonlinear_io_system` for it.
    """

    CONVERTED_BY: ClassVar[str] = "lpvid.export.python_control"

    basis: Basis
    scheduling: Scheduling | None
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    input_stage: InputStage | None
    noise_covariance: np.ndarray | None
    metadata: Mapping

    def _settle(self, ny: int, nu: int, shaped: str) -> None:
        """Check and complete the fields around the coefficients, of `ny` outputs and `nu` filter inputs."""
        set_ = object.__setattr__
        names = self.basis.names
        box = self.scheduling or Scheduling(names, (-1.0,) * len(names), (1.0,) * len(names))
        if tuple(box.names) != tuple(names):
            raise InputError("the basis and the scheduling name different variables", got=f"{names} and {box.names}")
        set_(self, "scheduling", box)
        set_(self, "outputs", as_signals(self.outputs, "y", ny))
        set_(self, "inputs", as_signals(self.inputs, "u", nu if self.input_stage is None else 1))
        if len(self.outputs) != ny or len(self.filter_inputs) != nu:
            raise InputError("signals do not match the coefficients",
                             got=f"{len(self.outputs)} outputs and {len(self.filter_inputs)} filter inputs "
                                 f"for {shaped}")
        noise = np.zeros((ny, ny)) if self.noise_covariance is None else self.noise_covariance
        noise = _checks.shaped(_checks.frozen_array(noise, "noise_covariance"), (ny, ny), "noise_covariance")
        set_(self, "noise_covariance", _checks.finite(noise, "noise_covariance"))
        set_(self, "metadata", dict(self.metadata))

    @property
    def filter_inputs(self) -> tuple[Signal, ...]:
        """Inputs of the linear part."""
        return self.inputs if self.input_stage is None else self.input_stage.signals(self.inputs)

    @property
    def box(self) -> Scheduling:
        """The scheduling variables' names, box and rate bounds."""
        assert self.scheduling is not None
        return self.scheduling

    @abstractmethod
    def companion(self, p: Sequence[float] | np.ndarray) -> np.ndarray:
        """(n, n) matrix whose eigenvalues are the frozen poles.

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the variables.

        Returns
        -------
        (n, n) array
            Of a state space, A; of a transfer function, the block companion matrix in observer form.
        """

    @abstractmethod
    def forcing(self, reach: float, state: float = 0.0) -> float:
        """Size of the output that inputs and constants make in one step: a sum of moduli, no bound.

        Parameters
        ----------
        reach : float
            Largest modulus of an input.
        state : float
            Sum of the moduli of a state that is given.

        Returns
        -------
        float
        """

    def frozen_poles(self, p: Sequence[float] | np.ndarray) -> np.ndarray:
        """(n,) poles with the scheduling frozen at `p`.

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the variables.

        Returns
        -------
        (n,) array
            Of the z plane; [1/s] in continuous time.
        """
        return np.linalg.eigvals(self.companion(p))

    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by field.

        Returns
        -------
        LPVModel
            A copy.
        """
        return replace(self, **changes)  # type: ignore[type-var]

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
