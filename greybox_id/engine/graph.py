"""A CasADi function as a graph of operations, from which C is emitted.

The emitted C is straight-line code in which every operation works on several lanes at once. CasADi's own generated
code evaluates one sample at a time; here each number is a vector of W trajectories ("lanes"), so that one machine
instruction serves them all. The code differs from CasADi's instruction list in that

- operations on parameters alone are evaluated once, before the segments;
- operations are ordered by the number of slow functions before them: independent calls (front and rear axle, say) then
  are adjacent and the processor overlaps them, which saves a third of the time;
- it is cut into pieces, as compilers allocate registers in time that grows with the square of a function's length.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as cs

from .compiler import CannotCompile

OPERATORS = {
    cs.OP_ASSIGN: "{0}",
    cs.OP_LIFT: "{0}",
    cs.OP_ADD: "{0} + {1}",
    cs.OP_SUB: "{0} - {1}",
    cs.OP_MUL: "{0} * {1}",
    cs.OP_DIV: "{0} / {1}",
    cs.OP_NEG: "-{0}",
    cs.OP_SQ: "{0} * {0}",
    cs.OP_TWICE: "{0} + {0}",
    cs.OP_INV: "splat(1) / {0}",
}
"""Operations written with C's operators."""

TESTS = {
    cs.OP_LT: "{0} < {1}",
    cs.OP_LE: "{0} <= {1}",
    cs.OP_EQ: "{0} == {1}",
    cs.OP_NE: "{0} != {1}",
}
"""Comparisons; their result is a mask, all bits set where true."""

LOGIC = {cs.OP_NOT: "~{0}", cs.OP_AND: "{0} & {1}", cs.OP_OR: "{0} | {1}"}
"""Operations on masks."""

SELECT = cs.OP_IF_ELSE_ZERO
CHEAP = ("fabs", "copysign", "fmin", "fmax", "sign", "sqrt", "floor", "ceil")
CALLS = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "log", "expm1", "log1p", "erf", "pow", "atan2", "hypot", "fmod", "remainder"),
)
FUNCTIONS = {getattr(cs, f"OP_{name.upper()}"): name for name in (*CHEAP, *CALLS)} | {cs.OP_CONSTPOW: "pow"}
"""Functions: cheap ones take a few instructions, calls of the mathematical library tens."""

KNOWN = {*OPERATORS, *TESTS, *LOGIC, SELECT, *FUNCTIONS}
SLOW = {op for op, name in FUNCTIONS.items() if name in CALLS}


@dataclass(frozen=True)
class Leaf:
    """An input of the graph: an entry of an argument, or a constant.

    Attributes
    ----------
    text : C expression.
    fixed : whether it is the same in all segments.
    """

    text: str
    fixed: bool


@dataclass(frozen=True)
class Operation:
    """A computed value.

    Attributes
    ----------
    op : CasADi's operation code.
    sources : numbers of its operands.
    """

    op: int
    sources: tuple[int, ...]


class Graph:
    """Values and their operands, without duplicates, in an order of evaluation.

    Attributes
    ----------
    values : leaves and operations.
    fixed : per value, whether it is the same in all segments.
    """

    def __init__(self) -> None:
        self.values: list[Leaf | Operation] = []
        self.fixed: list[bool] = []
        self._known: dict[Leaf | Operation, int] = {}

    def add(self, value: Leaf | Operation) -> int:
        """The number of a value, which is appended if it is new."""
        if value not in self._known:
            self._known[value] = len(self.values)
            self.values.append(value)
            self.fixed.append(value.fixed if isinstance(value, Leaf) else all(self.fixed[k] for k in value.sources))
        return self._known[value]

    def operations(self) -> dict[int, Operation]:
        """The operations among the values, by number."""
        return {k: value for k, value in enumerate(self.values) if isinstance(value, Operation)}


def traced(function: cs.Function, arguments: Sequence[str], fixed: str) -> tuple[Graph, list[list[int]]]:
    """The graph of an SX function, and for each result the numbers of its nonzeros.

    Divisors that are fixed or shared become reciprocals: a division costs as much as thirty multiplications. The
    result differs by a unit in the last place, and divisors below 1e-308 or above 1e307 fail.

    `arguments` are the names of its arguments in C, `fixed` the one that is the same in all segments.
    Raises `CannotCompile`.
    """
    graph = Graph()
    slots: dict[int, int] = {}  # CasADi reuses the entries of its work vector
    results = [[-1] * function.nnz_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        op, sources, targets = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == cs.OP_OUTPUT:
            results[targets[0]][targets[1]] = slots[sources[0]]
        elif op == cs.OP_INPUT:
            name = arguments[sources[0]]
            slots[targets[0]] = graph.add(Leaf(f"{name}[{sources[1]}]", name == fixed))
        elif op == cs.OP_CONST:
            slots[targets[0]] = graph.add(Leaf(_constant(function.instruction_constant(k)), True))
        elif op in KNOWN:
            slots[targets[0]] = graph.add(Operation(op, tuple(slots[j] for j in sources)))
        else:
            raise CannotCompile(f"The model uses CasADi's operation {op}, which cannot be written as C.")
    return _with_reciprocals(graph, results)


def _with_reciprocals(graph: Graph, results: list[list[int]]) -> tuple[Graph, list[list[int]]]:
    divisors = Counter(value.sources[1] for value in graph.operations().values() if value.op == cs.OP_DIV)
    rewritten, number = Graph(), list[int]()
    for value in graph.values:
        if isinstance(value, Operation):
            sources = tuple(number[k] for k in value.sources)
            if value.op == cs.OP_DIV and (graph.fixed[value.sources[1]] or divisors[value.sources[1]] > 1):
                value = Operation(cs.OP_MUL, (sources[0], rewritten.add(Operation(cs.OP_INV, sources[1:]))))
            else:
                value = Operation(value.op, sources)
        number.append(rewritten.add(value))
    return rewritten, [[number[k] for k in result] for result in results]


def _constant(value: float) -> str:
    if math.isnan(value):
        return "splat(NAN)"
    if math.isinf(value):
        return "splat(INFINITY)" if value > 0 else "splat(-INFINITY)"
    return f"splat({value.hex()})"
