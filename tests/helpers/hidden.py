"""Cases with something hidden: from a seed a damper, an excitation, a noise, a measurement chain and a cause.

The data come from the virtual rig's integrator (or, for the slightly wrong baseline, a Bouc-Wen law), 16 times
oversampled; nothing here looks at `quartercar.effects` or at the diagnosis.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import butter, lfilter

from helpers.hidden_causes import HIDEABLE, OUTSIDE, Hideable, Imposed, Scene, find
from lpvid.record import Channel, Record
from quartercar.dampers.drive import Drive
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.rig import Aprbs, Chirp, Constant, Creep, Icps, Multisine, RigDamper, Road, Sensors, Stepped, Triangle
from quartercar.rig.damper import Motion, low_passed, respond
from quartercar.rig.sensors import measure
from quartercar.rig.setup import MeasurementChain, Physics, Setup
from quartercar.rig.virtual import UNITS

RATE, OVERSAMPLING, WARM = 512.0, 16, 0.5
EXCITATIONS = ("road", "sines", "chirp", "triangle", "creep")
CURRENTS = ("random steps", "stepped", "constant")
LEVELS = (0.005, 0.02, 0.05)
COLOURS = ("white", "ar1", "low-passed", "proportional")
FLOOR = 1e-3
"""white part of the low-passed noise: no channel is free of it"""
KINDS = ("nothing", "one", "two", "three", "outside", "wrong-baseline")
RATIOS = (0.3, 1.0, 3.0, 10.0, 30.0)
"""strengths over the smallest detectable; at 0.5 % noise ten times that is still below 1 % of the force"""
TOGETHER = (("coulomb-friction", "gas-stiffness"), ("coil-lag", "rise-fall-lag", "current-saturation"),
            ("fixture-inertia", "end-stop"), ("force-offset",), ("displacement-delay", "one-sided-filter"),
            ("asymmetry", "quadratic-loss"), ("viscous-fade", "missing-scheduling"))
"""families of which causes that occur together are drawn, one of each at most"""
BESIDE_BOUC_WEN = ("coulomb-friction", "gas-stiffness", "fixture-inertia", "coil-lag", "command-delay",
                   "current-saturation", "displacement-delay", "force-delay", "force-offset", "one-sided-filter",
                   "missing-scheduling", "end-stop")
YIELDING = 0.3
"""share of the yield force in a damper whose law the baseline has only nearly"""
HYDRAULIC_NOT = ("coulomb-friction", "gas-preload", "gas-stiffness", "asymmetry", "quadratic-loss", "force-offset")
"""what the hydraulic baseline knows already"""


@dataclass(frozen=True)
class Plan:
    """What a case is, before anything is simulated: plain data."""

    seed: int
    kind: str
    baseline: str
    excitation: str
    current: str
    level: float
    colour: str
    chain: str
    repeats: bool
    duration: float
    causes: tuple[str, ...]
    law: str
    ratio: float

    def to_dict(self) -> dict:
        """For a line of JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class World:
    """Specimen and motion on the fine clock, and the scales by which causes are shaped."""

    plan: Plan
    damper: RigDamper
    bouc_wen: BoucWen | None
    motion: Motion
    scene: Scene

    def run(self, hidden: tuple[tuple[str, float], ...] = ()) -> dict[str, np.ndarray]:
        """Noise-free channels at the output rate, and ``force_true``, the force before the chain's filter."""
        imposed = [_imposed(self.plan, name, size, self.scene) for name, size in hidden]
        setup = Setup(self.damper.physics(), MeasurementChain())
        for item in imposed:
            setup = item.setup(setup)
        setup = Setup(Physics(*map(float, setup.physics)), setup.chain)
        command = self.motion.command
        for item in imposed:
            command = item.command(command, self.motion.rate)
        driven = replace(self.motion, command=command)
        response = respond(setup, driven)
        force = response.force
        if self.bouc_wen is not None:
            force = force + _bouc_wen_force(self.bouc_wen, driven, response.current) * _swell(setup, force.size, driven)
        for item in imposed:
            force = item.force(force, self.motion)
        return self._measured(force, setup.chain, imposed)

    def _measured(self, force: np.ndarray, chain: MeasurementChain, imposed: list[Imposed]) -> dict[str, np.ndarray]:
        """The chain without noise: causes in it, and the filters that all channels share."""
        rate = self.motion.rate
        x, v, i = self.motion.displacement, self.motion.velocity, self.motion.command
        for item in imposed:
            x, v = item.channel(x, rate), item.channel(v, rate)
        if self.plan.chain == "full":
            corner = 120.0 + 80.0 * self.scene.ratio
            x, v, i, force = (low_passed(s, corner, 0.7071, rate) for s in (x, v, i, force))
        seen = replace(self.motion, displacement=x, velocity=v, command=i)
        response = _Force(force)
        keep = slice(round(WARM * RATE) * OVERSAMPLING, None, OVERSAMPLING)
        return measure(seen, response, chain, Sensors.perfect(), keep, np.random.default_rng(0))  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class _Force:
    """As much of a `Response` as the sensors read."""

    force: np.ndarray


def _filtered(b: object, a: object, values: np.ndarray) -> np.ndarray:
    return np.asarray(lfilter(b, a, values, axis=0))


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of one colour on the force, and the filter by which it would be white."""

    colour: str
    deviation: float

    def drawn(self, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(n,) noise."""
        e = rng.standard_normal(force.size + 400)
        if self.colour == "ar1":
            return self.deviation * np.sqrt(1 - 0.95**2) * _filtered([1.0], [1.0, -0.95], e)[400:]
        if self.colour == "low-passed":
            tone = _filtered(*self._tone[0], e)[400:] / self._tone[1]
            return self.deviation * (tone + np.sqrt(FLOOR) * rng.standard_normal(force.size))
        return self._size(force) * e[400:]

    def whitened(self, values: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n, …) as the best filter would leave them, in units of the noise."""
        if self.colour == "ar1":
            return _filtered([1.0, -0.95], [1.0], values) / (self.deviation * np.sqrt(1 - 0.95**2))
        if self.colour == "low-passed":
            a, power = self._predictor
            return _filtered(a, [1.0], values) / (self.deviation * np.sqrt(power))
        return (values.T / self._size(force)).T

    @property
    def predictor(self) -> np.ndarray:
        """(k + 1,) coefficients of the filter that whitens it; of noise without colour 1."""
        if self.colour == "ar1":
            return np.array([1.0, -0.95])
        return self._predictor[0] if self.colour == "low-passed" else np.ones(1)

    def _size(self, force: np.ndarray) -> np.ndarray:
        if self.colour != "proportional":
            return np.full(force.size, self.deviation)
        share = np.abs(force) / np.sqrt(np.mean(force**2))
        return self.deviation * np.hypot(0.15, share)

    @cached_property
    def _tone(self) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        b, a = butter(2, 20.0, fs=RATE)[:2]  # type: ignore[misc]
        return (b, a), float(np.sqrt(np.sum(_filtered(b, a, np.eye(1, 4000)[0]) ** 2)))

    @cached_property
    def _predictor(self) -> tuple[np.ndarray, float]:
        (b, a), size = self._tone
        h = _filtered(b, a, np.eye(1, 4000)[0]) / size
        r = np.array([h[: h.size - k] @ h[k:] for k in range(17)])
        r[0] *= 1 + FLOOR
        w = solve_toeplitz(r[:-1], r[1:])
        return np.concatenate([[1.0], -w]), float(r[0] - w @ r[1:])


@dataclass(frozen=True, eq=False)
class Made:
    """A case: records for the diagnosis, and what is known about them.

    Attributes
    ----------
    plan : Plan
    world : World
    records : list of Record
    clean : dict
        Channels of the first record without noise.
    without : dict
        The same without the hidden causes.
    hidden : tuple of (name, size)
    noise : Noise
    """

    plan: Plan
    world: World
    records: list[Record]
    clean: dict[str, np.ndarray]
    without: dict[str, np.ndarray]
    hidden: tuple[tuple[str, float], ...]
    noise: Noise

    def further(self, seed: int) -> tuple[Record, np.ndarray]:
        """Another drawing of the same experiment, (record without noise, its noise-free force)."""
        world = _world(self.plan, np.random.default_rng([self.plan.seed, seed, 99]), self.world)
        channels = world.run(self.hidden)
        return _record(channels, "further"), channels["force"]


# -- drawing ------------------------------------------------------------------------------------------------------
def draw(seed: int, known: tuple[str, ...], **fixed: object) -> Plan:
    """The plan of a case from its seed; `known` are the causes that the catalogue under test has.

    Parameters
    ----------
    seed : int
    known : tuple of str
    **fixed : object
        Fields of the plan that are not left to chance.
    """
    rng = np.random.default_rng([seed, 5])
    kind = str(fixed.get("kind", rng.choice(KINDS, p=(0.15, 0.48, 0.06, 0.09, 0.12, 0.10))))
    free = {"excitation": str(rng.choice(EXCITATIONS, p=(0.35, 0.3, 0.15, 0.1, 0.1))),
            "current": str(rng.choice(CURRENTS, p=(0.55, 0.25, 0.2))), "level": float(rng.choice(LEVELS)),
            "colour": str(rng.choice(COLOURS)), "chain": str(rng.choice(("clean", "full"))),
            "repeats": bool(rng.random() < 2 / 3), "duration": float(rng.choice((6.0, 10.0))),
            "law": "other" if rng.random() < 0.3 else "rig",
            "ratio": float(rng.choice(RATIOS, p=(0.1, 0.15, 0.2, 0.3, 0.25))),
            "baseline": "guo" if kind != "one" or rng.random() < 0.75 else "power-law-friction-gas"}
    if kind in ("two", "three", "wrong-baseline"):
        free |= {"excitation": str(rng.choice(("road", "sines"))), "current": "random steps",
                 "ratio": 10.0 if kind != "wrong-baseline" else float(rng.choice((10.0, 30.0)))}
    if kind == "outside":
        free["ratio"] = float(rng.choice((3.0, 10.0, 30.0)))
    free |= fixed
    free["kind"] = kind
    if "causes" not in fixed:
        free["causes"] = _causes(kind, free, known, rng)
    if not any(find(n).other for n in free["causes"]):  # type: ignore[union-attr]
        free["law"] = "rig"
    return Plan(seed=seed, **free)  # type: ignore[arg-type]


def _causes(kind: str, free: dict, known: tuple[str, ...], rng: np.random.Generator) -> tuple[str, ...]:
    def open_to(h: Hideable) -> bool:
        if free["baseline"] != "guo":
            return not h.current and h.name not in HYDRAULIC_NOT
        return not (h.current and free["current"] == "constant" and kind != "one")

    if kind == "nothing":
        return ()
    if kind == "outside":
        return (str(rng.choice([h.name for h in OUTSIDE if open_to(h)])),)
    names = [h.name for h in HIDEABLE if open_to(h) and h.name in known]
    if kind == "wrong-baseline":
        return (str(rng.choice([n for n in names if n in BESIDE_BOUC_WEN])),)
    if kind == "one":
        return (str(rng.choice(names)),)
    families = [[n for n in family if n in names] for family in TOGETHER]
    families = [f for f in families if f]
    chosen = rng.permutation(len(families))[: 2 if kind == "two" else 3]
    return tuple(str(rng.choice(families[k])) for k in chosen)


def world_of(plan: Plan) -> World:
    """Specimen, motion and scales of a plan."""
    return _world(plan, np.random.default_rng([plan.seed, 6]), None)


def _world(plan: Plan, rng: np.random.Generator, like: World | None) -> World:
    scatter = np.random.default_rng([plan.seed, 7])
    damper = _hydraulic(scatter) if plan.baseline != "guo" else _magnetorheological(scatter)
    bouc_wen = _bouc_wen(damper, scatter) if plan.kind == "wrong-baseline" else None
    if bouc_wen is not None:
        damper = RigDamper.viscous_only(0.0)
    motion_rng, current_rng = rng.spawn(2)
    fine = RATE * OVERSAMPLING
    samples, warm = round(plan.duration * RATE), round(WARM * RATE)
    displacement = _motion(plan).displacement((samples + warm) * OVERSAMPLING, fine, motion_rng)
    current = _current(plan, scatter).current(samples, RATE, current_rng, 0)
    held = np.concatenate([np.full(warm, current[0]), current])
    motion = Motion.along(displacement, np.repeat(held, OVERSAMPLING), fine)
    scene = like.scene if like is not None else Scene(
        float(np.quantile(np.abs(displacement), 0.8)), float(np.abs(displacement).max()),
        float(np.abs(motion.velocity).max()), 0.0, plan.duration, float(scatter.choice((0.5, 2.0))))
    return World(plan, damper, bouc_wen, motion, scene)


def _magnetorheological(rng: np.random.Generator) -> RigDamper:
    return replace(RigDamper.static(), viscous=rng.uniform(500, 1500), viscous_per_current=rng.uniform(100, 500),
                   yield_base=rng.uniform(30, 120), yield_per_current=rng.uniform(250, 700),
                   yield_speed=rng.uniform(0.012, 0.05))


def _hydraulic(rng: np.random.Generator) -> RigDamper:
    """Linear damping, friction, gas; with a loss proportional to the square through `_motion` of larger speeds."""
    return replace(RigDamper.viscous_only(rng.uniform(800, 2500)), asymmetry=rng.uniform(1.0, 2.5),
                   gas_preload=rng.uniform(100, 300), gas_stiffness=rng.uniform(200, 800))


def _bouc_wen(damper: RigDamper, rng: np.random.Generator) -> BoucWen:
    """A law whose loop before yielding Guo's has not, by a tenth of the force or so."""
    return BoucWen(values={
        "viscous_damping": damper.viscous, "series_damping": rng.uniform(2e5, 6e5),
        "yield_force": YIELDING * damper.yield_base,
        "yield_displacement": rng.uniform(1e-6, 6e-6), "hysteresis_shape": rng.uniform(0.2, 0.6),
        "viscous_damping_per_current": damper.viscous_per_current, "series_damping_per_current": 3e4,
        "yield_force_per_current": YIELDING * damper.yield_per_current, "current_rate": rng.uniform(1e3, 3e3),
        "parallel_stiffness": rng.uniform(0, 300), "gas_stiffness": 0.0, "gas_force": 0.0})


def _bouc_wen_force(law: BoucWen, motion: Motion, current: np.ndarray) -> np.ndarray:
    drive = Drive(1.0 / motion.rate, motion.velocity, motion.displacement, current)
    return law.response(drive, law.vector)


def _swell(setup: Setup, size: int, motion: Motion) -> np.ndarray:
    """The unlogged modulation, which the rig's integrator would have laid on its own hydraulics."""
    p = setup.physics
    return 1 + p.hidden_gain * np.sin(2 * np.pi * np.arange(size) / motion.rate / p.hidden_period)


def _motion(plan: Plan):
    return {"road": Road(), "sines": Multisine(rms=0.003), "chirp": Chirp(f_start=1.0), "triangle": Triangle(),
            "creep": Creep()}[plan.excitation]


def _current(plan: Plan, rng: np.random.Generator):
    if plan.baseline != "guo":
        return Constant((0.0,))
    if plan.current == "random steps":
        return Icps(hold=float(rng.choice((0.05, 0.15)))) if rng.random() < 0.5 else Aprbs(clock=10 / 512)
    return Stepped() if plan.current == "stepped" else Constant((float(rng.uniform(0.3, 2.0)),))


# -- making -------------------------------------------------------------------------------------------------------
def make(world: World, hidden: tuple[tuple[str, float], ...], without: dict[str, np.ndarray], noise: Noise) -> Made:
    """Records of a case: one run, or the same run twice with other noise."""
    plan = world.plan
    clean = world.run(hidden)
    rng = np.random.default_rng([plan.seed, 8])
    records = [_noisy(clean, noise, plan, rng, f"run-{k}") for k in range(2 if plan.repeats else 1)]
    return Made(plan, world, records, clean, without, hidden, noise)


def _noisy(clean: dict[str, np.ndarray], noise: Noise, plan: Plan, rng: np.random.Generator, name: str) -> Record:
    channels = dict(clean)
    channels["force"] = clean["force"] + noise.drawn(clean["force"], rng)
    if plan.chain == "full":
        for role, share, steps in (("displacement", 1e-3, 4096), ("velocity", 2e-3, 4096), ("current", 1e-3, 1024),
                                   ("force", 0.0, 4096)):
            size = float(np.ptp(clean[role])) or 1.0
            moving = float(np.std(clean[role])) or 0.01 * size
            raw = channels[role] + share * moving * rng.standard_normal(clean[role].size)
            if role == "displacement":
                raw = raw + 0.02 * moving * np.sin(plan.seed)  # its zero
            channels[role] = np.round(raw / (size * 1.2 / steps)) * (size * 1.2 / steps)
    return _record(channels, name)


def _record(channels: dict[str, np.ndarray], name: str) -> Record:
    return Record({n: Channel(v, UNITS[n]) for n, v in channels.items()}, sample_time=1.0 / RATE, name=name)


def _imposed(plan: Plan, name: str, size: float, scene: Scene) -> Imposed:
    cause = find(name)
    law = cause.other if plan.law == "other" and cause.other is not None else cause.rig
    return law(size, scene)
