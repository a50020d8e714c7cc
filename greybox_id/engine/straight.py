"""From a CasADi function to straight-line C in which every operation works on several lanes at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import groupby

import casadi as cs

from .graph import FUNCTIONS, LOGIC, OPERATORS, SELECT, SLOW, TESTS, Graph, Leaf, traced
from .idle import idle_without

PIECE = 500
"""Statements per C function."""


@dataclass(frozen=True)
class Result:
    """Destination of a function's result.

    Attributes
    ----------
    name : C array for its nonzeros.
    conditions : for each nonzero, the C condition under which it is stored; "" always. None: all always.
    """

    name: str
    conditions: Sequence[str] | None = None


@dataclass(frozen=True)
class _Statement:
    """Computes a value or, with a target, stores it there; under a condition, if that is not empty.

    `unless_zero` : index of a parameter without which (zero, and no derivative by it wanted) the value has no effect.
    """

    value: int
    target: str = ""
    condition: str = ""
    unless_zero: int | None = None


def straight_line(
    name: str,
    function: cs.Function,
    results: Sequence[Result],
    known: Sequence[str] = (),
    refining: AbstractSet[int] = frozenset(),
) -> str:
    """C functions `name_fixed(p, w)` and `name(z, s, p, w, results..., known...)`, on vectors of lanes.

    Parameters
    ----------
    function : SX function (z, s, p) -> results, of which the nonzeros are computed.
    results : destinations; entries whose condition is false are left unchanged.
    known : C declarations of further arguments, which conditions refer to.
    refining : indices of parameters whose terms are skipped while they are zero.

    Returns
    -------
    The C text, with `NAME_KEPT` defined as the length of w, in which `name_fixed` leaves values for `name`.
    """
    graph, numbers = traced(function, ("z", "s", "p"), "p")
    stores: dict[int, list[tuple[str, str]]] = {}  # value -> its destinations and their conditions
    for result, values in zip(results, numbers, strict=True):
        for k, (value, condition) in enumerate(zip(values, result.conditions or [""] * len(values), strict=True)):
            stores.setdefault(value, []).append((f"{result.name}[{k}]", condition))
    fixed, changing = (_cut(statements) for statements in _statements(graph, stores, refining))
    moving = any("moving" in declaration for declaration in known)
    writer = _Writer(graph, [*fixed, *changing], "any_set(p[{0}])" + " || moving[{0}] >= 0" * moving)
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
    """A C function that calls its pieces, each a function too."""
    call = ", ".join(argument.split()[-1].strip("*") for argument in arguments)
    text = [
        f"static NOINLINE void {name}_{k}({', '.join(arguments)})\n{{\n{piece}\n}}" for k, piece in enumerate(pieces)
    ]
    calls = [f"    {name}_{k}({call});" for k in range(len(pieces))]
    return "\n".join([*text, f"static void {name}({', '.join(arguments)})", "{", *calls, "}"])


def _statements(
    graph: Graph, stores: Mapping[int, Sequence[tuple[str, str]]], refining: AbstractSet[int]
) -> tuple[list[_Statement], list[_Statement]]:
    """Statements before the segments, and those of each segment, in order."""
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
    stored = {k: {condition for _, condition in several} for k, several in stores.items()}
    idle = idle_without(graph, stored, conditions, refining)
    for k in sorted(range(len(graph.values)), key=depths.__getitem__):
        if k in operations and not graph.fixed[k]:
            condition = next(iter(conditions[k])) if len(conditions[k]) == 1 else ""
            result.append(_Statement(k, condition=condition, unless_zero=None if condition else idle.get(k)))
        result += [_Statement(k, target, condition) for target, condition in stores.get(k, ())]
    # unconditional statements come first: the conditional parts depend on them, and not on each other
    return [_Statement(k) for k in operations if graph.fixed[k]], sorted(
        result, key=lambda statement: statement.condition
    )


def _cut(statements: Sequence[_Statement]) -> list[Sequence[_Statement]]:
    return [statements[start : start + PIECE] for start in range(0, len(statements), PIECE)]


class _Writer:
    """Writes statements in C; a value used in another piece than its own is passed through the array w.

    Attributes
    ----------
    pieces : bodies of C functions.
    kept : index in w of the values that pass through it.
    """

    def __init__(self, graph: Graph, pieces: Sequence[Sequence[_Statement]], acts: str) -> None:
        self.graph = graph
        self.acts = acts
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
        tested = sorted({s.unless_zero for s in statements if s.unless_zero is not None})
        lines = [f"const int acts{k} = {self.acts.format(k)};" for k in tested]
        for (condition, parameter), several in groupby(statements, lambda s: (s.condition, s.unless_zero)):
            group = list(several)
            if parameter is not None:
                lines += self._where_it_acts(group, parameter, piece)
                continue
            block = [line for statement in group for line in self._lines(statement, piece)]
            lines += [f"if ({condition}) {{", *block, "}"] if condition else block
        return "\n".join(f"    {line}" for line in lines)

    def _where_it_acts(self, statements: Sequence[_Statement], parameter: int, piece: int) -> list[str]:
        """Statements whose values are set to zero while a parameter does not act."""
        values = [statement.value for statement in statements]
        return [
            f"v {', '.join(f'v{k} = splat(0)' for k in values)};",
            f"if (acts{parameter}) {{",
            *[f"v{k} = {self._expression(k, piece)};" for k in values],
            "}",
            *[f"w[{self.kept[k]}] = v{k};" for k in values if k in self.kept],
        ]

    def _lines(self, statement: _Statement, piece: int) -> list[str]:
        k = statement.value
        if statement.target:
            return [f"{statement.target} = {self._name(k, piece)};"]
        return [self._definition(k, piece), *([f"w[{self.kept[k]}] = v{k};"] if k in self.kept else [])]

    def _definition(self, k: int, piece: int) -> str:
        value = self.graph.values[k]
        assert not isinstance(value, Leaf)
        if value.op in TESTS or value.op in LOGIC:
            # most tests are used as masks only; the compiler then drops the number
            operands = [(self._name if value.op in TESTS else self._mask)(source, piece) for source in value.sources]
            return (
                f"const m m{k} = {(TESTS | LOGIC)[value.op].format(*operands)}; const v v{k} = where(m{k}, splat(1));"
            )
        return f"const v v{k} = {self._expression(k, piece)};"

    def _expression(self, k: int, piece: int) -> str:
        value = self.graph.values[k]
        assert not isinstance(value, Leaf)
        names = [self._name(source, piece) for source in value.sources]
        if value.op == SELECT:
            return f"where({self._mask(value.sources[0], piece)}, {names[1]})"
        if value.op in OPERATORS:
            return OPERATORS[value.op].format(*names)
        return f"v_{FUNCTIONS[value.op]}({', '.join(names)})"

    def _name(self, k: int, piece: int) -> str:
        value = self.graph.values[k]
        if isinstance(value, Leaf):
            return value.text
        return f"v{k}" if self.home[k] == piece else f"w[{self.kept[k]}]"

    def _mask(self, k: int, piece: int) -> str:
        """Mask of the lanes in which a value is true: not zero, NaN included."""
        value = self.graph.values[k]
        tested = not isinstance(value, Leaf) and (value.op in TESTS or value.op in LOGIC)
        return f"m{k}" if tested and self.home[k] == piece else f"({self._name(k, piece)} != splat(0))"
