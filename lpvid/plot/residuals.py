"""What a model leaves one step ahead: histogram, autocorrelation, cross-correlation with the inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import BLUE, INK, MODEL
from lpvid.plot.comparison import Comparison
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_above, look, panels
from lpvid.units import quotient
from lpvid.validation.residuals import lagged_means

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CROSSED = 4
"""Inputs that the residual is correlated with, at most."""
NORMAL_99 = 2.576
"""99 % of a normal law lie within so many standard deviations."""


def residuals(shown: Sequence[Comparison], lags: int = 40, inputs: Sequence[str] = (),
              ax: Ax = None) -> Drawn | None:
    """One-step residuals: histogram about their own mean, autocorrelation, cross-correlation with inputs.

    The limits hold 99 % of a lag's correlations where there is none. Of the autocorrelation they are those of white
    noise, 2.58/√N. Of the cross-correlation the variance is Σ_k r_ee(k) r_uu(k) / (N r_ee(0) r_uu(0)) (Bartlett; Box &
    Jenkins 1970, 11.1.3), so that a coloured residual beside a coloured input does not fail by itself.

    Parameters
    ----------
    shown : sequence of Comparison
    lags : int
    inputs : sequence of str
        Channels for the cross-correlation, at most `CROSSED`.
    ax : array of Axes, optional
        Where to draw: two, and one for each input that moves; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes, or None
        None when there is nothing finite.
    """
    usable = [c for c in shown if c.innovation.size > 4 and np.isfinite(c.innovation).all()]
    if not usable:
        return None
    pooled = np.concatenate([c.innovation for c in usable])
    lags = min(lags, min(c.innovation.size for c in usable) - 2)
    moving = [n for n in inputs if all(c.record.has(n) for c in usable)
              and any(np.ptp(c.record[n][c.one_step.start:]) > 0 for c in usable)][:CROSSED]
    with look():
        axes = panels(1 + (len(moving) + 1) // 2, 2, height=2.4, ax=ax, count=2 + len(moving))[1]
        cells = axes.ravel()
        _histogram(cells[0], pooled, usable[0].unit)
        _autocorrelation(cells[1], usable, lags)
        for ax, name in zip(cells[2:], moving, strict=False):
            _cross_correlation(ax, usable, name, lags)
        for ax in cells[2 + len(moving):]:
            ax.set_visible(False)
    return drawn(axes, 2 + len(moving))


def _histogram(ax: Axes, values: np.ndarray, unit: str) -> None:
    centre = float(values.mean())
    spread = max(float(values.std()), 1e-9 * float(np.abs(values).max())) or 1.0  # a constant has no histogram
    edges = np.linspace(centre - 4 * spread, centre + 4 * spread, 41)
    ax.hist(values, bins=edges.tolist(), density=True, color=BLUE, alpha=0.55)
    x = 0.5 * (edges[1:] + edges[:-1])
    ax.plot(x, np.exp(-0.5 * ((x - centre) / spread) ** 2) / (spread * np.sqrt(2 * np.pi)), color=INK, linewidth=1.0,
            label="normal law")
    ax.axvline(centre, color=MODEL, linewidth=1.2, linestyle="--", label=f"mean {centre:.3g} {unit}".rstrip())
    ax.set_title("histogram")
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(label("residual", unit))
    ax.set_ylabel(label("density", quotient("", unit)))
    legend_above(ax, 2)


def _autocorrelation(ax: Axes, shown: Sequence[Comparison], lags: int) -> None:
    products = lagged_means([(e, e) for e in _centred(shown)], lags)
    ratio = products / (products[0] or 1.0)
    _bars(ax, np.arange(1, lags + 1), ratio[1:], NORMAL_99 / np.sqrt(sum(c.innovation.size for c in shown)))
    ax.set_title("autocorrelation, 99 % limits")


def _cross_correlation(ax: Axes, shown: Sequence[Comparison], name: str, lags: int) -> None:
    errors, drives = _centred(shown), [c.record[name][c.one_step.start:] for c in shown]
    drives = [u - u.mean() for u in drives]
    reach = min(4 * lags, min(e.size for e in errors) - 1)
    own, driven = (lagged_means([(x, x) for x in xs], reach) for xs in (errors, drives))
    scale = np.sqrt(own[0] * driven[0]) or 1.0
    pairs = list(zip(errors, drives, strict=True))
    later, earlier = lagged_means(pairs, lags), lagged_means([(u, e) for e, u in pairs], lags)
    taper = 1 - np.arange(reach + 1) / (reach + 1)
    both = taper * own * driven
    count = sum(e.size for e in errors)
    limit = NORMAL_99 * np.sqrt(max(float(both[0] + 2 * both[1:].sum()), 0.0) / count) / scale
    _bars(ax, np.arange(-lags, lags + 1), np.concatenate([earlier[:0:-1], later]) / scale, limit)
    ax.set_title(f"cross-correlation with {name}, 99 % limits")
    ax.set_xlabel(f"samples that {name} comes before [1]")


def _centred(shown: Sequence[Comparison]) -> list[np.ndarray]:
    return [c.innovation - c.innovation.mean() for c in shown]


def _bars(ax: Axes, lags: np.ndarray, values: np.ndarray, limit: float) -> None:
    ax.axhspan(-limit, limit, color=BLUE, alpha=0.15, linewidth=0)
    outside = np.abs(values) > limit
    for chosen, colour in ((~outside, BLUE), (outside, MODEL)):
        ax.vlines(lags[chosen], 0, values[chosen], color=colour, linewidth=1.4)
    ax.axhline(0, color=INK, linewidth=0.5)
    reach = max(1.25 * float(np.abs(values).max(initial=0.0)), 4 * limit)
    ax.set_ylim(-reach, reach)
    ax.set_xlabel("lag [samples]")
    ax.set_ylabel("correlation [1]")
