"""What a controller does: closed-loop gain over frequency and scheduling, singular values, step responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.plot.style import BLUE, CYCLE, INK, MUTED, SCALE, VERMILION, look, panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FREQUENCIES = 160
CURVES = 7


def frozen_gains(loop: LPVStateSpace, level: float | None = None) -> Figure:
    """Largest singular value of the closed loop over frequency, one curve for each frozen scheduling point.

    Parameters
    ----------
    loop : LPVStateSpace
        From disturbances to performance signals.
    level : float, optional
        The verified bound, drawn as a line.

    Returns
    -------
    matplotlib.figure.Figure
        Left over frequency, right the peak over the first scheduling variable (or the singular values, where nothing
        varies).
    """
    from matplotlib import colormaps

    points, frequencies = _line(loop), _frequencies(loop)
    values = np.array([_singular_values(loop, p, frequencies) for p in points])
    with look():
        figure, axes = panels(1, 2, height=3.6)
        left, right = axes[0]
        shades = colormaps[SCALE](np.linspace(0.1, 0.9, len(points)))
        for k, p in enumerate(points):
            name = f"{loop.box.names[0]} = {p[0]:.4g}" if loop.box.names else "closed loop"
            left.loglog(frequencies, values[k, :, 0], color=shades[k], linewidth=1.4, label=name)
        left.set_title("Largest singular value, frozen")
        if loop.box.names:
            right.plot(points[:, 0], values[:, :, 0].max(axis=1), "o-", color=BLUE, markersize=4)
            unit = loop.box.units[0] or "1"
            right.set_xlabel(f"{loop.box.names[0]} [{unit}]")
            right.set_title("Peak over frequency")
        else:
            for i in range(values.shape[2]):
                right.loglog(frequencies, np.maximum(values[0, :, i], 1e-300), color=CYCLE[i % len(CYCLE)])
            right.set_xlabel("frequency [rad/s]")
            right.set_title("Singular values")
        for ax in (left, right) if loop.box.names else (left,):
            if level is not None:
                ax.axhline(level, color=VERMILION, linestyle="--", linewidth=1.2, label="verified bound")
        left.set_xlabel("frequency [rad/s]")
        left.set_ylabel("gain")
        left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2, borderaxespad=0.0)
    return figure


def step_responses(loop: LPVStateSpace) -> Figure:
    """Responses of every performance signal to a unit step in each disturbance, at frozen scheduling points."""
    from matplotlib import colormaps

    points, time = _line(loop), _times(loop)
    nz, nw = min(len(loop.outputs), 6), min(len(loop.inputs), 4)
    with look():
        figure, axes = panels(nz, nw, height=1.9, sharex=True)
        shades = colormaps[SCALE](np.linspace(0.1, 0.9, len(points)))
        for k, p in enumerate(points):
            response = _steps(loop, p, time)
            for i in range(nz):
                for j in range(nw):
                    axes[i, j].plot(time, response[:, i, j], color=shades[k], linewidth=1.2)
        for i in range(nz):
            axes[i, 0].set_ylabel(f"{loop.outputs[i].name} [{loop.outputs[i].unit or '1'}]")
        for j in range(nw):
            axes[0, j].set_title(f"step in {loop.inputs[j].name}", color=INK)
            axes[-1, j].set_xlabel("time [s]")
        for ax in axes.ravel():
            ax.axhline(0, color=MUTED, linewidth=0.5)
    return figure


def _line(loop: LPVStateSpace) -> np.ndarray:
    """Points across the box: the first variable swept, the others swept with it from corner to corner."""
    box = loop.box
    if not box.names:
        return np.empty((1, 0))
    share = np.linspace(0, 1, CURVES)[:, None]
    return np.array(box.lower) * (1 - share) + np.array(box.upper) * share


def _speeds(loop: LPVStateSpace) -> np.ndarray:
    """Moduli [rad/s] of the frozen poles, without those that hardly move."""
    poles = np.concatenate([loop.frozen_poles(p) for p in _line(loop)]) if loop.order else np.ones(1)
    if loop.sample_time is not None:
        poles = np.log(np.where(np.abs(poles) > 1e-6, poles, 1e-6).astype(complex)) / loop.sample_time
    speeds = np.abs(poles)
    return speeds[speeds > 1e-6 * speeds.max(initial=1e-300)] if speeds.max(initial=0) > 0 else np.ones(1)


def _frequencies(loop: LPVStateSpace) -> np.ndarray:
    speeds = _speeds(loop)
    high = speeds.max() * 30 if loop.sample_time is None else np.pi / loop.sample_time
    return np.geomspace(min(speeds.min() / 30, high / 10), high, FREQUENCIES)


def _times(loop: LPVStateSpace) -> np.ndarray:
    poles = np.concatenate([np.asarray(loop.frozen_poles(p)) for p in _line(loop)]) if loop.order else -np.ones(1)
    if loop.sample_time is not None:
        slow = -np.log(np.clip(np.abs(poles).max(initial=0.5), 1e-3, 1 - 1e-6)) / loop.sample_time
        count = int(np.clip(6 / (slow * loop.sample_time), 20, 2000))
        return loop.sample_time * np.arange(count)
    return np.linspace(0, 6 / max(-float(np.real(poles).max(initial=-1e3)), 1e-6), 400)


def _singular_values(loop: LPVStateSpace, p: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    a, b, c, d = loop.frozen(p)
    z = 1j * frequencies if loop.sample_time is None else np.exp(1j * frequencies * loop.sample_time)
    resolvent = np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b, (len(z), *b.shape)))
    return np.linalg.svd(c @ resolvent + d, compute_uv=False)


def _steps(loop: LPVStateSpace, p: np.ndarray, time: np.ndarray) -> np.ndarray:
    """(T, n_z, n_w) responses to unit steps."""
    a, b, c, d = loop.frozen(p)
    n, nw = b.shape
    if loop.sample_time is None:
        from scipy.linalg import expm

        both = expm(np.block([[a, b], [np.zeros((nw, n + nw))]]) * (time[1] - time[0]))
        a, b = both[:n, :n], both[:n, n:]
    x, rows = np.zeros((n, nw)), []
    for _ in time:
        rows.append(c @ x + d)
        x = a @ x + b
    return np.array(rows)
