"""Controllers in files: their part in `lpvid.save` and `lpvid.load`, by the entry-point group ``lpvid.kinds``."""

from __future__ import annotations

from lpvid.export.serialise import Kind
from quartercar.controllers import CONTROLLERS, LAWS

KIND = Kind("controller", 1, LAWS, "quartercar", CONTROLLERS)
"""``quartercar/controller/1``: every law of `quartercar.controllers.LAWS`, chosen by its name."""
