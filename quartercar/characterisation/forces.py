"""Forces at standard speeds: for every specimen, current and direction the force, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.cycles import FEWEST, Block, least_stroke
from quartercar.characterisation.local_fit import APART, local_fit
from quartercar.characterisation.points import DIRECTIONS, BranchForce, branch_force, peak_point
from quartercar.characterisation.runs import RecordPiece
from quartercar.dampers.bench.static_characteristic import SAME_SPEED
from quartercar.dampers.bench.strokes import turning_points

SLICES = 20
"""Stretches of a random record that count as independent for its standard error: enough for a 16 % error of it."""
LONGEST_STROKE = 0.05
"""Amplitude [m] of the sine that is proposed; a faster test takes a higher frequency."""


class TooSlow(str):
    """Why there is no force: no test is as fast."""

    __slots__ = ()


class Between(str):
    """Why there is no force: no test has this speed, and only triangles are faster."""

    __slots__ = ()


@dataclass(frozen=True)
class StandardForce:
    """Force at one speed.

    Attributes
    ----------
    specimen : str
    current : float or None
        Held current; None where it was not recorded.
    direction : {1, −1}
    speed : float
        [m/s].
    force : float or None
        Positive in tension [N].
    std : float or None
        Standard error, from the spread over cycles [N].
    hysteresis : float or None
        Force while the speed rises minus the force while it falls [N].
    last : float or None
        Of the last complete cycle [N].
    source : str
        Record and test that it was read from.
    method : {"sine", "triangle", "periodic", "random", ""}
    cycles : int
    why : str
        Why there is no force; empty where there is one.
    modelled : float or None
        The model's force by the same estimator along the same run [N].
    """

    specimen: str
    current: float | None
    direction: int
    speed: float
    force: float | None = None
    std: float | None = None
    hysteresis: float | None = None
    last: float | None = None
    source: str = ""
    method: str = ""
    cycles: int = 0
    why: str = ""
    modelled: float | None = None


Key = tuple[str, float | None]
"""Specimen and held current (None where it was not recorded)."""


def _keys_of(runs: Sequence[RecordPiece]) -> list[Key]:
    """Specimens and currents of the runs with a force at one current, in order."""
    found = dict.fromkeys((r.specimen, r.level) for r in runs if r.has_force and r.current != "varies")
    return sorted(found, key=lambda k: (k[0], -np.inf if k[1] is None else k[1]))


def standard_forces(runs: Sequence[RecordPiece], blocks: Sequence[Block], speeds: Sequence[float],
                    models: Mapping[int, np.ndarray]) -> tuple[StandardForce, ...]:
    """The table of forces.

    Each is read from the cycles whose peak speed is the least that reaches the speed (within 5 %), and of those from
    the block with most cycles: there the force is nearest to a steady one. Where the speed lies beyond those cycles and
    the next faster block has it with a third of their standard error, from that block. A triangle serves only at its
    own speed. Where no cycle reaches it, from random motion of three strokes or more. A force whose two branches differ
    by more than half the difference of the two directions is not given: it is elastic or inertial. Nor is one at whose
    speed, within 5 %, the measured force rests on an end of its range: what it reads there is the range.

    Parameters
    ----------
    runs : sequence of RecordPiece
    blocks : sequence of Block
    speeds : sequence of float
        [m/s].
    models : mapping
        Simulated force along a run, by the run's `id`; may be empty.

    Returns
    -------
    tuple of StandardForce
        One for every specimen, current, direction and speed, in this order; without a force where the records hold
        none.
    """
    rows = []
    for specimen, level in _keys_of(runs):
        own = [b for b in blocks if (b.run.specimen, b.run.level) == (specimen, level) and b.run.current != "varies"]
        loose = [r for r in runs if (r.specimen, r.level) == (specimen, level) and r.current != "varies"
                 and r.has_force and not any(b.run is r for b in own)]
        for direction in DIRECTIONS:
            rows += [_force(specimen, level, direction, v, own, loose, models) for v in speeds]
    return tuple(rows)


def _force(specimen: str, level: float | None, direction: int, speed: float, own: Sequence[Block],
           loose: Sequence[RecordPiece], models: Mapping[int, np.ndarray]) -> StandardForce:
    reaching = sorted((b for b in own if b.peak >= (1 - SAME_SPEED) * speed),
                      key=lambda b: (round(b.peak / speed / SAME_SPEED), -len(b.cycles)))
    elastic: BranchForce | None = None
    beyond: StandardForce | None = None
    cut = ""
    for block in reaching:
        if any(_cut_off(block.run, direction, speed, c.span) for c in block.settled):
            cut = cut or f"{block.run.name}: {block.label}"
            continue
        if block.kind == "triangle":
            row = _from_triangle(block, direction, speed, models)
            if row is not None:
                return _surer(beyond, row)
            continue
        found = branch_force(block, direction, speed)
        back = branch_force(block, -direction, speed)
        if found is None or back is None:
            continue
        if abs(found.hysteresis) > 0.5 * abs(found.force - back.force):
            elastic = elastic or found
            continue
        simulated = models.get(id(block.run))
        model = None if simulated is None else branch_force(block, direction, speed, simulated)
        row = StandardForce(specimen, level, direction, speed, found.force, found.std, found.hysteresis, found.last,
                            f"{block.run.name}: {block.label}", block.kind, len(block.settled),
                            modelled=None if model is None else model.force)
        if not found.extrapolated:
            return _surer(beyond, row)
        beyond = beyond or row
    if beyond is not None:
        return beyond
    for run in loose:
        if _cut_off(run, direction, speed, slice(None)):
            cut = cut or run.name
            continue
        row = _from_random(run, specimen, level, direction, speed, models)
        if row is not None:
            return row
    return StandardForce(specimen, level, direction, speed, why=_why(own, loose, direction, speed, elastic, cut))


def _cut_off(run: RecordPiece, direction: int, speed: float, span: slice) -> bool:
    """Whether the force rests on an end of its range anywhere within 5 % of the speed."""
    at = np.abs(direction * run.velocity[span] - speed) <= SAME_SPEED * speed
    return bool((at & run.cut_off[span]).any())


def _surer(beyond: StandardForce | None, within: StandardForce) -> StandardForce:
    """The force beyond a slower test's speed, where there is one, unless the faster test has it far more sharply.

    "Far" is what `local_fit` takes a difference for: three standard errors.
    """
    if beyond is None or beyond.std is None or within.std is None:
        return within
    return within if beyond.std > APART * within.std else beyond


def _from_triangle(block: Block, direction: int, speed: float,
                   models: Mapping[int, np.ndarray]) -> StandardForce | None:
    """The peak-velocity point of a triangle within 5 % of the speed.

    The difference of speeds counts as an error, by a slope of half the difference of the two directions over the speed.
    """
    point, back = peak_point(block, direction), peak_point(block, -direction)
    if point is None or back is None or abs(point.speed / speed - 1) > SAME_SPEED:
        return None
    simulated = models.get(id(block.run))
    model = None if simulated is None else peak_point(block, direction, simulated)
    error = float(np.hypot(np.nan_to_num(point.std),
                           0.5 * (point.force - back.force) * (point.speed / speed - 1)))
    last = float(point.by_cycle[-1])
    return StandardForce(block.run.specimen, block.run.level, direction, speed, point.force, error, None, last,
                         f"{block.run.name}: {block.label}", block.kind, len(block.settled),
                         modelled=None if model is None else model.force)


def _from_random(run: RecordPiece, specimen: str, level: float | None, direction: int, speed: float,
                 models: Mapping[int, np.ndarray]) -> StandardForce | None:
    """Mean force at a speed over all passages through it, with speeds on both sides of it.

    Samples of one stroke share what spring, gas and temperature add: strokes are what is counted, and twenty or more of
    them in stretches of the record, neighbours being alike.
    """
    u = direction * run.velocity - speed
    near = np.abs(u) <= 0.5 * speed
    if (u[near] > 0).sum() < SLICES or (u[near] < 0).sum() < SLICES:
        return None
    stroke = _stroke_of(run)
    passing = _strokes_through(run, direction, speed)
    if passing < FEWEST:
        return None
    group = stroke if passing < SLICES else (np.arange(u.size) * SLICES) // u.size
    found = local_fit(u[near], run.force[near], group[near], 0.5 * speed)
    if found is None or found.outside:
        return None
    simulated = models.get(id(run))
    model = None if simulated is None else local_fit(u[near], simulated[near], group[near], 0.5 * speed)
    return StandardForce(specimen, level, direction, speed, found.value, found.std,
                         source=f"{run.name}: random motion", method="random",
                         modelled=None if model is None else model.value)


def _stroke_of(run: RecordPiece) -> np.ndarray:
    """(n,) number of the stroke that every sample belongs to."""
    turns = turning_points(run.displacement, least_stroke(run.displacement))
    return np.searchsorted(turns[1:-1], np.arange(run.displacement.size), side="right")


def _strokes_through(run: RecordPiece, direction: int, speed: float) -> int:
    """Strokes in one direction that reach a speed."""
    return int(np.unique(_stroke_of(run)[direction * run.velocity >= speed]).size)


def _why(own: Sequence[Block], loose: Sequence[RecordPiece], direction: int, speed: float,
         elastic: BranchForce | None, cut: str) -> str:
    if cut:
        return (f"the force rests on an end of its range there ({cut.replace(': ', ', ')}): widen the range of the "
                "load cell and run that test again")
    if elastic is not None:
        return (f"the two branches of {elastic.block.label} differ by {abs(elastic.hysteresis):.3g} N, so that the "
                f"force is elastic more than damping: {propose_sine(speed)}")
    passed = max((_strokes_through(r, direction, speed) for r in loose), default=0)
    if passed:
        times = "stroke reaches" if passed == 1 else "strokes reach"
        return (f"{passed} {times} {speed:g} m/s in a record without periodic motion, too few for a mean and its "
                f"error: {propose_sine(speed)}")
    if others := [b.peak for b in own if b.kind == "triangle" and b.peak > (1 + SAME_SPEED) * speed]:
        return Between(f"no test has this speed, the triangles have one speed each, the next faster {min(others):.3g} "
                       f"m/s: {propose_sine(speed)}")
    peaks = [b.peak for b in own] + [float(np.quantile(np.maximum(direction * r.velocity, 0), 0.999)) for r in loose]
    fastest = max(peaks, default=0.0)
    return TooSlow(f"fastest test reaches {fastest:.3g} m/s: {propose_sine(speed)}")


def propose_sine(speed: float) -> str:
    """The test that gives a speed.

    Parameters
    ----------
    speed : float
        [m/s], above zero.

    Returns
    -------
    str
        Of at most 50 mm amplitude.

    Examples
    --------
    >>> propose_sine(0.1), propose_sine(1.05)
    ('run a sine of ±20 mm at 0.8 Hz', 'run a sine of ±50 mm at 3.4 Hz')
    """
    frequency = max(speed / (2 * np.pi * LONGEST_STROKE), min(0.8, speed / (2 * np.pi * 0.005)))
    amplitude = float(f"{speed / (2 * np.pi * frequency):.2g}")
    return f"run a sine of ±{1e3 * amplitude:.2g} mm at {_at_least(speed / (2 * np.pi * amplitude)):.2g} Hz"


def round_down(value: float) -> float:
    """To two digits.

    Parameters
    ----------
    value : float
        Above zero.

    Returns
    -------
    float

    Examples
    --------
    >>> round_down(0.001009), round_down(0.0254)
    (0.001, 0.025)
    """
    grain = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.floor(value / grain * (1 + 1e-9)) * grain:.2g}")


def _at_least(value: float) -> float:
    """Rounded up to two digits, so that a test at the figure that is printed reaches what it is for."""
    grain = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / grain * (1 - 1e-9)) * grain)
