"""What cross-validation asks beyond consecutive blocks: stretches that go furthest, and stages that move."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.identification.selection import auto
from lpvid.identification.selection.excursions import furthest
from lpvid.identification.selection.free_run import cross_validate, make_folds, of_its_range
from lpvid.identification.selection.search import StructureSearch
from lpvid.identification.selection.starting import fit_from_measured_samples
from lpvid.model.input_stage import TanhStage
from lpvid.record import Record

KNEE = 0.3
"""of the tanh in the velocity [m/s]"""


def yielding(seed: int, n: int = 1500, noise: float = 0.05, size: float = 1.0) -> Record:
    """A force that yields, behind a slow pole, with noise of the sensor."""
    rng = np.random.default_rng(seed)
    v = size * np.asarray(lfilter([0.4], [1.0, -0.6], rng.standard_normal(n)))
    force = np.asarray(lfilter([1.0], [1.0, -0.7], 0.5 * v + 2.0 * np.tanh(v / KNEE)))
    channels: Any = {"velocity": v, "force": force + noise * force.std() * rng.standard_normal(n)}
    return Record(channels, 0.01, name=f"run {seed}", units={"velocity": "m/s", "force": "N"})


def test_held_out_stretches_go_further_than_all_others() -> None:
    """Oracle: every sample is in one of the two parts, in stretches of the length, and the largest are held out."""
    records = [yielding(seed) for seed in (1, 2)]
    parts = furthest(records, ["velocity"], 5, 100)
    assert parts is not None
    training, held_out = parts
    assert sum(r.n_samples for r in training) + sum(r.n_samples for r in held_out) == 3000
    assert sum(r.n_samples for r in held_out) == 600
    peaks = [np.abs(r["velocity"][k: k + 100]).max() for r in records for k in range(0, 1500, 100)]
    mean = np.mean([r["velocity"].mean() for r in records])
    assert abs(mean) < 0.05 * max(peaks)
    limit = sorted(peaks)[-6]
    assert max(np.abs(r["velocity"]).max() for r in training) < limit + 2 * abs(mean)
    assert all(np.abs(r["velocity"]).max() > limit - 2 * abs(mean) for r in held_out)


def test_units_and_constants_change_nothing() -> None:
    records = [yielding(1)]
    channels: Any = {"velocity": 1e3 * records[0]["velocity"] + 40, "rest": np.ones(records[0].n_samples)}
    scaled = [Record(channels, 0.01)]
    parts, other = furthest(records, ["velocity"], 5, 100), furthest(scaled, ["velocity", "rest"], 5, 100)
    assert parts is not None and other is not None
    assert [r.n_samples for r in parts[1]] == [r.n_samples for r in other[1]]


def test_a_folds_spline_knows_no_range_beyond_its_own_training_part() -> None:
    """Oracle: the fold of an ARX on knots of all records is that of the same ARX estimated on its training part."""
    records = [yielding(seed) for seed in (1, 2)]
    parts = furthest(records, ["velocity"], 5, 100)
    assert parts is not None
    free = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force", basis=lpv.Spline("velocity", 3, 1), lagged=True)
    low, high = (f(np.concatenate([r["velocity"] for r in records])) for f in (np.min, np.max))
    bound = replace(free, basis=lpv.Spline("velocity", 3, 1, knots=tuple(np.linspace(low, high, 4))))
    seen = np.concatenate([r["velocity"] for r in parts[0]])
    own = of_its_range(bound, records, parts[0]).basis
    assert isinstance(own, lpv.Spline)
    np.testing.assert_allclose(own.knots, np.linspace(seen.min(), seen.max(), 4))
    assert own.knots[-1] < high or own.knots[0] > low
    trial, again = (cross_validate(s, [parts], records) for s in (bound, replace(free, ridge=1e-12)))
    np.testing.assert_allclose(trial.esr, again.esr, rtol=1e-6)
    users = replace(free, basis=lpv.Spline("velocity", 3, 1, knots=(-1.0, -0.1, 0.1, 1.0)))
    assert of_its_range(users, records, parts[0]) is users


def test_short_or_still_records_have_no_such_fold() -> None:
    assert furthest([yielding(1, 900)], ["velocity"], 5, 100) is None
    still: Any = {"velocity": np.ones(2000)}
    assert furthest([Record(still, 0.01)], ["velocity"], 5, 100) is None
    parts, notes = make_folds([yielding(1, 600)], 5, 5, ["velocity"])
    assert len(parts) == 5 and not any("furthest" in n for n in notes)
    parts, notes = make_folds([yielding(1)], 5, 5, ["velocity"])
    assert len(parts) == 6 and any("1/5 of the training data" in n for n in notes)


def test_only_an_error_about_shortness_is_called_one() -> None:
    """One block of a long record is a fault of the call, which a longer record does not mend."""
    with pytest.raises(lpv.InputError, match="k must be") as fault:
        make_folds([yielding(1)], 1, 5, ["velocity"])
    assert "too short" not in str(fault.value)
    with pytest.raises(lpv.InputError, match="too short to compare structures"):
        make_folds([yielding(1, 60)], 5, 20, ["velocity"])


@pytest.mark.seconds
def test_a_basis_without_support_outside_fails_where_it_is_asked() -> None:
    """A polynomial of high degree in the velocity follows most blocks as the tanh does, and the excursions not."""
    record = yielding(3)
    parts, _ = make_folds([record], 5, 5, ["velocity"])
    shared: Any = {"na": 1, "nb": 1, "nk": 0, "input": "velocity", "output": "force"}
    rich = lpv.ARX(**shared, basis=lpv.Polynomial(("velocity",), degree=9))
    true = lpv.ARX(**shared, stage="tanh")
    bent, right = (cross_validate(s, parts, [record]).esr for s in (rich, true))
    assert np.median(bent[:5]) < 2 * np.median(right[:5]) and bent[5] > 3 * right[5]


@pytest.mark.seconds
def test_a_search_begins_at_a_fitted_stage_and_moves_it() -> None:
    record = yielding(4)
    named = lpv.OutputError(na=1, nb=1, nk=0, input="velocity", output="force", stage="tanh")
    begin = replace(named.arx, stage=TanhStage(v0=1.0))
    found = named.estimate_from([record], begin)
    assert found.model.input_stage.v0 == pytest.approx(KNEE, rel=0.05)
    assert found.model.input_stage.v0 == pytest.approx(named.estimate([record]).model.input_stage.v0, rel=1e-3)
    held = replace(named, stage=TanhStage(v0=1.0)).estimate([record])
    assert held.model.input_stage.v0 == 1.0


def test_output_errors_of_a_search_have_stages_of_their_own() -> None:
    """Those of least squares only begin them: a stage by name stays a name in what the search compares."""
    record = yielding(5)
    search = StructureSearch([record], make_folds([record], 5, 5, ["velocity"])[0], 0.0, 4, None)
    arx = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force", stage="tanh")
    search.screen([arx])
    search.cross_validate()
    leader, asked = search.leader(), search.asked_leader()
    assert leader is not None and asked is not None
    assert isinstance(leader.stage, TanhStage) and asked.stage == "tanh" and asked.basis == leader.basis
    named = lpv.OutputError(na=2, nb=2, nk=0, input="velocity", output="force", stage="tanh")
    begin = search.begin_of(named)
    assert begin is not None and begin.stage == leader.stage and begin.na == 2
    assert search.begin_of(replace(named, stage=leader.stage)) is None
    assert search.begin_of(replace(named, stage="three-zone")) is None


@pytest.mark.seconds
def test_the_cost_of_measured_starts_is_that_of_their_noise() -> None:
    """Oracle: a pole a carries the noise of its first sample on, σ²/(1 − a²) in all, whichever sample that is."""
    a, sigma, n = 0.9, 0.5, 20_000
    rng = np.random.default_rng(8)
    u = rng.standard_normal(n)
    x = np.asarray(lfilter([0.0, 1.0], [1.0, -a], u))
    clean: Any = {"u": u, "y": x}
    noisy: Any = {"u": u, "y": x + sigma * rng.standard_normal(n)}
    model = lpv.identify(Record(clean, 0.01), lpv.ARX(na=1, nb=1, nk=1, input="u", output="y")).model
    fit = fit_from_measured_samples(model, [Record(noisy, 0.01)], 400)
    power = float(np.sum((noisy["y"] - noisy["y"].mean()) ** 2))
    cost = (1 - fit / 100) ** 2 * power - float(np.sum((noisy["y"] - x)[1:] ** 2))
    assert cost == pytest.approx(sigma**2 * a**2 / (1 - a**2), rel=0.25)  # 400 starts, standard error 7 %
    assert fit_from_measured_samples(model, [Record(clean, 0.01)], 5) == pytest.approx(100.0, abs=1e-4)


@pytest.mark.slow
def test_a_yielding_damper_is_found_beyond_its_training_range() -> None:
    """Held-out data of twice the size: within a point of what the noise leaves."""
    found = auto(yielding(6), "velocity", "force", held_out=yielding(7, size=2.0), budget=30)
    assert found.identification is not None and found.identification.held_out is not None
    assert "tanh" in repr(found).splitlines()[0]
    assert found.identification.held_out.overall.free_run.fit_percent > 100 * (1 - 0.05 / np.sqrt(1.05**2)) - 1.0
