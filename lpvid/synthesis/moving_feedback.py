"""Discrete output feedback whose Lyapunov matrix moves: P(p) now, P(p⁺) one sample later, and slack matrices between.

With the dual Lyapunov matrix P of the closed loop and a slack matrix G, for all p and every p⁺ that one sample can lead
to (de Oliveira, Geromel & Bernussou, Systems & Control Letters 2002; with scheduling: De Caigny, Camino, Oliveira,
Peres & Swevers, IET Control Theory & Applications 2010 and Int. J. Robust Nonlinear Control 2012),

    [ P(p⁺)   A_cl G(p)     B_cl   0          ]
    [ ⋆       G + Gᵀ − P    0      GᵀC_clᵀ    ] ≻ 0.                                                            (1)
    [ ⋆       ⋆             γI     D_clᵀ      ]
    [ ⋆       ⋆             ⋆      γI         ]

The controller's matrices multiply G, not P, so P(p) and P(p⁺) may differ. With T = [I Zᵀ; 0 Nᵀ] and G T = [X I; U 0],

    𝐆 = TᵀGT = [X I; S Z],  S = ZX + NU,        𝐏 = TᵀPT,
    TᵀA_cl G T = [AX + B2L  A + B2RC2; Q  ZA + FC2],  TᵀB_cl = [B1 + B2RD21; ZB1 + FD21],
    C_cl G T = [C1X + D12L  C1 + D12RC2],  D_cl = D11 + D12RD21

are affine in 𝐏(p), X(p), S(p), Q(p), F(p), L(p), R(p) and constant Z. T is constant, for it stands on both sides of a
sample; X and S are not. The controller at p needs p alone:

    D_K = R,  C_K = (L − RC2X)U⁻¹,  B_K = N⁻¹(F − ZB2R),  A_K = N⁻¹(Q − Z(A + B2RC2)X − NB_KC2X − ZB2C_KU)U⁻¹.

det 𝐆 = ± det(ZX − S), so that N and U = N⁻¹(S − ZX) are as well conditioned as 𝐏 ⪯ 𝐆 + 𝐆ᵀ lets them be. With P = G
constant, (1) is the inequality of one quadratic X and Y: what moves can only help, as far as Q, F, L and R are free.

Turned, the same inequalities of the transposed plant with p and p⁺ exchanged: then Y(p) moves and X is constant. In
either, 𝐏(p) moves as a whole; Z is a slack alone. With a Z(p) as well, Z⁺ takes its place in TᵀA_cl G T, and the factor
of it can wait for the next sample, so that a controller of twice the states reads p alone. On six springs and eight
random plants with a moving B2 and C2 its least bounds were 0.0 to 1.0 % below the lower of the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.lmi.affine import Affine, block, combined
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial
from lpvid.synthesis.bilinear import around_feedthrough
from lpvid.synthesis.criteria import Criterion, HInfinity
from lpvid.synthesis.design_grid import columns, fitted, richer, storage_for, tensor
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_functions import written
from lpvid.synthesis.polytope import Polytope
from lpvid.synthesis.reconstruction import dual
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.scaling import Matrices
from lpvid.synthesis.shaped_design import KEPT, ShapedProblem, Values, settle
from lpvid.synthesis.shaped_loop import ShapedLoop, moves
from lpvid.synthesis.shaped_program import Shaped, Shaping, SignalCoordinates, size_and_condition

ABOVE = 1.05
"""Factor by which the proven gain may lie above the promise: between the points of a grid (1) misses it by 1 to 2 % for
two variables, less for one. With the back-off it stays within the tenth that `OutputFeedback` calls solved."""


def moving_feedback(plant: GeneralizedPlant, lyapunov: Basis, axes: tuple[np.ndarray, ...], *, turned: bool = False,
                    strictly_proper: bool = False, bound: float | None = None, back_off: float = 0.01,
                    criteria: Sequence[Criterion] = (), polytope: Polytope | None = None) -> Synthesis:
    """The controller of inequality (1) for a discrete plant, with the verified figures of its closed loop.

    Parameters
    ----------
    plant : GeneralizedPlant
        In discrete time. A variable of its box without a rate may jump from one sample to the next.
    lyapunov : Basis
        Functions of 𝐏(p), X(p) and S(p), bound to the plant's box.
    axes : tuple of arrays
        Values of each scheduling variable at which (1) is imposed.
    turned : bool
        Y(p) moves and X is constant; otherwise X(p) moves and Y is constant.
    strictly_proper : bool
        No feedthrough D_K. There is none either where controls reach the measurements directly: a D_K that moves
        would form a loop with D22 whose solution is no finite sum over a basis.
    bound : float, optional
        A gain that is good enough; left out, the least.
    back_off : float
        Share by which the bound is raised above the least one, for a controller of moderate gains.
    criteria : sequence of HInfinity, H2 or GeneralizedH2
        In place of one gain; they share P and G. Those of the covariance need `turned` to be false.
    polytope : Polytope, optional
        The scheduling set where that is no box, of a plant whose controller can be affine (`Polytope.full_order`). P is
        of degree one, X and S are constants too: (1) is then affine in p and p⁺ together, so that the vertices with
        every corner of a step, or every pair of them, cover the set, and the controller is affine.

    Returns
    -------
    Synthesis
        With a note where D22 kept the controller from having feedthrough.
    """
    axes = _with_kinks(plant, lyapunov, axes)
    raw = plant.at(tensor(axes) if polytope is None else polytope.vertices)
    coordinates = SignalCoordinates.of(raw, True)
    gains = richer(plant, lyapunov, axes) if polytope is None else Polynomial(plant.box.names, 1).bound(plant.box)
    direct = not strictly_proper and not raw.D22.any()
    found = settle(_Moving(plant, tuple(criteria) or (HInfinity(bound=bound),), (), 1 + back_off, lyapunov, gains, axes,
                           turned, direct, coordinates, polytope=polytope), kept=ABOVE if bound is None else KEPT)
    if direct or strictly_proper:
        return found
    return replace(found, notes=(*found.notes, "controls reach the measurements directly: no feedthrough in the "
                                               "controller"))


def lowest(moving: Sequence[Synthesis], constant: Synthesis) -> Synthesis:
    """The lowest verified gain of designs whose matrices move, and of one whose do not, which a note compares.

    Parameters
    ----------
    moving : sequence of Synthesis
        Of matrices that move; at least one.
    constant : Synthesis
        Of a constant X and Y.

    Returns
    -------
    Synthesis
        One of them with a note; where none gave a controller the first of `moving` that is not shown to be infeasible.
    """
    solved = [s for s in moving if s.gamma_verified is not None]
    best = min(solved, key=_verified, default=None)
    if best is None:
        failed = next((s for s in moving if s.verdict != "infeasible"), moving[0])  # all of them, or it is not shown
        why = f"matrices that move gave no controller ({failed.verdict}: {failed.why})"
        if not constant.solved:
            return replace(failed, notes=(f"nor does a constant X and Y ({constant.verdict}): {constant.why}",))
        return replace(constant, notes=(f"X and Y are constants: {why}", *constant.notes))
    if not constant.solved:
        note = f"a constant X and Y gave no controller ({constant.verdict}: {constant.why})"
        return replace(best, notes=(note, *best.notes))
    where = f"on the whole {constant.region}" if constant.between_grid else "at the points of a grid"
    if _verified(constant) < _verified(best):
        note = f"X and Y are constants: matrices that move gave {_verified(best):.6g}, which is more"
        return replace(constant, notes=(note, *constant.notes))
    note = f"a constant X and Y keep {_verified(constant):.6g} {where}, for scheduling that jumps"
    return replace(best, notes=(note, *best.notes))


def _verified(found: Synthesis) -> float:
    return np.inf if found.gamma_verified is None else found.gamma_verified


@dataclass(frozen=True, eq=False)
class _Moving(ShapedProblem):
    """One discrete plant with moving Lyapunov and slack matrices, in scaled coordinates."""

    lyapunov: Basis
    gains: Basis
    axes: tuple[np.ndarray, ...]
    turned: bool
    direct: bool
    coordinates: SignalCoordinates

    @property
    def method(self) -> str:
        which = "P" if self.polytope is not None else "P and Y" if self.turned else "P and X"
        over = "" if self.polytope is None else f" on {self.polytope.text}"
        return f"output feedback, {which} over {', '.join(self.lyapunov.labels)}, {len(self.points)} points{over}"

    @property
    def points(self) -> np.ndarray:
        """(N, n_scheduling) where (1) stands."""
        return tensor(self.axes) if self.polytope is None else self.polytope.vertices

    @property
    def slack(self) -> Basis:
        """Functions of X and S."""
        return self.lyapunov if self.polytope is None else Polynomial((), 0)

    @property
    def remedy(self) -> str:
        return (f"raise the bound, lower the weights on {', '.join(self.plant.performance)}, or tighten the rate "
                "bounds of the scheduling")

    @property
    def storage(self) -> Basis | None:
        return storage_for(self.lyapunov) if self.polytope is None else self.lyapunov

    def storage_of(self, shaped: Shaped) -> Values:
        z, n = _split(self, shaped)
        order = len(z)
        t = np.block([[np.eye(order), z.T], [np.zeros((order, order)), n.T]])
        back = np.diag(np.concatenate([1 / self.coordinates.states, np.ones(order)]))
        into = back @ (np.linalg.inv(t).T if self.turned else t)

        def values(points: np.ndarray) -> np.ndarray:
            p = self._at(shaped, "lyapunov", points)
            return into @ (p if self.turned else np.linalg.inv(p)) @ into.T

        return values

    def blocks_of(self, shaped: Shaped) -> None:
        return None

    def build(self, program: Program, scale: float) -> Shaping:
        box, points = self.plant.box, self.points
        design = self._design(points)
        new, n, nu, ny = program.unknowns, self.plant.order, design.B2.shape[2], design.C2.shape[1]
        p = [new.symmetric(2 * n) for _ in range(self.lyapunov.size)]
        x, s = ([new.matrix(n, n) for _ in range(self.slack.size)] for _ in range(2))
        z = new.matrix(n, n)
        shapes = {"Q": (n, n), "F": (n, ny), "L": (nu, n)} | ({"R": (nu, ny)} if self.direct else {})
        hats = {name: [new.matrix(*shape) for _ in range(self.gains.size)] for name, shape in shapes.items()}
        psi, phi, chi = (columns(box, basis, points) for basis in (self.lyapunov, self.gains, self.slack))
        loops, above, below = [], [], [z]
        for k, point in enumerate(points):
            here = {name: combined(h, phi[k]) for name, h in hats.items()}
            slack = block([[combined(x, chi[k]), np.eye(n)], [combined(s, chi[k]), z]])
            now = combined(p, psi[k])
            above.append(now)
            below += [combined(x, chi[k]), combined(s, chi[k]), *here.values()]
            for step in (moves(box, self.lyapunov, point, self.plant.sample_time) if self.polytope is None
                         else self.polytope.steps(self.lyapunov, point, psi, self.plant.sample_time)):
                later = combined(p, step)
                first, second = (now, later) if self.turned else (later, now)
                loops.append(_loop(design.point(k), combined(x, chi[k]), z, here, slack + slack.T - second, first,
                                   self.turned))
        return Shaping(tuple(loops), size_and_condition(program, above=above, below=below), {
            "lyapunov": tuple(p), "X": tuple(x), "S": tuple(s), "Z": (z,), **{k: tuple(h) for k, h in hats.items()}})

    def controller(self, shaped: Shaped) -> LPVStateSpace:
        plant, order = self.plant, self.plant.order

        def law(points: np.ndarray) -> np.ndarray:
            a, b, c, d = self._physical(self._controller_at(shaped, points), points)
            return np.block([[a, b], [c, d]])

        if self.polytope is not None:
            inverse = np.linalg.pinv(columns(plant.box, self.gains, self.points))
            return written(plant, np.tensordot(inverse, law(self.points), axes=1), order, self.gains)
        basis, k = fitted(law, plant.box, self.axes, self.gains)
        return written(plant, k, order, basis)

    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        return close_loop(self.plant, controller)

    def _design(self, points: np.ndarray) -> PlantMatrices:
        """What (1) is written for: the scaled plant, or its transpose."""
        scaled = self.coordinates.scaled(self.plant.at(points))
        return dual(scaled) if self.turned else scaled

    def _at(self, shaped: Shaped, name: str, points: np.ndarray) -> np.ndarray:
        """(N, …) values of an unknown matrix function."""
        basis = self.lyapunov if name == "lyapunov" else self.slack if name in ("X", "S") else self.gains
        return np.tensordot(columns(self.plant.box, basis, points), shaped.values(name), axes=1)

    def _controller_at(self, shaped: Shaped, points: np.ndarray) -> Matrices:
        """(N, …) the controller of the scaled plant, or of its transpose."""
        m, (z, n) = self._design(points), _split(self, shaped)
        x, q, f, command = (self._at(shaped, name, points) for name in "XQFL")
        back = np.linalg.inv(n)
        u = back @ (self._at(shaped, "S", points) - z @ x)
        right = np.linalg.inv(u)
        d = self._at(shaped, "R", points) if self.direct else np.zeros((len(x), command.shape[1], f.shape[2]))
        c = (command - d @ m.C2 @ x) @ right
        b = back @ (f - z @ m.B2 @ d)
        a = back @ (q - z @ (m.A + m.B2 @ d @ m.C2) @ x - n @ b @ m.C2 @ x - z @ m.B2 @ c @ u) @ right
        return a, b, c, d

    def _physical(self, k: Matrices, points: np.ndarray) -> Matrices:
        """A controller of the design's plant in the plant's own signals, around its D22."""
        a, b, c, d = k
        if self.turned:
            a, b, c, d = (m.swapaxes(1, 2) for m in (a, c, b, d))
        scaled = self.coordinates.scaled(self.plant.at(points))
        a, b, c, d = around_feedthrough((a, b, c, d), scaled.D22)
        u, y = self.coordinates.controls[:, None], self.coordinates.measurements
        return a, b / y, u * c, u * d / y


def _loop(m: PlantMatrices, x: Affine, z: Affine, hats: dict[str, Affine], tail: Affine, first: Affine,
          turned: bool) -> ShapedLoop:
    """The blocks of (1) at one point and one move."""
    q, f, command = hats["Q"], hats["F"], hats["L"]
    through: Affine | np.ndarray = m.D11
    a, b, c = m.A, m.B1, m.C1
    if "R" in hats:
        r = hats["R"]
        a, b, c = m.A + m.B2 @ r @ m.C2, m.B1 + m.B2 @ r @ m.D21, m.C1 + m.D12 @ r @ m.C2
        through = m.D11 + m.D12 @ r @ m.D21
    return ShapedLoop(tail, first, block([[m.A @ x + m.B2 @ command, a], [q, z @ m.A + f @ m.C2]]),
                      block([[b], [z @ m.B1 + f @ m.D21]]), block([[m.C1 @ x + m.D12 @ command, c]]), through, True,
                      turned=turned)


def _with_kinks(plant: GeneralizedPlant, lyapunov: Basis, axes: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Axes with the values from which one sample just reaches an end of the box.

    The pairs (p, p⁺) fill a polygon whose corners these are: a grid without them leaves the pairs that start there
    outside of the hull of those it looks at.
    """
    found = []
    for name, axis, low, high, rate in zip(plant.box.names, axes, plant.box.lower, plant.box.upper, plant.box.rate,
                                           strict=True):
        step = np.inf if rate is None else rate * (plant.sample_time or 0.0)
        more = [low + step, high - step] if name in lyapunov.names and 0 < step < high - low else []
        found.append(np.unique(np.concatenate([axis, more])))
    return tuple(found)


def _split(problem: _Moving, shaped: Shaped) -> tuple[np.ndarray, np.ndarray]:
    """Z and N, with the mean of S − ZX = N U over the design points split evenly between N and U."""
    z, points = shaped.values("Z")[0], problem.points
    mean = (problem._at(shaped, "S", points) - z @ problem._at(shaped, "X", points)).mean(axis=0)
    u, s, _ = np.linalg.svd(mean)
    if not s.min() > 1e-12 * s.max():
        raise np.linalg.LinAlgError("S − ZX is singular")
    return z, u * np.sqrt(s)
