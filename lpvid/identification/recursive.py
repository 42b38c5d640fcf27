"""Recursive least squares: LPV-ARX parameters sample by sample, with forgetting and covariance reset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.forgetting import CovarianceReset, VariableForgetting, forgetting_factor
from lpvid.identification.recursive_estimator import RecursiveEstimator
from lpvid.identification.regression import Factor, RegressionEstimate
from lpvid.identification.result import Identification
from lpvid.identification.structure import Structure
from lpvid.record import Record


@dataclass(frozen=True, eq=False)
class ParameterHistory:
    """Parameters along the data.

    Attributes
    ----------
    equations : (m,) int array
        Equations absorbed so far, all records together.
    parameters : (m, k) array
        NaN where the data did not yet determine them.
    names : tuple of str
    """

    equations: np.ndarray
    parameters: np.ndarray
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class RecursiveIdentification(Identification):
    """The final parameters, and how they went there.

    Attributes
    ----------
    history : ParameterHistory or None
    resets : int
        Covariance resets.
    """

    history: ParameterHistory | None = None
    resets: int = 0


@dataclass(frozen=True)
class Recursive(Structure):
    """LPV-ARX by recursive least squares.

    ::

        K = Pφ/(λ + φᵀPφ),    θ ← θ + K (y − φᵀθ),    P ← (P − K φᵀP)/λ

    Ljung 1999 (11.12), for dampers Niño-Juárez 2008 (λ in 0.98 … 1); P is held as U D Uᵀ (Bierman 1977). By default the
    first samples are solved exactly, without a prior: with ``forgetting=1`` the result is that of `ARX`.

    Parameters
    ----------
    structure : ARX
        Without ridge; stages as objects or None.
    forgetting : float or VariableForgetting
        λ in (0, 1]; 1/(1 − λ) samples are remembered.
    reset : CovarianceReset or None
    initial_covariance : float, optional
        Start from θ = 0 with P = this times the identity (Niño-Juárez: 1e4 … 1e6), in the parameters' own units.
    history : int
        Keep the parameters after every so many equations; 0 keeps none.

    Examples
    --------
    >>> Recursive(ARX(na=1, nb=1, input="u", output="y"), forgetting=0.99).channels
    ('u', 'y')
    """

    KIND = "recursive"

    structure: ARX = field(default_factory=ARX)
    forgetting: float | VariableForgetting = 0.995
    reset: CovarianceReset | None = field(default_factory=CovarianceReset)
    initial_covariance: float | None = None
    history: int = 0

    def __post_init__(self) -> None:
        if self.structure.ridge:
            raise InputError("recursive least squares has no ridge", got=self.structure.ridge,
                             mend="give initial_covariance, which is a prior that fades")
        for name in ("stage", "schedule_filter"):
            if isinstance(getattr(self.structure, name), str):
                raise InputError(f"recursive least squares cannot fit a {name}", got=getattr(self.structure, name),
                                 mend="fit it with ARX first, and give the fitted object")
        if not isinstance(self.forgetting, VariableForgetting):
            object.__setattr__(self, "forgetting", forgetting_factor(self.forgetting, "forgetting"))
        if self.initial_covariance is not None:
            _checks.positive(self.initial_covariance, "initial_covariance")
            if isinstance(self.forgetting, VariableForgetting):
                raise InputError("variable forgetting learns the noise from an exact start",
                                 mend="leave initial_covariance out")
        _checks.count(self.history, "history")

    @property
    def channels(self) -> tuple[str, ...]:
        return self.structure.channels

    @property
    def start(self) -> int:
        return self.structure.start

    def estimate(self, records: Sequence[Record]) -> RecursiveIdentification:
        arx = self.structure
        for name in (*arx.input, *arx.output):
            if not any(np.ptp(r[name]) > 0 for r in records):
                raise InputError(f"channel '{name}' never moves", got=f"the constant {records[0][name][0]:.6g}",
                                 mend="leave it out, or check the sensor")
        assert records[0].sample_time is not None
        running = RecursiveEstimator(self, scheduling_box(records, arx.basis), records[0].sample_time)
        for record in records:
            running.follow(record)
        return packaged(running, records)


def packaged(running: RecursiveEstimator, records: Sequence[Record]) -> RecursiveIdentification:
    """The present estimate as a result; `records` give names, units and the rate.

    Parameters
    ----------
    running : RecursiveEstimator
        After the last sample.
    records : sequence of Record
        At least one.

    Returns
    -------
    RecursiveIdentification
        With the history of the parameters where the structure keeps one.
    """
    running.settle()
    bound, structure = running.bound, running.structure
    width = bound._filter_width()
    layout, empty = bound.layout(width), bound._empty_model(records[0], running.box, width)
    theta = running.parameters.reshape(running.stream.n_outputs, -1).T
    solution = RegressionEstimate(theta, running.covariance, running.noise, *running.conditions)
    found = bound._package(records, empty, layout, Factor(np.zeros((0, 0)), running.equations, len(theta)), solution)
    model = found.model.replace(metadata={**found.model.metadata, "structure": structure.to_dict()})
    history = None
    if structure.history:
        trail = running.trail
        history = ParameterHistory(structure.history * np.arange(1, len(trail) + 1), trail, layout.names(empty))
    notes = (f"covariance reset {running.resets} time(s)",) if running.resets else ()
    return RecursiveIdentification(model, structure, layout, found.covariance, found.condition, found.scaled_condition,
                                   found.n_samples, notes=notes, history=history, resets=running.resets,
                                   covariance_kind="recursive least squares, white equation error")


__all__ = ["CovarianceReset", "ParameterHistory", "Recursive", "RecursiveEstimator", "RecursiveIdentification",
           "VariableForgetting"]
