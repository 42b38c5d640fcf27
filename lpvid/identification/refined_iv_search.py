"""The refined instrumental-variable iteration, damped where the plain one diverges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.identification.arma import ARMA, fit_arma, reflected
from lpvid.identification.covariance import pseudo_inverse
from lpvid.identification.refined_iv_problem import WHITE, AuxiliaryRun, IVProblem
from lpvid.least_squares import bounded_step, column_scale

HALVINGS = 10
DAMPINGS = (1e-7, 1e-5, 1e-3, 1e-1, 10.0)
"""of Levenberg's steps, relative to the sensitivities' own energy, tried where the plain step fails."""
IDLE = 8
"""damped iterations without gain after which the cost has its minimum, and the equations no root within reach."""
SLACK = 5.0
"""times k/N by which the cost may exceed its least: the root of the equations is not the minimum of the cost."""
ORDERS = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24)
"""orders of the autoregression that describes output-error residuals."""
SHRINK = 0.97
"""factor on the poles of a start that diverges, until it runs."""
NEGLIGIBLE = 1e-24
"""noise power, relative to the output's, below which there is no noise to model."""


@dataclass(frozen=True, eq=False)
class RefinedIvEnd:
    """Where the iteration ended.

    Attributes
    ----------
    theta : (k,) array
    run : AuxiliaryRun
    noise : ARMA
    innovations : tuple of (n,) arrays
    factor : (2k + 1, 2k + 1) array
        Of instruments, exact sensitivities and innovations.
    iterations : int
    change : float
        Last relative change of the parameters, in the scale of their regressors.
    converged : bool
    damped : int
        Iterations whose plain step had to be shortened or replaced.
    origin : str
        What it started from, when that was not the least-squares estimate itself.
    """

    theta: np.ndarray
    run: AuxiliaryRun
    noise: ARMA
    innovations: tuple[np.ndarray, ...]
    factor: np.ndarray
    iterations: int
    change: float
    converged: bool
    damped: int
    origin: str = ""


@dataclass(frozen=True, eq=False)
class _Point:
    theta: np.ndarray
    run: AuxiliaryRun
    radius: float


def search(problem: IVProblem, start: np.ndarray, orders: tuple[int, int] | None, iterations: int,
           tolerance: float) -> RefinedIvEnd | None:
    """Solve Σ ζ_f(θ) ε(θ) = 0 from `start`; None where no run from it stays bounded.

    Where `start` diverges its poles are drawn in; where the iteration from there does not converge, it is tried again
    from a start whose A does not depend on p, and the better end is kept.

    Parameters
    ----------
    problem : IVProblem
    start : (k,) array
    orders : (nc, nd) or None
        Orders of the noise model; None for white output noise.
    iterations : int
    tolerance : float

    Returns
    -------
    RefinedIvEnd or None
        Its ``origin`` states where the start is not the one given.
    """
    first, shrunk = _bounded_start(problem, start)
    found = None if first is None else _iterate(problem, first, orders, iterations, tolerance)
    if found is None or not found.converged or shrunk < 1:
        plain = _invariant_start(problem, start)
        other = None if plain is None else _iterate(problem, plain, orders, iterations, tolerance)
        if other is not None and (found is None or _cost(other.run, other.noise) < _cost(found.run, found.noise)):
            return replace(other, origin="from a start whose output coefficients do not depend on the scheduling")
    drawn = f"the least-squares start diverged and was drawn in by {shrunk:.2f}" if shrunk < 1 else ""
    return None if found is None else replace(found, origin=drawn)


def _iterate(problem: IVProblem, first: _Point, orders: tuple[int, int] | None, iterations: int,
             tolerance: float) -> RefinedIvEnd:
    """Refined steps from one bounded start.

    Each iteration is the step δ = (Σ ζ_f φ_fᵀ)⁻¹ Σ ζ_f ε of Laurain, Gilson, Tóth & Garnier 2010 (equation sheet 5.9),
    whose new estimate is θ + δ. It is halved once if the auxiliary model does not stay bounded or the whitened cost
    rises. Where that fails, or the changes no longer shrink, Newton's step on the same equations takes its place, with
    the exact sensitivities for φ_f; and where Levenberg's steps reach a clearly lower cost, the best of those.
    """
    point, noise, kinds = first, WHITE, ("measured", "exact")
    best, best_cost, first_cost = first, np.inf, first.run.cost
    count, damped, change, before, converged, idle = 0, 0, np.inf, np.inf, False, 0
    while count < iterations and not converged and idle < IDLE:
        noise = _noise(problem, point.run, orders, noise)
        cost = _cost(point.run, noise)
        idle = idle + 1 if kinds == ("exact",) and cost > (1 - 1e-5) * best_cost else 0
        if orders is not None or cost < best_cost:
            best, best_cost = point, cost
        ceiling = (1 + SLACK * problem.size / problem.rows) * best_cost
        moved, full, factor = _step(problem, point, noise, kinds, (ceiling, first_cost, best_cost))
        count += 1
        if moved is None:
            converged = _solved(problem, factor)
            break
        damped += not full
        change = _change(problem, factor, moved.theta, point.theta)
        if count > 5 and change > 0.7 * before:
            kinds = ("exact",)
        before, point = change, moved
        converged = change < tolerance or _solved(problem, factor)
    if not converged and _cost(best.run, noise) < _cost(point.run, noise):
        point = best
    noise = _noise(problem, point.run, orders, noise)
    return RefinedIvEnd(
        point.theta,
        point.run,
        noise,
        point.run.innovations(noise),
        problem.factor(point.run, noise, "exact"),
        count,
        change,
        converged,
        damped,
    )


def _step(problem: IVProblem, point: _Point, noise: ARMA, kinds: Sequence[str],
          limits: tuple[float, float, float]) -> tuple[_Point | None, bool, np.ndarray]:
    """A step that `limits` let pass, whether it was the plain one in full, and the factor it came from."""
    factor = np.zeros((0, 0))
    for kind in kinds:
        factor = problem.factor(point.run, noise, kind)
        if not np.isfinite(factor).all():
            break
        own = _solve(problem.jacobian(factor, kind), factor[: problem.size, -1])
        full = _tried(problem, point, own, noise, limits)
        if kind == "measured":
            if full is not None:
                return full, True, factor
            half = _tried(problem, point, 0.5 * own, noise, limits)
            if half is not None:
                return half, False, factor
            continue
        damped = [_tried(problem, point, step, noise, limits) for step in _levenberg(problem, factor)]
        found = [(_cost(t.run, noise), i, t) for i, t in enumerate(damped) if t is not None]
        least = min(found, default=None)
        if full is not None and (least is None or _cost(full.run, noise) <= limits[0] / limits[2] * least[0]):
            return full, False, factor
        if least is not None:
            return least[2], False, factor
        for length in 0.5 ** np.arange(1, HALVINGS + 1):
            short = _tried(problem, point, length * own, noise, limits)
            if short is not None:
                return short, False, factor
    return None, False, factor


def _tried(problem: IVProblem, point: _Point, step: np.ndarray, noise: ARMA, limits: Sequence[float]) -> _Point | None:
    """The point after a step, if its run stays bounded, below the ceiling and no worse than the start.

    A step on which a frozen pole leaves the unit circle, or moves further out, is refused: over the training data such
    a model may still fit.
    """
    theta = point.theta + step
    run = problem.run(theta)
    if run is None or run.cost > limits[1] or _cost(run, noise) > limits[0]:
        return None
    radius = problem.frozen_radius(run.model)
    return _Point(theta, run, radius) if radius <= max(1.0, point.radius * (1 + 1e-9)) else None


def _levenberg(problem: IVProblem, factor: np.ndarray) -> Iterator[np.ndarray]:
    """Levenberg's steps down the cost, from the exact sensitivities, ever shorter."""
    k = problem.size
    slope, error = factor[: 2 * k, k: 2 * k], factor[: 2 * k, -1]
    scale, wide = column_scale(slope), np.full(k, np.inf)
    for damping in DAMPINGS:
        yield bounded_step(slope, -error, damping, scale, -wide, wide)


def _change(problem: IVProblem, factor: np.ndarray, new: np.ndarray, old: np.ndarray) -> float:
    """Relative change of the parameters, each in the scale of its instrument."""
    scale = np.linalg.norm(factor[:, : problem.size], axis=0)
    return float(np.linalg.norm(scale * (new - old)) / max(float(np.linalg.norm(scale * new)), 1e-300))


def _noise(problem: IVProblem, run: AuxiliaryRun, orders: tuple[int, int] | None, before: ARMA) -> ARMA:
    if orders is None:
        return WHITE
    if run.cost <= NEGLIGIBLE * sum(float(y @ y) for y in problem.y):
        return ARMA(np.zeros(orders[0]), np.zeros(orders[1]))
    series = [v[problem.start:] for v in run.noise]
    return fit_arma(series, *orders, start=before if (before.c.size, before.d.size) == orders else None)


def _cost(run: AuxiliaryRun, noise: ARMA) -> float:
    return float(sum(e @ e for e in run.innovations(noise)))


def _bounded_start(problem: IVProblem, start: np.ndarray) -> tuple[_Point | None, float]:
    """The start itself, or with its poles drawn in (a_i γⁱ) until its run stays bounded; the best of three such."""
    part, lag = problem.layout.table[:, 0], problem.layout.table[:, 1]
    run = problem.run(start)
    if run is not None:
        return _point(problem, start, run), 1.0
    gamma, found = SHRINK, []
    while gamma > 0.3 and len(found) < 3:
        point = _refitted(problem, np.where(part == 0, start * gamma ** (lag + 1.0), start))
        if point is not None:
            found.append((point.run.cost, gamma, point))
        gamma *= SHRINK
    if not found:
        return None, 1.0
    _, gamma, best = min(found, key=lambda t: t[0])
    return best, gamma


def _invariant_start(problem: IVProblem, start: np.ndarray) -> _Point | None:
    """A at its mean over the data, kept stable; B and the affine terms fitted to its free run."""
    part, lag, _, _, function = problem.layout.table.T
    tail = reflected(problem.layout.fill(problem.model, start).a[:, 0, 0, :] @ problem.mean_phi, 0.95)
    own = part == 0
    theta = np.where(own, 0.0, start)
    theta[own] = tail[lag[own]] * problem.one[function[own]]
    return _refitted(problem, theta)


def _refitted(problem: IVProblem, theta: np.ndarray) -> _Point | None:
    """With this A, the B and affine terms whose free run is closest: the run is linear in them."""
    k, free = problem.size, np.flatnonzero(problem.layout.table[:, 0] != 0)
    run = problem.run(theta)
    if run is None:
        return None
    factor = problem.factor(run, WHITE, "exact")
    step = _solve(factor[: 2 * k, k + free], factor[: 2 * k, -1])
    moved = theta.copy()
    moved[free] += step
    fitted = problem.run(moved)
    if fitted is not None and fitted.cost < run.cost:
        return _point(problem, moved, fitted)
    return _point(problem, theta, run)


def _point(problem: IVProblem, theta: np.ndarray, run: AuxiliaryRun) -> _Point:
    return _Point(theta, run, problem.frozen_radius(run.model))


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0] = 1.0
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        return np.full(matrix.shape[1], np.nan)
    return np.linalg.lstsq(matrix / scale, right, rcond=1e-12)[0] / scale


def _solved(problem: IVProblem, factor: np.ndarray) -> bool:
    """True when the step that is left moves no parameter by a ten-thousandth of its standard error, or by rounding."""
    k = problem.size
    left, whole = float(factor[:k, -1] @ factor[:k, -1]), float(factor[:, -1] @ factor[:, -1])
    return left <= 1e-8 * whole / problem.rows or whole <= NEGLIGIBLE * sum(float(y @ y) for y in problem.y)


def covariance(problem: IVProblem, found: RefinedIvEnd) -> tuple[np.ndarray, float, ARMA]:
    """Covariance of the parameters, variance of the innovations, and the colour that the former allows for.

    G⁻¹ S G⁻ᵀ with G = Σ ζ_f ψᵀ of the exact sensitivities ψ = (D/C) ∂x̂/∂θ and S the covariance of Σ ζ_f ε (Söderström &
    Stoica 1989, section 8.2). For white ε it is σ² Σ ζ_f ζ_fᵀ; where A varies little ψ is ζ_f, and this is Laurain's
    σ² (Σ ζ_f ζ_fᵀ)⁻¹. Where an autoregression describes ε better (output error, or a noise model of too low an order),
    S = σ² Σ (H ζ_f)(H ζ_f)ᵀ with H that autoregression's filter: the instruments are independent of ε.

    Parameters
    ----------
    problem : IVProblem
    found : RefinedIvEnd

    Returns
    -------
    (k, k) array
        Covariance of the parameters.
    float
        Variance of the innovations [square of the output's unit].
    ARMA
        Of order 0 where white innovations suffice.
    """
    k, factor = problem.size, found.factor
    extra = found.noise.c.size + found.noise.d.size
    energy = float(sum(e @ e for e in found.innovations))
    variance = energy / max(problem.rows - k - extra, 1)
    root = pseudo_inverse(factor[:k, k: 2 * k])
    colour = _autoregression([e[problem.start:] for e in found.innovations])
    if not colour.d.size:
        return variance * root @ root.T, variance, colour
    driving = sum(float(w @ w) for w in (colour.whiten(e[problem.start:]) for e in found.innovations))
    coloured = problem.factor(found.run, found.noise, "coloured", colour=colour)
    root = root @ (coloured[: 2 * k, k: 2 * k] @ pseudo_inverse(coloured[:k, :k])).T
    return driving / max(problem.rows - k, 1) * root @ root.T, variance, colour


def _autoregression(series: Sequence[np.ndarray]) -> ARMA:
    """The autoregression of least BIC; of order 0 for a white series."""
    n = sum(len(v) for v in series)
    best, least = WHITE, np.inf
    for order in (o for o in ORDERS if o < n / 20):
        model = fit_arma(series, 0, order) if order else WHITE
        energy = sum(float(e @ e) for e in map(model.whiten, series))
        if not energy > 0:
            return WHITE
        score = n * np.log(energy) + order * np.log(n)
        if score < least:
            best, least = model, score
    return best


def conditions(factor: np.ndarray, k: int) -> tuple[float, float]:
    """Condition number of the instruments, as they are and with unit columns.

    Parameters
    ----------
    factor : array
        Triangular factor whose first k columns are the instruments'.
    k : int
        Number of parameters.

    Returns
    -------
    float, float
    """
    r = factor[:k, :k]
    scale = np.linalg.norm(r, axis=0)
    scale[scale == 0] = 1.0
    return float(np.linalg.cond(r)), float(np.linalg.cond(r / scale))


