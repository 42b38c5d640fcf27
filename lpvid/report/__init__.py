"""Reports: one self-contained HTML page per command, verdict first, readable without a network."""

from __future__ import annotations

from lpvid.report.formatting import number
from lpvid.report.origin import Origin
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section
from lpvid.report.rendering import render
from lpvid.report.traces import Curve, Panel, Traces

__all__ = ["OUT", "Curve", "Item", "Mark", "NextStep", "Notes", "Origin", "Page", "PageFigure", "PageTable", "Panel",
           "Paragraph", "Section", "Traces", "number", "render"]
