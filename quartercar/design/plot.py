"""Figures of a designed suspension controller: its weights, its frozen gains, its way over a bump."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.plot.colours import CYCLE, INK
from lpvid.plot.style import Ax, Drawn, drawn, label, legend_outside, look, panels, plain_decades, shades, zero_lines
from lpvid.units import driver
from quartercar.design.figures import FREQUENCIES, SHOWN
from quartercar.plot.rides import SIGNALS, draw_signals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from quartercar.design.identified import IdentifiedDesign
    from quartercar.design.nominal import Design
    from quartercar.rides.simulation import Ride

TITLES = {"body_acceleration": ("body acceleration", "1/s²"), "tyre_force": ("tyre force", "N/m"),
          "suspension_deflection": ("stroke", "1")}


def weights(found: Design | IdentifiedDesign, ax: Ax = None) -> Drawn:
    """Modulus of the weights on acceleration and tyre force over frequency.

    Parameters
    ----------
    found : Design or IdentifiedDesign
    ax : two matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    with look():
        axes = panels(1, 2, height=2.4, ax=ax)[1]
        chosen = found.task.weights
        for ax, gain, name, unit in ((axes[0, 0], chosen.comfort_gain, "body acceleration", "s²/m"),
                                     (axes[0, 1], chosen.wheel_gain, "tyre force", "1/N")):
            ax.loglog(FREQUENCIES, gain(FREQUENCIES), color=CYCLE[0])
            ax.set_title(f"weight on {name}")
            ax.set_ylabel(label("gain", unit))
            ax.set_xlabel(label("frequency", "Hz"))
    return drawn(axes)


def gains(found: Design | IdentifiedDesign, ax: Ax = None) -> Drawn:
    """Gains from the road with the scheduling frozen at values over its range, against the car without control.

    Parameters
    ----------
    found : Design or IdentifiedDesign
    ax : three matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    with look():
        foreign = ax is not None
        figure, axes = panels(1, 3, height=3.0, ax=ax)
        for ax, signal in zip(axes[0], SHOWN, strict=True):
            ax.loglog(FREQUENCIES, found.passive_gains[signal], color=INK, linestyle="--", label=found.baseline)
            _draw_frozen(ax, found, signal)
            name, unit = TITLES[signal]
            ax.set_title(f"road to {name}")
            ax.set_ylabel(label("gain", unit))
            ax.set_xlabel(label("frequency", "Hz"))
        legend_outside(figure, axes[0, 0], foreign, 7, "upper")
    return drawn(axes)


def _draw_frozen(ax: Axes, found: Design | IdentifiedDesign, signal: str, over: np.ndarray | float = 1.0) -> None:
    """A curve for every frozen value of the scheduling: the gain to a signal, as a share of `over`."""
    for colour, (share, curves) in zip(shades(len(found.gains)), found.gains, strict=True):
        ax.loglog(FREQUENCIES, curves[signal] / over, color=colour, label=f"ρ = {share:.2g}")


def sensitivity(found: Design | IdentifiedDesign, ax: Ax = None) -> Drawn:
    """Gain from the road with control over that without, signal by signal, the scheduling frozen over its range.

    S(jω) = |G_controlled|/|G_passive|: below one control helps, above one it costs. Where the plant has invariant
    points (the wheel's own resonance) every curve passes through one (Hrovat 1997).

    Parameters
    ----------
    found : Design or IdentifiedDesign
    ax : three matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    with look():
        foreign = ax is not None
        figure, axes = panels(1, 3, height=2.8, ax=ax)
        for ax, signal in zip(axes[0], SHOWN, strict=True):
            _draw_frozen(ax, found, signal, np.maximum(found.passive_gains[signal], 1e-300))
            plain_decades(ax.yaxis)
            ax.axhline(1.0, color=INK, linewidth=0.9, linestyle="--")
            ax.set_title(TITLES[signal][0])
            ax.set_ylabel(label("with control / without", "1"))
            ax.set_xlabel(label("frequency", "Hz"))
        legend_outside(figure, axes[0, 0], foreign, 7, "upper")
    return drawn(axes)


def actuator_use(found: Design | IdentifiedDesign, controlled: Ride, ax: Ax = None) -> Drawn:
    """Damper force over velocity within what the lowest and the highest command give, and the share of each command.

    Parameters
    ----------
    found : Design or IdentifiedDesign
    controlled : Ride
    ax : two matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    run, car = controlled.run, found.car
    velocity, current = run["suspension_velocity"], run["current"]
    unit = run.units["current"]
    low, high = car.coil.lowest, car.coil.highest
    with look():
        axes = panels(1, 2, height=3.2, ax=ax)[1]
        left, right = axes[0]
        left.plot(velocity, run["damper_force"], ".", color=CYCLE[1], markersize=2.0, alpha=0.6, rasterized=True,
                  label="over the bump")
        if car.damper is not None:
            grid = float(np.abs(velocity).max()) * np.linspace(-1, 1, 101)
            for level, dash in ((low, "--"), (high, "-")):
                if np.isfinite(level):
                    left.plot(grid, car.damper.static_force(grid, level, 0.0), color=INK, linewidth=1.1, linestyle=dash,
                              label=f"at {level:g} {unit}")
        zero_lines(left)
        left.set_xlabel(label("velocity of the damper", "m/s"))
        left.set_ylabel(label("damper force", "N"))
        left.legend(loc="upper left")
        right.hist(current, bins=30, weights=np.full(current.size, 100.0 / current.size), color=CYCLE[0], alpha=0.75)
        right.set_xlabel(label(driver(unit), unit))
        right.set_ylabel(label("share of the time", "%"))
        for level in (low, high):
            if np.isfinite(level):
                right.axvline(level, color=INK, linestyle="--", linewidth=0.9)
    return drawn(axes)


def bump(rides: tuple[Ride, Ride], ax: Ax = None) -> Drawn:
    """Acceleration, tyre load, stroke and current over a bump, controlled and passive.

    Parameters
    ----------
    rides : (Ride, Ride)
        Controlled, passive.
    ax : four matplotlib.axes.Axes, optional
        Where to draw; left out, in a new figure.

    Returns
    -------
    array of matplotlib.axes.Axes
    """
    with look():
        axes = panels(len(SIGNALS), heights=[1.9, 1.6, 1.6, 1.4], sharex=True, ax=ax)[1]
        for found, name, colour in zip(rides, ("controlled", "passive, lowest current"), (CYCLE[1], INK), strict=True):
            draw_signals(axes[:, 0], found.run, found.run.time >= 0.9, color=colour, label=name)
        axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=2, borderaxespad=0.0)
        axes[-1, 0].set_xlabel(label("time", "s"))
    return drawn(axes)
