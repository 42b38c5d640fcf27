"""What printers of step programs share: a walk over statements, with the words of a language left open."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from lpvid.export.expression import (
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
from lpvid.export.step_program import Statement

LEVELS = {"or": 1, "and": 2, "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "neg": 7, "not": 7}
"""Binding strength of the operators, weakest first; the three languages agree on these."""
ATOM = 9


class Printer(ABC):
    """Statements and expressions as text of one language."""

    indent = "    "
    explicit = False
    """whether operators of different strength stand in parentheses beside each other (MISRA C:2012, rule 12.1)"""

    # -- a language's own words --------------------------------------------------------------------------------------
    @abstractmethod
    def number(self, value: float) -> str:
        """A real constant."""

    @abstractmethod
    def constant(self, value: ByPrecision) -> str:
        """A constant by precision."""

    @abstractmethod
    def scalar(self, symbol: Symbol) -> str:
        """A scalar by its home and name."""

    @abstractmethod
    def element(self, element: ArrayElement) -> str:
        """An entry of an array."""

    @abstractmethod
    def operator(self, operator: str) -> str:
        """The word for "and", "or", "not"."""

    @abstractmethod
    def function(self, name: str, arguments: Sequence[str]) -> str:
        """A call."""

    @abstractmethod
    def choice(self, condition: str, then: str, other: str) -> str:
        """One of two values."""

    @abstractmethod
    def rounded(self, value: str) -> str:
        """A whole real number as an index."""

    @abstractmethod
    def real(self, index: str) -> str:
        """An index as a real number."""

    @abstractmethod
    def lines(self, statement: Statement, depth: int) -> list[str]:
        """Lines of one statement; `block` prints those inside."""

    # -- settled here ------------------------------------------------------------------------------------------------
    def block(self, body: Sequence[Statement], depth: int) -> list[str]:
        """Lines of statements."""
        return [line for statement in body for line in self.lines(statement, depth)]

    def text(self, expr: Expr) -> str:
        """An expression."""
        return self._text(expr)[0]

    def index(self, index: Index) -> str:
        """An index."""
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
            return self.scalar(expr), ATOM
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
            word = "-" if expr.operator == "neg" else self.operator("not")
            return f"{word}{inner if bound > level else f'({inner})'}", level
        (left, a), (right, b) = (self._text(o) for o in expr.operands)
        logical = expr.operator in ("and", "or")
        word = self.operator(expr.operator) if logical else expr.operator
        bare = ("neg", "not")
        if logical or self.explicit:
            alike = not logical and _operator(expr.operands[0]) in (_PEERS.get(expr.operator, ()) + bare)
            left = left if a == ATOM or alike else f"({left})"
            right = right if b == ATOM or (not logical and _operator(expr.operands[1]) in bare) else f"({right})"
        else:
            left = left if a >= level else f"({left})"
            right = right if b > level else f"({right})"
        return f"{left} {word} {right}", level


_PEERS = {"+": ("+", "-"), "-": ("+", "-"), "*": ("*", "/"), "/": ("*", "/")}
"""Operators of one strength, which chain from the left."""


def _operator(expr: Expr) -> str:
    """The operator of an expression, "" for one that is none."""
    return expr.operator if isinstance(expr, Operation) else ""
