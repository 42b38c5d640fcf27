"""Noise and effort where a plant has none: controllers of moderate gains, if a bound leaves room for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from lpvid.synthesis.progress import stop_at, stopped
from lpvid.synthesis.projected_search import ROOMY, least_bound
from lpvid.synthesis.projection import MatrixPair, ProjectedInequalities
from lpvid.synthesis.regularised_plants import regular, singular

SLACK = 0.002
"""share by which the controller's bound is above that of X and Y, which hold their own only to a solver's accuracy."""
NOISE = (10.0, 1.0, 1e-1, 1e-2, 1e-3, 1e-4)
"""noise, and effort, added for moderate gains where nothing else limits them: shares of what the sensors show."""


class Moderated:
    """The inequalities with `NOISE`, where controls are free or measurements exact, each with a bound near its least.

    That does not depend on the bound requested and rises with the noise: it is computed once per size, for half of the
    sizes left each time. A program for a bound that the noise does not admit takes a solver five times as long.

    Parameters
    ----------
    projected : ProjectedInequalities
        Of the plant itself.
    best : MatrixPair
        Its pair of least bound.
    solvers : tuple of str
    fewer : mapping of int to float, optional
        Bounds by size for the same plant at fewer points: at more points they are no lower, so that a bound which they
        refuse needs no program.
    """

    def __init__(self, projected: ProjectedInequalities, best: MatrixPair, solvers: tuple[str, ...],
                 fewer: Mapping[int, float] | None = None) -> None:
        self.projected, self.best, self.solvers, self.fewer = projected, best, solvers, dict(fewer or {})
        self.sizes = NOISE if singular(projected.plant) else ()
        self.found: dict[int, tuple[ProjectedInequalities, MatrixPair | None]] = {}

    @property
    def bounds(self) -> dict[int, float]:
        """The least bound by size, of those computed here or at fewer points; infinite where there is none."""
        own = {k: math.inf if pair is None else pair.gamma for k, (_, pair) in self.found.items()
               if pair is None or pair.status != ROOMY}
        return {**self.fewer, **own}

    def fitting(self, gamma: float) -> Iterator[tuple[ProjectedInequalities, MatrixPair]]:
        """Those that admit a bound, the most noise first.

        Parameters
        ----------
        gamma : float
            The bound.

        Yields
        ------
        ProjectedInequalities, MatrixPair
        """
        first, last = 0, len(self.sizes)
        while first < last:
            middle = (first + last) // 2
            first, last = (first, middle) if self._admits(middle, gamma) else (middle + 1, last)
        for k in range(first, len(self.sizes)):
            if self._admits(k, gamma):
                noisy, least = self._least(k)
                assert least is not None
                yield noisy, least

    def _admits(self, k: int, gamma: float) -> bool:
        if k not in self.found and self.fewer.get(k, 0.0) * (1 + SLACK) >= gamma:
            return False
        least = self._least(k)[1]
        return least is not None and least.status != ROOMY and least.gamma * (1 + SLACK) < gamma

    def _least(self, k: int) -> tuple[ProjectedInequalities, MatrixPair | None]:
        if k not in self.found:
            noisy, least = replace(self.projected, plant=regular(self.projected.plant, self.sizes[k])), None
            if stopped():
                return noisy, None
            try:
                least = least_bound(noisy, solvers=self.solvers, known=self.best, roughly=True)
            except KeyboardInterrupt as error:  # the plant's own pair is there to go on with
                stop_at(error)
            self.found[k] = noisy, least
        return self.found[k]
