"""Anti-windup: feedback of the difference between wanted and given controls to the controller's states."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, block_diagonal, combined, given, trace
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.design_grid import columns, design_axes, finer, is_affine, tensor
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.saturated import Limits, SaturatedController, saturate
from lpvid.synthesis.shaped_program import INTERIOR_POINT

RISES = (1.001, 1.01, 1.05, 1.2)
"""Factors above the solver's bound at which the numpy check is tried."""
LARGEST = 1e3
"""Largest entry of E times the deadzone's scale that is looked for, relative to that scale."""


@dataclass(frozen=True, eq=False)
class AntiWindup:
    """An anti-windup gain and the verified figures of the limited loop.

    Parameters
    ----------
    verdict : str
        "solved" or "infeasible".
    gamma : float
        Bound of the L2 gain w → z of the loop with limits, re-checked with numpy; infinite where there is none.
    energy : float or None
        ∫|w|² up to which the bound holds; None: for every disturbance.
    saturated : SaturatedController or None
        The controller behind its limits, with the gain.
    between_grid : bool
        The bound holds on the whole scheduling box.
    why, mend : str
    """

    verdict: str
    gamma: float
    energy: float | None
    saturated: SaturatedController | None
    between_grid: bool
    why: str
    mend: str = ""

    def __repr__(self) -> str:
        if self.saturated is None:
            return f"{self.verdict}: {self.why}\n  mend: {self.mend}"
        reach = "every disturbance" if self.energy is None else f"disturbances of energy up to {self.energy:g}"
        where = "on the whole box" if self.between_grid else "at the points of a grid only"
        return f"{self.verdict}: with limits the gain is at most {self.gamma:.6g} for {reach}, {where}\n  {self.why}"


def anti_windup(plant: GeneralizedPlant, controller: LPVStateSpace, limits: Limits, *, energy: float | None = None,
                points: int = 5) -> AntiWindup:
    """The gain E that keeps the L2 gain of the limited loop smallest.

    With the deadzone φ = v − u, Q = P⁻¹ and U diagonal, the sector condition φᵀU⁻¹(v − Hx − φ) ≥ 0 gives (Gomes da
    Silva & Tarbouriech 2005; Mulder, Kothare & Morari 2001)

        [He(AQ), B_φU + (C_vQ − Y)ᵀ, B, QCᵀ; ⋆, −2U, D_v, −(D12U)ᵀ; ⋆, ⋆, −I, Dᵀ; ⋆, ⋆, ⋆, −γ²I] ≺ 0,

    B_φU = −[B2U; Z], E = Z U⁻¹; globally Y = 0, locally Y = HQ with [Q, Y_iᵀ; Y_i, ū_i²/energy] ⪰ 0.

    Parameters
    ----------
    plant : GeneralizedPlant
        D22 = 0.
    controller : LPVStateSpace
        Stabilises the plant without limits.
    limits : mapping of control to its largest modulus or (lower, upper)
        For the local bound the smaller of the two distances from zero counts.
    energy : float, optional
        ∫|w|² to allow for; left out, a bound for every disturbance, which an unstable plant cannot have.
    points : int
        Grid points per scheduling variable, where corners are not enough.

    Returns
    -------
    AntiWindup
        Infeasible, with why and mend, where no gain bounds the loop; an outcome, no error.

    Raises
    ------
    InputError
        A plant with D22, signals that do not match.
    """
    if plant.at(plant.box.grid(2)).D22.any():
        raise InputError("anti-windup needs a plant whose controls do not reach the measurements directly",
                         got=", ".join(plant.controls), mend="put a fast lag before the measurements")
    if energy is not None:
        _checks.positive(energy, "the energy of the disturbances")
    shape = saturate(controller, limits)
    corners = is_affine(plant.system.basis) and not controller.box.names
    axes = design_axes(plant.box, points, corners)
    problem = _Limited(plant, controller, tensor(axes), shape, energy)
    fine = problem if corners else _Limited(plant, controller, tensor(finer(axes, 3)), shape, energy)
    for level, values in problem.answers():
        for rise in RISES:
            if fine.slack(values, level * rise**2) > 0:
                gain = problem.gain(values)
                return AntiWindup("solved", math.sqrt(level) * rise, energy, saturate(controller, limits, gain),
                                  corners, f"sector condition, E of norm {np.abs(gain).max(initial=0.0):.3g}")
    if energy is None:
        return AntiWindup("infeasible", math.inf, None, None, False, "no gain bounds the loop with limits for every "
                          "disturbance", "give the energy of the disturbances: an unstable plant, or one with an "
                          "integrator, has only a local bound")
    return AntiWindup("infeasible", math.inf, energy, None, False, "no gain bounds the loop with limits for "
                      f"disturbances of energy {energy:g}", "lower the energy, or widen the limits")


def back_calculation(controller: LPVStateSpace, limits: Limits, time_constant: float) -> SaturatedController:
    """The classical form: v follows u with a time constant, E = C_K⁺/T (of the controller in the middle of its box).

    Parameters
    ----------
    controller : LPVStateSpace
    limits : mapping
    time_constant : float
        T [s]; in discrete time v comes back by T_s/T per sample, at most at once.

    Returns
    -------
    SaturatedController
        The controller behind its limits, with one gain E for the whole box.
    """
    t = _checks.positive(time_constant, "the time constant of back-calculation", "s")
    c = controller.frozen(controller.box.centre)[2]
    share = 1 / t if controller.sample_time is None else min(controller.sample_time / t, 1.0)
    return saturate(controller, limits, share * np.linalg.pinv(c))


@dataclass(frozen=True, eq=False)
class _Limited:
    """The loop with a deadzone, at points of the scheduling."""

    plant: GeneralizedPlant
    controller: LPVStateSpace
    points: np.ndarray
    law: SaturatedController
    energy: float | None

    def answers(self) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
        """γ² and the matrices Q, U, Y (one) and Z (one per function of the controller's basis)."""
        program = Program()
        new, nk, nu = program.unknowns, self.controller.order, len(self.plant.controls)
        n = self.plant.order + nk
        q, level = new.symmetric(n), new.scalar()
        u = block_diagonal([new.scalar() for _ in range(nu)])
        y = None if self.energy is None else new.matrix(nu, n)
        z = [new.matrix(nk, nu) for _ in range(self.controller.basis.size)]
        for matrix in self._inequalities(q, u, y, z, level):
            program.require(matrix, margin=1e-9)
        for part in z:  # E = Z U⁻¹ stays moderate
            if nk:
                tall = [[LARGEST * u, part.T], [part, (LARGEST * trace(u)).times(np.eye(nk))]]
                program.require(block(tall))
        program.minimise(level)
        for found in program.solve(solvers=INTERIOR_POINT):
            yield max(float(found[level][0, 0]), 1e-12), {
                "Q": found[q], "U": found[u], "Z": np.array([found[m] for m in z]),
                "Y": np.zeros((nu, n)) if y is None else found[y]}

    def gain(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """(M, n_K, n_u) E over the controller's basis."""
        return values["Z"] @ np.linalg.inv(values["U"])

    def slack(self, values: dict[str, np.ndarray], level: float) -> float:
        """Smallest eigenvalue, relative to the largest, of all inequalities with these matrices; numpy alone."""
        y = None if self.energy is None else given(values["Y"])
        least = math.inf
        for matrix in self._inequalities(given(values["Q"]), given(values["U"]), y, [given(m) for m in values["Z"]],
                                         given(level)):
            m = matrix.constant
            scale = 1 / np.sqrt(np.maximum(np.diag(m), 1e-300))
            low = float(np.linalg.eigvalsh(scale[:, None] * (0.5 * (m + m.T)) * scale)[0])
            least = min(least, low - 1e-13 * len(m))
        return least

    def _inequalities(self, q: Affine, u: Affine, y: Affine | None, z: list[Affine], level: Affine
                      ) -> Iterator[Affine]:
        from lpvid.synthesis.interconnection import close_loop_at

        k, plant, discrete = self.controller, self.plant, self.plant.sample_time is not None
        phi = columns(plant.box, k.basis, self.points)
        at = plant.at(self.points)
        inputs = [[s.name for s in k.inputs].index(n) for n in plant.measurements]
        rows = [[s.name for s in k.outputs].index(n) for n in plant.controls]
        ak, bk, ck, dk = k.at(self.points[:, [plant.box.names.index(n) for n in k.basis.names]])
        bk, ck, dk = bk[:, :, inputs], ck[:, rows], dk[:, rows][:, :, inputs]
        loop = close_loop_at(at, ak, bk, ck, dk)
        for i in range(len(self.points)):
            a, b, c, d = (m[i] for m in loop)
            cv, dv = np.hstack([dk[i] @ at.C2[i], ck[i]]), dk[i] @ at.D21[i]
            seen = cv @ q if y is None else cv @ q - y
            pushed = block([[at.B2[i] @ u], [combined(z, phi[i])]])  # −B_φ U
            dz, nw, nz = at.D12[i] @ u, b.shape[1], len(c)
            unit, gains = np.eye(nw), level.times(np.eye(nz))
            if discrete:
                n = q.shape[0]
                yield block([[q, -seen.T, np.zeros((n, nw)), (a @ q).T, (c @ q).T],
                             [-seen, 2.0 * u, -dv, -pushed.T, -dz.T],
                             [np.zeros((nw, n)), -dv.T, unit, b.T, d.T],
                             [a @ q, -pushed, b, q, np.zeros((n, nz))],
                             [c @ q, -dz, d, np.zeros((nz, n)), gains]])
            else:
                flow = a @ q
                yield block([[-(flow + flow.T), pushed - seen.T, -b, -(c @ q).T], [pushed.T - seen, 2.0 * u, -dv, dz.T],
                             [-b.T, -dv.T, unit, -d.T], [-(c @ q), dz, -d, gains]])
        yield q
        if y is not None and self.energy is not None:
            reach = np.minimum(-self.law.lower, self.law.upper)[rows]
            for i, limit in enumerate(reach):
                if math.isfinite(limit):
                    row = np.eye(y.shape[0])[i : i + 1] @ y
                    yield block([[q, row.T], [row, np.array([[limit**2 / self.energy]])]])
