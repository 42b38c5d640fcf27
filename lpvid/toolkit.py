"""What a package on top of lpvid needs beside the nouns: checks of arguments, kernels, threads, processes, drawing.

`quartercar` uses nothing of lpvid that starts with an underscore, and no other package has to.

- ``checks``: checks of a caller's argument, each with a message of one line (`checks.positive`, `checks.known_name`).
- ``njit``, ``copy_values``: compile a kernel with numba and keep it on disk. They load numba: import a module of
  kernels inside the function that calls them.
__all__ = ["Beside", "ReadOnlyState", "Shown", "checks", "copy_values", "found_once", "in_forks", "in_processes", "njit",
           "single_thread"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'lpvid.toolkit' has no attribute '{name}'")
    from lpvid import _compiling  # loads numba

    return getattr(_compiling, name)
