"""Mathematical expressions as plain data for typesetting, and their abbreviation to a readable size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast


@dataclass(frozen=True)
class Constant:
    """A number."""

    value: float


@dataclass(frozen=True)
class Symbol:
    """A named quantity.

    Attributes
    ----------
    name : in the model.
    entry : index in an array, from 1.
    dots : number of time derivatives.
    mark : superscript: a prime if an effect alters the quantity, "late" if it is delayed, "read" for a sensor's
        reading.
    """

    name: str
    entry: tuple[int, ...] = ()
    dots: int = 0
    mark: str = ""


@dataclass(frozen=True)
class Sum:
    """Terms, each with whether it is subtracted; `left_out` is the number of terms omitted before the last."""

    terms: tuple[tuple[bool, Expression], ...]
    left_out: int = 0


@dataclass(frozen=True)
class Product:
    """Factors."""

    factors: tuple[Expression, ...]


@dataclass(frozen=True)
class Quotient:
    """A fraction."""

    above: Expression
    below: Expression


@dataclass(frozen=True)
class Power:
    """A base and its exponent."""

    base: Expression
    exponent: Expression


@dataclass(frozen=True)
class Call:
    """A function of arguments: "sin", "max", "abs", "sqrt" ..."""

    name: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True)
class Comparison:
    """Two sides and the sign between them: <, ≤, =, ≠, "and", "or"."""

    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Cases:
    """A value under a condition, and otherwise another."""

    where: Expression
    value: Expression
    otherwise: Expression


@dataclass(frozen=True)
class Window:
    """The weighted sum of a signal's last samples; the last weight belongs to the newest sample.

    Attributes
    ----------
    weights : symbol whose last index runs over the window.
    signal : expression whose samples are summed.
    length : in samples.
    """

    weights: Symbol
    signal: Expression
    length: int


SHIFTED = "shifted"
"""Name of the function that delays a quantity by a time."""

Expression = Constant | Symbol | Sum | Product | Quotient | Power | Call | Comparison | Cases | Window


@dataclass(frozen=True)
class Equation:
    """Left and right side of an equation."""

    left: Symbol
    right: Expression


_PARTS: Mapping[type[Any], tuple[str, ...]] = {
    Quotient: ("above", "below"), Power: ("base", "exponent"), Comparison: ("left", "right"),
    Cases: ("where", "value", "otherwise"), Window: ("signal",),
}  # fmt: skip
"""Kind of expression with a fixed number of parts -> names of its parts."""


def children(of: Expression) -> tuple[Expression, ...]:
    """The parts of an expression."""
    match of:
        case Sum(terms):
            return tuple(term for _, term in terms)
        case Product(factors):
            return factors
        case Call(_, arguments):
            return arguments
    return tuple(getattr(of, name) for name in _PARTS.get(type(of), ()))


def with_children(of: Expression, new: tuple[Expression, ...]) -> Expression:
    """The same expression with other parts."""
    match of:
        case Sum(terms):
            return replace(of, terms=tuple((minus, item) for (minus, _), item in zip(terms, new, strict=True)))
        case Product():
            return Product(new)
        case Call():
            return replace(of, arguments=new)
    parts = dict(zip(_PARTS.get(type(of), ()), new, strict=True))
    return replace(cast(Any, of), **parts) if parts else of


def symbols(of: Expression) -> Iterator[Symbol]:
    """All symbols in an expression."""
    if isinstance(of, Symbol):
        yield of
    if isinstance(of, Window):
        yield of.weights
    for child in children(of):
        yield from symbols(child)


def added(one: Expression, other: Expression, minus: bool = False) -> Expression:
    """A sum or difference; sums among its terms are flattened."""
    first = one.terms if isinstance(one, Sum) else ((False, one),)
    second = other.terms if isinstance(other, Sum) else ((False, other),)
    return Sum((*map(_unsigned, first), *(_unsigned((sign != minus, term)) for sign, term in second)))


def multiplied(one: Expression, other: Expression) -> Expression:
    """A product with its sign in front; quotients are kept together."""
    negative = _is_negative(one) != _is_negative(other)
    one, other = _positive(one), _positive(other)
    if isinstance(one, Constant) and one.value == 1.0:
        expression: Expression = other
    elif isinstance(other, Constant) and other.value == 1.0:
        expression = one
    else:
        if isinstance(other, Constant):
            one, other = other, one
        factors = tuple(
            factor for item in (one, other) for factor in (item.factors if isinstance(item, Product) else (item,))
        )
        expression = Product(factors)
    return Sum(((True, expression),)) if negative else expression


def divided(one: Expression, other: Expression) -> Expression:
    """A quotient with its sign in front."""
    quotient = Quotient(_positive(one), _positive(other))
    return Sum(((True, quotient),)) if _is_negative(one) != _is_negative(other) else quotient


def _is_negative(expression: Expression) -> bool:
    if isinstance(expression, Constant):
        return expression.value < 0
    return isinstance(expression, Sum) and len(expression.terms) == 1 and expression.terms[0][0]


def _positive(expression: Expression) -> Expression:
    if not _is_negative(expression):
        return expression
    if isinstance(expression, Constant):
        return Constant(-expression.value)
    assert isinstance(expression, Sum)
    return expression.terms[0][1]


def _unsigned(term: tuple[bool, Expression]) -> tuple[bool, Expression]:
    minus, value = term
    return (not minus, _positive(value)) if _is_negative(value) else (minus, value)


LARGE = 7
"""Least number of parts of an expression for an abbreviation."""
MOST_TERMS, SHOWN = 8, 3
"""Longer sums are shown by this many first terms and the last one."""
LETTER = "w"
MOST = 60
"""Most equations; the report gives the number of those left out."""


def readable(equations: Sequence[Equation]) -> tuple[tuple[Equation, ...], int]:
    """The same equations, each followed by definitions of its abbreviations, and the number of definitions left out."""
    return _Shortened(equations).found()


class _Shortened:
    def __init__(self, equations: Sequence[Equation]) -> None:
        self._equations = equations
        self._sizes: dict[Expression, int] = {}
        self._uses: Counter[Expression] = Counter()
        self._letters: dict[Expression, Symbol] = {}
        self._made: list[Equation] = []
        self._defined = 0
        self._left_out = 0
        seen: set[Expression] = set()
        for equation in equations:
            self._count(equation.right, seen)

    def found(self) -> tuple[tuple[Equation, ...], int]:
        """Equations in order; each definition follows the first equation that uses it."""
        for equation in self._equations:
            self._add(Equation(equation.left, self._inside(equation.right)), equation.right)
        return tuple(self._made), self._left_out

    def _add(self, equation: Equation, original: Expression) -> None:
        waiting = self._waiting_in(original)
        self._made.append(equation)
        for item in waiting:
            if len(self._made) >= MOST:
                self._left_out += 1
                continue
            self._add(Equation(self._letters[item], self._inside(item)), item)

    def _waiting_in(self, original: Expression) -> list[Expression]:
        """Expressions that were abbreviated while this one was written, in order of appearance."""
        new = [item for item in list(self._letters)[self._defined :] if item != original]
        self._defined = len(self._letters)
        return new

    def _count(self, of: Expression, seen: set[Expression]) -> int:
        self._uses[of] += 1
        if of in seen:
            return self._sizes[of]
        seen.add(of)
        self._sizes[of] = 1 + sum(self._count(child, seen) for child in children(of))
        return self._sizes[of]

    def _inside(self, of: Expression) -> Expression:
        """An expression with its larger, repeated parts abbreviated."""
        if isinstance(of, Sum) and len(of.terms) > MOST_TERMS:
            kept = (*of.terms[:SHOWN], of.terms[-1])
            of_kept = tuple((minus, self._written(item)) for minus, item in kept)
            return Sum(of_kept, left_out=len(of.terms) - len(kept))
        return with_children(of, tuple(self._written(child) for child in children(of)))

    def _written(self, of: Expression) -> Expression:
        repeated = self._uses[of] > 1 and self._sizes[of] >= LARGE
        long = isinstance(of, Sum) and len(of.terms) > MOST_TERMS
        if repeated or long or isinstance(of, Cases | Window):
            if of not in self._letters:
                self._letters[of] = Symbol(f"{LETTER}_{len(self._letters) + 1}")
            return self._letters[of]
        return self._inside(of)
