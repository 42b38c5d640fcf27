"""The search: many starts tasted on shortened data, the best followed on all, the parameters judged at the optimum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.toolkit import single_thread
from lpvid.validation.residuals import EXACT, residual_of
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import LawDamper
from quartercar.dampers.fitting.coordinates import SearchCoordinates
from quartercar.dampers.fitting.covariance import covariance_of
from quartercar.dampers.fitting.estimate import Estimate, Starts
from quartercar.dampers.fitting.identifiability import identifiability
from quartercar.dampers.fitting.problem import DamperFitProblem, Full, ProjectedFit
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.fitting.solver import DamperSearchEnd, levenberg_marquardt

AGREEING = 1e-4
"""relative difference of two costs that counts as none."""
ALIKE = 1e-3
"""tasted costs closer than this in relative terms belong to one minimum, which is polished once."""
COARSE, FINE = 1e-4, 1e-7
"""relative decrease of the cost at which a first tasting and its continuation end."""
PROMISING = 2.0
"""tasted cost over the best up to which a start is followed further."""
SCATTER = 0.7
"""of scattered starts: of a logarithm, or relative to the value."""
SAME_POINT = 1e-3
"""parameters closer than this in relative terms are one start."""


def estimate_law(damper: LawDamper, drives: Sequence[Drive], settings: FitSettings) -> Estimate:
    """Least free-run force residual over all drives.

    Parameters
    ----------
    damper : LawDamper
        Structure; its own values are one of the starts.
    drives : sequence of Drive
        With the measured force.
    settings : FitSettings

    Raises
    ------
    InputError
        Fewer samples than parameters.
    NumericalError
        The free run diverges from every start.
    """
    problem = DamperFitProblem(damper, tuple(drives))
    if problem.measured.size <= len(damper.names):
        raise InputError(f"too few samples to fit {damper.name}",
                         got=f"{problem.measured.size} for {len(damper.names)} parameters", mend="a longer record")
    with single_thread():
        found, starts = search(problem, settings)
        theta = found.trial.theta
        held = at_bounds(damper, theta)
        jacobian = problem.jacobian(theta)
        left = residual_of(problem.measured, problem.measured + found.trial.residual)
        spread = covariance_of(jacobian, left, problem.lengths, ~held)
        report = identifiability(damper, theta, jacobian, problem.measured, spread.covariance, ~held)
    notes = [*spread.notes]
    if not found.converged:
        notes.append(f"the search stopped at its limit of {settings.evaluations} evaluations before it had settled")
    return Estimate(damper.with_vector(theta), spread.covariance,
                    tuple(n for n, h in zip(damper.names, held, strict=True) if h), report.undetermined, tuple(notes),
                    starts if len(damper.linear) < len(damper.names) else None, report.condition)


def search(problem: DamperFitProblem, settings: FitSettings) -> tuple[DamperSearchEnd, Starts]:
    """The best of many starts, and how many agree on it."""
    damper = problem.damper
    rng = np.random.default_rng(settings.seed)
    short = DamperFitProblem(damper, shortened(problem.drives, settings.tasting_samples))
    given = [np.asarray(s, dtype=float) for s in damper.starts(problem.drives, settings.starts, rng)]
    starts = distinct([*given[: max(settings.starts - 1, 1)], damper.vector][: settings.starts])
    starts += scattered(damper, starts, settings.starts // 2 - len(starts), rng)
    groups = [[(0.0, starts[0])]] if len(starts) == 1 else _alike(tasted(short, starts, settings))
    polished = [(polish(problem, group[0][1], settings), len(group)) for group in groups[: settings.polished]]
    ends = [(end, size) for end, size in polished if end is not None]
    if not ends:
        raise NumericalError(f"{damper.name}: the free run diverges from each of {len(starts)} starts; check units and "
                             "signs of the records")
    best = min((end for end, _ in ends), key=lambda e: e.trial.cost)
    least = best.trial.cost * (1 + AGREEING) + EXACT**2 * float(problem.measured @ problem.measured)
    agreed = sum(size for end, size in ends if end.trial.cost <= least)
    return best, Starts(len(starts), len(ends), agreed)


def scattered(damper: LawDamper, starts: Sequence[np.ndarray], count: int,
              rng: np.random.Generator) -> list[np.ndarray]:
    """`count` further starts about the given ones: factors of about two where a parameter moves by its logarithm."""
    if len(damper.linear) == len(damper.names):
        return []
    place = SearchCoordinates(damper.parameters)
    default = np.array([abs(p.default) for p in damper.parameters])
    out = []
    for k in range(max(count, 0)):
        theta = starts[k % len(starts)]
        spread = np.where(place.log, SCATTER, SCATTER * np.maximum(np.abs(theta), default))
        out.append(place.values(place.of(theta) + spread * rng.normal(size=theta.size)))
    return out


def tasted(
    problem: DamperFitProblem, starts: Sequence[np.ndarray], settings: FitSettings
) -> list[tuple[float, np.ndarray]]:
    """(cost, parameters) of each start by rising cost, after a few steps on shortened data.

    Those near the best are followed three times as far, so that starts which share a minimum are seen to. Starts that
    diverge are left out, unless all do.
    """
    view = ProjectedFit(problem) if problem.damper.linear else Full(problem)
    ends = [levenberg_marquardt(view, view.start(s), settings.tasting_evaluations, COARSE) for s in starts]
    out = sorted(((e.trial.cost, e.trial.theta) for e in ends if e is not None), key=lambda t: t[0])
    for k, (cost, theta) in enumerate(out):
        if cost > PROMISING * out[0][0]:
            break
        end = levenberg_marquardt(view, view.start(theta), 3 * settings.tasting_evaluations, FINE)
        if end is not None:
            out[k] = (end.trial.cost, end.trial.theta)
    return sorted(out, key=lambda t: t[0]) or [(np.inf, s) for s in starts]


def _alike(ends: Sequence[tuple[float, np.ndarray]]) -> list[list[tuple[float, np.ndarray]]]:
    """Tasted starts by rising cost, those of nearly one cost together."""
    groups: list[list[tuple[float, np.ndarray]]] = []
    for cost, theta in ends:
        if groups and cost <= groups[-1][0][0] * (1 + ALIKE):
            groups[-1].append((cost, theta))
        else:
            groups.append([(cost, theta)])
    return groups


def polish(problem: DamperFitProblem, theta: np.ndarray, settings: FitSettings) -> DamperSearchEnd | None:
    """Variable projection on all data where the model is partly linear, then all parameters together."""
    if problem.damper.linear:
        view = ProjectedFit(problem)
        first = levenberg_marquardt(view, view.start(theta), settings.evaluations, settings.tolerance)
        if first is None:
            return None
        theta = first.trial.theta
    full = Full(problem)
    return levenberg_marquardt(full, full.start(theta), settings.evaluations, settings.tolerance)


def distinct(vectors: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The vectors without those that nearly repeat an earlier one."""
    out: list[np.ndarray] = []
    for v in vectors:
        if not any(np.all(np.abs(v - o) <= SAME_POINT * np.maximum(np.abs(v), np.abs(o)) + 1e-12) for o in out):
            out.append(v)
    return out


def shortened(drives: Sequence[Drive], samples: int) -> tuple[Drive, ...]:
    """A stretch of every drive, the one in which the force moves most of four, together about `samples` long."""
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


def at_bounds(damper: LawDamper, theta: np.ndarray) -> np.ndarray:
    """(P,) whether a parameter rests on one of its bounds."""
    lower = np.array([p.lower for p in damper.parameters])
    upper = np.array([p.upper for p in damper.parameters])
    return (theta <= lower) | (theta >= upper)
