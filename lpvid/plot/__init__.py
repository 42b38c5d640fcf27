"""Figures: every function draws on new axes or on those of ``ax=``, and returns its `Axes`.

`show`, `svg` and `png` take a figure or axes. Nothing global is touched.
"""

from __future__ import annotations

from lpvid.plot.audit import channel_traces, spectra, strokes
from lpvid.plot.bands import free_run_band
from lpvid.plot.comparison import Comparison, compare, free_run, loops, overlay
from lpvid.plot.export import png, svg
from lpvid.plot.passivity import passivity
from lpvid.plot.residuals import residuals
from lpvid.plot.responses import bode, steps
from lpvid.plot.showing import show
from lpvid.plot.stability import locus, poles

__all__ = ["Comparison", "bode", "channel_traces", "compare", "free_run", "free_run_band", "locus", "loops", "overlay",
           "passivity", "png", "poles", "residuals", "show", "spectra", "steps", "strokes", "svg"]
