"""What a ride does by frequency: power spectral densities, gains from the road, weighted acceleration by band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import BLUE, CYCLE, INK
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, plain_decades
from lpvid.units import quotient
from quartercar.criteria import comfort_weighting

if TYPE_CHECKING:
    from quartercar.vehicle.result import CarRun

SIGNALS: Mapping[str, tuple[str, str]] = {
    "body_acceleration": ("body acceleration", "m/s²"), "tyre_load": ("tyre force", "N"),
    "suspension_deflection": ("stroke", "m")}
BAND = (0.25, 50.0)
"""Frequencies shown [Hz]: those of ride and wheel hop."""
SEGMENT = 4.0
"""Length of a segment of the estimate [s]: a resolution of 0.25 Hz."""
SEGMENTS = 3
"""Segments (half overlapping) below which an average is no average, and nothing is drawn."""
SENSITIVE = 0.9
"""Share of the largest |W_k| above which a frequency counts as most felt by a seated person."""
FEWEST_POWER = 1e-6
"""Share of the road's largest density below which a gain is not drawn: rounding over rounding."""
LAWS = 6
PANELS = 8
"""Three densities, three gains, bands of comfort and their weighting."""


def spectra(runs: Sequence[tuple[str, CarRun]], settle: float = 0.0, ax: Ax = None) -> Drawn | None:
    """Densities and gains of body acceleration, tyre force and stroke, and third-octave bands of comfort.

    Densities S_yy by Welch's method (Hann, half overlapping); gains |S_ry|/S_rr from the elevation r of the road, the
    best linear description of the nonlinear car on this road (Pintelon & Schoukens 2012, 3.4); below 1 Hz the window
    leaks, as a road has most of its power there. Third-octave bands of
    the W_k-weighted acceleration: the square root of ∫|W_k|² S_aa over each (ISO 2631-1, 5.4 and annex A); the sum of
    their squares is the square of the weighted rms.

    Parameters
    ----------
    runs : sequence of (str, CarRun)
        Laws on the same road with the same seed.
    settle : float
        Start that is left out [s].
    ax : eight matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    (8,) array of matplotlib.axes.Axes, or None
        None where the ride is too short for an average.
    """
    found = [(name, estimates(run, settle)) for name, run in list(runs)[:LAWS]]
    known = [(name, e) for name, e in found if e is not None]
    if not known:
        return None
    with look():
        foreign = ax is not None
        figure, cells = panels(3, 3, height=2.5, ax=ax, count=PANELS)
        last = cells.ravel()[:PANELS]
        densities_of, gains_of, (by_band, weighting) = last[:3], last[3:6], last[6:]
        for k, (name, (f, densities, gains)) in enumerate(known):
            colour = (INK, *CYCLE)[k % 7]
            shown = (f >= BAND[0]) & (f <= BAND[1])
            for j, signal in enumerate(SIGNALS):
                densities_of[j].loglog(f[shown], densities[signal][shown], color=colour, linewidth=1.1, label=name)
                gains_of[j].loglog(f[shown], gains[signal][shown], color=colour, linewidth=1.1)
            centres, bands = third_octaves(f, densities["body_acceleration"])
            by_band.loglog(centres, bands, "o-", color=colour, markersize=3, linewidth=0.8)
        low, high = sensitive_band()
        for j, (stated, unit) in enumerate(SIGNALS.values()):
            densities_of[j].set_title(stated)
            densities_of[j].set_ylabel(label("PSD", f"({unit})²/Hz" if "/" in unit else f"{unit}²/Hz"))
            gains_of[j].set_title(f"road to {stated}")
            gains_of[j].set_ylabel(label("gain", quotient(unit, "m")))
            for panel in (densities_of[j], gains_of[j]):
                panel.set_xlabel(label("frequency", "Hz"))
        for panel in (densities_of[0], gains_of[0], by_band, weighting):
            panel.axvspan(low, high, color=BLUE, alpha=0.10, linewidth=0)
        by_band.set_title("weighted acceleration by third octave")
        by_band.set_ylabel(label("rms in the band", "m/s²"))
        by_band.set_xlabel(label("frequency", "Hz"))
        weight = np.geomspace(*BAND, 200)
        weighting.loglog(weight, np.abs(comfort_weighting(weight)), color=INK)
        weighting.set_title("W_k of ISO 2631-1")
        weighting.set_ylabel(label("weight", "1"))
        weighting.set_xlabel(label("frequency", "Hz"))
        for panel in (by_band, weighting):
            plain_decades(panel.yaxis)
        for spare in cells.ravel()[PANELS:]:
            spare.set_visible(False)
        legend_outside(figure, densities_of[0], foreign, 6, "upper")
    return drawn(cells, PANELS)


def estimates(run: CarRun, settle: float = 0.0
              ) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]] | None:
    """(frequencies [Hz], densities by signal, gains from the road by signal), or None for too short a run.

    Parameters
    ----------
    run : CarRun
        Of at least three segments of 4 s, half overlapping, after the start.
    settle : float
        Start that is left out [s].

    Returns
    -------
    frequency : (n,) array
        [Hz], in steps of 0.25 Hz.
    densities : dict of str to (n,) array
        One-sided, in the squared unit of the signal per Hz.
    gains : dict of str to (n,) array
        In the unit of the signal per metre; NaN where the road has next to no power.
    """
    from scipy.signal import csd, welch

    inside = run.time >= run.time[0] + settle
    size = round(SEGMENT / run.sample_time)
    if int(inside.sum()) < size * (SEGMENTS + 1) // 2:
        return None
    given = {"fs": 1 / run.sample_time, "nperseg": size, "detrend": "constant"}
    road = run["road"][inside]
    f, power = welch(road, **given)
    enough = power > FEWEST_POWER * power.max()
    densities, gains = {}, {}
    for name in SIGNALS:
        values = run[name][inside]
        densities[name] = welch(values, **given)[1]
        crossed = np.abs(csd(road, values, **given)[1])
        gains[name] = np.where(enough, crossed / np.where(enough, power, 1.0), np.nan)
    return f, densities, gains


def third_octaves(frequency: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre frequencies [Hz] and W_k-weighted rms of the third-octave bands from 0.5 to 50 Hz that hold a line.

    Parameters
    ----------
    frequency : (n,) array
        Evenly spaced [Hz].
    density : (n,) array
        One-sided, of the body's acceleration [(m/s²)²/Hz].

    Returns
    -------
    centres : (k,) array
        [Hz].
    bands : (k,) array
        [m/s²].

    Examples
    --------
    >>> f = np.arange(0.0, 100.0, 0.01)
    >>> centres, bands = third_octaves(f, np.where((f > 7) & (f < 9), 2.0, 0.0))
    >>> total = np.sqrt(np.sum(bands**2))
    >>> bool(abs(total / (2.0 * abs(comfort_weighting(np.array([8.0]))[0])) - 1) < 0.01)
    True
    """
    centres = 10.0 ** (np.arange(-3, 18) / 10)
    weighted = np.abs(comfort_weighting(frequency)) ** 2 * density * (frequency[1] - frequency[0])
    sums, kept = [], []
    for centre in centres:
        inside = (frequency >= centre * 10**-0.05) & (frequency < centre * 10**0.05)
        if inside.any():
            kept.append(centre)
            sums.append(float(np.sqrt(weighted[inside].sum())))
    return np.array(kept), np.array(sums)


def sensitive_band() -> tuple[float, float]:
    """Frequencies [Hz] between which |W_k| is above `SENSITIVE` of its largest value.

    Returns
    -------
    (float, float)
        Lowest and highest [Hz].

    Examples
    --------
    >>> [round(f, 1) for f in sensitive_band()]
    [3.9, 11.2]
    """
    f = np.geomspace(0.1, 100.0, 2000)
    weight = np.abs(comfort_weighting(f))
    high = f[weight >= SENSITIVE * weight.max()]
    return float(high[0]), float(high[-1])
