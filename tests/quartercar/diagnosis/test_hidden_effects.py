"""The diagnosis against data with something hidden, made by the virtual rig: what must be said, and what must not."""

from __future__ import annotations

import dataclasses
import os
from typing import ClassVar

import numpy as np
import pytest
from helpers import hidden, hidden_score, hidden_truth
from helpers.hidden_causes import HIDEABLE, OUTSIDE, Scene

from lpvid.diagnosis.evidence import engine
from quartercar.effects import CATALOGUE
from quartercar.rig import CAUSES

QUIET = {"baseline": "guo", "excitation": "road", "current": "random steps", "level": 0.02, "colour": "white",
         "chain": "clean", "repeats": True, "duration": 6.0, "law": "rig", "ratio": 10.0}
SCENE = Scene(0.004, 0.01, 0.2, 1000.0, 6.0, 2.0)


class TestGenerator:
    """The hiding place itself: reproducible, exact where nothing is hidden, of the size that was asked for."""

    KNOWN: ClassVar[tuple[str, ...]] = tuple(e.name for e in CATALOGUE)

    def test_same_seed_same_data(self) -> None:
        plan = hidden.draw(3, self.KNOWN, kind="nothing", **QUIET)
        first, second = (hidden.world_of(plan).run()["force"] for _ in range(2))
        assert np.array_equal(first, second)

    def test_what_is_hidden_has_the_name_of_a_cause_of_the_rig(self) -> None:
        assert {h.name for h in HIDEABLE} <= {c.name for c in CAUSES}
        assert not {h.name for h in OUTSIDE} & {c.name for c in CAUSES}

    @pytest.mark.thinned(3)
    @pytest.mark.parametrize("cause", [*HIDEABLE, *OUTSIDE], ids=lambda c: c.name)
    def test_every_law_vanishes_with_its_size(self, cause: hidden.Hideable) -> None:
        plan = hidden.draw(4, self.KNOWN, kind="nothing", **(QUIET | {"duration": 2.0}))
        world = hidden.world_of(plan)
        nothing = world.run()["force"]
        for law in ("rig", "other") if cause.other else ("rig",):
            twin = hidden.World(dataclasses.replace(plan, law=law), world.damper, None, world.motion, world.scene)
            full, faint = (np.std(twin.run(((cause.name, s),))["force"] - nothing) for s in
                           (cause.typical, 0.05 * cause.typical))
            assert faint <= 0.7 * full  # any part of a sample is a whole one to a held current

    @pytest.mark.seconds
    def test_smallest_detectable_is_that_of_a_closed_form(self) -> None:
        """White noise, an added term u and no sensitivities: e = sigma sqrt(10 + ln n)/|u|."""
        plan = hidden.draw(5, self.KNOWN, kind="nothing", **(QUIET | {"repeats": False}))
        world = hidden.world_of(plan)
        bench, without = hidden_truth.bench_of(world, 0.02)
        bare = dataclasses.replace(bench, basis=np.zeros((bench.force.size - hidden_truth.HEAD, 0)))
        found = hidden_truth.smallest_detectable(world, bare, without, "force-offset")
        n = bench.force.size - hidden_truth.HEAD
        assert found == pytest.approx(bench.noise.deviation * np.sqrt((10 + np.log(n)) / n), rel=1e-6)

    @pytest.mark.parametrize("colour", hidden.COLOURS)
    def test_noise_has_its_level_and_its_filter_whitens_it(self, colour: str, rng: np.random.Generator) -> None:
        noise = hidden.Noise(colour, 3.0)
        force = 100 * np.sin(np.arange(40000) / 50)
        drawn = noise.drawn(force, rng)
        assert np.std(drawn) == pytest.approx(3.0, rel=0.1)
        white = noise.whitened(drawn, force)[100:]
        assert abs(np.mean(white[1:] * white[:-1]) / np.var(white)) < 0.1


def answer(seed: int, **fixed: object) -> dict:
    """A case marked, with what was said in a message."""
    row = hidden_score.case(seed, CATALOGUE, **(QUIET | fixed))
    row["id"] = seed
    return row


@pytest.mark.parametrize("cause", [
    pytest.param("coulomb-friction", marks=pytest.mark.seconds),
    *(pytest.param(n, marks=pytest.mark.slow) for n in ("coil-lag", "fixture-inertia", "asymmetry"))])
def test_a_clear_cause_is_named_and_measured(cause: str) -> None:
    row = answer(11, kind="one", causes=(cause,), ratio=10.0 if cause == "coil-lag" else 30.0)
    assert row["separable"], row
    assert row["named"] == [cause], hidden_score.line(row)
    assert row.get("relative_error", 0.0) < 0.15
    assert row["held_out_gain"] > 0.85 * row["oracle_gain"] > 0


@pytest.mark.seconds
def test_a_lag_is_found_beside_a_law_that_was_fitted_to_nothing() -> None:
    """Sines of 30 ms too early: Guo's law by itself takes away less than nothing, and no lag of it shows."""
    made, _ = hidden_truth.build(2100027, CATALOGUE)
    few = ("one-sided-filter", "displacement-delay", "fixture-inertia", "coulomb-friction", "gas-stiffness")
    found = engine.diagnose(made.records, hidden_truth.baseline_for(made.plan, made.records),
                            [e for e in CATALOGUE if e.name in few])
    assert made.hidden == (("one-sided-filter", 0.03),) and found.before.esr_held_out > 0.95
    assert [c.name for c in found.causes] == ["one-sided-filter"]
    assert found.causes[0].parameters[0].value == pytest.approx(0.03, rel=0.05)
    assert found.after.esr_held_out < 0.001


@pytest.mark.parametrize("colour", [
    pytest.param(c, marks=pytest.mark.seconds if c == "white" else pytest.mark.slow) for c in hidden.COLOURS])
def test_nothing_hidden_accuses_nothing(colour: str) -> None:
    row = answer(21, kind="nothing", colour=colour)
    assert not row["named"], hidden_score.line(row)


@pytest.mark.slow
@pytest.mark.parametrize("cause", [pytest.param("cogging", marks=pytest.mark.slow), "beating-by-velocity"])
def test_a_cause_outside_the_catalogue_is_not_explained_away(cause: str) -> None:
    row = answer(31, kind="outside", causes=(cause,), ratio=30.0)
    assert row["verdict"] != "explained", hidden_score.line(row)
    assert not row["named"], hidden_score.line(row)


@pytest.mark.slow
def test_an_offset_and_a_gas_force_are_not_told_apart() -> None:
    row = answer(41, kind="one", causes=("gas-preload",))
    assert row["ambiguous"], row
    assert not row["named"], hidden_score.line(row)
    assert any({"gas-preload", "force-offset"} <= set(group) for group in row["rivals"]), hidden_score.line(row)


@pytest.mark.slow
def test_a_constant_current_tells_nothing_of_its_lag() -> None:
    row = answer(51, kind="one", causes=("coil-lag",), current="constant")
    assert row["smallest"] == [np.inf]
    assert not row["named"], hidden_score.line(row)


@pytest.mark.xfail(reason="of three causes at once 2 of 31 sets were exact, docs/diagnosis_boards.md")
@pytest.mark.slow
@pytest.mark.parametrize("seed", [
    7800100,  # a saturation that covers for a bent current law, each superfluous beside the other
    8000054,  # friction whose bristles bend, by LuGre's law
    8100013,  # a network that takes the place of nearly the whole baseline
    7800318,  # a faint fade beside edges of the current fifty times as large
])
def test_three_causes_at_once_are_all_named(seed: int) -> None:
    row = hidden_score.case(seed, CATALOGUE) | {"id": seed}
    assert row["kind"] == "three" and hidden_score.exact(row), hidden_score.line(row)
    assert row["held_out_gain"] > 0.98 * row["oracle_gain"]


@pytest.mark.slow
def test_causes_together_are_hidden_at_a_size_that_is_worth_naming() -> None:
    made, truth = hidden_truth.build(41, tuple(CATALOGUE), kind="two", causes=("gas-stiffness", "coil-lag"),
                                     **(QUIET | {"level": 0.005}))
    assert len(truth.besides) == 2 and min(truth.besides) >= hidden_truth.NOTED
    alone = {n: made.world.run(((n, s),))["force"] - made.without["force"] for n, s in made.hidden}
    assert all(np.std(alone[n]) / np.std(made.without["force"]) > b for n, b in
               zip(alone, truth.besides, strict=True)), "the baseline and the other take up a part"


@pytest.mark.xfail(reason="of 129 cases 15 % had a wrong name, 8 of 21 causes were found")
@pytest.mark.slow
def test_over_many_cases() -> None:
    """Rotating seeds (HIDDEN_SEED, or the day): wrong names stay rare, and separable causes are found."""
    import datetime

    first = int(os.environ.get("HIDDEN_SEED", datetime.date.today().toordinal()))
    rows = [hidden_score.case(first * 1000 + k, CATALOGUE) for k in range(40)]
    for k, row in enumerate(rows):
        row["id"] = first * 1000 + k
    stated = "\n".join(map(hidden_score.line, rows))
    assert sum(bool(hidden_score.wrong(r)) for r in rows) <= 5, stated
    clear = [r for r in rows if r["kind"] == "one" and r["separable"]]
    assert sum(map(hidden_score.right_first, clear)) >= 0.7 * len(clear), stated
