"""Idle terms: values that have no effect while a parameter is zero need not be computed then."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet

import casadi as cs

from .graph import LOGIC, SLOW, TESTS, Graph, Leaf, Operation, traced

LINEAR = {cs.OP_ASSIGN, cs.OP_LIFT, cs.OP_ADD, cs.OP_SUB, cs.OP_MUL, cs.OP_NEG, cs.OP_SQ, cs.OP_TWICE}
"""Operations whose result vanishes with an operand, or with all of them, if the others are finite."""


ZERO_AT_ZERO = {
    *(cs.OP_SIN, cs.OP_TAN, cs.OP_ASIN, cs.OP_ATAN, cs.OP_SINH, cs.OP_TANH, cs.OP_ASINH, cs.OP_ATANH),
    *(cs.OP_EXPM1, cs.OP_LOG1P, cs.OP_ERF, cs.OP_SQRT, cs.OP_FABS),
}
"""Functions that give zero for zero."""


def refinements(function: cs.Function) -> frozenset[int]:
    """Indices of parameters whose being zero makes a slow function or a division idle, but no other parameter.

    Such a parameter is that of a refinement, which many models leave at zero; a parameter that scales a whole force
    makes the force's other parameters idle too.

    Parameters
    ----------
    function : (z, s, p) -> results.
    """
    graph, results = traced(function, ("z", "s", "p"), "p")
    idle = _idle(graph, {k: {""} for result in results for k in result}, [{""}] * len(graph.values))
    places = _places(graph)
    saved = {place for k, reasons in enumerate(idle) if _slow(graph, k) and not graph.fixed[k] for place in reasons}
    return frozenset(
        saved - {place for k, reasons in enumerate(idle) if k in places for place in reasons - {places[k]}}
    )


def idle_without(
    graph: Graph,
    stored: Mapping[int, AbstractSet[str]],
    conditions: Sequence[AbstractSet[str]],
    parameters: AbstractSet[int],
) -> dict[int, int]:
    """Values without effect while a parameter is zero and no derivative by it is wanted: value -> parameter's index.

    Parameters
    ----------
    graph : the values.
    stored : for values that are results, the conditions of storing them; "moving[k] >= 0" for derivatives by
        parameter k.
    conditions : the conditions under which each value is needed.
    parameters : indices of the parameters to consider.
    """
    idle = [reasons & parameters for reasons in _idle(graph, stored, conditions)] if parameters else []
    count = Counter(place for reasons in idle for place in reasons)
    return {
        k: min(reasons, key=lambda place: (count[place], place))
        for k, reasons in enumerate(idle)
        if reasons and isinstance(graph.values[k], Operation) and not graph.fixed[k]
    }


def _places(graph: Graph) -> dict[int, int]:
    """The values that are parameters, and their indices in p."""
    matches = {k: re.fullmatch(r"p\[(\d+)\]", v.text) for k, v in enumerate(graph.values) if isinstance(v, Leaf)}
    return {k: int(match[1]) for k, match in matches.items() if match}


def _slow(graph: Graph, k: int) -> bool:
    value = graph.values[k]
    return isinstance(value, Operation) and value.op in {*SLOW, cs.OP_DIV, cs.OP_INV}


def _zero(graph: Graph, places: Mapping[int, int]) -> list[frozenset[int]]:
    """For each value, the parameters of which it is a multiple: it vanishes with any of them."""
    zero = list[frozenset[int]]()
    for k, value in enumerate(graph.values):
        if isinstance(value, Leaf):
            zero.append(frozenset({places[k]} if k in places else ()))
            continue
        of_sources = [zero[source] for source in value.sources]
        if value.op == cs.OP_MUL:
            zero.append(of_sources[0] | of_sources[1])
        elif value.op in LINEAR or value.op in ZERO_AT_ZERO:
            zero.append(frozenset.intersection(*of_sources))
        else:
            zero.append(of_sources[0] if value.op == cs.OP_DIV else frozenset())
    return zero


def _idle(
    graph: Graph, stored: Mapping[int, AbstractSet[str]], conditions: Sequence[AbstractSet[str]]
) -> list[frozenset[int]]:
    """For each value, the parameters whose being zero makes it without effect on all results."""
    places = _places(graph)
    zero = _zero(graph, places)
    idle = [frozenset(places.values())] * len(graph.values)
    for k, several in stored.items():
        idle[k] = _moving(several)
    operations = graph.operations()
    for k in reversed(operations):
        value = operations[k]
        idle[k] |= _moving(conditions[k])
        if value.op in TESTS or value.op in LOGIC:  # masks are always computed
            idle[k] = frozenset()
        for position, source in enumerate(value.sources):
            spared = value.op in LINEAR or (value.op == cs.OP_DIV and position == 0)
            idle[source] &= idle[k] | zero[k] if spared else idle[k]
    return idle


def _moving(conditions: AbstractSet[str]) -> frozenset[int]:
    """The parameter whose derivative is wanted, if that is the only condition."""
    match = re.fullmatch(r"moving\[(\d+)\] >= 0", next(iter(conditions))) if len(conditions) == 1 else None
    return frozenset({int(match[1])} if match else ())
