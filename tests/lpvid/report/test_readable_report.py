"""What a reader needs of every page: axes with numbers, curves that can be seen, units, commands that can be run."""

from __future__ import annotations

import json
from html import unescape
from itertools import pairwise
from typing import Annotated

import numpy as np
import pytest
import typer
from helpers.browser import BROWSER, opened

import lpvid as lpv
from lpvid import plot
from lpvid.auditing import audit
from lpvid.cli.invocation import Invocation
from lpvid.model.input_stage import TanhStage
from lpvid.plot.responses import FrozenResponse
from lpvid.plot.style import figure_of, panels, plain_decades, shades
from lpvid.realization.gap import Gap
from lpvid.report import Curve, NextStep, Origin, Page, PageFigure, PageTable, Panel, Paragraph, Section, Traces, render
from lpvid.report.courses import LOW
from lpvid.report.figures import comparisons
from lpvid.report.forms import FormGap, forms_table
from lpvid.report.inspection import inspection_page
from lpvid.report.origin import Source
from lpvid.report.responses import frozen_figures

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
RANGES = ((-900.0, 900.0), (0.0, 1.0), (-3.2e-3, 3.1e-3), (0.95, 1.05), (-7.0, 13.0), (1.2e-9, 4.1e-9),
          (-3.4e-4, 3.4e-4), (-2.2e5, 2.2e5), (64.0, 66.0), (-2.4, 2.6), (0.26, 0.26))
"""Least and largest value of a panel: ranges about zero and far from it, small and large, and a constant."""
HEIGHTS = (LOW, 190)
"""Heights of panels [px], the lowest that the pages have among them."""
LABELS = """
addEventListener('load', async () => {
  const root = document.documentElement;
  try {
    await window.lpvidTraces.all();
    const seen = window.lpvidTraces.figures.flatMap(f => f.charts.map(u => {
      u.ctx.font = '12px system-ui, sans-serif';
      const axis = u.axes[1], tall = u.bbox.height / devicePixelRatio, {min, max} = u.scales.y;
      const kept = axis._splits.filter((v, i) => axis._values[i] != null && axis._values[i] !== '');
      return {labels: kept.length, wrong: kept.filter(v => v < min || v > max).length,
              apart: kept.length > 1 ? (kept[1] - kept[0]) / (max - min) * tall : 0,
              texts: axis._values.filter(t => t), room: axis.size(u, axis._values, 1, 0) - axis.ticks.size - axis.gap,
              wide: Math.max(...axis._values.filter(t => t).map(t => u.ctx.measureText(t).width)) / devicePixelRatio};
    }));
    root.setAttribute('data-axes', JSON.stringify(seen));
  } catch (error) { root.setAttribute('data-error', String(error)); }
});
"""


@pytest.mark.seconds
@needs_browser
def test_every_time_trace_has_a_scale(tmp_path):
    """Two labels or more, far enough apart to be read, whatever the range and the height of the panel."""
    t = np.arange(400) / 100
    figures = tuple(Traces(tuple(Panel("y [1]", (Curve("y", t, np.linspace(*ends, t.size)),), None, height)
                                 for ends in RANGES), f"{height} px") for height in HEIGHTS)
    seen = opened(render(Page("t", "v", sections=(Section("Over time", figures),))), LABELS, tmp_path)
    assert "error" not in seen, seen["error"]
    axes = json.loads(unescape(seen["axes"]))
    assert len(axes) == len(RANGES) * len(HEIGHTS)
    for axis in axes:
        assert axis["labels"] >= 2 and axis["wrong"] == 0 and len(set(axis["texts"])) == axis["labels"], axis
        assert axis["wide"] <= axis["room"] + 1, axis
        assert axis["apart"] >= 10, axis  # digits of 12 px letters are 9 px high


LONG_LABEL = """
addEventListener('load', async () => {
  const root = document.documentElement;
  await window.lpvidTraces.all();
  await null;
  const u = window.lpvidTraces.figures[0].charts[0], ratio = devicePixelRatio;
  u.ctx.font = 12 * ratio + 'px system-ui, sans-serif';
  const half = u.ctx.measureText(u.axes[1].label).width / 2, middle = u.bbox.top + u.bbox.height / 2;
  root.setAttribute('data-above', middle - half);
  root.setAttribute('data-below', u.ctx.canvas.height - middle - half);
});
"""


@pytest.mark.seconds
@needs_browser
@pytest.mark.parametrize("last", [False, True])
def test_the_name_of_a_channel_is_whole_beside_a_low_panel(last, tmp_path):
    t = np.arange(400) / 100
    name = Panel("actuator force, measured [kN]", (Curve("y", t, np.sin(t)),), None, LOW)
    figure = Traces((name,) if last else (name, Panel("y [1]", (Curve("y", t, np.cos(t)),), None, LOW)), "Long.")
    seen = opened(render(Page("t", "v", sections=(Section("Over time", (figure,)),))), LONG_LABEL, tmp_path)
    assert float(seen["above"]) >= 0 and float(seen["below"]) >= 0


COLUMNS = """
addEventListener('load', () => {
  const items = Array.from(document.querySelectorAll('nav.contents li'), li => li.getBoundingClientRect());
  const root = document.documentElement, heads = new Map();
  for (const r of items) heads.set(Math.round(r.left), Math.min(heads.get(Math.round(r.left)) ?? 1e9, r.top));
  root.setAttribute('data-columns', heads.size);
  root.setAttribute('data-uneven', Math.max(...heads.values()) - Math.min(...heads.values()));
});
"""


@pytest.mark.seconds
@needs_browser
def test_the_columns_of_the_contents_begin_at_one_height(tmp_path):
    sections = tuple(Section(f"Section {k}", (Paragraph("Text."),)) for k in range(7))
    seen = opened(render(Page("t", "v", sections=sections)), COLUMNS, tmp_path)
    assert int(seen["columns"]) > 1 and float(seen["uneven"]) < 0.5


PRINTED = """
addEventListener('load', () => {
  const root = document.documentElement;
  root.setAttribute('data-wide', Array.from(document.querySelectorAll('table'), t =>
    t.getBoundingClientRect().right > root.clientWidth + 0.5).filter(Boolean).length);
  root.setAttribute('data-tables', document.querySelectorAll('table').length);
});
"""


@pytest.mark.seconds
@needs_browser
def test_tables_fit_a_sheet_of_paper(tmp_path):
    """On paper nothing scrolls: a table of long texts and of many numbers is as wide as the sheet, at most."""
    texts = PageTable(("cannot be distinguished", "weight of the others", "parameters, each alone", "what separates"),
                      (("one-sided-filter / displacement-delay", "0.923", "time_constant 0.00085 s, damping 0.72; " * 2,
                        "the same record with both channels unfiltered, or both through the same filter"),), "", (1,))
    numbers = PageTable(("cause", "parameter", *(f"held-out gain {k}" for k in range(7))),
                        (("series-compliance", "compliance", *("1.439e-07 m/N",) * 2, *("75.7 %",) * 5),), "",
                        tuple(range(2, 9)))
    html = render(Page("t", "v", sections=(Section("Tables", (texts, numbers)),)))
    assert "@media print {" in html
    seen = opened(html.replace("@media print {", "@media all {"), PRINTED, tmp_path, width=718)
    assert (seen["tables"], seen["wide"]) == ("2", "0")


WIDTHS = """
addEventListener('load', () => {
  document.documentElement.setAttribute('data-widths', Array.from(document.images, i => i.clientWidth).join(' '));
});
"""


@pytest.mark.seconds
@needs_browser
def test_a_narrow_figure_is_whole_on_a_phone_and_a_wide_one_scrolls(tmp_path):
    """A figure of up to 7.5 inches fits the width of the screen; letters of a wider one would be too small to read."""
    drawings = [panels(1, 1, width=width)[0] for width in (7.4, 9.9)]
    items = tuple(PageFigure.of(d, f"Figure {k}.") for k, d in enumerate(drawings))
    seen = opened(render(Page("t", "v", sections=(Section("Figures", items),))), WIDTHS, tmp_path, width=500)
    narrow, wide = map(int, seen["widths"].split())
    assert 400 < narrow <= 500 < wide


# -- colours and units ------------------------------------------------------------------------------------------------
def _luminance(colour: np.ndarray) -> float:
    """Relative luminance of sRGB (WCAG 2.1)."""
    linear = np.where(colour <= 0.03928, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def _inverted(colour: np.ndarray) -> np.ndarray:
    """The style sheet's filter for a dark page, invert(0.905) hue-rotate(180deg) (CSS Filter Effects, 9.4 and 13.3)."""
    turn = np.array([[-0.574, 1.43, 0.144], [0.426, 0.43, 0.144], [0.426, 1.43, -0.856]])
    return np.clip(turn @ (0.905 - 0.81 * colour), 0.0, 1.0)


@pytest.mark.parametrize("count", [1, 2, 4, 8])
def test_curves_along_a_scale_are_seen_on_light_and_on_dark_pages(count):
    """A contrast of 3:1 with the page (WCAG 2.1, 1.4.11)."""
    def contrast(a: np.ndarray, b: np.ndarray) -> float:
        low, high = sorted((_luminance(a), _luminance(b)))
        return (high + 0.05) / (low + 0.05)

    white = np.ones(3)
    for colour in shades(count)[:, :3]:
        assert contrast(colour, white) > 2.99 and contrast(_inverted(colour), _inverted(white)) > 3


def test_numbers_of_a_logarithmic_axis_are_written_out():
    figure, axes = panels(1)
    ax = axes[0, 0]
    ax.set_yscale("log")
    ax.set_ylim(3.5, 12.0)
    plain_decades(ax.yaxis)
    figure.canvas.draw()
    texts = [t.get_text() for t in (*ax.get_yticklabels(), *ax.get_yticklabels(minor=True)) if t.get_text()]
    assert {"4", "6", "10"} <= set(texts) and not any("times" in t or "^" in t for t in texts)


def test_units_of_quotients_stand_on_figures_and_in_remarks():
    """A stage's knee moves by (m/s)/V; the gain from a pure number has the output's unit; a density has 1/(rad/s)."""
    stated = TanhStage(v0=0.1, slope=0.02).stated("m/s", "V")
    assert "(m/s)/V" in stated and "(V)" not in stated
    rng = np.random.default_rng(0)
    u = rng.standard_normal(400)
    data = lpv.Record({"u": u, "speed": np.convolve(u, [1.0, 0.5])[:400] + 0.1 * rng.standard_normal(400)},
                      sample_time=0.01, units={"u": "1", "speed": "rad/s"})
    found = lpv.identify([data], lpv.ARX(na=1, nb=1, nk=0, input="u", output="speed"))
    shown = comparisons(found.model, [data], "training")
    labels = [ax.get_ylabel() for item in frozen_figures(found.model, [], [np.zeros(0)], ["fixed"], 400)
              for ax in figure_of(item.drawing).axes]
    assert "magnitude [rad/s]" in labels and "response [rad/s]" in labels
    assert plot.residuals(shown)[0].get_ylabel() == "density [1/(rad/s)]"


@pytest.mark.seconds
def test_the_width_of_a_band_is_labelled_within_its_row():
    drawn = np.ones((20, 3, 1)) * np.linspace(0.95, 1.05, 20)[:, None, None]
    response = FrozenResponse("fixed", np.ones((3, 1), complex), drawn.astype(complex))
    lowest = plot.bode(np.array([0.1, 1.0, 4.0]), [response], ["u"], ["1"], "y")[2]
    lowest.figure.canvas.draw()
    label, frame = lowest.yaxis.label.get_window_extent(), lowest.get_window_extent()
    assert label.height < 1.1 * frame.height
    assert not any("times" in t.get_text() for t in lowest.get_yticklabels(minor=True))


def test_every_line_of_the_energy_figure_is_in_its_legend():
    structure = lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force",
                        basis=lpv.Polynomial("current", degree=1))
    margin = lpv.passivity_margin(lpv.identify([damper_record()], structure).model)
    ax = np.ravel(plot.passivity(margin))[-1]
    named = {text.get_text() for text in ax.get_legend().get_texts()}
    assert "limit of passivity" in named and len(named) == len(ax.lines)


# -- what the pages state ---------------------------------------------------------------------------------------------
def damper_record() -> lpv.Record:
    rng = np.random.default_rng(3)
    v = 0.1 * rng.standard_normal(600)
    current = np.repeat(rng.uniform(0, 2, 30), 20)
    force = (300 + 200 * current) * v + rng.standard_normal(600)
    return lpv.Record({"velocity": v, "current": current, "force": force}, sample_time=0.005,
                      units={"velocity": "m/s", "current": "A", "force": "N"})


def test_a_form_that_is_exact_has_no_gap_but_rounding():
    gap = Gap("augmented", True, True, (), (2.8e-31,), (0.1,), ("force",), ("current",), "exact, nothing is lost")
    table = forms_table([FormGap("augmented", 4, gap)])
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["ESR of the gap"] == "0" and row["fit [%]"] == "100"


def test_the_next_command_of_an_audit_names_the_channels_that_there_are():
    """A damper's by name; of other data in capitals, without a scheduling variable where there is none."""
    def command(record: lpv.Record) -> str:
        return inspection_page(audit([record]), [record]).steps[-1].command

    assert "--input velocity --output force --schedule current --hold-out" in command(damper_record())
    rng = np.random.default_rng(0)
    road = np.cumsum(rng.standard_normal(500)) * 1e-3
    car = lpv.Record({"actuator force": rng.standard_normal(500), "road": road, "sprung": 0.5 * road},
                     sample_time=0.002, units={"actuator force": "N", "road": "m", "sprung": "m"})
    assert "--input INPUT --output OUTPUT --hold-out" in command(car)


@pytest.mark.seconds
def test_the_numbers_below_a_histogram_do_not_overlap():
    """Small residuals have long numbers."""
    rng = np.random.default_rng(0)
    data = lpv.Record({"u": rng.standard_normal(900), "y": 3e-4 * rng.standard_normal(900)}, sample_time=0.01,
                      units={"u": "N", "y": "m"})
    found = lpv.identify([data], lpv.ARX(na=1, nb=1, nk=0, input="u", output="y"))
    ax = plot.residuals(comparisons(found.model, [data], "training"), inputs=("u",))[0]
    ax.figure.canvas.draw()
    low, high = ax.get_xlim()
    boxes = [t.get_window_extent() for t in ax.get_xticklabels() if low <= t.get_position()[0] <= high]
    assert len(boxes) >= 3 and all(a.x1 < b.x0 for a, b in pairwise(boxes))


def test_a_file_that_shares_its_name_is_called_by_its_path_in_commands():
    sources = (Source("far/a/model.json", "0" * 12), Source("far/b/model.json", "1" * 12),
               Source("far/run.csv", "2" * 12))
    step = NextStep("Go.", "lpvid validate a/model.json run.csv OUT/x.json elsewhere/model.json")
    html = render(Page("t", "v", steps=(step,), origin=Origin("lpvid compare", None, sources, (), "res")))
    assert "far/a/model.json" in render(Page("t", "v", steps=(NextStep("Go.", "lpvid stability model.json"),),
                                             origin=Origin("lpvid validate", None, sources, (), "res")))
    words = html.replace("</span> <span>", " ")
    assert "lpvid validate far/a/model.json far/run.csv res/x.json elsewhere/model.json" in words


def test_the_files_of_arguments_stand_before_those_of_options(tmp_path):
    """Whatever the order on the command line: a bare name in a next step is that of the model that was judged."""
    def judge(beside: Annotated[list[str] | None, typer.Option("--beside")] = None,
              data: Annotated[list[str], typer.Argument()] = [],  # noqa: B006
              model: Annotated[str, typer.Argument()] = "") -> None: ...

    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "model.json").write_text("{}")
    given = {"beside": [str(tmp_path / "b" / "model.json")], "model": str(tmp_path / "a" / "model.json"), "data": []}
    assert [p.parent.name for p in Invocation("lpvid judge", judge, given).files()] == ["a", "b"]
