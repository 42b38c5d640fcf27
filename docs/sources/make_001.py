"""Page of source 001: `python docs/sources/make_001.py`, about a minute."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import numpy as np
from study_001 import (
    AMPLITUDES,
    FREQUENCY,
    HELD_OUT,
    REGIMES,
    TRAINING,
    UNIT_1,
    UNIT_2,
    convexity,
    fit_models,
    line,
    steady,
)
from writing import number, picture, table, write

import lpvid as lpv
from lpvid.plot.colours import BLUE, INK, MUTED, VERMILION
from lpvid.plot.style import label, look, panels
from quartercar.dampers.bench.characteristic import CharacteristicLine, characteristic_line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from quartercar.dampers.laws.relief_valve import LagDamper

BAND = 0.15
"""half width of our qualification band, a share of unit 1's force; the source's band is not printed in numbers"""
INTRO = """# 001: a helicopter lag damper with relief valves (Titurus and Lieven)

B. Titurus and N. A. J. Lieven, *Model validation and experimentally driven hydraulic damper model refinement*,
University of Bristol. Two nominally identical dampers on a servo-hydraulic rig, sines of 3.5 Hz with eleven
amplitudes from 0.23 to 27.28 mm. All results of the source are dimensionless and in figures only; there are no
tables.

**Whose data.** *Source* statements rest on measured dampers. *Ours* are virtual: a device outside the class of both
models, with leakage, seal friction, changing chamber volumes and other powers in both flow laws
(`docs/sources/study_001.py`). Unit 2 has a relief setting 10 % lower, softer oil and 0.1 mm of play.

This page is written by `python docs/sources/make_001.py`. Free runs throughout; unit 2 and five
of the eleven amplitudes, the two largest among them, are held out."""


def esr(model: LagDamper, runs: list[lpv.Record]) -> float | None:
    """Pooled free-run ESR."""
    return lpv.validate(model, runs).overall.free_run.esr


def loops(models: dict[str, LagDamper], name: str, first: list[lpv.Record], second: list[lpv.Record]) -> Figure:
    """Fig. 4 or 5: three regimes, force over displacement above and over velocity below."""
    with look():
        figure, axes = panels(2, 3, height=2.5)
        for (top, bottom), (regime, k) in zip(axes.T, REGIMES.items(), strict=True):
            shown = first[k].with_channel("model", lpv.simulate(models[name], first[k]).output[:, 0], "N")
            part = steady(shown)
            for ax, channel in ((top, "displacement"), (bottom, "velocity")):
                ax.plot(
                    first[k][channel][part], first[k]["force"][part], color=INK, linewidth=0.8, label="unit 1, virtual"
                )
                ax.plot(second[k][channel][part], second[k]["force"][part], ":", color=MUTED, label="unit 2, virtual")
                ax.plot(shown[channel][part], shown["model"][part], color=VERMILION, label=f"{name} model, free run")
                ax.set_xlabel(label(channel, first[k].unit(channel)))
            top.set_title(f"{regime} regime, {first[k].name}")
        for ax in axes[:, 0]:
            ax.set_ylabel(label("force", "N"))
        axes[0, 0].legend(fontsize=7)
    return figure


def characteristic(lines: dict[str, CharacteristicLine], first: np.ndarray, second: np.ndarray) -> Figure:
    """Fig. 6 a) and b): largest and smallest force over velocity in the outer quadrants, and the band."""
    with look():
        figure, axes = panels(1, 2, height=3.4)
        for ax, (name, found) in zip(axes[0], lines.items(), strict=True):
            for speed, force in ((0, 2), (1, 3)):
                order = np.argsort(first[:, speed])
                low, high = ((1 + s * BAND) * first[order, force] for s in (-1, 1))
                ax.fill_between(
                    first[order, speed],
                    low,
                    high,
                    color=BLUE,
                    alpha=0.15,
                    linewidth=0,
                    label=f"band, ±{BAND:.0%} of unit 1" if speed == 0 else None,
                )
                ax.plot(
                    first[:, speed],
                    first[:, force],
                    "o",
                    color=INK,
                    ms=4,
                    mfc="none",
                    label="unit 1, virtual" if speed == 0 else None,
                )
                ax.plot(
                    second[:, speed],
                    second[:, force],
                    "^",
                    color=MUTED,
                    ms=4,
                    label="unit 2, virtual" if speed == 0 else None,
                )
            ax.plot(found.speed, found.highest, "s-", color=VERMILION, ms=3, label=f"{name} model")
            ax.plot(-found.speed, found.lowest, "s-", color=VERMILION, ms=3)
            ax.axhline(0, color=MUTED, linewidth=0.5)
            ax.axvline(0, color=MUTED, linewidth=0.5)
            ax.set(
                xlabel=label("largest and smallest velocity", "m/s"),
                ylabel=label("force", "N"),
                title=f"Fig. 6: {name} model",
            )
            ax.legend(fontsize=7, loc="upper left")
    return figure


def by_run(models: dict[str, LagDamper], first: list[lpv.Record], second: list[lpv.Record]) -> str:
    """Free-run ESR of both models at every amplitude."""
    rows = []
    for k, run in enumerate(first):
        use = "training" if k in TRAINING else "held-out"
        rows.append(
            [
                run.name,
                f"{1e3 * run['velocity'].max():.0f}",
                use,
                *(number(esr(m, [run])) for m in models.values()),
                *(number(esr(m, [second[k]])) for m in models.values()),
            ]
        )
    return table(
        [
            "amplitude",
            "speed [mm/s]",
            "unit 1 is",
            "baseline, unit 1",
            "extended, unit 1",
            "baseline, unit 2 (held-out)",
            "extended, unit 2 (held-out)",
        ],
        rows,
    )


def statements(
    models: dict[str, LagDamper],
    first: list[lpv.Record],
    second: list[lpv.Record],
    lines: dict[str, CharacteristicLine],
) -> str:
    """What the source concludes, and ours."""
    fast = [first[k] for k in HELD_OUT]
    one, two = line(first), line(second)
    slopes = {name: convexity(found.speed, found.highest) for name, found in lines.items()}
    device = convexity(one[:, 0], one[:, 2])
    errors = {name: esr(model, fast) for name, model in models.items()}
    low = {name: esr(model, [first[0]]) for name, model in models.items()}
    spread = np.abs(two[:, 2] / one[:, 2] - 1)
    miss = np.abs(np.interp(one[:, 0], lines["extended"].speed, lines["extended"].highest) / one[:, 2] - 1)
    outside = int(np.sum(spread > BAND))
    return table(
        ["the source finds", "ours, virtual", "why it differs"],
        [
            [
                "after the valves open, the tests' force grows convexly",
                f"convexity {device:.2f} (ratio of the last two secants)",
                "the number is ours; the source shows curves",
            ],
            [
                "the baseline's grows concavely there (Fig. 6a)",
                f"convexity {slopes['baseline']:.2f}",
                "the fit makes up for the missing ring by a smaller valve, so that the line stays nearly straight",
            ],
            [
                "a ring of holes behind the valves mends it (Fig. 6b)",
                f"convexity {slopes['extended']:.2f}; held-out ESR {number(errors['extended'])}, "
                f"baseline {number(errors['baseline'])}",
                "our ring has another power than the model's",
            ],
            [
                "at low velocity both models miss friction, air and play",
                f"ESR {number(low['baseline'])} and {number(low['extended'])} at {first[0].name}",
                "our models contain a friction, the source's do not",
            ],
            [
                "the two units differ, one is outside the qualification band",
                f"unit 2 off by up to {spread.max():.0%}, at {outside} of {spread.size} amplitudes outside ±{BAND:.0%}",
                "the band is ours",
            ],
            [
                "the spread of units can exceed the distance of model and test",
                f"median {np.median(spread):.1%} between units, {np.median(miss):.1%} from model to unit 1",
                "the spread of unit 2 is chosen by us",
            ],
            [
                "loops over velocity have an area: compressible oil",
                f"{lines['extended'].lag_area[REGIMES['middle']]:.0f} W in the extended model, middle regime",
                "–",
            ],
            [
                "valve oscillations are visible at high velocity",
                "none: the poppets of our device have no mass",
                "left out on purpose: foreign to both models",
            ],
        ],
    )


def expectations(
    models: dict[str, LagDamper],
    first: list[lpv.Record],
    second: list[lpv.Record],
    lines: dict[str, CharacteristicLine],
) -> str:
    """What was written down before the first run of the models (see `study_001`), and whether it came true."""
    one, two = line(first), line(second)
    bend = {name: convexity(found.speed, found.highest) for name, found in lines.items()}
    fast = {name: esr(model, [first[k] for k in HELD_OUT]) or np.inf for name, model in models.items()}
    low = min(esr(model, [first[0]]) or np.inf for model in models.values())
    extended = np.interp(one[:, 0], lines["extended"].speed, lines["extended"].highest)
    apart, miss = (float(np.median(np.abs(f / one[:, 2] - 1))) for f in (two[:, 2], extended))
    rows = [
        ("device and extended model convex", min(convexity(one[:, 0], one[:, 2]), bend["extended"]) > 1),
        ("baseline concave", bend["baseline"] < 1),
        ("extended below a fifth of the baseline's ESR, two fastest runs", fast["extended"] < fast["baseline"] / 5),
        ("at the smallest amplitude both miss more than the noise of 1 %", low > 1e-4),
        ("units farther apart than the extended model from unit 1", apart > miss),
    ]
    return table(["expected before measuring", "came true"], [[name, "yes" if held else "no"] for name, held in rows])


def parameters(models: dict[str, LagDamper]) -> str:
    """Parameters of both fits."""
    names = sorted({n for m in models.values() for n in m.values})
    return table(
        ["parameter", *models],
        [[f"`{n}`", *(number(m.values[n], 4) if n in m.values else "–" for m in models.values())] for n in names],
    )


def main() -> None:
    """Compute everything and write the page."""
    begun = time.perf_counter()
    rng = np.random.default_rng(1)
    first, second = ([unit.run(a, rng) for a in AMPLITUDES] for unit in (UNIT_1, UNIT_2))
    models = fit_models(first)
    lines = {name: characteristic_line(model, AMPLITUDES, FREQUENCY) for name, model in models.items()}
    write(
        "001",
        [
            INTRO,
            "## What the source concludes",
            statements(models, first, second, lines),
            "## Expected and found",
            expectations(models, first, second, lines),
            "## Every figure",
            table(
                ["source", "what it shows", "here"],
                [
                    ["Figs. 1, 2", "layout of the damper, the ring of holes", "drawings; [dampers](../dampers.md)"],
                    ["Fig. 3", "rig", "photograph, no data"],
                    ["Fig. 4", "baseline model and two units, three regimes, both loops", "below"],
                    ["Fig. 5", "the same for the extended model", "below"],
                    ["Fig. 6 a), b)", "characteristic lines with the qualification band", "below"],
                ],
            ),
            "## Loops in three regimes (Fig. 4)",
            picture(
                loops(models, "baseline", first, second),
                "001-baseline",
                "Baseline model and two units. Virtual devices; steady cycles.",
            ),
            "## Loops in three regimes (Fig. 5)",
            picture(
                loops(models, "extended", first, second),
                "001-extended",
                "Extended model and two units. Virtual devices; steady cycles.",
            ),
            "## Characteristic lines (Fig. 6)",
            picture(
                characteristic(lines, line(first), line(second)),
                "001-lines",
                "Characteristic lines of both models. Virtual devices; extreme forces over extreme velocities. Oil is "
                "compressible, so that the two are not simultaneous.",
            ),
            "The inner quadrants, where force and velocity have opposite signs, hold no extreme: a damper that only "
            "takes energy does not reach them.",
            "## Free-run ESR by amplitude",
            by_run(models, first, second),
            "## Fitted parameters",
            parameters(models),
        ],
    )
    print(f"{time.perf_counter() - begun:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
