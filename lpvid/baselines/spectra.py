"""Spectra: channels before a low-pass of the recording, after a further one, and differentiated without noise."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.condition.band_limited import in_band, jumps, share_of_motion
from lpvid.condition.continuation import Continued
from lpvid.condition.interference import (
    ABOVE,
    FEWEST,
    SHORT,
    interference,
    is_flat,
    power_of,
    power_of_all,
    stretch_samples,
    top_of,
)
from lpvid.rounding import EPS

LASTING = -math.log(EPS)
"""length of the transient of a low-pass, in time constants: until it is rounding"""
RATES = {"velocity": ("displacement",), "acceleration": ("displacement", "velocity")}
"""channels from which another one may have been derived"""
COHERENT = 0.5
"""coherence with the noise of another channel above which a channel was derived from that"""


def before_filter(s: Signals, channel: str, factors: tuple[float, ...], finer: int = 1) -> np.ndarray:
    """(n finer,) a channel before the low-pass with the inverse 1 + Σ_k c_k sᵏ, c from k = 1 on.

    x + Σ_k c_k dᵏx/dtᵏ, differentiated in the frequency domain with Wiener's weight (S − 2N)₊/S: S is the power, N the
    sensor's noise (the level at the top of the spectrum), doubled for safety. Where the weight is small, the inverse
    would amplify little but noise. The ends are continued by linear prediction. On a clock `finer` times as fast the
    channel is band-limited between its samples. A channel of few samples is unchanged.

    Parameters
    ----------
    s : Signals
    channel : str
        Role.
    factors : tuple of float
        c_k [s^k].
    finer : int

    Returns
    -------
    (n finer,) array
        In the unit of the channel; of fewer than `SHORT` samples each is repeated.
    """
    return _weighed(s, channel, lambda omega, share: 1 + share * sum(c * (1j * omega) ** (k + 1)
                                                                     for k, c in enumerate(factors)), finer)


def derivative(s: Signals, channel: str) -> np.ndarray:
    """(n,) rate of change of a channel, limited to the band of its motion to exclude its sensor's noise.

    By `lpvid.condition.band_limited.in_band`; by central differences where the channel jumps or has few samples.

    Parameters
    ----------
    s : Signals
    channel : str
        Role.

    Returns
    -------
    (n,) array
        In the unit of the channel over a second.
    """
    values = s[channel]
    if not has_band(s, channel):
        return np.gradient(values, s.sample_time)
    at, interfering = s.fact(channel, "interference", lambda x: interference(x, s.output, s.sample_time, s.finer)
                             if channel == "displacement" else (np.zeros(1), np.zeros(1, dtype=bool)))
    return in_band(values, *_spectrum_and_share(s, channel), at, interfering)


def has_band(s: Signals, channel: str) -> bool:
    """Whether the band of a channel's motion can be determined: it does not jump and has enough samples.

    Parameters
    ----------
    s : Signals
    channel : str
        Role.

    Returns
    -------
    bool
    """
    return s[channel].size >= FEWEST * SHORT and not jumps(s[channel])


def low_passed(x: np.ndarray, sample_time: float, t: float, zeta: float) -> np.ndarray:
    """(n,) x filtered by 1/(1 + 2ζTs + T²s²) in the frequency domain, its ends continued by odd reflection.

    Parameters
    ----------
    x : (n,) array
    sample_time : float
        [s].
    t : float
        T [s].
    zeta : float
        Damping ratio ζ.

    Returns
    -------
    (n,) array
        In the unit of x.
    """
    signal = Continued.reflected(x, sample_time, LASTING * t)
    s = 1j * signal.omega
    return signal.back(signal.spectrum / (1 + 2 * zeta * t * s + (t * s) ** 2))


def _weighed(s: Signals, channel: str, weights: Callable[[np.ndarray, np.ndarray], np.ndarray],
             finer: int = 1) -> np.ndarray:
    """(n finer,) a channel, its spectrum times weights(ω, share of motion); one of few samples is unchanged."""
    if s[channel].size < SHORT:
        return np.repeat(s[channel], finer)
    signal, share = _spectrum_and_share(s, channel)
    return signal.back(signal.spectrum * weights(signal.omega, share), finer)


def _spectrum_and_share(s: Signals, channel: str) -> tuple[Continued, np.ndarray]:
    """Spectrum of a channel continued at both ends, and the share of motion at each frequency; computed once.

    A channel derived from another one has the share of that one: differentiation amplifies motion and noise alike, so
    that its noise rises with frequency instead of being a level at the top of the spectrum.
    """
    signal = s.fact(channel, "spectrum", lambda x: Continued.predicted(x, s.sample_time))

    def find(x: np.ndarray) -> np.ndarray:
        if (channel, "made of") in s.facts:
            before, share = _spectrum_and_share(s.facts[channel, "made of"], channel)
            return share if before.omega.size == signal.omega.size else \
                np.interp(signal.omega, before.omega, share, right=0.0)
        source = next((r for r in RATES.get(channel, ()) if s.has(r) and _derived(s, channel, r)), None)
        return share_of_motion(signal.omega, _recorded(s, channel), s.sample_time, s.finer) if source is None else \
            _spectrum_and_share(s, source)[1]

    return signal, s.fact(channel, "share", find)


def _recorded(s: Signals, channel: str) -> list[np.ndarray]:
    """A channel along every whole record of the diagnosis; where it is not that of a record, along these signals.

    Stretches of records that are cut together have kinks between them, which have more power at high frequencies than
    a motion and its sensor's noise have.
    """
    return [r[channel] for r in (s.as_recorded(channel) if s.stretches else (s,))]


def weighed_alike(s: Signals, like: Signals) -> Signals:
    """The signals, with the share of motion of each channel that of the signals from which they were computed.

    A delayed channel, or one before a filter, has its noise at the same frequencies as the original, also on a faster
    clock. From a channel whose noise was removed the share cannot be estimated: it would be one at every frequency, and
    a filter would be inverted where there is no motion.

    Parameters
    ----------
    s : Signals
        Changed in place: the source of each channel is stored in `facts`.
    like : Signals
        From which they were computed; a channel that is the same array is left out.

    Returns
    -------
    Signals
        `s` itself.
    """
    for channel, values in s.channels.items():
        if values is not like.channels.get(channel):
            s.facts[channel, "made of"] = like
    return s


def noisier(s: Signals, rng: np.random.Generator) -> Signals:
    """The signals with further noise of the level of the motion's sensors; the shares of motion stay.

    White, at the level at the top of each spectrum; for a channel derived from another one, the noise of that one
    differentiated.

    Parameters
    ----------
    s : Signals
    rng : numpy.random.Generator

    Returns
    -------
    Signals
    """
    added: dict[str, np.ndarray] = {}
    for channel in dict.fromkeys([r for sources in RATES.values() for r in sources] + list(RATES)):
        if s.has(channel) and s[channel].size >= SHORT:
            source = next((r for r in RATES.get(channel, ()) if r in added and _derived(s, channel, r)), None)
            level = power_of_all(_recorded(s, channel), s.sample_time, s.finer)[2]
            added[channel] = np.gradient(added[source], s.sample_time) if source else \
                np.sqrt(level / (2 * s.sample_time * s.finer)) * rng.standard_normal(s.n_samples)
    return weighed_alike(s.replace(**{c: s[c] + n for c, n in added.items()}), s)


def _derived(s: Signals, channel: str, source: str) -> bool:
    """Whether a channel is coherent with the noise of another one's sensor, and so was computed from that channel.

    At frequencies where the spectrum of the other channel is flat (`is_flat`), as its sensor's noise is, two channels
    of separate sensors are not coherent. The criterion is their mean coherence there, weighted with the power of the
    channel, which smoothing may have reduced.
    """
    from scipy.signal import coherence, welch

    if s[source].size < SHORT:
        return False
    if s.stretches and all(s.as_recorded(c)[0] is not s for c in (channel, source)):
        return _derived(max(s.as_recorded(source), key=lambda r: r.n_samples), channel, source)
    at, power, noise = power_of(s[source], s.sample_time, s.finer)
    if not is_flat(top_of(at, power, s.finer)):  # also a record of few samples, or on a slow clock
        return False
    size = stretch_samples(s[source].size, s.sample_time)
    common = coherence(s[source], s[channel], 1 / s.sample_time, nperseg=size)[1]
    weight = welch(s[channel], 1 / s.sample_time, nperseg=size)[1] * (power < ABOVE * noise) * (at <= at[-1] / s.finer)
    return float(common @ weight) > COHERENT * float(weight.sum()) > 0
