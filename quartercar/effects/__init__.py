"""Causes that a diagnosis can name: one family per file, one ordered catalogue."""

from __future__ import annotations

from lpvid.diagnosis.effect import Effect
from quartercar.effects.electrical import CoilLag, CommandDelay, CurrentSaturation, Remanence, RiseFallLag

CATALOGUE: tuple[Effect, ...] = (
    CoilLag(), CommandDelay(), RiseFallLag(), CurrentSaturation(), Remanence(),
)
"""Every cause, in the order in which they are listed."""

__all__ = ["CATALOGUE"]
