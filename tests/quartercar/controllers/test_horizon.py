"""The prediction over a horizon against the ride, its gradient and its minimum against other ways to them.

The kernels take 20 s to compile: what runs them is marked ``seconds``.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import lsq_linear
from scipy.signal import bilinear, lfilter, tf2ss

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from quartercar import dampers
from quartercar.controllers.laws._horizon_kernels import back, predict
from quartercar.controllers.laws._horizon_search_kernels import improve_all, note_all
from quartercar.controllers.laws.horizon import CostWeights, Horizon, comfort_filter
from quartercar.controllers.laws.horizon_uncertainty import DEVIATIONS, Uncertainty, linearised
from quartercar.criteria import comfort_transition, comfort_weighting
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.adjoint import AdjointCar, has_gradient
from quartercar.vehicle.filter_bank import filter_of
from quartercar.vehicle.nonlinear import Coil, QuarterCar

RATE, N = 512.0, 60
GUO = dampers.Guo(degree=1, span=(0.0, 2.0), current_range=(0.0, 2.0))
CASES = {"lpv-arx": (identified_damper, Coil(highest=2.5)), "guo": (lambda: GUO, Coil(0.005, 0.01, highest=2.0))}


def horizon(name: str = "lpv-arx") -> Horizon:
    damper, coil = CASES[name]
    return Horizon.of(MEGANE, damper(), coil, 1 / RATE, N)


def weights(tyre: float = 0.3, stroke: float = 0.1, given: float = 0.5, cars: int = 1) -> CostWeights:
    return CostWeights(*(np.full(cars, w) for w in (tyre, stroke, given)))


class Prediction:
    """The kernels on one car from rest."""

    def __init__(self, model: Horizon, road: np.ndarray, given: CostWeights | None = None) -> None:
        n, nf = model.samples, len(model.shape) - 1
        rows, ends = model.weights(given or weights())
        hist = max(int(model.sizes.max()) - 1, 0)
        forces, inputs = model.history
        self.outs = (np.empty((n + 1, 4)), np.empty((n + 1 + hist, 4)), np.empty((n, 5)), np.empty((n + 1, 2)),
                     np.empty((n + 1, nf)), np.empty((n, 2)), np.empty((n, 2)))
        self.work = np.empty(model.table.shape[1] + 4 + nf)
        self.bars = np.empty(4), np.empty((n + 1 + hist, 4)), np.empty(nf), np.empty(model.table.shape[1])
        low = float(model.limits[0])
        self.start = (np.zeros(4), np.full(forces, model.settled_force(low)), np.zeros((inputs, 3)), np.zeros(nf),
                      np.full(2, low))
        self.model, self.road, self.rows, self.ends = model, road, rows[0], ends[0]
        self.unknown = np.zeros((n, len(model.table)))

    def cost(self, command: np.ndarray) -> float:
        m = self.model
        return predict(command, self.road, m.sample_time, m.car, m.table, m.grid, m.sizes, m.lag, m.shape, self.rows,
                       self.ends, self.unknown, m.limits, self.start, self.work, self.outs)

    def gradient(self, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        m, out, scale = self.model, np.empty(command.size), np.empty(command.size)
        self.cost(command)
        back(m.car, m.table, m.grid, m.sizes, m.shape, self.rows, self.ends, self.unknown, self.work, self.outs,
             self.bars, out, scale)
        return out, scale

    def best(self, rounds: int, first: np.ndarray | None = None) -> tuple[np.ndarray, float]:
        m, low = self.model, float(self.model.limits[0])
        plan = (np.full(m.samples, low) if first is None else first.copy())[None]
        cost = np.zeros(1)
        improve_all(plan, cost, self.road[None], np.array([1e6]), rounds, m.sample_time, m.car, m.table, m.grid,
                    m.sizes, m.lag, m.shape, self.rows[None], self.ends[None],
                    self.unknown[None], m.limits, *(a[None].copy() for a in self.start))
        return plan[0], float(cost[0])


def uneven(rng: np.random.Generator, size: float = 1e-3) -> np.ndarray:
    road = np.cumsum(rng.normal(0, size, N + 1))
    return road - road[0]


@pytest.mark.seconds
def test_the_prediction_is_the_ride(rng):
    """Memory, lag and limits of the identified damper included: the same as the car whose adjoint the bound has."""
    model, road, command = horizon(), uneven(rng), rng.uniform(-0.5, 3.0, N)
    car = QuarterCar(MEGANE, identified_damper(), coil=Coil(highest=2.5), lift_off=False)
    run = AdjointCar(car, road, 1 / RATE).run(np.append(command, 0.0))
    found = Prediction(model, road)
    found.cost(command)
    motion = found.outs[0]
    np.testing.assert_allclose(motion, run.motion, atol=2e-5 * np.abs(run.motion).max())
    np.testing.assert_allclose(found.outs[5][:, 1], run.tyre_force[1:], atol=1e-4 * np.abs(run.tyre_force).max())


@pytest.mark.seconds
def test_the_prediction_of_a_law_without_memory_is_the_ride_to_the_order_of_the_step(rng):
    model, road, command = horizon("guo"), uneven(rng), rng.uniform(0, 2.0, N)
    car = QuarterCar(MEGANE, GUO, coil=Coil(0.005, 0.01, highest=2.0), lift_off=False)
    run = car.run(road, 1 / RATE, np.append(command, 0.0))
    found = Prediction(model, road)
    found.cost(command)
    speed = run["suspension_velocity"]
    assert np.abs(found.outs[0][:, 1] - found.outs[0][:, 3] - speed).max() < 0.08 * np.abs(speed).max()


@pytest.mark.seconds
@pytest.mark.parametrize("name", list(CASES))
def test_the_gradient_is_that_of_the_cost(name: str, rng):
    model, road = horizon(name), uneven(rng, 3e-4)
    found, command = Prediction(model, road), rng.uniform(0.1, 0.9, N) * horizon(name).limits[1]
    found.unknown = 0.02 * np.cumsum(rng.normal(0, 1, found.unknown.shape), axis=1)
    gradient, scale = found.gradient(command)
    size = np.abs(gradient).max()
    for k in (0, 1, 7, 30, N - 1):
        step = np.zeros(N)
        step[k] = 1e-4
        difference = (found.cost(command + step) - found.cost(command - step)) / 2e-4
        assert gradient[k] == pytest.approx(difference, abs=2e-3 * size)
    assert np.all(scale >= 0) and scale.max() > 0


def proportional(lag: tuple[float, float] = (0.0, 0.0)) -> Horizon:
    """A damper whose force is 400 N per ampere, whatever the motion: the problem is then a convex quadratic program."""
    coil = Coil(*lag, highest=2.5)
    model = Horizon.of(MEGANE, GUO, replace(coil, highest=2.5), 1 / RATE, N)
    table = np.zeros_like(model.table)
    table[:, 0] = 400.0 * np.linspace(0, 2.5, len(table))
    table[:, 7] = 1.0
    return replace(model, table=table)


def least_squares(model: Horizon, road: np.ndarray, tyre: float, stroke: float, tail: int = 8000) -> tuple:
    """(A, b) of ‖A u − b‖², by simulation of its own: force linear between samples, the filter by `lfilter`."""
    ms, mu, k, kt = (getattr(MEGANE, n) for n in ("sprung_mass", "unsprung_mass", "spring_stiffness", "tyre_stiffness"))
    a = np.array([[0, 1, 0, 0], [-k / ms, 0, k / ms, 0], [0, 0, 0, 1], [k / mu, 0, -(k + kt) / mu, 0]])
    block = np.zeros((8, 8))  # states, (force, road), their slopes
    block[:4, :4], block[:4, 4:6] = a, np.array([[0, 0], [-1 / ms, 0], [0, 0], [1 / mu, kt / mu]])
    block[4, 6] = block[5, 7] = 1.0
    step = expm(block / RATE)[:4]
    c = model.damping
    soft = expm((a + np.outer([0, -c / ms, 0, c / mu], [0, 1, 0, -1])) / RATE)
    top, bottom = bilinear(*comfort_transition(), fs=RATE)

    def outputs(u: np.ndarray, z: np.ndarray) -> np.ndarray:
        force, x, rows = np.append(0.0, 400.0 * u), np.zeros(4), []
        for j in range(N):
            x = step @ np.concatenate([x, [force[j], z[j], RATE * (force[j + 1] - force[j]), RATE * (z[j + 1] - z[j])]])
            rows.append([-(k * (x[0] - x[2]) + force[j + 1]) / ms, kt * (x[2] - z[j + 1]), x[0] - x[2]])
        x = x - z[N] * np.array([1.0, 0, 1, 0])
        for _ in range(tail):
            x = soft @ x
            rows.append([-(k * (x[0] - x[2]) + c * (x[1] - x[3])) / ms, kt * x[2], x[0] - x[2]])
        acceleration, load, deflection = np.array(rows).T
        return np.concatenate([lfilter(top, bottom, acceleration), np.sqrt(tyre) / ms * load,
                               np.sqrt(stroke) * k / ms * deflection])

    still = outputs(np.zeros(N), road)
    matrix = np.column_stack([outputs(e, np.zeros(N + 1)) for e in np.eye(N)])
    return matrix, -still


def viscous() -> Horizon:
    """A dashpot of 1000 N·s/m without current and 400 more per ampere, whatever the velocity."""
    model = proportional()
    return replace(model, damping=1000.0, dampings=np.tile(1000.0 + 400.0 * np.linspace(0, 2.5, 65), (25, 1)))


def tail_cost(start: np.ndarray, first: float, given: CostWeights, tail: int = 6000) -> float:
    """Cost of a car from a deviation on, level road, one sample of a dashpot and then 1000 N·s/m; `lfilter` for W_k."""
    ms, mu, k, kt = (getattr(MEGANE, n) for n in ("sprung_mass", "unsprung_mass", "spring_stiffness", "tyre_stiffness"))
    rows, x = [], np.array([start[0] + start[2], start[1], start[2], start[3]])  # z_s, ż_s, z_us, ż_us
    for j in range(tail):
        c = first if j == 0 else 1000.0
        if j < 2:
            force = np.array([k, c, -k, -c])
            step = expm(np.array([[0, 1, 0, 0], -force / ms, [0, 0, 0, 1], force / mu - [0, 0, kt / mu, 0]]) / RATE)
        x = step @ x
        rows.append([-(k * (x[0] - x[2]) + c * (x[1] - x[3])) / ms, kt * x[2], x[0] - x[2]])
    acceleration, load, deflection = np.array(rows).T
    heavy = lfilter(*bilinear(*comfort_transition(), fs=RATE), acceleration)
    return float(heavy @ heavy + given.tyre[0] * (load @ load) / ms**2 + given.stroke[0] * (deflection @ deflection)
                 * (k / ms) ** 2)


@pytest.mark.seconds
def test_what_is_not_known_costs_what_its_deviations_cost():
    """E(0, i) is the mean over the error of the estimates, here by the columns of a root of its covariance."""
    model, given = viscous(), weights(given=0.0)
    root = np.diag([1e-3, 0.02, 5e-4, 0.05]) @ np.array([[1, 0, 0, 0], [0.3, 1, 0, 0], [0, 0.5, 1, 0], [0.2, 0, 0, 1]])
    found = model.uncertain(model.weights(given), Uncertainty(root @ root.T, np.zeros(N)))[0, 0]
    for place in (0, 20, 64):
        wanted = sum(tail_cost(column, 1000.0 + 400.0 * 2.5 * place / 64, given) for column in root.T)
        assert found[place] == pytest.approx(wanted, rel=1e-3)


def test_the_road_beyond_the_preview_is_what_spreads():
    """From exact states on nothing deviates within the preview; then the deviation grows to that of a long ride."""
    model, level = horizon(), 2e-4
    rows = model.weights(weights())
    road = np.full(N, level)
    road[:20] = 0.0
    found = model.uncertain(rows, Uncertainty(np.zeros((4, 4)), road))[0]
    assert np.all(found[:21] == 0) and np.all(np.diff(found[21:, 0]) > 0)


def test_a_knee_is_linearised_over_the_deviation():
    """100 N of yield with 900 N·s/m: 900 + 100 √(2/π)/σ."""
    found = linearised(lambda v: 900.0 * v + 100.0 * np.tanh(v / 1e-4))
    np.testing.assert_allclose(found, 900.0 + 100.0 * np.sqrt(2 / np.pi) / DEVIATIONS, rtol=0.03)


@pytest.mark.slow
def test_the_quadratic_program_of_a_frozen_case_is_solved(rng):
    """Against bounded least squares on an independent simulation, the terminal cost as its tail in full."""
    model, road = proportional(), uneven(rng)
    found = Prediction(model, road, weights(given=0.0))
    matrix, wanted = least_squares(model, road, 0.3, 0.1)
    command = rng.uniform(0, 2.5, N)
    assert found.cost(command) == pytest.approx(np.sum((matrix @ command - wanted) ** 2), rel=1e-5)
    oracle = lsq_linear(matrix, wanted, (0.0, 2.5), tol=1e-12)
    assert 5 < np.sum((oracle.x > 1e-6) & (oracle.x < 2.5 - 1e-6)) < N - 5  # some commands at a limit, some not
    plan, cost = found.best(2000)
    assert cost == pytest.approx(2 * oracle.cost, rel=1e-5)
    np.testing.assert_allclose(plan, oracle.x, atol=0.02)
    _, early = found.best(15)
    assert early < 1.01 * cost


@pytest.mark.slow
def test_and_a_solver_of_quadratic_programs_finds_the_same(rng):
    osqp = pytest.importorskip("osqp")
    from scipy.sparse import csc_matrix

    model, road = proportional(), uneven(rng)
    matrix, wanted = least_squares(model, road, 0.3, 0.1)
    solver = osqp.OSQP()
    solver.setup(csc_matrix(np.triu(2 * matrix.T @ matrix)), -2 * matrix.T @ wanted, csc_matrix(np.eye(N)), np.zeros(N),
                 np.full(N, 2.5), verbose=False, eps_abs=1e-8, eps_rel=1e-8, max_iter=100_000)
    plan, _ = Prediction(model, road, weights(given=0.0)).best(2000)
    np.testing.assert_allclose(plan, solver.solve(raise_error=True).x, atol=0.02)


@pytest.mark.seconds
def test_more_iterations_are_never_worse_and_few_are_nearly_enough(rng):
    found = Prediction(horizon(), uneven(rng))
    costs = [found.best(rounds)[1] for rounds in (1, 4, 16, 64, 256)]
    assert all(later <= before * (1 + 1e-6) for before, later in pairwise(costs))
    plan, cost = found.best(256)
    gradient, _ = found.gradient(plan)
    inside = (plan > 1e-3) & (plan < 2.5 - 1e-3)
    assert cost < costs[0] and np.all(gradient[plan <= 1e-9] > -1e-2 * np.abs(gradient).max())
    assert np.abs(gradient[inside]).max(initial=0.0) < 0.05 * np.abs(found.gradient(np.zeros(N))[0]).max()


@pytest.mark.seconds
def test_a_stiff_start_is_left_for_the_lowest_current(rng):
    """A damper at its highest current hardly moves: from such a plan a ride on a bump went on for two seconds."""
    found = Prediction(horizon(), uneven(rng, 2e-4))
    passive, stiff = found.cost(np.zeros(N)), np.full(N, 2.5)
    assert found.cost(stiff) > 1.5 * passive
    assert found.best(1, stiff)[1] <= passive * (1 + 1e-9)


def test_the_filter_is_that_of_comfort_between_its_band_limits():
    f = np.geomspace(1.0, 30.0, 40)
    m, z = comfort_filter(1 / RATE), np.exp(2j * np.pi * f / RATE)
    gain = [abs(m[4, :4] @ np.linalg.solve(x * np.eye(4) - m[:4, :4], m[:4, 4]) + m[4, 4]) for x in z]
    np.testing.assert_allclose(gain, np.abs(comfort_weighting(f)), atol=0.01)
    a, b, c, d = tf2ss(*bilinear(*comfort_transition(), fs=RATE))
    other = [abs(c @ np.linalg.solve(x * np.eye(4) - a, b) + d).item() for x in z]
    np.testing.assert_allclose(gain, other, rtol=1e-6)


def state_space() -> dampers.Identified:
    """A damper whose ride is stepped together with others, but whose gradient is not built."""
    box, still = Scheduling(("current",), (0.0,), (2.0,), units=("A",)), np.zeros((1, 1))
    a, one, direct = (np.array([np.full((1, 1), x), still]) for x in (0.5, 1.0, 500.0))
    model = LPVStateSpace(a, one, one, direct, Polynomial(("current",), degree=1), 1 / RATE, box,
                          inputs=(Signal("velocity", "m/s"),), outputs=(Signal("force", "N"),))
    return dampers.Identified.of(model)


def test_a_state_space_has_no_gradient():
    assert filter_of(state_space()) is not None and not has_gradient(state_space())
    with pytest.raises(InputError, match="no bound"):
        AdjointCar(QuarterCar(MEGANE, state_space(), coil=Coil(highest=2.0)), np.zeros(5), 1 / RATE)


@pytest.mark.parametrize(("changes", "message"), [
    ({"damper": dampers.BoucWen()}, "gradient"), ({"damper": state_space()}, "gradient"), ({"coil": Coil()}, "limits"),
    ({"damper": None}, "no damper model")])
def test_what_has_no_horizon(changes, message: str):
    given = {"damper": GUO, "coil": Coil(highest=2.0), **changes}
    with pytest.raises(InputError, match=message):
        Horizon.of(MEGANE, given["damper"], given["coil"], 1 / RATE, N)


@pytest.mark.seconds
def test_the_damper_remembers_the_newest_samples_first() -> None:
    rng, table = np.random.default_rng(0), np.zeros((2, 8 + 2 + 9))
    table[:, 7] = 1.0
    table[:, 1] = 100.0  # F = 100 v
    forces, inputs, filtered = np.zeros((1, 2)), np.zeros((1, 3, 3)), np.zeros((1, 1))
    motion = rng.normal(size=(4, 2))
    for z, v in motion:
        note_all(np.array([z]), np.array([v]), np.zeros(1), np.ones((4, 10)), table, np.array([0.0, 1.0]),
                 np.array([2, 3]), np.zeros((2, 2)), forces, inputs, filtered)
    np.testing.assert_array_equal(inputs[0, :, 0], motion[:0:-1, 1])
    np.testing.assert_array_equal(inputs[0, :, 1], motion[:0:-1, 0])
    np.testing.assert_allclose(forces[0], 100.0 * motion[:1:-1, 1], rtol=1e-14)
