"""What healthy files share is part of the law: a file differs by what it has beyond that, or in another strength."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.toy_diagnosis import CAUSES, Bent, Cubic, Dry, Late, record

from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.evidence.priors import inclusion_prior
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.fleet_law import FleetEffect, FleetLaw
from lpvid.errors import InputError
from lpvid.fleet.strengths import refitted, strengths
from lpvid.record import Record

SHARED, SPREAD = 0.8, 0.03
"""gain of the cubic that every specimen has, and its relative standard deviation"""


def extended() -> ExtendedModel:
    composition = Composition(Bent(), (Cubic(),))
    vector = np.array([2.0, 3.0, 1.5, SHARED])
    return ExtendedModel(composition, vector, np.full((4, 4), np.nan), ("u", "c"))


def run(k: int, cubic: float = SHARED, dry: float = 0.0) -> Record:
    rng = np.random.default_rng(k)
    gain = cubic * (1 + SPREAD * rng.standard_normal())
    return record(rng, hidden=lambda u: gain * u**3 + dry * np.sign(u))


class Seen(Cubic):
    """One that the samples show."""

    visible = True


@cache
def fleet() -> FleetLaw:
    free = FleetLaw.free(extended())
    return FleetLaw.of(free.shared, [refitted(free, [run(k)]) for k in range(12)])


def test_further_effects_take_their_place_among_its_own() -> None:
    law = FleetLaw.free(extended())
    s = law.signals(run(0))
    around = Composition(law, (Dry(),))
    plain = Composition(Bent(), (Cubic(), Dry()))
    at = np.array([2.1, 2.9, 1.4, 0.7, 0.5])  # law, its cubic, dry; the plain one in the order of names
    np.testing.assert_array_equal(around.predict(s, at), plain.predict(s, at))
    np.testing.assert_allclose(around.sensitivities(s, at), plain.sensitivities(s, at), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(law.core(law.vector)(s), Composition(Bent(), (Cubic(),)).predict(s, law.vector))


def test_what_samples_show_is_the_cause_and_no_other_strength_than_the_fleet_s() -> None:
    """Its prior holds for its own neutral value, not for that of the fleet."""
    own = FleetEffect(Seen(), np.array([SHARED]))
    assert inclusion_prior(Seen()) > 0 > inclusion_prior(own) == inclusion_prior(Cubic())


def test_an_effect_of_its_own_composed_once_more_replaces_it() -> None:
    law = FleetLaw.free(extended())
    s = law.signals(run(0))
    (own,) = (e for e in law.candidates(CAUSES) if e.name == "cubic")
    assert isinstance(own, FleetEffect) and own.neutral == pytest.approx([SHARED])
    twice = Composition(law, (own,))
    np.testing.assert_array_equal(twice.predict(s, twice.neutral), law.core(law.vector)(s))
    at = np.append(law.vector, 1.7)
    np.testing.assert_array_equal(twice.predict(s, at), Composition(Bent(), (Cubic(),)).predict(s, at[[0, 1, 2, 4]]))
    slopes = twice.sensitivities(s, at)
    assert not slopes[:, 3].any()
    np.testing.assert_allclose(slopes[:, 4], s["u"] ** 3, rtol=1e-6, atol=1e-6)


def test_what_a_further_diagnosis_found_becomes_part_of_the_law() -> None:
    law = FleetLaw.free(extended())
    more = ExtendedModel(Composition(law, (Late(),)), np.append(law.vector, 0.4), np.full((5, 5), np.nan), ("u", "c"))
    joined = FleetLaw.free(more)
    assert joined.shared.effects == ("cubic", "late") and joined.inner.baseline is law.inner.baseline
    s = law.signals(run(0))
    np.testing.assert_array_equal(joined.core(joined.vector)(s), more.composition.predict(s, more.vector))


def test_its_numbers_stay_within_the_spread_of_the_specimens() -> None:
    found = fleet()
    width = found.upper[3] - found.lower[3]
    assert found.lower[3] < SHARED < found.upper[3]
    assert 2 * SPREAD * SHARED < width < 20 * SPREAD * SHARED
    assert all(c.lower <= v <= c.upper for c, v in zip(found.coefficients, found.vector, strict=True))
    wild = FleetLaw.of(found.shared, [*(found.shared.vector * (1 + 0.01 * k) for k in range(-4, 5)),
                                      100 * found.shared.vector])
    assert (wild.upper < 2 * np.abs(found.shared.vector)).all()  # one that is no specimen moves no bound


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("cubic", "dry", "named"), [(SHARED, 0.0, ()), (SHARED, 1.0, ("dry",)),
                                                     (2 * SHARED, 0.0, ("cubic",))])
def test_a_file_differs_by_what_it_has_beyond_the_fleet(cubic: float, dry: float, named: tuple[str, ...]) -> None:
    law = fleet()
    found = diagnose([run(100, cubic, dry)], law, law.candidates(CAUSES))
    assert tuple(c.name for c in found.causes) == named, found


@pytest.mark.seconds
def test_what_every_file_has_is_an_error_without_the_fleet_alone() -> None:
    law = fleet()
    assert diagnose([run(100)], law, law.candidates(CAUSES)).verdict == "nothing-to-explain"
    assert diagnose([run(100)], Bent(), CAUSES).verdict != "nothing-to-explain"


def test_strengths_of_a_file_are_compared_with_those_of_healthy_ones() -> None:
    law = fleet()
    cubic = next(e for e in law.candidates(CAUSES) if e.name == "cubic")
    composition = Composition(law, (cubic, Dry()))
    vector = np.concatenate([law.vector, [2 * SHARED, 1.0]])
    model = ExtendedModel(composition, vector, np.full((6, 6), np.nan), ("u", "c"))
    found = strengths(model, [[run(k)] for k in range(4)])
    assert found["cubic"]["here"] == [2 * SHARED] and found["dry"]["here"] == [1.0]
    assert np.allclose(found["cubic"]["healthy"], SHARED, rtol=0.2)
    assert np.abs(found["dry"]["healthy"]).max() < 0.2


def test_a_file_with_fewer_parameters_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a version in which an effect had one parameter fewer: later ones would move by one place."""
    monkeypatch.setattr(ExtendedModel, "from_dict", lambda data: fleet().shared)  # the toy is not installed
    data = fleet().to_dict()
    shorter = data | {"at": data["at"][:-1], "lower": data["lower"][:-1], "upper": data["upper"][:-1]}
    with pytest.raises(InputError, match="diagnose the fleet again"):
        FleetLaw.from_dict(shorter)
    np.testing.assert_array_equal(FleetLaw.from_dict(data).vector, fleet().vector)
