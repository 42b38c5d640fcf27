"""One H2 criterion of `MultiObjective`, by the inequalities of `lpvid.synthesis.variance_search`.

Answers in balanced units become answers in the coordinates in which X and Y are one diagonal matrix, from which the
controller is recovered as from any other (`lpvid.synthesis.multiobjective`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lpvid.lmi.affine import given
from lpvid.lmi.program import SolverAnswer
from lpvid.synthesis.criteria import H2
from lpvid.synthesis.design_grid import columns, varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.preconditioning import Preconditioned, balancing, turned, unconditioned
from lpvid.synthesis.scaling import Units
from lpvid.synthesis.shaped_program import INTERIOR_POINT, Shaped, Shaping, SignalCoordinates
from lpvid.synthesis.variance_search import ROOM, VarianceAnswer, VarianceProblem, regulated


def suits(plant: GeneralizedPlant, criterion: H2, points: np.ndarray) -> bool:
    """Â is affine in the plant's basis where nothing but A, C1 and D11 varies; time is continuous.

    Parameters
    ----------
    plant : GeneralizedPlant
        The plant.
    criterion : H2
        Which disturbances and performance signals count.
    points : (N, n) array
        Points of the scheduling, in its units.

    Returns
    -------
    bool
        Whether the variance feedback applies.
    """
    at = plant.at(points)
    return plant.sample_time is None and bool(plant.order) and not any(
        varies(m) for m in (at.B1 @ criterion.selection(plant)[0], at.B2, at.D12, at.C2,
                            at.D21 @ criterion.selection(plant)[0]))


@dataclass(frozen=True, eq=False)
class VarianceFeedback:
    """The program of one criterion, with the way back to the plant's own units.

    Parameters
    ----------
    plant : GeneralizedPlant
    criterion : H2
    points : (N, n_scheduling) array
        At which the inequalities are imposed.
    """

    plant: GeneralizedPlant
    criterion: H2
    points: np.ndarray

    def answers(self, back_off: float) -> Iterator[tuple[Preconditioned, Shaped]]:
        """Answers `back_off` above the least level, or at the level that is requested, with their coordinates.

        The best conditioned comes first.

        Parameters
        ----------
        back_off : float
            Share above one by which the level is raised; not used where the criterion has a bound.

        Yields
        ------
        Preconditioned, Shaped
            Nothing where no answer was found or the bound is below the least level.
        """
        at = self.plant.at(self.points)
        units, (into, out) = Units.of(at), self.criterion.selection(self.plant)
        b = units.apply(at)
        part = replace(b, B1=b.B1 @ into, C1=out @ b.C1, D11=out @ b.D11 @ into, D12=out @ b.D12, D21=b.D21 @ into)
        problem = VarianceProblem(part, columns(self.plant.box, self.plant.system.basis, self.points))
        root, asked = np.sqrt(units.time), self.criterion.bound
        least = problem.least(INTERIOR_POINT)
        if least is None or (asked is not None and asked < least.level * root):
            return
        level = least.level * back_off if asked is None else asked / root
        for found in reversed([*problem.gentle(least, level, INTERIOR_POINT)]):
            try:
                yield self._moved(units, found, problem.dynamics(found), least)
            except np.linalg.LinAlgError:
                continue

    def _moved(self, units: Units, found: VarianceAnswer, a: np.ndarray, least: VarianceAnswer
               ) -> tuple[Preconditioned, Shaped]:
        """An answer in the coordinates where X = Y = diag(σ).

        x = D x'/√s with time t' = s t makes X = DX'D/√s, Y = √s D⁻¹Y'D⁻¹, Ĉ = UĈ'D, B̂ = s D⁻¹B̂'V⁻¹ and
        Â = s D⁻¹Â'D, ν = √s ν'; x = T x̃ makes Ĉ T⁻ᵀ of Ĉ, TᵀB̂ of B̂ and TᵀÂT⁻ᵀ of Â.
        """
        root = np.sqrt(units.time)
        inner, sizes = balancing(found.x / root, found.y * root)
        ready = turned(self.plant, units.states[:, None] * inner, sizes)
        c = SignalCoordinates.of(ready.plant.at(self.points), False, True)
        s, back = np.sqrt(sizes), np.linalg.inv(inner).T
        hats = {"A": units.time * (inner.T @ a @ back) / s / s[:, None],
                "B": units.time * (inner.T @ found.b) / units.measurements * c.measurements / s[:, None],
                "C": (units.controls / c.controls)[:, None] * (found.c @ back) / s,
                "D": np.zeros((len(a), found.c.shape[1], found.b.shape[2])),
                "X": np.eye(len(s))[None], "Y": np.eye(len(s))[None]}
        shaping = Shaping((), given(0.0), {k: tuple(map(given, v)) for k, v in hats.items()})
        solution = SolverAnswer(np.zeros(0), found.level, found.solver, found.status)
        return ready, Shaped(solution, shaping, (root * found.level,), (root * least.level,))


def regulated_plant(plant: GeneralizedPlant, points: np.ndarray) -> Preconditioned:
    """The plant over states in which X and Y of the linear-quadratic problem at the middle point are one diagonal
    matrix; the plant as it is where that has no solution.

    Parameters
    ----------
    plant : GeneralizedPlant
        The plant.
    points : (N, n) array
        Points of the scheduling, in its units.

    Returns
    -------
    Preconditioned
        The plant over those states, with the way back.
    """
    at = plant.at(points)
    units = Units.of(at)
    found = regulated(units.apply(at).point(len(points) // 2)) if plant.sample_time is None and plant.order else None
    if found is None:
        return unconditioned(plant)
    x, y, level = found
    root = np.sqrt(units.time)
    inner, sizes = balancing(ROOM * x / level / root, ROOM * y * level * root)
    return turned(plant, units.states[:, None] * inner, sizes)
