"""What stands on top of lpvid uses its public names only: no name, module or attribute of it with an underscore."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [p for folder in ("quartercar", "examples") for p in sorted((ROOT / folder).rglob("*.py"))]


def private(name: str) -> bool:
    return any(part.startswith("_") and not part.endswith("__") for part in name.split("."))


def private_uses(source: str) -> Iterator[str]:
    """Names of lpvid in a module's text that have an underscore in front, anywhere in their path."""
    own = {}  # what names in the module stand for
    nodes = list(ast.walk(ast.parse(source)))
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "lpvid":
                    own[alias.asname or "lpvid"] = alias.name if alias.asname else "lpvid"
                    if private(alias.name):
                        yield alias.name
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "lpvid":
            for alias in node.names:
                own[alias.asname or alias.name] = name = f"{node.module}.{alias.name}"
                if private(name):
                    yield name
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in own:
            name = f"{own[node.value.id]}.{node.attr}"
            if private(node.attr):
                yield name


def test_quartercar_and_the_examples_use_public_names_of_lpvid_only() -> None:
    assert len(FILES) > 200
    found = {f"{path.relative_to(ROOT)}: {name}" for path in FILES for name in private_uses(path.read_text())}
    assert not found


@pytest.mark.parametrize(("source", "name"), [
    ("from lpvid import _checks", "lpvid._checks"), ("from lpvid._compiling import njit", "lpvid._compiling.njit"),
    ("def f():\n    import lpvid._threads as t", "lpvid._threads"), ("from lpvid.lmi.search import _scaled", "_scaled"),
    ("import lpvid as lpv\nlpv._checks.real(1, 'x')", "lpvid._checks"),
    ("from lpvid.model import state_space as s\ns._point(1)", "lpvid.model.state_space._point")])
def test_a_private_name_is_found_however_it_is_reached(source: str, name: str) -> None:
    assert any(found.endswith(name) for found in private_uses(source))


def test_public_names_pass() -> None:
    assert not list(private_uses("import lpvid as lpv\nfrom lpvid.toolkit import checks, njit\nlpv.__version__"))
