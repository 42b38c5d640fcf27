"""Fitting input stages and scheduling filters: known ones are found again, on real data they pay."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from lpvid import _threads
from lpvid.errors import InputError
from lpvid.files import read
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.compliance import Compliance
from lpvid.identification.output_error import OutputError
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.selection.automatic import _automatic_candidates
from lpvid.identification.stage_fit import DIVERGED_COST, free_run_cost, shorten, unresolved
from lpvid.model.input_stage import TanhStage, ThreeZoneStage
from lpvid.model.scheduling_stage import SchedulingLag, SchedulingStage
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling, Spline

TS = 0.002
P1 = Polynomial("current", degree=1)


def motion(rng: np.random.Generator, n: int, rms: float = 0.3) -> np.ndarray:
    """Velocity of a rig: a few sines of random phase, wide enough to cross the knees."""
    t = TS * np.arange(n)
    parts = [np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) / f**0.5 for f in (0.7, 1.9, 3.3, 5.1, 8.7, 13.0)]
    v = np.sum(parts, axis=0)
    return rms * v / v.std()


def stepped_current(rng: np.random.Generator, n: int, hold: int = 120) -> np.ndarray:
    return np.repeat(rng.uniform(0, 2, -(-n // hold)), hold)[:n]


def respond(shaped: np.ndarray, p: np.ndarray, rng: np.random.Generator, noise: float) -> np.ndarray:
    """Force of a first-order filter of the shaped inputs, written out; output noise on top."""
    gains = [(1500.0, 300.0), (600.0, 400.0)]
    y = np.zeros(len(p))
    for k in range(1, len(p)):
        y[k] = (0.7 - 0.05 * p[k]) * y[k - 1]
        for column in range(shaped.shape[1]):
            b0, b1 = gains[column] if shaped.shape[1] > 1 else (9000.0, 1500.0)
            y[k] += 0.3 * (b0 + b1 * p[k]) * shaped[k - 1, column]
    return y + noise * y.std() * rng.standard_normal(len(p))


def bench(stage, rng: np.random.Generator, n: int = 5000, noise: float = 0.0) -> Record:
    v, p = motion(rng, n), stepped_current(rng, n)
    y = respond(stage.apply(v[:, None], p[:, None]), p, rng, noise)
    return Record({"velocity": v, "current": p, "force": y}, sample_time=TS)


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(("noise", "tolerance", "esr"), [(0.0, 0.01, 1e-6), (0.001, 0.05, 1e-4)])
@pytest.mark.parametrize(("v0", "slope"), [(0.05, 0.0), (0.2, 0.0), (0.1, 0.05)])
def test_a_known_knee_is_found(
    v0: float, slope: float, noise: float, tolerance: float, esr: float, rng: np.random.Generator
) -> None:
    record = bench(TanhStage(v0=v0, slope=slope), rng, noise=noise)
    found = identify(record.slice(0, 3500), ARX(na=1, nb=1, basis=P1, stage="tanh"), held_out=record.slice(3500, 5000))
    stage = found.model.input_stage
    assert isinstance(stage, TanhStage)
    for current in (0.0, 1.0, 2.0):
        assert stage.v0 + stage.slope * current == pytest.approx(v0 + slope * current, rel=tolerance)
    assert found.held_out is not None
    assert found.held_out.overall.free_run.esr < esr
    assert found.n_parameters == found.layout.size + 2
    assert any("input stage tanh" in note and "holds it fixed" in note for note in found.notes)


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize(
    "true",
    [
        ThreeZoneStage(limit=0.06, upper=0.075, lower=0.075),
        ThreeZoneStage(limit=0.15, upper=0.3, lower=0.12),
    ],
)
def test_known_zones_are_found(true: ThreeZoneStage, rng: np.random.Generator) -> None:
    record = bench(true, rng)
    found = identify(
        record.slice(0, 3500), ARX(na=1, nb=1, basis=P1, stage="three-zone"), held_out=record.slice(3500, 5000)
    )
    stage = found.model.input_stage
    assert isinstance(stage, ThreeZoneStage)
    for current in (0.0, 1.0, 2.0):
        assert stage.limit + stage.limit_slope * current == pytest.approx(true.limit, rel=0.05)
        assert stage.upper + stage.upper_slope * current == pytest.approx(true.upper, abs=0.01)
        assert stage.lower + stage.lower_slope * current == pytest.approx(true.lower, abs=0.01)
    assert found.held_out is not None
    assert found.held_out.overall.free_run.esr < 1e-3


def test_a_given_stage_is_taken_as_it_is(rng: np.random.Generator) -> None:
    true = TanhStage(v0=0.1)
    found = identify(bench(true, rng, 1500), ARX(na=1, nb=1, basis=P1, stage=true))
    assert found.model.input_stage == true
    assert found.training is not None
    assert found.training.overall.free_run.esr < 1e-18


@pytest.mark.seconds
def test_a_known_lag_of_the_current_is_found(rng: np.random.Generator) -> None:
    v, p = motion(rng, 5000), stepped_current(rng, 5000)
    seen = np.zeros(5000)  # the current behind a coil with 20 ms, as a plain loop
    seen[0] = p[0]
    for k in range(1, 5000):
        seen[k] = seen[k - 1] + (1 - np.exp(-TS / 0.020)) * (p[k] - seen[k - 1])
    y = respond(v[:, None], seen, rng, 0.0)
    record = Record({"velocity": v, "current": p, "force": y}, sample_time=TS)
    found = identify(record, ARX(na=1, nb=1, basis=P1, schedule_filter="lag"))
    lag = found.model.scheduling_stage
    assert isinstance(lag, SchedulingLag)
    assert lag.tau_rise == pytest.approx(0.020, rel=0.01)
    assert found.training is not None
    assert found.training.overall.free_run.esr < 1e-5


@pytest.mark.seconds
@pytest.mark.skipif(sys.platform != "linux", reason="forks are used on Linux")
def test_one_and_two_processes_find_the_same(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    v, p = motion(rng, 800), stepped_current(rng, 800)
    y = respond(v[:, None], SchedulingLag(0.01, 0.02).apply(p[:, None], TS)[:, 0], rng, 0.02)
    record = Record({"velocity": v, "current": p, "force": y}, sample_time=TS)
    begun, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: begun.append(1) or fork())
    monkeypatch.setattr(_threads, "undisturbed", lambda: True)  # threads of the test runner wait and hold no lock

    def fitted(processors: int) -> tuple[np.ndarray, SchedulingStage | None, int]:
        monkeypatch.setattr(_threads, "processors", lambda: processors)
        monkeypatch.setattr(_threads, "_crew", _threads._Crew())
        begun.clear()
        found = identify(record, ARX(na=1, nb=1, basis=P1, schedule_filter="rise-fall"))
        return found.parameters, found.model.scheduling_stage, len(begun)

    (one, lag, alone), (two, same, beside) = fitted(1), fitted(2)
    assert np.array_equal(one, two)
    assert lag == same
    assert (alone, beside) == (0, 2)  # the starts, and the two that are refined


def test_a_run_away_costs_more_than_any_that_stays(rng: np.random.Generator) -> None:
    """A saw-tooth that grows by 1.2 a sample; with its resets weighted out the regression is unstable."""
    y = 1.2 ** (np.arange(600) % 25)
    record = Record({"u": rng.normal(size=600), "y": y, "w": (np.arange(600) % 25 > 0).astype(float)}, sample_time=TS)
    unstable = ARX(na=1, nb=1, input="u", output="y", weight="w")
    none = Scheduling((), (), ())
    assert DIVERGED_COST < free_run_cost([record], unstable, none) < 2 * DIVERGED_COST
    assert free_run_cost([record], ARX(na=0, nb=1, input="u", output="y"), none) < 2.0
    dead = record.with_channel("u", np.zeros(600))
    assert free_run_cost([dead], unstable, none) == 2 * DIVERGED_COST


def test_cost_is_the_pooled_free_run_error(rng: np.random.Generator) -> None:
    records = [bench(TanhStage(0.1), rng, n, noise=0.05) for n in (700, 300)]
    structure = ARX(na=2, nb=2, basis=P1)
    found = identify(records, structure)
    bound = ARX(na=2, nb=2, basis=found.model.basis)
    assert found.training is not None
    assert free_run_cost(records, bound, found.model.box) == pytest.approx(found.training.overall.free_run.esr)


def test_shortening_keeps_heads_within_the_budget() -> None:
    records = [Record({"x": np.arange(float(n))}, sample_time=TS) for n in (1000, 3000, 30)]
    assert shorten(records, 5000, 10) == records
    cut = shorten(records, 403, 10)
    assert [r.n_samples for r in cut] == [100, 300, 10]
    assert all(r["x"][0] == 0 for r in cut)


# -- real data --------------------------------------------------------------------------------------------------
def thirds(record: Record) -> tuple[Record, Record]:
    split = 2 * record.n_samples // 3
    return record.slice(0, split), record.slice(split, record.n_samples)


def test_real_gyroscope(shared_data: Path) -> None:
    (record,) = read(shared_data / "gyroscope" / "estimation.csv")
    train, test = thirds(record)
    structure = ARX(
        na=3,
        nb=3,
        nk=1,
        input="motor current",
        output="gimbal speed",
        basis=Polynomial(("p1", "p2", "p3"), degree=1),
        affine=4,
    )
    found = identify(train, structure, held_out=test)
    assert found.held_out is not None
    assert found.held_out.overall.free_run.fit_percent >= 94.0


@pytest.mark.seconds
def test_real_mr_damper_under_random_voltage(shared_data: Path) -> None:
    (record,) = read(shared_data / "mr_damper_random" / "estimation.csv")
    train, test = thirds(record)
    structure = ARX(
        na=4, nb=4, nk=0, input="velocity", output="force", basis=Polynomial("voltage", degree=1), stage="tanh"
    )
    found = identify(train, structure, sample_rate=500.8, held_out=test)
    assert found.model.sample_time == pytest.approx(1 / 500.8, rel=1e-6)
    assert found.held_out is not None
    assert found.held_out.overall.free_run.esr <= 0.06
    assert any("resampled" in note for note in found.held_out.notes)


@pytest.mark.seconds
def test_fitted_stages_are_stated_with_units(rng: np.random.Generator) -> None:
    """v0 in the input's unit, its slope per unit of the scheduling, time constants in s; once for each estimator."""
    record = bench(TanhStage(v0=0.1, slope=0.05), rng)
    record = Record({n: record[n] for n in record.channels}, sample_time=TS,
                    units={"velocity": "m/s", "current": "A", "force": "N"})
    for structure in (ARX(na=1, nb=1, basis=P1, stage="tanh", schedule_filter="lag"),
                      OutputError(na=1, nb=1, basis=P1, stage="tanh", schedule_filter="lag")):
        stated, = (n for n in identify(record, structure).notes if "input stage tanh" in n)
        assert "v0 0.1 m/s, slope 0.05 (m/s)/A" in stated and " s" in stated.split("tau_rise")[1]


@pytest.mark.seconds
def test_a_knee_beyond_the_data_is_bounded_and_called_not_identifiable(rng: np.random.Generator) -> None:
    """A cubic law is tanh of any wide knee: the search ends where tanh departs from a line by (1/5)²/3."""
    v = np.convolve(rng.normal(size=1500), np.ones(8) / 8, "same")
    v *= 0.13 / np.abs(v).max()
    force = 1500 * v + 2e5 * v**3
    record = Record({"velocity": v, "force": force + rng.normal(size=v.size)}, sample_time=TS,
                    units={"velocity": "m/s", "force": "N"})
    found = identify(record, ARX(na=0, nb=1, nk=0, input="velocity", output="force", stage="tanh"))
    stage = found.model.input_stage
    assert stage is not None and 0.3 < stage.v0 <= 5 * 0.13 * (1 + 1e-9)
    assert np.abs(found.model.b).max() < 1e6  # of 500 N that are cubic, 6e4 at most by 1/(r³/3)
    if stage.v0 > 5 * 0.13 * 0.999:
        assert any(n.startswith("not identifiable: the knee") and "is beyond the data" in n for n in found.notes)


def test_a_knee_that_no_sample_reaches_is_not_identifiable(rng: np.random.Generator) -> None:
    record = bench(TanhStage(v0=0.1), rng)
    top = float(np.abs(record["velocity"]).max())
    asked = ARX(na=1, nb=1, basis=P1, stage="tanh")
    for v0, open_ in ((5.01 * top, True), (4.9 * top, False)):
        model = identify(record, ARX(na=1, nb=1, basis=P1, stage=TanhStage(v0=v0))).model
        assert bool(unresolved(model, asked, [record])) == open_


def test_a_knee_at_its_bound_is_named_with_its_unit(rng: np.random.Generator) -> None:
    """v0 as low as the search goes, the width elsewhere from the slope: not collapsed, and stated all the same."""
    record = bench(TanhStage(v0=1e-9, slope=0.1), rng)
    record = Record({n: record[n] for n in record.channels}, sample_time=TS,
                    units={"velocity": "m/s", "current": "A", "force": "N"})
    asked = ARX(na=1, nb=1, basis=P1, stage="tanh")
    model = identify(record, ARX(na=1, nb=1, basis=P1, stage=TanhStage(v0=1e-9, slope=0.1))).model
    stated, = unresolved(model, asked, [record])
    assert "v0" in stated and "1e-09 m/s" in stated and "current is 0" in stated
    wide = identify(record, ARX(na=1, nb=1, basis=P1, stage=TanhStage(v0=1e-3, slope=0.1))).model
    assert unresolved(wide, asked, [record]) == ()


@pytest.mark.parametrize("structure", [
    ARX(na=1, nb=2, nk=0, input="velocity", output="force", basis=P1, schedule_filter="rise-fall"),
    OutputError(na=1, nb=2, nk=0, input="velocity", output="force", basis=P1, schedule_filter="lag"),
    QuasiLPV(nb=2, on="trial", basis=Spline("force", 4, order=1), external=P1, schedule_filter="lag"),
    Compliance(current="current", schedule_filter="rise-fall")])
def test_a_filter_of_a_scheduling_at_rest_is_refused(structure):
    """Time constants of a filter whose input never moves are free: what a search returned was its start."""
    rng = np.random.default_rng(4)
    held = []
    for level in (0.0, 1.0, 2.0):
        v, p = motion(rng, 400), np.full(400, level)
        held.append(Record({"velocity": v, "current": p, "force": respond(v[:, None], p, rng, 0.001)}, sample_time=TS,
                           units={"velocity": "m/s", "current": "A", "force": "N"}))
    with pytest.raises(InputError, match="current is constant within every record"):
        identify(held, structure)


def test_auto_offers_no_filter_where_the_scheduling_rests():
    rng = np.random.default_rng(5)
    moving = bench(TanhStage(0.1), rng, 600)
    units = {"velocity": "m/s", "current": "A", "force": "N"}
    moving = Record({n: moving[n] for n in units}, sample_time=TS, units=units)
    resting = Record({**{n: moving[n] for n in units}, "current": np.ones(600)}, sample_time=TS, units=units)
    for records, offered in (([moving], True), ([resting], False)):
        found = _automatic_candidates(records, "velocity", "force", "current")
        assert any(c.schedule_filter is not None for c in found) is offered


@pytest.mark.seconds
def test_a_collapsed_knee_is_named_beside_a_finite_condition_number() -> None:
    """Dry friction: the free run does not depend on a knee within which no sample lies; J has columns of zero."""
    rng = np.random.default_rng(0)
    t = np.arange(1500) / 500
    v, current = 0.1 * np.sin(9 * t) + 0.05 * np.sin(31 * t + 1), 0.6 + 0.5 * np.sign(np.sin(2.1 * t))
    force = 300 * (1 + current) * np.sign(v) + 800 * v + rng.normal(0, 5, t.size)
    record = Record({"velocity": v, "current": current, "force": force}, sample_time=1 / 500,
                        units={"velocity": "m/s", "current": "A", "force": "N"})
    found = identify(record, OutputError(na=1, nb=1, nk=0, input="velocity", output="force", stage="tanh",
                                                 basis=Polynomial("current", degree=1)))
    assert np.isfinite(found.condition) and " inf" not in repr(found)
    assert any(n.startswith("not identifiable: v0, slope") for n in found.notes)
    assert any("acts as sign(velocity)" in n for n in found.notes)
