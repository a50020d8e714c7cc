"""Equations as MathML, which browsers set themselves."""

from __future__ import annotations

from xml.sax.saxutils import escape

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
from .letters import PRODUCT, binding, in_words, is_worded, letter, plainly

DOTS = ("", "˙", "¨", "⃛")
THIN = '<mspace width="0.17em"/>'


def in_mathml(equation: Equation) -> str:
    """An equation."""
    inside = f"{_symbol(equation.left)}<mo>=</mo>{_set(equation.right)}"
    return f'<math xmlns="http://www.w3.org/1998/Math/MathML" displaystyle="true">{inside}</math>'


def _row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


def _operator(sign: str) -> str:
    return f"<mo>{escape(sign)}</mo>"


def _set(of: Expression, within: int = 0) -> str:
    of = plainly(of)
    own = _bare(of)
    return _row(_operator("("), own, _operator(")")) if binding(of) < within else own


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
                parts.append(_operator("·") if is_worded(own) or is_worded(before) else THIN)
                parts.append(_set(own, PRODUCT))
            return _row(*parts)
        case Quotient(above, below):
            return f"<mfrac>{_row(_set(above))}{_row(_set(below))}</mfrac>"
        case Power(base, exponent):
            return f"<msup>{_row(_set(base, 3))}{_row(_set(exponent))}</msup>"
        case Call(name, arguments):
            return _call(name, arguments)
        case Comparison(sign, left, right):
            return _row(_set(left), _operator(sign), _set(right))
        case Cases(where, value, otherwise):
            rows = (
                (_set(value), _row("<mtext>if</mtext>", '<mspace width="0.35em"/>', _set(where))),
                (_set(otherwise), "<mtext>else</mtext>"),
            )
            table = "".join(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in row)}</mtr>" for row in rows)
            return _row("<mo stretchy='true' form='prefix'>{</mo>", f"<mtable columnalign='left'>{table}</mtable>")
        case Window(weights, signal, length):
            ends = f"{_row('<mi>n</mi>', _operator('='), '<mn>1</mn>')}<mn>{length}</mn>"
            weight = _symbol(weights, ("n",))
            at = _row(
                "<mi>t</mi>", _operator("−"), f"<mo>(</mo><mn>{length}</mn><mo>−</mo><mi>n</mi><mo>)</mo><mi>T</mi>"
            )
            looked_at = _row(_operator("["), _set(signal), _operator("]"))
            return _row(f"<munderover><mo>∑</mo>{ends}</munderover>", weight, THIN, f"<msub>{looked_at}{at}</msub>")
    raise AssertionError(of)


def _sum(terms: tuple[tuple[bool, Expression], ...], left_out: int) -> str:
    parts: list[str] = []
    for k, (minus, own) in enumerate(terms):
        if left_out and k == len(terms) - 1:
            parts += [_operator("+"), _operator("⋯")]
        if minus or k:
            parts.append(_operator("−" if minus else "+"))
        parts.append(_set(own, PRODUCT if minus else 0))
    if left_out:
        parts.append(f'<mspace width="1em"/><mtext>({left_out + len(terms)} terms)</mtext>')
    return _row(*parts)


def _call(name: str, arguments: tuple[Expression, ...]) -> str:
    inside = [_set(own) for own in arguments]
    if name == SHIFTED:
        return _row(
            inside[0], _operator("("), "<mi>t</mi>", _operator("−"), _set(arguments[1], PRODUCT), _operator(")")
        )
    if name == "sqrt":
        return f"<msqrt>{inside[0]}</msqrt>"
    if name == "abs":
        return _row(_operator("|"), inside[0], _operator("|"))
    if name == "exp":
        return f"<msup><mi mathvariant='normal'>e</mi>{_row(inside[0])}</msup>"
    between = _operator(",").join(inside)
    return _row(f"<mi>{escape(name)}</mi>", "<mo>&#x2061;</mo>", _operator("("), between, _operator(")"))


def _symbol(symbol: Symbol, more: tuple[str, ...] = ()) -> str:
    own = letter(symbol)
    body = f"<mi>{escape(own.body)}</mi>" if own.slanted else f"<mtext>{escape(own.body)}</mtext>"
    if own.dots:
        body = f"<mover accent='true'>{body}<mo>{DOTS[own.dots]}</mo></mover>"
    parts = [f"<mi>{part}</mi>" if is_symbol_index(part) else f"<mtext>{escape(part)}</mtext>" for part in own.index]
    parts += [f"<mi>{part}</mi>" for part in more]
    lower = _row(_operator(",").join(parts)) if parts else ""
    upper = f"<mtext>{escape(own.mark)}</mtext>" if own.mark else ""
    if lower and upper:
        return f"<msubsup>{body}{lower}{upper}</msubsup>"
    if lower:
        return f"<msub>{body}{lower}</msub>"
    return f"<msup>{body}{upper}</msup>" if upper else body


def _number(value: float) -> str:
    words = in_words(value).replace("-", "−")
    if "e" in words:
        digits, power = words.split("e")
        sign = "−" if power.startswith("−") else ""
        power = power.lstrip("+−").lstrip("0")
        return _row(f"<mn>{digits}</mn>", _operator("·"), f"<msup><mn>10</mn><mn>{sign}{power}</mn></msup>")
    return f"<mn>{words}</mn>"
