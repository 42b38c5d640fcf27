"""What an estimate returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid._shown import Shown
from lpvid.caveat import Caveat
from lpvid.identification.layout import ModelLayout, ParameterCloud
from lpvid.model.noise_model import NoiseModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.validation import Validation
from lpvid.validation.trust import training_doubt

COVARIANCE_LIMIT = 200
"""models with more parameters than this do not carry their covariance in the file."""


@dataclass(frozen=True, eq=False)
class Identification(Shown):
    """An identified model, the uncertainty of its parameters, and its errors.

    Attributes
    ----------
    model : LPVTransferFunction or LPVStateSpace
    structure : Structure
        The settings that led to it.
    layout : ParameterLayout or StateSpaceLayout
        Where each parameter stands in the model.
    covariance : (k, k) array
        Covariance of the parameters, conditional on a fitted input stage; for equation noise that is white.
    condition : float
        2-norm condition number of the regressor as built; `scaled_condition` that with unit columns.
    n_samples : int
        Equations used.
    training, held_out : Validation or None
        Figures on the data used, and on the data kept back.
    notes : tuple of str
        What was done to the data and what to beware of.
    covariance_kind : str
        What the covariance assumes of the residual.
    unconstrained : LPVTransferFunction or None
        Of a constrained estimate: the model of the same structure without the constraint.
    unconstrained_figures : tuple of Validation
        Its figures on the training data, and on the data kept back.
    """

    model: Any
    structure: Any
    layout: ModelLayout
    covariance: np.ndarray
    condition: float
    scaled_condition: float
    n_samples: int
    training: Validation | None = None
    held_out: Validation | None = None
    notes: tuple[str, ...] = ()
    covariance_kind: str = "least squares, white equation error"
    unconstrained: Any = None
    unconstrained_figures: tuple[Validation, ...] = ()

    @property
    def parameters(self) -> np.ndarray:
        """(k,) estimated parameters, in normalised scheduling and SI units."""
        return self.layout.read(self.model)

    @property
    def noise(self) -> NoiseModel | None:
        """The noise model of a transfer function; a state space states it by its observer gain."""
        return self.model.noise if isinstance(self.model, LPVTransferFunction) else None

    @property
    def n_parameters(self) -> int:
        """Number of linear parameters plus those of the noise model, the input stage and the scheduling filter."""
        parts = (self.noise, self.model.input_stage, self.model.scheduling_stage)
        return self.layout.size + sum(s.vector.size for s in parts if s is not None)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """A name for every parameter, ``a2[current]`` the slope of a_2 over normalised current."""
        return self.layout.names(self.model)

    @property
    def standard_errors(self) -> np.ndarray:
        """(k,) standard errors of the parameters."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def doubt(self) -> str | None:
        """Why the fit cannot be trusted, or None: of the held-out data, or else of the training data.

        A free run that diverges on the training data, or is no better than their mean, counts first.

        A state space counts without the n² entries that only choose its state coordinates.
        """
        if (failure := self.training_failure) is not None:
            return failure
        if self.held_out is not None:
            return None if self.held_out.doubt is None else f"{self.held_out.label} {self.held_out.doubt}"
        if self.training is None:
            return None
        coordinates = self.model.order**2 if isinstance(self.model, LPVStateSpace) else 0
        each = (self.n_parameters - coordinates) / len(self.model.outputs)
        return training_doubt(self.n_samples, each) or self.training.doubt

    @property
    def training_failure(self) -> str | None:
        """Why the model is none of the data that it was fitted to: a free run that diverges, or not below their mean.

        `lpvid identify` then ends with exit code 3. None otherwise.
        """
        run = None if self.training is None else self.training.overall.free_run
        if run is not None and run.diverged_at is not None:
            return "the model cannot simulate the data that it was fitted to: its free run diverges"
        if run is not None and run.esr is not None and run.esr >= 1:
            return "the model cannot simulate the data that it was fitted to: its free run is no better than their mean"
        return None

    @property
    def held_out_notes(self) -> tuple[str, ...]:
        """What to beware of in the held-out figures alone: a range beyond that of training, a turned sign, a start."""
        if self.held_out is None:
            return ()
        share = self.held_out.extrapolation_share
        beyond = () if share < 5e-4 else (Caveat(f"{100 * share:.1f} % of samples outside the training range of the "
                                                 "scheduling: the model extrapolates there"),)
        return (*(n for n in self.held_out.notes if n not in self.notes), *beyond)

    @property
    def fit(self) -> float | None:
        """Free-run fit in percent on the training data."""
        return None if self.training is None else self.training.overall.free_run.fit_percent

    def with_parameters(self, theta: Sequence[float] | np.ndarray) -> Any:
        """The model at other parameters.

        Parameters
        ----------
        theta : (P,) array
            Parameters in the order of the layout.

        Returns
        -------
        model
            Of the same kind.
        """
        return self.layout.fill(self.model, np.asarray(theta, dtype=float))

    def draw(self, rng: np.random.Generator | int, count: int) -> list:
        """Models drawn from the estimate's normal law.

        Parameters
        ----------
        rng : numpy.random.Generator or int
            Source of the draws.
        count : int
            How many.

        Returns
        -------
        list of models
            Of the same kind.
        """
        return ParameterCloud(self.model, self.layout, self.covariance).draw(rng, count)

    def with_covariance(self, covariance: np.ndarray) -> Identification:
        """The same estimate with another covariance of its parameters, in the model's metadata too.

        Parameters
        ----------
        covariance : (P, P) array
            In the order of the layout.

        Returns
        -------
        Identification
            A copy.
        """
        metadata = dict(self.model.metadata)
        if "parameters" in metadata:
            metadata["parameters"] = {**metadata["parameters"], "covariance": covariance.tolist()}
        return replace(self, covariance=covariance, model=self.model.replace(metadata=metadata))

    def replace(self, **changes) -> Identification:
        """A copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by field.

        Returns
        -------
        Identification
            A copy.
        """
        return replace(self, **changes)

    def to_dict(self) -> dict:
        """identification.json.

        Returns
        -------
        dict
            Plain values by name; arrays as lists.
        """
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        box = self.model.box
        rows = zip(self.parameter_names, self.parameters.tolist(), self.standard_errors.tolist(), strict=True)
        return {
            "schema": "lpvid/identification/1",
            "structure": self.structure.to_dict(),
            "parameters": [{"name": n, "value": v, "std": s} for n, v, s in rows],
            "normalisation": {"names": list(box.names), "units": list(box.units), "centre": box.centre.tolist(),
                              "half_width": box.half_width.tolist()},
            "input_stage": None if stage is None else stage.to_dict(),
            "scheduling_stage": None if lag is None else lag.to_dict(),
            "noise": None if self.noise is None else self.noise.to_dict(), "covariance_kind": self.covariance_kind,
            "n_parameters": self.n_parameters, "n_samples": self.n_samples,
            "condition": self.condition, "scaled_condition": self.scaled_condition,
            "training": None if self.training is None else self.training.to_dict(),
            "held_out": None if self.held_out is None else self.held_out.to_dict(), "doubt": self.doubt,
            "notes": list(self.notes),
        }

    @property
    def _conditioning(self) -> str:
        """Condition numbers in words."""
        if not np.isfinite(self.condition):
            return "of which these data do not determine every combination (condition number infinite)"
        scaled = f"{self.scaled_condition:.1e}" if np.isfinite(self.scaled_condition) else "infinite"
        return f"condition number {self.condition:.1e} ({scaled} with unit columns)"

    def __repr__(self) -> str:
        doubt = "" if self.doubt is None else f" ({self.doubt})"
        lines = [f"Identification{doubt}: {self.model!r}",
                 f"  {self.n_parameters} parameters from {self.n_samples} equations, {self._conditioning}"]
        lines += [f"  {v.label}: {v.summary()}" for v in (self.training, self.held_out) if v is not None]
        lines += [f"  note: {n}" for n in self.notes[:5]]
        lines += [f"  note: held-out: {n}" for n in self.held_out_notes]
        return "\n".join(lines)
