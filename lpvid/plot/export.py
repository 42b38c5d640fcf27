"""Figures to bytes: SVG for a page, PNG for a folder."""

from __future__ import annotations

import base64
import io
import re
from typing import TYPE_CHECKING

from lpvid.plot.style import Drawn, figure_of, look

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PLACES = 2
"""Decimals of a coordinate [1/72 inch]: a hundredth of a point is finer than any screen or printer."""
CLOUD_DPI = 130
"""Resolution of dense clouds within an SVG [1/inch]: a pixel of a usual screen is 1/96 inch."""
COLOURS = 48
"""Colours of a cloud's pixels: a few inks in a few densities."""
_PLACED = re.compile(rb' (d|x|y|points)="([^"]*)"')
_LONG = re.compile(rb"-?\d+\.\d{3,}")
_MOVED = re.compile(rb"translate\(([^)]*)\)")
_PIXELS = re.compile(rb'"data:image/png;base64,([^"]*)"')
_IDLE = re.compile(rb"<metadata>.*?</metadata>|<!--.*?-->|<!DOCTYPE[^>]*>", re.DOTALL)


def svg(figure: Figure | Drawn) -> bytes:
    """The figure, or that of these axes, as SVG: lines as lines, dense clouds as embedded pixels.

    The same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure, Axes or array of Axes
        Drawn completely.

    Returns
    -------
    bytes
        UTF-8.
    """
    buffer = io.BytesIO()
    with look():
        figure_of(figure).savefig(buffer, format="svg", dpi=CLOUD_DPI, metadata={"Date": None, "Creator": "lpvid"})
    return shortened(buffer.getvalue())


def shortened(drawing: bytes) -> bytes:
    """The same SVG with coordinates of `PLACES` decimals, clouds of `COLOURS` colours, and nothing that draws nothing.

    Parameters
    ----------
    drawing : bytes
        SVG as matplotlib writes it.

    Returns
    -------
    bytes
        Looks the same to within a hundredth of a point.

    Examples
    --------
    >>> shortened(b'<g id="a">\\n <!-- b -->\\n <path d="M 1.23456 -0.001\\nL 2 3.5 "/>\\n</g>')
    b'<g><path d="M1.23 0L2 3.5"/></g>'
    """
    drawing = _PIXELS.sub(_fewer_colours, _PLACED.sub(_short_attribute, _IDLE.sub(b"", drawing)))
    drawing = re.sub(rb'<g id="[^"]*"', b"<g", drawing)  # groups are never referred to: clips, marks, glyphs are
    drawing = _MOVED.sub(lambda m: b"translate(%s)" % _LONG.sub(_coordinate, m.group(1)), drawing)
    return re.sub(rb">\s+<", b"><", _short_names(_plain_ticks(drawing))).strip()


def _plain_ticks(drawing: bytes) -> bytes:
    """Tick marks without a style of their own at each place: a line has no area to fill, its stroke is in its mark."""
    for name in re.findall(rb'<path id="([^"]*)" d="M[^LzCQ"]*L[^LzCQ"]*"', drawing):
        drawing = re.sub(rb'(<use xlink:href="#%s"[^>]*?) style="[^"]*"' % re.escape(name), rb"\1", drawing)
    return drawing


def _short_names(drawing: bytes) -> bytes:
    """Marks, glyphs and clips under short names."""
    short = {name: b"a%d" % k for k, name in enumerate(dict.fromkeys(re.findall(rb' id="([^"]*)"', drawing)))}
    drawing = re.sub(rb' id="([^"]*)"', lambda m: b' id="%s"' % short[m.group(1)], drawing)
    return re.sub(rb'#([^")]+)(?=[")])', lambda m: b"#" + short.get(m.group(1), m.group(1)), drawing)


def _short_attribute(found: re.Match[bytes]) -> bytes:
    name, value = found.groups()
    value = b" ".join(_LONG.sub(_coordinate, value).split())
    if name == b"d":
        value = re.sub(rb" ?([A-Za-z]) ?", rb"\1", value)
    return b' %s="%s"' % (name, value)


def _coordinate(found: re.Match[bytes]) -> bytes:
    text = f"{float(found.group()):.{PLACES}f}".rstrip("0").rstrip(".")
    return b"0" if text in ("-0", "") else text.encode("ascii")


def _fewer_colours(found: re.Match[bytes]) -> bytes:
    """An embedded picture with a palette, where that is smaller."""
    from PIL import Image

    given = base64.b64decode(found.group(1))
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(given)) as picture:
        picture.convert("RGBA").quantize(COLOURS, method=Image.Quantize.FASTOCTREE).save(buffer, "PNG", optimize=True)
    best = min(given, buffer.getvalue(), key=len)
    return b'"data:image/png;base64,%s"' % base64.b64encode(best)


def png(figure: Figure | Drawn) -> bytes:
    """The figure, or that of these axes, as PNG.

    Parameters
    ----------
    figure : matplotlib.figure.Figure, Axes or array of Axes
        Drawn completely.

    Returns
    -------
    bytes
        At the resolution of `lpvid.plot.style.SETTINGS`.
    """
    buffer = io.BytesIO()
    with look():
        figure_of(figure).savefig(buffer, format="png", metadata={"Software": "lpvid"})
    return buffer.getvalue()
