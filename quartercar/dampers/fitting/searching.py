"""The search: many starts on shortened data, the best followed on all, the parameters judged at the optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.identification.covariance import estimate_covariance
from lpvid.toolkit import single_thread, triangular_factor
from lpvid.validation.residuals import EXACT, residual_of
from quartercar.dampers.drive import Drive
from quartercar.dampers.fitting.estimate import Estimate, Starts
from quartercar.dampers.fitting.fitted_law import FittedLaw
from quartercar.dampers.fitting.problem import DamperFitProblem, MovingFit, ProjectedFit, sized_parameters
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.fitting.solver import DamperSearchEnd, SearchCoordinates, search_law
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import Sizes

D = TypeVar("D", bound=FittedLaw)

AGREEING = 1e-4
"""relative difference of two costs that counts as none."""
ALIKE = 1e-3
"""costs of the short searches closer than this in relative terms belong to one minimum, which is polished once."""
COARSE, FINE = 1e-4, 1e-7
"""relative decrease of the cost at which a short search and its continuation end."""
PROMISING = 2.0
"""cost of a short search over the best up to which a start is followed further."""
SURE = 3.0
"""standard errors by which a start must be worse on shortened data to be left there (one in a thousand by chance)."""
SCATTER = 0.7
"""of scattered starts: of a logarithm, or relative to the value."""
SAME_POINT = 1e-3
"""parameters closer than this in relative terms are one start."""


def estimate_law(damper: FittedLaw, drives: Sequence[Drive], settings: FitSettings) -> Estimate:
    """Least free-run force residual over all drives.

    Parameters
    ----------
    damper : FittedLaw
        Structure; its own values are one of the starts.
    drives : sequence of Drive
        With the measured force.
    settings : FitSettings

    Returns
    -------
    Estimate
        The damper at the optimum, with covariance, parameters at bounds and directions that the data leave open.

    Raises
    ------
    InputError
        Fewer samples than parameters.
    NumericalError
        The free run diverges from every start.
    """
    sizes = Sizes.of(drives)
    damper = at_size(damper, sizes)
    problem = DamperFitProblem(damper, tuple(drives), sizes)
    if problem.measured.size <= len(damper.names):
        raise InputError(f"too few samples to fit {damper.name}",
                         got=f"{problem.measured.size} for {len(damper.names)} parameters", mend="a longer record")
    with single_thread():
        found, starts = search(problem, settings)
        theta = found.trial.theta
        held = at_bounds(problem.parameters, theta)
        jacobian = problem.jacobian(theta)
        left = residual_of(problem.measured, problem.measured + found.trial.residual)
        spread = estimate_covariance(jacobian, left, problem.lengths, ~held)
        open_, lost, condition = _identifiability(problem, theta, jacobian, spread.covariance, ~held)
    notes = [*spread.notes]
    if not found.converged:
        notes.append(f"the search stopped at its limit of {settings.evaluations} evaluations before it had settled")
    return Estimate(damper.with_vector(theta), spread.covariance,
                    tuple(n for n, h in zip(damper.names, held, strict=True) if h), open_, lost, tuple(notes),
                    starts if len(damper.linear) < len(damper.names) else None, condition)


def search(problem: DamperFitProblem, settings: FitSettings) -> tuple[DamperSearchEnd, Starts]:
    """The best of many starts, and how many agree on it.

    Parameters
    ----------
    problem : DamperFitProblem
        On all data.
    settings : FitSettings
        Number of starts, length of the short and the long searches, seed.

    Returns
    -------
    best : DamperSearchEnd
        Of least cost on all data.
    starts : Starts
        How many were tried, followed, and ended at that cost.

    Raises
    ------
    NumericalError
        The free run diverges from every start.
    """
    damper = problem.damper
    rng = np.random.default_rng(settings.seed)
    short = DamperFitProblem(damper, shortened(problem.drives, settings.short_samples), problem.sizes)
    given = [np.asarray(s, dtype=float) for s in damper.starts(problem.drives, settings.starts, rng)]
    starts = distinct([*given[: max(settings.starts - 1, 1)], damper.vector][: settings.starts])
    starts += _scattered(problem, starts, settings.starts // 2 - len(starts), rng)
    groups = [[ShortSearch(0.0, starts[0])]] if len(starts) == 1 else _alike(searched_short(short, starts, settings))
    followed = [g for g in groups[: settings.polished] if not surely_worse(g[0], groups[0][0])]
    polished = [(polish(problem, group[0].theta, settings), len(group)) for group in followed]
    ends = [(end, size) for end, size in polished if end is not None]
    if not ends:
        raise NumericalError(f"{damper.name}: the free run diverges from each of {len(starts)} starts; check units and "
                             "signs of the records")
    best = min((end for end, _ in ends), key=lambda e: e.trial.cost)
    least = best.trial.cost * (1 + AGREEING) + EXACT**2 * float(problem.measured @ problem.measured)
    agreed = sum(size for end, size in ends if end.trial.cost <= least)
    return best, Starts(len(starts), len(ends), agreed)


def at_size(damper: D, sizes: Sizes) -> D:
    """A law with the values that its data's sizes make typical in place of those that nobody has chosen.

    Parameters
    ----------
    damper : FittedLaw
    sizes : Sizes
        Of the data.

    Returns
    -------
    FittedLaw
        Values other than the typical ones stay.
    """
    found = zip(damper.parameters, sized_parameters(damper, sizes), damper.vector, strict=True)
    return damper.with_vector(np.array([sized.default if value == p.default else value for p, sized, value in found]))


def _scattered(problem: DamperFitProblem, starts: Sequence[np.ndarray], count: int,
               rng: np.random.Generator) -> list[np.ndarray]:
    """`count` further starts about the given ones: factors of about two where a parameter moves by its logarithm."""
    if len(problem.damper.linear) == len(problem.damper.names):
        return []
    place = SearchCoordinates(problem.parameters)
    default = np.array([abs(p.default) for p in problem.parameters])
    out = []
    for k in range(max(count, 0)):
        theta = starts[k % len(starts)]
        spread = np.where(place.log, SCATTER, SCATTER * np.maximum(np.abs(theta), default))
        out.append(place.values(place.of(theta) + spread * rng.normal(size=theta.size)))
    return out


@dataclass(frozen=True, eq=False)
class ShortSearch:
    """A start after a few steps on shortened data.

    Attributes
    ----------
    cost : float
    theta : (P,) array
    residual : (m,) array or None
        None where nothing was run.
    """

    cost: float
    theta: np.ndarray
    residual: np.ndarray | None = None


def surely_worse(one: ShortSearch, best: ShortSearch) -> bool:
    """Whether the residual of one start is larger than the best one's by more than its own scatter can explain.

    A race: the mean of the paired differences of squared residuals lies `SURE` standard errors above zero. The standard
    error is that of batch means over √m samples, which holds for correlated residuals too. Maron & Moore (1994),
    NIPS 6, 59-66; Flegal & Jones (2010), Ann. Statist. 38(2), 1034-1070.

    Parameters
    ----------
    one, best : ShortSearch
        On the same shortened data.

    Returns
    -------
    bool
    """
    if one.residual is None or best.residual is None or one is best:
        return False
    difference = one.residual**2 - best.residual**2
    length = int(np.sqrt(difference.size))
    means = difference[: difference.size // length * length].reshape(-1, length).mean(axis=1)
    return float(means.mean()) > SURE * float(means.std(ddof=1)) / np.sqrt(means.size)


def searched_short(problem: DamperFitProblem, starts: Sequence[np.ndarray], settings: FitSettings) -> list[ShortSearch]:
    """Each start by rising cost, after a few steps on shortened data.

    Those near the best are followed three times as far, so that starts that share a minimum have nearly one cost. Those
    that diverge are left out, unless all do.

    Parameters
    ----------
    problem : DamperFitProblem
        On shortened data.
    starts : sequence of (P,) array
        Parameters, SI.
    settings : FitSettings
        ``short_evaluations`` is the length of a short search.

    Returns
    -------
    list of ShortSearch
        Never empty; where all diverge, every start at infinite cost.
    """
    view = ProjectedFit(problem) if problem.damper.linear else MovingFit(problem)
    ends = [search_law(view, view.start(s), settings.short_evaluations, COARSE) for s in starts]
    out = sorted((ShortSearch(e.trial.cost, e.trial.theta, e.trial.residual) for e in ends if e is not None),
                 key=lambda t: t.cost)
    for k, one in enumerate(out):
        if one.cost > PROMISING * out[0].cost:
            break
        end = search_law(view, view.start(one.theta), 3 * settings.short_evaluations, FINE)
        if end is not None:
            out[k] = ShortSearch(end.trial.cost, end.trial.theta, end.trial.residual)
    return sorted(out, key=lambda t: t.cost) or [ShortSearch(np.inf, s) for s in starts]


def _alike(ends: Sequence[ShortSearch]) -> list[list[ShortSearch]]:
    """Starts by rising cost of their short searches, those of nearly one cost together."""
    groups: list[list[ShortSearch]] = []
    for one in ends:
        if groups and one.cost <= groups[-1][0].cost * (1 + ALIKE):
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups


def polish(problem: DamperFitProblem, theta: np.ndarray, settings: FitSettings) -> DamperSearchEnd | None:
    """Variable projection on all data where the model is partly linear, then all parameters together.

    Parameters
    ----------
    problem : DamperFitProblem
        On all data.
    theta : (P,) array
        Where to start, SI.
    settings : FitSettings
        ``evaluations`` and ``tolerance`` of either search.

    Returns
    -------
    DamperSearchEnd or None
        None where the run diverges at the start.
    """
    if problem.damper.linear:
        view = ProjectedFit(problem)
        first = search_law(view, view.start(theta), settings.evaluations, settings.tolerance)
        if first is None:
            return None
        theta = first.trial.theta
    full = MovingFit(problem)
    return search_law(full, full.start(theta), settings.evaluations, settings.tolerance)


def distinct(vectors: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The vectors without those that nearly repeat an earlier one.

    Parameters
    ----------
    vectors : sequence of (P,) array
        Parameters, SI, the most important first.

    Returns
    -------
    list of (P,) array
        In the same order; one is left out where each parameter lies within `SAME_POINT` of an earlier one.
    """
    out: list[np.ndarray] = []
    for v in vectors:
        if not any(np.all(np.abs(v - o) <= SAME_POINT * np.maximum(np.abs(v), np.abs(o))) for o in out):
            out.append(v)
    return out


def shortened(drives: Sequence[Drive], samples: int) -> tuple[Drive, ...]:
    """A stretch of every drive, the one in which the force moves most of four, together about `samples` long.

    Parameters
    ----------
    drives : sequence of Drive
        With measured force.
    samples : int
        Wanted, over all drives.

    Returns
    -------
    tuple of Drive
        All of them, whole, where they hold no more than that; every nth where stretches would fall below 200 samples.
    """
    total = sum(d.n_samples for d in drives)
    if total <= samples:
        return tuple(drives)
    kept = list(drives) if len(drives) * 200 <= samples else list(drives[:: -(-len(drives) * 200 // samples)])
    share = samples // len(kept)
    out = []
    for d in kept:
        assert d.force is not None
        length = min(share, d.n_samples)
        first = max((int(p) for p in np.linspace(0, d.n_samples - length, 4)),
                    key=lambda p: float(d.force[p: p + length].std()))  # type: ignore[index]
        out.append(d.slice(first, first + length))
    return tuple(out)


def at_bounds(parameters: Sequence[Parameter], theta: np.ndarray) -> np.ndarray:
    """(P,) whether a parameter rests on one of its bounds.

    Parameters
    ----------
    parameters : sequence of Parameter
        Give the bounds.
    theta : (P,) array
        Parameters, SI.

    Returns
    -------
    (P,) array of bool
        True too beyond a bound.
    """
    lower = np.array([p.lower for p in parameters])
    upper = np.array([p.upper for p in parameters])
    return (theta <= lower) | (theta >= upper)


OPEN = 0.5
"""relative standard error of a combination above which the data do not determine it."""
LIMITLESS = 100.0
"""relative standard error from which nothing is known: of an error so large a linear estimate gives no size."""
SINGULAR = 1e-7
"""share of the largest singular value below which a direction is open whatever the noise."""
NEGLIGIBLE = 0.05
"""share of the measured force that counts as a parameter's natural size where its value is near zero."""
NAMED = 0.3
"""share of a direction from which a parameter is named, up to three."""


def _identifiability(problem: DamperFitProblem, theta: np.ndarray, jacobian: np.ndarray, covariance: np.ndarray,
                     free: np.ndarray) -> tuple[tuple[str, ...], tuple[str, ...], float]:
    """Singular directions of the sensitivities to relative changes of the free parameters.

    A direction v of relative changes is open where √(vᵀ D⁻¹ C D⁻¹ v) > ½ with C the covariance and D the natural sizes,
    or where the sensitivities are singular to seven digits, so that no noise is needed to lose it.

    Parameters
    ----------
    problem : DamperFitProblem
    theta : (P,) array
    jacobian : (m, P) array
        At the optimum.
    covariance : (P, P) array
    free : (P,) bool array

    Returns
    -------
    undetermined : tuple of str
        A sentence for each open direction.
    unidentified : tuple of str
        Parameters without effect, or with a standard error of `LIMITLESS` times their natural size.
    condition : float
        Largest over smallest singular value of the scaled sensitivities.
    """
    parameters = problem.parameters
    names = [n for n, f in zip(problem.damper.names, free, strict=True) if f]
    if not names:
        return (), (), 1.0
    sizes = _natural_sizes(problem, theta, jacobian)[free]
    units = [p.unit for p, f in zip(parameters, free, strict=True) if f]
    of = ["" if size == abs(value) else f"{size:.3g} {unit}".strip()
          for size, value, unit in zip(sizes.tolist(), theta[free].tolist(), units, strict=True)]
    norms = np.linalg.norm(jacobian[:, free], axis=0) * sizes
    lost = ~(norms > SINGULAR * norms.max()) if norms.max() > 0 else np.ones(len(names), dtype=bool)
    out = [f"{n}: has no effect on these data" for n, gone in zip(names, lost, strict=True) if gone]
    kept = np.flatnonzero(~lost)
    if not kept.size:
        return tuple(out), tuple(names), float("inf")
    scaled = jacobian[:, np.flatnonzero(free)[kept]]
    scaled *= sizes[kept]
    scaled = triangular_factor(scaled)
    _, s, vt = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0).max(), full_matrices=False)
    relative = covariance[np.ix_(free, free)][np.ix_(kept, kept)] / np.outer(sizes[kept], sizes[kept])
    for k in range(s.size):
        error = float(np.sqrt(max(vt[k] @ relative @ vt[k], 0.0)))
        if error > OPEN or s[k] < SINGULAR * s[0]:
            out.append(_sentence([names[i] for i in kept], [of[i] for i in kept], vt[k], error,
                                 s[k] < SINGULAR * s[0]))
    condition = float(s[0] / s[-1]) if s[-1] > 0 else float("inf")
    lost[kept] = np.sqrt(np.maximum(np.diag(relative), 0.0)) >= LIMITLESS
    unidentified = tuple(n for n, gone in zip(names, lost, strict=True) if gone)
    return tuple(out), unidentified, float("inf") if len(kept) < len(names) else condition


def _natural_sizes(problem: DamperFitProblem, theta: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """(P,) what a change of 100 % is: the value, or where that is near zero, what moves the force by a twentieth."""
    effect = np.linalg.norm(jacobian, axis=0)
    small = np.where(effect > 0, NEGLIGIBLE * np.linalg.norm(problem.measured) / np.where(effect > 0, effect, 1.0), 0.0)
    log = np.array([p.log for p in problem.parameters])
    default = np.array([abs(p.default) or problem.sizes.factor(p.unit) for p in problem.parameters])
    sizes = np.where(log, np.abs(theta), np.maximum(np.abs(theta), small))
    return np.where(sizes > 0, sizes, default)


def _sentence(names: list[str], of: list[str], direction: np.ndarray, error: float, singular: bool) -> str:
    """What is open, in per cent of each parameter's value, or of the size in `of` where it has another."""
    order = np.argsort(-np.abs(direction))
    leading = [int(i) for i in order[:3] if abs(direction[i]) >= NAMED * abs(direction[order[0]])]
    limit = f"uncertain by {100 * error:.0f} %" if error < LIMITLESS else "without limit"
    known = "no bound to it" if singular else limit
    if len(leading) == 1:
        size = of[leading[0]]
        base = "" if not known.endswith("%") else f" of {size}, which moves the force by a twentieth" if size else \
            " of its value"
        return f"{names[leading[0]]}: not determined by these data ({known}{base})"
    sign = np.sign(direction[leading[0]])
    moves = ", ".join(f"{names[i]} {100 * sign * direction[i] / abs(direction[leading[0]]):+.0f} %"
                      + (f" of {of[i]}" if of[i] else "") for i in leading)
    return f"{' and '.join(names[i] for i in leading)}: not determined apart; moving {moves} together is {known}"
