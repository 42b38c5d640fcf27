"""Feedback from output to input, where the excitation repeats itself: what does not repeat is disturbance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.auditing.coherence import one_per_motion
from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.condition import repetition_period

FALSE_ALARM = 0.01
"""probability of a finding on a data set without feedback, at most: an audit makes some forty checks."""
MOST_OF_IT = 0.5
"""rms of what does not repeat over that of the input, up to which the excitation counts as repeating: a fourth of the
power may be disturbance that comes back. It decides whether there are periods, not whether there is feedback."""
FEWEST = 64
"""frequencies, at least."""
SHARE = 16
"""the lags are at most this part of the frequencies: what noise gives to the even part is then 1/16 of it at most."""
EVENT = 8
"""part of a period, without the most different one of which there must be feedback still: a loop acts all the time, an
event once. With 4 or 8 none of 200 single events was taken for a loop (2: 1, 16: 3, 32: 93), with each all of 180
simulated loops were found."""
BESIDE = 2
"""lines of the excitation to either side over which spectra are averaged."""


@dataclass(frozen=True)
class Repeated:
    """Input and output over whole periods of one excitation.

    Attributes
    ----------
    input, output : (k, n) arrays
        Period by period.
    sample_time : float
        [s].
    """

    input: np.ndarray
    output: np.ndarray
    sample_time: float

    def without_largest(self) -> Repeated:
        """The same with the mean over the periods in that part of all of them in which what does not repeat is largest.

        Returns
        -------
        Repeated
            Nothing is left there beside the mean: an eighth of the period (`EVENT`), where u and y together, by the
            product of their squares, differ most between the periods.
        """
        size = self.input.shape[1]
        means = [c.mean(axis=0) for c in (self.input, self.output)]
        squares = [((c - m)**2).sum(axis=0) for c, m in zip((self.input, self.output), means, strict=True)]
        width = max(size // EVENT, 1)
        sums = [np.convolve(np.concatenate([q, q[:width - 1]]), np.ones(width), "valid") for q in squares]
        there = (int(np.argmax(sums[0] * sums[1])) + np.arange(width)) % size
        found = [c.copy() for c in (self.input, self.output)]
        for channel, mean in zip(found, means, strict=True):
            channel[:, there] = mean[there]
        return Repeated(found[0], found[1], self.sample_time)


@dataclass(frozen=True)
class InputFollows:
    """Whether the input follows the output in what does not repeat.

    Attributes
    ----------
    score, own_score : float
        z of `input_follows`: how much more the input follows the output than the other way round; the same with the
        phase of the response to the excitation taken off.
    critical : float
        What both must exceed.
    lag : float
        At which the input follows most [s].
    coherence : float
        Mean over the frequencies of the excitation's band, without its bias.
    periods : int
    """

    score: float
    own_score: float
    critical: float
    lag: float
    coherence: float
    periods: int

    @property
    def found(self) -> bool:
        """Whether there is feedback."""
        return min(self.score, self.own_score) > self.critical


def repeated(views: Sequence[View], source: str, answer: str) -> list[Repeated]:
    """Whole periods within each record, and records in which the input is the same from the first sample on.

    The period is a whole number of samples: the first period and the last fit each other best without a shift. Where
    the excitation runs on a clock of its own, what is left beside the mean of the periods is excitation too.

    Parameters
    ----------
    views : sequence of View
    source, answer : str
        Input and output, by channel or role.

    Returns
    -------
    list of Repeated
        Empty where nothing repeats.
    """
    found, others = [], []
    for v in views:
        if v.period is None or not (v.record.has(source) and v.record.has(answer)):
            continue
        names = v.record.resolve(source), v.record.resolve(answer)
        run = v.run(*names) if set(names) <= set(v.usable) else None
        if run is None or not (np.ptp(run[0]) > 0 and np.ptp(run[1]) > 0):
            continue
        size = _period(run[0], v.period)
        if size:
            whole = run[0].size // size * size
            u, y = (c[:whole].reshape(-1, size) for c in run)
            found.append(Repeated(u, y, v.period))
        else:
            others.append((run, v.period))
    while others:
        (u, y), period = others.pop(0)
        alike = [o for o in others if o[0][0].size == u.size and abs(o[1] / period - 1) < 1e-6 and _alike(u, o[0][0])]
        if alike:
            found.append(Repeated(np.vstack([u, *(o[0][0] for o in alike)]), np.vstack([y, *(o[0][1] for o in alike)]),
                                  period))
            others = [o for o in others if not any(o is a for a in alike)]
    return found


def _period(u: np.ndarray, sample_time: float) -> int:
    """Samples after which a signal repeats itself throughout; 0 where it does not."""
    level = MOST_OF_IT / 64
    while level <= MOST_OF_IT:  # of lags that fit about as well the smallest: the others are its multiples
        repetition = repetition_period(u, sample_time, tolerance=level)
        if repetition is not None:
            size = round(repetition.seconds / sample_time * (2 if repetition.sign < 0 else 1))
            last = (u.size // size - 1) * size
            return size if last > 0 and _alike(u[:size], u, last) else 0
        level *= 2
    return 0


def _alike(a: np.ndarray, b: np.ndarray, at: int = 0) -> bool:
    """Whether `b` has `a` at this sample, and not better one sample earlier or later."""
    def apart(shift: int) -> float:
        low, high = max(0, -at - shift), min(a.size, b.size - at - shift)
        x, y = a[low:high], b[at + shift + low:at + shift + high]
        power = float(np.var(x) + np.var(y))
        return float(np.var(x - y)) / power if power > 0 else np.inf
    here = apart(0)
    return here < MOST_OF_IT**2 and here <= min(apart(-1), apart(1))


def input_follows(repeats: Sequence[Repeated], false_alarm: float = FALSE_ALARM) -> InputFollows | None:
    """Test of feedback on what does not repeat.

    Every period has the same excitation, so that u and y less their means over the periods are made by disturbance
    alone, whatever the nonlinearity::

        v ─────────────► + ─► y          X(f) = U(f) Y*(f)/√(S_u S_y)
        r ─► + ─► u ─► G ┘               R(τ) = Re Σ X(f) e^{j2πfτ},  of u later than y by τ
             └──── −C ◄──────┘           T = Σ_{τ=1…m} (R²(τ) − R²(−τ))/4 = Σ_f H(f) Im X(f)
                                         H(f) = −Σ_τ s(τ) sin 2πfτ,  s(τ) = Σ_f Re X(f) cos 2πfτ

    Feedback makes u follow y: X has the phase of −C*, and R is larger at τ > 0. No feedback has one of these causes,
    for which R(−τ) is as large as R(τ), or larger:

    - u and y have nothing in common: the phase of X is any;
    - both sensors read the same interference, of any spectrum, at one instant: X is real but for noise;
    - u really moves otherwise in each period, and y answers by G: X has the phase of G*. Where y lags this is larger
      at τ < 0; where y leads (force over displacement) it is not. So the phase of the response to the excitation,
      G₀ = Y₀/U₀ of the means, is taken off too: X G₀/\\|G₀\\| is real but for noise, whatever noise is read.

    In each the signs of Im X at different frequencies are independent and even, given Re X and \\|Im X\\| (a Gaussian
    process that is real in this sense is the same backward in time). A single event, such as a jolt that reaches u
    after y, is no such process: its phase is smooth over the frequencies. `fed_back` asks for the same without the part
    of the periods that differs most. Then z = T/√Σ H² (Im X)², a sum of random signs over its rms, exceeds c with
    probability exp(−c²/2) at most, for any number of frequencies (Hoeffding 1963), so that c = √(2 ln(1/α)). Both z,
    with and without the phase of G₀, must exceed c, whose size is then α at most without a correction for two tests
    (Berger 1982, intersection-union). Not distinguishable from interference, so that nothing is found, is a u fed
    back in phase without any lag; nor is anything found where most of what does not repeat in u is not fed back.

    Frequencies are those between the first line and the last at which both means stand above their noise, exponential
    of mean S/k for k periods, at α over the number of lines. S_u and S_y, averaged over `BESIDE` lines to either side,
    give frequencies of little power as much weight as others (smoothed coherence transform, Carter, Nuttall & Cable
    1973); they are real, so that the phases stay.

    Parameters
    ----------
    repeats : sequence of Repeated
    false_alarm : float
        α.

    Returns
    -------
    InputFollows or None
        None where nothing can be compared, as where the input is the same in every period to the last digit.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> r, v = np.tile(rng.standard_normal(500), 8), rng.standard_normal(4000)
    >>> def run(gain):
    ...     u, y = r.copy(), np.zeros(4000)
    ...     for k in range(1, 4000):
    ...         u[k] = r[k] - gain * y[k - 1]
    ...         y[k] = 0.7 * y[k - 1] + u[k - 1] + v[k]
    ...     return input_follows([Repeated(u.reshape(8, -1), y.reshape(8, -1), 0.01)])
    >>> found = run(0.3)
    >>> found.found, found.lag
    (True, 0.01)
    >>> run(0.0) is None
    True
    """
    sums = np.zeros(4)
    shared = lines = 0.0
    best: tuple[float, float] = (-np.inf, 0.0)
    for one in repeats:
        spectrum = _apart(one, false_alarm)
        if spectrum is None:
            continue
        cross, phase, coherence = spectrum
        inside = np.flatnonzero(cross)
        lags = min(one.input.shape[1] // 2, inside.size // SHARE)
        for k, x in enumerate((cross, cross * phase)):
            course = np.fft.irfft(np.real(x), one.input.size)
            course[0], course[lags + 1:] = 0.0, 0.0
            odd = (np.imag(np.fft.rfft(course)) * np.imag(x))[inside]
            sums[2 * k:2 * k + 2] += odd.sum(), (odd**2).sum()
        later = np.abs(np.fft.irfft(cross, one.input.size)[1:lags + 1])
        top = int(np.argmax(later))
        best = max(best, (float(later[top]) / np.sqrt(inside.size), (top + 1) * one.sample_time))
        shared, lines = shared + coherence * inside.size, lines + inside.size
    if not (lines and sums[1] > 0 and sums[3] > 0):
        return None
    return InputFollows(float(sums[0] / np.sqrt(sums[1])), float(sums[2] / np.sqrt(sums[3])),
                        float(np.sqrt(-2 * np.log(false_alarm))), best[1], shared / lines,
                        sum(len(one.input) for one in repeats))


def _apart(one: Repeated, false_alarm: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    """X over all frequencies (0 outside of the band), phase of G₀ there, and the mean coherence."""
    from scipy.ndimage import uniform_filter1d

    count, size = one.input.shape
    if count < 2:
        return None
    both = [_level(c) for c in (one.input, one.output)]
    means = [c.mean(axis=0) for c in both]
    rests = [(c - m).ravel() for c, m in zip(both, means, strict=True)]
    if any(np.std(r) <= 1e-12 * float(np.abs(c).max()) for r, c in zip(rests, both, strict=True)):
        return None  # rounding
    u, y = (np.fft.rfft(r) for r in rests)
    place = np.arange(u.size)
    between = place % count != 0  # of the means nothing is left there
    width = 2 * BESIDE * count + 1
    kept = np.maximum(uniform_filter1d(between.astype(float), width), 1 / width)
    powers = [np.maximum(uniform_filter1d(np.where(between, np.abs(c)**2, 0.0), width) / kept, 1e-300) for c in (u, y)]
    lines = np.arange(1, (size - 1) // 2 + 1)
    if not lines.size:
        return None
    at, over = lines * count, -np.log(false_alarm / lines.size)
    first = [count * np.fft.rfft(m)[lines] for m in means]
    excited = np.all([np.abs(f)**2 > over * p[at] for f, p in zip(first, powers, strict=True)], axis=0)
    if not excited.any():
        return None
    gain = first[1][excited] / first[0][excited]
    gain /= np.abs(gain)
    at = at[excited]
    band = between & (place > at[0] - count) & (place < at[-1] + count)
    if band.sum() < FEWEST:
        return None
    phase = np.interp(place, at, gain.real) + 1j * np.interp(place, at, gain.imag)
    phase /= np.maximum(np.abs(phase), 1e-300)
    cross = np.where(band, u * y.conj() / np.sqrt(powers[0] * powers[1]), 0.0)
    smooth = uniform_filter1d(np.real(cross), width) + 1j * uniform_filter1d(np.imag(cross), width)
    averaged = (np.abs(smooth) / kept)**2
    bias = 1 / (width * kept)
    return cross, phase, max(0.0, float(np.mean(((averaged - bias) / (1 - bias))[band])))


def _level(values: np.ndarray) -> np.ndarray:
    """Periods without the drift of their means: a line through the samples would tilt an exact repetition."""
    count, size = values.shape
    middles = np.arange(count) - (count - 1) / 2
    slope = float(middles @ values.mean(axis=1)) / float(middles @ middles)
    within = (np.arange(size) - (size - 1) / 2) / size
    return values - values.mean() - slope * (middles[:, None] + within)


def fed_back(repeats: Sequence[Repeated], false_alarm: float = FALSE_ALARM) -> InputFollows | None:
    """The test of feedback, where it finds some with every part of the periods and without the most different one.

    Parameters
    ----------
    repeats : sequence of Repeated
    false_alarm : float
        α.

    Returns
    -------
    InputFollows or None
        With every part; None where no feedback is found.
    """
    found = input_follows(repeats, false_alarm)
    if found is None or not found.found:
        return None
    fewer = input_follows([one.without_largest() for one in repeats], false_alarm)
    return found if fewer is not None and fewer.found else None


def feedback(views: Sequence[View], inputs: Sequence[str], outputs: Sequence[str]) -> Iterator[Finding]:
    """Inputs that follow an output in what does not repeat: data in closed loop.

    There is no finding where no excitation repeats, for there the error of a model is not
    distinguishable from a disturbance; nor of a displacement and its velocity, which kinematics joins.

    Parameters
    ----------
    views : sequence of View
        The data set.
    inputs, outputs : sequence of str
        Of the model, by channel or role.

    Yields
    ------
    Finding
        ``feedback``, a warning; its value is the lower of both scores.
    """
    pairs = [(u, y) for u in inputs for y in outputs if len(one_per_motion(views, (u, y))) == 2 and u != y]
    for source, answer in pairs:
        found = fed_back(repeated(views, source, answer), FALSE_ALARM / len(pairs))
        if found is None:
            continue
        yield Finding(
            "feedback", views[0].name if len(views) == 1 else "", source, "warning",
            f"follows {answer} (most after {found.lag:.3g} s, mean coherence {found.coherence:.2g}) in what does not "
            f"repeat over {found.periods} periods of the excitation: score {min(found.score, found.own_score):.3g}, "
            f"critical {found.critical:.3g}. The data are from a closed loop: what fits the free run (oe, riv, pem-ss) "
            "is biased by the disturbance, and so is least squares (arx) unless the disturbance is of its form",
            "run bj or armax, whose noise model must be rich enough here; or use the mean over the periods, whose "
            "disturbance falls with their number; or record the loop's reference and identify reference to output "
            "and reference to input, whose ratio is the plant", min(found.score, found.own_score))
