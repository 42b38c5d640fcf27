"""The two projected inequalities of output feedback: what the controls can do, and what the measurements can observe.

With X for the controls and Y for the measurements (Apkarian & Gahinet 1995; equations sheet 5.4, Route A; with slopes:
Wu 1995), at every point p and every corner ṗ of the rate bounds,

    Nᵀ [ He(A X) − Ẋ   X C1ᵀ   B1  ] N ≺ 0     Mᵀ [ He(Y A) + Ẏ   Y B1   C1ᵀ  ] M ≺ 0     [ X  I ]
       [ C1 X          −γI     D11 ]              [ B1ᵀ Y         −γI    D11ᵀ ]           [ I  Y ] ⪰ 0
       [ B1ᵀ           D11ᵀ    −γI ]              [ C1            D11    −γI  ]

where N, M leave the last signal alone and span the null spaces of [B2ᵀ D12ᵀ] and [C2 D21] in the others. X and Y are
unknown in coordinates of their own, in which the previous answer was the identity; otherwise their sizes, which differ
by many orders of magnitude where controls are cheap or sensors good, are beyond a solver.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lpvid.lmi.affine import Affine, block, combined, trace
from lpvid.lmi.program import Program, SolverAnswer
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.projected_half import Half, Variation, congruent

REACH = 10.0
"""Times the norm of an answer's unknowns up to which others are looked at for a lower bound: they are of size one in
coordinates in which the last answer is the identity, and a dual matrix that is exact would reach over all."""


@dataclass(frozen=True, eq=False)
class MatrixPair:
    """Lyapunov matrices X (controls) and Y (measurements) as (K, n, n) coefficients, with the bound they are for.

    Parameters
    ----------
    x, y : (K, n, n) array
        One matrix for each function of its variation; K may differ.
    gamma : float
        Bound of the gain w → z.
    solver : str
        Where it comes from.
    status : str
        Of the solver, or what the pair is otherwise.
    floor : float
        Bound that no pair comes below, as the solver's dual matrices show; −∞ where they show nothing.
    """

    x: np.ndarray
    y: np.ndarray
    gamma: float
    solver: str = ""
    status: str = ""
    floor: float = -np.inf


@dataclass(frozen=True, eq=False)
class ProjectedInequalities:
    """The inequalities of a scaled plant at N points.

    Parameters
    ----------
    plant : PlantMatrices
    controls, measurements : Variation
        Of X and of Y.
    strictly_proper : bool
        Without feedthrough in the controller γ exceeds the norm of D11.
    """

    plant: PlantMatrices
    controls: Variation
    measurements: Variation
    strictly_proper: bool = False

    @property
    def halves(self) -> tuple[Half, Half]:
        """The side of the controls, and that of the measurements as the controls of the dual plant."""
        p = self.plant

        def t(m: np.ndarray) -> np.ndarray:
            return m.swapaxes(1, 2)

        return (Half(p.A, p.B1, p.B2, p.C1, p.D11, p.D12, self.controls, -1.0),
                Half(t(p.A), t(p.C1), t(p.C2), t(p.B1), t(p.D11), t(p.D21), self.measurements, 1.0))

    def program(self, roots: tuple[np.ndarray, np.ndarray], sizes: tuple[list, list], *, gamma: float | None,
                roomy: bool = False, room: float = 0.0) -> ProjectedProgram:
        """The semidefinite program in coordinates X = T X' Tᵀ, Y = U Y' Uᵀ with (T, U) = `roots`.

        With `gamma` left out it is minimised; given, the traces of X' and Y' are, and the coupling is kept away from
        its limit, where the controller's matrices would be inverses of nearly singular ones. `roomy`, it is the common
        margin of all inequalities, in rows of size one, that is made largest: where the traces are least some of them
        have no room at all, and rounding may then cost the proof. `room` is a margin that the inequalities must have.

        Parameters
        ----------
        roots : ((n, n) array, (n, n) array)
            T and U.
        sizes : (list of array, list of array)
            Diagonals, one for each inequality of either half, as `sizes_at` gives them.
        gamma : float or None
            Bound to keep; None for the least.
        roomy : bool
            Make the common margin largest, at most 1.
        room : float
            Margin in rows of size one; 0 for none.

        Returns
        -------
        ProjectedProgram
            Ready to be solved.
        """
        program = Program()
        unknowns, n = program.unknowns, self.plant.A.shape[1]
        own = [[unknowns.symmetric(n) for _ in range(h.variation.values.shape[1])] for h in self.halves]
        bound = unknowns.scalar()

        def required(matrix: Affine) -> None:
            eye = np.eye(matrix.shape[0])
            program.require(matrix - bound.times(eye) if roomy else matrix - room * eye if room else matrix)

        for half, root, size, matrices in zip(self.halves, roots, sizes, own, strict=True):
            for (matrix, weight), scale in zip(half.inequalities(root, matrices), size, strict=True):
                level = bound.times(weight) if gamma is None else gamma * weight
                required(congruent(level - matrix, scale))
        cross, apart = np.linalg.solve(roots[0], np.linalg.inv(roots[1]).T), None
        if gamma is not None and not roomy:
            apart = bound
            program.require(apart - 1.0)
            program.require(2.0 - apart)
        # a pair of constant matrices is coupled once, not at every point
        points = len(self.plant.A) if self.controls.moves or self.measurements.moves else 1
        for k in range(points):
            x, y = (combined(m, v.values[k]) for v, m in zip((self.controls, self.measurements), own, strict=True))
            if apart is None:
                required(block([[x, cross], [cross.T, y]]))
            else:
                pushed = apart.times(cross)
                program.require(block([[x, pushed], [pushed.T, y]]))
        if self.strictly_proper and gamma is None:
            program.require(bound - 1.0001 * float(np.linalg.norm(self.plant.D11, 2, axis=(1, 2)).max()))
        if roomy:  # X and Y alone have no bound
            program.require(1.0 - bound)
        program.minimise(-bound if roomy else bound if gamma is None else self._spread(own, bound))
        return ProjectedProgram(program, own[0], own[1], bound, roots, gamma)

    def _spread(self, own: list[list[Affine]], apart: Affine) -> Affine:
        """Mean traces over the points, less a reward for the distance of the coupling."""
        total = (-100.0 * len(self.plant.A[0])) * apart
        for variation, matrices in zip((self.controls, self.measurements), own, strict=True):
            total = total + trace(combined(matrices, variation.values.mean(axis=0)))
        return total


@dataclass(frozen=True, eq=False)
class ProjectedProgram:
    """A program and where its matrices are.

    Parameters
    ----------
    program : Program
        Constraints and objective.
    x, y : list of Affine
        (n, n) unknowns X' and Y', one for each function.
    bound : Affine
        (1, 1) γ where it is minimised; at a given γ the distance of the coupling, or the common margin.
    roots : ((n, n) array, (n, n) array)
        T of X = T X' Tᵀ and U of Y = U Y' Uᵀ.
    gamma : float or None
        The given bound; None where it is minimised.
    """

    program: Program
    x: list[Affine]
    y: list[Affine]
    bound: Affine
    roots: tuple[np.ndarray, np.ndarray]
    gamma: float | None

    def pair(self, solution: SolverAnswer) -> MatrixPair:
        """X and Y in the plant's coordinates.

        Parameters
        ----------
        solution : SolverAnswer
            Of this program.

        Returns
        -------
        MatrixPair
            With the solver's name and status.
        """
        x, y = (np.array([root @ solution[m] @ root.T for m in matrices])
                for root, matrices in zip(self.roots, (self.x, self.y), strict=True))
        if self.gamma is not None:
            return MatrixPair(x, y, self.gamma, solution.solver, solution.status)
        floor = self.program.floor(solution, REACH)
        return MatrixPair(x, y, float(solution[self.bound][0, 0]), solution.solver, solution.status, floor)


def sizes_at(
    problem: ProjectedInequalities, roots: tuple[np.ndarray, np.ndarray], pair: MatrixPair
) -> tuple[list, list]:
    """Diagonals that give every inequality, at a pair, rows of size one.

    Parameters
    ----------
    problem : ProjectedInequalities
        Of a balanced plant at N points.
    roots : ((n, n) array, (n, n) array)
        T and U.
    pair : MatrixPair
        X, Y and γ.

    Returns
    -------
    (list of array, list of array)
        One diagonal for each inequality of the controls' half, and of the measurements'.
    """
    x, y = ([_levelled(size) for size in half.sizes(root, matrices, pair.gamma)]
            for half, root, matrices in zip(problem.halves, roots, (pair.x, pair.y), strict=True))
    return x, y


def shortfall(problem: ProjectedInequalities, pair: MatrixPair) -> float:
    """How far a pair is from keeping the inequalities at its γ, and the coupling [X, I; I, Y] ⪰ 0: the least
    eigenvalue below zero, rows being of size one in coordinates in which the means of X and Y are the identity.

    Parameters
    ----------
    problem : ProjectedInequalities
        The two inequalities.
    pair : MatrixPair
        X, Y and γ.

    Returns
    -------
    float
        At least 0, without unit; 0 where it keeps them.
    """
    roots = roots_of(problem, pair)
    worst = _uncoupled(problem, pair)
    for half, root, matrices in zip(problem.halves, roots, (pair.x, pair.y), strict=True):
        for value in half.values(root, matrices, pair.gamma):
            scale = _levelled(np.linalg.norm(value, axis=1))
            worst = max(worst, -float(np.linalg.eigvalsh(value * np.outer(scale, scale))[0]))
    return worst


def _uncoupled(problem: ProjectedInequalities, pair: MatrixPair) -> float:
    """By how much the largest singular value of L_X⁻¹L_Y⁻ᵀ exceeds one, with X = L_X L_Xᵀ and Y alike; infinite where
    one of the two is not positive definite. Apart from the halves' scale: X may be tiny where the coupling fails.
    """
    try:
        x, y = (np.linalg.cholesky(v.at(m)) for v, m in ((problem.controls, pair.x), (problem.measurements, pair.y)))
    except np.linalg.LinAlgError:
        return np.inf
    cross = np.linalg.solve(x, np.linalg.inv(y).swapaxes(1, 2))
    return max(0.0, float(np.linalg.norm(cross, 2, axis=(1, 2)).max()) - 1) if x.shape[1] else 0.0


def raised(pair: MatrixPair, share: float) -> MatrixPair:
    """X, Y and γ a share larger: what keeps its inequalities then keeps them with room, the coupling too.

    Parameters
    ----------
    pair : MatrixPair
        X, Y and γ.
    share : float
        Above zero.

    Returns
    -------
    MatrixPair
        All three times 1 + share.
    """
    return replace(pair, x=(1 + share) * pair.x, y=(1 + share) * pair.y, gamma=(1 + share) * pair.gamma)


def _levelled(size: np.ndarray) -> np.ndarray:
    """Diagonal that gives rows of such norms size one."""
    return 1 / np.sqrt(np.maximum(size, 1e-5 * size.max()))


def initial(problem: ProjectedInequalities) -> tuple[MatrixPair, tuple[np.ndarray, np.ndarray]]:
    """Identity matrices, for scaling alone.

    Parameters
    ----------
    problem : ProjectedInequalities
        For the functions and the number of states.

    Returns
    -------
    MatrixPair
        X = Y = I as well as the functions have it, with γ = 1.
    ((n, n) array, (n, n) array)
        Identities: the plant's own coordinates.
    """
    n = problem.plant.A.shape[1]
    parts = []
    for v in (problem.controls, problem.measurements):
        one = np.linalg.lstsq(v.values, np.ones(len(v.values)), rcond=None)[0]
        parts.append(one[:, None, None] * np.eye(n))
    return MatrixPair(parts[0], parts[1], 1.0), (np.eye(n), np.eye(n))


def roots_of(problem: ProjectedInequalities, pair: MatrixPair) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in which the means over the points of X and Y are the identity.

    Parameters
    ----------
    problem : ProjectedInequalities
        For the functions.
    pair : MatrixPair
        X and Y over them.

    Returns
    -------
    ((n, n) array, (n, n) array)
        T and U; eigenvalues of a mean below 1e-13 of the largest are raised to that.
    """
    return (definite_root(problem.controls.at(pair.x).mean(axis=0)),
            definite_root(problem.measurements.at(pair.y).mean(axis=0)))


def definite_root(matrix: np.ndarray) -> np.ndarray:
    """R with R Rᵀ the matrix, its eigenvalues raised to 1e-13 of the largest.

    Parameters
    ----------
    matrix : (n, n) array
        Symmetric but for rounding.

    Returns
    -------
    (n, n) array
        Invertible.
    """
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return vectors * np.sqrt(np.maximum(values, 1e-13 * max(values[-1], 1e-300)))
