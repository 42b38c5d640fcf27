"""A figure where it can be seen: in a file, a window, a notebook or a gallery."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lpvid.plot.style import Drawn, figure_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def show(figure: Figure | Drawn, path: str | Path | None = None) -> None:
    """Write a figure to a file, or hand it to pyplot, which opens a window where the backend has windows.

    The figures of `lpvid.plot` and `quartercar.plot` are outside pyplot, so that nothing global is touched; this is the
    one door to it. A notebook and a gallery show what pyplot holds.

    Parameters
    ----------
    figure : matplotlib.figure.Figure, or Axes or an array of them
        What a function of `lpvid.plot` returns; of axes, their whole figure.
    path : str or Path, optional
        Name of the file; its suffix chooses the format. Left out, pyplot shows the figure.

    Examples
    --------
    >>> import tempfile
    >>> from matplotlib.figure import Figure
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     show(Figure(), Path(folder) / "empty.png")
    ...     (Path(folder) / "empty.png").exists()
    True
    """
    if path is not None:
        figure_of(figure).savefig(path)
        return
    import matplotlib as mpl
    from matplotlib import pyplot
    from matplotlib.backends.registry import BackendFilter, backend_registry

    pyplot.figure(figure_of(figure))
    if mpl.get_backend().lower() in backend_registry.list_builtin(BackendFilter.INTERACTIVE):
        pyplot.show()
