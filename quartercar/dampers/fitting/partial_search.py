"""A search over some of a semi-active damper's parameters, the others held."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np

from lpvid.errors import InputError
from lpvid.least_squares import Trial
from quartercar.dampers.drive import Drive
from quartercar.dampers.fitting.coordinates import SearchCoordinates
from quartercar.dampers.fitting.problem import DamperFitProblem
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.fitting.solver import search_law
from quartercar.dampers.laws.semi_active import SemiActiveDamper

FOLLOWED = 3
"""starts followed for a few steps, the cheapest first"""

D = TypeVar("D", bound=SemiActiveDamper)


def best_of(starts: Sequence[D], drives: Sequence[Drive], free: Sequence[str],
            settings: FitSettings) -> tuple[D, float]:
    """The best fit that a few starts lead to when `free` moves, and its ESR.

    Parameters
    ----------
    starts : sequence of SemiActiveDamper
        Of one structure.
    drives : sequence of Drive
        With forces.
    free : sequence of str
        Parameters that move.
    settings : FitSettings
        Its evaluations and tolerance.
    """
    parts = [PartialResiduals(s, drives, free) for s in starts]
    begun = [(part, trial) for part in parts if (trial := part.trial(part.start())) is not None]
    if not begun:
        raise InputError(f"{starts[0].name}: the free run diverges from every start", got=f"{len(starts)} starts")
    begun.sort(key=lambda pair: pair[1].cost)
    tried = []
    for part, trial in begun[:FOLLOWED] if len(begun) > 1 else []:
        found = search_law(part, trial.point, settings.tasting_evaluations, 1e-4)
        tried.append((part, trial if found is None else found.trial))
    part, trial = min(tried or begun[:1], key=lambda pair: pair[1].cost)
    found = search_law(part, trial.point, settings.evaluations, settings.tolerance)
    end = trial if found is None else found.trial
    measured = part.problem.measured
    power = sum(float(np.sum((m - m.mean()) ** 2)) for m in np.split(measured, np.cumsum(part.problem.lengths)[:-1]))
    return part.damper.with_vector(end.theta), end.cost / max(power, 1e-300)


def unseen(damper: SemiActiveDamper, drives: Sequence[Drive], free: Sequence[str]) -> tuple[str, ...]:
    """Those of some parameters on which the force along these drives does not depend."""
    part = PartialResiduals(damper, drives, free)
    now = part.trial(part.start())
    if now is None or not free:
        return ()
    size = np.abs(part.jacobian(now)).max(axis=0)
    return tuple(n for n, s in zip(free, size, strict=True) if s == 0.0)


class PartialResiduals(Generic[D]):
    """Residuals of a damper of which only some parameters move.

    Attributes
    ----------
    coordinates : Coordinates
        Of those that move.
    """

    def __init__(self, damper: D, drives: Sequence[Drive], free: Sequence[str]) -> None:
        self.problem = DamperFitProblem(damper, tuple(drives))
        self.damper = damper
        self.base = damper.vector
        self.free = [list(damper.names).index(n) for n in free]
        self.coordinates = SearchCoordinates([damper.parameters[i] for i in self.free])

    def start(self) -> np.ndarray:
        """Coordinates of the damper's own values."""
        return self.coordinates.of(self.base[self.free])

    def trial(self, point: np.ndarray) -> Trial | None:
        """Residual at a point of the search; None where the run diverges."""
        theta = self.base.copy()
        theta[self.free] = self.coordinates.values(point)
        residual = self.problem.model(theta) - self.problem.measured
        return Trial(point, theta, residual) if np.isfinite(residual).all() else None

    def jacobian(self, trial: Trial) -> np.ndarray:
        """(m, k) derivative of the residual in the coordinates."""
        return self.problem.sensitivity(trial.theta, self.free) * self.coordinates.slope(trial.theta[self.free])
