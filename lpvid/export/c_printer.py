"""Step programs in C99, with ``double`` or ``float``."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from lpvid.export.expression import Array, ArrayElement, ByPrecision
from lpvid.export.printing import Printer, wrapped
from lpvid.export.step_program import StepProgram

HOMES = {"input": "u->", "output": "y->", "state": "s->", "parameter": "p->", "rate": "dx->", "local": "",
         "state_tangent": "ds->", "input_tangent": "du->", "rate_tangent": "ddx->", "output_tangent": "dy->"}


class CPrinter(Printer):
    """C99.

    Parameters
    ----------
    program : StepProgram
    precision : {"double", "float"}
    """

    explicit = True
    words = MappingProxyType({"and": "&&", "or": "||", "not": "!"})
    remark, when, otherwise, closed, loop_closed = "/* {} */", "if ({}) {{", "} else {", "}", "}"

    def __init__(self, program: StepProgram, precision: str) -> None:
        self._single, self._real = precision == "float", f"{program.name}_real"
        self._moving = program.assigned()

    def number(self, value: float) -> str:
        return c_number(value, self._single)

    def constant(self, value: ByPrecision) -> str:
        return self.number(value.single if self._single else value.double)

    def place(self, home: str, name: str) -> str:
        return HOMES[home] + name

    def element(self, element: ArrayElement) -> str:
        places = "".join(f"[{self.index(i)}]" for i in element.index)
        return self.place(element.array.home, element.array.name) + places

    def function(self, name: str, arguments: Sequence[str]) -> str:
        return f"{name}{'f' if self._single else ''}({', '.join(arguments)})"

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"(({condition}) ? ({then}) : ({other}))"

    def rounded(self, value: str) -> str:
        return f"(int)({value})"

    def real(self, index: str) -> str:
        return f"(({self._real})({index}))"

    def declare(self, name: str, value: str) -> str:
        return f"{'' if name in self._moving else 'const '}{self._real} {name} = {value}"

    def zeros(self, array: Array) -> str:
        return f"{self._real} {array.name}{''.join(f'[{n}]' for n in array.shape)} = {{0}}"

    def declare_index(self, name: str, value: str) -> str:
        return f"int {name} = {value}"

    def loop(self, counter: str, first: int, last: int, down: bool) -> str:
        span = f"{last - 1}; {counter} >= {first}; {counter}--" if down else f"{first}; {counter} < {last}; {counter}++"
        return f"for (int {counter} = {span}) {{"

    def broken(self, line: str) -> list[str]:
        return wrapped(line)


def c_number(value: float, single: bool = False) -> str:
    """A constant that C reads back bit for bit.

    Parameters
    ----------
    value : float
        Finite number.
    single : bool
        Whether the constant is of type float, with the suffix f.

    Returns
    -------
    str
        The shortest digits that give the same number of that precision.

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
    """An array as a brace-enclosed list.

    Parameters
    ----------
    value : array
        Of any number of axes; a scalar gives a bare constant.
    single : bool
        Whether entries are rounded to float first.
    depth : int
        Levels of indentation of the lines that follow the first.

    Returns
    -------
    str
        With an inner brace for every row; a long row is broken over lines.
    """
    if value.ndim == 0:
        return c_number(float(value), single)
    if value.ndim == 1:
        parts = [initializer(v, single) for v in value]
        return "{" + textwrap.fill(", ".join(parts), 104, subsequent_indent="    " * (depth + 1),
                                   break_long_words=False, break_on_hyphens=False) + "}"
    pad = "    " * (depth + 1)
    return "{" + f",\n{pad}".join(initializer(v, single, depth + 1) for v in value) + "}"
