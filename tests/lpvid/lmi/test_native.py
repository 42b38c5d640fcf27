"""Clarabel called directly against cvxpy's call of it, closed forms, and numbers that change between solves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from lpvid.lmi.affine import Unknowns, block, he
from lpvid.lmi.native import Conic
from lpvid.lmi.program import Program


def _lyapunov(rng, n=5):
    """Least trace of P ⪰ 0 with AᵀP + PA + Q ⪯ 0: the solution of Lyapunov's equation."""
    a = rng.normal(size=(n, n))
    a -= (np.linalg.eigvals(a).real.max() + 0.5) * np.eye(n)
    root = rng.normal(size=(n, n))
    program = Program()
    p = program.unknowns.symmetric(n)
    program.require(p)
    program.require(-(he(p @ a) + root @ root.T))
    total = np.eye(n)[:1] @ p @ np.eye(n)[:, :1]
    for i in range(1, n):
        total = total + np.eye(n)[i : i + 1] @ p @ np.eye(n)[:, i : i + 1]
    program.minimise(total)
    return program, p, solve_continuous_lyapunov(a.T, -root @ root.T)


def test_lyapunov_equation():
    program, p, exact = _lyapunov(np.random.default_rng(0))
    found = next(program.solve(solvers=("CLARABEL",)))
    assert found.status == "optimal"
    assert found[p] == pytest.approx(exact, rel=1e-5, abs=1e-6 * np.abs(exact).max())


def test_the_same_answer_by_way_of_cvxpy():
    program, _, exact = _lyapunov(np.random.default_rng(1))
    x, status = program._modelled("CLARABEL", {}, {})
    assert status == "optimal" and x is not None
    direct = next(program.solve(solvers=("CLARABEL",)))
    assert direct.objective == pytest.approx(float(np.trace(exact)), rel=1e-6)
    assert direct.x == pytest.approx(x, rel=1e-4, abs=1e-5 * np.abs(x).max())


def test_numbers_change_between_solves():
    """min t, [t θ; θ 1] ⪰ 0 is θ²."""
    program = Program()
    t = program.unknowns.scalar()
    one = np.array([[1.0]])
    program.require(block([[t, 0 * one], [0 * one, one]]),
                    scaled={"theta": block([[0.0 * t, one], [one, 0 * one]])})
    program.minimise(t)
    for theta in (1.0, 3.0, 0.5):
        assert next(program.solve({"theta": theta})).objective == pytest.approx(theta**2, rel=1e-5)


def test_what_has_no_answer_gives_none():
    program = Program()
    t = program.unknowns.scalar()
    program.require(t - 1.0)
    program.require(-t)
    program.minimise(t)
    assert next(program.solve(solvers=("CLARABEL",)), None) is None


def test_a_panic_of_the_solver_is_no_answer(monkeypatch):
    """Clarabel panics where the eigenvalues of an iterate cannot be computed; pyo3 derives that from BaseException."""
    import clarabel

    class PanicException(BaseException):
        pass

    class Broken:
        def __init__(self, *_):
            pass

        def solve(self):
            raise PanicException("Eigval error")

    program = Program()
    t = program.unknowns.scalar()
    program.require(t.times(np.eye(2)) - np.eye(2))
    program.minimise(t)
    monkeypatch.setattr(clarabel, "DefaultSolver", Broken)
    assert next(program.solve(solvers=("CLARABEL",)), None) is None and program.refuted() == 0.0


def test_a_dual_matrix_shows_how_low_the_objective_can_be(rng):
    """max{1, 3} is the least t of tI ⪰ diag(1, 3); whatever z is proposed, no more is ever shown."""
    unknowns = Unknowns()
    t = unknowns.scalar()
    problem = Conic.of([(t.times(np.eye(2)) - np.diag([1.0, 3.0]), {})], t, unknowns.size)
    _, _, z = problem.solve({}, {})
    assert problem.floor({}, z, 30.0) == pytest.approx(3.0, abs=1e-5)
    for _ in range(50):
        assert problem.floor({}, z + rng.normal(size=z.shape), 3.0) <= 3.0 + 1e-9
    assert problem.floor({}, np.full(z.shape, np.nan), 3.0) == -np.inf


def test_no_floor_without_a_dual_or_with_squares():
    program = Program()
    t = program.unknowns.scalar()
    program.require(t - 1.0)
    program.minimise(t)
    answer = next(program.solve(solvers=("CLARABEL",)))
    assert program.floor(answer, 10.0) == pytest.approx(1.0, abs=1e-5)
    assert program.floor(replace(answer, dual=None), 10.0) == -np.inf
    program.minimise(t, squares=t)
    answer = next(program.solve(solvers=("CLARABEL",)))
    assert program.floor(answer, 10.0) == -np.inf
