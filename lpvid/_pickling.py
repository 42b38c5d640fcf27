"""ReadOnlyState: frozen classes whose mappings and arrays stay read-only through pickle and copy."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np


class ReadOnlyState:
    """A class without slots that pickle, copy and another process take as they take any other.

    A `types.MappingProxyType` has no pickle of its own, and numpy's pickle of a read-only array comes back writable.
    """

    def __getstate__(self) -> tuple[dict[str, Any], tuple[str, ...], tuple[str, ...]]:
        held = dict(vars(self))
        views = tuple(k for k, v in held.items() if isinstance(v, MappingProxyType))
        frozen = tuple(k for k, v in held.items() if isinstance(v, np.ndarray) and not v.flags.writeable)
        return {k: dict(v) if k in views else v for k, v in held.items()}, views, frozen

    def __setstate__(self, state: tuple[dict[str, Any], tuple[str, ...], tuple[str, ...]]) -> None:
        held, views, frozen = state
        for name in views:
            mapping: Mapping[Any, Any] = held[name]
            held[name] = MappingProxyType(mapping)
        for name in frozen:
            held[name].setflags(write=False)
        vars(self).update(held)
