"""relaxed_bound: a certified lower bound of the objective over the linear car, whatever the law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError
from quartercar.criteria.gradient import RideGradient
from quartercar.rides.clairvoyant import BestCurrents, CurrentSequenceProblem
from quartercar.vehicle.adjoint import AdjointCar, Coefficients, GradientRun

REACH = 2.0
"""of the largest |F − c ż_d| of the best run: how far the relaxed force may go. It is printed with the bound, which it
hardly moves: on 4 s of ISO C 1, 1.25, 2, 4 times certify .645, .641, .640, .639 of the passive car's objective"""


@dataclass(frozen=True)
class RelaxedBound(Encoded):
    """No force within a strip makes the objective of the linear car less than this.

    Attributes
    ----------
    value : float
        The certified bound.
    attained : float
        Objective of the best relaxed force found; the bound is tight for the relaxation where both agree.
    slope, reach : float
        c [N·s/m], E [N] of the strip |F − c ż_d| ≤ E.
    """

    value: float
    attained: float
    slope: float
    reach: float


def relaxed_bound(problem: CurrentSequenceProblem, best: BestCurrents, iterations: int = 150,
                  report_progress: Callable[[str], None] = lambda text: None) -> RelaxedBound:
    """Lower bound of J over the linear car by a convex relaxation: the force free in a strip about a line.

    ::

        minimise J(e)  over  |e| ≤ E at every stage of every step,   F = c ż_d + e, F less its rest

    The forces of a semi-active damper, a bow tie in the plane of ż_d and F, lie in such a strip for all speeds below
    some V (the convex hull of {c_min v ≤ F ≤ c_max v, |v| ≤ V} is |F − c v| ≤ (c_max − c_min) V/2, c the mean). That
    the damper can only brake is relaxed, as is the limit of the energy given. The linear car's signals are affine in
    e and the figures are norms of them, so J is convex, and from any point ê with the gradient g ::

        J(e) ≥ J(ê) + Σ_k min over |e_k| ≤ E of g_k (e_k − ê_k) = J(ê) − Σ_k (g_k ê_k + |g_k| E)

    which certifies the bound whether or not the search has converged (Frank, Wolfe 1956; Boyd, Vandenberghe 2004, 3.2).
    The best such value of the search is kept, never less than 0.

    Parameters
    ----------
    problem : CurrentSequenceProblem
        Over a linear car: no stops, no lift-off.
    best : BestCurrents
        What was found for that problem: c is the slope of its force over speed, E is `REACH` times the largest
        distance of its force from that line.
    iterations : int
        Of L-BFGS-B.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    RelaxedBound

    Raises
    ------
    InputError
        A car that is not linear.
    """
    from scipy.optimize import minimize

    car = problem.car
    if car.stops is not None or car.lift_off:
        raise InputError("a relaxed bound belongs to a car without stops and lift-off",
                         why="only there is the objective convex in the force")
    report_progress(f"{problem.road.name}, seed {problem.seed}: lower bound over the linear car")
    slope, reach = _strip(best)
    elevation = problem.road.profile(problem.sample_time, problem.seed)
    gradient = RideGradient(AdjointCar(car, elevation, problem.sample_time), problem.road.settle)
    shape, kept = gradient.car.shape, [0.0, np.inf]

    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        law = np.zeros((*shape, 8))
        law[..., 0], law[..., 1], law[..., 7] = reach * x.reshape(shape), slope, 1.0
        run = gradient.car.driven(Coefficients(law, np.zeros((shape[0], 0)), np.zeros((shape[0], 0, 3))))
        j, by = _convex(problem, gradient, run)
        g = reach * by.law[..., 0].ravel()
        kept[0] = max(kept[0], j - float(g @ x + np.abs(g).sum()))
        kept[1] = min(kept[1], j)
        return j, g

    start = np.zeros(shape[0] * shape[1])
    minimize(value, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * start.size,
             options={"maxiter": iterations, "maxcor": 30, "ftol": 0.0, "gtol": 0.0, "maxfun": 2 * iterations})
    return RelaxedBound(kept[0], kept[1], slope, reach)


def _convex(problem: CurrentSequenceProblem, gradient: RideGradient, run: GradientRun) -> tuple[float, Coefficients]:
    """J, without what limits the energy, and its gradient by the coefficients."""
    figures = gradient.of(run)
    j, weights = problem.weights(figures)
    return j, gradient.car.gradient_by_coefficients(run, *gradient.bars(figures, weights))


def _strip(best: BestCurrents) -> tuple[float, float]:
    """c, E about the force of a run."""
    v, force = best.run["suspension_velocity"], best.run["damper_force"] - best.run.car.preload
    slope = float(force @ v / (v @ v))
    return slope, REACH * float(np.abs(force - slope * v).max())

