"""Tangents of step programs: directional derivatives by forward differentiation of every statement.

For a program y = f(x, u) the tangent program computes dy = (∂f/∂x) dx + (∂f/∂u) du beside y itself, exactly: the rules
of differentiation are applied to each expression (Griewank & Walther 2008, chapter 3). Parameters and indices count
as constants. At a kink (|·|, min, max, a branch) it is the derivative of the side that the program takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

from lpvid.errors import InputError
from lpvid.export.expression import (
    Array,
    ArrayElement,
    ByPrecision,
    Call,
    Counter,
    Expr,
    Index,
    Operation,
    Real,
    RealConstant,
    Select,
    Symbol,
    call,
    parts,
    select,
)
from lpvid.export.step_program import (
    Assign,
    Branch,
    Declare,
    DeclareArray,
    DeclareIndex,
    LoopStatement,
    Statement,
    StepProgram,
    walk,
)

HOMES = {"input": "input_tangent", "output": "output_tangent", "state": "state_tangent", "rate": "rate_tangent",
         "local": "local"}
"""Where the tangent of a variable stands; what stands elsewhere is constant."""
ZERO = RealConstant(0.0)


def tangent(program: StepProgram) -> StepProgram:
    """The program with, before every assignment, that of the tangent.

    Parameters
    ----------
    program : StepProgram

    Returns
    -------
    StepProgram
        Of the same quantities; its body writes the homes ``output_tangent`` and ``rate_tangent`` too, from
        ``input_tangent`` and ``state_tangent``.

    Raises
    ------
    InputError
        A power whose exponent moves.

    Examples
    --------
    >>> from lpvid.export.step_builder import StepBuilder
    >>> b = StepBuilder("decay", "a decay", 0.0)
    >>> x = b.state("level")
    >>> b.rate(x, -2.0 * x * x)
    >>> len(tangent(b.program()).body)
    2
    """
    body = Differentiation(program).body(program.body)
    while True:
        read = _read(body)
        kept = _pruned(body, read)
        if sum(1 for _ in walk(kept)) == sum(1 for _ in walk(body)):
            return replace(program, body=tuple(kept))
        body = kept


class Differentiation:
    """Statements and expressions of one program with their tangents.

    Parameters
    ----------
    program : StepProgram
        Its names and assignments decide which locals move and how tangents are named.
    """

    def __init__(self, program: StepProgram) -> None:
        taken = {s.symbol.name for s in walk(program.body) if isinstance(s, Declare)}
        taken |= {s.array.name for s in walk(program.body) if isinstance(s, DeclareArray)}
        taken |= {s.counter.name for s in walk(program.body) if isinstance(s, (DeclareIndex, LoopStatement))}
        self.prefix = MARK
        while any(f"{self.prefix}{name}" in taken for name in taken):
            self.prefix += "t_"
        self._moving: set[str] = set()
        while found := self._moved(program.body) - self._moving:
            self._moving |= found

    def _moved(self, body: Sequence[Statement]) -> set[str]:
        """Local names that depend on states or inputs, as far as is known by now."""
        found = {s.symbol.name for s in walk(body) if isinstance(s, Declare) and self.of(s.value) is not ZERO}
        return found | {_target(s)[1] for s in walk(body)
                        if isinstance(s, Assign) and _target(s)[0] == "local" and self.of(s.value) is not ZERO}

    def _moves(self, home: str, name: str) -> bool:
        return name in self._moving if home == "local" else home in HOMES

    def body(self, statements: Sequence[Statement]) -> list[Statement]:
        """Each statement behind its tangent, which reads the values before it.

        Parameters
        ----------
        statements : sequence of Statement
            Of the program, a loop or a branch.

        Returns
        -------
        list of Statement
            Constants have no tangent; loops and branches hold both kinds.
        """
        return [found for s in statements for found in self._statement(s)]

    def _statement(self, s: Statement) -> Iterator[Statement]:
        if isinstance(s, Declare) and s.symbol.name in self._moving:
            yield Declare(self._symbol(s.symbol), self.of(s.value))
        elif isinstance(s, DeclareArray) and s.array.name in self._moving:
            yield DeclareArray(self._array(s.array))
        elif isinstance(s, Assign) and self._moves(*_target(s)):
            target = self._symbol(s.target) if isinstance(s.target, Symbol) else self._element(s.target)
            yield Assign(target, self.of(s.value))
        if isinstance(s, LoopStatement):
            yield LoopStatement(s.counter, s.first, s.last, s.down, self.body(s.body))
        elif isinstance(s, Branch):
            yield Branch(s.condition, self.body(s.then), self.body(s.other))
        else:
            yield s

    def _symbol(self, symbol: Symbol) -> Symbol:
        name = self.prefix + symbol.name if symbol.home == "local" else symbol.name
        return Symbol(HOMES[symbol.home], name)

    def _array(self, array: Array) -> Array:
        name = self.prefix + array.name if array.home == "local" else array.name
        return Array(HOMES[array.home], name, array.shape)

    def _element(self, element: ArrayElement) -> ArrayElement:
        return ArrayElement(self._array(element.array), element.index)

    def of(self, expr: Expr) -> Expr:
        """The tangent of an expression; `ZERO` where it is constant.

        Parameters
        ----------
        expr : Expr
            A real expression; comparisons have none.

        Returns
        -------
        Expr
            It reads locals of both kinds and the homes of `HOMES`.
        """
        if isinstance(expr, (RealConstant, ByPrecision, Real)):
            return ZERO
        if isinstance(expr, Symbol):
            return self._symbol(expr) if self._moves(expr.home, expr.name) else ZERO
        if isinstance(expr, ArrayElement):
            return self._element(expr) if self._moves(expr.array.home, expr.array.name) else ZERO
        if isinstance(expr, Select):
            then, other = self.of(expr.then), self.of(expr.other)
            return ZERO if then is ZERO and other is ZERO else select(expr.condition, then, other)
        if isinstance(expr, Call):
            return self._call(expr)
        assert isinstance(expr, Operation)
        return self._operation(expr)

    def _operation(self, expr: Operation) -> Expr:
        a, da = expr.operands[0], self.of(expr.operands[0])
        if expr.operator == "neg":
            return _negative(da)
        b, db = expr.operands[1], self.of(expr.operands[1])
        if expr.operator == "+":
            return _sum(da, db)
        if expr.operator == "-":
            return _difference(da, db)
        if expr.operator == "*":
            return _sum(_product(da, b), _product(db, a))
        assert expr.operator == "/", expr.operator
        above = _difference(da, _product(db, a / b))
        return ZERO if above is ZERO else above / b

    def _call(self, expr: Call) -> Expr:
        a, da = expr.arguments[0], self.of(expr.arguments[0])
        if expr.function in ("fmin", "fmax"):
            b, db = expr.arguments[1], self.of(expr.arguments[1])
            if da is ZERO and db is ZERO:
                return ZERO
            return select(a <= b, da, db) if expr.function == "fmin" else select(a >= b, da, db)
        if expr.function == "pow" and self.of(expr.arguments[1]) is not ZERO:
            raise InputError("a power whose exponent moves has no exported derivative", got=expr.function)
        if da is ZERO or expr.function == "floor":
            return ZERO
        if expr.function != "pow":
            return SLOPES[expr.function](expr, a, da)
        exponent = expr.arguments[1]
        return exponent * call("pow", a, exponent - 1.0) * da


SLOPES: Mapping[str, Callable[[Expr, Expr, Expr], Expr]] = {
    "tanh": lambda f, a, da: (1.0 - f * f) * da,
    "exp": lambda f, a, da: f * da,
    "log": lambda f, a, da: da / a,
    "atan": lambda f, a, da: da / (1.0 + a * a),
    "sqrt": lambda f, a, da: da / (2.0 * f),
    "sin": lambda f, a, da: call("cos", a) * da,
    "cos": lambda f, a, da: -(call("sin", a) * da),
    "fabs": lambda f, a, da: select(a > 0.0, da, select(a < 0.0, -da, 0.0)),
}
"""Differentials of the functions f(a) of one argument."""
MARK = "d_"
"""before the names of local tangents"""


def _sum(a: Expr, b: Expr) -> Expr:
    return b if a is ZERO else a if b is ZERO else a + b


def _difference(a: Expr, b: Expr) -> Expr:
    return _negative(b) if a is ZERO else a if b is ZERO else a - b


def _negative(a: Expr) -> Expr:
    return ZERO if a is ZERO else -a


def _product(a: Expr, b: Expr) -> Expr:
    return ZERO if a is ZERO else a * b


# -- what nothing reads ----------------------------------------------------------------------------------------------
def _names(expr: Expr | Index) -> Iterator[str]:
    """Local names that an expression reads."""
    for part in parts(expr):
        if isinstance(part, Counter) or (isinstance(part, Symbol) and part.home == "local"):
            yield part.name
        elif isinstance(part, ArrayElement) and part.array.home == "local":
            yield part.array.name


def _target(s: Assign) -> tuple[str, str]:
    if isinstance(s.target, Symbol):
        return s.target.home, s.target.name
    return s.target.array.home, s.target.array.name


def _read(body: Sequence[Statement]) -> set[str]:
    """Local names that are read by anything but an assignment to themselves."""
    found: set[str] = set()
    for s in walk(body):
        if isinstance(s, Declare):
            found.update(_names(s.value))
        elif isinstance(s, Assign):
            home, name = _target(s)
            found.update(n for n in _names(s.value) if home != "local" or n != name)
            if isinstance(s.target, ArrayElement):
                found.update(n for i in s.target.index for n in _names(i))
        elif isinstance(s, Branch):
            found.update(_names(s.condition))
    return found


def _pruned(body: Sequence[Statement], read: set[str]) -> list[Statement]:
    """Without local values that nothing reads, and without loops and branches that are empty."""
    kept: list[Statement] = []
    for s in body:
        if isinstance(s, Declare) and s.symbol.name not in read:
            continue
        if isinstance(s, DeclareArray) and s.array.name not in read:
            continue
        if isinstance(s, Assign) and _target(s)[0] == "local" and _target(s)[1] not in read:
            continue
        if isinstance(s, LoopStatement):
            inside = _pruned(s.body, read)
            if inside:
                kept.append(LoopStatement(s.counter, s.first, s.last, s.down, inside))
        elif isinstance(s, Branch):
            then, other = _pruned(s.then, read), _pruned(s.other, read)
            if then or other:
                kept.append(Branch(s.condition, then, other))
        else:
            kept.append(s)
    return kept
