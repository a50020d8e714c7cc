"""Calling a model's equations with symbols, with a sentence where they cannot be traced: they may be anybody's own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any

import casadi as cs

from ..base.errors import BadModel, GreyboxError, near_or_all
from ..models.model import Model, Namespace

KINDS = {"x": "state", "u": "input", "p": "parameter"}
"""What the namespaces of equations hold."""


def called(
    model: Model, equations: Callable[..., Any], spaces: Mapping[str, Namespace], *arguments: object
) -> dict[str, Any]:
    """What equations give, by name.

    Parameters
    ----------
    model : whose equations these are.
    equations : to be called with the arguments.
    spaces : letter -> namespace that they read: x states, u inputs, p parameters.

    Raises
    ------
    BadModel : they read a name that there is not, branch on a symbol, or give no mapping of names.
    """
    with tracing(model, spaces):
        one = equations(*arguments)
    if not isinstance(one, Mapping):
        raise BadModel(f"The equations of {model.name} must give a mapping of names to expressions, not {one!r:.40}.")
    for name, value in one.items():
        if isinstance(value, str) or not isinstance(value, Real | cs.SX | cs.MX | cs.DM):
            raise BadModel(f"The equations of {model.name} give {name} as {value!r:.40}, which is no expression.")
    return dict(one)


@contextmanager
def tracing(model: Model, spaces: Mapping[str, Namespace]) -> Iterator[None]:
    """Say what goes wrong in equations, of a model or of its effects, as `BadModel`."""
    try:
        yield
    except GreyboxError:
        raise
    except Exception as error:
        where = _line(error.__traceback__)
        raise BadModel(f"Model {model.name}{where}: {_reason(model, error, spaces)}") from error


def must_be_numbers(model: Model, expressions: Mapping[str, Any], symbols: list[Any]) -> None:
    """Raise `BadModel` where an expression holds NaN, as it does where a function of `math` was given a symbol."""
    names = [name for name, value in expressions.items() if _holds_nan(value, symbols)]
    if names:
        raise BadModel(
            f"The equations of {model.name} give {', '.join(names)} as NaN. Functions of math, such as math.tan, make "
            "that of a CasADi symbol: use casadi.tan and the like."
        )


def _holds_nan(value: Any, symbols: list[Any]) -> bool:
    function = cs.Function("looked_through", symbols, [cs.SX(value)], {"allow_free": True})
    return any(
        function.instruction_id(k) == cs.OP_CONST and math.isnan(function.instruction_constant(k))
        for k in range(function.n_instructions())
    )


def _reason(model: Model, error: Exception, spaces: Mapping[str, Namespace]) -> str:
    if isinstance(error, AttributeError):
        for letter, space in spaces.items():
            if error.obj is space and error.name:
                hint = near_or_all(error.name, vars(space))
                return f"its equations read {letter}.{error.name}, but it has no {KINDS[letter]} {error.name}.{hint}"
        return str(error)
    if "truth value" in str(error):
        return (
            "its equations branch on a symbol (if, and, or, min, max), which has no value yet: use casadi.if_else, "
            "fmin or fmax."
        )
    return f"its equations cannot be traced: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"


def _line(trace: TracebackType | None) -> str:
    """The place in the equations' own file; nothing inside this package."""
    result = ""
    package = str(Path(__file__).parents[1])
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if not file.startswith(package) and "casadi" not in Path(file).parts:
            result = f" ({Path(file).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return result
