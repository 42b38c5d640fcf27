"""Page of source 003: `python docs/sources/make_003.py`, ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from writing import example, number, picture, table, write

from lpvid.plot.colours import BLUE, INK, MUTED, VERMILION
from lpvid.plot.style import label, look, panels
from quartercar.dampers import (
    NetworkChoice,
    NetworkSquares,
    StaticCharacteristic,
    choose_network,
    fit_network_squares,
    static_points,
)
from quartercar.dampers.laws.bridged import Branch, Bridged
from quartercar.dampers.laws.hydraulics import Laminar, Turbulent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lpvid import Record

BRIDGE = Bridged(
    [
        Branch("in", "a", Laminar(4e4)),
        Branch("in", "b", Turbulent(4e8)),
        Branch("a", "b", Turbulent(1e7)),
        Branch("a", "out", Turbulent(6e8)),
        Branch("b", "out", Laminar(9e4)),
    ]
)
"""a bridge in force and speed [N·s/m], [N·s²/m²]: two ways with their losses in opposite order, and a gap across"""
INTRO = """# 003: series or parallel losses in a hydraulic damper (Titurus and co-workers)

An aerospace damper with one fixed orifice, 23 triangle runs below 2 mm/s. Is its static characteristic that of a
laminar and a turbulent loss in series, or in parallel?

**Whose data.** The *source* prints figures without numbers, since a scale is confidential. *Ours* are **virtual**: a
compressible oil column behind a network, dry friction of 10 N, 1 % of noise (`examples/network_topology.py`). One
device has its losses in series, as the source concludes for its own; another has a leak beside them, which the source
does not test; a third is a bridge, one of the general networks of (3)-(4), which is no series or parallel at all.

This page is written by `python docs/sources/make_003.py`. Points are steady forces over speed; every fit is static,
so that free-run and one-step are the same, and sees all of its points (training), except where held-out is written."""


def quadrant(choice: NetworkChoice) -> tuple[np.ndarray, np.ndarray]:
    """Speeds and forces of the points, friction included."""
    return choice.points.speed, choice.points.force


def steady_levels(runs: Mapping[float, Record]) -> Figure:
    """Fig. 3: force over time of two runs, with the level that is read."""
    with look():
        figure, axes = panels(1, 2, height=2.4)
        for ax, (speed, run) in zip(axes[0], runs.items(), strict=True):
            ax.plot(run.times, run["force"], color=MUTED, linewidth=0.7, label="virtual")
            found = static_points([run])
            for force in found.force if np.ndim(found.force) else [found.force]:
                ax.axhline(float(force), color=VERMILION, linewidth=0.8)
            ax.set(xlabel=label("time", "s"), ylabel=label("force", "N"), title=f"{1e6 * speed:.3g} µm/s")
            ax.legend()
    return figure


def characteristics(choice: NetworkChoice, fits: Sequence[NetworkSquares]) -> Figure:
    """Figs. 4, 6 and 7: points and both networks, linear and logarithmic; the source's fits and ours."""
    v, f = quadrant(choice)
    grid = np.geomspace(v.min(), v.max(), 200)
    with look():
        figure, axes = panels(1, 2, height=3.0)
        for ax, scale in zip(axes[0], ("linear", "log"), strict=True):
            ax.plot(1e3 * v, f, "o", mfc="none", ms=4, color=INK, label="triangle runs, virtual")
            for fit, style in zip(fits, ("-", "--"), strict=True):
                ax.plot(
                    1e3 * grid, fit.force(grid), style, color=VERMILION, label=f"source's least squares: {fit.form}"
                )
            ax.plot(
                1e3 * grid, choice.best.force(grid), ":", color=BLUE, label=f"ours, in log force: {choice.best.network}"
            )
            ax.set(xscale=scale, yscale=scale, xlabel=label("speed", "mm/s"), ylabel=label("force", "N"))
        axes[0, 0].legend(fontsize=7)
    return figure


def bridged(speeds: np.ndarray, rng: np.random.Generator) -> StaticCharacteristic:
    """Steady points of the bridge with friction and 0.3 % of noise."""
    force = BRIDGE.pressure(speeds) + 10.0
    noise = 0.003 * force
    return StaticCharacteristic(speeds, force + noise * rng.standard_normal(speeds.size), noise)


def comparison(choices: dict[str, NetworkChoice], fits: dict[str, list[NetworkSquares]]) -> str:
    """ESR by the source's own least squares, and ours."""
    rows = []
    for truth, choice in choices.items():
        esr = {f.form: f.esr for f in fits[truth]}
        rows.append(
            [
                f"losses {truth}",
                number(esr["series"]),
                number(esr["parallel"]),
                min(esr, key=lambda n: esr[n]),
                " / ".join(f"{choice.held_out[n]:.2%}" for n in ("series", "parallel", "mixed")),
                choice.verdict,
            ]
        )
    return table(
        [
            "device, virtual",
            "ESR series, source's (7)",
            "ESR parallel, source's (8)",
            "the source's method chooses",
            "ours: held-out error of ln F, series / parallel / mixed",
            "ours chooses",
        ],
        rows,
    )


def constants(choice: NetworkChoice, fits: Sequence[NetworkSquares], truth: tuple[float, float, float]) -> str:
    """True, source's and our constants of the device in series."""
    series = next(f for f in fits if f.form == "series")
    ours = choice.fits["series"].theta
    rows = [
        ["c_L [N·s/m]", number(truth[0], 4), number(series.coefficients[0], 4), number(float(ours[0]), 4)],
        ["c_Q [N·s²/m²]", number(truth[1], 4), number(series.coefficients[1], 4), number(float(ours[1]), 4)],
        ["friction or offset [N]", "10", number(series.offset, 4), number(float(ours[3]), 4)],
    ]
    return table(["constant", "true", "source's least squares", "ours, jointly in log force"], rows)


def bridge_share() -> float:
    """Flow through the gap of the bridge at the largest speed, as a share of what enters."""
    return float(abs(BRIDGE.flows(2e-3)[2]) / 2e-3)


def main() -> None:
    """Compute everything and write the page."""
    begun = time.perf_counter()
    study = example("network_topology")
    rng = np.random.default_rng(3)
    runs = {name: [study.run(v, truth, rng) for v in study.SPEEDS] for name, truth in study.TRUTHS.items()}
    choices = {name: choose_network(static_points(found)) for name, found in runs.items()}
    choices["bridged"] = choose_network(bridged(study.SPEEDS, rng))
    fits = {name: [fit_network_squares(*quadrant(c), n) for n in ("series", "parallel")] for name, c in choices.items()}
    series = choices["series"]
    slopes = series.slopes
    bend = ", ".join(f"{s:.2f}" for s in slopes.slope[[0, len(slopes.slope) // 2, -1]])
    write(
        "003",
        [
            INTRO,
            "## Headline numbers",
            table(
                ["statement of the source", "ours, virtual", "why it differs"],
                [
                    [
                        "the series network is clearly better",
                        f"its own least squares: ESR {number(fits['series'][0].esr)}, "
                        f"parallel {number(fits['series'][1].esr)}; "
                        f"ours: {series.verdict}",
                        "ours is the device whose answer is known",
                    ],
                    [
                        "the decisive region is near 0.1 mm/s in logarithms",
                        f"slope d ln F/d ln v {bend} (slow, middle, fast): {slopes.trend}",
                        "1 to 2 is series, 2 to 1 is parallel",
                    ],
                    [
                        "the offset is the least force",
                        f"{number(fits['series'][0].offset)} N; ours {number(float(series.best.theta[3]))} N; true 10",
                        "the least force holds viscous force too (E3.7)",
                    ],
                    [
                        "two losses, in series or parallel",
                        f"a device with a leak beside the losses: {choices['mixed'].verdict}",
                        "not tested in the source (E3.9)",
                    ],
                    [
                        "general networks of nodes (3)-(4)",
                        f"a bridge with {bridge_share():.0%} of the flow across it: "
                        f"{choices['bridged'].verdict}",
                        "a static characteristic shows the order of losses, not the wiring",
                    ],
                ],
            ),
            "## Series or parallel",
            comparison(choices, fits),
            "## Constants of the device in series",
            constants(series, fits["series"], study.TRUTHS["series"]),
            "## Every figure",
            table(
                ["source", "what it shows", "here"],
                [
                    [
                        "Figs. 1, 2, 5",
                        "damper, rig, networks",
                        "drawings; `quartercar.dampers.laws.hydraulics`, bridges in `quartercar.dampers.laws.bridged`",
                    ],
                    ["Fig. 3", "steady force levels of two runs", "below"],
                    ["Fig. 4", "static characteristic, linear and logarithmic", "below, points"],
                    ["Figs. 6, 7", "both networks, linear and logarithmic", "below, lines"],
                ],
            ),
            "## Steady levels (Fig. 3)",
            picture(
                steady_levels({float(study.SPEEDS[k]): runs["series"][k] for k in (5, 20)}),
                "003-levels",
                "Steady force levels. Virtual damper, two of 23 triangle runs.",
            ),
            *(
                p
                for name, c in choices.items()
                for p in (
                    f"## Characteristic, losses {name} (Figs. 4, 6, 7)",
                    picture(
                        characteristics(c, fits[name]),
                        f"003-{name}",
                        f"Static characteristic with losses {name}. Virtual damper, all 23 points.",
                    ),
                )
            ),
        ],
    )
    print(f"{time.perf_counter() - begun:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
