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
    "log", "sqrt", "sin", "cos", "atan", "floor", "pow", "fmin", "fmax", "fabs", "power", "abs", "min", "max", "zeros",
    "choose"))
"""Words of C, Python and MATLAB, and names that the printers use themselves."""


class StepBuilder:
    """Writes a `StepProgram` statement by statement.

    Parameters
    ----------
    name : str
        Prefix of files and functions; made an identifier, with "_model" behind a word of `RESERVED`.
    description : str
        One line on what the program computes.
    sample_time : float
        Period of the step [s]; 0 for a continuous model.

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
        """A scalar input; one of the same name is the same input.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        unit : str
            SI; empty for a pure number.
        description : str
            Left out, the name.
        lower, upper : float
            Range in this unit, infinite where none is known; those of the first call hold.

        Returns
        -------
        Symbol
            The input as an operand.
        """
        known = next((q for q in self._inputs if q.label == name), None)
        return Symbol("input", (known or self._kept(self._inputs, name, 0.0, unit, description, lower, upper)).name)

    def output(self, name: str, value: Expr, unit: str = "", description: str = "") -> None:
        """A scalar output and its value at this sample.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        value : Expr
            Computed where this call stands among the statements.
        unit : str
            SI; empty for a pure number.
        description : str
            Left out, the name.
        """
        self.set(Symbol("output", self._kept(self._outputs, name, 0.0, unit, description).name), value)

    def state(self, name: str, unit: str = "", description: str = "", start: float = 0.0) -> Symbol:
        """A scalar state.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        unit : str
            SI; empty for a pure number.
        description : str
            Left out, the name.
        start : float
            Value before the first sample, in this unit: a number, not an expression of parameters, since a target
            sets its states before it computes.

        Returns
        -------
        Symbol
            The state, to read and to set.

        Raises
        ------
        InputError
            A start that is an expression.
        """
        if isinstance(start, Expr):
            raise InputError(f"the start of state '{name}' is a number", got=type(start).__name__,
                             mend="give the value itself, as in self.values, or choose by select(b.first(), ...)")
        return Symbol("state", self._kept(self._states, name, float(start), unit, description).name)

    def states(self, name: str, start: np.ndarray, unit: str = "", description: str = "") -> Array:
        """An array of states; it must not be empty.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        start : array
            Values before the first sample; its shape is that of the states.
        unit : str
            SI, of all entries; empty for pure numbers or mixed ones.
        description : str
            Left out, the name.

        Returns
        -------
        Array
            The states, to read and to set by index.
        """
        quantity = self._kept(self._states, name, start, unit, description)
        return Array("state", quantity.name, quantity.shape)

    def parameter(self, name: str, value: float, unit: str = "", description: str = "") -> Symbol:
        """A scalar parameter.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        value : float
            In this unit.
        unit : str
            SI; empty for a pure number.
        description : str
            Left out, the name.

        Returns
        -------
        Symbol
            The parameter as an operand.
        """
        return Symbol("parameter", self._kept(self._parameters, name, float(value), unit, description).name)

    def table(self, name: str, value: np.ndarray, unit: str = "", description: str = "") -> Array:
        """An array of parameters; it must not be empty.

        Parameters
        ----------
        name : str
            In the model; the identifier in the program may differ.
        value : array
            Its shape is that of the table.
        unit : str
            SI, of all entries; empty for pure numbers or mixed ones.
        description : str
            Left out, the name.

        Returns
        -------
        Array
            The parameters, to read by index.
        """
        quantity = self._kept(self._parameters, name, value, unit, description)
        return Array("parameter", quantity.name, quantity.shape)

    def _kept(self, group: list[Quantity], name: str, start: np.ndarray | float, unit: str, description: str,
              lower: float = -np.inf, upper: float = np.inf) -> Quantity:
        quantity = Quantity(self.fresh(name), unit, description or name, np.array(start, dtype=float), lower, upper,
                            name)
        group.append(quantity)
        return quantity

    def first(self) -> Expr:
        """The condition that this is the first sample.

        Returns
        -------
        Expr
            It reads a state that is added on the first call and set at the end of the step.
        """
        if self._started is None:
            self._started = self.state("started", "", "0 before the first sample, 1 after it")
        return self._started < 0.5

    def note(self, text: str) -> None:
        """A remark for the user of the program.

        Parameters
        ----------
        text : str
            A sentence; exports print it in their notes and in the files.
        """
        self._notes.append(text)

    # -- statements --------------------------------------------------------------------------------------------------
    def let(self, name: str, value: Expr | float) -> Symbol:
        """A local scalar with this value.

        Parameters
        ----------
        name : str
            Made an identifier that is free where this call stands.
        value : Expr or float
            First value; `set` and `add` change it later.

        Returns
        -------
        Symbol
            The local scalar.
        """
        symbol = Symbol("local", self.fresh(name))
        self._add(Declare(symbol, as_expr(value)))
        return symbol

    def array(self, name: str, *shape: int) -> Array:
        """A local array of zeros.

        Parameters
        ----------
        name : str
            Made an identifier that is free where this call stands.
        *shape : int
            Constant lengths of the axes, at least 1.

        Returns
        -------
        Array
            The local array, to read and to set by index.
        """
        array = Array("local", self.fresh(name), shape)
        self._add(DeclareArray(array))
        return array

    def index(self, name: str, value: Index | int = 0) -> Counter:
        """A local index.

        Parameters
        ----------
        name : str
            Made an identifier that is free where this call stands.
        value : Index or int
            First value, counted from zero; `set_index` changes it later.

        Returns
        -------
        Counter
            The local index, to use as a subscript.
        """
        counter = Counter(self.fresh(name))
        self._add(DeclareIndex(counter, as_index(value)))
        return counter

    def set(self, target: Symbol | ArrayElement, value: Expr | float) -> None:
        """A new value of a scalar or an entry.

        Parameters
        ----------
        target : Symbol or ArrayElement
            A local, a state or an output.
        value : Expr or float
            In the unit of the target.
        """
        self._add(Assign(target, as_expr(value)))

    def rate(self, state: Symbol | ArrayElement, value: Expr | float) -> None:
        """The time derivative of a state, in a program of a continuous model.

        Parameters
        ----------
        state : Symbol or ArrayElement
            As `state` or `states` returned it.
        value : Expr or float
            In the unit of the state per second.
        """
        place = Symbol("rate", state.name) if isinstance(state, Symbol) else ArrayElement(
            Array("rate", state.array.name, state.array.shape), state.index)
        self.set(place, value)

    def set_index(self, counter: Counter, value: Index | int) -> None:
        """A new value of an index.

        Parameters
        ----------
        counter : Counter
            As `index` returned it.
        value : Index or int
            Counted from zero.
        """
        self._add(AssignIndex(counter, as_index(value)))

    def add(self, target: Symbol | ArrayElement, value: Expr | float) -> None:
        """A value added to a scalar or an entry.

        Parameters
        ----------
        target : Symbol or ArrayElement
            A local, a state or an output.
        value : Expr or float
            In the unit of the target.
        """
        self.set(target, target + value)

    def remark(self, text: str) -> None:
        """A comment.

        Parameters
        ----------
        text : str
            One line, printed as a comment where this call stands.
        """
        self._add(Remark(text))

    @contextmanager
    def loop(self, name: str, last: int, first: int = 0, down: bool = False) -> Iterator[Index]:
        """Statements for an index from `first` to `last` − 1; one pass needs no loop.

        Parameters
        ----------
        name : str
            Of the counter; made an identifier that is free.
        last, first : int
            Constants; nothing is written where `last` does not exceed `first`.
        down : bool
            Whether the counter starts at `last` − 1 and falls to `first`.

        Yields
        ------
        Index
            The counter, or a constant place for a single pass. Names declared inside are free again behind the loop.
        """
        if last - first == 1:
            yield Place(first)
            return
        before = set(self._used)
        statement = LoopStatement(Counter(self.fresh(name)), first, last, down)
        self._blocks.append(statement.body)
        yield statement.counter
        self._blocks.pop()
        lasting = (self._inputs, self._outputs, self._states, self._parameters)
        self._used = before | {q.name for group in lasting for q in group}  # names of the block are free again
        if last > first and statement.body:
            self._add(statement)

    @contextmanager
    def when(self, condition: Expr) -> Iterator[None]:
        """Statements for where a condition holds.

        Parameters
        ----------
        condition : Expr
            A comparison, or comparisons combined.

        Yields
        ------
        None
            Statements written inside the block go into the branch.
        """
        statement = Branch(condition)
        self._blocks.append(statement.then)
        yield
        self._blocks.pop()
        self._add(statement)

    @contextmanager
    def otherwise(self) -> Iterator[None]:
        """Statements for where the condition of the `when` just before does not hold.

        Yields
        ------
        None
            Statements written inside the block go into the other branch.
        """
        statement = self._blocks[-1][-1]
        assert isinstance(statement, Branch)
        self._blocks.append(statement.other)
        yield
        self._blocks.pop()

    def sum(self, name: str, start: Expr | float = 0.0) -> Symbol:
        """A local scalar that is going to be added to.

        Parameters
        ----------
        name : str
            Made an identifier that is free where this call stands.
        start : Expr or float
            First term.

        Returns
        -------
        Symbol
            The local scalar, for `add`.
        """
        return self.let(name, start)

    def program(self) -> StepProgram:
        """What was written.

        Returns
        -------
        StepProgram
            Complete; called once, outside all loops and branches.
        """
        assert len(self._blocks) == 1
        if self._started is not None:
            self.set(self._started, 1.0)
        return StepProgram(self.name, self.description, self.sample_time, tuple(self._inputs), tuple(self._outputs),
                           tuple(self._states), tuple(self._parameters), tuple(self._blocks[0]), tuple(self._notes))

    def fresh(self, name: str) -> str:
        """An identifier that nothing else here has.

        Parameters
        ----------
        name : str
            Any text.

        Returns
        -------
        str
            As `identifier` writes it, with a number behind it where that is used already; from now on it is used.
        """
        base = identifier(name)
        found, count = base, 2
        while found in self._used:
            found, count = f"{base}_{count}", count + 1
        self._used.add(found)
        return found

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

    Parameters
    ----------
    name : str
        Any text.

    Returns
    -------
    str
        At most 40 characters, with an x in front of what does not begin with a letter.

    Examples
    --------
    >>> identifier("v_d [m/s]"), identifier("2nd"), identifier("δ"), identifier("Lpv-ARX 4")
    ('v_d_m_s', 'x2nd', 'x', 'Lpv_ARX_4')
    """
    text = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return text[:40].rstrip("_") if text[:1].isalpha() else f"x{text[:39]}".rstrip("_")
