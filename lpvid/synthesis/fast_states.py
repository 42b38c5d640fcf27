"""A controller without the states that are faster than anything in its plant.

Where controls are cheap or measurements exact the inequalities have answers whose controllers have poles far beyond the
plant's, which no sampled target can run. In coordinates x_K = W [s; f] that split the slow from the fast modes of the
mean of A_K(p), the fast ones are replaced by their static gain at every p (residualisation; Fernando & Nicholson 1982),

    A_r = A_ss − A_sf A_ff⁻¹ A_fs,    B_r = B_s − A_sf A_ff⁻¹ B_f,
    C_r = C_s − C_f A_ff⁻¹ A_fs,      D_r = D − C_f A_ff⁻¹ B_f.

What the loop then keeps is not inferred: its bounded-real inequality is solved for one storage function, in states in
which the old one, on the slow manifold f = −A_ff⁻¹(A_fs s + B_f y), is the identity. The check by eigenvalues is
that of every other controller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur, solve_sylvester

from lpvid.lmi.affine import he
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.controller_formula import ControllerFormula, Variations
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop_at
from lpvid.synthesis.loop_check import LoopStorage, frozen_gain
from lpvid.synthesis.projected_half import congruent
from lpvid.synthesis.scaling import Matrices

FAST = 10.0
"""Times the plant's fastest pole, beyond which a state of the controller counts as fast: up to that pole its response
differs from its static gain by at most |1/(1 + j/10) - 1|, a tenth."""


@dataclass(frozen=True, eq=False)
class SlowFormula:
    """A formula with its fast states replaced by their static gain, and the storage function of its loop.

    Parameters
    ----------
    full : ControllerFormula
        With X and Y that do not move.
    split : (n, n) array
        W: the states of `full` are W [s; f].
    slow : int
        How many s are.
    root : (n_x + slow, n_x + slow) array
        T with V = ‖T⁻¹ [x; s]‖².
    gamma : float
        Bound for which the storage function was found.
    """

    full: ControllerFormula
    split: np.ndarray
    slow: int
    root: np.ndarray
    gamma: float

    @property
    def plant(self) -> BalancedPlant:
        """The plant."""
        return self.full.plant

    @property
    def variations(self) -> Variations:
        """Of X and Y: none."""
        return self.full.variations

    def at(self, points: np.ndarray) -> tuple[Matrices, np.ndarray]:
        """The controller at points; its A_K does not depend on the rates.

        Parameters
        ----------
        points : (N, n_scheduling) array

        Returns
        -------
        (A, B, C, D), each (N, …)
        (N, 0, slow, slow) array
        """
        k, slopes = self.full.at(points)
        return residual(k, self.split, self.slow)[0], slopes[:, :, : self.slow, : self.slow]

    def storage(self, points: np.ndarray) -> LoopStorage:
        """Of the closed loop with [x; s], the same at all points.

        Parameters
        ----------
        points : (N, n_scheduling) array

        Returns
        -------
        LoopStorage
        """
        m, corners = len(self.root), len(self.variations.corners)
        first, second = np.broadcast_to(np.eye(m), (len(points), m, m)), np.zeros((len(points), 0, 0))
        return LoopStorage(first, second, np.zeros((len(points), corners, m, m)),
                           np.zeros((len(points), corners, 0, 0)), self.root)


def residual(k: Matrices, split: np.ndarray, slow: int) -> tuple[Matrices, np.ndarray]:
    """Controllers with the states behind `slow` of W⁻¹x_K at rest.

    Parameters
    ----------
    k : (A, B, C, D), each (N, …)
    split : (n, n) array
        W.
    slow : int
        How many states are kept.

    Returns
    -------
    (A, B, C, D), each (N, …)
    (N, n − slow, slow + n_y) array
        F of f = F [s; y], the states at rest.
    """
    back = np.linalg.inv(split)
    a, b, c, d = back @ k[0] @ split, back @ k[1], k[2] @ split, k[3]
    rest = -np.linalg.solve(a[:, slow:, slow:], np.concatenate([a[:, slow:, :slow], b[:, slow:]], axis=2))
    f, g = rest[:, :, :slow], rest[:, :, slow:]
    return (a[:, :slow, :slow] + a[:, :slow, slow:] @ f, b[:, :slow] + a[:, :slow, slow:] @ g,
            c[:, :, :slow] + c[:, :, slow:] @ f, d + c[:, :, slow:] @ g), rest


def fastest_pole(formula: ControllerFormula, points: np.ndarray) -> float:
    """Largest modulus of the plant's frozen poles, its weights' included.

    Parameters
    ----------
    formula : ControllerFormula
        With its plant.
    points : (N, n_scheduling) array

    Returns
    -------
    float
        [rad/s]
    """
    a = formula.plant.plant.at(points).A
    return float(np.abs(np.linalg.eigvals(a)).max(initial=0.0))


def too_fast(plant: GeneralizedPlant, controller: LPVStateSpace, points: np.ndarray,
             beside: LPVStateSpace | None = None) -> bool:
    """Whether a controller in continuous time has frozen poles `FAST` times faster than every pole of the plant.

    Parameters
    ----------
    plant : GeneralizedPlant
    controller : LPVStateSpace
        Scheduled on some of the plant's variables.
    points : (N, n_scheduling) array
        Over the plant's box.
    beside : LPVStateSpace, optional
        Another controller of the plant, whose poles count beside the plant's.

    Returns
    -------
    bool
        False in discrete time.
    """
    if plant.sample_time is not None or not controller.order:
        return False

    def fastest(system: LPVStateSpace) -> float:
        own = points[:, [plant.box.names.index(n) for n in system.basis.names]]
        return float(np.abs(np.linalg.eigvals(system.at(own)[0])).max(initial=0.0))

    limit = max(fastest(s) for s in (plant.system, beside) if s is not None)
    return fastest(controller) > FAST * limit > 0


def without_fast_states(formula: ControllerFormula, points: np.ndarray, allowed: float, held: float,
                        settled: bool) -> SlowFormula | None:
    """The formula without its states that are `FAST` times faster than every pole of the plant, or as many as may go.

    The fewest states are kept with which no frozen loop has more than the gain `held`. Only for them a storage function
    is looked for: a semidefinite program of the loop's own size takes longer than everything before it.

    Parameters
    ----------
    formula : ControllerFormula
        Of a continuous plant, with X and Y that do not move.
    points : (N, n_scheduling) array
        Where the bounded-real inequality of the loop is imposed.
    allowed : float
        The largest bound that is worth having.
    held : float
        The largest gain with the scheduling held: what rolls off is not given away for a bound that has room for it.
    settled : bool
        The points cover the box: the least bound is looked for. Otherwise the storage function with the largest margin
        at a bound half way to the allowed one.

    Returns
    -------
    SlowFormula or None
        None where no state is fast, where none may go, or where no storage function was found.
    """
    k, plant = formula.at(points)[0], formula.plant.plant.at(points)
    mean, limit = k[0].mean(axis=0), FAST * fastest_pole(formula, points)
    n, speeds = len(mean), np.sort(np.abs(np.linalg.eigvals(mean)))
    for slow in range(int((speeds <= limit).sum()), n):
        split = _split(mean, slow, speeds)
        if split is None:
            continue
        try:
            small, rest = residual(k, split, slow)
            loops = close_loop_at(plant, *small)
            if not frozen_gain(loops) <= held:
                continue
            found = _least(loops, _on_manifold(formula, plant.C2, points, split, rest), allowed, settled)
        except np.linalg.LinAlgError:
            continue
        return None if found is None else SlowFormula(formula, split, slow, *found)
    return None


def _split(a: np.ndarray, slow: int, speeds: np.ndarray) -> np.ndarray | None:
    """W with W⁻¹AW = diag(A_s, A_f), the slowest first; None where a pair of poles would be torn apart."""
    if slow and speeds[slow] <= speeds[slow - 1] * (1 + 1e-9):
        return None
    cut = np.sqrt(speeds[slow] * speeds[slow - 1]) if slow else 0.0
    t, z, *counted = schur(a, sort=lambda x, y=0.0: np.hypot(x, y) < cut)
    count = int(counted[0])
    if count != slow:
        return None
    n, part = len(a), np.eye(len(a))
    if 0 < slow < n:
        part[:slow, slow:] = solve_sylvester(t[:slow, :slow], -t[slow:, slow:], -t[:slow, slow:])
    split = z @ part
    return split / np.linalg.norm(split, axis=0)


def _on_manifold(formula: ControllerFormula, c2: np.ndarray, points: np.ndarray, split: np.ndarray, rest: np.ndarray
                 ) -> np.ndarray:
    """T with ‖T⁻¹[x; s]‖² the old storage function where the fast states are at rest, at the mean of the points."""
    v, n, slow = formula.storage(points), len(formula.inner), rest.shape[2] - c2.shape[1]
    f = rest.mean(axis=0)
    fast = split[:, slow:] @ f
    onto = np.block([[np.eye(n), np.zeros((n, slow))],
                     [fast[:, slow:] @ c2.mean(axis=0), split[:, :slow] + fast[:, :slow]]])
    roots = [np.linalg.cholesky(m.mean(axis=0)).T for m in (v.first, v.second)]
    back = np.linalg.solve(v.mix, onto)
    r = np.linalg.qr(np.vstack([roots[0] @ back[:n], roots[1] @ back[n:]]), mode="r")
    return np.linalg.inv(r)


def _least(loops: Matrices, start: np.ndarray, allowed: float, settled: bool) -> tuple[np.ndarray, float] | None:
    """T of one storage function of all loops (N, …), and the bound it was found for; None above the allowed one."""
    found = _solved(loops, start, None)
    if found is None or found[1] > allowed:
        return None
    return found if settled else _solved(loops, start, float(np.sqrt(found[1] * allowed)))


def _solved(loops: Matrices, start: np.ndarray, gamma: float | None) -> tuple[np.ndarray, float] | None:
    """min γ, or the largest margin at a γ, of [−He(PA) −PB −Cᵀ; ⋆ γI −Dᵀ; ⋆ ⋆ γI] ⪰ 0, rows of A of size one."""
    program, back = Program(), np.linalg.inv(start)
    p, level = program.unknowns.symmetric(len(start)), program.unknowns.scalar()
    for a, b, c, d in zip(back @ loops[0] @ start, back @ loops[1], loops[2] @ start, loops[3], strict=True):
        n, w, z = len(a), b.shape[1], len(c)
        supply = np.diag(np.r_[np.zeros(n), np.ones(w + z)])
        known = np.block([[np.zeros((n, n + w)), c.T], [np.zeros((w, n + w)), d.T], [c, d, np.zeros((z, z))]])
        unknown = he(np.eye(n + w + z)[:, :n] @ p @ np.hstack([a, b, np.zeros((n, z))]))
        scale = np.concatenate([1 / np.sqrt(np.maximum(np.linalg.norm(a, axis=1), 1e-300)), np.ones(w + z)])
        if gamma is None:
            program.require(congruent(level.times(supply) - unknown - known, scale))
        else:
            program.require(congruent(gamma * supply - unknown - known, scale) - level.times(np.eye(len(scale))))
    program.minimise(level if gamma is None else -level)
    answer = next(program.solve(solvers=("CLARABEL",)), None)
    if answer is None:
        return None
    root = start @ np.linalg.inv(np.linalg.cholesky(answer[p])).T
    return root, float(answer.objective) if gamma is None else gamma
