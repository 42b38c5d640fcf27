"""How a structure was chosen: the ranking as a table."""

from __future__ import annotations

from lpvid.identification.selection import Selection
from lpvid.report.formatting import number, percent
from lpvid.report.page import Mark, Notes, PageTable, Paragraph, Section

ROWS = 40
"""Rows of the ranking in a report; all stand in selection.json."""


def selection_section(found: Selection, ceiling: str) -> Section:
    """The ranking with its reasons.

    Parameters
    ----------
    found : Selection
    ceiling : str
        What the noise leaves possible, in a sentence.

    Returns
    -------
    Section
    """
    rows, marks = [], []
    for i, r in enumerate(found.table[:ROWS]):
        error = "–" if r.esr is None else f"{number(r.esr)} ± {number(r.esr_error, 1)}"
        rows.append((r.structure.summary, "–" if r.n_parameters is None else f"{r.n_parameters}", error,
                     number(r.fit_percent), number(r.bic, 6), percent(r.outside), r.reason))
        mark: Mark = "good" if i == 0 else "plain"
        marks.append(mark)
    columns = ("structure", "parameters", "free-run ESR, cross-validated", "fit [%]", "BIC", "frozen poles outside",
               "why here")
    stated = Paragraph(f"{found.comparison}. The first is the choice. "
                     + ("" if found.complete else "The search was interrupted: the ranking is not complete. ")
                     + ceiling)
    table = PageTable(columns, tuple(rows), "", (1, 2, 3, 4, 5), tuple(marks),
                  f"Ranking, first {len(rows)} of {len(found.table)}")
    return Section("How the structure was chosen", (stated, table, *((Notes(found.notes),) if found.notes else ())))
