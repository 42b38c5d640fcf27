"""The report of `quartercar fit`: ranking, experiments, figures, parameters, what was not fitted and why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.caveat import Caveat
from lpvid.export.exportable import has_step
from lpvid.plot import passivity
from lpvid.report.courses import OTHERS, channel_panels
from lpvid.report.figures import grade
from lpvid.report.formatting import number, percent
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section
from lpvid.report.traces import Curve, Panel, Traces
from lpvid.units import driver
from quartercar import plot
from quartercar.dampers.evaluation.compared import FLAGS, Compared, Comparison, energy_lines
from quartercar.dampers.evaluation.sampled_passivity import margin_of
from quartercar.plot.comparing import DRAWN, free_run_of

if TYPE_CHECKING:
    from lpvid.plot.style import Drawn as Drawing
    from quartercar.dampers.contract import Damper

FANS = 3
"""Models whose law is drawn by current, the best ones."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure with its file name and caption.

    Attributes
    ----------
    name : str
        Of the file, without extension.
    figure : array of matplotlib.axes.Axes
        As the functions of `lpvid.plot` and `quartercar.plot` return it.
    caption : str
        Below the figure.
    """

    name: str
    figure: Drawing
    caption: str


def comparison_figures(found: Comparison) -> tuple[Drawn, ...]:
    """The figures of a comparison, as in chapter 6 of the thesis (Díaz Salas 2011).

    Parameters
    ----------
    found : Comparison
        Of dampers, with at least one fitted model.

    Returns
    -------
    tuple of Drawn
        In the order of the page; by experiment, by current and of passivity only where the data and models have them.
    """
    best = found.best.name
    excerpt = plot.livelier(found.data.held_out).name
    drawn = [Drawn("ranking", plot.ranking(found), "Free-run ESR of every model on held-out data (dots) and on "
                   "training data (marks).")]
    by_experiment = plot.experiments_by_model(found)
    if by_experiment is not None:
        drawn.append(Drawn("experiments", by_experiment, "Held-out free-run ESR by experiment, the best models side by "
                           "side; replicates pooled."))
    by_current = ", by current." if found.data.held_out[0].has("current") else "."
    drawn += [Drawn("force_time", plot.force_over_time(found), "Measured force and the free runs of the best models, "
                    f"an excerpt of {excerpt}, held-out; below, what each model leaves."),
              Drawn("force_velocity", plot.force_over_velocity(found), "Force over velocity on held-out data, measured "
                    f"and {best} in free run{by_current}")]
    fan = [r for r in found.rows if r.held_out.total.esr is not None][:FANS]
    if fan:
        drawn.insert(3, Drawn("law", plot.force_velocity_fan(fan, found.data.held_out, found.data.polarity), "The "
                     "fitted law by current: force at constant velocity once everything has settled, and what was "
                     "measured, held-out, in the colour of its current. Width of the measured cloud about its curve is "
                     "hysteresis, gas force and error."))
    for row in found.rows:
        margin = margin_of(row.damper)
        if margin is not None:
            stated = (
                f"{row.title}: damping in steady sine motion at the least favourable amplitude within the "
                "speeds of its training records; negative where the model gives energy."
            )
            drawn.append(Drawn(f"passivity_{row.damper.name}", passivity(margin), stated))
    return tuple(drawn)


def comparison_page(found: Comparison, figures: Sequence[Drawn]) -> Page:
    """A page about a comparison.

    Parameters
    ----------
    found : Comparison
    figures : sequence of Drawn
        As `comparison_figures` gives them.

    Returns
    -------
    Page
    """
    drawn = {f.name: PageFigure.of(f.figure, f.caption) for f in figures}
    by_experiment: list[Item] = [drawn["experiments"], _experiments(found)] if "experiments" in drawn else []
    sections = [Section("Ranking", (_ranking(found), drawn["ranking"]))]
    if by_experiment:
        sections.append(Section("By experiment", tuple(by_experiment)))
    law = [drawn["law"]] if "law" in drawn else []
    sections += [Section("Force over time", (_force_traces(found),)),
                 Section("Force over velocity", (*law, drawn["force_velocity"], _quadrants(found))),
                 Section("Parameters", tuple(_parameters(found)))]
    energy = [drawn[f.name] for f in figures if f.name.startswith("passivity_")]
    if energy:
        stated = tuple(line for row in found.rows for line in energy_lines(row.damper))
        sections.append(Section("Energy of identified models", (Notes(stated), *energy)))
    if found.not_fitted:
        rows = tuple((name, why) for name, why in found.not_fitted)
        sections.append(
            Section("Not fitted", (PageTable(("model", "why"), rows, "Models without a fit to these data, and why."),))
        )
    sections.append(Section("Data and remarks", tuple(_remarks(found))))
    return Page("Damper models compared", found.verdict, grade(found.best.held_out.total.esr), _facts(found),
                _caveats(found), tuple(sections), _steps(found))


def _force_traces(found: Comparison) -> Traces:
    """Measured force and the best models' free runs over a whole held-out record, their errors, motion and current."""
    record = plot.livelier(found.data.held_out)
    rows = [r for r in found.rows if r.held_out.total.esr is not None][:DRAWN] or list(found.rows[:1])
    runs = {r.name: free_run_of(r, record) for r in rows}
    t, force, wide = record.times, record["force"], float(np.ptp(record["force"]))
    limits = (float(force.min()) - wide, float(force.max()) + wide)
    roles = dict(zip(runs, OTHERS[1:], strict=False))
    panels = [Panel("force [N]", (Curve("measured", t, force), *(Curve(n, t, y, roles[n]) for n, y in runs.items())),
                    limits, 260),
              Panel("error [N]", tuple(Curve(n, t, force - y, roles[n]) for n, y in runs.items()), (-wide, wide), 130),
              *channel_panels(record, ("velocity", "current"))]
    return Traces(tuple(panels), f"Measured force of {record.name}, held-out, with the free runs of the best models "
                  "and their errors.", f"Measured and simulated force of {record.name}")


def _steps(found: Comparison) -> tuple[NextStep, ...]:
    name = found.best.damper.name
    steps = []
    if found.best.fit is not None:
        steps = [_into_a_car(found.best.damper),
                 NextStep("Ask what it still gets wrong, and which cause explains that.",
                      f"lpvid diagnose DATA --baseline {OUT}/{name}.json --out diagnosis")]
    stepping = next((r.damper.name for r in found.rows if r.fit is not None and has_step(r.damper)), None)
    if stepping is not None:
        what = "it" if stepping == name else f"'{stepping}'"
        also = "" if stepping == name else ", the best one with a step of fixed length"
        steps.append(NextStep(f"Take {what} along{also}: C, FMU, MATLAB, tables.",
                          f"lpvid export {OUT}/{stepping}.json --to c --out exported"))
    if found.best.flags:
        steps.insert(
            0,
            NextStep(
                f"{found.best.name} is flagged ({', '.join(found.best.flags)}): see the remarks before you use it."
            ),
        )
    return tuple(steps)


def _into_a_car(damper: Damper) -> NextStep:
    """A ride, of the laws where the force follows the current; a model of reversed polarity would drive the car."""
    if damper.polarity < 0:
        return NextStep("A car takes a force that is positive in tension: fit again with --flip force.")
    ride = f"quartercar ride --damper {OUT}/{damper.name}.json"
    if "current" in damper.reads:
        return NextStep("Put the best model into a car and compare control laws.", f"{ride} --out ride")
    return NextStep("Put the best model into a car. Its force follows no current: there are no laws to compare.",
                    f"{ride} --controller passive --out ride")


def _facts(found: Comparison) -> tuple[tuple[str, str], ...]:
    run = found.best.held_out.total
    return (("best model", found.best.name), ("ESR, free-run, held-out", number(run.esr)),
            ("rmse, free-run, held-out", number(run.rmse, 4, "N")),
            ("energy error, held-out", percent(found.best.held_out.energy_error)),
            ("models compared", str(len(found.rows))), ("held-out samples", f"{run.n_samples:,}"))


def _caveats(found: Comparison) -> tuple[str, ...]:
    lines = [n[0].upper() + n[1:] + "." for n in found.notes if isinstance(n, Caveat)]
    lines += [] if found.complete else ["Interrupted: not all models were fitted."]
    lines += [f"{found.best.name}: {FLAGS[flag]}." for flag in found.best.flags if flag != "reversed-polarity"]
    return tuple(lines)


def _ranking(found: Comparison) -> PageTable:
    rows, marks = [], []
    for i, row in enumerate(found.rows, start=1):
        run = row.held_out.total
        rows.append((f"{i}. {row.name}", number(run.esr), number(run.fit_percent, 3), number(run.sqrt_sse),
                     number(run.rmse, 3), percent(row.held_out.energy_error, 2), number(row.training.total.esr),
                     str(len(row.damper.parameters)), number(1e3 * row.time_per_simulated_second, 2),
                     number(None if row.fit is None else row.fit.seconds, 2), ", ".join(row.flags) or "–"))
        marks.append(grade(run.esr))
    return PageTable(("model", "ESR", "fit [%]", "√SSE [N]", "rmse [N]", "energy error", "training ESR", "par.", "ms/s",
                  "fit [s]", "flags"), tuple(rows),
                 f"Free run on held-out data, the same {found.best.held_out.total.n_samples:,} samples for all models. "
                 "ms/s: time to simulate one second, compiled.", tuple(range(1, 10)), tuple(marks))


def _experiments(found: Comparison) -> PageTable:
    names = [name for name, _ in found.best.held_out.experiments]
    rows = tuple((row.name, *(number(run.esr, 3) for _, run in row.held_out.experiments)) for row in found.rows)
    folded = "" if len(names) <= 8 and len(rows) <= 12 else f"All {len(rows)} models, {len(names)} experiments"
    return PageTable(("model", *names), rows, "Held-out free-run ESR.", tuple(range(1, len(names) + 1)), folded=folded)


def _quadrants(found: Comparison) -> PageTable:
    """Where the best models err."""
    shown = found.rows[:6]
    columns = [q.where.replace("<=", " ≤ ").replace(">", " > ").replace(",", ", ") for q in shown[0].held_out.quadrants]
    rows = tuple((row.name, *(number(q.rmse, 3) for q in row.held_out.quadrants)) for row in shown)
    return PageTable(("model", *columns), rows, "rmse [N] by quadrant of velocity and displacement, held-out.",
                 tuple(range(1, len(columns) + 1)))


def _parameters(found: Comparison) -> list[Item]:
    record = found.data.training[0]
    unit = record.unit("current") if record.has("current") else ""
    return [_parameter_table(row, f"{row.name}: {row.damper.source}", "" if i == 0 else row.title, unit)
            for i, row in enumerate(found.rows)]


def _parameter_table(row: Compared, caption: str, folded: str, driven: str) -> PageTable:
    """`driven` is the unit of the current or the voltage, at whose ends some parameters hold."""
    description = {p.name: re.sub(r"\bcurrent, (\S+)$", rf"{driver(driven)}, \1 {driven}".rstrip(), p.description)
                   for p in row.damper.parameters}
    held = () if row.fit is None else row.fit.at_bounds
    rows = tuple((description[p["name"]] + (" (at its bound)" if p["name"] in held else ""), p["name"],
                  _with_error(p["value"], p["std"]), p["unit"] or "1", _share(p["value"], p["std"]))
                 for p in row.parameters)
    marks: tuple[Mark, ...] = tuple("warn" if p["name"] in held or p["value"] is None else "plain"
                                    for p in row.parameters)
    return PageTable(("what it is", "name", "value ± std. error", "unit", "± %"), rows, caption, (2, 4), marks, folded)


def _with_error(value: float | None, std: float | None) -> str:
    """A value with as many digits as its standard error allows, that with two; powers of ten in common.

    None is a value that is not identifiable from the data.

    Examples
    --------
    >>> _with_error(1234.567, 12.3), _with_error(0.000123456, 0.0000021), _with_error(5.0, None), _with_error(2e6, 3e4)
    ('1235 ± 12', '(1.235 ± 0.021)·10⁻⁴', '5', '(2.000 ± 0.030)·10⁶')
    """
    if value is None:
        return "not identifiable"
    if not np.isfinite(value):
        return "–"
    power = int(np.floor(np.log10(abs(value)))) if value else 0
    scale = 0 if -3 <= power < 5 else power
    if std is None or not np.isfinite(std) or not std > 0:
        return f"{value:.5g}" if not scale else f"{value / 10.0**scale:.4g}·10{_raised(scale)}"
    least = int(np.floor(np.log10(std / 10.0**scale)))
    digits = min(max(1 - least, 0), 6)
    shown = f"{value / 10.0**scale:.{digits}f} ± {std / 10.0**scale:.{digits}f}"
    return shown if not scale else f"({shown})·10{_raised(scale)}"


def _raised(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _share(value: float | None, std: float | None) -> str:
    return "–" if std is None or not value or not np.isfinite(std) else number(100 * std / abs(value), 2)


def _remarks(found: Comparison) -> list[Item]:
    data = found.data
    stated = f"{len(data.training)} training and {len(data.held_out)} held-out records at {data.sample_rate:.6g} Hz."
    if found.first:
        head = "sample" if found.first == 1 else f"{found.first} samples"
        stated += (f" No figure includes the first {head} of a record, from which the model with the longest past "
                   "starts.")
    lines = [n for n in found.notes if not isinstance(n, Caveat)]
    for row in found.rows:
        if row.fit is not None:
            lines += [f"{row.name}: {text}" for text in (*row.fit.undetermined[:2], *row.fit.estimate.notes[:2])]
        if not row.passivity.passive:
            lines.append(f"{row.name} is not passive: {row.passivity.description}")
    return [Paragraph(stated), *([Notes(tuple(lines))] if lines else [])]
