"""Figures to bytes: SVG for a page, PNG for a folder."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from lpvid.plot.style import look

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def svg(figure: Figure) -> bytes:
    """The figure as SVG: lines as lines, dense clouds as embedded pixels; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    with look():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "lpvid"})
    return buffer.getvalue()


def png(figure: Figure) -> bytes:
    """The figure as PNG."""
    buffer = io.BytesIO()
    with look():
        figure.savefig(buffer, format="png", metadata={"Software": "lpvid"})
    return buffer.getvalue()
