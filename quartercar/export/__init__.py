"""Dampers, controllers and the loop law of a quarter car as step programs: what `lpvid export` makes of them."""

from __future__ import annotations

from lpvid.export.contract import Exporter
from quartercar.export.flow_steps import flow_of
from quartercar.export.nouns import accepts, prepare

EXPORTER = Exporter(accepts, prepare, flow_of)
"""Named in the entry-point group ``lpvid.exports``."""
