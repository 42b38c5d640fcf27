"""The best current for a known road: no law is better, limits hold, small cases against enumeration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar.controllers import LinearSkyhook, Passive, SkyhookAccelerationDriven
from quartercar.criteria import judge
from quartercar.dampers import Guo
from quartercar.parameters import MEGANE
from quartercar.rides.bound import BoundSettings, bound_rides
from quartercar.rides.clairvoyant import HELD, CurrentSequenceProblem, Effort, best_currents, energy_limit, replay
from quartercar.rides.comparison import compare_rides
from quartercar.rides.config import build_car
from quartercar.rides.relaxation import relaxed_bound
from quartercar.rides.simulation import drive
from quartercar.rides.tuning import Objective
from quartercar.roads.ride_roads import Bump, IsoRoad, RideRoad
from quartercar.vehicle.nonlinear import Coil, QuarterCar

SHORT = IsoRoad("C", 20.0, 1.0)
LAWS = {"passive": Passive(values={"fixed_current": 0.0}), "skyhook-linear": LinearSkyhook(),
        "sh-add": SkyhookAccelerationDriven()}
QUICK = Effort(iterations=20, rounds=4, polish=120)
SOFT = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0), hysteresis=False)


@dataclass(frozen=True)
class Given(RideRoad):
    """A road from numbers."""

    heights: tuple[float, ...]

    @property
    def name(self) -> str:
        return "given"

    @property
    def settle(self) -> float:
        return 0.0

    def profile(self, sample_time: float, seed: int) -> np.ndarray:
        return np.array(self.heights)

    def to_dict(self) -> dict:
        return {}


@pytest.fixture(scope="module")
def bounds():
    car = build_car()
    found = compare_rides(car, [SHORT], LAWS, (0, 1))
    return found, bound_rides(car, [SHORT], found, how=BoundSettings(2, effort=QUICK))


@pytest.mark.slow
def test_no_law_is_better_than_the_bound(bounds):
    found, (nonlinear, linear) = bounds
    assert (nonlinear.car, linear.car) == ("nonlinear", "linear")
    best = nonlinear.values(nonlinear.at(), "objective")
    again = replay(build_car(), SHORT.profile(1 / 512, 0), 1 / 512, nonlinear.best["objective"][0].command)
    assert judge(again, SHORT.settle).comfort == pytest.approx(nonlinear.at()[0].comfort, rel=1e-8)
    for row in found.rows:
        assert np.all(best < nonlinear.values(nonlinear.laws[row.name], "objective"))
        share = nonlinear.share(row.name)
        assert share is not None and share.mean < 1
    assert nonlinear.share("passive").mean == pytest.approx(0, abs=1e-7)
    assert nonlinear.share("sh-add").mean == pytest.approx(
        (2 - nonlinear.values(nonlinear.laws["sh-add"], "objective").sum()) / (2 - best.sum()))


@pytest.mark.slow
def test_each_aim_has_the_least_of_its_figure_within_its_limits(bounds):
    _, found = bounds
    for bound in found:
        for aim, other in (("comfort", "tyre_load"), ("tyre_load", "comfort")):
            least, before = bound.values(bound.at(aim), aim), bound.values(bound.at(), aim)
            assert np.all(least <= before * (1 + HELD))
            assert bound.car == "linear" or least.mean() < 0.998 * before.mean()
            for best in bound.best[aim]:
                assert getattr(best.figures, other) <= best.limits[other] * (1 + 2 * HELD)
        for best in sum(bound.best.values(), ()):
            assert best.passivity.negative_energy <= best.limits["given"] * (1 + 2 * HELD)


@pytest.mark.slow
def test_what_is_told_of_a_bound(bounds):
    _, (nonlinear, linear) = bounds
    data = nonlinear.to_dict()
    assert set(data["best"]) == {"objective", "comfort", "tyre_load"} and set(data["shares"]) == set(LAWS)
    assert "known road" in data["obtained"] and "energy given by the damper held" in str(nonlinear)
    assert data["best"]["objective"]["against"]["comfort"]["mean"] < 0 and linear.to_dict()["shares"] == {}
    assert nonlinear.best["objective"][1].run.n_samples == 2 < nonlinear.best["objective"][0].run.n_samples


def problem(car: QuarterCar, road: RideRoad, objective: Objective, sample_time: float = 2e-3) -> CurrentSequenceProblem:
    passive = drive(car, road, [Passive(values={"fixed_current": 0.0})], [0], None)[0]
    return CurrentSequenceProblem(
        car, road, 0, sample_time, passive.figures, objective, {"given": energy_limit(passive.passivity)}
    )


@pytest.mark.seconds
def test_two_commands_against_all_of_them():
    car = QuarterCar(MEGANE, SOFT, coil=Coil(highest=2.0))
    heights = np.repeat([0.0, 0.01, 0.015, 0.0], 5)
    posed = problem(car, Given(tuple(heights)), Objective(0.5, 0.5))
    grid = np.linspace(0, 2, 9)

    def cost(first: float, second: float) -> float:
        command = np.r_[np.full(5, first), np.full(15, second)]
        return posed.objective.of([judge(replay(car, heights, 2e-3, command))], [posed.reference])

    least = min(cost(a, b) for a in grid for b in grid)
    found = best_currents(posed, {"low": np.zeros(20), "high": np.full(20, 2.0)}, QUICK)
    assert found.objective <= least + 1e-9 and found.objective < cost(0.0, 0.0)
    again = replay(car, heights, 2e-3, found.command)
    assert found.objective == pytest.approx(posed.objective.of([judge(again)], [posed.reference]), rel=1e-8)
    for name, signal in again.signals.items():
        np.testing.assert_allclose(found.run[name], signal, rtol=0, atol=1e-7 * max(np.abs(signal).max(), 1e-6))
    assert np.all((found.command >= 0) & (found.command <= 2))


@pytest.mark.seconds
def test_limits_that_can_be_met_are_met():
    """On the bump a sequence with 8 % less tyre load than SH-ADD and no more energy given exists."""
    car, road = build_car(), Bump()
    rode = drive(car, road, [SkyhookAccelerationDriven()], [0])[0]
    limits = {"tyre_load": 0.92 * rode.figures.tyre_load, "given": energy_limit(rode.passivity)}
    posed = CurrentSequenceProblem(car, road, 0, 1 / 512, rode.figures, Objective(1.0, 0.0), limits)
    found = best_currents(posed, {"sh-add": rode.run["command"]}, Effort(60, 4, 0))
    assert found.figures.tyre_load <= limits["tyre_load"] * (1 + 2 * HELD)
    assert found.passivity.negative_energy <= limits["given"] * (1 + 2 * HELD)
    assert found.figures.comfort < 0.96 * rode.figures.comfort


@pytest.mark.seconds
def test_where_the_current_changes_nothing_the_certificate_closes():
    """A viscous damper of 1500 to 1500.5 N·s/m: passive is the optimum but for 1e-4, and the relaxation proves it."""
    values = {"yield_force_at_low": 0.0, "yield_force_at_high": 0.0, "post_yield_damping_at_low": 1500.0,
              "post_yield_damping_at_high": 1500.5}
    car = QuarterCar(MEGANE, SOFT.with_values(**values), coil=Coil(highest=2.0), lift_off=False)
    posed = problem(car, SHORT, Objective())
    found = best_currents(posed, {"low": np.zeros(1000)}, Effort(30, 1, 0))
    certified = relaxed_bound(posed, found, 50)
    assert certified.value <= found.objective <= 1 and found.objective == pytest.approx(1, abs=1e-3)
    assert certified.value == pytest.approx(found.objective, abs=2e-3)


@pytest.mark.slow
def test_the_relaxed_bound_lies_below_everything_and_is_convex_to_rounding(bounds):
    _, (_, linear) = bounds
    for certified, best in zip(linear.floor, linear.best["objective"], strict=True):
        assert 0 < certified.value <= certified.attained < best.objective
        assert certified.attained - certified.value < 0.02


def test_a_relaxed_bound_wants_a_linear_car():
    car = QuarterCar(MEGANE, SOFT, coil=Coil(highest=2.0))
    posed = problem(car, Given((0.0, 0.01, 0.01)), Objective())
    with pytest.raises(InputError, match="without stops and lift-off"):
        relaxed_bound(posed, best_currents(posed, {"low": np.zeros(3)}, Effort(2, 1, 0)))


def test_bad_starts_are_refused():
    car = QuarterCar(MEGANE, SOFT, coil=Coil(highest=2.0))
    posed = problem(car, Given((0.0, 0.01, 0.01)), Objective())
    with pytest.raises(InputError, match="needs limits of the current"):
        best_currents(replace(posed, car=replace(car, coil=Coil())), {"low": np.zeros(3)})
    for starts in ({}, {"short": np.zeros(2)}):
        with pytest.raises(InputError, match="starts are commands"):
            best_currents(replace(posed), starts)
