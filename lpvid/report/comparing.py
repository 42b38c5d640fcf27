"""Report of `lpvid compare`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from lpvid.model.adaptable import acting
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot import Comparison
from lpvid.record import Record
from lpvid.report.courses import overlay_traces
from lpvid.report.figures import comparisons, grade, verdict_grade
from lpvid.report.formatting import number
from lpvid.report.page import Item, Mark, NextStep, Notes, Page, PageTable, Paragraph, Section
from lpvid.report.responses import overlaid_figures, scheduling_places
from lpvid.simulation import Model
from lpvid.validation.comparing import ModelComparison

DRAWN = 5
"""Models that are drawn over each other, the best ones: more curves than colours that can be separated."""


def compare_page(found: ModelComparison, records: Sequence[Record],
                 fitted: Callable[[Model, list[Record]], list[Record]]) -> Page:
    """A page about several models on the same data.

    Parameters
    ----------
    found : ModelComparison
    records : sequence of Record
        As measured.
    fitted : callable
        Records with the roles that one model reads.

    Returns
    -------
    Page
    """
    best = found.models[0]
    sections = [Section("Figures", (_overall(found), _by_record(found))),
                Section("Measured and simulated", tuple(_overlays(found, records, fitted)))]
    if found.refused:
        sections.append(Section("Left out", (Notes(tuple(f"{n}: {why}" for n, why in found.refused.items())),)))
    turned = tuple(n for n in found.remarks if "--flip" in n)
    if rest := tuple(n for n in found.remarks if n not in turned):
        sections.append(Section("Remarks", (Notes(rest),)))
    facts = (("models", str(len(found.models))), ("records", str(len(best.found.records))), ("best", best.name),
             (f"its free-run ESR, {best.found.label}", number(best.found.overall.free_run.esr)))
    return Page("Models compared", found.verdict, verdict_grade(best.found), facts, turned, tuple(sections),
                (NextStep("Look at the best one alone: where it is wrong, and what is left in its residuals.",
                      f"lpvid validate {best.name}.json DATA --out checked"),
                 NextStep("See how far it is stable.", f"lpvid stability {best.name}.json --out stability")))


def beside_section(found: ModelComparison, records: Sequence[Record],
                   fitted: Callable[[Model, list[Record]], list[Record]]) -> Section:
    """Section of a model's report with other models on the same records.

    Parameters
    ----------
    found : ModelComparison
        The model of the report among them.
    records : sequence of Record
        As measured.
    fitted : callable
        Records with the roles that one model reads.

    Returns
    -------
    Section
    """
    refused: list[Item] = [Notes(tuple(f"{n}: {why}" for n, why in found.refused.items()))] if found.refused else []
    return Section("Beside other models", (_overall(found), _by_record(found), *refused,
                                           *([Notes(found.remarks)] if found.remarks else []),
                                           *_overlays(found, records, fitted)))


def _overall(found: ModelComparison) -> PageTable:
    rows, marks = [], []
    for m in found.models:
        free, one = m.found.overall.free_run, m.found.overall.one_step
        rows.append((m.name, m.found.label, number(free.esr), number(free.fit_percent),
                     number(free.rmse, 4, free.rmse_unit), number(free.mean_error, 3, free.rmse_unit), number(one.esr),
                     "–" if free.diverged_at is None else f"diverges at sample {free.diverged_at}"))
        marks.append(grade(free.esr))
    return PageTable(
        ("model", "data", "free-run ESR", "free-run fit [%]", "free-run rmse", "mean error", "one-step ESR", "remark"),
        tuple(rows),
        "Pooled over records, each about its own mean; least free-run ESR first.",
        (2, 3, 4, 5, 6),
        tuple(marks),
    )


def _by_record(found: ModelComparison) -> PageTable:
    names = [r.name for r in found.models[0].found.records]
    by_model = [{r.name: r.free_run.esr for r in m.found.records} for m in found.models]
    rows = tuple((name, *(number(esr.get(name)) for esr in by_model)) for name in names)
    marks: tuple[Mark, ...] = tuple(grade(by_model[0].get(name)) for name in names)
    return PageTable(("record", *(m.name for m in found.models)), rows, "Free-run ESR, record by record.",
                 tuple(range(1, 1 + len(found.models))), marks, f"{len(rows)} records" if len(rows) > 40 else "")


def _overlays(found: ModelComparison, records: Sequence[Record],
              fitted: Callable[[Model, list[Record]], list[Record]]) -> list[Item]:
    """All models over the record on which the best one is worst."""
    best = found.models[0].found
    worst = best.worst or best.records[0]
    shown = []
    for m in found.models[:DRAWN]:
        runs = comparisons(m.model, fitted(m.model, list(records)), m.found.label)
        shown += [(m.name, c) for c in runs if c.record.name == worst.name][:1]
    if not shown:
        return []
    left = len(found.models) - len(shown)
    more = f" The {left} models with larger errors are left out." if left > 0 else ""
    return [overlay_traces(shown, f"Free runs along {worst.name}, {best.label}, and their errors: the record on which "
                           f"the best model is worst; shaded, its worst stretch.{more}"), *_responses(found, shown)]


def _responses(found: ModelComparison, shown: Sequence[tuple[str, Comparison]]) -> list[Item]:
    """Bode plots and step responses of those that are linear and have the same signals as the best of them."""
    runs, kept = dict(shown), {}
    for m in found.models[:DRAWN]:
        model = m.model if m.name not in runs else acting(m.model, runs[m.name].record.time_base.period)
        if isinstance(model, (LPVTransferFunction, LPVStateSpace)) and m.name in runs:
            first = next(iter(kept.values()), model)
            same = [s.name for s in model.filter_inputs] == [s.name for s in first.filter_inputs]
            if same and model.sample_time is not None:
                kept[m.name] = model
    if not kept:
        return []
    places = {n: (p := scheduling_places(m.box, [runs[n]])[0])[len(p) // 2] for n, m in kept.items()}
    longest = max(runs[n].record.n_samples for n in kept)
    held = ", the scheduling held at its median" if any(m.box.names for m in kept.values()) else ""
    names = list(kept)
    items = overlaid_figures(kept, places, f"{' and '.join(names) if len(names) < 3 else 'several models'}{held}",
                             longest)
    missing = [n for n in runs if n not in kept]
    if missing:
        inputs = ", ".join(s.name for s in kept[names[0]].filter_inputs)
        items.append(Paragraph(f"Without a curve in these two figures: {', '.join(missing)}. Only models "
                               f"that are linear at a fixed scheduling, behind the same inputs ({inputs}), have one."))
    return items
