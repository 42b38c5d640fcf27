"""Shifted: the same functions of the scheduling some samples ago."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.scheduling.basis import Basis
from lpvid.scheduling.reading import Reading
from lpvid.scheduling.variables import Scheduling


@dataclass(frozen=True)
class Shifted(Basis):
    """The same functions of p(k − lag): dynamic dependence; a negative lag reads future p.

    Parameters
    ----------
    basis : Basis
        The functions.
    lag : int
        [samples]; before the first sample, and behind the last, the end values hold.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> Shifted(Polynomial("p", degree=1), 1).evaluate(np.array([[1.0], [2.0], [3.0]]))
    array([[1., 1.], [1., 1.], [1., 2.]])
    """

    kind = "shifted"

    basis: Basis
    lag: int

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Scheduling variables of the basis."""
        return self.basis.names

    @property
    def size(self) -> int:
        return self.basis.size

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(x if x == "1" or not self.lag else f"{x}(k{-self.lag:+d})" for x in self.basis.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        return self.basis.degree

    @property
    def lags(self) -> tuple[int, int]:
        low, high = self.basis.lags
        return low + self.lag, high + self.lag

    def _moved(self, p: np.ndarray) -> np.ndarray:
        n = np.asarray(p).shape[0]
        return np.asarray(p, dtype=float)[np.clip(np.arange(n) - self.lag, 0, max(n - 1, 0))]

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self.basis.evaluate(self._moved(p))

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        return self.basis.derivative(self._moved(p), name)

    def bound(self, box: Scheduling) -> Shifted:
        return Shifted(self.basis.bound(box), self.lag)

    @property
    def redundant(self) -> int | None:
        return self.basis.redundant

    @property
    def unity(self) -> np.ndarray | None:
        return self.basis.unity

    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        return self.basis.readings(shift + self.lag)

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        return self.basis.ranges(limits)

    def penalty(self, order: int) -> np.ndarray:
        return self.basis.penalty(order)

    def shifted(self, lag: int) -> Basis:
        return self.basis.shifted(self.lag + lag)

    def still(self) -> Basis:
        """What is shifted, without its delay.

        Returns
        -------
        Basis
            Equal to this one for a constant scheduling.
        """
        return self.basis.still()
