"""What every drawing of the toolbox does with the caller's axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lpvid.errors import InputError


def check_on_given_axes(draw: Callable[[Any], Any]) -> None:
    """The curves and figures of new axes stand on given ones too; another number of axes is refused in one line."""
    made = np.atleast_1d(np.asarray(draw(None), dtype=object)).ravel()
    assert all(isinstance(ax, Axes) for ax in made)
    given = Figure().subplots(1, made.size, squeeze=False).ravel()
    back = np.atleast_1d(np.asarray(draw(given), dtype=object)).ravel()
    assert list(back) == list(given)
    for new, old in zip(back, made, strict=True):
        assert len(new.lines) == len(old.lines) and len(new.collections) == len(old.collections)
        for a, b in zip(new.lines, old.lines, strict=True):
            np.testing.assert_array_equal(np.asarray(a.get_ydata()), np.asarray(b.get_ydata()))
    with pytest.raises(InputError, match="is drawn on"):
        draw(Figure().subplots(1, made.size + 1, squeeze=False))
