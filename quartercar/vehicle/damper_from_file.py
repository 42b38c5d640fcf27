"""A damper from a file that a car can be given: it dissipates, its poles are stable, its rate shows the wheel hop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Scheduling
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.contract import Damper
from quartercar.dampers.loading import load_damper
from quartercar.parameters import CarParameters

PROBES = np.array([0.05, 0.1, 0.2, 0.3])
"""speeds at which the sense of a force is evaluated; a law that is active at some of them still has a sense [m/s]"""
USUAL_RATE = 500.0
"""to which measurements are decimated [Hz]; half of it is above ten times the wheel hop of a road car, 10 to 20 Hz"""


def car_damper(path: str | Path) -> Damper:
    """The damper in a file, refused with one line where a car would be driven by it or leave all bounds.

    Parameters
    ----------
    path : str or Path
        A damper file, as `load_damper` reads it.

    Returns
    -------
    Damper
        Ready for a car.

    Raises
    ------
    InputError
        As `load_damper`; reversed polarity; a frozen pole outside the unit circle at a current of its range.
    """
    damper = load_damper(path)
    check_sense(damper, f"'{path}'")
    check_stable(damper, f"'{path}'")
    return damper


def check_sense(damper: Damper, label: str) -> None:
    """Refuse a force that drives the motion.

    Parameters
    ----------
    damper : Damper
        Its force is evaluated at `PROBES` and the middle of its usual currents.
    label : str
        What the message begins with, the file for instance.

    Raises
    ------
    InputError
        Records of reversed polarity, or a force that gives energy at all of the speeds.
    """
    if damper.polarity < 0:
        raise InputError(f"{label}: the damper was identified from records of reversed polarity",
                         why="its force is measured against the velocity, so that a car would be driven by it",
                         mend="turn the force's sign and identify again (--flip force)")
    low, high = damper.usual_currents or (0.0, 0.0)
    with np.errstate(all="ignore"):
        force = np.array([[damper.static_force(np.array([s * v]), 0.5 * (low + high))[0] for v in PROBES]
                          for s in (1.0, -1.0)])
    power = (force[0] - force[1]) * PROBES
    if np.isfinite(power).all() and np.all(power < 0):
        raise InputError(f"{label}: the force of this damper points along the motion",
                         got=f"{force[0, -1]:.4g} N in extension and {force[1, -1]:.4g} N in compression at "
                         f"{PROBES[-1]:g} m/s", why="a damper pulls in extension and pushes in compression",
                         mend="turn the force or the velocity of its records (--flip) and identify again")


def check_stable(damper: Damper, label: str, currents: tuple[float, float] | None = None) -> None:
    """Refuse a transfer function or state space with a frozen pole outside the circle at a current of a range.

    The range is that of its training records, or that of the coil where that is another.

    Exact over the range for one scheduling variable (`lpvid.analysis.frozen_stability`). A model that schedules itself
    is bounded by what it is made of, and not looked at.

    Parameters
    ----------
    damper : Damper
        Anything but an identified transfer function or state space passes.
    label : str
        What the message begins with, the file for instance.
    currents : (float, float), optional
        Range, in the damper's unit; that of its training records where left out.

    Raises
    ------
    InputError
        A pole on or outside the unit circle, with the current at which it lies.
    """
    if not isinstance(damper, SampledDamper) or damper.clock is None:
        return
    model = damper.at_clock(damper.clock)
    if not isinstance(model, (LPVTransferFunction, LPVStateSpace)) or not model.order:
        return
    from lpvid.analysis.frozen_stability import frozen_stability

    span = currents or damper.usual_currents
    if model.box.names and span is not None:
        model = model.replace(scheduling=Scheduling(model.box.names, span[:1], span[1:], units=model.box.units))
    found = frozen_stability(model)
    if found.stable:
        return
    unit = "" if damper.current_unit == "1" else f" {damper.current_unit}"
    where = "".join(f" at {n} {v:.4g}{unit}" for n, v in found.at.items())
    size = np.inf if found.max_modulus is None else found.max_modulus
    raise InputError(f"{label}: the damper is unstable", got=f"a pole of modulus {size:.4g}{where}",
                     why="its force in a car would grow without end", mend="identify again with a lower order, with "
                     "--passive, or with records at that current")


def check_rate(damper: Damper, parameters: CarParameters, label: str) -> None:
    """Refuse a sampled damper whose Nyquist frequency lies below the car's wheel hop √((k_s + k_t)/m_us)/2π.

    Parameters
    ----------
    damper : Damper
        One without a clock of its own passes.
    parameters : CarParameters
        For the wheel hop.
    label : str
        What the message begins with, the file for instance.

    Raises
    ------
    InputError
        A Nyquist frequency at or below the wheel hop.
    """
    if damper.clock is None:
        return
    hop = parameters.wheel_hop
    if 0.5 / damper.clock <= hop:
        raise InputError(f"{label}: the damper runs at {1 / damper.clock:.4g} Hz only", why="the loop runs at the "
                         f"damper's rate, and this car's wheel hops at {hop:.3g} Hz",
                         mend=_faster(2 * hop))


def _faster(least: float) -> str:
    """What makes a loop fast enough for a wheel whose hop asks for a rate above `least` [Hz]."""
    if least >= USUAL_RATE:
        return "check the car's tyre stiffness and unsprung mass, and their units: no wheel of a car hops so fast"
    return f"identify again at {USUAL_RATE:g} Hz (--sample-rate {USUAL_RATE:g}), at least above {least:.3g} Hz"


def current_limits(damper: Damper, otherwise: float) -> tuple[float, float]:
    """Limits of a coil for a damper: the currents at which its training records drove it, to a hundredth of the range.

    Parameters
    ----------
    damper : Damper
    otherwise : float
        Highest current where the damper has no range.

    Returns
    -------
    (float, float)
        Lowest, not below zero, and highest, in the damper's unit; 0 and `otherwise` for a damper that does not read the
        current.

    Examples
    --------
    >>> from quartercar.rides.default_damper import identified_damper
    >>> current_limits(identified_damper(), 2.0)
    (0.0, 2.5)
    """
    span = damper.usual_currents
    if span is None or "current" not in damper.reads:
        return 0.0, otherwise
    grain = 10.0 ** math.floor(math.log10(damper.slack))
    low, high = (max(round(c / grain) * grain, 0.0) for c in span)
    digits = max(0, -math.floor(math.log10(grain)))
    return (round(low, digits), round(high, digits)) if high > low else (0.0, max(otherwise, high))
