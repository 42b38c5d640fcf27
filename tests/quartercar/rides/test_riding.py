"""Rides: the loop against its parts, energy and passivity, comparison, intervals, tuning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from lpvid.errors import InputError, NumericalError
from lpvid.identification.free_run_search import VectorLayout
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.signals import Signal
from quartercar import roads
from quartercar.controllers import ClippedOptimal, Groundhook, Passive, Skyhook, SkyhookAccelerationDriven
from quartercar.controllers.contract import Law, Setting, Values
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import BODY, SETS, MeasurementSet, Sensor
from quartercar.criteria import judge
from quartercar.dampers import Compliance, Guo, Linear, PowerLawFrictionGas
from quartercar.dampers.blackbox.held import Held
from quartercar.parameters import MEGANE
from quartercar.rides.comparison import FIGURES, Interval, compare_rides, joined, pareto
from quartercar.rides.default_damper import identified_damper
from quartercar.rides.simulation import RideSettings, drive, ride
from quartercar.rides.tuning import Objective, Trial, tune
from quartercar.roads.ride_roads import Bump, IsoRoad, MeasuredRoad, SineSweep
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar
from quartercar.vehicle.passivity_balance import has_storage, ride_passivity
from quartercar.vehicle.result import CarRun

IDEAL = RideSettings(ChainSettings(sensors=SETS["ideal"]), sample_time=0.002)
COARSE = RideSettings(ChainSettings(sensors=SETS["ideal"]), sample_time=0.004)
SHORT = IsoRoad("C", 20.0, 2.0)
BRIEF = IsoRoad("C", 20.0, 0.5)
HYSTERETIC = Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0))
COIL = Coil(0.005, 0.010, 0.0, 2.0)


def plain() -> Guo:
    """A law that is affine in the current, without hysteresis."""
    return Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0), hysteresis=False, values={
        "yield_force_at_low": 50.0, "yield_force_at_high": 1200.0, "sharpness": 15.0,
        "post_yield_damping_at_low": 500.0, "post_yield_damping_at_high": 1200.0})


def car(damper=None, coil: Coil = COIL) -> QuarterCar:
    return QuarterCar(MEGANE, damper or plain(), BumpStops(), coil)


# -- the loop ----------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_constant_current_is_the_car_without_a_loop():
    found = ride(car(), SHORT, Passive(values={"fixed_current": 0.7}), seed=3)
    z = SHORT.profile(0.002, 3)
    alone = car().run(z, 0.002, 0.7)
    # the loop starts at rest at the lowest current, the other run settled at 0.7 A: they differ while the coil rises
    for name in ("body_acceleration", "tyre_force", "suspension_deflection"):
        late = slice(400, None)
        np.testing.assert_allclose(found.run[name][late], alone[name][late], atol=0.02 * np.abs(alone[name]).max())
    assert found.figures.comfort == pytest.approx(judge(found.run, 1.0).comfort)


@pytest.mark.seconds
def test_ideal_skyhook_written_down_anew():
    """Two-state skyhook on ideal sensors and a coil at once, by a loop over the car's own stepper."""
    coil, law = Coil(highest=2.0), Skyhook(values={"low_damping": 600.0, "high_damping": 2500.0})
    found = ride(car(coil=coil), SHORT, law, 1, IDEAL)
    z, damper = SHORT.profile(0.002, 1), plain()
    grid = np.linspace(0.0, 2.0, 11)
    stepper, command, states = car(coil=coil).start(0.002, z[0], 0.0), [], []
    x, on, held = np.zeros(4), False, 0.0
    for k in range(z.size):
        v = x[1] - x[3]
        if abs(v) > 5e-3:
            on = bool(x[1] * v > 0)
            force = damper.law(np.zeros(11), np.full(11, v), grid, damper.vector)
            asked = (2500.0 if on else 600.0) * v
            if np.ptp(force) >= 5.0:
                rising = force * np.sign(v)
                held = float(np.interp(asked * np.sign(v), rising, grid))
        command.append(held)
        if k + 1 < z.size:
            moved = stepper.advance(z[k + 1:k + 2], np.array([held]))
            x = moved.motion[-1]
        states.append(x[1])
    np.testing.assert_allclose(found.run["command"], command, atol=1e-9)
    np.testing.assert_allclose(found.run["body_velocity"][1:], states[:-1], atol=1e-12)


@pytest.mark.slow
def test_same_seed_same_ride_whatever_else_is_ridden():
    one = ride(car(), SHORT, Skyhook(), seed=4)
    many = drive(car(), SHORT, [Groundhook(), Skyhook(), Passive(), Skyhook()], [1, 4, 2, 5])
    np.testing.assert_array_equal(many[1].run["body_acceleration"], one.run["body_acceleration"])
    assert not np.array_equal(many[3].run["road"], one.run["road"])
    assert many[2].controller.name == "passive"


@pytest.mark.slow
def test_noise_changes_the_ride_and_nothing_else():
    quiet = RideSettings(ChainSettings(sensors=SETS["stroke-body"].quiet()))
    loud, calm = (ride(car(), SHORT, Skyhook(), 1, s) for s in (None, quiet))
    np.testing.assert_array_equal(loud.run["road"], calm.run["road"])
    assert not np.array_equal(loud.run["command"], calm.run["command"])


@pytest.mark.seconds
def test_the_identified_damper_is_ridden_at_its_own_rate():
    found = ride(car(identified_damper(), Coil(highest=2.5)), SHORT, SkyhookAccelerationDriven())
    assert found.run.sample_time == identified_damper().clock
    assert 0 < found.out_of_reach < 1 and found.passivity.holds is None
    assert "no storage function" in repr(found)


@pytest.mark.slow
def test_semi_active_control_beats_every_fixed_current():
    damper = identified_damper()
    passive = [Passive(values={"fixed_current": i}) for i in (0.0, 0.1, 0.2, 0.4)]
    road, laws = IsoRoad("C", 20.0, 6.0), [*passive, SkyhookAccelerationDriven()]
    rides = drive(car(damper, Coil(highest=2.5)), road, [law for law in laws for _ in range(3)], list(range(3)) * 5)
    points = {str(k): tuple(np.mean([(r.figures.comfort, r.figures.tyre_load) for r in rides[3 * k:3 * k + 3]], axis=0))
              for k in range(5)}
    assert "4" in pareto(points)
    assert points["4"][1] < min(points[str(k)][1] for k in range(4))


@pytest.mark.seconds
def test_what_is_not_measured_is_named():
    sensors = MeasurementSet("no-stroke", (BODY, Sensor("suspension_velocity"), Sensor("suspension_deflection")))
    settings = RideSettings(ChainSettings(sensors=sensors), sample_time=0.004)
    assert ride(car(), BRIEF, Skyhook(), 0, settings).run.n_samples > 0

    class Curious(Skyhook):
        @property
        def reads(self) -> tuple[str, ...]:
            return (*super().reads, "wheel_acceleration")

    with pytest.raises(InputError, match="wheel_acceleration"):
        ride(car(), SHORT, Curious())


def test_a_coil_without_limits_is_refused():
    with pytest.raises(InputError, match="limits of the current"):
        ride(car(coil=Coil()), SHORT, Skyhook())


@pytest.mark.seconds
@pytest.mark.parametrize("damper", [None, Linear(values={"damping": 1500.0})])
def test_a_car_without_a_current_needs_no_coil(damper):
    """Its rides are those with a coil, whose command changes nothing, and no command stands at a limit."""
    found, limited = (ride(QuarterCar(MEGANE, damper, coil=c), BRIEF, Skyhook(), 0, COARSE) for c in (Coil(), COIL))
    np.testing.assert_array_equal(found.run["body_acceleration"], limited.run["body_acceleration"])
    assert found.at_limits is None and limited.at_limits is None and "follows none" in repr(found)
    assert ride(car(), BRIEF, Skyhook(), 0, COARSE).at_limits is not None


def test_a_ride_too_short_for_figures_names_the_mend():
    with pytest.raises(InputError, match=r"too short.*Mend: give a longer duration"):
        ride(car(), IsoRoad("C", 20.0, 0.001), Skyhook())
    with pytest.raises(InputError, match=r"too short.*Mend: give a longer duration"):
        ride(car(), SineSweep(duration=1e-4), Skyhook())
    track = MeasuredRoad(roads.Track(np.array([0.0, 0.01]), np.zeros(2)), 20.0, 1)
    with pytest.raises(InputError, match=r"too short.*Mend: give a longer track, more laps, or a lower speed"):
        ride(car(), track, Skyhook())


# -- energy ------------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_viscous_damper_takes_what_it_is_given():
    found = ride(QuarterCar(MEGANE, Linear(values={"damping": 1500.0}), coil=COIL), SHORT, Passive())
    after = found.run.after(1.0)
    v = after["suspension_velocity"]
    taken = 1500.0 * np.trapezoid(v**2, dx=0.002)
    assert found.passivity.dissipated == pytest.approx(taken, rel=1e-9)
    assert found.passivity.storage == "known" and found.passivity.holds and found.passivity.negative_share == 0


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("damper", [plain(), PowerLawFrictionGas()])
def test_delivered_less_stored_never_falls_below_the_start(damper):
    found = ride(car(damper), Bump(duration=2.0), Skyhook())
    assert found.passivity.holds and found.passivity.lowest is not None and found.passivity.lowest > -1e-3
    balance = found.run.after(1.0).energy()
    z, rest = found.run.after(1.0)["suspension_deflection"], damper.conservative_force(np.zeros(1))[0]
    spring = np.trapezoid(damper.conservative_force(np.linspace(z[0], z[-1], 101)) - rest, dx=(z[-1] - z[0]) / 100)
    assert found.passivity.dissipated == pytest.approx(balance.damper - spring, rel=1e-3, abs=0.05)


def run_of(force: np.ndarray, v: np.ndarray, damper) -> CarRun:
    """A run with a force and a velocity of our own."""
    base = QuarterCar(MEGANE, damper, coil=COIL).run(np.zeros(force.size), 0.01)
    z = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * 0.01])
    signals = {**base.signals, "damper_force": force, "suspension_velocity": v, "suspension_deflection": z}
    return CarRun(0.01, signals, base.units, base.static_load, base.car)


def test_a_spring_gives_back_half_of_the_time_and_no_more_than_it_had():
    t = 0.01 * np.arange(1001)
    v = 0.1 * np.cos(2 * np.pi * t)
    z = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * 0.01])
    k = 1e4
    spring = HYSTERETIC.conservative_force(z)
    hidden = ride_passivity(run_of(k * z + spring, v, HYSTERETIC))  # of unknown storage
    assert hidden.holds is None
    assert hidden.negative_share == pytest.approx(0.5, abs=0.03)
    assert hidden.returned == pytest.approx(0.5 * k * z.max() ** 2, rel=0.01)
    assert hidden.negative_energy == pytest.approx(20 * 0.5 * k * z.max() ** 2, rel=0.02)
    known = ride_passivity(run_of(k * z, v, Linear(values={"damping": 0.0, "stiffness": k})))
    assert known.holds and known.negative_share == 0.0 and abs(known.dissipated) < 1e-9


def test_energy_from_nowhere_is_seen():
    v = 0.3 * np.sin(0.05 * np.arange(600))
    found = ride_passivity(run_of(-200.0 * v, v, Linear(values={"damping": 0.0})))
    assert found.holds is False and found.lowest is not None
    assert found.lowest == pytest.approx(-200.0 * np.trapezoid(v**2, dx=0.01))
    assert "GAVE" in str(found)


@pytest.mark.seconds
def test_a_series_spring_keeps_what_it_stores():
    """Maxwell element, c in series with k: dissipated = ∫F²/c dt."""
    k, c, period = 2e5, 1500.0, 1 / 512
    model = ComplianceModel((Element([[-c, 0.0, c]], k),), [-1.0, 0.0, 1.0], [0.0], [], 0.0, period,
                            (Signal("velocity", "m/s"),), (Signal("force", "N"),))
    damper = Compliance(lags=1, levels=1, displacement=False,
                        stored=Held(model, VectorLayout(model.vector.size)).to_dict())
    run = QuarterCar(MEGANE, damper, coil=COIL).run(IsoRoad("C", 20.0, 1.0).profile(period, 0), period)
    found, force = ride_passivity(run), run["damper_force"]
    assert found.storage == "known" and found.holds
    assert found.negative_share > 0.02 and found.returned > 0.1  # it does give back, of what it had
    assert found.dissipated == pytest.approx(np.trapezoid(force**2 / c, dx=period), rel=0.02)


@pytest.mark.seconds
def test_the_laws_may_know_another_damper_than_the_car_has():
    rough = RideSettings(model=Guo(degree=1, span=(0.0, 2.5), current_range=(0.0, 2.5)))
    plant = car(identified_damper(), Coil(highest=2.5))
    known, guessed = (ride(plant, SHORT, Skyhook(), 1, s) for s in (None, rough))
    assert guessed.run.sample_time == known.run.sample_time
    assert not np.array_equal(known.run["command"], guessed.run["command"])
    assert guessed.figures.comfort == pytest.approx(known.figures.comfort, rel=0.3)


def test_which_dampers_have_a_storage_function():
    assert has_storage(None, (0, 2)) and has_storage(plain(), (0, 2)) and has_storage(PowerLawFrictionGas(), (0, 2))
    assert has_storage(Guo(), (0, 2))  # without current: F(z, v) − F(z, 0) has the sign of v
    assert not has_storage(HYSTERETIC, (0, 2)) and not has_storage(identified_damper(), (0, 2))


# -- roads -------------------------------------------------------------------------------------------------------------
def test_iso_road_has_its_spectrum_and_its_seeds():
    road = IsoRoad("B", 20.0, 40.0)
    z = road.profile(0.002, 0)
    assert z[0] == 0 and not np.array_equal(z, road.profile(0.002, 1))
    np.testing.assert_array_equal(z, road.profile(0.002, 0))
    density = 4 * np.pi**2 * 64e-6 * 0.01 * 20.0  # one-sided, of the velocity
    rate = np.diff(np.concatenate([road.profile(0.002, s) for s in range(6)]).reshape(6, -1), axis=1) / 0.002
    assert rate.var() == pytest.approx(density * 250.0, rel=0.03)  # white up to 250 Hz


def test_bump_and_sweep_and_track():
    z = Bump(0.06, 3.0, 10.0, 3.0, "A").profile(0.001, 0) - Bump(0.0, 3.0, 10.0, 3.0, "A").profile(0.001, 0)
    assert z.max() == pytest.approx(0.06, rel=1e-4) and np.count_nonzero(z) == pytest.approx(300, abs=2)
    assert np.flatnonzero(z)[0] == pytest.approx(1100, abs=2)
    sweep = SineSweep(0.02, 1.0, 10.0, 5.0)
    w = np.diff(sweep.profile(1e-4, 0)) / 1e-4
    assert np.abs(w[:10000]).max() == pytest.approx(np.abs(w[-1000:]).max(), rel=0.15)  # velocity stays
    assert np.abs(w).max() == pytest.approx(2 * np.pi * 1.0 * 0.02, rel=0.06)
    track = roads.Track(np.array([0.0, 5.0, 10.0]), np.array([0.0, 0.05, 0.0]), "ridge")
    assert MeasuredRoad(track, 5.0).profile(0.5, 9).tolist() == pytest.approx([0, 0.025, 0.05, 0.025, 0])


@pytest.mark.parametrize(("make", "message"), [
    (lambda: IsoRoad("Q"), "class"), (lambda: IsoRoad(speed=-1.0), "speed"), (lambda: Bump(length=0.0), "length"),
    (lambda: SineSweep(lowest=5.0, highest=2.0), "low to high"), (lambda: IsoRoad().profile(0.002, -1), "seed")])
def test_roads_that_are_none(make, message: str):
    with pytest.raises(InputError, match=message):
        make()


# -- comparison --------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def comparison():
    laws = {"passive": Passive(values={"fixed_current": 0.5}), "skyhook": Skyhook(),
            "sh-add": SkyhookAccelerationDriven()}
    return compare_rides(car(), [SHORT, Bump(duration=1.5)], laws, range(4), COARSE)


@pytest.mark.seconds
def test_rows_are_the_rides(comparison):
    row = comparison.row("skyhook", SHORT.name)
    alone = drive(car(), SHORT, [Skyhook()] * 4, range(4), COARSE)
    np.testing.assert_array_equal(row.values("comfort"), [r.figures.comfort for r in alone])
    assert comparison.reference == "sh-add" and comparison.names == ("passive", "skyhook", "sh-add")
    assert row.rides[0].run.n_samples > 100 > row.rides[1].run.n_samples


def test_intervals_are_students(comparison):
    row, other = (comparison.row(n, SHORT.name) for n in ("skyhook", "passive"))
    values = row.values("tyre_load")
    low, high = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    found = row.interval("tyre_load")
    assert (found.mean, found.low, found.high) == pytest.approx((values.mean(), low, high))
    gap = row.against(other, "comfort")
    pairs = stats.ttest_rel(row.values("comfort"), other.values("comfort")).confidence_interval(0.95)
    scale = other.values("comfort").mean()
    assert (gap.low, gap.high) == pytest.approx((pairs.low / scale, pairs.high / scale))
    assert Interval.of(np.array([2.0])).low is None


def test_the_front_is_unbeaten(comparison):
    for road in comparison.roads:
        means = {r.name: (r.interval("comfort").mean, r.interval("tyre_load").mean) for r in comparison.on(road)}
        for name, (c, t) in means.items():
            beaten = any(oc <= c and ot <= t and (oc, ot) != (c, t) for oc, ot in means.values())
            assert beaten != (name in comparison.front[road])


def test_a_comparison_says_what_it_found(comparison):
    described = comparison.to_dict()
    assert described["schema"] == "quartercar/ride/1" and len(described["rides"]) == 6
    first = described["rides"][0]
    assert first["figures"]["comfort"]["unit"] == "m/s^2" and first["passivity"]["holds"] is True
    assert comparison.verdict in str(comparison)


@pytest.mark.slow
def test_laws_that_were_driven_apart_have_the_figures_of_those_driven_together():
    laws = {"passive": Passive(), "skyhook": Skyhook(), "sh-add": SkyhookAccelerationDriven()}
    roads = (SHORT, IsoRoad("B", 15.0, 1.0))

    def driven(names):
        return compare_rides(car(), roads, {n: laws[n] for n in names}, range(2), IDEAL)

    together, apart = driven(laws), joined(driven(["passive", "sh-add"]), driven(["skyhook"]))
    assert apart.roads == together.roads and apart.reference == "sh-add" and apart.notes == together.notes
    for road in together.roads:
        for name in laws:
            for figure in FIGURES:
                np.testing.assert_array_equal(apart.row(name, road).values(figure),
                                              together.row(name, road).values(figure))
    with pytest.raises(InputError, match="same law"):
        joined(together, driven(["skyhook"]))
    with pytest.raises(InputError, match="other roads or seeds"):
        joined(together, compare_rides(car(), [SHORT], {"groundhook": Groundhook()}, range(2), IDEAL))


def test_comparisons_that_are_none():
    with pytest.raises(InputError, match="needs roads"):
        compare_rides(car(), [], {"a": Skyhook()}, [0])
    with pytest.raises(InputError, match="twice"):
        compare_rides(car(), [SHORT, SHORT], {"a": Skyhook()}, [0])
    with pytest.raises(InputError, match="controller"):
        compare_rides(car(), [SHORT], {"a": Skyhook()}, [0], reference="b")
    with pytest.raises(InputError, match="control law"):
        compare_rides(car(), [SHORT], {"a": 3}, [0])


# -- tuning ------------------------------------------------------------------------------------------------------------
def trial(**changes) -> Trial:
    road = IsoRoad("C", 20.0, 1.0)
    return Trial(**{"car": car(), "roads": (road,), "seeds": (50, 51), "settings": COARSE, **changes})


@pytest.mark.seconds
def test_tuning_keeps_its_budget_and_never_gets_worse():
    for law in (ClippedOptimal(), Passive()):
        found = tune(law, trial(), budget=12)
        assert found.evaluations == 12 and found.costs.size == 12
        assert found.objective <= found.before and found.objective == found.costs.min()
        for p in law.parameters:
            assert p.lower <= found.controller.values[p.name] <= p.upper


@pytest.mark.slow
def test_tuning_is_repeatable_and_its_figure_is_that_of_its_rides():
    one, two = (tune(Skyhook(), trial(), 6, seed=3) for _ in range(2))
    assert dict(one.controller.values) == dict(two.controller.values)
    references = trial().references()
    rides = drive(car(), trial().roads[0], [one.controller] * 2, (50, 51), COARSE)
    cost = [0.5 * r.figures.comfort / unit.comfort + 0.5 * r.figures.tyre_load / unit.tyre_load
            for r in rides for unit in [references[r.road, r.seed]]]
    assert one.objective == pytest.approx(np.mean(cost), rel=1e-12)
    assert all(r.figures.space_used is not None and r.figures.space_used < 1 for r in rides)


@pytest.mark.seconds
def test_the_passive_car_at_its_lowest_current_is_the_unit():
    found = trial().costs([Passive(values={"fixed_current": 0.0})], trial().references())
    assert found[0] == pytest.approx(1.0)


@pytest.mark.seconds
def test_a_cap_keeps_the_tyre_load_below_that_of_another_law():
    law = SkyhookAccelerationDriven()
    capped = trial(objective=Objective(1.0, 0.0, tyre_cap=1.0), reference=law)
    unit = capped.references()
    assert capped.costs([law], unit)[0] == pytest.approx(1.0)
    stiff, soft = (Passive(values={"fixed_current": i}) for i in (2.0, 0.0))
    for other in (stiff, soft):
        rides = drive(car(), capped.roads[0], [other] * 2, capped.seeds, COARSE)
        comfort, tyre = (np.mean([getattr(r.figures, n) / getattr(unit[r.road, r.seed], n) for r in rides])
                         for n in ("comfort", "tyre_load"))
        assert capped.costs([other], unit)[0] == pytest.approx(comfort + 20 * max(0.0, tyre - 1))


@pytest.mark.slow
def test_a_comfort_objective_finds_a_softer_passive_car_than_a_tyre_objective():
    law = Passive(values={"fixed_current": 1.0})
    soft, firm = (tune(law, trial(objective=o), 8).controller.values["fixed_current"]
                  for o in (Objective(1.0, 0.0), Objective(0.0, 0.0, 1.0)))
    assert soft < firm


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Brittle(Passive):
    """A law whose design fails above half an ampere."""

    failure: type[Exception] = NumericalError

    def begin(self, values: Values, setting: Setting) -> Law:
        if values["fixed_current"].max() > 0.5:
            raise self.failure("no design for these values")
        return super().begin(values, setting)


@pytest.mark.parametrize("failure", [pytest.param(NumericalError, marks=pytest.mark.seconds), *(
    pytest.param(e, marks=pytest.mark.slow) for e in (ZeroDivisionError, InputError, np.linalg.LinAlgError))])
def test_a_design_that_fails_costs_infinitely_much_and_ends_no_tuning(failure):
    one = trial()
    unit = one.references()
    laws = [Brittle(values={"fixed_current": i}, failure=failure) for i in (0.0, 1.0, 0.25)]
    costs = one.costs(laws, unit)
    assert costs[0] == pytest.approx(1.0) and costs[1] == np.inf
    assert costs[2] == one.costs([Passive(values={"fixed_current": 0.25})], unit)[0]
    found = tune(laws[2], one, 8, references=unit)
    failed = found.tried[:, 0] > 0.5
    assert failed.any() and np.array_equal(np.isinf(found.costs), failed) and np.isfinite(found.objective)


@pytest.mark.seconds
def test_a_law_that_cannot_work_with_its_own_values_is_said_before_tuning():
    with pytest.raises(InputError, match="no design"):
        tune(Brittle(values={"fixed_current": 1.0}, failure=InputError), trial(), 4)
    lost = tune(Brittle(values={"fixed_current": 1.0}), trial(), 8)
    assert lost.before == np.inf and np.isfinite(lost.objective)


def test_objectives_that_are_none():
    with pytest.raises(InputError, match="weights"):
        Objective(0.0, 0.0)
    with pytest.raises(InputError, match="budget"):
        tune(Skyhook(), trial(), budget=1)
