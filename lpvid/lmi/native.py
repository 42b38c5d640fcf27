"""Clarabel called directly: a matrix inequality is already in the solver's form, and a modelling layer takes as long
to find that out as the solver takes to solve it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine, widened

NAME = "CLARABEL"
STATUS = {"Solved": "optimal", "AlmostSolved": "optimal_inaccurate"}
"""What the solver's own words are called elsewhere; every other word means no answer."""

PANIC = "PanicException"
"""what the solver raises where its own arithmetic breaks down; no subclass of Exception"""


def installed() -> bool:
    """Clarabel can be imported.

    Returns
    -------
    bool
        Nothing is imported for the answer.
    """
    return find_spec("clarabel") is not None


@dataclass(frozen=True, eq=False)
class Conic:
    """Minimise ½xᵀHx + cᵀx subject to b − Ax in a product of cones, with A = A_0 + Σ θ_k A_k and b alike.

    Parameters
    ----------
    parts : mapping of name to (A, b)
        "" stands for A_0, b_0.
    sizes : sequence of int
        Orders of the symmetric matrices, one cone each.
    c : (K,) array
    h : (K, K) sparse array
        H, positive semidefinite.
    """

    parts: Mapping[str, tuple[Any, np.ndarray]]
    sizes: Sequence[int]
    c: np.ndarray
    h: Any

    @classmethod
    def of(cls, required: Sequence[tuple[Affine, Mapping[str, Affine]]], objective: Affine | None, size: int,
           squares: Affine | None = None) -> Conic:
        """From F(x) + Σ θ_k G_k(x) ⪰ 0 for each of `required`; half the sum of `squares` is added to the objective.

        Parameters
        ----------
        required : sequence of (Affine, mapping of name to Affine)
            F, and G_k by the name of θ_k; symmetric.
        objective : (1, 1) Affine or None
            What is minimised; None for nothing.
        size : int
            K, number of unknowns.
        squares : Affine, optional
            Its entries are squared.

        Returns
        -------
        Conic
            For any values of θ.

        Examples
        --------
        >>> from lpvid.lmi.affine import Unknowns
        >>> unknowns = Unknowns()
        >>> t = unknowns.scalar()
        >>> problem = Conic.of([(t.times(np.eye(2)) - np.diag([1.0, 3.0]), {})], t, unknowns.size)
        >>> x, status, z = problem.solve({}, {})
        >>> x.round(4), status, round(problem.floor({}, z, 10.0), 4)
        (array([3.]), 'optimal', 3.0)
        """
        sizes = [matrix.shape[0] for matrix, _ in required]
        names = dict.fromkeys(["", *(name for _, scaled in required for name in scaled)])
        parts = {name: _stacked([matrix if name == "" else scaled.get(name) for matrix, scaled in required],
                                sizes, size) for name in names}
        goal = np.zeros(size)
        if objective is not None:
            goal[: objective.linear.shape[1]] = objective.linear.toarray().ravel()
        curved: Any = sparse.csc_array((size, size))
        if squares is not None:
            wide = widened(squares.linear, size)
            curved = sparse.csc_array(wide.T @ wide)
            goal += wide.T @ squares.constant.ravel()
        return cls(parts, sizes, goal, curved)

    def solve(self, values: Mapping[str, float], options: Mapping[str, Any]
              ) -> tuple[np.ndarray | None, str, np.ndarray | None]:
        """x, or None, the status and the dual matrices.

        Parameters
        ----------
        values : mapping of name to float
            θ.
        options : mapping
            Settings of Clarabel, by name.

        Returns
        -------
        (K,) array or None
            None where the solver gives no answer.
        str
            "optimal" or "optimal_inaccurate"; empty without an answer.
        array or None
            z of the dual problem, as b − Ax is stacked; for `floor`.
        """
        found = self._run(values, options)
        status = STATUS.get(str(found.status), "")
        if not status:
            return None, status, None
        return np.array(found.x, dtype=float), status, np.array(found.z, dtype=float)

    def floor(self, values: Mapping[str, float], z: np.ndarray, radius: float) -> float:
        """What cᵀx cannot fall below where the constraints hold and ‖x‖ ≤ radius, as a dual z shows; H must be zero.

        With z in the dual cone, cᵀx ≥ cᵀx − zᵀ(b − Ax) = −bᵀz + (c + Aᵀz)ᵀx (weak duality). The solver proposes z; its
        nearest point of the cone and both products are computed here.

        Parameters
        ----------
        values : mapping of name to float
            θ.
        z : array
            As `solve` gives it.
        radius : float
            Of the ball of unknowns that are looked at.

        Returns
        -------
        float
            −∞ where z is not finite.
        """
        if not np.all(np.isfinite(z)):
            return -np.inf
        a, b = self._assembled(values)
        z = _into_cone(z, self.sizes)
        return -float(b @ z) - radius * float(np.linalg.norm(self.c + a.T @ z))

    def refuted(self, values: Mapping[str, float]) -> float:
        """The norm of x below which the constraints were shown to have no solution; 0 where nothing was shown.

        A z in the dual cone with bᵀz < 0 proves it (Farkas): b − Ax in the cone gives 0 ≤ zᵀ(b − Ax), so that
        ‖x‖ ≥ −bᵀz / ‖Aᵀz‖. The solver proposes z; its cone and both products are computed here.

        Parameters
        ----------
        values : mapping of name to float
            θ.

        Returns
        -------
        float
            In the unit of the unknowns.
        """
        found = self._run(values, {})
        z = np.array(found.z, dtype=float)
        if not len(z) or not np.all(np.isfinite(z)):
            return 0.0
        a, b = self._assembled(values)
        z = _polished(sparse.csr_array(a).toarray(), z / max(np.linalg.norm(z), 1e-300), self.sizes)
        gap, slack = -float(b @ z), float(np.linalg.norm(a.T @ z))
        rounding = 1e-14 * float(np.abs(b) @ np.abs(z))
        return gap / max(slack, 1e-300) if gap > rounding else 0.0

    def _assembled(self, values: Mapping[str, float]) -> tuple[Any, np.ndarray]:
        a, b = self.parts[""]
        for name, (more, extra) in self.parts.items():
            if name:
                a, b = a + values[name] * more, b + values[name] * extra
        return a, b

    def _run(self, values: Mapping[str, float], options: Mapping[str, Any]) -> Any:
        clarabel: Any = import_module("clarabel")
        a, b = self._assembled(values)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1  # the same numbers; threads of the factorization wait for each other at these sizes
        for name, value in options.items():
            setattr(settings, name, value)
        cones = [clarabel.PSDTriangleConeT(n) if n > 1 else clarabel.NonnegativeConeT(1) for n in self.sizes if n]
        matrix = sparse.csc_matrix(a)
        matrix.sort_indices()
        curved = sparse.csc_matrix(sparse.triu(self.h))
        try:
            return clarabel.DefaultSolver(curved, self.c, matrix, b, cones, settings).solve()
        except BaseException as error:  # a panic inside the solver (eigenvalues of a matrix that is not finite)
            if type(error).__name__ != PANIC:
                raise
            return SimpleNamespace(status=PANIC, x=[], z=[])


POLISHES = 30
"""alternating projections; each halves what is left where z lies within its face of the cone"""


def _polished(a: np.ndarray, z: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """A point of the cone near z with Aᵀz as small as alternating projections make it (Boyle & Dykstra 1986)."""
    q, _ = np.linalg.qr(a)
    z = _into_cone(z, sizes)
    for _ in range(POLISHES):
        z = _into_cone(z - q @ (q.T @ z), sizes)
        z = z / max(float(np.linalg.norm(z)), 1e-300)
    return z


def _into_cone(z: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """The nearest point of the product of cones, each of which is its own dual."""
    out, at = np.zeros_like(z), 0
    for n in (n for n in sizes if n):
        length = n * (n + 1) // 2
        columns, rows = np.tril_indices(n)
        weight = np.where(rows == columns, 1.0, np.sqrt(2.0))
        part = np.zeros((n, n))
        part[rows, columns] = z[at : at + length] / weight
        part[columns, rows] = part[rows, columns]
        values, vectors = np.linalg.eigh(part)
        part = (vectors * np.maximum(values, 0.0)) @ vectors.T
        out[at : at + length] = part[rows, columns] * weight
        at += length
    return out


def _stacked(matrices: Sequence[Affine | None], sizes: Sequence[int], size: int) -> tuple[Any, np.ndarray]:
    """A and b of b − Ax: every matrix's upper triangle, column by column, off-diagonal entries times √2.

    Both triangles count half. All entries go into one sparse matrix: an own one for each is a hundred times dearer.
    """
    places: list[np.ndarray] = [np.zeros(0, dtype=int)]
    unknowns: list[np.ndarray] = [np.zeros(0, dtype=int)]
    data: list[np.ndarray] = [np.zeros(0)]
    constants: list[np.ndarray] = [np.zeros(0)]
    first = 0
    for matrix, n in zip(matrices, sizes, strict=True):
        columns, rows = np.tril_indices(n)
        weight = np.where(rows == columns, 1.0, np.sqrt(2.0)) / 2
        if matrix is None:
            constants.append(np.zeros(len(rows)))
        else:
            place, share = np.empty((n, n), dtype=int), np.empty((n, n))
            place[rows, columns] = place[columns, rows] = first + np.arange(len(rows))
            share[rows, columns] = share[columns, rows] = np.where(rows == columns, 1.0, weight)
            linear = matrix.linear.tocsr()
            at = np.repeat(np.arange(n * n), np.diff(linear.indptr))
            places.append(place.ravel()[at])
            unknowns.append(linear.indices)
            data.append(-share.ravel()[at] * linear.data)
            constants.append(weight * (matrix.constant[rows, columns] + matrix.constant[columns, rows]))
        first += len(rows)
    entries = (np.concatenate(data), (np.concatenate(places), np.concatenate(unknowns)))
    return sparse.csc_array(sparse.coo_array(entries, shape=(first, size))), np.concatenate(constants)
