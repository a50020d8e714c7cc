"""Equations in the language of the typesetter of the PDF."""

from __future__ import annotations

from ..words import is_symbol_index
from .expression import (
    SHIFTED,
    Call,
    Cases,
    Comparison,
    Constant,
    Equation,
    Expression,
    Power,
    Product,
    Quotient,
    Sum,
    Symbol,
    Window,
)
from .letters import PRODUCT, SUM, binding, in_words, is_worded, letter, plainly

SIGNS = {"<": "<", "≤": "<=", "≥": ">=", ">": ">", "=": "=", "≠": "!=", "and": "and", "or": "or"}
DOTS = ("", "dot", "dot.double", "dot.triple")


def in_typst(equation: Equation) -> str:
    """An equation."""
    return f"{_symbol(equation.left)} = {_set(equation.right)}"


def _set(of: Expression, within: int = 0) -> str:
    of = plainly(of)
    own = _bare(of)
    return f"lr(({own}))" if binding(of) < within else own


def _bare(of: Expression) -> str:
    match of:
        case Constant(value):
            return _number(value)
        case Symbol():
            return _symbol(of)
        case Sum(terms, left_out):
            return _sum(terms, left_out)
        case Product(factors):
            parts = [_set(factors[0], PRODUCT)]
            for before, own in zip(factors, factors[1:], strict=False):
                parts.append("dot.op" if is_worded(own) or is_worded(before) else "thin")
                parts.append(_set(own, PRODUCT))
            return " ".join(parts)
        case Quotient(above, below):
            return f"({_set(above)}) / ({_set(below)})"
        case Power(base, exponent):
            return f"{_set(base, 3)}^({_set(exponent)})"
        case Call(name, arguments):
            return _call(name, arguments)
        case Comparison(sign, left, right):
            return f"{_set(left)} {SIGNS[sign]} {_set(right)}"
        case Cases(where, value, otherwise):
            return f'cases({_set(value)} & "if" {_set(where)}, {_set(otherwise)} & "else")'
        case Window(weights, signal, length):
            weight = _symbol(Symbol(weights.name, weights.entry), ("n",))
            return f"sum_(n=1)^({length}) {weight} thin [ {_set(signal)} ]_(t - ({length} - n) T)"
    raise AssertionError(of)


def _sum(terms: tuple[tuple[bool, Expression], ...], left_out: int) -> str:
    parts: list[str] = []
    for k, (minus, own) in enumerate(terms):
        if left_out and k == len(terms) - 1:
            parts.append("+ dots.c")
        sign = "-" if minus else ("+" if k else "")
        parts.append(f"{sign} {_set(own, PRODUCT if minus else SUM)}".strip())
    more = f' quad ("{left_out + len(terms)} terms")' if left_out else ""
    return " ".join(parts) + more


def _call(name: str, arguments: tuple[Expression, ...]) -> str:
    inside = [_set(own) for own in arguments]
    if name == SHIFTED:
        return f"{inside[0]} lr((t - {_set(arguments[1], PRODUCT)}))"
    if name == "sqrt":
        return f"sqrt({inside[0]})"
    if name == "abs":
        return f"abs({inside[0]})"
    if name == "exp":
        return f'"e"^({inside[0]})'
    return f'op("{name}") lr(({", ".join(inside)}))'


def _symbol(symbol: Symbol, more: tuple[str, ...] = ()) -> str:
    own = letter(symbol)
    body = own.body if own.slanted else f'"{own.body}"'
    if own.dots:
        body = f"{DOTS[own.dots]}({body})"
    index = ", ".join([*(part if is_symbol_index(part) else f'"{part}"' for part in own.index), *more])
    lower = f"_({index})" if index else ""
    upper = {"": "", "′": "^prime"}.get(own.mark, f'^"{own.mark}"')
    return f"{body}{lower}{upper}"


def _number(value: float) -> str:
    words = in_words(value)
    if "e" in words:
        digits, power = words.split("e")
        return f"{digits} dot.op 10^({int(power)})"
    return words
