"""Where the fit of a rival starts when something of the measurement stands in its way."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, motion, power_law, road_like

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.engine import DiagnosisSettings, diagnose
from lpvid.diagnosis.noise import WHITE
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.rivals import DISTINCT, SEPARATED, _behind_a_filter, _of_motion, _without_chain, alternatives
from lpvid.diagnosis.selection import ForwardSelection
from lpvid.diagnosis.signals import Signals
from lpvid.diagnosis.spectra import low_passed
from lpvid.record import Channel, Record
from quartercar.effects.electrical import CoilLag, RiseFallLag
from quartercar.effects.friction_gas import CoulombFriction, GasStiffness, StribeckFriction
from quartercar.effects.hydraulics import ValveDynamics
from quartercar.effects.measurement import DisplacementDelay, ForceDelay, ForceOffset, OneSidedFilter
from quartercar.effects.shared_filter import SharedFilter
from quartercar.effects.structure import FixtureResonance


def starts_of(rival: Effect, *beside: Effect) -> tuple[Composition, list[np.ndarray]]:
    """Starts of a rival in the place of a force delay, beside other effects of the set."""
    s = road_like(2, 2048)
    problem = DiagnosisProblem((s,), Blocks.of((s,)), WHITE)
    present, composition = Composition(guo(), (ForceDelay(), *beside)), Composition(guo(), (rival, *beside))
    vector = present.neutral
    for effect, place in zip(present.effects, present.places, strict=True):
        vector[place] = effect.points((s,))[0]
    return composition, _without_chain(problem, refit(problem, present, vector, iterations=2), composition, rival)


def test_a_rival_that_is_of_the_measurement_is_not_put_beside_itself() -> None:
    assert starts_of(FixtureResonance())[1] == []
    composition, found = starts_of(FixtureResonance(), ForceOffset())
    assert len(found) == 1 and found[0].shape == composition.neutral.shape and np.isfinite(found[0]).all()


def test_what_the_measurement_does_is_put_back() -> None:
    composition, (start,) = starts_of(FixtureResonance(), ForceOffset())
    places = dict(zip((e.name for e in composition.effects), composition.places, strict=True))
    assert np.all(start[places["force-offset"]] != ForceOffset().neutral)
    assert np.any(start[places["fixture-resonance"]] != FixtureResonance().neutral)


FAR = 1e7
"""log-likelihood by which a rival trails at first"""


def behind(candidates: tuple[Effect, ...], rival: Effect | None = None) -> tuple[float, Refit, Refit]:
    """A rival that trails far, by default but the cause itself, on a record that has passed a filter of 80 Hz."""
    fine, (x, v) = 8, motion(PERIOD / 8 * np.arange(8 * 4096))
    passed = [low_passed(channel, PERIOD / fine, 1 / (2 * np.pi * 80), np.sqrt(0.5)) for channel in (x, v)]
    whole = Signals(PERIOD / fine, {"displacement": x, "velocity": v, "current": np.ones(x.size)}, np.zeros(x.size))
    force = low_passed(guo().core(guo().vector)(whole), PERIOD / fine, 1 / (2 * np.pi * 80), np.sqrt(0.5))[::fine]
    channels = {"displacement": passed[0][::fine], "velocity": passed[1][::fine], "current": np.ones(force.size)}
    s = Signals(PERIOD, channels, 20.0 + force + np.random.default_rng(0).standard_normal(force.size))
    problem = DiagnosisProblem((s,), Blocks.of((s,)), WHITE)
    composition = Composition(guo(), (ForceOffset(),))
    fit = refit(problem, composition, composition.neutral)
    other = fit if rival is None else refit(problem, Composition(guo(), (rival,)), Composition(guo(), (rival,)).neutral)
    search = ForwardSelection(problem, fit, candidates, np.random.default_rng(0), print)
    return *_behind_a_filter(search, FAR, other), fit


def test_a_filter_of_all_channels_is_put_beside_both() -> None:
    apart, found, alone = behind((SharedFilter(),))
    assert [e.name for e in found.composition.effects] == ["force-offset", "shared-filter"]
    assert apart == 0.0 and found.cost < 0.9 * alone.cost, "either gains as much by it"


def test_where_no_filter_is_a_candidate_nothing_changes() -> None:
    apart, found, alone = behind(())
    assert apart == FAR and found is alone


def test_one_that_trails_behind_a_filter_as_well_is_no_nearer_than_that() -> None:
    apart, found, _ = behind((SharedFilter(),), GasStiffness())
    assert [e.name for e in found.composition.effects] == ["gas-stiffness", "shared-filter"]
    assert 100 < apart < FAR and found.cost > 1.1 * behind((SharedFilter(),))[1].cost


def among_sines(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity of three tones, which a delay and a low-pass bring to where they were alike."""
    tones = [(0.01, 0.7, 0.0), (0.006, 1.9, 1.0), (0.003, 4.3, 2.0)]
    x = sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in tones)
    return x, sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * t + p) for a, f, p in tones)


@pytest.mark.parametrize("noise", [0.01, 0.05])
@pytest.mark.parametrize(("corner", "most"), [(53.0, SEPARATED), (16.0, -2 * SEPARATED)])
def test_noise_of_the_motion_does_not_speak_against_the_filter_that_raises_it(noise: float, corner: float, most: float,
                                                                              rng: np.random.Generator) -> None:
    """A delay wins by hundreds as long as the noise counts; without it these data tell, or cannot."""
    t, lag = PERIOD * np.arange(6000), 1 / (2 * np.pi * corner)
    x, v = among_sines(t)
    whole = Signals(PERIOD, {"displacement": x, "velocity": v, "current": np.ones(t.size)}, np.zeros(t.size))
    passed = [low_passed(c, PERIOD, lag, np.sqrt(0.5)) for c in (x, v)]
    late = [c + noise * c.std() * rng.standard_normal(t.size) for c in passed]
    s = whole.replace(displacement=late[0], velocity=late[1])
    s = Signals(PERIOD, s.channels, guo().core(guo().vector)(whole) + 5.0 * rng.standard_normal(t.size))
    problem, fits = DiagnosisProblem((s,), Blocks.of((s,)), WHITE), []
    for effect, begun in ((DisplacementDelay(), (1.4 * lag, 0.2)), (OneSidedFilter(), (lag, 0.7, 0.0))):
        composition = Composition(guo(), (effect,))
        vector = composition.neutral
        vector[composition.places[0]] = begun
        fits.append(refit(problem, composition, vector))
    delay, filtered = fits
    assert (filtered.cost - delay.cost) / delay.variance > 300
    assert _of_motion(ForwardSelection(problem, delay, (), rng, print), filtered, 0.0, SEPARATED)[0] < most


@pytest.mark.parametrize(("levels", "described"), [((0.0, 0.4, 0.8, 1.2, 1.6, 2.0), {"coil-lag", "rise-fall-lag"}),
                                              ((0.0, 0.8, 1.2, 0.4, 2.0, 1.6), {"coil-lag"})])
def test_edges_that_only_rise_do_not_tell_a_lag_from_one_that_falls_faster(levels: tuple[float, ...], described: set,
                                                                           rng: np.random.Generator) -> None:
    x, v = motion(PERIOD * np.arange(6000))
    s = Signals(PERIOD, {"displacement": x, "velocity": v, "current": np.repeat(levels, 1000)}, np.zeros(6000))
    lag = Composition(guo(), (CoilLag(),))
    vector = lag.neutral
    vector[lag.places[0]] = 0.03
    force = lag.predict(s, vector) + rng.standard_normal(6000)
    units = {"displacement": "m", "velocity": "m/s", "current": "A"}
    record = Record({**{c: Channel(s[c], u) for c, u in units.items()}, "force": Channel(force, "N")}, PERIOD, name="r")
    found = diagnose([record], guo(), (CoilLag(), RiseFallLag()), settings=DiagnosisSettings(fit_baseline=False))
    assert {name for group in found.rivals for name in group.names} | {c.name for c in found.causes} == described
    assert found.verdict == ("explained" if len(described) == 1 else "cannot-tell")


@pytest.mark.parametrize(("stribeck_speed", "described"), [(0.2, False), (0.02, True)])
def test_a_special_case_leaves_what_it_is_one_of_as_its_rival(stribeck_speed: float, described: bool,
                                                              rng: np.random.Generator) -> None:
    """Friction that breaks away, named as dry friction: beyond these speeds it is the same, within it is contested."""
    x, v = motion(PERIOD * np.arange(6000))
    s = Signals(PERIOD, {"displacement": x, "velocity": v, "current": np.ones(6000)}, np.zeros(6000))
    truth = Composition(guo(), (StribeckFriction(),))
    vector = truth.neutral
    vector[truth.places[0]] = (60.0, stribeck_speed)
    s = Signals(PERIOD, s.channels, truth.predict(s, vector) + 5.0 * rng.standard_normal(6000))
    problem, alone = DiagnosisProblem((s,), Blocks.of((s,)), WHITE), Composition(guo())
    rest, dry = refit(problem, alone, alone.neutral), CoulombFriction()
    composition = Composition(guo(), (dry,))
    begun = composition.neutral
    begun[composition.places[0]] = dry.points((s,))[0]
    search = ForwardSelection(
        problem, refit(problem, composition, begun), (dry, StribeckFriction()), rng, lambda text: None
    )
    found = {a.effect.name: a.apart for a in alternatives(search, dry, rest)}
    assert ("stribeck-friction" in found) == described
    assert not described or found["stribeck-friction"] <= 0


@pytest.mark.parametrize(("share", "rivals"), [(1.0, []), (0.7, ["valve-dynamics"])])
def test_a_valve_that_passes_all_gives_way_to_the_fixture_that_it_comes_to(share: float, rivals: list[str],
                                                                           rng: np.random.Generator) -> None:
    """A power law of exponent 1 is viscous altogether: there the two are one, but for a parameter."""
    law = power_law()
    x, v = motion(PERIOD * np.arange(6000))
    s = Signals(PERIOD, {"displacement": x, "velocity": v, "current": np.ones(6000)}, np.zeros(6000))
    valve, fixture = ValveDynamics(), FixtureResonance()
    true = Composition(law, (fixture,) if share == 1.0 else (valve,))
    vector = true.neutral
    vector[true.places[0]] = (1 / (2 * np.pi * 40), 0.1) if share == 1.0 else (share, 40.0, 0.1)
    s = Signals(PERIOD, s.channels, true.predict(s, vector) + 5.0 * rng.standard_normal(6000))
    problem, alone = DiagnosisProblem((s,), Blocks.of((s,)), WHITE), Composition(law)
    rest, fits = refit(problem, alone, alone.neutral), {}
    for effect, begun in ((valve, (share, 40.0, 0.1)), (fixture, (1 / (2 * np.pi * 40), 0.1))):
        composition = Composition(law, (effect,))
        start = composition.neutral
        start[composition.places[0]] = begun
        fits[effect.name] = refit(problem, composition, start)
    of_valve, of_fixture = (
        [(a.effect.name, a.apart) for a in
         alternatives(ForwardSelection(problem, fits[e.name], (valve, fixture), rng, lambda text: None), e, rest)]
        for e in (valve, fixture))
    assert [name for name, apart in of_fixture if apart < SEPARATED] == rivals
    assert [name for name, apart in of_valve if apart < -DISTINCT] == (["fixture-resonance"] if share == 1.0 else [])
