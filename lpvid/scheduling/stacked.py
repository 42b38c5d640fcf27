"""Stacked: the functions of several bases side by side."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.composite import Composite
from lpvid.scheduling.reading import Reading, merged
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Stacked(Composite):
    """The functions of several bases side by side (realisations that read p at several times need this).

    Parameters
    ----------
    factors : tuple of Basis
        In the order of their functions.

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

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        return merged([f.readings(shift) for f in self.factors], max)

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        parts = [f.ranges(limits) for f in self.factors]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def penalty(self, order: int) -> np.ndarray:
        from scipy.linalg import block_diag

        return np.asarray(block_diag(*(f.penalty(order) for f in self.factors)))

    def trimmed(self, c: np.ndarray) -> tuple[Basis, np.ndarray]:
        ends = np.cumsum([0, *(f.size for f in self.factors)])
        kept = [f.trimmed(c[i:j]) for f, (i, j) in zip(self.factors, itertools.pairwise(ends), strict=True)
                if c[i:j].any()]
        joined = Stacked(tuple(b for b, _ in kept)) if len(kept) > 1 else kept[0][0] if kept else self
        if kept and joined.names == self.names:
            return joined, np.concatenate([x for _, x in kept])
        return self, c

    def shifted(self, lag: int) -> Basis:
        return Stacked(tuple(f.shifted(lag) for f in self.factors))

    def still(self) -> Basis:
        """Without delays, factor by factor.

        Returns
        -------
        Basis
            Equal to this one for a constant scheduling.
        """
        return Stacked(tuple(f.still() for f in self.factors))

    def piece_degree(self, moving: Collection[str]) -> int | None:
        known = self._piece_degrees(moving)
        return None if known is None else max(known, default=0)
