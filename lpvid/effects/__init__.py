"""Effects: what a cause by name changes in a simulation, catalogues of them, and models with effects in them.

`Effect` is the contract: its stage, its parameters, the change of a simulation. `composition` puts effects around a
baseline; `extended` is such a composition as a model for all other commands. Which of
them are there is decided by a diagnosis, one room further up.
"""

from __future__ import annotations

from lpvid.effects.effect import Effect, EffectParameter, GridEffect, LpvChange

__all__ = ["Effect", "EffectParameter", "GridEffect", "LpvChange"]
