"""Test signals for a rig: switching currents and displacement patterns, each an (n,) array on a uniform clock.

Currents and the like hold levels: `icps`, `prbs`, `aprbs`, `stepped`. Motions are smooth: `sine`, `triangle`, `chirp`,
`multisine`, `random_phase`. Whatever is random draws from the generator that is passed in, or from that of a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError

REGISTER_TAPS: dict[int, tuple[int, int]] = {7: (7, 6), 9: (9, 5), 10: (10, 7), 11: (11, 9), 15: (15, 14)}
"""Feedback taps (1-based cells) that give a shift register of that many cells its full period 2ⁿ−1."""

_BLOCK = 1024


# -- signals that hold levels -------------------------------------------------------------------------------------
def icps(samples: int, rate: float, *, hold: float, low: float, high: float,
         rng: np.random.Generator | int) -> np.ndarray:
    """Increased clock period signal: a fresh uniform level every `hold` seconds.

    i(t) = e(⌊(t−1)/N⌋ + 1), e ~ U[low, high], N = hold·rate rounded (Díaz Salas 2011, eq. 4.1; after Söderström &
    Stoica 1989).

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    hold : float
        Time for which a level is held [s]; 20 ms at 512 Hz becomes 10 samples (19.5 ms).
    low, high : float
        Range of the levels, in the signal's unit.
    rng : numpy.random.Generator or int

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        A hold shorter than half a sample, a range that is empty.

    Examples
    --------
    >>> icps(6, 100.0, hold=0.02, low=0.0, high=2.5, rng=np.random.default_rng(1)).round(2)
    array([1.28, 1.28, 2.38, 2.38, 0.36, 0.36])
    """
    samples, width = _length(samples), _hold_samples(hold, rate)
    low, high = _range(low, high)
    levels = _checks.generator(rng).uniform(low, high, -(-samples // width))
    return np.repeat(levels, width)[:samples]


def register_bits(cells: int, count: int, *, start: Sequence[int] | None = None) -> np.ndarray:
    """Output bits of a linear feedback shift register of maximal length.

    The last cell leaves; the exclusive-or of the two cells in `REGISTER_TAPS` enters at the front; the pattern repeats
    after 2ⁿ−1 bits, of which 2ⁿ⁻¹ are ones.

    Parameters
    ----------
    cells : int
        Number of cells n: 7, 9, 10, 11 or 15.
    count : int
        Number of bits.
    start : sequence of int, optional
        First content of the cells (0 or 1, not all 0); all ones if left out.

    Returns
    -------
    (count,) integer array of 0 and 1

    Raises
    ------
    InputError
        A number of cells without known taps, a start of zeros.

    Examples
    --------
    >>> "".join(map(str, register_bits(7, 32)))
    '11111110000001000001100001010001'
    """
    count = _checks.count(count, "count", at_least=1)
    if cells not in REGISTER_TAPS:
        raise InputError("cells of the shift register must have known taps", got=cells,
                         mend=f"choose one of {', '.join(map(str, REGISTER_TAPS))}")
    state = [1] * cells if start is None else [int(bool(b)) for b in start]
    if len(state) != cells or not any(state):
        raise InputError(f"start needs {cells} bits, not all of them 0", got=state)
    first, second = REGISTER_TAPS[cells]
    period = 2**cells - 1
    bits = np.empty(min(count, period), dtype=np.int64)
    for k in range(bits.size):
        bits[k] = state[-1]
        state = [state[first - 1] ^ state[second - 1], *state[:-1]]
    return np.resize(bits, count)


def prbs(samples: int, rate: float, *, clock: float, low: float, high: float, cells: int = 11,
         rng: np.random.Generator | int | None = None) -> np.ndarray:
    """Pseudo-random binary signal between two levels.

    Clocked every λ samples; its spectrum has the first null at rate/λ and its longest run lasts `cells`·λ samples,
    which must exceed the settling time of what is tested.

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    clock : float
        Time between register clocks [s], rounded to whole samples.
    low, high : float
        The two levels.
    cells : int
        Cells of the shift register.
    rng : numpy.random.Generator or int, optional
        Draws the register's first content; all ones if left out.

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        Unknown number of cells, a clock shorter than half a sample.

    Examples
    --------
    >>> prbs(10, 512.0, clock=1 / 512, low=0.0, high=2.5, cells=7)
    array([2.5, 2.5, 2.5, 2.5, 2.5, 2.5, 2.5, 0. , 0. , 0. ])
    """
    samples, width = _length(samples), _hold_samples(clock, rate)
    low, high = _range(low, high)
    bits = register_bits(cells, -(-samples // width), start=_first_cells(cells, rng))
    return np.repeat(np.where(bits == 1, high, low), width)[:samples]


def aprbs(samples: int, rate: float, *, clock: float, low: float, high: float, rng: np.random.Generator | int,
          cells: int = 11) -> np.ndarray:
    """Amplitude-modulated pseudo-random signal: switches when a PRBS does, to a level drawn uniformly.

    Parameters
    ----------
    samples, rate, clock, low, high, cells
        As in `prbs`.
    rng : numpy.random.Generator or int
        Draws the register's first content and the levels.

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        As `prbs`.

    Examples
    --------
    >>> aprbs(8, 512.0, clock=1 / 512, low=0.0, high=2.5, rng=np.random.default_rng(3), cells=7).round(2)
    array([0.59, 0.59, 2.  , 1.46, 0.24, 0.24, 0.24, 0.24])
    """
    low, high, rng = *_range(low, high), _checks.generator(rng)
    binary = prbs(samples, rate, clock=clock, low=0.0, high=1.0, cells=cells, rng=rng)
    run = np.concatenate([[0], np.cumsum(np.diff(binary) != 0)])
    return rng.uniform(low, high, int(run[-1]) + 1)[run]


def stepped(samples: int, levels: Sequence[float]) -> np.ndarray:
    """Levels held one after another for equal times (the first ones get the samples left over).

    Parameters
    ----------
    samples : int
        Length of the signal, at least one sample for each level.
    levels : sequence of float
        Levels in order.

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        No level, or fewer samples than levels.

    Examples
    --------
    >>> stepped(5, [0.0, 0.44])
    array([0.  , 0.  , 0.  , 0.44, 0.44])
    """
    values = _checks.finite(_checks.frozen_array(levels, "levels", ndim=1), "levels")
    if not values.size or values.size > _length(samples):
        raise InputError("stepped needs at least one level and one sample for each", got=f"{values.size} levels, "
                         f"{samples} samples")
    widths = [part.size for part in np.array_split(np.empty(samples), values.size)]
    return np.repeat(values, widths)


# -- motions ------------------------------------------------------------------------------------------------------
def sine(samples: int, rate: float, *, amplitude: float, frequency: float, phase: float = 0.0) -> np.ndarray:
    """x = X sin(2πft + φ).

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    amplitude : float
        X, in the signal's unit.
    frequency : float
        f [Hz].
    phase : float
        φ [rad].

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        A rate or frequency that is not positive.

    Examples
    --------
    >>> sine(5, 4.0, amplitude=2.0, frequency=1.0).round(12) + 0.0
    array([ 0.,  2.,  0., -2.,  0.])
    """
    time = _clock(samples, rate)
    return amplitude * np.sin(2 * np.pi * _checks.positive(frequency, "frequency", "Hz") * time + phase)


def triangle(samples: int, rate: float, *, amplitude: float, frequency: float,
             acceleration: float | None = None) -> np.ndarray:
    """Constant-speed strokes between ±X whose corners are rounded by an acceleration limit.

    Without a limit the speed is 4Xf. With one, a corner is a parabola of duration 2V/a, and the speed V on the flanks
    rises to the smaller root of V²/a − V/(2f) + 2X = 0, so that amplitude and frequency are kept.

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    amplitude : float
        X, in the signal's unit [m].
    frequency : float
        f [Hz].
    acceleration : float, optional
        Limit a [m/s²]; sharp corners if left out.

    Returns
    -------
    (samples,) array
        Starts at 0, rising.

    Raises
    ------
    InputError
        An acceleration limit under which the stroke cannot be made: a < 32Xf².

    Examples
    --------
    >>> triangle(9, 8.0, amplitude=1.0, frequency=1.0)
    array([ 0. ,  0.5,  1. ,  0.5,  0. , -0.5, -1. , -0.5,  0. ])
    """
    amplitude = _checks.positive(amplitude, "amplitude")
    frequency = _checks.positive(frequency, "frequency", "Hz")
    quarter = 0.25 / frequency
    phase = np.mod(_clock(samples, rate) + quarter, 4 * quarter)  # 0 at the lower turning point
    since = np.minimum(phase, 4 * quarter - phase)  # time since the lower turning point, 0 … half a period
    if acceleration is None:
        return amplitude * (since / quarter - 1.0)
    a = _checks.positive(acceleration, "acceleration", "m/s²")
    needed = 2 * amplitude / quarter**2
    if a < needed:
        raise InputError("triangle: the acceleration limit is too low for this stroke", got=f"{a:.6g} m/s²",
                         why=f"amplitude {amplitude:.6g} at {frequency:.6g} Hz needs {needed:.6g} m/s²")
    speed = 0.5 * (2 * quarter * a - np.sqrt((2 * quarter * a) ** 2 - 8 * amplitude * a))
    corner = speed / a
    early = 0.5 * a * np.minimum(since, corner) ** 2
    flank = speed * np.clip(since - corner, 0.0, 2 * quarter - 2 * corner)
    left = np.clip(since - (2 * quarter - corner), 0.0, corner)
    return early + flank + speed * left - 0.5 * a * left**2 - amplitude


def chirp(samples: int, rate: float, *, f_start: float, f_end: float, amplitude: float,
          peak_velocity: float | None = None) -> np.ndarray:
    """Logarithmic sweep: the frequency grows by equal factors in equal times.

    x(t) = X(f) sin(2π f_start T/ln r · (r^{t/T} − 1)), r = f_end/f_start, with X constant, or, for equal peak velocity
    V, X = (amplitude⁻⁴ + (V/2πf)⁻⁴)^(−1/4): a smooth passage from the stroke limit to V/(2πf).

    Parameters
    ----------
    samples : int
        Length of the signal; the sweep ends with it.
    rate : float
        Sampling rate [Hz].
    f_start, f_end : float
        First and last frequency [Hz].
    amplitude : float
        Amplitude, the largest one where `peak_velocity` is given [m].
    peak_velocity : float, optional
        V [m/s].

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        Equal frequencies, or one above half the rate.

    Examples
    --------
    >>> x = chirp(4096, 512.0, f_start=0.5, f_end=15.0, amplitude=0.02, peak_velocity=0.2)
    >>> bool(abs(np.diff(x) * 512).max() < 0.21)
    True
    """
    time = _clock(samples, rate)
    f_start, f_end = _band(f_start, f_end, rate)
    span = samples / rate
    growth = np.log(f_end / f_start)
    frequency = f_start * np.exp(growth * time / span)
    phase = 2 * np.pi * span / growth * (frequency - f_start)
    size = _checks.positive(amplitude, "amplitude")
    if peak_velocity is None:
        return size * np.sin(phase)
    wanted = _checks.positive(peak_velocity, "peak_velocity", "m/s") / (2 * np.pi * frequency)
    return (size**-4.0 + wanted**-4.0) ** -0.25 * np.sin(phase)


def multisine(samples: int, rate: float, *, frequencies: Sequence[float] | np.ndarray, rms: float,
              rng: np.random.Generator | int | None = None) -> np.ndarray:
    """Sum of sines of equal amplitude with Schroeder phases φ_j = −πj(j−1)/N, or with random ones.

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    frequencies : (lines,) array
        Frequencies [Hz]; `spread_lines` gives ones that do not repeat.
    rms : float
        Root mean square of the sum, in the signal's unit.
    rng : numpy.random.Generator or int, optional
        Random phases U[0, 2π) instead of Schroeder's.

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        No frequency, or one that is not between 0 and half the rate.

    Examples
    --------
    >>> x = multisine(512, 512.0, frequencies=np.arange(1, 21), rms=1.0)
    >>> round(float(np.sqrt(np.mean(x**2))), 6), bool(abs(x).max() < 2.0)
    (1.0, True)
    """
    lines = np.asarray(frequencies, dtype=float)
    order = np.arange(1, lines.size + 1)
    phases = -np.pi * order * (order - 1) / max(lines.size, 1)
    if rng is not None:
        phases = _checks.generator(rng).uniform(0, 2 * np.pi, lines.size)
    amplitudes = np.full(lines.size, _checks.positive(rms, "rms") * np.sqrt(2 / max(lines.size, 1)))
    return sum_of_cosines(samples, rate, lines, amplitudes, phases)


def spread_lines(f_min: float, f_max: float, lines: int, rng: np.random.Generator | int | None = None) -> np.ndarray:
    """Frequencies of `lines` equal bins of [f_min, f_max]: one drawn inside each bin, or the lower edges.

    Edges 0.5, 0.7, … Hz repeat every 10 s (with turned sign every 5 s): when such a record is split into training and
    test parts, the test repeats the training. Lines drawn inside their bins have no common period.

    Parameters
    ----------
    f_min, f_max : float
        Band [Hz].
    lines : int
        Number of bins.
    rng : numpy.random.Generator or int, optional
        Draws each line inside its bin; the bins' lower edges if left out.

    Returns
    -------
    (lines,) array
        Frequencies [Hz].

    Raises
    ------
    InputError
        An empty band.

    Examples
    --------
    >>> spread_lines(0.5, 20.5, 100)[:3]
    array([0.5, 0.7, 0.9])
    """
    lines = _checks.count(lines, "lines", at_least=1)
    f_min, f_max = _range(f_min, f_max)
    shift = np.zeros(lines) if rng is None else _checks.generator(rng).uniform(0.0, 1.0, lines)
    return f_min + (np.arange(lines) + shift) * ((f_max - f_min) / lines)


def random_phase(samples: int, rate: float, psd: Callable[[np.ndarray], np.ndarray], *, f_min: float, f_max: float,
                 lines: int, rng: np.random.Generator | int, incommensurate: bool = True) -> np.ndarray:
    """Random signal of a given spectrum as a sum of cosines with random phases.

    x(t) = Σ_j A_j cos(2πf_j t + φ_j), A_j = √(2 S(f_j) Δf), φ_j ~ U[0, 2π) (Díaz Salas 2011, eq. 4.3-4.4; phases
    uniform, not normal).

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    psd : callable
        One-sided power spectral density S(f) [unit²/Hz] of an array of frequencies [Hz].
    f_min, f_max : float
        Band [Hz].
    lines : int
        Number of cosines.
    rng : numpy.random.Generator or int
        Draws phases and, where wanted, the lines' places.
    incommensurate : bool
        Draw each line inside its bin (no common period) instead of at its lower edge.

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        An empty band, a spectrum that is negative or not finite.

    Examples
    --------
    >>> x = random_phase(5120, 512.0, lambda f: 1 / f**2, f_min=0.5, f_max=20.5, lines=100,
    ...                  rng=np.random.default_rng(0), incommensurate=False)
    >>> bool(np.allclose(x[:2560], -x[2560:]))
    True
    """
    rng = _checks.generator(rng)
    phases = rng.uniform(0.0, 2 * np.pi, _checks.count(lines, "lines", at_least=1))
    frequencies = spread_lines(f_min, f_max, lines, rng if incommensurate else None)
    density = np.asarray(psd(frequencies), dtype=float)
    if density.shape != frequencies.shape or not np.all(np.isfinite(density)) or np.any(density < 0):
        raise InputError("psd must give one finite value of at least 0 for each frequency", got=density)
    return sum_of_cosines(samples, rate, frequencies, np.sqrt(2 * density * (f_max - f_min) / lines), phases)


def sum_of_cosines(samples: int, rate: float, frequencies: np.ndarray, amplitudes: np.ndarray,
                   phases: np.ndarray) -> np.ndarray:
    """x(t) = Σ A_j cos(2πf_j t + φ_j), as two matrix products over blocks of time.

    Parameters
    ----------
    samples : int
        Length of the signal.
    rate : float
        Sampling rate [Hz].
    frequencies, amplitudes, phases : (lines,) arrays
        f_j [Hz], A_j in the signal's unit, φ_j [rad].

    Returns
    -------
    (samples,) array

    Raises
    ------
    InputError
        Arrays of different lengths, a frequency outside (0, rate/2).

    Examples
    --------
    >>> sum_of_cosines(3, 4.0, np.array([1.0]), np.array([2.0]), np.array([0.0])).round(12) + 0.0
    array([ 2.,  0., -2.])
    """
    samples, rate = _length(samples), _checks.positive(rate, "rate", "Hz")
    f, size, phase = (np.atleast_1d(np.asarray(part, dtype=float)) for part in (frequencies, amplitudes, phases))
    if f.size == 0 or f.shape != size.shape or f.shape != phase.shape:
        raise InputError("frequencies, amplitudes and phases need one entry for each line",
                         got=f"{f.size}, {size.size} and {phase.size}")
    if f.min() <= 0 or f.max() >= rate / 2:
        raise InputError("frequencies must lie between 0 and half the rate", got=f"{f.min():.6g} … {f.max():.6g} Hz",
                         why=f"half the rate is {rate / 2:.6g} Hz")
    blocks = -(-samples // _BLOCK)
    inside = 2 * np.pi * np.outer(np.arange(_BLOCK) / rate, f)
    starts = 2 * np.pi * np.outer(f, np.arange(blocks) * (_BLOCK / rate)) + phase[:, None]
    waves = np.cos(inside) @ (size[:, None] * np.cos(starts)) - np.sin(inside) @ (size[:, None] * np.sin(starts))
    return waves.T.reshape(-1)[:samples]


# -- checks -------------------------------------------------------------------------------------------------------
def _length(samples: int) -> int:
    return _checks.count(samples, "samples", at_least=1)


def _clock(samples: int, rate: float) -> np.ndarray:
    return np.arange(_length(samples)) / _checks.positive(rate, "rate", "Hz")


def _hold_samples(hold: float, rate: float) -> int:
    width = round(_checks.positive(hold, "hold", "s") * _checks.positive(rate, "rate", "Hz"))
    if width < 1:
        raise InputError("a level must be held for at least one sample", got=f"{hold:.6g} s at {rate:.6g} Hz")
    return width


def _range(low: float, high: float) -> tuple[float, float]:
    low, high = _checks.real(low, "the lower end"), _checks.real(high, "the upper end")
    if not high > low:
        raise InputError("the upper end of a range must exceed the lower one", got=f"{low:.6g} … {high:.6g}")
    return low, high


def _band(f_start: float, f_end: float, rate: float) -> tuple[float, float]:
    first, last = _checks.positive(f_start, "f_start", "Hz"), _checks.positive(f_end, "f_end", "Hz")
    if first == last or max(first, last) >= rate / 2:
        raise InputError("a sweep needs two different frequencies below half the rate", got=f"{first:.6g}, {last:.6g}")
    return first, last


def _first_cells(cells: int, rng: np.random.Generator | int | None) -> list[int] | None:
    if rng is None or cells not in REGISTER_TAPS:
        return None
    word = int(_checks.generator(rng).integers(1, 2**cells))
    return [(word >> k) & 1 for k in range(cells)]
