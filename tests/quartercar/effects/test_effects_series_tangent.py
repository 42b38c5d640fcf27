"""Derivatives of a set with elements in series, along one march, against differences of whole simulations."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import road_like

from lpvid.baselines.signals import Linearised, Signals
from lpvid.effects.composition import STEP, Composition
from lpvid.effects.effect import by_name
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.guo import Guo
from quartercar.effects import CATALOGUE
from quartercar.effects.series import InSeries
from quartercar.effects.series_march import Elements

TABLE = by_name(CATALOGUE)
VALUES = {"series-compliance": [6e-7], "backlash": [3e-4, 5.0], "entrained-air": [3e-4, 500.0], "cavitation": [1 / 400],
          "coil-lag": [0.008], "displacement-delay": [0.003, 0.2], "coulomb-friction": [30.0, 0.0, 2e-3],
          "quadratic-loss": [2000.0], "asymmetry": [0.2], "valve-dynamics": [0.4, 40.0, 0.2],
          "thermal-fade": [5e-5, 60.0], "force-offset": [10.0]}
ELEMENTS = ("series-compliance", "backlash", "entrained-air", "cavitation")
AROUND = ((), ("coil-lag", "quadratic-loss"), ("displacement-delay", "coulomb-friction", "asymmetry"),
          ("thermal-fade", "force-offset"), ("backlash", "valve-dynamics"))


def signals(current: str) -> Signals:
    s = road_like(3, 768)
    return s if current == "held" else s.replace(current=1.2 + np.sin(9 * s.times))


def made(names: tuple[str, ...], hysteresis: bool) -> tuple[Composition, np.ndarray]:
    """Guo's law with effects, and parameters at which each of them acts."""
    base = DamperBaseline(Guo(degree=1, span=(0.0, 2.5), hysteresis=hysteresis))
    composition = Composition(base, tuple(TABLE[n] for n in dict.fromkeys(names)))
    vector = composition.neutral
    for effect, place in zip(composition.effects, composition.places, strict=True):
        vector[place] = VALUES[effect.name]
    return composition, vector


def differences(composition: Composition, s: Signals, vector: np.ndarray, step: float) -> np.ndarray:
    """(n, P) by a simulation for each parameter, inwards from a bound."""
    here, high = composition.predict(s, vector), composition.bounds[1]
    out = np.empty((s.n_samples, vector.size))
    for j, size in enumerate(step * composition.scales):
        moved = vector.copy()
        moved[j] += size if vector[j] + size <= high[j] else -size
        out[:, j] = (composition.predict(s, moved) - here) / (moved[j] - vector[j])
    return out


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(("current", "hysteresis"), [("held", True), ("swinging", False)], ids=str)
@pytest.mark.parametrize("element", ELEMENTS)
def test_columns_are_those_of_differences(element: str, current: str, hysteresis: bool) -> None:
    """Up to what the table of the law misses, at one of three steps: a jump or play may turn within a larger one."""
    s = signals(current)
    for names in AROUND:
        composition, vector = made((element, *names), hysteresis)
        found, off = composition.sensitivities(s, vector), np.full(vector.size, np.inf)
        for step in (STEP, STEP / 10, STEP / 100):
            expected = np.where(composition.chosen, 0.0, differences(composition, s, vector, step))
            size = np.maximum(np.linalg.norm(expected, axis=0), 1e-300)
            off = np.minimum(off, np.linalg.norm(found - expected, axis=0) / size)
            if off.max() < 5e-3:
                break
        assert off.max() < 5e-3, (names, composition.names[int(off.argmax())], off.max())
        assert np.median(off) < 2e-3


def test_one_march_serves_all_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    s = signals("held")
    composition, vector = made(("backlash", "quadratic-loss", "coulomb-friction"), True)
    here = composition.predict(s, vector)
    marched, march = [], InSeries.march
    monkeypatch.setattr(InSeries, "march", lambda *given: marched.append(1) or march(*given))
    composition.sensitivities(s, vector, at=here)
    assert len(marched) == 1


def test_what_differs_in_kind_is_simulated_itself() -> None:
    s = signals("held")
    base = DamperBaseline(Guo(degree=1, span=(0.0, 2.5)))
    law = base.core(base.vector)
    own = InSeries(law, Elements(play=3e-4))
    assert isinstance(own, Linearised)

    def looks_around(s: Signals) -> np.ndarray:
        return law(s) + 0.1 * np.abs(s["velocity"]).max() * s["velocity"]

    near = own.near([law, InSeries(looks_around, own.elements), InSeries(law, own.elements)])
    assert np.array_equal(near[0](s), law(s))
    assert np.array_equal(near[1](s), InSeries(looks_around, own.elements)(s))
    assert np.array_equal(near[2](s), own(s))


@pytest.mark.parametrize("hysteresis", [True, False])
def test_parts_of_the_march_change_nothing(hysteresis: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The derivatives are gone through in parts; where these end is no matter."""
    composition, vector = made(("series-compliance", "coil-lag"), hysteresis)
    whole = composition.sensitivities(signals("swinging"), vector)
    monkeypatch.setattr("quartercar.effects.series_tangent.LONG", 100)
    parted = composition.sensitivities(signals("swinging"), vector)
    assert np.abs(parted - whole).max() <= 1e-12 * np.abs(whole).max()
