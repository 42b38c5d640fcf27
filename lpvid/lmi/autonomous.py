"""The autonomous part of a model: which matrix A(p) drives which state, and how A depends on p."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Scheduling
from lpvid.scheduling.reading import Reading

Model = LPVTransferFunction | LPVStateSpace


@dataclass(frozen=True, eq=False)
class Autonomous:
    """x⁺ = A(p) x with A(p) = Σ_m coefficients[m] φ_m(p); the last coefficient belongs to the constant 1.

    The zero-input equation y(k) = −Σ a_i(p_k) y(k−i) has the state [y(k−1) … y(k−n)] and the companion matrix with the
    coefficients in its first block row; with a_i at p(k−i) the observer companion at p(k) is exact (Tóth, Abbas &
    Werner 2012). Each has its own products A(p_k) A(p_{k−1})…, so a statement about one is not one about the other.

    Parameters
    ----------
    coefficients : (M + 1, n, n) array
    basis : Basis
    readings : tuple of Reading
        The variables that A depends on; p at another delay counts as a further variable.
    sample_time : float or None
    digest : str
        sha256 of what the stability depends on.
    """

    coefficients: np.ndarray
    basis: Basis
    readings: tuple[Reading, ...]
    sample_time: float | None
    digest: str

    @property
    def order(self) -> int:
        """Number of states."""
        return self.coefficients.shape[1]

    def weights(self, points: np.ndarray) -> np.ndarray:
        """(K, M + 1) values of the basis, and 1, at `points` of shape (K, len(readings))."""
        return reading_weights(self.basis, self.readings, points)

    def matrices(self, points: np.ndarray) -> np.ndarray:
        """(K, n, n) A at `points` of shape (K, len(readings))."""
        return np.tensordot(self.weights(points), self.coefficients, axes=1)

    def magnitudes(self, points: np.ndarray) -> np.ndarray:
        """(K, n, n) Σ |coefficient| |φ|, which bounds the rounding errors of `matrices`."""
        return np.tensordot(np.abs(self.weights(points)), np.abs(self.coefficients), axes=1)


def reading_weights(basis: Basis, readings: tuple[Reading, ...], points: np.ndarray) -> np.ndarray:
    """(K, M + 1) values of a basis, and 1, where the readings have the values `points` of shape (K, len(readings))."""
    names = basis.names
    lags = [r.lag for r in readings]
    ahead, back = max([0, *(-lag for lag in lags)]), max([0, *lags])
    path = np.zeros((len(points), back + 1 + ahead, len(names)))
    for column, reading in enumerate(readings):
        if reading.name in names:
            path[:, back - reading.lag, names.index(reading.name)] = points[:, column]
    phi = basis.evaluate(path.reshape(len(points) * (back + 1 + ahead), len(names)))[back :: back + 1 + ahead]
    return np.hstack([phi, np.ones((len(points), 1))])


def autonomous(model: Model) -> Autonomous:
    """The autonomous part of a model; refuses a basis that is not piecewise polynomial."""
    if isinstance(model, LPVTransferFunction):
        na, ny, size = model.na, model.n_outputs, model.basis.size
        coefficients = np.zeros((size + 1, na * ny, na * ny))
        if na and model.lagged:
            coefficients[:size, :, :ny] = -model.a.transpose(3, 0, 1, 2).reshape(size, na * ny, ny)
            coefficients[size, : (na - 1) * ny, ny:] = np.eye((na - 1) * ny)
        elif na:
            coefficients[:size, :ny, :] = -model.a.transpose(3, 1, 0, 2).reshape(size, ny, na * ny)
            coefficients[size, ny:, : (na - 1) * ny] = np.eye((na - 1) * ny)
    elif isinstance(model, LPVStateSpace):
        coefficients = np.concatenate([model.A, np.zeros((1, model.order, model.order))])
    else:
        raise InputError("a stability certificate needs an LPV transfer function or state space",
                         got=type(model).__name__)
    found = readings_of(model.basis)
    if any(r.frequency for r in found):
        raise InputError("a stability certificate needs a basis of polynomials or splines", got=model.basis.labels,
                         mend="use lpvid.decay_rate or lpvid.l2_gain, which also cover trigonometric dependence")
    readings = tuple(r for r in found if r.degree)
    if model.sample_time is None and any(r.lag for r in readings):
        raise InputError("a continuous-time model reads p at a delay in samples", got=model.basis.labels)
    return Autonomous(coefficients, model.basis, readings, model.sample_time, _digest(model, coefficients))


def reading_box(system: Autonomous, scheduling: Scheduling) -> Scheduling:
    """Box and rate bounds of what is read, one entry for each reading; a delayed copy has those of its variable."""
    return box_of(system.readings, scheduling)


def box_of(readings: tuple[Reading, ...], scheduling: Scheduling) -> Scheduling:
    """As `reading_box`, for readings by themselves."""
    index = [scheduling.names.index(r.name) for r in readings]
    return Scheduling(tuple(r.label for r in readings), tuple(scheduling.lower[i] for i in index),
                      tuple(scheduling.upper[i] for i in index), tuple(scheduling.rate[i] for i in index),
                      tuple(scheduling.units[i] for i in index))


def _digest(model: Model, coefficients: np.ndarray) -> str:
    text = json.dumps([model.basis.to_dict(), model.sample_time, list(coefficients.shape)], sort_keys=True)
    return hashlib.sha256(text.encode() + np.ascontiguousarray(coefficients, dtype="<f8").tobytes()).hexdigest()


def readings_of(basis: Basis, shift: int = 0) -> tuple[Reading, ...]:
    """What a basis reads: each variable at each delay; refuses one that is neither piecewise polynomial nor Fourier."""
    return basis.readings(shift)
