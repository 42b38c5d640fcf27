"""Whatever `lpvid identify` writes is a damper: the same force along records and in a car, refused where it is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.identified_cases import MODELS, RATE, arx, fitted, model, run
from helpers.no_dampers import CAR_REFUSES, NO_DAMPERS, linear

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from quartercar.dampers import Identified, load_damper
from quartercar.dampers.moved import moved
from quartercar.parameters import MEGANE
from quartercar.rides.simulation import extrapolation
from quartercar.vehicle.batch import start_fleet
from quartercar.vehicle.damper_from_file import car_damper, check_rate, current_limits
from quartercar.vehicle.nonlinear import Coil, QuarterCar

SLOW = ("coprime", "quasi", "arx-tanh", "pem-ss")
KINDS = [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in MODELS]
ROAD = 0.004 * np.sin(2 * np.pi * 2.0 * np.arange(251) / RATE) ** 2
VOLTS = np.repeat([0.4, 1.5, 0.9, 1.7, 0.6], 51)[:251]


@pytest.fixture(params=KINDS)
def kind(request) -> str:
    return request.param


def car(damper) -> QuarterCar:
    return QuarterCar(MEGANE, damper, coil=Coil(lowest=0.23, highest=1.79))


@pytest.mark.thinned(3)
def test_it_runs_along_records_as_the_model_itself(kind):
    found, record = model(kind), run(1, mean=0.3)
    damper = Identified.of(found)
    wanted, got = lpv.simulate(found, record), damper.simulate(record)
    assert got.start == wanted.start
    np.testing.assert_allclose(got.output, wanted.output, rtol=0, atol=1e-6 * np.abs(record["force"]).max())
    back = damper.to_model(1 / RATE)
    np.testing.assert_allclose(lpv.simulate(back, record).output, wanted.output, rtol=0, atol=1e-4)


@pytest.mark.thinned(13, "seconds")
def test_it_comes_back_from_a_file_of_either_kind(kind, tmp_path):
    found, record = model(kind), run(1, mean=0.3)
    first = load_damper(lpv.save(found, tmp_path / "model.json"))
    again = lpv.load(lpv.save(first, tmp_path / "damper.json"))
    assert isinstance(first, Identified) and isinstance(again, Identified) and again.reads == first.reads
    np.testing.assert_array_equal(first.simulate(record).output, again.simulate(record).output)
    assert first.metadata["label"] == "model" and first.metadata["roles"]["force"] == "force"
    if "current" in first.reads:
        assert first.current_unit == "V" and first.metadata["roles"]["current"] == "voltage"
        assert current_limits(first, 9.0) == pytest.approx((run()["voltage"].min(), run()["voltage"].max()), abs=0.02)


def test_its_settled_force_is_where_a_long_run_ends(kind):
    """Oracle: the damper's own run, 4 s of constant velocity that ends at zero displacement."""
    damper = Identified.of(model(kind))
    n, v, i = 2000, 0.2, 1.1
    x = damper.centre + v / RATE * np.arange(1 - n, 1)
    ramp = "velocity" not in damper.reads or not isinstance(model(kind), lpv.model.quasi.SelfScheduled)
    record = Record({"velocity": np.full(n, v), "displacement": x if ramp else np.full(n, damper.centre),
                     "current": np.full(n, i)}, 1 / RATE, units={"velocity": "m/s", "displacement": "m",
                                                                 "current": "V"})
    end = damper.simulate(record).output[-1, 0]
    assert damper.static_force(v, i)[0] == pytest.approx(end, rel=1e-6)


def test_in_a_car_it_gives_the_force_of_the_model_along_the_motion_of_the_car(kind):
    """Oracle: the identified model itself along the motion that the car had, from rest."""
    damper = Identified.of(model(kind))
    found = car(damper).run(ROAD, 1 / RATE, VOLTS)
    record = Record({"velocity": found["suspension_velocity"], "current": found["current"],
                     "displacement": found["suspension_deflection"] + damper.centre}, 1 / RATE,
                    units={"velocity": "m/s", "displacement": "m", "current": "V"})
    wanted = damper.simulate(record).output[:, 0]
    assert np.ptp(wanted) > 20
    np.testing.assert_allclose(found["damper_force"], wanted, rtol=0, atol=1e-5 * np.ptp(wanted))


def test_it_stands_still_in_a_car_at_rest(kind):
    damper = Identified.of(model(kind))
    low = car(damper).coil.lowest
    gap = abs(damper.static_force(0.0, low)[0] - car(damper).preload)  # what the force at rest depends on the current
    found = car(damper).run(np.zeros(100), 1 / RATE, low)
    assert np.abs(found["body_displacement"]).max() <= 2 * gap / MEGANE.spring_stiffness + 1e-9
    assert found["damper_force"][0] == pytest.approx(damper.static_force(0.0, low)[0], abs=1e-3)
    assert gap < 2.0


@pytest.mark.seconds
def test_cars_side_by_side_do_what_one_does(kind):
    damper = Identified.of(model(kind))
    one = car(damper).run(ROAD, 1 / RATE, VOLTS)
    fleet = start_fleet(car(damper), 1 / RATE, np.zeros(2), np.full(2, VOLTS[0]))
    force = [fleet.strut.copy()]
    for k in range(1, 60):
        fleet.advance(np.full(2, ROAD[k]), np.full(2, VOLTS[k - 1]))
        force.append(fleet.strut.copy())
    wanted = one["damper_force"][:60] - car(damper).preload
    np.testing.assert_allclose(np.array(force), np.column_stack([wanted, wanted]), rtol=0, atol=1e-3)


@pytest.mark.parametrize("kind", ["arx", "arx-lagged", "arx-displacement", "arx-both", "subspace-displacement",
                                  "augmented", pytest.param("quasi", marks=pytest.mark.slow)])
def test_a_model_moved_to_another_sign_and_zero_is_the_same_along_the_moved_record(kind):
    found, record = model(kind), run(1, mean=0.3)
    shift = 0.21
    other = Record({"velocity": record["velocity"], "displacement": record["displacement"] - shift,
                    "current": record["voltage"], "force": -record["force"]}, 1 / RATE,
                   units={"velocity": "m/s", "displacement": "m", "current": "V", "force": "N"})
    wanted = lpv.simulate(found, record).output
    got = lpv.simulate(moved(found, -1, shift), other).output
    np.testing.assert_allclose(got, -wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


def test_a_model_scheduled_by_a_channel_of_another_name_finds_its_roles():
    record = run()
    plain = Record({"v_rod": record["velocity"], "U": record["voltage"], "F_cell": record["force"]}, 1 / RATE,
                   units={"v_rod": "m/s", "U": "V", "F_cell": "N"})
    named = fitted(arx(input="v_rod", output="F_cell", basis=Polynomial("U", 1)), plain)
    damper = Identified.of(named)
    assert damper.reads == ("velocity", "current") and damper.metadata["roles"]["current"] == "U"
    np.testing.assert_allclose(damper.simulate(run(1)).output, Identified.of(model("arx")).simulate(run(1)).output,
                               atol=1e-6)


def test_the_model_keeps_the_ranges_and_roles_of_its_training_data():
    record, found = run(), model("arx")
    ranges = found.metadata["training"]["ranges"]
    assert ranges["velocity"] == [record["velocity"].min(), record["velocity"].max()]
    assert ranges["force"] == [record["force"].min(), record["force"].max()]
    assert found.metadata["roles"] == {"velocity": "velocity", "force": "force", "current": "voltage"}
    assert "roles" in lpv.realize(found, form="augmented").model.metadata
    validated = lpv.validate(found, Record({n: record[n] for n in ("velocity", "voltage", "force")}, 1 / RATE,
                                           units={"velocity": "m/s", "voltage": "V", "force": "N"}))
    assert validated.label == "training" and validated.overall.free_run.esr < 0.01


def test_a_diagnosis_calls_its_signals_by_their_roles_so_that_effects_meet_them():
    from lpvid.diagnosis.task import prepare_task

    record = run()
    plain = Record({n: record[n] for n in ("velocity", "voltage", "force")}, 1 / RATE,
                   units={"velocity": "m/s", "voltage": "V", "force": "N"})
    found = fitted(arx(basis=Polynomial("voltage", 1)), plain)
    task = prepare_task([plain], found)
    assert found.box.names == ("voltage",) and task.baseline.channels == ("velocity", "current", "force")
    np.testing.assert_array_equal(task.prepared.training[0]["current"], record["voltage"])
    assert prepare_task([plain], Identified.of(found)).baseline.channels == task.baseline.channels


def test_a_ride_counts_what_the_records_never_held():
    damper = Identified.of(model("arx"))
    slow = car(damper).run(ROAD, 1 / RATE, VOLTS)
    assert extrapolation(slow) == {"current": 0.0, "speed": 0.0}
    fast = car(damper).run(40 * ROAD, 1 / RATE, VOLTS)
    known, speed = run()["velocity"], fast["suspension_velocity"]
    inside = np.abs(speed - 0.5 * (known.max() + known.min())) <= 0.51 * np.ptp(known)
    assert 0 < extrapolation(fast)["speed"] == pytest.approx(np.mean(~inside))
    with pytest.warns(lpv.errors.ExtrapolationWarning):
        wide = replace(car(damper), coil=Coil(lowest=0.0, highest=5.0)).run(ROAD, 1 / RATE, np.full(251, 4.0))
    assert extrapolation(wide)["current"] == 1.0


# -- what is no damper -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("case", NO_DAMPERS)
def test_what_is_no_damper_is_refused_with_one_line_and_a_mend(case, tmp_path):
    make, stated = NO_DAMPERS[case]
    with pytest.raises(InputError, match=stated) as caught:
        load_damper(lpv.save(make(), tmp_path / "model.json"))
    assert "Mend:" in str(caught.value) and "model.json" in str(caught.value)


@pytest.mark.parametrize("case", CAR_REFUSES)
def test_what_a_car_cannot_be_given_is_refused_with_one_line_and_a_mend(case, tmp_path):
    make, stated = CAR_REFUSES[case]
    with pytest.raises(InputError, match=stated) as caught:
        car_damper(lpv.save(make(), tmp_path / "model.json"))
    assert "Mend:" in str(caught.value)


def test_a_rate_that_misses_the_wheel_hop_is_refused():
    with pytest.raises(InputError, match="runs at 20 Hz only"):
        check_rate(Identified.of(linear(sample_time=0.05)), MEGANE, "'m'")
    check_rate(Identified.of(linear(sample_time=0.01)), MEGANE, "'m'")


def test_a_form_that_reads_the_future_current_is_refused(tmp_path):
    shifted = Identified.of(lpv.realize(model("arx"), form="shifted").model)
    with pytest.raises(InputError, match="2 samples ahead"):
        car(shifted).run(ROAD, 1 / RATE, VOLTS)


def test_a_reversed_model_runs_along_its_records_and_is_turned_for_the_damper():
    record = run().flip("force")
    found = fitted(arx(), record)
    found = found.replace(metadata={**found.metadata, "polarity": "reversed"})
    damper = Identified.of(found)
    assert damper.polarity == -1 and damper.static_force(0.2, 1.0)[0] > 0
    np.testing.assert_allclose(damper.simulate(record).output, lpv.simulate(found, record).output, atol=1e-6)


@pytest.mark.parametrize("name", ["arx", "arx-displacement", "arx-both", "subspace", "arx-three-zone"])
def test_the_frequency_response_about_rest_is_that_of_a_small_sine(name):
    """Oracle: a least-squares sine through the end of a long run at 7 Hz and a held current."""
    from quartercar.lpv_models.active import _mechanical

    damper, f, n, i = Identified.of(model(name)), 7.0, 4000, 1.1
    t = np.arange(n) / RATE
    v = 1e-6 * np.cos(2 * np.pi * f * t)
    record = Record({"velocity": v, "displacement": damper.centre + 1e-6 * np.sin(2 * np.pi * f * t) / (2 * np.pi * f),
                     "current": np.full(n, i)}, 1 / RATE, units={"velocity": "m/s", "displacement": "m",
                                                                 "current": "V"})
    tail = slice(n // 2, n)
    force = damper.simulate(record).output[tail, 0]
    basis = np.column_stack([np.cos(2 * np.pi * f * t[tail]), np.sin(2 * np.pi * f * t[tail]), np.ones(n - n // 2)])
    cosine, sine, _ = np.linalg.lstsq(basis, force, rcond=None)[0] / 1e-6
    found = _mechanical(damper.at_clock(1 / RATE), i, np.array([f]), 1 / RATE)[0]
    assert found == pytest.approx(cosine - 1j * sine, rel=1e-4)


def test_a_model_that_is_active_at_high_frequency_only_is_found():
    """F(k) = −200 v(k) + 800 v(k−1): 600 N·s/m settled, −1000 where v alternates."""
    from quartercar.lpv_models.active import active_frequency, active_region

    quick = Identified.of(linear(a=[[0.0, 0.0]], b=[[-200.0, 0.0], [800.0, 0.0]]))
    assert active_region(quick, (0.0, 2.0)) is None
    found = active_frequency(quick, (0.0, 2.0))
    assert found.frequency == pytest.approx(250.0) and found.damping == pytest.approx(-1000.0)
    assert active_frequency(Identified.of(linear()), (0.0, 2.0)) is None


def test_a_model_keeps_its_own_period_and_is_refused_along_another():
    damper = Identified.of(model("arx"))
    back = damper.to_model(2 / RATE)
    assert back.sample_time == damper.clock == pytest.approx(1 / RATE)
    with pytest.raises(InputError, match="another rate than the model"):
        lpv.simulate(damper, replace(run(1), time=None, sample_time=2 / RATE))
