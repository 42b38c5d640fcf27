"""The differentiable ride against the ordinary one, and its gradient against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar.criteria import judge
from quartercar.criteria.gradient import SIGNALS, RideGradient
from quartercar.dampers import BoucWen, Guo, Kwok, Linear
from quartercar.parameters import BENCH, MEGANE
from quartercar.rides.clairvoyant import replay
from quartercar.rides.default_damper import identified_damper
from quartercar.roads.ride_roads import IsoRoad
from quartercar.vehicle.adjoint import AdjointCar
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar
from quartercar.vehicle.passivity_balance import ride_passivity

GUO = Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5))
KWOK = Kwok(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5))
CASES = {"filter": (identified_damper(), 1 / 512, MEGANE), "filter, two steps a sample": (identified_damper(), 1 / 256,
                                                                                           MEGANE),
         "guo": (GUO, 2e-3, MEGANE), "guo, tyre with damping": (GUO, 2e-3, BENCH), "kwok": (KWOK, 2e-3, MEGANE)}
COILS = {"own lag": Coil(highest=2.5), "slow": Coil(0.004, 0.009, 0.0, 2.5)}


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.fixture(params=COILS)
def coil(request) -> Coil:
    return COILS[request.param]


@pytest.fixture(params=["nonlinear", "linear"])
def car(request, case, coil) -> QuarterCar:
    stops = BumpStops(compression=0.01, rebound=0.01) if request.param == "nonlinear" else None
    return QuarterCar(case[2], case[0], stops, coil, lift_off=request.param == "nonlinear")


def road(sample_time: float, duration: float = 0.5) -> np.ndarray:
    return IsoRoad("E", 20.0, duration).profile(sample_time, 1)


@pytest.mark.thinned(3)
def test_it_runs_as_the_ordinary_ride_does(car: QuarterCar, case):
    elevation = road(case[1])
    command = np.repeat(np.random.default_rng(0).uniform(-0.2, 2.7, elevation.size // 3 + 1), 3)[:elevation.size]
    run, found = replay(car, elevation, case[1], command), AdjointCar(car, elevation, case[1]).run(command)
    if car.stops is not None:
        assert case[2] is BENCH or (np.abs(run["stop_force"]).max() > 0 and run["tyre_load"].min() == 0)
    free = run["damper_force"] - case[0].conservative_force(run["suspension_deflection"])
    for ours, theirs in ((found.acceleration, run["body_acceleration"]), (found.tyre_force, run["tyre_force"]),
                         (found.deflection, run["suspension_deflection"]), (found.speed, run["suspension_velocity"]),
                         (found.force, free)):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=3e-9 * np.abs(theirs).max())


@pytest.mark.thinned(3)
def test_its_gradient_is_that_of_finite_differences(car: QuarterCar, case):
    elevation, rng = road(case[1]), np.random.default_rng(1)
    adjoint = AdjointCar(car, elevation, case[1])
    n = elevation.size
    weights = rng.standard_normal((5, n)) * np.array([1.0, 1e-3, 1e2, 10.0, 1e-3])[:, None]
    command = rng.uniform(0.05, 2.45, n)

    def scalar(u: np.ndarray) -> float:
        run = adjoint.run(u)
        return float(sum(w @ getattr(run, s) for w, s in zip(weights, SIGNALS, strict=True)))

    gradient = adjoint.gradient(adjoint.run(command), *weights)
    for k in (0, 1, 7, n // 2, n - 3, n - 2):
        step = np.zeros(n)
        step[k] = 1e-5
        expected = (scalar(command + step) - scalar(command - step)) / 2e-5
        assert gradient[k] == pytest.approx(expected, abs=1e-5 * np.abs(gradient).max())
    assert gradient[-1] == 0  # the last command acts on nothing


@pytest.mark.seconds
def test_figures_are_those_of_the_criteria_with_their_gradients():
    car = QuarterCar(MEGANE, identified_damper(), BumpStops(), Coil(highest=2.5))
    elevation, rng = IsoRoad("C", 20.0, 1.0).profile(1 / 512, 2), np.random.default_rng(2)
    adjoint = RideGradient(AdjointCar(car, elevation, 1 / 512), 0.5)
    command = rng.uniform(0.05, 2.45, elevation.size)
    trajectory = adjoint.car.run(command)
    found, run = adjoint.of(trajectory), replay(car, elevation, 1 / 512, command)
    expected = judge(run, 0.5)
    for name in ("comfort", "tyre_load", "stroke"):
        assert found[name].value == pytest.approx(getattr(expected, name), rel=1e-8)
    assert found["room"].value == pytest.approx(expected.space_used, rel=1e-8)
    assert found["given"].value == pytest.approx(ride_passivity(run.after(0.5)).negative_energy, rel=1e-4)
    direction = rng.standard_normal(elevation.size)
    for name, figure in found.items():
        slope = adjoint.gradient(trajectory, found, {name: 1.0}) @ direction
        ahead, behind = (adjoint.of(adjoint.car.run(command + s * 1e-6 * direction))[name].value for s in (1, -1))
        assert slope == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-6 * figure.value)


@pytest.mark.parametrize("damper", [None, Linear(), BoucWen()])
def test_a_damper_without_gradient_is_refused_in_one_line(damper):
    with pytest.raises(InputError, match="no bound is available for this damper"):
        AdjointCar(QuarterCar(MEGANE, damper, coil=Coil(highest=1.0)), np.zeros(5), 1e-3)
