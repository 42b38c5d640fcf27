"""ShapedLoop: a closed loop after the change of variables that makes every synthesis inequality linear.

State feedback, output feedback and estimators differ in what their blocks are made of; bounds on gains and pole regions
(`lpvid.synthesis.criteria`) are written once, in these blocks.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.affine import Affine
from lpvid.scheduling import Basis, Scheduling

Matrix = Affine | np.ndarray


@dataclass(frozen=True, eq=False)
class ShapedLoop:
    """The blocks 𝐗, 𝐀, 𝐁, 𝐂, 𝐃 of a closed loop at one point of the scheduling and one move away from it.

    With V = xᵀ𝒳x and a congruence Π: 𝐗 = Πᵀ𝒳Π, 𝐀 = Πᵀ𝒳A_cl Π, 𝐁 = Πᵀ𝒳B_cl, 𝐂 = C_cl Π, 𝐃 = D_cl (Scherer,
    Gahinet & Chilali 1997). State feedback has Π = 𝒳⁻¹, an observer Π = I.

    Parameters
    ----------
    lyapunov : Affine
        (n, n) 𝐗 now; with a slack matrix in discrete time 𝐆 + 𝐆ᵀ − 𝐗.
    moved : Affine or None
        Discrete time: 𝐗 one sample later. Continuous time: what the motion of the scheduling adds to 𝐀 + 𝐀ᵀ.
    dynamics : Affine
        (n, n) 𝐀.
    entry, exit, through : Affine or array
        (n, n_w) 𝐁, (n_z, n) 𝐂 and (n_z, n_w) 𝐃.
    discrete : bool
    pace : float
        Typical rate [1/s] by which the rows of continuous-time inequalities are scaled.
    turned : bool
        The blocks are those of the transposed loop: 𝐁 is (n, n_z), 𝐂 is (n_w, n) and 𝐃 is (n_w, n_z).
    """

    lyapunov: Affine
    moved: Affine | None
    dynamics: Affine
    entry: Matrix
    exit: Matrix
    through: Matrix
    discrete: bool
    pace: float = 1.0
    turned: bool = False

    @property
    def order(self) -> int:
        """n."""
        return self.dynamics.shape[0]

    def flow(self) -> Affine:
        """(n, n) 𝐀 + 𝐀ᵀ with what the motion of the scheduling adds, per pace (continuous time).

        Returns
        -------
        Affine
            Negative definite where the loop is stable.
        """
        total = self.dynamics + self.dynamics.T
        return (1.0 / self.pace) * (total if self.moved is None else total + self.moved)

    def later(self) -> Affine:
        """(n, n) 𝐗 one sample later (discrete time).

        Returns
        -------
        Affine
            `lyapunov` where nothing moves.
        """
        return self.lyapunov if self.moved is None else self.moved


def moves(box: Scheduling, basis: Basis, point: np.ndarray, sample_time: float | None) -> list[np.ndarray]:
    """What a matrix in `basis` must be compared with, away from one point of the box.

    Parameters
    ----------
    box : Scheduling
    basis : Basis
        Functions of the Lyapunov matrix.
    point : (n_scheduling,) array
    sample_time : float or None

    Returns
    -------
    list of array
        Continuous time: (M,) values of dψ/dt at every corner of the rate bounds. Discrete time: ψ at every corner of
        what p(k+1) can be, with the middle where a polynomial of higher degree needs it. Empty for a constant.
    """
    if not basis.names:
        return []
    index = [box.names.index(n) for n in basis.names]
    if sample_time is None:
        slopes = [basis.derivative(point[None, index], n)[0] for n in basis.names]
        rates = [box.rate[i] or 0.0 for i in index]
        signs = itertools.product(*([-r, r] if r else [0.0] for r in rates))
        return [np.tensordot(np.array(s), np.array(slopes), axes=1) for s in signs]
    ends = []
    for i in index:
        rate = box.rate[i]
        step = np.inf if rate is None else rate * sample_time
        low, high = max(box.lower[i], point[i] - step), min(box.upper[i], point[i] + step)
        ends.append(np.unique(_ends(basis, low, high)))
    return [basis.evaluate(np.array(p)[None])[0] for p in itertools.product(*ends)]


def _ends(basis: Basis, low: float, high: float) -> Sequence[float]:
    """Where a function of one variable on [low, high] must be looked at: an affine one at its ends."""
    return [low, high] if basis.degree == 1 else np.linspace(low, high, 5).tolist()
