"""Equations traced once for all simulators of a task, since a trace takes as long as many a fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields

from ...models.motion_model import MotionModel
from .trace import MotionTrace

_KNOWN: ContextVar[list[MotionTrace] | None] = ContextVar("known", default=None)


@contextmanager
def traced_once() -> Iterator[None]:
    """Context in which equations are traced once for all their simulators.

    It should last no longer than a task: equations are a user's functions, and data that they read may change later.
    """
    known = _KNOWN.set([])
    try:
        yield
    finally:
        _KNOWN.reset(known)


def traced(model: MotionModel) -> MotionTrace:
    """A model's trace; within `traced_once` shared with earlier models of the same equations."""
    known = _KNOWN.get()
    if known is None:
        return MotionTrace(model)
    result = next((one.of(model) for one in known if _same_equations(one.model, model)), None)
    if result is None:
        result = MotionTrace(model)
        known.append(result)
    return result


def _same_equations(one: MotionModel, other: MotionModel) -> bool:
    """Whether the models differ in nothing but their parameters' values, bounds and priors."""
    if type(one) is not type(other):
        return False
    alike = all(getattr(one, f.name) is getattr(other, f.name) for f in fields(one) if f.name != "parameters")
    return alike and [(p.name, p.shape) for p in one.parameters] == [(p.name, p.shape) for p in other.parameters]
