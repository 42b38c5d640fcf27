"""Dampers with known difference equations, and the run of a car with one, written down anew."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from lpvid.identification.layout import ParameterLayout
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Scheduling
from quartercar.dampers import LpvArx
from quartercar.dampers.blackbox.held import Held
from quartercar.parameters import MEGANE
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import QuarterCar

STEP = 1 / 512
ONE = ParameterLayout(np.zeros((1, 5), dtype=int))


def damper(order: int = 2, slope: float = 0.0, affine: float = 0.0, lag: bool = True, **changes) -> LpvArx:
    """A known damper of order 1 or 2: a lag on c(i) v + f(i) tanh(v/v_0), unity gain at rest of its pole part."""
    p = Polynomial("current", 1)
    if order == 1:
        a = [[-0.4, -0.05]]
        b = [[[300.0, 60.0], [20.0, 180.0]], [[220.0, 30.0], [30.0, 160.0]]]
    else:
        a = [[-0.7, -0.04], [0.15, 0.02]]
        b = [[[240.0, 40.0], [15.0, 120.0]], [[160.0, 30.0], [15.0, 100.0]], [[60.0, 10.0], [5.0, 40.0]]]
    box = Scheduling(("current",), (0.0,), (2.5,), units=("A",))
    model = LPVTransferFunction(
        np.array(a)[:, None, None, :], np.array(b)[:, None], p, STEP, box, np.array([[[-60.0, affine]]]),
        inputs=(Signal("velocity", "m/s"),), outputs=(Signal("force", "N"),), input_stage=TanhStage(0.04, slope),
        scheduling_stage=SchedulingLag(0.006, 0.01) if lag else None, **changes)
    return LpvArx(order=order, stored=Held(model, ONE).to_dict())


def road_and_current(n: int = 800, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    road = np.convolve(np.cumsum(rng.standard_normal(n)) * 6e-4, np.hanning(21) / np.hanning(21).sum(), "same")
    return road - road[0], np.repeat(rng.uniform(0, 2.5, n // 40 + 1), 40)[:n]


class Recorded(dict):
    """What `along` reads of a run."""

    sample_time = STEP
    car = None


def held_force_run(law: LpvArx, road: np.ndarray, current: np.ndarray) -> Recorded:
    """The difference equation of the damper and the car for held force and road slope, written down anew."""
    model = law.at_clock(STEP)
    car = LinearCar(MEGANE.replace(damping=0.0)).relative()
    block = np.zeros((6, 6))
    block[:4, :4], block[:4, 4:] = car.A, car.B
    e = expm(block * STEP)
    q = current if model.scheduling_stage is None else model.scheduling_stage.apply(current[:, None], STEP)[:, 0]
    a, b, c = (np.array([model.coefficients([i])[k] for i in q]) for k in range(3))
    rest = c[0].sum() / (1 + a[0].sum())
    preload = float(np.atleast_1d(law.conservative_force(np.zeros(1)))[0])
    x, states, force, shaped = np.zeros(4), [], [rest] * model.na, [np.zeros(2)] * model.na
    for k in range(len(road)):
        v = x[1] - x[3]
        shaped.append(model.input_stage.apply(np.array([[v]]), q[k: k + 1, None])[0])
        y = float(c[k].sum() - sum(a[k][j, 0, 0] * force[-1 - j] for j in range(model.na))
                  + sum(b[k][j, 0] @ shaped[-1 - j] for j in range(model.n_lags)))
        force.append(y)
        states.append(x)
        slope = (road[k + 1] - road[k]) / STEP if k + 1 < len(road) else 0.0
        x = e[:4, :4] @ x + e[:4, 4] * slope + e[:4, 5] * (y - preload)
    x = np.array(states)
    run = Recorded(suspension_deflection=x[:, 0], body_velocity=x[:, 1], tyre_deflection=x[:, 2],
                   wheel_velocity=x[:, 3], suspension_velocity=x[:, 1] - x[:, 3], road=road, current=current,
                   damper_force=np.array(force[model.na:]))
    run.car = QuarterCar(MEGANE, law)
    return run
