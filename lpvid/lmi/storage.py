"""P(p), and how fast it changes while p moves: the storage function xᵀP(p)x of a dissipation inequality."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.lmi.box_positivity import Axis
from lpvid.lmi.driven import basis_ceilings
from lpvid.lmi.readings import Reading
from lpvid.scheduling import Basis, Scheduling


@dataclass(frozen=True, eq=False)
class Storage:
    """P(p) = Σ_k matrices[k] ψ_k(p) on a box, in which p moves no faster than the box's rates.

    Parameters
    ----------
    matrices : (K, n, n) array
        Symmetric.
    basis : Basis
        The K functions ψ_k, over names of `box`.
    box : Scheduling
        One entry for each reading of the system; rates in units per second, None for arbitrary variation.
    sample_time : float or None
    """

    matrices: np.ndarray
    basis: Basis
    box: Scheduling
    sample_time: float | None

    @cached_property
    def columns(self) -> list[int]:
        """Which variables of the box ψ reads."""
        return [self.box.names.index(n) for n in self.basis.names]

    @cached_property
    def readings(self) -> dict[int, Reading]:
        """Degree or frequency of P in each variable of the box that it depends on."""
        return {self.box.names.index(r.name): r for r in self.basis.readings() if r.degree or r.frequency}

    @cached_property
    def moving(self) -> list[int]:
        """Variables whose motion matters: those P depends on, unless they stand still."""
        return [i for i in sorted(self.readings)
                if self.box.rate[i] != 0 and self.box.upper[i] > self.box.lower[i]]

    @property
    def unbounded(self) -> bool:
        """In continuous time P may not depend on a variable whose rate has no bound."""
        return self.sample_time is None and any(self.box.rate[i] is None for i in self.moving)

    def reach(self, i: int) -> float:
        """Largest move of variable i in one sample, in its unit.

        Parameters
        ----------
        i : int
            Place in the box.

        Returns
        -------
        float
            Infinite without a rate bound, and in continuous time.
        """
        rate = self.box.rate[i]
        return math.inf if rate is None or self.sample_time is None else rate * self.sample_time

    # -- values ------------------------------------------------------------------------------------------------------
    def psi(self, points: np.ndarray) -> np.ndarray:
        """(N, K) the functions at `points` of shape (N, variables).

        Parameters
        ----------
        points : (N, variables) array
            One column for each variable of the box.

        Returns
        -------
        (N, K) array
            ψ_k.
        """
        return self.basis.evaluate(points[:, self.columns])

    def values(self, points: np.ndarray) -> np.ndarray:
        """(N, n, n) P.

        Parameters
        ----------
        points : (N, variables) array
            One column for each variable of the box.

        Returns
        -------
        (N, n, n) array
            P(p).
        """
        return np.tensordot(self.psi(points), self.matrices, axes=1)

    def magnitudes(self, points: np.ndarray) -> np.ndarray:
        """(N, n, n) Σ |matrix| |ψ|, which bounds the rounding errors of `values`.

        Parameters
        ----------
        points : (N, variables) array
            One column for each variable of the box.

        Returns
        -------
        (N, n, n) array
            Not negative.
        """
        return np.tensordot(np.abs(self.psi(points)), np.abs(self.matrices), axes=1)

    def scheduling_after(self, points: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """(N·T, variables) scheduling one sample later, for moves τ ∈ [0, 1] from the lowest to the highest reached.

        Parameters
        ----------
        points : (N, variables) array
            Scheduling now.
        moves : (T, variables) array
            τ of each variable.

        Returns
        -------
        (N·T, variables) array
            Moves of a point stand together; variables whose motion does not matter stay.
        """
        ahead = np.repeat(points[:, None, :], len(moves), axis=1)
        for i in self.moving:
            low = np.maximum(points[:, i] - self.reach(i), self.box.lower[i])[:, None]
            high = np.minimum(points[:, i] + self.reach(i), self.box.upper[i])[:, None]
            ahead[:, :, i] = low + moves[None, :, i] * (high - low)
        return ahead.reshape(len(points) * len(moves), points.shape[1])

    def later(self, points: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, T, n, n) P one sample later, and its magnitude.

        Parameters
        ----------
        points : (N, variables) array
            Scheduling now.
        moves : (T, variables) array
            τ of each variable.

        Returns
        -------
        ((N, T, n, n) array, (N, T, n, n) array)
            P(p⁺) and Σ |matrix| |ψ|.
        """
        ahead, shape = self.scheduling_after(points, moves), (len(points), len(moves), *self.matrices.shape[1:])
        return self.values(ahead).reshape(shape), self.magnitudes(ahead).reshape(shape)

    def drift(self, points: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, T, n, n) Ṗ = Σ ṗ_i ∂P/∂p_i for ṗ_i = (2τ_i − 1)·rate_i, and its magnitude.

        Parameters
        ----------
        points : (N, variables) array
            Scheduling now.
        moves : (T, variables) array
            τ of each variable.

        Returns
        -------
        ((N, T, n, n) array, (N, T, n, n) array)
            [1/s]; a variable without a rate bound counts as one that does not move.
        """
        drift, size = np.zeros((2, len(points), len(moves), *self.matrices.shape[1:]))
        for i in self.moving:
            slope = self.basis.derivative(points[:, self.columns], self.box.names[i])
            speed = ((self.box.rate[i] or 0.0) * (2 * moves[:, i] - 1))[None, :, None, None]
            drift += np.tensordot(slope, self.matrices, axes=1)[:, None] * speed
            size += np.tensordot(np.abs(slope), np.abs(self.matrices), axes=1)[:, None] * np.abs(speed)
        return drift, size

    def ceilings(self) -> tuple[np.ndarray, np.ndarray]:
        """Entrywise bounds of |P| and |Ṗ| over the box, trigonometric functions over their period.

        Returns
        -------
        ((n, n) array, (n, n) array)
            Not negative; the second one [1/s].
        """
        ceiling = basis_ceilings(self.basis, self.box.limits)
        size = np.tensordot(ceiling, np.abs(self.matrices), axes=1)
        speed = sum((self.box.rate[i] or 0.0) * self._steepness(i) for i in self.moving)
        return size, speed * size

    def _steepness(self, i: int) -> float:
        """Bound of |∂ψ/∂p_i| over sup|ψ|: Bernstein for trigonometric, Markov for piecewise polynomial functions."""
        own = self.readings[i]
        edges = [self.box.lower[i], *(b for b in own.breaks if self.box.lower[i] < b < self.box.upper[i]),
                 self.box.upper[i]]
        return own.frequency + 2 * own.degree**2 / min(np.diff(edges))

    # -- axes --------------------------------------------------------------------------------------------------------
    def axes(self, readings: tuple[Reading, ...], power: int) -> tuple[list[Axis], list[Axis]]:
        """Axes of an inequality of degree `power` in the system's matrices and linear in P: points and moves.

        Parameters
        ----------
        readings : tuple of Reading
            Of the system, one for each variable of the box.
        power : int
            Degree in the system's matrices.

        Returns
        -------
        list of Axis
            Of the points, in the variables' units.
        list of Axis
            Of the moves, τ ∈ [0, 1]; of degree 0 where a motion does not matter.
        """
        points, moves = [], []
        for i, system in enumerate(readings):
            low, high, own = self.box.lower[i], self.box.upper[i], self.readings.get(i, Reading("", 0, 0))
            breaks = (*system.breaks, *own.breaks)
            # at a kink `drift` has the slope of one side only: the cell on the other side would be given a wrong value
            opaque = self.sample_time is None and i in self.moving and bool(own.jumps(low, high))
            move = Axis(0.0, 1.0, 1 if i in self.moving else 0)
            if self.sample_time is not None and i in self.moving:
                everywhere = self.reach(i) >= high - low
                if not everywhere:
                    breaks += (low + self.reach(i), high - self.reach(i))
                    opaque = bool(own.breaks)  # pieces of P(p+) do not end where pieces of P(p) do
                knots = tuple((b - low) / (high - low) for b in own.breaks)
                move = Axis(0.0, 1.0, own.degree, knots, own.frequency * min(high - low, 2 * self.reach(i)))
            points.append(Axis(low, high, power * system.degree + own.degree, breaks,
                               power * system.frequency + own.frequency, opaque))
            moves.append(move)
        return points, moves

    def still(self) -> list[Axis]:
        """Axes of P(p) by itself, over all variables of the box.

        Returns
        -------
        list of Axis
            In the order of the box.
        """
        own = [self.readings.get(i, Reading("", 0, 0)) for i in range(len(self.box.names))]
        return [Axis(low, high, r.degree, r.breaks, r.frequency)
                for low, high, r in zip(self.box.lower, self.box.upper, own, strict=True)]


def symmetric_units(n: int) -> np.ndarray:
    """(n(n+1)/2, n, n) what the unknowns of a symmetric matrix multiply, in the order of `Unknowns.symmetric`.

    Parameters
    ----------
    n : int
        Order.

    Returns
    -------
    (n(n+1)/2, n, n) array
        Ones and zeros.
    """
    rows, columns = np.triu_indices(n)
    units = np.zeros((len(rows), n, n))
    units[np.arange(len(rows)), rows, columns] = units[np.arange(len(rows)), columns, rows] = 1.0
    return units
