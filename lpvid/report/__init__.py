"""Reports: one self-contained HTML page per command, verdict first, readable without a network."""

from __future__ import annotations

from lpvid.report.origin import Origin
from lpvid.report.page import OUT, Figure, Item, Mark, Notes, Page, Paragraph, Section, Step, Table, number
from lpvid.report.rendering import render
from lpvid.report.traces import Curve, Panel, Traces

__all__ = ["OUT", "Curve", "Figure", "Item", "Mark", "Notes", "Origin", "Page", "Panel", "Paragraph", "Section", "Step",
           "Table", "Traces", "number", "render"]
