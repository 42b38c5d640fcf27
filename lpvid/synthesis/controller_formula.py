"""The controller of a pair X(p), Y(p), as a formula that holds at every value of the scheduling."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from lpvid.scheduling import Basis, Scheduling
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.design_grid import columns
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.projected_half import Variation
from lpvid.synthesis.projection import MatrixPair
from lpvid.synthesis.reconstruction import (
    LyapunovPair,
    closed_through,
    controller_at,
    dual,
    feedthrough,
    with_largest_noise,
)
from lpvid.synthesis.scaling import Matrices


@dataclass(frozen=True, eq=False)
class Variations:
    """How X and Y may vary.

    Parameters
    ----------
    basis : Basis or None
        Bound to the box; None for constants.
    varying : str
        "both", "controls" (only X) or "measurements" (only Y).
    box : Scheduling
        With rate bounds.
    """

    basis: Basis | None
    varying: str
    box: Scheduling

    @property
    def moving(self) -> tuple[str, ...]:
        """Variables whose motion changes X or Y."""
        names = self.basis.names if self.basis is not None else ()
        return tuple(n for n in names if self.box.rate[self.box.names.index(n)] != 0
                     and self.box.upper[self.box.names.index(n)] > self.box.lower[self.box.names.index(n)])

    @property
    def corners(self) -> np.ndarray:
        """(T, len(moving)) extreme rates [units/s]; one row of zero length where nothing moves."""
        limits = [self.box.rate[self.box.names.index(n)] or 0.0 for n in self.moving]
        return np.array(list(itertools.product(*([-r, r] for r in limits)))).reshape(2 ** len(limits), len(limits))

    @property
    def rated(self) -> bool:
        """X and Y both move, so that the controller needs the rate of the scheduling."""
        return self.varying == "both" and bool(self.moving)

    def at(self, points: np.ndarray, time: float) -> tuple[Variation, Variation]:
        """Of X and of Y, with slopes in the time of the balanced plant.

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the units of the box.
        time : float
            Pace of the balanced plant [1/s], `Units.time`: physical slopes over it.

        Returns
        -------
        (Variation, Variation)
            Of X and of Y; constant where it does not vary.
        """
        still = Variation.constant(len(points))
        still = Variation(still.values, np.zeros((len(points), len(self.corners), 1)))
        if self.basis is None:
            return still, still
        own = Variation(columns(self.box, self.basis, points),
                        np.einsum("tv,nvk->ntk", self.corners / time, self.gradients(points)))
        return (still if self.varying == "measurements" else own), (still if self.varying == "controls" else own)

    def gradients(self, points: np.ndarray) -> np.ndarray:
        """(N, len(moving), K) ∂ψ/∂p_i per physical unit.

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the units of the box.

        Returns
        -------
        (N, len(moving), K) array
            K functions of the basis; (N, 0, 1) without one.
        """
        if self.basis is None:
            return np.zeros((len(points), 0, 1))
        own = points[:, [self.box.names.index(n) for n in self.basis.names]]
        slopes = [self.basis.derivative(own, n) for n in self.moving]
        return np.stack(slopes, axis=1) if slopes else np.zeros((len(points), 0, self.basis.size))


class FeedbackLaw(Protocol):
    """A controller for every p, with the storage function of its closed loop and the bound that this keeps."""

    @property
    def plant(self) -> BalancedPlant:
        """The plant."""
        ...

    @property
    def variations(self) -> Variations:
        """Of X and Y."""
        ...

    @property
    def gamma(self) -> float:
        """The bound."""
        ...

    def at(self, points: np.ndarray) -> tuple[Matrices, np.ndarray]:
        """The controller at ṗ = 0, and how A_K depends on the rates.

        Parameters
        ----------
        points : (N, n_scheduling) array

        Returns
        -------
        (A, B, C, D), each (N, …)
        (N, n_rates, n, n) array
            ∂A_K/∂ṗ_i
        """
        ...

    def storage(self, points: np.ndarray) -> LoopStorage:
        """Of the closed loop.

        Parameters
        ----------
        points : (N, n_scheduling) array

        Returns
        -------
        LoopStorage
        """
        ...


@dataclass(frozen=True, eq=False)
class ControllerFormula:
    """A controller for every p, with the storage function of its closed loop.

    Parameters
    ----------
    plant : BalancedPlant
    variations : Variations
    pair : MatrixPair
        In coordinates x = `inner`·x' of the balanced plant, in which the means of X and Y are one diagonal matrix.
    inner : (n, n) array
    gamma : float
    efforts : ((n_u, n_u) array, (n_y, n_y) array)
        Fictitious effort of the controls and noise of the measurements, to be added to D12ᵀD12 and D21D21ᵀ.
    outer : (n, n) array
        x_K as returned is this times x_K of the formula.
    """

    plant: BalancedPlant
    variations: Variations
    pair: MatrixPair
    inner: np.ndarray
    gamma: float
    efforts: tuple[np.ndarray, np.ndarray]
    outer: np.ndarray

    @classmethod
    def gentle(cls, plant: BalancedPlant, variations: Variations, pair: MatrixPair, gamma: float, points: np.ndarray
               ) -> ControllerFormula | None:
        """The formula with as much fictitious effort and noise as the bound allows at the points; None for no bound.

        Parameters
        ----------
        plant : BalancedPlant
            What is designed for.
        variations : Variations
            How X and Y may vary.
        pair : MatrixPair
            X and Y of the search.
        gamma : float
            Bound of the gain w → z, the same in balanced units.
        points : (N, n_scheduling) array
            Where the bound is kept.

        Returns
        -------
        ControllerFormula or None
            None where the pair keeps no bound at some point, also by rounding.
        """
        n = pair.x.shape[1]
        try:
            pair, inner = _balanced(variations, pair, points)
            none = np.zeros((0, 0))
            draft = cls(plant, variations, pair, inner, gamma, (none, none), np.eye(n))
            at, v = draft._plant(points), draft._lyapunov(points)
            parts = v.blocks()
            for p in parts:
                np.linalg.cholesky(p)
            at = closed_through(at, feedthrough(at, gamma))
        except np.linalg.LinAlgError:
            return None
        noise = with_largest_noise(at, v.y, v.y_slope, gamma)
        effort = with_largest_noise(dual(at), v.x, -v.x_slope, gamma)
        if noise is None or effort is None:
            return None
        return cls(plant, variations, pair, inner, gamma, (effort[1], noise[1]),
                   np.linalg.cholesky(parts[1].mean(axis=0)).T)

    def at(self, points: np.ndarray) -> tuple[Matrices, np.ndarray]:
        """The controller (N, …) at ṗ = 0, and ∂A_K/∂ṗ_i as (N, len(moving), n, n); none if it does not depend on ṗ.

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the plant's units.

        Returns
        -------
        (A, B, C, D), each (N, …)
            For the plant's own sensors, controls and kind of time.
        (N, n_rates, n, n) array
            ∂A_K/∂ṗ_i; no rates unless X and Y both move.
        """
        at, v = self._plant(points), self._lyapunov(points)
        a, b, c, d = controller_at(at, v, self.gamma, self.efforts, feedthrough(at, self.gamma))
        q, back = self.outer, np.linalg.inv(self.outer)
        k = self.plant.controller((q @ a @ back, q @ b, c @ back, d), points)
        slopes = np.zeros((len(points), len(self.variations.moving) * self.variations.rated, *q.shape))
        if self.variations.rated:
            gradients = np.einsum("nvk,kij->nvij", self.variations.gradients(points), self.pair.x)
            for i in range(gradients.shape[1]):
                slopes[:, i] = q @ v.drift(gradients[:, i]) @ back
        return k, slopes

    def storage(self, points: np.ndarray) -> LoopStorage:
        """Of the closed loop with [x; x_K], both as the plant and the returned controller have them.

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the plant's units.

        Returns
        -------
        LoopStorage
            With slopes per second.
        """
        v, d = self._lyapunov(points), self.plant.units.states[:, None] * self.inner
        zero, q = np.zeros_like(d), self.outer
        first, second, first_slope, second_slope = (*v.blocks(), *v.block_slopes())
        mix = np.block([[d, zero], [-q, q]]) if v.by_measurements else np.block([[d, d], [zero, q]])
        time = self.plant.units.time
        return LoopStorage(first, second, time * first_slope, time * second_slope, mix)

    def _plant(self, points: np.ndarray) -> PlantMatrices:
        at, t = self.plant.at(points), self.inner
        back = np.linalg.inv(t)
        return replace(at, A=back @ at.A @ t, B1=back @ at.B1, B2=back @ at.B2, C1=at.C1 @ t, C2=at.C2 @ t)

    def _lyapunov(self, points: np.ndarray) -> LyapunovPair:
        x, y = self.variations.at(points, self.plant.units.time)
        return LyapunovPair(x.at(self.pair.x), y.at(self.pair.y), x.slope(self.pair.x), y.slope(self.pair.y),
                            self.variations.varying != "controls" or not self.variations.moving)


def _balanced(variations: Variations, pair: MatrixPair, points: np.ndarray) -> tuple[MatrixPair, np.ndarray]:
    """The pair where its two means are one diagonal matrix, and the coordinates in which they are.

    By factors, as in balanced truncation: X and Y apart differ less than their product does from the identity.
    """
    x, y = variations.at(points, 1.0)
    first = np.linalg.cholesky(x.at(pair.x).mean(axis=0))
    second = np.linalg.cholesky(y.at(pair.y).mean(axis=0))
    u, s, vt = np.linalg.svd(second.T @ first)
    t, back = first @ vt.T / np.sqrt(s), (u / np.sqrt(s)).T @ second.T
    return replace(pair, x=_symmetric(back @ pair.x @ back.T), y=_symmetric(t.T @ pair.y @ t)), t


def _symmetric(m: np.ndarray) -> np.ndarray:
    return 0.5 * (m + m.swapaxes(1, 2))
