"""Points of a test: peak-velocity forces (PVP) and forces along the cycle at given speeds (CVP)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from quartercar.characterisation.cycles import Block, RecordedCycle
from quartercar.characterisation.local_fit import APART, LEAST, LocalFit, local_fit
from quartercar.characterisation.settings import CENTRE
from quartercar.dampers.bench.static_characteristic import SAME_SPEED

DIRECTIONS = {1: "rebound", -1: "compression"}
"""Sign of the velocity by the name of the direction."""
FEWEST_SAMPLES = 3
"""samples of a peak-velocity point, for a line and one to spare"""


@dataclass(frozen=True, eq=False)
class PeakPoint:
    """Speed and force at mid stroke, over the central tenth of it.

    Attributes
    ----------
    block : Block
    direction : {1, −1}
        1 in rebound.
    speed, force : float
        |v| [m/s], force [N], means over the settled cycles.
    std, spread : float
        Standard error of the mean and standard deviation between cycles [N]; NaN from one cycle.
    by_cycle : (n,) array
        Force of every cycle, the first included [N].
    """

    block: Block
    direction: int
    speed: float
    force: float
    std: float
    spread: float
    by_cycle: np.ndarray


@dataclass(frozen=True, eq=False)
class BranchForce:
    """Force at one speed of the cycles of a block.

    Attributes
    ----------
    block : Block
    direction : {1, −1}
    speed : float
        [m/s].
    force, std : float
        Mean of the two branches over the settled cycles [N].
    hysteresis : float
        Force while the speed rises minus the force while it falls [N], positive where |F| is larger while it rises.
    last : float
        Mean of the two branches of the last complete cycle [N].
    extrapolated : bool
        Whether the speed lies beyond the cycle's, by at most 5 %.
    """

    block: Block
    direction: int
    speed: float
    force: float
    std: float
    hysteresis: float
    last: float
    extrapolated: bool


def peak_point(block: Block, direction: int, force: np.ndarray | None = None) -> PeakPoint | None:
    """Force at mid stroke, from a line over the displacement in the central tenth of the stroke.

    |x − x_c| ≤ 0.05 (x_max − x_min); F = β_0 + β_1 (x − x_c), and β_0 is the point; the same for the speed.

    Parameters
    ----------
    block : Block
    direction : {1, −1}
    force : (n,) array, optional
        Another force along the same run, e.g. that of a model [N].

    Returns
    -------
    PeakPoint or None
        None where no cycle has samples enough in this direction.
    """
    values = block.run.force if force is None else force
    rows = [r for c in block.cycles if (r := _centre(c, values[c.span], direction)) is not None]
    if not rows:
        return None
    found = np.array(rows)
    kept = found[block.is_settled] if len(found) == len(block.cycles) else found
    n = len(kept)
    spread = float(kept[:, 1].std(ddof=1)) if n > 1 else float("nan")
    return PeakPoint(block, direction, float(kept[:, 0].mean()), float(kept[:, 1].mean()), spread / np.sqrt(n), spread,
                     found[:, 1])


def disagreeing(found: Sequence[PeakPoint]) -> tuple[str, ...]:
    """Tests of one speed, current and direction whose forces differ: other frequencies, settings or specimens.

    Within 5 % of the speed a force that grows with its square differs by 10 %; more, and more than three standard
    errors, is another damper, or where the frequencies differ what is elastic or inertial.

    Parameters
    ----------
    found : sequence of PeakPoint

    Returns
    -------
    tuple of str
        One caveat on the furthest pair, or none.
    """
    pairs = [(a, b) for a, b in combinations(found, 2)
             if (a.block.run.specimen, a.block.run.level, a.direction) == (b.block.run.specimen, b.block.run.level,
                                                                           b.direction)
             and abs(a.speed / b.speed - 1) <= SAME_SPEED and a.block.run.name != b.block.run.name
             and abs(a.force - b.force) > max(2 * SAME_SPEED * max(abs(a.force), abs(b.force)),
                                              APART * float(np.hypot(*np.nan_to_num((a.std, b.std)))))]
    if not pairs:
        return ()
    a, b = max(pairs, key=lambda pair: abs(pair[0].force - pair[1].force))
    low, high = sorted((a.block.frequency, b.block.frequency))
    why = ("Records of several settings, gas pressures or specimens: --specimen keeps them apart."
           if high <= (1 + SAME_SPEED) * low else
           f"The tests are of {low:.3g} and {high:.3g} Hz: what is elastic or inertial in damper, mount and fixture "
           "differs then; or the records are of several settings, gas pressures or specimens, which --specimen keeps "
           "apart.")
    return (f"Tests of one speed disagree: {a.force:.4g} N in '{a.block.run.name}' and {b.force:.4g} N in "
            f"'{b.block.run.name}', {DIRECTIONS[a.direction]} at {1e3 * a.speed:.3g} mm/s. {why}",)


def _centre(cycle: RecordedCycle, force: np.ndarray, direction: int) -> tuple[float, float] | None:
    off = cycle.displacement - cycle.centre
    way = direction * cycle.velocity > 0
    if not way.any():
        return None
    inside = way & (np.abs(off) <= CENTRE * cycle.amplitude)
    if inside.sum() < FEWEST_SAMPLES:
        order = np.argsort(np.where(way, np.abs(off), np.inf))[:FEWEST_SAMPLES]
        if not np.isfinite(np.where(way, off, np.inf)[order]).all():
            return None
        inside = np.zeros(off.size, dtype=bool)
        inside[order] = True
    design = np.column_stack([np.ones(int(inside.sum())), off[inside] / cycle.amplitude])
    beta = np.linalg.lstsq(design, np.column_stack([direction * cycle.velocity[inside], force[inside]]), rcond=None)[0]
    return float(beta[0, 0]), float(beta[0, 1])


def branch_force(block: Block, direction: int, speed: float, force: np.ndarray | None = None) -> BranchForce | None:
    """Force at a speed: a local parabola over the velocity on each branch, pooled over the settled cycles.

    The branch of rising speed lies before mid stroke, that of falling speed behind it; their mean is free of the
    displacement's part and, to first order, of delays. None where the cycle is slower than 95 % of the speed.

    Parameters
    ----------
    block : Block
    direction : {1, −1}
        1 in rebound.
    speed : float
        [m/s].
    force : (n,) array, optional
        Another force along the same run, e.g. that of a model [N].

    Returns
    -------
    BranchForce or None
        None also where a branch has too few samples about the speed.
    """
    values = block.run.force if force is None else force
    both = [_branch(block.settled, values, direction, speed, side) for side in (-1, 1)]
    rising, falling = both
    if rising is None or falling is None:
        return None
    last = [_branch(block.cycles[-1:], values, direction, speed, side) for side in (-1, 1)]
    ends = [f.value for f in last if f is not None]
    return BranchForce(block, direction, speed, 0.5 * (rising.value + falling.value),
                       0.5 * float(np.hypot(rising.std, falling.std)), direction * (rising.value - falling.value),
                       float(np.mean(ends)) if len(ends) == 2 else float("nan"),
                       max(rising.outside, falling.outside) > 0)


def _branch(cycles: tuple[RecordedCycle, ...], force: np.ndarray, direction: int, speed: float,
            side: int) -> LocalFit | None:
    """The local fit on one branch: `side` −1 before mid stroke, 1 behind."""
    parts = []
    for k, c in enumerate(cycles):
        keep = (direction * c.velocity > 0) & (side * direction * (c.displacement - c.centre) >= 0)
        parts.append((direction * c.velocity[keep] - speed, force[c.span][keep], np.full(int(keep.sum()), k)))
    u, y, group = (np.concatenate(column) for column in zip(*parts, strict=True))
    if u.size < LEAST or float(u.max()) < -SAME_SPEED * speed:
        return None
    return local_fit(u, y, group, speed)
