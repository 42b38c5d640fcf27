"""Reduction of unstable systems: by their left coprime factors, which are stable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from lpvid import _checks
from lpvid.analysis.frozen import pole_margins
from lpvid.errors import InputError
from lpvid.lmi.affine import block, he
from lpvid.lmi.program import Program
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis._gramians import frozen_matrices
from lpvid.synthesis.matrix_function import MatrixFunction
from lpvid.synthesis.matrix_function import block as function_block
from lpvid.synthesis.reduction import Reduction, reduce_order
from lpvid.synthesis.shaped_program import INTERIOR_POINT

STRICT = 1e-7
"""margin of the inequality that stabilises the factors, in units where its largest matrix is one"""


@dataclass(frozen=True, eq=False)
class CoprimeReduction:
    """A system with fewer states, and how far its coprime factors are from those of the full one.

    Parameters
    ----------
    model : LPVStateSpace
    factors : Reduction
        Of [N M], with its bound 2Σσ and its frozen error: a controller whose loop withstands perturbations of the
        factors of gain ε (`loop_shaping`) stabilises the full system too where that bound is below ε.
    injection : MatrixFunction
        L(p).
    """

    model: LPVStateSpace
    factors: Reduction
    injection: MatrixFunction

    def __repr__(self) -> str:
        return f"coprime factors: {self.factors}"


def reduce_coprime(system: LPVStateSpace, order: int | None = None, *, tolerance: float = 1e-3, points: int = 5,
                   certified: bool = True) -> CoprimeReduction:
    """Fewer states for a system that need not be stable.

    G = M⁻¹N with [N M] = (A + LC, [B + LD  L], C, [D I]), stable for every scheduling; the factors are reduced as
    `reduce_order` does it, and G_r = M_r⁻¹N_r = (A_r − L_rC_r, B_r − L_rD, C_r, D) has their states (Wood, Goddard &
    Glover, CDC 1996). L = −YCᵀ with one Y of A Y + Y Aᵀ − Y CᵀC Y + B Bᵀ ≺ 0 at all points of the grid, for which [N M]
    is contractive where D = 0; where the Riccati equation for the mean of the grid stabilises all of it, that is used.

    Parameters
    ----------
    system : LPVStateSpace
        Detectable with one observer over the grid.
    order, tolerance, points, certified
        As for `reduce_order`.

    Returns
    -------
    CoprimeReduction
        Reduced system, the reduction of its factors with bound and error, and the injection L(p).

    Raises
    ------
    InputError
        No common injection makes the factors stable.
    NumericalError
        As for `reduce_order`.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> system = LPVStateSpace([np.diag([1.0, -30.0]), np.diag([0.5, 0.0])], [[[1.0], [1.0]], [[0.0], [0.0]]],
    ...                        [[[1.0, 1.0]], [[0.0, 0.0]]], np.zeros((2, 1, 1)), Polynomial("p", 1), None)
    >>> found = reduce_coprime(system, 1)
    >>> found.model.order, found.factors.error <= found.factors.bound < 0.1
    (1, True)
    """
    _checks.instance(system, LPVStateSpace, "a reduction is of a state space",
                     'lpv.realize(model, form="augmented").model')
    grid = system.box.grid(points)
    a, b, c, _ = frozen_matrices(system, grid)
    discrete = system.sample_time is not None
    own = {n: MatrixFunction(system.basis, getattr(system, n)) for n in "ABCD"}
    injection = _injection(own["C"], a, b, c, discrete)
    if injection is None:
        raise InputError("no common injection makes the coprime factors stable over the grid",
                         got=f"{len(grid)} points", mend="narrow the range, or measure more")
    ny = system.n_outputs
    whole = function_block([[own["A"] + injection @ own["C"], own["B"] + injection @ own["D"], injection],
                            [own["C"], own["D"], np.eye(ny)]])
    corrections = tuple(Signal(f"correction of {s.name}", s.unit) for s in system.outputs)
    factors = LPVStateSpace.of(whole.coefficients, system.order, whole.basis, system.sample_time, system.scheduling,
                               inputs=(*system.filter_inputs, *corrections), outputs=system.outputs)
    reduced = reduce_order(factors, order, tolerance=tolerance, points=points, certified=certified)
    small, nu = reduced.model, system.n_filter_inputs
    part = {"A": small.A, "B": small.B[:, :, :nu], "L": small.B[:, :, nu:], "C": small.C, "D": small.D[:, :, :nu]}
    f = {name: MatrixFunction(small.basis, value) for name, value in part.items()}
    back = function_block([[f["A"] - f["L"] @ f["C"], f["B"] - f["L"] @ f["D"]], [f["C"], f["D"]]]).trimmed()
    model = LPVStateSpace.of(back.coefficients, small.order, back.basis, system.sample_time, system.scheduling,
                             inputs=system.filter_inputs, outputs=system.outputs)
    return CoprimeReduction(model, reduced, injection)


def _injection(c_of: MatrixFunction, a: np.ndarray, b: np.ndarray, c: np.ndarray, discrete: bool
               ) -> MatrixFunction | None:
    """L(p) that makes A + LC stable at every point; None where none was found."""
    mean_a, mean_b, mean_c = (x.mean(axis=0) for x in (a, b, c))
    q = mean_b @ mean_b.T
    q = q + 1e-9 * max(float(np.trace(q)), 1e-12) * np.eye(len(q))
    try:
        if discrete:
            y = solve_discrete_are(mean_a.T, mean_c.T, q, np.eye(len(mean_c)))
            gain = -np.linalg.solve(np.eye(len(mean_c)) + mean_c @ y @ mean_c.T, mean_c @ y @ mean_a.T).T
            law = MatrixFunction.constant(gain)
            found = np.broadcast_to(gain, (len(a), *gain.shape))
        else:
            y = solve_continuous_are(mean_a.T, mean_c.T, q, np.eye(len(mean_c)))
            law, found = _transposed(c_of, -y), -y @ c.swapaxes(1, 2)
        if pole_margins(a + found @ c, discrete).max() < 0:
            return law
    except (np.linalg.LinAlgError, ValueError):
        pass
    y = None if discrete else _common(a, b, c)
    stable = y is not None and pole_margins(a - y @ c.swapaxes(1, 2) @ c, discrete).max() < 0
    return _transposed(c_of, -y) if y is not None and stable else None


def _transposed(c: MatrixFunction, left: np.ndarray) -> MatrixFunction:
    """left · C(p)ᵀ."""
    return MatrixFunction(c.basis, left @ c.coefficients.swapaxes(1, 2))


def _common(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray | None:
    """Y with A Y + Y Aᵀ − Y CᵀC Y + B Bᵀ ≺ 0 at every point, by R = Y⁻¹: [AᵀR + RA − CᵀC, RB; ⋆, −I] ≺ 0."""
    n, m = a.shape[1], b.shape[2]
    program = Program()
    r, t = program.unknowns.symmetric(n), program.unknowns.scalar()
    program.require(block([[r, np.eye(n)], [np.eye(n), t.times(np.eye(n))]]))   # Y ⪯ t I
    for x, y, z in zip(a, b, c, strict=True):
        program.require(block([[z.T @ z - he(x.T @ r), -(r @ y)], [-(r @ y).T, np.eye(m)]]), margin=STRICT)
    program.minimise(t)
    for found in program.solve(solvers=INTERIOR_POINT):
        values = found[r]
        if np.linalg.eigvalsh(values)[0] > 0:
            return np.linalg.inv(values)
    return None
