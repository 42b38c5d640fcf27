"""Least squares on LPV regressors: chunks of [X y] folded into one triangular factor, memory independent of N."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid._memory import keep_for_reuse
from lpvid._threads import single_thread
from lpvid.errors import InputError
from lpvid.model.input_stage import InputStage
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.record import Record
from lpvid.scheduling import Basis

SUPER_CHUNK = 32768
"""samples for which the basis is evaluated at once."""
CHUNK = 1024
"""rows folded into R at once."""
SINGULAR = 1e-13
"""smallest over largest singular value, with unit columns, below which parameters cannot be separated."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What stands in each column of a regressor.

    Column q is ``sign · signal[source](k − lag) · φ_function(p(k − phi_lag))``; function −1 stands for 1. Signals are
    the outputs, then the filter inputs, then the constant 1.

    Attributes
    ----------
    source : (columns,) int array
        Place of the signal.
    sign : (columns,) array
        −1 for past outputs, else 1.
    lag : (columns,) int array
        Of the signal [samples].
    function : (columns,) int array
        Place in the basis.
    phi_lag : (columns,) int array
        Of the scheduling [samples].
    """

    source: np.ndarray
    sign: np.ndarray
    lag: np.ndarray
    function: np.ndarray
    phi_lag: np.ndarray

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.source.size


@dataclass(frozen=True, eq=False)
class RegressionData:
    """Channels and maps that turn records into regressor rows.

    Attributes
    ----------
    inputs, outputs, scheduling : tuple of str
        Channel names.
    basis : Basis
        Bound to a box.
    columns : Columns
        Of one output's equation.
    start : int
        First sample that gives an equation.
    stage : InputStage, optional
    scheduling_stage : SchedulingStage, optional
        Filter on the logged scheduling.
    weight : str, optional
        Channel of non-negative weights per sample.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    scheduling: tuple[str, ...]
    basis: Basis
    columns: Columns
    start: int
    stage: InputStage | None = None
    scheduling_stage: SchedulingStage | None = None
    weight: str | None = None


@dataclass(frozen=True, eq=False)
class Factor:
    """R of [X Y] and the number of rows behind it.

    Attributes
    ----------
    r : (columns + outputs, columns + outputs) array
    rows : int
    columns : int
        Columns of X.
    """

    r: np.ndarray
    rows: int
    columns: int

    def solve(self, ridge: float, names: Sequence[str], spare: np.ndarray | None = None) -> RegressionEstimate:
        """Least squares, with `ridge` times the squared parameters in unit-column scaling added to the cost.

        Parameters
        ----------
        ridge : float
            0 for plain least squares; relative to a regressor column's own energy.
        names : sequence of str
            Parameter names, for the message when some are dependent.
        spare : (columns,) bool array, optional
            Columns that may depend on one another: the estimate of least norm, in unit-column scaling, is taken where
            nothing else does.

        Returns
        -------
        RegressionEstimate

        Raises
        ------
        InputError
            A regressor that is zero throughout; without ridge, regressors that are linearly dependent, unless
            `spare` allows it.
        """
        from scipy.linalg import solve_triangular

        k = self.columns
        r11, r12, r22 = self.r[:k, :k], self.r[:k, k:], self.r[k:, k:]
        scale = np.linalg.norm(r11, axis=0)
        if not np.all(scale > 0):
            dead = ", ".join(names[int(i)] for i in np.flatnonzero(scale == 0)[:4])
            raise InputError(f"regressors are zero throughout: {dead}", why="their signals do not move",
                             mend="leave these inputs out")
        singular = np.linalg.svd(r11 / scale, compute_uv=False)
        condition = np.linalg.cond(r11)
        if singular[-1] < SINGULAR * singular[0] and ridge == 0:
            _, values, vt = np.linalg.svd(r11 / scale)
            null = vt[values < SINGULAR * values[0]]
            if spare is not None and np.sum(null[:, ~spare] ** 2) < np.sqrt(SINGULAR):
                return self._least_norm(scale, singular)
            weight = np.abs(vt[-1])
            mixed = [names[int(i)] for i in np.argsort(-weight)[:4] if weight[i] > 0.05 * weight.max()]
            raise InputError("these data cannot separate some parameters",
                             got=f"a dependence among {', '.join(mixed)}",
                             why="their regressors are linearly dependent", mend=_apart(mixed))
        if ridge:
            q, stacked = np.linalg.qr(np.vstack([r11, np.diag(np.sqrt(ridge) * scale)]))
            theta = solve_triangular(stacked, q[:k].T @ r12)
        else:
            stacked, theta = r11, solve_triangular(r11, r12)
        inverse = solve_triangular(stacked, np.eye(k))
        gram = inverse @ inverse.T
        if ridge:  # R (XᵀX + ridge·D²)⁻¹ =: H gives the sandwich HᵀH
            gram = (r11 @ gram).T @ (r11 @ gram)
        residual = np.vstack([r12 - r11 @ theta, r22])
        noise = residual.T @ residual / max(self.rows - k, 1)
        return RegressionEstimate(
            theta, np.kron(noise, gram), noise, float(condition), float(singular[0] / singular[-1])
        )

    def _least_norm(self, scale: np.ndarray, singular: np.ndarray) -> RegressionEstimate:
        """The least squares of least norm; no variance along what these equations do not hold."""
        k = self.columns
        inverse = np.linalg.pinv(self.r[:k, :k] / scale, rcond=SINGULAR)
        theta = (inverse @ self.r[:k, k:]) / scale[:, None]
        residual = np.vstack([self.r[:k, k:] - self.r[:k, :k] @ theta, self.r[k:, k:]])
        noise = residual.T @ residual / max(self.rows - k, 1)
        gram = inverse @ inverse.T / np.outer(scale, scale)
        ratio = float(singular[0] / singular[-1]) if singular[-1] > 0 else np.inf
        return RegressionEstimate(theta, np.kron(noise, gram), noise, ratio, ratio)


@dataclass(frozen=True, eq=False)
class RegressionEstimate:
    """Estimate of Y ≈ X Θ.

    Attributes
    ----------
    theta : (columns, outputs) array
    covariance : (columns·outputs, columns·outputs) array
        Of the parameters output by output.
    noise : (outputs, outputs) array
        Covariance of the equation error.
    condition, scaled_condition : float
        2-norm condition number of X, as it is and with unit columns.
    """

    theta: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    condition: float
    scaled_condition: float


def factorize(records: Sequence[Record], data: RegressionData) -> Factor:
    """Fold every record's regressor rows into one R; rows of different records never mix.

    Parameters
    ----------
    records : sequence of Record
        Uniform, finite, of one rate, each longer than ``data.start``.
    data : RegressionData

    Returns
    -------
    Factor
    """
    from lpvid._kernels import ChunkedQR

    keep_for_reuse()
    qr = ChunkedQR(data.columns.size + len(data.outputs), CHUNK)
    with single_thread():
        for record in records:
            for rows in rows_of(record, data, qr.block):
                qr.absorb(rows)
    return Factor(qr.r, qr.rows_seen, data.columns.size)


def rows_of(record: Record, data: RegressionData, block: np.ndarray) -> Iterator[int]:
    """Write one record's rows of [X Y], chunk by chunk, into `block`; yields each chunk's rows.

    Parameters
    ----------
    record : Record
    data : RegressionData
    block : (columns + outputs, CHUNK) array
        C-ordered: the transpose of a Fortran-ordered workspace.

    Yields
    ------
    int
        Rows that stand in `block`.
    """
    p = _scheduling(record, data)
    for first in range(data.start, record.n_samples, SUPER_CHUNK):
        yield from _fill(record, data, p, first, min(first + SUPER_CHUNK, record.n_samples), block)


def _scheduling(record: Record, data: RegressionData) -> np.ndarray | None:
    """The filtered scheduling of a whole record (a filter has memory), or None where there is no filter."""
    if data.scheduling_stage is None:
        return None
    assert record.sample_time is not None
    return data.scheduling_stage.apply(record.matrix(data.scheduling), record.sample_time)


def _fill(record: Record, data: RegressionData, filtered: np.ndarray | None, first: int, last: int,
          block: np.ndarray) -> Iterator[int]:
    from lpvid._kernels import fill_regressor

    low = first - data.start
    high = min(last + max(-data.basis.lags[0], 0), record.n_samples)
    p = _stack(record, data.scheduling, low, high) if filtered is None else filtered[low:high]
    phi = np.ascontiguousarray(data.basis.evaluate(p)[: last - low].T)
    u = _stack(record, data.inputs, low, last)
    if data.stage is not None:
        u = data.stage.apply(u, p[: last - low])
    signals = np.vstack([*(record[n][low:last] for n in data.outputs), u.T, np.ones(last - low)])
    c = data.columns
    for offset in range(data.start, last - low, CHUNK):
        rows = min(CHUNK, last - low - offset)
        fill_regressor(block, 0, offset, rows, signals, phi, c.source, c.sign, c.lag, c.function, c.phi_lag)
        for i in range(len(data.outputs)):
            block[c.size + i, :rows] = signals[i, offset: offset + rows]
        if data.weight is not None:
            weight = np.sqrt(record[data.weight][low + offset: low + offset + rows])
            block[:, :rows] *= weight
        yield rows


def _stack(record: Record, names: Sequence[str], low: int, high: int) -> np.ndarray:
    return np.column_stack([record[n][low:high] for n in names]) if names else np.empty((high - low, 0))


def _apart(mixed: Sequence[str]) -> str:
    """What to do about parameters that depend on one another, from their names."""
    if all(name.startswith("c") for name in mixed):  # c_j(p(k−j)) are the same where p is constant in every record
        return "use a single affine term (affine=1, --affine-terms 1), or add records in which the scheduling moves"
    return "lower the orders or the degree, or add ridge"
