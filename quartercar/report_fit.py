"""The report of `quartercar fit`: ranking, experiments, figures, parameters, what was not fitted and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lpvid.plot import passivity
from lpvid.report import Figure, Item, Mark, Notes, Page, Paragraph, Section, Table, number
from lpvid.report.figures import grade
from lpvid.report.page import percent
from quartercar import plot
from quartercar.dampers.compared import FLAGS, Compared, Comparison, energy_lines
from quartercar.dampers.sampled_passivity import margin_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

GRAVE = ("reversed polarity", "the polarity", "no channel 'current'")
"""Beginnings of notes that stand at the head of the page."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A figure with its file name and caption."""

    name: str
    figure: Drawing
    caption: str


def comparison_figures(found: Comparison) -> tuple[Drawn, ...]:
    """The figures of a comparison, as in chapter 6 of the thesis (Díaz Salas 2011)."""
    best = found.best.name
    excerpt = plot.livelier(found.data.held_out).name
    drawn = [Drawn("ranking", plot.ranking(found), "Free-run ESR of every model on held-out data (bars) and on "
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
    for row in found.rows:
        margin = margin_of(row.damper)
        if margin is not None:
            said = (f"{row.title}: damping in steady sine motion at the least favourable amplitude; negative where the "
                    "model gives energy.")
            drawn.append(Drawn(f"passivity_{row.damper.name}", passivity(margin), said))
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
    drawn = {f.name: Figure.of(f.figure, f.caption) for f in figures}
    by_experiment: list[Item] = [drawn["experiments"], _experiments(found)] if "experiments" in drawn else []
    sections = [Section("Ranking", (_ranking(found), drawn["ranking"]))]
    if by_experiment:
        sections.append(Section("By experiment", tuple(by_experiment)))
    sections += [Section("Force over time", (drawn["force_time"],)),
                 Section("Force over velocity", (drawn["force_velocity"], _quadrants(found))),
                 Section("Parameters", tuple(_parameters(found)))]
    energy = [drawn[f.name] for f in figures if f.name.startswith("passivity_")]
    if energy:
        said = tuple(line for row in found.rows for line in energy_lines(row.damper))
        sections.append(Section("Energy of identified models", (Notes(said), *energy)))
    if found.not_fitted:
        rows = tuple((name, why) for name, why in found.not_fitted)
        sections.append(Section("Not fitted", (Table(("model", "why"), rows, "Models that these data do not allow."),)))
    sections.append(Section("Data and remarks", tuple(_remarks(found))))
    return Page("Damper models compared", found.verdict, grade(found.best.held_out.total.esr), _facts(found),
                _caveats(found), tuple(sections))


def _facts(found: Comparison) -> tuple[tuple[str, str], ...]:
    run = found.best.held_out.total
    return (("best model", found.best.name), ("ESR, free-run, held-out", number(run.esr)),
            ("rmse, free-run, held-out", number(run.rmse, 4, "N")),
            ("energy error, held-out", percent(found.best.held_out.energy_error)),
            ("models compared", str(len(found.rows))), ("held-out samples", f"{run.n_samples:,}"))


def _caveats(found: Comparison) -> tuple[str, ...]:
    lines = [n[0].upper() + n[1:] + "." for n in found.notes if n.startswith(GRAVE)]
    lines += [] if found.complete else ["Interrupted: not all models were fitted."]
    lines += [f"{found.best.name}: {FLAGS[flag]}." for flag in found.best.flags if flag != "reversed-polarity"]
    return tuple(lines)


def _ranking(found: Comparison) -> Table:
    rows, marks = [], []
    for i, row in enumerate(found.rows, start=1):
        run = row.held_out.total
        rows.append((f"{i}. {row.name}", number(run.esr), number(run.fit_percent, 3), number(run.sqrt_sse),
                     number(run.rmse, 3), percent(row.held_out.energy_error, 2), number(row.training.total.esr),
                     str(len(row.damper.parameters)), number(1e3 * row.time_per_simulated_second, 2),
                     number(None if row.fit is None else row.fit.seconds, 2), ", ".join(row.flags) or "–"))
        marks.append(grade(run.esr))
    return Table(("model", "ESR", "fit [%]", "√SSE [N]", "rmse [N]", "energy error", "training ESR", "par.", "ms/s",
                  "fit [s]", "flags"), tuple(rows),
                 f"Free run on held-out data, the same {found.best.held_out.total.n_samples:,} samples for all models. "
                 "ms/s: time to simulate one second, compiled.", tuple(range(1, 10)), tuple(marks))


def _experiments(found: Comparison) -> Table:
    names = [name for name, _ in found.best.held_out.experiments]
    rows = tuple((row.name, *(number(run.esr, 3) for _, run in row.held_out.experiments)) for row in found.rows)
    folded = "" if len(names) <= 8 and len(rows) <= 12 else f"All {len(rows)} models, {len(names)} experiments"
    return Table(("model", *names), rows, "Held-out free-run ESR.", tuple(range(1, len(names) + 1)), folded=folded)


def _quadrants(found: Comparison) -> Table:
    """Where the best models err."""
    shown = found.rows[:6]
    columns = [q.where.replace("<=", " ≤ ").replace(">", " > ").replace(",", ", ") for q in shown[0].held_out.quadrants]
    rows = tuple((row.name, *(number(q.rmse, 3) for q in row.held_out.quadrants)) for row in shown)
    return Table(("model", *columns), rows, "rmse [N] by quadrant of velocity and displacement, held-out.",
                 tuple(range(1, len(columns) + 1)))


def _parameters(found: Comparison) -> list[Item]:
    return [_parameter_table(row, f"{row.name}: {row.damper.source}", "" if i == 0 else row.title)
            for i, row in enumerate(found.rows)]


def _parameter_table(row: Compared, caption: str, folded: str) -> Table:
    says = {p.name: p.says for p in row.damper.parameters}
    held = () if row.fit is None else row.fit.at_bounds
    rows = tuple((p["name"] + (" (at its bound)" if p["name"] in held else ""), number(p["value"], 5),
                  number(p["std"], 2), p["unit"] or "1", says[p["name"]]) for p in row.parameters)
    marks: tuple[Mark, ...] = tuple("warn" if p["name"] in held else "plain" for p in row.parameters)
    return Table(("parameter", "value", "std. error", "unit", "what it is"), rows, caption, (1, 2), marks, folded)


def _remarks(found: Comparison) -> list[Item]:
    data = found.data
    said = f"{len(data.training)} training and {len(data.held_out)} held-out records at {data.sample_rate:.6g} Hz."
    if found.first:
        said += (f" The first {found.first} samples of every record count for no model: the longest start takes them "
                 "from the measurement.")
    lines = [n for n in found.notes if not n.startswith(GRAVE)]
    for row in found.rows:
        if row.fit is not None:
            lines += [f"{row.name}: {text}" for text in (*row.fit.undetermined[:2], *row.fit.estimate.notes[:2])]
        if not row.passivity.passive:
            lines.append(f"{row.name} is not passive: {row.passivity.says}")
    return [Paragraph(said), *([Notes(tuple(lines))] if lines else [])]
