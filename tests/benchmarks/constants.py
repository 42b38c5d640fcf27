"""Numbers set by hand in packages: how many named constants, how many numbers in them, and how many without a name.

    python tests/benchmarks/constants.py [FOLDER ...] [--list]

A line per folder:

- names: constants of a module in capitals whose value has a number; each name of an assignment to several counts;
- numbers: numeric literals in those values, powers and signs as one;
- derived: names whose value is computed from other names or functions only, without a number of its own;
- unnamed: literals elsewhere in the code, but for those by which formulas are written (0, 1, 2, 3, 4, 0.5 and their
  negatives) and whole numbers in indices; the ranges and grids of an `EffectParameter` are counted apart.

Inlining a constant moves it from one column to another: the sum of numbers and unnamed ones is the measure.
"""

from __future__ import annotations

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

FOLDERS = ("lpvid/diagnosis", "lpvid/effects", "lpvid/baselines", "quartercar/effects")
FORMULA = {0, 1, 2, 3, 4, 0.5}


def literals(node: ast.AST) -> Iterator[ast.Constant]:
    """Numeric literals in a piece of code, in order."""
    for part in ast.walk(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, int | float) and not isinstance(part.value, bool):
            yield part


def targets(node: ast.Assign | ast.AnnAssign) -> list[str]:
    """Names in capitals that a statement of a module assigns."""
    first = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
    names = first.elts if isinstance(first, ast.Tuple) else [first]
    return [n.id for n in names if isinstance(n, ast.Name) and n.id.isupper()]


def prior_numbers(tree: ast.AST) -> list[ast.Constant]:
    """Literals in the calls that make an `EffectParameter`."""
    return [v for call in ast.walk(tree) if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
            and call.func.id == "EffectParameter" for v in literals(call)]


def counted(path: Path) -> tuple[Counter, list[str]]:
    """Counts of a file, and a line per constant with numbers.

    Examples
    --------
    >>> import tempfile
    >>> source = "A, B = 0.1, -3\\nC = 2 * A\\nD = A + B\\n\\ndef f(x):\\n    return x[7] * 2 + 0.25\\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "some.py"
    ...     _ = path.write_text(source)
    ...     found, lines = counted(path)
    >>> found["names"], found["numbers"], found["derived"], found["unnamed"]
    (3, 3, 1, 1)
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: Counter = Counter()
    lines: list[str] = []
    prior = {id(v) for v in prior_numbers(tree)}
    seen = set(prior)
    for node in tree.body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        names = targets(node)
        if not names:
            continue
        own = [v for v in literals(node.value) if id(v) not in prior]
        if own:
            found["names"] += len(names)
            found["numbers"] += len(own)
            lines.append(f"{path}:{node.lineno}: {ast.unparse(node)}")
        elif not isinstance(node.value, ast.Constant | ast.Tuple | ast.Dict | ast.JoinedStr):
            found["derived"] += len(names)
        seen |= {id(v) for v in own}
    index = {id(v) for part in ast.walk(tree) if isinstance(part, ast.Subscript) for v in literals(part.slice)
             if isinstance(v.value, int)}
    bare = [v for v in literals(tree) if id(v) not in seen | index and v.value not in FORMULA]
    found["unnamed"], found["prior"] = len(bare), len(prior)
    lines += [f"{path}:{v.lineno}: unnamed {v.value}" for v in bare]
    return found, lines


def main() -> None:
    """A table, a line per folder."""
    parser = argparse.ArgumentParser(description="Numbers set by hand in packages.")
    parser.add_argument("folder", nargs="*", type=Path, default=[Path(f) for f in FOLDERS])
    parser.add_argument("--list", action="store_true", help="each of them")
    options = parser.parse_args()
    print("| folder | names | numbers | derived | unnamed | in parameters |\n|---|---|---|---|---|---|")
    listed: list[str] = []
    for folder in options.folder:
        total: Counter = Counter()
        for path in sorted(folder.rglob("*.py")):
            found, lines = counted(path)
            total += found
            listed += lines
        print(f"| {folder} | " + " | ".join(str(total[k]) for k in ("names", "numbers", "derived", "unnamed", "prior"))
              + " |")
    if options.list:
        print("\n".join(listed))


if __name__ == "__main__":
    main()
