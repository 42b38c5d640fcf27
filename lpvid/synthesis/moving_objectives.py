"""Several criteria by output feedback while a Lyapunov matrix moves, in continuous time.

With 𝐗 = [X, I; I, Y] of Scherer, Gahinet & Chilali 1997 and I − YX = N Mᵀ, what the motion adds to 𝐀 + 𝐀ᵀ is

    [−Ẋ   −(ẊY + ṀNᵀ)]
    [⋆     Ẏ         ]

of which the part off the diagonal would make the controller read the rates (Apkarian & Adams 1998). It is zero where
one of the two is constant with its factor: Y and N, or X and M. The controller at p then needs p alone:

    D_K = R,  C_K = (L − RC2X)M⁻ᵀ,  B_K = N⁻¹(F − YB2R),
    A_K = N⁻¹(Q − Y(A + B2RC2)X − NB_KC2X − YB2C_KMᵀ)M⁻ᵀ.

Where both move, A_K has what takes that part back, N⁻¹(YẊ + NṀᵀ)M⁻ᵀ: affine in the rates, which the controller reads
as further scheduling variables. With N moving and M constant it is N⁻¹YẊM⁻ᵀ. The inequalities with both contain those
with either.

All criteria share X and Y, as with constant ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.lmi.affine import block, combined
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.bilinear import around_feedthrough
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.controller_table import rated_box, with_rates
from lpvid.synthesis.criteria import Criterion
from lpvid.synthesis.design_grid import columns, fitted, richer, storage_for, tensor
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_functions import named
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.scaling import Matrices
from lpvid.synthesis.shaped_design import ShapedProblem, Values, settle
from lpvid.synthesis.shaped_loop import ShapedLoop, moves
from lpvid.synthesis.shaped_program import APART, Shaped, Shaping, SignalCoordinates

KEPT = 1.03
"""Factor by which a verified figure may lie above the promise: matrices that hold at the points of a grid miss it by up
to 2 % between them, with a controller that is a polynomial fit."""
WHICH = {"controls": "X", "measurements": "Y", "both": "X and Y"}


def moving_objectives(plant: GeneralizedPlant, criteria: Sequence[Criterion], lyapunov: Basis,
                      axes: tuple[np.ndarray, ...], *, varying: str, direct: bool, back_off: float) -> Synthesis:
    """The controller for several criteria of a continuous plant with rate bounds, with the figures of its loop.

    Parameters
    ----------
    plant : GeneralizedPlant
    criteria : sequence of HInfinity, H2 or GeneralizedH2
    lyapunov : Basis
        Functions of the matrix that moves, bound to the plant's box.
    axes : tuple of arrays
        Values of each scheduling variable at which the inequalities are imposed.
    varying : {"controls", "measurements", "both"}
        Whether X moves, or Y, or both; with both the controller reads the rates.
    direct : bool
        With feedthrough.
    back_off : float
        Factor above the lowest level.

    Returns
    -------
    Synthesis
    """
    raw = plant.at(tensor(axes))
    coordinates = SignalCoordinates.of(raw, False)
    return settle(_MovingObjectives(plant, tuple(criteria), (), back_off, lyapunov, richer(plant, lyapunov, axes), axes,
                                    varying, direct and not raw.D22.any(), coordinates), kept=KEPT)


@dataclass(frozen=True, eq=False)
class _MovingObjectives(ShapedProblem):
    """One plant with X, Y or both over the scheduling, in scaled coordinates."""

    lyapunov: Basis
    gains: Basis
    axes: tuple[np.ndarray, ...]
    varying: str
    direct: bool
    coordinates: SignalCoordinates

    @property
    def method(self) -> str:
        return (f"output feedback, {len(self.criteria)} criteria, {WHICH[self.varying]} over "
                f"{', '.join(self.lyapunov.labels)}, {len(tensor(self.axes))} points")

    @property
    def remedy(self) -> str:
        return (f"raise the bounds, lower the weights on {', '.join(self.plant.performance)}, tighten the rate bounds "
                "of the scheduling, or measure more")

    @property
    def storage(self) -> Basis | None:
        return storage_for(self.lyapunov)

    def blocks_of(self, shaped: Shaped) -> None:
        return None

    def storage_of(self, shaped: Shaped) -> Values:
        n = self.plant.order
        scale = np.concatenate([1 / self.coordinates.states, np.ones(n)])

        def values(points: np.ndarray) -> np.ndarray:
            x, y, nn, mt = self._factors(shaped, points)
            eye, zero = np.broadcast_to(np.eye(n), x.shape), np.zeros_like(x)
            first = np.concatenate([np.concatenate([x, eye], 2), np.concatenate([mt, zero], 2)], 1)
            second = np.concatenate([np.concatenate([eye, y], 2), np.concatenate([zero, nn.swapaxes(1, 2)], 2)], 1)
            p = second @ np.linalg.inv(first)
            return scale[:, None] * 0.5 * (p + p.swapaxes(1, 2)) * scale

        return values

    def build(self, program: Program, scale: float) -> Shaping:
        points, box, pace = tensor(self.axes), self.plant.box, self.coordinates.pace
        design = self.coordinates.scaled(self.plant.at(points))
        new, n, nu, ny = program.unknowns, self.plant.order, design.B2.shape[2], design.C2.shape[1]
        many = (1 if self.varying == "measurements" else self.lyapunov.size,
                1 if self.varying == "controls" else self.lyapunov.size)
        x, y = ([new.symmetric(n) for _ in range(count)] for count in many)
        shapes = {"Q": (n, n), "F": (n, ny), "L": (nu, n)} | ({"R": (nu, ny)} if self.direct else {})
        hats = {name: [new.matrix(*shape) for _ in range(self.gains.size)] for name, shape in shapes.items()}
        psi, phi = (columns(box, basis, points) for basis in (self.lyapunov, self.gains))
        t, apart = new.scalar(), new.scalar()
        program.require(APART - apart)
        loops: list[ShapedLoop] = []
        eye, zero = np.eye(n), np.zeros((n, n))
        for k, point in enumerate(points):
            m = design.point(k)
            xk, yk = (combined(v, psi[k]) if len(v) > 1 else v[0] for v in (x, y))
            here = {name: combined(h, phi[k]) for name, h in hats.items()}
            a, b, c, d = m.A, m.B1, m.C1, m.D11
            if self.direct:
                r = here["R"]
                a, b, c, d = (a + m.B2 @ r @ m.C2, b + m.B2 @ r @ m.D21, c + m.D12 @ r @ m.C2, d + m.D12 @ r @ m.D21)
            dynamics = block([[m.A @ xk + m.B2 @ here["L"], a], [here["Q"], yk @ m.A + here["F"] @ m.C2]])
            entry, exit_ = block([[b], [yk @ m.B1 + here["F"] @ m.D21]]), block([[m.C1 @ xk + m.D12 @ here["L"], c]])
            whole = block([[xk, eye], [eye, yk]])
            for step in moves(box, self.lyapunov, point, None):
                moved = block([[combined(x, -step) if len(x) > 1 else zero, zero],
                               [zero, combined(y, step) if len(y) > 1 else zero]])
                loops.append(ShapedLoop(whole, moved, dynamics, entry, exit_, d, False, pace))
            pushed = apart.times(eye)
            program.require(block([[xk, pushed], [pushed, yk]]))
            for matrix in (xk, yk):
                program.require(t.times(eye) - matrix)
            for matrix in here.values():
                rows, width = matrix.shape
                program.require(block([[t.times(np.eye(rows)), matrix], [matrix.T, t.times(np.eye(width))]]))
        return Shaping(tuple(loops), t, {"X": tuple(x), "Y": tuple(y), **{k: tuple(h) for k, h in hats.items()}},
                       apart - 1.0)

    def controller(self, shaped: Shaped) -> LPVStateSpace:
        plant, order, moving = self.plant, self.plant.order, self.moving

        def law(points: np.ndarray) -> np.ndarray:
            a, b, c, d = self._controller_at(shaped, points)
            scaled = self.coordinates.scaled(plant.at(points))
            a, b, c, d = around_feedthrough((a, b, c, d), scaled.D22)
            u, y = self.coordinates.controls[:, None], self.coordinates.measurements
            slopes = self._slopes(shaped, points)
            parts = [np.concatenate([a, b / y], 2), np.concatenate([u * c, u * d / y], 2)]
            return np.concatenate([*parts, *(np.concatenate([s, 0 * b], 2) for s in slopes)], 1)

        basis, k = fitted(law, plant.box, self.axes, self.gains)
        rows, box = order + len(plant.controls), plant.box
        matrices = k[:, :order, :order], k[:, :order, order:], k[:, order:rows, :order], k[:, order:rows, order:]
        if moving:
            slopes = k[:, rows:, :order].reshape(len(k), len(moving), order, order)
            basis, matrices = with_rates(basis, matrices, slopes, moving)
            box = rated_box(box, moving)
        return LPVStateSpace(*matrices, basis, None, box.part(basis.names), inputs=named(plant, plant.measurements),
                             outputs=named(plant, plant.controls))

    @property
    def moving(self) -> tuple[str, ...]:
        """Variables whose rates the controller reads."""
        return Variations(self.lyapunov, self.varying, self.plant.box).moving if self.varying == "both" else ()

    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        return close_loop(self.plant, controller)

    def _at(self, shaped: Shaped, name: str, points: np.ndarray) -> np.ndarray:
        """(N, …) values of an unknown matrix function."""
        values = shaped.values(name)
        if len(values) == 1 and name in "XY":
            return np.broadcast_to(values[0], (len(points), *values.shape[1:]))
        basis = self.lyapunov if name in "XY" else self.gains
        return np.tensordot(columns(self.plant.box, basis, points), values, axes=1)

    def _factors(self, shaped: Shaped, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """X, Y, N and Mᵀ at points (N, …): the mean of I − YX over the design is split evenly between the two."""
        def product(at: np.ndarray) -> np.ndarray:
            return np.eye(self.plant.order) - self._at(shaped, "Y", at) @ self._at(shaped, "X", at)

        u, s, vt = np.linalg.svd(product(tensor(self.axes)).mean(axis=0))
        if not s.min(initial=1.0) > 1e-12 * s.max(initial=1.0):
            raise np.linalg.LinAlgError("I − YX is singular")
        x, y, whole = self._at(shaped, "X", points), self._at(shaped, "Y", points), product(points)
        if self.varying != "controls":
            mt = np.broadcast_to(np.sqrt(s)[:, None] * vt, x.shape)
            return x, y, whole @ np.linalg.inv(mt), mt
        n = np.broadcast_to(u * np.sqrt(s), x.shape)
        return x, y, n, np.linalg.inv(n) @ whole

    def _controller_at(self, shaped: Shaped, points: np.ndarray) -> Matrices:
        """(N, …) the controller of the scaled plant, which reads y − D22u."""
        m = self.coordinates.scaled(self.plant.at(points))
        x, y, n, mt = self._factors(shaped, points)
        q, f, command = (self._at(shaped, name, points) for name in "QFL")
        left, right = np.linalg.inv(n), np.linalg.inv(mt)
        d = self._at(shaped, "R", points) if self.direct else np.zeros((len(x), command.shape[1], f.shape[2]))
        c = (command - d @ m.C2 @ x) @ right
        b = left @ (f - y @ m.B2 @ d)
        a = left @ (q - y @ (m.A + m.B2 @ d @ m.C2) @ x - n @ b @ m.C2 @ x - y @ m.B2 @ c @ mt) @ right
        return a, b, c, d

    def _slopes(self, shaped: Shaped, points: np.ndarray) -> list[np.ndarray]:
        """(N, n, n) ∂A_K/∂ṗ = N⁻¹ Y (∂X/∂p) M⁻ᵀ for every variable whose rate the controller reads."""
        if not self.moving:
            return []
        _, y, n, mt = self._factors(shaped, points)
        gradients = Variations(self.lyapunov, self.varying, self.plant.box).gradients(points)
        x = np.einsum("nvk,kij->nvij", gradients, shaped.values("X"))
        return [np.linalg.solve(n, y @ x[:, i]) @ np.linalg.inv(mt) for i in range(len(self.moving))]
