"""The rig's sensors: from the fine clock to a measured record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.tables import option, quantity
from lpvid.toolkit import checks
from quartercar.rig.damper import Motion, Response, delayed, low_passed
from quartercar.rig.setup import MeasurementChain


@dataclass(frozen=True)
class Sensors:
    """Noise of each sensor, white and Gaussian at the output rate.

    Attributes
    ----------
    force_noise : float
        Standard deviation over the root mean square of the record's true force.
    displacement_noise, velocity_noise, current_noise : float
        Standard deviations [m], [m/s], [A].
    velocity_sensor : bool
        True: velocity has a sensor of its own. False: it is the central difference of the measured displacement.

    Examples
    --------
    >>> Sensors.perfect().force_noise
    0.0
    """

    force_noise: float = quantity(0.01, "", "force noise over the force's root mean square")
    displacement_noise: float = quantity(1e-6, "m", "displacement noise")
    velocity_noise: float = quantity(3e-4, "m/s", "velocity noise")
    current_noise: float = quantity(2e-3, "A", "current noise")
    velocity_sensor: bool = option(True, "velocity from its own sensor, not from the displacement")

    def __post_init__(self) -> None:
        for name in ("force_noise", "displacement_noise", "velocity_noise", "current_noise"):
            if not checks.real(getattr(self, name), name) >= 0:
                raise InputError(f"{name} must not be negative", got=getattr(self, name))

    @classmethod
    def perfect(cls) -> Sensors:
        """No noise at all.

        Returns
        -------
        Sensors
            Velocity with a sensor of its own.
        """
        return cls(0.0, 0.0, 0.0, 0.0)


def measure(motion: Motion, response: Response, chain: MeasurementChain, sensors: Sensors, keep: slice,
            rng: np.random.Generator | int) -> dict[str, np.ndarray]:
    """Sampled channels as the rig's computer stores them.

    Parameters
    ----------
    motion : Motion
        What was imposed, on the fine clock.
    response : Response
        What the damper did, on the fine clock.
    chain : MeasurementChain
        Delays, filters, gains, noise colour, steps.
    sensors : Sensors
        White noise of each sensor.
    keep : slice
        Samples of the fine clock that are stored.
    rng : numpy.random.Generator or int

    Returns
    -------
    dict of str to (n,) array
        ``displacement`` [m], ``velocity`` [m/s], ``current`` [A], ``force`` [N].
    """
    rate, rng = motion.rate, checks.generator(rng)
    moved = {"displacement": motion.displacement, "velocity": motion.velocity}
    for name, signal in moved.items():
        late = delayed(signal, chain.motion_delay * rate)
        if chain.filter_share != 0.0:
            late = late + chain.filter_share * (
                low_passed(late, chain.filter_frequency, chain.filter_damping, rate) - late)
        moved[name] = late[keep]
    force = delayed(response.force, chain.force_delay * rate)[keep]
    noise = rng.standard_normal((4, force.size))
    rms = float(np.sqrt(np.mean(force**2)))
    sampled = {
        "displacement": moved["displacement"] + sensors.displacement_noise * noise[0],
        "velocity": moved["velocity"] + sensors.velocity_noise * noise[1],
        "current": motion.command[keep] + sensors.current_noise * noise[2],
        "force": force + sensors.force_noise * rms * noise[3] + chain.force_offset,
    }
    if chain.colour_std != 0.0 or chain.colour_share != 0.0:
        sampled["force"] += (chain.colour_std + chain.colour_share * np.abs(force)) * _coloured(
            chain.colour_pole, force.size, rng)
    if chain.clip_share != 0.0:
        raw = sampled["force"]
        sampled["force"] = raw + chain.clip_share * (np.clip(raw, -chain.clip_force, chain.clip_force) - raw)
    if not sensors.velocity_sensor:
        period = (keep.step or 1) / rate
        sampled["velocity"] = np.gradient(sampled["displacement"]) / period
    return {name: _stored(signal, getattr(chain, f"{name}_gain"), getattr(chain, f"{name}_step"))
            for name, signal in sampled.items()}


def _stored(signal: np.ndarray, gain: float, step: float) -> np.ndarray:
    scaled = gain * signal if gain != 1.0 else signal
    return np.round(scaled / step) * step if step > 0 else scaled


def _coloured(pole: float, size: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary AR(1) of unit variance."""
    from scipy.signal import lfilter

    drive = rng.standard_normal(size) * np.sqrt(1 - pole**2)
    drive[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -pole], drive))
