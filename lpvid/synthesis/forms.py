"""One system in several forms: affine, polynomial, gridded, polytopic, linear fractional; each with its error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.certificate import tensor
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Product, Scheduling, Spline
from lpvid.synthesis._form_parts import (
    Conversion,
    Model,
    as_polynomial,
    knots,
    rebuilt,
    stated,
    values,
)
from lpvid.synthesis._horner import fractional
from lpvid.synthesis.design_grid import interpolating
from lpvid.synthesis.generalized_plant import refuse_offsets
from lpvid.synthesis.matrix_function import MatrixFunction, block

__all__ = ["Conversion", "from_lft", "multi_affine", "to_affine", "to_gridded", "to_lft", "to_polynomial",
           "to_polytopic"]


def to_polynomial(model: Model, degree: int) -> Conversion:
    """The system over monomials up to a total degree: exact where it is such a polynomial, else least squares.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
    degree : int
        1 gives the affine form.

    Returns
    -------
    Conversion
        The system over monomials, with its error.

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[-2.0]]], np.zeros((2, 1, 0)), np.zeros((2, 0, 1)), np.zeros((2, 0, 0)),
    ...                        Spline("p", 1, 1, (0.0, 1.0)), None, Scheduling(("p",), (0.0,), (1.0,)))
    >>> affine = to_polynomial(system, 1)
    >>> affine.model.A.ravel().round(12).tolist(), affine.error < 1e-14          # −1.5 − 0.5 (p − 0.5)/0.5
    ([-1.5, -0.5], True)
    """
    basis, box = Polynomial(model.box.names, _checks.count(degree, "degree")).bound(model.box), model.box
    known = as_polynomial(model) if isinstance(model, LPVStateSpace) else None
    if known is not None and known.basis.degree is not None and known.basis.degree <= basis.degree:
        return stated(model, rebuilt(known, model), "polynomial", exact=True)
    nodes = np.cos(np.pi * (2 * np.arange(degree + 4) + 1) / (2 * (degree + 4)))
    points = tensor([nodes] * len(box.names)) * box.half_width + box.centre
    matrices = values(model, points)
    fitted = np.linalg.lstsq(basis.evaluate(points), matrices.reshape(len(points), -1), rcond=None)[0]
    function = MatrixFunction(basis, fitted.reshape(basis.size, *matrices.shape[1:]))
    return stated(model, rebuilt(function, model), "polynomial")


def to_affine(model: Model) -> Conversion:
    """`to_polynomial` of degree 1.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
        What is converted.

    Returns
    -------
    Conversion
        The affine system, with its error.
    """
    return to_polynomial(model, 1)


def to_gridded(model: Model, points: int | Mapping[str, Sequence[float]] = 5) -> Conversion:
    """Linear interpolation between the points of a grid over the box, exact at them.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
    points : int or mapping of name to rising values
        Points of every variable; a number spreads that many evenly.

    Returns
    -------
    Conversion
        The table, with its error; exact for a system that is affine in every single variable.

    Notes
    -----
    Between points the error falls with the square of their distance h: h²/8 · max |∂²S/∂p²| for one variable.
    """
    return stated(model, _interpolated(model, _axes(model.box, points)), "gridded",
                   exact=multi_affine(model))


def to_polytopic(model: Model) -> Conversion:
    """Vertices of the box and interpolation weights: a grid of two points for every variable.

    The coefficients are the vertex systems, the basis gives their weights, which are positive and add up to 1.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
        Affine in every single scheduling variable.

    Returns
    -------
    Conversion
        Exact.

    Raises
    ------
    InputError
        A system that is not affine in every single variable is no convex combination of the corners of its box.

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[-2.0]]], np.zeros((2, 1, 0)), np.zeros((2, 0, 1)), np.zeros((2, 0, 0)),
    ...                        Polynomial("p", 1), None, Scheduling(("p",), (0.0,), (1.0,)))
    >>> corners = to_polytopic(system)
    >>> print(corners), corners.model.A.ravel().tolist(), corners.model.basis.evaluate(np.array([[0.25]])).tolist()
    polytopic, exact
    (None, [-1.0, -3.0], [[0.75, 0.25]])
    """
    if not multi_affine(model):
        raise InputError("the system is not affine in each of its scheduling variables",
                         got=repr(model), mend="take to_affine or to_gridded, with their error, or lift it first")
    return stated(model, _interpolated(model, _axes(model.box, 2)), "polytopic", exact=True)


def to_lft(system: LPVStateSpace) -> Conversion:
    """A polynomial system as a linear fractional form, exact and well posed, with few repetitions (rank factorised).

    Parameters
    ----------
    system : LPVStateSpace
        Over polynomials, without offsets.

    Returns
    -------
    Conversion
        Exact; its model is an `LFTModel`.

    Raises
    ------
    InputError
        A basis that is no polynomial, or affine terms.

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[0.0]], [[-2.0]]], np.zeros((3, 1, 0)), np.zeros((3, 0, 1)),
    ...                        np.zeros((3, 0, 0)), Polynomial("p", 2), None, Scheduling(("p",), (0.0,), (1.0,)))
    >>> form = to_lft(system)
    >>> form.model.repetitions, form.exact, round(float(form.model.frozen([0.5])[0][0, 0]), 12)
    ((2,), True, -1.5)
    """
    refuse_offsets(system, "a linear fractional form")
    function, box = as_polynomial(system), system.box
    if function is None:
        raise InputError("only a polynomial becomes a linear fractional form without error",
                         got=f"a basis of {', '.join(system.basis.labels)}",
                         mend="fit it with to_polynomial, or lift it: its functions then become the variables")
    assert isinstance(function.basis, Polynomial)
    k, repetitions = fractional(function.coefficients[..., :-1], function.basis.exponents)
    n, ny, nu, r = system.order, len(system.outputs), len(system.inputs), sum(repetitions)
    rows, columns = np.r_[0:n, n + ny : n + ny + r, n : n + ny], np.r_[0:n, n + nu : n + nu + r, n : n + nu]
    model = LFTModel(k[np.ix_(rows, columns)], n, box, repetitions, system.sample_time, system.inputs, system.outputs)
    return stated(system, model, "linear-fractional", exact=True)


def from_lft(model: LFTModel) -> Conversion:
    """The polynomial that a linear fractional form with nilpotent D_qp Δ stands for, exactly.

    Parameters
    ----------
    model : LFTModel
        With D_qp Δ nilpotent for every Δ.

    Returns
    -------
    Conversion
        Exact, over monomials.

    Raises
    ------
    InputError
        A rational form; `to_gridded` and `to_polynomial` take it with an error.
    """
    box = model.box
    linear = Polynomial(box.names, 1).bound(box)
    delta = np.zeros((linear.size, model.width, model.width))
    index = np.repeat(np.arange(len(box.names)), model.repetitions)
    for j, i in enumerate(index):
        delta[np.flatnonzero(linear.exponents[:, i])[0], j, j] = 1.0
    scheduled = MatrixFunction(linear, delta)
    n, r = model.order, model.width
    rows, columns = np.r_[0:n, n + r : model.matrix.shape[0]], np.r_[0:n, n + r : model.matrix.shape[1]]
    m, loop = model.matrix, model.part("q", "p")
    term = scheduled @ m[n : n + r, columns]
    total = MatrixFunction.constant(m[np.ix_(rows, columns)]) + m[rows, n : n + r] @ term
    floor = 1e-12 * max(1.0, float(np.abs(m).max(initial=0.0)))
    for _ in range(r + 1):
        term = (scheduled @ MatrixFunction(term.basis, loop @ term.coefficients)) if r else term
        size = float(np.abs(term.coefficients).max(initial=0.0))
        if size <= floor or not r:
            whole = total.trimmed()
            padded = block([[whole, np.zeros((whole.shape[0], 1))]])
            return stated(model, rebuilt(padded, model), "polynomial", exact=True)
        total = total + m[rows, n : n + r] @ term
    raise InputError("this linear fractional form is rational, not polynomial", got="D_qp Δ that is not nilpotent",
                     mend="use to_gridded or to_polynomial, which state their error")


def _axes(box: Scheduling, points: int | Mapping[str, Sequence[float]]) -> dict[str, np.ndarray]:
    axes = {}
    for name, low, high in zip(box.names, box.lower, box.upper, strict=True):
        if isinstance(points, Mapping):
            _checks.known_name(name, list(points), "axis of the grid")
            axis = np.asarray(points[name], dtype=float)
            if axis.ndim != 1 or len(axis) < 2 or np.any(np.diff(axis) <= 0):
                raise InputError(f"the grid of '{name}' needs at least two rising values", got=points[name])
            if axis[0] > low or axis[-1] < high:
                raise InputError(f"the grid of '{name}' does not reach the ends of its box", got=points[name],
                                 why=f"the box is [{low:g}, {high:g}]")
        elif high > low:
            axis = np.linspace(low, high, _checks.count(points, "points of a grid", at_least=2))
        else:
            axis = np.array([low, low + 1.0])
        axes[name] = axis
    return axes


def _interpolated(model: Model, axes: Mapping[str, np.ndarray]) -> LPVStateSpace:
    table = values(model, tensor(list(axes.values())))
    return rebuilt(MatrixFunction(interpolating(model.box, tuple(axes.values())), table), model)


def multi_affine(model: Model) -> bool:
    """Whether the system is affine in every single variable over its box.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
        What is looked at.

    Returns
    -------
    bool
        False for every linear fractional form, and for a basis that is neither polynomial nor table.
    """
    if isinstance(model, LFTModel):
        return False
    function = as_polynomial(model)
    if function is None:
        ends, box = knots(model), model.box
        return isinstance(model.basis, Spline | Product) and all(
            len(k) == 2 and k[0] <= low and k[1] >= high
            for k, low, high in zip((ends.get(n, ()) for n in box.names), box.lower, box.upper, strict=True))
    assert isinstance(function.basis, Polynomial)
    used = np.any(function.coefficients != 0, axis=(1, 2))
    return bool(function.basis.exponents[used].max(initial=0) <= 1)
