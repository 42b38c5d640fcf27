"""Signals, auxiliary model and filtered instruments of a refined instrumental-variable estimate of one output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.identification.arma import ARMA, monic, reflected
from lpvid.identification.arx import ARX
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.regression import CHUNK
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import DIVERGED

PAST_SAMPLES = 200
"""samples, or 20 per output lag if that is more, that decide a record's noise-free past."""
FROZEN_POINTS = 300
"""points of the scheduling trajectories at which frozen poles are looked at."""
WHITE = ARMA(np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class AuxiliaryRun:
    """The auxiliary model's output along every record, and what the measurement adds to it.

    Attributes
    ----------
    model : LPVTransferFunction
    noise_free : tuple of (n,) arrays
        x̂, zero before its past.
    noise : tuple of (n,) arrays
        v̂ = y − x̂ from each record's start on, zero before.
    """

    model: LPVTransferFunction
    noise_free: tuple[np.ndarray, ...]
    noise: tuple[np.ndarray, ...]

    @property
    def cost(self) -> float:
        """Σ v̂²."""
        return float(sum(v @ v for v in self.noise))

    def innovations(self, noise: ARMA) -> tuple[np.ndarray, ...]:
        """ε = (D/C) v̂, record by record.

        Parameters
        ----------
        noise : ARMA
            Model C/D of v̂; of order 0 for white noise.

        Returns
        -------
        tuple of (n,) arrays
            v̂ itself for white noise.
        """
        return tuple(noise.whiten(v) for v in self.noise) if noise.c.size + noise.d.size else self.noise


class IVProblem:
    """The instrumental-variable equations of one output.

    Parameters
    ----------
    records : sequence of Record
    structure : ARX
        One output, bound basis, stages as objects.
    model : LPVTransferFunction
        A model of that structure.
    layout : ParameterLayout
    """

    def __init__(
        self, records: Sequence[Record], structure: ARX, model: LPVTransferFunction, layout: ParameterLayout
    ) -> None:
        self.model, self.layout, self.start = model, layout, structure.start
        self.columns = structure._places(model.n_filter_inputs)[1]
        self.size = layout.size
        self.y, self.u, self.phi = [], [], []
        for record in records:
            p = record.matrix(model.box.names)
            if model.scheduling_stage is not None:
                p = model.scheduling_stage.apply(p, model.sample_time)
            u = record.matrix(structure.input)
            u = u if model.input_stage is None else model.input_stage.apply(u, p)
            self.y.append(np.ascontiguousarray(record[structure.output[0]]))
            self.u.append(np.ascontiguousarray(u.T))
            self.phi.append(np.ascontiguousarray(model.basis.evaluate(p).T))
        self.rows = sum(len(y) - self.start for y in self.y)
        self.mean_phi = sum(phi.sum(axis=1) for phi in self.phi) / sum(phi.shape[1] for phi in self.phi)
        phi = np.hstack(self.phi)
        self.sample = np.ascontiguousarray(phi[:, :: max(1, phi.shape[1] // FROZEN_POINTS)])
        self.one = np.linalg.lstsq(phi @ phi.T, phi.sum(axis=1), rcond=1e-12)[0]
        """(M,) coefficients with which the basis makes the constant 1, as near as it can"""
        part = structure.places()[:, 0]
        self.n_output_columns = int(np.sum(part == 0))  # they stand first
        lti = np.flatnonzero((part == 0) & (self.columns.function == -1))
        self.lti = lti[np.argsort(self.columns.lag[lti])]
        """columns −y(k−i) of the time-invariant part, by lag; empty where the basis lacks the constant"""

    # -- auxiliary model -----------------------------------------------------------------------------------------
    def run(self, theta: np.ndarray) -> AuxiliaryRun | None:
        """The auxiliary model's free run, each record from the past that fits it best; None where it diverges.

        Parameters
        ----------
        theta : (k,) array
            Parameters of the auxiliary model in the order of the layout.

        Returns
        -------
        AuxiliaryRun or None
        """
        if not np.isfinite(theta).all():
            return None
        model = self.layout.fill(self.model, theta)
        out, noise = [], []
        for y, u, phi in zip(self.y, self.u, self.phi, strict=True):
            x = self._noise_free(model, y, u, phi)
            if x is None:
                return None
            v = y - x
            v[: self.start] = 0.0
            out.append(x)
            noise.append(v)
        run = AuxiliaryRun(model, tuple(out), tuple(noise))
        return run if np.isfinite(run.cost) else None

    def _noise_free(self, model: LPVTransferFunction, y: np.ndarray, u: np.ndarray,
                    phi: np.ndarray) -> np.ndarray | None:
        from lpvid import _kernels

        assert model.c is not None
        u, start, na, n = _checks.read_only(u), self.start, model.na, len(y)
        limit = DIVERGED * max(float(np.abs(y).max()), 1e-300)
        x, length = np.zeros((n, 1)), min(n, start + max(20 * na, PAST_SAMPLES))
        used = np.flatnonzero(np.any(model.b != 0, axis=(1, 2, 3)))
        lag = int(used[0]) if used.size else model.n_lags
        if na:
            influence = []
            for i in range(na + 1):  # the last one is forced, from a zero past
                head = np.zeros((length, 1))
                if i < na:
                    head[start - na + i] = 1.0
                b, c, first, most = ((model.b, model.c, lag, limit) if i == na else
                                     (model.b[:0], model.c[:0], 0, DIVERGED))
                if _kernels.free_run_io(model.a, b, c, first, model.lagged, phi, 0, u, head, start, length, most) >= 0:
                    return None
                influence.append(head[start - na:, 0])
            forced = influence.pop()
            x[start - na: start, 0] = np.linalg.lstsq(np.column_stack(influence), y[start - na: length] - forced,
                                                      rcond=1e-10)[0]
        code = _kernels.free_run_io(model.a, model.b, model.c, lag, model.lagged, phi, 0, u, x, start, n, limit)
        return None if code >= 0 else x[:, 0]

    def frozen_radius(self, model: LPVTransferFunction) -> float:
        """Largest modulus of the model's frozen poles along the scheduling trajectories.

        Parameters
        ----------
        model : LPVTransferFunction
            Of one output.

        Returns
        -------
        float
            0 without output lags.
        """
        if not model.na:
            return 0.0
        a = np.tensordot(model.a[:, 0, 0, :], self.sample, axes=1).T
        companion = np.zeros((len(a), model.na, model.na))
        companion[:, :, 0] = -a
        companion[:, :-1, 1:] = np.eye(model.na - 1)
        return float(np.abs(np.linalg.eigvals(companion)).max())

    # -- instruments ---------------------------------------------------------------------------------------------
    def _constant_part(self, model: LPVTransferFunction) -> np.ndarray:
        """F − 1 of the prefilter: the coefficients a_i0 of the constant, or the data's mean a_i(p); kept stable."""
        if self.lti.size:
            tail = self.layout.read(model)[self.lti]
        else:
            tail = model.a[:, 0, 0, :] @ self.mean_phi
        return reflected(tail, 0.98)

    def factor(
        self, run: AuxiliaryRun, noise: ARMA, kind: str, others: Sequence[Sequence[np.ndarray]] = (),
        colour: ARMA = WHITE
    ) -> np.ndarray:
        """Triangular factor of [Z  W  ε] over all records: instruments, what is multiplied onto them, innovations.

        Z = Q ζ with Q = D/(C F). W depends on `kind`: "measured" gives −Q v̂(k−i), by which the regressor of Laurain et
        al. 2010 differs from the instrument; "exact" gives the true sensitivities (D/C) ∂x̂/∂θ; "coloured" the
        instruments Z through C/D of `colour`; "others" the filtered pasts of the other outputs, from their
        auxiliary models' outputs in `others`.

        Parameters
        ----------
        run : AuxiliaryRun
            Free run at the present parameters.
        noise : ARMA
            C and D.
        kind : {"measured", "exact", "coloured", "others"}
            What W is.
        others : sequence of sequences of (n,) arrays
            Per other output and record, for "others" alone.
        colour : ARMA
            Of the innovations, for "coloured" alone.

        Returns
        -------
        (k + w + 1, k + w + 1) array
            w the columns of W.
        """
        from lpvid._kernels import ChunkedQR

        more = {"measured": self.lti.size, "exact": self.size, "coloured": self.size,
                "others": len(others) * self.n_output_columns}[kind]
        qr = ChunkedQR(self.size + more + 1, CHUNK)
        for i, (x, v, e) in enumerate(zip(run.noise_free, run.noise, run.innovations(noise), strict=True)):
            fill = _Filler(self, run.model, noise, kind, more, colour)
            beside = [o[i] for o in others]
            for first in range(self.start, len(x), CHUNK):
                rows = min(CHUNK, len(x) - first)
                fill(qr.block, first, rows, (x, v, self.u[i], self.phi[i]), beside)
                qr.block[self.size + more, :rows] = e[first: first + rows]
                qr.absorb(rows)
        return qr.r

    def jacobian(self, factor: np.ndarray, kind: str) -> np.ndarray:
        """(k, k) QᵀΦ from a factor: minus the derivative of the equations Qᵀε = 0, Z = Q R.

        Parameters
        ----------
        factor : array
            Triangular factor of [Z  W  ε] from `factor`.
        kind : {"measured", "exact"}
            What W is in it.

        Returns
        -------
        (k, k) array
        """
        k = self.size
        if kind == "exact":
            return factor[:k, k: 2 * k]
        out = factor[:k, :k].copy()
        out[:, self.lti] += factor[:k, k: k + self.lti.size]
        return out


class _Filler:
    """Writes one record's chunks in turn; holds the filters' states between them."""

    def __init__(self, problem: IVProblem, model: LPVTransferFunction, noise: ARMA, kind: str, more: int,
                 colour: ARMA) -> None:
        self.problem, self.model, self.kind, self.more = problem, model, kind, more
        c, d = monic(noise.c, noise.c.size), monic(noise.d, noise.d.size)
        frozen, k = monic(problem._constant_part(model), model.na), problem.size
        double = kind in ("exact", "coloured")  # the second half has its own filter
        self.prefilter, self.colour = _padded(d, np.convolve(c, frozen)), _padded(d, c)
        if kind == "coloured":
            self.colour = _padded(monic(colour.c, colour.c.size), monic(colour.d, colour.d.size))
        self.state = np.zeros((k + (0 if double else more), self.prefilter[0].size - 1))
        self.colour_state = np.zeros((more if double else 0, self.colour[0].size - 1))
        self.past = np.zeros((more if double else 0, model.na))

    def __call__(self, block: np.ndarray, first: int, rows: int, signals: tuple, others: list) -> None:
        from lpvid._filter_kernels import rational_rows, varying_rows
        from lpvid._kernels import fill_regressor

        x, v, u, phi = signals
        problem, k, c = self.problem, self.problem.size, self.problem.columns
        window = slice(rows)

        def write(row: int, count: int, output: np.ndarray) -> None:
            reach = slice(first - problem.start, first + rows)
            data = np.vstack([output[None, reach], u[:, reach], np.ones((1, problem.start + rows))])
            fill_regressor(block[row: row + count], 0, problem.start, rows, data, phi[:, reach],
                           c.source[:count], c.sign, c.lag, c.function, c.phi_lag)

        write(0, k, x)
        if self.kind == "exact":
            block[k: 2 * k, window] = block[:k, window]
            varying_rows(self._back(phi, first, rows), block, k, 2 * k, 0, rows, self.past)
            rational_rows(*self.colour, block, k, 2 * k, 0, rows, self.colour_state)
        elif self.kind == "measured":
            for i in range(problem.lti.size):
                block[k + i, window] = -v[first - i - 1: first - i - 1 + rows]
        elif self.kind == "others":
            count = problem.n_output_columns
            for i, other in enumerate(others):
                write(k + count * i, count, other)
        rational_rows(*self.prefilter, block, 0, len(self.state), 0, rows, self.state)
        if self.kind == "coloured":
            block[k: 2 * k, window] = block[:k, window]
            rational_rows(*self.colour, block, k, 2 * k, 0, rows, self.colour_state)

    def _back(self, phi: np.ndarray, first: int, rows: int) -> np.ndarray:
        a, lagged = self.model.a[:, 0, 0, :], self.model.lagged
        back = np.empty((len(a), rows))
        for i in range(len(a)):
            low = first - (i + 1 if lagged else 0)
            back[i] = a[i] @ phi[:, low: low + rows]
        return back


def _padded(numerator: np.ndarray, denominator: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    m = max(numerator.size, denominator.size)
    return np.pad(numerator, (0, m - numerator.size)), np.pad(denominator, (0, m - denominator.size))


