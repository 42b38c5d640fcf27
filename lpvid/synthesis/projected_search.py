"""The search for X and Y: least bound first, then a well-conditioned pair for a bound slightly above it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from lpvid.lmi.program import SOLVERS, available
from lpvid.synthesis.progress import Rounds, stage, stop_at
from lpvid.synthesis.projection import (
    MatrixPair,
    ProjectedInequalities,
    ProjectedProgram,
    initial,
    raised,
    roots_of,
    shortfall,
    sizes_at,
)
from lpvid.synthesis.regularised_plants import singular
from lpvid.synthesis.riccati import Central, admits, central, least_gain, start

ROUNDS = 6
SETTLED = 1e-3
"""Share below a bound within which the least counts as found: the dual matrices show that no pair is lower by more, or
the bound of the round before, in other coordinates, was not."""
KEPT, ACCURATE = 2e-3, 1e-8
"""An answer counts that keeps its inequalities and the coupling, all raised by this share, to a solver's accuracy in
rows of size one: answers of two disks, an autopilot and random plants miss them by nothing, false ones by 1e-3 to 0.3.
"""
ABOVE = 10.0
"""times a bound at which Riccati equations that refuse it must have a solution, for their refusal to count: nearer they
may fail by rounding alone"""
ROOMY = "with room"
"""status of a pair that is not the least"""
FACTORS = (1.01, 1.05, 1.12, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)
"""of the largest frozen optimum that are tried where no least bound could be computed"""


def least_bound(
    problem: ProjectedInequalities,
    *,
    solvers: Sequence[str] = SOLVERS,
    known: MatrixPair | None = None,
    hopeless: Callable[[], bool] | None = None,
    roughly: bool = False,
) -> MatrixPair | None:
    """The pair of least γ, in coordinates that follow the answers until the bound settles; None if no solver answers.

    Those of a `known` pair, of the same problem at fewer points, come first. `hopeless` is evaluated once, where the
    first attempt fails: whether it can be shown that there is no answer. `roughly`, the first answer is enough that
    keeps its inequalities: its bound can be had, and may not be the least.

    Every solver but the first is a fallback for one that gives no plausible answer: no bound can be had that the
    Riccati equations refuse at a frozen point. Where all of them fail, bounds above the largest frozen optimum are
    tried, which leaves the solvers room.

    Parameters
    ----------
    problem : ProjectedInequalities
        In balanced units.
    solvers : sequence of str
        In the order in which they are tried; those that are not installed are passed over.
    known : MatrixPair, optional
        Of the same problem at fewer points.
    hopeless : callable, optional
        Without arguments, to bool.
    roughly : bool
        Accept the first answer that keeps its inequalities.

    Returns
    -------
    MatrixPair or None
        Its status is `ROOMY` where γ may not be the least.
    """
    rough: MatrixPair | None = None
    for solver in (s for s in solvers if available([s])):
        for pair, roots in itertools.chain([] if known is None else [(known, roots_of(problem, known))],
                                           _starts(problem)):
            found = _settled(problem, pair, roots, (solver,), roughly)
            if found is not None and found.status == ROOMY:
                rough = found
            elif found is not None and _plausible(problem, found.gamma):
                return found
            if hopeless is not None and hopeless():
                return None
            hopeless = None
    return _with_room(problem, solvers) or rough


def _plausible(problem: ProjectedInequalities, gamma: float) -> bool:
    """No frozen point refuses a bound, where its Riccati equations can be solved at `ABOVE` times that.

    Where controls are free or measurements exact they only bound the least gain from above, and refuse nothing.
    """
    return singular(problem.plant) or not any(
        not admits(problem.plant, gamma * (1 + SETTLED), k) and admits(problem.plant, ABOVE * gamma, k)
        for k in range(len(problem.plant.A)))


def _with_room(problem: ProjectedInequalities, solvers: Sequence[str]) -> MatrixPair | None:
    """A pair for the first multiple of the largest frozen optimum at which there is one."""
    if not problem.plant.A.shape[1]:
        return None
    frozen = [least_gain(problem.plant, k) for k in range(len(problem.plant.A))]
    worst = int(np.argmax(frozen))
    if not 0 < frozen[worst] < np.inf:
        return None
    plain, _ = initial(problem)
    for factor in FACTORS:
        gamma = factor * frozen[worst]
        middle = central(problem.plant, gamma, worst)
        if middle is None:
            continue
        found = list(conditioned(problem, _spread(plain, middle), gamma, rounds=1, solvers=solvers))
        if found:
            return replace(found[0], status=ROOMY)
    return None


def _starts(problem: ProjectedInequalities) -> Iterator[tuple[MatrixPair, tuple[np.ndarray, np.ndarray]]]:
    """First coordinates: those of the Riccati equations at the middle of the box, and those of the balanced plant."""
    plain, roots = initial(problem)
    middle = start(problem.plant) if problem.plant.A.shape[1] else None
    if middle is not None:
        pair = _spread(plain, middle)
        yield pair, roots_of(problem, pair)
    yield plain, roots


def start_roots(problem: ProjectedInequalities) -> tuple[np.ndarray, np.ndarray]:
    """The first coordinates in which the search looks.

    Parameters
    ----------
    problem : ProjectedInequalities
        In balanced units.

    Returns
    -------
    ((n, n) array, (n, n) array)
        T of X = T X' Tᵀ and U of Y = U Y' Uᵀ.
    """
    return next(_starts(problem))[1]


def _spread(plain: MatrixPair, middle: Central) -> MatrixPair:
    """The matrices of one point, constant over all of them."""
    x, y = (np.einsum("kij,jl->kil", one, m) for one, m in zip((plain.x, plain.y), (middle.x, middle.y), strict=True))
    return MatrixPair(x, y, middle.gamma)


def _settled(problem: ProjectedInequalities, pair: MatrixPair, roots: tuple[np.ndarray, np.ndarray],
             solvers: Sequence[str], roughly: bool = False) -> MatrixPair | None:
    """The pair of least γ from one start on.

    A solver calls answers optimal that miss the inequalities by far in other coordinates: only those count that keep
    them, by numpy. The others give coordinates for the next round; where no other comes, the last has the status
    `ROOMY`: its γ is no bound.
    """
    best: MatrixPair | None = None
    rough: MatrixPair | None = None
    stalled, rounds = 0, Rounds(f"the least gain, by {', '.join(solvers)}", ROUNDS)
    for _ in range(ROUNDS):
        try:
            rounds.enter("" if best is None else f"{best.gamma:.4g} so far")
            program = problem.program(roots, sizes_at(problem, roots, pair), gamma=None)
            found = next(_usable(program, solvers), None)
        except KeyboardInterrupt as error:
            if best is None:
                raise
            stop_at(error)
            break
        if found is None:
            break
        if shortfall(problem, raised(found, KEPT)) > ACCURATE:
            rough, pair, roots = found, found, roots_of(problem, found)
            continue
        last, best = best, found if best is None or found.gamma < best.gamma else best
        settled = last is not None and found.gamma > (1 - SETTLED) * last.gamma
        stalled = stalled + 1 if settled else 0
        least = found.floor > (1 - SETTLED) * found.gamma
        if roughly or least or (stalled and (found.status == "optimal" or stalled > 1)):
            break
        pair, roots = found, roots_of(problem, found)
    return best if best is not None or rough is None else replace(rough, status=ROOMY)


def conditioned(problem: ProjectedInequalities, pair: MatrixPair, gamma: float, *, rounds: int = 2,
                solvers: Sequence[str] = SOLVERS) -> Iterator[MatrixPair]:
    """Pairs for a fixed bound above the least one, each better conditioned than the last.

    The traces in coordinates where the last pair is the identity are the slopes of log det X + log det Y.

    Parameters
    ----------
    problem : ProjectedInequalities
        In balanced units.
    pair : MatrixPair
        Whose coordinates are used first.
    gamma : float
        Bound to keep.
    rounds : int
        Most pairs that are made.
    solvers : sequence of str
        In the order in which they are tried.

    Yields
    ------
    MatrixPair
        Keeps the bound; `pair` itself after an interruption, none where no solver answers.
    """
    pair, timed = replace(pair, gamma=gamma), Rounds(f"a well-conditioned controller for {gamma:.4g}", rounds)
    for _ in range(rounds):
        try:
            timed.enter()
            roots = roots_of(problem, pair)
            program = problem.program(roots, sizes_at(problem, roots, pair), gamma=gamma)
            found = next(_usable(program, solvers), None)
        except KeyboardInterrupt as error:  # the pair of the least bound has room at this one
            stop_at(error)
            yield pair
            return
        if found is None:
            return
        pair = found
        yield pair


def roomy(problem: ProjectedInequalities, pair: MatrixPair, gamma: float, *,
          solvers: Sequence[str] = SOLVERS) -> Iterator[MatrixPair]:
    """Pairs that keep a bound with room in every inequality: half of the largest common margin, and well conditioned
    with that; then the largest.

    Parameters
    ----------
    problem : ProjectedInequalities
    pair : MatrixPair
        Whose coordinates are used.
    gamma : float
    solvers : sequence of str

    Yields
    ------
    MatrixPair
    """
    stage(f"a controller with room in every inequality for {gamma:.4g}")
    at = replace(pair, gamma=gamma)
    roots = roots_of(problem, at)
    sizes = sizes_at(problem, roots, at)
    program = problem.program(roots, sizes, gamma=gamma, roomy=True)
    answer = next(program.program.solve(solvers=solvers), None)
    if answer is None or answer.objective >= 0:
        return
    half = problem.program(roots, sizes, gamma=gamma, room=-0.5 * answer.objective)
    yield from itertools.islice(_usable(half, solvers), 1)
    yield program.pair(answer)


def _usable(program: ProjectedProgram, solvers: Sequence[str]) -> Iterator[MatrixPair]:
    """Answers whose inequalities hold to a solver's accuracy in the program's own coordinates."""
    for solution in program.program.solve(solvers=solvers):
        matrices = [*program.x, *program.y]
        if np.all(np.isfinite(solution.x)) and all(np.abs(solution[m]).max() < 1e12 for m in matrices):
            yield program.pair(solution)
