"""Report of `simulate`."""

from __future__ import annotations

from lpvid.plot import Comparison
from lpvid.report.figures import driving, grade, run_figures
from lpvid.report.formatting import number, percent
from lpvid.report.page import Item, Mark, NextStep, Notes, Page, PageTable, Paragraph, Section
from lpvid.simulation import predict
from lpvid.validation.free_runs import FreeRuns


def simulation_page(found: FreeRuns, name: str) -> Page:
    """A page about a model's free runs.

    Parameters
    ----------
    found : FreeRuns
    name : str
        What to call the model.

    Returns
    -------
    Page
    """
    sections = [Section("Records", (_table(found),))]
    if found.overall is not None:
        drawn: list[Item] = run_figures(_shown(found), driving(found.model))
        sections.append(Section("Measured and simulated", tuple(drawn)))
    sections.append(Section("The model", (Paragraph(repr(found.model)),)))
    if found.notes:
        sections.append(Section("Remarks", (Notes(found.notes),)))
    share = max(r.extrapolation_share for r in found.runs)
    caveats = [f"Up to {percent(share)} of a record's samples lie outside the scheduling range of the training data: "
               "there the run is extrapolation."] if share > 0 else []
    esr = None if found.overall is None else found.overall.esr
    facts = (("data", found.label), ("records", str(len(found.runs))), ("free-run ESR", number(esr)))
    return Page(f"Simulation by {name}", verdict(found), "plain" if found.overall is None else grade(esr), facts,
                tuple(caveats), tuple(sections),
                (NextStep("See how good the model is on these data: residuals, regimes, every record.",
                      f"lpvid validate {name} DATA --out checked"),))


def verdict(found: FreeRuns) -> str:
    """The runs in one sentence.

    Parameters
    ----------
    found : FreeRuns
        Runs along one set of records.

    Returns
    -------
    str
        Diverging records come first, at most four by name.
    """
    diverged = [r.record.name for r in found.runs if r.run.diverged_at is not None]
    if diverged:
        return f"The free run diverges on {', '.join(diverged[:4])}."
    if found.overall is None:
        return "The model's free run from zero; the output was not measured, so that there are no figures."
    return f"Along {found.label} data: {found.overall}."


def _table(found: FreeRuns) -> PageTable:
    rows, marks = [], []
    for r in found.runs:
        f = r.figures
        rows.append((r.record.name, f"{r.record.n_samples:,}", number(None if f is None else f.esr),
                     number(None if f is None else f.fit_percent), number(None if f is None else f.rmse, 4, "" if f is
                     None else f.rmse_unit), percent(r.extrapolation_share)))
        marks.append(grade(f.esr) if f is not None else "plain")
    coloured: tuple[Mark, ...] = tuple(marks)
    return PageTable(
        ("record", "samples", "free-run ESR", "free-run fit [%]", "free-run rmse", "outside training range"),
        tuple(rows),
        f"Free run, {found.label}.",
        (1, 2, 3, 4, 5),
        coloured,
    )


def _shown(found: FreeRuns) -> list[Comparison]:
    signal = found.model.outputs[0]
    return [Comparison(r.record, found.label, r.run, predict(found.model, r.record, 1), signal.name, signal.unit)
            for r in found.runs]
