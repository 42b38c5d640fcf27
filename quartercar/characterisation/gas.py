"""Gas force, spring rate and friction: the mean and half the difference of the two directions at one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from quartercar.characterisation.cycles import Block
from quartercar.characterisation.local_fit import APART
from quartercar.characterisation.settings import CREEP
from quartercar.dampers.bench.static_characteristic import SAME_SPEED

BINS = 16
"""places along the stroke at which the two directions are compared"""
INNER = 0.8
"""share of the stroke that is used: at its ends the speed is not that of the test"""


@dataclass(frozen=True)
class StaticForce:
    """One slow test.

    Attributes
    ----------
    specimen : str
    current : float or None
    record, test : str
    speed : float
        Peak speed [m/s].
    gas, gas_std : float
        Force outwards at mid stroke, −½(F_out + F_in) [N].
    rate, rate_std : float
        Slope of ½(F_out + F_in) over the displacement [N/m].
    friction, friction_std : float
        ½(F_out − F_in) at mid stroke [N]; it still holds the damping at this speed.
    position : float
        Mid stroke [m].
    creep : bool
        Whether the speed is at most 10 mm/s, no slower test has another gas force or friction, and half the difference
        is friction for the most part; if not, friction is an upper bound and the gas force holds what the damping of
        the two directions differs by.
    """

    specimen: str
    current: float | None
    record: str
    test: str
    speed: float
    gas: float
    gas_std: float
    rate: float
    rate_std: float
    friction: float
    friction_std: float
    position: float
    creep: bool


def static_force(block: Block) -> StaticForce | None:
    """Gas, rate and friction of one block, means over its cycles.

    At each of 16 places in the inner 80 % of the stroke::

        g(x) = ½ (F_out + F_in) = −F_gas + K (x − x_c)        F_f = ½ (F_out − F_in)

    the first as a straight line over x, F_out and F_in the means of the samples there. F_f is taken over the central
    quarter. None where a direction has no sample in a bin.

    Parameters
    ----------
    block : Block
        With a force.

    Returns
    -------
    StaticForce or None
    """
    rows = [row for c in block.cycles if (row := _cycle(block, c)) is not None]
    if not rows:
        return None
    values = np.array(rows)
    mean = values.mean(axis=0)
    std = values[:, :3].std(axis=0, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else values[0, 3:6]
    place = float(np.mean([c.centre for c in block.cycles]))
    run = block.run
    return StaticForce(run.specimen, run.level, run.name, block.label, block.peak, float(-mean[0]), float(std[0]),
                       float(mean[1]), float(std[1]), float(mean[2]), float(std[2]), place, block.peak <= CREEP)


def _cycle(block: Block, cycle) -> tuple[float, ...] | None:
    """Level, slope, friction, and their standard errors from the line's residual."""
    off, force = cycle.displacement - cycle.centre, block.run.force[cycle.span]
    reach = INNER * cycle.amplitude
    bins = np.minimum(BINS, max(4, off.size // 8))
    edges = np.linspace(-reach, reach, bins + 1)
    sides = []
    for way in (cycle.velocity > 0, cycle.velocity < 0):
        keep = way & (np.abs(off) < reach)
        where = np.digitize(off[keep], edges) - 1
        count = np.bincount(where, minlength=bins)[:bins]
        if np.any(count == 0):
            return None
        sides.append([np.bincount(where, weights=w[keep], minlength=bins)[:bins] / count for w in (off, force)])
    (x_out, out), (x_in, back) = sides
    middle, half = 0.5 * (out + back), 0.5 * (out - back)
    x = 0.5 * (x_out + x_in)
    slope, level = np.polyfit(x, middle, 1)
    rest = middle - np.polyval((slope, level), x)
    error = float(rest.std(ddof=2)) / np.sqrt(bins)
    central = np.abs(x) <= max(0.25 * cycle.amplitude, float(np.sort(np.abs(x))[1]))
    return (float(level), float(slope), float(half[central].mean()), error, error / float(x.std()), error)


def pulling(found: Sequence[StaticForce]) -> tuple[str, ...]:
    """Tests whose force pulls in both directions at mid stroke, which no gas does.

    With dampings D_r, D_c ≥ 0 and a gas force G outwards, F_out = D_r − G and F_in = −D_c − G: F_in > 0 needs G < 0,
    however much the directions differ. Three standard errors of F_in count as its sign.

    Parameters
    ----------
    found : sequence of StaticForce

    Returns
    -------
    tuple of str
        One caveat, or none.
    """
    def inwards(test: StaticForce) -> float:
        """F_in [N]."""
        return -test.gas - test.friction

    own = [s for s in found if inwards(s) > APART * np.hypot(*np.nan_to_num((s.gas_std, s.friction_std)))]
    if not own:
        return ()
    worst = max(own, key=inwards)
    others = "" if len(own) == 1 else f" and {len(own) - 1} more test" + ("s" if len(own) > 2 else "")
    return (f"The force pulls in both directions in '{worst.record}' ({inwards(worst):.3g} N of tension in compression "
            f"at mid stroke){others}: a gas pushes. Either the load cell has an offset, or displacement and force both "
            "count compression positive, so that rebound and compression have changed places here: --flip displacement "
            "--flip force (and velocity).",)


def slowest(found: Sequence[StaticForce]) -> list[StaticForce]:
    """Of each specimen and current: every test up to 10 mm/s, or else the slowest test.

    Of those, one that differs from the slowest in gas force or friction by more than three standard errors still holds
    damping: 10 mm/s is creep for a damper of decimetres per second, not for one of millimetres per second. So does one
    of which the larger part grows with the speed, at the slope to the next faster test::

        v_1 (F_2 − F_1)/(v_2 − v_1) > ½ F_1,     F = ½ (F_out − F_in)

    A damping that grows less than in proportion has a steeper slope below v_1: the part is at least that.

    Parameters
    ----------
    found : sequence of StaticForce

    Returns
    -------
    list of StaticForce
        The slowest first, one specimen and current after the other.
    """
    rows: list[StaticForce] = []
    for key in dict.fromkeys((f.specimen, f.current) for f in found):
        own = sorted((f for f in found if (f.specimen, f.current) == key), key=lambda f: f.speed)
        creeping = [f for f in own if f.creep]
        rows += [replace(f, creep=_alike(f, creeping[0]) and not _damped(f, own)) for f in creeping] or own[:1]
    return rows


def _damped(test: StaticForce, own: Sequence[StaticForce]) -> bool:
    """Whether half the difference of the two directions is damping for the most part; False in the fastest test."""
    faster = next((f for f in own if f.speed > (1 + SAME_SPEED) * test.speed), None)
    if faster is None:
        return False
    return test.speed * (faster.friction - test.friction) / (faster.speed - test.speed) > 0.5 * test.friction


def _alike(test: StaticForce, slower: StaticForce) -> bool:
    """Whether a test shows the gas force and the friction of a slower one."""
    gaps = ((test.gas - slower.gas, test.gas_std, slower.gas_std),
            (test.friction - slower.friction, test.friction_std, slower.friction_std))
    rounding = 1e-9 * max(abs(test.gas), abs(test.friction))
    return all(abs(gap) <= APART * float(np.hypot(*np.nan_to_num((a, b)))) + rounding for gap, a, b in gaps)
