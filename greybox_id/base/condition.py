"""Conditions on signals as people write them, `v_x > 5 and abs(steer) < 0.1`: parsed, never executed.

A condition may contain names of signals, `time`, numbers, + - * /, abs(), comparisons (also 1 < v_x < 5), and, or, not,
and brackets. In rows where one of its signals is missing, a condition is false.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import BadInput, near_or_all

Values = NDArray[np.float64]
LONGEST = 500
"""Largest number of characters of a condition."""
ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
}  # fmt: skip
COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Lt: operator.lt, ast.LtE: operator.le,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
EXAMPLE = "write it like v_x > 5 and abs(steer) < 0.1"


def span(text: str) -> tuple[float | None, float | None]:
    """Parse START:STOP in seconds; one of the two may be missing. Raises `BadInput`."""
    ends = text.split(":")
    try:
        start, stop = (float(end) if end.strip() else None for end in ends)
    except ValueError as error:
        raise BadInput(f"{text!r} is not START:STOP in seconds, as in 10:60, 10: or :60.") from error
    if any(end is not None and not abs(end) < np.inf for end in (start, stop)) or (start is None and stop is None):
        raise BadInput(f"{text!r} is not START:STOP in seconds, as in 10:60, 10: or :60.")
    if start is not None and stop is not None and start > stop:
        raise BadInput(f"{text!r} ends before it starts.")
    return start, stop


def holds(condition: str, signals: Mapping[str, Values]) -> NDArray[np.bool_]:
    """Rows in which a condition is true, (n,), for signals of (n,) values each.

    Raises
    ------
    BadInput
        The condition cannot be parsed, or names a signal that is not recorded.
    """
    if len(condition) > LONGEST:
        raise BadInput(f"The condition has {len(condition)} characters; at most {LONGEST} are allowed.")
    try:
        tree = ast.parse(condition.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f'The condition "{condition}" cannot be understood; {EXAMPLE}.') from error
    walk = _Walk(condition, signals)
    with np.errstate(all="ignore"):
        result = walk.truth(tree)
    finite = [np.isfinite(signals[name]) for name in walk.named]
    return np.asarray(np.logical_and.reduce([result, *finite]))


class _Walk:
    """Recursive evaluation of a condition's syntax tree."""

    def __init__(self, condition: str, signals: Mapping[str, Values]) -> None:
        self.condition, self.signals, self.named = condition, signals, set[str]()

    def truth(self, node: ast.expr) -> NDArray[np.bool_]:
        match node:
            case ast.BoolOp(op=joint, values=values):
                parts = [self.truth(value) for value in values]
                return np.asarray((np.logical_and if isinstance(joint, ast.And) else np.logical_or).reduce(parts))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return ~self.truth(operand)
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                values = [self.number(part) for part in (left, *comparators)]
                if all(type(op) in COMPARISONS for op in ops):
                    pairs = zip(ops, values, values[1:], strict=False)
                    return np.asarray(np.logical_and.reduce([COMPARISONS[type(op)](a, b) for op, a, b in pairs]))
        raise BadInput(f'In the condition "{self.condition}", "{ast.unparse(node)}" is no comparison; {EXAMPLE}.')

    def number(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=value) if isinstance(value, int | float) and not isinstance(value, bool):
                return np.full(self._rows, float(value) if abs(value) < 1e300 else np.inf)
            case ast.Name(id=name):
                if name not in self.signals:
                    raise BadInput(
                        f'The condition "{self.condition}" names {name}, which is not recorded.'
                        f"{near_or_all(name, self.signals)}"
                    )
                self.named.add(name)
                return self.signals[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in ARITHMETIC:
                return ARITHMETIC[type(op)](self.number(left), self.number(right))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.number(operand)
            case ast.Call(func=ast.Name(id="abs"), args=[argument], keywords=[]):
                return np.abs(self.number(argument))
        raise BadInput(
            f'In the condition "{self.condition}", "{ast.unparse(node)}" cannot be understood as a number; {EXAMPLE}.'
        )

    @property
    def _rows(self) -> int:
        return len(next(iter(self.signals.values()))) if self.signals else 0
