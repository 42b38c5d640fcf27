"""Step programs in C99, with ``double`` or ``float``."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np

from lpvid.export.expression import ArrayElement, ByPrecision, Symbol
from lpvid.export.printing import Printer
from lpvid.export.step_program import (
    Assign,
    AssignIndex,
    Branch,
    Declare,
    DeclareArray,
    DeclareIndex,
    LoopStatement,
    Remark,
    Statement,
    StepProgram,
)

HOMES = {"input": "u->", "output": "y->", "state": "s->", "parameter": "p->", "rate": "dx->", "local": "",
         "state_tangent": "ds->", "input_tangent": "du->", "rate_tangent": "ddx->", "output_tangent": "dy->"}
WORDS = {"and": "&&", "or": "||", "not": "!"}


class CPrinter(Printer):
    """C99.

    Parameters
    ----------
    program : StepProgram
    precision : {"double", "float"}
    """

    explicit = True

    def __init__(self, program: StepProgram, precision: str) -> None:
        self._single, self._real = precision == "float", f"{program.name}_real"
        self._moving = program.assigned()

    def number(self, value: float) -> str:
        if self._single:
            return c_number(float(np.float32(value)), single=True)
        return c_number(value)

    def constant(self, value: ByPrecision) -> str:
        return self.number(value.single if self._single else value.double)

    def scalar(self, symbol: Symbol) -> str:
        return HOMES[symbol.home] + symbol.name

    def element(self, element: ArrayElement) -> str:
        places = "".join(f"[{self.index(i)}]" for i in element.index)
        return f"{HOMES[element.array.home]}{element.array.name}{places}"

    def operator(self, operator: str) -> str:
        return WORDS[operator]

    def function(self, name: str, arguments: Sequence[str]) -> str:
        return f"{name}{'f' if self._single else ''}({', '.join(arguments)})"

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"(({condition}) ? ({then}) : ({other}))"

    def rounded(self, value: str) -> str:
        return f"(int)({value})"

    def real(self, index: str) -> str:
        return f"(({self._real})({index}))"

    def lines(self, statement: Statement, depth: int) -> list[str]:
        pad = self.indent * depth
        if isinstance(statement, Declare):
            name = statement.symbol.name
            fixed = "" if name in self._moving else "const "
            return wrapped(f"{pad}{fixed}{self._real} {name} = {self.text(statement.value)};")
        if isinstance(statement, DeclareArray):
            shape = "".join(f"[{n}]" for n in statement.array.shape)
            return [f"{pad}{self._real} {statement.array.name}{shape} = {{0}};"]
        if isinstance(statement, DeclareIndex):
            return [f"{pad}int {statement.counter.name} = {self.index(statement.value)};"]
        if isinstance(statement, Assign):
            target = statement.target
            place = self.scalar(target) if isinstance(target, Symbol) else self.element(target)
            return wrapped(f"{pad}{place} = {self.text(statement.value)};")
        if isinstance(statement, AssignIndex):
            return [f"{pad}{statement.counter.name} = {self.index(statement.value)};"]
        if isinstance(statement, Remark):
            return [f"{pad}/* {statement.text} */"]
        if isinstance(statement, LoopStatement):
            i, first, last = statement.counter.name, statement.first, statement.last
            head = (f"for (int {i} = {last - 1}; {i} >= {first}; {i}--)" if statement.down else
                    f"for (int {i} = {first}; {i} < {last}; {i}++)")
            return [f"{pad}{head} {{", *self.block(statement.body, depth + 1), f"{pad}}}"]
        assert isinstance(statement, Branch)
        out = [*wrapped(f"{pad}if ({self.text(statement.condition)}) {{"), *self.block(statement.then, depth + 1)]
        if statement.other:
            out += [f"{pad}}} else {{", *self.block(statement.other, depth + 1)]
        return [*out, f"{pad}}}"]


def wrapped(line: str) -> list[str]:
    """A long line of C broken at spaces."""
    start = " " * (len(line) - len(line.lstrip()))
    return textwrap.wrap(line.strip(), 110, initial_indent=start, subsequent_indent=start + "    ",
                         break_long_words=False, break_on_hyphens=False)


def c_number(value: float, single: bool = False) -> str:
    """A constant that C reads back bit for bit.

    Examples
    --------
    >>> c_number(0.1), c_number(1.0), c_number(0.5, single=True), c_number(1e300)
    ('0.1', '1.0', '0.5f', '1e+300')
    """
    text = str(np.float32(value)) if single else repr(float(value))
    if not any(c in text for c in ".e"):
        text += ".0"
    return f"{text}f" if single else text


def initializer(value: np.ndarray, single: bool, depth: int = 1) -> str:
    """An array as a brace-enclosed list."""
    if value.ndim == 0:
        v = float(np.float32(value)) if single else float(value)
        return c_number(v, single)
    if value.ndim == 1:
        parts = [initializer(v, single) for v in value]
        return "{" + textwrap.fill(", ".join(parts), 104, subsequent_indent="    " * (depth + 1),
                                   break_long_words=False, break_on_hyphens=False) + "}"
    pad = "    " * (depth + 1)
    return "{" + f",\n{pad}".join(initializer(v, single, depth + 1) for v in value) + "}"
