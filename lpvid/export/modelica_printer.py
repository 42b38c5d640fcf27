"""Step programs as functions of Modelica: one sample, or the derivatives and outputs of a continuous model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import MappingProxyType

import numpy as np

from lpvid.export.expression import Array, ArrayElement, Counter, Index
from lpvid.export.printing import Printer, wrapped
from lpvid.export.step_program import Branch, LoopStatement, Quantity, Statement, StepProgram

WORDS = frozenset((
    "abs", "algorithm", "and", "annotation", "assert", "block", "break", "cardinality", "class", "connect",
    "connector", "constant", "constrainedby", "delay", "der", "discrete", "each", "else", "elseif", "elsewhen",
    "encapsulated", "end", "enumeration", "equation", "expandable", "extends", "external", "false", "fill", "final",
    "flow", "for", "function", "homotopy", "identity", "if", "import", "impure", "in", "initial", "inner", "input",
    "integer", "linspace", "loop", "matrix", "max", "min", "mod", "model", "noEvent", "not", "ones", "operator", "or",
    "outer", "output", "package", "parameter", "partial", "pre", "product", "protected", "public", "pure", "record",
    "redeclare", "rem", "replaceable", "return", "sample", "scalar", "sign", "size", "stream", "sum", "terminal",
    "terminate", "then", "time", "true", "type", "vector", "when", "while", "within", "zeros", "before", "after",
    "held", "states", "tested", "found", "samples", "error", "U", "X", "Y", "Block", "Check", "step"))
"""Keywords (Modelica 3.6, 2.3.3), built-in functions, and names that the functions printed here use themselves."""


class ModelicaPrinter(Printer):
    """Modelica inside one function, where every quantity is a local variable; indices count from one.

    A name that two blocks of a program declare with different shapes is two variables, since functions declare all
    of theirs at the top; `declared` lists them after `block`, and `conditional` those that first occur in a branch.
    """

    first_index = 1
    functions = MappingProxyType({"fabs": "abs", "fmin": "min", "fmax": "max"})
    assign, remark, when, otherwise = "{} := {}", "// {}", "if {} then", "else"
    closed, loop_closed = "end if;", "end for;"

    def __init__(self) -> None:
        self.declared: dict[str, str] = {}
        self.conditional: dict[str, str] = {}
        self._now: dict[str, str] = {}
        self._branches = 0

    def place(self, home: str, name: str) -> str:
        name = f"der_{name}" if home == "rate" else name
        return self._now.get(name, spelled(name)) if home == "local" else spelled(name)

    def element(self, element: ArrayElement) -> str:
        places = ", ".join(self.index(i + 1) for i in element.index)
        return f"{self.place(element.array.home, element.array.name)}[{places}]"

    def index(self, index: Index) -> str:
        return self._now.get(index.name, spelled(index.name)) if isinstance(index, Counter) else super().index(index)

    def function(self, name: str, arguments: Sequence[str]) -> str:
        if name == "pow":
            return f"(({arguments[0]})^({arguments[1]}))"
        return super().function(name, arguments)

    def choice(self, condition: str, then: str, other: str) -> str:
        return f"(if {condition} then {then} else {other})"

    def rounded(self, value: str) -> str:
        return f"integer({value})"

    def real(self, index: str) -> str:
        return f"({index})"

    def _declare(self, name: str, kind: str) -> str:
        """The variable for a local name from here on."""
        found, count = spelled(name), 2
        while self.declared.get(found, kind) != kind:
            found, count = f"{spelled(name)}_v{count}", count + 1
        self.declared[found] = kind
        self._now[name] = found
        if self._branches:
            self.conditional[found] = kind
        return found

    def declare(self, name: str, value: str) -> str:
        return f"{self._declare(name, 'Real')} := {value}"

    def declare_index(self, name: str, value: str) -> str:
        return f"{self._declare(name, 'Integer')} := {value}"

    def zeros(self, array: Array) -> str:
        shape = ", ".join(map(str, array.shape))
        return f"{self._declare(array.name, f'Real[{shape}]')} := zeros({shape})"

    def loop(self, counter: str, first: int, last: int, down: bool) -> str:
        return f"for {counter}_i in {f'{last - 1}:-1:{first}' if down else f'{first}:{last - 1}'} loop"

    def broken(self, line: str) -> list[str]:
        return wrapped(line)

    def lines(self, statement: Statement, depth: int) -> list[str]:
        if not isinstance(statement, LoopStatement):
            return super().lines(statement, depth)
        name, outside = statement.counter.name, self._now.get(statement.counter.name)
        self._now[name] = f"{name}_i"  # not the name of a local variable, which a block beside may declare
        out = super().lines(statement, depth)
        self._now.pop(name)
        if outside is not None:
            self._now[name] = outside
        return out

    def branch(self, statement: Branch, depth: int) -> list[str]:
        self._branches += 1
        out = super().branch(statement, depth)
        self._branches -= 1
        return out


def spelled(name: str) -> str:
    """A name that is no word of Modelica.

    Parameters
    ----------
    name : str
        Identifier of a step program.

    Returns
    -------
    str
        With an underscore behind a word of `WORDS`; any other as it is.

    Examples
    --------
    >>> spelled("force"), spelled("flow")
    ('force', 'flow_')
    """
    return f"{name}_" if name in WORDS else name


def literal(value: np.ndarray) -> str:
    """An array as nested braces, a scalar as a number.

    Parameters
    ----------
    value : array
        Of any number of axes.

    Returns
    -------
    str
        Numbers that are read back bit for bit.

    Examples
    --------
    >>> literal(np.array([[1.0, 2.0]])), literal(np.array(0.5))
    ('{{1.0, 2.0}}', '0.5')
    """
    return repr(float(value)) if value.ndim == 0 else "{" + ", ".join(literal(v) for v in value) + "}"


def description(text: str) -> str:
    """A comment string.

    Parameters
    ----------
    text : str
        Any text; backslashes are dropped, double quotes become single ones.

    Returns
    -------
    str
        Between double quotes, as it stands behind a declaration.
    """
    return '"' + text.replace("\\", "").replace('"', "'") + '"'


# -- one function ----------------------------------------------------------------------------------------------------
def step_function(program: StepProgram) -> list[str]:
    """A function of parameters, states and inputs that returns one vector: states or their derivatives, then outputs.

    One vector, since a function called in a when-clause returns one value in every tool.

    Parameters
    ----------
    program : StepProgram
        A period of 0 stands for a continuous model, whose function returns derivatives of the states.

    Returns
    -------
    list of str
        Lines of the function ``step``, from its head to its end.
    """
    printer = ModelicaPrinter()
    body = printer.block(program.body, 1)
    ahead = [("rate" if not program.sample_time and program.states else "state", q) for q in program.states]
    count, outputs = sum(q.start.size for q in program.states), len(program.outputs)
    out = ["function step " + description(program.description)]
    out += [f"    input Real {spelled(q.name)}{size_of(q)} {description(q.description)};" for q in program.parameters]
    width = count + outputs if program.sample_time else count
    out += [f"    input Real before[{width}] {description('what it returned before')};"] if count else []
    out += [f"    input Real {spelled(q.name)} {description(q.description)};" for q in program.inputs]
    what = "derivatives of the states, then outputs" if ahead and ahead[0][0] == "rate" else "states, then outputs"
    out += [f"    output Real after[{count + outputs}] {description(what)};", "protected"]
    out += [f"    Real {spelled(q.name)}{size_of(q)};" for q in (*program.states, *program.outputs)]
    out += [f"    Real {spelled('der_' + q.name)}{size_of(q)};" for home, q in ahead if home == "rate"]
    out += [f"    {kind.split('[')[0]} {name}{kind[len(kind.split('[')[0]):]};"
            for name, kind in printer.declared.items()]
    out += ["algorithm"]
    out += [f"    {_entry(spelled(q.name), at)} := before[{k}];" for k, (q, at) in _places(program.states)]
    out += [f"    {name} := {_zero(kind)};" for name, kind in printer.conditional.items()]  # a value on every way
    out += body
    out += [f"    after[{k}] := {_entry(spelled(('der_' if home == 'rate' else '') + q.name), at)};"
            for (k, (q, at)), home in zip(_places(program.states), _homes(ahead), strict=True)]
    out += [f"    after[{count + k}] := {spelled(q.name)};" for k, q in enumerate(program.outputs, 1)]
    return [*out, "end step;"]


def _zero(kind: str) -> str:
    name, _, shape = kind.partition("[")
    return f"zeros({shape[:-1]})" if shape else "0" if name == "Integer" else "0.0"


def _homes(ahead: Sequence[tuple[str, Quantity]]) -> list[str]:
    return [home for home, q in ahead for _ in range(q.start.size)]


def _places(states: Sequence[Quantity]) -> Iterator[tuple[int, tuple[Quantity, tuple[int, ...]]]]:
    """Every entry of the states with its place in the vector, from one."""
    yield from enumerate(((q, at) for q in states for at in np.ndindex(q.shape)), 1)


def _entry(name: str, at: tuple[int, ...]) -> str:
    return name + (f"[{', '.join(str(i + 1) for i in at)}]" if at else "")


def size_of(q: Quantity) -> str:
    """The dimensions of a quantity behind its name.

    Parameters
    ----------
    q : Quantity

    Returns
    -------
    str
        Empty for a number.
    """
    return f"[{', '.join(map(str, q.shape))}]" if q.shape else ""
