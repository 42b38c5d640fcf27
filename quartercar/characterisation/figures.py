"""Figures of a dynamometer's page; each answers one question and stays readable on a phone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.plot.colours import CYCLE, FAINT, INK, MUTED, PURPLE, VERMILION
from lpvid.plot.style import look, panels, shades
from lpvid.units import driver
from quartercar.characterisation.cycles import Block
from quartercar.characterisation.points import DIRECTIONS, peak_point
from quartercar.characterisation.readings import Readings
from quartercar.characterisation.wording import amps, label_of, shortened, speed_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from quartercar.characterisation.drift import Drift
    from quartercar.characterisation.gas import StaticForce


WIDTH, HEIGHT, FONT = 7.4, 4.1, 11.0
"""inches and points: at 390 px wide the text is still 5 px high"""
MOST_CURVES = 8
"""Tests drawn in one axes; of more, those spread evenly over the peak speed."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure with its file name and caption.

    Attributes
    ----------
    name : str
        Without the ending.
    figure : matplotlib.figure.Figure
    caption : str
    """

    name: str
    figure: Figure
    caption: str


def figures_of(found: Readings) -> tuple[Drawn, ...]:
    """Every figure for which the records hold something, in the order of the page.

    Parameters
    ----------
    found : Readings

    Returns
    -------
    tuple of Drawn
    """
    import matplotlib as mpl

    steady = _steady(found)
    with look(), mpl.rc_context({"font.size": FONT, "axes.labelsize": FONT, "axes.titlesize": FONT,
                                 "xtick.labelsize": FONT - 1, "ytick.labelsize": FONT - 1,
                                 "legend.fontsize": FONT - 1.5, "lines.linewidth": 1.5}):
        charts = ((found.peaks, _peak_velocity), (steady, _continuous_velocity), (steady, _displacement_loops),
                  (found.spreads, _by_current), (found.static, _static_line), (found.loops, _stiffness),
                  (found.switching, _switching), (found.drifts, _drift), (found.histograms, _histogram),
                  (found.given, _specimens))
        made = [draw(found) for rows, draw in charts if rows]
    return tuple(m for m in made if m is not None)


def _chart(rows: int = 1, height: float = HEIGHT, sharex: bool = False) -> tuple[Figure, Any]:
    figure, axes = panels(rows, 1, height=height, width=WIDTH, sharex=sharex)
    return figure, axes[:, 0] if rows > 1 else axes[0, 0]


def _colours(found: Readings) -> dict:
    """A colour for every (specimen, current): by current along a map, or by specimen where there is one current."""
    keys = list(dict.fromkeys((b.run.specimen, b.run.level) for b in _steady(found)))
    keys.sort(key=lambda k: (k[0], -np.inf if k[1] is None else k[1]))
    levels = found.data.levels
    if len(levels) < 2:
        return {k: CYCLE[n % len(CYCLE)] for n, k in enumerate(keys)}
    shade = dict(zip(levels, shades(len(levels)), strict=True))
    return {k: MUTED if k[1] is None else shade.get(k[1], MUTED) for k in keys}


def _label(found: Readings, key: tuple) -> str:
    parts = [shortened(key[0]), "" if key[1] is None else amps(key[1], found.data.current_unit)]
    return " ".join(p for p in parts if p) or "measured"


def _legend(ax: Axes, height: float = HEIGHT) -> None:
    """Below the axes and their label, in a chart of this height."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        unique = dict(zip(labels, handles, strict=True))
        ax.legend(unique.values(), unique.keys(), loc="upper left", bbox_to_anchor=(0.0, -0.19 * HEIGHT / height),
                  ncols=_columns(unique), borderaxespad=0.0, handlelength=1.4, columnspacing=1.2)


def _columns(labels: Iterable[str]) -> int:
    """Columns of a legend that the width holds: about 75 characters with their handles."""
    return int(np.clip(75 // (6 + max(map(len, labels))), 1, 4))


def _zero(ax: Axes) -> None:
    ax.axhline(0, color=INK, linewidth=0.7, zorder=1)


def _spread_over(blocks: Sequence[Block]) -> list[Block]:
    ordered = sorted(blocks, key=lambda b: b.peak)
    if len(ordered) <= MOST_CURVES:
        return ordered
    return [ordered[k] for k in np.unique(np.linspace(0, len(ordered) - 1, MOST_CURVES).round().astype(int))]


def _steady(found: Readings) -> list[Block]:
    return [b for b in found.blocks if b.run.has_force and b.run.current != "varies"]


def _block_of(found: Readings, row: StaticForce | Drift) -> Block:
    """The block that a row was read from."""
    return next(b for b in _steady(found)
                if (b.run.name, b.label, b.run.level) == (row.record, row.test, row.current))


def _peak_velocity(found: Readings) -> Drawn:
    """PVP: force at mid stroke over the peak speed."""
    sign, colours = found.settings.sign, _colours(found)
    figure, ax = _chart()
    for key in colours:
        for direction in DIRECTIONS:
            own = sorted((p for p in found.peaks if (p.block.run.specimen, p.block.run.level, p.direction) ==
                          (*key, direction)), key=lambda p: p.speed)
            ax.errorbar([1e3 * p.speed for p in own], [sign * p.force for p in own],
                        yerr=[2 * np.nan_to_num(p.std) for p in own], color=colours[key], marker="o", markersize=4.5,
                        linewidth=1.0, capsize=2.5, label=_label(found, key))
            model = [(p.speed, m.force) for p in own if id(p.block.run) in found.models
                     and (m := peak_point(p.block, direction, found.models[id(p.block.run)])) is not None]
            if model:
                ax.plot([1e3 * v for v, _ in model], [sign * f for _, f in model], "x", color=VERMILION, markersize=7,
                        markeredgewidth=1.6, label=found.model, zorder=5)
    _zero(ax)
    ax.set_xlim(0, 1.06e3 * max(p.speed for p in found.peaks))
    ax.set(xlabel="peak speed [mm/s]", ylabel="force [N]", title=f"Peak velocity, rebound {found.settings.rebound}")
    _legend(ax)
    return Drawn("peak_velocity", figure, "Peak-velocity plot: force at mid stroke (central 10 %), mean over the "
                 "settled cycles with two standard errors, over the speed there; one point per test and direction.")


def _one_per_key(found: Readings) -> tuple[list[Block], str]:
    """The fastest test of every specimen and current; with only one of these, tests of all speeds."""
    steady = _steady(found)
    keys = list(dict.fromkeys((b.run.specimen, b.run.level) for b in steady))
    if len(keys) > 1:
        keys.sort(key=lambda k: (k[0], -np.inf if k[1] is None else k[1]))
        return [max((b for b in steady if (b.run.specimen, b.run.level) == k), key=lambda b: b.peak) for k in keys], \
            "the fastest test of each"
    return _spread_over(steady), "every test" if len(steady) <= MOST_CURVES else f"{MOST_CURVES} of {len(steady)} tests"


def _continuous_velocity(found: Readings) -> Drawn:
    """CVP: force over velocity along the last complete cycle."""
    return _last_cycles(found, "continuous_velocity", "velocity [mm/s]", lambda c: 1e3 * c.velocity,
                        "Continuous velocity", "Continuous-velocity plot: force over velocity")


def _displacement_loops(found: Readings) -> Drawn:
    """Force over displacement along the last complete cycle."""
    return _last_cycles(found, "force_displacement", "displacement from mid stroke [mm]",
                        lambda c: 1e3 * (c.displacement - c.centre), "Force-displacement loops",
                        "Force over displacement")


def _last_cycles(found: Readings, name: str, across: str, pick: Any, title: str, stated: str) -> Drawn:
    chosen, which = _one_per_key(found)
    several = len({(b.run.specimen, b.run.level) for b in chosen}) > 1
    sign, colours = found.settings.sign, _colours(found)
    figure, ax = _chart()
    for n, block in enumerate(chosen):
        key = (block.run.specimen, block.run.level)
        label = f"{_label(found, key)}, {speed_text(block.peak)}" if several else label_of(
            found, block.run.name, block.label)
        c = block.last
        x, force = pick(c), sign * block.run.force[c.span]
        colour = colours[key] if several else CYCLE[n % len(CYCLE)]
        ax.plot(np.append(x, x[0]), np.append(force, force[0]), color=colour, label=label)
        if id(block.run) in found.models:
            model = sign * found.models[id(block.run)][c.span]
            ax.plot(x, model, "--", color=VERMILION, linewidth=1.1, label=found.model)
    _zero(ax)
    ax.axvline(0, color=INK, linewidth=0.7, zorder=1)
    ax.set(xlabel=across, ylabel="force [N]", title=title)
    _legend(ax)
    return Drawn(name, figure, f"{stated}, last complete cycle of {which}.")


def _by_current(found: Readings) -> Drawn | None:
    """(F − F_soft)/(F_hard − F_soft) over the current."""
    if len({s.current for s in found.spreads}) < 3:
        return None
    figure, ax = _chart()
    word = driver(found.data.current_unit)
    speeds = list(dict.fromkeys(s.speed for s in found.spreads))
    shown = [speeds[k] for k in np.unique(np.linspace(0, len(speeds) - 1, min(3, len(speeds))).round().astype(int))]
    specimen = found.spreads[0].specimen
    for n, speed in enumerate(shown):
        for direction, mark in ((1, "o-"), (-1, "s--")):
            own = [s for s in found.spreads if (s.specimen, s.direction, s.speed) == (specimen, direction, speed)]
            ax.errorbar([s.current for s in own], [100 * s.share for s in own], yerr=[200 * s.share_std for s in own],
                        fmt=mark, color=CYCLE[n % len(CYCLE)], markersize=4.5, capsize=2.5,
                        label=f"{speed:g} m/s {DIRECTIONS[direction]}")
    low, high = ax.get_xlim()
    ends = [min(s.current for s in found.spreads), max(s.current for s in found.spreads)]
    ax.plot(ends, [0, 100], color=MUTED, linewidth=1.0, linestyle=":", label="straight line")
    ax.set_xlim(low, high)
    ax.set(xlabel=f"{word} [{found.data.current_unit}]", ylabel="place between soft and hard [%]",
           title=f"Spread over the {word}")
    _legend(ax)
    of = f" of {specimen}" if specimen else ""
    return Drawn("by_current", figure, f"(F − F_soft)/(F_hard − F_soft){of} at standard speeds, with two standard "
                 f"errors; off the dotted line the setting is not linear in the {word}.")


def _static_line(found: Readings) -> Drawn:
    """The slowest test over displacement, with the mean of its two directions."""
    slow = min(found.static, key=lambda s: s.speed)
    block = _block_of(found, slow)
    sign, c = found.settings.sign, block.last
    x = 1e3 * (c.displacement - c.centre)
    where = "" if slow.current is None and not slow.specimen else f"{_label(found, (slow.specimen, slow.current))}, "
    figure, ax = _chart()
    ax.plot(x, sign * block.run.force[c.span], color=CYCLE[0],
            label=f"{where}{label_of(found, slow.record, slow.test)} ({speed_text(slow.speed)})")
    reach = np.array([x.min(), x.max()])
    ax.plot(reach, sign * (-slow.gas + slow.rate * 1e-3 * reach), color=VERMILION, linestyle="--",
            label="mean of both directions")
    _zero(ax)
    ax.set(xlabel="displacement from mid stroke [mm]", ylabel="force [N]",
           title="Gas force and friction" + ("" if slow.creep else ": not a creep test"))
    _legend(ax)
    return Drawn("static", figure, "The slowest test: the mean of both directions is the gas spring, half their "
                 "difference the friction" + ("." if slow.creep else ", here with the damping at this speed in both."))


def _stiffness(found: Readings) -> Drawn | None:
    """Dynamic and elastic stiffness and loss angle over frequency."""
    rows = [x for x in found.loops if x.loss_angle is not None]
    if len({round(x.frequency, 2) for x in rows}) < 2:
        return None
    colours = _colours(found)
    height = 2.7
    figure, axes = _chart(2, height, sharex=True)
    for key in colours:
        own = sorted((x for x in rows if (x.specimen, x.current) == key), key=lambda x: x.frequency)
        f = [x.frequency for x in own]
        axes[0].plot(f, [1e-3 * (x.dynamic_stiffness or 0) for x in own], "o", color=colours[key], markersize=5,
                     label=_label(found, key))
        axes[0].plot(f, [1e-3 * (x.elastic_stiffness or 0) for x in own], "o", color=colours[key], markersize=5,
                     fillstyle="none")
        axes[1].plot(f, [np.degrees(x.loss_angle or 0) for x in own], "o", color=colours[key], markersize=5,
                     label=_label(found, key))
    axes[0].set(ylabel="stiffness [N/mm]", title="Dynamic (full) and elastic (open) stiffness")
    axes[1].axhline(90, color=MUTED, linewidth=0.9, linestyle=":")
    axes[1].set(ylabel="loss angle [°]", xlabel="frequency [Hz]", xscale="log")
    axes[1].xaxis.set_minor_formatter(lambda value, _: "")
    axes[1].set_xticks(_apart([x.frequency for x in rows]))
    axes[1].xaxis.set_major_formatter(lambda value, _: f"{value:.2g}")
    _legend(axes[1], height)
    return Drawn("stiffness", figure, "Complex stiffness F₁/x₁ of the fundamental by frequency; amplitudes differ "
                 "between tests (table). 90° is a damper without elasticity.")


def _apart(frequencies: Sequence[float]) -> list[float]:
    """Frequencies whose labels do not overlap on a logarithmic axis: each a quarter above the last one that is kept."""
    kept: list[float] = []
    for f in sorted(frequencies):
        if not kept or f > 1.25 * kept[-1]:
            kept.append(f)
    return kept


def _switching(found: Readings) -> Drawn:
    """Mean response to a step of the current."""
    figure, ax = _chart()
    unit = found.data.current_unit
    longest = 3.0 * max(s.time for s in found.switching)
    for n, s in enumerate(found.switching[:MOST_CURVES]):
        keep = (s.times > -0.15 * longest) & (s.times < longest)
        colour = CYCLE[n % len(CYCLE)]
        ax.plot(1e3 * s.times[keep], 100 * s.response[keep], color=colour,
                label=f"{amps(s.low, unit)} → {amps(s.high, unit)}, {DIRECTIONS[s.direction]}: {1e3 * s.time:.3g} ms")
        ax.plot(1e3 * s.time, 90, "o", color=colour, markersize=6)
    for level in (0, 90, 100):
        ax.axhline(level, color=MUTED if level == 90 else FAINT, linewidth=0.9, linestyle=":" if level == 90 else "-")
    ax.axvline(0, color=MUTED, linewidth=0.9, linestyle=":")
    ax.set(xlabel=f"time since 10 % of the {driver(unit)}'s step [ms]", ylabel="force, share of its step [%]",
           title="Switching")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.19), ncols=1, borderaxespad=0.0)
    return Drawn("switching", figure, f"Force after a step of the {driver(unit)} at steady speed, mean over like "
                 "steps; the dot is at 90 %.")


def _drift(found: Readings) -> Drawn:
    """Force at mid stroke cycle by cycle of the longest block."""
    longest = max(found.drifts, key=lambda d: d.cycles)
    block = _block_of(found, longest)
    figure, ax = _chart()
    for n, direction in enumerate(DIRECTIONS):
        point = peak_point(block, direction)
        if point is not None:
            own = point.by_cycle[block.is_settled] if point.by_cycle.size == len(block.cycles) else point.by_cycle
            mean = float(np.mean(own))
            ax.plot(np.arange(1, point.by_cycle.size + 1), 100 * (point.by_cycle / mean - 1), "o-", markersize=3,
                    linewidth=0.8, color=CYCLE[n], label=f"{DIRECTIONS[direction]}, mean {abs(mean):.4g} N")
    ax.set(xlabel="cycle [1]", ylabel="|force| about its mean [%]", title="Drift over the cycles")
    temperature = block.run.temperature
    if temperature is not None:
        other = ax.twinx()
        means = [float(np.nanmean(temperature[c.span])) - 273.15 for c in block.cycles]
        other.plot(np.arange(1, len(means) + 1), means, color=PURPLE, linewidth=1.2)
        other.set_ylabel("temperature [°C]", color=PURPLE)
        other.grid(visible=False)
    _legend(ax)
    return Drawn("drift", figure, f"Force at mid stroke of every cycle of {longest.record}"
                 + (", and the temperature." if temperature is not None else "; no temperature was recorded."))


def _histogram(found: Readings) -> Drawn:
    """Share of the time by velocity."""
    figure, ax = _chart()
    for n, h in enumerate(found.histograms[:MOST_CURVES]):
        ax.stairs(100 * h.share, 1e3 * h.edges, color=CYCLE[n % len(CYCLE)], linewidth=1.4,
                  fill=len(found.histograms) == 1, alpha=0.75 if len(found.histograms) == 1 else 1.0, label=h.record)
    ax.axvline(0, color=INK, linewidth=0.7)
    ax.set(xlabel="velocity [mm/s], rebound right", ylabel="share of the time [%]", title="Velocity histogram")
    _legend(ax)
    return Drawn("velocity_histogram", figure, "Share of the time in classes of 10 mm/s.")


def _specimens(found: Readings) -> Drawn | None:
    """Every specimen's force against the mean, with the band where there is one."""
    sign = found.settings.sign
    means = {(s.current, s.direction, s.speed): sign * s.mean for s in found.specimens}
    bands = {(c.force.current, c.force.direction, c.force.speed): (c.lower, c.upper, c.nominal) for c in found.checks}
    keys = [k for k in dict.fromkeys((f.current, f.direction, f.speed) for f in found.given)
            if k in means or k in bands]
    if not keys:
        return None
    centre = {k: bands[k][2] if k in bands and bands[k][2] is not None else means.get(k) for k in keys}
    keys = [k for k in keys if centre[k]]
    figure, ax = _chart(height=max(HEIGHT, 1.2 + 0.24 * len(keys)))
    names = list(found.data.specimens)
    for place, k in enumerate(keys):
        middle = centre[k] or 1.0
        if k in bands:
            low, high = sorted(100 * (b / middle - 1) for b in bands[k][:2])
            ax.barh(place, high - low, left=low, height=0.7, color=FAINT, zorder=1)
        for f in found.given:
            if (f.current, f.direction, f.speed) == k:
                n = names.index(f.specimen)
                ax.plot(100 * (sign * (f.force or 0.0) / middle - 1), place, "o", markersize=4.5,
                        color=CYCLE[n % len(CYCLE)], label=shortened(f.specimen) or "measured",
                        zorder=3)
    unit = found.data.current_unit
    stated = [f"{amps(c, unit)} " * (c is not None) + f"{DIRECTIONS[d]} {v:g} m/s" for c, d, v in keys]
    ax.set_yticks(range(len(keys)), stated, fontsize=FONT - 3)
    ax.invert_yaxis()
    ax.axvline(0, color=INK, linewidth=0.7)
    ax.set(xlabel="force about its nominal or mean [%]", title="Specimens and tolerance")
    _legend(ax, ax.figure.get_figheight())
    return Drawn("specimens", figure, "Every specimen at every standard speed, against the nominal force or the mean "
                 "of the specimens; grey is the tolerance band.")
