"""Semidefinite programs for passive models: storage and multiplier of a given model, or all three at once.

The inequality M(p, p⁺) ≻ 0 of `lpvid.lmi.passive_form` is affine in (P, λ) for a given h. In (h, P, λ) together it is,
after a Schur complement,

    [ M₀(P(p), h, λ)   [A B](h)ᵀ ]
    [ ⋆                P(p⁺)⁻¹   ] ≻ 0,     P⁻¹ ≽ 2 Q⁻¹ − Q⁻¹ P Q⁻¹  for every Q ≻ 0,

and with the bound in place of P⁻¹ affine, and sufficient: an inner approximation that is exact at P = Q. Steps from a
passive model therefore end at passive models, and all of the segment between them is passive.

Nothing here proves anything; every candidate goes through `lpvid.lmi.inequality.recheck_inequality`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine
from lpvid.lmi.bernstein import nodes
from lpvid.lmi.certificate import tensor
from lpvid.lmi.passive_form import sector_basis, shift, slack
from lpvid.lmi.passive_unknowns import Iterate, PassiveUnknowns, affine, mixed
from lpvid.lmi.program import Program
from lpvid.model.input_stage import TanhStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Scheduling

SOLVERS = ("CLARABEL",)
LARGEST = 1e4
"""bound of P in its frame and of λ in units of the form: keeps the programs bounded; answers stay far below it."""
GIVEN = 1e-5
"""least eigenvalue of P(p) in the frame for a given model: P must be invertible for a step to be taken from it."""
STEP = 0.03
"""least eigenvalue that a step may leave of a P(p) that stood at one: the approximation is good near its own point."""
KNEE = 0.5
"""share of v₀ below which a step may not take it."""
DAMPING = 1e-4
"""Levenberg-Marquardt damping, columns and error of size one: holds combinations that the data do not see."""


@dataclass(frozen=True, eq=False)
class PassiveProgram:
    """The inequalities of a model structure at sampled values of the scheduling.

    Parameters
    ----------
    model : LPVTransferFunction
        In units in which inputs and output are about one (`scaled`); its denominators and numerators are the point at
        which steps are taken.
    box : Scheduling
        Range and rates of the scheduling.
    degree : int
        Of P in the scheduling.
    table : (k, 5) int array
        Parameters that may move, as in an identification layout; parts 0 (a) and 1 (b).
    density : int
        Factor on the number of points.
    """

    model: LPVTransferFunction
    box: Scheduling
    degree: int
    table: np.ndarray
    density: int = 1

    # -- what is where -----------------------------------------------------------------------------------------------
    @property
    def sizes(self) -> tuple[int, int]:
        """States n and filter inputs n_u."""
        nu, past = self.model.n_filter_inputs, max(self.model.n_lags - 1, 0)
        return self.model.na + past * nu, nu

    @property
    def basis(self) -> Polynomial:
        """Basis of P."""
        read = sector_basis(self.model).names
        names = tuple(n for n, (low, high) in self.box.limits.items() if high > low and n in read)
        return Polynomial(names if self.degree else (), self.degree if names else 0).bound(self.box)

    def _pieces(self, name: str) -> int:
        """Intervals between the points of a variable.

        With coefficients affine in p and P(p⁺) at its ends, M is concave in p but for λ v₀, so that the ends suffice
        at a constant knee; they and the middle serve a knee that moves, and twice the degree in all others.
        """
        degree = next((r.degree for r in self.model.basis.readings() if r.name == name), 0)
        stage = self.model.input_stage
        knee = isinstance(stage, TanhStage) and stage.slope != 0 and self.box.names[stage.variable] == name
        return self.density * (2 * max(degree, self.degree) if max(degree, self.degree) > 1 else 2 if knee else 1)

    def _sector(self, points: np.ndarray) -> np.ndarray:
        """(N, L) basis of λ."""
        basis = sector_basis(self.model)
        return basis.evaluate(points[:, [self.box.names.index(n) for n in basis.names]])

    def samples(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """(N, variables) points p, and for each the p⁺ (T, variables) that one sample can lead to.

        Returns
        -------
        (N, variables) array
            Points, in the units of the box.
        list of (T, variables) arrays
            One for each point; T may differ.
        """
        axes, read = [], sector_basis(self.model).names
        for name, (low, high) in self.box.limits.items():
            breaks = [b for r in self.model.basis.readings() if r.name == name for b in r.breaks if low < b < high]
            cells = itertools.pairwise((low, *breaks, high))
            axes.append(np.unique(np.concatenate([a + nodes(self._pieces(name)) * (b - a) for a, b in cells]))
                        if high > low and name in read else np.array([0.5 * (low + high)]))
        points = tensor(axes) if axes else np.zeros((1, 0))
        ahead = []
        for point in points:
            ends = []
            for i, (name, rate) in enumerate(zip(self.box.names, self.box.rate, strict=True)):
                reach = np.inf if rate is None else rate * self.model.sample_time
                low, high = max(self.box.lower[i], point[i] - reach), min(self.box.upper[i], point[i] + reach)
                if name not in self.basis.names:
                    ends.append(point[i : i + 1])
                else:
                    ends.append(low + nodes(max(self.degree, 1)) * (high - low) if high > low else np.array([low]))
            ahead.append(tensor(ends) if ends else np.zeros((1, 0)))
        return points, ahead

    def psi(self, points: np.ndarray) -> np.ndarray:
        """(N, K) basis of P.

        Parameters
        ----------
        points : (N, variables) array
            Scheduling values.

        Returns
        -------
        (N, K) array
            Values of the K functions.
        """
        return self.basis.evaluate(points[:, [self.box.names.index(n) for n in self.basis.names]])

    def _unknowns(self, pace: np.ndarray, products: int = 0) -> PassiveUnknowns:
        n, nu = self.sizes
        return PassiveUnknowns(n, self.basis.size, sector_basis(self.model).size if nu > 1 else 0, pace, products)

    def equation(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """h (n + n_u,) at a point of the scheduling, and (n + n_u, k) how it moves with the parameters.

        Parameters
        ----------
        point : (variables,) array
            Scheduling values.

        Returns
        -------
        (n + n_u,) array
            h of the model as it is.
        (n + n_u, k) array
            ∂h/∂θ, one column for each row of the table.
        """
        n, nu = self.sizes
        phi = self.model.basis.evaluate(point[None])[0]
        part, lag, _, source, function = self.table.T
        place = np.where(part == 0, lag, np.where(lag == 0, n + source, self.model.na + (lag - 1) * nu + source))
        slope = np.zeros((n + nu, len(part)))
        slope[place, np.arange(len(part))] = np.where(part == 0, -1.0, 1.0) * phi[function]
        a, b, _ = self.model.coefficients(point)
        own = np.concatenate([-a[:, 0, 0], b[1:, 0].ravel(), b[0, 0] if len(b) else np.zeros(nu)])
        return own, slope

    # -- programs ----------------------------------------------------------------------------------------------------
    def given(self, frame: np.ndarray, room: float = 0.0) -> Iterate | None:
        """P and λ of the model as it is, with the least shortage ε; with `room` the inequality is shared by the states.

        Parameters
        ----------
        frame : (n, n) array
            T of the coordinates x = T x̃ in which the program is stated.
        room : float
            Weight of the states in M ≽ −ε·diag(room·I, I).

        Returns
        -------
        Iterate or None
            None where no solver answers.
        """
        unknowns = self._unknowns(np.zeros(0))
        program = unknowns.program()
        ends = sparse.csr_array(([1.0], ([0], [unknowns.size - 1])), shape=(1, unknowns.size))
        for point, nexts in zip(*self.samples(), strict=True):
            now, h, _ = self._state(unknowns, frame, point, room)
            ab = self._both(frame, h)
            for psi in self.psi(nexts):
                linear = now[1].copy()
                linear[:, :, unknowns.storage] -= mixed(psi, ab.T @ unknowns.units @ ab)
                program.require(affine(now[0], linear))
        self._positive(program, unknowns, GIVEN)
        program.minimise(Affine(np.zeros((1, 1)), ends))
        found = self._solution(program, unknowns, frame)
        return None if found is None else found[1]

    def stepped(self, current: Iterate, jacobian: np.ndarray, residual: np.ndarray, ceiling: float,
                knee: tuple[int, ...] = ()) -> tuple[np.ndarray, Iterate] | None:
        """Move parameters, P and λ together: minimise ‖residual + jacobian·dθ‖² subject to M + ceiling·I ≽ 0.

        Parameters
        ----------
        current : Iterate
            At the model.
        jacobian, residual : (m, k), (m,) arrays
            Of the error to be reduced, over the parameters of the table and whatever columns follow them, which are
            free.
        ceiling : float
            ε in coordinates that make P at the centre of the box the identity.
        knee : tuple of int
            Columns of v₀ and of its slope, where they move too. Their product with λ is bounded from below,
            4 λ v ≥ 2 (λ' + v')(λ + v) − (λ' + v')² − (λ − v)², with equality at the present (λ', v').

        Returns
        -------
        dθ and the new iterate, or None
        """
        centre = current_centre(self, current)
        root = np.linalg.cholesky(centre)
        frame = np.linalg.inv(root).T
        count = jacobian.shape[1]
        pace = 1 / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12 * max(float(np.abs(jacobian).max()), 1e-300))
        jacobian = np.vstack([jacobian * pace, np.sqrt(DAMPING) * np.eye(count)])
        residual = np.append(residual, np.zeros(count))
        points, ahead = self.samples()
        unknowns = self._unknowns(pace, len(points) if knee else 0)
        program = unknowns.program()
        for i, (point, nexts) in enumerate(zip(points, ahead, strict=True)):
            now, h, slope = self._state(unknowns, frame, point, 1.0)
            if knee:
                self._bound_product(program, unknowns, now[1], current, knee, i, point)
            ab = self._both(frame, h)
            move = np.zeros((*ab.shape, unknowns.size))
            if self.model.na:
                move[:, :, : slope.shape[1]] = np.einsum("i,jk->ijk", np.linalg.inv(frame)[:, 0], slope)
            for psi, plus in zip(self.psi(nexts), np.tensordot(self.psi(nexts), current.matrices, axes=1), strict=True):
                inverse = np.linalg.inv(frame.T @ plus @ frame)
                inverse = 0.5 * (inverse + inverse.T)
                corner = np.zeros((len(ab), len(ab), unknowns.size))
                corner[:, :, unknowns.storage] = -mixed(psi, inverse @ unknowns.units @ inverse)
                constant = np.block([[now[0], ab.T], [ab, 2 * inverse]])
                linear = np.vstack([np.hstack([now[1], move.transpose(1, 0, 2)]), np.hstack([move, corner])])
                program.require(affine(constant, linear))
        self._positive(program, unknowns, STEP)
        last = np.zeros((1, 1, unknowns.size))
        last[0, 0, -1] = 1.0
        program.require(affine(np.full((1, 1), ceiling), -last))
        squares = np.zeros((len(residual), 1, unknowns.size))
        squares[:, 0, :count] = jacobian
        program.minimise(affine(np.zeros((1, 1)), 0 * last), affine(residual[:, None], squares))
        found = self._solution(program, unknowns, frame)
        return None if found is None else (found[0][:count] * pace, found[1])

    def shortage(self, iterate: Iterate) -> float:
        """The least ε with M + ε·I ≽ 0 at the samples, where P at the centre is the identity; infinite without one.

        Parameters
        ----------
        iterate : Iterate
            P and λ at the model.

        Returns
        -------
        float
            Negative for a passive model with room, as far as the samples show. Infinite where P is not positive
            definite or λ is negative at one of them.
        """
        worst, (n, nu) = -np.inf, self.sizes
        try:
            frame = np.linalg.inv(np.linalg.cholesky(current_centre(self, iterate))).T
        except np.linalg.LinAlgError:
            return np.inf
        inner = frame.T @ iterate.matrices @ frame
        for point, nexts in zip(*self.samples(), strict=True):
            h, _ = self.equation(point)
            h = np.concatenate([frame.T @ h[:n], h[n:]])
            value = np.zeros((n + nu, n + nu))
            value[:n, :n] = np.tensordot(self.psi(point[None])[0], inner, axes=1)
            if n and np.linalg.eigvalsh(value[:n, :n])[0] <= 0:
                return np.inf
            value[n] += 0.5 * h
            value[:, n] += 0.5 * h
            if nu > 1:
                own = float(self._sector(point[None])[0] @ iterate.multiplier)
                if own < 0:
                    return np.inf
                value[n, n + 1] -= 0.5 * own
                value[n + 1, n] -= 0.5 * own
                value[n + 1, n + 1] += own * slack(self.model, point[None])[0]
            ab = self._both(frame, h)
            for plus in np.tensordot(self.psi(nexts), inner, axes=1):
                worst = max(worst, -float(np.linalg.eigvalsh(value - ab.T @ plus @ ab)[0]))
        return worst

    # -- pieces ------------------------------------------------------------------------------------------------------
    def _state(self, unknowns: PassiveUnknowns, frame: np.ndarray, point: np.ndarray, room: float
               ) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray]:
        """M without the last term at a point, as (constant, linear), and h with its slopes, all in the frame."""
        n, nu = self.sizes
        h, slope = self.equation(point)
        h, slope = (np.concatenate([frame.T @ x[:n], x[n:]]) for x in (h, slope))
        if unknowns.parameters:
            slope = slope * unknowns.pace[: slope.shape[1]]
        constant = np.zeros((n + nu, n + nu))
        linear = np.zeros((n + nu, n + nu, unknowns.size))
        psi = self.psi(point[None])[0]
        linear[:n, :n, unknowns.storage] = mixed(psi, unknowns.units)
        constant[n] += 0.5 * h
        constant[:, n] += 0.5 * h
        if unknowns.parameters:
            linear[n, :, : slope.shape[1]] += 0.5 * slope
            linear[:, n, : slope.shape[1]] += 0.5 * slope
        if nu > 1:
            own = self._sector(point[None])[0]
            linear[n, n + 1, unknowns.multiplier] -= 0.5 * own
            linear[n + 1, n, unknowns.multiplier] -= 0.5 * own
            linear[n + 1, n + 1, unknowns.multiplier] += own * slack(self.model, point[None])[0]
        linear[np.arange(n), np.arange(n), -1] += room
        linear[np.arange(n, n + nu), np.arange(n, n + nu), -1] += 1.0
        return (constant, linear), h, slope

    def _bound_product(self, program: Program, unknowns: PassiveUnknowns, linear: np.ndarray, current: Iterate,
                       knee: tuple[int, ...], i: int, point: np.ndarray) -> None:
        """Put an unknown s ≤ λ v₀ of this point in the place of λ v₀."""
        n, stage = self.sizes[0], self.model.input_stage
        assert isinstance(stage, TanhStage)
        own = self._sector(point[None])[0]
        place = unknowns.product.start + i
        linear[n + 1, n + 1, unknowns.multiplier] = 0.0
        linear[n + 1, n + 1, place] = 1.0
        now, was = float(slack(self.model, point[None])[0]), float(own @ current.multiplier)
        weight, moved = np.zeros(unknowns.size), np.zeros(unknowns.size)
        weight[unknowns.multiplier] = own
        for column, factor in zip(knee, (1.0, point[stage.variable] if point.size else 0.0), strict=False):
            moved[column] = factor * unknowns.pace[column]
        total = was + now
        square = np.zeros((2, 2, unknowns.size))
        square[0, 0] = 2 * total * (weight + moved)
        square[0, 0, place] -= 4.0
        square[0, 1] = square[1, 0] = weight - moved
        program.require(affine(np.array([[2 * total * now - total**2, -now], [-now, 1.0]]), square))
        program.require(affine(np.full((1, 1), (1 - KNEE) * now), moved[None, None]))

    def _both(self, frame: np.ndarray, h: np.ndarray) -> np.ndarray:
        """[A B] in the frame."""
        n, nu = self.sizes
        both = shift(self.model.na, nu, max(self.model.n_lags - 1, 0))
        both[:, :n] = both[:, :n] @ frame
        both = np.linalg.solve(frame, both)
        if self.model.na:
            both += np.outer(np.linalg.inv(frame)[:, 0], h)
        return both

    def _positive(self, program: Program, unknowns: PassiveUnknowns, floor: float) -> None:
        """P ≽ 0 and λ ≥ 0 at the corners of the box."""
        points, _ = self.samples()
        n, _ = self.sizes
        still = np.array([m not in self.basis.names for m in self.box.names], dtype=bool)
        at_end = (points == np.array(self.box.lower)) | (points == np.array(self.box.upper)) | still
        ends = points if self.degree > 1 else points[np.all(at_end, axis=1)]
        total = np.zeros((1, 1, unknowns.size))
        for psi in np.unique(self.psi(ends), axis=0) if n else ():
            linear = np.zeros((n, n, unknowns.size))
            linear[:, :, unknowns.storage] = mixed(psi, unknowns.units)
            program.require(affine(-floor * np.eye(n), linear))
            total += np.einsum("aak->k", linear)
        if n:
            program.require(affine(np.full((1, 1), LARGEST), -total))
        if unknowns.multiplier.stop > unknowns.multiplier.start:
            for own in np.unique(self._sector(points), axis=0):
                linear = np.zeros((1, 1, unknowns.size))
                linear[0, 0, unknowns.multiplier] = own
                program.require(affine(np.zeros((1, 1)), linear))
                program.require(affine(np.full((1, 1), LARGEST), -linear))

    def _solution(self, program: Program, unknowns: PassiveUnknowns, frame: np.ndarray
                  ) -> tuple[np.ndarray, Iterate] | None:
        solution = next(program.solve(solvers=SOLVERS), None)
        if solution is None:
            return None
        n = self.sizes[0]
        weights = solution.x[unknowns.storage].reshape(self.basis.size, len(unknowns.units))
        inner = np.tensordot(weights, unknowns.units, axes=1)
        back = np.linalg.inv(frame)
        matrices = back.T @ inner.reshape(self.basis.size, n, n) @ back
        return solution.x, Iterate(0.5 * (matrices + matrices.swapaxes(1, 2)), solution.x[unknowns.multiplier],
                                   float(solution.x[-1]))


def current_centre(program: PassiveProgram, current: Iterate) -> np.ndarray:
    """P at the centre of the box.

    Parameters
    ----------
    program : PassiveProgram
        For the box and the basis of P.
    current : Iterate
        P over that basis.

    Returns
    -------
    (n, n) array
        P(p) there, in the coordinates of the past.
    """
    return np.tensordot(program.psi(program.box.centre[None])[0], current.matrices, axes=1)
