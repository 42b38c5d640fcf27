"""A page in a headless Chromium: its DOM after its scripts, what they wrote onto the root, and the processor time."""

from __future__ import annotations

import importlib.util
import os
import re
import resource
import shutil
import subprocess
from pathlib import Path

BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))),
               None)


def dump(file: Path, profile: Path, width: int = 1200, budget: int = 5000, height: int = 2000) -> str:
    """The DOM after `budget` ms of the page's own clock."""
    return _run(file, profile, f"--window-size={width},{height}", f"--virtual-time-budget={budget}", "--dump-dom")


def screenshot(file: Path, picture: Path, profile: Path, width: int, height: int) -> None:
    """The window that shows a page or a drawing, without scroll bars, as a PNG."""
    _run(file, profile, f"--window-size={width},{height}", "--hide-scrollbars", f"--screenshot={picture}")


def _run(file: Path, profile: Path, *words: str) -> str:
    """What the browser writes to its standard output."""
    assert BROWSER is not None
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
               "--disable-background-networking", "--disable-component-update", "--disable-sync",
               f"--user-data-dir={profile}", *words, file.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


def opened(html: str, script: str, folder: Path, width: int = 1200, budget: int = 5000) -> dict[str, str]:
    """What a script put at the end of a page wrote into the data attributes of its root."""
    folder.mkdir(exist_ok=True)
    file = folder / "page.html"
    file.write_text(html.replace("</body>", f"<script>{script}</script></body>"))
    dom = dump(file, folder / "profile", width, budget)
    head = dom[: dom.index(">", dom.index("<html"))]
    return dict(re.findall(r'data-(\w+)="([^"]*)"', head))


def processor_time(file: Path, profile: Path) -> float:
    """Seconds that all processes of the browser compute for a page: independent of what else the machine does."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    dump(file, profile)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def axe_source() -> str | None:
    """axe-core: the file that LPVID_AXE names, or that of the package axe-core-python; None where there is neither."""
    if "LPVID_AXE" in os.environ:
        return Path(os.environ["LPVID_AXE"]).read_text(encoding="utf-8")
    found = importlib.util.find_spec("axe_core_python")
    for folder in () if found is None else found.submodule_search_locations or ():
        file = Path(folder) / "axe.min.js"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    return None


AXE = """
addEventListener('load', async () => {
  const root = document.documentElement;
  try {
    if (window.lpvidTraces) await window.lpvidTraces.all();
    const found = await axe.run();
    const grave = found.violations.filter(v => v.impact === 'serious' || v.impact === 'critical');
    root.setAttribute('data-checked', found.passes.length);
    root.setAttribute('data-grave', grave.map(v => v.id + ': ' + v.nodes[0].target.join(' ')).join('; '));
  } catch (error) { root.setAttribute('data-error', String(error)); }
});
"""


def grave_findings(html: str, folder: Path, width: int = 1200) -> str:
    """Serious and critical findings of axe-core, with where the first of each is; empty where there are none."""
    source = axe_source()
    assert source is not None
    seen = opened(html, source + AXE, folder, width, 30_000)
    assert "error" not in seen, seen["error"]
    assert int(seen["checked"]) > 5  # it ran: a page always passes some rules
    return seen["grave"]
