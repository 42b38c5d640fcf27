"""Why the inequalities of output feedback have no answer: the controls' side, the measurements' side, or numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.lmi.affine import combined, he
from lpvid.lmi.program import Program
from lpvid.synthesis.assumptions import slow_mode_out_of_reach
from lpvid.synthesis.balanced_plant import convex_axes
from lpvid.synthesis.design_grid import tensor
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.projected_half import Half, null_space
from lpvid.synthesis.projected_search import start_roots
from lpvid.synthesis.projection import ProjectedInequalities
from lpvid.synthesis.riccati import least_gain
from lpvid.synthesis.scaling import pace

BEYOND = 1e6
"""Norm of X ⪰ I up to which none must exist for a verdict, in coordinates in which the Riccati equations have X = I at
the middle of the box. Two disks and a quarter car, which have controllers, are refuted up to 1 there, Wu's example with
one X up to 1e8; an X of larger condition than 1/√eps = 7e7 proves nothing in double precision."""

DECAY = 1e-6
"""Decay, in the balanced plant's unit of time, that a storage function must show to be found at all: a hundred times
the accuracy of a solver (1e-8 in rows of size one)."""


def obstacle(plant: GeneralizedPlant, problem: ProjectedInequalities, *, on_hull: bool = False
             ) -> tuple[str, str, str]:
    """Verdict, why and mend for a plant on which no solver found a bound at all.

    A bound exists as soon as both sides can be stabilised: X ≻ 0 with Nᵀ(He(AX) − Ẋ)N ≺ 0, N spanning the null space
    of B2ᵀ, and the same for the measurements. That one side cannot is only stated where a dual matrix shows it.

    Parameters
    ----------
    plant : GeneralizedPlant
        For the names of signals and scheduling variables.
    problem : ProjectedInequalities
        The inequalities without answer, in balanced units.
    on_hull : bool
        They stand at the vertices of a hull, not over the box.

    Returns
    -------
    str
        "infeasible" where a dual matrix shows it, else "numerical".
    str
        Why, with the least frozen gain where that is known.
    str
        What to change.
    """
    scheduled = ", ".join(plant.box.names)
    moves = problem.controls.moves or problem.measurements.moves
    slow = f"; give {scheduled} a narrower range, " + (
        "lower rate bounds, or the design a richer Lyapunov basis (a higher degree, or more of the variables)" if moves
        else "or a rate bound and the design a Lyapunov basis")
    slow = "; design for a smaller hull" if on_hull else slow
    roots = start_roots(problem)
    for half, root, text, mend in zip(problem.halves, roots, (
            f"even with the whole state measured, {', '.join(plant.controls)} cannot stabilise the plant",
            f"even with full command of the state, {', '.join(plant.measurements)} cannot observe it"),
            ("add an actuator", "add a sensor"), strict=True):
        slowly = _slowly_refuted(problem, half, root)
        if slowly or _refuted(half, root) >= BEYOND:
            moving = "moves as it may" if len(plant.box.names) == 1 else "move as they may"
            kind = "by any Lyapunov matrix in this basis" if moves else "by one Lyapunov matrix"
            why = f"{text} while {scheduled} {moving}, {kind}" if scheduled else text
            why += f" that decays faster than {DECAY:g} of the plant's pace" * slowly
            return "infeasible", why + " (shown by a dual matrix)", mend + (slow if scheduled else "")
    frozen = max((least_gain(problem.plant, k) for k in range(len(problem.plant.A))), default=np.inf)
    held = f"; {frozen:.4g} is the least gain with the scheduling held" if np.isfinite(frozen) and scheduled else ""
    if plant.sample_time is None and plant.box.names and not on_hull:
        # a mode slower than the plant's pace, out of reach in between
        points = tensor(convex_axes(plant))
        lost = slow_mode_out_of_reach(plant, points, pace(plant.at(points).A))
        held = f"; {lost}" if lost else held
    return ("numerical", f"no solver found a usable answer, and none showed that there is no controller{held}",
            "scale the signals to similar size, make very slow or very fast weights less so" + slow * bool(scheduled))


def _slowly_refuted(problem: ProjectedInequalities, half: Half, root: np.ndarray) -> bool:
    """No X decays at `DECAY` over all points, though every point by itself admits a controller with that decay."""
    n = half.A.shape[1]
    if len(half.A) == 1 or _refuted(replace(half, A=half.A + DECAY * np.eye(n)), root) < BEYOND:
        return False
    faster = replace(problem.plant, A=problem.plant.A + DECAY * np.eye(n))
    return all(np.isfinite(least_gain(faster, k)) for k in range(len(half.A)))


def hopeless(problem: ProjectedInequalities) -> bool:
    """Proof that one side is infeasible.

    Parameters
    ----------
    problem : ProjectedInequalities
        In balanced units.

    Returns
    -------
    bool
        False does not show that there is a controller.
    """
    return any(_refuted(half, root) >= BEYOND for half, root in zip(problem.halves, start_roots(problem), strict=True))


def _refuted(half: Half, root: np.ndarray) -> float:
    """Norm up to which no X(p) ⪰ I, over states x' = `root`⁻¹x, has Nᵀ(He(AX) ∓ Ẋ)N ⪯ 0, as far as was shown."""
    back = np.linalg.inv(root)
    half = replace(half, A=back @ half.A @ root, B2=back @ half.B2)
    program = Program()
    n, k = half.A.shape[1], half.variation.values.shape[1]
    if not n:
        return 0.0
    matrices = [program.unknowns.symmetric(n) for _ in range(k)]
    for i in range(len(half.A)):
        x = combined(matrices, half.variation.values[i])
        null = null_space(half.B2[i].T)
        for slope in half.variation.slopes[i]:
            drift = he(half.A[i] @ x) + combined(matrices, half.sign * slope)
            if null.shape[1]:
                program.require(-(null.T @ drift @ null))
        program.require(x - np.eye(n))
    return program.refuted()
