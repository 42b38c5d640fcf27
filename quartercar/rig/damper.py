"""The rig's specimen: a magnetorheological damper with a series spring, and the run of it along a motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from lpvid.errors import InputError
from lpvid.tables import quantity
from lpvid.toolkit import checks
from quartercar.rig.setup import Physics, Setup


@dataclass(frozen=True)
class RigDamper:
    """Physical damper of the rig; the defaults lie outside the class of LPV models with polynomial scheduling.

    A spring k in series with yield and viscous loss, Ḟ/k = v − g(F, i), where g inverts

        F = s(w)·[(c_0 + c_1 i) w + (F_0 + G i_s tanh(i/i_s)) tanh(w/v_k)],  s = asymmetry for w > 0, else 1,

    in parallel with gas −P(1 + Kx/(nP))^(−n), n = 1.3, and seal friction F_c tanh(v/2 mm/s). The current i follows the
    driver with one time constant when it rises and another when it falls.

    Attributes
    ----------
    viscous, viscous_per_current : float
        c_0 [N·s/m], c_1 [N·s/(m·A)].
    yield_base, yield_per_current : float
        F_0 [N], G [N/A].
    yield_current : float
        i_s [A]; infinite for a yield force that is linear in the current.
    yield_speed : float
        v_k [m/s], the fluid speed at which the yield force has built up to tanh 1.
    asymmetry : float
        Rebound over compression force.
    series_stiffness : float
        k [N/m]; infinite for a damper without compliance.
    gas_preload, gas_stiffness : float
        P [N], K [N/m].
    friction : float
        F_c [N].
    rise_time, fall_time : float
        Time constants of the current [s].

    Examples
    --------
    >>> RigDamper.viscous_only(1500.0).series_stiffness
    inf
    """

    viscous: float = quantity(900.0, "N*s/m", "viscous damping at zero current")
    viscous_per_current: float = quantity(300.0, "N*s/(m*A)", "growth of the viscous damping with current")
    yield_base: float = quantity(60.0, "N", "yield force at zero current")
    yield_per_current: float = quantity(1050.0, "N/A", "initial slope of the yield force over current")
    yield_current: float = quantity(1.5, "A", "current scale of its saturation; inf for none")
    yield_speed: float = quantity(0.025, "m/s", "fluid speed of the yield knee")
    asymmetry: float = quantity(1.3, "", "rebound over compression force")
    series_stiffness: float = quantity(4e6, "N/m", "spring in series (fluid and mount); inf for none")
    gas_preload: float = quantity(180.0, "N", "gas force at mid stroke")
    gas_stiffness: float = quantity(500.0, "N/m", "gas spring rate at mid stroke")
    friction: float = quantity(20.0, "N", "seal friction")
    rise_time: float = quantity(0.005, "s", "time constant of a rising current")
    fall_time: float = quantity(0.010, "s", "time constant of a falling current")

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            endless = field.name in ("yield_current", "series_stiffness") and value == math.inf
            if not endless and checks.real(value, f"damper {field.name}") < 0:
                raise InputError(f"damper {field.name} must not be negative", got=value)
        for name in ("yield_current", "yield_speed", "asymmetry", "series_stiffness"):
            if not getattr(self, name) > 0:
                raise InputError(f"damper {name} must be positive", got=getattr(self, name))

    @classmethod
    def viscous_only(cls, damping: float, series_stiffness: float = math.inf) -> RigDamper:
        """F = c v, or the Maxwell element c in series with k: nothing else, for checks against closed forms.

        Parameters
        ----------
        damping : float
            c [N·s/m].
        series_stiffness : float
            k [N/m]; infinite for the dashpot alone.

        Returns
        -------
        RigDamper
            No yield force, gas, friction or lag.
        """
        return cls(viscous=damping, viscous_per_current=0.0, yield_base=0.0, yield_per_current=0.0, asymmetry=1.0,
                   series_stiffness=series_stiffness, gas_preload=0.0, gas_stiffness=0.0, friction=0.0, rise_time=0.0,
                   fall_time=0.0)

    @classmethod
    def static(cls) -> RigDamper:
        """Damper without memory, a clean baseline for one cause: F = (900 + 300i) v + (60 + 580i) tanh(v/0.025).

        Returns
        -------
        RigDamper
            Currents i in A, velocities v in m/s: no series spring, saturation, gas, friction or lag.
        """
        return cls(viscous=900.0, viscous_per_current=300.0, yield_base=60.0, yield_per_current=580.0,
                   yield_current=math.inf, yield_speed=0.025, asymmetry=1.0, series_stiffness=math.inf,
                   gas_preload=0.0, gas_stiffness=0.0, friction=0.0, rise_time=0.0, fall_time=0.0)

    def physics(self) -> Physics:
        """The integrator's numbers for this damper alone.

        Returns
        -------
        Physics
            An infinite `series_stiffness` becomes a compliance of 0, an infinite `yield_current` a saturation of 0.
        """
        return Physics(
            viscous=float(self.viscous), viscous_per_current=float(self.viscous_per_current),
            yield_base=float(self.yield_base), yield_per_current=float(self.yield_per_current),
            yield_saturation=1.0 / self.yield_current, yield_speed=float(self.yield_speed),
            asymmetry=float(self.asymmetry), compliance=1.0 / self.series_stiffness,
            gas_preload=float(self.gas_preload), gas_stiffness=float(self.gas_stiffness),
            friction=float(self.friction), rise_time=float(self.rise_time), fall_time=float(self.fall_time),
        )


@dataclass(frozen=True, eq=False)
class Motion:
    """What the rig imposes, on the fine clock: displacement [m], its two derivatives, the driver's current [A].

    Ten minutes are five million samples of the fine clock; the acceleration is computed where it is asked for.

    Attributes
    ----------
    displacement : (n,) array
        Of the piston, positive in extension [m].
    velocity : (n,) array
        Its derivative [m/s].
    command : (n,) array
        Current that the driver is asked for, before any delay [A].
    rate : float
        Of the fine clock [Hz].
    """

    displacement: np.ndarray
    velocity: np.ndarray
    command: np.ndarray
    rate: float

    @classmethod
    def along(cls, displacement: np.ndarray, command: np.ndarray, rate: float) -> Motion:
        """Derive the velocity by central differences, one-sided at the two ends.

        Parameters
        ----------
        displacement : (n,) array
            [m].
        command : (n,) array
            Current of the driver [A].
        rate : float
            Of both [Hz].

        Returns
        -------
        Motion
            The arrays themselves, with the velocity [m/s].
        """
        velocity = np.gradient(displacement)
        velocity *= rate
        return cls(displacement, velocity, command, rate)

    @property
    def acceleration(self) -> np.ndarray:
        """(n,) by second differences, at the two ends of the velocity [m/s²]."""
        out = np.empty_like(self.velocity)
        out[1:-1] = np.diff(self.displacement, 2) * self.rate**2
        out[0] = (self.velocity[1] - self.velocity[0]) * self.rate
        out[-1] = (self.velocity[-1] - self.velocity[-2]) * self.rate
        return out


@dataclass(frozen=True, eq=False)
class Response:
    """What the damper did: the force on the fine clock, (n,), all else at the (m,) steps that were asked for.

    Ten minutes are five million steps: the five other signals, kept at each of them, would take 200 MB.

    Attributes
    ----------
    force : (n,) array
        Force at the load cell: damper, fixture inertia, fixture dynamics [N].
    series_force : (m,) array
        Force of hydraulics and yield, which the series spring carries [N].
    current : (m,) array
        Effective current behind all lags [A].
    temperature : (m,) array
        Temperature rise of the fluid [K].
    fluid_speed : (m,) array
        w [m/s].
    deflection : (m,) array
        Deflection of the series elements [m].
    """

    force: np.ndarray
    series_force: np.ndarray
    current: np.ndarray
    temperature: np.ndarray
    fluid_speed: np.ndarray
    deflection: np.ndarray


def respond(setup: Setup, motion: Motion, every: int = 1) -> Response:
    """Integrate the damper along a motion, both on the fine clock.

    Parameters
    ----------
    setup : Setup
        Numbers of damper and chain.
    motion : Motion
        Displacement, derivatives and current, (n,) each, with their rate [Hz].
    every : int
        Steps of the fine clock between two samples of all signals but the force.

    Returns
    -------
    Response
    """
    from quartercar.rig import _integrator

    step, chain = 1.0 / motion.rate, setup.chain
    force = np.empty(motion.displacement.size)
    states = np.empty((5, -(-force.size // every)))
    command = delayed(motion.command, chain.command_delay * motion.rate)
    _integrator.integrate(motion.displacement, motion.velocity, command, setup.physics, step, every, force, states)
    if chain.fixture_mass != 0.0:
        force = force + chain.fixture_mass * motion.acceleration
    if chain.resonance_share != 0.0:
        force = force + chain.resonance_share * (
            low_passed(force, chain.resonance_frequency, chain.resonance_damping, motion.rate) - force)
    return Response(force, *states)


def low_passed(signal: np.ndarray, frequency: float, damping: float, rate: float) -> np.ndarray:
    """Second-order low-pass ω²/(s² + 2ζωs + ω²), started at rest on the first sample.

    Parameters
    ----------
    signal : (n,) array
        In any unit.
    frequency : float
        Natural frequency ω/2π [Hz].
    damping : float
        ζ.
    rate : float
        Sampling rate of `signal` [Hz].

    Returns
    -------
    (n,) array
        In the unit of `signal`.
    """
    from quartercar.rig import _integrator

    out = np.empty_like(signal)
    _integrator.second_order(signal, float(frequency), float(damping), 1.0 / rate, out)
    return out


def delayed(signal: np.ndarray, samples: float) -> np.ndarray:
    """Signal later by a number of samples, interpolated linearly; the first value stands before the start.

    Parameters
    ----------
    signal : (n,) array
        In any unit.
    samples : float
        Delay in samples, whole or not; 0 returns `signal` itself.

    Returns
    -------
    (n,) array
        In the unit of `signal`.
    """
    if samples == 0:
        return signal
    return np.interp(np.arange(signal.size) - samples, np.arange(signal.size), signal)
