"""LFTModel: a linear fractional form, a constant matrix with the scheduling pulled out into a block Δ."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks
from lpvid.codec import VERBATIM, Coded
from lpvid.errors import InputError
from lpvid.model.signals import Signal, as_signals
from lpvid.model.state_space import Matrices
from lpvid.model.transfer_function import _point
from lpvid.scheduling import Scheduling

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class WellPosedness:
    """Whether I − D_qp Δ can be inverted on the whole box: proven, disproven at a point, or undecided.

    Parameters
    ----------
    holds : bool or None
    at : tuple of float or None
        Scheduling where the determinant vanishes or changes sign.
    boxes : int
        Pieces into which the box was cut.
    """

    holds: bool | None
    at: tuple[float, ...] | None
    boxes: int

    def __str__(self) -> str:
        if self.holds is None:
            return f"well-posedness undecided after {self.boxes} boxes"
        return f"well posed on the whole box ({self.boxes} boxes)" if self.holds else f"ill posed near p = {self.at}"


@dataclass(frozen=True, eq=False)
class LFTModel(Coded):
    """x⁺, q, y = M [x, p, u] with p = Δ q: every rational dependence on the scheduling, exactly.

    ::

             ┌──────────────────┐        Δ = diag(δ_1 I_{r_1}, δ_2 I_{r_2}, …),  δ_i = (ρ_i − centre_i)/half_width_i
          ┌──│ Δ(ρ), |δ_i| ≤ 1  │<─┐
        p │  └──────────────────┘  │ q     [x⁺]   [A   B_p   B_u ] [x]        x⁺ = x(k+1), or ẋ in continuous time
          │  ┌──────────────────┐  │       [q ] = [C_q D_qp  D_qu] [p]
          └─>│ M                │──┘       [y ]   [C_y D_yp  D_yu] [u]
        u ──>│                  │──> y
             └──────────────────┘          (Zhou, Doyle & Glover 1996, chapter 10)

    Parameters
    ----------
    matrix : (n + r + n_outputs, n + r + n_inputs) array
        M, with r = Σ r_i.
    order : int
        n.
    scheduling : Scheduling
        Names, box (its ends are δ = ∓1) and rate bounds.
    repetitions : tuple of int
        r_i for every scheduling variable; 0 for one that has no influence.
    sample_time : float or None
        Sampling period [s]; None for continuous time.
    inputs, outputs : tuple of Signal or str, optional
    metadata : mapping, optional

    Examples
    --------
    >>> box = Scheduling(("p",), (0.0,), (2.0,))                                # x⁺ = −x/(1 + p)
    >>> model = LFTModel(np.array([[-0.5, 0.25], [1.0, -0.5]]), 1, box, (1,), 0.1)
    >>> model.frozen([2.0])[0].round(12).tolist(), str(model.well_posed())
    ([[-0.333333333333]], 'well posed on the whole box (1 boxes)')
    """

    kind = "lft"
    JSON = ("kind", "matrix", "shape", "order", "scheduling", "repetitions", "sample_time", "inputs", "outputs",
            "metadata")

    matrix: np.ndarray
    order: int
    scheduling: Scheduling
    repetitions: tuple[int, ...]
    sample_time: float | None
    inputs: tuple[Signal, ...] = ()
    outputs: tuple[Signal, ...] = ()
    metadata: Mapping = field(default_factory=dict, metadata=VERBATIM)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        matrix = _checks.finite(_checks.frozen_array(self.matrix, "the matrix of an LFT", ndim=2), "matrix")
        set_(self, "matrix", matrix)
        set_(self, "order", _checks.count(self.order, "the order of an LFT"))
        set_(self, "repetitions", _checks.counts(tuple(self.repetitions), len(self.scheduling.names), "repetitions"))
        if self.sample_time is not None:
            set_(self, "sample_time", _checks.positive(self.sample_time, "sample_time", "s"))
        inner = self.order + self.width
        if min(matrix.shape) < inner:
            raise InputError("the matrix of an LFT is too small", got=f"shape {matrix.shape}",
                             why=f"{self.order} states and {self.width} repeated parameters need more")
        set_(self, "inputs", as_signals(self.inputs, "u", matrix.shape[1] - inner))
        set_(self, "outputs", as_signals(self.outputs, "y", matrix.shape[0] - inner))
        if (len(self.outputs), len(self.inputs)) != (matrix.shape[0] - inner, matrix.shape[1] - inner):
            raise InputError("signals do not match the matrix of an LFT",
                             got=f"{len(self.outputs)} outputs and {len(self.inputs)} inputs for shape {matrix.shape}")
        set_(self, "metadata", dict(self.metadata))

    @property
    def width(self) -> int:
        """r, the size of Δ."""
        return sum(self.repetitions)

    @property
    def box(self) -> Scheduling:
        """The scheduling variables' names, box and rate bounds."""
        return self.scheduling

    @property
    def is_discrete(self) -> bool:
        """True for a discrete-time model."""
        return self.sample_time is not None

    def part(self, row: str, column: str) -> np.ndarray:
        """A block of M by its letters: rows x, q, y; columns x, p, u.

        Parameters
        ----------
        row : {"x", "q", "y"}
        column : {"x", "p", "u"}

        Returns
        -------
        array
            View of M; sizes n, r and the number of outputs or inputs.
        """
        edges = [0, self.order, self.order + self.width]
        rows, columns = [*edges, self.matrix.shape[0]], [*edges, self.matrix.shape[1]]
        i, j = "xqy".index(row), "xpu".index(column)
        return self.matrix[rows[i] : rows[i + 1], columns[j] : columns[j + 1]]

    def delta(self, points: np.ndarray) -> np.ndarray:
        """(N, r) diagonal of Δ at points of shape (N, n_scheduling).

        Parameters
        ----------
        points : (N, n_scheduling) array
            In the units of the box.

        Returns
        -------
        (N, r) array
            −1 … 1 inside the box.
        """
        half = np.where(self.scheduling.half_width > 0, self.scheduling.half_width, 1.0)
        normal = (np.asarray(points, dtype=float) - self.scheduling.centre) / half
        return np.repeat(normal, self.repetitions, axis=1)

    def at(self, points: np.ndarray) -> Matrices:
        """(N, …) A, B, C, D at points of shape (N, n_scheduling); raises where the form is ill posed.

        Parameters
        ----------
        points : (N, n_scheduling) array
            In the units of the box.

        Returns
        -------
        (N, n, n), (N, n, n_inputs), (N, n_outputs, n), (N, n_outputs, n_inputs) arrays

        Raises
        ------
        InputError
            I − D_qp Δ is singular to rounding at one of the points.
        """
        r, n = self.width, self.order
        outside = np.r_[0:n, n + r : self.matrix.shape[0]]
        across = np.r_[0:n, n + r : self.matrix.shape[1]]
        delta = self.delta(points)
        loop = np.eye(r) - self.part("q", "p") * delta[:, None, :]
        if r and np.any(weak := np.linalg.cond(loop) > 1e13):
            where = np.asarray(points, dtype=float)[np.argmax(weak)].tolist()
            raise InputError("the linear fractional form has no value here", got=f"scheduling {where}",
                             why="I − D_qp Δ is singular", mend="stay inside the box for which it is well posed")
        inner = np.linalg.solve(loop, np.broadcast_to(self.matrix[n : n + r, across], (len(delta), r, len(across))))
        whole = self.matrix[np.ix_(outside, across)] + (self.matrix[outside, n : n + r] * delta[:, None, :]) @ inner
        return whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n], whole[:, n:, n:]

    def frozen(self, p: Sequence[float] | np.ndarray) -> Matrices:
        """A, B, C, D with the scheduling frozen at `p` of shape (n_scheduling,).

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the box.

        Returns
        -------
        (n, n), (n, n_inputs), (n_outputs, n), (n_outputs, n_inputs) arrays
        """
        a, b, c, d = self.at(_point(p, self.scheduling))
        return a[0], b[0], c[0], d[0]

    def frozen_poles(self, p: Sequence[float] | np.ndarray) -> np.ndarray:
        """(n,) poles with the scheduling frozen at `p`.

        Parameters
        ----------
        p : (n_scheduling,) array
            In the units of the box.

        Returns
        -------
        (n,) array
            In the plane of z, or of s [1/s] in continuous time.
        """
        return np.linalg.eigvals(self.frozen(p)[0]) if self.order else np.empty(0)

    def well_posed(self, budget: int = 4096) -> WellPosedness:
        """Prove or disprove that I − D_qp Δ is invertible for every Δ of the box.

        Around a centre Δ₀, with G = (I − D_qp Δ₀)⁻¹ D_qp, it is wherever the spectral radius of |G| diag|Δ − Δ₀| is
        below 1; boxes for which that fails are halved. A change of sign of the determinant disproves it.

        Parameters
        ----------
        budget : int
            Boxes examined at most.

        Returns
        -------
        WellPosedness
            Undecided where the budget is spent; with the point where the form has no value where it is disproved.
        """
        if not self.width:
            return WellPosedness(True, None, 0)
        active = [i for i, count in enumerate(self.repetitions) if count]
        index = np.repeat(np.arange(len(active)), [self.repetitions[i] for i in active])
        loop = self.part("q", "p")
        boxes, seen, sign = [(np.zeros(len(active)), np.ones(len(active)))], 0, 0.0
        while boxes:
            centre, half = boxes.pop()
            seen += 1
            gap = np.eye(self.width) - loop * centre[index]
            here = float(np.linalg.slogdet(gap)[0]) if np.linalg.cond(gap) < 1e13 else 0.0
            if here == 0.0 or sign * here < 0:
                return WellPosedness(False, self._physical(active, centre), seen)
            sign = here
            reach = np.abs(np.linalg.solve(gap, loop)) * half[index]
            if np.abs(np.linalg.eigvals(reach)).max() < 1 - 1e-9:
                continue
            if seen >= budget:
                return WellPosedness(None, None, seen)
            axis = int(np.argmax([reach[:, index == k].sum() for k in range(len(active))]))
            step = np.where(np.arange(len(active)) == axis, half / 2, 0.0)
            boxes += [(centre - step, half - step), (centre + step, half - step)]
        return WellPosedness(True, None, seen)

    def _physical(self, active: Sequence[int], delta: np.ndarray) -> tuple[float, ...]:
        point = self.scheduling.centre.copy()
        point[list(active)] += self.scheduling.half_width[list(active)] * delta
        return tuple(point.tolist())

    def simulate(self, inputs: np.ndarray, scheduling: np.ndarray, initial: np.ndarray | None = None,
                 sample_time: float | None = None) -> np.ndarray:
        """Output along sampled inputs and scheduling, each held over its sample (exact in continuous time).

        Parameters
        ----------
        inputs : (N, n_inputs) array
        scheduling : (N, n_scheduling) array
        initial : (n,) array, optional
            State at the first sample; zero if left out.
        sample_time : float, optional
            Period [s] of the samples; needed in continuous time.

        Returns
        -------
        (N, n_outputs) array
        """
        u = _checks.shaped(np.asarray(inputs, dtype=float), (None, len(self.inputs)), "inputs")
        p = _checks.shaped(np.asarray(scheduling, dtype=float), (len(u), len(self.scheduling.names)), "scheduling")
        a, b, c, d = self.at(p)
        if not self.is_discrete:
            a, b = held(a, b, _checks.positive(sample_time if sample_time else math.nan, "sample_time", "s"))
        x = np.zeros(self.order) if initial is None else _checks.shaped(np.asarray(initial, dtype=float),
                                                                        (self.order,), "initial")
        return run_along((a, b, c, d), u, x)

    def to_control(self, at: Sequence[float] | np.ndarray) -> control.StateSpace:
        """The frozen model as a python-control `StateSpace`.

        Parameters
        ----------
        at : (n_scheduling,) array
            Scheduling, in the units of the box.

        Returns
        -------
        control.StateSpace
            Of the same sampling period.
        """
        import control

        return control.StateSpace(*self.frozen(at), self.sample_time or 0.0, inputs=[s.name for s in self.inputs],
                                  outputs=[s.name for s in self.outputs])

    def replace(self, **changes) -> LFTModel:
        """A copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by name of the field.

        Returns
        -------
        LFTModel
        """
        return replace(self, **changes)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the matrix."""
        return self.matrix.shape[0], self.matrix.shape[1]

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        return {"matrix": tuple(values["shape"])}

    def __repr__(self) -> str:
        size = ", ".join(f"{n} x{r}" for n, r in zip(self.scheduling.names, self.repetitions, strict=True))
        clock = f"{1 / self.sample_time:.6g} Hz" if self.sample_time else "continuous"
        return (f"LFTModel {', '.join(map(str, self.inputs))} -> {', '.join(map(str, self.outputs))}: {self.order} "
                f"states, Δ {{{size}}}, {clock}")


def held(a: np.ndarray, b: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """(N, …) matrices over one sample of held input and scheduling: exp of [A B; 0 0] T.

    Parameters
    ----------
    a, b : (N, n, n) and (N, n, m) array
        Of a continuous system.
    period : float
        Sample [s].

    Returns
    -------
    (N, n, n) and (N, n, m) array
        Of the sampled one.
    """
    from scipy.linalg import expm

    n, m = b.shape[1:]
    whole = np.zeros((len(a), n + m, n + m))
    whole[:, :n, :n], whole[:, :n, n:] = a * period, b * period
    moved = np.asarray(expm(whole)) if whole.size else whole
    return moved[:, :n, :n], moved[:, :n, n:]


def run_along(system: Matrices, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(N, ny) output of a discrete system whose matrices are known at every sample.

    Parameters
    ----------
    system : (A, B, C, D), each (N, …)
        One for each sample.
    u : (N, nu) array
        Inputs.
    x : (n,) array
        State at the first sample.

    Returns
    -------
    (N, ny) array
        Sample by sample.
    """
    a, b, c, d = system
    out = np.empty((len(u), c.shape[1]))
    for k in range(len(u)):
        out[k] = c[k] @ x + d[k] @ u[k]
        x = a[k] @ x + b[k] @ u[k]
    return out
