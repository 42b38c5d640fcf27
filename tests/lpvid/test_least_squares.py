"""The one nonlinear least-squares search: problems of Moré, Garbow and Hillstrom (1981), bounds, rules."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from lpvid.least_squares import (
    CONVERGED,
    INTERRUPTED,
    LIMIT,
    Factors,
    FunctionResiduals,
    GainRatio,
    Shares,
    StopRule,
    minimise_dense,
)

Vector = np.ndarray
BARD = np.array([0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39])
KOWALIK = np.array([[4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625],
                    [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]])


def _bard(x: Vector) -> Vector:
    u = np.arange(1.0, 16.0)
    return BARD - (x[0] + u / ((16 - u) * x[1] + np.minimum(u, 16 - u) * x[2]))


def _box(x: Vector) -> Vector:
    t = 0.1 * np.arange(1, 11)
    return np.exp(-t * x[0]) - np.exp(-t * x[1]) - x[2] * (np.exp(-t) - np.exp(-10 * t))


def _brown_dennis(x: Vector) -> Vector:
    t = np.arange(1, 21) / 5
    return (x[0] + t * x[1] - np.exp(t)) ** 2 + (x[2] + x[3] * np.sin(t) - np.cos(t)) ** 2


def _helical(x: Vector) -> Vector:
    turn = np.arctan(x[1] / x[0]) / (2 * np.pi) + (0.5 if x[0] < 0 else 0.0)
    return np.array([10 * (x[2] - 10 * turn), 10 * (np.hypot(x[0], x[1]) - 1), x[2]])


PROBLEMS: dict[str, tuple[Callable[[Vector], Vector], list[float], float]] = {
    "rosenbrock": (lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), [-1.2, 1.0], 0.0),
    "freudenstein-roth": (lambda x: np.array([-13 + x[0] + ((5 - x[1]) * x[1] - 2) * x[1],
                                              -29 + x[0] + ((x[1] + 1) * x[1] - 14) * x[1]]), [0.5, -2.0], 48.98425),
    "helical valley": (_helical, [-1.0, 0.0, 0.0], 0.0),
    "powell singular": (lambda x: np.array([x[0] + 10 * x[1], 5**0.5 * (x[2] - x[3]), (x[1] - 2 * x[2]) ** 2,
                                            10**0.5 * (x[0] - x[3]) ** 2]), [3.0, -1.0, 0.0, 1.0], 0.0),
    "bard": (_bard, [1.0, 1.0, 1.0], 8.214877e-3),
    "kowalik-osborne": (lambda x: KOWALIK[1] - x[0] * (KOWALIK[0] ** 2 + KOWALIK[0] * x[1])
                        / (KOWALIK[0] ** 2 + KOWALIK[0] * x[2] + x[3]), [0.25, 0.39, 0.415, 0.39], 3.075056e-4),
    "box": (_box, [0.0, 10.0, 20.0], 0.0),
    "jennrich-sampson": (lambda x: 2 + 2 * np.arange(1, 11) - np.exp(np.arange(1, 11) * x[0])
                         - np.exp(np.arange(1, 11) * x[1]), [0.3, 0.4], 124.3622),
    "brown-dennis": (_brown_dennis, [25.0, 5.0, -5.0, -1.0], 85822.20),
}
"""Residuals, standard start and least sum of squares as printed in ACM Trans. Math. Softw. 7(1), 17-41."""


def _residuals(f: Callable[[Vector], Vector]) -> FunctionResiduals:
    def slopes(x: Vector) -> Vector:
        steps = np.cbrt(np.finfo(float).eps) * np.maximum(np.abs(x), 1e-2)
        return np.column_stack([(f(x + h * e) - f(x - h * e)) / (2 * h)
                                for h, e in zip(steps, np.eye(x.size), strict=True)])

    return FunctionResiduals(f, slopes)


@pytest.mark.parametrize("rule", [GainRatio(), Factors(), Factors(down=8.0, up=6.0, good=0.7, poor=0.2)])
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.filterwarnings("ignore:overflow")
def test_reaches_the_published_minimum(name: str, rule: GainRatio | Factors) -> None:
    f, start, least = PROBLEMS[name]
    found = minimise_dense(_residuals(f), np.array(start), StopRule(1e-12, iterations=500), damping_rule=rule)
    assert found is not None
    first = float(f(np.array(start)) @ f(np.array(start)))
    assert found.cost == pytest.approx(least, rel=1e-6, abs=1e-9 * first)
    assert found.first_cost == pytest.approx(first)
    if least:
        gradient = found.linearised.factor.T @ found.linearised.right / found.linearised.scale
        assert np.abs(gradient).max() < 1e-4 * np.sqrt(least)


@pytest.mark.parametrize("low, high", [([-1.2, -10.0], [0.5, 10.0]), ([-50.0, -10.0], [50.0, 0.5]),
                                       ([1.5, -10.0], [3.0, 10.0])])
def test_rests_on_the_bounds_where_scipy_ends(low: list[float], high: list[float]) -> None:
    f = PROBLEMS["rosenbrock"][0]
    bounds = np.array(low), np.array(high)
    start = np.clip(np.array([-1.2, 1.0]), *bounds) + 0.0
    found = minimise_dense(_residuals(f), start, StopRule(1e-13), bounds)
    inside = np.clip(start, bounds[0] + 1e-3, bounds[1] - 1e-3)
    other = least_squares(f, inside, bounds=bounds, xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=5000)
    assert found is not None
    assert found.cost == pytest.approx(2 * other.cost, rel=1e-5)
    assert found.trial.point == pytest.approx(other.x, abs=1e-3)
    assert np.any((found.trial.point == bounds[0]) | (found.trial.point == bounds[1]))


def test_units_of_the_parameters_change_nothing() -> None:
    f, start, _ = PROBLEMS["kowalik-osborne"]
    units = np.array([1e-6, 1.0, 1e4, 1e-2])
    plain, scaled = (minimise_dense(_residuals(g), x, StopRule(1e-12)) for g, x in
                     ((f, np.array(start)), (lambda z: f(z * units), np.array(start) / units)))
    assert plain is not None and scaled is not None
    assert scaled.trial.point * units == pytest.approx(plain.trial.point, rel=1e-4)
    assert abs(scaled.evaluations - plain.evaluations) <= 2


@pytest.mark.seconds
def test_ends_for_the_stated_reason() -> None:
    f, start, _ = PROBLEMS["brown-dennis"]
    problem, x = _residuals(f), np.array(start)
    costs: list[float] = []

    def until_third(iteration: int, cost: float) -> bool:
        costs.append(cost)
        return iteration == 3

    ends = [minimise_dense(problem, x, StopRule()), minimise_dense(problem, x, StopRule(iterations=2)),
            minimise_dense(problem, x, StopRule(evaluations=4)),
            minimise_dense(problem, x, StopRule(), progress=until_third)]
    assert [(e.why, e.converged) for e in ends if e] == [(CONVERGED, True), (LIMIT, False), (LIMIT, False),
                                                         (INTERRUPTED, False)]
    assert ends[1] and ends[1].iterations == 2 and ends[2] and ends[2].evaluations == 4
    assert len(costs) == 3 and costs == sorted(costs, reverse=True)


def test_a_start_that_does_not_run_gives_none_and_a_trial_that_does_not_is_too_long() -> None:
    def log_ratio(x: Vector) -> Vector:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(x) - np.log(1e-3)

    problem = FunctionResiduals(log_ratio, lambda x: np.diag(1 / x))
    assert minimise_dense(problem, np.array([-1.0]), StopRule()) is None
    found = minimise_dense(problem, np.array([5.0]), StopRule())  # the undamped first step leads below zero
    assert found is not None and found.trial.point == pytest.approx([1e-3], rel=1e-6)
    assert found.evaluations > found.iterations + 1


def test_shares_are_gauss_newton_which_solves_a_linear_problem_in_one_step(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(20, 4)), rng.normal(size=20)
    problem = FunctionResiduals(lambda x: a @ x - b, lambda x: a)
    found = minimise_dense(problem, np.zeros(4), StopRule(iterations=1), damping_rule=Shares())
    assert found is not None
    assert found.trial.point == pytest.approx(np.linalg.lstsq(a, b, rcond=None)[0], rel=1e-10)
    f, start, least = PROBLEMS["bard"]
    found = minimise_dense(_residuals(f), np.array(start), StopRule(1e-12), damping_rule=Shares())
    assert found is not None and found.cost == pytest.approx(least, rel=1e-6)


def test_without_parameters_the_start_is_the_end() -> None:
    problem = FunctionResiduals(lambda x: np.ones(3), lambda x: np.zeros((3, 0)))
    found = minimise_dense(problem, np.zeros(0), StopRule())
    assert found is not None and found.converged and found.cost == 3.0 and not found.iterations


def test_derivatives_whose_squares_overflow_end_the_search_where_it_stands() -> None:
    """A simulation that grows has sensitivities of 1e200: no step is taken along them, and no warning leaves."""
    found = minimise_dense(FunctionResiduals(lambda x: np.array([x[0] - 1, x[1]]), lambda x: np.diag([1.0, 1e200])),
                           np.zeros(2), StopRule())
    assert found is not None and not found.iterations
    assert np.array_equal(found.trial.point, np.zeros(2))
