"""Dampers in files: their part in `lpvid.save` and `lpvid.load`, by the entry-point group ``lpvid.kinds``."""

from __future__ import annotations

from lpvid.export.serialise import Kind
from quartercar.dampers import DAMPERS, STORED

KIND = Kind("damper", 1, STORED, "quartercar", DAMPERS)
"""``quartercar/damper/1``: every kind of `quartercar.dampers.STORED`, chosen by its name."""
