"""Product: all products of the functions of two bases."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.composite import Composite
from lpvid.scheduling.reading import Reading, merged
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Product(Composite):
    """All products φ_i(p)·ψ_j(q) of two bases: a tensor grid over several scheduling variables.

    Parameters
    ----------
    first, second : Basis
        φ and ψ; the functions of the second run fastest.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> Product(Polynomial("p", degree=1), Polynomial("q", degree=1)).labels
    ('1', 'q', 'p', 'p*q')
    """

    kind = "product"

    first: Basis
    second: Basis

    @property
    def factors(self) -> tuple[Basis, ...]:  # type: ignore[override]
        """Both bases."""
        return (self.first, self.second)

    @property
    def size(self) -> int:
        return self.first.size * self.second.size

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple("*".join(x for x in (a, b) if x != "1") or "1"
                     for a in self.first.labels for b in self.second.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        first, second = self.first.degree, self.second.degree
        return None if first is None or second is None else first + second

    def _outer(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("ni,nj->nij", a, b).reshape(a.shape[0], -1)

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self._outer(*(f.evaluate(self._columns(f, p)) for f in self.factors))

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        _checks.known_name(name, self.names, "scheduling variable")
        a, b = (f.evaluate(self._columns(f, p)) for f in self.factors)
        return self._outer(self._slope(self.first, p, name), b) + self._outer(a, self._slope(self.second, p, name))

    def bound(self, box: Scheduling) -> Product:
        return Product(self.first.bound(box), self.second.bound(box))

    @property
    def unity(self) -> np.ndarray | None:
        first, second = self.first.unity, self.second.unity
        return None if first is None or second is None else np.kron(first, second)

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        return merged([f.readings(shift) for f in self.factors], sum)

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        (a, b), (c, d) = self.first.ranges(limits), self.second.ranges(limits)
        corners = np.array([np.kron(x, y) for x in (a, b) for y in (c, d)])
        return corners.min(axis=0), corners.max(axis=0)

    def penalty(self, order: int) -> np.ndarray:
        first, second = self.first.penalty(order), self.second.penalty(order)
        return np.kron(first, np.eye(len(second))) + np.kron(np.eye(len(first)), second)

    def trimmed(self, c: np.ndarray) -> tuple[Basis, np.ndarray]:
        first, c = self.first.trimmed(c.reshape(self.first.size, self.second.size, *c.shape[1:]))
        second, c = self.second.trimmed(c.swapaxes(0, 1))
        return Product(first, second), c.swapaxes(0, 1).reshape(first.size * second.size, *c.shape[2:])

    def shifted(self, lag: int) -> Basis:
        return Product(self.first.shifted(lag), self.second.shifted(lag))

    def still(self) -> Basis:
        """Without delays, factor by factor.

        Returns
        -------
        Basis
            Equal to this one for a constant scheduling.
        """
        return Product(self.first.still(), self.second.still())

    def piece_degree(self, moving: Collection[str]) -> int | None:
        known = self._piece_degrees(moving)
        return None if known is None else sum(known)
