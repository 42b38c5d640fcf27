"""Levels of a current that one record holds one after the other: curves per level, as with one record per level."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
import quartercar as qc
from lpvid.report import render
from quartercar.characterisation import CharacteriseSettings
from quartercar.characterisation.page import characterisation_page

RATE, FREQUENCY, AMPLITUDE = 500.0, 2.0, 0.02
SPEED = 2 * np.pi * FREQUENCY * AMPLITUDE


def steady_force(velocity, current):
    """[N], tension positive: viscous and friction, both affine in the current, and a gas of 100 N."""
    return (800 + 600 * current) * velocity + (50 + 400 * current) * np.tanh(velocity / 0.02) - 100.0


def driven(current: np.ndarray, name: str, rng: np.random.Generator) -> lpv.Record:
    """A sine at a given current, with noise of 2 N and of 2 mA."""
    t = np.arange(current.size) / RATE
    x = AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t)
    v = SPEED * np.cos(2 * np.pi * FREQUENCY * t)
    force = steady_force(v, current) + 2.0 * rng.standard_normal(t.size)
    return lpv.Record({"displacement": x, "force": force, "current": current + 0.002 * rng.standard_normal(t.size)},
                      sample_time=1 / RATE, name=name, units={"displacement": "m", "force": "N", "current": "A"})


def held(levels, cycles: float) -> np.ndarray:
    """A staircase; every level lasts so many cycles."""
    return np.repeat(np.asarray(levels, dtype=float), round(cycles * RATE / FREQUENCY))


SETTINGS = CharacteriseSettings(speeds=(0.1, 0.2))


@pytest.mark.seconds
@pytest.mark.parametrize(("levels", "cycles"), [((0, 0.5, 1.0), 5.3), ((0, 1, 0.5, 0, 1, 0.5), 3.1),
                                                (tuple(np.arange(0, 3.05, 0.3)), 4.0)])
def test_every_held_level_has_its_forces(rng, levels, cycles):
    found = qc.characterise([driven(held(levels, cycles), "staircase", rng)], SETTINGS)
    assert found.data.levels == pytest.approx(sorted(set(map(float, levels))), abs=1e-3)
    assert len(found.given) == 2 * 2 * len(set(map(float, levels)))
    for f in found.given:
        truth = steady_force(f.direction * f.speed, f.current)
        assert f.force == pytest.approx(truth, abs=max(0.005 * abs(truth), 5.0)), f
    assert len(found.loops) == len(found.data.levels)
    assert any("held over several cycles" in note for note in found.data.notes)


@pytest.mark.seconds
def test_one_record_of_three_levels_is_read_like_three_records(rng):
    together = qc.characterise([driven(held((0, 0.5, 1.0), 6.0), "all", rng)], SETTINGS)
    apart = qc.characterise([driven(held((i,), 6.0), f"at {i}", rng) for i in (0, 0.5, 1.0)], SETTINGS)
    for a, b in zip(together.given, apart.given, strict=True):
        assert (a.direction, a.speed) == (b.direction, b.speed)
        assert a.current == pytest.approx(b.current, abs=1e-3)
        assert a.force == pytest.approx(b.force, abs=max(4 * np.hypot(a.std, b.std), 1.0))
    assert len(together.spreads) == len(apart.spreads)
    assert "1 record, 3 currents" in together.verdict
    assert characterisation_page(together)


@pytest.mark.seconds
def test_a_level_has_the_time_of_its_own_cycles_and_the_page_names_what_is_left_out(rng):
    found = qc.characterise([driven(np.concatenate([held((0,), 4.0), held((1.0,), 8.0)]), "two", rng)], SETTINGS)
    rows = {r["current"]: r["duration"] for r in found.to_dict()["records"]}
    assert rows[None] == pytest.approx(6.0)
    assert [rows[k] for k in sorted(k for k in rows if k is not None)] == pytest.approx([2.0, 4.0], abs=1 / FREQUENCY)
    for run in found.data.runs:
        if run.held is not None:
            assert run.duration == pytest.approx(sum(c.period for b in found.blocks if b.run is run for c in b.cycles))
    shown = render(characterisation_page(found, ()))
    assert "the first cycle after a step of the current is left out of means too" in shown
    alone = qc.characterise([driven(held((1.0,), 8.0), "one", rng)], SETTINGS)
    assert "after a step of the current" not in render(characterisation_page(alone, ()))


@pytest.mark.seconds
def test_a_held_level_is_the_one_of_a_record_at_constant_current(rng):
    found = qc.characterise([driven(held((0, 0.5, 1.0), 5.0), "staircase", rng),
                             driven(held((1.003,), 8.0), "constant", rng)], SETTINGS)
    assert len(found.data.levels) == 3


@pytest.mark.seconds
def test_levels_on_both_sides_of_a_record_at_constant_current_make_one_test_at_its_level(rng):
    """Of 2 A two per cent: 0.97 A and 1.03 A are two levels, and either is that of a record at 1 A."""
    found = qc.characterise([driven(held((0.97, 1.03, 2.0), 5.0), "staircase", rng),
                             driven(held((1.0,), 8.0), "constant", rng)], SETTINGS)
    assert found.data.levels == pytest.approx((1.0, 2.0), abs=1e-3)
    assert [b.run.level for b in found.blocks if b.run.name == "staircase" and b.run.current == "constant"] == \
        pytest.approx([1.0, 2.0], abs=1e-3)


def test_one_level_is_counted_in_the_singular(rng):
    current = np.concatenate([np.linspace(0.0, 1.0, 1500), held((1.0,), 6.0)])
    found = qc.characterise([driven(current, "run-up", rng)], SETTINGS)
    assert any("at 1 level within 1 record:" in note for note in found.data.notes)


@pytest.mark.parametrize("current", [
    np.linspace(0.0, 2.0, 15000), 1.0 + np.sin(1.5 * np.arange(15000) / RATE), held((0, 2) * 40, 0.5)],
    ids=("ramp", "sine", "step in every stroke"))
def test_a_current_that_creeps_or_steps_within_a_cycle_is_held_nowhere(rng, current):
    found = qc.characterise([driven(current, "moving", rng)], SETTINGS)
    assert found.data.levels == ()
    assert not found.given


@pytest.mark.seconds
def test_the_first_cycle_of_a_hold_is_left_out_of_means(rng):
    """A current that takes 0.1 s to the force: the cycle after the step is another one."""
    current = held((0, 1.0), 6.0)
    record = driven(current, "late", rng)
    late = current.copy()
    late[1500:1750] = 0.5  # the first cycle at 1 A
    force = record["force"] + steady_force(np.gradient(record["displacement"], 1 / RATE), late) - steady_force(
        np.gradient(record["displacement"], 1 / RATE), current)
    found = qc.characterise([record.with_channel("force", force, "N")], SETTINGS)
    top = [f for f in found.given if f.current > 0.5 and f.direction == 1 and f.speed == 0.2]
    assert top[0].force == pytest.approx(steady_force(0.2, 1.0), rel=0.01)


@pytest.mark.seconds
def test_a_ripple_of_the_driver_is_no_other_level(rng):
    """A square ripple of 5 % at 317 Hz, as a pulse-width modulated voltage has; decimation takes it off."""
    current = np.repeat([1.0, 0.5, 1.0, 2.0], 4000)
    t = np.arange(current.size) / 2000.0
    v = SPEED * np.cos(2 * np.pi * FREQUENCY * t)
    ripple = 0.05 * np.sign(np.sin(2 * np.pi * 317 * t))
    record = lpv.Record({"displacement": AMPLITUDE * np.sin(2 * np.pi * FREQUENCY * t), "current": current + ripple,
                         "force": steady_force(v, current) + 2.0 * rng.standard_normal(t.size)}, sample_time=1 / 2000,
                        name="pwm", units={"displacement": "m", "force": "N", "current": "A"})
    found = qc.characterise([record], SETTINGS)
    assert found.data.levels == pytest.approx([0.5, 1.0, 2.0], abs=0.01)
    why = next(m.why for m in found.missing if m.what == "switching time")
    assert "ripple" in why
