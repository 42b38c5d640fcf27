"""Road profiles as a vehicle at constant speed meets them: Wong's power laws, ISO 8608, measured tracks.

Elevation over time, one-sided spectra in time frequency f = nV. A profile is either a sum of cosines (exact spectrum
in a band) or the output of a first-order shaping filter (white velocity above its cut-off, any length).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lpvid.errors import InputError
from lpvid.excitation import random_phase
from lpvid.toolkit import checks

MILES_PER_HOUR = 0.44704
REFERENCE_WAVENUMBER = 0.1
"""n_0 of ISO 8608 [cycles/m]."""


@dataclass(frozen=True)
class Roughness:
    """Power-law road: G(n) = coefficient · n^(−exponent), n in cycles/m.

    Attributes
    ----------
    coefficient : float
        C [m²/(cycle/m)] at n = 1 cycle/m.
    exponent : float
        N, waviness.
    """

    coefficient: float
    exponent: float

    def psd(self, frequency: np.ndarray, speed: float) -> np.ndarray:
        """One-sided elevation spectrum S(f) = (1/V)·C·(f/V)^(−N) [m²/Hz] (Díaz Salas 2011, eq. 4.2; Wong).

        Parameters
        ----------
        frequency : (n,) array
            f, positive [Hz].
        speed : float
            V [m/s].

        Returns
        -------
        (n,) array
            [m²/Hz].
        """
        return self.coefficient * (np.asarray(frequency, dtype=float) / speed) ** -self.exponent / speed


WONG: dict[str, Roughness] = {
    "smooth-runway": Roughness(4.3e-11, 3.8),
    "rough-runway": Roughness(8.1e-6, 2.1),
    "smooth-highway": Roughness(4.8e-7, 2.1),
    "highway-with-gravel": Roughness(4.4e-6, 2.1),
    "pasture": Roughness(3.0e-4, 1.6),
    "ploughed-field": Roughness(6.5e-4, 1.6),
}
"""Surfaces after Wong, *Theory of Ground Vehicles*."""

ISO_CLASSES: dict[str, float] = {letter: 16e-6 * 4.0**k for k, letter in enumerate("ABCDEFGH")}
"""Geometric mean G_d(n_0) [m³] of each class of ISO 8608."""

SURFACES: tuple[str, ...] = (*WONG, *(f"iso-{letter.lower()}" for letter in ISO_CLASSES))
"""Names that `surface` takes."""


def surface(name: str) -> Roughness:
    """A road by name: one of Wong's surfaces, or ``"iso-a"`` … ``"iso-h"`` (waviness 2).

    Parameters
    ----------
    name : str
        One of `SURFACES`.

    Returns
    -------
    Roughness
        Of an ISO class the geometric mean.

    Examples
    --------
    >>> surface("iso-b").psd(np.array([1.0]), 10.0)
    array([6.4e-06])
    """
    checks.known_name(name, SURFACES, "road surface")
    return WONG[name] if name in WONG else iso_roughness(name.removeprefix("iso-"))


def iso_roughness(road_class: str, waviness: float = 2.0) -> Roughness:
    """Power law of an ISO 8608 class: G_d(n) = G_d(n_0)(n/n_0)^(−w), n_0 = 0.1 cycles/m.

    Parameters
    ----------
    road_class : str
        ``"A"`` … ``"H"``; the class's geometric mean is taken.
    waviness : float
        w, 2 in the standard.

    Returns
    -------
    Roughness

    Raises
    ------
    InputError
        A class that does not exist.

    Examples
    --------
    >>> round(iso_roughness("C").coefficient * 0.1**-2.0 * 1e6, 6)
    256.0
    """
    letter = checks.known_name(road_class.upper(), list(ISO_CLASSES), "ISO 8608 class")
    return Roughness(ISO_CLASSES[letter] * REFERENCE_WAVENUMBER**waviness, waviness)


def profile(samples: int, rate: float, roughness: Roughness, *, speed: float, rng: np.random.Generator | int,
            f_min: float = 0.5, f_max: float = 20.5, lines: int = 100, incommensurate: bool = True) -> np.ndarray:
    """Elevation over time as a sum of cosines with the road's spectrum inside a frequency band.

    Parameters
    ----------
    samples : int
        Length of the profile.
    rate : float
        Sampling rate [Hz].
    roughness : Roughness
        The road; `surface` looks one up by name.
    speed : float
        Vehicle speed V [m/s].
    rng : numpy.random.Generator or int
        Draws phases and lines.
    f_min, f_max : float
        Band [Hz].
    lines : int
        Number of cosines.
    incommensurate : bool
        False puts the lines at f_min + jΔf, which repeats after 2/Δf at the latest (see `lpvid.excitation`).

    Returns
    -------
    (samples,) array
        Elevation [m].

    Raises
    ------
    InputError
        A speed or band that is not positive.

    Examples
    --------
    >>> z = profile(15360, 512.0, WONG["smooth-highway"], speed=25 * MILES_PER_HOUR, rng=np.random.default_rng(2))
    >>> bool(3.2e-3 < z.std() < 4.2e-3)
    True
    """
    speed = checks.positive(speed, "speed", "m/s")
    return random_phase(samples, rate, lambda f: roughness.psd(f, speed), f_min=f_min, f_max=f_max, lines=lines,
                        rng=rng, incommensurate=incommensurate)


def iso8608(samples: int, rate: float, road_class: str, *, speed: float, rng: np.random.Generator | int,
            cutoff: float = 0.01) -> np.ndarray:
    """Elevation over time by the first-order shaping filter, discretised exactly and started in steady state.

    ż = −2πn_00 V z + 2πn_0 √(G_d(n_0)V) w(t), w of one-sided spectrum 1/Hz (autocorrelation ½δ). Exact steps:
    z⁺ = a z + s g, a = exp(−2πn_00 VΔt), s² = σ²(1 − a²), σ² = πn_0²G_d/(2n_00), g ~ N(0, 1).

    Parameters
    ----------
    samples : int
        Length of the profile.
    rate : float
        Sampling rate [Hz].
    road_class : str
        ``"A"`` … ``"H"`` of ISO 8608.
    speed : float
        Vehicle speed V [m/s].
    rng : numpy.random.Generator or int
    cutoff : float
        n_00 [cycles/m], below which the spectrum is flat.

    Returns
    -------
    (samples,) array
        Elevation [m].

    Raises
    ------
    InputError
        An unknown class, a speed or cut-off that is not positive.

    Examples
    --------
    >>> iso8608(3, 1000.0, "B", speed=20.0, rng=0).shape
    (3,)
    """
    samples, rng = checks.count(samples, "samples", at_least=1), checks.generator(rng)
    speed, cutoff = checks.positive(speed, "speed", "m/s"), checks.positive(cutoff, "cutoff", "cycles/m")
    level = ISO_CLASSES[checks.known_name(road_class.upper(), list(ISO_CLASSES), "ISO 8608 class")]
    a = np.exp(-2 * np.pi * cutoff * speed / checks.positive(rate, "rate", "Hz"))
    spread = np.sqrt(np.pi * REFERENCE_WAVENUMBER**2 * level / (2 * cutoff))
    drive = spread * np.sqrt(1 - a**2) * rng.standard_normal(samples)
    drive[0] = spread * rng.standard_normal()
    return _first_order(drive, float(a))


def _first_order(drive: np.ndarray, a: float) -> np.ndarray:
    """z(k) = a z(k−1) + drive(k), one block at a time so that a^(−k) stays in range."""
    out = np.empty_like(drive)
    block = max(1, min(drive.size, int(20.0 / max(-np.log(a), 1e-9)), 65536))
    last = 0.0
    for start in range(0, drive.size, block):
        part = drive[start : start + block]
        powers = a ** np.arange(1, part.size + 1)
        out[start : start + part.size] = powers * (last + np.cumsum(part / powers))
        last = out[start + part.size - 1]
    return out


@dataclass(frozen=True, eq=False)
class Track:
    """A measured profile: elevation over distance, linear in between.

    Attributes
    ----------
    distance, elevation : (n,) arrays
        From the start, rising; from the first elevation [m].
    name : str

    Examples
    --------
    >>> Track(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.01, 0.0])).over_time(10.0, 0.05).round(4).tolist()
    [0.0, 0.005, 0.01, 0.005, 0.0]
    """

    distance: np.ndarray
    elevation: np.ndarray
    name: str = ""

    def __post_init__(self) -> None:
        for field in ("distance", "elevation"):
            array = checks.frozen_array(getattr(self, field), field, ndim=1)
            object.__setattr__(self, field, checks.finite(array, field))
        if self.distance.shape != self.elevation.shape or self.distance.size < 2:
            raise InputError("a measured road needs two or more distances with one elevation each",
                             got=f"{self.distance.size} distances, {self.elevation.size} elevations")
        back = np.flatnonzero(np.diff(self.distance) <= 0)
        if back.size:
            before, after = self.distance[back[0]:back[0] + 2]
            raise InputError("a measured road needs rising distances", got=f"{after:.6g} m after {before:.6g} m",
                             mend="sort the rows by distance and leave repeated ones out")

    @property
    def length(self) -> float:
        """[m]."""
        return float(self.distance[-1] - self.distance[0])

    def over_time(self, speed: float, sample_time: float, laps: int = 1) -> np.ndarray:
        """(samples,) elevation as a point contact at constant speed meets it [m].

        Parameters
        ----------
        speed : float
            [m/s].
        sample_time : float
            [s].
        laps : int
            How often the track is driven; beyond the first each runs backwards or forwards in turn, without a step.

        Returns
        -------
        (samples,) array
            At the samples from the start of the track to the last one within the laps.
        """
        step = checks.positive(speed, "speed", "m/s") * checks.positive(sample_time, "sample_time", "s")
        laps = checks.count(laps, "laps", at_least=1)
        along = step * np.arange(int(np.floor(laps * self.length / step + 1e-9)) + 1)
        folded = self.length - np.abs(np.mod(along, 2 * self.length) - self.length)
        return np.interp(folded + self.distance[0], self.distance, self.elevation)


def measured(path: str | Path, track: int | str | None = None) -> Track:
    """A measured profile from a file that `lpvid.read` reads, with a distance and one or more height columns.

    Parameters
    ----------
    path : str or Path
        Any format; units as in its header.
    track : int or str, optional
        Which height column, by its place or name; needed where there are several.

    Returns
    -------
    Track
        Elevation from its value at the start.

    Raises
    ------
    InputError
        No such file, no distance, no such track, several tracks of which none is named, samples that are missing.
    """
    import lpvid

    record = lpvid.read(path, sample_rate=1.0)[0]
    if not record.has("distance"):
        raise InputError(f"{path}: a measured road needs a column 'distance [m]'", got=", ".join(record.channels))
    heights = [name for name in record.channels if name != "distance"]
    if track is None and len(heights) > 1:
        raise InputError(f"{path} holds {len(heights)} tracks", got=", ".join(heights),
                         mend=f"name one: --road {Path(path).name}#{heights[0]}@SPEED, or track = \"{heights[0]}\" in "
                         "CONFIG")
    if isinstance(track := 0 if track is None else track, int):
        if not 0 <= track < len(heights):
            raise InputError(f"{path}: no track number {track + 1}", got=", ".join(heights))
        track = heights[track]
    name = checks.known_name(track, heights, "track")
    for channel in ("distance", name):
        unit, values = record.channel(channel).unit, np.asarray(record[channel])
        if unit != "m":
            raise InputError(f"{path}: '{channel}' is not a length", got=unit or "no unit",
                             mend=f"state its unit in the header: '{channel} [mm]', for instance")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(f"{path}: '{channel}' is not finite", got=f"{values[bad[0]]} in sample {bad[0] + 1}, "
                             f"{bad.size} in all", mend="fill the gap or cut the track there")
    height = np.asarray(record[name])
    return Track(np.asarray(record["distance"]), height - height[0], name)
