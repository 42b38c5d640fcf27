"""LPVStateSpace: matrices linear in a basis of the scheduling variables (affine, polynomial or gridded)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lpvid import _checks
from lpvid.codec import VERBATIM
from lpvid.model.input_stage import InputStage
from lpvid.model.lpv_model import LPVModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import _point
from lpvid.scheduling import Basis, Polynomial, Scheduling
from lpvid.scheduling.basis import checked_basis

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A, B, C, D, at one value of the scheduling or (N, …) at several."""


@dataclass(frozen=True, eq=False)
class LPVStateSpace(LPVModel):
    """State-space LPV model, discrete (``sample_time`` set) or continuous (None).

    ::

        x⁺ = A(p) x + B(p) u + f(p) + K(p) e        x⁺ = x(k+1), or ẋ in continuous time
        y  = C(p) x + D(p) u + g(p) + e             A(p) = Σ_m A[m] φ_m(p), the others alike

    An affine model has a first-degree polynomial basis, a polynomial one a higher degree, a gridded one a `Spline` of
    order 1 (linear interpolation between grid points). f and g carry affine terms; K, where known, makes the model an
    innovation form and gives `predict` its observer.

    Parameters
    ----------
    A : (M, n, n) array
    B : (M, n, m) array
    C : (M, n_outputs, n) array
    D : (M, n_outputs, m) array
    basis : Basis
        The M functions φ_m; it may read p at several times (`Stacked`, `Shifted`).
    sample_time : float or None
        Sampling period [s]; None for continuous time.
    scheduling : Scheduling, optional
        Names, box and rate bounds of p; left out, −1 to 1 of each of the basis's variables, at any rate.
    state_offset, output_offset : (M, n) and (M, n_outputs) arrays, optional
        f and g.
    observer_gain : (M, n, n_outputs) array, optional
        K.
    inputs, outputs, input_stage, scheduling_stage, noise_covariance, metadata
        As in `LPVTransferFunction`.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVStateSpace([[[0.5]], [[0.2]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], [[[0.0]], [[0.0]]],
    ...                       Polynomial("p", degree=1), sample_time=0.1)
    >>> float(model.frozen([1.0])[0][0, 0])
    0.7
    """

    kind = "lpv-state-space"
    JSON = ("kind", "A", "B", "C", "D", "state_offset", "output_offset", "observer_gain", "basis", "sample_time",
            "scheduling", "order", "inputs", "outputs", "input_stage", "scheduling_stage", "noise_covariance",
            "metadata")

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    basis: Basis
    sample_time: float | None
    scheduling: Scheduling | None = None
    state_offset: np.ndarray | None = None
    output_offset: np.ndarray | None = None
    observer_gain: np.ndarray | None = None
    inputs: tuple[Signal, ...] = ()
    outputs: tuple[Signal, ...] = ()
    input_stage: InputStage | None = None
    scheduling_stage: SchedulingStage | None = None
    noise_covariance: np.ndarray | None = None
    metadata: Mapping = field(default_factory=dict, metadata=VERBATIM)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        checked_basis(self.basis)
        m = self.basis.size
        a = _checks.frozen_array(self.A, "A", ndim=3)
        c = _checks.frozen_array(self.C, "C", ndim=3)
        d = _checks.frozen_array(self.D, "D", ndim=3)
        n, ny, nu = a.shape[1], c.shape[1], d.shape[2]
        arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]] = {
            "A": (a, (m, n, n)), "C": (c, (m, ny, n)), "D": (d, (m, ny, nu)),
            "B": (_checks.frozen_array(self.B, "B", ndim=3), (m, n, nu))}
        offset_f = np.zeros((m, n)) if self.state_offset is None else self.state_offset
        offset_g = np.zeros((m, ny)) if self.output_offset is None else self.output_offset
        arrays["state_offset"] = (_checks.frozen_array(offset_f, "state_offset"), (m, n))
        arrays["output_offset"] = (_checks.frozen_array(offset_g, "output_offset"), (m, ny))
        if self.observer_gain is not None:
            arrays["observer_gain"] = (_checks.frozen_array(self.observer_gain, "observer_gain"), (m, n, ny))
        for name, (array, shape) in arrays.items():
            set_(self, name, _checks.finite(_checks.shaped(array, shape, name), name))
        if self.sample_time is not None:
            set_(self, "sample_time", _checks.positive(self.sample_time, "sample_time", "s"))
        self._settle(ny, nu, f"D of shape {d.shape}")

    @classmethod
    def of(cls, whole: np.ndarray, order: int, basis: Basis, sample_time: float | None,
           scheduling: Scheduling | None = None, **more: Any) -> LPVStateSpace:
        """The system of one matrix [A B; C D] over a basis.

        Parameters
        ----------
        whole : (M, n + ny, n + nu) array
            The matrix, one for each function of the basis.
        order : int
            n.
        basis : Basis
            M functions.
        sample_time : float or None
            Period [s]; None in continuous time.
        scheduling : Scheduling, optional
            Box and rate bounds of the basis's variables.
        **more
            Further fields, such as `inputs` and `outputs`.

        Returns
        -------
        LPVStateSpace
            n states, nu inputs, ny outputs.
        """
        n = order
        return cls(whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n], whole[:, n:, n:], basis, sample_time,
                   scheduling, **more)

    @classmethod
    def still(cls, a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike, sample_time: float | None = None,
              **more: Any) -> LPVStateSpace:
        """A system without scheduling.

        Parameters
        ----------
        a, b, c, d : (n, n), (n, nu), (ny, n) and (ny, nu) array
            Its matrices.
        sample_time : float or None
            Period [s]; None in continuous time.
        **more
            Further fields, such as `inputs` and `outputs`.

        Returns
        -------
        LPVStateSpace
            Over the constant alone.

        Examples
        --------
        >>> LPVStateSpace.still([[-2.0]], [[1.0]], [[1.0]], [[0.0]]).frozen_poles([]).tolist()
        [-2.0]
        """
        matrices = (np.asarray(m, dtype=float)[None] for m in (a, b, c, d))
        return cls(*matrices, basis=Polynomial((), 0), sample_time=sample_time, **more)

    @property
    def order(self) -> int:
        """Number of states."""
        return self.A.shape[1]

    @property
    def memory(self) -> int:
        """Values that hold what ran before a record: the states."""
        return self.order

    @property
    def n_outputs(self) -> int:
        """Number of outputs."""
        return self.C.shape[1]

    @property
    def n_filter_inputs(self) -> int:
        """Number of inputs of the linear part, after the input stage."""
        return self.D.shape[2]

    @property
    def is_discrete(self) -> bool:
        """True for a discrete-time model."""
        return self.sample_time is not None

    @property
    def start(self) -> int:
        """Measured samples from which a free run takes its state: two per state, at least four."""
        return max(2 * self.order, 4) if self.order else 0

    def frozen(self, p: Sequence[float] | np.ndarray) -> Matrices:
        """A, B, C, D with the scheduling frozen at `p` of shape (n_scheduling,).

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the variables.

        Returns
        -------
        tuple of arrays
            A (n, n), B (n, nu), C (ny, n), D (ny, nu).
        """
        phi = self.basis.evaluate(_point(p, self.box))[0]
        a, b, c, d = (np.tensordot(phi, x, axes=1) for x in (self.A, self.B, self.C, self.D))
        return a, b, c, d

    def at(self, points: np.ndarray) -> Matrices:
        """(N, …) A, B, C, D at points of shape (N, n_scheduling).

        Parameters
        ----------
        points : (N, n_scheduling) array
            In the units of the variables.

        Returns
        -------
        tuple of arrays
            Along their first axis the points.
        """
        phi = self.basis.evaluate(np.asarray(points, dtype=float))
        a, b, c, d = (np.tensordot(phi, x, axes=1) for x in (self.A, self.B, self.C, self.D))
        return a, b, c, d

    def companion(self, p: Sequence[float] | np.ndarray) -> np.ndarray:
        return self.frozen(p)[0]

    def forcing(self, reach: float, state: float = 0.0) -> float:
        assert self.state_offset is not None and self.output_offset is not None
        moved = reach * np.abs(self.B).sum() + np.abs(self.state_offset).sum() + state
        return float(reach * np.abs(self.D).sum() + np.abs(self.output_offset).sum() + moved * np.abs(self.C).sum())

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        m, n, outputs, stage, inputs = (values[k] for k in ("basis", "order", "outputs", "input_stage", "inputs"))
        m, y, u = m.size, len(outputs), len(inputs if stage is None else stage.signals(inputs))
        return {"A": (m, n, n), "B": (m, n, u), "C": (m, y, n), "D": (m, y, u), "state_offset": (m, n),
                "output_offset": (m, y), "observer_gain": (m, n, y)}

    def __repr__(self) -> str:
        inputs = ", ".join(map(str, self.inputs))
        outputs = ", ".join(map(str, self.outputs))
        clock = f"{1 / self.sample_time:.6g} Hz" if self.sample_time else "continuous"
        return (f"LPVStateSpace {inputs} -> {outputs}: {self.order} states, "
                f"basis {{{', '.join(self.basis.labels)}}}, {clock}")
