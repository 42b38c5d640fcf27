"""Cheap checks of the documentation's sources, without Sphinx: navigation, links, options, lists and code blocks."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from helpers.docs_pages import DOCS, GENERATED, PAGES, ROOT, blocks, name, prose, toctree

MOST_WORDS = 60
"""In a list item: the rule of issue 30, so that lists stay lists."""


def test_every_page_is_reached_from_the_index() -> None:
    reached, waiting = set(), ["index"]
    while waiting:
        page = waiting.pop()
        if page in reached or page.startswith(GENERATED):
            continue
        assert (DOCS / f"{page}.md").exists(), f"a toctree lists {page}, which is not there"
        reached.add(page)
        waiting += toctree(DOCS / f"{page}.md")
    missing = {name(p).removesuffix(".md") for p in PAGES} - reached
    assert not missing, f"in no toctree: {sorted(missing)}"


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_internal_links_resolve(page: Path) -> None:
    text = page.read_text(encoding="utf8")
    anchors = {
        re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    }
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(text)):
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        if not path:
            assert anchor in anchors, f"no heading for #{anchor}"
            continue
        inside = (page.parent / path).resolve()
        if inside.is_relative_to(DOCS) and inside.relative_to(DOCS).as_posix().startswith(GENERATED):
            continue  # made by the build, which checks them itself
        assert inside.exists(), f"{target} leads nowhere"


def items(text: str) -> Iterator[str]:
    """Whole list items, with their continued lines."""
    item: list[str] = []
    for line in [*prose(text).splitlines(), ""]:
        begins = re.match(r"\s*(?:[-*+]|\d+\.)\s+(.*)", line)
        continued = bool(item) and line.startswith(" ") and line.strip()
        if not continued and item:
            yield " ".join(item)
            item = []
        if begins:
            if item:
                yield " ".join(item)
            item = [begins.group(1)]
        elif continued:
            item.append(line.strip())


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_list_items_are_short(page: Path) -> None:
    for item in items(page.read_text(encoding="utf8")):
        count = len(item.split())
        assert count <= MOST_WORDS, f"{count} words in one list item: {item[:70]}… (make it paragraphs)"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_doctests_are_fenced(page: Path) -> None:
    """Unfenced they render as nested quotes; unfenced code is not code."""
    text = page.read_text(encoding="utf8")
    assert ">>>" not in prose(text), "a doctest outside a ```pycon block"
    for info, content in blocks(text):
        if ">>>" in content and not info.startswith("{"):
            assert info == "pycon", f"a doctest in a block of {info or 'nothing'}"
            assert content.endswith("\n\n"), "an empty line before the closing fence ends the expected output"


@functools.cache
def commands() -> dict[str, set[str]]:
    """Every command with its options."""
    from lpvid.cli.app import app as lpvid_app
    from quartercar.cli.app import app as quartercar_app

    found = {}
    for program, app in (("lpvid", lpvid_app), ("quartercar", quartercar_app)):
        for command, made in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
            params = [p for p in made.params if not getattr(p, "hidden", False)]
            found[f"{program} {command}"] = {
                o for p in params for o in (*p.opts, *p.secondary_opts) if o.startswith("--")} | {"--help"}
    return found


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_commands_and_options_exist(page: Path) -> None:
    known = commands()
    for info, content in blocks(page.read_text(encoding="utf8")):
        if info != "sh":
            continue
        for line in re.sub(r"\\\n\s*", " ", content).splitlines():
            for part in re.split(r"&&|;|\|", line.split(" #")[0]):
                words = part.split()
                while words and not words[0].endswith(("lpvid", "quartercar")):
                    words = words[1:]
                if len(words) < 2 or words[1].startswith("-"):
                    continue
                command = f"{Path(words[0]).name} {words[1]}"
                assert command in known, f"no command {command}"
                unknown = [w for w in words[2:] if w.startswith("--") and w.split("=")[0] not in known[command]]
                assert not unknown, f"{command} has no option {unknown[0]}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pictures_are_there(page: Path) -> None:
    for info, content in blocks(page.read_text(encoding="utf8")):
        if not info.startswith("{figure}"):
            continue
        inside = (page.parent / info.removeprefix("{figure}").strip()).resolve()
        assert ":alt:" in content, f"{inside.name} has no description for those who cannot see it"
        if inside.is_relative_to(DOCS / "generated" / "pictures"):
            makers = (DOCS / "pictures.py").read_text(encoding="utf8")
            assert f"def {inside.stem}(" in makers, f"nothing makes {inside.name}"
        else:
            assert inside.exists(), f"{inside.name} is not there"


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> None:
    """The site's own scripts are importable, as Sphinx has them."""
    for folder in (DOCS, DOCS / "sources"):
        monkeypatch.syspath_prepend(str(folder))


@pytest.mark.usefixtures("site")
def test_the_api_reference_has_every_public_name() -> None:
    from building.api import lpvid_lists, module_lists

    import lpvid
    import quartercar

    listed = [n.removeprefix("lpvid.") for names in lpvid_lists().values() for n in names]
    assert sorted(listed) == sorted(n for n in lpvid.__all__ if not inspect.ismodule(getattr(lpvid, n)))
    found = module_lists()
    assert {f"quartercar.{n}" for n in quartercar.__all__} == {*found["quartercar"], *found} & {
        f"quartercar.{n}" for n in quartercar.__all__}
    dampers = {n.rpartition(".")[2] for n in found["quartercar.dampers"]}
    assert set(quartercar.dampers.__all__) - dampers == {"ExtrapolationWarning"}  # stands on a page of lpvid


@pytest.mark.usefixtures("site")
@pytest.mark.parametrize("text, escaped", [
    ("|Δp| <= rate·Ts, `a*b`, x_ is", r"\|Δp\| <= rate·Ts, `a*b`, x\_ is"),
    ("F = c*v with ``**settings``", r"F = c\*v with ``**settings``"),
    ("a_1 stays", "a_1 stays"),
])
def test_formulas_in_docstrings_are_no_marks(text: str, escaped: str) -> None:
    from building.docstrings import escape_line

    assert escape_line(text) == escaped


@pytest.mark.usefixtures("site")
def test_command_pages_have_every_option(tmp_path: Path) -> None:
    from building.commands import write_commands

    write_commands(tmp_path)
    for command, options in commands().items():
        text = (tmp_path / f"{command.replace(' ', '-')}.md").read_text(encoding="utf8")
        assert all(option in text for option in options - {"--help"}), command


@pytest.mark.usefixtures("site")
@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.stem)
def test_an_example_has_a_title_for_the_gallery(path: Path) -> None:
    from building.gallery import with_title

    made = with_title(path.read_text(encoding="utf8"), "")
    title, underline = made.splitlines()[1:3]
    assert title.endswith("?") and underline == "=" * len(title)
    compile(made, path.name, "exec")


def test_every_example_shows_its_figure() -> None:
    for path in (ROOT / "examples").glob("*.py"):
        assert re.search(r"\bshow\(", path.read_text(encoding="utf8")), f"{path.name} leaves no figure"


@pytest.mark.usefixtures("site")
def test_the_device_of_source_001_obeys_its_equations() -> None:
    """The pressure splits behind the valve; the settled force of a slow motion inverts the flow."""
    import numpy as np
    from study_001 import UNIT_1, convexity

    pressure = np.array([1e5, 4e6, 6e6, 2e7])
    flow = UNIT_1.valve_flow(pressure)
    ring = (flow / UNIT_1.ring) ** UNIT_1.ring_power
    poppet = pressure - ring
    lift = UNIT_1.seat_area * np.maximum(poppet - UNIT_1.relief_pressure, 0) / UNIT_1.spring_rate
    assert np.allclose(UNIT_1.valve * lift * np.sqrt(poppet), flow, rtol=1e-9, atol=1e-18)
    assert flow[0] == flow[1] == 0.0 < flow[2] < flow[3]
    record = UNIT_1.run(1e-3, np.random.default_rng(0))
    fast = int(np.argmax(record["velocity"]))
    net = (record["force"][fast] - UNIT_1.friction) / UNIT_1.piston_area
    assert UNIT_1.flow(np.array([net]))[0] == pytest.approx(UNIT_1.piston_area * record["velocity"][fast], rel=0.05)
    v = np.array([1.0, 2.0, 4.0])
    assert convexity(v, v) == 1.0 and convexity(v, v**2) == 2.0


@pytest.mark.usefixtures("site")
def test_the_filter_of_source_004_equals_the_equation_sheet() -> None:
    import numpy as np
    from make_004 import GOLDEN_FILTER, discretised

    for ours, golden in zip(discretised(), GOLDEN_FILTER, strict=True):
        assert np.allclose(ours, golden, atol=5e-9)


@pytest.mark.slow
@pytest.mark.usefixtures("site")
def test_the_tutorial_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    import runpy

    monkeypatch.setenv("MPLBACKEND", "agg")
    found = runpy.run_path(str(DOCS / "tutorial" / "plot_ten_minutes.py"))
    assert found["certificate"].verified
    assert found["better"].held_out.overall.free_run.esr < 0.03


@pytest.mark.seconds
@pytest.mark.usefixtures("site")
def test_the_device_of_source_002_settles_to_its_law() -> None:
    """At constant speed and duty: law, full Dahl friction and gas, other in rebound than in compression."""
    import numpy as np
    from study_002 import Foreign, law

    import lpvid as lpv

    device, still = Foreign(), np.zeros(400)
    shape = np.array([device.rebound, device.knee, device.power])
    for speed in (0.05, -0.05):
        motion = {"displacement": still, "velocity": still + speed, "current": still + 0.3}
        force = device.simulate(lpv.Record(motion, sample_time=1e-3)).output[-1, 0]
        settled = law(speed, 0.3, shape) + np.copysign(device.friction, speed) + device.gas_preload
        assert force == pytest.approx(settled, rel=1e-3)
    assert law(0.05, 0.3, shape) == pytest.approx(-device.rebound * law(-0.05, 0.3, shape))


@pytest.mark.usefixtures("site")
def test_dead_links_of_a_site_are_named(tmp_path: Path) -> None:
    from building.links import dead_links

    (tmp_path / "sub").mkdir()
    (tmp_path / "index.html").write_text('<p id="top"><a href="#top">a</a><a href="sub/page.html#there">b</a><img '
                                         'src="none.png"><a href="https://example.org/x">c</a><a href="#no">d</a>')
    (tmp_path / "sub" / "page.html").write_text('<h1 id="there"></h1><a href="..">up</a><a href="../gone.html">e</a>')
    assert sorted(dead_links(tmp_path)) == ["index.html: #no", "index.html: none.png", "sub/page.html: ../gone.html"]


@pytest.mark.slow
@pytest.mark.usefixtures("site")
def test_the_lags_of_source_002_come_back_by_direction_and_edge() -> None:
    """Eight time constants and delays, all different and away from the defaults, from a device of another form."""
    import numpy as np
    from study_002 import NODES, TRUE_LAG, Foreign, lag_values, records

    from quartercar.dampers import ExtendedBoucWen, identify_stepwise

    training, _ = records(Foreign(), np.random.default_rng(2))
    found = identify_stepwise(ExtendedBoucWen(nodes=NODES, current_unit="1"), training)
    for key, (time_constant, delay) in lag_values(found).items():
        assert time_constant == pytest.approx(TRUE_LAG[key][0], abs=4e-3), key
        assert delay == pytest.approx(TRUE_LAG[key][1], abs=4e-3), key
    assert lag_values(found)["compression", "fall"][0] == max(t for t, _ in lag_values(found).values())
    assert lag_values(found)["rebound", "rise"][0] == min(t for t, _ in lag_values(found).values())
