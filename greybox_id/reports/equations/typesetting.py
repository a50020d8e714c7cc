"""Typesetting of equations in two formats by one traversal: Typst for PDF, MathML for browsers.

Symbols are those of textbooks where these agree, and otherwise as elsewhere in the report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

from ..words import is_symbol_index, named
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

TEXTBOOK = {"yaw_rate": ("ψ", 1), "steer": ("δ", 0), "sideslip": ("β", 0)}
"""Name -> letter and number of dots."""
SUM, PRODUCT, POWER, ATOM = range(4)
"""Precedence of expressions, ascending."""
TYPST_SIGNS = {"≤": "<=", "≥": ">=", "≠": "!=", "−": "-"}


def in_typst(equation: Equation) -> str:
    """An equation in Typst."""
    return f"{_TYPST.symbol(equation.left)} = {_set(equation.right, _TYPST)}"


def in_mathml(equation: Equation) -> str:
    """An equation in MathML."""
    inside = f"{_MATHML.symbol(equation.left)}<mo>=</mo>{_set(equation.right, _MATHML)}"
    return f'<math xmlns="http://www.w3.org/1998/Math/MathML" displaystyle="true">{inside}</math>'


@dataclass(frozen=True)
class Letter:
    """A symbol ready for typesetting.

    Attributes
    ----------
    body : letter or words.
    slanted : whether it is a letter, typeset in italics.
    index : parts of the index; numbers and words are upright.
    dots : number of dots.
    mark : superscript.
    """

    body: str
    slanted: bool
    index: tuple[str, ...]
    dots: int
    mark: str


def letter(symbol: Symbol) -> Letter:
    """The typeset form of a symbol."""
    entry = tuple(str(k) for k in symbol.entry)
    if symbol.name in TEXTBOOK:
        body, dots = TEXTBOOK[symbol.name]
        return Letter(body, True, entry, dots + symbol.dots, symbol.mark)
    first, *more = named(symbol.name)
    if first.symbol and not more:
        return Letter(first.words, True, (*first.index, *entry), symbol.dots, symbol.mark)
    return Letter(symbol.name.replace("_", " "), False, entry, symbol.dots, symbol.mark)


def _binding(of: Expression) -> int:
    """Precedence of an expression."""
    match of:
        case Sum() | Comparison() | Cases() | Window():
            return SUM
        case Product() | Quotient():
            return PRODUCT
        case Power():
            return POWER
        case Constant(value):
            return ATOM if value >= 0 else SUM
    return ATOM


def _digits(value: float) -> str:
    """A number with the digits shown in equations."""
    return str(round(value)) if value == round(value) and abs(value) < 1e6 else f"{value:.4g}"


def _is_worded(of: Expression) -> bool:
    """Whether an expression consists of words or digits, which need a dot as the sign of multiplication."""
    return isinstance(of, Constant) or (isinstance(of, Symbol) and not letter(of).slanted)


def _plainly(of: Expression) -> Expression:
    """A simplified expression: a power of 1/2 as a root, a sum of one positive term as that term."""
    if isinstance(of, Power) and of.exponent == Constant(0.5):
        return Call("sqrt", (of.base,))
    if isinstance(of, Sum) and len(of.terms) == 1 and not of.terms[0][0] and not of.left_out:
        return of.terms[0][1]
    return of


def _set(of: Expression, to: _Typst | _MathML, within: int = SUM) -> str:
    """A typeset expression, in brackets if its precedence is lower than that of the expression around it."""
    of = _plainly(of)
    text = _bare(of, to)
    return to.bracketed(text) if _binding(of) < within else text


def _bare(of: Expression, to: _Typst | _MathML) -> str:
    match of:
        case Constant(value):
            return to.number(_digits(value))
        case Symbol():
            return to.symbol(of)
        case Sum(terms, left_out):
            return _sum(terms, left_out, to)
        case Product(factors):
            parts = [_set(factors[0], to, PRODUCT)]
            for before, item in pairwise(factors):
                parts += [to.dot if _is_worded(item) or _is_worded(before) else to.thin, _set(item, to, PRODUCT)]
            return to.row(*parts)
        case Quotient(above, below):
            return to.fraction(_set(above, to), _set(below, to))
        case Power(base, exponent):
            return to.power(_set(base, to, ATOM), _set(exponent, to))
        case Call(name, arguments) if name == SHIFTED:
            return to.shifted(_set(arguments[0], to), _set(arguments[1], to, PRODUCT))
        case Call(name, arguments):
            return to.call(name, [_set(argument, to) for argument in arguments])
        case Comparison(sign, left, right):
            return to.row(_set(left, to), to.operator(sign), _set(right, to))
        case Cases(where, value, otherwise):
            return to.cases(_set(where, to), _set(value, to), _set(otherwise, to))
        case Window(weights, signal, length):
            return to.window(to.symbol(weights, ("n",)), _set(signal, to), length)
    raise AssertionError(of)


def _sum(terms: Sequence[tuple[bool, Expression]], left_out: int, to: _Typst | _MathML) -> str:
    parts: list[str] = []
    for k, (minus, item) in enumerate(terms):
        if left_out and k == len(terms) - 1:
            parts += [to.operator("+"), to.dots]
        if minus or k:
            parts.append(to.operator("−" if minus else "+"))
        parts.append(_set(item, to, PRODUCT if minus else SUM))
    if left_out:
        parts.append(to.counted(left_out + len(terms)))
    return to.row(*parts)


class _Typst:
    """Elements of expressions in Typst."""

    dot, thin, dots = "dot.op", "thin", "dots.c"
    accents = ("", "dot", "dot.double", "dot.triple")

    def row(self, *parts: str) -> str:
        return " ".join(parts)

    def bracketed(self, inside: str) -> str:
        return f"lr(({inside}))"

    def operator(self, sign: str) -> str:
        return TYPST_SIGNS.get(sign, sign)

    def number(self, digits: str) -> str:
        digits, _, power = digits.partition("e")
        return f"{digits} dot.op 10^({int(power)})" if power else digits

    def symbol(self, symbol: Symbol, more: tuple[str, ...] = ()) -> str:
        value = letter(symbol)
        body = value.body if value.slanted else f'"{value.body}"'
        if value.dots:
            body = f"{self.accents[value.dots]}({body})"
        index = ", ".join([*(part if is_symbol_index(part) else f'"{part}"' for part in value.index), *more])
        lower = f"_({index})" if index else ""
        upper = {"": "", "′": "^prime"}.get(value.mark, f'^"{value.mark}"')
        return f"{body}{lower}{upper}"

    def fraction(self, above: str, below: str) -> str:
        return f"({above}) / ({below})"

    def power(self, base: str, exponent: str) -> str:
        return f"{base}^({exponent})"

    def shifted(self, of: str, by: str) -> str:
        return f"{of} lr((t - {by}))"

    def call(self, name: str, inside: list[str]) -> str:
        if name in ("sqrt", "abs"):
            return f"{name}({inside[0]})"
        return f'"e"^({inside[0]})' if name == "exp" else f'op("{name}") lr(({", ".join(inside)}))'

    def cases(self, where: str, value: str, otherwise: str) -> str:
        return f'cases({value} & "if" {where}, {otherwise} & "else")'

    def window(self, weight: str, signal: str, length: int) -> str:
        return f"sum_(n=1)^({length}) {weight} thin [ {signal} ]_(t - ({length} - n) T)"

    def counted(self, terms: int) -> str:
        return f'quad ("{terms} terms")'


class _MathML:
    """Elements of expressions in MathML."""

    dot, thin, dots = "<mo>·</mo>", '<mspace width="0.17em"/>', "<mo>⋯</mo>"
    accents = ("", "˙", "¨", "⃛")

    def row(self, *parts: str) -> str:
        return f"<mrow>{''.join(parts)}</mrow>"

    def bracketed(self, inside: str) -> str:
        return self.row("<mo>(</mo>", inside, "<mo>)</mo>")

    def operator(self, sign: str) -> str:
        return f"<mo>{escape(sign)}</mo>"

    def number(self, digits: str) -> str:
        digits, _, power = digits.replace("-", "−").partition("e")
        if not power:
            return f"<mn>{digits}</mn>"
        sign = "−" if power.startswith("−") else ""
        power = power.lstrip("+−").lstrip("0")
        return self.row(f"<mn>{digits}</mn>", self.dot, f"<msup><mn>10</mn><mn>{sign}{power}</mn></msup>")

    def symbol(self, symbol: Symbol, more: tuple[str, ...] = ()) -> str:
        value = letter(symbol)
        body = f"<mi>{escape(value.body)}</mi>" if value.slanted else f"<mtext>{escape(value.body)}</mtext>"
        if value.dots:
            body = f"<mover accent='true'>{body}<mo>{self.accents[value.dots]}</mo></mover>"
        parts = [
            f"<mi>{part}</mi>" if is_symbol_index(part) else f"<mtext>{escape(part)}</mtext>" for part in value.index
        ]
        parts += [f"<mi>{part}</mi>" for part in more]
        lower = self.row(self.operator(",").join(parts)) if parts else ""
        upper = f"<mtext>{escape(value.mark)}</mtext>" if value.mark else ""
        if lower and upper:
            return f"<msubsup>{body}{lower}{upper}</msubsup>"
        if lower:
            return f"<msub>{body}{lower}</msub>"
        return f"<msup>{body}{upper}</msup>" if upper else body

    def fraction(self, above: str, below: str) -> str:
        return f"<mfrac>{self.row(above)}{self.row(below)}</mfrac>"

    def power(self, base: str, exponent: str) -> str:
        return f"<msup>{self.row(base)}{self.row(exponent)}</msup>"

    def shifted(self, of: str, by: str) -> str:
        return self.row(of, "<mo>(</mo>", "<mi>t</mi>", "<mo>−</mo>", by, "<mo>)</mo>")

    def call(self, name: str, inside: list[str]) -> str:
        match name:
            case "sqrt":
                return f"<msqrt>{inside[0]}</msqrt>"
            case "abs":
                return self.row("<mo>|</mo>", inside[0], "<mo>|</mo>")
            case "exp":
                return f"<msup><mi mathvariant='normal'>e</mi>{self.row(inside[0])}</msup>"
        return self.row(f"<mi>{escape(name)}</mi>", "<mo>&#x2061;</mo>", self.operator("("),
                        self.operator(",").join(inside), self.operator(")"))  # fmt: skip

    def cases(self, where: str, value: str, otherwise: str) -> str:
        rows = (
            (value, self.row("<mtext>if</mtext>", '<mspace width="0.35em"/>', where)),
            (otherwise, "<mtext>else</mtext>"),
        )
        table = "".join(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in row)}</mtr>" for row in rows)
        return self.row("<mo stretchy='true' form='prefix'>{</mo>", f"<mtable columnalign='left'>{table}</mtable>")

    def window(self, weight: str, signal: str, length: int) -> str:
        ends = f"{self.row('<mi>n</mi>', '<mo>=</mo>', '<mn>1</mn>')}<mn>{length}</mn>"
        at = self.row(
            "<mi>t</mi>", "<mo>−</mo>", f"<mo>(</mo><mn>{length}</mn><mo>−</mo><mi>n</mi><mo>)</mo><mi>T</mi>"
        )
        looked_at = self.row("<mo>[</mo>", signal, "<mo>]</mo>")
        return self.row(
            f"<munderover><mo>∑</mo>{ends}</munderover>", weight, self.thin, f"<msub>{looked_at}{at}</msub>"
        )

    def counted(self, terms: int) -> str:
        return f'<mspace width="1em"/><mtext>({terms} terms)</mtext>'


_TYPST, _MATHML = _Typst(), _MathML()
