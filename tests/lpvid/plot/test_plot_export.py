"""A figure as SVG is smaller than matplotlib writes it, and draws the same."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import BROWSER, screenshot

from lpvid.plot import svg
from lpvid.plot.style import look, panels


def figure():
    rng = np.random.default_rng(0)
    with look():
        drawn, axes = panels(1, 2)
        axes[0, 0].loglog(np.geomspace(0.1, 100, 300), rng.uniform(0.1, 3, 300), label="a curve")
        axes[0, 0].legend()
        axes[0, 1].plot(*rng.standard_normal((2, 3000)), ".", rasterized=True, alpha=0.5)
        axes[0, 1].plot([0.0, 1.0], [0.0, 1.0], "o")
    return drawn


def as_written() -> bytes:
    buffer = io.BytesIO()
    with look():
        figure().savefig(buffer, format="svg", metadata={"Date": None, "Creator": "lpvid"}, dpi=130)
    return buffer.getvalue()


@pytest.mark.seconds
def test_it_is_smaller_and_every_reference_still_has_its_mark():
    plain, short = as_written(), svg(figure())
    assert len(short) < 0.7 * len(plain)
    names = set(re.findall(rb' id="([^"]*)"', short))
    used = set(re.findall(rb'href="#([^"]*)"', short)) | set(re.findall(rb"url\(#([^)]*)\)", short))
    assert used and used <= names
    assert len(re.findall(rb"<use ", short)) == len(re.findall(rb"<use ", plain))
    assert svg(figure()) == short


@pytest.mark.seconds
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_it_draws_the_same(tmp_path: Path):
    """Pixel by pixel in a browser: but for the palette of the cloud and the rounding of edges, nothing differs."""
    from matplotlib.image import imread

    pictures = []
    for name, data in (("plain", as_written()), ("short", svg(figure()))):
        (tmp_path / f"{name}.svg").write_bytes(data)
        screenshot(tmp_path / f"{name}.svg", tmp_path / f"{name}.png", tmp_path / "p", 960, 220)
        pictures.append(imread(tmp_path / f"{name}.png")[..., :3])
    gap = np.abs(pictures[0] - pictures[1])
    assert np.ptp(pictures[0]) > 0.5
    assert float(gap.mean()) < 0.004 and float(np.mean(gap > 0.25)) < 0.002
