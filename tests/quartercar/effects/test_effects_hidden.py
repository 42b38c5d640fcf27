"""Causes that the rig hides at full size, one at a time, are named, and their size is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.effects.effect import Effect
from lpvid.effects.scaling import Scales
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.guo import Guo
from quartercar.effects import CATALOGUE
from quartercar.effects.friction_gas import StribeckFriction
from quartercar.rig import EXPERIMENTS, Rig, RigDamper, effect

PERIOD = 1 / 512
QUICK: tuple[Effect, ...] = tuple(e for e in CATALOGUE if e.stage != "series" and e.family not in ("hydraulics", "car"))
"""without elements in series and restrictions, which have tests of their own and take longest"""


def hidden(name: str, duration: float = 30.0, strength: float = 1.0, **numbers: float) -> Diagnosis:
    """The static damper on test 3 with one cause, diagnosed from Guo's law."""
    rig = Rig(damper=RigDamper.static(), effects=(effect(name, strength, **numbers),))
    record = rig.run(replace(EXPERIMENTS["test-3"], duration=duration), seed=0)
    law = Guo.suited(Facts.of([record])).replace(offset=False, values={})  # type: ignore[attr-defined]
    return diagnose([record], DamperBaseline(law), CATALOGUE if duration >= 30 else QUICK)


def value(found: Diagnosis, parameter: str) -> float:
    return next(p.value for p in found.causes[0].parameters if p.name == parameter)


SIZES: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "coulomb-friction": ({}, {"friction": 60.0}),
    "stribeck-friction": ({}, {"breakaway": 80.0, "stribeck_speed": 0.01}),
    "gas-stiffness": ({}, {"stiffness": 8000.0}),
    "coil-lag": ({}, {"time_constant": 0.02}),
    "rise-fall-lag": ({}, {"time_constant": np.sqrt(0.008 * 0.025), "ratio": np.sqrt(0.008 / 0.025)}),
    "remanence": ({}, {"half_width": 0.15}),
    "displacement-delay": ({}, {"delay": 0.006}),
    "force-delay": ({}, {"delay": 0.006}),
    "one-sided-filter": ({}, {"time_constant": 1 / (2 * np.pi * 20.0), "damping": np.sqrt(0.5)}),
    "force-offset": ({}, {"offset": 120.0}),
    "force-clipping": ({}, {"reciprocal_limit": 1 / 900.0}),
    "quantisation": ({}, {"force_step": 40.0}),
    "thermal-fade": ({"strength": 3.0}, {"fade": 0.015 / 150.0}),
    "end-stop": ({}, {"stiffness": 1e5, "position": 0.006}),
    "fixture-inertia": ({}, {"mass": 6.0}),
    "fixture-resonance": ({}, {"time_constant": 1 / (2 * np.pi * 60.0), "damping": 0.05}),
    "model-order": ({}, {"share": 0.4, "time_constant": 1 / (2 * np.pi * 25.0), "damping": 0.2}),
    "current-saturation": ({}, {}),
    "scheduling-degree": ({}, {}),
    "missing-scheduling": ({}, {}),
    "viscous-fade": ({"strength": 3.0}, {}),
}
"""how to hide it, and the size to be found"""


MISSED = {"quantisation", "thermal-fade", "fixture-resonance"}
"""not found as what they are by themselves, where the law is exact but for them"""
FORMS = ("model-order", "scheduling-degree", "missing-scheduling")
"""forms of the law, which are listed with the components that they describe too and never named alone"""


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.xfail(strict=True) if n in MISSED else ())
                                  for n in SIZES if n not in FORMS])
def test_one_hidden_cause_is_named(name: str) -> None:
    how, sizes = SIZES[name]
    found = hidden(name, **how)  # type: ignore[arg-type]
    assert found.verdict == "explained" and [c.name for c in found.causes] == [name], found
    for parameter, size in sizes.items():
        assert value(found, parameter) == pytest.approx(size, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMS)
def test_a_hidden_form_is_listed_first(name: str) -> None:
    how, sizes = SIZES[name]
    found = hidden(name, **how)  # type: ignore[arg-type]
    assert found.verdict == "cannot-tell" and [r.names[0] for r in found.rivals] == [name], found
    estimated = {p.name: p.value for p in found.rivals[0].parameters[name]}
    assert {n: estimated[n] for n in sizes} == pytest.approx(sizes, rel=0.1)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", [
    pytest.param("coulomb-friction", marks=pytest.mark.seconds), "coil-lag", *(pytest.param(n, marks=pytest.mark.slow)
    for n in ("one-sided-filter", "force-offset", "force-clipping"))])
def test_a_short_record_names_it_too(name: str) -> None:
    found = hidden(name, duration=10.0)
    assert [c.name for c in found.causes] == [name], found
    for parameter, size in SIZES[name][1].items():
        assert value(found, parameter) == pytest.approx(size, rel=0.1)


@pytest.mark.slow
def test_a_delay_under_a_held_current_is_told_to_half_a_sample() -> None:
    found = hidden("command-delay")
    assert [c.name for c in found.causes] == ["command-delay"], found
    assert abs(value(found, "delay") - 0.008) < 0.55 * PERIOD


@pytest.mark.slow
def test_gas_and_the_zero_of_the_load_cell_are_rivals() -> None:
    """At one temperature, a constant is a constant."""
    found = hidden("gas-preload")
    assert found.verdict == "cannot-tell" and not found.causes
    assert set(found.rivals[0].names) == {"gas-preload", "force-offset"}


def test_a_stribeck_speed_is_looked_at_two_to_a_decade() -> None:
    """Between speeds twenty times apart lies one that took half of the error away and was passed by."""
    scales = Scales(force=500.0, displacement=0.01, time=0.1, current=1.0, period=0.002, work=1e3)
    speeds = np.unique([p[1] for p in StribeckFriction().spread_points((), scales.size)])
    assert speeds[-1] / speeds[0] > 300 and np.max(speeds[1:] / speeds[:-1]) < 4.5
