"""Reports: one self-contained HTML page per command, verdict first, readable without a network."""

from __future__ import annotations

from lpvid.report.page import Figure, Item, Mark, Notes, Page, Paragraph, Section, Table, number, render

__all__ = ["Figure", "Item", "Mark", "Notes", "Page", "Paragraph", "Section", "Table", "number", "render"]
