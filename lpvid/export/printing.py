"""What printers of step programs share: a walk over statements, with the words of a language left open."""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from lpvid.export.expression import (
    Array,
    ArrayElement,
    ByPrecision,
    Call,
    Counter,
    Expr,
    Index,
    Offset,
    Operation,
    Place,
    Real,
    RealConstant,
    Rounded,
    Select,
    Symbol,
)
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
)

LEVELS = {"or": 1, "and": 2, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "neg": 7, "not": 7}
"""Binding strength of the operators, weakest first; the three languages agree on these."""
ATOM = 9


class Printer(ABC):
    """Statements and expressions as text of one language."""

    indent = "    "
    explicit = False
    """whether operators of different strength stand in parentheses beside each other (MISRA C:2012, rule 12.1)"""
    first_index = 0
    words: Mapping[str, str] = {}
    """of "and", "or", "not", where the language has others"""
    functions: Mapping[str, str] = {}
    """names of functions that are not those of C"""
    assign, end, remark = "{} = {}", ";", "{}"
    when, otherwise, closed, loop_closed = "", "", "", ""
    """a branch's lines, and the last one of a loop; empty where there is none"""

    # -- a language's own words --------------------------------------------------------------------------------------
    @abstractmethod
    def place(self, home: str, name: str) -> str:
        """A scalar or an array by its home and name.

        Parameters
        ----------
        home, name : str

        Returns
        -------
        str
        """

    @abstractmethod
    def choice(self, condition: str, then: str, other: str) -> str:
        """One of two values.

        Parameters
        ----------
        condition, then, other : str
            Expressions of the language: a condition, and the value where it holds and where it does not.

        Returns
        -------
        str
            An expression that needs no parentheses around it.
        """

    @abstractmethod
    def rounded(self, value: str) -> str:
        """A whole real number as an index.

        Parameters
        ----------
        value : str
            A real expression that is whole.

        Returns
        -------
        str
            An expression that may stand as a subscript.
        """

    @abstractmethod
    def real(self, index: str) -> str:
        """An index as a real number.

        Parameters
        ----------
        index : str
            An expression of whole numbers.

        Returns
        -------
        str
            A real expression that needs no parentheses around it.
        """

    @abstractmethod
    def zeros(self, array: Array) -> str:
        """The statement that declares an array.

        Parameters
        ----------
        array : Array

        Returns
        -------
        str
        """

    @abstractmethod
    def loop(self, counter: str, first: int, last: int, down: bool) -> str:
        """The first line of a loop over counter = first … last − 1, or down from there.

        Parameters
        ----------
        counter : str
        first, last : int
        down : bool

        Returns
        -------
        str
        """

    # -- alike in most languages -------------------------------------------------------------------------------------
    def number(self, value: float) -> str:
        """A real constant.

        Parameters
        ----------
        value : float
            Finite number.

        Returns
        -------
        str
            Digits that are read back bit for bit in the arithmetic of the program.
        """
        return repr(float(value))

    def constant(self, value: ByPrecision) -> str:
        """A constant by precision.

        Parameters
        ----------
        value : ByPrecision
            Its values in double and in single precision.

        Returns
        -------
        str
            The one of the program's arithmetic, as `number` writes it.
        """
        return self.number(value.double)

    def element(self, element: ArrayElement) -> str:
        """An entry of an array.

        Parameters
        ----------
        element : ArrayElement

        Returns
        -------
        str
        """
        places = ", ".join(self.index(i + self.first_index) for i in element.index)
        return f"{self.place(element.array.home, element.array.name)}({places})"

    def function(self, name: str, arguments: Sequence[str]) -> str:
        """A call.

        Parameters
        ----------
        name : str
            One of `lpvid.export.expression.FUNCTIONS`.
        arguments : sequence of str
            Expressions of the language.

        Returns
        -------
        str
            By the language's own name of the function, from `functions`.
        """
        return f"{self.functions.get(name, name)}({', '.join(arguments)})"

    def declare(self, name: str, value: str) -> str:
        """The statement that declares a local scalar with its first value.

        Parameters
        ----------
        name, value : str

        Returns
        -------
        str
        """
        return self.assign.format(name, value)

    def declare_index(self, name: str, value: str) -> str:
        """The statement that declares an index with its first value.

        Parameters
        ----------
        name, value : str

        Returns
        -------
        str
        """
        return self.assign.format(name, value)

    def broken(self, line: str) -> list[str]:
        """A line, broken as the language has long ones.

        Parameters
        ----------
        line : str

        Returns
        -------
        list of str
        """
        return [line]

    def lines(self, statement: Statement, depth: int) -> list[str]:
        """Lines of one statement; `block` prints those inside.

        Parameters
        ----------
        statement : Statement
        depth : int
            Of indentation.

        Returns
        -------
        list of str
        """
        pad = self.indent * depth
        if isinstance(statement, LoopStatement):
            head = self.loop(statement.counter.name, statement.first, statement.last, statement.down)
            return [pad + head, *self.block(statement.body, depth + 1), *self._last(pad, self.loop_closed)]
        if isinstance(statement, Branch):
            return self.branch(statement, depth)
        if isinstance(statement, Remark):
            return [pad + self.remark.format(statement.text)]
        if isinstance(statement, Declare):
            text = self.declare(statement.symbol.name, self.text(statement.value))
        elif isinstance(statement, DeclareArray):
            text = self.zeros(statement.array)
        elif isinstance(statement, DeclareIndex):
            text = self.declare_index(statement.counter.name, self.index(statement.value))
        elif isinstance(statement, AssignIndex):
            text = self.assign.format(self.index(statement.counter), self.index(statement.value))
        else:
            assert isinstance(statement, Assign)
            text = self.assign.format(self.text(statement.target), self.text(statement.value))
        return self.broken(f"{pad}{text}{self.end}")

    def branch(self, statement: Branch, depth: int) -> list[str]:
        """Lines of a branch.

        Parameters
        ----------
        statement : Branch
        depth : int
            Of indentation.

        Returns
        -------
        list of str
        """
        pad = self.indent * depth
        out = [*self.broken(pad + self.when.format(self.text(statement.condition))),
               *self.block(statement.then, depth + 1)]
        if statement.other:
            out += [pad + self.otherwise, *self.block(statement.other, depth + 1)]
        return [*out, *self._last(pad, self.closed)]

    @staticmethod
    def _last(pad: str, word: str) -> list[str]:
        return [pad + word] if word else []

    # -- settled here ------------------------------------------------------------------------------------------------
    def block(self, body: Sequence[Statement], depth: int) -> list[str]:
        """Lines of statements.

        Parameters
        ----------
        body : sequence of Statement
        depth : int
            Of indentation.

        Returns
        -------
        list of str
        """
        return [line for statement in body for line in self.lines(statement, depth)]

    def text(self, expr: Expr) -> str:
        """An expression.

        Parameters
        ----------
        expr : Expr
            A real value or a condition.

        Returns
        -------
        str
            With the parentheses that precedence or the language's rule needs.
        """
        return self._text(expr)[0]

    def index(self, index: Index) -> str:
        """An index.

        Parameters
        ----------
        index : Index
            Counted from zero.

        Returns
        -------
        str
            Counted from zero too; `element` adds the language's first index.
        """
        if isinstance(index, Place):
            return str(index.value)
        if isinstance(index, Counter):
            return index.name
        if isinstance(index, Offset):
            return f"{self.index(index.base)} {'+' if index.by > 0 else '-'} {abs(index.by)}"
        assert isinstance(index, Rounded)
        return self.rounded(self.text(index.value))

    def _text(self, expr: Expr) -> tuple[str, int]:
        if isinstance(expr, RealConstant):
            return self.number(expr.value), ATOM if expr.value >= 0 else LEVELS["neg"]
        if isinstance(expr, ByPrecision):
            return self.constant(expr), ATOM
        if isinstance(expr, Symbol):
            return self.place(expr.home, expr.name), ATOM
        if isinstance(expr, ArrayElement):
            return self.element(expr), ATOM
        if isinstance(expr, Call):
            return self.function(expr.function, [self.text(a) for a in expr.arguments]), ATOM
        if isinstance(expr, Select):
            return self.choice(self.text(expr.condition), self.text(expr.then), self.text(expr.other)), ATOM
        if isinstance(expr, Real):
            return self.real(self.index(expr.index)), ATOM
        assert isinstance(expr, Operation)
        return self._operation(expr)

    def _operation(self, expr: Operation) -> tuple[str, int]:
        level = LEVELS[expr.operator]
        if expr.operator in ("neg", "not"):
            inner, bound = self._text(expr.operands[0])
            word = "-" if expr.operator == "neg" else self.words.get("not", "not ")
            return f"{word}{inner if bound > level else f'({inner})'}", level
        (left, a), (right, b) = (self._text(o) for o in expr.operands)
        logical = expr.operator in ("and", "or")
        word = self.words.get(expr.operator, expr.operator)
        bare = ("neg", "not")
        if logical or self.explicit:
            alike = not logical and _operator(expr.operands[0]) in (_PEERS.get(expr.operator, ()) + bare)
            left = left if a == ATOM or alike else f"({left})"
            right = right if b == ATOM or (not logical and _operator(expr.operands[1]) in bare) else f"({right})"
        else:
            left = left if a >= level else f"({left})"
            right = right if b > level else f"({right})"
        return f"{left} {word} {right}", level


def wrapped(line: str) -> list[str]:
    """A long line broken at spaces.

    Parameters
    ----------
    line : str
        With its indentation.

    Returns
    -------
    list of str
        Lines of at most 110 characters where spaces allow it; those after the first are indented by four more.
    """
    start = " " * (len(line) - len(line.lstrip()))
    return textwrap.wrap(line.strip(), 110, initial_indent=start, subsequent_indent=start + "    ",
                         break_long_words=False, break_on_hyphens=False)


_PEERS = {"+": ("+", "-"), "-": ("+", "-"), "*": ("*", "/"), "/": ("*", "/")}
"""Operators of one strength, which chain from the left."""


def _operator(expr: Expr) -> str:
    """The operator of an expression, "" for one that is none."""
    return expr.operator if isinstance(expr, Operation) else ""
