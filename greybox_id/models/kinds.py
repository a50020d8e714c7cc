"""What every kind of model does in a way of its own: one function for each question, with an answer for each kind.

    @by_kind
    def simulate(model: Model, recording: Recording) -> Prediction:
        "Free run of every unbroken run of a recording."
        raise BadInput(f"{model.name} is not simulated.")  # kinds that bring no answer

    @simulate.register(MotionModel)
    def _simulated(model: MotionModel, recording: Recording) -> Prediction: ...

A floor asks its questions in one of its modules and calls them like functions. A kind answers them in a module of its
own that is called after `Model.kind` (`fitting/scores/motion.py`, `fitting/motion.py`) and is imported when a model
of that kind is first asked about, or wherever else it calls `register`. So a new kind changes no file of the others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, update_wrapper
from importlib import import_module
from importlib.util import find_spec
from typing import Concatenate, Generic, ParamSpec, TypeVar

from ..base.errors import BadInput
from .model import Model

P = ParamSpec("P")
T = TypeVar("T")
Kind = TypeVar("Kind", bound=Model)


class ByKind(Generic[P, T]):
    """A question about a model, as a function.

    Parameters
    ----------
    otherwise : the answer for kinds that bring none, often a sentence that says why.
    """

    def __init__(self, otherwise: Callable[Concatenate[Model, P], T]) -> None:
        self._answers: dict[type[Model], Callable[..., T]] = {Model: otherwise}
        self._floor = otherwise.__module__.rpartition(".")[0]
        update_wrapper(self, otherwise)

    def __call__(self, model: Model, /, *args: P.args, **kwargs: P.kwargs) -> T:
        """The answer of the model's kind."""
        for kind in type(model).__mro__:
            if kind not in self._answers and vars(kind).get("kind"):
                _load(f"{self._floor}.{vars(kind)['kind']}")
            if kind in self._answers:
                return self._answers[kind](model, *args, **kwargs)
        raise TypeError(f"{model!r:.60} is no model.")

    def register(
        self, kind: type[Kind]
    ) -> Callable[[Callable[Concatenate[Kind, P], T]], Callable[Concatenate[Kind, P], T]]:
        """Decorator of a kind's own answer; it holds for subclasses too."""

        def keep(answer: Callable[Concatenate[Kind, P], T]) -> Callable[Concatenate[Kind, P], T]:
            self._answers[kind] = answer
            return answer

        return keep


def by_kind(otherwise: Callable[Concatenate[Model, P], T]) -> ByKind[P, T]:
    """Decorator: a function of a model, then anything, to which kinds of models bring answers of their own."""
    return ByKind(otherwise)


def must_be(kind: type[Kind], model: Model, otherwise: str = "") -> Kind:
    """The model, where it is of the kind that is needed. Raises `BadInput` with that sentence where it is not."""
    if isinstance(model, kind):
        return model
    raise BadInput(otherwise or f"{model.name} is {model.called}; {kind.called} is needed here.")


@cache
def _load(module: str) -> None:
    if find_spec(module) is not None:
        import_module(module)
