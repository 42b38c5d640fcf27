"""Report of `validate`."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

from lpvid.caveat import Caveat
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot import Comparison
from lpvid.report.figures import grade, judged_sections, residual_items, verdict_grade
from lpvid.report.formatting import number, percent
from lpvid.report.page import NextStep, Notes, Page, Paragraph, Section
from lpvid.report.responses import drawn_models, frozen_figures, scheduling_places
from lpvid.simulation import Model
from lpvid.validation import Validation


def validation_page(found: Validation, model: Model, shown: Sequence[Comparison], name: str,
                    more: Sequence[Section] = ()) -> Page:
    """A page about a model on data.

    Parameters
    ----------
    found : Validation
    model : LPVTransferFunction or LPVStateSpace
    shown : sequence of Comparison
    name : str
        What to call the model.
    more : sequence of Section
        Further sections, e.g. on other models on the same records.

    Returns
    -------
    Page
    """
    sections = [*judged_sections([found], shown, model), *more]
    left = residual_items(shown, [found], [s.name for s in model.inputs])
    if left:
        sections.append(Section("What is left in the residuals", tuple(left)))
    sections += responses(model, shown)
    sections.append(Section("The model", (Paragraph(repr(model)),)))
    caveats: list[str] = [n for n in found.notes if isinstance(n, Caveat)]
    if rest := tuple(n for n in found.notes if n not in caveats):
        sections.append(Section("Remarks", (Notes(rest),)))
    if found.extrapolation_share > 0:
        caveats.append(f"{percent(found.extrapolation_share)} of the samples lie outside the scheduling range of the "
                       "training data: there the figures are extrapolation.")
    return Page(f"Validation of {name}", verdict(found), verdict_grade(found), facts(found),
                tuple(caveats), tuple(sections), _steps(found, name))


def responses(model: Model, shown: Sequence[Comparison]) -> list[Section]:
    """Bode plots and step responses with the bands that the model itself carries; none for other kinds of model.

    Parameters
    ----------
    model : model
        Any kind.
    shown : sequence of Comparison
        The runs that the page shows; they give the scheduling values.

    Returns
    -------
    list of Section
        One, or none.
    """
    if not shown or not isinstance(model, (LPVTransferFunction, LPVStateSpace)):
        return []
    places, stated = scheduling_places(model.box, shown)
    items = frozen_figures(model, drawn_models(model), places, stated, max(c.record.n_samples for c in shown))
    return [Section("Frequency and step response", tuple(items))]


def _steps(found: Validation, name: str) -> tuple[NextStep, ...]:
    worst, steps = found.worst, []
    if found.extrapolation_share > 0:
        steps.append(NextStep("Measure, and fit again, where the scheduling leaves the range of the training data."))
    if worst is not None and grade(worst.free_run.esr) == "bad":
        steps.append(NextStep(f"Look at '{worst.name}' first: is it the data, or the model?",
                          f"lpvid inspect FILE-OF-{worst.name} --out audit"))
    if grade((found.from_estimated_past or found.overall.free_run).esr) != "good":
        steps.append(NextStep("Let the diagnosis find what the model lacks.", f"lpvid diagnose DATA --baseline {name} "
                          "--out diagnosis"))
    steps.append(NextStep("Set it beside other models on the same records.", f"lpvid compare {name} OTHER.json DATA "
                      "--out compared"))
    return tuple(steps)


def verdict(found: Validation, doubt: str | None = None) -> str:
    """The free run in one sentence.

    Parameters
    ----------
    found : Validation
        On one data set.
    doubt : str, optional
        Why its fit cannot be trusted, where that is not its own `doubt`.

    Returns
    -------
    str
        With further sentences: why it cannot be trusted, and on the worst record, where there are several.
    """
    run = found.overall.free_run
    if run.diverged_at is not None:
        return (f"The free run diverges on {found.label} data, at sample {run.diverged_at}: the model cannot simulate "
                "them.")
    if run.esr is None:
        return f"No figure on {found.label} data: the output does not move there."
    late = found.from_estimated_past
    if late is not None and late.esr is not None:
        return (f"In free run on {found.label} data the error is that of the start: from the first measured samples "
                f"ESR {run.esr:.4g} (fit {run.fit_percent:.1f}\u00a0%), from an estimated past ESR {late.esr:.4g} (fit "
                f"{late.fit_percent:.1f}\u00a0%).{_worst_record(found)}")
    explained = (f"{_share(run.esr)}\u00a0% of the output's variance" if run.esr < 1 else
                 f"nothing of the output: its squared error is {run.esr:.3g} times the output's variance")
    doubt = doubt or (found.doubt if run.esr < 1 else None)
    return (f"In free run on {found.label} data the model explains {explained} "
            f"(ESR {run.esr:.4g}, fit {run.fit_percent:.1f}\u00a0%, mean error "
            f"{number(run.mean_error, 3, run.rmse_unit)}).{f' {doubt[0].upper()}{doubt[1:]}.' if doubt else ''}"
            f"{_worst_record(found)}")


def _share(esr: float) -> str:
    """100 (1 − ESR) with so many digits that what is left shows: 99.97, where 100.0 would claim that nothing is."""
    left = 100 * esr
    return f"{100 - left:.{min(max(1, -floor(log10(left))), 9) if left > 0 else 1}f}"


def _worst_record(found: Validation) -> str:
    """The record with the largest free-run ESR in a sentence, where there are several; empty for one."""
    worst = found.worst
    if worst is None:
        return ""
    run = worst.free_run
    what = f"diverges at sample {run.diverged_at}" if run.esr is None else (
        f"fit {run.fit_percent:.1f}\u00a0%, rmse {number(run.rmse, 3, run.rmse_unit)}")
    apart = grade(run.esr) == "bad" and grade(found.overall.free_run.esr) != "bad"
    return f" {'But not record' if apart else 'Worst record:'} '{worst.name}': {what}."


def facts(found: Validation) -> tuple[tuple[str, str], ...]:
    """Key numbers.

    Parameters
    ----------
    found : Validation
        On one data set.

    Returns
    -------
    tuple of (str, str)
        Label with the data set, and figure with its unit.
    """
    free, one = found.overall.free_run, found.overall.one_step
    return ((f"free-run ESR, {found.label}", number(free.esr)),
            (f"free-run fit, {found.label}", number(free.fit_percent, 3, "%")),
            (f"free-run rmse, {found.label}", number(free.rmse, 4, free.rmse_unit)),
            (f"free-run mean error, {found.label}", number(free.mean_error, 3, free.rmse_unit)),
            (f"one-step ESR, {found.label}", number(one.esr)))
