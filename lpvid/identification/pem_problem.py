"""The least-squares problem behind prediction-error estimates: residuals, and their exact Jacobian folded into R."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.identification.arx import ARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.pem_sweep import CHUNK, sweep_record
from lpvid.identification.regression import Columns
from lpvid.model.input_stage import InputStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import DIVERGED

STAGE_STEP = 1e-4
"""central difference of a stage's parameter, in units of its search scale."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where a search stands: shared parameters, and the unknown past of every record.

    Attributes
    ----------
    shared : (k,) array
        Parameters of A, B and the affine terms in the order of the layout; then of the noise model; then the free ones
        of the input stage and of the scheduling filter.
    past : tuple of (depth, n_outputs) arrays
        Per record: noise-free past outputs, or past innovations of an ARMAX model.
    """

    shared: np.ndarray
    past: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Prediction errors at a point, record by record, from sample ``head`` on (zero before), and the weighted cost.

    Attributes
    ----------
    errors : tuple of (n, n_outputs) arrays
        One per record, in the units of the outputs.
    plants : tuple of (n, n_outputs) arrays
        What the Jacobian needs of the run besides: the plant's output x, or A y − B u of an ARMAX model.
    cost : float
        Σ of the squared errors, each times the weight of its output.
    """

    errors: tuple[np.ndarray, ...]
    plants: tuple[np.ndarray, ...]
    cost: float


class PredictionErrorProblem:
    """Prediction errors of a structure on records, as a function of a `Point`.

    Every kind of noise is one or two banded recursions. ``output`` and ``box-jenkins`` run A x = B u first, and
    ``box-jenkins`` C e = D (y − x) behind it; ``armax`` runs C e = A y − B u. The Jacobian ∂ŷ/∂θ satisfies the same
    recursions (equation sheet 5.8) and is never held for more than one chunk: [J e] is folded into a triangular factor.

    Parameters
    ----------
    records : sequence of Record
    structure : ARX
        With bound basis, and stages as objects.
    model : LPVTransferFunction
        Model of that structure (its values serve as a start).
    layout : ParameterLayout
    noise : NoiseModel
        Kind and orders.
    free_stages : (bool, bool)
        Whether the input stage and the scheduling filter join the search.
    estimate_past : bool
        False starts every run from measured samples, or from zero innovations.
    """

    def __init__(self, records: Sequence[Record], structure: ARX, model: LPVTransferFunction, layout: ParameterLayout,
                 noise: NoiseModel, free_stages: tuple[bool, bool], estimate_past: bool = True) -> None:
        self.structure, self.model, self.layout, self.noise = structure, model, layout, noise
        self.free_stages, self.estimate_past = free_stages, estimate_past
        self.n_outputs = model.n_outputs
        self.start = structure.start
        self.depth = min(noise.nc if noise.kind == "armax" else model.na, self.start)
        self.columns: Columns = structure._places(model.n_filter_inputs)[1]
        self.weights = np.ones(self.n_outputs)
        self._y = [np.ascontiguousarray(r.matrix(structure.output)) for r in records]
        self._u = [r.matrix(structure.input) for r in records]
        self._p = [r.matrix(model.box.names) for r in records]
        self._driven: tuple[bytes, list] | None = None
        self._scales = self._stage_scales()

    # -- parameters ----------------------------------------------------------------------------------------------
    def _stage_scales(self) -> list[np.ndarray]:
        box = self.model.box
        reach = float(box.half_width[0]) if box.names else 0.0
        stage, lag = self.model.input_stage, self.model.scheduling_stage
        return [stage.scales(reach) if self.free_stages[0] and stage is not None else np.zeros(0),
                lag.scales() if self.free_stages[1] and lag is not None else np.zeros(0)]

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Of the free stage parameters, in the order of the search."""
        found = []
        for stage, scales in zip((self.model.input_stage, self.model.scheduling_stage), self._scales, strict=True):
            known = () if stage is None else [k for k, v in stage.to_dict().items() if isinstance(v, float)]
            found += [name for name, scale in zip(known, scales, strict=False) if scale > 0]
        return tuple(found)

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Number of linear, noise and free stage parameters."""
        return self.layout.size, self.noise.vector.size, sum(int(np.sum(s > 0)) for s in self._scales)

    @property
    def counted(self) -> int:
        """Residuals in the cost, all outputs together."""
        head = self.depth if self.estimate_past else 0
        return sum((len(y) - self.start + head) * self.n_outputs for y in self._y)

    @property
    def n_past(self) -> int:
        """Initial conditions per record that are estimated."""
        return self.depth * self.n_outputs if self.estimate_past else 0

    def point(self, model: LPVTransferFunction) -> Point:
        """The point of a model, its noise included when of this kind; past outputs as measured, innovations zero.

        Parameters
        ----------
        model : LPVTransferFunction
            Of the problem's orders and layout.

        Returns
        -------
        Point
            With the free parameters of the stages.
        """
        noise = model.noise.vector if model.noise.kind == self.noise.kind else np.zeros(0)
        if noise.size != self.noise.vector.size:
            noise = np.zeros(self.noise.vector.size)
        own = (model.input_stage, model.scheduling_stage)
        stages = [v.vector[s > 0] for v, s in zip(own, self._scales, strict=True) if v is not None and s.size]
        rows = slice(self.start - self.depth, self.start)
        past = tuple(np.zeros((self.depth, self.n_outputs)) if self.noise.kind == "armax" else y[rows].copy()
                     for y in self._y)
        return Point(np.concatenate([self.layout.read(model), noise, *stages]), past)

    def model_at(self, shared: np.ndarray) -> LPVTransferFunction:
        """The model at these shared parameters.

        Parameters
        ----------
        shared : (k,) array
            In the order of a `Point`.

        Returns
        -------
        LPVTransferFunction
        """
        k, q, _ = self.sizes
        stage, lag = self._stages(shared[k + q:])
        noise = self.noise.with_vector(shared[k: k + q])
        return self.layout.fill(self.model, shared[:k]).replace(noise=noise, input_stage=stage, scheduling_stage=lag)

    def projected(self, shared: np.ndarray) -> np.ndarray:
        """`shared` with the stages' parameters brought into their admissible range.

        Parameters
        ----------
        shared : (k,) array
            In the order of a `Point`.

        Returns
        -------
        (k,) array
            `shared` itself where no stage is free.
        """
        k, q, s = self.sizes
        if not s:
            return shared
        values = [v.vector[w > 0] for v, w in zip(self._stages(shared[k + q:]), self._scales, strict=True)
                  if v is not None and w.size]
        return np.concatenate([shared[: k + q], *values])

    def _stages(self, free: np.ndarray) -> tuple[InputStage | None, SchedulingStage | None]:
        found: list[Any] = []
        for own, scales in zip((self.model.input_stage, self.model.scheduling_stage), self._scales, strict=True):
            moving = scales > 0
            if own is not None and moving.any():
                vector = own.vector.copy()
                vector[moving], free = free[: moving.sum()], free[moving.sum():]
                own = own.with_vector(vector)
            found.append(own)
        return found[0], found[1]

    # -- signals -------------------------------------------------------------------------------------------------
    def drive(self, model: LPVTransferFunction) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per record filter inputs (width, n) and basis functions (M, n); kept as long as the stages stay.

        Parameters
        ----------
        model : LPVTransferFunction
            Whose stages and basis apply.

        Returns
        -------
        list of ((width, n) array, (M, n) array)
        """
        stages = (model.input_stage, model.scheduling_stage)
        key = b"".join(s.vector.tobytes() for s in stages if s is not None)
        if self._driven is None or self._driven[0] != key:
            out = []
            for u, raw in zip(self._u, self._p, strict=True):
                p = raw if stages[1] is None else stages[1].apply(raw, model.sample_time)
                driven = u if stages[0] is None else stages[0].apply(u, p)
                out.append((np.ascontiguousarray(driven.T), np.ascontiguousarray(model.basis.evaluate(p).T)))
            self._driven = (key, out)
        return self._driven[1]

    def residuals(self, point: Point) -> PredictionErrors | None:
        """Prediction errors at a point, or None where a run diverges.

        Parameters
        ----------
        point : Point
            Parameters and pasts.

        Returns
        -------
        PredictionErrors or None
        """
        model = self.model_at(point.shared)
        errors, plants, cost = [], [], 0.0
        for y, past, (u, phi) in zip(self._y, point.past, self.drive(model), strict=True):
            found = self._record_errors(model, y, past, u, phi)
            if found is None:
                return None
            errors.append(found[0])
            plants.append(found[1])
            cost += float(np.sum((found[0][self.head:] * self.weights) ** 2))
        return PredictionErrors(tuple(errors), tuple(plants), cost) if np.isfinite(cost) else None

    @property
    def head(self) -> int:
        """First sample whose residual counts."""
        return self.start - (self.depth if self.estimate_past else 0)

    def _record_errors(self, model: LPVTransferFunction, y: np.ndarray, past: np.ndarray, u: np.ndarray,
                       phi: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Innovations e (n, ny), and what drives them: x, or the equation error of an ARMAX model."""
        from lpvid import _kernels, _noise

        noise, limit = model.noise, DIVERGED * max(float(np.abs(y).max()), 1e-300)
        assert noise.c is not None and noise.d is not None
        first = self.start - self.depth
        if noise.kind == "armax":
            v, e = self._equation_errors(model, y, u, phi), np.zeros_like(y)
            e[first: self.start] = past
            code = _noise.innovations(v, noise.c, noise.d, phi, model.lagged, self.start, limit, e)
            return None if code >= 0 else (e, v)
        x = np.zeros_like(y)
        x[first: self.start] = past
        used = np.flatnonzero(np.any(model.b != 0, axis=(1, 2, 3)))
        lag = int(used[0]) if used.size else model.n_lags
        if _kernels.free_run_io(model.a, model.b, model.c, lag, model.lagged, phi, 0, _checks.read_only(u), x,
                                self.start, len(y), limit) >= 0:
            return None
        v = y - x
        v[:first] = 0.0
        if noise.kind == "output":
            return v, x
        e = np.zeros_like(y)
        code = _noise.innovations(v, noise.c, noise.d, phi, model.lagged, first, limit, e)
        return None if code >= 0 else (e, x)

    def _equation_errors(self, model: LPVTransferFunction, y: np.ndarray, u: np.ndarray, phi: np.ndarray) -> np.ndarray:
        theta = self.layout.read(model).reshape(self.n_outputs, -1)
        signals = np.vstack([y.T, u, np.ones(len(y))])
        v = np.zeros_like(y)
        for first in range(self.start, len(y), CHUNK):
            rows = min(CHUNK, len(y) - first)
            v[first: first + rows] = y[first: first + rows] - (theta @ self._regressor(signals, phi, first, rows)).T
        return v

    def _regressor(self, signals: np.ndarray, phi: np.ndarray, first: int, rows: int) -> np.ndarray:
        from lpvid._kernels import fill_regressor

        c, block = self.columns, np.empty((self.columns.size, rows))
        fill_regressor(block, 0, first, rows, signals, phi, c.source, c.sign, c.lag, c.function, c.phi_lag)
        return block

    # -- Jacobian ------------------------------------------------------------------------------------------------
    def factors(self, point: Point, residuals: PredictionErrors) -> list[np.ndarray]:
        """Per record the triangular factor of [J_past  J_shared  e], weighted.

        Parameters
        ----------
        point : Point
            Parameters and pasts.
        residuals : PredictionErrors
            At that point.

        Returns
        -------
        list of (n_past + k + 1, n_past + k + 1) arrays
        """
        from lpvid._kernels import ChunkedQR

        out = []

        def fold(record: int) -> Callable:
            qr = ChunkedQR(self.n_past + sum(self.sizes) + 1, CHUNK)
            out.append(qr)

            def absorb(write: Callable[[np.ndarray, int], None], rows: int) -> None:
                for output in range(self.n_outputs):
                    write(qr.block, output)
                    qr.absorb(rows)

            return absorb

        self.sweep(point, residuals, fold)
        return [qr.r for qr in out]

    def sweep(self, point: Point, residuals: PredictionErrors, consumer: Callable[[int], Callable]) -> None:
        """Run through every record's Jacobian chunk by chunk.

        ``consumer(record)`` gives a function that is called as ``absorb(write, rows)`` for each chunk in turn;
        ``write(block, output)`` writes the weighted rows [J_past J_shared e] of one output, transposed.

        Parameters
        ----------
        point : Point
            Parameters and pasts.
        residuals : PredictionErrors
            At that point.
        consumer : callable
            As above; called once per record.
        """
        model = self.model_at(point.shared)
        slopes = self._stage_slopes(point)
        for i, (u, phi) in enumerate(self.drive(model)):
            sweep_record(self, model, (self._y[i], u, phi), (residuals.errors[i], residuals.plants[i]),
                         [s[i] for s in slopes], consumer(i))

    def _stage_slopes(self, point: Point) -> list[tuple[np.ndarray, ...]]:
        """∂ŷ/∂ψ of every free stage parameter by central differences of the runs, record by record."""
        k, q, s = self.sizes
        scales = np.concatenate([w[w > 0] for w in self._scales]) if s else np.zeros(0)
        zero = tuple(np.zeros_like(y) for y in self._y)
        out = []
        for j in range(s):
            ends = []
            for sign in (1, -1):
                moved = point.shared.copy()
                moved[k + q + j] += sign * STAGE_STEP * scales[j]
                moved = self.projected(moved)
                ends.append((moved[k + q + j], self.residuals(replace(point, shared=moved))))
            (high, up), (low, down) = ends
            out.append(zero if up is None or down is None or high == low else
                       tuple((b - a) / (high - low) for a, b in zip(up.errors, down.errors, strict=True)))
        return out
