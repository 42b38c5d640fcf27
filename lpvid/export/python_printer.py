"""Step programs in Python: what carries them into python-control, and checks them without a compiler."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

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

Step = Callable[[dict, dict, dict, dict], None]
"""(parameters, states, inputs, outputs), by name; states and outputs are changed in place."""


HOMES = {"input": "u", "output": "y", "state": "s", "parameter": "p"}


class PythonPrinter(Printer):
    """Python on plain floats and numpy arrays."""

    def number(self, value: float) -> str:
        return repr(float(value))

    def constant(self, value: ByPrecision) -> str:
        return self.number(value.double)

    def scalar(self, symbol: Symbol) -> str:
        return symbol.name if symbol.home == "local" else f"{HOMES[symbol.home]}[{symbol.name!r}]"

    def element(self, element: ArrayElement) -> str:
        array = element.array
        name = array.name if array.home == "local" else f"{HOMES[array.home]}[{array.name!r}]"
        return f"{name}[{', '.join(self.index(i) for i in element.index)}]"

    def operator(self, operator: str) -> str:
        return "not " if operator == "not" else operator

    def function(self, name: str, arguments: Sequence[str]) -> str:
        return f"{name}({', '.join(arguments)})"

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"(({then}) if {condition} else ({other}))"

    def rounded(self, value: str) -> str:
        return f"int({value})"

    def real(self, index: str) -> str:
        return f"float({index})"

    def lines(self, statement: Statement, depth: int) -> list[str]:
        pad = self.indent * depth
        if isinstance(statement, Declare):
            return [f"{pad}{statement.symbol.name} = {self.text(statement.value)}"]
        if isinstance(statement, DeclareArray):
            return [f"{pad}{statement.array.name} = zeros({statement.array.shape})"]
        if isinstance(statement, (DeclareIndex, AssignIndex)):
            return [f"{pad}{statement.counter.name} = {self.index(statement.value)}"]
        if isinstance(statement, Assign):
            target = statement.target
            place = self.scalar(target) if isinstance(target, Symbol) else self.element(target)
            return [f"{pad}{place} = {self.text(statement.value)}"]
        if isinstance(statement, Remark):
            return [f"{pad}# {statement.text}"]
        if isinstance(statement, LoopStatement):
            first, last = statement.first, statement.last
            span = f"{last - 1}, {first - 1}, -1" if statement.down else f"{first}, {last}"
            return [f"{pad}for {statement.counter.name} in range({span}):", *self.block(statement.body, depth + 1)]
        assert isinstance(statement, Branch)
        inner = self.block(statement.then, depth + 1)
        out = [f"{pad}if {self.text(statement.condition)}:", *(inner or [f"{pad}{self.indent}pass"])]
        return out + ([f"{pad}else:", *self.block(statement.other, depth + 1)] if statement.other else [])


def python_source(program: StepProgram) -> str:
    """The program as the text of a function ``step(p, s, u, y)``."""
    return "\n".join(["def step(p, s, u, y):", *PythonPrinter().block(program.body, 1), ""])


def python_step(program: StepProgram) -> Step:
    """The program as a function of parameters, states, inputs and outputs by name."""
    scope: dict = {"tanh": math.tanh, "exp": math.exp, "sqrt": math.sqrt, "sin": math.sin, "cos": math.cos,
                   "fabs": abs, "floor": math.floor, "pow": math.pow, "fmin": min, "fmax": max, "zeros": np.zeros}
    exec(compile(python_source(program), f"<{program.name}>", "exec"), scope)  # text printed above, from no file
    return scope["step"]


def run(program: StepProgram, inputs: np.ndarray) -> np.ndarray:
    """Outputs along (n, inputs) samples, by Python alone.

    Returns
    -------
    (n, outputs) array

    Examples
    --------
    >>> from lpvid.export.step_builder import StepBuilder
    >>> b = StepBuilder("sum", "a sum", 1.0)
    >>> u, x = b.input("u1"), b.state("x1")
    >>> b.set(x, x + u)
    >>> b.output("y1", x)
    >>> run(b.program(), np.ones((3, 1))).ravel()
    array([1., 2., 3.])
    """
    step = python_step(program)
    p, s = ({q.name: q.start.copy() if q.shape else float(q.start) for q in group}
            for group in (program.parameters, program.states))
    out = np.empty((len(inputs), len(program.outputs)))
    y: dict[str, float] = {}
    for k, row in enumerate(np.asarray(inputs, dtype=float).tolist()):
        step(p, s, dict(zip((q.name for q in program.inputs), row, strict=True)), y)
        out[k] = [y[q.name] for q in program.outputs]
    return out
