"""A page as data: verdict, next steps, sections, tables, figures; `lpvid.report.rendering` turns it into HTML."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal

from lpvid.report.origin import Origin
from lpvid.report.traces import Traces

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

Mark = Literal["good", "warn", "bad", "plain"]


@dataclass(frozen=True)
class Paragraph:
    """Plain text; `strong` for what must not be missed.

    Attributes
    ----------
    text : str
        Plain, without markup.
    strong : bool
        Printed in bold.
    """

    text: str
    strong: bool = False
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Notes:
    """A list of remarks.

    Attributes
    ----------
    lines : tuple of str
        One per remark, plain.
    """

    lines: tuple[str, ...]
    kind: ClassVar[str] = "notes"


@dataclass(frozen=True)
class PageTable:
    """Columns and rows of text; `numeric` columns are right-aligned, `marks` colour rows, `folded` labels a fold.

    Attributes
    ----------
    columns : tuple of str
        Headings; empty for a table without a head.
    rows : tuple of tuple of str
        Cells, as many in each row as there are columns.
    caption : str
        One sentence or more; empty for none.
    numeric : tuple of int
        Columns that are right-aligned, from zero.
    marks : tuple of {"good", "warn", "bad", "plain"}
        One per row; empty for no colours.
    folded : str
        Label under which the table is folded; empty for an open one.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    numeric: tuple[int, ...] = ()
    marks: tuple[Mark, ...] = ()
    folded: str = ""
    kind: ClassVar[str] = "table"


@dataclass(frozen=True, eq=False)
class PageFigure:
    """A drawing, with what it shows in words; `lpvid.report.render` turns all drawings of a page into SVG at once.

    Attributes
    ----------
    drawing : matplotlib.figure.Figure
        Complete: nothing is drawn on it later.
    caption : str
        Below the figure.
    alternative : str
        What it shows, for who cannot see it.
    """

    drawing: Drawing
    caption: str
    alternative: str
    kind: ClassVar[str] = "figure"

    @property
    def narrow(self) -> bool:
        """Whether its letters can be read when it is as wide as a phone."""
        from lpvid.plot.style import figure_of

        return figure_of(self.drawing).get_figwidth() <= NARROW

    @classmethod
    def of(cls, drawing: Drawing, caption: str, alternative: str = "") -> PageFigure:
        """A matplotlib figure with its caption.

        Parameters
        ----------
        drawing : matplotlib.figure.Figure
            Drawn completely.
        caption : str
            Below the figure.
        alternative : str
            What it shows, for who cannot see it; the caption by default.

        Returns
        -------
        PageFigure
        """
        return cls(drawing, caption, alternative or caption)


NARROW = 7.5
"""Width up to which a drawing is shown whole on a phone [inch]: wider ones scroll, at twice the width of the screen."""
Item = Paragraph | Notes | PageTable | PageFigure | Traces

OUT = "OUT"
"""Stands for the folder of the results in the command of a `Step`."""


@dataclass(frozen=True)
class NextStep:
    """Something to do next: why, and the command that does it; `OUT` there becomes the folder of the results.

    Attributes
    ----------
    text : str
        A sentence.
    command : str
        As typed in a shell; empty for a step without one.
    """

    text: str
    command: str = ""


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it.

    Attributes
    ----------
    title : str
        Its heading.
    items : tuple of Item
        From top to bottom.
    """

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True)
class Page:
    """One report.

    Attributes
    ----------
    title : str
        What was looked at.
    verdict : str
        The answer in one sentence.
    mark : {"good", "warn", "bad", "plain"}
        Colour of the verdict.
    facts : tuple of (str, str)
        Key numbers with units, shown as tiles below the verdict.
    caveats : tuple of str
        What the verdict does not cover.
    sections : tuple of Section
    steps : tuple of NextStep
        What to do next.
    origin : Origin or None
        How the page came about; the command line fills it in.
    """

    title: str
    verdict: str
    mark: Mark = "plain"
    facts: tuple[tuple[str, str], ...] = ()
    caveats: tuple[str, ...] = ()
    sections: tuple[Section, ...] = field(default_factory=tuple)
    steps: tuple[NextStep, ...] = ()
    origin: Origin | None = None
