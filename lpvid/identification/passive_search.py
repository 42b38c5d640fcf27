"""The passive model nearest to measured records in free run: Gauss-Newton steps under a dissipation inequality."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.identification.covariance import pseudo_inverse
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.levenberg_marquardt import reduce
from lpvid.identification.pem_covariance import free_run_covariance
from lpvid.identification.pem_problem import Point, PredictionErrorProblem, PredictionErrors
from lpvid.lmi.passive_form import slack
from lpvid.lmi.passive_search import PassiveProgram, current_centre
from lpvid.lmi.passive_unknowns import Iterate, scaled
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Spline

MOST_STEPS = 40
SMALL = 2e-3
"""fall of the free-run error, as a share of itself, below which (twice in a row) the search ends."""
ROOM = 1e-3
"""least eigenvalue kept in M, where P, rms velocity and rms force are one: far above the rounding of the re-check
(1e-9); 1e-6 in its place lowers the squared error of the rig's model by 2 % at most."""
DENSITY = 2
"""of the points in the scheduling: between five points the product λ v₀ leaves its chord by 1/64 of its bend."""
LEAST = 0.02
"""least damping and yield of the static start, as a share of their largest: it must be strictly passive."""
LONGEST = 8.0
"""times a step that is tried at most, where the inequality allows: the inner approximation is cautious."""
SHORTEST = 1e-3
"""share of a step below which no descent is left."""


@dataclass(frozen=True, eq=False)
class Reached:
    """Where a search stands.

    Attributes
    ----------
    xi : (k,) array
    iterate : Iterate
        Storage function and multiplier there.
    cost : float
        Free-run sum of squares.
    steps : int
        Taken so far.
    """

    xi: np.ndarray
    iterate: Iterate
    cost: float
    steps: int


@dataclass(frozen=True, eq=False)
class PassiveSearch:
    """Parameters ξ = (a, b, F₀, knee, scheduling filter) in units in which velocity and force are about one.

    Parameters
    ----------
    problem : PredictionErrorProblem
        Of output error, from measured starts.
    layout : ParameterLayout
    speed, force : float
        rms of input and output.
    offset : bool
        Whether there is a preload F₀.
    degree : int
        Of P in the scheduling.
    room : float
        Kept in the inequality.
    balanced : bool
        Whether each record's error counts over its own variance (`record_weights`).
    """

    problem: PredictionErrorProblem
    layout: ParameterLayout
    speed: float
    force: float
    offset: bool
    degree: int = 0
    room: float = ROOM
    balanced: bool = False

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
        """The model of ξ, with c(p) = F₀ (1 + Σ a_i(p)) in its first affine term.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        LPVTransferFunction
            In the units of the records.
        """
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
        """ξ of a model.

        Parameters
        ----------
        model : LPVTransferFunction
            Of the problem's layout.
        offset : float
            F₀ [unit of the force]; of no effect in a search without preload.

        Returns
        -------
        (k,) array
        """
        shared = self.problem.point(model).shared
        own = self.layout.read(model)[self.moving]
        stages = shared[shared.size - self.n_stages :]
        return np.concatenate([own, [offset] if self.offset else [], stages]) / self.units

    def program(self, xi: np.ndarray) -> PassiveProgram:
        """The inequalities at ξ.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        PassiveProgram
        """
        model = scaled(self.model_at(xi), self.speed, self.force)
        return PassiveProgram(model, model.box, self.degree, self.layout.table[self.moving], DENSITY)

    # -- free run ----------------------------------------------------------------------------------------------------
    @cached_property
    def record_weights(self) -> np.ndarray:
        """(records,) factors on the residuals of each record: 1, or σ/σ_r with σ_r the deviation of its own output.

        The second makes the sum of squares the free-run ESR averaged over the records, in units of their mean variance:
        the most probable model where the model's error is a share of the force, whatever its level.
        """
        variance = np.array([float(np.var(y)) for y in self.problem._y])
        if not self.balanced or not (variance > 0).all():
            return np.ones(variance.size)
        return np.sqrt(variance.mean() / variance)

    def cost(self, xi: np.ndarray) -> float:
        """Free-run sum of squares, weighted; infinite where the run diverges.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        float
        """
        return self._sum(self.problem.residuals(self.point(xi)), self.record_weights)

    def plain_cost(self, xi: np.ndarray) -> float:
        """The same without weights.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        float
            [square of the force's unit]; infinite where the run diverges.
        """
        return self._sum(self.problem.residuals(self.point(xi)), np.ones(len(self.record_weights)))

    def _sum(self, found: PredictionErrors | None, weights: np.ndarray) -> float:
        if found is None:
            return np.inf
        head, own = self.problem.head, self.problem.weights
        return float(sum(np.sum((w * own * e[head:]) ** 2) for w, e in zip(weights, found.errors, strict=True)))

    def point(self, xi: np.ndarray) -> Point:
        """ξ as a point of the problem.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        Point
        """
        return self.problem.point(self.model_at(xi))

    def linearised(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
        """J and r of the linearised error ‖r + J dξ‖², both folded into a triangle, and the cost.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        (J, r, cost) or None
            None where the free run diverges.
        """
        point = self.point(xi)
        now = self.problem.residuals(point)
        if now is None:
            return None
        factors = self.problem.factors(point, now)
        shared, _ = reduce(self.problem, [w * r for w, r in zip(self.record_weights, factors, strict=True)])
        jacobian, error = shared[:, :-1], shared[:, -1]
        return -jacobian @ self.chain(xi), error, self._sum(now, self.record_weights)

    def chain(self, xi: np.ndarray) -> np.ndarray:
        """(parameters of the problem, size of ξ) derivative of the one by the other.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.

        Returns
        -------
        (parameters of the problem, k) array
        """
        chain, stages = np.zeros((sum(self.problem.sizes), xi.size)), np.arange(self.n_stages)
        chain[self.moving, np.arange(self.moving.size)] = self.units[: self.moving.size]
        chain[self.layout.size + stages, xi.size - self.n_stages + stages] = self.units[xi.size - self.n_stages :]
        if self.offset:
            self._chain_offset(xi, chain)
        return chain

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
    def memoryless(self, model: LPVTransferFunction, offset: float) -> Reached:
        """The static damper d(p) v + A(p) w + F₀ nearest to the output, positive at the corners of the box.

        It is passive with λ = A and P → 0, whatever the motion, so that the search has a feasible start.

        Parameters
        ----------
        model : LPVTransferFunction
            The unconstrained model, for the stages.
        offset : float
            F₀.

        Returns
        -------
        Reached
            With no step taken.

        Raises
        ------
        NumericalError
            No storage function is found for the static damper.
        """
        from scipy.optimize import nnls

        table = self.layout.table[self.moving]
        direct = [np.flatnonzero((table[:, 0] == 1) & (table[:, 1] == 0) & (table[:, 3] == q))
                  for q in range(model.n_filter_inputs)]
        parts = _positive_parts(model)
        rows, target = [], []
        for y, (u, phi) in zip(self.problem._y, self.problem.drive(model), strict=True):
            rows.append(np.vstack([parts.T @ phi * u[q] for q in range(len(direct))]).T)
            target.append(y[:, 0] - offset)
        found = nnls(np.vstack(rows), np.concatenate(target))[0].reshape(len(direct), -1)
        xi = self.read(model.replace(a=0 * model.a, b=0 * model.b), offset)
        for q, places in enumerate(direct):
            least = LEAST * max(float(found[q].max()), self.force / (self.speed if q == 0 else 1.0))
            xi[places] = (parts @ np.maximum(found[q], least))[table[places, 4]] / self.units[places]
        program = self.program(xi)
        start = program.given(np.eye(program.sizes[0]), 1.0)
        if start is None:
            raise NumericalError("a static damper is passive, and no solver shows it")
        return Reached(xi, self.judged(xi, start), self.cost(xi), 0)

    def run(
        self,
        reached: Reached,
        most: int = MOST_STEPS,
        report_progress: Callable[[str], None] = lambda text: None,
        *,
        descend: bool = True,
    ) -> Reached:
        """Descend from a passive point; every point on the way is passive.

        Parameters
        ----------
        reached : Reached
        most : int
            Steps.
        report_progress : callable
            Receives every step.
        descend : bool
            Whether a step must lower the error; not so on the way to more room.

        Returns
        -------
        Reached
            Where two steps in a row lower the error by little, no step is left, or `most` are taken.

        Raises
        ------
        NumericalError
            The free run of a passive model diverges.
        """
        xi, iterate, cost, steps, calm = reached.xi, reached.iterate, reached.cost, reached.steps, 0
        while steps < reached.steps + most and calm < 2:
            found = self.linearised(xi)
            if found is None:
                raise NumericalError("the free run of a passive model diverged")
            moved = self._step(xi, iterate, found)
            share, ahead = (0.0, cost) if moved is None else (
                self._along(xi, moved, iterate, cost) if descend else (1.0, self.cost(xi + moved[0])))
            if moved is None or not share:
                break
            xi, steps = xi + share * moved[0], steps + 1
            iterate = self._recentred(xi, _between(iterate, moved[1], share))
            report_progress(f"passive step {steps}: free-run rms {np.sqrt(ahead / self.problem.counted):.4g}, "
                f"room {-iterate.shortage:.3g}, share {share:.3g}")
            calm = calm + 1 if cost - ahead < SMALL * cost else 0
            cost = ahead
        return Reached(xi, iterate, cost, steps)

    def _step(self, xi: np.ndarray, iterate: Iterate, found: tuple[np.ndarray, np.ndarray, float]
              ) -> tuple[np.ndarray, Iterate] | None:
        """The step of least linearised error with room to spare, or with half the room there is where it needs that."""
        scale, program = np.sqrt(max(found[2], 1e-300)), self.program(xi)
        for ceiling in dict.fromkeys((-self.room, max(-self.room, 0.5 * iterate.shortage))):
            moved = program.stepped(iterate, found[0] / scale, found[1] / scale, ceiling, self.knee)
            if moved is not None:
                return moved
        return None

    def _recentred(self, xi: np.ndarray, iterate: Iterate) -> Iterate:
        """P and λ with the most room at ξ: on the boundary of the set that one P allows, steps would shrink to none."""
        iterate, program = self.judged(xi, iterate), self.program(xi)
        try:
            frame = np.linalg.inv(np.linalg.cholesky(current_centre(program, iterate))).T
        except np.linalg.LinAlgError:
            return iterate
        found = program.given(frame, 1.0)
        if found is None:
            return iterate
        found = self.judged(xi, found)
        return found if found.shortage <= min(0.0, 0.5 * iterate.shortage) else iterate

    def judged(self, xi: np.ndarray, iterate: Iterate) -> Iterate:
        """The iterate with its shortage as the program at ξ has it.

        Parameters
        ----------
        xi : (k,) array
            ξ, without unit.
        iterate : Iterate
            Storage function and multiplier.

        Returns
        -------
        Iterate
        """
        return replace(iterate, shortage=self.program(xi).shortage(iterate))

    def _along(self, xi: np.ndarray, moved: tuple[np.ndarray, Iterate], iterate: Iterate, cost: float
               ) -> tuple[float, float]:
        """Share of a step to take, and the cost there: the best of 8, 4, 2, 1, ½ … that stays passive with room.

        All of the step is passive by construction; beyond it the inequality is evaluated.
        """
        best, share = (0.0, cost), LONGEST
        while share > SHORTEST:
            trial = xi + share * moved[0]
            if share <= 1 or self._keeps(trial, _between(iterate, moved[1], share), iterate.shortage):
                ahead = self.cost(trial)
                if ahead < best[1]:
                    best = (share, ahead)
                elif best[0]:
                    break
            share *= 0.5
        return best

    def _keeps(self, xi: np.ndarray, iterate: Iterate, before: float) -> bool:
        model = self.model_at(xi)
        if model.n_filter_inputs > 1 and np.any(slack(model, model.box.grid(2)) <= 0):
            return False
        return self.program(xi).shortage(iterate) <= 0.9 * max(-self.room, 0.5 * before)

    def covariance(self, reached: Reached) -> tuple[np.ndarray, float, int, str]:
        """Covariance of the layout's parameters, the condition of J in unit columns, its rows, and how it was found.

        It allows for the colour of the free run's error (`free_run_covariance`). The constraint is left out: where it
        is active the parameters vary less.

        Parameters
        ----------
        reached : Reached
            Where the search ended.

        Returns
        -------
        (k, k) array, float, int, str
        """
        found, point = self.linearised(reached.xi), self.point(reached.xi)
        residuals = self.problem.residuals(point)
        assert found is not None and residuals is not None
        jacobian = found[0]
        norms = np.linalg.norm(jacobian, axis=0)
        size = np.where(norms > 0, norms, 1.0)
        alive = (jacobian / size)[:, norms > 0]
        whole, kind = free_run_covariance(self.problem, point, residuals,
                                          self.chain(reached.xi) @ pseudo_inverse(jacobian), self.record_weights)
        k = self.layout.size
        return whole[:k, :k], float(np.linalg.cond(alive)), self.problem.counted, kind


def _positive_parts(model: LPVTransferFunction) -> np.ndarray:
    """(M, r) combinations of the basis that are nowhere negative in the box, and positive together.

    Of a polynomial in one variable 1 − t and t over its range; the functions of a spline; else the constant.
    """
    basis, box = model.basis, model.box
    if isinstance(basis, Spline):
        return np.eye(basis.size)
    if isinstance(basis, Polynomial) and len(basis.names) == 1 and basis.degree and box.upper[0] > box.lower[0]:
        out = np.zeros((basis.size, 2))
        out[:2] = np.linalg.inv(basis.evaluate(box.grid(2))[:, :2])
        return out
    if basis.unity is None:
        raise InputError("a passive model needs a basis that holds a constant", got=", ".join(basis.labels))
    return basis.unity[:, None]


def _between(before: Iterate, after: Iterate, share: float) -> Iterate:
    return Iterate(before.matrices + share * (after.matrices - before.matrices),
                   before.multiplier + share * (after.multiplier - before.multiplier),
                   before.shortage + share * (after.shortage - before.shortage))
