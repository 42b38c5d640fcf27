"""Semidefinite programs, solved by whatever is installed: Clarabel directly, others through cvxpy (only here).

What comes back is a candidate. The status of a solver proves nothing; `lpvid.lmi.certificate` decides.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from lpvid.lmi import native
from lpvid.lmi.affine import Affine, Unknowns, widened
from lpvid.lmi.suppress_output import quiet

SOLVERS = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT", "SCS")


def available(solvers: Sequence[str]) -> bool:
    """Some of these solvers is installed.

    Parameters
    ----------
    solvers : sequence of str
        Names as in `SOLVERS`.

    Returns
    -------
    bool
        False for none.
    """
    if native.NAME in solvers and native.installed():
        return True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cvxpy as cp

        return any(s in cp.installed_solvers() for s in solvers)


@dataclass(frozen=True, eq=False)
class SolverAnswer:
    """A solver's answer: x of shape (K,), the objective there, its solver and the solver's status.

    Attributes
    ----------
    x : (K,) array
        Values of the unknowns.
    objective : float
        Value at x; 0 for a program without one.
    solver : str
        Name as in `SOLVERS`.
    status : str
        "optimal", "optimal_inaccurate", or the word of cvxpy for another solver.
    dual : array or None
        Of the dual problem, for `Program.floor`; None of another solver than Clarabel.
    """

    x: np.ndarray
    objective: float
    solver: str
    status: str
    dual: np.ndarray | None = None

    def __getitem__(self, matrix: Affine) -> np.ndarray:
        """Value of a matrix of unknowns."""
        return matrix.value(self.x)


class Program:
    """Minimise a scalar subject to F(x) + Σ_k θ_k G_k(x) ⪰ margin·I.

    The θ are named numbers that may change between solves. It is compiled once, at the first `solve`; a sweep over θ
    re-uses that.

    Examples
    --------
    >>> program = Program()
    >>> t = program.unknowns.scalar()
    >>> program.require(t.times(np.eye(2)) - np.diag([1.0, 3.0]))
    >>> program.minimise(t)
    >>> round(next(program.solve()).objective, 4)
    3.0
    """

    def __init__(self) -> None:
        self.unknowns = Unknowns()
        self._required: list[tuple[Affine, dict[str, Affine]]] = []
        self._objective: Affine | None = None
        self._squares: Affine | None = None
        self._ratio: tuple[Affine, Affine, float] | None = None
        self._compiled: tuple[Any, Any, dict[str, Any]] | None = None
        self._conic: native.Conic | None = None

    def require(self, matrix: Affine, *, margin: float = 0.0, scaled: Mapping[str, Affine] | None = None) -> None:
        """matrix + Σ θ_name · scaled[name] ⪰ margin·I (all symmetric).

        Parameters
        ----------
        matrix : Affine
            F(x), symmetric.
        margin : float
            What the smallest eigenvalue must reach.
        scaled : mapping of name to Affine, optional
            G_k by the name of θ_k.
        """
        self._required.append((matrix - margin * np.eye(matrix.shape[0]) if margin else matrix, dict(scaled or {})))
        self._compiled = self._conic = None

    def minimise(self, objective: Affine, squares: Affine | None = None) -> None:
        """Set the (1, 1) objective; half the sum of the squared entries of `squares` is added to it.

        Parameters
        ----------
        objective : (1, 1) Affine
            Takes the place of the one before.
        squares : Affine, optional
            Of any shape.
        """
        self._objective, self._squares, self._compiled, self._conic = objective, squares, None, None
        self._ratio = None

    def maximise_ratio(self, numerator: Affine, denominator: Affine, limit: float = 1.0) -> None:
        """Set the goal numerator/denominator, the second positive wherever the inequalities hold; to be maximised.

        With τ = limit/denominator and y = τx every inequality F₀ + F₁x ⪰ 0 becomes F₀τ + F₁y ⪰ 0, and the ratio is
        the linear numerator of (y, τ), to be maximised where the denominator is at most `limit`: one program (Charnes &
        Cooper, Naval Research Logistics Quarterly 9 (1962) 181-186). Where no ratio above zero exists, there is no
        answer.

        Parameters
        ----------
        numerator, denominator : (1, 1) Affine
        limit : float
            About as large as the denominator, so that τ is near 1.

        Examples
        --------
        >>> program = Program()
        >>> t = program.unknowns.scalar()
        >>> program.require(t - 1.0)
        >>> program.maximise_ratio(t - 1.0, t * 1.0 + 0.0)         # the closer to 1, the larger t
        >>> program.require(4.0 - t)
        >>> round(float(next(program.solve())[t][0, 0]), 3)
        4.0
        """
        self._ratio = numerator, denominator, float(limit)
        self._objective = self._squares = None

    def _homogeneous(self, numerator: Affine, denominator: Affine, limit: float) -> Program:
        """The program in (y, τ)."""
        size, found = self.unknowns.size, Program()
        found.unknowns.matrix(1, size + 1)

        def lifted(matrix: Affine) -> Affine:
            column = sparse.csr_array(matrix.constant.reshape(-1, 1))
            linear: Any = sparse.hstack([widened(matrix.linear, size), column])
            return Affine(np.zeros(matrix.shape), linear.tocsr())

        for matrix, scaled in self._required:
            found.require(lifted(matrix), scaled={name: lifted(part) for name, part in scaled.items()})
        found.require(lifted(Affine(np.ones((1, 1)), sparse.csr_array((1, size)))))
        found.require(limit - lifted(denominator))
        found.minimise(-lifted(numerator))
        return found

    def solve(self, values: Mapping[str, float] | None = None, *, solvers: Sequence[str] = SOLVERS,
              settings: Mapping[str, Mapping[str, Any]] | None = None) -> Iterator[SolverAnswer]:
        """Answers of one solver after the other; the next is only started when the generator is advanced.

        Parameters
        ----------
        values : mapping of name to float, optional
            θ.
        solvers : sequence of str
            In this order, where installed.
        settings : mapping of solver to its options, optional

        Yields
        ------
        SolverAnswer
            Of every solver that is installed and gives finite numbers; none where no solver does.
        """
        if self._ratio is not None:
            for found in self._homogeneous(*self._ratio).solve(values, solvers=solvers, settings=settings):
                if found.objective < 0 < found.x[-1]:
                    yield SolverAnswer(found.x[:-1] / found.x[-1], -found.objective / self._ratio[2], found.solver,
                                       found.status)
            return
        known = {name: float((values or {})[name]) for _, scaled in self._required for name in scaled}
        for solver in solvers:
            options = dict((settings or {}).get(solver, {}))
            if solver == native.NAME and native.installed():
                x, status, dual = self._direct().solve(known, options)
            else:
                (x, status), dual = self._modelled(solver, known, options), None
            if x is not None and np.all(np.isfinite(x)):
                value = float(self._objective.value(x)[0, 0]) if self._objective is not None else 0.0
                if self._squares is not None:
                    value += 0.5 * float(np.sum(self._squares.value(x) ** 2))
                yield SolverAnswer(x, value, solver, status, dual)

    def floor(self, answer: SolverAnswer, times: float) -> float:
        """What the linear objective of a program without θ cannot fall below, for unknowns up to so many times an
        answer's norm.

        Shown by the answer's dual matrices, with numpy (`lpvid.lmi.native.Conic.floor`): how far an answer can be from
        the optimum, whatever its status.

        Parameters
        ----------
        answer : SolverAnswer
            Of this program.
        times : float
            Above 1.

        Returns
        -------
        float
            −∞ where nothing is shown: no dual, no objective, or squares in it.

        Examples
        --------
        >>> program = Program()
        >>> t = program.unknowns.scalar()
        >>> program.require(t.times(np.eye(2)) - np.diag([1.0, 3.0]))
        >>> program.minimise(t)
        >>> answer = next(program.solve(solvers=("CLARABEL",)))
        >>> answer.objective - program.floor(answer, 10.0) < 1e-5
        True
        """
        if answer.dual is None or self._objective is None or self._squares is not None:
            return -np.inf
        radius = times * float(np.linalg.norm(answer.x))
        return float(self._objective.constant[0, 0]) + self._direct().floor({}, answer.dual, radius)

    def refuted(self) -> float:
        """The norm of the unknowns below which the inequalities were shown to have no solution; 0 for nothing shown.

        Shown by a dual matrix that numpy checks (`lpvid.lmi.native.Conic.refuted`), for a program without θ.

        Returns
        -------
        float
            0 also where Clarabel is not installed.

        Examples
        --------
        >>> program = Program()
        >>> t = program.unknowns.scalar()
        >>> program.require(t - 1.0)
        >>> program.refuted()
        0.0
        >>> program.require(0.5 - t)
        >>> program.refuted() > 1e8
        True
        """
        return self._direct().refuted({}) if native.installed() else 0.0

    def prepare(self) -> None:
        """Compile now rather than at the first `solve`, where Clarabel is there."""
        if native.installed():
            self._direct()

    def _direct(self) -> native.Conic:
        if self._conic is None:
            self._conic = native.Conic.of(self._required, self._objective, self.unknowns.size, self._squares)
        return self._conic

    def _modelled(self, solver: str, values: Mapping[str, float], options: Mapping[str, Any]
                  ) -> tuple[np.ndarray | None, str]:
        """An answer by way of cvxpy, and its status; None where the solver is not there or gives none."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import cvxpy as cp

            if solver not in cp.installed_solvers():
                return None, ""
            if self._compiled is None:
                self._compiled = self._compile(cp)
            problem, x, parameters = self._compiled
            for name, parameter in parameters.items():
                parameter.value = values[name]
            try:
                with quiet():
                    problem.solve(solver=solver, **options)
            except (cp.SolverError, ArithmeticError, ValueError):
                return None, ""
        return (None if x.value is None else np.array(x.value, dtype=float)), str(problem.status)

    def _compile(self, cp: Any) -> tuple[Any, Any, dict[str, Any]]:
        size = self.unknowns.size
        x = cp.Variable(size)
        parameters: dict[str, Any] = {}
        constraints = []
        for matrix, scaled in self._required:
            n = matrix.shape[0]
            flat = widened(matrix.linear, size) @ x + matrix.constant.ravel()
            for name, part in scaled.items():
                theta = parameters.setdefault(name, cp.Parameter(name=name))
                flat = flat + theta * (widened(part.linear, size) @ x + part.constant.ravel())
            constraints.append(cp.reshape(flat, (n, n), order="C") >> 0 if n > 1 else flat >= 0)
        goal = 0 if self._objective is None else (widened(self._objective.linear, size) @ x)[0]
        if self._squares is not None:
            goal = goal + 0.5 * cp.sum_squares(widened(self._squares.linear, size) @ x + self._squares.constant.ravel())
        return cp.Problem(cp.Minimize(goal), constraints), x, parameters
