"""How quantities are called in equations: as in textbooks where these agree, else as everywhere in the report."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..words import named
from .expression import (
    Call,
    Cases,
    Comparison,
    Constant,
    Expression,
    Power,
    Product,
    Quotient,
    Sum,
    Symbol,
    Window,
)

TEXTBOOK = {"yaw_rate": ("ψ", 1), "steer": ("δ", 0), "sideslip": ("β", 0)}
"""Name -> letter and dots over it."""
SUM, PRODUCT, POWER, ATOM = range(4)
"""How tightly an expression holds together."""


@dataclass(frozen=True)
class Letter:
    """A symbol as it is set.

    Attributes
    ----------
    body : a letter, or words.
    slanted : whether it is a letter.
    index : its parts; numbers and words stand upright.
    dots : over it.
    mark : at its upper right.
    """

    body: str
    slanted: bool
    index: tuple[str, ...]
    dots: int
    mark: str


def letter(symbol: Symbol) -> Letter:
    """How a symbol is set."""
    entry = tuple(str(k) for k in symbol.entry)
    if symbol.name in TEXTBOOK:
        body, dots = TEXTBOOK[symbol.name]
        return Letter(body, True, entry, dots + symbol.dots, symbol.mark)
    first, *more = named(symbol.name)
    if first.symbol and not more:
        return Letter(first.words, True, (*first.index, *entry), symbol.dots, symbol.mark)
    return Letter(symbol.name.replace("_", " "), False, entry, symbol.dots, symbol.mark)


def binding(of: Expression) -> int:
    """How tightly an expression holds together."""
    match of:
        case Sum() | Comparison() | Cases() | Window():
            return SUM
        case Product() | Quotient():
            return PRODUCT
        case Power():
            return POWER
        case Constant(value):
            return ATOM if value >= 0 else SUM
        case Call(name, _) if name == "sqrt":
            return ATOM
    return ATOM


def in_words(value: float) -> str:
    """A number as it is printed in an equation."""
    if value == round(value) and abs(value) < 1e6:
        return str(round(value))
    return f"{value:.4g}"


def is_worded(of: Expression) -> bool:
    """Whether an expression is set in words or digits, which need a dot between them and their neighbours."""
    return isinstance(of, Constant) or (isinstance(of, Symbol) and not letter(of).slanted)


def plainly(of: Expression) -> Expression:
    """An expression as it is set: a power of a half is a root, a sum of one positive term that term."""
    if isinstance(of, Power) and of.exponent == Constant(0.5):
        return Call("sqrt", (of.base,))
    if isinstance(of, Sum) and len(of.terms) == 1 and not of.terms[0][0] and not of.left_out:
        return of.terms[0][1]
    return replace(of)
