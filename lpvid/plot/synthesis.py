"""What a controller does: closed-loop gain over frequency and scheduling, singular values, step responses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lpvid.model.hull import corners_of, hull_of
from lpvid.model.state_space import LPVStateSpace
from lpvid.plot.colours import BLUE, CYCLE, INK, MUTED, VERMILION
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, shades

FREQUENCIES = 160
CURVES = 7
MOST = 8
"""Corners of the box that are drawn."""


def frozen_gains(loop: LPVStateSpace, level: float | None = None, ax: Ax = None) -> Drawn:
    """Largest singular value of the closed loop over frequency, one curve for each frozen scheduling point.

    Parameters
    ----------
    loop : LPVStateSpace
        From disturbances to performance signals.
    level : float, optional
        The verified bound, drawn as a line.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes, or array of them
        Left over frequency, right the peak over the first scheduling variable (or the singular values, where nothing
        varies).
    """
    points, frequencies = line_of(loop), frequencies_of(loop)
    values = np.array([_singular_values(loop, p, frequencies) for p in points])
    hertz = frequencies / (2 * np.pi)
    with look():
        axes = panels(1, 2, height=3.6, ax=ax)[1]
        left, right = axes[0]
        for p, gains, shade in zip(points, values, shades(len(points)), strict=True):
            name = f"{loop.box.names[0]} = {p[0]:.4g}" if loop.box.names else "closed loop"
            left.loglog(hertz, gains[:, 0], color=shade, linewidth=1.4, label=name)
        left.set_title("Largest singular value, frozen")
        if loop.box.names:
            right.plot(points[:, 0], values[:, :, 0].max(axis=1), "o-", color=BLUE, markersize=4)
            unit = loop.box.units[0] or "1"
            right.set_xlabel(f"{loop.box.names[0]} [{unit}]")
            right.set_title("Peak over frequency")
        else:
            for i in range(values.shape[2]):
                right.loglog(hertz, np.maximum(values[0, :, i], 1e-300), color=CYCLE[i % len(CYCLE)],
                             label=f"σ{i + 1}")
            right.set_xlabel(label("frequency", "Hz"))
            right.set_title("Singular values")
        for ax in (left, right) if loop.box.names else (left,):
            if level is not None:
                ax.axhline(level, color=VERMILION, linestyle="--", linewidth=1.2, label="verified bound")
        left.set_xlabel(label("frequency", "Hz"))
        for ax in (left, right):
            ax.set_ylabel(label("gain", "1"))
        left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2, borderaxespad=0.0)
    return drawn(axes)


def weighted_channels(loop: LPVStateSpace, weights: Mapping[str, LPVStateSpace | float], level: float,
                      ax: Ax = None) -> Drawn:
    """Gain of each performance signal before its weight, against what the weight and the verified bound allow.

    The loop holds the weights: z_i = W_i(s) e_i, so that ‖z‖ ≤ γ‖w‖ bounds every frozen channel by
    |e_i(jω)/w| ≤ γ/|W_i(jω)| (Skogestad & Postlethwaite 2005, 2.8.2). The curve is the norm of the channel's row
    divided by |W_i|; it may touch the inverse weight times γ, and cross it nowhere.

    Parameters
    ----------
    loop : LPVStateSpace
        From disturbances to weighted performance signals.
    weights : mapping of str to LPVStateSpace or float
        By performance signal; time-invariant, one input and one output each, or a plain factor.
    level : float
        The verified bound γ.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes, or array of them
    """
    points, frequencies = line_of(loop), frequencies_of(loop)
    hertz = frequencies / (2 * np.pi)
    names = [s.name for s in loop.outputs]
    shown = [n for n in names if n in weights][:6]
    rows = [np.linalg.norm(responses(loop, p, frequencies), axis=2) for p in points]
    with look():
        foreign = ax is not None
        figure, axes = panels(-(-len(shown) // 3), min(3, len(shown)), height=2.7, ax=ax, count=len(shown))
        colours = shades(len(points))
        for ax, name in zip(axes.ravel(), shown, strict=False):
            weight = np.maximum(_weight_gain(weights[name], frequencies), 1e-300)
            for gains, colour in zip(rows, colours, strict=True):
                ax.loglog(hertz, gains[:, names.index(name)] / weight, color=colour, linewidth=1.2)
            ax.loglog(hertz, level / weight, color=VERMILION, linestyle="--", linewidth=1.3,
                      label="verified bound over the weight")
            ax.set_title(name)
            ax.set_xlabel(label("frequency", "Hz"))
            ax.set_ylabel(label("gain before the weight", "1"))
        for ax in axes.ravel()[len(shown):]:
            ax.set_visible(False)
        legend_outside(figure, axes[0, 0], foreign, 1)
    return drawn(axes, len(shown))


def step_responses(loop: LPVStateSpace, ax: Ax = None) -> Drawn:
    """Responses of every performance signal to a unit step in each disturbance, at the corners of the box.

    Of a single scheduling variable some values in between are shown too.

    Parameters
    ----------
    loop : LPVStateSpace
        Closed loop; its first six outputs and first four inputs are drawn.
    ax : matplotlib.axes.Axes or sequence of them, optional
        Where to draw, one for each output and input; left out, in a new figure.

    Returns
    -------
    matplotlib.axes.Axes or array of them
        One row per performance signal, one column per disturbance.
    """
    points, time = _corners(loop), _times(loop)
    nz, nw = min(len(loop.outputs), 6), min(len(loop.inputs), 4)
    with look():
        foreign = ax is not None
        figure, axes = panels(nz, nw, height=1.9, sharex=True, ax=ax)
        for p, shade in zip(points, shades(len(points)), strict=True):
            response = _steps(loop, p, time)
            name = ", ".join(f"{n} = {v:.3g}" for n, v in zip(loop.box.names, p, strict=True))
            for i in range(nz):
                for j in range(nw):
                    axes[i, j].plot(time, response[:, i, j], color=shade, linewidth=1.2, label=name)
        for i in range(nz):
            axes[i, 0].set_ylabel(f"{loop.outputs[i].name} [{loop.outputs[i].unit or '1'}]")
        for j in range(nw):
            axes[0, j].set_title(f"step in {loop.inputs[j].name}", color=INK)
            axes[-1, j].set_xlabel("time [s]")
        for ax in axes.ravel():
            ax.axhline(0, color=MUTED, linewidth=0.5)
        if loop.box.names:
            legend_outside(figure, axes[0, 0], foreign, 2)
    return drawn(axes)


def _corners(loop: LPVStateSpace) -> np.ndarray:
    """Corners of the box, or of the hull of the design; a line across it for one variable."""
    return corners_of(loop, MOST) if len(loop.box.names) > 1 else line_of(loop)


def _weight_gain(weight: LPVStateSpace | float, frequencies: np.ndarray) -> np.ndarray:
    if isinstance(weight, LPVStateSpace):
        return np.abs(responses(weight, np.zeros(0), frequencies))[:, 0, 0]
    return np.full(frequencies.size, abs(float(weight)))


def line_of(loop: LPVStateSpace, count: int = CURVES) -> np.ndarray:
    """Points across the box: the first variable swept, the others swept with it from corner to corner.

    Where the metadata name the hull of a design, from the vertex at which the first variable is least to that at which
    it is largest: a line inside, as the hull is convex.

    Parameters
    ----------
    loop : LPVStateSpace
        A system over a box.
    count : int
        Points, N.

    Returns
    -------
    (N, n) array
        Points [units of the variables]; (1, 0) without scheduling.
    """
    box = loop.box
    if not box.names:
        return np.empty((1, 0))
    share = np.linspace(0, 1, count)[:, None]
    hull = hull_of(loop)
    first, last = (box.lower, box.upper) if hull is None or set(box.names) - set(hull.names) else corners_of(loop, 2)
    return np.array(first) * (1 - share) + np.array(last) * share


def _speeds(loop: LPVStateSpace) -> np.ndarray:
    """Moduli [rad/s] of the frozen poles, without those that hardly move."""
    poles = np.concatenate([loop.frozen_poles(p) for p in line_of(loop)]) if loop.order else np.ones(1)
    if loop.sample_time is not None:
        poles = np.log(np.where(np.abs(poles) > 1e-6, poles, 1e-6).astype(complex)) / loop.sample_time
    speeds = np.abs(poles)
    return speeds[speeds > 1e-6 * speeds.max(initial=1e-300)] if speeds.max(initial=0) > 0 else np.ones(1)


def frequencies_of(loop: LPVStateSpace) -> np.ndarray:
    """(n,) frequencies [rad/s] about the frozen poles of a system.

    Parameters
    ----------
    loop : LPVStateSpace
        A system.

    Returns
    -------
    (n,) array
        Geometrically spaced [rad/s]; to the Nyquist frequency in discrete time.
    """
    speeds = _speeds(loop)
    high = speeds.max() * 30 if loop.sample_time is None else np.pi / loop.sample_time
    return np.geomspace(min(speeds.min() / 30, high / 10), high, FREQUENCIES)


def _times(loop: LPVStateSpace) -> np.ndarray:
    poles = np.concatenate([np.asarray(loop.frozen_poles(p)) for p in line_of(loop)]) if loop.order else -np.ones(1)
    if loop.sample_time is not None:
        slow = -np.log(np.clip(np.abs(poles).max(initial=0.5), 1e-3, 1 - 1e-6)) / loop.sample_time
        count = int(np.clip(6 / (slow * loop.sample_time), 20, 2000))
        return loop.sample_time * np.arange(count)
    return np.linspace(0, 6 / max(-float(np.real(poles).max(initial=-1e3)), 1e-6), 400)


def _singular_values(loop: LPVStateSpace, p: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    return np.linalg.svd(responses(loop, p, frequencies), compute_uv=False)


def responses(loop: LPVStateSpace, p: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """(n, n_outputs, n_inputs) frozen response at frequencies [rad/s].

    Parameters
    ----------
    loop : LPVStateSpace
        A system.
    p : (s,) array
        Scheduling held at this point, in its units.
    frequencies : (n,) array
        [rad/s]

    Returns
    -------
    (n, n_outputs, n_inputs) complex array
        Response.
    """
    a, b, c, d = loop.frozen(p)
    z = 1j * frequencies if loop.sample_time is None else np.exp(1j * frequencies * loop.sample_time)
    resolvent = np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b, (len(z), *b.shape)))
    return c @ resolvent + d


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
