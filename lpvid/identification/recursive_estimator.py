"""The recursion itself, sample by sample or in blocks; its state can be saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError, TooFewSamples
from lpvid.identification.arx import ARX
from lpvid.identification.forgetting import CovarianceReset, VariableForgetting
from lpvid.identification.regression import Factor
from lpvid.identification.row_stream import RowStream
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.scheduling import Scheduling

CLEAR = 1e-7
"""smallest over largest singular value, with unit columns, at which the start hands over to the recursion."""
NOISE_FLOOR = 1e-6
"""of an output's rms: the least noise that variable forgetting assumes."""


class RecursiveSettings(Protocol):
    """What a recursion is set to; `Recursive` is one."""

    @property
    def structure(self) -> ARX:
        """Whose parameters are followed."""
        ...

    @property
    def forgetting(self) -> float | VariableForgetting:
        """Factor by which the past counts less with every sample."""
        ...

    @property
    def reset(self) -> CovarianceReset | None:
        """When the covariance is opened again."""
        ...

    @property
    def initial_covariance(self) -> float | None:
        """Of the parameters in unit-column scaling; None to begin with least squares."""
        ...

    @property
    def history(self) -> int:
        """Samples between stored parameters; 0 for none."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON.

        Returns
        -------
        dict
            By which the settings of a saved state are recognised.
        """
        ...


class RecursiveEstimator:
    """A recursive estimate at work: feed it samples, read its parameters, save it and go on later.

    Parameters
    ----------
    structure : RecursiveSettings
        E.g. a `Recursive`.
    box : Scheduling
        Range of the scheduling variables, to which the basis is normalised.
    sample_time : float
        Period [s].

    Examples
    --------
    >>> from lpvid.identification.arx import ARX
    >>> from lpvid.identification.recursive import Recursive
    >>> rng = np.random.default_rng(0)
    >>> running = RecursiveEstimator(Recursive(ARX(na=1, nb=1, input="u", output="y")), Scheduling((), (), ()), 0.01)
    >>> y = 0.0
    >>> for u in rng.normal(size=50):
    ...     _ = running.update([y], [u], [])
    ...     y = 0.5 * y + u
    >>> running.parameters.round(6)
    array([-0.5,  1. ])
    """

    def __init__(self, structure: RecursiveSettings, box: Scheduling, sample_time: float) -> None:
        self.structure, self.box = structure, box
        self.sample_time = _checks.positive(sample_time, "sample_time", "s")
        arx = structure.structure
        self.bound = replace(arx, basis=arx.basis.bound(box))
        self.stream = RowStream(self.bound, self.sample_time)
        if self.stream.ahead:
            raise InputError("a recursive estimate cannot read the scheduling ahead of time",
                             got=f"a basis that reads p {self.stream.ahead} samples ahead")
        k, ny = self.stream.size, self.stream.n_outputs
        self._theta, self._loss = np.full((k, ny), np.nan), np.zeros((ny, ny))
        self._upper, self._diagonal = np.eye(k), np.full(k, structure.initial_covariance or 0.0)
        self._square, self._tally, self._inverse_noise = np.zeros(k), np.zeros(7), np.ones(ny)
        self._settings = _settings(structure)
        self._ready = structure.initial_covariance is not None
        if self._ready:
            self._theta[:] = 0.0
        self._r, self._target = np.zeros((k + ny, k + ny)), 2 * k + ny
        self._trail: list[np.ndarray] = []

    # -- feeding -------------------------------------------------------------------------------------------------
    def update(self, y: Any, u: Any, p: Any, weight: Any = None) -> np.ndarray:
        """Take in one sample, or several in order.

        Parameters
        ----------
        y : (n_outputs,) or (n, n_outputs) array
        u : (n_inputs,) or (n, n_inputs) array
            Measured inputs, of the same times.
        p : (n_scheduling,) or (n, n_scheduling) array
        weight : (n,) array, optional
            Where the structure has weights.

        Returns
        -------
        (rows, n_outputs) array
            Error of the prediction made before each sample was known; NaN as long as there are no parameters. No rows
            while the past that the lags need is still filling.

        Raises
        ------
        InputError
            Different numbers of samples, or a negative weight.
        """
        widths = (self.stream.n_outputs, self.stream.n_inputs, len(self.box.names))
        arrays = [_samples(a, w, name) for a, w, name in zip((y, u, p), widths, ("y", "u", "p"), strict=True)]
        n = len(arrays[0])
        if any(len(a) != n for a in arrays[1:]):
            raise InputError("y, u and p must hold the same samples", got=", ".join(str(len(a)) for a in arrays))
        if self.bound.weight is not None:
            weight = _checks.shaped(np.atleast_1d(np.asarray(weight, dtype=float)), (n,), "weight")
            if not np.all(weight >= 0):
                raise InputError("weights must not be negative", got=float(weight.min()))
        return self._absorb(self.stream.push(arrays[0], arrays[1], arrays[2], weight))

    def follow(self, record: Record) -> None:
        """Take in a whole record, which does not continue what came before.

        Parameters
        ----------
        record : Record
            Uniform and finite, of the estimator's rate.
        """
        self.cut()
        self.go_on(record)

    def go_on(self, record: Record) -> None:
        """Take in a whole record, which continues what came before.

        Parameters
        ----------
        record : Record
            Uniform and finite, of the estimator's rate.
        """
        for rows in self.stream.blocks(record):
            self._absorb(rows)

    def cut(self) -> None:
        """What comes next does not continue what came before; the parameters stay."""
        self.stream.cut()

    def reset(self, to: float | None = None) -> None:
        """Open the covariance on demand: `to` in unit-column scaling, by default that of the structure's reset.

        Parameters
        ----------
        to : float, optional
            Variance of every parameter in unit-column scaling. As long as there are no parameters nothing is done.
        """
        from lpvid._filter_kernels import reset_covariance

        usual = self.structure.reset or CovarianceReset()
        if self._ready:
            reset_covariance(self._upper, self._diagonal, self._square,
                             _checks.positive(usual.to if to is None else to, "the variance after a reset"))
            self._tally[3] += 1
            self._tally[5:] = 0.0

    def _absorb(self, rows: np.ndarray) -> np.ndarray:
        """Rows (k + ny, n) into the estimate; a priori errors (n, ny)."""
        from lpvid._filter_kernels import recursive_rows

        k, n, ny, stride = self.stream.size, rows.shape[1], self.stream.n_outputs, self.structure.history
        errors, done = np.full((ny, n), np.nan), 0
        while not self._ready and done < n:
            with single_thread():
                done += self._begin(rows[:, done:])
        if done < n:
            trail = np.zeros((n // stride + 1 if stride else 0, k * ny))
            fresh, late = np.ascontiguousarray(rows[:, done:]), np.empty((ny, n - done))
            written = recursive_rows(fresh[:k], fresh[k:], self._upper, self._diagonal, self._theta, self._loss,
                                     self._tally, self._square, self._inverse_noise, self._settings, late,
                                     np.empty(n - done), trail, stride)
            self._trail += list(trail[:written])
            errors[:, done:] = late
        return errors.T

    # -- exact start ---------------------------------------------------------------------------------------------
    def _begin(self, rows: np.ndarray) -> int:
        """Fold rows into a triangular factor until it determines all parameters; how many were taken."""
        take = min(rows.shape[1], self._target - int(self._tally[2]))
        forgetting = 1.0 if isinstance(self.structure.forgetting, VariableForgetting) else self.structure.forgetting
        fade = np.sqrt(forgetting) ** np.arange(take - 1, -1, -1)
        stacked = np.vstack([self._r * np.sqrt(forgetting) ** take, (rows[:, :take] * fade).T])
        self._r = np.asarray(np.linalg.qr(stacked, mode="r"))
        before, stride = int(self._tally[2]), self.structure.history
        self._tally[0] = forgetting**take * self._tally[0] + float(np.sum(fade**2))
        self._tally[1] = forgetting ** (2 * take) * self._tally[1] + float(np.sum(fade**4))
        self._tally[2] += take
        if stride:
            self._trail += [np.full(self._theta.size, np.nan)] * ((before + take) // stride - before // stride)
        if self._tally[2] >= self._target:
            k = self.stream.size
            scale = np.linalg.norm(self._r[:k, :k], axis=0)
            if np.all(scale > 0):
                singular = np.linalg.svd(self._r[:k, :k] / scale, compute_uv=False)
                if singular[-1] > CLEAR * singular[0]:
                    self._hand_over()
            self._target += k
        return take

    def _hand_over(self) -> None:
        """From the triangular factor to P = R⁻¹R⁻ᵀ = U D Uᵀ, whose U and D stand in R⁻¹ as they are."""
        from scipy.linalg import solve_triangular

        k = self.stream.size
        r11, r12, r22 = self._r[:k, :k], self._r[:k, k:], self._r[k:, k:]
        inverse = solve_triangular(r11, np.eye(k))
        self._diagonal = np.diag(inverse) ** 2
        self._upper = np.ascontiguousarray((inverse / np.diag(inverse)).T)
        self._theta = np.ascontiguousarray(solve_triangular(r11, r12))
        self._loss = np.ascontiguousarray(r22.T @ r22)
        self._square = np.sum(r11**2, axis=0) / self._tally[0]
        power = (np.sum(r12**2, axis=0) + np.diag(self._loss)) / self._tally[0]
        noise = np.diag(self._loss) / max(self._tally[0] - k, 1.0)
        self._inverse_noise = 1 / np.maximum(np.maximum(noise, NOISE_FLOOR**2 * power), 1e-300)
        self._tally[4] = float(np.mean(noise * self._inverse_noise))
        self._ready = True

    # -- reading -------------------------------------------------------------------------------------------------
    @property
    def ready(self) -> bool:
        """True when there are parameters."""
        return self._ready

    @property
    def equations(self) -> int:
        """Equations absorbed."""
        return int(self._tally[2])

    @property
    def resets(self) -> int:
        """Covariance resets so far."""
        return int(self._tally[3])

    @property
    def parameters(self) -> np.ndarray:
        """(k,) parameters output by output, in the layout of the ARX structure; NaN before they are determined."""
        return self._theta.T.ravel()

    @property
    def noise(self) -> np.ndarray:
        """(n_outputs, n_outputs) covariance of the equation error over the samples remembered."""
        effective = self._tally[0] - self.stream.size * self._tally[1] / max(self._tally[0], 1.0)
        return self._loss / max(effective, 1.0)

    @property
    def covariance(self) -> np.ndarray:
        """(k, k) covariance of the parameters for white equation error: σ² P Σw²/Σw, with w the fading weights."""
        k = self.stream.size
        if not self._ready:
            return np.full((k * self.stream.n_outputs,) * 2, np.nan)
        spread = (self._upper.T * self._diagonal) @ self._upper
        return np.kron(self.noise, spread) * self._tally[1] / max(self._tally[0], 1.0)

    @property
    def model(self) -> LPVTransferFunction:
        """The model at the present parameters."""
        if not self._ready:
            raise InputError("these samples do not determine the parameters yet", got=f"{self.equations} equations",
                             mend="feed more samples, or give initial_covariance")
        width = self.bound._filter_width()
        named = Record({n: Channel(np.zeros(2)) for n in self.bound.channels}, sample_time=self.sample_time)
        empty = self.bound._empty_model(named, self.box, width)
        return self.bound.layout(width).fill(empty, self.parameters).replace(noise_covariance=self.noise)

    @property
    def conditions(self) -> tuple[float, float]:
        """Condition number of the regressors remembered, as they are and with unit columns."""
        factor = np.linalg.inv(self._upper.T * np.sqrt(self._diagonal))
        return float(np.linalg.cond(factor)), float(np.linalg.cond(factor / np.linalg.norm(factor, axis=0)))

    @property
    def trail(self) -> np.ndarray:
        """(m, k) parameters kept along the way, after every `history` equations."""
        return np.array(self._trail).reshape(-1, self._theta.size)

    def settle(self) -> None:
        """Take the parameters from few or badly conditioned samples too; refused where these cannot separate them.

        Raises
        ------
        InputError
            No more equations than parameters per output, or regressors that are linearly dependent.
        """
        if self._ready:
            return
        k = self.stream.size
        if self.equations <= k:
            raise TooFewSamples(f"{self.equations} equations cannot determine {k} parameters per output",
                                mend="give longer records, or lower the orders or the degree")
        named = Record({n: Channel(np.zeros(2)) for n in self.bound.channels}, sample_time=self.sample_time)
        width = self.bound._filter_width()
        names = self.bound.layout(width).names(self.bound._empty_model(named, self.box, width))
        Factor(self._r, self.equations, k).solve(0.0, [n.split(":")[-1] for n in names[:k]])
        self._hand_over()

    # -- saving --------------------------------------------------------------------------------------------------
    def state(self) -> dict:
        """Plain data for JSON, from which `restore` goes on as if nothing had happened.

        Returns
        -------
        dict
            With schema, structure, box, period and all arrays as lists.
        """
        arrays = {name: getattr(self, "_" + name).tolist() for name in _ARRAYS}
        return {"schema": "lpvid/recursive-state/1", "structure": self.structure.to_dict(), "box": self.box.to_dict(),
                "sample_time": self.sample_time, "ready": self._ready, "target": self._target, **arrays,
                "trail": [t.tolist() for t in self._trail], "stream": self.stream.state()}

    @classmethod
    def restore(cls, structure: RecursiveSettings, state: Mapping) -> RecursiveEstimator:
        """An estimator of the same structure in a saved state.

        Parameters
        ----------
        structure : Recursive
            The one that the state was saved from.
        state : mapping
            From `state`.

        Returns
        -------
        RecursiveEstimator

        Raises
        ------
        InputError
            The state is of another structure.
        """
        if state.get("schema") != "lpvid/recursive-state/1" or state.get("structure") != structure.to_dict():
            raise InputError("this state belongs to another structure",
                             mend="restore it with the one it was saved from")
        out = cls(structure, Scheduling.from_dict(state["box"]), state["sample_time"])
        for name in _ARRAYS:
            like = getattr(out, "_" + name)
            setattr(out, "_" + name, np.array(state[name], dtype=float).reshape(like.shape))
        out._ready, out._target = bool(state["ready"]), int(state["target"])
        out._trail = [np.array(t) for t in state["trail"]]
        out.stream.restore(state["stream"])
        return out


_ARRAYS = ("theta", "loss", "upper", "diagonal", "square", "tally", "inverse_noise", "r")


def _settings(structure: RecursiveSettings) -> np.ndarray:
    f, reset = structure.forgetting, structure.reset
    bounds = (np.inf, 0.0, 1.0) if reset is None else (reset.above, reset.below, reset.to)
    if isinstance(f, VariableForgetting):
        return np.array([1.0, f.lowest, f.memory, 0.0, *bounds])
    return np.array([f, 1.0, 0.0, 0.0, *bounds])


def _samples(values: Any, width: int, name: str) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    array = array.reshape(1, -1) if array.ndim < 2 else array
    return _checks.finite(_checks.shaped(array, (None, width), name), name)
