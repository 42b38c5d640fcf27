"""One door from figures to files and to pyplot."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib import pyplot

from lpvid import plot
from lpvid.plot.style import panels


@pytest.fixture(autouse=True)
def _closed():
    pyplot.close("all")
    yield
    pyplot.close("all")


def test_a_path_writes_the_file_and_leaves_pyplot_alone(tmp_path: Path) -> None:
    figure, _ = panels(1, 1)
    plot.show(figure, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert pyplot.get_fignums() == []


def test_without_a_path_pyplot_holds_the_figure() -> None:
    figure, _ = panels(1, 1)
    plot.show(figure)
    assert [pyplot.figure(n) for n in pyplot.get_fignums()] == [figure]
