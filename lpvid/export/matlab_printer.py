"""Step programs as functions of MATLAB, which GNU Octave runs too."""

from __future__ import annotations

from collections.abc import Sequence

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

HOMES = {"input": "u.", "output": "y.", "state": "s.", "parameter": "p.", "local": ""}
FUNCTIONS = {"fabs": "abs", "pow": "power", "fmin": "min", "fmax": "max"}
CHOOSE = """
function value = choose(condition, then, other)
if condition
    value = then;
else
    value = other;
end
end
"""


class MatlabPrinter(Printer):
    """MATLAB: indices from one, structures for inputs, outputs, states and parameters."""

    def number(self, value: float) -> str:
        return repr(float(value))

    def constant(self, value: ByPrecision) -> str:
        return self.number(value.double)

    def scalar(self, symbol: Symbol) -> str:
        return HOMES[symbol.home] + symbol.name

    def element(self, element: ArrayElement) -> str:
        places = ", ".join(self.index(i + 1) for i in element.index)
        return f"{HOMES[element.array.home]}{element.array.name}({places})"

    def operator(self, operator: str) -> str:
        return {"and": "&&", "or": "||", "not": "~"}[operator]

    def function(self, name: str, arguments: Sequence[str]) -> str:
        return f"{FUNCTIONS.get(name, name)}({', '.join(arguments)})"

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"choose({condition}, {then}, {other})"

    def rounded(self, value: str) -> str:
        return f"({value})"

    def real(self, index: str) -> str:
        return f"({index})"

    def lines(self, statement: Statement, depth: int) -> list[str]:
        pad = self.indent * depth
        if isinstance(statement, Declare):
            return [f"{pad}{statement.symbol.name} = {self.text(statement.value)};"]
        if isinstance(statement, DeclareArray):
            shape = statement.array.shape if len(statement.array.shape) > 1 else (*statement.array.shape, 1)
            return [f"{pad}{statement.array.name} = zeros({', '.join(map(str, shape))});"]
        if isinstance(statement, (DeclareIndex, AssignIndex)):
            return [f"{pad}{statement.counter.name} = {self.index(statement.value)};"]
        if isinstance(statement, Assign):
            target = statement.target
            place = self.scalar(target) if isinstance(target, Symbol) else self.element(target)
            return [f"{pad}{place} = {self.text(statement.value)};"]
        if isinstance(statement, Remark):
            return [f"{pad}% {statement.text}"]
        if isinstance(statement, LoopStatement):
            first, last = statement.first, statement.last - 1
            span = f"{last}:-1:{first}" if statement.down else f"{first}:{last}"
            return [f"{pad}for {statement.counter.name} = {span}", *self.block(statement.body, depth + 1), f"{pad}end"]
        assert isinstance(statement, Branch)
        out = [f"{pad}if {self.text(statement.condition)}", *self.block(statement.then, depth + 1)]
        out += [f"{pad}else", *self.block(statement.other, depth + 1)] if statement.other else []
        return [*out, f"{pad}end"]


def matlab_step(program: StepProgram) -> str:
    """A function ``[s, y] = NAME_step(p, s, u)`` of one sample."""
    name = program.name
    description = [
        f"%{name.upper()}_STEP One sample: outputs now, and the states of the next sample.",
        f"%   {program.description}.",
        f"%   Period {program.sample_time!r} s. p, s: parameters and states of {name}.mat.",
        *(f"%   u.{q.name} [{q.unit or '1'}]: {q.description}" for q in program.inputs),
        *(f"%   y.{q.name} [{q.unit or '1'}]: {q.description}" for q in program.outputs),
    ]
    return "\n".join(
        [
            f"function [s, y] = {name}_step(p, s, u)",
            *description,
            *MatlabPrinter().block(program.body, 0),
            "end",
            CHOOSE,
        ]
    )
