"""The report of the demo."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lpvid.record import Record
from lpvid.report import OUT, Item, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section, number
from quartercar.demo.run import TARGET, Demo, ExperimentFigures, mean_of


def demo_page(demo: Demo) -> Page:
    """The report of the demo.

    Parameters
    ----------
    demo : Demo

    Returns
    -------
    Page
    """
    from lpvid.report.forms import forms_table
    from lpvid.report.identification import identification_page
    from lpvid.report.passivity import passivity_section
    from lpvid.report.stability import stability_page
    from lpvid.toolkit import in_forks

    parts = (
        demo.ride.section, lambda: stability_page(demo.study, "the damper model"),
        lambda: identification_page(demo.found, (), demo.gaps, demo.audit),
        lambda: (passivity_section(demo.found), _experiments_figure(demo)))
    ride, stability, model, (passivity, experiments) = in_forks(_drawn, parts)  # the longest first
    parameters = [s for s in model.sections if s.title in ("Where the error lies", "What is left in the residuals",
                                                           "Parameters", "Remarks")]
    sections = (
        Section("Eight experiments", (experiments_table(demo.experiments), *experiments)),
        Section("The virtual rig and the model", demo.drawn.runs),
        Section("State-space forms", (Paragraph("What each form costs on the training currents, against the transfer "
                                                "function, in free run from rest."), forms_table(demo.gaps))),
        Section("Stability", (Paragraph(demo.study.verdict, strong=True),)),
        *(s for s in stability.sections if s.title != "The model"),
        *passivity,
        demo.drawn.hidden,
        ride,
        *parameters,
        Section("The data", (Paragraph(f"{len(demo.training)} training and {len(demo.held_out)} held-out records from "
                                       "the virtual rig: compliance in series, a yield force that saturates with the "
                                       "current, a coil that rises in 5 ms and falls in 10 ms, asymmetry, gas, 1 % "
                                       "noise. No model of the class identified here can be exact for it."),
                             Notes((f"Audit of the training records: {demo.audit.verdict}.",
                                    *(str(f) for f in demo.audit.findings[:12]))))))
    return Page("From rig records to an LPV damper model", demo.verdict,
                "good" if demo.mean_esr is not None and demo.mean_esr < TARGET else "warn", _facts(demo),
                (*model.caveats[:1], *stability.caveats), sections, _STEPS)


def _drawn(draw: Callable[[], Any]) -> Any:
    return draw()


_STEPS = (
    NextStep("Fit a model to your own records; nothing else is needed.",
         "lpvid identify DATA --input velocity --output force --schedule current --hold-out 1/3 --out model"),
    NextStep("Or fit the dampers of the literature and rank them.", "quartercar fit DATA --out fit"),
    NextStep("Look at the model of this demo from all sides.", f"lpvid stability {OUT}/model.json --out stability"),
    NextStep("Put it into a car of your own.", f"quartercar ride --damper {OUT}/model.json --out ride"))


def experiments_table(figures: Sequence[ExperimentFigures]) -> PageTable:
    """ESR of every experiment.

    Parameters
    ----------
    figures : sequence of ExperimentFigures
        One for each experiment.

    Returns
    -------
    PageTable
        One row for each, and their mean; a dash where a model diverged.
    """
    rows = [(e.name, e.description, str(len(e.records)), number(e.esr), number(e.rmse, 4, "N"), number(e.worst),
             number(e.free_esr), number(e.plain_esr)) for e in figures]
    rows.append(("mean", "eight experiments", str(sum(len(e.records) for e in figures)),
                 number(mean_of([e.esr for e in figures])), "", "", number(mean_of([e.free_esr for e in figures])),
                 number(mean_of([e.plain_esr for e in figures]))))
    return PageTable(("test", "what moves", "records", "ESR", "rmse", "worst", "unconstrained", "plain"), tuple(rows),
                 "Free-run ESR on held-out records of the virtual rig.", (2, 3, 4, 5, 6, 7))


def _facts(demo: Demo) -> tuple[tuple[str, str], ...]:
    assert demo.found.held_out is not None
    run = demo.found.held_out.overall.free_run
    return (("mean ESR, free-run, held-out", number(demo.mean_esr)),
            ("pooled ESR, free-run, held-out", number(run.esr)),
            ("rmse, free-run, held-out", number(run.rmse, 4, run.rmse_unit)),
            ("parameters", str(demo.found.n_parameters)),
            ("frozen poles", "stable" if demo.study.frozen.stable else "NOT stable"),
            ("moving current", demo.study.certificate.verdict))


def _experiments_figure(demo: Demo) -> list[Item]:
    from quartercar import plot

    drawn = plot.experiments([(e.name, e.esr, e.plain_esr) for e in demo.experiments], TARGET)
    return [PageFigure.of(drawn, "Free-run ESR of the eight experiments, each pooled over its held-out records."),
            Paragraph("Unconstrained is the same structure without the constraint of passivity. Plain is a model of "
                      "the same order and degree without input stage, current filter and constant term. What the "
                      "constraint costs here is the price of this class: a soft spring in series with a yielding "
                      "damper, which this rig has, looks like a lag of the yield force; that lag is not passive."),
            *(Paragraph(text) for text in (worst_currents(demo.experiments, demo.held_out),) if text)]


def worst_currents(figures: Sequence[ExperimentFigures], records: Sequence[Record]) -> str:
    """At which constant current each test of several records is worst.

    Parameters
    ----------
    figures : sequence of ExperimentFigures
        One per test, with the free-run error-to-signal ratio of every record.
    records : sequence of Record
        The held-out records, named ``test-N-rM``; the current in A.

    Returns
    -------
    str
        One sentence; empty where no test has several records.
    """
    parts = []
    for e in figures:
        current = [float(np.mean(r["current"])) for r in records if r.name.startswith(f"{e.name}-r")]
        if e.worst is not None and len(current) == len(e.records) > 1:
            parts.append(f"{e.name} at {number(current[e.records.index(e.worst)], 3, 'A')} (ESR {number(e.worst, 3)})")
    return f"The worst records by test, of constant currents: {', '.join(parts)}." if parts else ""
