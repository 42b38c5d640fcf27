"""What a package on top of lpvid needs beside its classes: checks of arguments, kernels, threads, processes, drawing.

`quartercar` uses nothing of lpvid that starts with an underscore, and no other package has to.

- ``checks``: checks of a caller's argument, each with a message of one line (`checks.positive`, `checks.known_name`).
- ``njit``, ``copy_values``: compile a kernel with numba and keep it on disk. They load numba: import a module of
  kernels inside the function that calls them.
- ``single_thread``, ``found_once``, ``in_processes``, ``in_forks``, ``Beside``: one BLAS thread inside a block, a value
  that threads share, a function over items on several processes or forks, one call beside the caller's own work.
  ``processors``: how many of them the machine has for this process.
- ``ReadOnlyState``: a frozen class whose mappings and arrays stay read-only through pickle and copy.
- ``triangular_factor``: R of a tall matrix, with one copy of it in memory.
- ``Shown``: a result that draws itself and has a card in a notebook.

Examples
--------
>>> from lpvid.toolkit import checks
>>> checks.positive(-1.0, "mass", "kg")
Traceback (most recent call last):
lpvid.errors.InputError: mass must be positive: got -1.0 kg.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lpvid import _checks as checks
from lpvid._forks import in_forks
from lpvid._pickling import ReadOnlyState
from lpvid._processes import Beside, in_processes
from lpvid._shown import Shown
from lpvid._tall import triangular_factor
from lpvid._threads import found_once, processors, single_thread

if TYPE_CHECKING:
    from lpvid._compiling import copy_values, njit

__all__ = ["Beside", "ReadOnlyState", "Shown", "checks", "copy_values", "found_once", "in_forks", "in_processes",
           "njit", "processors", "single_thread", "triangular_factor"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'lpvid.toolkit' has no attribute '{name}'")
    from lpvid import _compiling  # loads numba

    return getattr(_compiling, name)
