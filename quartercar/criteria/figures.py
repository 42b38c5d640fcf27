"""What a ride is judged by: weighted comfort, road holding, room of the suspension, gains by frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks

if TYPE_CHECKING:
    from quartercar.vehicle.nonlinear import QuarterCar
    from quartercar.vehicle.result import CarRun

F1, F2, F3, F4, Q4, F5, Q5, F6, Q6 = 0.4, 100.0, 12.5, 12.5, 0.63, 2.37, 0.91, 3.35, 0.91
"""Corner frequencies [Hz] and resonance factors of W_k (ISO 2631-1:1997, annex A)."""
COMFORT: tuple[tuple[str, float, float], ...] = (
    ("not uncomfortable", 0.0, 0.315), ("a little uncomfortable", 0.315, 0.63), ("fairly uncomfortable", 0.5, 1.0),
    ("uncomfortable", 0.8, 1.6), ("very uncomfortable", 1.25, 2.5), ("extremely uncomfortable", 2.0, np.inf))
"""Likely reactions with their overlapping ranges of weighted acceleration [m/s²] (ISO 2631-1, annex C)."""
BANDS: dict[str, tuple[str, float, float]] = {
    "comfort_high": ("body_acceleration", 4.0, 30.0), "comfort_low": ("body_displacement", 0.0, 5.0),
    "road_holding": ("wheel_displacement", 0.0, 20.0), "deflection": ("suspension_deflection", 0.0, 20.0)}
"""Gain criteria to the road by name: signal and band [Hz] (Poussot-Vassal 2008; equation sheet 4.5)."""
RUNNING = 1.0
"""Time over which the running rms of MTVV is taken [s]."""
SETTLED = 10.0
"""Zeros put after a signal so that the weighting's slowest pole (0.4 Hz) has decayed before it wraps around [s]."""
SAMPLES = 200
"""Samples per period of a sine, linear in between: its gain is then right to (2π/200)²/12 = 8e-5."""
LOWEST_RATE = 200.0
"""Sampling rate [Hz] below which the weighted band, up to 80 Hz, is not in the data."""


def comfort_transfer() -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of W_k(s), highest power first, for plants and filters.

    W_k = H_h H_l H_t H_s with the factor (ω_5/ω_6)² in H_s that puts its high-frequency gain at one (ISO 2631-1,
    annex A; equation sheet 4.7).

    Returns
    -------
    tuple of two arrays
        Six and nine coefficients, s in rad/s; the denominator begins with one.

    Examples
    --------
    >>> numerator, denominator = comfort_transfer()
    >>> denominator.size - numerator.size  # relative degree
    3
    """
    w1, w2 = 2 * np.pi * F1, 2 * np.pi * F2
    top, bottom = comfort_transition()
    top = np.polymul(np.polymul([1.0, 0.0, 0.0], [w2**2]), top)
    bottom = np.polymul(np.polymul([1.0, np.sqrt(2) * w1, w1**2], [1.0, np.sqrt(2) * w2, w2**2]), bottom)
    return top / bottom[0], bottom / bottom[0]


def comfort_transition() -> tuple[np.ndarray, np.ndarray]:
    """H_t H_s of W_k, which shape it between its band limits H_h H_l; as `comfort_transfer`.

    Returns
    -------
    tuple of two arrays
        Four and five coefficients, s in rad/s; the denominator begins with one.
    """
    w3, w4, w5, w6 = (2 * np.pi * f for f in (F3, F4, F5, F6))
    ratio = (w5 / w6) ** 2
    top = np.polymul([1 / w3, 1.0], [ratio / w5**2, ratio / (Q5 * w5), ratio])
    bottom = np.polymul([1 / w4**2, 1 / (Q4 * w4), 1.0], [1 / w6**2, 1 / (Q6 * w6), 1.0])
    return top / bottom[0], bottom / bottom[0]


def comfort_weighting(frequency: np.ndarray) -> np.ndarray:
    """(n,) complex W_k at frequencies [Hz].

    Parameters
    ----------
    frequency : (n,) array
        [Hz].

    Returns
    -------
    (n,) complex array
        Dimensionless.

    Examples
    --------
    >>> abs(comfort_weighting(np.array([1.0, 10.0]))).round(4)
    array([0.4825, 0.9884])
    """
    top, bottom = comfort_transfer()
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    return np.polyval(top, s) / np.polyval(bottom, s)


def weighted(acceleration: np.ndarray, sample_time: float) -> np.ndarray:
    """(n,) acceleration behind W_k, from rest: convolution by the discrete Fourier transform, exact in phase and gain.

    Parameters
    ----------
    acceleration : (n,) array
        Vertical [m/s²]; finite.
    sample_time : float
        [s].

    Returns
    -------
    (n,) array
        a_w [m/s²].

    Raises
    ------
    InputError
        A rate below 200 Hz, at which part of the weighted band is missing.
    """
    a = checks.finite(checks.frozen_array(acceleration, "acceleration", ndim=1), "acceleration")
    rate = 1 / checks.positive(sample_time, "sample_time", "s")
    if rate < LOWEST_RATE:
        raise InputError("too slow a sampling for the weighting of ISO 2631-1", got=f"{rate:.6g} Hz",
                         why="its band reaches 80 Hz", mend=f"at least {LOWEST_RATE:g} Hz")
    size = 1 << int(np.ceil(np.log2(a.size + SETTLED * rate)))
    spectrum = np.fft.rfft(a, size) * comfort_weighting(np.fft.rfftfreq(size, sample_time))
    return np.fft.irfft(spectrum, size)[: a.size]


def rms(signal: np.ndarray) -> float:
    """Root mean square about zero.

    Parameters
    ----------
    signal : array
        Of any shape.

    Returns
    -------
    float
        In the unit of the signal.
    """
    return float(np.sqrt(np.mean(np.square(signal))))


def vibration_dose(weighted_acceleration: np.ndarray, sample_time: float) -> float:
    """VDV = (∫ a_w⁴ dt)^¼ [m/s^1.75].

    Parameters
    ----------
    weighted_acceleration : (n,) array
        As `weighted` returns it [m/s²].
    sample_time : float
        [s].

    Returns
    -------
    float
        Over all samples.

    Examples
    --------
    >>> round(vibration_dose(np.full(1600, 2.0), 0.01), 6)
    4.0
    """
    return float((np.sum(np.asarray(weighted_acceleration) ** 4) * sample_time) ** 0.25)


def transient_maximum(weighted_acceleration: np.ndarray, sample_time: float) -> float:
    """MTVV: largest rms over one second of the weighted acceleration [m/s²]; over all of a shorter one.

    Parameters
    ----------
    weighted_acceleration : (n,) array
        As `weighted` returns it [m/s²].
    sample_time : float
        [s].

    Returns
    -------
    float
        [m/s²].
    """
    square = np.concatenate([[0.0], np.cumsum(np.asarray(weighted_acceleration, dtype=float) ** 2)])
    width = min(max(round(RUNNING / sample_time), 1), square.size - 1)
    return float(np.sqrt(np.max(square[width:] - square[:-width]) / width))


def comfort_classes(weighted_rms: float) -> tuple[str, ...]:
    """Likely reactions to a weighted rms acceleration [m/s²]; the ranges overlap.

    Parameters
    ----------
    weighted_rms : float
        [m/s²].

    Returns
    -------
    tuple of str
        One or two of the names in `COMFORT`, mildest first.

    Examples
    --------
    >>> comfort_classes(0.9)
    ('fairly uncomfortable', 'uncomfortable')
    """
    value = checks.real(weighted_rms, "weighted rms")
    return tuple(name for name, low, high in COMFORT if low <= value < high)


@dataclass(frozen=True)
class RideFigures:
    """Figures of one run.

    Attributes
    ----------
    acceleration, comfort : float
        Rms of the body's acceleration, plain and W_k-weighted [m/s²].
    dose, transient : float
        VDV [m/s^1.75], MTVV [m/s²].
    tyre_load, load_coefficient : float
        Rms of the dynamic tyre force about its mean [N]; DLC, as a share of the static load.
    off_road : float
        Share of samples with the tyre in the air.
    stroke, largest_stroke : float
        Standard deviation and largest modulus of the suspension's deflection [m].
    space_used : float or None
        Largest share of the room up to a bump stop that was used; above 1 the stop was touched. None without stops.
    """

    acceleration: float
    comfort: float
    dose: float
    transient: float
    tyre_load: float
    load_coefficient: float
    off_road: float
    stroke: float
    largest_stroke: float
    space_used: float | None

    @property
    def classes(self) -> tuple[str, ...]:
        """Likely reactions (ISO 2631-1, annex C)."""
        return comfort_classes(self.comfort)

    def __str__(self) -> str:
        used = "" if self.space_used is None else f", {self.space_used:.0%} of its room"
        return (f"comfort    {self.comfort:.4g} m/s^2 weighted ({self.acceleration:.4g} plain), "
                f"{' / '.join(self.classes)}\n"
                f"           VDV {self.dose:.4g} m/s^1.75, MTVV {self.transient:.4g} m/s^2\n"
                f"tyre load  {self.tyre_load:.4g} N rms, DLC {self.load_coefficient:.4g}, "
                f"off the road {self.off_road:.2%}\n"
                f"stroke     {1e3 * self.stroke:.3g} mm rms, {1e3 * self.largest_stroke:.3g} mm at most{used}")


def judge(run: CarRun, settle: float = 0.0) -> RideFigures:
    """Figures of a run.

    Parameters
    ----------
    run : CarRun
    settle : float
        Time at the start that is left out [s]; the weighting filter has then run in.

    Returns
    -------
    RideFigures
        Over the samples from `settle` on.

    Examples
    --------
    >>> from quartercar.vehicle.nonlinear import QuarterCar
    >>> from quartercar.parameters import MEGANE
    >>> bump = np.r_[np.zeros(100), 0.02 * np.hanning(100), np.zeros(800)]
    >>> judge(QuarterCar(MEGANE).run(bump, 1e-3)).space_used is None
    True
    """
    rest = run.after(settle) if settle else run
    skipped = run.n_samples - rest.n_samples
    a = weighted(run["body_acceleration"], run.sample_time)[skipped:]
    force, z = rest["tyre_force"], rest["suspension_deflection"]
    stops = run.car.stops
    used = None if stops is None else float(max(z.max() / stops.rebound, -z.min() / stops.compression))
    return RideFigures(rms(rest["body_acceleration"]), rms(a), vibration_dose(a, run.sample_time),
                transient_maximum(a, run.sample_time), float(force.std()), float(force.std()) / run.static_load,
                float(np.mean(rest["tyre_load"] <= 0)), float(z.std()), float(np.abs(z).max()), used)


def band_gain(frequency: np.ndarray, gain: np.ndarray, low: float, high: float) -> float:
    """√∫|X(f)|² df over a band, trapezoidal, with the band's ends interpolated (Poussot-Vassal 2008).

    A band from 0 begins at the lowest frequency there is.

    Parameters
    ----------
    frequency : (n,) array
        Rising [Hz].
    gain : (n,) array
        X, complex or its modulus.
    low, high : float
        Ends of the band [Hz].

    Returns
    -------
    float
        In the unit of the gain times √Hz.

    Raises
    ------
    InputError
        A band that the frequencies do not reach.
    """
    f, g = np.asarray(frequency, dtype=float), np.abs(np.asarray(gain))
    if not (low < high <= f[-1] and (low == 0 or f[0] <= low)):
        raise InputError("the frequencies do not cover the band", got=f"{f[0]:g} to {f[-1]:g} Hz against "
                         f"{low:g} to {high:g} Hz")
    low = max(low, f[0])
    inside = np.concatenate([[low], f[(f > low) & (f < high)], [high]])
    square = np.interp(inside, f, g) ** 2
    return float(np.sqrt(np.sum(0.5 * (square[1:] + square[:-1]) * np.diff(inside))))


@dataclass(frozen=True, eq=False)
class FrequencyGains:
    """Gains of a nonlinear car from road to signals, by sines of one amplitude.

    Attributes
    ----------
    frequency : (n,) array
        [Hz].
    gains : dict of str to (n,) array
        √(∫z²/∫w²) of each signal about its mean over whole periods, once settled.
    amplitude : float
        Of the road [m].
    """

    frequency: np.ndarray
    gains: dict[str, np.ndarray]
    amplitude: float

    def criteria(self) -> dict[str, float]:
        """Band criteria of `BANDS`, as far as the frequencies reach.

        Returns
        -------
        dict of str to float
            By the names of `BANDS`; a band whose signal is missing or whose upper end is not reached is left out.
        """
        return {name: band_gain(self.frequency, self.gains[signal], low, high)
                for name, (signal, low, high) in BANDS.items() if signal in self.gains and high <= self.frequency[-1]}


def frequency_gains(car: QuarterCar, frequency: Sequence[float] | np.ndarray, amplitude: float = 1e-3,
                    current: float = 0.0, signals: Sequence[str] = ("body_acceleration", "body_displacement",
                                                                    "wheel_displacement", "suspension_deflection",
                                                                    "tyre_deflection")) -> FrequencyGains:
    """Nonlinear frequency response: pure sines, variance gain (Savaresi et al. 2010).

    Parameters
    ----------
    car : QuarterCar
    frequency : sequence of float
        Rising [Hz].
    amplitude : float
        Of the road [m].
    current : float
        Commanded, constant.
    signals : sequence of str

    Returns
    -------
    FrequencyGains
        Each sine runs for at least 6 s and 4 periods to settle, then over 4 periods (at least 1 s) that count.

    Raises
    ------
    InputError
        No frequencies, or some that are not positive or do not rise.
    """
    f = checks.finite(checks.frozen_array(frequency, "frequency", ndim=1), "frequency")
    if f.size < 1 or f[0] <= 0 or np.any(np.diff(f) <= 0):
        raise InputError("frequencies must be positive and rise", got=f"{f.size} values")
    amplitude = checks.positive(amplitude, "amplitude", "m")
    clock = None if car.damper is None else car.damper.clock
    rows = [_sine_gains(car, float(value), amplitude, current, tuple(signals), clock) for value in f]
    gains = {s: np.array([row[i] for row in rows]) for i, s in enumerate(signals)}
    return FrequencyGains(np.array(f), gains, amplitude)


def _sine_gains(car: QuarterCar, frequency: float, amplitude: float, current: float, signals: tuple[str, ...],
                clock: float | None) -> list[float]:
    """Gains at one frequency; the road's samples fall on whole periods unless the damper has a clock of its own."""
    parts = max(SAMPLES, int(np.ceil(1 / (frequency * 1e-3))))
    step = clock or 1 / (frequency * parts)
    counted = max(4, int(np.ceil(frequency)))
    settle = max(4, int(np.ceil(6 * frequency)))
    n = round((settle + counted) / (frequency * step))
    t = step * np.arange(n + 1)
    run = car.run(amplitude * np.sin(2 * np.pi * frequency * t), step, current)
    keep = round(counted / (frequency * step))
    road = run["road"][-keep:]
    return [float(np.std(run[s][-keep:]) / np.std(road)) for s in signals]
