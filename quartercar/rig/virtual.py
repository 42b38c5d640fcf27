"""The virtual rig: specimen, sensors and causes; run an experiment, get a record."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Channel, Record
from lpvid.toolkit import checks
from quartercar.rig.causes import RigEffect
from quartercar.rig.damper import Motion, RigDamper, respond
from quartercar.rig.patterns import EXPERIMENTS, Experiment
from quartercar.rig.sensors import Sensors, measure
from quartercar.rig.setup import MeasurementChain, Setup

UNITS = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N", "force_true": "N", "current_true": "A",
         "temperature_true": "K", "displacement_true": "m", "velocity_true": "m/s"}
_WARM_UP = 0.5
"""Time [s] that the rig runs before a record starts, so that no start-up transient is in it."""
_MOST_STEPS = 40_000_000


@dataclass(frozen=True)
class Rig:
    """A damper between a position-controlled piston and a load cell, with a current driver and a data logger.

    ::

        motion ──► piston ──► damper ──► fixture ──► load cell ──► force
        current ─► driver ─(delay, rise 5 ms, fall 10 ms)─► damper      each channel: noise, delay, filter, gain, step

    The damper is integrated `oversampling` times faster than the record's clock. `current` is the driver's current, so
    the force lags behind it. Displacement and velocity are positive in extension, force in tension.

    Attributes
    ----------
    damper : RigDamper
    sensors : Sensors
    effects : tuple of RigEffect
        Causes switched on (`effect`); none by default.
    sample_rate : float
        Rate of the records [Hz].
    oversampling : int
        Integration steps for each sample.

    Examples
    --------
    >>> from dataclasses import replace
    >>> record = Rig().run(replace(EXPERIMENTS["test-1"], duration=0.1), seed=1)
    >>> record
    Record 'test-1-r0': 51 samples, 512 Hz, displacement [m], velocity [m/s], current [A], force [N]
    """

    damper: RigDamper = field(default_factory=RigDamper)
    sensors: Sensors = field(default_factory=Sensors)
    effects: tuple[RigEffect, ...] = ()
    sample_rate: float = 512.0
    oversampling: int = 16

    def __post_init__(self) -> None:
        checks.positive(self.sample_rate, "sample_rate", "Hz")
        checks.count(self.oversampling, "oversampling", at_least=1)
        object.__setattr__(self, "effects", tuple(self.effects))
        for item in self.effects:
            if not isinstance(item, RigEffect):
                raise InputError("effects of a rig must be made by effect(name, …)", got=repr(item))

    def setup(self) -> Setup:
        """Numbers for the integrator and the chain: the damper's, changed by each effect in turn.

        Returns
        -------
        Setup
            Floats throughout its `physics`, as the compiled integrator needs them.
        """
        setup = Setup(self.damper.physics(), MeasurementChain())
        for item in self.effects:
            setup = item.apply(setup)
        return Setup(type(setup.physics)(*map(float, setup.physics)), setup.chain)

    def run(self, experiment: Experiment, seed: int = 0, replicate: int = 0, *, truth: bool = False) -> Record:
        """Run one replicate of an experiment.

        Parameters
        ----------
        experiment : Experiment
        seed : int
            Seed of everything random; the same seed gives the same record, whatever else was run.
        replicate : int
            Which replicate, counted from 0.
        truth : bool
            Add ``force_true``, ``current_true``, ``temperature_true``, ``displacement_true`` and ``velocity_true``:
            what sensors without noise, delay or filter would see.

        Returns
        -------
        Record
            Channels displacement [m], velocity [m/s], current [A], force [N] on a uniform clock.

        Raises
        ------
        InputError
            A record shorter than three samples, or too long for one; a replicate that is no number from 0 on.
        """
        samples = round(experiment.duration * self.sample_rate)
        if samples < 3:
            raise InputError(f"experiment '{experiment.name}' is too short", got=f"{samples} samples")
        if samples * self.oversampling > _MOST_STEPS:
            raise InputError(f"experiment '{experiment.name}' is too long for one record", got=f"{samples} samples",
                             why=f"{_MOST_STEPS} integration steps are the limit", mend="run it in parts")
        drawing, noise = self._generators(experiment, seed, checks.count(replicate, "replicate"))
        warm = round(_WARM_UP * self.sample_rate)
        motion = self._motion(experiment, samples, warm, drawing, replicate)
        setup = self.setup()
        response = respond(setup, motion, self.oversampling)
        keep = slice(warm * self.oversampling, None, self.oversampling)
        channels = measure(motion, response, setup.chain, self.sensors, keep, noise)
        if truth:
            channels |= {"force_true": response.force[keep], "current_true": response.current[warm:],
                         "temperature_true": response.temperature[warm:],
                         "displacement_true": motion.displacement[keep], "velocity_true": motion.velocity[keep]}
        return Record({name: Channel(values, UNITS[name]) for name, values in channels.items()},
                      sample_time=1.0 / self.sample_rate, name=f"{experiment.name}-r{replicate}",
                      notes=(self._note(seed),))

    def run_all(self, experiment: Experiment, seed: int = 0) -> list[Record]:
        """Every replicate of an experiment.

        Parameters
        ----------
        experiment : Experiment
            Motion, current, duration and number of replicates.
        seed : int
            Seed of everything random, of all replicates.

        Returns
        -------
        list of Record
            Named ``name-r0``, ``name-r1``, … after the experiment.
        """
        return [self.run(experiment, seed, k) for k in range(experiment.replicates)]

    def _motion(self, experiment: Experiment, samples: int, warm: int, rng: np.random.Generator,
                replicate: int) -> Motion:
        """Motion and current on the fine clock; the current's first value is held while the rig warms up."""
        fine = self.sample_rate * self.oversampling
        motion_rng, current_rng = rng.spawn(2)
        displacement = experiment.displacement.displacement((samples + warm) * self.oversampling, fine, motion_rng)
        current = experiment.current.current(samples, self.sample_rate, current_rng, replicate)
        held = np.concatenate([np.full(warm, current[0]), current])
        return Motion.along(displacement, np.repeat(held, self.oversampling), fine)

    @staticmethod
    def _generators(experiment: Experiment, seed: int, replicate: int) -> list[np.random.Generator]:
        key = zlib.crc32(experiment.name.encode())
        seed = checks.count(seed, "seed")
        drawn = replicate if experiment.redraw else 0
        return [np.random.default_rng([seed, key, drawn, 0]), np.random.default_rng([seed, key, replicate, 1])]

    def _note(self, seed: int) -> str:
        named = ", ".join(f"{e.name} × {e.strength:g}" for e in self.effects if e.strength != 0) or "none"
        return f"synthetic: virtual rig, seed {seed}, effects: {named}"




def default_records(seed: int = 0, part: str = "all", names: Sequence[str] | None = None) -> list[Record]:
    """The embedded data: runs of the eight experiments on the default rig.

    Training: replicate 0 of tests 1-3 and the seven constant currents of test 6. Held-out: replicate 1 of tests 1-3
    (other roads, other currents), replicate 0 of the long tests 4 and 5, the constant currents of tests 7 and 8.

    Parameters
    ----------
    seed : int
        Seed of everything random.
    part : str
        ``"training"``, ``"held-out"`` or ``"all"`` (training first).
    names : sequence of str, optional
        Only these tests, e.g. ``["test-1", "test-8"]``.

    Returns
    -------
    list of Record
        Named ``test-1-r0`` and so on.

    Raises
    ------
    InputError
        An unknown part or test.
    """
    checks.one_of(part, ("training", "held-out", "all"), "part")
    wanted = list(EXPERIMENTS) if names is None else [
        checks.known_name(n, list(EXPERIMENTS), "experiment") for n in names]
    rig = Rig()
    return [rig.run(EXPERIMENTS[name], seed, replicate) for name, replicate, training in _default_runs()
            if name in wanted and (part == "all" or training == (part == "training"))]


def _default_runs() -> list[tuple[str, int, bool]]:
    levels = range(EXPERIMENTS["test-6"].replicates)
    training = [("test-1", 0), ("test-2", 0), ("test-3", 0), *(("test-6", k) for k in levels)]
    held_out = [("test-1", 1), ("test-2", 1), ("test-3", 1), ("test-4", 0), ("test-5", 0),
                *(("test-7", k) for k in levels), *(("test-8", k) for k in levels)]
    return [(*run, True) for run in training] + [(*run, False) for run in held_out]
