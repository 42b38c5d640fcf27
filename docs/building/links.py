"""Internal links of the built site: `python docs/building/links.py docs/_build` names every dead one and exits with 1.

Sphinx's own linkcheck asks the network and warns of missing pages only; this looks into the HTML itself, for pages,
pictures, downloads and anchors alike, so that what sphinx-gallery and autosummary wrote is looked at too.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Links and anchors of one page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what points somewhere, and what can be pointed at."""
        for name, value in attrs:
            if value is None:
                continue
            if name in ("href", "src"):
                self.links.append(value)
            elif name == "id" or (tag == "a" and name == "name"):
                self.anchors.add(value)


def dead_links(site: Path) -> Iterator[str]:
    """Page and link of every internal link that leads nowhere."""
    pages = {path.resolve(): Page(path.read_text(encoding="utf8")) for path in sorted(site.rglob("*.html"))
             if "_static" not in path.parts}  # the theme keeps a template there
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link.startswith("data:"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            anchor = unquote(parts.fragment)
            if not target.exists() or (anchor and target in pages and anchor not in pages[target].anchors):
                yield f"{path.relative_to(site.resolve())}: {link}"


if __name__ == "__main__":
    found = sorted(set(dead_links(Path(sys.argv[1]))))
    print(*found, f"{len(found)} dead internal links", sep="\n")
    sys.exit(bool(found))
