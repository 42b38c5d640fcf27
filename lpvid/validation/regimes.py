"""Where a free run is wrong: by sign of the input, by level of the scheduling, by frequency band, at single lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lpvid.codec import Encoded
from lpvid.validation.spectral_lines import spectral_lines
from lpvid.validation.trust import LEVEL

THINNED = 100_000
"""samples from which levels of the scheduling are found."""
CHUNK = 65_536
"""samples worked on at once."""
BANDS = 5
"""frequency bands, equal on a logarithmic scale up to half the sampling rate; the lowest begins at 0 Hz."""
LOWEST_PERIOD = 1024
"""samples of the period from which the logarithmic scale starts (of the longest stretch, where that is shorter): each
band spans a factor 3.5."""
SHORTEST = 64
"""samples of the longest stretch below which there are no bands: each would hold a handful of frequencies."""
LEVELS = 3
"""groups of scheduling values with equal numbers of samples, where there are more distinct values than this."""


@dataclass(frozen=True)
class Regime(Encoded):
    """Free-run error in one part of the data.

    Attributes
    ----------
    where : str
        E.g. "velocity < 0", "0.8 A <= current", "2.1 to 9.4 Hz", "a line at 50 Hz that no input has".
    share : float
        Share of the samples (of the measured power, for a frequency band or a line).
    error_share : float
        Share of the squared error.
    esr : float or None
        Squared error over the measured squared deviation from its record's mean, in this part alone; None where the
        output does not move there.
    """

    where: str
    share: float
    error_share: float
    esr: float | None


@dataclass(frozen=True, eq=False)
class FreeRunStretch:
    """One record's free run, cut to the samples that count.

    Attributes
    ----------
    measured, model : (n,) arrays
        First output.
    input : (n,) array or None
        First measured input.
    scheduling : (n, n_scheduling) array
    further : (n, k) array, optional
        Further inputs, which may drive a line.
    """

    measured: np.ndarray
    model: np.ndarray
    input: np.ndarray | None
    scheduling: np.ndarray
    further: np.ndarray | None = None


def regimes(stretches: Sequence[FreeRunStretch], input_name: str, scheduling: Sequence[tuple[str, str]],
            sample_time: float) -> tuple[Regime, ...]:
    """Split the free-run error by input sign, scheduling level and frequency, and find lines in its spectrum.

    Parameters
    ----------
    stretches : sequence of FreeRunStretch
    input_name : str
    scheduling : sequence of (name, unit)
    sample_time : float
        Period [s].

    Returns
    -------
    tuple of Regime
    """
    if not stretches:
        return ()
    sorters = _sorters(stretches, input_name, scheduling)
    sums = [np.zeros((len(described), 3)) for described, _ in sorters]  # samples, squared error, squared deviation
    total, count = 0.0, 0
    for stretch, mean in _chunks(stretches):
        squared = (stretch.measured - stretch.model) ** 2
        power = (stretch.measured - mean) ** 2
        total, count = total + float(squared.sum()), count + squared.size
        for table, (described, group_of) in zip(sums, sorters, strict=True):
            group = group_of(stretch)
            for column, values in enumerate((np.ones(squared.size), squared, power)):
                table[:, column] += np.bincount(group, weights=values, minlength=len(described))
    every = total if total > 0 else 1.0
    found = [Regime(where, row[0] / count, row[1] / every, row[1] / row[2] if row[2] > 0 else None)
             for table, (described, _) in zip(sums, sorters, strict=True)
             for where, row in zip(described, table.tolist(), strict=True) if row[0] > 0]
    return (*found, *bands(stretches, sample_time), *lines(stretches, sample_time))


def _chunks(stretches: Sequence[FreeRunStretch]) -> Iterator[tuple[FreeRunStretch, float]]:
    """Pieces of stretches, each with its stretch's mean, so that no temporary is as long as a record."""
    for s in stretches:
        mean = float(s.measured.mean())
        for first in range(0, len(s.measured), CHUNK):
            part = slice(first, first + CHUNK)
            yield FreeRunStretch(s.measured[part], s.model[part], None if s.input is None else s.input[part],
                          s.scheduling[part], None if s.further is None else s.further[part]), mean


Sorter = tuple[list[str], Callable[[FreeRunStretch], np.ndarray]]
"""Names of some groups, and the group of every sample of a stretch."""


def _sorters(
    stretches: Sequence[FreeRunStretch], input_name: str, scheduling: Sequence[tuple[str, str]]
) -> list[Sorter]:
    sorters: list[Sorter] = []
    if all(s.input is not None for s in stretches):
        low = min(float(s.input.min()) for s in stretches)  # type: ignore[union-attr]
        high = max(float(s.input.max()) for s in stretches)  # type: ignore[union-attr]
        if low < 0 < high:
            sorters.append(([f"{input_name} < 0", f"{input_name} >= 0"],
                            lambda s: (s.input >= 0).astype(np.intp)))  # type: ignore[operator]
    step = max(1, sum(len(s.measured) for s in stretches) // THINNED)
    for column, (name, unit) in enumerate(scheduling):
        values = np.concatenate([s.scheduling[::step, column] for s in stretches])
        sorters += _levels(values, column, name, unit)
    return sorters


def _levels(values: np.ndarray, column: int, name: str, unit: str) -> list[Sorter]:
    """Each distinct value where there are few, groups of about equal size otherwise."""
    tag = f" {unit}" if unit else ""
    distinct = np.unique(np.round(values, 9))
    if distinct.size == 1:
        return []
    if distinct.size <= LEVELS:
        edges = 0.5 * (distinct[:-1] + distinct[1:])
        described = [f"{name} = {x:.4g}{tag}" for x in distinct]
    else:
        edges = np.unique(np.quantile(values, np.linspace(0, 1, LEVELS + 1)[1:-1]))
        edges = edges[(edges > values.min()) & (edges <= values.max())]
        if not edges.size:
            return []
        described = [
            f"{name} < {edges[0]:.4g}{tag}",
            *(f"{a:.4g} <= {name} < {b:.4g}{tag}" for a, b in pairwise(edges)),
            f"{edges[-1]:.4g}{tag} <= {name}",
        ]
    return [(described, lambda s: np.searchsorted(edges, s.scheduling[:, column], side="right"))]


def bands(stretches: Sequence[FreeRunStretch], sample_time: float) -> list[Regime]:
    """Power of error and of measurement by frequency, summed over stretches and over bands.

    Of orthonormal cosine transforms (DCT-II) of whole chunks, whose squares add up to those of the samples (Parseval):
    the shares of the bands add up to 1, and the lowest band holds the mean error. The coefficient k of n samples stands
    for the frequency k / (2 n T). A cosine transform continues a chunk by its mirror image, without a jump, so that
    less of what is slow leaks into higher bands than with a Fourier transform.

    Parameters
    ----------
    stretches : sequence of FreeRunStretch
    sample_time : float
        Period [s].

    Returns
    -------
    list of Regime
        None where the longest stretch has fewer samples than `SHORTEST`.
    """
    from scipy.fft import dct

    longest = max(len(s.measured) for s in stretches)
    if longest < SHORTEST:
        return []
    lowest, top = 1 / (min(LOWEST_PERIOD, longest) * sample_time), 0.5 / sample_time
    edges = np.geomspace(lowest, top, BANDS + 1)
    error, power = np.zeros(BANDS), np.zeros(BANDS)
    for stretch, mean in _chunks(stretches):
        n = len(stretch.measured)
        band = np.searchsorted(edges[1:-1], np.arange(n) / (2 * n * sample_time), side="right")
        for sums, values in ((error, stretch.measured - stretch.model), (power, stretch.measured - mean)):
            sums += np.bincount(band, weights=np.asarray(dct(values, norm="ortho")) ** 2, minlength=BANDS)
    whole = (float(error.sum()) or 1.0, float(power.sum()) or 1.0)
    edges[0] = 0.0
    return [Regime(f"{low:.3g} to {high:.3g} Hz", float(p) / whole[1], float(e) / whole[0],
                   float(e / p) if p > 0 else None)
            for (low, high), e, p in zip(pairwise(edges), error, power, strict=True)]


def lines(stretches: Sequence[FreeRunStretch], sample_time: float) -> list[Regime]:
    """Lines in the error that nothing of the motion has: `spectral_lines` of chunks, added up where they agree.

    A model without a line lacks all of it, so that its measured power there is that of its error.

    Parameters
    ----------
    stretches : sequence of FreeRunStretch
    sample_time : float
        Period [s].

    Returns
    -------
    list of Regime
        Those that hold a significant share of the squared error (`LEVEL`), the largest first.
    """
    found: list[tuple[float, float, float]] = []  # energy, frequency, resolution
    error, power = 0.0, 0.0
    for s, mean in _chunks(stretches):
        error += float(np.sum((s.measured - s.model) ** 2))
        power += float(np.sum((s.measured - mean) ** 2))
        driving = [s.model, *([] if s.input is None else [s.input]), *s.scheduling.T,
                   *([] if s.further is None else s.further.T)]
        found += [(x.power * s.measured.size, x.frequency, 1 / (s.measured.size * sample_time))
                  for x in spectral_lines(s.measured - s.model, driving, sample_time)]
    regimes = []
    while found:
        _, frequency, resolution = max(found)
        alike = [abs(f - frequency) <= max(r, resolution) for _, f, r in found]
        energy = sum(e for (e, _, _), same in zip(found, alike, strict=True) if same)
        if energy > (1 - LEVEL) * error:
            regimes.append(Regime(f"a line at {frequency:.4g} Hz that no input has", energy / (power or 1.0),
                                  min(energy / error, 1.0), 1.0))
        found = [x for x, same in zip(found, alike, strict=True) if not same]
    return regimes
