"""AdjointCar: a quarter car on a known road as a function of its current, with the exact gradient of that function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.contract import Damper
from quartercar.vehicle.batch import lag_coil
from quartercar.vehicle.filter_bank import INPUTS, FilterBank, filter_of
from quartercar.vehicle.integrator import IntegratorStages
from quartercar.vehicle.nonlinear import QuarterCar
from quartercar.vehicle.result import CarRun
from quartercar.vehicle.stepper import States
from quartercar.vehicle.tanh_coefficients import Form, tanh_form

STEP = 1e-6
"""of the central difference by the current, as a share of its range: ε^⅓ of double precision, rounded"""


def has_gradient(damper: Damper | None) -> bool:
    """Whether an `AdjointCar` can carry this damper: a law of `tanh_form`, or a transfer function of `filter_of`.

    Parameters
    ----------
    damper : Damper or None
        None for a viscous car.

    Returns
    -------
    bool
        False for None.
    """
    return damper is not None and (tanh_form(damper) is not None or isinstance(filter_of(damper), LPVTransferFunction))


def refuse_without_gradient(damper: Damper | None) -> None:
    """Refuse a damper that an `AdjointCar` cannot carry.

    Parameters
    ----------
    damper : Damper or None
        None is refused.

    Raises
    ------
    InputError
        A damper without gradient, with the kinds that have one.
    """
    if not has_gradient(damper):
        raise InputError("no bound is available for this damper", got="none" if damper is None else damper.name,
                         why="the gradient of its ride by the current is not built",
                         mend="an identified transfer function (lpv-arx) or a law of one tanh (guo, kwok)")


@dataclass(frozen=True, eq=False)
class Coefficients:
    """Damper at N steps of S stages: law (N, S, 8) as `law` reads it; past forces (N, na), past inputs (N, nb, 3).

    Attributes
    ----------
    law : (N, S, 8) array
        a_0 … a_7 of `tanh_coefficients.Form` at each step and stage, the force at rest taken off; of a gradient (N, S,
        7), without the scale a_7.
    a : (N, na) array
        Of the past forces, latest first; their sign is that of an autoregression.
    b : (N, nb, 3) array
        Of the past velocities, displacements and tanh of the velocity, latest first.
    """

    law: np.ndarray
    a: np.ndarray
    b: np.ndarray


class _Law:
    """Coefficients of a law without memory."""

    def __init__(self, form: Form, rest: float, span: float) -> None:
        self._form, self._rest, self._step = form, rest, STEP * span
        self.first = rest

    def at(self, p: np.ndarray) -> Coefficients:
        law = self._form(p.ravel()).reshape(*p.shape, 8)
        law[..., 0] -= self._rest
        return Coefficients(law, np.zeros((len(p), 0)), np.zeros((len(p), 0, 3)))

    def back(self, p: np.ndarray, bars: Coefficients) -> np.ndarray:
        """(N, S) gradient by the current."""
        ahead, behind = (self._form(p.ravel() + s * self._step).reshape(*p.shape, 8) for s in (1, -1))
        return np.einsum("nsj,nsj->ns", bars.law, (ahead - behind)[..., :7]) / (2 * self._step)


class _Filter:
    """Coefficients of a transfer function, which stand in one stage per step."""

    def __init__(self, model: Any, rest: float, first: float) -> None:
        bank = FilterBank(model, 1)
        bank.begin(np.array([first]))
        self._model, self._rest, self.first = model, rest, float(bank.force[0])
        names = [s.name for s in model.inputs]
        places = [INPUTS.index(n) for n in names] + ([2] if model.input_stage is not None else [])
        b = np.zeros((model.b.shape[0], 3, model.basis.size))
        b[:, places] = model.b[:, 0]
        c = np.zeros(model.basis.size) if model.c is None or not model.n_affine else model.c[0, 0]
        self._direct, self._past, self._a, self._c = b[0], b[1:], model.a[:, 0, 0], c
        stage = model.input_stage
        self._shape = None if stage is None else (stage.v0, stage.slope if model.box.names else 0.0)

    def _basis(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, m) of the basis functions and their slopes."""
        column = p[:, :1] if self._model.box.names else np.zeros((len(p), 0))
        values = self._model.basis.evaluate(column)
        slopes = self._model.basis.derivative(column, "current") if self._model.box.names else np.zeros_like(values)
        return values, slopes

    def _sharpness(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N,) 1/v0 and its slope by the current."""
        if self._shape is None:
            return np.zeros(len(p)), np.zeros(len(p))
        v0, slope = self._shape
        width = v0 + slope * p[:, 0]
        free = width > 0.05 * v0
        sharp = 1 / np.where(free, width, 0.05 * v0)
        return sharp, np.where(free, -slope * sharp**2, 0.0)

    def at(self, p: np.ndarray) -> Coefficients:
        phi, _ = self._basis(p)
        law = np.zeros((len(p), 1, 8))
        law[:, 0, 0] = phi @ self._c - self._rest
        law[:, 0, [1, 2, 3]] = phi @ self._direct.T
        law[:, 0, 4], law[:, 0, 7] = self._sharpness(p)[0], 1.0
        past = np.ascontiguousarray(np.einsum("nm,jim->nji", phi, self._past))  # one order of memory, one compilation
        return Coefficients(law, phi @ self._a.T, past)

    def back(self, p: np.ndarray, bars: Coefficients) -> np.ndarray:
        """(N, 1) gradient by the current."""
        _, slope = self._basis(p)
        by_phi = bars.a @ self._a + np.einsum("nji,jim->nm", bars.b, self._past) + bars.law[:, 0, 1:4] @ self._direct
        by_phi = by_phi + bars.law[:, 0, :1] * self._c
        return (np.sum(by_phi * slope, axis=1) + bars.law[:, 0, 4] * self._sharpness(p)[1])[:, None]


def coefficients_at(damper: Damper, currents: np.ndarray, rest: float) -> Coefficients:
    """Coefficients of one stage at each of (N,) lagged currents, past forces counted from zero.

    Parameters
    ----------
    damper : Damper
        A law of one tanh, or with an identified transfer function inside.
    currents : (N,) array
        Behind the coil's lag and the damper's own, in the damper's unit.
    rest : float
        Force at rest that is taken off [N].

    Returns
    -------
    Coefficients
        Of N steps with one stage each.

    Raises
    ------
    InputError
        A damper without gradient.
    """
    refuse_without_gradient(damper)
    form = tanh_form(damper)
    inner = _Filter(filter_of(damper), rest, float(currents[0])) if form is None else _Law(form, rest, 1.0)
    return inner.at(currents[:, None])


@dataclass(frozen=True, eq=False)
class GradientRun:
    """A run and what its gradient needs.

    Attributes
    ----------
    acceleration, tyre_force, deflection, speed, force : (n,) arrays
        Body acceleration [m/s²], F_t [N], z_d [m], ż_d [m/s], damper force less what displacement alone gives [N].
    motion : (n, 4) array
        As in `stepper.States`.
    state : tuple of arrays
        Inner.
    """

    acceleration: np.ndarray
    tyre_force: np.ndarray
    deflection: np.ndarray
    speed: np.ndarray
    force: np.ndarray
    motion: np.ndarray
    state: tuple[Any, ...]


class AdjointCar:
    """A car on a known road from rest under its lowest current, as `rides.simulation.drive` starts it.

    The same stages as `fleet` takes, solved to rounding, and their discrete adjoint: the gradient is that of the
    computed run, not of the differential equation. Where a kink is met exactly (a stop or the road just touched, a coil
    that just turns) it is one of the one-sided ones.

    Parameters
    ----------
    car : QuarterCar
        With a coil whose limits are finite.
    road : (n,) array
        Elevation at the samples of the loop [m].
    sample_time : float
        [s].

    Raises
    ------
    InputError
        A damper without gradient.

    Examples
    --------
    >>> from quartercar.vehicle.nonlinear import Coil
    >>> from quartercar.rides.default_damper import identified_damper
    >>> from quartercar.parameters import MEGANE
    >>> car = AdjointCar(QuarterCar(MEGANE, identified_damper(), coil=Coil(highest=2.5)), np.zeros(5), 1 / 512)
    >>> car.run(np.zeros(5)).acceleration.shape
    (5,)
    """

    def __init__(self, car: QuarterCar, road: np.ndarray, sample_time: float) -> None:
        refuse_without_gradient(car.damper)
        self.car, self.sample_time, self.road = car, sample_time, np.array(road, dtype=float)
        coil, damper = car.coil, car.damper
        self._rest = car.preload
        assert damper is not None
        model = filter_of(damper)
        form = tanh_form(damper)
        step = car.start(sample_time, 0.0, coil.lowest).step  # which checks the rate
        parts = round(sample_time / step)
        self._step, self._parts, self._first = step, parts, coil.lowest
        if form is not None:
            self._stages = IntegratorStages.held(car.linear_part, step)
            self._damper: _Law | _Filter = _Law(form, car.preload, coil.highest - coil.lowest)
            lag = (0.0, 0.0)
        else:
            self._stages = IntegratorStages.ramp(car.linear_part, step)
            self._damper = _Filter(model, car.preload, coil.lowest)
            lag = (lag_coil(model).fall_time, lag_coil(model).rise_time)
        times = step * (np.arange(parts)[:, None] + self._stages.ends[None]).ravel()
        self._coil = np.array([_left(times, tau) for tau in (coil.fall_time, coil.rise_time)])
        self._lag = np.array([_left(step, tau) for tau in lag])
        self._stop, self._tyre = car.limits
        n = self.road.size
        self._profile = np.interp(np.arange((n - 1) * parts + 1) / parts, np.arange(n), self.road)
        self._rate = np.concatenate([[0.0], np.diff(self.road) / sample_time])
        ends = np.asarray(damper.conservative_force(np.array([0.0, 1.0])), dtype=float)
        self._affine = None if form is not None else (float(ends[0]), float(ends[1] - ends[0]))

    def run(self, command: np.ndarray) -> GradientRun:
        """Drive under (n,) commands, each held until the next sample; the last one acts on nothing.

        Parameters
        ----------
        command : (n,) array
            In the damper's unit; clipped to the coil's limits.

        Returns
        -------
        GradientRun
            At the samples of the loop.

        Raises
        ------
        NumericalError
            A car that leaves all bounds.
        """
        from quartercar.vehicle._adjoint_kernels import currents

        command = np.clip(np.asarray(command, dtype=float), self.car.coil.lowest, self.car.coil.highest)[:-1]
        points = self._coil.shape[1]
        in_coil, lagged = np.empty((command.size, points)), np.empty((command.size, points))
        currents(command, self._first, self._coil, self._lag, in_coil, lagged)
        p = lagged.reshape(-1, self._stages.ends.size)
        return self.driven(self._damper.at(p), (command, in_coil, lagged, p))

    @property
    def shape(self) -> tuple[int, int]:
        """(N, S): steps, and stages of each."""
        return self._profile.size - 1, self._stages.ends.size

    def driven(self, c: Coefficients, currents: tuple[Any, ...] = ()) -> GradientRun:
        """Drive with given coefficients of the damper, instead of those that a command gives.

        Parameters
        ----------
        c : Coefficients
            Of as many steps and stages as `shape` has.
        currents : tuple of arrays
            What `run` keeps of the currents, for `gradient` and `car_run`; empty where `gradient_by_coefficients` alone
            is used.

        Returns
        -------
        GradientRun
            At the samples of the loop.

        Raises
        ------
        NumericalError
            A car that leaves all bounds.
        """
        from quartercar.vehicle._adjoint_kernels import forward

        stages, (count, size) = self._stages, self.shape
        count += 1
        motion, past = np.empty((count, 4)), np.empty((count, 4))
        pairs, places = np.empty((count, size, 2)), np.empty((count, size, 2))
        forward(stages.ends, stages.state, stages.road, stages.force, self._profile, self._step, c.law, c.a, c.b,
                self._rest, self._damper.first, self._stop, self._tyre, motion, pairs, places, past)
        if not np.all(np.abs(motion[-1]) < 1e4):
            raise NumericalError("the car left all bounds; a damper that gives energy, or a step that is too long")
        at = slice(0, None, self._parts)
        return self._signals(motion[at], pairs[at, -1], (currents, c, pairs, places, past))

    def car_run(self, run: GradientRun, command: np.ndarray) -> CarRun:
        """Every signal of a trajectory under the (n,) commands that gave it.

        Parameters
        ----------
        run : GradientRun
            As `run` returned it.
        command : (n,) array
            The commands of that run, in the damper's unit.

        Returns
        -------
        CarRun
            At the samples of the loop.
        """
        (_, in_coil, *_), _, pairs, _, _ = run.state
        pair = pairs[::self._parts, -1]
        current = np.concatenate([[self._first], in_coil[:, -1]])
        return CarRun.of(self.car, self.sample_time, self.road.copy(), np.array(command, dtype=float),
                         States(run.motion, pair[:, 0], pair[:, 1], current))

    def _signals(self, motion: np.ndarray, pair: np.ndarray, state: tuple[Any, ...]) -> GradientRun:
        """What is measured at the samples, from the states and (f, g) there."""
        part, (kt, ct, _) = self.car.linear_part, self._tyre
        zs, vs, zu, vu = motion.T
        z, v = zs - zu, vs - vu
        tyre = kt * (zu - self.road) + ct * (vu - self._rate) + pair[:, 1]
        strut = part.stiffness * z + part.damping * v + pair[:, 0]
        body = part.inverse_mass[0] @ np.vstack([-strut, strut - tyre])
        free = pair[:, 0] - self._bump(z)[0] - (self._spring(z) - self._rest)
        return GradientRun(body, tyre, z, v, free, motion, state)

    def _spring(self, z: np.ndarray) -> np.ndarray:
        """(n,) force of the displacement alone; that of a transfer function is affine."""
        if self._affine is not None:
            return self._affine[0] + self._affine[1] * z
        assert self.car.damper is not None
        return np.asarray(self.car.damper.conservative_force(z), dtype=float)

    def _bump(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) force of the stops and its slope."""
        k, compression, rebound = self._stop
        if k == 0:
            return np.zeros_like(z), np.zeros_like(z)
        return (k * (np.maximum(z - rebound, 0) - np.maximum(-z - compression, 0)),
                k * ((z > rebound) | (z < -compression)).astype(float))

    def gradient(self, at: GradientRun, acceleration: np.ndarray, tyre_force: np.ndarray, deflection: np.ndarray,
                 speed: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n,) gradient by the command of a scalar, from its gradients by the (n,) signals of a trajectory.

        Parameters
        ----------
        at : GradientRun
            As `run` returned it.
        acceleration, tyre_force, deflection, speed, force : (n,) arrays
            Gradients by the signals of these names in `at`, per SI unit of each.

        Returns
        -------
        (n,) array
            Per unit of current; zero at the last sample, whose command acts on nothing. A command beyond a limit of the
            coil has the gradient of the one at the limit.
        """
        from quartercar.vehicle._adjoint_kernels import currents_back

        command, in_coil, lagged, p = at.state[0]
        bars = self.gradient_by_coefficients(at, acceleration, tyre_force, deflection, speed, force)
        by_p = self._damper.back(p, bars).reshape(lagged.shape)
        found = np.zeros(command.size + 1)
        currents_back(command, self._first, self._coil, self._lag, in_coil, lagged, by_p, found[:-1])
        return found

    def gradient_by_coefficients(self, at: GradientRun, acceleration: np.ndarray, tyre_force: np.ndarray,
                                 deflection: np.ndarray, speed: np.ndarray, force: np.ndarray) -> Coefficients:
        """The same by the damper's coefficients; of the law (N, S, 7), its scale a_7 left out.

        Parameters
        ----------
        at : GradientRun
            As `run` or `driven` returned it.
        acceleration, tyre_force, deflection, speed, force : (n,) arrays
            Gradients by the signals of these names in `at`, per SI unit of each.

        Returns
        -------
        Coefficients
            Gradients in place of the coefficients.
        """
        from quartercar.vehicle._adjoint_kernels import backward

        _, c, pairs, places, past = at.state
        motion_bar, pair_bar = self._signals_back(at, acceleration, tyre_force, deflection, speed, force, len(past))
        bars = Coefficients(np.empty((*c.law.shape[:2], 7)), np.empty_like(c.a), np.empty_like(c.b))
        stages = self._stages
        backward(stages.ends, stages.state, stages.force, c.law, c.a, c.b, self._stop, self._tyre, pairs, places, past,
                 motion_bar, pair_bar, bars.law, bars.a, bars.b)
        return bars

    def _signals_back(self, at: GradientRun, a: np.ndarray, t: np.ndarray, z: np.ndarray, v: np.ndarray,
                      force: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Gradients by states and (f, g) at all steps."""
        part, (kt, ct, _) = self.car.linear_part, self._tyre
        inverse = part.inverse_mass[0]
        strut = a * (inverse[1] - inverse[0])
        tyre = t - inverse[1] * a
        size = 1e-7  # [m] of the difference, far below the strokes over which a law turns
        spring = (self._spring(at.deflection + size) - self._spring(at.deflection - size)) / (2 * size)
        by_z = z + part.stiffness * strut - force * (self._bump(at.deflection)[1] + spring)
        by_v = v + part.damping * strut
        motion, pair = np.zeros((count, 4)), np.zeros((count, 2))
        rows = slice(0, None, self._parts)
        motion[rows] = np.column_stack([by_z, by_v, kt * tyre - by_z, ct * tyre - by_v])
        pair[rows] = np.column_stack([strut + force, tyre])
        return motion, pair


def _left(times: Any, tau: float) -> Any:
    """exp(−t/τ), none for τ = 0."""
    return np.exp(-np.asarray(times) / tau) if tau > 0 else np.zeros(np.shape(times))
