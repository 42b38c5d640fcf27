"""A damper, a law and an estimator as a user writes them, outside the packages: those of docs/extending.md."""

from __future__ import annotations

import doctest
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "extending.md"
NAMES = ("orifice", "groundhook-rate", "noisy-output")
ENTRY_POINTS = """\
[quartercar.dampers]
orifice = my_extensions:Orifice
maxwell = my_extensions:Maxwell
[quartercar.controllers]
groundhook-rate = my_extensions:RateLimitedGroundhook
[lpvid.structures]
noisy-output = my_extensions:NoisyOutput
"""


def source(registers: bool) -> str:
    """The imports and classes of the page, in its order."""
    examples = doctest.DocTestParser().get_examples(PAGE.read_text(encoding="utf8"))
    wanted = [e.source for e in examples if e.source.startswith(("from ", "import ", "@", "class "))]
    lines = [line for text in wanted for line in (text + "\n").splitlines()]
    return "\n".join(line for line in lines if registers or "register" not in line or not line.startswith("@")) + "\n"


def install(folder: Path, registers: bool = False) -> Path:
    """The classes as an installed package: a module with its entry points, for a path that Python searches."""
    (folder / "my_extensions.py").write_text(source(registers), encoding="utf8")
    info = folder / "my_extensions-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-extensions\nVersion: 1.0\n", encoding="utf8")
    (info / "entry_points.txt").write_text(ENTRY_POINTS, encoding="utf8")
    return folder
