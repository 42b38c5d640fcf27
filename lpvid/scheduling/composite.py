"""What products and stacks of bases share."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from lpvid.scheduling.basis import Basis


class Composite(Basis, abstract=True):
    """Several bases over the union of their variables."""

    factors: tuple[Basis, ...]

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Scheduling variables of all factors, each once."""
        return tuple(dict.fromkeys(n for f in self.factors for n in f.names))

    @property
    def lags(self) -> tuple[int, int]:
        pairs = [f.lags for f in self.factors]
        return min(p[0] for p in pairs), max(p[1] for p in pairs)

    def _columns(self, factor: Basis, p: np.ndarray) -> np.ndarray:
        return np.asarray(p, dtype=float)[:, [self.names.index(n) for n in factor.names]]

    def _slope(self, factor: Basis, p: np.ndarray, name: str) -> np.ndarray:
        columns = self._columns(factor, p)
        return factor.derivative(columns, name) if name in factor.names else np.zeros((columns.shape[0], factor.size))

    def _piece_degrees(self, moving: Collection[str]) -> list[int] | None:
        degrees = [f.piece_degree(moving) for f in self.factors]
        known = [d for d in degrees if d is not None]
        return known if len(known) == len(degrees) else None

    @property
    def knots_of(self) -> Mapping[str, tuple[float, ...]]:
        together: dict[str, set[float]] = {}
        for factor in self.factors:
            for name, knots in factor.knots_of.items():
                together.setdefault(name, set()).update(knots)
        return {name: tuple(sorted(knots)) for name, knots in together.items()}
