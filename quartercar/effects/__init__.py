"""Causes that a diagnosis can name: one family per file, one ordered catalogue."""

from __future__ import annotations

from lpvid.diagnosis.effect import Effect
from quartercar.effects.electrical import CoilLag, CommandDelay, CurrentSaturation, Remanence, RiseFallLag
from quartercar.effects.friction_gas import CoulombFriction, GasPreload, GasStiffness, StribeckFriction
from quartercar.effects.measurement import (
    DisplacementDelay,
    ForceClipping,
    ForceDelay,
    ForceOffset,
    OneSidedFilter,
    Quantisation,
)

CATALOGUE: tuple[Effect, ...] = (
    CoulombFriction(), StribeckFriction(), GasPreload(), GasStiffness(),
    CoilLag(), CommandDelay(), RiseFallLag(), CurrentSaturation(), Remanence(),
    DisplacementDelay(), ForceDelay(), OneSidedFilter(), ForceOffset(), ForceClipping(), Quantisation(),
)
"""Every cause, in the order in which they are listed."""

__all__ = ["CATALOGUE"]
