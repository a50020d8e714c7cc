"""What a parameter that is zero leaves nothing of: terms that are multiplied by it need not be computed then."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet

import casadi as cs

from .graph import LOGIC, SLOW, TESTS, Graph, Leaf, Operation

LINEAR = {cs.OP_ASSIGN, cs.OP_LIFT, cs.OP_ADD, cs.OP_SUB, cs.OP_MUL, cs.OP_NEG, cs.OP_SQ, cs.OP_TWICE}
"""Operations that give zero for operands that are zero, whatever the others are, as long as they are numbers."""


def idle_without(graph: Graph, conditions: Sequence[AbstractSet[str]], stored: AbstractSet[int]) -> dict[int, int]:
    """Of values that matter only while a parameter is not zero, or moves: the place of that parameter.

    A parameter is taken where a slow function or a division depends on it that way, and where without it all others
    still act: that of a refinement, which many models leave at zero, not that of a whole force.

    Parameters
    ----------
    graph : the values.
    conditions : of each value, on what conditions it is wanted; "moving[k] >= 0" where it serves the derivative by
        parameter k.
    stored : values that are results under no condition.
    """
    places = {k: int(found[1]) for k, value in enumerate(graph.values) if (found := _parameter(value))}
    zero = _zero(graph, places)
    idle = _idle(graph, places, zero, conditions, stored)
    members = {place: [k for k in range(len(graph.values)) if place in idle[k]] for place in places.values()}
    pays = {
        place
        for place, values in members.items()
        if not any(k in places and places[k] != place for k in values)
        and any(_slow(graph, k) for k in values if not graph.fixed[k])
    }
    chosen = {
        k: min(own, key=lambda place: len(members[place])) for k, own_all in enumerate(idle) if (own := own_all & pays)
    }
    return {k: place for k, place in chosen.items() if k in graph.operations() and not graph.fixed[k]}


def _parameter(value: Leaf | Operation) -> re.Match[str] | None:
    return re.fullmatch(r"p\[(\d+)\]", value.text) if isinstance(value, Leaf) else None


def _slow(graph: Graph, k: int) -> bool:
    value = graph.values[k]
    return isinstance(value, Operation) and value.op in {*SLOW, cs.OP_DIV, cs.OP_INV}


def _zero(graph: Graph, places: Mapping[int, int]) -> list[frozenset[int]]:
    """Of each value, the parameters that are factors of it."""
    zero = list[frozenset[int]]()
    for k, value in enumerate(graph.values):
        if isinstance(value, Leaf):
            zero.append(frozenset({places[k]} if k in places else ()))
            continue
        own = [zero[source] for source in value.sources]
        if value.op == cs.OP_MUL:
            zero.append(own[0] | own[1])
        elif value.op in LINEAR:
            zero.append(frozenset.intersection(*own))
        else:
            zero.append(own[0] if value.op == cs.OP_DIV else frozenset())
    return zero


def _idle(
    graph: Graph,
    places: Mapping[int, int],
    zero: Sequence[frozenset[int]],
    conditions: Sequence[AbstractSet[str]],
    stored: AbstractSet[int],
) -> list[frozenset[int]]:
    """Of each value, the parameters without which nothing that is wanted depends on it."""
    everything = frozenset(places.values())
    idle = [everything] * len(graph.values)
    for k in stored:
        idle[k] = frozenset()
    for k in reversed(graph.operations()):
        value = graph.operations()[k]
        if value.op in TESTS or value.op in LOGIC:  # masks stay
            idle[k] = frozenset()
        (condition,) = conditions[k] if len(conditions[k]) == 1 else ("",)
        moving = re.fullmatch(r"moving\[(\d+)\] >= 0", condition)
        if moving:
            idle[k] |= {int(moving[1])}
        for position, source in enumerate(value.sources):
            spared = value.op in LINEAR or (value.op == cs.OP_DIV and position == 0)
            idle[source] &= idle[k] | zero[k] if spared else idle[k]
    return idle
