"""Step programs in Python: what carries them into python-control, and checks them without a compiler."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from lpvid.export.expression import Array, ArrayElement
from lpvid.export.printing import Printer
from lpvid.export.step_program import Statement, StepProgram

Step = Callable[[dict, dict, dict, dict], None]
"""(parameters, states, inputs, outputs), by name; states and outputs are changed in place."""


HOMES = {"input": "u", "output": "y", "state": "s", "parameter": "p"}


class PythonPrinter(Printer):
    """Python on plain floats and numpy arrays."""

    end, remark, when, otherwise = "", "# {}", "if {}:", "else:"

    def place(self, home: str, name: str) -> str:
        return name if home == "local" else f"{HOMES[home]}[{name!r}]"

    def element(self, element: ArrayElement) -> str:
        places = ", ".join(map(self.index, element.index))
        return f"{self.place(element.array.home, element.array.name)}[{places}]"

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"(({then}) if {condition} else ({other}))"

    def rounded(self, value: str) -> str:
        return f"int({value})"

    def real(self, index: str) -> str:
        return f"float({index})"

    def zeros(self, array: Array) -> str:
        return f"{array.name} = zeros({array.shape})"

    def loop(self, counter: str, first: int, last: int, down: bool) -> str:
        return f"for {counter} in range({f'{last - 1}, {first - 1}, -1' if down else f'{first}, {last}'}):"

    def block(self, body: Sequence[Statement], depth: int) -> list[str]:
        return super().block(body, depth) or [f"{self.indent * depth}pass"]


def python_source(program: StepProgram) -> str:
    """The program as the text of a function ``step(p, s, u, y)``.

    Parameters
    ----------
    program : StepProgram
        A sampled program.

    Returns
    -------
    str
        The function alone; names of the C library such as ``fmin``, and ``zeros``, must be defined around it.
    """
    return "\n".join(["def step(p, s, u, y):", *PythonPrinter().block(program.body, 1), ""])


def python_step(program: StepProgram) -> Step:
    """The program as a function of parameters, states, inputs and outputs by name.

    Parameters
    ----------
    program : StepProgram
        A sampled program.

    Returns
    -------
    callable
        As described at `Step`.
    """
    scope: dict = {"tanh": math.tanh, "exp": math.exp, "log": math.log, "sqrt": math.sqrt, "sin": math.sin,
                   "cos": math.cos, "atan": math.atan, "fabs": abs, "floor": math.floor, "pow": math.pow,
                   "fmin": min, "fmax": max, "zeros": np.zeros}
    exec(compile(python_source(program), f"<{program.name}>", "exec"), scope)  # text printed above, from no file
    return scope["step"]


def run(program: StepProgram, inputs: np.ndarray) -> np.ndarray:
    """Outputs along (n, inputs) samples, by Python alone.

    Parameters
    ----------
    program : StepProgram
        A sampled program; it starts from the starts of its states.
    inputs : (n, inputs) array
        In the order and the units of the program's inputs.

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
