"""Stacked: the functions of several bases side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.composite import Composite
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Stacked(Composite):
    """The functions of several bases side by side (realisations that read p at several times need this).

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial, Shifted
    >>> Stacked((Polynomial("p", degree=1), Shifted(Polynomial("p", degree=1), 1))).labels
    ('1', 'p', '1', 'p(k-1)')
    """

    kind = "stacked"

    factors: tuple[Basis, ...]  # type: ignore[assignment]

    @property
    def size(self) -> int:
        return sum(f.size for f in self.factors)

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(label for f in self.factors for label in f.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        degrees = [f.degree for f in self.factors]
        known = [d for d in degrees if d is not None]
        return max(known) if len(known) == len(degrees) else None

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return np.hstack([f.evaluate(self._columns(f, p)) for f in self.factors])

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        _checks.known_name(name, self.names, "scheduling variable")
        return np.hstack([self._slope(f, p, name) for f in self.factors])

    def bound(self, box: Scheduling) -> Stacked:
        return Stacked(tuple(f.bound(box) for f in self.factors))

    @property
    def redundant(self) -> int | None:
        return None

    @property
    def unity(self) -> np.ndarray | None:
        place = next((i for i, f in enumerate(self.factors) if f.unity is not None), None)
        parts = [f.unity if i == place else np.zeros(f.size) for i, f in enumerate(self.factors)]
        return None if place is None else np.concatenate(parts)  # type: ignore[arg-type]
