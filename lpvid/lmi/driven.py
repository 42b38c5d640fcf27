"""The linear part of a model, with its inputs and outputs or without: what a certificate is a statement about."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.readings import Reading, reading_weights
from lpvid.model.state_space import LPVStateSpace, Matrices
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Polynomial, Scheduling

Model = LPVTransferFunction | LPVStateSpace


@dataclass(frozen=True, eq=False)
class Driven:
    """x⁺ or ẋ = A(p) x + B(p) w, z = C(p) x + D(p) w, with [A B; C D](p) = Σ_m coefficients[m] φ_m(p).

    Parameters
    ----------
    coefficients : (M + 1, n + n_z, n + n_w) array
        The last one belongs to the constant 1.
    order : int
        n.
    basis : Basis
    readings : tuple of Reading
        The variables that the matrices, or a storage function, depend on; p at another delay counts as a further one.
    sample_time : float or None
    digest : str
        sha256 of what a gain depends on.
    inputs, outputs : tuple of str
        Names of w and z.
    sizes : (M + 1, n + n_z, n + n_w) array, optional
        What the rounding errors of the coefficients are shares of; left out, their absolute values.
    """

    coefficients: np.ndarray
    order: int
    basis: Basis
    readings: tuple[Reading, ...]
    sample_time: float | None
    digest: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sizes: np.ndarray | None = None

    def matrices(self, points: np.ndarray) -> Matrices:
        """A, B, C, D at `points` of shape (N, len(readings)), each (N, …).

        Parameters
        ----------
        points : (N, readings) array
            Value of each reading, in the variable's unit.

        Returns
        -------
        (A, B, C, D), each (N, …)
            Frozen matrices.
        """
        weights = reading_weights(self.basis, self.readings, points)
        return self._parts(np.tensordot(weights, self.coefficients, axes=1))

    def state_matrices(self, points: np.ndarray) -> np.ndarray:
        """A alone.

        Parameters
        ----------
        points : (N, readings) array

        Returns
        -------
        (N, n, n) array
        """
        return self.matrices(points)[0]

    def magnitudes(self, points: np.ndarray) -> Matrices:
        """Σ |coefficient| |φ|, or `sizes` in their place, which bounds the rounding errors of `matrices`.

        Parameters
        ----------
        points : (N, readings) array
            Value of each reading.

        Returns
        -------
        (A, B, C, D), each (N, …)
            Not negative.
        """
        weights = reading_weights(self.basis, self.readings, points)
        return self._parts(np.tensordot(np.abs(weights), self._sizes, axes=1))

    def ceilings(self, box: Scheduling) -> Matrices:
        """(1, …) entrywise bounds of |A|, |B|, |C|, |D| over the box, trigonometric functions over their period.

        Those of coefficients over other states, which are off by rounding, include what they may be off.

        Parameters
        ----------
        box : Scheduling
            Ranges of the readings, or of their variables.

        Returns
        -------
        (A, B, C, D), each (1, …)
            Not negative.
        """
        limits = box.limits
        for reading in self.readings:  # a delayed copy has the box of its variable
            limits.setdefault(reading.name, limits[reading.label])
        weights = np.append(basis_ceilings(self.basis, limits), 1.0)
        whole = np.abs(self.coefficients)
        if self.sizes is not None:
            whole = whole + 6 * self.order * np.finfo(float).eps * self.sizes
        return self._parts(np.tensordot(weights[None, :], whole, axes=1))

    @property
    def dual(self) -> Driven:
        """(Aᵀ, Cᵀ, Bᵀ, Dᵀ)."""
        return replace(self, coefficients=self.coefficients.swapaxes(1, 2), inputs=self.outputs, outputs=self.inputs,
                       sizes=None if self.sizes is None else self.sizes.swapaxes(1, 2))

    @property
    def affine(self) -> bool:
        """Affine in all readings together, none delayed: no monomial of higher degree, and no product, has a share."""
        basis = self.basis
        if not isinstance(basis, Polynomial) or any(r.lag for r in self.readings):
            return False
        return not self.coefficients[:-1][basis.exponents.sum(axis=1) > 1].any()

    @property
    def _sizes(self) -> np.ndarray:
        return np.abs(self.coefficients) if self.sizes is None else self.sizes

    def _parts(self, s: np.ndarray) -> Matrices:
        n = self.order
        return s[:, :n, :n], s[:, :n, n:], s[:, n:, :n], s[:, n:, n:]


def autonomous(model: Model) -> Driven:
    """The autonomous part x⁺ or ẋ = A(p) x of a model, without signals; a basis must be piecewise polynomial.

    The zero-input equation y(k) = −Σ a_i(p_k) y(k−i) has the state [y(k−1) … y(k−n)] and the companion matrix with the
    coefficients in its first block row; with a_i at p(k−i) the observer companion at p(k) is exact (Tóth, Abbas &
    Werner 2012). Each has its own products A(p_k) A(p_{k−1})…, so a statement about one is not one about the other.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Affine terms and inputs do not count.

    Returns
    -------
    Driven
        Without inputs and outputs.

    Raises
    ------
    InputError
        Another kind of model, a basis that is no piecewise polynomial, or a continuous-time model that reads p at a
        delay.
    """
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
    found = _read(model.basis, coefficients[:-1])
    if any(r.frequency for r in found):
        raise InputError("a stability certificate needs a basis of polynomials or splines", got=model.basis.labels,
                         mend="use lpvid.decay_rate or lpvid.l2_gain, which also cover trigonometric dependence")
    readings = tuple(r for r in found if r.degree)
    if model.sample_time is None and any(r.lag for r in readings):
        raise InputError("a continuous-time model reads p at a delay in samples", got=model.basis.labels)
    return Driven(coefficients, coefficients.shape[1], model.basis, readings, model.sample_time,
                  _digest(model, coefficients), (), ())


def _digest(model: Model, coefficients: np.ndarray, *more: int) -> str:
    text = json.dumps([model.basis.to_dict(), model.sample_time, *more, list(coefficients.shape)], sort_keys=True)
    return hashlib.sha256(text.encode() + np.ascontiguousarray(coefficients, dtype="<f8").tobytes()).hexdigest()


def driven(model: LPVStateSpace, also: tuple[str, ...] = ()) -> Driven:
    """The linear part of a model; `also` names scheduling variables to list although the matrices may not read them.

    Parameters
    ----------
    model : LPVStateSpace
        With named inputs and outputs.
    also : tuple of str
        Scheduling variables that a storage function may depend on.

    Returns
    -------
    Driven
        From the model's inputs (behind an input stage, where it has one) to its outputs.

    Raises
    ------
    InputError
        No state space, or a basis that is neither piecewise polynomial nor trigonometric.
    """
    if not isinstance(model, LPVStateSpace):
        raise InputError("a gain needs a state-space model with named inputs and outputs", got=type(model).__name__,
                         mend="make one with lpv.realize(model, form=\"augmented\")")
    whole = np.block([[model.A, model.B], [model.C, model.D]])
    stacked = np.concatenate([whole, np.zeros((1, *whole.shape[1:]))])
    found = tuple(r for r in _read(model.basis, whole) if r.degree or r.frequency)
    found += tuple(Reading(name, 0, 0) for name in also if name not in [r.label for r in found])
    if model.sample_time is None and any(r.lag for r in found):
        raise InputError("a continuous-time model reads p at a delay in samples", got=model.basis.labels)
    return Driven(stacked, model.order, model.basis, found, model.sample_time, _digest(model, stacked, model.order),
                  tuple(s.name for s in model.filter_inputs), tuple(s.name for s in model.outputs))


def _read(basis: Basis, coefficients: np.ndarray) -> tuple[Reading, ...]:
    """What a basis reads, with the degrees that its coefficients use: a loop bilinear in two variables is written down
    over all monomials of degree two, and Bernstein coefficients of degree two amplify rounding errors nine times."""
    found = basis.readings()
    if not isinstance(basis, Polynomial):
        return found
    used = basis.exponents[coefficients.any(axis=(1, 2))].max(axis=0, initial=0)
    return tuple(replace(r, degree=min(r.degree, max(int(e), 1))) for r, e in zip(found, used, strict=True))


def basis_ceilings(basis: Basis, limits: dict[str, tuple[float, float]]) -> np.ndarray:
    """(M,) bounds of |φ| over intervals of the variables; splines, sines and cosines count 1.

    Parameters
    ----------
    basis : Basis
        The functions φ.
    limits : dict of str to (float, float)
        Lowest and highest value of each variable.

    Returns
    -------
    (M,) array
        One for each function.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> basis_ceilings(Polynomial("p", degree=2), {"p": (-3.0, 2.0)}).tolist()
    [1.0, 3.0, 9.0]
    """
    return np.maximum(*np.abs(basis.ranges(limits)))
