"""Every state-space form of a model with its gap on the user's own data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from lpvid.errors import InputError
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.report.formatting import listing, number
from lpvid.report.page import Mark, PageTable, Paragraph, Section

if TYPE_CHECKING:
    from lpvid.identification.form_refit import FormRefit
    from lpvid.realization.gap import Gap


@dataclass(frozen=True, eq=False)
class FormGap:
    """One form: its gap, or why there is none.

    Attributes
    ----------
    form : str
        One of `lpvid.realization.realization.FORMS`.
    order : int or None
        States of the realisation; None where there is none.
    gap : Gap or None
        Between realisation and transfer function on the records.
    why_not : str
        Reason that there is no realisation; empty where there is one.
    """

    form: str
    order: int | None
    gap: Gap | None
    why_not: str = ""

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        if self.gap is None:
            return {"form": self.form, "available": False, "why_not": self.why_not}
        return {**self.gap.to_dict(), "available": True, "order": self.order}

    def __str__(self) -> str:
        if self.gap is None:
            return f"{self.form}: not available ({self.why_not})"
        causal = "" if self.gap.causal else ", not causal"
        judged = self.gap.judgement
        if self.gap.exact or judged is None:
            fit = f"fit {min(self.gap.fit_percent):.5g} % against the transfer function"
            return f"{self.form} ({self.order} states): {'exact' if self.gap.exact else fit}{causal}"
        own, form = judged.own[judged.worst], judged.form[judged.worst]
        error = f"from {own:.3g} to {form:.3g}" if isfinite(form) else "diverges"
        return f"{self.form} ({self.order} states): {judged.verdict}, free-run ESR {error}{causal}"


def form_gaps(model: LPVTransferFunction, records: Sequence[Record], label: str = "") -> list[FormGap]:
    """Realise a model in every form and measure each on given records.

    Parameters
    ----------
    model : LPVTransferFunction
    records : sequence of Record
        Uniform, finite, at the model's rate.
    label : str
        "training" or "held-out".

    Returns
    -------
    list of FormGap
    """
    from lpvid.realization.realization import FORMS, realize

    found = []
    for form in FORMS:
        try:
            realization = realize(model, form=form)
            found.append(FormGap(form, realization.model.order, realization.gap(records, label)))
        except InputError as error:
            found.append(FormGap(form, None, None, error.what))
    return found


def forms_table(gaps: Sequence[FormGap]) -> PageTable:
    """One row for each form.

    Parameters
    ----------
    gaps : sequence of FormGap
        As `form_gaps` returns them.

    Returns
    -------
    PageTable
        Green for a causal form that is safe or, without a verdict, has an ESR of the gap below 1e-4 on every output;
        amber for any other, no colour where there is none.
    """
    rows, marks = [], []
    for g in gaps:
        if g.gap is None:
            rows.append((g.form, "–", "–", "–", "–", "–", f"not available: {g.why_not}"))
            marks.append("plain")
            continue
        rows.append((g.form, str(g.order), "yes" if g.gap.exact else "no", "yes" if g.gap.causal else "no",
                     listing(["0" if g.gap.exact else number(e, 3) for e in g.gap.esr]),
                     listing([number(f, 4) for f in g.gap.fit_percent]),
                     g.gap.advice))
        marks.append(_mark(g.gap))
    return PageTable(("form", "states", "exact", "causal", "ESR of the gap", "fit [%]", "advice"), tuple(rows), "",
                 (1, 4, 5), tuple(marks))


def form_section(refit: FormRefit) -> Section:
    """The transfer function, the form as realised and the form re-estimated beside each other.

    Parameters
    ----------
    refit : FormRefit
        With figures of all three on each data set.

    Returns
    -------
    Section
        Advice and a table of free-run ESR.
    """
    rows = tuple(refit.rows())
    heads = ("model", *(f"free-run ESR, {v.label}" for v in next(iter(refit.figures.values()))))
    table = PageTable(heads, rows, "", tuple(range(1, len(heads))))
    return Section(f"The {refit.form} form, re-estimated",
                   (Paragraph(f"state_space.json holds the last. As realised the form {refit.gap.advice}."), table))


def _mark(gap: Gap) -> Mark:
    if not gap.causal:
        return "warn"
    return "good" if gap.verdict == "safe" or (gap.verdict is None and max(gap.esr) < 1e-4) else "warn"
