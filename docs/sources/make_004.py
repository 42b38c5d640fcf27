"""Page of source 004: `python docs/sources/make_004.py --full`, some ten minutes; without --full two.

--full: tests 4 and 5 at the source's 600 s on a damper that warms up, with all replicates; the page that is kept is
this one. After each model the time that is left is printed.
"""

from __future__ import annotations

import argparse
import sys
import time

import figures_004 as draw
import numpy as np
from study_004 import EXPERIMENTS, Chain, Row, compare_all, held_out, identify_chain, regressions
from writing import number, picture, table, write

import lpvid as lpv
from lpvid import plot
from quartercar.rig import default_records

GOLDEN_FILTER = ((0.0, 0.02678571, 0.02385608), (1.0, -1.6560927, 0.70673449))
"""(4.5) with ζ = 1/√2, held by a zero-order hold at 512 Hz: equation sheet 1.4.10."""

INTRO = """# 004: an MR damper by LPV models (Díaz Salas 2011)

V. A. Díaz Salas, *Magneto-rheological damper modeling using LPV systems*, M.Sc. thesis, ITESM Monterrey, January
2011. The device was a Delphi MagneRide damper at 512 Hz, the current 0 to 2.5 A. Its records are not public, and the
text that we have has lost most of its tables and equations.

**Whose data.** *Source* figures are measured on that device. *Ours* are virtual, from the default damper of
`quartercar.rig`, which lies outside every class of models below. Equal figures would be chance. The question is
whether the same statements hold.

This page is written by `python docs/sources/make_004.py --full`. Free-run figures on held-out records throughout."""


def discretised() -> tuple[np.ndarray, np.ndarray]:
    """(4.5) by zero-order hold: ω_c = 40π rad/s, ζ = 1/√2, T_s = 1/512 s."""
    from scipy.signal import cont2discrete

    w = 40 * np.pi
    found = cont2discrete(([w**2], [1.0, np.sqrt(2) * w, w**2]), 1 / 512, method="zoh")
    return np.ravel(found[0]), found[1]


def headline(chain: Chain, rows: list[Row], runs: dict[str, lpv.Record]) -> str:
    """The numbers of the thesis that survive, ours beside them."""
    by = {f"{r.family}, {r.model}": r for r in rows}
    re_estimated, form = by["LPV, canonical form, re-estimated"], by["LPV, its canonical form (3.23)"]
    others = [r.mean for r in rows if r.family not in ("LPV", "linear") and r.mean is not None]
    critical = [c.value for c in lpv.critical_scheduling(chain.canonical).values if c.value > 0]
    certificate = lpv.certify_stability(chain.canonical)
    proof = "certified" if lpv.verify(certificate, chain.canonical).holds else "not certified"
    poles = np.abs(np.concatenate([chain.canonical.frozen_poles([i]) for i in np.linspace(0, 2.5, 26)]))
    one = runs["test-1"]
    x = one["displacement"] - one["displacement"].mean()
    f = np.fft.rfftfreq(x.size, one.sample_time)
    power = np.abs(np.fft.rfft(x)) ** 2
    peak = np.sqrt(float(np.sum(power * f**2) / np.sum(power)))
    num, den = discretised()
    golden = all(np.allclose(a, b, atol=5e-9) for a, b in ((num, GOLDEN_FILTER[0]), (den, GOLDEN_FILTER[1])))
    return table(
        ["statement of the source", "source, measured", "ours, virtual", "why it differs"],
        [
            [
                "mean ESR of the LPV model",
                "below 0.04",
                f"{number(re_estimated.mean)} re-estimated; {number(form.mean)} as realised",
                "the source does not state which data; ours are held-out free runs",
            ],
            [
                "mean ESR of most other models",
                "“values below 0.1”",
                f"{number(min(others))} to {number(max(others))}",
                "an upper bound of some, no figures survive; ours are judged on motions that no fit has seen",
            ],
            [
                "a pole that does not move with the current",
                "0.83",
                "none constrained to stand still",
                "0.83 at 512 Hz is 15 Hz, the bandwidth of the source's actuator",
            ],
            [
                "current at which the frozen model turns unstable",
                "9 A",
                ", ".join(f"{c:.3g} A" for c in critical) or "none above 0 A",
                "another device, another model",
            ],
            [
                "stable from 0 to 2.5 A",
                "by eigenvalues (frozen)",
                f"largest frozen pole {poles.max():.3f}; {proof} for a current that moves",
                "frozen poles are not sufficient (E4.5)",
            ],
            [
                "largest displacement of the road",
                "0.5 in (12.7 mm)",
                f"{1e3 * np.abs(x).max():.1f} mm",
                "random phases; a road of its own",
            ],
            [
                "its main frequency",
                "around 6 Hz",
                f"{peak:.1f} Hz (r.m.s. of the spectrum)",
                "another reading of “main”",
            ],
            [
                "largest force",
                "2850 N",
                f"{max(np.abs(r['force']).max() for r in runs.values()):.0f} N",
                "another damper",
            ],
            [
                "20 Hz pre-filter (4.5), ζ = 1/√2",
                "equation lost",
                f"{num[1]:.7f} z⁻¹ + {num[2]:.7f} z⁻² over 1 − {-den[1]:.6f} z⁻¹ + {den[2]:.7f} z⁻²",
                "equals the equation sheet to 5e-9" if golden else "differs from the equation sheet",
            ],
        ],
    )


def zones_text(chain: Chain) -> list[str]:
    """Table C.1 and what the source reads from it."""
    found = chain.zones
    lines = np.array(found.lines)
    (m1, c1), (m2, c2), (m3, c3) = (lines[:, z].T for z in range(3))
    v = np.array(found.limits)
    fit = np.polynomial.polynomial.polyval(np.array(found.levels), found.stage.limit)
    r2 = 1 - np.sum((v - fit) ** 2) / np.sum((v - v.mean()) ** 2)
    rows = [
        [
            f"{level:.2f}",
            f"{1e3 * limit:.1f}",
            *(f"{a:.0f}" for a in (row[0][0], row[0][1], row[1][0], row[1][1], row[2][0], row[2][1])),
        ]
        for level, limit, row in zip(found.levels, found.limits, found.lines, strict=True)
    ]
    return [
        table(
            ["current [A]", "v_high [mm/s]", "m₁ [N·s/m]", "c₁ [N]", "m₂ [N·s/m]", "c₂ [N]", "m₃ [N·s/m]", "c₃ [N]"],
            rows,
        ),
        "Ours, virtual, for Figs. 3.2 to 3.6 and Table C.1, whose numbers are lost. Over the current:",
        table(
            ["coefficient", "at 0 A", "per A", "R² of first degree", "R² of second degree"],
            [
                [f"{r.name} [{r.unit}]", *(number(c) for c in r.coefficients), *(f"{q:.3f}" for q in r.r_squared)]
                for r in regressions(found)
            ],
        ),
        table(
            ["the source reads from its figures", "ours, virtual"],
            [
                ["v_high is a line in the current", f"R² = {r2:.3f}"],
                [
                    "m₂ is always the largest slope",
                    "yes"
                    if np.all(m2 > np.maximum(m1, m3))
                    else f"at {int(np.sum(m2 > np.maximum(m1, m3)))} of {m2.size} levels",
                ],
                [
                    "m₁ ≈ m₃",
                    f"m₁/m₃ from {np.min(m1 / m3):.2f} to {np.max(m1 / m3):.2f}: our rig has 1.3 in rebound",
                ],
                ["c₁ ≈ −c₃", f"−c₁/c₃ from {np.min(-c1 / c3):.2f} to {np.max(-c1 / c3):.2f}"],
                ["c₂ is negligible", f"up to {np.abs(c2).max():.0f} N in size: gas force and asymmetry"],
            ],
        ),
    ]


def errors_text(rows: list[Row]) -> list[str]:
    """ESR and √SSE by experiment, and the contrast between models without and with the current."""
    head = ["model", "table", *EXPERIMENTS, "mean"]
    esr = [[f"{r.family}, {r.model}", r.table, *(number(r.esr[t]) for t in EXPERIMENTS), number(r.mean)] for r in rows]
    root = [[f"{r.family}, {r.model}", *(number(r.root_sse[t]) for t in EXPERIMENTS)] for r in rows]
    contrast = []
    for family in ("Wang-Kamath", "NARX (2,2,2)", "Guo"):
        mine = [r for r in rows if r.family == family]
        without = next(r for r in mine if r.model == "without current")
        best = min((r for r in mine if r is not without), key=lambda r: np.inf if r.mean is None else r.mean)
        contrast.append([family, number(without.mean), f"{number(best.mean)} ({best.model})"])
    return [
        "## ESR of every model (Figs. 5.1 to 5.11, 5.16, 6.1)",
        table(head, esr),
        "“Diverged” is an answer: that free run left all bounds. The bars of the source are lost.",
        "**With and without the current** (Tables B.1, B.3, B.6 against B.2, B.4, B.5 to B.9), mean ESR, ours:",
        table(["family", "without the current", "best with it"], contrast),
        "## √SSE [N] (Figs. 5.1 to 5.11, 6.2)",
        table(["model", *EXPERIMENTS], root),
        "√SSE grows with the length of a record (E4.16), so that its columns cannot be compared with each other.",
    ]


def inventory() -> list[str]:
    """Every table and figure of the source, and where ours is."""
    return [
        "## Every table and figure",
        table(
            ["source", "what it shows", "here"],
            [
                [
                    "Tables 1, 2.1, 4.1, 4.2, D.1",
                    "symbols, models, road coefficients, contents of the tests",
                    "text lost; ours in the equation sheet and `quartercar.rig.EXPERIMENTS`",
                ],
                ["Tables B.1 to B.9", "coefficients of Wang, NARX, Guo", "numbers lost; ours are fitted, errors below"],
                ["Tables C.1 to C.3", "regression lines, matrices, example", "C.1 below; C.2 and C.3 lost"],
                ["Figs. 1.1 to 2.5, 3.10, C.1", "drawings of the car, the damper, the models", "drawings, no data"],
                [
                    "Figs. 1.4, 3.1, 2.2",
                    "force over velocity by current",
                    "below; for own data `quartercar.plot.loops_by_current`",
                ],
                ["Figs. 3.2, 3.3, 3.5, 3.6, C.2", "zones, slopes, intercepts, limits", "below"],
                ["Fig. 3.4", "one LTI model fails", "below"],
                ["Figs. 3.7, 3.8", "the shaped input", "below"],
                ["Fig. 3.9", "root locus", "below"],
                ["Figs. 4.1, 4.2", "device, rig", "photographs, no data"],
                ["Figs. 4.3, D.1 to D.8", "signals of the experiments", "below"],
                ["Figs. 4.4 to 4.6", "filter, its effect, derivative", "filter in the first table; `lpvid.condition`"],
                ["Figs. 5.1 to 5.11, 5.16, 6.1, 6.2", "ESR and √SSE", "below"],
                ["Figs. 5.3, 5.6, 5.12 to 5.15, 6.3, 6.4, C.3", "loops and time courses", "below"],
            ],
        ),
    ]


def main(full: bool) -> None:
    """Compute everything and write the page."""
    begun = time.perf_counter()
    training = default_records(part="training")
    kept = held_out(full)
    chain = identify_chain(training)
    rows, models = compare_all(chain, training, kept)
    first = {name: runs[0] for name, runs in kept.items()}
    constant = {round(float(r["current"].mean()), 1): r for r in kept["test-8"]}
    chosen = {
        k.split(", ", 1)[0]: models[k]
        for k in ("Guo, 15 parameters", "NARX (2,2,2), with current", "LPV, canonical form, re-estimated")
    }
    locus = plot.locus(lpv.pole_locus(chain.canonical), critical=lpv.critical_scheduling(chain.canonical))
    length = (
        "the source's 600 s on a damper that warms up, all replicates; 1.6 h of held-out records"
        if full
        else "60 s (quick mode, without `--full`; the source: 600 s), one replicate"
    )
    write(
        "004",
        [
            INTRO,
            f"Tests 4 and 5 last {length}.",
            "## Headline numbers",
            headline(chain, rows, first),
            *inventory(),
            "## Force by current (Figs. 1.4, 2.2, 3.1)",
            picture(
                draw.by_current(list(kept["test-8"])),
                "004-currents",
                "Loops at four of seven constant currents. Virtual rig, test-8.",
            ),
            "## Three zones (Figs. 3.2 to 3.6, Table C.1)",
            *zones_text(chain),
            picture(
                draw.zones(chain, [r for r in training if r.name.startswith("test-6")]),
                "004-zones",
                "Three-zone regression. Virtual rig, test-6.",
            ),
            "## One linear model fails (Fig. 3.4)",
            picture(
                draw.linear_fails(chain, constant[1.2]),
                "004-linear",
                "A linear model of velocity, and the LPV model. Virtual rig, test-8 at 1.2 A, held-out free run.",
            ),
            "## The shaped input (Figs. 3.7, 3.8)",
            picture(
                draw.shaped_input(chain, [constant[0.8], first["test-2"]]),
                "004-input",
                "Velocity and the input made of it. Virtual rig.",
            ),
            "## Root locus (Fig. 3.9)",
            picture(
                locus,
                "004-locus",
                "Poles of the re-estimated canonical form over the current. Identified from virtual data.",
            ),
            *errors_text(rows),
            picture(
                draw.errors(rows),
                "004-errors",
                "Free-run ESR of every model. Virtual rig, held-out; dashed lines are the source's, measured.",
            ),
            "## Loops and time courses (Figs. 5.3, 5.6, 5.12 to 5.15, 6.3, 6.4)",
            picture(
                draw.loops(chosen, [first["test-8"], first["test-3"]]),
                "004-loops",
                "Force over velocity and over time. Virtual rig, held-out free runs.",
            ),
            "## Signals (Figs. 4.3, D.1 to D.8)",
            picture(
                draw.signals(first),
                "004-signals",
                "Displacement, current and spectrum of the eight experiments. Virtual rig.",
            ),
        ],
    )
    print(f"{time.perf_counter() - begun:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="600 s tests with all replicates; some ten minutes")
    main(parser.parse_args().full)
