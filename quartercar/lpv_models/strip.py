"""E4: where the pair (tanh ξ, tanh ξ/ξ) can lie, and a hull of that which is smaller than the box."""

from __future__ import annotations

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.toolkit import checks
from quartercar.dampers.laws.secant import secant
from quartercar.lpv_models.car_part import with_force
from quartercar.lpv_models.region import Region
from quartercar.lpv_models.yielding import Reach, YieldingLaw
from quartercar.parameters import CarParameters

NAMES = ("saturation", "secant")
"""ρ_1 and ρ_2."""


def pair_box(law: YieldingLaw, reach: Reach, points: int = 21) -> Region:
    """ρ_1 ∈ [−tanh ξ̂, tanh ξ̂], ρ_2 ∈ [tanh ξ̂/ξ̂, 1]: the box of E1, four corners, visited along the curve.

    ξ̂ is the largest |ξ| at the reach. Most of the box is never visited: ρ_1 = ξ ρ_2 ties the two.

    Parameters
    ----------
    law : YieldingLaw
        For the slopes in ξ.
    reach : Reach
        Largest velocity and deflection.
    points : int
        Visited points along the curve, ξ evenly spaced.

    Returns
    -------
    Region
        Over `NAMES`, both dimensionless.
    """
    ends = _curve(law, reach, 2)[-1]
    corners = np.array([[a, b] for a in (-ends[0], ends[0]) for b in (ends[1], 1.0)])
    return Region(NAMES, corners, _curve(law, reach, points), _source(law, reach))


def pair_hull(law: YieldingLaw, reach: Reach, tangents: int = 1, points: int = 21) -> Region:
    """The curve's chord below, tangents to it above: a polygon around ρ_2 = |ρ_1|/artanh|ρ_1| (E4).

    The curve is concave and lies in the strip 1 − ρ_1² ≤ ρ_2 ≤ 1 − ρ_1²/3 (equation sheet 4.3). A tangent at the top,
    one at each end and `tangents` in between on each side give 2·tangents + 4 corners.

    Parameters
    ----------
    law : YieldingLaw
        For the slopes in ξ.
    reach : Reach
        Largest velocity and deflection.
    tangents : int
        Tangents on each side between the top and the end.
    points : int
        Visited points along the curve, ξ evenly spaced.

    Returns
    -------
    Region
        Over `NAMES`, both dimensionless.

    Examples
    --------
    >>> law = YieldingLaw(800.0, 0.0, 10.0, 0.0, 100.0, 1000.0)
    >>> areas = [pair_hull(law, Reach(0.3), count).volume for count in (1, 8)]
    >>> [round(area / pair_box(law, Reach(0.3)).volume, 2) for area in areas]
    [0.86, 0.79]
    """
    far = reach.argument(law)
    xi = np.linspace(0.0, far, checks.count(tangents, "tangents") + 2)
    rho1, rho2 = np.tanh(xi), secant(xi)
    square = 1 / np.cosh(xi) ** 2
    along = np.column_stack([square * xi**2, square * xi - rho1])  # the curve's direction (dρ_1, dρ_2)
    along[0] = 1.0, 0.0
    right = [_crossing((rho1[j], rho2[j]), along[j], (rho1[j + 1], rho2[j + 1]), along[j + 1])
             for j in range(len(xi) - 1)]
    right.append((float(rho1[-1]), float(rho2[-1])))
    corners = np.array([*right, *((-x, y) for x, y in reversed(right))])
    return Region(NAMES, corners, _curve(law, reach, points), _source(law, reach))


def pair_plant(parameters: CarParameters, law: YieldingLaw, region: Region, control: str) -> LPVStateSpace:
    """The car with F = c_0 v_d + k_0 z_d + F_0 ρ_2 ξ + ρ_1 u between its masses (E1).

    Parameters
    ----------
    parameters : CarParameters
    law : YieldingLaw
    region : Region
        Of ρ_1 and ρ_2.
    control : str
        Name of u [N].

    Returns
    -------
    LPVStateSpace
        Continuous.
    """
    none = np.zeros(1)
    rows = {"": (law.linear, none), "saturation": (np.zeros(4), np.ones(1)),
            "secant": (law.middle * law.argument, none)}
    return with_force(parameters, rows, region, (Signal(control, "N"),))


def _crossing(a, along_a, b, along_b) -> tuple[float, float]:
    """Where two lines through points a and b meet."""
    gap = np.subtract(b, a)
    share = (gap[0] * along_b[1] - gap[1] * along_b[0]) / (along_a[0] * along_b[1] - along_a[1] * along_b[0])
    return float(a[0] + share * along_a[0]), float(a[1] + share * along_a[1])


def _curve(law: YieldingLaw, reach: Reach, points: int) -> np.ndarray:
    far = reach.argument(law)
    xi = np.linspace(-far, far, points)
    return np.column_stack([np.tanh(xi), secant(xi)])


def _source(law: YieldingLaw, reach: Reach) -> str:
    return f"|xi| <= {reach.argument(law):.3g} from {reach.speed:g} m/s and {reach.stroke:g} m"
