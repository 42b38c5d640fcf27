"""What all reports have: origin, contents, terms, next steps; time traces that are right, small and quick."""

from __future__ import annotations

import hashlib
import json
import re
import time
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from helpers.browser import BROWSER, axe_source, grave_findings, opened
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.report import Curve, NextStep, Notes, Origin, Page, PageTable, Panel, Paragraph, Section, Traces, render
from lpvid.report.glossary import TERMS, split_terms, term_of
from lpvid.report.origin import Source, sources_of
from lpvid.report.traces import LEVELS, extremes, pack, unpacked

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
LONG = 150_000
"""Samples of the record that has to open in under a second."""


def curves(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, a lively signal with a gap, and a model of it."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / 500.0
    y = 900 * np.sin(2 * np.pi * 1.3 * t) + 200 * np.sin(2 * np.pi * 17.0 * t) + 60 * rng.standard_normal(n)
    y[n // 2: n // 2 + n // 50] = np.nan
    return t, y, 0.97 * np.nan_to_num(y) + 20 * rng.standard_normal(n)


def traces(n: int = 2000, caption: str = "A run.") -> Traces:
    t, y, model = curves(n)
    current = np.repeat(np.arange(-(-n // 100)) % 3, 100)[:n].astype(float)
    return Traces((Panel("force [N]", (Curve("measured", t, y), Curve("free run", t, model, "model"))),
                   Panel("current [A]", (Curve("current", t, current, "input", stepped=True),))), caption,
                  marked=(1.0, 1.5, "largest error"))


def whole_page(*items, origin: Origin | None = None) -> Page:
    table = PageTable(("record", "free-run ESR", "fit [%]"), (("run", "0.01", "90"), ("held-out", "0.02", "86")),
                  "Free run, held-out.", (1, 2), ("good", "warn"))
    return Page("A page", "The free run has an ESR of 0.01 on held-out data.", "good", (("free-run ESR", "0.01"),),
                ("Nothing was held out.",), (Section("Figures", (table,)), Section("Over time", items),
                                             Section("Figures", (Paragraph("Again."),))),
                (NextStep("Try it elsewhere.", "lpvid validate OUT/model.json only.json NEW.csv"),), origin)


# -- packing ----------------------------------------------------------------------------------------------------------
@settings(max_examples=40, deadline=None)
@given(st.integers(1, 400), st.integers(0, 2**31), st.floats(1e-6, 1e9), st.floats(-1e6, 1e6))
def test_unpacked_values_are_those_packed(n, seed, size, offset):
    """Within half a step of 1/65534 of the panel's range, gaps where they were, at the times they had."""
    rng = np.random.default_rng(seed)
    y = offset + size * rng.standard_normal(n)
    y[rng.uniform(size=n) < 0.1] = np.nan
    t = 3.0 + 0.01 * np.arange(n)
    figure = json.loads(pack([Traces((Panel("y [1]", (Curve("y", t, y),)),), "")], 10**7)[0])
    panel = figure["panels"][0]
    found = unpacked(panel["curves"][0], panel)
    assert np.array_equal(np.isnan(found), np.isnan(y))
    step = (panel["high"] - panel["low"]) / LEVELS
    known = np.isfinite(y)
    assert np.all(np.abs(found - y)[known] <= 0.5 * step * (1 + 1e-6) + 1e-9 * abs(offset))
    start, period = panel["curves"][0]["clock"]
    assert start == pytest.approx(t[0]) and (n < 2 or period == pytest.approx(0.01))


def test_an_uneven_clock_keeps_its_times():
    import base64
    import zlib

    t = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 300))
    panel = json.loads(pack([Traces((Panel("y [1]", (Curve("y", t, t**2),)),), "")], 10**6)[0])["panels"][0]
    curve = panel["curves"][0]
    assert "clock" not in curve
    assert np.array_equal(np.frombuffer(zlib.decompress(base64.b64decode(curve["times"]))), t)


@pytest.mark.parametrize("room", [120_000, 60_000, 8_000])
def test_what_does_not_fit_is_thinned_to_its_extremes(room):
    """Never above the room, and no peak is lost: largest and least value survive any thinning."""
    figure = traces(60_000)
    text = pack([figure], room)[0]
    assert len(text) <= room
    panel = json.loads(text)["panels"][0]
    y = figure.panels[0].curves[0].values
    found = unpacked(panel["curves"][0], panel)
    step = (panel["high"] - panel["low"]) / LEVELS
    assert found.size < 60_000
    assert np.nanmax(found) == pytest.approx(np.nanmax(y), abs=step) and np.nanmin(found) == pytest.approx(
        np.nanmin(y), abs=step)
    start, pace = panel["curves"][0]["clock"]
    assert abs(start + pace * (found.size - 1) - figure.panels[0].curves[0].times[-1]) < 2 * pace


def test_extremes_are_found_in_every_bin():
    y = np.random.default_rng(1).standard_normal(1003)
    places, size = extremes(y, 100)
    assert places.size <= 102 and np.all(np.diff(places) >= 0)
    for k in range(0, 1003, size):
        inside = places[(places >= k) & (places < k + size)]
        assert y[inside].max() == y[k:k + size].max() and y[inside].min() == y[k:k + size].min()


def test_a_run_that_leaves_all_bounds_is_cut_at_the_limits():
    t, huge = np.arange(5.0), np.array([0.0, 1.0, 1e200, -1e300, np.nan])
    figure = Traces((Panel("y [1]", (Curve("y", t, huge),), (-2.0, 3.0)),), "")
    panel = json.loads(pack([figure], 10**6)[0])["panels"][0]
    assert unpacked(panel["curves"][0], panel) == pytest.approx([0.0, 1.0, 3.0, -2.0, np.nan], abs=1e-4, nan_ok=True)


def test_names_cannot_close_the_script():
    t = np.arange(3.0)
    html = render(whole_page(Traces((Panel("</script><b>", (Curve("<i>", t, t),)),), "A run.")))
    assert "</script><b>" not in html and "\\u003c/script>" in html


# -- the page ---------------------------------------------------------------------------------------------------------
def test_contents_steps_origin_and_terms(tmp_path):
    when = datetime(2031, 2, 3, 4, 5, tzinfo=UTC)
    origin = Origin("lpvid identify run.csv --out res", when, (Source("a/run.csv", "0123456789ab"),
                                                               Source("b/run.csv", "ba9876543210"),
                                                               Source("deep/only.json", "0" * 12)),
                    ("model.json", "other.bin"), "res")
    html = render(whole_page(Notes(("nothing",)), origin=origin))
    ids = re.findall(r'<section id="([^"]+)"', html)
    assert ids == ["next", "figures", "over-time", "figures-2", "origin"]
    assert re.findall(r'<a href="#([^"]+)"', html) == ids
    assert "3 February 2031, 04:05 UTC" in html and html.index("3 February") < html.index("<section")
    listed = render(Page("t", "v", "good", (), steps=(NextStep("Go.", "lpvid x --law passive,OUT/c.json,only.json"),),
                         origin=origin))
    assert "<span>passive,res/c.json,deep/only.json</span>" in listed
    assert '<span>res/model.json</span>' in html  # OUT stands for the folder of the results
    assert '<span>deep/only.json</span>' in html  # and a file that was read for its path
    for text in ("a/run.csv</td><td class=\"hash\">0123456789ab", "b/run.csv</td>",
                 '<a href="model.json">model.json</a>', '<a href="other.bin">'):
        assert text in html
    assert html.count(f'<abbr title="{TERMS["ESR"].replace("<", "&lt;")}" tabindex="0">') == 1
    assert html.count("<dt>ESR</dt>") == 1 and "<dt>BIC</dt>" not in html
    assert "<script" not in html


def test_what_stands_between_backquotes_is_code():
    html = render(whole_page(Notes(("`lpvid verify <a>` re-checks it", "no ` alone"))))
    assert "<code>lpvid verify &lt;a&gt;</code> re-checks it" in html and "no ` alone" in html


@pytest.mark.parametrize("term", sorted(TERMS))
def test_every_term_is_found_where_it_stands(term):
    text = f"the free-run {term} 3" if term == "fit" else f"the {term} of it"
    assert (term_of(term), TERMS[term]) == (term, TERMS[term])
    assert term in {t for _, t in split_terms(text)}
    assert "".join(words for words, _ in split_terms(text)) == text


def test_a_fit_to_data_is_not_the_figure_of_that_name():
    assert all(not t for _, t in split_terms("Fit a model; the fit is quick")[:1])
    assert ("fit", "fit") in split_terms("fit 88.2 %, rmse 3 N")
    assert all(not term for _, term in split_terms("fit a model to keep"))


@pytest.mark.seconds
def test_a_command_line_leaves_its_origin(tmp_path, monkeypatch):
    """Line, hash and files of a real run; a word that is the name of a file is no file that was read."""
    t = np.arange(400) / 100
    lines = "\n".join(f"{a:.2f},{np.sin(9 * a):.6f},{np.cos(9 * a) + 0.1 * np.sin(40 * a):.6f}" for a in t)
    data = tmp_path / "my run.csv"
    data.write_text(f"time [s],velocity [m/s],force [N]\n{lines}\n")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "velocity").write_text("a file with the name of a channel")
    done = CliRunner().invoke(app, ["inspect", "my run.csv", "--input", "velocity", "--out", "res"])
    assert done.exit_code == 0, done.output
    html = (tmp_path / "res" / "report.html").read_text()
    plain = re.sub(r"</?span>", "", html)
    assert "lpvid inspect &#39;my run.csv&#39; --input velocity --out res" in plain
    assert hashlib.sha256(data.read_bytes()).hexdigest()[:12] in html
    assert re.findall(r'class="hash">(\w+)<', html) == [hashlib.sha256(data.read_bytes()).hexdigest()[:12]]
    assert '<a href="audit.json">' in html and (tmp_path / "res" / "audit.json").is_file()
    assert sources_of([tmp_path / "gone.csv"]) == ()


# -- in a browser -----------------------------------------------------------------------------------------------------
PROBE = """
addEventListener('load', async () => {
  const root = document.documentElement;
  try {
    await window.lpvidTraces.all();
    const figure = window.lpvidTraces.figures[0], chart = figure.charts[0];
    const spread = () => chart.data[1].filter(v => v != null);
    root.setAttribute('data-points', figure.points);
    root.setAttribute('data-drawn', chart.data[0].length);
    root.setAttribute('data-largest', Math.max(...spread()));
    figure.show([1.0, 1.2]);
    root.setAttribute('data-zoomed', JSON.stringify([chart.data[0], chart.data[1]]));
    root.setAttribute('data-both', figure.charts.map(c => c.scales.x.min.toFixed(6)).join(' '));
    document.querySelector('button[aria-label="show the whole record"]').click();
    root.setAttribute('data-back', chart.data[0].length);
    root.setAttribute('data-overflow', root.scrollWidth > innerWidth + 1);
    root.setAttribute('data-wide', Math.max(...figure.charts.map(c => c.width)) > innerWidth);
    root.setAttribute('data-fetched', performance.getEntriesByType('resource').filter(
      e => !e.name.startsWith('data:') && !e.name.startsWith('blob:')).length);
  } catch (error) { root.setAttribute('data-error', String(error)); }
});
"""


@pytest.mark.thinned(3, "slow", "seconds")
@needs_browser
@pytest.mark.parametrize("width, n", [(1200, LONG), (500, LONG), (1200, 20_000)])
def test_a_long_record_is_drawn_and_zoomed(width, n, tmp_path):
    """All extremes at first sight, the samples themselves once zoomed in, all panels together."""
    import html as entities

    figure = traces(n)
    page = render(whole_page(figure))
    assert len(page.encode()) <= 1_500_000
    seen = opened(page, PROBE, tmp_path, width)
    assert "error" not in seen, seen["error"]
    t, y = figure.panels[0].curves[0].times, figure.panels[0].curves[0].values
    step = (np.nanmax(y) - np.nanmin(y)) / 1000
    kept = json.loads(re.findall(r'application/json">(.*?)</script>', page)[0])["bin"]
    assert 2 * 3 * n / kept >= int(seen["points"]) > 2 * n / kept and kept <= 12 and int(seen["drawn"]) < 3 * width
    assert float(seen["largest"]) == pytest.approx(np.nanmax(y), abs=step)
    assert seen["back"] == seen["drawn"] and seen["overflow"] == seen["wide"] == "false" and seen["fetched"] == "0"
    assert len(set(seen["both"].split())) == 1
    x, values = (np.array(v, dtype=float) for v in json.loads(entities.unescape(seen["zoomed"])))
    assert x[0] <= 1.0 and x[-1] >= 1.2 - 0.01
    assert n == LONG or kept == 1
    if kept == 1:  # every sample fits: the curve is the record's
        inside = np.searchsorted(t, x[0] - 1e-9) + np.arange(x.size)
        assert x == pytest.approx(t[inside], abs=1e-9) and values == pytest.approx(y[inside], abs=step)


STEPS = """
addEventListener('load', async () => {
  const root = document.documentElement;
  await window.lpvidTraces.all();
  const figure = window.lpvidTraces.figures[0], [a, b] = figure.whole, drawn = [];
  for (let k = 0; k <= 60; k++) {
    const half = 0.5 * (b - a) * Math.pow(0.85, k);
    figure.show([0.5 * (a + b) - half, 0.5 * (a + b) + half]);
    drawn.push(Math.max(...figure.charts.map(c => c.data[0].length)));
  }
  root.setAttribute('data-points', figure.points);
  root.setAttribute('data-wide', Math.max(...figure.charts.map(c => c.width)));
  root.setAttribute('data-most', Math.max(...drawn));
  root.setAttribute('data-least', Math.min(...drawn));
});
"""


@needs_browser
@pytest.mark.slow
@pytest.mark.parametrize("width", [500, 1200])
def test_a_long_record_is_never_drawn_whole(width, tmp_path):
    """Opening and every step of a zoom draw two points for a pixel at most, whatever the record's length.

    How long they take is measured by benchmarks/report_times.py.
    """
    seen = opened(render(whole_page(traces(LONG))), STEPS, tmp_path, width)
    assert int(seen["points"]) > 100_000
    assert 1 <= int(seen["least"]) <= int(seen["most"]) <= 2 * int(seen["wide"])


@pytest.mark.slow
def test_a_long_record_is_written_quickly():
    start = time.process_time()
    render(whole_page(traces(LONG), traces(LONG)))
    assert time.process_time() - start < 5.0


@pytest.mark.seconds
@needs_browser
@pytest.mark.skipif(axe_source() is None, reason="no axe-core here")
@pytest.mark.parametrize("width", [1200, 500])
def test_no_grave_findings_of_accessibility(width, tmp_path):
    wide = PageTable(tuple(f"column {k}" for k in range(30)), (tuple(f"a value {k}" for k in range(30)),), "Wide.",
                 folded="All")
    origin = Origin("lpvid x", datetime(2031, 1, 1, tzinfo=UTC), (Source("a.csv", "0" * 12),), ("model.json",), "res")
    page = whole_page(traces(), wide, replace(wide, folded=""), Notes(("note",)), origin=origin)
    assert grave_findings(render(page), tmp_path, width) == ""


@pytest.mark.seconds
@needs_browser
@pytest.mark.skipif(axe_source() is None, reason="no axe-core here")
def test_the_search_for_findings_finds_them(tmp_path):
    assert "image-alt" in grave_findings(render(whole_page()).replace("<main>", '<main><img src="data:,">'), tmp_path)


@pytest.mark.seconds
def test_constant_gains_are_a_table_and_others_a_figure() -> None:
    """A state feedback without scheduling: its lines over frequency would be flat."""
    from lpvid.report.page import PageFigure, PageTable
    from lpvid.report.synthesis import gains_item

    d = np.array([[[3.0, -4.0]]])
    fixed = lpv.LPVStateSpace(np.zeros((1, 0, 0)), np.zeros((1, 0, 2)), np.zeros((1, 1, 0)), d, lpv.Polynomial(), None)
    table = gains_item(fixed)
    assert isinstance(table, PageTable) and [row[1] for row in table.rows] == ["3", "-4"]
    one = np.ones((2, 1, 1))
    assert isinstance(gains_item(lpv.LPVStateSpace(-one, one, one, 0 * one, lpv.Polynomial(("p",), degree=1), None)),
                      PageFigure)
