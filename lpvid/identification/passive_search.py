"""The passive model nearest to measured records in free run: Gauss-Newton steps under a dissipation inequality."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import NumericalError
from lpvid.identification.layout import Layout
from lpvid.identification.levenberg_marquardt import reduce
from lpvid.identification.pem_problem import Point, Problem
from lpvid.lmi.passive_search import Iterate, PassiveProgram, current_centre, scaled
from lpvid.model.transfer_function import LPVTransferFunction

MOST_STEPS = 40
SMALL = 5e-3
"""fall of the free-run error, as a share of itself, below which (twice in a row) the search ends."""
ROOM = 1e-3
"""damping kept in hand, in units of rms force over rms velocity: what the re-check's rounding needs, and 0.1 % of it."""
LONGEST = 8.0
"""times a step that is tried at most, where the inequality allows: the inner approximation is cautious."""
WORSE = 4.0
"""factor by which the free-run error may grow in a step on the way to the first passive model."""
FALLS = (0.6, 0.8, 0.95)
"""shares of the shortage that a step on the way in is to leave, the boldest first."""
SHRINK = (1.0, 0.99, 0.98, 0.96, 0.93, 0.9, 0.85, 0.8, 0.7, 0.5, 0.2, 0.0)
"""factors by which the poles of a start are drawn in until one storage function holds for all motions."""


@dataclass(frozen=True, eq=False)
class PassiveSearch:
    """Parameters ξ = (a, b, F₀) in units in which velocity and force are about one.

    Parameters
    ----------
    problem : Problem
        Of output error, from measured starts, with the stages held.
    layout : Layout
    speed, force : float
        rms of input and output.
    offset : bool
        Whether there is a preload F₀.
    degree : int
        Of P in the scheduling.
    """

    problem: Problem
    layout: Layout
    speed: float
    force: float
    offset: bool
    degree: int = 1

    @property
    def moving(self) -> np.ndarray:
        """Rows of the layout that are free: those of a and b."""
        return np.flatnonzero(self.layout.table[:, 0] < 2)

    @property
    def units(self) -> np.ndarray:
        """(k,) what ξ is multiplied by for SI units."""
        table = self.layout.table[self.moving]
        own = np.where(table[:, 3] == 0, self.force / self.speed, self.force)
        return np.concatenate([np.where(table[:, 0] == 0, 1.0, own), [self.force] if self.offset else [],
                               np.full(len(self.knee), self.speed), np.ones(self.n_stages - len(self.knee))])

    @property
    def n_stages(self) -> int:
        """Free parameters of the input stage and the scheduling filter, the last entries of ξ."""
        return self.problem.sizes[2]

    @property
    def knee(self) -> tuple[int, ...]:
        """Columns of the input stage's free parameters."""
        first = self.moving.size + int(self.offset)
        return tuple(range(first, first + int(np.sum(self.problem._scales[0] > 0))))

    def model_at(self, xi: np.ndarray) -> LPVTransferFunction:
        """The model of ξ, with c(p) = F₀ (1 + Σ a_i(p)) in its first affine term."""
        theta = np.zeros(self.layout.size)
        theta[self.moving] = (xi * self.units)[: self.moving.size]
        values = xi * self.units
        model = self.problem.model_at(np.concatenate([theta, values[xi.size - self.n_stages :]]))
        assert model.c is not None
        c = np.zeros_like(model.c)
        if self.offset:
            c[0, 0] = xi[self.moving.size] * self.force * (model.basis.unity + model.a[:, 0, 0].sum(axis=0))
        return model.replace(c=c)

    def read(self, model: LPVTransferFunction, offset: float) -> np.ndarray:
        """ξ of a model."""
        shared = self.problem.point(model).shared
        own = self.layout.read(model)[self.moving]
        stages = shared[shared.size - self.n_stages :]
        return np.concatenate([own, [offset] if self.offset else [], stages]) / self.units

    def program(self, xi: np.ndarray) -> PassiveProgram:
        """The inequalities at ξ."""
        model = scaled(self.model_at(xi), self.speed, self.force)
        return PassiveProgram(model, model.box, self.degree, self.layout.table[self.moving])

    # -- free run ----------------------------------------------------------------------------------------------------
    def cost(self, xi: np.ndarray) -> float:
        """Free-run sum of squares; infinite where the run diverges."""
        found = self.problem.residuals(self.point(xi))
        return np.inf if found is None else found.cost

    def point(self, xi: np.ndarray) -> Point:
        """ξ as a point of the problem."""
        return self.problem.point(self.model_at(xi))

    def linearised(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
        """J and r, triangular, with the error ‖r + J dξ‖², and the cost; scaled by the cost's own reference."""
        point = self.point(xi)
        now = self.problem.residuals(point)
        if now is None:
            return None
        shared, _ = reduce(self.problem, self.problem.factors(point, now))
        jacobian, error = shared[:, :-1], shared[:, -1]
        chain, stages = np.zeros((jacobian.shape[1], xi.size)), np.arange(self.n_stages)
        chain[self.moving, np.arange(self.moving.size)] = self.units[: self.moving.size]
        chain[self.layout.size + stages, xi.size - self.n_stages + stages] = self.units[xi.size - self.n_stages :]
        if self.offset:
            self._chain_offset(xi, chain)
        return -jacobian @ chain, error, now.cost

    def _chain_offset(self, xi: np.ndarray, chain: np.ndarray) -> None:
        """∂c₀/∂a_i[f] = F₀ and ∂c₀/∂F₀ = 1 + Σ a_i."""
        table, model = self.layout.table, self.model_at(xi)
        below = model.basis.unity + model.a[:, 0, 0].sum(axis=0)
        for row in np.flatnonzero((table[:, 0] == 2) & (table[:, 1] == 0)):
            function = table[row, 4]
            chain[row, self.moving.size] = below[function] * self.force
            same = (table[self.moving, 0] == 0) & (table[self.moving, 4] == function)
            chain[row, : self.moving.size][same] = xi[self.moving.size] * self.force

    # -- the search --------------------------------------------------------------------------------------------------
    def start(self, model: LPVTransferFunction, offset: float) -> tuple[np.ndarray, Iterate]:
        """ξ near a model, with poles drawn in as far as a storage function needs, and what damping is missing."""
        for share in SHRINK:
            power = share ** np.arange(1, model.na + 1)
            drawn = model.replace(a=model.a * power[:, None, None, None])
            xi = self.read(drawn, offset)
            program = self.program(xi)
            found = program.given(frame_of(program.model))
            if found is not None and np.isfinite(found.shortage):
                return xi, found
        raise NumericalError("no start for a passive model was found")

    def memoryless(self, model: LPVTransferFunction, offset: float) -> tuple[np.ndarray, Iterate]:
        """ξ of a static force: damping and yield by non-negative least squares at the ends of the box."""
        from scipy.optimize import nnls

        table = self.layout.table[self.moving]
        direct = [np.flatnonzero((table[:, 0] == 1) & (table[:, 1] == 0) & (table[:, 3] == q))
                  for q in range(model.n_filter_inputs)]
        ends = model.basis.evaluate(model.box.grid(2))
        rows, target = [], []
        for y, (u, phi) in zip(self.problem._y, self.problem.drive(model), strict=True):
            weights = np.linalg.lstsq(ends.T, phi, rcond=None)[0]  # φ(p) as a mixture of the ends
            rows.append(np.vstack([weights * u[q] for q in range(len(direct))]).T)
            target.append(y[:, 0] - offset)
        found = nnls(np.vstack(rows), np.concatenate(target))[0].reshape(len(direct), -1)
        print(found)
        xi = self.read(model.replace(a=0 * model.a, b=0 * model.b), offset)
        for q, places in enumerate(direct):
            own = np.linalg.lstsq(ends[:, table[places, 4]], np.maximum(found[q], 0.02 * found[q].max()), rcond=None)[0]
            xi[places] = own / self.units[places]
        program = self.program(xi)
        start = program.given(np.eye(program.sizes[0]), 1.0)
        if start is None:
            raise NumericalError("a static damper is passive, and no solver shows it")
        return xi, start

    def run(self, xi: np.ndarray, iterate: Iterate, reference: float,
            say: Callable[[str], None] = lambda text: None) -> tuple[np.ndarray, Iterate, float]:
        """The passive ξ that the search ends at, with its storage function and cost.

        Parameters
        ----------
        xi, iterate
            As `start` gives them.
        reference : float
            Sum of squares about the mean that errors are measured by.
        """
        iterate = self.judged(xi, iterate)
        calm, cost = 0, self.cost(xi)
        for step in range(MOST_STEPS):
            found = self.linearised(xi)
            if found is None:
                raise NumericalError("the free run of a passive model diverged")
            inside = iterate.shortage <= -0.5 * ROOM
            moved = self._step(xi, iterate, found, inside)
            if moved is None:
                break
            share, ahead = self._along(xi, moved, iterate, cost, inside)
            if not share:
                break
            xi = xi + share * moved[0]
            iterate = self.recentred(xi, self.judged(xi, _between(iterate, moved[1], share)))
            say(f"passive step {step + 1}: ESR {ahead / reference:.4g}, shortage {iterate.shortage:.3g}, "
                f"share {share:.3g}")
            calm = calm + 1 if inside and cost - ahead < SMALL * cost else 0
            cost = ahead
            if calm >= 2:
                break
        return xi, iterate, cost

    def recentred(self, xi: np.ndarray, iterate: Iterate) -> Iterate:
        """P and λ with the most room at ξ, where they have more than those of the last step."""
        program = self.program(xi)
        try:
            frame = np.linalg.inv(np.linalg.cholesky(current_centre(program, iterate))).T
        except np.linalg.LinAlgError:
            return iterate
        found = program.given(frame, 1.0)
        if found is None:
            return iterate
        found = self.judged(xi, found)
        return found if found.shortage <= 0.0 else iterate

    def judged(self, xi: np.ndarray, iterate: Iterate) -> Iterate:
        """The iterate with its shortage as the program at ξ has it."""
        return replace(iterate, shortage=self.program(xi).shortage(iterate))

    def _step(self, xi: np.ndarray, iterate: Iterate, found: tuple[np.ndarray, np.ndarray, float], inside: bool
              ) -> tuple[np.ndarray, Iterate] | None:
        """The step of least linearised error: inside with the room kept, on the way in with less shortage."""
        jacobian, error, cost = found
        scale = np.sqrt(cost)
        for fall in ((1.0,) if inside else FALLS):
            ceiling = max(fall * iterate.shortage, -ROOM) if not inside else -ROOM
            if ceiling < 0.02:
                ceiling = -ROOM
            moved = self.program(xi).stepped(iterate, jacobian / scale, error / scale, ceiling, self.knee)
            if moved is not None:
                return moved
        return None

    def _along(self, xi: np.ndarray, moved: tuple[np.ndarray, Iterate], iterate: Iterate, cost: float, inside: bool
               ) -> tuple[float, float]:
        """Share of a step to take, and the cost there.

        All of the step is passive by construction; beyond it the inequality is evaluated. From inside, the share of
        least cost among 8, 4, 2, 1, ½ … that keeps the room; on the way in, the first whose run is bounded.
        """
        best, share = (0.0, cost), LONGEST
        while share > 1e-3:
            trial = xi + share * moved[0]
            if share <= 1 or self._keeps(trial, _between(iterate, moved[1], share), iterate.shortage):
                ahead = self.cost(trial)
                if not inside:
                    if ahead < WORSE * cost:
                        return share, ahead
                elif ahead < best[1]:
                    best = (share, ahead)
                elif best[0]:
                    break
            share *= 0.5
        return best

    def _keeps(self, xi: np.ndarray, iterate: Iterate, before: float) -> bool:
        stage = self.model_at(xi).input_stage
        if stage is not None and np.any(self.read_knee(xi) <= 0):
            return False
        return self.program(xi).shortage(iterate) <= max(-0.9 * ROOM, min(before, 0.0))

    def read_knee(self, xi: np.ndarray) -> np.ndarray:
        """v₀ at the ends of the box."""
        from lpvid.lmi.passive_form import slack

        return slack(self.model_at(xi), self.problem.model.box.grid(2))


def frame_of(model: LPVTransferFunction) -> np.ndarray:
    """Coordinates of the past in which the frozen model at the centre of the box is a contraction."""
    from lpvid.lmi.passive_form import supplied, sector_basis
    from lpvid.lmi.search import _gramian

    system = supplied(model, np.zeros(sector_basis(model).size))
    if not system.order:
        return np.zeros((0, 0))
    from lpvid.lmi.autonomous import box_of

    a = system.matrices(box_of(system.readings, model.box).centre[None])[0][0]
    size = max(float(np.abs(np.linalg.eigvals(a)).max()), 1e-3)
    gram = _gramian(a * min(1.0, 0.999 / size), np.eye(len(a)))
    return np.linalg.inv(np.linalg.cholesky(gram)).T


def _between(before: Iterate, after: Iterate, share: float) -> Iterate:
    return Iterate(before.matrices + share * (after.matrices - before.matrices),
                   before.multiplier + share * (after.multiplier - before.multiplier),
                   before.shortage + share * (after.shortage - before.shortage))
