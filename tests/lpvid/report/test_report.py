"""Reports: self-contained, escaped, and opened in a real browser."""

from __future__ import annotations

import dataclasses
import pickle
import re
from urllib.parse import unquote

import numpy as np
import pytest
from helpers.browser import BROWSER, opened

import lpvid as lpv
from lpvid import plot
from lpvid.analysis.bands import frequency_response
from lpvid.analysis.frozen_responses import step_response
from lpvid.auditing import audit
from lpvid.caveat import Caveat
from lpvid.plot.responses import FrozenResponse
from lpvid.plot.style import figure_of, thinned
from lpvid.report import Notes, Page, PageFigure, PageTable, Paragraph, Section, number, render
from lpvid.report.bands import response_section, sureness
from lpvid.report.figures import comparisons
from lpvid.report.forms import form_gaps
from lpvid.report.identification import identification_page
from lpvid.report.inspection import inspection_page
from lpvid.report.responses import scheduling_places
from lpvid.report.stability import stability_page, study_stability
from lpvid.report.validation import validation_page
from lpvid.validation import ResidualTest

RATE = 200.0


def record(seed: int = 0, n: int = 1200, name: str = "run") -> lpv.Record:
    """A damper-like system of first order, with displacement and velocity that belong together."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    lines = 2 * np.pi * np.array([0.7, 1.9, 3.3, 7.1])
    phase, size = rng.uniform(0, 6, 4), np.array([0.02, 0.01, 0.005, 0.002])
    x = (size * np.sin(np.outer(t, lines) + phase)).sum(axis=1)
    v = (size * lines * np.cos(np.outer(t, lines) + phase)).sum(axis=1)
    p = np.repeat(rng.uniform(0, 2, n // 20 + 1), 20)[:n]
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = (0.5 + 0.1 * p[k]) * y[k - 1] + (200 + 150 * p[k]) * v[k]
    y += 0.02 * y.std() * rng.standard_normal(n)
    return lpv.Record({"displacement": x, "velocity": v, "current": p, "force": y}, sample_time=1 / RATE,
                      units={"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}, name=name)


@pytest.fixture(scope="module")
def found() -> lpv.Identification:
    structure = lpv.ARX(na=1, nb=1, nk=0, basis=lpv.Polynomial("current", degree=1))
    return lpv.identify([record(1)], structure, held_out=[record(2, name="other")])


@pytest.fixture(scope="module")
def pages(found) -> dict[str, Page]:
    data = [record(1), record(2, name="other")]
    shown = comparisons(found.model, [record(2, name="other")], "held-out")
    return {"inspect": inspection_page(audit(data), data),
            "identify": identification_page(found, shown, form_gaps(found.model, [record(1)]), audit(data),
                                            (*response_section(found, shown), *sureness(found, shown))),
            "validate": validation_page(found.held_out, found.model, shown, "model.json"),
            "stability": stability_page(study_stability(found.model), "model.json")}


@pytest.fixture(scope="module")
def rendered(pages) -> dict[str, str]:
    """The pages as HTML: their drawings cost more than all that is looked for in them."""
    return {name: render(page) for name, page in pages.items()}


COMMANDS = ("inspect", "identify", "validate", "stability")


# -- the page ---------------------------------------------------------------------------------------------------------
def outside_references(html: str) -> list[str]:
    """Addresses that a browser would fetch: anything in src, href, url() or @import that is not data."""
    addresses = re.findall(r"""(?:src|href|srcset|action|data)\s*=\s*["']([^"']*)["']|url\(([^)]*)\)|@import\s+(\S+)""",
                           html)
    listed = [a or b or c for a, b, c in addresses]
    return [a for a in listed if not a.strip("'\" ").startswith(("data:", "#"))]


@pytest.mark.parametrize("command", COMMANDS)
def test_self_contained(rendered, command):
    html = rendered[command]
    assert outside_references(html) == []
    assert "<link" not in html and not re.search(r"<script[^>]*src", html)
    drawings = re.findall(r'src="data:image/svg\+xml;charset=utf-8,([^"]+)"', html)
    assert len(drawings) == html.count("<img ")
    for data in drawings:
        inside = unquote(data)
        assert inside.startswith("<?xml") and inside.endswith("</svg>")
        assert outside_references(inside.replace("xlink:href", "href")) == []
    assert html.count("<img ") + html.count('<figure class="traces"') >= 1 and 'alt=""' not in html
    assert len(html.encode("utf-8")) <= 1_500_000


def test_the_search_for_references_finds_them():
    assert outside_references('<img src="http://a/b.png"><link href="c.css"> url(d.woff)') == [
        "http://a/b.png", "c.css", "d.woff"]


def test_text_is_escaped():
    page = Page("<b>&", "a < b", sections=(Section("s", (Paragraph("<script>x</script>"), Notes(("<i>",)),
                                                        PageTable(("<c>",), (("<d>",),)))),))
    html = render(page)
    assert "<script>" not in html and "&lt;script&gt;" in html and "&lt;d&gt;" in html


@pytest.mark.seconds
def test_same_page_same_bytes(pages):
    again = stability_page(study_stability(lpv.LPVTransferFunction.siso(
        [[-0.5, 0.1]], [[1.0, 0.0]], lpv.Polynomial("p", degree=1), 0.1)), "m")
    twice = stability_page(study_stability(lpv.LPVTransferFunction.siso(
        [[-0.5, 0.1]], [[1.0, 0.0]], lpv.Polynomial("p", degree=1), 0.1)), "m")
    assert render(again) == render(twice)


def test_verdict_comes_first_and_numbers_agree(pages, rendered, found):
    html = rendered["identify"]
    esr = found.held_out.overall.free_run.esr
    assert html.index('class="verdict') < html.index("<h2>")
    assert f"ESR {esr:.4g}" in pages["identify"].verdict and "held-out" in pages["identify"].verdict
    for heading in ("Figures", "Measured and simulated", "What is left in the residuals", "Frozen poles",
                    "State-space forms", "Parameters", "Audit of the data"):
        assert f"<h2>{heading}</h2>" in html
    for name, value in zip(found.parameter_names, found.parameters, strict=True):
        assert f"<td>{name}</td><td class=\"n\">{number(value, 6)}</td>" in html


def test_stability_page_warns_in_words(rendered):
    html = rendered["stability"]
    assert "does not cover a moving scheduling variable" in html and "Critical values" in html


@pytest.mark.seconds
def test_unstable_page_is_marked():
    model = lpv.LPVTransferFunction.siso([[-0.5, 0.8]], [[1.0, 0.0]], lpv.Polynomial("p", degree=1), 0.1)
    study = study_stability(model)
    page = stability_page(study, "m")
    assert page.mark == "bad" and page.verdict.startswith("NOT stable") and not study.certified
    assert "inside the range" in render(page)


@pytest.mark.seconds
def test_diverging_run_is_reported_not_drawn_away():
    model = lpv.LPVTransferFunction.siso([[-1.5]], [[1.0]], lpv.Polynomial(), 1 / RATE, inputs="velocity",
                                         outputs="force")
    data = [record(3)]
    checked = lpv.validate(model, data)
    page = validation_page(checked, model, comparisons(model, data, "held-out"), "m")
    assert "diverges" in page.verdict and page.mark == "bad"
    assert "diverged at" in render(page)


@pytest.mark.parametrize("value, text", [(0.0, "0"), (-1.5, "-1.5"), (None, "–"), (float("inf"), "–"),
                                         (1e-12, "1e-12"), (123456.0, "1.235e+05")])
def test_numbers(value, text):
    assert number(value) == text


# -- how sure ------------------------------------------------------------------------------------------------------
def test_bands_at_three_values_that_occur(found):
    shown = comparisons(found.model, [record(2, name="other")], "held-out")
    section = sureness(found, shown)[0]
    assert [item.kind for item in section.items] == ["paragraph", "figure"]
    values, words_ = scheduling_places(found.model.box, shown)
    occurring = np.sort(record(2)["current"])
    for value, share, text in zip(values, (0.05, 0.5, 0.95), words_, strict=True):
        assert value[0] in occurring and value[0] == pytest.approx(np.quantile(occurring, share), abs=0.05)
        assert text.startswith("current = ") and text.endswith(" A")


def test_the_bode_plot_follows_the_estimate():
    """A band that blows up does not squeeze the curves; magnitude and phase are those of y = b u/(1 − 0.5 z⁻¹)."""
    model = lpv.LPVTransferFunction.siso([[-0.5]], [[2.0]], lpv.Polynomial(), 0.1)
    hertz = np.array([0.1, 1.0, 4.0])
    response = frequency_response(model, [], hertz)[:, 0]
    drawn = np.stack([response * 1e-9, response, response * 1e9 * np.exp(0.2j)])
    size, phase, width = plot.bode(hertz, [FrozenResponse("fixed", response, drawn)], ["u"], ["1"], "y")
    expected = 2 / (1 - 0.5 * np.exp(-2j * np.pi * hertz * 0.1))
    assert size.lines[0].get_ydata() == pytest.approx(np.abs(expected), rel=1e-12)
    assert phase.lines[0].get_ydata() == pytest.approx(np.degrees(np.unwrap(np.angle(expected))), rel=1e-12)
    assert size.get_ylim() == pytest.approx((np.abs(expected).min() / 3, np.abs(expected).max() * 3))
    assert width.lines[0].get_ydata() == pytest.approx(50 * (1 + 0.95 * (1e9 - 1)), rel=1e-6)  # quantiles of 3 draws


def test_step_responses_are_those_of_a_simulation(found):
    """The frozen step response is the free run along a record whose scheduling stands still; MIMO by its own states."""
    held, n = 1.3, 60
    step = lpv.Record({"velocity": np.r_[np.zeros(5), np.ones(n)], "current": np.full(n + 5, held),
                       "force": np.zeros(n + 5)}, sample_time=1 / RATE,
                      units={"velocity": "m/s", "current": "A", "force": "N"})
    run = lpv.simulate(found.model, step).output[5:, 0]
    assert step_response(found.model, [held], n)[:, 0, 0] == pytest.approx(run, rel=1e-9)
    space = lpv.realize(found.model, "augmented").model
    assert step_response(space, [held], n)[:, 0, 0] == pytest.approx(run, rel=1e-8)
    rng = np.random.default_rng(0)
    a, b = 0.2 * rng.standard_normal((2, 2, 2, 1)), rng.standard_normal((3, 2, 2, 1))
    both = lpv.LPVTransferFunction(a=a, b=b, basis=lpv.Polynomial(), sample_time=0.1,
                                   inputs=(lpv.Signal("u1"), lpv.Signal("u2")),
                                   outputs=(lpv.Signal("y1"), lpv.Signal("y2")))
    last = step_response(both, [], 400)[-1]
    gain = np.linalg.solve(np.eye(2) + a[..., 0].sum(axis=0), b[..., 0].sum(axis=0))
    assert last == pytest.approx(gain, rel=1e-6)


def test_no_bands_without_a_covariance(found):
    shown = comparisons(found.model, [record(2)], "held-out")
    assert sureness(found.replace(covariance=np.zeros_like(found.covariance)), shown) == ()
    assert sureness(found, []) == ()


def test_an_estimate_too_uncertain_for_a_band_says_so(found):
    shown = comparisons(found.model, [record(2)], "held-out")
    spread = np.zeros_like(found.covariance)
    spread[0, 0] = 1e8  # of a1: nearly every draw is far outside the unit circle
    section = sureness(found.replace(covariance=spread), shown)[0]
    last = section.items[-1]
    assert isinstance(last, Paragraph) and "diverges" in last.text


@pytest.mark.thinned(3)
@pytest.mark.parametrize("kind, notes, words_", [
    ("least squares, white equation error", (), "assume white errors, and are too small"),
    ("least squares, white equation error", ("the residual is correlated: standard errors in sandwich form",),
     "of sandwich form"),
    ("sandwich, coloured output error", (), "of sandwich form")])
def test_standard_errors_are_said_to_be_what_they_are(found, kind, notes, words_):
    failed = ResidualTest("whiteness", 99.0, 1e-9, False, "not white")
    judged = dataclasses.replace(found.held_out, residual_tests=(failed,))
    page = identification_page(found.replace(held_out=judged, notes=notes, covariance_kind=kind), [], [],
                               audit([record(1)]))
    assert any(words_ in line for line in page.caveats)


# -- figures ----------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_axes_carry_names_and_units(found):
    c = comparisons(found.model, [record(2)], "held-out")
    figures = [plot.free_run(c[0], ("current",)), plot.loops(c, ("velocity", "displacement")), plot.residuals(c),
               plot.channel_traces(record()), plot.spectra([record(), record(5)], ["force", "velocity"]),
               plot.locus(lpv.pole_locus(found.model)), plot.poles(np.array([0.5, -0.2]))]
    for figure in map(figure_of, figures):
        for ax in figure.axes:
            if ax.get_visible():
                assert re.search(r"\[.+\]", ax.get_ylabel()) or (ax is not figure.axes[0] and not ax.get_ylabel())
        lowest = [ax.get_xlabel() for ax in figure.axes if ax.get_xlabel()]
        assert lowest and all(re.search(r"\[.+\]", label) for label in lowest)


def test_curves_are_those_of_the_simulation(found):
    c = comparisons(found.model, [record(2)], "held-out")[0]
    run = lpv.simulate(found.model, record(2)).output[:, 0]
    close_up = {line.get_label(): line for line in plot.free_run(c)[1].lines}
    times = close_up["free run"].get_xdata()
    at = np.round(np.asarray(times) * RATE).astype(int)
    assert np.array_equal(close_up["free run"].get_ydata(), run[at])
    assert np.array_equal(close_up["measured"].get_ydata(), record(2)["force"][at])
    error = (record(2)["force"] - run)[c.free_run.start:]
    best = max(float(np.sum(error[k:k + at.size] ** 2)) for k in range(error.size - at.size + 1))
    assert float(np.sum((record(2)["force"] - run)[at] ** 2)) == pytest.approx(best, rel=1e-9)


def test_loops_need_their_channels(found):
    bare = lpv.Record({k: record(2).channels[k] for k in ("velocity", "current", "force")}, sample_time=1 / RATE)
    assert plot.loops(comparisons(found.model, [bare], "held-out"), ("temperature",)) is None


@pytest.mark.parametrize("n", [10, 999, 1000, 1001, 12345])
def test_thinning_keeps_both_ends_and_extremes(n):
    y = np.cumsum(np.random.default_rng(n).standard_normal(n))
    y[n // 3] = np.nan
    x, kept = thinned(np.arange(float(n)), y, most=1000)
    assert kept.size <= 1002 and np.nanmax(kept) == np.nanmax(y) and np.nanmin(kept) == np.nanmin(y)
    assert np.all(np.diff(x) >= 0) and x[-1] >= n - 1 - 2 * n / 1000 and x[0] <= 2 * n / 1000


@pytest.mark.seconds
def test_figures_are_drawn_on_the_callers_axes(found):
    """What a function draws on new axes it draws on the caller's, and returns them; a wrong number is refused."""
    from matplotlib.figure import Figure as Canvas

    c = comparisons(found.model, [record(2)], "held-out")
    hertz = np.array([0.1, 1.0])
    response = FrozenResponse("fixed", np.array([[1.0 + 0j], [0.5 - 0.5j]]))
    margin = lpv.passivity_margin(found.model)
    drawings = {
        "free_run": lambda ax: plot.free_run(c[0], ("current",), ax=ax),
        "overlay": lambda ax: plot.overlay([("a", c[0])], ax=ax),
        "loops": lambda ax: plot.loops(c, ("velocity", "displacement"), ax=ax),
        "residuals": lambda ax: plot.residuals(c, inputs=("velocity",), ax=ax),
        "channel_traces": lambda ax: plot.channel_traces(record(), ax=ax),
        "spectra": lambda ax: plot.spectra([record(), record(5)], ["force", "velocity", "current"], ax=ax),
        "strokes": lambda ax: plot.strokes(
            [("a", *(record()[n] for n in ("displacement", "velocity", "force")))], ax=ax
        ),
        "locus": lambda ax: plot.locus(lpv.pole_locus(found.model), ax=ax),
        "poles": lambda ax: plot.poles(np.array([0.5, -0.2]), ax=ax),
        "bode": lambda ax: plot.bode(hertz, [response], ["u"], ["1"], "y", ax=ax),
        "steps": lambda ax: plot.steps(
            hertz, [FrozenResponse("fixed", response.values.real)], ["u"], ["1"], "y", ax=ax
        ),
        "passivity": lambda ax: plot.passivity(margin, ax=ax),
        "free_run_band": lambda ax: plot.free_run_band(
            c[0], lpv.free_run_band(found.draw(np.random.default_rng(0), 20), record(2)), ax=ax
        ),
    }
    assert {*drawings, "Comparison", "compare", "png", "svg", "show"} == set(plot.__all__)
    for name, draw in drawings.items():
        made = np.atleast_1d(np.asarray(draw(None), dtype=object)).ravel()
        given = Canvas().subplots(1, made.size, squeeze=False)
        back = np.atleast_1d(np.asarray(draw(given), dtype=object)).ravel()
        assert list(back) == list(given.ravel()), name
        for new, old in zip(back, made, strict=True):
            assert new.get_xlabel() == old.get_xlabel() or not old.get_xlabel(), name
            assert len(new.lines) == len(old.lines) and len(new.collections) == len(old.collections), name
            for a, b in zip(new.lines, old.lines, strict=True):
                np.testing.assert_array_equal(np.asarray(a.get_ydata()), np.asarray(b.get_ydata()))
        with pytest.raises(lpv.InputError, match="is drawn on"):
            draw(Canvas().subplots(1, made.size + 1, squeeze=False))


@pytest.mark.seconds
def test_figures_leave_no_global_state(found):
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    plot.png(plot.locus(lpv.pole_locus(found.model)))
    assert dict(mpl.rcParams) == before


@pytest.mark.seconds
def test_figures_are_embedded_as_svg_in_their_order():
    """Whatever process drew them: each is byte for byte what `plot.svg` gives for its drawing."""
    drawings = [plot.poles(np.array([k / 4])).figure for k in range(4)]
    page = Page("Poles", "Four poles.", sections=tuple(
        Section(f"section {k}", (PageFigure.of(d, f"pole {k}"),)) for k, d in enumerate(drawings)))
    found = re.findall(r'src="data:image/svg\+xml;charset=utf-8,([^"]+)"', render(page))
    assert [unquote(text).encode() for text in found] == [plot.svg(d) for d in drawings]


# -- a real browser ---------------------------------------------------------------------------------------------------
PROBE = """
window.onerror = (message) => { document.documentElement.setAttribute('data-error', message); };
window.addEventListener('load', () => {
  const images = Array.from(document.images), root = document.documentElement;
  root.setAttribute('data-images', images.length);
  root.setAttribute('data-loaded', images.filter(i => i.complete && i.naturalWidth > 0).length);
  root.setAttribute('data-headings', document.querySelectorAll('h1, h2').length);
  root.setAttribute('data-fetched', performance.getEntriesByType('resource').filter(
    e => !e.name.startsWith('data:')).length);
  root.setAttribute('data-overflow', document.documentElement.scrollWidth > window.innerWidth + 1);
});
"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
@pytest.mark.slow
def test_a_browser_shows_them(rendered, tmp_path):
    """Four reports in one browser run each: figures loaded, headings there, nothing fetched, no script error."""
    for command in COMMANDS:
        html = rendered[command]
        seen = opened(html, PROBE, tmp_path / command)
        assert "error" not in seen
        assert int(seen["images"]) == html.count("<img ") >= 1
        assert seen["loaded"] == seen["images"]
        assert int(seen["headings"]) == 1 + html.count("<h2>")
        assert seen["fetched"] == "0" and seen["overflow"] == "false"


def test_a_form_is_printed_with_the_errors_that_its_verdict_rests_on():
    """Without a constant order-two model the controllable form is neither exact nor free."""
    from dataclasses import replace

    structure = lpv.ARX(na=2, nb=2, nk=0, basis=lpv.Polynomial("current", degree=1))
    model = lpv.identify([record(1)], structure).model
    gaps = {g.form: g for g in form_gaps(model, [record(1)], "training")}
    assert "exact" in str(gaps["augmented"])
    one = gaps["controllable"]
    assert one.gap is not None and one.gap.judgement is not None and not one.gap.exact
    judged = one.gap.judgement
    assert str(one) == (f"controllable ({one.order} states): {judged.verdict}, free-run ESR from {judged.own[0]:.3g} "
                        f"to {judged.form[0]:.3g}")
    lost = replace(judged, form=(float("inf"),))
    assert str(replace(one, gap=replace(one.gap, judgement=lost))).endswith("not safe, free-run ESR diverges")


def test_a_share_that_is_nearly_whole_is_not_rounded_to_all():
    from lpvid.report.validation import _share

    assert [_share(e) for e in (2.87e-4, 0.004, 0.16, 0.99, 0.0, 1e-6)] == ["99.97", "99.6", "84.0", "1.0", "100.0",
                                                                          "99.9999"]


@pytest.mark.seconds
def test_bands_of_drawn_models_that_are_unstable_leave_the_panel_without_a_warning():
    """Draws that grow beyond all numbers, and then have none: a band of finite ends inside the axes."""
    time = np.linspace(0.0, 1.0, 40)
    draws = np.ones((50, 40, 1)) * np.linspace(0.9, 1.1, 50)[:, None, None]
    with np.errstate(over="ignore"):
        draws[:20] *= np.geomspace(1.0, 1e308, 40)[:, None] * 1e9
    draws[20:25, 10:] = np.nan
    ax = np.ravel(plot.steps(time, [FrozenResponse("model", np.ones((40, 1)), draws)], ["u"], ["N"], "y"))[0]
    assert plot.png(figure_of(ax)) and np.all(np.isfinite(ax.get_ylim()))
    values = np.ones((40, 1), dtype=complex)
    values[3] = 0.0
    axes = plot.bode(time + 0.1, [FrozenResponse("model", values, draws.astype(complex))], ["u"], ["N"], "y")
    assert plot.png(figure_of(np.ravel(axes)[0]))


def test_a_caveat_stands_in_the_summary_whatever_its_words(found):
    """By its type: a remark of any words goes up, the same words without the type stay among the remarks."""
    judged = dataclasses.replace(found.held_out, notes=(Caveat("zwei von drei"), "lies outside the training range"))
    page = identification_page(found.replace(held_out=judged, notes=(Caveat("eins"), "with --flip force")), [], [],
                               audit([record(1)]))
    assert {"Eins.", "Zwei von drei."} <= set(page.caveats)
    assert not any("--flip" in line or "training range" in line for line in page.caveats)
    page = validation_page(judged, found.model, [], "m")
    assert "zwei von drei" in page.caveats and "lies outside the training range" not in page.caveats
    assert pickle.loads(pickle.dumps(judged.notes))[0].__class__ is Caveat


def test_what_qualifies_held_out_figures_is_a_caveat(found):
    """A range beyond that of training and a turned sign."""
    other = record(7)
    wide = other.with_channel("velocity", 50 * other["velocity"])
    beyond, turned = lpv.validate(found.model, wide).notes, lpv.validate(found.model, other.flip("force")).notes
    assert any(isinstance(n, Caveat) and "outside the range of the training data" in n for n in beyond)
    assert any(isinstance(n, Caveat) and "--flip force" in n for n in turned)
