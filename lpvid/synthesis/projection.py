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

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine, block, combined, trace, widened
from lpvid.lmi.program import Program, SolverAnswer
from lpvid.synthesis.generalized_plant import PlantMatrices


@dataclass(frozen=True, eq=False)
class Variation:
    """How a Lyapunov matrix varies: Σ_j values[k, j] X_j at point k, and its derivative at corner t of the rates.

    Parameters
    ----------
    values : (N, K) array
    slopes : (N, T, K) array
    """

    values: np.ndarray
    slopes: np.ndarray

    @classmethod
    def constant(cls, points: int) -> Variation:
        """One matrix for all points.

        Parameters
        ----------
        points : int
            Number of points N.

        Returns
        -------
        Variation
            One function, one corner, no slope.
        """
        return cls(np.ones((points, 1)), np.zeros((points, 1, 1)))

    @property
    def moves(self) -> bool:
        """The matrix depends on the scheduling."""
        return self.values.shape[1] > 1

    def at(self, matrices: np.ndarray) -> np.ndarray:
        """(N, n, n) of (K, n, n) matrices.

        Parameters
        ----------
        matrices : (K, n, n) array
            Coefficients X_j.

        Returns
        -------
        (N, n, n) array
            The matrix at every point.
        """
        return np.tensordot(self.values, matrices, axes=1)

    def slope(self, matrices: np.ndarray) -> np.ndarray:
        """(N, T, n, n) derivatives.

        Parameters
        ----------
        matrices : (K, n, n) array
            Coefficients X_j.

        Returns
        -------
        (N, T, n, n) array
            At every point and corner, per unit of time of the plant.
        """
        return np.tensordot(self.slopes, matrices, axes=1)


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
    """

    x: np.ndarray
    y: np.ndarray
    gamma: float
    solver: str = ""
    status: str = ""


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
        gamma = float(solution[self.bound][0, 0]) if self.gamma is None else self.gamma
        return MatrixPair(x, y, gamma, solution.solver, solution.status)


@dataclass(frozen=True, eq=False)
class Half:
    """One of the two sides, as a problem of full information; `sign` is that of the Lyapunov matrix's derivative.

    Parameters
    ----------
    A, B1, B2 : (N, n, n), (N, n, n_w) and (N, n, n_u) arrays
        Dynamics, disturbances and controls; of the measurements' side those of the dual plant.
    C1, D11, D12 : (N, n_z, n), (N, n_z, n_w) and (N, n_z, n_u) arrays
        Performance signals.
    variation : Variation
        Of X, or of Y.
    sign : float
        1 or −1.
    """

    A: np.ndarray
    B1: np.ndarray
    B2: np.ndarray
    C1: np.ndarray
    D11: np.ndarray
    D12: np.ndarray
    variation: Variation
    sign: float

    def pieces(self, root: np.ndarray, k: int) -> HalfPoint:
        """What the inequalities at point k are made of, in coordinates x = `root`·x'.

        Parameters
        ----------
        root : (n, n) array
            Regular.
        k : int
            Which of the N points.

        Returns
        -------
        HalfPoint
            For a bound that is a number or an unknown.
        """
        inverse = np.linalg.inv(root)
        n, w = self.A.shape[1], self.D11.shape[2]
        a, b, c = inverse @ self.A[k] @ root, inverse @ self.B1[k], self.C1[k] @ root
        null = null_space(np.hstack([(inverse @ self.B2[k]).T, self.D12[k].T]))
        weight = np.zeros((null.shape[1] + w,) * 2)
        weight[: null.shape[1], : null.shape[1]] = null[n:].T @ null[n:]
        weight[null.shape[1] :, null.shape[1] :] = np.eye(w)
        return HalfPoint(null[:n].T @ a + null[n:].T @ c, null[:n], null.T @ np.vstack([b, self.D11[k]]), weight)

    def inequalities(self, root: np.ndarray, matrices: list[Affine]) -> Iterator[tuple[Affine, np.ndarray]]:
        """F and E with γE − F ⪰ 0, for every point and corner.

        Parameters
        ----------
        root : (n, n) array
            Of x = `root`·x'.
        matrices : list of Affine
            (n, n) unknowns, one for each function of the variation, in coordinates x'.

        Yields
        ------
        Affine
            F, affine in the unknowns.
        2-D array
            E, of the size of F.
        """
        width = max(m.linear.shape[1] for m in matrices)
        entries = sparse.vstack([widened(m.linear, width) for m in matrices], format="csr").T
        for k in range(len(self.A)):
            p = self.pieces(root, k)
            size, drives = p.null.shape[1], p.drive.shape[1]
            constant = np.zeros((size + drives,) * 2)
            constant[:size, size:], constant[size:, :size] = p.drive, p.drive.T
            own, moved = p.slopes()
            inside = np.zeros((len(constant), len(constant), width))
            for slope in self.variation.slopes[k]:
                weights = self.variation.values[k][:, None, None, None] * own
                if slope.any():
                    weights = weights + self.sign * slope[:, None, None, None] * moved
                inside[:size, :size] = (entries @ weights.transpose(0, 3, 1, 2).reshape(entries.shape[1], -1)
                                        ).T.reshape(size, size, width)
                yield Affine(constant, sparse.csr_array(inside.reshape(-1, width))), p.weight

    def sizes(self, root: np.ndarray, matrices: np.ndarray, gamma: float) -> list[np.ndarray]:
        """Norms of the rows of γE − F for known matrices (K, n, n) in the plant's own coordinates.

        Parameters
        ----------
        root : (n, n) array
            Of x = `root`·x'.
        matrices : (K, n, n) array
            X or Y over its basis.
        gamma : float
            Bound of the gain.

        Returns
        -------
        list of array
            One for each point and corner.
        """
        return [np.linalg.norm(value, axis=1) for value in self.values(root, matrices, gamma)]

    def values(self, root: np.ndarray, matrices: np.ndarray, gamma: float) -> Iterator[np.ndarray]:
        """γE − F for known matrices (K, n, n) in the plant's own coordinates, for every point and corner.

        Parameters
        ----------
        root : (n, n) array
            Change of coordinates from the plant's own to those of the pieces.
        matrices : (K, n, n) array
            X or Y over its basis.
        gamma : float
            The gain.

        Yields
        ------
        (m, m) array
            Positive semidefinite where the inequality holds.
        """
        inverse = np.linalg.inv(root)
        own = inverse @ matrices @ inverse.T
        for k in range(len(self.A)):
            p = self.pieces(root, k)
            half = p.left @ np.tensordot(self.variation.values[k], own, axes=1) @ p.null
            for slope in self.variation.slopes[k]:
                drift = self.sign * (p.null.T @ np.tensordot(slope, own, axes=1) @ p.null)
                m, value = len(half), gamma * p.weight
                value[:m, :m] -= half + half.T + drift
                value[:m, m:] -= p.drive
                value[m:, :m] -= p.drive.T
                yield value


@dataclass(frozen=True, eq=False)
class HalfPoint:
    """One point of a side: F = [He(left·X·null) + nullᵀẊnull, drive; ⋆, 0] and its weight E.

    Parameters
    ----------
    left : (m, n) array
        NᵀA with the performance signals, in the coordinates of the side.
    null : (n, m) array
        States' part of the null space of [B2ᵀ D12ᵀ]; F uses its transpose on the left.
    drive : (m, n_w) array
        Disturbances on the null space.
    weight : (m + n_w, m + n_w) array
        E, what γ multiplies.
    """

    left: np.ndarray
    null: np.ndarray
    drive: np.ndarray
    weight: np.ndarray

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by the entries of X of He(left·X·null), and of nullᵀX null.

        Returns
        -------
        (m, m, n²) array
        (m, m, n²) array
            The entries of X row by row.
        """
        m, n = self.left.shape
        half = np.einsum("ai,jb->abij", self.left, self.null).reshape(m, m, n * n)
        return half + half.swapaxes(0, 1), np.einsum("ia,jb->abij", self.null, self.null).reshape(m, m, n * n)


def null_space(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal columns spanning the null space; directions below 1e-10 of the largest count as null.

    Parameters
    ----------
    matrix : (m, n) array
        Any matrix.

    Returns
    -------
    (n, n − rank) array
        The identity's size for a matrix of zeros.
    """
    _, s, vt = np.linalg.svd(matrix)
    rank = int((s > 1e-10 * max(s.max(initial=0.0), 1e-300)).sum())
    return vt[rank:].T


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


def singular(plant: PlantMatrices) -> bool:
    """Some control is limited by nothing at high frequency, or some measurement is exact.

    Parameters
    ----------
    plant : PlantMatrices
        At N points.

    Returns
    -------
    bool
        D12 or D21 passes almost nothing in some direction at some point.
    """
    return any(len(w) for w in _unlimited(plant))


def regular(plant: PlantMatrices, size: float) -> PlantMatrices:
    """The plant with noise of a given size in measurements that are exact, and effort of controls that are free.

    What bounds its gain bounds that of the plant itself.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in balanced units.
    size : float
        Of noise and effort.

    Returns
    -------
    PlantMatrices
        With further disturbances and performance signals where there are such directions.
    """
    return _restrained(plant, size, *_unlimited(plant))


def restrained(plant: PlantMatrices, size: float) -> PlantMatrices:
    """The plant with noise of a given size in every measurement and effort of every control: gains stay moderate.

    Parameters
    ----------
    plant : PlantMatrices
        At N points, in balanced units.
    size : float
        Of noise and effort.

    Returns
    -------
    PlantMatrices
        With n_y more disturbances and n_u more performance signals.
    """
    return _restrained(plant, size, np.eye(plant.B2.shape[2]), np.eye(plant.C2.shape[1]))


def stirred(plant: PlantMatrices, size: float, *, by_controls: bool) -> PlantMatrices:
    """The plant with a disturbance more that enters where the controls do, or a performance signal of what is measured.

    Where disturbances reach only a part of what the controls move, and the measurements show them exactly, the filter's
    Riccati equation has the solution zero: Y = γY∞⁻¹ is not bounded, and no solver ends. What bounds the gain of this
    plant bounds that of the plant itself.

    Parameters
    ----------
    plant : PlantMatrices
    size : float
        Of the disturbance, or the signal, as a share of the plant's own.
    by_controls : bool

    Returns
    -------
    PlantMatrices
    """
    own, like = (plant.B1, plant.B2) if by_controls else (plant.C1, plant.C2)
    largest = float(np.abs(like).max(initial=0.0))
    more = size * float(np.abs(own).max(initial=0.0)) / max(largest, 1e-300) * like
    axis = 2 if by_controls else 1
    through, beside = plant.D11, plant.D21 if by_controls else plant.D12
    zeros = [np.zeros_like(m.take(range(1), axis=axis)).repeat(more.shape[axis], axis=axis) for m in (through, beside)]
    through, beside = (np.concatenate([m, z], axis=axis) for m, z in zip((through, beside), zeros, strict=True))
    wide = np.concatenate([own, more], axis=axis)
    if by_controls:
        return replace(plant, B1=wide, D11=through, D21=beside)
    return replace(plant, C1=wide, D11=through, D12=beside)


def _restrained(plant: PlantMatrices, size: float, effort: np.ndarray, noise: np.ndarray) -> PlantMatrices:
    """Effort of, and noise in, the directions that are given as rows."""
    def wide(m: np.ndarray, more: np.ndarray, axis: int) -> np.ndarray:
        shape = [*m.shape]
        shape[axis] = more.shape[axis - 1]
        return np.concatenate([m, np.broadcast_to(more, shape)], axis=axis)

    through = wide(wide(plant.D11, np.zeros((1, len(noise))), 2), np.zeros((len(effort), 1)), 1)
    return replace(plant, B1=wide(plant.B1, np.zeros((1, len(noise))), 2),
                   C1=wide(plant.C1, np.zeros((len(effort), 1)), 1), D11=through,
                   D12=wide(plant.D12, size * effort, 1), D21=wide(plant.D21, size * noise.T, 2))


def _unlimited(plant: PlantMatrices) -> tuple[np.ndarray, np.ndarray]:
    """Directions, as rows, of which D12 (controls) or D21 (measurements) passes almost nothing at some point."""
    return unlimited(plant.D12), unlimited(plant.D21.swapaxes(1, 2))


def unlimited(through: np.ndarray) -> np.ndarray:
    """(·, n) directions, as rows, of which some of the matrices (N, m, n) passes almost nothing.

    Parameters
    ----------
    through : (N, m, n) array
        One matrix for each point.

    Returns
    -------
    (k, n) array
        Orthonormal rows.
    """
    least = min((m.T @ m for m in through), key=lambda g: float(np.linalg.eigvalsh(g).min(initial=np.inf)))
    values, vectors = np.linalg.eigh(least)
    return vectors.T[values < 1e-12]


def congruent(matrix: Affine, scale: np.ndarray) -> Affine:
    """The matrix between diagonal matrices: diag(s) M diag(s).

    Parameters
    ----------
    matrix : Affine
        (n, n), with its unknowns.
    scale : (n,) array
        The diagonal s.

    Returns
    -------
    Affine
        (n, n), with the same unknowns.
    """
    both = np.outer(scale, scale)
    return Affine(both * matrix.constant, sparse.csr_array(sparse.diags_array(both.ravel()) @ matrix.linear))
