"""Wall time of a call."""

from __future__ import annotations

import time
from collections.abc import Callable


def best_of(function: Callable[[], object], times: int = 3) -> float:
    """Least wall time of a few calls after a first one [s]."""
    function()
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        spent.append(time.perf_counter() - start)
    return min(spent)
