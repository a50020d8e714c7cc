"""Equations of a model, derived by evaluating it once with CasADi symbols."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as cs

from ...models.model import Model, by_kind
from ...models.model import Symbol as Casadi
from .expression import (
    Call,
    Cases,
    Comparison,
    Constant,
    Equation,
    Expression,
    Power,
    Quotient,
    Sum,
    Symbol,
    added,
    divided,
    multiplied,
)

ONE_ARGUMENT = {
    cs.OP_EXP: "exp", cs.OP_LOG: "ln", cs.OP_SQRT: "sqrt", cs.OP_SIN: "sin", cs.OP_COS: "cos", cs.OP_TAN: "tan",
    cs.OP_ASIN: "arcsin", cs.OP_ACOS: "arccos", cs.OP_ATAN: "arctan", cs.OP_FABS: "abs", cs.OP_SIGN: "sgn",
    cs.OP_SINH: "sinh", cs.OP_COSH: "cosh", cs.OP_TANH: "tanh", cs.OP_ERF: "erf", cs.OP_FLOOR: "floor",
    cs.OP_CEIL: "ceil", cs.OP_NOT: "not", cs.OP_LOG1P: "log1p", cs.OP_EXPM1: "expm1", cs.OP_ASINH: "arsinh",
}  # fmt: skip
TWO_ARGUMENTS = {cs.OP_FMIN: "min", cs.OP_FMAX: "max", cs.OP_ATAN2: "arctan2", cs.OP_HYPOT: "hypot", cs.OP_FMOD: "mod"}
SIGNS = {cs.OP_LT: "<", cs.OP_LE: "≤", cs.OP_EQ: "=", cs.OP_NE: "≠", cs.OP_AND: "and", cs.OP_OR: "or"}

TWO = Constant(2.0)


class Reader:
    """Converts CasADi expressions of known symbols.

    Parameters
    ----------
    known : name of a CasADi symbol -> expression that it represents.
    """

    def __init__(self, known: Mapping[str, Expression] | None = None) -> None:
        self.known = dict(known or {})
        self._read: dict[int, Expression] = {}
        self._kept: list[Casadi] = []  # hashes are unique only among nodes that still exist

    def named(self, expression: Expression, name: str = "") -> Casadi:
        """A new CasADi symbol that represents an expression."""
        name = name or repr(expression)
        self.known[name] = expression
        return cs.SX.sym(name)

    def __call__(self, of: Casadi) -> Expression:
        """Convert one scalar expression."""
        node = cs.SX(of)
        key = node.element_hash()
        if key not in self._read:
            self._kept.append(node)
            self._read[key] = self._made(node)
        return self._read[key]

    def _made(self, node: Casadi) -> Expression:
        if node.is_constant():
            return Constant(float(node))
        if node.is_symbolic():
            return self.known[node.name()]
        op = node.op()
        parts = [node.dep(k) for k in range(node.n_dep())]
        if op in (cs.OP_ADD, cs.OP_SUB):
            cases = self._cases(parts) if op == cs.OP_ADD else None
            return cases or added(self(parts[0]), self(parts[1]), minus=op == cs.OP_SUB)
        if op in ONE_ARGUMENT:
            return Call(ONE_ARGUMENT[op], (self(parts[0]),))
        if op in TWO_ARGUMENTS:
            first, second = self(parts[0]), self(parts[1])
            if op == cs.OP_FMAX and isinstance(first, Call) and first.name == "abs" and second == Constant(0.0):
                return first
            return Call(TWO_ARGUMENTS[op], (first, second))
        if op in SIGNS:
            return Comparison(SIGNS[op], self(parts[0]), self(parts[1]))
        return _ELSE[op](*(self(part) for part in parts))

    def _cases(self, parts: list[Casadi]) -> Expression | None:
        """A sum of values under complementary conditions, as cases; None for any other sum."""
        if not all(part.op() == cs.OP_IF_ELSE_ZERO for part in parts if not part.is_leaf()):
            return None
        if any(part.is_leaf() for part in parts):
            return None
        first, second = (part.dep(0) for part in parts)
        if second.op() == cs.OP_NOT and second.dep(0).element_hash() == first.element_hash():
            return Cases(self(first), self(parts[0].dep(1)), self(parts[1].dep(1)))
        if first.op() == cs.OP_NOT and first.dep(0).element_hash() == second.element_hash():
            return Cases(self(second), self(parts[1].dep(1)), self(parts[0].dep(1)))
        return None


_ELSE: dict[int, Callable[..., Expression]] = {
    cs.OP_MUL: multiplied,
    cs.OP_DIV: divided,
    cs.OP_NEG: lambda item: multiplied(Constant(-1.0), item),
    cs.OP_SQ: lambda item: Power(item, TWO),
    cs.OP_TWICE: lambda item: multiplied(TWO, item),
    cs.OP_POW: Power,
    cs.OP_CONSTPOW: Power,
    cs.OP_INV: lambda item: Quotient(Constant(1.0), item),
    cs.OP_IF_ELSE_ZERO: lambda where, value: Cases(where, value, Constant(0.0)),
}


def is_plain(of: Expression) -> bool:
    """Whether an expression is only a number or the name of a quantity."""
    return isinstance(of, Constant | Symbol) or (isinstance(of, Sum) and not of.terms)


@by_kind
def traced(model: Model) -> tuple[Equation, ...]:
    """Equations of the model with all its effects; empty for kinds of models that register no conversion."""
    return ()
