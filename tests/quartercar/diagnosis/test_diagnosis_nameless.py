"""An entry that has the right direction and the wrong name: functions without a name do its work as well, and more."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, motion, road_like
from scipy.signal import lfilter

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.engine import DiagnosisSettings, diagnose
from lpvid.diagnosis.nameless import BEYOND, Nameless, static_in_place
from lpvid.diagnosis.noise import WHITE
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.signals import Signals, in_turn
from lpvid.record import Channel, Record
from quartercar.effects.electrical import CoilLag, Remanence
from quartercar.effects.friction_gas import GasStiffness
from quartercar.effects.model_structure import MissingScheduling, SchedulingDegree

NOISE = 10.0
"""[N]"""
INPUTS = ("displacement", "velocity", "current")
STARTS = {"gas-stiffness": [1e4], "coil-lag": [0.02], "scheduling-degree": SchedulingDegree().points((road_like(),))[0],
          "remanence": [0.15], "missing-scheduling": MissingScheduling().points(())[0]}


def inputs(n: int = 6000) -> Signals:
    """A motion and a current that both wander."""
    t = PERIOD * np.arange(n)
    x, v = motion(t)
    current = 1.2 + np.sin(2 * np.pi * 0.31 * t) * np.sin(2 * np.pi * 2.3 * t)
    return Signals(PERIOD, {"displacement": x, "velocity": v, "current": current}, np.zeros(n))


def dragged(x: np.ndarray, share: float) -> np.ndarray:
    """(n,) [N] a spring of 20 kN/m at the other end of a gap of `share` of the range at either side."""
    out, y = np.empty(x.size), x[0]
    for k, at in enumerate(x):
        y = min(max(y, at - share * np.ptp(x)), at + share * np.ptp(x))
        out[k] = y
    return 2e4 * out


def behind_a_coil() -> np.ndarray:
    """(n,) [N] what a lag of the coil changes in Guo's force."""
    s, lag = inputs(), Composition(guo(), (CoilLag(),))
    vector = lag.neutral
    vector[lag.places[0]] = STARTS["coil-lag"]
    return lag.predict(s, vector) - guo().core(guo().vector)(s)


def problem_of(hidden: np.ndarray, noise: np.ndarray, s: Signals | None = None) -> DiagnosisProblem:
    """Guo's force, something hidden, and noise."""
    s = s or inputs()
    recorded, = in_turn([Signals(PERIOD, s.channels, guo().core(guo().vector)(s) + hidden + noise)])
    return DiagnosisProblem((recorded,), Blocks.of((recorded,)), WHITE)


def fits(problem: DiagnosisProblem, *effects: Effect) -> list[Refit]:
    """Guo's law with all effects, and without each of them, and alone."""
    def fitted(chosen: tuple[Effect, ...]) -> Refit:
        composition = Composition(guo(), chosen)
        begun = composition.neutral
        for effect, place in zip(composition.effects, composition.places, strict=True):
            begun[place] = STARTS[effect.name]
        return refit(problem, composition, begun)

    return [fitted(effects), *(fitted(tuple(e for e in effects if e is not without)) for without in effects),
            fitted(())]


@pytest.mark.parametrize("share", [0.0, 0.12])
def test_a_spring_has_a_name_and_what_is_dragged_has_none(share: float, rng: np.random.Generator) -> None:
    problem = problem_of(dragged(inputs()["displacement"], share), NOISE * rng.standard_normal(6000))
    fit, rest, bare = fits(problem, GasStiffness())
    assert rest.cost - fit.cost > 1000 * fit.variance, "stiffness wins by far either way"
    assert (Nameless(problem, INPUTS).beyond(bare, fit, rest) > BEYOND) == (share > 0)


def test_only_what_they_can_do_loses_its_name(rng: np.random.Generator) -> None:
    """A lag beside something that is dragged, for which a spring stands in."""
    problem = problem_of(behind_a_coil() + dragged(inputs()["displacement"], 0.12), NOISE * rng.standard_normal(6000))
    fit, without_lag, without_spring, bare = fits(problem, CoilLag(), GasStiffness())
    functions = Nameless(problem, INPUTS)
    assert functions.beyond(bare, fit, without_spring) > BEYOND and functions.beyond(bare, fit, without_lag) == 0.0


def test_a_friction_that_comes_and_goes_with_the_current_is_no_degree_of_it(rng: np.random.Generator) -> None:
    s = inputs()
    hidden = 60 * np.tanh(s["velocity"] / 2e-3) * np.sin(1.5 * np.pi * s["current"] / 2.5)
    problem = problem_of(hidden, NOISE * rng.standard_normal(6000))
    fit, rest, bare = fits(problem, SchedulingDegree())
    assert Nameless(problem, INPUTS).beyond(bare, fit, rest) > BEYOND


def crept(n: int = 6000) -> Signals:
    """One stroke out and most of the way back, at one speed and current: where it is says what time it is."""
    x = 0.01 * (1 - np.abs(np.linspace(-1.0, 0.8, n)))
    return Signals(PERIOD, {"displacement": x, "velocity": np.gradient(x, PERIOD), "current": np.full(n, 0.9)},
                   np.zeros(n))


def test_what_was_logged_is_nothing_unlogged(rng: np.random.Generator) -> None:
    """A force that depends on the position is a slow modulation in creep; and a modulation is none of the inputs."""
    s = crept()
    hidden = 60 * np.sign(s["velocity"]) * s["displacement"] / 0.01
    problem = problem_of(hidden, NOISE * rng.standard_normal(6000), s)
    fit, rest, _ = fits(problem, MissingScheduling())
    assert rest.cost - fit.cost > 300 * fit.variance and Nameless(problem, INPUTS).do_the_work(fit, rest)
    slow = 0.1 * np.sin(2 * np.pi * np.arange(6000) / 1500)
    for s in (crept(), inputs()):
        problem = problem_of(slow * guo().core(guo().vector)(s), NOISE * rng.standard_normal(6000), s)
        fit, rest, _ = fits(problem, MissingScheduling())
        assert rest.cost - fit.cost > 300 * fit.variance and not Nameless(problem, INPUTS).do_the_work(fit, rest)


def test_a_form_that_misses_something_of_the_current_is_no_memory_of_it(rng: np.random.Generator) -> None:
    """On a staircase that only rises a play is a function of the level; on a current that wanders it is not."""
    stairs = inputs().replace(current=np.repeat([0.0, 0.4, 0.8, 1.2, 1.6, 2.1], 1000))
    play = Composition(guo(), (Remanence(),))
    vector = play.neutral
    vector[play.places[0]] = STARTS["remanence"]
    for s, alike in ((stairs, True), (inputs(), False)):
        hidden = play.predict(s, vector) - guo().core(guo().vector)(s)
        problem = problem_of(hidden, NOISE * rng.standard_normal(6000), s)
        fit, _, without_play, _ = fits(problem, SchedulingDegree(), Remanence())
        assert without_play.cost - fit.cost > 50 * fit.variance
        assert static_in_place(problem, fit, without_play, ("current",)) == alike


@pytest.mark.parametrize("pole", [0.0, 0.95])
def test_noise_is_not_explained(pole: float) -> None:
    """Coloured as well, whose colour the whitening here does not know."""
    seen = []
    for seed in range(25):
        noise = lfilter([1.0], [1.0, -pole], NOISE * np.random.default_rng(seed).standard_normal(6500))[500:]
        problem = problem_of(np.zeros(6000), noise)
        fit, _, _ = fits(problem, GasStiffness())
        functions = Nameless(problem, INPUTS)
        gains = [functions.gain(fit, family) for family in functions.families]
        seen.append(any(gained > by_chance for gained, by_chance in gains))
    assert sum(seen) <= 3


def test_an_input_that_rests_or_all_but_rests_has_no_functions() -> None:
    """Rounding is no function; one that rests in every record, at another level in each, is an input like any other."""
    s = inputs(3000)
    levels = [Signals(PERIOD, {**s.channels, "current": np.full(3000, i * (1 + 1e-8))}, s["velocity"])
              for i in (0.5, 1.0, 2.0)]
    problem = DiagnosisProblem(tuple(levels), Blocks.of(levels), WHITE)
    assert len(Nameless(problem, INPUTS).families) == 6
    assert len(Nameless(DiagnosisProblem(levels[:1] * 3, problem.blocks, problem.whitening), INPUTS).families) == 3
    values = Nameless(problem, INPUTS)._functions(levels[0], ("current",))
    assert np.ptp(values, axis=0).max() == 0.0 and np.abs(values[0, :3]).min() > 1e-3


def diagnosed(hidden: np.ndarray, rng: np.random.Generator, *candidates: Effect) -> Diagnosis:
    """Guo's damper, the same beside something hidden."""
    s, units = inputs(), {"displacement": "m", "velocity": "m/s", "current": "A"}
    force = guo().core(guo().vector)(s) + hidden + NOISE * rng.standard_normal(s.n_samples)
    record = Record({**{c: Channel(s[c], units[c]) for c in INPUTS}, "force": Channel(force, "N")}, PERIOD, name="run")
    return diagnose([record], guo(), candidates, settings=DiagnosisSettings(fit_baseline=False))


def test_nothing_is_named_whose_work_they_do_as_well(rng: np.random.Generator) -> None:
    found = diagnosed(dragged(inputs()["displacement"], 0.12), rng, GasStiffness())
    assert found.verdict == "unexplained" and not found.causes
    assert "functions of the inputs without a name" in found.reason
    assert found.stand_ins == ("gas-stiffness",) and [r.name for r in found.rejected] == ["gas-stiffness"]


def test_the_others_are_not_credited_with_what_a_stand_in_explains(rng: np.random.Generator) -> None:
    found = diagnosed(behind_a_coil() + dragged(inputs()["displacement"], 0.12), rng, GasStiffness(), CoilLag())
    assert found.verdict == "unexplained" and found.explained_share is not None and found.explained_share[0] < 0.9
    assert "coil-lag" in found.reason and "gas-stiffness would do for a part" in found.reason
