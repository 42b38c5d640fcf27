"""Dampers in files: what `lpvid.save` and `lpvid.load` know of them, by the entry-point group ``lpvid.kinds``."""

from __future__ import annotations

from lpvid.export.serialise import Kind
from quartercar.dampers import MODELS

KIND = Kind("damper", 1, (*MODELS, ("identified", "quartercar.dampers.identified", "Identified")), "quartercar")
"""``quartercar/damper/1``: every model of `quartercar.dampers.MODELS`, and those that lpvid identified."""
