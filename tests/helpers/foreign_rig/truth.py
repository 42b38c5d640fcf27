"""What a case's data could tell, from the truth alone and before any diagnosis.

The change by a cause is what it makes of the recorded force beyond what the device with nothing hidden does along the
*recorded* motion and current, so that causes in the law, in the force path and in the chain are measured alike::

    d = [F - replay(channels)] with the cause - [F - replay(channels)] without

All of it after projecting out the sensitivities to the law's own numbers and a constant, a spring and a damper beside
it. A single cause is separable if d is at least twice the error of the law, and if what tells it from every other cause
of the rig, sqrt(1 - rho^2) |d|, is at least the law's error and the noise together: less than that no one can know.
Sizes are drawn at the record's rate. What is separable is decided at the rate of the analysis: beyond half of it no two
causes can be distinguished.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import decimate

from .cases import OVERSAMPLING, RATE, World, hideable, noise
from .causes import cause
from .laws import SHAPES

START_UP = 0.25
"""s before what is compared"""


@dataclass(frozen=True)
class Truth:
    """Sizes hidden, how visible they are, and what else would look the same.

    Attributes
    ----------
    hidden : tuple of (name, size)
    visible : tuple of float
        Share of the force's root mean square that each changes by itself beyond the law's numbers.
    rivals : dict
        Per other cause what tells the (single) hidden one from it, as a share of the force.
    separable : bool
    unknown : float
        Law error and noise together, as a share of the force.
    """

    hidden: tuple[tuple[str, float], ...]
    visible: tuple[float, ...]
    rivals: dict[str, float]
    separable: bool
    unknown: float


@dataclass(frozen=True, eq=False)
class Bench:
    """A world without its causes, what of it the law's own numbers can do, and the size of its force."""

    world: World
    plain: np.ndarray
    basis: np.ndarray
    size: float
    step: int

    def change(self, name: str, size: float) -> np.ndarray:
        """(m,) d of one cause, projected, over the force's root mean square."""
        return self.projected(self.raw(name, size))

    def raw(self, name: str, size: float) -> np.ndarray:
        """(m,) the same before the projection, over the force's root mean square."""
        channels = self.world.run(((name, size),))
        return compared(channels["force"] - self.world.replayed(channels) - self.plain, self.step) / self.size

    def projected(self, values: np.ndarray) -> np.ndarray:
        """What the law's numbers cannot do."""
        return values - self.basis @ (self.basis.T @ values)

    def sized(self, name: str, share: float, within: float = 0.05) -> tuple[float, np.ndarray]:
        """The size at which a cause changes that share of the force, and its change; where none does the nearest.

        The smallest such size: upwards over a grid to the first that changes more, then by bisection.
        """
        entry = cause(name)
        grid = np.linspace(np.log(entry.least), np.log(entry.most), 9)
        low, high = grid[0], np.inf
        best: tuple[float, float, np.ndarray] | None = None
        for turn in range(20):
            middle = grid[turn] if high == np.inf else 0.5 * (low + high)
            change = self.change(name, float(np.exp(middle)))
            length = float(np.sqrt(np.mean(change**2)))
            miss = abs(np.log(max(length, 1e-12) / share))
            if best is None or miss < best[0]:
                best = (miss, float(np.exp(middle)), change)
            low, high = (middle, high) if length < share else (low, middle)
            if miss < within or low == grid[-1]:
                break
        assert best is not None
        return best[1], best[2]


def compared(values: np.ndarray, step: int) -> np.ndarray:
    """(m,) values after the start-up; `step` times slower than recorded, filtered without delay."""
    slower = values if step == 1 else decimate(values, step, ftype="fir")
    return slower[round(START_UP * RATE / step):]


def bench(world: World, rate: float = RATE) -> Bench:
    """Sensitivities by finite differences of the law's numbers, and a constant, a spring and a damper; at a rate."""
    step = round(RATE / rate)
    clean = world.run()
    plain = clean["force"] - world.replayed(clean)
    size = float(np.sqrt(np.mean(compared(clean["force"], step) ** 2)))
    columns = [np.ones_like(clean["x"]), clean["x"], clean["v"]]
    shape = world.device.shape
    for k, name in enumerate(SHAPES):
        if shape[k] == 0.0 and name != "stiffness":
            continue
        by = 0.02 * abs(shape[k]) or 0.02
        device = replace(world.device, shape=(*shape[:k], shape[k] + by, *shape[k + 1:]))
        columns.append(replace(world, device=device).run()["force"] - clean["force"])
    block = np.column_stack([compared(c, step) for c in columns])
    block = block / np.maximum(np.sqrt(np.mean(block**2, axis=0)), 1e-300)
    left, values, _ = np.linalg.svd(block, full_matrices=False)
    return Bench(world, plain, left[:, values > 1e-6 * values[0]], size, step)


def truth_of(world: World, rate: float = RATE) -> Truth:
    """Sizes, visibility and rivals of what the plan hides, in a record that is analysed at a rate."""
    plan = world.plan
    recorded = bench(world)
    hidden = tuple((name, recorded.sized(name, plan.share)[0]) for name in plan.causes)
    here = recorded if rate == RATE else bench(world, rate)
    found = [here.change(name, size) for name, size in hidden]
    visible = tuple(float(np.sqrt(np.mean(c**2))) for c in found)
    law = 0.0 if not world.device.error else law_error(world)
    of_noise = compared(noise(plan.colour, recorded.plain.size, np.random.default_rng([plan.seed, 28])), here.step)
    unknown = float(np.hypot(law, plan.level * np.sqrt(np.mean(of_noise**2))))
    rivals: dict[str, float] = {}
    if len(found) == 1:
        d = found[0]
        for other in hideable(plan.law, plan.current):
            if other.name != plan.causes[0] and not other.outside:
                _, change = here.sized(other.name, max(visible[0], 1e-3), 0.3)
                rho = float(d @ change) / max(float(np.sqrt((d @ d) * (change @ change))), 1e-300)
                rivals[other.name] = visible[0] * float(np.sqrt(max(1 - rho**2, 0.0)))
    near = min(rivals.values(), default=np.inf)
    return Truth(hidden, visible, rivals, len(found) == 1 and visible[0] >= 2 * law and near >= unknown, unknown)


def law_error(world: World) -> float:
    """Root mean square of the law's smooth error as a share of the force."""
    force = world.force((), world.x, world.v, world.i)
    bare = replace(world, device=replace(world.device, error=0.0)).force((), world.x, world.v, world.i)
    return float(np.sqrt(np.mean((force - bare)[round(START_UP * RATE) * OVERSAMPLING:] ** 2) / np.mean(force**2)))
