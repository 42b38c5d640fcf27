"""Step programs as functions of MATLAB, which GNU Octave runs too."""

from __future__ import annotations

from types import MappingProxyType

from lpvid.export.expression import Array
from lpvid.export.printing import Printer
from lpvid.export.step_program import StepProgram

HOMES = {"input": "u.", "output": "y.", "state": "s.", "parameter": "p.", "local": ""}
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

    first_index = 1
    words = MappingProxyType({"and": "&&", "or": "||", "not": "~"})
    functions = MappingProxyType({"fabs": "abs", "pow": "power", "fmin": "min", "fmax": "max"})
    remark, when, otherwise, closed, loop_closed = "% {}", "if {}", "else", "end", "end"

    def place(self, home: str, name: str) -> str:
        return HOMES[home] + name

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"choose({condition}, {then}, {other})"

    def rounded(self, value: str) -> str:
        return f"({value})"

    def real(self, index: str) -> str:
        return f"({index})"

    def zeros(self, array: Array) -> str:
        shape = array.shape if len(array.shape) > 1 else (*array.shape, 1)
        return f"{array.name} = zeros({', '.join(map(str, shape))})"

    def loop(self, counter: str, first: int, last: int, down: bool) -> str:
        return f"for {counter} = " + (f"{last - 1}:-1:{first}" if down else f"{first}:{last - 1}")


def matlab_step(program: StepProgram) -> str:
    """A function ``[s, y] = NAME_step(p, s, u)`` of one sample.

    Parameters
    ----------
    program : StepProgram
        Sampled; its period stands in the comment at the head.

    Returns
    -------
    str
        Text of ``NAME_step.m``, with the helper ``choose`` behind the function.
    """
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
