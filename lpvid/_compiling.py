"""Compile a kernel with numba, kept on disk where there is a folder to keep it in.

Import this module inside the function that needs it: it loads numba.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit(cache=True, nogil=True, …)`; where no folder for the cache can be written, without the cache.

    Kernels work on arrays alone, so that several can run at a time in threads. Without the cache the kernel is
    compiled anew by every process, which costs a few seconds and changes no number.

    Parameters
    ----------
    **options
        As for `numba.njit`.

    Returns
    -------
    callable
        The decorator.
    """
    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, nogil=True, **options)(function)
        except RuntimeError:  # no place for the cache: an installation for all users, no home
            return numba.njit(**options)(function)

    return compiled


@njit()
def copy_values(source, target):
    """Write a one-dimensional array into another of its size, inside a kernel.

    As `target[:] = source`, whose error message about sizes numba compiles into every kernel that holds one: 2.4 s of
    processor time instead of 0.1 s.
    """
    for i in range(target.size):
        target[i] = source[i]
