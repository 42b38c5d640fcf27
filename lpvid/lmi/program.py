"""Semidefinite programs, solved by whatever is installed: the only module that imports cvxpy.

What comes back is a candidate. The status of a solver proves nothing; `lpvid.lmi.certificate` decides.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

SOLVERS = ("CLARABEL", "MOSEK", "SDPA", "CVXOPT", "SCS")


@dataclass(frozen=True, eq=False)
class Inequality:
    """F(x) − weight·t·I ⪰ 0 with F(x) = constant + Σ_i x_i linear[:, :, i], symmetric.

    Parameters
    ----------
    constant : (n, n) array
    linear : (n, n, K) array
    weight : float
        Share of the common margin t that this inequality must keep.
    """

    constant: np.ndarray
    linear: np.ndarray
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A solver's answer, to be checked: x of shape (K,), and the margin it believes in."""

    x: np.ndarray
    margin: float
    solver: str


def largest_margin(inequalities: Sequence[Inequality], *, solvers: Sequence[str] = SOLVERS) -> Iterator[Candidate]:
    """Maximise the common margin t of linear matrix inequalities, one solver after the other.

    Parameters
    ----------
    inequalities : sequence of Inequality
        They must bound t from above.
    solvers : sequence of str
        Tried in this order, where installed. Take the first candidate that passes the check; the next solver is only
        started when the generator is asked again.

    Yields
    ------
    Candidate

    Examples
    --------
    >>> import numpy as np
    >>> one = np.ones((1, 1, 1))
    >>> best = next(largest_margin([Inequality(np.zeros((1, 1)), one), Inequality(np.eye(1), -one)]))  # x, 1 − x ⪰ t
    >>> round(best.margin, 4)
    0.5
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cvxpy as cp

        x, t = cp.Variable(inequalities[0].linear.shape[2]), cp.Variable()
        constraints: list[cp.Constraint] = [_constraint(cp, inequality, x, t) for inequality in inequalities]
        problem = cp.Problem(cp.Maximize(t), constraints)
        available = cp.installed_solvers()
    for solver in (s for s in solvers if s in available):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                problem.solve(solver=solver)
        except (cp.SolverError, ArithmeticError, ValueError):
            continue
        if x.value is not None and t.value is not None and np.all(np.isfinite(x.value)):
            yield Candidate(np.array(x.value, dtype=float), float(t.value), solver)


def _constraint(cp, inequality: Inequality, x, t):
    n = len(inequality.constant)
    flat = inequality.linear.reshape(n * n, -1) @ x + inequality.constant.reshape(-1)
    matrix = cp.reshape(flat, (n, n), order="C")
    return (matrix - inequality.weight * t * np.eye(n) if inequality.weight else matrix) >> 0
