"""Product: all products of the functions of two bases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.composite import Composite
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Product(Composite):
    """All products φ_i(p)·ψ_j(q) of two bases: a tensor grid over several scheduling variables.

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
