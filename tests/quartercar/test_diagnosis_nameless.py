"""An entry that has the right direction and the wrong name: functions without a name do its work better."""

from __future__ import annotations

import numpy as np
import pytest
from effect_signals import PERIOD, guo, motion

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.engine import DiagnosisSettings, diagnose
from lpvid.diagnosis.nameless import BEYOND, Nameless
from lpvid.diagnosis.noise import Whitening
from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.refitting import Refit, refit
from lpvid.diagnosis.signals import Signals
from lpvid.record import Channel, Record
from quartercar.effects.electrical import CoilLag
from quartercar.effects.friction_gas import GasStiffness

NOISE = 10.0
"""[N]"""
INPUTS = ("displacement", "velocity", "current")


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


def fits(hidden: np.ndarray, effect: Effect, start: list[float], rng: np.random.Generator
         ) -> tuple[Nameless, Refit, Refit]:
    """Guo's law with one effect and alone."""
    s = inputs()
    force = guo().core(guo().vector)(s) + hidden + NOISE * rng.standard_normal(s.n_samples)
    recorded = Signals(PERIOD, s.channels, force)
    problem = Problem((recorded,), Blocks.of((recorded,)), Whitening(np.ones(1), 1.0))
    alone, composed = Composition(guo()), Composition(guo(), (effect,))
    bare = refit(problem, alone, alone.neutral)
    begun = composed.neutral
    begun[composed.places[0]] = start
    return Nameless(problem, INPUTS), refit(problem, composed, begun), bare


@pytest.mark.parametrize("share", [0.0, 0.12])
def test_a_spring_has_a_name_and_what_is_dragged_has_none(share: float, rng: np.random.Generator) -> None:
    functions, fit, bare = fits(dragged(inputs()["displacement"], share), GasStiffness(), [1e4], rng)
    assert bare.cost - fit.cost > 1000 * fit.variance, "stiffness wins by far either way"
    assert functions.replaces(fit, bare)
    assert (functions.share(bare, fit) > BEYOND) == (share > 0)


def test_what_they_cannot_do_they_do_not_replace(rng: np.random.Generator) -> None:
    s, lag = inputs(), Composition(guo(), (CoilLag(),))
    vector = lag.neutral
    vector[lag.places[0]] = 0.02
    behind = lag.predict(s, vector) - guo().core(guo().vector)(s)
    functions, fit, bare = fits(behind + dragged(s["displacement"], 0.12), CoilLag(), [0.02], rng)
    assert functions.share(bare, fit) > BEYOND and not functions.replaces(fit, bare)


def test_of_noise_they_explain_nothing() -> None:
    shares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        functions, fit, _ = fits(np.zeros(6000), GasStiffness(), [100.0], rng)
        shares.append(functions.gain(fit)[0] > functions.gain(fit)[1])
    assert sum(shares) <= 1


def test_nothing_is_named_whose_work_they_do_better(rng: np.random.Generator) -> None:
    s = inputs()
    force = guo().core(guo().vector)(s) + dragged(s["displacement"], 0.12) + NOISE * rng.standard_normal(s.n_samples)
    units = {"displacement": "m", "velocity": "m/s", "current": "A"}
    record = Record({**{c: Channel(s[c], units[c]) for c in INPUTS}, "force": Channel(force, "N")}, PERIOD, name="run")
    found = diagnose([record], guo(), (GasStiffness(),), settings=DiagnosisSettings(fit_baseline=False))
    assert found.verdict == "unexplained" and not found.causes
    assert "functions of the inputs without a name" in found.reason
    assert found.stand_ins == ("gas-stiffness",) and [r.name for r in found.rejected] == ["gas-stiffness"]
