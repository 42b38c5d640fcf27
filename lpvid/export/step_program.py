"""StepProgram: one sample of a model or controller as statements, from which C, MATLAB and Python are printed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid.export.expression import Array, ArrayElement, Counter, Expr, Index, Symbol


@dataclass(frozen=True, eq=False)
class Quantity:
    """A named input, output, state or parameter.

    Attributes
    ----------
    name : str
        An identifier of C, Python and MATLAB.
    unit : str
        SI; empty for a pure number.
    description : str
        What it is.
    start : array
        Start of a state, value of a parameter, zero of an input; its shape is that of the quantity.
    lower, upper : float
        Range of an input, infinite where none is known.
    label : str
        The name in the model.
    """

    name: str
    unit: str
    description: str
    start: np.ndarray
    lower: float = -np.inf
    upper: float = np.inf
    label: str = ""

    @property
    def shape(self) -> tuple[int, ...]:
        """Empty for a scalar."""
        return self.start.shape


# -- statements ------------------------------------------------------------------------------------------------------
class Statement:
    """One instruction."""


@dataclass(frozen=True, eq=False)
class Declare(Statement):
    """A local scalar with its first value.

    Attributes
    ----------
    symbol : Symbol
        Of the home "local".
    value : Expr
        Computed where the statement stands.
    """

    symbol: Symbol
    value: Expr


@dataclass(frozen=True, eq=False)
class DeclareArray(Statement):
    """A local array of zeros.

    Attributes
    ----------
    array : Array
        Of the home "local".
    """

    array: Array


@dataclass(frozen=True, eq=False)
class DeclareIndex(Statement):
    """A local index with its first value.

    Attributes
    ----------
    counter : Counter
        No loop's counter.
    value : Index
        Counted from zero.
    """

    counter: Counter
    value: Index


@dataclass(frozen=True, eq=False)
class Assign(Statement):
    """A new value of a scalar or of an entry.

    Attributes
    ----------
    target : Symbol or ArrayElement
        A local, a state, an output or a rate.
    value : Expr
        It may read the target.
    """

    target: Symbol | ArrayElement
    value: Expr


@dataclass(frozen=True, eq=False)
class AssignIndex(Statement):
    """A new value of an index.

    Attributes
    ----------
    counter : Counter
        Of a `DeclareIndex`.
    value : Index
        Counted from zero.
    """

    counter: Counter
    value: Index


@dataclass(eq=False)
class LoopStatement(Statement):
    """Statements for counter = first … last − 1, or downwards from last − 1; both are constants.

    Attributes
    ----------
    counter : Counter
        Declared by the loop itself.
    first, last : int
        Ends, counted from zero.
    down : bool
        Whether it falls from last − 1 to first.
    body : list of Statement
        Executed for each value.
    """

    counter: Counter
    first: int
    last: int
    down: bool = False
    body: list[Statement] = field(default_factory=list)


@dataclass(eq=False)
class Branch(Statement):
    """Statements where a condition holds, and others where it does not.

    Attributes
    ----------
    condition : Expr
        A comparison, or comparisons combined.
    then, other : list of Statement
        Where it holds, and where it does not; `other` empty for no second branch.
    """

    condition: Expr
    then: list[Statement] = field(default_factory=list)
    other: list[Statement] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Remark(Statement):
    """A comment.

    Attributes
    ----------
    text : str
        One line, without the language's marks.
    """

    text: str


@dataclass(frozen=True, eq=False)
class StepProgram:
    """One sample: outputs y(k) and the states for k + 1 from states, inputs and parameters at k.

    Loops have constant bounds, so that the time of a step is bounded whatever the data.

    Attributes
    ----------
    name : str
        An identifier.
    description : str
        One line on what it computes.
    sample_time : float
        [s].
    inputs, outputs, states, parameters : tuple of Quantity
        Inputs and outputs are scalars.
    body : tuple of Statement
    notes : tuple of str
        Remarks for the user.
    """

    name: str
    description: str
    sample_time: float
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    states: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    body: tuple[Statement, ...]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        inputs, outputs = (", ".join(q.label or q.name for q in side) for side in (self.inputs, self.outputs))
        period = f"every {self.sample_time:g} s" if self.sample_time else "continuous"
        return (f"StepProgram {self.name}: {inputs} -> {outputs}; {len(self.states)} states, "
                f"{len(self.parameters)} parameters, {period}")

    def assigned(self) -> set[str]:
        """Names of local scalars that are assigned after their declaration.

        Returns
        -------
        set of str
            Loops and branches included; all other locals are constant.
        """
        return {s.target.name for s in walk(self.body) if isinstance(s, Assign) and isinstance(s.target, Symbol)
                and s.target.home == "local"}

    def operations(self) -> int:
        """Statements that one step executes at most.

        Returns
        -------
        int
            Declarations of scalars and indices, assignments and conditions; of a branch the longer side, of a loop all
            passes.
        """
        return _count(self.body)


def walk(body: Sequence[Statement]) -> Iterator[Statement]:
    """Every statement, those inside loops and branches included.

    Parameters
    ----------
    body : sequence of Statement
        Of a program, a loop or a branch.

    Yields
    ------
    Statement
        In the order of the text, a loop or branch before what is inside.
    """
    for statement in body:
        yield statement
        if isinstance(statement, LoopStatement):
            yield from walk(statement.body)
        elif isinstance(statement, Branch):
            yield from walk(statement.then)
            yield from walk(statement.other)


def _count(body: Sequence[Statement]) -> int:
    total = 0
    for s in body:
        if isinstance(s, LoopStatement):
            total += (s.last - s.first) * _count(s.body)
        elif isinstance(s, Branch):
            total += 1 + max(_count(s.then), _count(s.other))
        elif isinstance(s, (Declare, Assign, AssignIndex, DeclareIndex)):
            total += 1
    return total
