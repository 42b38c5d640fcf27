"""StepBuilder: writes step programs, statement by statement."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Array, ArrayElement, Counter, Expr, Index, Place, Symbol, as_expr, as_index
from lpvid.export.step_program import (
    Assign,
    AssignIndex,
    Branch,
    Declare,
    DeclareArray,
    DeclareIndex,
    LoopStatement,
    Quantity,
    Remark,
    Statement,
    StepProgram,
)

RESERVED = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
    "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
    "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "main",
    "and", "as", "assert", "class", "def", "del", "elif", "except", "finally", "from", "global", "import", "in",
    "is", "lambda", "None", "nonlocal", "not", "or", "pass", "raise", "try", "with", "yield", "True", "False",
    "end", "function", "otherwise", "until", "p", "s", "u", "y", "i", "j", "k", "pi", "math", "real", "tanh", "exp",
    "sqrt", "sin", "cos", "floor", "pow", "fmin", "fmax", "fabs", "power", "abs", "min", "max", "zeros", "choose"))
"""Words of C, Python and MATLAB, and names that the printers use themselves."""


class StepBuilder:
    """Writes a `StepProgram` statement by statement.

    Examples
    --------
    >>> b = StepBuilder("leak", "a leaking integrator", 0.1)
    >>> u, x, a = b.input("flow", "1/s"), b.state("level"), b.parameter("share", 0.5)
    >>> b.output("level_now", x)
    >>> b.set(x, a * x + u)
    >>> [s.name for s in b.program().states]
    ['level']
    """

    def __init__(self, name: str, description: str, sample_time: float) -> None:
        found = identifier(name)
        self.name = f"{found}_model" if found in RESERVED else found
        self.description, self.sample_time = description, sample_time
        self._used: set[str] = set(RESERVED)
        self._inputs: list[Quantity] = []
        self._outputs: list[Quantity] = []
        self._states: list[Quantity] = []
        self._parameters: list[Quantity] = []
        self._blocks: list[list[Statement]] = [[]]
        self._notes: list[str] = []
        self._started: Symbol | None = None

    # -- quantities --------------------------------------------------------------------------------------------------
    def input(
        self, name: str, unit: str = "", description: str = "", lower: float = -np.inf, upper: float = np.inf
    ) -> Symbol:
        """A scalar input; one of the same name is the same input."""
        known = next((q for q in self._inputs if q.label == name), None)
        if known is None:
            known = Quantity(self.fresh(name), unit, description or name, np.zeros(()), lower, upper, name)
            self._inputs.append(known)
        return Symbol("input", known.name)

    def output(self, name: str, value: Expr, unit: str = "", description: str = "") -> None:
        """A scalar output and its value at this sample."""
        quantity = Quantity(self.fresh(name), unit, description or name, np.zeros(()), label=name)
        self._outputs.append(quantity)
        self.set(Symbol("output", quantity.name), value)

    def state(self, name: str, unit: str = "", description: str = "", start: float = 0.0) -> Symbol:
        """A scalar state."""
        quantity = Quantity(self.fresh(name), unit, description or name, np.array(float(start)), label=name)
        self._states.append(quantity)
        return Symbol("state", quantity.name)

    def states(self, name: str, start: np.ndarray, unit: str = "", description: str = "") -> Array:
        """An array of states; it must not be empty."""
        quantity = Quantity(self.fresh(name), unit, description or name, np.array(start, dtype=float), label=name)
        self._states.append(quantity)
        return Array("state", quantity.name, quantity.shape)

    def parameter(self, name: str, value: float, unit: str = "", description: str = "") -> Symbol:
        """A scalar parameter."""
        quantity = Quantity(self.fresh(name), unit, description or name, np.array(float(value)), label=name)
        self._parameters.append(quantity)
        return Symbol("parameter", quantity.name)

    def table(self, name: str, value: np.ndarray, unit: str = "", description: str = "") -> Array:
        """An array of parameters; it must not be empty."""
        quantity = Quantity(self.fresh(name), unit, description or name, np.array(value, dtype=float), label=name)
        self._parameters.append(quantity)
        return Array("parameter", quantity.name, quantity.shape)

    def first(self) -> Expr:
        """The condition that this is the first sample."""
        if self._started is None:
            self._started = self.state("started", "", "0 before the first sample, 1 after it")
        return self._started < 0.5

    def note(self, text: str) -> None:
        """A remark for the user of the program."""
        self._notes.append(text)

    # -- statements --------------------------------------------------------------------------------------------------
    def let(self, name: str, value: Expr | float) -> Symbol:
        """A local scalar with this value."""
        symbol = Symbol("local", self.fresh(name))
        self._add(Declare(symbol, as_expr(value)))
        return symbol

    def array(self, name: str, *shape: int) -> Array:
        """A local array of zeros."""
        array = Array("local", self.fresh(name), shape)
        self._add(DeclareArray(array))
        return array

    def index(self, name: str, value: Index | int = 0) -> Counter:
        """A local index."""
        counter = Counter(self.fresh(name))
        self._add(DeclareIndex(counter, as_index(value)))
        return counter

    def set(self, target: Symbol | ArrayElement, value: Expr | float) -> None:
        """A new value of a scalar or an entry."""
        self._add(Assign(target, as_expr(value)))

    def rate(self, state: Symbol | ArrayElement, value: Expr | float) -> None:
        """The time derivative of a state, in a program of a continuous model."""
        place = Symbol("rate", state.name) if isinstance(state, Symbol) else ArrayElement(
            Array("rate", state.array.name, state.array.shape), state.index)
        self.set(place, value)

    def set_index(self, counter: Counter, value: Index | int) -> None:
        """A new value of an index."""
        self._add(AssignIndex(counter, as_index(value)))

    def add(self, target: Symbol | ArrayElement, value: Expr | float) -> None:
        """A value added to a scalar or an entry."""
        self.set(target, target + value)

    def remark(self, text: str) -> None:
        """A comment."""
        self._add(Remark(text))

    @contextmanager
    def loop(self, name: str, last: int, first: int = 0, down: bool = False) -> Iterator[Index]:
        """Statements for an index from `first` to `last` − 1; one pass needs no loop."""
        if last - first == 1:
            yield Place(first)
            return
        before = set(self._used)
        statement = LoopStatement(Counter(self.fresh(name)), first, last, down)
        self._blocks.append(statement.body)
        yield statement.counter
        self._blocks.pop()
        self._used = before | self._lasting()  # names of the block are free again
        if last > first and statement.body:
            self._add(statement)

    @contextmanager
    def when(self, condition: Expr) -> Iterator[None]:
        """Statements for where a condition holds."""
        statement = Branch(condition)
        self._blocks.append(statement.then)
        yield
        self._blocks.pop()
        self._add(statement)

    @contextmanager
    def otherwise(self) -> Iterator[None]:
        """Statements for where the condition of the `when` just before does not hold."""
        statement = self._blocks[-1][-1]
        assert isinstance(statement, Branch)
        self._blocks.append(statement.other)
        yield
        self._blocks.pop()

    def sum(self, name: str, start: Expr | float = 0.0) -> Symbol:
        """A local scalar that is going to be added to."""
        return self.let(name, start)

    def program(self) -> StepProgram:
        """What was written."""
        assert len(self._blocks) == 1
        if self._started is not None:
            self.set(self._started, 1.0)
        return StepProgram(self.name, self.description, self.sample_time, tuple(self._inputs), tuple(self._outputs),
                           tuple(self._states), tuple(self._parameters), tuple(self._blocks[0]), tuple(self._notes))

    def fresh(self, name: str) -> str:
        """An identifier that nothing else here has."""
        base = identifier(name)
        found, count = base, 2
        while found in self._used:
            found, count = f"{base}_{count}", count + 1
        self._used.add(found)
        return found

    def _lasting(self) -> set[str]:
        return {q.name for group in (self._inputs, self._outputs, self._states, self._parameters) for q in group}

    def _add(self, statement: Statement) -> None:
        self._blocks[-1].append(statement)


def checked_name(name: str) -> str:
    """A prefix that a user gave, as it is.

    Parameters
    ----------
    name : str

    Returns
    -------
    str

    Raises
    ------
    InputError
        One that C, Python and MATLAB would not all take; empty is allowed, and leaves it to the exporter.

    Examples
    --------
    >>> checked_name("my_damper"), checked_name("")
    ('my_damper', '')
    """
    if name and identifier(name) != name:
        raise InputError("a name for exported files and functions has letters, digits and single underscores, a "
                         "letter first, and at most 40 characters", got=f"'{name}'", mend=f"--name {identifier(name)}")
    return name


def identifier(name: str) -> str:
    """A name as C, Python and MATLAB take it: letters, digits and single underscores, a letter first.

    Examples
    --------
    >>> identifier("v_d [m/s]"), identifier("2nd"), identifier("δ"), identifier("Lpv-ARX 4")
    ('v_d_m_s', 'x2nd', 'x', 'Lpv_ARX_4')
    """
    text = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return text[:40].rstrip("_") if text[:1].isalpha() else f"x{text[:39]}".rstrip("_")
