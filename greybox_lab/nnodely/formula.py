"""Python source as a formula: parsed, never executed.

A function of a file is understood where it holds names, numbers, arithmetic, comparisons, assignments to names, the
functions below and one `return`. It is then evaluated by walking its tree; anything else ends in a sentence.
"""

from __future__ import annotations

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array

MOST_CODE = 5_000
"""Characters of one function."""
DEEPEST = 60
"""Levels of one expression."""
LIBRARIES = ("torch", "np", "numpy", "math")
CONSTANTS = {"pi": np.pi}
BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power,
}  # fmt: skip
COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Gt: operator.gt, ast.GtE: operator.ge, ast.Lt: operator.lt, ast.LtE: operator.le,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "tanh": np.tanh, "exp": np.exp, "sqrt": np.sqrt, "square": np.square,
    "abs": np.abs, "neg": np.negative, "add": np.add, "sub": np.subtract, "subtract": np.subtract, "mul": np.multiply,
    "multiply": np.multiply, "div": np.divide, "divide": np.divide, "pow": np.power, "minimum": np.minimum,
    "maximum": np.maximum, "gt": np.greater, "ge": np.greater_equal, "lt": np.less, "le": np.less_equal,
    "logical_not": np.logical_not, "where": np.where, "relu": lambda x: np.maximum(x, 0.0),
    "zeros_like": np.zeros_like, "clamp": lambda x, min=-np.inf, max=np.inf: np.clip(x, min, max),
}  # fmt: skip


@dataclass(frozen=True)
class Formula:
    """A function understood as arithmetic.

    Attributes
    ----------
    where : file and function, for sentences.
    arguments : names, in order.
    assignments : name -> expression, in order; the last one is the result.
    """

    where: str
    arguments: tuple[str, ...]
    assignments: tuple[tuple[str, ast.expr], ...]

    def __call__(self, *values: Array) -> Array:
        """The result for arrays that broadcast. Raises `BadInput` where there is not one value per argument."""
        if len(values) != len(self.arguments):
            raise BadInput(f"{self.where} takes {len(self.arguments)} arguments, but the file passes {len(values)}.")
        known: dict[str, Any] = dict(zip(self.arguments, values, strict=True))
        try:
            for name, expression in self.assignments:
                known[name] = self._value(expression, known)
        except (TypeError, ValueError) as error:  # a mask that is subtracted, windows of different lengths
            raise BadInput(f"{self.where} cannot be evaluated: {error}.") from error
        return np.asarray(known[self.assignments[-1][0]], dtype=float)

    def _value(self, node: ast.expr, known: Mapping[str, Any]) -> Any:
        match node:
            case ast.Constant(value=bool() | complex()):
                pass
            case ast.Constant(value=int() | float()):
                return self._number(node)
            case ast.Name(id=name) if name in known:
                return known[name]
            case ast.Attribute(value=ast.Name(id=library), attr=name) if library in LIBRARIES and name in CONSTANTS:
                return CONSTANTS[name]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in BINARY:
                return BINARY[type(op)](self._value(left, known), self._value(right, known))
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return np.negative(self._value(operand, known))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self._value(operand, known)
            case ast.UnaryOp(op=ast.Invert(), operand=operand):
                return np.logical_not(self._mask(operand, known))
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in COMPARISONS:
                return COMPARISONS[type(op)](self._value(left, known), self._value(right, known))
            case ast.Call(func=ast.Attribute(value=ast.Name(id=library), attr=name)) if (
                library in LIBRARIES and library not in known and name in FUNCTIONS
            ):
                return self._called(name, [], node, known)
            case ast.Call(func=ast.Attribute(value=own, attr=name)) if name in FUNCTIONS:
                return self._called(name, [self._value(own, known)], node, known)
        raise self._not_understood(node)

    def _called(self, name: str, first: list[Any], node: ast.Call, known: Mapping[str, Any]) -> Any:
        arguments = first + [self._value(arg, known) for arg in node.args]
        named = {
            keyword.arg: self._value(keyword.value, known) for keyword in node.keywords if keyword.arg in ("min", "max")
        }
        if len(named) < len(node.keywords) or (named and name != "clamp"):
            raise self._not_understood(node)  # out=, where= and dtype= of numpy are none of torch's
        taken = 3 if name == "where" else getattr(FUNCTIONS[name], "nin", 1)
        if len(arguments) != taken and not (name == "clamp" and 0 < len(arguments) + len(named) <= 3):
            raise self._not_understood(node)
        return FUNCTIONS[name](*arguments, **named)

    def _mask(self, node: ast.expr, known: Mapping[str, Any]) -> Any:
        value = self._value(node, known)
        if np.asarray(value).dtype != bool:
            raise self._not_understood(node)
        return value

    def _number(self, node: ast.Constant) -> np.float64:
        assert isinstance(node.value, int | float)
        try:
            return np.float64(node.value)
        except OverflowError as error:
            raise self._not_understood(node) from error

    def _not_understood(self, node: ast.expr) -> BadInput:
        return BadInput(
            f"{self.where}: {_quoted(node)} is not understood. Functions are read, "
            "never run: they may hold names, numbers, + - * / **, comparisons, assignments to names and torch's "
            f"{', '.join(FUNCTIONS)}."
        )


def formula(code: object, where: str) -> Formula:
    """Understand the source of one function.

    Raises
    ------
    BadInput : it is not one plain function of arithmetic.
    """
    if not isinstance(code, str) or len(code) > MOST_CODE:
        raise BadInput(f"{where} must be Python source of at most {MOST_CODE} characters.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what the compiler thinks of a stranger's spelling is not for the user
            body = ast.parse(code).body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f"{where} is not Python that can be read ({type(error).__name__}).") from error
    match body:
        case [ast.FunctionDef(args=arguments, body=lines, decorator_list=[])]:
            pass
        case _:
            raise BadInput(f"{where} is not one plain function; a lambda or a decorated one is not understood.")
    if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.defaults or arguments.posonlyargs:
        raise BadInput(f"{where}: only plain arguments, without defaults, are understood.")
    result: list[tuple[str, ast.expr]] = []
    for place, line in enumerate(lines):
        match line:
            case ast.Expr(value=ast.Constant(value=str())) if place == 0:
                continue
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if place < len(lines) - 1:
                result.append((name, value))
            case ast.Return(value=ast.expr() as value) if place == len(lines) - 1:
                result.append(("return", value))
            case _:
                raise BadInput(
                    f"{where}: {_quoted(line)} is not understood; only assignments to names and one return are."
                )
    if not result or result[-1][0] != "return":
        raise BadInput(f"{where} returns nothing.")
    if any(_deep(value) for _, value in result):
        raise BadInput(f"{where} nests its expressions deeper than {DEEPEST} levels.")
    return Formula(where, tuple(arg.arg for arg in arguments.args), tuple(result))


def _quoted(node: ast.AST) -> str:
    try:
        text = ast.unparse(node).splitlines()[0]
    except RecursionError:
        return "an expression"
    return text if len(text) <= 60 else text[:57] + "..."


def _deep(expression: ast.AST) -> bool:
    level: list[ast.AST] = [expression]
    for _ in range(DEEPEST):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return False
    return True
