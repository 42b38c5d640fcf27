"""Two solves behind every shaped design: the lowest levels, then matrices of least size at levels a little above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance

from lpvid.lmi.affine import Affine, block, given
from lpvid.lmi.program import Program, SolverAnswer
from lpvid.synthesis.criteria import STRICT, Criterion, HInfinity, Region
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.progress import stop_at
from lpvid.synthesis.shaped_loop import ShapedLoop

INTERIOR_POINT = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT")
"""Interior-point methods; a first-order one takes minutes and finds no solution."""
APART = 4.0
"""How far the coupling [X, sI; sI, Y] ⪰ 0 is pushed from its limit s = 1, if that costs nothing."""
NOTHING = 1e-6
"""Share of a channel's size below which an infimum counts as zero: to come close to it would take infinite gains."""


@dataclass(frozen=True, eq=False)
class Shaping:
    """Unknowns of one design: the loops they shape, and a scalar that grows with their size and ill condition.

    Parameters
    ----------
    loops : tuple of ShapedLoop
    size : Affine
        (1, 1), minimised once the levels are fixed.
    unknowns : mapping of name to matrices
        What the controller is recovered from.
    room : Affine, optional
        (1, 1) distance of a coupling from its limit; room/size is then maximised in place of the size alone.
    """

    loops: tuple[ShapedLoop, ...]
    size: Affine
    unknowns: Mapping[str, tuple[Affine, ...]]
    room: Affine | None = None


@dataclass(frozen=True, eq=False)
class Shaped:
    """An answer: the values of the unknowns, the figures (γ, ν) that it promises, and the lowest there are.

    Parameters
    ----------
    solution : SolverAnswer
        Of the program.
    shaping : Shaping
        Loops and unknown matrices by name.
    promised : tuple of float
        γ or ν of each criterion.
    lowest : tuple of float
        The least of each; the bound itself where one was given.
    """

    solution: SolverAnswer
    shaping: Shaping
    promised: tuple[float, ...]
    lowest: tuple[float, ...]

    def values(self, name: str) -> np.ndarray:
        """(M, …) values of the unknown matrices of a name.

        Parameters
        ----------
        name : str
            Key in `shaping.unknowns`.

        Returns
        -------
        (M, …) array
            One for each function.
        """
        return np.array([self.solution[matrix] for matrix in self.shaping.unknowns[name]])


@dataclass(frozen=True, eq=False)
class ShapedProgram:
    """Criteria and regions over the loops of a design.

    Parameters
    ----------
    plant : GeneralizedPlant
    criteria : tuple of HInfinity, H2 or GeneralizedH2
    regions : tuple of Region
    build : callable
        Declares the design's unknowns in a program; the number is how large they were in the first solve (1 there).
    """

    plant: GeneralizedPlant
    criteria: tuple[Criterion, ...]
    regions: tuple[Region, ...]
    build: Callable[[Program, float], Shaping]

    @property
    def powers(self) -> tuple[int, ...]:
        """Level = figure ** power: γ and ν, but γ² and ν² where the two kinds share a Lyapunov matrix."""
        mixed = len({type(c) for c in self.criteria}) > 1
        return (2 if mixed else 1,) * len(self.criteria)

    def answers(self, back_off: float) -> Iterator[Shaped]:
        """Answers with figures `back_off` above the lowest, best solver first; none if no solver finds any.

        Parameters
        ----------
        back_off : float
            Factor, at least 1; a criterion with a bound of its own keeps that.

        Yields
        ------
        Shaped
            For every solver the answers of least size, then the one of the lowest levels itself.
        """
        bounds = [c.bound for c in self.criteria]
        program, shaping, levels = self._program(bounds)
        for rough in program.solve(solvers=INTERIOR_POINT):
            lowest = [b if b is not None else max(float(rough[level][0, 0]), 0.0) ** (1 / power)
                      for b, level, power in zip(bounds, levels, self.powers, strict=True)]
            raised = [low if c.bound is not None else self._raised(c, low, back_off)
                      for c, low in zip(self.criteria, lowest, strict=True)]
            second, moderate, _ = self._program(raised, float(np.abs(rough.x).max(initial=1.0)))
            try:
                for solution in second.solve(solvers=INTERIOR_POINT):
                    yield Shaped(solution, moderate, tuple(raised), tuple(lowest))
            except KeyboardInterrupt as error:  # the lowest levels have an answer, if not that of least size
                stop_at(error)
            yield Shaped(rough, shaping, tuple(lowest), tuple(lowest))

    def refuted(self) -> float:
        """The norm of the unknowns below which the criteria and regions were shown to have no answer; 0 for nothing.

        Returns
        -------
        float
            In the coordinates of the design.
        """
        return self._program([c.bound for c in self.criteria])[0].refuted()

    def _raised(self, criterion: Criterion, low: float, back_off: float) -> float:
        size = _size(self.plant, criterion)
        return low * back_off if low > NOTHING * size else max(low, 10 * NOTHING * size)

    def _program(self, fixed: Sequence[float | None], scale: float = 1.0) -> tuple[Program, Shaping, list[Affine]]:
        program = Program()
        shaping = self.build(program, scale)
        for matrix in {id(loop.lyapunov): loop.lyapunov for loop in shaping.loops}.values():
            program.require(matrix, margin=STRICT)
        levels, goal = [], None
        for criterion, value, power in zip(self.criteria, fixed, self.powers, strict=True):
            level = program.unknowns.scalar() if value is None else given(value**power)
            criterion.require(program, shaping.loops, level, criterion.selection(self.plant), squared=power == 2)
            levels.append(level)
            if value is None:
                goal = criterion.weight * level if goal is None else goal + criterion.weight * level
        for region in self.regions:
            region.require(program, shaping.loops)
        if goal is None and shaping.room is not None:
            program.maximise_ratio(shaping.room, shaping.size, scale)
        else:
            program.minimise(shaping.size if goal is None else goal)
        return program, shaping, levels


def _size(plant: GeneralizedPlant, criterion: Criterion) -> float:
    """How large a channel's gain is, roughly: what a level is measured against that could be brought to zero."""
    m, (into, out) = plant.at(plant.box.centre[None]), criterion.selection(plant)
    c = SignalCoordinates.of(m, plant.sample_time is not None)
    moved = float(np.linalg.norm(out @ m.C1[0] * c.states) * np.linalg.norm(m.B1[0] @ into / c.states[:, None]))
    return float(np.linalg.norm(out @ m.D11[0] @ into)) + moved / (
        c.pace if isinstance(criterion, HInfinity) else np.sqrt(c.pace))


def size_and_condition(program: Program, *, above: Sequence[Affine] = (), below: Sequence[Affine] = ()) -> Affine:
    """(1, 1) t with M ⪰ I/t for the matrices of `above` and ‖M‖ ≤ t for those of `below`.

    Parameters
    ----------
    program : Program
        Gets the unknown t and the constraints.
    above : sequence of Affine
        Square and symmetric.
    below : sequence of Affine
        Of any shape.

    Returns
    -------
    Affine
        (1, 1) t, to be minimised.
    """
    t = program.unknowns.scalar()
    for matrix in above:
        n = matrix.shape[0]
        program.require(block([[matrix, np.eye(n)], [np.eye(n), t.times(np.eye(n))]]))
    for matrix in below:
        m, n = matrix.shape
        program.require(block([[t.times(np.eye(m)), matrix], [matrix.T, t.times(np.eye(n))]]))
    return t


@dataclass(frozen=True, eq=False)
class SignalCoordinates:
    """Scaled states, controls and measurements x = T x̃, u = U ũ, y = Y ỹ, and a typical rate.

    Parameters
    ----------
    states, controls, measurements : arrays
        Diagonals of T, U and Y.
    pace : float
        1/s; 1 in discrete time.
    """

    states: np.ndarray
    controls: np.ndarray
    measurements: np.ndarray
    pace: float

    @classmethod
    def of(cls, m: PlantMatrices, discrete: bool, balanced: bool = False) -> SignalCoordinates:
        """Balanced coordinates of a plant at N points, whose states may be `balanced` already.

        Parameters
        ----------
        m : PlantMatrices
            At N points.
        discrete : bool
            Discrete time.
        balanced : bool
            Leave the states as they are.

        Returns
        -------
        SignalCoordinates
            In which B2 with D12, and C2 with D21, have columns and rows of size one.
        """
        n, nw, nz = m.A.shape[1], m.B1.shape[2], m.C1.shape[1]
        mean = np.zeros((n + nw + nz,) * 2)
        mean[:n, :n], mean[:n, n : n + nw], mean[n + nw :, :n] = (np.abs(x).mean(axis=0) for x in (m.A, m.B1, m.C1))
        pace = 1.0 if discrete else _pace(m.A)
        mean[:n, :n] /= pace
        mean[:n, n:] /= np.sqrt(pace)
        mean[n:, :n] /= np.sqrt(pace)
        states = np.diag(matrix_balance(mean, permute=False)[1])[:n].copy() if n else np.ones(0)
        states = np.ones(n) if balanced else states
        scaled = np.concatenate([m.B2 / states[None, :, None] / np.sqrt(pace), m.D12], axis=1)
        seen = np.concatenate([m.C2 * states / np.sqrt(pace), m.D21], axis=2)
        return cls(states, 1 / _lengths(scaled, 1), _lengths(seen, 2), pace)

    def scaled(self, m: PlantMatrices) -> PlantMatrices:
        """The plant in these coordinates.

        Parameters
        ----------
        m : PlantMatrices
            At N points, in the original coordinates.

        Returns
        -------
        PlantMatrices
            Time keeps its unit.
        """
        t, u, y = self.states, self.controls, self.measurements
        return PlantMatrices(m.A * t / t[:, None], m.B1 / t[:, None], m.B2 * u / t[:, None], m.C1 * t, m.D11,
                             m.D12 * u, m.C2 * t / y[:, None], m.D21 / y[:, None], m.D22 * u / y[:, None])


def _pace(a: np.ndarray) -> float:
    """Geometric mean of the fastest and the median mode [1/s]; of the size of A where no mode moves."""
    speeds = np.abs(np.linalg.eigvals(a)).ravel() if a.shape[1] else np.zeros(1)
    size = float(np.abs(a).max(initial=0.0)) or 1.0
    fast = float(speeds.max()) if speeds.max() > 1e-6 * size else size
    return float(np.sqrt(fast * max(float(np.median(speeds)), 1e-3 * fast)))


def _lengths(stack: np.ndarray, axis: int) -> np.ndarray:
    length = np.sqrt((stack**2).sum(axis=axis).mean(axis=0))
    return np.where(length > 1e-8 * max(length.max(initial=0.0), 1e-300), length, 1.0)
