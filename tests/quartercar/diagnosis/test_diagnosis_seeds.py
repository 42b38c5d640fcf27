"""Diagnoses that the literature calls for: the whole catalogue on the seeds' dampers against data of another form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.record import Channel, Record
from quartercar import dampers
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.facts import Facts
from quartercar.effects import CATALOGUE
from quartercar.rig import EXPERIMENTS, Chirp, Constant, Experiment, Rig, RigDamper, effect


def with_force(motion: Record, force: np.ndarray, seed: int = 0) -> Record:
    """The motion of a record with another force and 1 % of noise on it."""
    noise = 0.01 * force.std() * np.random.default_rng(seed).standard_normal(force.size)
    channels = {c: Channel(motion[c], motion.unit(c)) for c in ("displacement", "velocity")}
    return Record({**channels, "force": Channel(force + noise, "N")}, motion.sample_time, name="made")


@pytest.mark.slow
def test_a_force_model_without_compliance_names_it_and_not_friction() -> None:
    """Source 000: a power law with friction and gas against a damper behind a bush of 300 kN/m."""
    damper = RigDamper(yield_base=0.0, yield_per_current=0.0, viscous=1500.0, viscous_per_current=0.0,
                       series_stiffness=math.inf, friction=0.0, rise_time=0.0, fall_time=0.0)
    experiment = replace(EXPERIMENTS["test-1"], duration=8.0, current=Constant(levels=(0.0,)))
    record = Rig(damper=damper, effects=(effect("series-compliance", 1.0, stiffness=3e5),)).run(experiment, seed=0)
    made = dampers.model_class("power-law-friction-gas").suited(Facts.of([record])).replace(values={})
    found = diagnose([record], DamperBaseline(made), CATALOGUE)
    assert found.verdict == "explained" and [c.name for c in found.causes] == ["series-compliance"]
    assert found.causes[0].parameters[0].value == pytest.approx(1 / 3e5, rel=0.02)


@pytest.mark.slow
def test_a_parallel_network_against_data_of_one_in_series_names_the_topology() -> None:
    """Source 003: c_L v + c_Q v² against the law of losses side by side, over 1.5 decades of speed."""
    sweep = Experiment("speeds", Chirp(f_start=0.1, f_end=4.0, amplitude=0.018, peak_velocity=0.4),
                       Constant(levels=(0.0,)), 30.0)
    motion = Rig(damper=RigDamper.static()).run(sweep, 0)
    v = motion["velocity"]
    force = (800 + 9000 * np.abs(v)) * v + 20 * np.tanh(v / 2e-3)
    found = lpv.diagnose(with_force(motion, force), "network-parallel", CATALOGUE)
    assert found.verdict == "explained" and [c.name for c in found.causes] == ["network-topology"]
    assert found.gain_percent > 75


@pytest.mark.slow
def test_a_motion_filtered_by_itself_is_named_or_listed() -> None:
    """Source 004: only the displacement passes the low-pass of the signal conditioning."""
    rig = Rig(damper=RigDamper.static(), effects=(effect("one-sided-filter", 1.0),))
    found = lpv.diagnose(rig.run(replace(EXPERIMENTS["test-3"], duration=15.0), 0), "guo", CATALOGUE)
    estimated = {c.name: c.parameters for c in found.causes}
    for group in found.rivals:
        estimated |= group.parameters
    assert {c.name for c in found.causes} <= {"one-sided-filter"}
    time_constant, damping, *_ = (p.value for p in estimated["one-sided-filter"])
    assert time_constant == pytest.approx(1 / (2 * math.pi * 20), rel=0.05)
    assert damping == pytest.approx(math.sqrt(0.5), rel=0.05)


def growing(seconds: float = 10.0, rate: float = 512.0) -> Record:
    """Four sines together, from rest to 0.5 m/s and back, twice."""
    t = np.arange(round(seconds * rate)) / rate
    phases = np.random.default_rng(0).uniform(0, 2 * math.pi, 4)
    shape = sum(np.cos(2 * math.pi * f * t + p) for f, p in zip((0.7, 1.9, 3.1, 4.7), phases, strict=True)) / 4
    velocity = (0.05 + 0.55 * (0.5 - 0.5 * np.cos(4 * math.pi * t / seconds))) * shape
    position = np.cumsum(velocity) / rate
    return Record({"displacement": Channel(position - position.mean(), "m"), "velocity": Channel(velocity, "m/s")},
                  1 / rate, name="growing")


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="a filter of all channels of 2 ms is named beside it")
def test_a_relief_valve_that_grows_concave_against_holes_behind_it_names_the_orifice() -> None:
    """Source 001: the baseline (7)-(8) against data of the extended one (9)-(11), A_P³/(N_O K_O)² = 27,000 N·s²/m²."""
    motion = growing()
    force = np.asarray(dampers.model_class("relief-valve-orifice")().simulate(motion).output).ravel()
    found = lpv.diagnose(with_force(motion, force), "relief-valve", CATALOGUE)
    assert found.verdict == "explained" and [c.name for c in found.causes] == ["series-orifice"]
    coefficient, onset = (p.value for p in found.causes[0].parameters)
    assert coefficient == pytest.approx(27000.0, rel=0.2)
    assert math.sqrt(7000.0 / 4e6) < onset < 0.25  # the valve opens at the first; its own loss trades with the holes
    assert found.gain_percent > 85
