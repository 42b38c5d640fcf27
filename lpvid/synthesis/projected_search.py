"""The search for X and Y: least bound first, then a well-conditioned pair for a bound slightly above it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.lmi.program import SOLVERS
from lpvid.synthesis.projection import Pair, Projected, ProjectedProgram, initial, roots_of, sizes_at
from lpvid.synthesis.riccati import start

ROUNDS = 6
SETTLED = 1e-3
"""relative change of the bound from one round of coordinates to the next at which it counts as found."""


@dataclass
class Clock:
    """Wall time spent inside solvers [s], for comparison with the whole."""

    solving: float = 0.0


def least_bound(problem: Projected, clock: Clock, *, solvers: Sequence[str] = SOLVERS) -> Pair | None:
    """The pair of least γ, in coordinates that follow the answers until the bound settles; None if no solver answers.

    Every solver but the first is a fallback for one that gives no usable answer.
    """
    best: Pair | None = None
    for pair, roots in _starts(problem):
        found = _settled(problem, pair, roots, clock, solvers)
        if found is not None and (best is None or found.gamma < best.gamma):
            best = found
        if best is not None:
            break
    return best


def _starts(problem: Projected) -> Iterator[tuple[Pair, tuple[np.ndarray, np.ndarray]]]:
    """First coordinates: those of the Riccati equations at the middle of the box, and those of the balanced plant."""
    plain, roots = initial(problem)
    n, middle = problem.plant.A.shape[1], start(problem.plant)
    if middle is not None and n:
        x, y = (np.einsum("kij,jl->kil", one, m) for one, m in zip((plain.x, plain.y), (middle.x, middle.y), strict=True))
        pair = Pair(x, y, middle.gamma)
        yield pair, roots_of(problem, pair)
    yield plain, roots


def _settled(problem: Projected, pair: Pair, roots: tuple[np.ndarray, np.ndarray], clock: Clock,
             solvers: Sequence[str]) -> Pair | None:
    """The pair of least γ from one start on."""
    best: Pair | None = None
    stalled = 0
    for _ in range(ROUNDS):
        program = problem.program(roots, sizes_at(problem, roots, pair), gamma=None)
        found = next(_usable(program, clock, solvers), None)
        if found is None:
            break
        last, best = best, found if best is None or found.gamma < best.gamma else best
        settled = last is not None and found.gamma > (1 - SETTLED) * last.gamma
        stalled = stalled + 1 if settled else 0
        if stalled and (found.status == "optimal" or stalled > 1):
            break
        pair, roots = found, roots_of(problem, found)
    return best


def conditioned(problem: Projected, pair: Pair, gamma: float, clock: Clock, *, rounds: int = 2,
                solvers: Sequence[str] = SOLVERS) -> Iterator[Pair]:
    """Pairs for a fixed bound above the least one, each better conditioned than the last.

    The traces in coordinates where the last pair is the identity are the slopes of log det X + log det Y.
    """
    pair = replace(pair, gamma=gamma)
    for _ in range(rounds):
        roots = roots_of(problem, pair)
        program = problem.program(roots, sizes_at(problem, roots, pair), gamma=gamma)
        found = next(_usable(program, clock, solvers), None)
        if found is None:
            return
        pair = found
        yield pair


def _usable(program: ProjectedProgram, clock: Clock, solvers: Sequence[str]) -> Iterator[Pair]:
    """Answers whose inequalities hold to a solver's accuracy in the program's own coordinates."""
    answers = program.program.solve(solvers=solvers)
    while True:
        begun = time.perf_counter()
        solution = next(answers, None)
        clock.solving += time.perf_counter() - begun
        if solution is None:
            return
        matrices = [*program.x, *program.y]
        if np.all(np.isfinite(solution.x)) and all(np.abs(solution[m]).max() < 1e12 for m in matrices):
            yield program.pair(solution)
