"""Where the fit of a rival starts when something of the measurement stands in its way."""

from __future__ import annotations

import numpy as np
from effect_signals import guo, road_like

from lpvid.diagnosis.blocks import Blocks
from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.noise import Whitening
from lpvid.diagnosis.problem import Problem
from lpvid.diagnosis.refitting import refit
from lpvid.diagnosis.rivals import _without_chain
from quartercar.effects.measurement import ForceDelay, ForceOffset
from quartercar.effects.structure import FixtureResonance


def starts_of(rival: Effect, *beside: Effect) -> tuple[Composition, list[np.ndarray]]:
    """Starts of a rival in the place of a force delay, beside other effects of the set."""
    s = road_like(2, 2048)
    problem = Problem((s,), Blocks.of((s,)), Whitening(np.ones(1), 1.0))
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
