"""Pictures of source 004, each beside the figure of the thesis that it answers; all data are virtual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from study_004 import Chain, Row

import lpvid as lpv
from lpvid.plot.colours import BLUE, CYCLE, GREEN, INK, MUTED, VERMILION
from lpvid.plot.style import label, look, panels
from quartercar.rig import EXPERIMENTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VIRTUAL = "virtual rig"


def zones(chain: Chain, constant: Sequence[lpv.Record]) -> Figure:
    """Figs. 3.2, 3.3, 3.5, 3.6: lines at 1.2 A, slopes and intercepts and v_high over the current."""
    found = chain.zones
    levels = np.array(found.levels)
    lines = np.array(found.lines)
    at = int(np.argmin(np.abs(levels - 1.2)))
    run = min(constant, key=lambda r: abs(float(r["current"].mean()) - levels[at]))
    grid = np.linspace(levels[0], levels[-1], 50)
    with look():
        figure, axes = panels(2, 2, height=2.4)
        ax = axes[0, 0]
        ax.plot(run["velocity"], run["force"], ".", ms=1, color=MUTED, label=VIRTUAL)
        reach, high = float(np.abs(run["velocity"]).max()), found.limits[at]
        for (m, c), low, up in zip(lines[at], (-reach, -high, high), (-high, high, reach), strict=True):
            ax.plot([low, up], [m * low + c, m * up + c], color=VERMILION)
        ax.set(
            xlabel=label("velocity", "m/s"), ylabel=label("force", "N"), title=f"Fig. 3.2: lines at {levels[at]:.2g} A"
        )
        ax.legend(markerscale=6)
        panel = ((axes[0, 1], 0, "slope", "N·s/m"), (axes[1, 0], 1, "intercept", "N"))
        for ax, part, name, unit in panel:
            for zone, title, colour in zip(range(3), ("I", "II", "III"), CYCLE, strict=False):
                ax.plot(levels, lines[:, zone, part], "o", color=colour, label=f"zone {title}")
                fit = np.polynomial.polynomial.polyfit(levels, lines[:, zone, part], 1)
                ax.plot(grid, np.polynomial.polynomial.polyval(grid, fit), color=colour, linewidth=0.8)
            ax.set(xlabel=label("current", "A"), ylabel=label(name, unit), title=f"Figs. 3.3, 3.6: {name}s ({VIRTUAL})")
            ax.legend(ncols=3)
        axes[1, 1].plot(levels, found.limits, "ko", label=VIRTUAL)
        axes[1, 1].plot(
            grid,
            np.polynomial.polynomial.polyval(grid, found.stage.limit),
            color=VERMILION,
            label="first degree (3.16)",
        )
        axes[1, 1].set(xlabel=label("current", "A"), ylabel=label("v_high", "m/s"), title="Fig. 3.5: limit of zone II")
        axes[1, 1].legend()
    return figure


def by_current(constant: Sequence[lpv.Record]) -> Figure:
    """Figs. 1.4, 2.2, 3.1: force over displacement and velocity at every constant current."""
    runs = sorted(constant, key=lambda r: float(r["current"].mean()))
    colours = (MUTED, BLUE, GREEN, VERMILION)
    with look():
        figure, axes = panels(1, 2, height=3.0)
        for ax, channel, unit, scale in zip(
            axes[0], ("displacement", "velocity"), ("mm", "m/s"), (1e3, 1.0), strict=True
        ):
            for run, colour in zip(runs[::2], colours, strict=False):
                part = slice(1000, 1800)
                ax.plot(
                    scale * run[channel][part],
                    run["force"][part],
                    color=colour,
                    linewidth=0.8,
                    label=f"{abs(run['current'].mean()):.1f} A, {VIRTUAL}",
                )
            ax.set(xlabel=label(channel, unit), ylabel=label("force", "N"))
        axes[0, 1].legend(fontsize=7)
    return figure


def linear_fails(chain: Chain, run: lpv.Record) -> Figure:
    """Fig. 3.4: one linear model of velocity beside the LPV model, at one current."""
    with look():
        figure, axes = panels(1, 2, height=2.8)
        for ax, (title, model) in zip(
            axes[0], (("one LTI model", chain.linear), ("canonical form, re-estimated", chain.canonical)), strict=True
        ):
            esr = lpv.validate(model, run).overall.free_run.esr
            force = lpv.simulate(model, run).output[:, 0]
            part = slice(200, 2200)
            ax.plot(run["velocity"][part], run["force"][part], color=INK, linewidth=0.8, label=VIRTUAL)
            ax.plot(
                run["velocity"][part], force[part], color=VERMILION, linewidth=0.8, label=f"free run, ESR {esr:.3g}"
            )
            ax.set(xlabel=label("velocity", "m/s"), ylabel=label("force", "N"), title=title)
            ax.legend()
    return figure


def shaped_input(chain: Chain, runs: Sequence[lpv.Record]) -> Figure:
    """Figs. 3.7 and 3.8: velocity and the input that the zones make of it."""
    stage = chain.by_level.input_stage
    assert stage is not None
    with look():
        figure, axes = panels(2, len(runs), height=1.7, sharex="col")
        for (top, bottom), run in zip(axes.T, runs, strict=True):
            part = slice(1000, 1512)
            v, i = run["velocity"][part, None], run["current"][part, None]
            shaped = stage.apply(v, i)
            top.plot(run.times[part], v, color=MUTED, label="v")
            top.plot(
                run.times[part], np.asarray(shaped).reshape(v.shape[0], -1)[:, -1], color=VERMILION, label="u(v, i)"
            )
            top.set(ylabel=label("velocity", "m/s"), title=f"{run.name} ({VIRTUAL})")
            top.legend(ncols=2)
            bottom.plot(run.times[part], i, color=BLUE)
            bottom.set(xlabel=label("time", "s"), ylabel=label("current", "A"), ylim=(-0.1, 2.7))
    return figure


def errors(rows: Sequence[Row]) -> Figure:
    """Figs. 5.1-5.11, 5.16, 6.1: ESR of every model, each experiment a point, the mean a bar."""
    shown = [r for r in rows if r.mean is not None]
    with look():
        figure, ((ax,),) = panels(1, 1, height=0.33 * len(shown) + 0.8)
        for k, row in enumerate(shown[::-1]):
            ax.barh(k, row.mean, color=GREEN if row.family == "LPV" else BLUE, alpha=0.55, height=0.6)
            values = [e for e in row.esr.values() if e is not None]
            ax.plot(values, np.full(len(values), k), ".", color=INK)
        ax.axvline(0.04, color=VERMILION, linestyle="--", label="source, measured: LPV below 0.04 on average")
        ax.axvline(0.1, color=MUTED, linestyle="--", label="source, measured: most others below 0.1")
        ax.set_yticks(range(len(shown)), [f"{r.family}, {r.model}" for r in shown[::-1]])
        ax.set(xscale="log", xlabel=f"free-run ESR, held-out ({VIRTUAL}); points: experiments, bar: mean")
        ax.legend(loc="upper right", fontsize=7.5)
    return figure


def loops(models: Mapping[str, object], runs: Sequence[lpv.Record]) -> Figure:
    """Figs. 5.3, 5.6, 5.12-5.14, 6.4: force over velocity, and 6.3, 5.15: force over time."""
    with look():
        figure, axes = panels(len(runs) + 1, len(models), height=2.2)
        for column, (name, model) in zip(axes.T, models.items(), strict=True):
            for ax, run in zip(column, runs, strict=False):
                force = lpv.simulate(model, run).output[:, 0]  # type: ignore[arg-type]
                part = slice(1000, 1700)
                ax.plot(run["velocity"][part], run["force"][part], color=INK, linewidth=0.7, label=VIRTUAL)
                ax.plot(run["velocity"][part], force[part], color=VERMILION, linewidth=0.7, label="free run")
                ax.set(title=f"{name}\n{run.name}", xlabel=label("velocity", "m/s"))
            part = slice(1000, 1300)
            column[-1].plot(run.times[part], run["force"][part], color=INK, linewidth=0.9)
            column[-1].plot(run.times[part], force[part], color=VERMILION, linewidth=0.9)
            column[-1].set(xlabel=label("time", "s"), title=run.name)
        for ax in axes[:, 0]:
            ax.set_ylabel(label("force", "N"))
        axes[0, 0].legend(fontsize=7)
    return figure


def signals(runs: Mapping[str, lpv.Record]) -> Figure:
    """Figs. 4.3 and D.1-D.8: displacement, current and the spectrum of displacement."""
    with look():
        figure, axes = panels(len(EXPERIMENTS), 3, height=1.15)
        for (left, middle, right), (name, run) in zip(axes, runs.items(), strict=True):
            part = slice(0, 5 * round(1 / run.sample_time))
            left.plot(run.times[part], 1e3 * run["displacement"][part], color=INK, linewidth=0.7)
            middle.plot(run.times[part], run["current"][part], color=BLUE, linewidth=0.7)
            x = run["displacement"] - run["displacement"].mean()
            power = np.abs(np.fft.rfft(x)) ** 2
            f = np.fft.rfftfreq(x.size, run.sample_time)
            right.semilogy(f[1:], power[1:] / power.max(), color=GREEN, linewidth=0.5)
            right.set(xlim=(0, 30), ylim=(1e-7, 2))
            left.set_ylabel(f"{name}\nx [mm]", fontsize=7)
            middle.set_ylabel("i [A]", fontsize=7)
            middle.set_ylim(-0.1, 2.7)
            right.set_ylabel("power", fontsize=7)
        for ax, name in zip(axes[-1], (label("time", "s"), label("time", "s"), label("frequency", "Hz")), strict=True):
            ax.set_xlabel(name)
    return figure
