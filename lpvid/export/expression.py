"""Expressions of a step program: real numbers, indices and conditions, written with Python's own operators."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

from lpvid import _checks

FUNCTIONS = ("tanh", "exp", "log", "sqrt", "sin", "cos", "atan", "fabs", "floor", "pow", "fmin", "fmax")
"""Functions of the C library that a program may call; every printer has them."""


class Expr:
    """A value; ``+ − * /`` build real ones, comparisons build conditions, which ``& | ~`` combine."""

    def __add__(self, other: Expr | float) -> Expr:
        return Operation("+", (self, as_expr(other)))

    def __radd__(self, other: Expr | float) -> Expr:
        return Operation("+", (as_expr(other), self))

    def __sub__(self, other: Expr | float) -> Expr:
        return Operation("-", (self, as_expr(other)))

    def __rsub__(self, other: Expr | float) -> Expr:
        return Operation("-", (as_expr(other), self))

    def __mul__(self, other: Expr | float) -> Expr:
        return Operation("*", (self, as_expr(other)))

    def __rmul__(self, other: Expr | float) -> Expr:
        return Operation("*", (as_expr(other), self))

    def __truediv__(self, other: Expr | float) -> Expr:
        return Operation("/", (self, as_expr(other)))

    def __rtruediv__(self, other: Expr | float) -> Expr:
        return Operation("/", (as_expr(other), self))

    def __neg__(self) -> Expr:
        return Operation("neg", (self,))

    def __lt__(self, other: Expr | float) -> Expr:
        return Operation("<", (self, as_expr(other)))

    def __le__(self, other: Expr | float) -> Expr:
        return Operation("<=", (self, as_expr(other)))

    def __gt__(self, other: Expr | float) -> Expr:
        return Operation(">", (self, as_expr(other)))

    def __ge__(self, other: Expr | float) -> Expr:
        return Operation(">=", (self, as_expr(other)))

    def __and__(self, other: Expr) -> Expr:
        return Operation("and", (self, other))

    def __or__(self, other: Expr) -> Expr:
        return Operation("or", (self, other))

    def __invert__(self) -> Expr:
        return Operation("not", (self,))


@dataclass(frozen=True, eq=False)
class RealConstant(Expr):
    """A real constant.

    Attributes
    ----------
    value : float
        A printer in single precision rounds it.
    """

    value: float


@dataclass(frozen=True, eq=False)
class ByPrecision(Expr):
    """A constant that depends on the arithmetic, as a tolerance does.

    Attributes
    ----------
    double, single : float
        Its value in either arithmetic; languages with double alone print the first.
    """

    double: float
    single: float


@dataclass(frozen=True, eq=False)
class Symbol(Expr):
    """A scalar of the program by its home and name.

    Attributes
    ----------
    home : {"local", "input", "output", "state", "parameter", "rate"}
    name : str
    """

    home: str
    name: str


@dataclass(frozen=True, eq=False)
class Array:
    """An array of the program; indexing it gives an `Element`.

    Attributes
    ----------
    home : {"local", "state", "parameter", "rate"}
        Where it stands; a tangent program has homes with ``_tangent`` too.
    name : str
        Identifier in the program.
    shape : tuple of int
        Constant, one length per axis.
    """

    home: str
    name: str
    shape: tuple[int, ...]

    def __getitem__(self, index: Index | int | tuple[Index | int, ...]) -> ArrayElement:
        places = index if isinstance(index, tuple) else (index,)
        assert len(places) == len(self.shape), f"{self.name} has {len(self.shape)} axes"
        return ArrayElement(self, tuple(as_index(i) for i in places))


@dataclass(frozen=True, eq=False)
class ArrayElement(Expr):
    """One entry of an array.

    Attributes
    ----------
    array : Array
        Where the entry stands.
    index : tuple of Index
        One per axis, from zero.
    """

    array: Array
    index: tuple[Index, ...]


@dataclass(frozen=True, eq=False)
class Operation(Expr):
    """An operator applied to its operands.

    Attributes
    ----------
    operator : {"+", "-", "*", "/", "neg", "<", "<=", ">", ">=", "and", "or", "not"}
        "neg" and "not" have one operand, the others two.
    operands : tuple of Expr
        Left operand first.
    """

    operator: str
    operands: tuple[Expr, ...]


@dataclass(frozen=True, eq=False)
class Call(Expr):
    """A function of `FUNCTIONS`.

    Attributes
    ----------
    function : str
        One of `FUNCTIONS`, by its name in C.
    arguments : tuple of Expr
        In the order of C.
    """

    function: str
    arguments: tuple[Expr, ...]


@dataclass(frozen=True, eq=False)
class Select(Expr):
    """One of two values by a condition; both are defined either way.

    Attributes
    ----------
    condition : Expr
        A comparison, or comparisons combined.
    then, other : Expr
        Value where the condition holds, and where it does not.
    """

    condition: Expr
    then: Expr
    other: Expr


# -- indices ---------------------------------------------------------------------------------------------------------
class Index:
    """A whole number that picks an entry; constants may be added."""

    def __add__(self, other: int) -> Index:
        if isinstance(self, Place):
            return Place(self.value + other)
        base, by = (self.base, self.by + other) if isinstance(self, Offset) else (self, other)
        return Offset(base, by) if by else base

    def __sub__(self, other: int) -> Index:
        return self + (-other)


@dataclass(frozen=True, eq=False)
class Place(Index):
    """A constant place.

    Attributes
    ----------
    value : int
        Counted from zero.
    """

    value: int


@dataclass(frozen=True, eq=False)
class Counter(Index):
    """A loop's counter, or an index that statements set.

    Attributes
    ----------
    name : str
        Identifier in the program.
    """

    name: str


@dataclass(frozen=True, eq=False)
class Offset(Index):
    """An index moved by a constant.

    Attributes
    ----------
    base : Index
        No constant place and no offset of its own: constants are gathered.
    by : int
        Added to it; not zero.
    """

    base: Index
    by: int


@dataclass(frozen=True, eq=False)
class Rounded(Index):
    """A real value that is whole already, as an index.

    Attributes
    ----------
    value : Expr
        Whole by construction; languages differ in what they make of a fraction.
    """

    value: Expr


@dataclass(frozen=True, eq=False)
class Real(Expr):
    """An index as a real number.

    Attributes
    ----------
    index : Index
        Converted to the real type of the program.
    """

    index: Index


def parts(node: Expr | Index) -> Iterator[Expr | Index]:
    """A node and all nodes inside it.

    Parameters
    ----------
    node : Expr or Index

    Yields
    ------
    Expr or Index
        The node first, then what it is made of, from left to right.
    """
    yield node
    for field in fields(node):  # type: ignore[arg-type]
        value = getattr(node, field.name)
        for part in value if isinstance(value, tuple) else (value,):
            if isinstance(part, (Expr, Index)):
                yield from parts(part)


def as_expr(value: Expr | float) -> Expr:
    """A number as an expression; an expression as it is.

    Parameters
    ----------
    value : Expr or float
        A number becomes a `RealConstant`.

    Returns
    -------
    Expr
        Ready as an operand.
    """
    return value if isinstance(value, Expr) else RealConstant(float(value))


def as_index(value: Index | int) -> Index:
    """A number as an index; an index as it is.

    Parameters
    ----------
    value : Index or int
        A number becomes a `Place`.

    Returns
    -------
    Index
        Ready as a subscript.
    """
    return value if isinstance(value, Index) else Place(int(value))


def call(function: str, *arguments: Expr | float) -> Expr:
    """A function's value.

    Parameters
    ----------
    function : str
        One of `FUNCTIONS`.
    *arguments : Expr or float
        As many as the function has in C.

    Returns
    -------
    Call
        The function applied to them.

    Raises
    ------
    InputError
        Another function.

    Examples
    --------
    >>> call("tanh", 1.0).function
    'tanh'
    """
    _checks.one_of(function, FUNCTIONS, "a function of an exported step")
    return Call(function, tuple(as_expr(a) for a in arguments))


def select(condition: Expr, then: Expr | float, other: Expr | float) -> Expr:
    """`then` where the condition holds, else `other`.

    Parameters
    ----------
    condition : Expr
        A comparison, or comparisons combined.
    then, other : Expr or float
        Both must be computable whatever the condition.

    Returns
    -------
    Select
        The choice between them.
    """
    return Select(condition, as_expr(then), as_expr(other))


def clipped(value: Expr | float, low: Expr | float, high: Expr | float) -> Expr:
    """The value within [low, high].

    Parameters
    ----------
    value : Expr or float
        In the unit of the limits.
    low, high : Expr or float
        Limits; where low exceeds high, high is the result.

    Returns
    -------
    Expr
        ``fmin(fmax(value, low), high)``.
    """
    return call("fmin", call("fmax", value, low), high)
