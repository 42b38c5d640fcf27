"""Cars side by side against each car alone."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError, NumericalError
from quartercar import roads
from quartercar.dampers import BoucWen, Guo, Linear
from quartercar.parameters import BENCH, MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.batch import Log, start_fleet
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar

STEP = 1 / 512
LAGGING = Coil(0.004, 0.009, 0.0, 2.5)


def driven(car: QuarterCar, n: int, cars: int, seed: int = 0) -> tuple[Log, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    z = np.column_stack([roads.iso8608(n, 1 / STEP, "C", speed=20.0, rng=rng) for _ in range(cars)])
    z -= z[0]
    command = np.repeat(rng.uniform(0, 2.5, (-(-n // 16), cars)), 16, axis=0)[:n]
    fleet = start_fleet(car, STEP, z[0], command[0])
    log = Log(fleet, z)
    for k in range(n):
        log.note(command[k])
        if k + 1 < n:
            fleet.advance(z[k + 1], command[k])
    return log, z, command


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("damper", "tolerance"), [
    (None, 1e-12), (Linear(values={"damping": 1200.0, "mass": 2.0}), 1e-12),
    (Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5)), 1e-12), (identified_damper(), 1e-6)])
@pytest.mark.parametrize("coil", [Coil(highest=2.5), LAGGING])
def test_a_fleet_is_its_cars(damper, tolerance: float, coil: Coil):
    car = QuarterCar(MEGANE, damper, BumpStops(compression=0.01, rebound=0.01), coil)
    log, z, command = driven(car, 700, 3)
    for k in range(3):
        alone, run = car.run(z[:, k], STEP, command[:, k]), log.run(k)
        for name in ("body_acceleration", "wheel_acceleration", "damper_force", "tyre_force", "current", "stop_force"):
            np.testing.assert_allclose(run[name], alone[name], atol=tolerance * max(1.0, np.abs(alone[name]).max()))


def test_any_other_damper_goes_car_by_car():
    car = QuarterCar(MEGANE, BoucWen(), coil=Coil(highest=2.0))
    log, z, command = driven(car, 60, 2)
    np.testing.assert_allclose(log.run(1)["body_acceleration"],
                               car.run(z[:, 1], STEP, command[:, 1])["body_acceleration"], atol=1e-9)


def test_accelerations_are_those_of_the_run():
    car = QuarterCar(BENCH)  # a tyre with damping: the road's rate counts
    z = 1e-3 * np.sin(np.arange(50.0))[:, None] * np.ones((1, 2))
    z -= z[0]
    fleet = start_fleet(car, STEP, z[0], np.zeros(2))
    found = []
    for k in range(50):
        found.append([a[1] for a in fleet.accelerations])
        if k + 1 < 50:
            fleet.advance(z[k + 1], np.zeros(2))
    run = car.run(z[:, 1], STEP)
    np.testing.assert_allclose(np.array(found).T, [run["body_acceleration"], run["wheel_acceleration"]], atol=1e-12)


def test_a_car_out_of_all_bounds_ends_the_ride():
    car = QuarterCar(MEGANE, Linear(values={"damping": 0.0}), coil=Coil(highest=1.0))
    fleet = start_fleet(car, STEP, np.zeros(1), np.zeros(1))
    with pytest.raises(NumericalError, match="all bounds"):
        fleet.advance(np.array([1e9]), np.zeros(1))


def test_another_rate_than_the_damper_has():
    with pytest.raises(InputError, match="own rate"):
        start_fleet(QuarterCar(MEGANE, identified_damper(), coil=Coil(highest=2.5)), 1 / 700, np.zeros(1), np.zeros(1))


@pytest.mark.slow
def test_the_embedded_damper_is_what_its_data_give():
    from quartercar.rides.default_damper import identify_damper

    anew, kept = identify_damper(), identified_damper()
    np.testing.assert_allclose(anew.vector, kept.vector, rtol=1e-4, atol=1e-6)


def test_the_embedded_damper_simulates_what_it_has_not_seen():
    from quartercar.rig import default_records

    record = default_records(0, "held-out", ["test-1"])[0]
    run = identified_damper().simulate(record)
    force = record["force"][run.start:]
    error = force - run.output[run.start:, 0]
    assert np.sum(error**2) / np.sum((force - force.mean()) ** 2) < 0.02
