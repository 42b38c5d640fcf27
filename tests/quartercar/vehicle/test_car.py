"""The nonlinear quarter car against scipy, the linear car, energy, and every damper's own response."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from helpers.damper_cases import LAWS, NAMES, truth
from helpers.toy_dampers import Toy
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import lsim

import quartercar
from lpvid.errors import InputError, NumericalError
from quartercar import roads
from quartercar.criteria import judge
from quartercar.dampers import BoucWen, Drive, Guo, Kwok, Linear, LpvArx, PowerLawFrictionGas
from quartercar.dampers.contract import ExtrapolationWarning
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.stepper import StateStepper, rates_move
from quartercar.parameters import BENCH, MEGANE, CarParameters
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import BumpStops, Coil, QuarterCar
from quartercar.vehicle.result import CarRun

REFERENCE = MEGANE.replace(tyre_stiffness=208e3)
STEP = 1e-3


def rough(n: int, seed: int = 3, height: float = 1.0, step: float = STEP) -> np.ndarray:
    """A road of class C at 20 m/s from zero, times `height`."""
    z = roads.iso8608(n, 1 / step, "C", speed=20.0, rng=np.random.default_rng(seed))
    return height * (z - z[0])


def bump(n: int = 1500, height: float = 0.06, length: int = 120) -> np.ndarray:
    z = np.zeros(n)
    z[100:100 + length] = height * np.hanning(length)
    return z


def integrated(car: QuarterCar, force, road: np.ndarray, step: float, **options) -> np.ndarray:
    """(n, 4) motion by scipy, written down anew: force(z_d, v_d, t) is the damper's without its preload."""
    p, stops = car.parameters, car.stops
    load = (p.sprung_mass + p.unsprung_mass) * 9.81 if car.lift_off else np.inf
    times = step * np.arange(road.size)

    def rates(t, x):
        k = min(int(t / step + 1e-9), road.size - 2)
        slope = (road[k + 1] - road[k]) / step
        z, v = x[0] - x[2], x[1] - x[3]
        strut = p.spring_stiffness * z + force(z, v, t)
        if stops is not None:
            strut += stops.stiffness * (max(z - stops.rebound, 0) - max(-z - stops.compression, 0))
        tyre = min(p.tyre_stiffness * (x[2] - road[k] - slope * (t - times[k])) + p.tyre_damping * (x[3] - slope), load)
        return [x[1], -strut / p.sprung_mass, x[3], (strut - tyre) / p.unsprung_mass]

    found = [np.array([road[0], 0, road[0], 0])]
    for k in range(road.size - 1):  # sample by sample: the road has a kink at each
        part = solve_ivp(rates, (times[k], times[k + 1] - 1e-13), found[-1], rtol=1e-9, atol=1e-12, **options)
        found.append(part.y[:, -1])
    return np.array(found)


def motion(run: CarRun) -> np.ndarray:
    return np.column_stack([run[n] for n in ("body_displacement", "body_velocity", "wheel_displacement",
                                             "wheel_velocity")])


def identity_gap(run: CarRun) -> float:
    """m_s z̈_s + m_us z̈_us + F_t, against the largest tyre force."""
    p = run.car.parameters
    total = p.sprung_mass * run["body_acceleration"] + p.unsprung_mass * run["wheel_acceleration"] + run["tyre_force"]
    return float(np.abs(total).max() / np.abs(run["tyre_force"]).max())


# -- the linear car ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("parameters", [MEGANE, BENCH])
def test_passive_car_is_the_linear_car(parameters: CarParameters):
    road = rough(1000, height=0.2)
    run = QuarterCar(parameters, lift_off=False).run(road, STEP)
    system = LinearCar(parameters).relative()
    velocity = np.diff(road) / STEP  # held over each step
    x, out = np.zeros(4), []
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4] = system.A, system.B[:, 0]
    e = expm(block * STEP)
    for w in velocity:
        x = e[:4, :4] @ x + e[:4, 4] * w
        out.append(system.C @ x + system.D[:, 0] * w)
    for name, column in zip(system.outputs, np.array(out).T, strict=True):
        np.testing.assert_allclose(run[name][1:], column, atol=1e-9 * np.abs(column).max())


def test_passive_car_against_lsim():
    road = rough(1000, height=0.2)
    system = LinearCar(MEGANE).absolute().select(inputs=("road",), outputs=("body_acceleration", "tyre_force"))
    _, out, _ = lsim((system.A, system.B, system.C, system.D), road, STEP * np.arange(road.size))
    run = QuarterCar(MEGANE).run(road, STEP)
    np.testing.assert_allclose(run["body_acceleration"], out[:, 0], atol=1e-8 * np.abs(out[:, 0]).max())
    np.testing.assert_allclose(run["tyre_force"], out[:, 1], atol=1e-8 * np.abs(out[:, 1]).max())


def test_linear_damper_is_the_linear_car():
    road = rough(1500, height=0.3)
    damper = Linear(values={"damping": 1500.0, "stiffness": 5000.0})
    passive = QuarterCar(MEGANE.replace(spring_stiffness=34500.0)).run(road, STEP)
    run = QuarterCar(MEGANE, damper).run(road, STEP)
    for name in ("body_acceleration", "tyre_force", "suspension_deflection"):
        np.testing.assert_allclose(run[name], passive[name], atol=1e-10 * np.abs(passive[name]).max())


def test_a_nonlinear_law_that_is_straight_is_the_linear_car():
    # tanh of next to nothing: the implicit solution instead of the exact exponential, of order two
    law = Kwok(values={"viscous_damping": 1500.0, "stiffness": 5000.0, "hysteresis_force": 0.0, "offset": 0.0})
    road = bump(800, 0.02)
    exact = QuarterCar(MEGANE, Linear(values={"damping": 1500.0, "stiffness": 5000.0})).run(road, STEP)
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        run = QuarterCar(MEGANE, law, longest_step=step).run(road, STEP)
        errors.append(np.abs(run["body_acceleration"] - exact["body_acceleration"]).max())
    assert errors[1] < 1e-3 * np.ptp(exact["body_acceleration"])
    assert errors[0] / errors[1] > 3.4 and errors[1] / errors[2] > 3.4


def test_a_moved_mass_in_the_damper_is_an_inerter():
    b, c, road = 12.0, 1500.0, bump(600, 0.02)
    run = QuarterCar(MEGANE, Linear(values={"mass": b, "damping": c})).run(road, STEP)
    p = MEGANE
    mass = np.array([[p.sprung_mass + b, -b], [-b, p.unsprung_mass + b]])
    stiff = np.array([[p.spring_stiffness, -p.spring_stiffness], [-p.spring_stiffness,
                                                                  p.spring_stiffness + p.tyre_stiffness]])
    loss = c * np.array([[1.0, -1], [-1, 1]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, stiff), -np.linalg.solve(mass, loss)]])
    _, out, _ = lsim((a, np.r_[0, 0, np.linalg.solve(mass, [0, p.tyre_stiffness])][:, None], np.eye(4),
                      np.zeros((4, 1))), road, STEP * np.arange(road.size))
    np.testing.assert_allclose(motion(run), out[:, [0, 2, 1, 3]], atol=1e-9)
    assert identity_gap(run) < 1e-12
    force = c * run["suspension_velocity"] + b * (run["body_acceleration"] - run["wheel_acceleration"])
    np.testing.assert_allclose(run["damper_force"], force, atol=1e-9 * np.abs(force).max())


# -- roads -------------------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_iso_class_b_at_20_metres_per_second(rng):
    # synthesis.md, section 1: 0.81093 m/s² and 418.3 N
    squares = []
    for _ in range(3):
        road = roads.iso8608(300_000, 1000.0, "B", speed=20.0, rng=rng)
        ride = judge(QuarterCar(REFERENCE, longest_step=STEP).run(road - road[0], STEP), settle=5.0)
        squares.append((ride.acceleration**2, ride.tyre_load**2))
    acceleration, load = np.sqrt(np.mean(squares, axis=0))
    assert acceleration == pytest.approx(0.81093, rel=0.01)
    assert load == pytest.approx(418.3, rel=0.01)


@pytest.mark.seconds
def test_iso_class_b_without_chance(rng):
    # white velocity as a periodic sum of cosines of equal amplitude: only the phases are drawn
    n = 1 << 16
    lines = np.arange(1, n // 2)
    f = lines / (n * STEP)
    spectrum = np.zeros(n // 2 + 1, complex)
    amplitude = np.sqrt(2 * 64e-6 * 0.1**2 * 20.0 / f**2 / (n * STEP))
    spectrum[1:-1] = 0.5 * n * amplitude * np.exp(2j * np.pi * rng.random(lines.size))
    period = np.fft.irfft(spectrum, n)
    ride = judge(QuarterCar(REFERENCE).run(np.tile(period, 2), STEP), settle=n * STEP)
    assert ride.acceleration == pytest.approx(0.81093, rel=3e-3)
    missing = 208e3**2 * 64e-6 * 0.1**2 * 20 / 500  # above the lines the wheel stands still: k_t² ∫_500^∞ G(f) df
    assert ride.tyre_load == pytest.approx(np.sqrt(418.3**2 - missing), rel=1e-3)
    assert ride.off_road == 0


def test_measured_profile(tmp_path: Path):
    path = tmp_path / "profile.csv"
    path.write_text("distance [m],left [mm],right [mm]\n" + "\n".join(f"{10 + k},{k},{5 + 2 * k}" for k in range(4)))
    track = roads.measured(path, "right")
    assert track.length == 3 and track.name == "right"
    np.testing.assert_allclose(track.elevation, [0, 2e-3, 4e-3, 6e-3])
    there_and_back = track.over_time(2.0, 0.25, laps=2)
    np.testing.assert_allclose(there_and_back[[0, 3, 6, 9, 12]], [0, 3e-3, 6e-3, 3e-3, 0], atol=1e-15)
    with pytest.raises(InputError, match="no track"):
        roads.measured(path, "middle")
    with pytest.raises(InputError, match="no track number 3"):
        roads.measured(path, 2)


def test_belgian_blocks(shared_data: Path):
    file = shared_data / "belgian_block_road" / "profiles.csv"
    track = roads.measured(file, 1)
    assert track.length == pytest.approx(10.0) and track.distance.size == 1001
    run = QuarterCar(MEGANE, Guo()).run(track.over_time(5.0, STEP), STEP)
    assert judge(run).comfort > 1.25 and run["tyre_load"].min() >= 0
    assert identity_gap(run) < 1e-12


# -- the nonlinear car -------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_against_scipy_with_every_nonlinearity_at_work():
    law = Guo(current_range=(0.0, 2.0))
    car = QuarterCar(MEGANE, law, BumpStops(1e5, 0.03, 0.04), longest_step=1e-4)
    road = bump(400, 0.09)
    current = np.where(np.arange(road.size) < 200, 0.5, 1.5)
    run = car.run(road, STEP, current)
    preload = float(law.conservative_force(np.zeros(1))[0])

    def force(z, v, t):
        return float(law.force(z, v, current[min(int(t / STEP + 1e-9), road.size - 1)])[0]) - preload

    wanted = integrated(car, force, road, STEP)
    assert run["tyre_load"].min() == 0 and np.abs(run["stop_force"]).max() > 100  # lifted off, stops hit
    np.testing.assert_allclose(motion(run), wanted, atol=2e-4 * np.ptp(wanted, axis=0).max())
    for column in range(4):
        assert np.abs(motion(run) - wanted)[:, column].max() < 2e-4 * np.ptp(wanted[:, column])


def test_half_the_step_is_a_quarter_of_the_error():
    road = bump(500, 0.03)
    finest = QuarterCar(MEGANE, Guo(), longest_step=1e-5).run(road, STEP, 1.0)
    errors = [np.abs(motion(QuarterCar(MEGANE, Guo(), longest_step=h).run(road, STEP, 1.0)) - motion(finest)).max()
              for h in (1e-3, 5e-4, 2.5e-4)]
    assert errors[0] / errors[1] > 3 and errors[1] / errors[2] > 3
    assert errors[1] < 1e-3 * np.ptp(motion(finest))


def test_the_tyre_never_pulls_on_the_road():
    run = QuarterCar(MEGANE, Guo()).run(bump(1500, 0.12, 60), STEP, 0.0)
    load = 352.5 * 9.81
    assert run.static_load == pytest.approx(load)
    assert run["tyre_force"].max() <= load * (1 + 1e-12) and run["tyre_load"].min() >= 0
    air = run["tyre_load"] == 0
    assert 20 < air.sum() < 1000
    # in the air the two masses fall freely together
    fall = (315 * run["body_acceleration"] + 37.5 * run["wheel_acceleration"])[air] / 352.5
    np.testing.assert_allclose(fall, -9.81, rtol=1e-9)
    assert run["tyre_deflection"][air].min() >= load / MEGANE.tyre_stiffness * (1 - 1e-9)
    free = QuarterCar(MEGANE, Guo(), lift_off=False).run(bump(1500, 0.12, 60), STEP, 0.0)
    assert free["tyre_load"].min() < 0


@pytest.mark.parametrize("parameters", [MEGANE, MEGANE.replace(tyre_damping=80.0)])
def test_energy_balance_with_stops_and_lift_off(parameters: CarParameters):
    car = QuarterCar(parameters, Guo(), BumpStops(1e5, 0.03, 0.04))
    gaps = []
    for step in (5e-4, 2.5e-4):
        t = np.arange(int(1.2 / step)) * step
        road = 0.09 * np.interp(t, [0.1, 0.12, 0.16, 0.22], [0.0, 0.3, 1.0, 0.0]) + 0.01 * np.sin(11 * t) ** 2
        balance = QuarterCar(parameters, Guo(), car.stops, longest_step=step).run(road, step, 1.0).energy()
        gaps.append(abs(balance.gap) / balance.road)
        assert balance.road > 0 and balance.damper > 0
        assert (balance.tyre > 0) == (parameters.tyre_damping > 0)
    assert gaps[1] < 2e-4 and gaps[1] < gaps[0]


def test_gas_is_carried_by_the_spring():
    car = QuarterCar(MEGANE, PowerLawFrictionGas(values={"gas_preload": 178.0}))
    still = car.run(np.zeros(200), STEP)
    assert np.abs(motion(still)).max() == 0
    np.testing.assert_allclose(still["damper_force"], -178.0)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Dry(Toy):
    """F = 800 v + F_c sign v with a true jump, as no model of the package has it."""

    name: ClassVar[str] = "dry"
    title: ClassVar[str] = "Dry friction"
    source: ClassVar[str] = "tests"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("friction", "N", "F_c", 150.0, 0.0),)

    @property
    def linear(self) -> tuple[str, ...]:
        return self.names

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        return vector[0] * np.sign(velocity) + 800 * velocity

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        return np.sign(velocity)[:, None]


@pytest.mark.seconds
def test_dry_friction_holds_without_chatter():
    run = QuarterCar(MEGANE, Dry()).run(bump(1800, 0.03), STEP)
    stuck = run.after(1.5)
    held = stuck["damper_force"]
    assert np.abs(stuck["suspension_velocity"]).max() < 1e-8  # it sticks, off the middle by less than F_c/k_s
    assert 0 < abs(stuck["suspension_deflection"][-1]) < 150 / MEGANE.spring_stiffness
    assert np.abs(held).max() <= 150 * (1 + 1e-9)
    # both masses then swing as one on the undamped tyre, and friction gives just what keeps them together
    together = -(MEGANE.spring_stiffness * stuck["suspension_deflection"]
                 - 315 / 352.5 * stuck["tyre_force"])
    np.testing.assert_allclose(held, together, atol=0.02 * np.ptp(held) + 1e-3)


# -- every damper ------------------------------------------------------------------------------------------------------
@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", NAMES)
def test_every_damper_gives_its_own_response_inside_the_car(name: str):
    damper = truth(name)
    step = damper.clock or 5e-4
    n = 500
    t = step * np.arange(n)
    road = 0.01 * (1 - np.cos(2 * np.pi * 1.4 * t)) + 0.002 * np.sin(2 * np.pi * 9 * t) ** 3
    run = QuarterCar(MEGANE, damper, coil=Coil(0.01, 0.005)).run(road, step, np.repeat([0.3, 1.5, 0.8, 1.9], n // 4))
    drive = Drive(step, *(np.array(run[s]) for s in ("suspension_velocity", "suspension_deflection", "current")))
    force = damper.response(drive, damper.vector)
    np.testing.assert_allclose(run["damper_force"], force, atol=(2e-3 if name == "linear" else 3e-4) * np.ptp(force))
    assert identity_gap(run) < 1e-12
    balance = run.energy()
    assert abs(balance.gap) < 5e-3 * np.abs([balance.road, balance.damper, balance.stored]).max()


@pytest.mark.seconds
@pytest.mark.parametrize("name", ["bouc-wen", "wang-kamath"])
def test_steps_from_the_rates_alone_agree_with_the_compiled_ones(name: str):
    damper = truth(name)
    step = 2e-4
    ours, general = damper.stepper(step), StateStepper(damper, rates_move(damper, step))  # type: ignore[arg-type]
    t = step * np.arange(150)
    x, v = 0.004 * np.sin(20 * t), 0.08 * np.cos(20 * t)
    forces = []
    for stepper in (ours, general):
        described = [stepper.begin(x[0], v[0], 1.0)]
        for k in range(1, t.size):
            stepper.approach(1.0)
            described.append(stepper.trial(x[k], v[k]))
            stepper.commit(x[k], v[k])
        forces.append(np.array(described))
    np.testing.assert_allclose(forces[1], forces[0], atol=3e-3 * np.ptp(forces[0]))


@pytest.mark.seconds
def test_pieces_are_the_whole():
    for damper in (Guo(), truth("bouc-wen"), truth("lpv-arx")):
        step = damper.clock or 1e-3
        road, current = rough(61, step=step), np.linspace(0, 2, 61)
        car = QuarterCar(MEGANE, damper, coil=Coil(0.02, 0.01, highest=1.5))
        whole = car.run(road, step, current)
        stepper = car.start(step, road[0], current[0])
        pieces = [stepper.advance(road[k + 1:k + 11], current[k:k + 10]) for k in range(0, 60, 10)]
        joined = np.vstack([pieces[0].motion[:1], *(p.motion[1:] for p in pieces)])
        np.testing.assert_allclose(joined, motion(whole), rtol=0, atol=1e-14)
        assert whole["current"].max() <= 1.5


def test_coil_follows_in_closed_form():
    command = np.r_[np.zeros(10), np.full(50, 2.0), np.zeros(40)]
    run = QuarterCar(MEGANE, Guo(), coil=Coil(0.02, 0.005)).run(np.zeros(100), STEP, command)
    np.testing.assert_allclose(run["current"][10:61], 2 * (1 - np.exp(-np.arange(51) / 20)), atol=1e-12)
    np.testing.assert_allclose(run["current"][60:], run["current"][60] * np.exp(-np.arange(40) / 5), atol=1e-12)
    at_once = QuarterCar(MEGANE, Guo()).run(np.zeros(100), STEP, command)
    np.testing.assert_allclose(at_once["current"][1:], command[:-1])


def test_run_as_a_record_and_in_words():
    run = QuarterCar(MEGANE, Guo()).run(rough(800), STEP, 1.0)
    record = run.to_record()
    assert record.channel("body_acceleration").unit == "m/s^2" and record.sample_time == STEP
    np.testing.assert_allclose(Guo().simulate(record).output[:, 0], run["damper_force"], atol=1e-5)
    assert len(repr(run).splitlines()) == 4 and "N rms" in repr(run)
    assert run.after(0.5).n_samples == 300


# -- bad input ---------------------------------------------------------------------------------------------------------
def test_bad_input_in_one_line():
    car = QuarterCar(MEGANE)
    with pytest.raises(InputError, match="road must be finite"):
        car.run(np.array([0.0, np.nan]), STEP)
    with pytest.raises(InputError, match="two samples"):
        car.run(np.zeros(1), STEP)
    with pytest.raises(InputError, match="current must have shape"):
        car.run(np.zeros(5), STEP, np.zeros(4))
    with pytest.raises(InputError, match="sample_time must be positive"):
        car.run(np.zeros(5), 0.0)
    with pytest.raises(InputError, match="has not been fitted"):
        QuarterCar(MEGANE, LpvArx()).run(np.zeros(5), STEP)
    with pytest.raises(InputError, match="512 Hz"):
        QuarterCar(MEGANE, truth("narx-2")).run(np.zeros(5), STEP)
    with pytest.raises(InputError, match="a model of quartercar"):
        QuarterCar(MEGANE, "guo")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no signal"):
        car.run(np.zeros(5), STEP)["body_speed"]
    with pytest.raises(InputError, match="limits"):
        Coil(lowest=2.0, highest=1.0)
    with pytest.raises(InputError, match="rebound of a bump stop"):
        BumpStops(rebound=0.0)


def test_currents_beyond_the_fit_are_told():
    with pytest.warns(ExtrapolationWarning, match="outside the fitted 0 to 2"):
        QuarterCar(MEGANE, BoucWen(current_range=(0.0, 2.0))).run(np.zeros(20), STEP, 3.0)


def test_a_run_says_once_how_much_of_it_lies_beyond_the_fit():
    car = QuarterCar(MEGANE, BoucWen(current_range=(0.0, 2.0)))
    with pytest.warns(ExtrapolationWarning) as told:
        car.run(np.zeros(21), STEP, np.repeat([3.0, 1.0], [5, 16]))
    assert [str(w.message) for w in told] == ["bouc-wen: 25% of the commands lie outside the fitted 0 to 2 A"]
    assert told[0].filename == __file__
    with pytest.warns(ExtrapolationWarning) as told:
        stepper = car.start(STEP, 0.0, 1.0)
        for current in (1.0, 3.0, 3.0):
            stepper.advance(np.zeros(1), np.array([current]))
    assert len(told) == 1 and told[0].filename == __file__


def test_a_damper_that_gives_energy_ends_in_a_typed_outcome():
    pushing = Linear(values={"stiffness": -1e6, "damping": 0.0})
    with pytest.raises(NumericalError, match="left all bounds"):
        QuarterCar(MEGANE, pushing, lift_off=False).run(bump(9000), STEP)


def test_public_names():
    assert quartercar.QuarterCar is QuarterCar and quartercar.CarParameters is CarParameters
    assert quartercar.parameters.MEGANE is MEGANE and quartercar.criteria.judge is judge
    assert all(hasattr(quartercar, name) for name in quartercar.__all__)


def test_laws_and_sampled_models_are_all_there():
    assert set(LAWS) < set(NAMES) and len(set(NAMES)) == len(NAMES)
