"""Sections that several reports share: figures of a model on data, in tables and drawings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid import plot
from lpvid.plot import Comparison
from lpvid.record import Record
from lpvid.report.courses import free_run_traces
from lpvid.report.formatting import number, percent
from lpvid.report.page import Item, Mark, PageFigure, PageTable, Section
from lpvid.simulation import Model
from lpvid.validation import Validation
from lpvid.validation.report import along
from lpvid.validation.residuals import probability

LOOP_CHANNELS = ("velocity", "displacement")
"""What output is drawn against, where it was recorded."""
GOOD, FAIR = 0.05, 0.2
"""Free-run ESR up to which a model is called good, and fair (fit 78 % and 55 %)."""


OPEN_ROWS = {"held-out": 40}
"""Records of a data set above which its table is folded; 8 for others."""


def comparisons(model: Model, records: Sequence[Record], label: str) -> list[Comparison]:
    """The model's runs along measured records, cut and resampled as validation does.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    records : sequence of Record
    label : str
        "training" or "held-out".

    Returns
    -------
    list of Comparison
    """
    _, pieces, _ = along(model, records)
    return [plot.compare(model, piece, label) for piece in pieces]


def grade(esr: float | None) -> Mark:
    """Colour of a free-run figure.

    Parameters
    ----------
    esr : float or None
        Free-run ESR [1]; None for a run that diverged or has no figure.

    Returns
    -------
    {"good", "warn", "bad"}
        Limits are `GOOD` and `FAIR`; None is bad.
    """
    if esr is None:
        return "bad"
    return "good" if esr <= GOOD else "warn" if esr <= FAIR else "bad"


def verdict_grade(found: Validation, doubt: str | None = None) -> Mark:
    """Colour of a validation: that of the pooled figure, but never good where one record's is bad, or it is in doubt.

    Parameters
    ----------
    found : Validation
        On one data set.
    doubt : str, optional
        Why its fit cannot be trusted, where that is not its own `doubt`.

    Returns
    -------
    {"good", "warn", "bad"}
        Records whose output does not move are passed over (`Validation.judged`).
    """
    pooled = grade(found.overall.free_run.esr)
    worst = [grade(r.free_run.esr) for r in found.judged]
    return "warn" if pooled == "good" and ("bad" in worst or doubt or found.doubt) else pooled


def overall_table(found: Sequence[Validation]) -> PageTable:
    """Pooled figures, one row per data set and kind of run.

    Parameters
    ----------
    found : sequence of Validation
        One per data set.

    Returns
    -------
    PageTable
        Free runs, one-step and k-step predictions; free runs are coloured.
    """
    rows, marks = [], []
    for v in found:
        for f in (v.overall.free_run, v.overall.one_step, *v.k_steps):
            diverged = "" if f.diverged_at is None else f"diverged at sample {f.diverged_at}"
            rows.append((v.label, f.kind, number(f.esr), number(f.fit_percent), number(f.rmse, 4, f.rmse_unit),
                         number(f.mean_error, 3, f.rmse_unit), f"{f.n_samples:,}", diverged or "–"))
            marks.append(grade(f.esr) if f.kind == "free-run" else "plain")
    return PageTable(("data", "run", "ESR [1]", "fit [%]", "rmse", "mean error", "samples", "remark"), tuple(rows),
                 "Pooled over records, each about its own mean.", (2, 3, 4, 5, 6), tuple(marks))


def records_table(found: Validation) -> PageTable:
    """Figures of every record of one data set.

    Parameters
    ----------
    found : Validation
        On one data set.

    Returns
    -------
    PageTable
        Folded where it has more rows than `OPEN_ROWS` states for this data set.
    """
    rows, marks = [], []
    for r in found.records:
        diverged = "" if r.free_run.diverged_at is None else f" (diverged at {r.free_run.diverged_at})"
        rows.append((r.name + diverged, f"{r.n_samples:,}", number(r.free_run.esr), number(r.free_run.fit_percent),
                     number(r.free_run.rmse, 4, r.free_run.rmse_unit),
                     number(r.free_run.mean_error, 3, r.free_run.rmse_unit), number(r.one_step.esr),
                     percent(r.extrapolation_share)))
        marks.append(grade(r.free_run.esr))
    columns = ("record", "samples", "free-run ESR", "free-run fit [%]", "free-run rmse", "mean error",
               "one-step ESR", "outside training range")
    folded = f"{len(rows)} records, {found.label}" if len(rows) > OPEN_ROWS.get(found.label, 8) else ""
    return PageTable(
        columns, tuple(rows), f"Record by record, {found.label}.", (1, 2, 3, 4, 5, 6, 7), tuple(marks), folded
    )


def _tests_table(found: Validation) -> PageTable | None:
    """Residual tests of one data set, or None where nothing could be tested."""
    if not found.residual_tests:
        return None
    rows = tuple((t.name, "passed" if t.passed else "failed", number(t.statistic),
                  probability(t.p_value).removeprefix("p = ").removeprefix("p "), t.description)
                 for t in found.residual_tests)
    marks: tuple[Mark, ...] = tuple("good" if t.passed else "warn" for t in found.residual_tests)
    return PageTable(("test", "outcome", "statistic", "p-value", "what it states"), rows,
                 f"Tests on the one-step residuals, {found.label}.", (2, 3), marks)


def regimes_table(found: Validation) -> PageTable | None:
    """Where the free run is wrong, or None where that was not worked out.

    Parameters
    ----------
    found : Validation
        On one data set.

    Returns
    -------
    PageTable or None
        One row per regime, in the order of the validation.
    """
    if not found.regimes:
        return None
    rows = tuple((r.where.replace("<=", "≤").replace(">=", "≥"), f"{100 * r.share:.3g} %",
                  f"{100 * r.error_share:.3g} %", number(r.esr)) for r in found.regimes)
    marks: tuple[Mark, ...] = tuple("warn" if r.error_share > 1.3 * r.share else "plain" for r in found.regimes)
    return PageTable(("where", "share of the data", "share of the error", "ESR there"), rows,
                 f"Free run, {found.label}; marked where the error weighs more than the data. For a frequency band, "
                 "the share of the data is that of the measured power.", (1, 2, 3), marks)


def run_figures(shown: Sequence[Comparison], signals: Sequence[str]) -> list[Item]:
    """Free run of the worst and of the middling record, with signals over the same time, then the loops.

    Parameters
    ----------
    shown : sequence of Comparison
        Of one data set; empty for no figures.
    signals : sequence of str
        Channels in panels of their own below each run.

    Returns
    -------
    list of Item
        One or two time traces, and the loops over `LOOP_CHANNELS` where these were recorded.
    """
    if not shown:
        return []
    by_error = sorted(shown, key=_relative_error, reverse=True)
    chosen = list(dict.fromkeys([0, len(by_error) // 2]))
    stated = ("the record with the largest free-run error", "a middling record")
    items: list[Item] = []
    for place, i in enumerate(chosen):
        c = by_error[i]
        which = f"{c.record.name}, {c.label}" if len(shown) == 1 else f"{c.record.name}, {c.label}: {stated[place]}"
        items.append(free_run_traces(c, signals, f"Free run of {which}; shaded, the stretch with the largest error."))
    loops = plot.loops(shown, LOOP_CHANNELS)
    if loops is not None:
        items.append(PageFigure.of(loops, f"Loops of measured and free-run output, {shown[0].label} data."))
    return items


def residual_items(shown: Sequence[Comparison], found: Sequence[Validation], inputs: Sequence[str]) -> list[Item]:
    """Tests on the one-step residuals of every data set, and their histogram and correlations on the data shown.

    Parameters
    ----------
    shown : sequence of Comparison
        Of one data set, for the drawing.
    found : sequence of Validation
        One per data set, for the tables.
    inputs : sequence of str
        Channels to correlate the residuals with.

    Returns
    -------
    list of Item
        Empty where nothing could be tested or drawn.
    """
    items: list[Item] = [t for v in found if (t := _tests_table(v)) is not None]
    drawn = plot.residuals(shown, inputs=inputs)
    if drawn is not None:
        items.append(PageFigure.of(drawn, f"One-step residuals, {shown[0].label} data: histogram about their own mean, "
                               "correlation with themselves and with the inputs. Bars outside the limits are what the "
                               "model leaves unused; at negative lags the input follows the residual, as under "
                               "feedback."))
    return items


def driving(model: Model) -> tuple[str, ...]:
    """Scheduling variables, then inputs: what is drawn below a free run.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Any model with a box and inputs.

    Returns
    -------
    tuple of str
        Names, each once.
    """
    return tuple(dict.fromkeys((*model.box.names, *(s.name for s in model.inputs))))


def judged_sections(found: Sequence[Validation], shown: Sequence[Comparison], model: Model) -> list[Section]:
    """What a page states first of a model on data: figures, where the error lies, measured and simulated.

    Parameters
    ----------
    found : sequence of Validation
        What counts most comes first.
    shown : sequence of Comparison
        Runs to draw.
    model : LPVTransferFunction, LPVStateSpace or self-scheduled model

    Returns
    -------
    list of Section
    """
    tables: list[Item] = [overall_table(found), *(records_table(v) for v in found)]
    regimes = regimes_table(found[0])
    return [Section("Figures", tuple(tables)),
            *([] if regimes is None else [Section("Where the error lies", (regimes,))]),
            Section("Measured and simulated", tuple(run_figures(shown, driving(model))))]


def _relative_error(c: Comparison) -> float:
    error = c.error[c.free_run.start:]
    if not np.isfinite(error).all():
        return float("inf")
    return float(np.mean(error**2) / max(float(np.var(c.measured[c.free_run.start:])), 1e-300))
