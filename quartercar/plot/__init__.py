"""Figures of dampers: one identified model on its experiments, several models beside each other."""

from __future__ import annotations

from quartercar.plot.identified import experiments, loops_by_current, overview

__all__ = ["experiments", "loops_by_current", "overview"]
