"""The report of `quartercar ride`: what each law trades, its figures with intervals, its energy, its parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid.report.courses import signal_traces
from lpvid.report.formatting import number, percent
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section
from lpvid.report.traces import Traces
from quartercar.criteria import comfort_classes
from quartercar.plot import rides as plot
from quartercar.plot.ride_spectra import SEGMENT, SEGMENTS, sensitive_band, spectra
from quartercar.report.bound import bound_items, bound_row
from quartercar.report.fit import Drawn
from quartercar.rides.bound import Bound
from quartercar.rides.comparison import Interval, LawRow, RideComparison
from quartercar.rides.tuning import Tuned
from quartercar.roads.ride_roads import LEAD

CRITERIA = {"comfort": ("comfort", "m/s²", 1.0), "tyre_load": ("tyre load, rms", "N", 1.0),
            "stroke": ("stroke, rms", "mm", 1e3)}


def ride_figures(found: RideComparison, bounds: Sequence[Bound] = ()) -> tuple[Drawn, ...]:
    """The figures of a comparison of rides, with the bounds marked.

    Parameters
    ----------
    found : RideComparison
        Of laws over the same roads.
    bounds : sequence of Bound
        What the damper could have reached; none by default.

    Returns
    -------
    tuple of Drawn
        The trade-offs, then spectra (of a ride long enough for an average) and signals of every road.
    """
    seeds = "one seed" if len(found.seeds) == 1 else f"{len(found.seeds)} seeds, bars: 95 % intervals, paired by seed"
    marked = ("" if not bounds else " Stars: best current found for the known road, at the objective and at "
              "either end (comfort at the reference's tyre load, tyre load at its comfort); no law can "
              "reach them, as none has the road in advance.")
    drawn = [Drawn("pareto", plot.trade_offs(found, bounds), "Weighted acceleration against tyre load and against "
                   f"stroke, as a difference to {found.reference} on the same roads and noise; {seeds}; dashed: laws "
                   f"that no other beats in both. Down and left is better; a law more than {plot.FRAME:g} % above the "
                   "best is named at the edge of the frame. Hollow: the model of the damper gave out more energy than "
                   f"it had taken in, so that no real damper reaches this point.{marked}")]
    for k, road in enumerate(found.roads, start=1):
        averaged = spectra([(r.name, r.rides[0].run) for r in found.on(road)], LEAD)
        if averaged is not None:
            drawn.append(Drawn(f"spectra_{k}", averaged, f"{road}, first seed: power spectral density of body "
                               "acceleration, tyre force and stroke; below, how the road's elevation comes through "
                               "(the best linear description on this road); last, the weighted acceleration by third "
                               "octave and the weighting itself. Shaded: where ISO 2631-1 weighs most, "
                               f"{sensitive_band()[0]:.1f} to {sensitive_band()[1]:.1f} Hz."))
        drawn.append(Drawn(f"time_{k}", plot.over_time(found, road), f"The liveliest {plot.EXCERPT:g} s of {road}, "
                           "first seed."))
    return tuple(drawn)


def ride_page(found: RideComparison, figures: Sequence[Drawn], tuned: Mapping[str, Tuned] | None = None,
              facts: Sequence[tuple[str, str]] = (), bounds: Sequence[Bound] = ()) -> Page:
    """A page about a comparison of rides.

    Parameters
    ----------
    found : RideComparison
    figures : sequence of Drawn
        As `ride_figures` gives them.
    tuned : mapping of str to Tuned, optional
        Where the laws were tuned.
    facts : sequence of (str, str)
        Car, damper, sensors.
    bounds : sequence of Bound
        What the damper could have reached.

    Returns
    -------
    Page
    """
    drawn = {f.name: PageFigure.of(f.figure, f.caption) for f in figures}
    sections = [Section("Winners", (_winners(found),)), Section("What each law trades", (drawn["pareto"],))]
    if bounds:
        sections.append(Section("What the damper could have reached", bound_items(bounds)))
    for k, road in enumerate(found.roads, start=1):
        averaged = [drawn[f"spectra_{k}"] if f"spectra_{k}" in drawn else Paragraph(
            f"No spectra of this road: an average of {SEGMENTS} segments of {SEGMENT:g} s, half overlapping, needs "
            f"{SEGMENT * (SEGMENTS + 1) / 2:g} s after the first {LEAD:g} s. A longer road, or repeated more often, "
            "has them.")]
        sections.append(Section(road, (_figures(found, road, bounds), _against(found, road), _ride_traces(found, road),
                                       *averaged)))
    sections += [Section("Energy and passivity", _energy(found)), Section("Laws", tuple(_laws(found, tuned or {})))]
    if found.notes:
        sections.append(Section("Remarks", (Notes(found.notes),)))
    shown = (*facts, ("laws", str(len(found.names))), ("seeds", str(len(found.seeds))))
    return Page("Ride comparison", found.verdict, "plain", tuple(shown), _caveats(found), tuple(sections),
                _steps(found, bool(bounds), bool(tuned)))


def _winners(found: RideComparison) -> PageTable:
    """Road by road and criterion by criterion: the best law, its figure, and who cannot be separated from it."""
    rows = []
    for road in found.roads:
        reference = found.row(found.reference, road)
        for name, (stated, unit, scale) in CRITERIA.items():
            best, near = found.leaders(road, name)
            gap = "–" if best is reference else _share(best.against(reference, name))
            feels = ", ".join(comfort_classes(best.interval(name).mean)) if name == "comfort" else "–"
            rows.append((road, stated, best.name, f"{_described(best.interval(name), scale)} {unit}", gap,
                         ", ".join(near) or "–", feels))
    columns = ("road", "criterion", "best law", "its mean", f"against {found.reference}",
               "not distinguishable from it", "likely reaction (ISO 2631-1, annex C)")
    return PageTable(
        columns,
        tuple(rows),
        "Means over the seeds ± half of the 95 % interval; not distinguishable: paired "
        "by seed, the 95 % interval of the difference holds zero.",
        (3, 4),
    )


def _ride_traces(found: RideComparison, road: str) -> Traces:
    """Body acceleration, tyre load, stroke and current of a few laws over the whole ride of the first seed."""
    rows = plot.shown_laws(found, road)
    runs = {r.name: r.rides[0].run for r in rows}
    return signal_traces(rows[0].rides[0].run.time, plot.signal_panels(runs), f"{road}, seed {rows[0].rides[0].seed}: "
                         "the whole ride under the reference, the passive car and the most comfortable law.")


def _steps(found: RideComparison, bounded: bool, tuned: bool) -> tuple[NextStep, ...]:
    steps = []
    if len(found.seeds) < 5:
        steps.append(NextStep("More roads and noises make the intervals narrower: add --seeds 10."))
    if not tuned:
        steps.append(
            NextStep("The laws have their default parameters: tune them before you compare them, with --tune 40.")
        )
    if not bounded:
        steps.append(NextStep("See what this damper could have reached at best on these roads: add --bound."))
    best = found.leaders(found.roads[0], "comfort")[0].name
    steps.append(NextStep("Take a law to a control unit.", f"quartercar export --controller {OUT}/{best}.json --to c "
                      "--out exported"))
    return tuple(steps)


def _described(interval: Interval, scale: float = 1.0, digits: int = 4) -> str:
    """A mean with half of its interval.

    Examples
    --------
    >>> _described(Interval(1.5, 1.4, 1.6))
    '1.500 ± 0.1'
    """
    if interval.high is None:
        return number(scale * interval.mean, digits)
    mean = f"{scale * interval.mean:#.{digits}g}".rstrip(".")
    return f"{mean} ± {number(scale * (interval.high - interval.mean), 2)}"


def _caveats(found: RideComparison) -> tuple[str, ...]:
    lines = []
    if len(found.seeds) < 2:
        lines.append("One seed only: nothing here has an interval.")
    for name in found.names:
        left = max(float(np.mean([x.counts.get("scheduling_outside", 0.0) for x in r.rides]))
                   for r in found.rows if r.name == name)
        if left:
            lines.append(f"{name}: its scheduling left the box of its design in {percent(left)} of the samples and was "
                         "held at the edge; the bound of the design does not hold there.")
    bad = sorted({r.name for r in found.rows if r.passive is False})
    if bad:
        lines.append(f"The damper's model gave out more energy than it had taken in under {', '.join(bad)}.")
    if any(r.passive is None for r in found.rows):
        lines.append("No storage function of this damper model is known: passivity is assessed by the share of samples "
                     "with F·v < 0 and their energy.")
    return tuple(lines)


def _figures(found: RideComparison, road: str, bounds: Sequence[Bound]) -> PageTable:
    rows = tuple((r.name, _described(r.interval("comfort")), _described(r.interval("tyre_load")),
                  _described(r.interval("stroke"), 1e3, 3), number(1e3 * r.interval("largest_stroke").mean, 3),
                  number(r.interval("transient").mean, 4), percent(r.interval("off_road").mean),
                  percent(r.interval("at_limits").mean), percent(r.interval("out_of_reach").mean),
                  ", ".join(comfort_classes(r.interval("comfort").mean)))
                 for r in found.on(road))
    marks: tuple[Mark, ...] = tuple("good" if r.name in found.front[road] else "plain" for r in found.on(road))
    rows += tuple(bound_row(b) for b in bounds if b.road == road)
    marks += ("plain",) * (len(rows) - len(marks))
    return PageTable(
        (
            "law",
            "comfort [m/s²]",
            "tyre load [N]",
            "stroke [mm]",
            "largest [mm]",
            "MTVV [m/s²]",
            "off road",
            "current at a limit",
            "demand out of reach",
            "likely reaction",
        ),
        rows,
        "Means over the seeds ± half of the 95 % interval; comfort is W_k-weighted (ISO 2631-1), tyre load "
        "and stroke are rms. Likely reaction: ISO 2631-1, annex C, overlapping classes. Green: unbeaten "
        "in comfort and tyre load at once.",
        tuple(range(1, 9)),
        marks,
    )


def _against(found: RideComparison, road: str) -> PageTable:
    reference = found.row(found.reference, road)
    rows = tuple((r.name, *(_share(r.against(reference, n)) for n in ("comfort", "tyre_load", "stroke")))
                 for r in found.on(road) if r.name != found.reference)
    return PageTable(
        ("law", "comfort", "tyre load", "stroke"),
        rows,
        f"Difference to {found.reference} on the same roads "
        "and noise, paired by seed, ± half of the 95 % interval; negative is better.",
        (1, 2, 3),
    )


def _share(interval: Interval) -> str:
    half = "" if interval.high is None else f" ± {number(100 * (interval.high - interval.mean), 2)}"
    return f"{100 * interval.mean:+.2f}{half} %"


def _energy(found: RideComparison) -> tuple[Item, ...]:
    def passive(row: LawRow) -> str:
        return "unknown storage" if row.passive is None else "yes" if row.passive else "NO"

    rows = tuple((r.road, r.name, _described(r.interval("dissipated"), digits=4), passive(r),
                  percent(r.interval("negative_share").mean, 3), number(r.interval("negative_energy").mean, 3),
                  number(max(x.passivity.returned for x in r.rides), 3)) for r in found.rows)
    known = all(r.passive is not None for r in found.rows)
    text = ("Delivered energy less stored energy, gas and spring, never fell below the initial storage where the "
            "column has yes." if known else
            "Energy that the damper's model gave back came from what it stored (compliance) or from errors of the "
            "model; the last columns bound both.")
    return (Paragraph(text), PageTable(("road", "law", "taken [J]", "passive", "F·v < 0", "energy in them [J]",
                                    "most at a stretch [J]"), rows,
                                   "Energy of the damper, the force of displacement alone left out.", (2, 4, 5, 6)))


def _laws(found: RideComparison, tuned: Mapping[str, Tuned]) -> list[Item]:
    out: list[Item] = []
    for row in found.on(found.roads[0]):
        law = row.controller
        rows = tuple(
            (p.name, number(law.values[p.name], 5), p.unit or "1", f"{p.lower:g} to {p.upper:g}", p.description)
            for p in law.parameters
        )
        stated = f"{law.title}: {law.source}."
        if row.name in tuned:
            t = tuned[row.name]
            stated += f" Tuned in {t.evaluations} evaluations: objective {t.before:.4f} to {t.objective:.4f}."
        out.append(
            PageTable(("parameter", "value", "unit", "range", "what it is"), rows, stated, (1,), folded=row.name)
        )
    return out
