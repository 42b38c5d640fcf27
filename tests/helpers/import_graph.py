"""Which modules import which, inside functions and under TYPE_CHECKING too, and the circles among them."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

Graph = Mapping[str, frozenset[str]]


def modules(packages: Sequence[Path]) -> dict[str, Path]:
    """Every module of packages by its dotted name."""
    found = {}
    for package in packages:
        for path in sorted(package.rglob("*.py")):
            parts = path.relative_to(package.parent).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def statements(tree: ast.AST, typing: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements of a module at any depth; those under ``if TYPE_CHECKING:`` only on request."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test) and not typing:
            for branch in node.orelse:
                yield from statements(branch, typing)
        elif not isinstance(node, ast.expr):  # expressions hold no statement: most nodes are theirs
            yield from statements(node, typing)


def targets(statement: ast.Import | ast.ImportFrom, package: str, known: Mapping[str, Path]) -> Iterator[str]:
    """Modules among the known ones that a statement in a package names itself: of `import a.b.c` the longest."""
    if isinstance(statement, ast.Import):
        for alias in statement.names:
            name = alias.name
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name:
                yield name
        return
    above = package.split(".")[: len(package.split(".")) - statement.level + 1] if statement.level else []
    base = ".".join([*above, *([statement.module] if statement.module else [])])
    for alias in statement.names:
        for name in (f"{base}.{alias.name}", base):
            if name in known:
                yield name
                break


def import_graph(packages: Sequence[Path], typing: bool = True) -> Graph:
    """What each module imports of the packages, at its top, inside its functions, and, on request, for types alone."""
    known = modules(packages)
    found = {}
    for name, path in known.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        tree = ast.parse(path.read_text(encoding="utf8"))
        found[name] = frozenset(t for s in statements(tree, typing) for t in targets(s, package, known)) - {name}
    return found


def circles(graph: Graph) -> set[tuple[str, ...]]:
    """Strongly connected components of two or more modules, each in alphabetical order (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: set[tuple[str, ...]] = set()

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            place = stack.index(node)
            if len(stack) - place > 1:
                found.add(tuple(sorted(stack[place:])))
            del stack[place:]

    for node in graph:
        if node not in index:
            visit(node)
    return found
