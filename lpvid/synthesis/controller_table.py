"""A controller formula written down as an LPV system, and what its closed loop does."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np

from lpvid.lmi.certificate import tensor
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Product, Scheduling, Spline
from lpvid.synthesis.controller_formula import FeedbackLaw
from lpvid.synthesis.design_grid import columns, interpolating
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop_at
from lpvid.synthesis.loop_check import gain_bounds
from lpvid.synthesis.plant_functions import named
from lpvid.synthesis.scaling import Matrices

RATE = "_rate"
"""What a scheduling variable's name gets appended for the variable that holds its derivative."""


def table(formula: FeedbackLaw, axes: tuple[np.ndarray, ...], polynomial: bool) -> LPVStateSpace:
    """The controller, exact at the grid of `axes` and linear in each variable between its points.

    With `polynomial` and two points for each variable the entries are polynomials of degree one in each variable.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p.
    axes : tuple of arrays
        Rising values of each scheduling variable.
    polynomial : bool
        Prefer polynomials to a table where both are the same.

    Returns
    -------
    LPVStateSpace
        Scheduled also on ``p_rate`` where the formula depends on rates.
    """
    points = tensor(axes)
    k, slopes = formula.at(points)
    box = formula.plant.plant.box
    if polynomial and all(len(a) <= 2 for a in axes):
        moving = tuple(n for n, low, high in zip(box.names, box.lower, box.upper, strict=True) if high > low)
        basis = Polynomial(moving, len(moving)).bound(box) if moving else Polynomial((), 0)
        once = basis.exponents.max(axis=1, initial=0) <= 1
        inverse = np.zeros((basis.size, len(points)))
        inverse[once] = np.linalg.inv(columns(box, basis, points)[:, once])
        return _written(formula, basis, inverse, k, slopes)
    return _written(formula, interpolating(box, axes), np.eye(len(points)), k, slopes)


def smooth(formula: FeedbackLaw, segments: int, linear: Mapping[str, np.ndarray]) -> LPVStateSpace:
    """The controller with cubic splines of so many segments of each variable, fitted by least squares.

    Along some variables it is linear between given values, at which it is fitted.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p; its box has width in some variable.
    segments : int
        Of every other variable with width; the fit takes three cells to each.
    linear : mapping of name to array
        Rising values of variables.

    Returns
    -------
    LPVStateSpace
        Near the formula, not equal to it: its bound must be checked.
    """
    box = formula.plant.plant.box
    knots = {n: linear.get(n, np.linspace(low, high, segments + 1))
             for n, (low, high) in box.limits.items() if high > low}
    basis: Basis = reduce(Product, (Spline(n, at.size - 1, 1 if n in linear else 3, tuple(at.tolist()))
                                    for n, at in knots.items()))
    points = dense(box, 3 * segments, linear)
    k, slopes = formula.at(points)
    return _written(formula, basis, np.linalg.pinv(columns(box, basis, points)), k, slopes)


def polynomial(formula: FeedbackLaw, degree: int, points: np.ndarray) -> LPVStateSpace:
    """The controller as a polynomial of a total degree, fitted by least squares.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p; it reads no rates.
    degree : int
    points : (N, n_scheduling) array
        At which it is fitted.

    Returns
    -------
    LPVStateSpace
        Near the formula, not equal to it: its bound must be checked.
    """
    box = formula.plant.plant.box
    basis = Polynomial(box.names, degree).bound(box)
    k, slopes = formula.at(points)
    return _written(formula, basis, np.linalg.pinv(columns(box, basis, points)), k, slopes)


def dense(box: Scheduling, cells: int, given: Mapping[str, np.ndarray] | None = None) -> np.ndarray:
    """(N, n_scheduling) tensor grid with so many cells along every variable that has width.

    Parameters
    ----------
    box : Scheduling
        Ranges of the variables.
    cells : int
        At least 1.
    given : mapping of name to array, optional
        Values of some variables, in place of those.

    Returns
    -------
    (N, n_scheduling) array
        In the units of the box; ends included.
    """
    return tensor(tuple(given[name] if given and name in given
                        else np.linspace(low, high, cells + 1) if high > low else np.array([low])
                        for name, low, high in zip(box.names, box.lower, box.upper, strict=True)))


def rated_box(box: Scheduling, moving: tuple[str, ...]) -> Scheduling:
    """The box with a further variable for the rate of each of `moving`.

    Parameters
    ----------
    box : Scheduling
        With rate bounds of the variables that move.
    moving : tuple of str
        Variables whose rate becomes a variable, named with `RATE` appended.

    Returns
    -------
    Scheduling
        Rates range over ± their bound [units/s]; no bound counts as 0.
    """
    limits = [box.rate[box.names.index(n)] or 0.0 for n in moving]
    units = [f"{box.units[box.names.index(n)] or '1'}/s" for n in moving]
    return Scheduling((*box.names, *(n + RATE for n in moving)), (*box.lower, *(-r for r in limits)),
                      (*box.upper, *limits), (*box.rate, *(None,) * len(moving)), (*box.units, *units))


def matrices_at(controller: LPVStateSpace, box: Scheduling, points: np.ndarray) -> Matrices:
    """(N, …) matrices of a controller at points over the variables of `box`.

    Parameters
    ----------
    controller : LPVStateSpace
        Scheduled on some of the box's variables.
    box : Scheduling
        Names the columns of the points.
    points : (N, n_scheduling) array
        Scheduling values.

    Returns
    -------
    (A, B, C, D), each (N, …)
        Frozen matrices.
    """
    return controller.at(points[:, [box.names.index(n) for n in controller.basis.names]])


def bounds_at(formula: FeedbackLaw, points: np.ndarray, controller: LPVStateSpace | None = None) -> np.ndarray:
    """(N,) bounds of the closed loop's gain at points, over all corners of the rates; infinite where there is none.

    With the controller as written down; left out, as the formula has it at every point.

    Parameters
    ----------
    formula : FeedbackLaw
        The controller for every p, with its storage function.
    points : (N, n_scheduling) array
        Scheduling values, in the plant's units.
    controller : LPVStateSpace, optional
        As `table` or `smooth` gives it.

    Returns
    -------
    (N,) array
        In the plant's units of performance per disturbance.
    """
    plant, v = formula.plant.plant, formula.storage(points)
    at, discrete = plant.at(points), plant.sample_time is not None
    exact = formula.at(points) if controller is None else None
    bound = np.zeros(len(points))
    for t, rate in enumerate(formula.variations.corners):
        if exact is not None:
            (a, b, c, d), slopes = exact
            k = (a + np.einsum("v,nvij->nij", rate, slopes) if slopes.shape[1] else a), b, c, d
        else:
            assert controller is not None
            k = _rated_matrices(formula, controller, points, rate)
        bound = np.maximum(bound, gain_bounds(close_loop_at(at, *k), v, t, discrete=discrete))
    return bound


def loop_at(plant: GeneralizedPlant, controller: LPVStateSpace, points: np.ndarray) -> Matrices:
    """The frozen closed loop w → z at points of the plant's box, rates of the scheduling at zero.

    Parameters
    ----------
    plant : GeneralizedPlant
        What is controlled.
    controller : LPVStateSpace
        May be scheduled on rates (``p_rate``) too.
    points : (N, n_scheduling) array
        Scheduling values, in the plant's units.

    Returns
    -------
    (A, B, C, D), each (N, …)
        Frozen matrices with [x; x_K].
    """
    extra = sum(n not in plant.box.names for n in controller.box.names)
    box = plant.box if not extra else rated_box(plant.box, tuple(
        n.removesuffix(RATE) for n in controller.box.names if n not in plant.box.names))
    still = np.hstack([points, np.zeros((len(points), extra))])
    return close_loop_at(plant.at(points), *matrices_at(controller, box, still))


def _rated_matrices(formula: FeedbackLaw, controller: LPVStateSpace, points: np.ndarray,
                    rate: np.ndarray) -> Matrices:
    box = formula.plant.plant.box
    if formula.variations.rated:
        box = rated_box(box, formula.variations.moving)
        points = np.hstack([points, np.broadcast_to(rate, (len(points), len(rate)))])
    return matrices_at(controller, box, points)


def _written(formula: FeedbackLaw, basis: Basis, inverse: np.ndarray, k: Matrices, slopes: np.ndarray
             ) -> LPVStateSpace:
    """The controller over a basis whose coefficients are `inverse` times values at points."""
    plant = formula.plant.plant
    a, b, c, d, slopes = (np.tensordot(inverse, m, axes=1) for m in (*k, slopes))
    box, k = plant.box, (a, b, c, d)
    if slopes.shape[1]:
        basis, k = with_rates(basis, k, slopes, formula.variations.moving)
        box = rated_box(box, formula.variations.moving)
    return LPVStateSpace(*k, basis, plant.sample_time, box.part(basis.names), inputs=named(plant, plant.measurements),
                         outputs=named(plant, plant.controls))


def with_rates(basis: Basis, k: Matrices, slopes: np.ndarray, moving: tuple[str, ...]) -> tuple[Basis, Matrices]:
    """A controller with A_K + Σ ṗ_i·slopes_i over a basis in p, as one over p and the variables ``p_rate``.

    Parameters
    ----------
    basis : Basis
    k : (A, B, C, D), each (M, …)
        Coefficients over the basis.
    slopes : (M, len(moving), n, n) array
    moving : tuple of str

    Returns
    -------
    tuple
        Basis and coefficients.
    """
    rates = Polynomial(tuple(n + RATE for n in moving), 1)

    def wide(m: np.ndarray, extra: np.ndarray | None = None) -> np.ndarray:
        full = np.zeros((len(m), 1 + len(moving), *m.shape[1:]))
        full[:, 0] = m
        if extra is not None:
            full[:, 1:] = extra
        return full.reshape(-1, *m.shape[1:])

    a, b, c, d = k
    return Product(basis, rates), (wide(a, slopes), wide(b), wide(c), wide(d))
