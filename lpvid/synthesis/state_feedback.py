"""State feedback u = K(p) x by linear matrix inequalities: H-infinity, H2, mixed, with pole regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, combined
from lpvid.lmi.program import Program
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.design_grid import (
    columns,
    fitted,
    storage_for,
    varies,
)
from lpvid.synthesis.gain_design import GainDesign, GainProblem
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_functions import written
from lpvid.synthesis.polytope import Polytope
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_design import Values
from lpvid.synthesis.shaped_loop import ShapedLoop
from lpvid.synthesis.shaped_program import Shaped, Shaping, size_and_condition


@dataclass(frozen=True, eq=False)
class StateFeedback(GainDesign):
    """u = K(p) x for a plant whose measurements are all its states.

    Continuous time: [He(AX + B2F) − Ẋ, B1, (C1X + D12F)ᵀ; ⋆, −γI, D11ᵀ; ⋆, ⋆, −γI] ≺ 0, K = F X⁻¹. Discrete time,
    with a slack matrix G: [X⁺, AG + B2F, B1, 0; ⋆, G + Gᵀ − X, 0, (C1G + D12F)ᵀ; ⋆, ⋆, γI, D11ᵀ; ⋆, ⋆, ⋆, γI] ≻ 0,
    K = F G⁻¹ (de Oliveira, Geromel & Bernussou 2002). H2 and pole regions replace or join the first block.

    Parameters
    ----------
    criteria : HInfinity, H2, GeneralizedH2 or a sequence of them
        What to bound; those without a bound of their own are minimised. Several share X.
    regions : Region or sequence of Region
        Where the frozen poles of the closed loop must lie.
    lyapunov : Basis, optional
        Functions of X(p); left out, one X: quadratic, for arbitrarily fast scheduling. In continuous time the variables
        of this basis need rate bounds.
    gain : Basis, optional
        Functions of F(p); left out, the plant's own for a constant X, and for X(p) those of degree higher by one.
    points : int
        Grid points per scheduling variable at which the inequalities are imposed. Where they are affine in the
        scheduling the corners of the box are enough, and are used.
    back_off : float
        Factor above the lowest level at which the gain is then made small and well conditioned.
    hull : Hull, optional
        As in `GainDesign`: a polytope in which the scheduling stays, in place of its box.

    Raises
    ------
    InputError
        On `solve`: measurements that are not all states, a criterion that names no signal of the plant.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> from lpvid.synthesis.criteria import HInfinity
    >>> system = LPVStateSpace([[[1.0]]], [[[1.0, 1.0]]], [[[1.0], [0.0], [1.0]]], [[[0.0, 0.0], [0.0, 1.0], [0, 0]]],
    ...                        Polynomial((), 0), None, inputs=(Signal("push"), Signal("force")),
    ...                        outputs=(Signal("offset"), Signal("effort"), Signal("x")))
    >>> result = StateFeedback(HInfinity(bound=1.5)).solve(GeneralizedPlant(system, ["force"], ["x"]))
    >>> result.solved, result.gamma_verified < 1.5
    (True, True)
    """

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The gain for a plant, with the figures of its closed loop.

        Parameters
        ----------
        plant : GeneralizedPlant
            All states follow from its measurements.

        Returns
        -------
        Synthesis
            The controller has no states.
        """
        reading = state_reading(plant)
        polytope = None if self.hull is None else Polytope.full_order(self.hull, plant)
        problem = self.problem(_StateFeedbackProblem, plant, ("B2", "D12"), polytope, reading=reading)
        return self.settled(problem, fault_of(plant, plant.at(problem.points), problem.points))


def state_reading(plant: GeneralizedPlant) -> np.ndarray:
    """(n, n_y) matrix E with x = E y.

    Parameters
    ----------
    plant : GeneralizedPlant
        Looked at in the middle and the corners of its box.

    Returns
    -------
    (n, n_y) array
        Pseudo-inverse of C2; constant over the box.

    Raises
    ------
    InputError
        Measurements that disturbances or controls reach directly, that vary with the scheduling, or from which the
        state does not follow.
    """
    m = plant.at(np.vstack([plant.box.centre, plant.box.grid(2)]))
    named = ", ".join(plant.measurements)
    if varies(m.C2) or m.D21.any() or m.D22.any():
        raise InputError("state feedback needs measurements that are the states themselves", got=named,
                         mend="measure the states without noise or feedthrough, or use OutputFeedback")
    rank = int(np.linalg.matrix_rank(m.C2[0]))
    if rank < plant.order:
        raise InputError(f"state feedback needs all {plant.order} states", got=f"{rank} of them in {named}",
                         mend="add the missing states to the measurements, or use OutputFeedback")
    return np.linalg.pinv(m.C2[0])


@dataclass(frozen=True, eq=False)
class _StateFeedbackProblem(GainProblem):
    """One plant with a state feedback: its grid, bases and coordinates."""

    reading: np.ndarray

    @property
    def method(self) -> str:
        return self.summary("state feedback", "X")

    @property
    def remedy(self) -> str:
        slow = "" if self.lyapunov.names or not self.plant.box.names else (
            ", or let the Lyapunov matrix depend on the scheduling (lyapunov=...) with rate bounds")
        return f"raise the bounds or widen the regions, lower the weights on {', '.join(self.plant.performance)}{slow}"

    @property
    def storage(self) -> Basis | None:
        return storage_for(self.lyapunov) if self.polytope is None else self.lyapunov

    def storage_of(self, shaped: Shaped) -> Values | None:
        if not self.plant.box.names:  # the analysis of a time-invariant loop needs no search
            return None
        x, scale = shaped.values("lyapunov"), np.outer(self.coordinates.states, self.coordinates.states)
        return lambda points: np.linalg.inv(
            np.tensordot(columns(self.plant.box, self.lyapunov, points), x, axes=1) * scale)

    def build(self, program: Program, scale: float) -> Shaping:
        plant, n, discrete = self.plant, self.plant.order, self.plant.sample_time is not None
        x = [program.unknowns.symmetric(n) for _ in range(self.lyapunov.size)]
        g = [program.unknowns.matrix(n, n) for _ in range(self.slack.size)] if discrete else x
        f = [program.unknowns.matrix(len(plant.controls), n) for _ in range(self.gain.size)]
        points = self.points
        psi, phi, chi = (columns(plant.box, basis, points) for basis in (self.lyapunov, self.gain, self.slack))
        loops: list[ShapedLoop] = []
        for k, point in enumerate(points):
            m = self.matrices.point(k)
            xk, gk, fk = combined(x, psi[k]), combined(g, chi[k] if discrete else psi[k]), combined(f, phi[k])
            tail = gk + gk.T - xk if discrete else xk
            away: list[Affine | None] = [combined(x, step if discrete else -step)
                                         for step in self.steps(point, psi)]
            loops += [ShapedLoop(tail, move, m.A @ gk + m.B2 @ fk, m.B1, m.C1 @ gk + m.D12 @ fk, m.D11, discrete,
                                 self.coordinates.pace) for move in away or [xk if discrete else None]]
        size = size_and_condition(program, above=[combined(x, w) for w in psi], below=[combined(f, w) for w in phi])
        return Shaping(tuple(loops), size, {"inner": tuple(g), "gain": tuple(f), "lyapunov": tuple(x)})

    def close(self, controller: LPVStateSpace) -> LPVStateSpace:
        return close_loop(self.plant, controller)

    def controller(self, shaped: Shaped) -> LPVStateSpace:
        inner, gain = shaped.values("inner"), shaped.values("gain")
        plant, c, box = self.plant, self.coordinates, self.plant.box
        back = self.reading / c.states[:, None]
        if len(inner) > 1:
            def law(points: np.ndarray) -> np.ndarray:
                here = np.tensordot(columns(box, self.lyapunov, points), inner, axes=1)
                force = np.tensordot(columns(box, self.gain, points), gain, axes=1)
                return c.controls[:, None] * (force @ np.linalg.inv(here) @ back)

            basis, k = (fitted(law, box, self.axes, self.lyapunov) if self.polytope is None
                        else self.polytope.fitted(law))
        else:
            basis, k = self.gain, c.controls[:, None] * (gain @ np.linalg.inv(inner[0]) @ back)
        return written(plant, k, 0, basis)
