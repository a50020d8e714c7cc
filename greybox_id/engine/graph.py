"""A CasADi function as a graph of operations: what is emitted as C.

From a CasADi function to straight-line C in which every operation works on several lanes at once.

CasADi's own generated code evaluates one sample at a time. Here each number is a vector of W trajectories
("lanes"), so that one machine instruction serves them all. The code differs from CasADi's instruction list in that

- what depends on parameters alone is evaluated once, before the segments;
- operations are ordered by how many slow functions lie before them: independent calls (front and rear axle, say)
  stand side by side and the processor overlaps them, which takes a third off the time;
- it is cut into pieces, as compilers allocate registers in time that grows with the square of a function's length.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

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
"""Operations that C's operators do."""

TESTS = {
    cs.OP_LT: "{0} < {1}",
    cs.OP_LE: "{0} <= {1}",
    cs.OP_EQ: "{0} == {1}",
    cs.OP_NE: "{0} != {1}",
}
"""Comparisons: they give a mask, all bits set where true."""

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
    """A value that is given: an entry of an argument, or a constant.

    Attributes
    ----------
    text : what it is called in C.
    fixed : whether it is the same over all segments.
    """

    text: str
    fixed: bool


@dataclass(frozen=True)
class Operation:
    """A value that is computed.

    Attributes
    ----------
    op : CasADi's code.
    sources : the numbers of the values it works on.
    """

    op: int
    sources: tuple[int, ...]


class Graph:
    """Values and what they are made of, each once, in an order in which they can be evaluated.

    Attributes
    ----------
    values : given or computed.
    fixed : per value, whether it is the same over all segments.
    """

    def __init__(self) -> None:
        self.values: list[Leaf | Operation] = []
        self.fixed: list[bool] = []
        self._known: dict[Leaf | Operation, int] = {}

    def add(self, value: Leaf | Operation) -> int:
        """The number of a value, new or known."""
        if value not in self._known:
            self._known[value] = len(self.values)
            self.values.append(value)
            self.fixed.append(value.fixed if isinstance(value, Leaf) else all(self.fixed[k] for k in value.sources))
        return self._known[value]

    def operations(self) -> dict[int, Operation]:
        """The values that are computed, by number."""
        return {k: value for k, value in enumerate(self.values) if isinstance(value, Operation)}


def traced(function: cs.Function, arguments: Sequence[str], fixed: str) -> tuple[Graph, list[list[int]]]:
    """The graph of an SX function, and per result the numbers of its nonzeros.

    Divisors that are fixed or shared become reciprocals: a division costs as much as thirty multiplications. The
    result differs by a unit in the last place; divisors below 1e-308 or above 1e307 are the price.

    `arguments` are the names of its arguments in C, `fixed` the one that is the same over all segments.
    Raises `CannotCompile`.
    """
    graph = Graph()
    slots: dict[int, int] = {}  # CasADi uses the entries of its work vector again and again
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


PIECE = 500
"""Statements that make one C function."""


@dataclass(frozen=True)
class Result:
    """Where a result of a function goes.

    Attributes
    ----------
    name : the array in C that takes its nonzeros.
    conditions : what must hold in C for each nonzero to be wanted; "" always. None: all are.
    """

    name: str
    conditions: Sequence[str] | None = None


@dataclass(frozen=True)
class _Statement:
    """Computes a value or, with a target, stores it there; on a condition, if that is not empty."""

    value: int
    target: str = ""
    condition: str = ""


def straight_line(name: str, function: cs.Function, results: Sequence[Result], known: Sequence[str] = ()) -> str:
    """C functions `name_fixed(p, w)` and `name(z, s, p, w, results..., told...)`, on vectors of lanes.

    Parameters
    ----------
    function : SX function (z, s, p) -> results, of which the nonzeros are computed.
    results : where they go; what is not wanted is left as it was.
    known : C declarations of further arguments, which the conditions are about.

    Returns
    -------
    The text, with `NAME_KEPT` defined as the length of w, in which `name_fixed` leaves what `name` needs.
    """
    graph, numbers = traced(function, ("z", "s", "p"), "p")
    stores: dict[int, list[tuple[str, str]]] = {}  # value -> where it goes and on what condition
    for result, values in zip(results, numbers, strict=True):
        for k, (value, condition) in enumerate(zip(values, result.conditions or [""] * len(values), strict=True)):
            stores.setdefault(value, []).append((f"{result.name}[{k}]", condition))
    fixed, changing = (_cut(statements) for statements in _statements(graph, stores))
    writer = _Writer(graph, [*fixed, *changing])
    given = [f"const v *restrict {argument}" for argument in "zsp"]
    arguments = [*given, "v *restrict w", *[f"v *restrict {result.name}" for result in results], *known]
    return "\n".join(
        [
            f"#define {name.upper()}_KEPT {len(writer.kept)}",
            _function(f"{name}_fixed", [given[2], "v *restrict w"], writer.pieces[: len(fixed)]),
            _function(name, arguments, writer.pieces[len(fixed) :]),
        ]
    )


def _function(name: str, arguments: Sequence[str], pieces: Sequence[str]) -> str:
    """C function that is made of pieces, each a function itself."""
    call = ", ".join(argument.split()[-1].strip("*") for argument in arguments)
    text = [
        f"static NOINLINE void {name}_{k}({', '.join(arguments)})\n{{\n{piece}\n}}" for k, piece in enumerate(pieces)
    ]
    calls = [f"    {name}_{k}({call});" for k in range(len(pieces))]
    return "\n".join([*text, f"static void {name}({', '.join(arguments)})", "{", *calls, "}"])


def _statements(
    graph: Graph, stores: Mapping[int, Sequence[tuple[str, str]]]
) -> tuple[list[_Statement], list[_Statement]]:
    """What is done before the segments and what in each, in order."""
    operations = graph.operations()
    conditions = [{condition for _, condition in stores.get(k, ())} for k in range(len(graph.values))]
    for k in reversed(operations):
        for source in operations[k].sources:
            conditions[source] |= conditions[k]
    depths = [0] * len(graph.values)
    for k, value in operations.items():
        if not graph.fixed[k]:
            depths[k] = max(depths[source] for source in value.sources) + (value.op in SLOW)
    result = list[_Statement]()
    for k in sorted(range(len(graph.values)), key=depths.__getitem__):
        if k in operations and not graph.fixed[k]:
            result.append(_Statement(k, condition=next(iter(conditions[k])) if len(conditions[k]) == 1 else ""))
        result += [_Statement(k, target, condition) for target, condition in stores.get(k, ())]
    # what is always done comes first: the conditional parts build on it, and not on each other
    return [_Statement(k) for k in operations if graph.fixed[k]], sorted(
        result, key=lambda statement: statement.condition
    )


def _cut(statements: Sequence[_Statement]) -> list[Sequence[_Statement]]:
    return [statements[start : start + PIECE] for start in range(0, len(statements), PIECE)]


class _Writer:
    """Writes statements in C; a value that is used in another piece than its own goes through the array w.

    Attributes
    ----------
    pieces : bodies of C functions.
    kept : place in w of the values that go through it.
    """

    def __init__(self, graph: Graph, pieces: Sequence[Sequence[_Statement]]) -> None:
        self.graph = graph
        self.home = {s.value: k for k, piece in enumerate(pieces) for s in piece if not s.target}
        abroad = {source for k, piece in enumerate(pieces) for s in piece for source in self._uses(s, k)}
        self.kept = {value: place for place, value in enumerate(sorted(abroad))}
        self.pieces = [self._piece(k, piece) for k, piece in enumerate(pieces)]

    def _uses(self, statement: _Statement, piece: int) -> list[int]:
        """The values of other pieces that a statement uses."""
        value = self.graph.values[statement.value]
        used = [statement.value] if statement.target or isinstance(value, Leaf) else value.sources
        return [k for k in used if self.home.get(k, piece) != piece]

    def _piece(self, piece: int, statements: Sequence[_Statement]) -> str:
        lines = []
        for condition, group in groupby(statements, lambda statement: statement.condition):
            block = [line for statement in group for line in self._lines(statement, piece)]
            lines += [f"if ({condition}) {{", *block, "}"] if condition else block
        return "\n".join(f"    {line}" for line in lines)

    def _lines(self, statement: _Statement, piece: int) -> list[str]:
        k = statement.value
        if statement.target:
            return [f"{statement.target} = {self._name(k, piece)};"]
        return [self._definition(k, piece), *([f"w[{self.kept[k]}] = v{k};"] if k in self.kept else [])]

    def _definition(self, k: int, piece: int) -> str:
        value = self.graph.values[k]
        assert not isinstance(value, Leaf)
        if value.op in TESTS or value.op in LOGIC:
            # the mask is what most tests are for; the compiler drops the number where nobody asks for it
            operands = [(self._name if value.op in TESTS else self._mask)(source, piece) for source in value.sources]
            return (
                f"const m m{k} = {(TESTS | LOGIC)[value.op].format(*operands)}; const v v{k} = where(m{k}, splat(1));"
            )
        names = [self._name(source, piece) for source in value.sources]
        if value.op == SELECT:
            return f"const v v{k} = where({self._mask(value.sources[0], piece)}, {names[1]});"
        if value.op in OPERATORS:
            return f"const v v{k} = {OPERATORS[value.op].format(*names)};"
        return f"const v v{k} = v_{FUNCTIONS[value.op]}({', '.join(names)});"

    def _name(self, k: int, piece: int) -> str:
        value = self.graph.values[k]
        if isinstance(value, Leaf):
            return value.text
        return f"v{k}" if self.home[k] == piece else f"w[{self.kept[k]}]"

    def _mask(self, k: int, piece: int) -> str:
        """Where a value counts as true: anything but zero, NaN included."""
        value = self.graph.values[k]
        tested = not isinstance(value, Leaf) and (value.op in TESTS or value.op in LOGIC)
        return f"m{k}" if tested and self.home[k] == piece else f"({self._name(k, piece)} != splat(0))"
