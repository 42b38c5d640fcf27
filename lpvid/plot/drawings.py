"""Results drawn on axes, and as cards in a notebook: records, models, diagnoses, syntheses."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.analysis.pole_locus import pole_locus
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.errors import InputError
from lpvid.identification.result import Identification
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot.audit import MOST_CHANNELS
from lpvid.plot.colours import BLUE, CYCLE, VERMILION
from lpvid.plot.stability import pole_plane
from lpvid.plot.style import label, look, panels, robust_limits, shades, thinned, visible_scale
from lpvid.record import Record
from lpvid.synthesis.result import Synthesis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Drawing = tuple[int, Callable[[Any], None]]
"""Number of panels, and what draws on that many axes."""
CARD_WIDTH = 6.0
"""Of a card's figure [inch]."""
CARD_DPI = 96
"""Pixels per inch of it: one for one in a notebook."""
STYLE = """<style>.lpvid-card{font:13px system-ui,sans-serif;max-width:640px;border:1px solid #8886;border-radius:6px;
padding:.6em .9em}.lpvid-card pre{margin:.4em 0 0;white-space:pre-wrap;font-size:12px;background:none;color:inherit}
.lpvid-card img{display:block;max-width:100%;margin-top:.5em}@media(prefers-color-scheme:dark){.lpvid-card img{
filter:invert(.9) hue-rotate(180deg)}}</style>"""


def plot(drawn: Any, ax: Any = None) -> Any:
    """Draw a result on new axes or on the caller's.

    Parameters
    ----------
    drawn : object
        A class with a drawing: see `drawing_of`.
    ax : matplotlib.axes.Axes or sequence of them, optional

    Returns
    -------
    matplotlib.axes.Axes or (n,) array of them

    Raises
    ------
    InputError
        Nothing to draw, or another number of axes than panels.
    """
    found = drawing_of(drawn)
    if found is None:
        raise InputError(f"this {type(drawn).__name__} has nothing to draw", mend="print it")
    count, draw = found
    if ax is None:
        with look():
            heights = [1.4] * count if count > 1 else [3.2]
            axes = panels(count, heights=heights, width=CARD_WIDTH, sharex=count > 1)[1][:, 0]
            draw(axes)
    else:
        axes = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
        if axes.size != count:
            raise InputError(f"a {type(drawn).__name__} is drawn on {count} axes", got=f"{axes.size}",
                             mend=f"plt.subplots({count}, 1)" if count > 1 else "one Axes")
        draw(axes)
    return axes[0] if count == 1 else axes


def card(drawn: Any) -> str:
    """A result as a small piece of HTML: its text and, where it has one, its figure; for dark and light pages.

    Parameters
    ----------
    drawn : object
        Anything with a text of its own.

    Returns
    -------
    str
        Safe inside a page: text is escaped, the figure embedded as PNG.
    """
    found, picture = drawing_of(drawn), ""
    if found is not None:
        axes = np.atleast_1d(np.asarray(plot(drawn), dtype=object))
        buffer = io.BytesIO()
        axes[0].figure.savefig(buffer, format="png", dpi=CARD_DPI)
        title = axes[0].get_title(loc="left") or type(drawn).__name__
        picture = (f'<img alt="{html.escape(title)}" '
                   f'src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">')
    first, _, rest = (str(drawn) or type(drawn).__name__).partition("\n")
    body = f"<pre>{html.escape(rest)}</pre>" if rest else ""
    return f'{STYLE}<div class="lpvid-card"><b>{html.escape(first)}</b>{body}{picture}</div>'


@singledispatch
def drawing_of(drawn: Any) -> Drawing | None:
    """Drawing of a result; None for one that is text only. Packages on top register their classes here.

    Parameters
    ----------
    drawn : object
        Dispatched by its class.

    Returns
    -------
    (int, callable) or None
        Number of axes, and what draws on a sequence of so many.
    """
    return None


@drawing_of.register
def _(drawn: Record) -> Drawing:
    names = list(drawn.channels)[:MOST_CHANNELS]

    def draw(axes: Sequence[Axes]) -> None:
        for ax, name in zip(axes, names, strict=True):
            ax.plot(*thinned(drawn.times, drawn[name]), color=BLUE, linewidth=0.8)
            ax.set_ylim(*robust_limits(drawn[name]))
            ax.set_ylabel(label(name, drawn.unit(name)))
        axes[0].set_title(drawn.name)
        axes[-1].set_xlabel(label("time", "s"))

    return len(names), draw


@drawing_of.register
def _(drawn: LPVTransferFunction) -> Drawing | None:
    return _locus(drawn)


@drawing_of.register
def _(drawn: LPVStateSpace) -> Drawing | None:
    return _locus(drawn) if drawn.order else None


@drawing_of.register
def _(drawn: Identification) -> Drawing | None:
    return drawing_of(drawn.model)


@drawing_of.register
def _(drawn: Diagnosis) -> Drawing | None:
    stages = [("baseline", drawn.before), ("extended", drawn.after)] if drawn.extended is not None else \
        [("baseline", drawn.before)]

    def draw(axes: Sequence[Axes]) -> None:
        parts = ["training", "held-out"] if drawn.before.part == "held-out" else ["training"]
        place = np.arange(len(parts))
        for k, (name, figures) in enumerate(stages):
            shift = 0.4 * (k - 0.5 * (len(stages) - 1))
            shares = [figures.esr_training, figures.esr_held_out][:len(parts)]
            axes[0].bar(place + shift, shares, 0.36, color=CYCLE[k], label=name)
        axes[0].set_xticks(place, parts)
        axes[0].set_ylabel(label("free-run ESR", "1"))
        axes[0].set_title(drawn.verdict)
        axes[0].legend()

    return 1, draw


@drawing_of.register
def _(drawn: Synthesis) -> Drawing | None:
    return None if drawn.closed_loop is None else _gains(drawn.closed_loop, drawn.gamma_verified)


# -- families of frozen systems ----------------------------------------------------------------------------------------
def _locus(model: LPVTransferFunction | LPVStateSpace) -> Drawing:
    """Frozen poles along the first scheduling variable, the others in the middle of their range."""
    def draw(axes: Sequence[Axes]) -> None:
        ax = axes[0]
        pole_plane(ax, model.sample_time is not None)
        if model.box.names:
            found = pole_locus(model, model.box.names[0])
            colours = np.repeat(found.p[:, None], found.poles.shape[1], axis=1)
            drawn = ax.scatter(np.real(found.poles).ravel(), np.imag(found.poles).ravel(), c=colours.ravel(), s=9,
                               cmap=visible_scale(), zorder=3, linewidths=0)
            ax.figure.colorbar(drawn, ax=ax, label=label(found.variable, found.unit))
        else:
            poles = np.asarray(model.to_control([]).poles())
            ax.plot(np.real(poles), np.imag(poles), "x", color=BLUE, zorder=3)
        ax.set_title("Frozen poles")

    return 1, draw


def _gains(loop: LPVStateSpace, level: float | None) -> Drawing:
    """Largest singular value of frozen closed loops over frequency, with the verified bound."""
    from lpvid.plot.synthesis import _singular_values, frequencies_of, line_of

    def draw(axes: Sequence[Axes]) -> None:
        frequencies, points = frequencies_of(loop), line_of(loop)
        for shade, p in zip(shades(len(points)), points, strict=True):
            axes[0].loglog(frequencies / (2 * np.pi), _singular_values(loop, p, frequencies)[:, 0], color=shade)
        if level is not None:
            axes[0].axhline(level, color=VERMILION, linestyle="--", label="verified bound")
            axes[0].legend()
        axes[0].set_xlabel(label("frequency", "Hz"))
        axes[0].set_ylabel(label("gain", "1"))
        axes[0].set_title("Largest singular value, frozen")

    return 1, draw
