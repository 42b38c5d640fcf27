"""Where a free run is wrong: by sign of the input, by level of the scheduling, by frequency band."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

BANDS = 5
"""frequency bands, equal on a logarithmic scale."""
LEVELS = 3
"""groups of scheduling values with equal numbers of samples, where there are more distinct values than this."""


@dataclass(frozen=True)
class Regime:
    """Free-run error in one part of the data.

    Attributes
    ----------
    where : str
        E.g. "velocity < 0", "0.8 A <= current", "2.1 to 9.4 Hz".
    share : float
        Share of the samples (of the measured power, for a frequency band).
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

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"where": self.where, "share": self.share, "error_share": self.error_share, "esr": self.esr}


@dataclass(frozen=True, eq=False)
class Stretch:
    """One record's free run, cut to the samples that count.

    Attributes
    ----------
    measured, model : (n,) arrays
        First output.
    input : (n,) array or None
        First measured input.
    scheduling : (n, n_scheduling) array
    """

    measured: np.ndarray
    model: np.ndarray
    input: np.ndarray | None
    scheduling: np.ndarray


def regimes(stretches: Sequence[Stretch], input_name: str, scheduling: Sequence[tuple[str, str]],
            sample_time: float) -> tuple[Regime, ...]:
    """Split the free-run error by input sign, scheduling level and frequency.

    Parameters
    ----------
    stretches : sequence of Stretch
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
    deviation = np.concatenate([s.measured - s.measured.mean() for s in stretches])
    error = np.concatenate([s.measured - s.model for s in stretches])
    parts: list[tuple[str, np.ndarray]] = []
    if all(s.input is not None for s in stretches):
        u = np.concatenate([s.input for s in stretches])  # type: ignore[misc]
        if u.min() < 0 < u.max():
            parts += [(f"{input_name} < 0", u < 0), (f"{input_name} > 0", u > 0)]
    p = np.vstack([s.scheduling for s in stretches])
    for column, (name, unit) in enumerate(scheduling):
        parts += _levels(p[:, column], name, unit)
    found = [_regime(where, error[mask], deviation[mask], error, mask.mean()) for where, mask in parts if mask.any()]
    return (*found, *_bands(stretches, sample_time))


def _regime(where: str, error: np.ndarray, deviation: np.ndarray, every: np.ndarray, share: float) -> Regime:
    power, total = float(deviation @ deviation), float(every @ every)
    squared = float(error @ error)
    return Regime(where, float(share), squared / total if total > 0 else 0.0, squared / power if power > 0 else None)


def _levels(values: np.ndarray, name: str, unit: str) -> list[tuple[str, np.ndarray]]:
    """Each distinct value where there are few, groups of equal size otherwise."""
    tag = f" {unit}" if unit else ""
    distinct = np.unique(np.round(values, 9))
    if distinct.size == 1:
        return []
    if distinct.size <= LEVELS:
        return [(f"{name} = {x:.4g}{tag}", np.isclose(values, x, rtol=0, atol=1e-8)) for x in distinct]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, LEVELS + 1)[1:-1]))
    edges = edges[(edges > values.min()) & (edges <= values.max())]
    if not edges.size:
        return []
    told = [f"{name} < {edges[0]:.4g}{tag}",
            *(f"{a:.4g} <= {name} < {b:.4g}{tag}" for a, b in itertools.pairwise(edges)),
            f"{edges[-1]:.4g}{tag} <= {name}"]
    group = np.searchsorted(edges, values, side="right")
    return [(where, group == i) for i, where in enumerate(told)]


def _bands(stretches: Sequence[Stretch], sample_time: float) -> list[Regime]:
    """Welch spectra of error and measurement, summed over stretches and over bands."""
    from scipy.signal import welch

    long = [s for s in stretches if len(s.measured) >= 256]
    if not long:
        return []
    segment = min(1024, min(len(s.measured) for s in long))

    def spectrum(pick: Callable[[Stretch], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        total = np.zeros(segment // 2 + 1)
        frequency = total
        for s in long:
            frequency, density = welch(pick(s), fs=1 / sample_time, nperseg=segment, detrend="constant")
            total = total + density * len(s.measured)
        return frequency, total

    frequency, error = spectrum(lambda s: s.measured - s.model)
    _, power = spectrum(lambda s: s.measured)
    edges = np.geomspace(frequency[1], frequency[-1], BANDS + 1)
    edges[0], edges[-1] = 0.0, np.inf
    found = []
    for low, high in itertools.pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        if not inside.any() or not power[inside].sum() > 0:
            continue
        told = f"{low:.3g} to {min(high, frequency[-1]):.3g} Hz"
        share = float(error[inside].sum() / error.sum()) if error.sum() > 0 else 0.0
        found.append(Regime(told, float(power[inside].sum() / power.sum()), share,
                            float(error[inside].sum() / power[inside].sum())))
    return found
