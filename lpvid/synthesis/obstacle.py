"""Why the inequalities of output feedback have no answer: the controls' side, the measurements' side, or numbers."""

from __future__ import annotations

import numpy as np

from lpvid.lmi.affine import he
from lpvid.lmi.program import Program
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.projection import Half, Projected, null_space

NEAR = 1e-6


def obstacle(plant: GeneralizedPlant, problem: Projected) -> tuple[str, str, str]:
    """Verdict, why and mend for a plant on which no solver found a bound at all.

    A bound exists as soon as both sides can be stabilised: X ≻ 0 with Nᵀ(He(AX) − Ẋ)N ≺ 0, N spanning the null space
    of B2ᵀ, and the same for the measurements.
    """
    scheduled = ", ".join(plant.box.names)
    slow = (f"; give {scheduled} a narrower range" + (", or a rate bound and the design a Lyapunov basis"
            if not problem.controls.moves and not problem.measurements.moves else ", or lower rate bounds"))
    for half, text, mend in zip(problem.halves, (
            f"even with the whole state measured, {', '.join(plant.controls)} cannot be shown to stabilise the plant",
            f"even with full command of the state, {', '.join(plant.measurements)} cannot be shown to observe it"),
            ("add an actuator", "add a sensor"), strict=True):
        if _margin(half) > -NEAR:
            moving = "moves as it may" if len(plant.box.names) == 1 else "move as they may"
            why = f"{text} while {scheduled} {moving}" if scheduled else text
            return "infeasible", why, mend + (slow if scheduled else "")
    return ("numerical", "no solver found a usable answer, though both the controls and the measurements can stabilise "
            "the plant", "scale the signals to similar size, or install another solver (pip install sdpa-python)")


def _margin(half: Half) -> float:
    """Least t with Nᵀ(He(AX) ∓ Ẋ)N ⪯ tI, X ⪰ tiny, over X of mean trace 1; infinite if no solver answers."""
    program = Program()
    n, k = half.A.shape[1], half.variation.values.shape[1]
    matrices = [program.unknowns.symmetric(n) for _ in range(k)]
    level = program.unknowns.scalar()
    for i in range(len(half.A)):
        x = matrices[0] * half.variation.values[i, 0]
        for j in range(1, k):
            x = x + matrices[j] * half.variation.values[i, j]
        null = null_space(half.B2[i].T)
        for slope in half.variation.slopes[i]:
            drift = he(half.A[i] @ x)
            for j in range(k):
                if slope[j]:
                    drift = drift + matrices[j] * (half.sign * slope[j])
            if null.shape[1]:
                program.require(level.times(np.eye(null.shape[1])) - null.T @ drift @ null)
        program.require(x - 1e-6 * np.eye(n))
        program.require(np.eye(n) - x)
    program.require(level + 10.0)
    program.minimise(level)
    found = next(program.solve(), None)
    return np.inf if found is None else found.objective
