"""Shown: results that draw themselves, alone or on axes of the caller, and appear as a small card in a notebook."""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any, ClassVar


class Shown:
    """What can be drawn; the drawing itself stands in a higher layer and is looked up when it is wanted.

    Attributes
    ----------
    DRAWN_BY : str
        Module that registers the drawing of this class in `lpvid.plot.drawings.drawing_of`.
    """

    DRAWN_BY: ClassVar[str] = "lpvid.plot.drawings"

    def plot(self, ax: Any = None) -> Any:
        """Draw it.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or sequence of them, optional
            Where to draw; left out, a new figure is made.

        Returns
        -------
        matplotlib.axes.Axes or (n,) array of them
            One for each panel.

        Raises
        ------
        InputError
            Another number of axes than the drawing has panels.
        """
        return self._drawings().plot(self, ax)

    def _repr_html_(self) -> str:
        return self._drawings().card(self)

    def _drawings(self) -> ModuleType:
        importlib.import_module(self.DRAWN_BY)
        return importlib.import_module(Shown.DRAWN_BY)
