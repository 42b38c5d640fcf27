"""What the data of a case could tell at best: smallest detectable size, separation from every other cause, an oracle.

All of it from the rig's noise-free differences, with the noise's true colour and the sensitivities of the true law;
of the diagnosis only the composition of a baseline with an effect is used, to know what a rival could imitate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from helpers.hidden import RATE, Made, Noise, Plan, World, draw, make, world_of
from helpers.hidden_causes import find
from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.record import Channel, Record
from quartercar import dampers
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.facts import Facts

HEAD = round(0.25 * RATE)
"""samples that no judgement rests on"""
SEPARATE, CLEAR = 10.0, 60.0
SHARE, NOTED = 0.01, 0.02
ROUNDS, ROOM, GROWTH = 3, 1.2, 10.0
"""how often the sizes of several causes are raised until each is worth naming beside the others, and by how much"""
IMITATED = 0.05
"""share of the likelihood of a cause outside the catalogue that an entry may miss and still pass for it: the diagnosis
asks for 95 % of the excess error"""
SAME = {"force-offset": "gas-preload", "gas-preload": "force-offset"}
SPECIAL = {"end-stop": ("gas-stiffness",), "stribeck-friction": ("coulomb-friction",),
           "hysteresis": ("coulomb-friction",), "entrained-air": ("series-compliance",), "rise-fall-lag": ("coil-lag",),
           "series-orifice": ("quadratic-loss", "network-topology"), "network-topology": ("quadratic-loss",)}
"""special cases of entries, which are no rivals of theirs: at some of their numbers they are those"""
BEYOND = 1.5
"""times the plausible range of a number within which a rival may have it"""


@dataclass(frozen=True, eq=False)
class Bench:
    """The true law without the cause, as far as the baseline can show it, along noise-free signals.

    Attributes
    ----------
    baseline : DamperBaseline
        Fitted to the noise-free record without the cause.
    signals : Signals
        That record.
    noise : Noise
    force : (n,) array
        Of that record.
    basis : (m, r) array
        Orthonormal basis of the whitened sensitivities.
    repeats : int
    """

    baseline: DamperBaseline
    signals: Signals
    noise: Noise
    force: np.ndarray
    basis: np.ndarray
    repeats: int

    def projected(self, change: np.ndarray) -> np.ndarray:
        """Whitened change of the output, the baseline's own part taken out, over all repeats."""
        w = self.noise.whitened(change, self.force)[HEAD:]
        return np.sqrt(self.repeats) * (w - self.basis @ (self.basis.T @ w))

    def change(self, channels: dict[str, np.ndarray], without: dict[str, np.ndarray]) -> np.ndarray:
        """(n,) what causes do to the error of the true law along the channels as they are recorded."""
        change = channels["force"] - without["force"]
        if any(np.any(channels[c] != without[c]) for c in ("displacement", "velocity", "current")):
            core = self.baseline.core(self.baseline.vector)
            change = change - core(self.baseline.signals(record_of(channels))) + core(self.signals)
        return change

    @property
    def wanted(self) -> float:
        """Length at which a change is detectable: √(10 + ln n)."""
        return float(np.sqrt(10 + np.log(self.repeats * (self.force.size - HEAD))))


@dataclass(frozen=True)
class Truth:
    """What is known of one case.

    Attributes
    ----------
    smallest : tuple of float
        Smallest detectable size of each cause; inf where none up to the largest is.
    likelihood : float
        Squared length of the first cause's projected change.
    share : float
        Root mean square of what the baseline cannot take up, over that of the force.
    rivals : dict of str to float
        Catalogue entries that come near, with D_ij; for a cause outside the catalogue those that imitate most of it.
    separable : bool
        Whether it is at least 3 e_min and 1 % of the force, and no rival comes near.
    ambiguous : bool
        Whether it is as large as that, and one does.
    besides : tuple of float
        Of several causes: what each changes that neither baseline nor the others can take up, over the force.
    bench : Bench
    """

    smallest: tuple[float, ...]
    likelihood: float
    share: float
    rivals: dict[str, float]
    separable: bool
    ambiguous: bool
    besides: tuple[float, ...]
    bench: Bench


def record_of(channels: dict[str, np.ndarray], name: str = "clean") -> Record:
    """Record of noise-free channels."""
    units = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}
    return Record({n: Channel(v, units[n]) for n, v in channels.items()}, sample_time=1 / RATE, name=name)


def baseline_for(plan: Plan, records: list[Record]) -> DamperBaseline:
    """The baseline that a case is diagnosed with, unfitted."""
    law = dampers.model_class(plan.baseline).suited(Facts.of(records))
    return DamperBaseline(law.replace(values={}))


def bench_of(world: World, level: float) -> tuple[Bench, dict[str, np.ndarray]]:
    """Run the world without a cause and prepare the projections."""
    channels = world.run()
    record = record_of(channels)
    baseline = baseline_for(world.plan, [record]).fit([record])
    signals = baseline.signals(record)
    force = channels["force"]
    noise = Noise(world.plan.colour, level * float(np.sqrt(np.mean(force**2))))
    jacobian = noise.whitened(baseline.sensitivities(signals, baseline.vector), force)[HEAD:]
    norms = np.linalg.norm(jacobian, axis=0)
    left, values, _ = np.linalg.svd(jacobian[:, norms > 0] / norms[norms > 0], full_matrices=False)
    basis = left[:, values > 1e-7 * values[0]]
    return Bench(baseline, signals, noise, force, basis, 2 if world.plan.repeats else 1), channels


def smallest_detectable(world: World, bench: Bench, without: dict[str, np.ndarray], name: str) -> float:
    """Size at which the projected, whitened change is as long as `Bench.wanted`; inf where none is."""
    return max(_detectable(world, bench, without, name), find(name).least)


def _detectable(world: World, bench: Bench, without: dict[str, np.ndarray], name: str) -> float:
    cause = find(name)
    size = cause.typical
    for _ in range(5):
        length = float(np.linalg.norm(bench.projected(bench.change(world.run(((name, size),)), without))))
        if length < 1e-6:
            if size >= cause.largest:
                return np.inf
            size = cause.largest
            continue
        if abs(length / bench.wanted - 1) < 0.15:
            return size * bench.wanted / length
        if size >= cause.largest and length < bench.wanted:
            return np.inf
        size = min(size * float(np.clip(bench.wanted / length, 1e-3, 1e3)), cause.largest)
    return size


def build(seed: int, catalogue: tuple[Effect, ...], **fixed: object) -> tuple[Made, Truth]:
    """The case of a seed, with what is known about it."""
    known = tuple(e.name for e in catalogue)
    plan = draw(seed, known, **fixed)
    world = world_of(plan)
    bench, without = bench_of(world, plan.level)
    smallest = tuple(smallest_detectable(world, bench, without, n) for n in plan.causes)
    sizes = tuple(min(plan.ratio * s, find(n).largest) for n, s in zip(plan.causes, smallest, strict=True))
    hidden = tuple(zip(plan.causes, sizes, strict=True))
    besides: tuple[float, ...] = ()
    if plan.kind in ("two", "three"):
        hidden, besides = _worth_naming(world, bench, without, hidden)
    made = make(world, hidden, without, bench.noise)
    return made, _known(made, bench, smallest, catalogue, besides)


def _worth_naming(world: World, bench: Bench, without: dict[str, np.ndarray], hidden: tuple[tuple[str, float], ...]
                  ) -> tuple[tuple[tuple[str, float], ...], tuple[float, ...]]:
    """Sizes at which each cause changes `NOTED` of the force by what neither baseline nor the others can take up."""
    besides = _besides(world, bench, without, hidden)
    for _ in range(ROUNDS):
        if min(besides) >= NOTED:
            break
        hidden = tuple((n, min(s * float(np.clip(NOTED * ROOM / max(b, 1e-9), 1.0, GROWTH)), find(n).largest))
                       for (n, s), b in zip(hidden, besides, strict=True))
        besides = _besides(world, bench, without, hidden)
    return hidden, besides


def _besides(world: World, bench: Bench, without: dict[str, np.ndarray], hidden: tuple[tuple[str, float], ...]
             ) -> tuple[float, ...]:
    """Share of the force that each cause changes beside the others, whose sizes are free, and the baseline."""
    whole = bench.change(world.run(hidden), without)

    def apart(k: int, factor: float) -> np.ndarray:
        """What the whole loses where one of them is so much smaller."""
        name, size = hidden[k]
        kept = (*hidden[:k], *([(name, factor * size)] if factor else []), *hidden[k + 1:])
        return whole - bench.change(world.run(kept), without)

    slopes = [apart(k, 0.95) for k in range(len(hidden))]
    return tuple(_share(bench, apart(k, 0.0), [slopes[j] for j in range(len(hidden)) if j != k])
                 for k in range(len(hidden)))


def _share(bench: Bench, change: np.ndarray, others: Sequence[np.ndarray] = ()) -> float:
    """Root mean square of a change beyond what the baseline and other directions take up, over that of the force."""
    jacobian = np.column_stack([bench.baseline.sensitivities(bench.signals, bench.baseline.vector), *others])[HEAD:]
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    absorbed = (jacobian / norms) @ np.linalg.lstsq(jacobian / norms, change[HEAD:], rcond=1e-10)[0]
    return float(np.sqrt(np.mean((change[HEAD:] - absorbed) ** 2)) / np.sqrt(np.mean(bench.force**2)))


def _known(made: Made, bench: Bench, smallest: tuple[float, ...], catalogue: tuple[Effect, ...],
           besides: tuple[float, ...]) -> Truth:
    change = bench.change(made.clean, made.without)
    direction = bench.projected(change)
    likelihood = float(direction @ direction)
    share = _share(bench, change)
    if made.plan.kind == "one" and share >= SHARE:
        share = min(share, _left_over(made))
    rivals: dict[str, float] = {}
    strong = (made.plan.kind in ("one", "wrong-baseline") and share >= SHARE
              and made.hidden[0][1] >= 2.99 * smallest[0])
    if strong or made.plan.kind == "outside":
        seen = bench.baseline.signals(record_of(made.clean))
        limit = max(CLEAR, IMITATED * likelihood) if made.plan.kind == "outside" else CLEAR
        rivals = _rivals(made.hidden[0][0], bench, direction, catalogue, seen, limit)
    near = any(d < SEPARATE for d in rivals.values())
    return Truth(smallest, likelihood, share, rivals, strong and not near, strong and near, besides, bench)


def _left_over(made: Made) -> float:
    """Root mean square of what the baseline, fitted anew, leaves of the noise-free force, over that of the force.

    A law with exponents takes up more of a change than its derivatives can.
    """
    record = record_of(made.clean)
    baseline = baseline_for(made.plan, [record]).fit([record])
    signals = baseline.signals(record)
    errors = (signals.output - baseline.core(baseline.vector)(signals))[HEAD:]
    return float(np.sqrt(np.mean(errors**2)) / np.sqrt(np.mean(made.clean["force"] ** 2)))


# -- rivals -------------------------------------------------------------------------------------------------------
def _rivals(name: str, bench: Bench, direction: np.ndarray, catalogue: tuple[Effect, ...], seen: Signals,
            limit: float) -> dict[str, float]:
    """D_ij of every other entry below a limit: what of the true change none of its plausible settings reaches."""
    found = {}
    for effect in catalogue:
        if effect.name == name or effect.family == "noise" or effect.missing((seen,)) or effect.behind:
            continue
        if name in (effect.form_of, effect.placement_of, *SPECIAL.get(effect.name, ())):
            continue
        if effect.applies(bench.baseline, (seen,)) is not None:
            continue
        distance = _distance(effect, bench, direction, seen)
        if distance < limit:
            found[effect.name] = distance
    return found


def _distance(effect: Effect, bench: Bench, direction: np.ndarray, seen: Signals) -> float:
    composition = Composition(bench.baseline, (effect,))
    place = composition.places[0]
    vector = composition.neutral
    vector[: bench.baseline.vector.size] = bench.baseline.vector
    start = composition.predict(seen, vector)

    def change(values: np.ndarray) -> np.ndarray:
        moved = vector.copy()
        moved[place] = values
        with np.errstate(all="ignore"):
            return bench.projected(np.clip(np.nan_to_num(composition.predict(seen, moved) - start), -1e9, 1e9))

    points = effect.points((seen,))
    moves = np.column_stack([change(p) for p in points])
    weights = np.linalg.lstsq(moves, direction, rcond=1e-8)[0]
    left = direction - moves @ weights
    if left @ left > 5 * CLEAR and left @ left > 0.3 * direction @ direction:
        return float(left @ left)
    low, high = _plausible(effect)
    single = [max(float(m @ direction), 0.0) ** 2 / max(float(m @ m), 1e-300) for m in moves.T]
    best = np.inf
    scale = np.maximum(np.abs(high - low) / 10, 1e-12)
    for k in np.argsort(single)[::-1][:3]:
        grown = points[k].copy()
        m = moves[:, k]
        if effect.strengths == 1:
            grown[0] = effect.neutral[0] + (grown[0] - effect.neutral[0]) * float(
                np.clip(m @ direction / max(m @ m, 1e-300), 1e-3, 1e3))
        first = np.clip(grown, low + 1e-9 * scale, high - 1e-9 * scale)
        fit = least_squares(lambda p: change(p) - direction, first, bounds=(low, high), x_scale=scale, max_nfev=40,
                            diff_step=1e-3)
        best = min(best, 2 * float(fit.cost))
        if best < SEPARATE:
            break
    return best


def _plausible(effect: Effect) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of what is plausible, wider by a factor to either side of 0."""
    p = effect.parameters
    bounds, plausible = (np.array([getattr(n, k) for n in p], dtype=float).T for k in ("bounds", "plausible"))
    low = np.where(plausible[0] > 0, plausible[0] / BEYOND, plausible[0] * BEYOND)
    high = np.where(plausible[1] < 0, plausible[1] / BEYOND, plausible[1] * BEYOND)
    return np.maximum(low, bounds[0]), np.minimum(high, bounds[1])


# -- oracle -------------------------------------------------------------------------------------------------------
def oracle_gain(made: Made, catalogue: tuple[Effect, ...], named: object, seed: int = 1) -> tuple[float, float]:
    """Gains against the noise-free force of a further run: of a diagnosis, and of a fit that knows the causes.

    Parameters
    ----------
    made : Made
    catalogue : tuple of Effect
    named : Diagnosis
    seed : int
        Of the further run.

    Returns
    -------
    (float, float)
        1 − squared error/squared error of the baseline, for the extended model and for the oracle.
    """
    from lpvid.diagnosis.blocks import Blocks
    from lpvid.diagnosis.problem import DiagnosisProblem
    from lpvid.diagnosis.refitting import refit

    further, force = made.further(seed)
    model = named.extended  # type: ignore[attr-defined]
    baseline = model.composition.baseline
    table = {e.name: e for e in catalogue}
    effects = tuple(table[n] for n, _ in made.hidden)
    signals = tuple(baseline.signals(r) for r in made.records)
    problem = DiagnosisProblem(signals, Blocks.of(signals, baseline.start))
    seen = baseline.signals(further)

    def squared(composition: Composition, vector: np.ndarray) -> float:
        return float(np.mean((force - composition.predict(seen, vector))[HEAD:] ** 2))

    bare = refit(problem, Composition(baseline), baseline.vector)
    composition = Composition(baseline, effects)
    own = {e.name: model.vector[p] for e, p in zip(model.composition.effects, model.composition.places, strict=True)}
    fits = []
    for k in range(max(len(e.points(signals)) for e in effects)):
        start = composition.neutral
        start[: baseline.vector.size] = bare.vector
        for e, p in zip(composition.effects, composition.places, strict=True):
            points = e.points(signals)
            start[p] = own.get(e.name, points[k % len(points)])
        fits.append(refit(problem, composition, start, iterations=6))
        if all(e.name in own for e in effects):
            break
    best = min(fits, key=lambda f: f.cost)
    known = refit(problem, composition, best.vector)
    base = squared(bare.composition, bare.vector)
    return 1 - squared(model.composition, model.vector) / base, 1 - squared(composition, known.vector) / base
