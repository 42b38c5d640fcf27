"""Models that schedule themselves: the coefficients depend on what the model itself has put out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.codec import VERBATIM, Coded
from lpvid.errors import InputError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Polynomial, Product, Scheduling, Spline

ON = ("output", "trial", "input")
"""What a quasi-LPV model can be scheduled on."""


class SelfScheduled(ABC):
    """What simulation and validation need of a single-output model that is scheduled on its own output."""

    sample_time: float
    box: Scheduling
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    scheduling_stage: SchedulingStage | None
    input_stage: None = None
    n_outputs: ClassVar[int] = 1
    metadata: Mapping

    @property
    @abstractmethod
    def start(self) -> int:
        """Samples at the head of a record that only serve as a past."""

    @property
    @abstractmethod
    def memory(self) -> int:
        """How many past outputs the run depends on."""

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(k,) free parameters, those of the scheduling filter not included."""

    @abstractmethod
    def with_vector(self, vector: np.ndarray) -> SelfScheduled:
        """The same model with other parameters.

        Parameters
        ----------
        vector : (k,) array
            In the order of the model's `vector`.

        Returns
        -------
        SelfScheduled
        """

    @property
    @abstractmethod
    def parameter_names(self) -> tuple[str, ...]:
        """(k,) a name for every parameter."""

    @abstractmethod
    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        """Run from `past` (start,) on.

        Parameters
        ----------
        u : (n, n_inputs) array
            Inputs, the `start` samples of the past included.
        p : (n, n_scheduling) array
            External scheduling behind its filter.
        past : (start,) array
            Outputs before the run.
        limit : float
            Modulus beyond which the run has diverged.

        Returns
        -------
        output : (n,) array
        diverged_at : int or None
        """

    @abstractmethod
    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """(n,) prediction of every sample from measured outputs up to k − horizon; the first `start` are y.

        Parameters
        ----------
        u : (n, n_inputs) array
            Inputs, in SI.
        p : (n, n_scheduling) array
            Measured scheduling, behind its filter.
        y : (n,) array
            Measured output.
        horizon : int
            [samples].

        Returns
        -------
        (n,) array
        """

    @property
    @abstractmethod
    def noise(self) -> NoiseModel:
        """Equation noise where predictions start from measured outputs, output noise where they are the free run."""

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
        return float((reach + 1.0) * np.abs(self.vector).sum())

    def replace(self, **changes):
        """A copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by name of the field.

        Returns
        -------
        SelfScheduled
        """
        return replace(self, **changes)  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class QuasiLPVModel(Coded, SelfScheduled):
    r"""LPV input-output model whose scheduling variable is simulated along with it.

    ::

        y(k) = Σ_m Σ_e φ_m(ρ(k)) ψ_e(p(k)) [ −Σ_{i=1}^{na} a_{i,me} y(k−i) + Σ_q Σ_j b_{qj,me} u_q(k−j) + c_me ]
        ρ(k) = y(k−1)                       on="output"
        ρ(k) = y(k−1) + Σ_j κ_j u(k−nk−j)   on="trial": where the output would go if nothing yielded
        ρ(k) = u(k−1)                       on="input"

    φ_m are hat functions or powers of a saturated argument: ρ is clamped to ``range`` before they are read, so that the
    coefficients stay in a known set whatever the run does. That is what its stability statement rests on: every
    trajectory of this model is one of the LPV model `embedding`, whose scheduling variable moves freely (and at
    any rate) in that range, so a certificate of the embedding covers it. With na = 0 no certificate is needed: hat
    functions are a convex mixture, so |y(k)| ≤ max_m (Σ|b_m| |u| + |c_m|) at every sample (`output_bound`).

    The trial variable is the elastic predictor of plasticity: a yielding element gives F = clamp(F_old + k·Δx).

    Parameters
    ----------
    theta : (M, E, R) array
        By own function, external function, and regressor: na past outputs, then each input's lags, then the constant.
    own : Spline of order 1 with knots, or Polynomial of one variable bound to a box
    na : int
    nb, nk : tuple of int
        Number and first of each input's lags.
    sample_time : float
        Period [s].
    inputs : tuple of Signal
    outputs : tuple of Signal
        One.
    on : {"output", "trial", "input"}
    kappa : (t,) array
        Trial weights on the first input's lags nk, nk+1, …; empty unless on="trial".
    external : Basis
        The ψ_e over measured scheduling variables; the constant alone by default.
    box : Scheduling
        Box of the measured scheduling variables.
    scheduling_stage : SchedulingStage, optional
        Filter on the measured scheduling variables.
    noise_variance : float
        Mean squared free-run error in training.
    metadata : mapping

    Examples
    --------
    >>> stop = QuasiLPVModel([[[0.0, -1.0]], [[0.0, 1.0]]], Spline("y", 1, 1, (-1.0, 1.0)), 0, (1,), (0,), 0.1,
    ...                      (Signal("u"),), (Signal("y"),), "trial", [1.0])
    >>> stop.free_run(np.array([[0.0], [0.6], [0.6], [-0.5]]), np.zeros((4, 0)), np.array([0.0]), 1e9)[0]
    array([0. , 0.6, 1. , 0.5])
    """

    kind = "quasi-lpv"
    JSON = ("kind", "theta", "own", "na", "nb", "nk", "sample_time", "inputs", "outputs", "on", "kappa", "external",
            ("scheduling", "box"), "scheduling_stage", "noise_variance", "metadata")

    theta: np.ndarray
    own: Basis
    na: int
    nb: tuple[int, ...]
    nk: tuple[int, ...]
    sample_time: float
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    on: str = "output"
    kappa: np.ndarray = field(default_factory=lambda: np.zeros(0))
    external: Basis = field(default_factory=Polynomial)
    box: Scheduling = field(default_factory=lambda: Scheduling((), (), ()))
    scheduling_stage: SchedulingStage | None = None
    noise_variance: float = 0.0
    metadata: Mapping = field(default_factory=dict, metadata=VERBATIM)
    noise: ClassVar[NoiseModel] = NoiseModel("equation")

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "nb", _checks.counts(tuple(self.nb), len(self.inputs), "nb", at_least=1))
        set_(self, "nk", _checks.counts(tuple(self.nk), len(self.inputs), "nk"))
        set_(self, "inputs", tuple(self.inputs))
        set_(self, "outputs", tuple(self.outputs))
        _checks.count(self.na, "na")
        _checks.one_of(self.on, ON, "on")
        checked_own(self.own)
        width = self.na + sum(self.nb) + 1
        theta = _checks.frozen_array(self.theta, "theta", ndim=3)
        set_(self, "theta", _checks.finite(_checks.shaped(theta, (self.own.size, self.external.size, width), "theta"),
                                           "theta"))
        set_(self, "kappa", _checks.finite(_checks.frozen_array(self.kappa, "kappa", ndim=1), "kappa"))
        if len(self.outputs) != 1 or (self.on == "trial") != bool(self.kappa.size):
            raise InputError("a quasi-LPV model has one output, and trial weights where it is scheduled on a trial",
                             got=f"{len(self.outputs)} outputs, on='{self.on}', {self.kappa.size} weights")

    # -- sizes --------------------------------------------------------------------------------------------------
    @property
    def start(self) -> int:
        back = [b + k - 1 for b, k in zip(self.nb, self.nk, strict=True)]
        return max(self.na, 1, self.nk[0] + self.kappa.size - 1, *back)

    @property
    def memory(self) -> int:
        return max(self.na, 1)

    @property
    def vector(self) -> np.ndarray:
        return np.concatenate([self.theta.ravel(), self.kappa])

    def with_vector(self, vector: np.ndarray) -> QuasiLPVModel:
        vector = np.asarray(vector, dtype=float)
        return self.replace(theta=vector[: self.theta.size].reshape(self.theta.shape), kappa=vector[self.theta.size:])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        several = len(self.inputs) > 1
        regressors = [f"a{i}" for i in range(1, self.na + 1)]
        for signal, b, k in zip(self.inputs, self.nb, self.nk, strict=True):
            regressors += [f"b{j}{{{signal.name}}}" if several else f"b{j}" for j in range(k, k + b)]
        regressors.append("c")
        functions = Product(self.own, self.external).labels
        return (*(f"{r}[{f}]" for f in functions for r in regressors),
                *(f"kappa{j}" for j in range(self.nk[0], self.nk[0] + self.kappa.size)))

    @property
    def range(self) -> tuple[float, float]:
        """Range to which ρ is clamped, in its SI unit."""
        if isinstance(self.own, Spline):
            return self.own.knots[0], self.own.knots[-1]
        assert isinstance(self.own, Polynomial)
        return (self.own.centre[0] - self.own.half_width[0], self.own.centre[0] + self.own.half_width[0])

    # -- running ------------------------------------------------------------------------------------------------
    def arrays(self, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """External functions (n, E), regressors (n, R) with empty output columns, drive of ρ (n, t).

        Parameters
        ----------
        u : (n, n_inputs) array
            Inputs, in SI.
        p : (n, n_scheduling) array
            Measured scheduling, behind its filter.

        Returns
        -------
        (n, E) array, (n, R) array, (n, t) array
            The last without columns where ρ is the past output alone.
        """
        columns = [np.zeros(len(u))] * self.na
        for q, (b, k) in enumerate(zip(self.nb, self.nk, strict=True)):
            columns += [lagged(u[:, q], j) for j in range(k, k + b)]
        columns.append(np.ones(len(u)))
        lags = [1] if self.on == "input" else [self.nk[0] + j for j in range(self.kappa.size)]
        drive = np.column_stack([lagged(u[:, 0], j) for j in lags]) if lags else np.zeros((len(u), 0))
        return (np.ascontiguousarray(self.external.evaluate(p)), np.ascontiguousarray(np.column_stack(columns)),
                np.ascontiguousarray(drive))

    @property
    def kernel_settings(self) -> tuple[int, np.ndarray, np.ndarray, np.ndarray, float, int]:
        """Own functions, parameters and feedback in the order of the compiled loops."""
        if isinstance(self.own, Spline):
            kind, knots = 0, np.array(self.own.knots)
        else:
            assert isinstance(self.own, Polynomial)
            kind, knots = 1, np.array([self.own.centre[0], self.own.half_width[0]])
        kappa = _checks.read_only(np.ones(1)) if self.on == "input" else self.kappa
        return kind, knots, self.theta, kappa, 0.0 if self.on == "input" else 1.0, self.na

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        from lpvid._quasi_kernels import free_run_quasi

        y = np.zeros(len(u))
        y[: self.start] = past
        code = int(free_run_quasi(*self.kernel_settings, *self.arrays(u, p), y, self.start, limit))
        return y, None if code < 0 else code

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        from lpvid._quasi_kernels import ahead_quasi

        out = np.array(y, dtype=float)
        ahead_quasi(*self.kernel_settings, *self.arrays(u, p), np.array(y, dtype=float), self.start, horizon, out)
        return out

    # -- statements ---------------------------------------------------------------------------------------------
    def embedding(self) -> LPVTransferFunction:
        """The LPV model in which ρ is a measured scheduling variable ``rho``, free in the clamped range.

        Its coefficients are taken at the time of the output, as here; every run of this model is one of it.

        Returns
        -------
        LPVTransferFunction
            Over the product of both bases, the box of ρ in front.
        """
        low, high = self.range
        box = Scheduling(("rho", *self.box.names), (low, *self.box.lower), (high, *self.box.upper),
                         (None, *self.box.rate), ("", *self.box.units))
        own = replace(self.own, name="rho") if isinstance(self.own, Spline) else replace(self.own, names=("rho",))  # type: ignore[call-arg, arg-type]
        basis = Product(own, self.external) if self.external.names else own
        flat = self.theta.reshape(basis.size, -1)
        a = np.array([flat[:, i] for i in range(self.na)]).reshape(self.na, 1, 1, basis.size)
        b = np.zeros((max(n + k for n, k in zip(self.nb, self.nk, strict=True)), 1, len(self.inputs), basis.size))
        column = self.na
        for q, (n, k) in enumerate(zip(self.nb, self.nk, strict=True)):
            for j in range(k, k + n):
                b[j, 0, q] = flat[:, column]
                column += 1
        return LPVTransferFunction(a, b, basis, self.sample_time, box, flat[:, -1].reshape(1, 1, -1), False,
                                   self.inputs, self.outputs, scheduling_stage=self.scheduling_stage)

    def output_bound(self, amplitude: float | np.ndarray, p: np.ndarray | None = None) -> float:
        """What |y| never exceeds for inputs within `amplitude`, whatever their course; inf where this cannot decide.

        With s_i the largest |a_i| over the clamped range and f the largest forcing Σ|b||u| + |c| there, |y| ≤
        max(past, f/(1 − Σ s_i)) for Σ s_i < 1. Hat functions are a convex mixture, so their maxima stand at the knots.

        Parameters
        ----------
        amplitude : float or (n_inputs,) array
            Largest modulus of each input.
        p : (n, n_scheduling) array, optional
            External scheduling that occurs (behind its filter); left out, a grid of the box.

        Returns
        -------
        float
            In the unit of the output, for outputs before the start no larger than it.
        """
        reach = np.broadcast_to(np.asarray(amplitude, dtype=float), (len(self.inputs),))
        if p is None:
            p = self.box.grid(2 if self.external.degree is not None and self.external.degree <= 1 else 41)
        values = np.abs(np.einsum("mer,ne->nmr", self.theta, self.external.evaluate(p)))
        mixed = values.max(axis=1) if isinstance(self.own, Spline) else values.sum(axis=1)  # |z| ≤ 1
        weight = np.concatenate([np.repeat(reach, self.nb), [1.0]])
        forcing = (values[:, :, self.na:] @ weight)
        largest = float(forcing.max() if isinstance(self.own, Spline) else forcing.sum(axis=1).max())
        back = float(mixed[:, : self.na].sum(axis=1).max(initial=0.0))
        return largest / (1.0 - back) if back < 1.0 else float("inf")

    def __repr__(self) -> str:
        inputs = ", ".join(map(str, self.inputs))
        low, high = self.range
        return (f"QuasiLPVModel {inputs} -> {self.outputs[0]}: na={self.na}, nb={list(self.nb)}, scheduled on its "
                f"{self.on} in [{low:.4g}, {high:.4g}], {self.theta.size + self.kappa.size} parameters, "
                f"{1 / self.sample_time:.6g} Hz")


def checked_own(own: Basis) -> Basis:
    """A basis that stays bounded outside its range: hat functions, or powers of a saturated argument.

    Parameters
    ----------
    own : Basis
        In the self-scheduling variable ρ.

    Returns
    -------
    Basis
        The same.

    Raises
    ------
    InputError
        A basis of another kind, of several variables or of shifted times, or a spline of another order than 1.
    """
    if len(own.names) != 1 or own.lags != (0, 0) or not isinstance(own, (Spline, Polynomial)):
        raise InputError("a self-scheduled model needs a spline or polynomial of one variable", got=own)
    if isinstance(own, Spline) and own.order != 1:
        raise InputError("a self-scheduled model needs splines of order 1", got=own.order,
                         why="their clamped mixture stays convex", mend="Spline(name, segments, order=1)")
    return own


def lagged(column: np.ndarray, lag: int) -> np.ndarray:
    """Column delayed by `lag` samples; its first value stands before the start.

    Parameters
    ----------
    column : (n,) array
    lag : int
        ≥ 0.

    Returns
    -------
    (n,) array
    """
    return np.concatenate([np.full(min(lag, len(column)), column[:1].sum()), column[: max(len(column) - lag, 0)]])
