"""Figures of a closed loop: what it was promised to do, and what it was then found to do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lpvid.analysis.covariance import output_bound
from lpvid.analysis.gain import l2_gain
from lpvid.analysis.pole_regions import certify_region
from lpvid.codec import Encoded
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis
from lpvid.synthesis.criteria import CovarianceCriterion, Criterion, Region
from lpvid.synthesis.generalized_plant import GeneralizedPlant

GRID = {0: 1, 1: 81, 2: 13, 3: 6}
"""Points per scheduling variable at which frozen poles are looked at; 3 for more variables."""


@dataclass(frozen=True, eq=False)
class Figure(Encoded):
    """One criterion of a design, promised and verified.

    Parameters
    ----------
    criterion : str
        "H-infinity", "H2" or "generalized H2".
    channel : str
        From what to what.
    promised : float
        What the matrix inequalities gave.
    verified : float
        Bound of the closed loop with the controller as returned; infinite where none was found.
    lower : float or None
        A value that the closed loop reaches.
    between_grid : bool
        `verified` holds on the whole box, or what `region` names.
    certificate : object or None
        What `lpvid.verify` re-checks.
    region : str
        The scheduling set: "box" or "polytope".
    """

    JSON = ("criterion", "channel", "promised", "verified", "lower", "between_grid")

    criterion: str
    channel: str
    promised: float
    verified: float
    lower: float | None
    between_grid: bool
    certificate: Any = None
    region: str = "box"

    def __str__(self) -> str:
        where = f"on the whole {self.region}" if self.between_grid else "at the points of a grid only"
        return (f"{self.criterion} from {self.channel}: at most {self.verified:.6g} (promised {self.promised:.6g}), "
                f"{where}")


def channel(loop: LPVStateSpace, into: Sequence[int], out: Sequence[int]) -> LPVStateSpace:
    """The closed loop between some of its signals.

    Parameters
    ----------
    loop : LPVStateSpace
        Closed loop.
    into, out : sequence of int
        Places of its inputs and outputs, in the order wanted.

    Returns
    -------
    LPVStateSpace
        Same states, without offsets, observer gain and noise.
    """
    j, i = list(into), list(out)
    return replace(loop, B=loop.B[:, :, j], C=loop.C[:, i], D=loop.D[:, i][:, :, j], state_offset=None,
                   output_offset=None, observer_gain=None, noise_covariance=None,
                   inputs=tuple(loop.inputs[k] for k in j), outputs=tuple(loop.outputs[k] for k in i))


def measure(criterion: Criterion, plant: GeneralizedPlant, loop: LPVStateSpace, promised: float,
            storage: Basis | None = None) -> Figure:
    """What a closed loop, with signals in the order of a plant's, does in the channel of a criterion.

    `storage` are the functions of the storage function that is looked for; None leaves them to the analysis.

    Parameters
    ----------
    criterion : Criterion
        Names the channel.
    plant : GeneralizedPlant
        For the places of the channel's signals.
    loop : LPVStateSpace
        Closed loop w → z.
    promised : float
        Level that the inequalities gave.
    storage : Basis, optional
        Functions of the scheduling.

    Returns
    -------
    Figure
        `verified` is infinite where no bound was found.
    """
    part = channel(loop, *criterion.indices(plant))
    if isinstance(criterion, CovarianceCriterion):
        found = output_bound(part, criterion.peak, basis=storage)
        verified = found.upper if part.box.names else found.lower  # the Lyapunov equation has the norm itself
        return Figure(criterion.kind, criterion.description(plant), promised, verified, found.lower,
                      found.between_grid or not part.box.names)
    found = l2_gain(part, basis=storage, trajectories=False)
    return Figure("H-infinity", criterion.description(plant), promised, _finite(found.upper), found.lower,
                  found.between_grid, found.certificate)


def stays_inside(regions: Sequence[Region], loop: LPVStateSpace) -> tuple[bool, tuple[str, ...]]:
    """Whether the frozen poles of a loop are stable and lie in all regions, with a remark on each region.

    Parameters
    ----------
    regions : sequence of Region
        Where frozen poles are wanted.
    loop : LPVStateSpace
        Closed loop; its poles are looked at on a grid of the box.

    Returns
    -------
    bool
        False where a frozen pole at a point of the grid is not stable or lies outside.
    tuple of str
        One remark for each region; empty with False.
    """
    points = loop.box.grid(GRID.get(len(loop.box.names), 3))
    poles = np.linalg.eigvals(loop.at(points)[0]).ravel() if loop.order else np.empty(0)
    if not np.all(np.abs(poles) < 1 if loop.is_discrete else poles.real < 0):
        return False, ()
    if any(float(r.distance(poles).max(initial=-1.0)) >= 0 for r in regions):
        return False, ()
    notes = []
    for region in regions:
        found = certify_region(loop, region)
        where = "in the whole box" if found.between_grid else f"at {len(points)} points, not proven between them"
        notes.append(f"frozen poles lie in {region!r} {where}")
    return True, tuple(notes)


def _finite(value: float | None) -> float:
    return math.inf if value is None or not math.isfinite(value) else float(value)
