"""A plant as the inequalities of output feedback see it: continuous, in balanced units, without path from u to y."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from lpvid.scheduling import Basis, Polynomial, Product, Spline
from lpvid.scheduling.reading import Reading
from lpvid.synthesis.bilinear import around_feedthrough, plant_to_continuous, sign_for, to_discrete
from lpvid.synthesis.design_grid import design_axes, is_affine, tensor, varies
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.scaling import Matrices, Units

WAVE = 9
"""values between two knots at which a trigonometric dependence is looked at, beyond one for each half wave"""
GOLDEN = (np.sqrt(5.0) - 1) / 2
"""share of an interval by which such values go on, modulo one: no two lie a simple fraction of a period apart"""
MOST = 20_000
"""Points at which a plant is looked at for variables along which it is linear: a second's worth."""


@dataclass(frozen=True, eq=False)
class BalancedPlant:
    """A plant with the way there and back.

    Parameters
    ----------
    plant : GeneralizedPlant
    sign : float or None
        Of the bilinear transformation; None in continuous time.
    units : Units
    """

    plant: GeneralizedPlant
    sign: float | None
    units: Units

    @classmethod
    def of(cls, plant: GeneralizedPlant, points: np.ndarray) -> BalancedPlant:
        """Balanced over the given points (N, n_scheduling).

        Parameters
        ----------
        plant : GeneralizedPlant
            Continuous or discrete.
        points : (N, n_scheduling) array
            Where its matrices are balanced and, in discrete time, the sign is chosen.

        Returns
        -------
        BalancedPlant
            The plant with its units.
        """
        at = plant.at(points)
        sign = None if plant.sample_time is None else sign_for(at.A)
        return cls(plant, sign, Units.of(at if sign is None else plant_to_continuous(at, sign)))

    def at(self, points: np.ndarray) -> PlantMatrices:
        """The balanced blocks, with D22 = 0: y is what the sensors show less what the controls add directly.

        Parameters
        ----------
        points : (N, n_scheduling) array
            Scheduling values, in the plant's units.

        Returns
        -------
        PlantMatrices
            Continuous, (N, …) each.
        """
        at = self.units.apply(self._continuous(points))
        return replace(at, D22=np.zeros_like(at.D22))

    def controller(self, k: Matrices, points: np.ndarray) -> Matrices:
        """A controller of the balanced plant, for the sensors and the time of the plant itself.

        Parameters
        ----------
        k : (A, B, C, D), each (N, …)
            Controller of the balanced plant at the points.
        points : (N, n_scheduling) array
            Where D22 is taken.

        Returns
        -------
        (A, B, C, D), each (N, …)
            Discrete where the plant is.
        """
        k = around_feedthrough(self.units.controller(k), self._continuous(points).D22)
        return k if self.sign is None else to_discrete(k, self.sign)

    def _continuous(self, points: np.ndarray) -> PlantMatrices:
        at = self.plant.at(points)
        return at if self.sign is None else plant_to_continuous(at, self.sign)


def corners_suffice(plant: GeneralizedPlant) -> bool:
    """Inequalities with one X and Y, imposed at `convex_axes`, then hold in the whole box.

    The plant is a convex combination of its values there, and what multiplies the controller does not vary.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its matrices and its box.

    Returns
    -------
    bool
        True also for a box without width.
    """
    if not plant.box.half_width.any():
        return True
    if not _convex(plant.system.basis):
        return False
    at = plant.at(tensor(convex_axes(plant)))
    return not at.D22.any() and not any(varies(m) for m in (at.B2, at.D12, at.C2, at.D21))


def linear_axes(plant: GeneralizedPlant, moving: Basis | None) -> dict[str, np.ndarray]:
    """Variables along which values at a few points stand for all between them, with these values.

    X and Y do not depend on them, the plant is linear in each between its knots, and what multiplies the controller
    does not vary with them: for fixed values of the other variables the loop with a controller that is linear between
    the same points is a convex combination of the loops there, and its inequality one of theirs.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its matrices and its box.
    moving : Basis or None
        Functions of X and Y.

    Returns
    -------
    dict of name to array
        Rising values, those of `convex_axes`.
    """
    box, axes = plant.box, dict(zip(plant.box.names, convex_axes(plant), strict=True))
    free = [n for n in box.names if len(axes[n]) > 1 and n not in (moving.names if moving is not None else ())]
    looked = dict(axes)
    for reading in plant.system.basis.readings():
        if reading.name in free and (reading.degree > 1 or reading.frequency or reading.lag):
            free.remove(reading.name)
        if len(axes[reading.name]) > 1:
            looked[reading.name] = _sampled(reading, axes[reading.name])
    if not free or np.prod([len(a) for a in looked.values()]) > MOST:
        return {}
    inside = tensor(tuple(looked.values()))
    at, found = plant.at(inside), {}
    if at.D22.any():
        return {}
    for name in free:
        others = np.delete(inside, box.names.index(name), axis=1)
        groups = np.unique(others, axis=0, return_inverse=True)[1].ravel()
        if not any(varies(m[groups == g]) for m in (at.B2, at.D12, at.C2, at.D21) for g in range(groups.max() + 1)):
            found[name] = axes[name]
    return found


def _sampled(reading: Reading, axis: np.ndarray) -> np.ndarray:
    """Values at which a function that is zero there is zero: one more than its degree between every two knots.

    A trigonometric polynomial has a zero for each half wave at most, evenly spaced where it is one sine: so many values
    and `WAVE` more, by the golden section, which no such spacing meets.
    """
    edges = np.unique([axis[0], *(b for b in reading.breaks if axis[0] < b < axis[-1]), axis[-1]])
    pieces = []
    for a, b in itertools.pairwise(edges):
        waves = WAVE + int(np.ceil(reading.frequency * (b - a) / np.pi))
        between = np.arange(1, waves + 1) * GOLDEN % 1 if reading.frequency else np.linspace(0, 1, reading.degree + 1)
        pieces.append(a + (b - a) * between)
    return np.union1d(axis, np.concatenate([edges, *pieces]))


def varying_signals(plant: GeneralizedPlant) -> str:
    """Which signals' gains vary with the scheduling, so that corners are not enough; empty for none.

    Parameters
    ----------
    plant : GeneralizedPlant
        Looked at on three points per scheduling variable.

    Returns
    -------
    str
        Names, controls before measurements, with commas between.
    """
    at = plant.at(plant.box.grid(3))
    moving = [n for j, n in enumerate(plant.controls)
              if varies(at.B2[:, :, j]) or varies(at.D12[:, :, j])]
    moving += [n for j, n in enumerate(plant.measurements)
               if varies(at.C2[:, j]) or varies(at.D21[:, j])]
    return ", ".join(moving)


def convex_axes(plant: GeneralizedPlant) -> tuple[np.ndarray, ...]:
    """Ends of the box and, for a gridded plant, its grid.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its box and the knots of its basis.

    Returns
    -------
    tuple of arrays
        Rising values of each scheduling variable; one value where it has no width.
    """
    ends = design_axes(plant.box, 2, True)
    inside = plant.system.basis.knots_of
    return tuple(np.unique(np.concatenate([a, [k for k in inside.get(n, ()) if a[0] < k < a[-1]]]))
                 for n, a in zip(plant.box.names, ends, strict=True))


def _convex(basis: Basis) -> bool:
    if isinstance(basis, Product):
        first, second = basis.factors[0], basis.factors[1]
        separate = len(basis.factors) == 2 and not set(first.names) & set(second.names)
        return separate and _convex(first) and _convex(second)
    return (isinstance(basis, Spline) and basis.order == 1) or (isinstance(basis, Polynomial) and is_affine(basis))
