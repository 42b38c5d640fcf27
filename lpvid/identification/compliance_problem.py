"""Free-run errors of a compliance model and their exact sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.free_run_search import FreeRunProblem, Piece
from lpvid.model.compliance import ComplianceModel
from lpvid.record import Record

SMALLEST = 1e-8
"""smallest rise of the law from knot to knot, as a share of the output's spread."""


@dataclass(frozen=True, eq=False)
class ComplianceProblem(FreeRunProblem):
    """Free-run errors of a compliance over records, and their exact Jacobian.

    The parameter vector: for every element the log-rises (tied in pairs about zero in a symmetric law) and ln k_h, then
    the linear terms, then the filter's where that is fitted.

    Attributes
    ----------
    model : ComplianceModel
        Whose settings are kept; its values serve as a start.
    inputs : tuple of (n, n_inputs) arrays
        Per record, the speed in the first column [m/s].
    outputs : tuple of (n,) arrays
        Measured output of every record [N].
    scheduling : tuple of (n, n_scheduling) arrays
        As logged, before any filter.
    free_filter : bool
        Whether the parameters of the scheduling filter are fitted along.
    """

    model: ComplianceModel
    tie: np.ndarray
    """(M − 1,) place of each rise's parameter among those of its current level."""

    @classmethod
    def of(cls, records: Sequence[Record], model: ComplianceModel, free_filter: bool,
           asymmetric: bool) -> ComplianceProblem:
        """Read the records once.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        model : ComplianceModel
            Where the search starts.
        free_filter : bool
            Whether the model's scheduling filter is fitted along.
        asymmetric : bool
            Whether rebound and compression have laws of their own; otherwise rises are tied in pairs.

        Returns
        -------
        ComplianceProblem

        Raises
        ------
        InputError
            A symmetric law on knots that are not symmetric about zero.
        """
        rises = model.knots.size - 1
        tie = np.arange(rises)
        if not asymmetric:
            if not np.allclose(model.knots, -model.knots[::-1]):
                raise InputError("a symmetric law needs symmetric knots", got=model.knots.tolist())
            tie = np.abs(np.arange(rises) - (rises - 1) / 2).astype(int)
        return cls(model, *cls.columns(records, model), free_filter, tie)

    # -- parameters -----------------------------------------------------------------------------------------------
    @cached_property
    def spread(self) -> float:
        """Standard deviation of the output."""
        return float(np.std(np.concatenate(self.outputs)))

    @cached_property
    def widths(self) -> np.ndarray:
        """Knot spacing that belongs to every rise parameter."""
        out = np.zeros(self.tie.max() + 1)
        out[self.tie] = np.diff(self.model.knots)
        return out

    @cached_property
    def matrix(self) -> np.ndarray:
        """(model parameters, own parameters) selection of each model parameter."""
        from scipy.linalg import block_diag

        q, k = self.model.current.size, self.tie.max() + 1
        one = np.zeros((self.tie.size, k))
        one[np.arange(self.tie.size), self.tie] = 1.0
        element = block_diag(*[one] * q, 1.0)
        rest = np.eye(self.model.direct.size + self.model.side.size + 1 + self.filter_scales.size)
        return np.asarray(block_diag(*[element] * len(self.model.elements), rest))

    def start(self) -> np.ndarray:
        """Own parameters of the model.

        Returns
        -------
        (k,) array
            Of a symmetric law the mean of each pair of log-rises.
        """
        stage = self.model.scheduling_stage
        whole = np.concatenate([self.model.vector, stage.vector if self.filter_scales.size and stage else np.zeros(0)])
        select = self.matrix
        return select.T @ whole / select.sum(axis=0)

    def model_at(self, x: np.ndarray) -> ComplianceModel:
        """The model at a parameter vector; rises are kept above rounding and below overflow.

        Parameters
        ----------
        x : (k,) array
            Parameters in the order of the class.

        Returns
        -------
        ComplianceModel
        """
        whole = self.matrix @ x
        cut = whole.size - self.filter_scales.size
        vector = whole[:cut].copy()
        per = self.model.current.size * self.tie.size + 1
        low = np.full(len(self.model.elements) * per, np.log(SMALLEST * self.spread))
        high = low + 60
        low[per - 1:: per], high[per - 1:: per] = -60, 60  # stiffness, last of every element
        vector[: low.size] = np.clip(vector[: low.size], low, high)
        return self.with_filter(self.model.with_vector(vector), whole[cut:])

    # -- errors ---------------------------------------------------------------------------------------------------
    def along(self, place: int, x: np.ndarray, jacobian: bool) -> Iterator[Piece]:
        """Errors of the free run along one record and their Jacobian.

        Parameters
        ----------
        place : int
            Number of the record.
        x : (k,) array
            Parameters in the order of the class.
        jacobian : bool
            Whether the derivatives are wanted too.

        Yields
        ------
        (n,) array, (n, k) array or None
            Errors ŷ − y [N] from the model's first free sample on, and ∂ŷ/∂x; None where it was not wanted.
        """
        u, y, p = self.inputs[place], self.outputs[place], self.scheduling[place]
        model = self.model_at(x)
        if not jacobian:
            yield (self.run(model, u, p, y) - y)[model.start:], None
            return
        tied = self.tie.max() + 1 < self.tie.size
        run, slopes = _sensitivity(model, u, self.filtered(model, p), y)
        moved = self.filter_slopes(x, u, p, y, run)
        whole = np.column_stack([slopes, *moved])[model.start:] if moved else slopes[model.start:]
        yield (run - y)[model.start:], whole @ self.matrix if tied else whole

    def run(self, model: ComplianceModel, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
        return model.free_run(u, self.filtered(model, p), y[: model.start], np.inf)[0]

    def with_linear_terms(self, x: np.ndarray) -> np.ndarray:
        """The vector with its linear terms replaced by the best ones for the elements' forces (variable projection).

        Parameters
        ----------
        x : (k,) array
            Parameters in the order of the class.

        Returns
        -------
        (k,) array
            A copy; log-rises, stiffness and filter as in `x`.
        """
        model = self.model_at(x)
        count = model.direct.size + model.side.size + 1
        first = x.size - self.filter_scales.size - count
        gram, right = np.zeros((count, count)), np.zeros(count)
        for error, slopes in self.pieces(x, True):
            assert slopes is not None
            part = slopes[:, first: first + count]
            gram, right = gram + part.T @ part, right - part.T @ error
        out = x.copy()
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        move = np.linalg.lstsq(gram / np.outer(scale, scale), right / scale, rcond=1e-8)[0] / scale
        out[first: first + count] += move
        return out


def _sensitivity(model: ComplianceModel, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Free run from the measured start, (n,), and its exact Jacobian by the model's vector, (n, k)."""
    from lpvid._quasi_kernels import sensitivity_compliance

    v, phi, beside = model.arrays(u, p)
    parallel, begin, n = model.parallel(u), model.start - 1, len(v)
    q, m = model.current.size, model.knots.size
    forces, slopes = [], []
    for e in range(len(model.elements) - 1, -1, -1):
        element = model.elements[e]
        force, change = np.zeros(n), np.zeros((n, q * m + 2))
        at = 0 if e else begin
        if e:  # settles from its static law
            force[0] = _hat(v[0], model.knots) @ (phi[0] @ element.law)
            change[0, : q * m] = np.outer(phi[0], _hat(v[0], model.knots)).ravel()
        else:
            force[begin] = y[begin] - beside[begin] - (forces[0][begin] if forces else 0.0)
            change[begin, -1] = 1.0
        sensitivity_compliance(element.law, model.knots, model.gain(element), phi, v, at, model.substeps, force, change)
        forces.append(force)
        slopes.append(change)
    run = sum(forces) + beside
    run[: model.start] = y[: model.start]
    own, start_column = slopes[-1][:, :-1], slopes[-1][:, -1:]
    columns = [own @ _chain(model, 0)]
    if len(model.elements) > 1:
        second = slopes[0][:, :-1]
        columns.append((second - start_column * second[begin]) @ _chain(model, 1))
    columns.append(parallel - start_column * parallel[begin])
    out = np.hstack(columns)
    out[: model.start] = 0.0
    return run, out


def _chain(model: ComplianceModel, e: int) -> np.ndarray:
    """(q·m + 1, q·(m − 1) + 1) change of the law's nodes, and of ln k_h, with the log-rises and ln k_h."""
    law, zero, m = model.elements[e].law, model.zero, model.knots.size
    step = np.zeros((m, m - 1))
    for j in range(m - 1):
        if j >= zero:
            step[j + 1:, j] = 1.0
        else:
            step[: j + 1, j] = -1.0
    out = np.zeros((law.size + 1, law.shape[0] * (m - 1) + 1))
    for i, rises in enumerate(np.diff(law, axis=1)):
        out[i * m: (i + 1) * m, i * (m - 1): (i + 1) * (m - 1)] = step * rises
    out[-1, -1] = 1.0
    return out


def _hat(w: float, knots: np.ndarray) -> np.ndarray:
    """Weights of the knots at one speed, linear beyond the ends."""
    s = int(np.clip(np.searchsorted(knots, w, side="right") - 1, 0, knots.size - 2))
    out, part = np.zeros(knots.size), (w - knots[s]) / (knots[s + 1] - knots[s])
    out[s], out[s + 1] = 1 - part, part
    return out
