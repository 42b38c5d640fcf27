"""The scaled bounded-real lemma: gain bounds of linear fractional forms by multipliers that commute with Δ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.affine import Affine, block, block_diagonal, given, he
from lpvid.lmi.program import Program
from lpvid.model.lft import LFTModel
from lpvid.synthesis.shaped_program import INTERIOR_POINT

RISE = 1e-3
"""Relative amount above the solver's γ at which its matrices are checked; from a tenth of it up to a hundredfold."""


@dataclass(frozen=True, eq=False)
class ScaledGain:
    """A bound of the induced L2 gain for every trajectory of the scheduling, however fast.

    Parameters
    ----------
    gamma : float
        Re-checked with numpy; infinite where nothing was found.
    lyapunov, scaling, skew : arrays
        P (n, n), S ≻ 0 and T = −Tᵀ (r, r) that prove it.
    margin : float
        Smallest eigenvalue of the inequality, of which the rounding errors were taken away.
    solver : str
    """

    gamma: float
    lyapunov: np.ndarray
    scaling: np.ndarray
    skew: np.ndarray
    margin: float
    solver: str = ""


def scaled_gain(model: LFTModel) -> ScaledGain:
    """The least γ with P ≻ 0, S ≻ 0, T = −Tᵀ commuting with Δ and, for continuous time,

    [He(PA), PB_p, PB_w; ⋆, 0, 0; ⋆, ⋆, −γI] + [C_q D_qp D_qw; 0 I 0]ᵀ [S, T; Tᵀ, −S] [C_q D_qp D_qw; 0 I 0]
    + [C_z D_zp D_zw]ᵀ γ⁻¹ [C_z D_zp D_zw] ≺ 0 (equations sheet, 5.5).

    Parameters
    ----------
    model : LFTModel
        |δ_i| ≤ 1 are real and repeated.

    Returns
    -------
    ScaledGain
        The first solver's matrices that pass the check.

    Examples
    --------
    >>> from lpvid.scheduling import Scheduling
    >>> box = Scheduling(("p",), (-1.0,), (1.0,))               # ẋ = −(2 + p) x + w, z = x: gain 1
    >>> form = LFTModel(np.array([[-2.0, -1.0, 1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 1, box, (1,), None)
    >>> round(scaled_gain(form).gamma, 2)
    1.0
    """
    program = Program()
    n, r = model.order, model.width
    p = program.unknowns.symmetric(n)
    new = program.unknowns
    s, t = (commuting(declared, model.repetitions) for declared in (new.symmetric, new.antisymmetric))
    level = program.unknowns.scalar()
    program.require(p, margin=1e-9)
    if r:
        program.require(s, margin=1e-9)
    program.require(_inequality(model, p, s, t, level), margin=1e-9)
    program.minimise(level)
    for found in program.solve(solvers=INTERIOR_POINT):
        values = found[p], found[s], found[t]
        least = float(found[level][0, 0])
        for k in range(4):
            gamma = least * (1 + RISE * 10.0 ** (k - 1))
            margin = recheck_scaled(model, *values, gamma)
            if margin > 0:
                return ScaledGain(gamma, *values, margin, found.solver)
    return ScaledGain(np.inf, np.zeros((n, n)), np.zeros((r, r)), np.zeros((r, r)), -np.inf)


def recheck_scaled(model: LFTModel, p: np.ndarray, s: np.ndarray, t: np.ndarray, gamma: float) -> float:
    """Smallest eigenvalue of P, S and the inequality, less a bound of the rounding errors; numpy alone.

    Parameters
    ----------
    model : LFTModel
        What is bounded.
    p : (n, n) array
        Lyapunov matrix P.
    s, t : (r, r) array
        Multipliers S = Sᵀ and T = −Tᵀ, which commute with Δ.
    gamma : float
        Bound of the gain.

    Returns
    -------
    float
        Positive: the bound is proven.
    """
    whole = _inequality(model, given(p), given(s), given(t), given(gamma)).constant
    parts = [part for part in (p, s, whole) if len(part)]
    rounding = [50 * len(part) * np.finfo(float).eps * np.abs(part).max() for part in parts]
    lowest = [float(np.linalg.eigvalsh(0.5 * (part + part.T))[0]) for part in parts]
    return min(low - error for low, error in zip(lowest, rounding, strict=True))


def _inequality(model: LFTModel, p: Affine, s: Affine, t: Affine, level: Affine) -> Affine:
    """(·, ·) minus the scaled bounded-real matrix, with γ⁻¹ by a Schur complement."""
    ahead, seen, out = (np.hstack([model.part(row, c) for c in "xpu"]) for row in "xqy")
    total = scaled_form(ahead, seen, p, s, level, discrete=model.is_discrete, skew=t)
    return block([[-total, -out.T], [-out, level.times(np.eye(len(out)))]])


def scaled_form(ahead: np.ndarray, seen: np.ndarray, p: Affine, s: Affine, level: Affine, *, discrete: bool,
                skew: Affine | None = None) -> Affine:
    """The scaled bounded-real form over (x, p, w), without the output.

    Parameters
    ----------
    ahead, seen : (n, m) and (r, m) array
        What (x, p, w) does to x⁺ (ẋ) and to q.
    p, s : (n, n) and (r, r) Affine
        Lyapunov matrix and multiplier.
    level : (1, 1) Affine
        Bound of the gain.
    discrete : bool
        Discrete time.
    skew : (r, r) Affine, optional
        T = −Tᵀ.

    Returns
    -------
    (m, m) Affine
        Symmetric; with the output below it, negative definite for a gain below the level.
    """
    n, r, eye = len(ahead), len(seen), np.eye(ahead.shape[1])
    state, inner, last = eye[:n], eye[n : n + r], eye[n + r :]
    total = ahead.T @ p @ ahead - state.T @ p @ state if discrete else he(state.T @ p @ ahead)
    if r:
        total = total + seen.T @ s @ seen - inner.T @ s @ inner
    if r and skew is not None:
        skewed = seen.T @ skew @ inner
        total = total + skewed + skewed.T
    return total - level.times(last.T @ last)


def commuting(declared: Callable[[int], Affine], repetitions: Sequence[int]) -> Affine:
    """A matrix of full blocks on the diagonal, which commutes with diag(δ_i I_{r_i}).

    Parameters
    ----------
    declared : callable
        Declares a block of a given order.
    repetitions : sequence of int
        r_i.

    Returns
    -------
    Affine
        (0, 0) where nothing is repeated.
    """
    return block_diagonal([declared(k) for k in repetitions if k])
