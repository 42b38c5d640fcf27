"""Proposed experiments: one for every cause and every pair, or a sentence; run on the virtual rig they settle it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import lpvid as lpv
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.effects.effect import Effect
from lpvid.record import Record
from quartercar.effects import CATALOGUE
from quartercar.experiments import NO_PLAN, NOT_BY_FORCE, PAIRS, PLANS, WITHOUT_CURRENT, plan_for
from quartercar.rig import (
    Constant,
    Experiment,
    Rig,
    RigDamper,
    RigEffect,
    Road,
    Sensors,
    Triangle,
    effect,
    parse_plan,
    run_plan,
)

MUST_BE_TOLD = [  # diagnosis.md, section 3, last paragraph
    ("coil-lag", "command-delay"), ("coil-lag", "force-delay"), ("command-delay", "force-delay"),
    ("displacement-delay", "force-delay"), ("gas-stiffness", "fixture-inertia"), ("thermal-fade", "viscous-fade"),
    ("thermal-fade", "current-saturation"), ("thermal-fade", "scheduling-degree"),
    ("coulomb-friction", "quadratic-loss"), ("coulomb-friction", "gas-preload"), ("gas-preload", "quadratic-loss"),
    ("current-saturation", "scheduling-degree"), ("rise-fall-lag", "current-saturation"),
    ("gas-preload", "force-offset")]


@dataclass(frozen=True)
class SineCurrent:
    """A current that only ever swings at one frequency."""

    kind: ClassVar[str] = "sine-current"

    def current(self, samples: int, rate: float, rng: np.random.Generator, replicate: int) -> np.ndarray:
        return 1.2 + 0.8 * np.sin(2 * np.pi * 3.0 * np.arange(samples) / rate)


def bench(name: str, strength: float = 1.0, **sensors: float) -> Rig:
    """A damper that Guo's law describes, and one cause."""
    return Rig(damper=RigDamper.static(), sensors=Sensors(**sensors), effects=(effect(name, strength),))


def some(*names: str) -> tuple[Effect, ...]:
    return tuple(e for e in CATALOGUE if e.name in names)


def asked(records: Sequence[Record], rig: Rig, candidates: tuple[Effect, ...], seconds: float = 15.0
          ) -> tuple[Diagnosis, Diagnosis]:
    """What records tell, and what those of the experiment tell that is proposed for the rest."""
    found = lpv.diagnose(records, "guo", candidates)
    proposal = plan_for(found)
    assert proposal is not None and proposal.text
    plan = parse_plan(proposal.text)
    short = tuple(replace(e, duration=min(e.duration, seconds)) for e in plan.experiments)
    return found, lpv.diagnose(run_plan(replace(plan, rig=rig, experiments=short)), "guo", candidates)


# -- the table -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("cause", CATALOGUE, ids=str)
def test_every_cause_has_a_plan_or_a_sentence(cause: Effect) -> None:
    assert (cause.name in PLANS) != (cause.name in NO_PLAN)


def test_the_documentation_lists_every_cause() -> None:
    page = (Path(__file__).parents[3] / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = page.split("| cause | the plan reveals it by |")[1].split("\n\n")[0]
    rows = "".join(line for line in table.splitlines() if line.startswith("| `"))
    assert {e.name for e in CATALOGUE} == set(re.findall(r"`([a-z-]+)`", rows))


def test_every_plan_and_pair_is_of_causes_that_exist() -> None:
    known = {e.name for e in CATALOGUE}
    assert set(PLANS) | set(NO_PLAN) | set(NOT_BY_FORCE) | set().union(*PAIRS) <= known


@pytest.mark.parametrize("pair", MUST_BE_TOLD, ids=" or ".join)
def test_every_pair_that_looks_alike_has_what_tells_it(pair: tuple[str, str]) -> None:
    what = PAIRS[frozenset(pair)]
    assert isinstance(what, str) or parse_plan("\n".join(p.toml(pair) for p in what)).experiments


# -- the loop --------------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_a_delay_behind_a_sinusoidal_current_looks_like_a_lag_until_the_current_steps() -> None:
    rig = bench("command-delay", 0.5, current_noise=0.0)
    first, second = asked([rig.run(Experiment("sine", Road(), SineCurrent(), 12.0), 0)], rig,
                          some("coil-lag", "command-delay", "force-delay", "coulomb-friction"))
    assert first.verdict == "cannot-tell" and {"coil-lag", "command-delay"} <= set(first.rivals[0].names)
    assert [c.name for c in second.causes] == ["command-delay"] and not second.rivals
    assert second.causes[0].parameters[0].value == pytest.approx(0.004, abs=0.5 / 512)


@pytest.mark.seconds
@pytest.mark.thinned(2)
@pytest.mark.parametrize("cause", [effect("gas-preload"), effect("force-offset", offset=-80.0)], ids=lambda e: e.name)
def test_an_offset_and_a_gas_force_get_a_sentence_and_no_plan(cause: RigEffect) -> None:
    rig = Rig(damper=RigDamper.static(), effects=(cause,))
    found = lpv.diagnose([rig.run(Experiment("road", Road(), Constant(levels=(1.2,)), 10.0), 0)], "guo",
                         some("gas-preload", "force-offset", "coulomb-friction", "gas-stiffness"))
    proposal = plan_for(found)
    assert found.verdict == "cannot-tell" and proposal is not None
    assert not proposal.text and "rod disconnected" in proposal.advice[0]


@pytest.mark.slow
def test_friction_under_one_triangle_shows_in_creep() -> None:
    rig = bench("coulomb-friction")
    single = Experiment("triangle", Triangle(amplitude=0.012, frequency=2.0), Constant(levels=(0.0,)), 12.0)
    first, second = asked([rig.run(single, 0)], rig, some("coulomb-friction", "quadratic-loss", "gas-stiffness"))
    assert not first.causes
    assert [c.name for c in second.causes] == ["coulomb-friction"]
    assert second.causes[0].parameters[0].value == pytest.approx(60.0, rel=0.1)


@pytest.mark.slow
def test_a_spring_is_found_and_where_it_sits_is_said_to_be_open() -> None:
    rig = bench("series-compliance")
    found = lpv.diagnose([rig.run(Experiment("road", Road(), Constant(levels=(1.2,)), 10.0), 0)], "guo",
                         some("series-compliance", "coulomb-friction", "force-delay"))
    proposal = plan_for(found)
    assert [c.name for c in found.causes] == ["series-compliance"] and proposal is not None
    assert any("second displacement" in a for a in proposal.advice)


@pytest.mark.parametrize(("cause", "other"), [("gas-stiffness", "fixture-inertia"),
                                              ("fixture-inertia", "gas-stiffness"),
                                              ("displacement-delay", "force-delay"),
                                              ("force-delay", "displacement-delay"), ("force-delay", "command-delay"),
                                              ("current-saturation", "scheduling-degree")])
@pytest.mark.slow
def test_what_is_planned_for_a_pair_names_the_one_that_it_is(cause: str, other: str) -> None:
    parts = PAIRS[frozenset((cause, other))]
    assert not isinstance(parts, str)
    plan = parse_plan("\n".join(p.toml((cause, other)) for p in parts))
    short = tuple(replace(e, duration=min(e.duration, 12.0)) for e in plan.experiments)
    found = lpv.diagnose(run_plan(replace(plan, rig=bench(cause), experiments=short)), "guo", some(cause, other))
    assert [c.name for c in found.causes] == [cause] and not found.rivals


@pytest.mark.seconds
def test_a_plan_for_a_device_without_a_current_has_none() -> None:
    """A dashpot: what its records leave open is asked of no current, and those who need one are counted apart."""
    rng = np.random.default_rng(0)
    t = np.arange(0, 12, 1 / 200)
    f, phase = rng.uniform(0.5, 5, (8, 1)), rng.uniform(0, 6.28, (8, 1))
    v = np.sum(0.1 * np.sin(2 * np.pi * f * t + phase), axis=0)
    channels = {"displacement": np.cumsum(v) / 200, "velocity": v, "force": 800 * v + rng.normal(size=t.size)}
    record = lpv.Record(channels, 1 / 200, units={"displacement": "m", "velocity": "m/s", "force": "N"})
    found = lpv.diagnose([record], "linear", some("coil-lag", "remanence", "gas-preload", "quantisation"))
    assert {c.name for c in found.cannot_tell if c.unmeasured == "current"} == {"coil-lag", "remanence"}
    assert "2 need a channel that was not measured: current" in str(found)
    proposal = plan_for(found)
    assert proposal is not None and "current" not in proposal.description
    assert not {"coil-lag", "remanence"} & set(proposal.names)
    assert any("no current was measured" in a for a in proposal.advice)


def test_without_a_current_every_experiment_of_the_table_has_a_motion_alone() -> None:
    parts = {p for parts in (*PLANS.values(), *(v for v in PAIRS.values() if not isinstance(v, str))) for p in parts}
    for part in parts:
        other = WITHOUT_CURRENT.get(part, part)
        assert other is None or ("levels = [0.0]" in other.current and "current" not in other.description)
