"""Public functions, methods and classes whose docstring lacks a numpydoc section that applies: none.

Parameters apply where arguments (of a class: of its constructor) do, Returns (or Yields) where something comes back,
Raises where a `raise` stands in the body. Of a property, a command of the command line and an error class only the
docstring itself is asked for: the first has no arguments, the second documents them in its options' help. A method that
overrides a documented one of a class in the same packages may leave the sections to it.
Format: https://numpydoc.readthedocs.io/en/latest/format.html
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("lpvid", "quartercar")
Function = ast.FunctionDef | ast.AsyncFunctionDef
DATA_CLASSES = ("NamedTuple", "TypedDict")


@dataclass(frozen=True)
class Named:
    """A public function or class, and the sections that its docstring lacks."""

    name: str
    """As written in the source, methods after their class: without the module, so that a move changes nothing."""
    lacks: tuple[str, ...]


def has(section: str, docstring: str) -> bool:
    """Whether a numpydoc section stands in a docstring: its title, underlined."""
    lines = [line.strip() for line in docstring.splitlines()]
    return any(a == section and len(b) >= 3 and not b.strip("-") for a, b in pairwise(lines))


def own_nodes(function: Function) -> Iterator[ast.AST]:
    """Nodes of a body, without those of the functions and classes defined inside."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)):
            waiting += ast.iter_child_nodes(node)


def own_statements(function: Function) -> Iterator[ast.AST]:
    """The statements among them."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            for part in ("body", "orelse", "handlers", "finalbody", "cases"):
                waiting += getattr(node, part, [])


def decorators(node: Function | ast.ClassDef) -> set[str]:
    """Last names of the decorators: `property`, `dataclass`, `overload`, `setter` …"""
    calls = (d.func if isinstance(d, ast.Call) else d for d in node.decorator_list)
    return {ast.unparse(call).rpartition(".")[2] for call in calls}


def arguments(function: Function, method: bool) -> list[str]:
    """Names of the arguments that a caller gives."""
    given = function.args
    names = [a.arg for a in (*given.posonlyargs, *given.args)]
    if method and "staticmethod" not in decorators(function):
        names = names[1:]
    names += [a.arg for a in (*given.kwonlyargs, *filter(None, (given.vararg, given.kwarg)))]
    return [n for n in names if not n.startswith("_")]


def returns(function: Function) -> bool:
    """Whether something other than None comes back, by annotation or else by a `return` with a value."""
    if function.returns is not None:
        return ast.unparse(function.returns).strip("'\"") not in ("None", "NoReturn", "Never")
    return any(isinstance(n, (ast.Yield, ast.YieldFrom)) or (isinstance(n, ast.Return) and n.value is not None)
               for n in own_nodes(function))


def raises(function: Function) -> bool:
    """Whether the body raises an error of its own (passing on a caught one, or `NotImplementedError`, is none)."""
    found = (ast.unparse(n.exc) for n in own_statements(function) if isinstance(n, ast.Raise) and n.exc is not None)
    return any(not error.startswith("NotImplementedError") for error in found)


def function_lacks(function: Function, method: bool, command: bool = False) -> tuple[str, ...]:
    """Sections that apply to a function and are missing; `docstring` where there is none at all."""
    docstring = ast.get_docstring(function)
    if docstring is None:
        return ("docstring",)
    if command or decorators(function) & {"property", "cached_property"}:
        return ()
    wanted = {"Parameters": bool(arguments(function, method)), "Returns": returns(function),
              "Raises": raises(function)}
    present = {s for s in wanted if has(s, docstring)} | ({"Returns"} if has("Yields", docstring) else set())
    return tuple(s for s, applies in wanted.items() if applies and s not in present)


def class_lacks(node: ast.ClassDef, fields: bool) -> tuple[str, ...]:
    """The same of a class: Parameters (or Attributes) where its constructor takes arguments."""
    docstring = ast.get_docstring(node)
    if docstring is None:
        return ("docstring",)
    return ("Parameters",) if fields and not (has("Parameters", docstring) or has("Attributes", docstring)) else ()


def base_names(node: ast.ClassDef) -> list[str]:
    """Names of the bases without module and type arguments."""
    return [ast.unparse(b).partition("[")[0].rpartition(".")[2] for b in node.bases]


def takes_arguments(node: ast.ClassDef) -> bool:
    """Whether the constructor of a class, as written in the class itself, takes arguments."""
    body = {f.name: f for f in node.body if isinstance(f, (ast.FunctionDef, ast.AsyncFunctionDef))}
    if "__init__" in body:
        return bool(arguments(body["__init__"], method=True))
    if "dataclass" not in decorators(node) and not set(base_names(node)) & set(DATA_CLASSES):
        return False
    fields = (s for s in node.body if isinstance(s, ast.AnnAssign) and "ClassVar" not in ast.unparse(s.annotation))
    return any(not ast.unparse(f.target).startswith("_") for f in fields)


def is_public(module: Path) -> bool:
    """Whether a module, by its path below the package, has no underscore in front."""
    return not any(p.startswith("_") and p != "__init__.py" for p in module.parts)


def methods(node: ast.ClassDef) -> Iterator[Function]:
    """Public methods of a class; of a property its getter only."""
    for member in node.body:
        if (isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef)) and not member.name.startswith("_")
                and not decorators(member) & {"setter", "deleter", "overload"}):
            yield member


def inherited(method: str, node: ast.ClassDef, classes: Mapping[str, list[ast.ClassDef]]) -> bool:
    """Whether a base in the same packages has this method with all sections that apply.

    An override without a docstring of its own has its base's (`inspect.getdoc`), one with a sentence of its own leaves
    the sections to it. Classes of one name in several modules all count: of a base the source names no module.
    """
    waiting, seen = base_names(node), set()
    while waiting:
        base = waiting.pop()
        if base in seen:
            continue
        seen.add(base)
        for found in classes.get(base, []):
            waiting += base_names(found)
            if any(m.name == method and not function_lacks(m, method=True) for m in found.body
                   if isinstance(m, (ast.FunctionDef, ast.AsyncFunctionDef))):
                return True
    return False


def survey(packages: Mapping[str, Path], commands: frozenset[str] = frozenset()) -> dict[str, list[Named]]:
    """Every public function, class and method of the packages.

    `commands` are the qualified names (`lpvid.cli.identify.identify`) of functions whose options the command line
    documents.
    """
    trees = {package: {path.relative_to(folder): ast.parse(path.read_text(encoding="utf8"))
                       for path in sorted(folder.rglob("*.py"))} for package, folder in packages.items()}
    classes: dict[str, list[ast.ClassDef]] = {}
    for node in (n for modules in trees.values() for tree in modules.values() for n in tree.body):
        if isinstance(node, ast.ClassDef):  # of private modules too: a base may stand there
            classes.setdefault(node.name, []).append(node)
    found: dict[str, list[Named]] = {}
    for package, modules in trees.items():
        rows = found.setdefault(package, [])
        for path, tree in modules.items():
            if not is_public(path):
                continue
            module = ".".join((package, *path.with_suffix("").parts))
            for node in tree.body:
                if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                    if not node.name.startswith("_") and "overload" not in decorators(node):
                        rows.append(Named(node.name, function_lacks(node, False, f"{module}.{node.name}" in commands)))
                elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    rows.append(Named(node.name, class_lacks(node, takes_arguments(node))))
                    for method in methods(node):
                        lacks = function_lacks(method, method=True)
                        if lacks and inherited(method.name, node, classes):
                            lacks = ()
                        rows.append(Named(f"{node.name}.{method.name}", lacks))
    return found


def command_functions() -> frozenset[str]:
    """Qualified names of the functions behind the commands of both programs."""
    from lpvid.cli.app import app as lpvid_app
    from quartercar.cli.app import app as quartercar_app

    calls = (c.callback for app in (lpvid_app, quartercar_app) for c in (*app.registered_commands,
                                                                         app.registered_callback) if c is not None)
    return frozenset(f"{c.__module__}.{c.__qualname__}" for c in calls if c is not None)


@pytest.fixture(scope="module")
def surveyed() -> dict[str, list[Named]]:
    return survey({p: ROOT / p for p in PACKAGES}, command_functions())


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_has_its_sections(package: str, surveyed: dict[str, list[Named]]) -> None:
    lacking = {n.name: n.lacks for n in surveyed[package] if n.lacks}
    assert not lacking, f"public names without a numpydoc section that applies: {lacking}"


SOURCE = '''
def bare(x): pass

def complete(x, *, y=1):
    """Add.

    Parameters
    ----------
    x, y : float
        Numbers.

    Returns
    -------
    float
        Their sum.

    Raises
    ------
    ValueError
        Where they are equal.
    """
    if x == y:
        raise ValueError
    return x + y

def no_sections(x) -> int:
    """Double."""
    if x < 0:
        raise ValueError("negative")
    return 2 * x

def none_apply() -> None:
    """Do it."""
    try:
        print()
    except OSError:
        raise

def nested() -> None:
    """The inner function is its own."""
    def inner():
        raise ValueError
    inner()

def _private(x): return x

class Base:
    """Something without fields."""

    def size(self, x: float) -> float:
        """Size.

        Parameters
        ----------
        x : float
            A number.

        Returns
        -------
        float
            Its size.
        """
        return abs(x)

class Child(Base):
    """A child."""

    def size(self, x: float) -> float:
        """The same."""
        return -abs(x)

    @property
    def weight(self) -> float:
        """A property needs no section."""
        return 0.0

    def other(self) -> float:
        """Nothing to inherit."""
        return 0.0

@dataclass
class Point:
    """A point."""
    x: float

@dataclass
class Described:
    """A point.

    Parameters
    ----------
    x : float
        A place.
    """
    x: float
'''
EXPECTED = {"bare": ("docstring",), "no_sections": ("Parameters", "Returns", "Raises"), "Child.other": ("Returns",),
            "Point": ("Parameters",)}


def test_what_lacks_and_what_does_not(tmp_path: Path) -> None:
    (tmp_path / "open.py").write_text(SOURCE, encoding="utf8")
    (tmp_path / "_closed.py").write_text(SOURCE, encoding="utf8")
    rows = survey({"package": tmp_path})["package"]
    assert {n.name: n.lacks for n in rows if n.lacks} == EXPECTED
    assert len(rows) == 13  # five functions, four classes, four methods of the open module


def test_an_option_of_a_command_is_documented_by_its_help(tmp_path: Path) -> None:
    (tmp_path / "cli.py").write_text('def run(data: str) -> int:\n    """Run it."""\n', encoding="utf8")
    assert [n.lacks for n in survey({"p": tmp_path})["p"]] == [("Parameters", "Returns")]
    assert [n.lacks for n in survey({"p": tmp_path}, frozenset({"p.cli.run"}))["p"]] == [()]
