"""The palette of all figures, which colour-blind readers can separate."""

from __future__ import annotations

INK, MUTED, FAINT = "#22262b", "#6b7480", "#d8dde3"
BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#56b4e9", "#cc79a7"
"""Okabe & Ito's colours, distinguishable with every common colour vision."""
CYCLE = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
MEASURED, MODEL = INK, VERMILION
SCALE = "viridis"
"""Colour map for a scheduling variable: rises in lightness, so that it survives a grey print."""
VISIBLE = 0.6
"""Share of `SCALE` that has a contrast of 3:1 or more with white (WCAG 2.1, 1.4.11: what a drawing needs to be seen);
inverted on a dark page it has 4.5:1 or more. The yellow beyond has 1.3:1."""
