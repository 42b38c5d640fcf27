"""Weights: small systems that state at which frequencies a signal matters, and how they are attached to a plant.

An H-infinity design makes every weighted gain from a disturbance to a performance signal smaller than γ. A weight of 5
on a performance signal asks for a fifth of the gain there; a weight on a disturbance states how large it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling

if TYPE_CHECKING:
    import control


IN, OUT = Signal("in"), Signal("out")


def first_order(dc: float, crossover: float | tuple[float, float], high: float) -> LPVStateSpace:
    """A step between two gains: `dc` at low and `high` at high frequency, through 1 (or a given gain) at `crossover`.

    W(s) = (high·s + dc·a)/(s + a), a = ω √((m² − high²)/(dc² − m²)). A large dc gain on an error forces slow
    tracking; a large high-frequency gain on a control limits its bandwidth; on a disturbance it is model error that
    grows with frequency.

    Parameters
    ----------
    dc, high : float
        Gains at frequency 0 and infinity.
    crossover : float or (float, float)
        Frequency ω [rad/s] where the gain is 1, or (ω, m) where it is m.

    Returns
    -------
    LPVStateSpace
        One state, from "in" to "out", continuous.

    Raises
    ------
    InputError
        Gains that do not lie on different sides of the gain at the crossover.

    Examples
    --------
    >>> w = first_order(100.0, 2.0, 0.5).to_control([])
    >>> [round(float(abs(w(s))), 6) for s in (0.0, 2.0j, 1e9j)]
    [100.0, 1.0, 0.5]
    """
    frequency, gain = crossover if isinstance(crossover, tuple) else (crossover, 1.0)
    w = _checks.positive(frequency, "the crossover of a weight", "rad/s")
    ratio = (gain**2 - high**2) / (dc**2 - gain**2) if abs(dc) != gain else -1.0
    if not 0 < ratio < math.inf:
        raise InputError("the gain at the crossover must lie between the gains at dc and at high frequency",
                         got=f"dc {dc:g}, crossover {gain:g}, high {high:g}")
    return _first(dc, w * math.sqrt(ratio), high)


def lead_lag(gain: float, zero: float, pole: float) -> LPVStateSpace:
    """gain (s/zero + 1)/(s/pole + 1), frequencies in rad/s: `gain` below both corners, gain·pole/zero above them.

    A target for a response (handling, comfort) is written so, and its inverse is the weight on that signal.

    Parameters
    ----------
    gain : float
        At rest.
    zero, pole : float
        Corner frequencies [rad/s].

    Returns
    -------
    LPVStateSpace
        One state, from "in" to "out", continuous.

    Examples
    --------
    >>> w = lead_lag(0.04, 8.0, 80.0).to_control([])              # handling target of a quarter-car design
    >>> round(float(abs(w(1e9j))), 6)
    0.4
    """
    return _first(gain, _checks.positive(pole, "the pole of a weight", "rad/s"),
                  gain * pole / _checks.positive(zero, "the zero of a weight", "rad/s"))


def lowpass(gain: float, corner: float) -> LPVStateSpace:
    """gain/(s/corner + 1), corner in rad/s: an actuator, a prefilter that makes B2 constant, a road as seen by speed.

    Parameters
    ----------
    gain : float
        At rest.
    corner : float
        Frequency [rad/s] where the gain has fallen to 0.71 of that.

    Returns
    -------
    LPVStateSpace
        One state, from "in" to "out", continuous.

    Examples
    --------
    >>> round(float(abs(lowpass(2.0, 60.0).to_control([])(60.0j))), 6)
    1.414214
    """
    return _first(gain, _checks.positive(corner, "the corner of a weight", "rad/s"), 0.0)


def performance(bandwidth: float, peak: float = 2.0, floor: float = 1e-3) -> LPVStateSpace:
    """(s/peak + ω_b)/(s + ω_b·floor) on an error: `floor` of it is allowed at rest, at most `peak` of it anywhere.

    With ‖W_e S‖ < 1 the sensitivity S stays below the inverse weight: static error below `floor`, bandwidth at least
    `bandwidth` [rad/s], resonance at most `peak`.

    Parameters
    ----------
    bandwidth : float
        ω_b [rad/s].
    peak : float
        Largest error over reference.
    floor : float
        Error over reference at rest.

    Returns
    -------
    LPVStateSpace
        One state, from "in" to "out", continuous.

    Examples
    --------
    >>> w = performance(10.0).to_control([])
    >>> round(float(abs(w(0.0)))), round(float(abs(w(1e9j))), 6)
    (1000, 0.5)
    """
    w = _checks.positive(bandwidth, "the bandwidth of a weight", "rad/s")
    return _first(1.0 / _checks.positive(floor, "the floor of a weight"), w * floor,
                  1.0 / _checks.positive(peak, "the peak of a weight"))


def control_effort(bandwidth: float, peak: float = 100.0, roll_off: float = 0.01) -> LPVStateSpace:
    """(s + ω_bc/peak)/(roll_off·s + ω_bc) on a control: gains up to `peak` below ω_bc [rad/s], and less and less above.

    It limits what the controller may ask of an actuator, above all beyond the actuator's bandwidth.

    Parameters
    ----------
    bandwidth : float
        ω_bc [rad/s].
    peak : float
        Gain to the control that is allowed at rest.
    roll_off : float
        Gain that is allowed at high frequency.

    Returns
    -------
    LPVStateSpace
        One state, from "in" to "out", continuous.

    Examples
    --------
    >>> w = control_effort(1000.0).to_control([])
    >>> round(float(abs(w(0.0))), 6), round(float(abs(w(1e9j))))
    (0.01, 100)
    """
    w = _checks.positive(bandwidth, "the bandwidth of a weight", "rad/s")
    r = _checks.positive(roll_off, "the roll-off of a weight")
    return _first(1.0 / _checks.positive(peak, "the peak of a weight"), w / r, 1.0 / r)


def bandpass(gain: float, centre: float, damping: float = 1.0) -> LPVStateSpace:
    """gain · 2ζω s/(s² + 2ζω s + ω²): only the band around `centre` [rad/s] counts, with `gain` at its middle.

    The larger the damping ζ the wider the band: ω·2ζ between the points of gain/√2. For comfort put it on the body's
    acceleration between 1 and 12 Hz, for road holding on the wheel between 8 and 15 Hz.

    Parameters
    ----------
    gain : float
        At the centre.
    centre : float
        ω [rad/s].
    damping : float
        ζ.

    Returns
    -------
    LPVStateSpace
        Two states, from "in" to "out", continuous.

    Examples
    --------
    >>> round(float(abs(bandpass(3.0, 10.0).to_control([])(10.0j))), 6)
    3.0
    """
    w, z = _checks.positive(centre, "the centre of a band", "rad/s"), _checks.positive(damping, "its damping")
    return _system([[0.0, w], [-w, -2 * z * w]], [[0.0], [1.0]], [[0.0, 2 * z * w * gain]], 0.0)


def second_order(gain: float, zero: tuple[float, float], pole: tuple[float, float]) -> LPVStateSpace:
    """gain (s² + 2ζ₁Ω₁s + Ω₁²)/(s² + 2ζ₂Ω₂s + Ω₂²): a bell (Ω₁ = Ω₂, ζ₁/ζ₂ its height) or a step of second order.

    The form in which Poussot-Vassal and Do weigh body acceleration and wheel travel, Ω between 1.5 and 13 Hz.

    Parameters
    ----------
    gain : float
        At high frequency; at rest gain·(Ω₁/Ω₂)².
    zero, pole : (float, float)
        (Ω, ζ), Ω in rad/s.

    Returns
    -------
    LPVStateSpace
        Two states, from "in" to "out", continuous.

    Examples
    --------
    >>> round(float(abs(second_order(2.0, (10.0, 0.9), (10.0, 0.3)).to_control([])(10.0j))), 6)
    6.0
    """
    (w1, z1), (w2, z2) = zero, pole
    _checks.positive(w2, "the pole of a weight", "rad/s")
    _checks.positive(z2, "the damping of a weight's poles")
    return _system([[0.0, w2], [-w2, -2 * z2 * w2]], [[0.0], [1.0]],
                   [[gain * (w1**2 - w2**2) / w2, gain * 2 * (z1 * w1 - z2 * w2)]], gain)


def scheduled_performance(bandwidth: str, box: Scheduling, peak: float = 2.0, floor: float = 1e-3) -> LPVStateSpace:
    """`performance` whose bandwidth ρ [rad/s] is a scheduling variable: A = −ρε, B = ρ(M − ε), C = D = 1/M.

    The requirement on the loop moves with ρ: fast where the plant allows it, slow elsewhere.

    peak, floor : float
        M and ε, as in `performance`.

    Parameters
    ----------
    bandwidth : str
        Name of the variable.
    box : Scheduling
        Its range and rate.

    Returns
    -------
    LPVStateSpace
        One state, scheduled on the bandwidth alone.

    Raises
    ------
    InputError
        A variable that the box does not have, or one that may be zero or negative.

    Examples
    --------
    >>> rho = Scheduling(("rho",), (0.1,), (0.99,))
    >>> round(float(abs(scheduled_performance("rho", rho).to_control([0.5])(0.0))), 6)
    1000.0
    """
    _checks.known_name(bandwidth, box.names, "scheduling variable")
    basis, i = Polynomial((bandwidth,), 1), box.names.index(bandwidth)
    if not box.lower[i] > 0:
        raise InputError(f"the bandwidth '{bandwidth}' must stay positive", got=f"a lower bound of {box.lower[i]:g}")
    one = np.array([1.0, 0.0])[:, None, None]
    return LPVStateSpace((1 - one) * -floor, (1 - one) * (peak - floor), one / peak, one / peak, basis, None,
                         box.part(basis.names), inputs=(IN,), outputs=(OUT,))


def scheduled_gain(variable: str, box: Scheduling, coefficients: Sequence[float]) -> LPVStateSpace:
    """c₀ + c₁ρ + c₂ρ² + …: a weight that grows or fades with a scheduling variable; multiply with `joining.series`.

    Large where the actuator is at its limit, it takes the control out of the loop there (Poussot-Vassal 2008).

    Parameters
    ----------
    variable : str
        Name of ρ.
    box : Scheduling
        Its range and rate.
    coefficients : sequence of float
        c₀, c₁, …; at least two, in powers of ρ in its unit.

    Returns
    -------
    LPVStateSpace
        Without states, scheduled on ρ alone.

    Raises
    ------
    InputError
        A variable that the box does not have, or fewer than two coefficients.

    Examples
    --------
    >>> rho = Scheduling(("rho",), (0.1,), (0.99,))
    >>> scheduled_gain("rho", rho, [11 / 300, -10 / 300]).frozen([0.5])[3].round(6).tolist()
    [[0.02]]
    """
    _checks.known_name(variable, box.names, "scheduling variable")
    c = np.asarray(coefficients, dtype=float)
    if c.ndim != 1 or len(c) < 2:
        raise InputError("a scheduled gain needs the coefficients of 1, ρ, …", got=coefficients)
    return LPVStateSpace.of(c[:, None, None], 0, Polynomial((variable,), len(c) - 1), None, box.part((variable,)),
                            inputs=(IN,), outputs=(OUT,))


def from_control(system: control.StateSpace | control.TransferFunction, inputs: Sequence[str] = (),
                 outputs: Sequence[str] = ()) -> LPVStateSpace:
    """Deprecated name of `from_lti`; `lpvid.from_control` makes an LPV model of systems on a grid.

    Parameters
    ----------
    system : control.TransferFunction or control.StateSpace
        As for `from_lti`.
    inputs, outputs : sequence of str, optional
        Left out, the names it bears.

    Returns
    -------
    LPVStateSpace
        That of `from_lti`.
    """
    import warnings

    warnings.warn("lpvid.synthesis.weights.from_control is now from_lti; lpvid.from_control is another function",
                  DeprecationWarning, stacklevel=2)
    return from_lti(system, inputs, outputs)


def from_lti(system: control.StateSpace | control.TransferFunction, inputs: Sequence[str] = (),
             outputs: Sequence[str] = ()) -> LPVStateSpace:
    """A python-control system (transfer function or state space) as a block, its realisation balanced if stable.

    Companion forms of high order lose digits in every inequality they enter; a balanced one does not.

    Parameters
    ----------
    system : control.TransferFunction or control.StateSpace
    inputs, outputs : sequence of str, optional
        Left out, the names it bears.

    Returns
    -------
    LPVStateSpace
        Without scheduling.

    Raises
    ------
    InputError
        A discrete system without a sampling period (dt=True).

    Examples
    --------
    >>> import control
    >>> from_lti(control.tf([9.6785, 0.029035, 0, 0], [1, 12064, 1.136e7, 1.0661e10])).order
    3
    """
    from lpvid.synthesis.reduction import balanced_realization

    return balanced_realization(as_it_stands(system, inputs, outputs))


def as_it_stands(system: control.StateSpace | control.TransferFunction, inputs: Sequence[str] = (),
                 outputs: Sequence[str] = ()) -> LPVStateSpace:
    """A python-control system as a block, in the realisation that python-control has of it.

    Parameters
    ----------
    system : control.StateSpace or control.TransferFunction
        Time-invariant.
    inputs, outputs : sequence of str
        Names of its signals; left out, its own.

    Returns
    -------
    LPVStateSpace
        Without scheduling.

    Raises
    ------
    InputError
        A discrete system without a sampling period (dt=True).
    """
    import control

    s: control.StateSpace = control.ss(system)  # type: ignore[assignment]
    if s.dt is True:
        raise InputError("a discrete system without a sampling period", got="dt=True", mend="give it its dt in seconds")
    return LPVStateSpace.still(s.A, s.B, s.C, s.D, float(s.dt) if s.dt else None,
                               inputs=tuple(Signal(n) for n in tuple(inputs) or s.input_labels),
                               outputs=tuple(Signal(n) for n in tuple(outputs) or s.output_labels))


def _first(dc: float, corner: float, high: float) -> LPVStateSpace:
    """high + (dc − high)·corner/(s + corner), with B and C of equal size."""
    step = (dc - high) * corner
    root = math.sqrt(abs(step))
    return _system([[-corner]], [[root]], [[math.copysign(root, step)]], high)


def _system(a, b, c, d: float) -> LPVStateSpace:
    return LPVStateSpace.still(a, b, c, [[d]], inputs=(IN,), outputs=(OUT,))
