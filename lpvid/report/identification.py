"""Report of `identify`: figures first, then the parameters, the forms and the poles."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.auditing import Audit
from lpvid.caveat import Caveat
from lpvid.identification.result import Identification
from lpvid.model.quasi import SelfScheduled
from lpvid.plot import Comparison
from lpvid.report import validation
from lpvid.report.figures import grade, judged_sections, residual_items, verdict_grade
from lpvid.report.formatting import number
from lpvid.report.forms import FormGap, forms_table
from lpvid.report.inspection import findings_table
from lpvid.report.page import OUT, Item, NextStep, Notes, Page, PageTable, Paragraph, Section
from lpvid.report.stability import fits_free_run, locus_items
from lpvid.validation import Validation

MOST_PARAMETERS = 200


def identification_page(found: Identification, shown: Sequence[Comparison], gaps: Sequence[FormGap],
                        audit: Audit, more: Sequence[Section] = ()) -> Page:
    """A page about an identified model.

    Parameters
    ----------
    found : Identification
    shown : sequence of Comparison
        Runs to draw: held-out ones where there are any.
    gaps : sequence of FormGap
        What each state-space form costs on these data; empty where the model is no transfer function.
    audit : Audit
        Of the data.
    more : sequence of Section
        Further sections, e.g. bands.

    Returns
    -------
    Page
    """
    model, figures = found.model, [v for v in (found.held_out, found.training) if v is not None]
    best = figures[0]
    left = residual_items(shown, figures, [s.name for s in model.inputs])
    remarks = (*found.notes, *(f"held-out: {n}" for n in found.held_out_notes))
    sections = [*judged_sections(figures, shown, model),
                Section("What is left in the residuals", tuple(left)),
                Section("Frozen poles", tuple(locus_items(model))),
                *more,
                Section("State-space forms", (Paragraph("What each form costs on these data, against the transfer "
                        "function, in free run from rest."), forms_table(gaps)) if gaps else ()),
                Section("Parameters", tuple(_parameters(found))), Section("Remarks", (Notes(remarks),)),
                Section("Audit of the data", (Paragraph(f"{audit.verdict}."), findings_table(audit)))]
    return Page(f"Identified model of {', '.join(s.name for s in model.outputs)}",
                validation.verdict(best, found.doubt), verdict_grade(best, found.doubt),
                _facts(found, best), _caveats(found),
                tuple(s for s in sections if s.items and s.items != (Notes(()),)), _steps(found, best))


def _steps(found: Identification, best: Validation) -> tuple[NextStep, ...]:
    """What follows from the figures: a better structure, then other data, then stability and causes."""
    steps = []
    failed = {t.name for t in best.residual_tests if not t.passed}
    if found.held_out is None:
        steps.append(
            NextStep(
                "Keep data out of the fit: only then do the figures show how good the model is on other data. "
                "Add --hold-out 1/3, or name other files with --held-out."
            )
        )
    if best.from_estimated_past is not None:
        steps.append(NextStep("The error is that of the start: a slow mode carries it on. A lower order (--na) may "
                          "have none, and lpv.simulate(model, record, 'estimate') starts from an estimated past."))
    elif grade(best.overall.free_run.esr) != "good":
        other = "" if fits_free_run(found.model) else (", or try --structure oe, which fits the free run itself")
        steps.append(NextStep(f"The free run misses much of the output: let structures compete with --auto{other}."))
    elif "independence" in failed:
        steps.append(
            NextStep(
                "The residual still follows the input: more input lags (--nb), a higher --degree or a shaped "
                "input (--shape) may use it."
            )
        )
    steps += [NextStep("Try the model on data of another day or another excitation.",
                   f"lpvid validate {OUT}/model.json NEW.csv --out checked"),
              NextStep("See how far it is stable while the scheduling moves." if found.model.box.names else
                   "See its poles and their uncertainty.", f"lpvid stability {OUT}/model.json --out stability"),
              NextStep("Use it elsewhere: C, FMU, MATLAB, python-control.", f"lpvid export {OUT}/model.json --to c "
                   "--out exported")]
    return tuple(steps)


def _facts(found: Identification, best: Validation) -> tuple[tuple[str, str], ...]:
    rate = 1 / found.model.sample_time
    return (*validation.facts(best)[:3], ("parameters", f"{found.n_parameters}"),
            ("sampling", number(rate, 5, "Hz")),
            ("condition number, unit columns", number(found.scaled_condition, 2)))


def _caveats(found: Identification) -> tuple[str, ...]:
    lines = []
    if found.held_out is None:
        lines.append("All figures are on training data: nothing was held out. They give little information on "
                     "other data.")
    lines += [f"{n[:1].upper()}{n[1:]}." for n in (*found.notes, *found.held_out_notes) if isinstance(n, Caveat)]
    judged = found.held_out or found.training
    if judged is not None and any(not t.passed and t.name == "whiteness" for t in judged.residual_tests):
        lines.append(_coloured(found))
    if found.model.box.names and not isinstance(found.model, SelfScheduled):
        lines.append("The frozen poles hold for a constant scheduling variable; see the stability report for "
                     "one that moves.")
    return tuple(lines)


def _coloured(found: Identification) -> str:
    """What a residual that is not white means for the standard errors given."""
    stated = "The one-step residuals are not white: "
    kind = found.covariance_kind
    if "sandwich" in kind or "coloured" in kind or any("sandwich" in n for n in found.notes):
        return stated + "the standard errors are of sandwich form, which allows for that."
    return stated + "the standard errors assume white errors, and are too small."


def _parameters(found: Identification) -> list[Item]:
    model, box = found.model, found.model.box
    items: list[Item] = [Paragraph(repr(model)),
                         Paragraph(f"{found.n_parameters} parameters from {found.n_samples:,} equations.")]
    if box.names:
        ranges = ", ".join(f"{n} {number(low)} … {number(high)} {u}".rstrip() for n, low, high, u in
                           zip(box.names, box.lower, box.upper, box.units, strict=True))
        items.append(Paragraph(f"Scheduling range: {ranges}. Parameters are over the normalised scheduling, "
                               "z = (p − centre)/half width."))
    rows = tuple((n, number(v, 6), number(s, 3)) for n, v, s in
                 zip(found.parameter_names, found.parameters.tolist(), found.standard_errors.tolist(), strict=True))
    items.append(PageTable(("parameter", "value", "standard error"), rows[:MOST_PARAMETERS], "In SI units.", (1, 2),
                       folded=f"{min(len(rows), MOST_PARAMETERS)} linear parameters"))
    if len(rows) > MOST_PARAMETERS:
        items.append(Paragraph(f"{len(rows) - MOST_PARAMETERS} more parameters are in identification.json."))
    return items
