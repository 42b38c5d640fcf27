"""Candidates for a Lyapunov function: closed forms first, then semidefinite programs of rising degree.

Nothing here proves anything; every candidate goes through `lpvid.lmi.bounds.recheck_decrease`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from lpvid.lmi.bounds import DecayBound
from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Polynomial, Scheduling

LARGEST = float(np.finfo(float).max)
"""largest double"""
DENSITY = 1.0
"""points along each variable, over the usual number; the re-check looks between them"""


def frozen_rates(system: Driven, points: np.ndarray) -> np.ndarray:
    """(N,) exponential rate [1/s] of the slowest frozen mode at each point; negative means decay.

    Discrete models: ln ρ(A)/T_s, no lower than that of a modulus of 1e-3.

    Parameters
    ----------
    system : Driven
        Its A alone counts.
    points : (N, readings) array
        Value of each reading.

    Returns
    -------
    (N,) array
        −∞ without states.
    """
    if not system.order:
        return np.full(len(points), -math.inf)
    poles = np.linalg.eigvals(system.state_matrices(points))
    if system.sample_time is None:
        return poles.real.max(axis=1)
    return np.log(np.maximum(np.abs(poles).max(axis=1), 1e-3)) / system.sample_time


def dependent(system: Driven, box: Scheduling) -> tuple[str, ...]:
    """Variables that P may depend on: those that have width and, in continuous time, a bounded rate.

    Parameters
    ----------
    system : Driven
        For the kind of time.
    box : Scheduling
        One entry for each reading.

    Returns
    -------
    tuple of str
        In the order of the box.
    """
    return tuple(name for name, low, high, rate in zip(box.names, box.lower, box.upper, box.rate, strict=True)
                 if high > low and (system.sample_time is not None or rate is not None))


@dataclass(frozen=True, eq=False)
class LyapunovSearch:
    """Looks for P(p) for one system on one box, in coordinates where the frozen systems are nearly contractions.

    Parameters
    ----------
    system : Driven
        Frozen-stable at the sampled points.
    box : Scheduling
    """

    system: Driven
    box: Scheduling

    def basis(self, degree: int) -> Polynomial:
        """The monomials of P.

        Parameters
        ----------
        degree : int
            0 for a constant P.

        Returns
        -------
        Polynomial
            Bound to the box.
        """
        return Polynomial(dependent(self.system, self.box) if degree else (), degree).bound(self.box)

    def _storage(self, matrices: np.ndarray, degree: int) -> Storage:
        return Storage(matrices, self.basis(degree), self.box, self.system.sample_time)

    def frozen_solutions(self, points: np.ndarray) -> np.ndarray:
        """(N, n, n) Lyapunov matrices of the frozen systems, each with some decay to spare.

        Parameters
        ----------
        points : (N, readings) array
            Value of each reading.

        Returns
        -------
        (N, n, n) array
            Symmetric.
        """
        a = self.system.state_matrices(points)
        worst = float(frozen_rates(self.system, points).max())
        if self.system.sample_time is not None:
            a = a / math.sqrt(0.5 * (1 + math.exp(2 * worst * self.system.sample_time)))
        else:
            eye = np.eye(self.system.order)
            shifted = (a - 0.5 * worst * eye) / max(float(np.abs(a).sum(axis=2).max()), 1e-300)
            a = (eye + shifted) @ np.linalg.inv(eye - shifted)
        weight = np.broadcast_to(np.diag(_balance(np.abs(a).mean(axis=0)) ** -2.0), a.shape)
        return np.array([frozen_gramian(x, w) for x, w in zip(a, weight, strict=True)])

    def closed_forms(self) -> Iterator[Storage]:
        """The mean of the frozen Lyapunov matrices: exact for a time-invariant model, and no solver.

        Yields
        ------
        Storage
            One, of degree 0.
        """
        yield self._storage(self._centre()[None], 0)

    def fitted(self, degree: int) -> Storage | None:
        """A polynomial through the frozen Lyapunov matrices, which serves slow variation; no solver.

        Parameters
        ----------
        degree : int
            Of the polynomial.

        Returns
        -------
        Storage or None
            None where a frozen Lyapunov matrix is not finite.
        """
        basis = self.basis(degree)
        points = grid(self.box, 2 * degree + 3 if len(self.box.names) < 3 else degree + 1)
        phi = basis.evaluate(points[:, [self.box.names.index(n) for n in basis.names]])
        solutions = self.frozen_solutions(points)
        if not np.all(np.isfinite(solutions)):
            return None
        fit = np.linalg.lstsq(phi, solutions.reshape(len(points), -1), rcond=None)[0]
        matrices = fit.reshape(basis.size, *solutions.shape[1:])
        return self._storage(0.5 * (matrices + matrices.swapaxes(1, 2)), degree)

    def solved(self, degree: int, exponent: float = 0.0) -> Iterator[tuple[Storage, str]]:
        """Candidates of a degree by semidefinite programming, with the solver's name; none where it finds no margin.

        Parameters
        ----------
        degree : int
            Of P in the scheduling.
        exponent : float
            α [1/s] of the decay to be proven.

        Yields
        ------
        Storage
            Candidate P(p), not re-checked.
        str
            Name of the solver.
        """
        from lpvid.lmi.storage_search import StorageSearch  # here, so that checking a certificate needs numpy alone

        try:
            states = np.linalg.inv(np.linalg.cholesky(self._centre())).T
        except np.linalg.LinAlgError:
            return
        system, time = self.system, 1.0
        if system.sample_time is None:  # the time in which the fastest frozen mode has the rate 1
            time = 1 / max(float(np.abs(np.linalg.eigvals(system.state_matrices(grid(self.box, 3)))).max()), 1e-300)
        decay = partial(DecayBound, level=exponent * time)
        search = StorageSearch(system, self.box, self.basis(degree), Frame(states, time, 1.0), lambda _: decay, DENSITY)
        if not search.affordable:
            return
        for found in search.roomiest(capped=True):
            yield self._storage(found.matrices, degree), found.solver
            if found.margin < 1e-7:
                return

    def _centre(self) -> np.ndarray:
        points = grid(self.box, {0: 1, 1: 9, 2: 4}.get(len(self.box.names), 2))
        if not self.system.order:
            return np.zeros((0, 0))
        solutions = self.frozen_solutions(points)
        solutions = solutions / np.trace(solutions, axis1=1, axis2=2)[:, None, None]
        return solutions.mean(axis=0)


def frozen_gramian(a: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Σ (Aᵏ)ᵀ W Aᵏ by doubling.

    Parameters
    ----------
    a : (n, n) array
        A, discrete time.
    weight : (n, n) array
        W, symmetric.

    Returns
    -------
    (n, n) array
        Symmetric; the doubling ends early where Aᵏ, of rounding, grows so far that the sum would overflow.
    """
    total, power = np.array(weight), np.array(a)
    for _ in range(60):
        size = float(np.abs(power).max())
        # |AᵏᵀSAᵏ| <= n² |Aᵏ|² |S| entry by entry; the rest of the room is for the sum, its trace, and the square of Aᵏ
        room = LARGEST / (8 * len(a) ** 3 * max(float(np.abs(total).max()), 1.0))
        if size < 1e-18 or size > math.sqrt(room):
            break
        total = total + power.T @ total @ power
        power = power @ power
    return 0.5 * (total + total.T)


def _balance(size: np.ndarray) -> np.ndarray:
    """Diagonal d that makes rows and columns of |D⁻¹AD| equally large, in a few sweeps."""
    n = len(size)
    d = np.ones(n)
    off = size * (1 - np.eye(n))
    for _ in range(10):
        for i in range(n):
            row, column = float((off[i] * d).sum() / d[i]), float((off[:, i] / d).sum() * d[i])
            if row > 0 and column > 0:
                d[i] *= float(np.clip(math.sqrt(row / column), 0.1, 10.0))
    return np.clip(d / d.mean(), 1e-6, 1e6)
