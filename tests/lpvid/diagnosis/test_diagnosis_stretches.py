"""Stretches of records cut together for a search: same samples, blocks apart, heat and time of the whole record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lpvid.baselines.signals import Signals, in_turn
from lpvid.diagnosis.blocks import LOOK_AHEAD, START_UP, Blocks
from lpvid.diagnosis.evidence.thinning import (
    FEWEST_STRETCHES,
    SEARCH_SAMPLES,
    for_search,
    length_of,
    stretched,
)
from quartercar.effects import CATALOGUE
from quartercar.effects.electrical import clocked
from quartercar.effects.thermal import stored_heat

RATE = 500.0


def moving(n: int, seed: int = 0, current: bool = False) -> Signals:
    t = np.arange(n) / RATE
    rng = np.random.default_rng(seed)
    x = 0.01 * np.sin(2 * np.pi * 3 * t + seed) + 0.003 * np.sin(2 * np.pi * 7.3 * t)
    channels = {"displacement": x, "velocity": np.gradient(x, 1 / RATE)}
    if current:
        channels["current"] = np.where(t > 0.7 * t[-1], 2.0, 0.0)
    return Signals(1 / RATE, channels, 800 * channels["velocity"] + rng.standard_normal(n))


def test_few_samples_of_one_record_stay_as_they_are():
    one = in_turn([moving(SEARCH_SAMPLES)])
    assert stretched(one) == one


def test_a_stretch_is_the_record_behind_the_time_that_leads_over_to_it():
    long = in_turn([moving(20000)])
    (found,) = stretched(long)
    assert len(found.stretches) >= FEWEST_STRETCHES and found.n_samples <= SEARCH_SAMPLES + length_of(long) * RATE
    lead = round(START_UP / 2 * RATE)
    for t, (first, last) in zip(found.stretches, found.pieces, strict=True):
        at = round(t.span[0] * long[0].n_samples)
        begin = first + (lead if first else 0)
        for role, values in found.channels.items():
            np.testing.assert_array_equal(values[begin:last], long[0][role][at + begin - first: at + last - first])
        np.testing.assert_array_equal(found.output[first:last], long[0].output[at: at + last - first])
        assert t.past is None or t.past.n_samples == at


@pytest.mark.parametrize("count", [1, 2])
def test_a_current_is_held_by_the_clock_of_the_record_although_its_stretches_begin_anywhere(count):
    """Else it would jump half a sample later on average, which beside a resonance was named as a delay."""
    moves = [moving(20000, seed=k) for k in range(count)]
    held = np.repeat(np.random.default_rng(1).uniform(0.0, 2.0, 2000), 10)
    long = in_turn([replace(s, channels={**s.channels, "current": held}) for s in moves])
    (found,) = stretched(long)
    assert any(first % 10 for first, _ in found.pieces)  # jumps of two stretches: no multiple of ten samples apart
    assert clocked(found) and clocked(found.evaluated(velocity=0.5 * found["velocity"]))
    shifted = found.replace(current=np.roll(found["current"], 1))
    assert shifted.as_recorded("current") == (shifted,)


def test_what_was_recorded_late_is_read_inside_the_record():
    """The correction of a delay reads later samples, of the same stretch wherever a sample counts."""
    long = in_turn([moving(20000)])
    later = round(LOOK_AHEAD * RATE)
    for (s,) in (stretched(long), long):
        counted = Blocks.of([s]).number[0] >= 0
        for (first, last), span in zip(s.pieces, [t.span for t in s.stretches] or [(0.0, 1.0)], strict=True):
            inside = first + np.flatnonzero(counted[first:last]) + later
            assert inside.size and inside.max() < last
            at = round(span[0] * long[0].n_samples) - first
            np.testing.assert_array_equal(s["displacement"][inside], long[0]["displacement"][at + inside])


def test_where_one_leads_over_to_the_next_nothing_jumps():
    (found,) = stretched(in_turn([moving(20000), moving(20000, seed=1)]))
    assert np.abs(np.diff(found["displacement"])).max() < 3 * np.abs(np.diff(moving(20000)["displacement"])).max()


def test_a_jump_of_the_current_is_in_a_stretch():
    (found,) = stretched(in_turn([moving(40000, current=True)]))
    jumped = np.flatnonzero(np.abs(np.diff(found["current"])) > 1.0)
    assert jumped.size == 1
    begun = max(first for first, _ in found.pieces if first <= jumped[0])
    assert jumped[0] - begun >= round(START_UP * RATE)


def test_a_record_that_is_mostly_at_rest_is_cut_without_a_warning():
    """The median part does not move; warnings are errors here."""
    s = moving(40000)
    still = np.arange(40000) > 12000
    channels = {n: np.where(still, 0.0, c) for n, c in s.channels.items()}
    (found,) = stretched(in_turn([replace(s, channels=channels)]))
    assert found.n_samples <= SEARCH_SAMPLES + length_of(in_turn([s])) * RATE


def test_a_current_that_jumps_in_every_part_jumps_in_most_stretches():
    """One stretch at most is given to the farthest reach."""
    s, t = moving(40000), np.arange(40000) / RATE
    current = np.random.default_rng(1).uniform(0.0, 2.0, int(t[-1] / 4) + 1)[(t / 4).astype(int)]
    (found,) = stretched(in_turn([replace(s, channels={**s.channels, "current": current})]))
    jumped = [np.abs(np.diff(found["current"][first + round(START_UP * RATE): last])).max() > 0.01
              for first, last in found.pieces]
    assert sum(jumped) >= len(jumped) - 1


def test_the_ends_of_the_stroke_are_in_a_stretch():
    """They are reached once, slowly: where the inputs move most nothing meets a stop."""
    s, t = moving(40000), np.arange(40000) / RATE
    x = s["displacement"] + 0.03 * np.exp(-(((t - 33.0) / 0.6) ** 2))
    far = in_turn([s.replace(displacement=x, velocity=np.gradient(x, 1 / RATE))])
    (found,) = stretched(far)
    assert found["displacement"].max() > 0.95 * x.max()


def test_blocks_keep_away_from_the_joints():
    (found,) = stretched(in_turn([moving(20000)]))
    blocks = Blocks.of([found])
    number = blocks.number[0]
    for first, _ in found.pieces:
        assert (number[first: first + round(START_UP * RATE)] == -1).all()
    for k in range(blocks.count):
        inside = np.flatnonzero(number == k)
        assert np.diff(inside).max() == 1
        assert len({sum(first <= i for first, _ in found.pieces) for i in (inside[0], inside[-1])}) == 1


@pytest.mark.parametrize("cooling", [5.0, 100.0])
def test_the_heat_in_a_stretch_is_that_of_the_whole_record(cooling):
    whole = moving(20000)
    (found,) = stretched(in_turn([whole]))
    everywhere = stored_heat(whole, whole.output * whole["velocity"], cooling)
    heat = stored_heat(found, found.output * found["velocity"], cooling)
    for t, (first, last) in zip(found.stretches, found.pieces, strict=True):
        at = round(t.span[0] * whole.n_samples)
        there = everywhere[at: at + last - first]
        assert np.abs(heat[first:last] - there).max() < 0.05 * everywhere.max()  # of the time that leads over


def test_a_slow_modulation_lies_where_it_does_in_the_record():
    effect = next(e for e in CATALOGUE if e.name == "missing-scheduling")
    whole = in_turn([moving(20000)])
    (found,) = stretched(whole)
    values = effect.neutral.copy()
    values[0] = 0.3

    def core(s: Signals) -> np.ndarray:
        return np.ones(s.n_samples)

    baseline = None
    along, cut = (effect.compose(core, values, baseline)(s) for s in (whole[0], found))  # type: ignore[arg-type]
    for t, (first, last) in zip(found.stretches, found.pieces, strict=True):
        at = round(t.span[0] * whole[0].n_samples)
        np.testing.assert_allclose(cut[first:last], along[at: at + last - first], atol=1e-3)


def test_beside_a_law_with_a_long_memory_the_records_begin_where_they_began():
    whole = in_turn([moving(20000), moving(10000, seed=1)])
    short = for_search(whole, static=False)
    assert sum(s.n_samples for s in short) == pytest.approx(SEARCH_SAMPLES, abs=2)
    assert all(not s.stretches and np.array_equal(s.output, w.output[: s.n_samples])
               for s, w in zip(short, whole, strict=True))
    assert for_search(in_turn([moving(1000)]), static=False)[0].n_samples == 1000


@pytest.mark.parametrize("static", [True, False])
def test_a_fast_clock_leaves_the_blocks_that_are_needed(static):
    """Two records of 10 s at 1 kHz: 3,000 samples would be three seconds, less than eight blocks."""
    whole = in_turn([Signals(1e-3, s.channels, s.output) for s in (moving(10000), moving(10000, 1))])
    assert Blocks.of(for_search(whole, static=static)).count >= 8
