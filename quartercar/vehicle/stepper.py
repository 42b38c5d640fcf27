"""CarStepper: a running quarter car, advanced piece by piece."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from quartercar.dampers.contract import ExtrapolationWarning
from quartercar.vehicle.integrator import IntegratorStages
from quartercar.vehicle.tanh_coefficients import tanh_form

if TYPE_CHECKING:
    from quartercar.vehicle.assembly import CarAssembly

CLOSE = 1e-8
"""relative and absolute [N] error of a force at which a stage of a damper that is not compiled ends"""
ITERATIONS = 100


@dataclass(frozen=True, eq=False)
class States:
    """The car at samples.

    Attributes
    ----------
    motion : (n, 4) array
        z_s, ż_s, z_us, ż_us.
    strut, tyre : (n,) arrays
        Force of damper and stops beside the linear part, without preload; what the tyre lacks of its linear law [N].
    current : (n,) array
        In the coil.
    """

    motion: np.ndarray
    strut: np.ndarray
    tyre: np.ndarray
    current: np.ndarray


class CarStepper:
    """A car and its damper between two samples of the road.

    Parameters
    ----------
    car : CarAssembly
    sample_time : float
        Between two samples of the road [s].
    road, current : float
        Elevation and command on which everything has settled.

    Examples
    --------
    >>> from quartercar.vehicle.nonlinear import QuarterCar
    >>> from quartercar.parameters import MEGANE
    >>> stepper = QuarterCar(MEGANE).start(1e-3)
    >>> stepper.advance(np.full(5, 1e-3), np.zeros(5)).motion.shape
    (6, 4)
    """

    def __init__(self, car: CarAssembly, sample_time: float, road: float, current: float) -> None:
        self.car, self.sample_time = car, sample_time
        damper = car.damper
        self._plain = car.damper_is_linear
        self._form = None if self._plain else tanh_form(damper)
        self._warned_outside = False
        clock = None if damper is None else damper.clock
        self._parts = self._divided(clock)
        self.step = sample_time / self._parts
        self._stop, self._tyre = car.limits
        self._x = np.array([road, 0.0, road, 0.0])
        self._held = np.zeros(3)
        self._road = road
        self._current = float(car.coil.limited(np.array(current)))
        self._inner = None
        self._rest = car.preload
        if not self._plain and self._form is None:
            assert damper is not None
            self._inner = damper.stepper(self.step)
            self._held[0] = self._inner.begin(0.0, 0.0, self._current) - self._rest
        memory = self._inner is not None and self._inner.memory
        self._stages = (IntegratorStages.ramp if memory else IntegratorStages.held)(car.linear_part, self.step)

    def _divided(self, clock: float | None) -> int:
        """Integration steps per sample."""
        if clock is None:
            return max(1, int(np.ceil(self.sample_time / self.car.longest_step - 1e-9)))
        parts = round(self.sample_time / clock)
        if parts < 1 or abs(self.sample_time / (parts * clock) - 1) > RATE_TOLERANCE:
            raise InputError("the road's samples do not fall on those of the damper",
                             got=f"{1 / self.sample_time:.6g} Hz against {1 / clock:.6g} Hz",
                             why=f"this {self.car.damper.name if self.car.damper else ''} runs at its own rate only",
                             mend=f"sample the road at {1 / clock:.6g} Hz or a whole fraction of it")
        return parts

    def warn_outside(self, command: np.ndarray) -> None:
        """Warn of commands outside the range of the damper's fit, once in the life of a stepper.

        Parameters
        ----------
        command : (n,) array
            In the damper's unit, before the coil's limits.

        Warns
        -----
        ExtrapolationWarning
            To whom called the method that calls this one.
        """
        damper = self.car.damper
        outside = 0.0 if damper is None or self._warned_outside else damper.outside(self.car.coil.limited(command))
        if damper is not None and outside:
            self._warned_outside = True
            low, high = damper.current_range or (0.0, 0.0)
            warnings.warn(f"{damper.name}: {outside:.0%} of the commands lie outside the fitted {low:g} to {high:g} "
                          f"{damper.current_unit}", ExtrapolationWarning, stacklevel=3)

    @property
    def strut(self) -> float:
        """Force of damper and stops beside the linear part, without preload, at the present sample [N]."""
        return float(self._held[0])

    # -- going on ----------------------------------------------------------------------------------------------------
    def advance(self, road: np.ndarray, command: np.ndarray) -> States:
        """Go on along a road.

        Parameters
        ----------
        road : (n,) array
            Elevation at the coming samples [m].
        command : (n,) array
            Current commanded from each sample to the next, the present one first.

        Returns
        -------
        States
            At the present and the n coming samples.

        Warns
        -----
        ExtrapolationWarning
            As `warn_outside`, if nothing was outside the range before.
        """
        self.warn_outside(command)
        n = len(road)
        before = np.array([*self._x, self._held[0], self._held[1]])
        profile = np.concatenate([[self._road], road])
        first = self._current
        at_stages, at_samples = self._currents(self.car.coil.limited(np.asarray(command, dtype=float)))
        out = np.empty((n, 6))
        if self._inner is None:
            self._compiled(profile, at_stages, out)
        else:
            self._carried(profile, at_stages, out)
        if n:
            self._road = float(road[-1])
        out = np.vstack([before, out])
        return States(out[:, :4], out[:, 4], out[:, 5], np.concatenate([[first], at_samples]))

    def _currents(self, command: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, parts·stages) current at the ends of the stages, and (n,) at the samples."""
        shares = (np.arange(self._parts)[:, None] + self._stages.ends[None]).ravel()
        times = shares * self.step
        out = np.empty((len(command), times.size))
        for k, u in enumerate(command):
            out[k] = self.car.coil.follow(self._current, float(u), times)
            self._current = float(out[k, -1])
        return out, out[:, -1]

    def _compiled(self, profile: np.ndarray, current: np.ndarray, out: np.ndarray) -> None:
        from quartercar.vehicle._nonlinear_kernels import advance

        stages = self._stages
        coefficients = np.zeros((current.size, 8)) if self._form is None else self._form(current.ravel())
        coefficients[:, 0] -= self._rest if self._form is not None else 0.0
        shape = (len(out), self._parts, stages.ends.size, 8)
        advance(stages.ends, stages.state, stages.road, stages.force, profile, self.step,
                np.ascontiguousarray(coefficients).reshape(shape), self._stop, self._tyre, self._x, self._held, out)

    def _carried(self, profile: np.ndarray, current: np.ndarray, out: np.ndarray) -> None:
        """The same with a damper that is called from Python."""
        stages, step = self._stages, self.step
        count = stages.ends.size
        for k in range(len(out)):
            rate = (profile[k + 1] - profile[k]) / self.sample_time
            for part in range(self._parts):
                road = np.array([profile[k] + part * step * rate, rate])
                forces = [self._held[:2].copy()]
                end = self._x
                for j in range(count):
                    base = stages.state[j] @ self._x + stages.road[j] @ road
                    for m in range(j + 1):
                        base = base + stages.force[j, m] @ forces[m]
                    tip = np.array([road[0] + stages.ends[j] * step * rate, rate])
                    pair, end = self._settle(base, stages.force[j, j + 1], tip, float(forces[j][0]),
                                             float(current[k, part * count + j]))
                    forces.append(pair)
                self._x, self._held[:2] = end, forces[-1]
            out[k, :4], out[k, 4:] = self._x, self._held[:2]

    def _settle(self, base: np.ndarray, weight: np.ndarray, road: np.ndarray, f: float,
                current: float) -> tuple[np.ndarray, np.ndarray]:
        """(f, g) and the state at a stage's end, f = F(z_d, ż_d) + stops by secant steps in the bracket that builds."""
        inner = self._inner
        assert inner is not None
        inner.approach(current)
        stiffness, compression, rebound = self._stop
        (zs, vs, zu, vu), ((a, ag), (b, bg), (c, cg), (d, dg)) = base.tolist(), weight.tolist()
        kt, ct, load = self._tyre
        level = kt * (zu - road[0]) + ct * (vu - road[1])
        by_f, by_g = kt * c + ct * d, 1.0 + kt * cg + ct * dg

        def motion(force: float) -> tuple[float, float, float]:
            g = min(0.0, (load - level - by_f * force) / by_g)
            return zs - zu + (a - c) * force + (ag - cg) * g, vs - vu + (b - d) * force + (bg - dg) * g, g

        def wanted(force: float) -> float:
            z, v, _ = motion(force)
            bump = stiffness * (max(z - rebound, 0.0) - max(-z - compression, 0.0))
            return inner.trial(z, v) - self._rest + bump

        f = _found(wanted, f, self._held)
        z, v, g = motion(f)
        inner.commit(z, v)
        return np.array([f, g]), base + weight @ np.array([f, g])


def _found(wanted, f: float, held: np.ndarray) -> float:
    """The f at which wanted(f) = f, from a starting value; held[2] keeps the slope from call to call.

    Parameters
    ----------
    wanted : callable
        From a force to the force that the law has there [N]; falling, or rising with a slope below one.
    f : float
        Guess [N].
    held : (3,) array
        Changed in place: `held[2]` is the slope of `wanted`.

    Returns
    -------
    float
        f, within `CLOSE`·(1 + |f|) or after `ITERATIONS` steps [N].
    """
    low, high, slope = -np.inf, np.inf, float(held[2])
    y = wanted(f)
    for count in range(ITERATIONS):
        r, close = f - y, CLOSE * (1.0 + abs(f))
        if abs(r) <= close:
            break
        low, high = (low, f) if r > 0 else (f, high)
        if high - low <= close:
            break
        new = f - r / (1.0 - slope)
        if not low < new < high:
            new = 0.5 * (low + high) if np.isfinite(high - low) else y
        elif count % 3 == 2 and np.isfinite(high - low):
            new = 0.5 * (low + high)
        ahead = wanted(new)
        if new != f:
            slope = min((ahead - y) / (new - f), 0.9)
        f, y = new, ahead
    held[2] = slope
    return f
