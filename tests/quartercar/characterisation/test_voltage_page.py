"""A page of records whose voltage stands for the current, and what every page lists as missing."""

from __future__ import annotations

import re

import numpy as np
import pytest

import lpvid as lpv
import quartercar as qc
from quartercar.characterisation import CharacteriseSettings
from quartercar.characterisation.figures import figures_of
from quartercar.characterisation.page import characterisation_page


def driven(level: float, unit: str, frequency: float = 1.6) -> lpv.Record:
    """A sine of 20 mm at a constant voltage or current."""
    t = np.arange(1600) / 400.0
    x, v = 0.02 * np.sin(2 * np.pi * frequency * t), 0.04 * np.pi * frequency * np.cos(2 * np.pi * frequency * t)
    force = (1500.0 + 600.0 * level) * v + (100 + 50.0 * level) * np.tanh(v / 0.01)
    return lpv.Record({"displacement": x, "force": force, "current": np.full(t.size, level)}, sample_time=1 / 400,
                      units={"displacement": "m", "force": "N", "current": unit}, name=f"level {level:g}")


@pytest.fixture(scope="module", params=["A", "V"])
def driven_at(request) -> tuple[str, qc.characterisation.Characterisation]:
    """Levels that come out of order, as files do."""
    records = [driven(level, request.param) for level in (2.0, 0.0, 1.0)]
    return request.param, qc.characterise(records, CharacteriseSettings(speeds=(0.1, 0.13, 0.6)))


def texts_of(page, figures) -> str:
    """Every word of a page and of its figures."""
    parts = [page.verdict, *page.caveats, *(name for name, _ in page.facts)]
    for section in page.sections:
        parts.append(section.title)
        for item in section.items:
            parts += [str(getattr(item, name)) for name in ("text", "lines", "columns", "rows", "caption", "folded")
                      if hasattr(item, name)]
    for ax in (ax for shown in figures for ax in shown.figure.axes):
        legend = ax.get_legend()
        parts += [ax.get_xlabel(), ax.get_ylabel(), ax.get_title(),
                  *([] if legend is None else [text.get_text() for text in legend.get_texts()])]
    return "\n".join(parts)


@pytest.mark.thinned(2, "seconds")
def test_a_voltage_is_called_a_voltage(driven_at):
    unit, found = driven_at
    figures = figures_of(found)
    text = texts_of(characterisation_page(found, figures), figures)
    word, other = ("current", "voltage") if unit == "A" else ("voltage", "current")
    assert f"3 {word}s, 0 {unit} to 2 {unit}" in text and f"{word} [{unit}]" in text and f"Over the {word}" in text
    assert not re.search(rf"\b{other}", text.replace("the yield force", ""))


@pytest.mark.thinned(2, "seconds")
def test_the_legend_of_the_loops_runs_from_soft_to_hard(driven_at):
    unit, found = driven_at
    (loops,) = (shown for shown in figures_of(found) if shown.name == "force_displacement")
    names = [text.get_text() for text in loops.figure.axes[0].get_legend().get_texts()]
    assert [name.split(",")[0] for name in names] == [f"0 {unit}", f"1 {unit}", f"2 {unit}"]


def test_all_axes_of_the_page_have_a_unit(driven_at):
    for shown in figures_of(driven_at[1]):
        for ax in shown.figure.axes:
            for label in (ax.get_xlabel(), ax.get_ylabel()):
                assert not label or re.search(r"\[.+\]$", label), (shown.name, label)


def test_every_quantity_is_on_the_page_or_listed_with_the_test_that_gives_it(driven_at):
    """The quantities of a dynamometer's page: a section with content, or an entry under 'Not in these records'."""
    unit, found = driven_at
    page = characterisation_page(found)
    titles = [section.title for section in page.sections]
    missing = {m.what: m for m in found.missing}
    word = "current" if unit == "A" else "voltage"
    for title in ("Forces at standard speeds", "Peak velocity", "Continuous velocity and loops",
                  "Gas force, spring rate, friction", "Hysteresis and energy", f"Over the {word}"):
        assert title in titles, title
    for what in ("forces at 0.6 m/s", "gas force, spring rate and friction at creep", "hysteresis over frequency",
                 "switching time", "drift over the cycles", "velocity histogram", "temperature coefficient",
                 "spread between specimens"):
        assert missing[what].why and missing[what].run, what
    assert "--specimen" in missing["spread between specimens"].run
