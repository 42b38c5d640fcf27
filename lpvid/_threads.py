"""One BLAS thread for work on small matrices: there, threads cost ten times what they bring."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache


@cache
def _controller():
    import numpy.linalg  # noqa: F401
    import scipy.linalg  # noqa: F401  (both libraries' BLAS must be loaded to be seen)
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit every BLAS to one thread inside the block; nests."""
    with _controller().limit(limits=1, user_api="blas"):
        yield
