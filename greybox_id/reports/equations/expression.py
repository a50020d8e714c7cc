"""Mathematical expressions as plain data, ready to be typeset."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Constant:
    """A number."""

    value: float


@dataclass(frozen=True)
class Symbol:
    """A named quantity.

    Attributes
    ----------
    name : as the model calls it.
    entry : place in an array, from 1.
    dots : derivatives by time.
    mark : what stands at its upper right: a prime where an effect alters it, "late", or "read" by a sensor.
    """

    name: str
    entry: tuple[int, ...] = ()
    dots: int = 0
    mark: str = ""


@dataclass(frozen=True)
class Sum:
    """Terms, each with whether it is subtracted; `left_out` counts those that are not shown before the last."""

    terms: tuple[tuple[bool, Expression], ...]
    left_out: int = 0


@dataclass(frozen=True)
class Product:
    """Factors."""

    factors: tuple[Expression, ...]


@dataclass(frozen=True)
class Quotient:
    """One over the other."""

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
    """Two sides and what is between them: <, ≤, =, ≠, "and", "or"."""

    sign: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Cases:
    """Values where a condition holds, and elsewhere."""

    where: Expression
    value: Expression
    otherwise: Expression


@dataclass(frozen=True)
class Window:
    """The sum of a signal's last samples times weights, newest with the last weight.

    Attributes
    ----------
    weights : symbol whose last entry runs over the window.
    signal : what the window looks at.
    length : samples.
    """

    weights: Symbol
    signal: Expression
    length: int


SHIFTED = "shifted"
"""The function of a quantity and a time: what the quantity was so long ago."""

Expression = Constant | Symbol | Sum | Product | Quotient | Power | Call | Comparison | Cases | Window


@dataclass(frozen=True)
class Equation:
    """A left side and what it equals."""

    left: Symbol
    right: Expression


def children(of: Expression) -> tuple[Expression, ...]:
    """What an expression is made of."""
    match of:
        case Sum(terms):
            return tuple(term for _, term in terms)
        case Product(factors):
            return factors
        case Quotient(above, below):
            return (above, below)
        case Power(base, exponent):
            return (base, exponent)
        case Call(_, arguments):
            return arguments
        case Comparison(_, left, right):
            return (left, right)
        case Cases(where, value, otherwise):
            return (where, value, otherwise)
        case Window(_, signal, _):
            return (signal,)
    return ()


def with_children(of: Expression, new: tuple[Expression, ...]) -> Expression:
    """The same expression of other parts."""
    match of:
        case Sum(terms):
            return replace(of, terms=tuple((minus, own) for (minus, _), own in zip(terms, new, strict=True)))
        case Product():
            return Product(new)
        case Quotient():
            return Quotient(*new)
        case Power():
            return Power(*new)
        case Call():
            return replace(of, arguments=new)
        case Comparison():
            return replace(of, left=new[0], right=new[1])
        case Cases():
            return Cases(*new)
        case Window():
            return replace(of, signal=new[0])
    return of


def symbols(of: Expression) -> Iterator[Symbol]:
    """Every symbol in an expression."""
    if isinstance(of, Symbol):
        yield of
    if isinstance(of, Window):
        yield of.weights
    for own in children(of):
        yield from symbols(own)


def added(one: Expression, other: Expression, minus: bool = False) -> Expression:
    """A sum or difference, with sums among its terms taken apart."""
    first = one.terms if isinstance(one, Sum) else ((False, one),)
    second = other.terms if isinstance(other, Sum) else ((False, other),)
    return Sum((*map(_unsigned, first), *(_unsigned((sign != minus, term)) for sign, term in second)))


def multiplied(one: Expression, other: Expression) -> Expression:
    """A product, with signs drawn out and quotients kept together."""
    negative = _is_negative(one) != _is_negative(other)
    one, other = _positive(one), _positive(other)
    if isinstance(one, Constant) and one.value == 1.0:
        found: Expression = other
    elif isinstance(other, Constant) and other.value == 1.0:
        found = one
    else:
        if isinstance(other, Constant):
            one, other = other, one
        factors = tuple(
            factor for own in (one, other) for factor in (own.factors if isinstance(own, Product) else (own,))
        )
        found = Product(factors)
    return Sum(((True, found),)) if negative else found


def divided(one: Expression, other: Expression) -> Expression:
    """A quotient with its sign drawn out."""
    found = Quotient(_positive(one), _positive(other))
    return Sum(((True, found),)) if _is_negative(one) != _is_negative(other) else found


def _is_negative(own: Expression) -> bool:
    if isinstance(own, Constant):
        return own.value < 0
    return isinstance(own, Sum) and len(own.terms) == 1 and own.terms[0][0]


def _positive(own: Expression) -> Expression:
    if not _is_negative(own):
        return own
    if isinstance(own, Constant):
        return Constant(-own.value)
    assert isinstance(own, Sum)
    return own.terms[0][1]


def _unsigned(term: tuple[bool, Expression]) -> tuple[bool, Expression]:
    minus, own = term
    return (not minus, _positive(own)) if _is_negative(own) else (minus, own)
