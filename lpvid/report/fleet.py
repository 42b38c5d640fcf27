"""Report of `lpvid fleet`: which files differ, by which cause, how strongly; links to the reports of each file."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.fleet.running import FleetResult
from lpvid.plot.fleet import departures
from lpvid.report.formatting import number
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section

if TYPE_CHECKING:
    from lpvid.fleet.plan import Job


def fleet_page(found: FleetResult) -> Page:
    """A page about a fleet.

    Parameters
    ----------
    found : FleetResult

    Returns
    -------
    Page
    """
    named = () if found.differing is None else found.differing.named
    mark: Mark = "bad" if named else "warn" if found.failed or found.warned else "good"
    count = len(found.plan.jobs)
    facts = [("files", str(count)), ("done", str(count - len(found.failed))), ("differ", str(len(named)))]
    if found.differing is not None:
        facts.append(("median free-run ESR, training", number(found.median_esr)))
        facts.append(("false discovery rate", f"{found.plan.fdr:g}"))
    sections = []
    if found.differing is not None and np.isfinite(found.differing.centre):
        sections.append(Section("Which files differ", tuple(_who(found))))
    elif found.differing is not None:
        few = Paragraph("No file is named: the spread between fewer than eight files is too uncertain.")
        sections.append(Section("Which files differ", (few,)))
    sections.append(Section("All files", (_all(found),)))
    if found.failed or found.left_out:
        sections.append(Section("Not done", (Notes(tuple(_faults(found))),)))
    return Page("Fleet", found.verdict, mark, tuple(facts), (), tuple(sections), _next(found))


def _next(found: FleetResult) -> tuple[NextStep, ...]:
    """What failed, then the file that lies furthest away, then the model of all."""
    steps = []
    if found.failed:
        steps.append(NextStep("Mend the files that were not done, and run the same command again: only what is missing "
                              "in the folder is done."))
    named = () if found.differing is None else found.differing.named
    if named:
        first = next(job for job in found.plan.jobs if job.name == named[0])
        steps.append(NextStep(f"Look at {first.name} first, which lies furthest from the fleet.",
                              f"lpvid inspect {shlex.quote(str(first.path))} --out audit"))
        if "diagnose" not in found.plan.do:
            steps.append(NextStep("Find the causes in the files that differ: run the same command with --do "
                                  "audit,identify,diagnose."))
    if found.errors:
        steps.append(NextStep("Judge the model of all files on records of another day.",
                              f"lpvid validate {OUT}/model/model.json NEW.csv --out checked"))
    else:
        steps.append(NextStep("Fit one model to all files, and see which of them differ: run the same command with "
                              "--do audit,identify and the names of input, output and scheduling."))
    return tuple(steps)


def _who(found: FleetResult) -> list[Item]:
    assert found.differing is not None
    items: list[Item] = [
        Paragraph(
            "The model of all files that do not differ is compared with each file's own fit of the same "
            "structure. A file differs where its parameters lie further from the fleet's than noise and the "
            "spread between the other files explain."
        ),
        PageFigure.of(
            departures(found.errors, found.differing),
            "Distance of each file from the fleet, over the typical "
            "one, against the free-run ESR of the fleet's model along it, training data. Orange: files that "
            "differ.",
        ),
    ]
    if found.against:
        items.append(Paragraph(f"Diagnosed against {found.against}."))
    rows = tuple((n, *_errors(found.errors.get(n)), number(found.differing.score[n], 3), f"{found.differing.q[n]:.2g}",
                  str(found.diagnoses.get(n, "–")), f"files/{n}/") for n in found.differing.named)
    if rows:
        items.append(
            PageTable(
                ("file", "free-run ESR", "rmse", "mean error", "score", "q", "cause", "its reports"),
                rows,
                "Score: distance from the fleet over the typical one. q: least false discovery rate at "
                "which the file is named. Cause: what the file has beyond the law and the causes that healthy files "
                "share, or in a strength outside theirs, with its probability; after it, those that the file's data "
                "cannot distinguish; without either, the verdict. As in healthy files: named by its diagnosis, but no "
                "stronger than there.",
                (1, 2, 3, 4, 5),
            )
        )
    return items


def _errors(e: Mapping[str, Any] | None) -> tuple[str, str, str]:
    if e is None:
        return "–", "–", "–"
    return (number(e["esr"]) if not e["diverged"] else "diverges", number(e["rmse"], 4, e["unit"]),
            number(e["mean_error"], 3, e["unit"]))


def _all(found: FleetResult) -> PageTable:
    rows, marks = [], []
    named = () if found.differing is None else found.differing.named
    for job in found.plan.jobs:
        warned = found.warned.get(job.name, ())
        rows.append((job.name, *_errors(found.errors.get(job.name)), ", ".join(warned) or "–", _steps(found, job)))
        marks.append("bad" if job.name in found.failed else "warn" if job.name in named or warned else "good")
    return PageTable(("file", "free-run ESR", "rmse", "mean error", "the audit warns of", "steps"), tuple(rows),
                 "Free run of the model of all files along each, training data." if found.errors else "",
                 (1, 2, 3), tuple(marks),
                 f"{len(rows)} files" if len(rows) > 40 else "")


def _steps(found: FleetResult, job: Job) -> str:
    return ", ".join(f"{s} {o.state}" for s, o in found.outcomes.get(job.name, {}).items())


def _faults(found: FleetResult) -> list[str]:
    lines = [f"{name}: {o.step} {o.state}: {o.message}" for name in found.failed
             for o in found.outcomes[name].values() if o.state != "done"]
    others = {n: why for n, why in found.left_out.items() if n not in found.failed}
    return lines + [f"{n}: not in the common model: {why}" for n, why in others.items()]
